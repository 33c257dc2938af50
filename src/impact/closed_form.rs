//! Layer 1: closed forms, each with its thesis equation. Where the printed form is off, the right one stands here and the
//! slip is named.
//!
//! One dimension: speeds along the face's normal, positive toward the incoming ball for the racket; `b` is the distance of
//! the impact from the centre of mass toward the tip, m.

use std::f64::consts::PI;

/// Apparent coefficient of restitution (eq 2.4): `(e m_e − m)/(m_e + m)`.
pub fn apparent_restitution(ball_mass: f64, effective_mass: f64, e: f64) -> f64 {
    (e * effective_mass - ball_mass) / (effective_mass + ball_mass)
}

/// Bounce of a ball with spin on a surface (Daish; eq 2.13 to 2.20): `tangential` speed of its centre relative to the surface, `normal`
/// approach speed, `spin` positive as topspin, `factor` = I/(m r²). Returns tangential speed and spin after.
///
/// The thesis uses 2/3 (a thin shell); a real ball has about 0.55.
pub fn daish_bounce(radius: f64, factor: f64, friction: f64, e: f64, tangential: f64, normal: f64, spin: f64) -> (f64, f64) {
    let slip = tangential - radius * spin;
    if friction >= roll_threshold(factor, e, slip, normal) {
        let after = (tangential + factor * radius * spin) / (1.0 + factor);
        return (after, after / radius);
    }
    let taken = friction * normal * (1.0 + e) * slip.signum();
    (tangential - taken, spin + taken / (factor * radius))
}

/// Friction from which the ball leaves rolling: `β |u − aω| / [(1 + β) v (1 + e)]`.
pub fn roll_threshold(factor: f64, e: f64, slip: f64, normal: f64) -> f64 {
    factor * slip.abs() / ((1.0 + factor) * normal * (1.0 + e))
}

/// Spin after the bounce of a ball squeezed by the share `k` of its radius (Brody, eq 2.22 with `(u − u')`; the printed sign
/// is wrong for topspin counted positive): the effective arm is `r (1 − k π/4)`.
pub fn compressed_ball_spin(radius: f64, factor: f64, squeeze: f64, spin: f64, before: f64, after: f64) -> f64 {
    spin + (1.0 - squeeze * PI / 4.0) / (factor * radius) * (before - after)
}

/// Hertz contact of a mass with force `stiffness x^1.5`: contact time (s), peak force (N) and depth (m).
pub fn hertz_contact(mass: f64, stiffness: f64, speed: f64) -> (f64, f64, f64) {
    let depth = (1.25 * mass * speed * speed / stiffness).powf(0.4);
    // 2.9432 = 2 ∫₀¹ dx / sqrt(1 − x^2.5).
    (2.943_275_2 * depth / speed, stiffness * depth.powf(1.5), depth)
}

/// Linear spring and damper (Kelvin-Voigt; Dignall and Haake, Pratt): force over time from first touch to zero displacement.
///
/// The force jumps to `c v` at first touch and turns tensile before the displacement is zero: figures 2.31 to 2.33.
pub fn kelvin_voigt_force(mass: f64, stiffness: f64, damping: f64, speed: f64, time: f64) -> f64 {
    let decay = 0.5 * damping / mass;
    let w2 = stiffness / mass - decay * decay;
    let w = w2.abs().sqrt().max(f64::MIN_POSITIVE);
    let (s, c) = if w2 >= 0.0 { ((w * time).sin(), (w * time).cos()) } else { ((w * time).sinh(), (w * time).cosh()) };
    let x = speed / w * (-decay * time).exp() * s;
    let v = speed * (-decay * time).exp() * (c - decay / w * s);
    stiffness * x + damping * v
}

/// Spring and damper of a Kelvin-Voigt ball from what is measured (Dignall and Haake 2000): restitution and contact time on a
/// rigid surface, from first touch to zero displacement. Returns N/m and N s/m.
///
/// `T = π/ω`, `e = exp(−c T/2m)`, `k = m (ω² + (c/2m)²)`.
pub fn kelvin_voigt_constants(mass: f64, restitution: f64, contact_time: f64) -> (f64, f64) {
    let decay = -restitution.ln() / contact_time;
    let rate = PI / contact_time;
    (mass * (rate * rate + decay * decay), 2.0 * mass * decay)
}

/// For how long a Kelvin-Voigt ball is pulled before its displacement is nil, s (thesis fig 2.32), and its contact time.
///
/// The force is nil where `k x = −c v`: `tan ωt = −c ω/(k − c²/2m)`.
pub fn kelvin_voigt_tensile(mass: f64, stiffness: f64, damping: f64) -> (f64, f64) {
    let decay = 0.5 * damping / mass;
    let rate = (stiffness / mass - decay * decay).max(0.0).sqrt();
    let contact = PI / rate;
    // k sin + c (w cos − decay sin) = 0.
    let zero = PI - (damping * rate).atan2(stiffness - damping * decay);
    (contact - zero / rate, contact)
}

/// How far in front of the ball's centre the normal force acts because a spinning ball's shell lands faster at the front of
/// the contact than at its rear, m (Haake, Carre, Kirk and Senior 2005; thesis 2.7.4 gives about half a millimetre).
///
/// Truncated sphere with contact radius `a² = 2 r x − x²`: shell of `ρ = m/(4πr²)` lands at the rim's front faster by `ω a`;
/// the moment `π ρ a² u (2 r − x) ω` over the force. Only while the ball is being compressed at `rate`.
pub fn haake_offset(mass: f64, radius: f64, compression: f64, rate: f64, spin: f64, force: f64) -> f64 {
    let area = 2.0 * radius * compression - compression * compression;
    mass * area * rate.max(0.0) * (2.0 * radius - compression) * spin / (4.0 * radius * radius * force)
}

