//! Layer 1: closed forms, each with its thesis equation. Where the printed form is off, the right one stands here and the
//! slip is named.
//!
//! One dimension: speeds along the face's normal, positive toward the incoming ball for the racket; `b` is the distance of
//! the impact from the centre of mass toward the tip, m.

use std::f64::consts::PI;

/// Effective mass of the racket at a point of its face, kg: `1/m_e = 1/M + X²/I_y + Y²/I_x` (eqs 2.3, 5.1, 5.2).
///
/// Eq 5.2 is right only if each offset goes with the inertia about the axis it turns about, as here.
pub fn effective_mass(mass: f64, inertia_swing: f64, inertia_twist: f64, along: f64, across: f64) -> f64 {
    1.0 / (1.0 / mass + along * along / inertia_swing + across * across / inertia_twist)
}

/// Ball speed after a head-on impact (eqs 2.6, 5.3): momentum of ball and effective mass, restitution `e`.
///
/// `ball` is negative when incoming; `strings` is the velocity of the impact point.
pub fn rebound_speed(ball_mass: f64, effective_mass: f64, e: f64, ball: f64, strings: f64) -> f64 {
    (ball_mass * ball + effective_mass * strings + e * effective_mass * (strings - ball)) / (ball_mass + effective_mass)
}

/// Apparent coefficient of restitution (eq 2.4): `(e m_e − m)/(m_e + m)`.
pub fn apparent_restitution(ball_mass: f64, effective_mass: f64, e: f64) -> f64 {
    (e * effective_mass - ball_mass) / (effective_mass + ball_mass)
}

/// Restitution from the apparent one: `e = e_A + (m/m_e)(1 + e_A)`.
pub fn restitution(ball_mass: f64, effective_mass: f64, apparent: f64) -> f64 {
    apparent + ball_mass / effective_mass * (1.0 + apparent)
}

/// Centre of percussion from the centre of mass, m (eq 2.5): `I/(a M)`, `pivot` the distance of the hand from the centre.
pub fn centre_of_percussion(mass: f64, inertia_swing: f64, pivot: f64) -> f64 {
    inertia_swing / (pivot * mass)
}

/// Dead spot from the centre of mass, m: where `m_e = m/e` and the ball stops on a resting racket; `None` when no point has
/// so little effective mass.
///
/// The text after eq 2.4 says `m_e = m`; that holds for e = 1 alone.
pub fn dead_spot(mass: f64, inertia_swing: f64, ball_mass: f64, e: f64) -> Option<f64> {
    let rest = e / ball_mass - 1.0 / mass;
    (rest >= 0.0).then(|| (inertia_swing * rest).sqrt())
}

/// Impact point of the fastest ball, from the centre of mass, m: `b* = sqrt(U² + Λ²) − U`, `U = (V − v)/ω`,
/// `Λ² = I (1/m + 1/M)`. The restitution cancels.
///
/// Eq 5.5 as printed misplaces the derivative's sign and has e = 1 in its numerator; b* is not affected.
pub fn ideal_point(mass: f64, inertia_swing: f64, ball_mass: f64, racket: f64, rate: f64, ball: f64) -> f64 {
    let lambda2 = inertia_swing * (1.0 / ball_mass + 1.0 / mass);
    let closing = racket - ball;
    // Written so that a racket without rotation gives 0 instead of 0/0.
    rate * lambda2 / (closing + (closing * closing + rate * rate * lambda2).sqrt())
}

/// Impact success ratio (5.6): `m_e v_IP` at the ideal point over that at the actual one.
pub fn success_ratio(ideal: (f64, f64), actual: (f64, f64)) -> f64 {
    ideal.0 * ideal.1 / (actual.0 * actual.1)
}

/// Kinetic energy of the ball after over that of racket and ball before (eq 5.8 with each inertia on its own axis; in the
/// frame of the court, for the ratio depends on the frame).
pub fn efficiency(ball_after: f64, racket_before: f64, ball_before: f64) -> f64 {
    ball_after / (racket_before + ball_before)
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
    fn truth_effective_mass_and_brody() {
        let me = effective_mass(0.33, 0.0158, 0.0015, 0.21, 0.0);
        near(me, 0.1717787, 5.1e-8);
        near(apparent_restitution(0.0577, me, 0.8), 0.3474090, 5.1e-8);
        near(restitution(0.0577, me, apparent_restitution(0.0577, me, 0.8)), 0.8, 1e-15);
        near(effective_mass(0.33, 0.0158, 0.0015, 0.2246, 0.0), 0.1606933, 5.1e-8);
    }

    #[test]
    fn truth_ideal_point() {
        let (m, i, ball) = (0.33, 0.0158, 0.0577);
        let b = ideal_point(m, i, ball, 15.96, 30.53, -9.30);
        near(b, 0.1757479, 5.1e-8);
        let speed = |b: f64| rebound_speed(ball, effective_mass(m, i, 1.0, b, 0.0), 0.8, -9.30, 15.96 + 30.53 * b);
        near(speed(b), 33.511499, 5.1e-7);
        near(speed(0.2246), 33.236961, 1e-6);
        assert!(speed(b + 1e-4) < speed(b) && speed(b - 1e-4) < speed(b));
        let side = |b: f64| (effective_mass(m, i, 1.0, b, 0.0), 15.96 + 30.53 * b);
        near(success_ratio(side(b), side(0.2246)), 1.166706, 5.1e-7);
        near(ideal_point(m, i, ball, 15.96, 0.0, -9.30), 0.0, 0.0);
        near(centre_of_percussion(m, i, 0.245), 0.1954, 5e-5);
        near(dead_spot(m, i, ball, 0.8).expect("real"), 0.414, 5e-4);
        assert!(dead_spot(0.05, i, 0.0577, 0.8).is_none());
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
