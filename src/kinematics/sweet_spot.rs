//! Special points of a racket for a given shot: effective mass, centre of percussion, node, dead spot, ideal point.
//!
//! Distances `b_m` are measured from the centre of mass toward the tip; masses kg, inertias kg m² about the centre of mass.

use crate::equipment::Racket;
use nalgebra::{Vector2, Vector3};

/// Where the hand pivots, m from the butt: between 0.08 m and the 0.10 m of the swingweight's axis (docs/impact.md, closed forms).
pub const HAND_PIVOT_FROM_BUTT_M: f64 = 0.09;
/// Spread of that place over those two figures, m.
pub const HAND_PIVOT_SD_M: f64 = 0.006;
/// Node of the first bending mode on the head side, over the racket's length: beam models of real rackets 0.783 to 0.805,
/// mean impact of the thesis's players 0.80 (docs/impact.md, the frame, where the thesis's print slips).
pub const NODE_OF_LENGTH: f64 = 0.80;
/// Spread over those models: (0.805 − 0.783)/√12.
pub const NODE_OF_LENGTH_SD: f64 = 0.0064;
/// What the thesis takes (5.5.1).
pub const THESIS_NODE_OF_LENGTH: f64 = 0.82;

/// Effective mass of a point of the face, kg: 1/m_e = 1/M + X²/I_y + Y²/I_x (equations 5.1, 5.2).
/// `from_com` is (X, Y) in local axes from the centre of mass, m.
pub fn effective_mass(mass: f64, inertia: &Vector3<f64>, from_com: &Vector2<f64>) -> f64 {
    1.0 / (1.0 / mass + from_com.x * from_com.x / inertia.y + from_com.y * from_com.y / inertia.x)
}

/// Centre of percussion for a pivot at the hand: b = I_y / (a M) (equation 2.5), a = distance of the pivot from the
/// centre of mass.
pub fn centre_of_percussion(racket: &Racket, pivot_from_butt: f64) -> f64 {
    racket.inertia_kg_m2().y / ((racket.balance_m - pivot_from_butt) * racket.mass_kg)
}

/// Dead spot: where the effective mass is m/e, so that the ball stops dead on a resting racket: b = √(I_y (e/m − 1/M))
/// (docs/impact.md, closed forms; the thesis's m_e = m is the case e = 1). `None` where e/m < 1/M.
pub fn dead_spot(mass: f64, inertia_y: f64, ball_mass: f64, restitution: f64) -> Option<f64> {
    let b2 = inertia_y * (restitution / ball_mass - 1.0 / mass);
    (b2 >= 0.0).then(|| b2.sqrt())
}

/// Ideal point: the b on the long axis at which the ball would leave fastest (equation 5.5 solved; e cancels):
/// ω b² + 2 (V − v) b − ω Λ² = 0, Λ² = I_y (1/m + 1/M), in a form that stays finite as ω → 0 (docs/impact.md, closed forms).
///
/// `racket_speed`, `ball_speed` along the normal toward the ball's side, m/s (the ball's is negative when it comes in);
/// `swing_rate` such that a point at b moves at V + ω b. `None` when racket and ball do not approach.
pub fn ideal_point(mass: f64, inertia_y: f64, ball_mass: f64, racket_speed: f64, ball_speed: f64, swing_rate: f64) -> Option<f64> {
    let closing = racket_speed - ball_speed;
    let lambda2 = inertia_y * (1.0 / ball_mass + 1.0 / mass);
    (closing > 0.0).then(|| swing_rate * lambda2 / (closing + (closing * closing + swing_rate * swing_rate * lambda2).sqrt()))
}

#[cfg(test)]
mod tests {
    use super::*;

    const M: f64 = 0.33;
    const I_Y: f64 = 0.0158;

    /// Speed of the ball after impact on the long axis (equation 5.3).
    fn rebound_speed(ball_mass: f64, effective_mass: f64, restitution: f64, point_speed: f64, ball_speed: f64) -> f64 {
        (restitution * effective_mass * (point_speed - ball_speed) + effective_mass * point_speed + ball_mass * ball_speed) / (ball_mass + effective_mass)
    }

    #[test]
    fn truth_effective_mass_of_the_reference_points() {
        // The checks of docs/impact.md, closed forms.
        let i = Vector3::new(0.0015, I_Y, 0.0173);
        assert!((effective_mass(M, &i, &Vector2::new(-0.21, 0.0)) - 0.1717787).abs() < 5e-8);
        assert!((effective_mass(M, &i, &Vector2::new(-0.2246, 0.0)) - 0.1606933).abs() < 5e-8);
        // Hand calculation off the axis: 1/0.33 + 0.04/0.0158 + 0.0009/0.0015 = 6.161949, m_e = 0.1622863.
        assert!((effective_mass(M, &i, &Vector2::new(-0.2, 0.03)) - 0.162_286_3).abs() < 5e-8);
    }

    #[test]
    fn truth_ideal_point_and_speeds_of_the_thesis_mean_shot() {
        // The checks of docs/impact.md, closed forms: means of table 5.27.
        let b = ideal_point(M, I_Y, 0.0577, 15.96, -9.30, 30.53).expect("approaching");
        assert!((b - 0.1757479).abs() < 5e-8, "{b}");
        let speed = |b: f64| {
            let me = effective_mass(M, &Vector3::new(0.0015, I_Y, 0.0173), &Vector2::new(-b, 0.0));
            rebound_speed(0.0577, me, 0.8, 15.96 + 30.53 * b, -9.30)
        };
        assert!((speed(b) - 33.511499).abs() < 1e-5, "{}", speed(b));
        assert!((speed(0.2246) - 33.236961).abs() < 1e-5);
        // It is a maximum, whatever the restitution, and lies at the centre of mass when nothing swings.
        assert!(speed(b) > speed(b + 0.003) && speed(b) > speed(b - 0.003));
        assert_eq!(ideal_point(M, I_Y, 0.0577, 10.0, -10.0, 0.0), Some(0.0));
        assert_eq!(ideal_point(M, I_Y, 0.0577, 0.0, 5.0, 3.0), None);
    }

    #[test]
    fn truth_dead_spot_lies_beyond_the_tip_of_a_modern_racket() {
        // The checks of docs/impact.md, closed forms: 0.414 m for e = 0.8.
        let b = dead_spot(M, I_Y, 0.0577, 0.8).expect("real");
        assert!((b - 0.414).abs() < 5e-4, "{b}");
        let me = effective_mass(M, &Vector3::new(0.0015, I_Y, 0.0173), &Vector2::new(-b, 0.0));
        assert!(rebound_speed(0.0577, me, 0.8, 0.0, -10.0).abs() < 1e-12, "a ball stops dead there");
        assert_eq!(dead_spot(M, I_Y, 0.0577, 0.1), None);
    }
}