/// Cross's oblique impact with two coefficients (2005): normal `e_y` and tangential `e_x`; returns normal speed, tangential
/// speed and spin after.
///
/// `(u' − aω') = −e_x (u − aω)` with the angular momentum about the contact point kept.
pub fn cross_oblique(radius: f64, factor: f64, e_normal: f64, e_tangential: f64, tangential: f64, normal: f64, spin: f64) -> (f64, f64, f64) {
    let slip = tangential - radius * spin;
    let change = (1.0 + e_tangential) * factor / (1.0 + factor) * slip;
    (e_normal * normal, tangential - change, spin + change / (factor * radius))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn near(seen: f64, expected: f64, digits: f64) {
        assert!((seen - expected).abs() <= digits, "{seen} against {expected}");
    }

    #[test]
    fn truth_brody() {
        near(apparent_restitution(0.0577, 0.171_778_7, 0.8), 0.3474090, 5.1e-8);
    }

    #[test]
    fn truth_daish() {
        near(roll_threshold(2.0 / 3.0, 0.75, 10.0, 20.0), 0.1142857, 5.1e-8);
        near(roll_threshold(0.55, 0.75, 10.0, 20.0), 0.1013825, 5.1e-8);
        let (u, w) = daish_bounce(0.033, 2.0 / 3.0, 1.0, 0.75, 10.0, 20.0, 0.0);
        near(u, 6.0, 1e-12);
        near(w, 181.8182, 5.1e-5);
        let (u, w) = daish_bounce(0.033, 0.55, 1.0, 0.75, 10.0, 20.0, 0.0);
        near(u, 6.4516129, 5.1e-8);
        near(w, 195.5034, 5.1e-5);
        // At the threshold sliding and rolling agree; angular momentum about the contact point is kept on both sides.
        for mu in [0.05, 0.1013825, 0.3] {
            let (u, w) = daish_bounce(0.033, 0.55, mu, 0.75, 10.0, 20.0, 50.0);
            near(u + 0.55 * 0.033 * w, 10.0 + 0.55 * 0.033 * 50.0, 1e-12);
            near(compressed_ball_spin(0.033, 0.55, 0.0, 50.0, 10.0, u), w, 1e-9);
        }
        let (v, u, w) = cross_oblique(0.033, 0.55, 0.75, 0.0, 10.0, 20.0, 0.0);
        assert!((v - 15.0).abs() < 1e-12 && (u - 0.033 * w).abs() < 1e-12);
    }

    /// The unphysical tensile end must show, and the force jump at first touch.
    #[test]
    fn truth_kelvin_voigt_pulls_before_it_leaves() {
        let (m, k, c, v) = (0.0577, 25e3, 20.0, 20.0);
        near(kelvin_voigt_force(m, k, c, v, 0.0), c * v, 1e-9);
        let half_period = PI / (k / m - (0.5 * c / m).powi(2)).sqrt();
        assert!(kelvin_voigt_force(m, k, c, v, 0.98 * half_period) < 0.0);
        assert!(kelvin_voigt_force(m, k, c, v, 0.5 * half_period) > 0.0);
    }

    #[test]
    fn truth_kelvin_voigt_constants_give_back_what_was_measured() {
        let (k, c) = kelvin_voigt_constants(0.0577, 0.57, 3.6e-3);
        near(k, 45.3e3, 100.0);
        near(c, 18.0, 0.05);
        let (pulled, contact) = kelvin_voigt_tensile(0.0577, k, c);
        near(contact, 3.6e-3, 1e-12);
        near(kelvin_voigt_force(0.0577, k, c, 20.0, contact - pulled), 0.0, 1e-9);
        near(kelvin_voigt_force(0.0577, k, c, 20.0, contact), -c * 0.57 * 20.0, 1e-9);
        // "The force acting for the last 0.5 ms of the impact drops below zero" (thesis, on Pratt 2000).
        assert!((0.3e-3..0.7e-3).contains(&pulled), "{pulled}");
    }

    /// Against the rim integrated numerically: landing only, at the front faster than at the rear.
    #[test]
    fn agrees_haake_offset_with_the_rim_integrated() {
        let (m, r, x, u, w, n) = (0.0577, 0.033, 0.009, 15.0, 150.0, 700.0);
        let density = m / (4.0 * PI * r * r);
        let a = f64::sqrt(2.0 * r * x - x * x);
        let steps = 100_000;
        let moment: f64 = (0..steps)
            .map(|i| {
                let cos = (2.0 * PI * (f64::from(i) + 0.5) / f64::from(steps)).cos();
                let landing = (density * (u * (r - x) + a * r * w * cos)).max(0.0);
                landing * (u + w * a * cos) * a * cos * 2.0 * PI / f64::from(steps)
            })
            .sum();
        near(haake_offset(m, r, x, u, w, n), moment / n, 1e-9);
        assert!((0.1e-3..2e-3).contains(&(moment / n)), "{}", moment / n);
    }

    #[test]
    fn truth_hertz() {
        let (t, f, x) = hertz_contact(0.05, 1e6, 10.0);
        near(0.4 * 1e6 * x.powf(2.5), 0.5 * 0.05 * 100.0, 1e-9);
        near(f, 1e6 * x.powf(1.5), 1e-9);
        near(hertz_contact(0.05, 1e6, 20.0).0 / t, 2f64.powf(-0.2), 1e-12);
    }
}
