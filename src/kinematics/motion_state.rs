//! State of a racket at a reference time, and the parts of it that a law of motion may estimate.

use super::motion_law::MotionLaw;
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

/// State at the reference time, of the stated balance point. Global axes, SI, unless it says body.
#[derive(Debug, Clone, PartialEq)]
pub struct MotionState {
    pub com: Point3<f64>,
    pub global_from_racket: UnitQuaternion<f64>,
    pub velocity: Vector3<f64>,
    /// Angular velocity, body axes, rad/s.
    pub rate_body: Vector3<f64>,
    /// Acceleration of the centre of mass beyond gravity, body axes, m/s².
    pub force_body: Vector3<f64>,
    /// Angular acceleration (beyond Euler's where the law has it), body axes, rad/s².
    pub rate_dot_body: Vector3<f64>,
    /// Slopes in time of the two above.
    pub force_slope_body: Vector3<f64>,
    pub rate_ddot_body: Vector3<f64>,
    /// Slopes of the slopes.
    pub force_curve_body: Vector3<f64>,
    pub rate_dddot_body: Vector3<f64>,
    /// Where the centre of mass lies from [`super::MovingRacket::com_local`] as seen already, body axes, m.
    pub lever_body: Vector3<f64>,
}

impl MotionState {
    pub fn at_rest(pose: &Isometry3<f64>, com_local: &Point3<f64>) -> Self {
        let zero = Vector3::zeros();
        MotionState {
            com: pose * com_local,
            global_from_racket: pose.rotation,
            velocity: zero,
            rate_body: zero,
            force_body: zero,
            rate_dot_body: zero,
            force_slope_body: zero,
            rate_ddot_body: zero,
            force_curve_body: zero,
            rate_dddot_body: zero,
            lever_body: zero,
        }
    }

    /// `global_from_racket` with the origin at the stringbed centre.
    pub fn pose(&self, com_local: &Point3<f64>) -> Isometry3<f64> {
        let origin = self.com - self.global_from_racket * com_local.coords;
        Isometry3::from_parts(Translation3::from(origin.coords), self.global_from_racket)
    }

    /// Given force and angular acceleration `dt` after the reference time.
    pub(crate) fn given(&self, law: MotionLaw, dt: f64) -> (Vector3<f64>, Vector3<f64>) {
        let [value, slope, curve] = law.course(dt);
        (
            self.force_body * value + self.force_slope_body * slope + self.force_curve_body * curve,
            self.rate_dot_body * value + self.rate_ddot_body * slope + self.rate_dddot_body * curve,
        )
    }
}

/// A three-vector of the state that a law may estimate.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Part {
    Place,
    Turn,
    Velocity,
    Rate,
    Force,
    RateDot,
    ForceSlope,
    RateDdot,
    ForceCurve,
    RateDddot,
    Lever,
}

impl Part {
    /// All that some laws leave out.
    pub(crate) const OPTIONAL: [Part; 7] = [Part::Force, Part::RateDot, Part::ForceSlope, Part::RateDdot, Part::ForceCurve, Part::RateDddot, Part::Lever];

    /// A step that changes the pictures by about a pixel (SI).
    pub(crate) fn step(self) -> f64 {
        match self {
            Part::Place | Part::Lever => 1e-3,
            Part::Turn => 1e-2,
            Part::Velocity => 0.3,
            Part::Rate => 1.0,
            Part::Force => 30.0,
            Part::RateDot => 100.0,
            Part::ForceSlope => 3e3,
            Part::RateDdot => 1e4,
            Part::ForceCurve => 3e5,
            Part::RateDddot => 1e6,
        }
    }

    /// Its value; of an attitude, which has no origin, nought.
    pub(crate) fn of(self, state: &MotionState) -> Vector3<f64> {
        match self {
            Part::Place => state.com.coords,
            Part::Turn => Vector3::zeros(),
            Part::Velocity => state.velocity,
            Part::Rate => state.rate_body,
            Part::Force => state.force_body,
            Part::RateDot => state.rate_dot_body,
            Part::ForceSlope => state.force_slope_body,
            Part::RateDdot => state.rate_ddot_body,
            Part::ForceCurve => state.force_curve_body,
            Part::RateDddot => state.rate_dddot_body,
            Part::Lever => state.lever_body,
        }
    }

    /// Moves it by `step`; an attitude by that rotation about global axes.
    pub(crate) fn shift(self, state: &mut MotionState, step: Vector3<f64>) {
        match self {
            Part::Place => state.com += step,
            Part::Turn => state.global_from_racket = UnitQuaternion::from_scaled_axis(step) * state.global_from_racket,
            Part::Velocity => state.velocity += step,
            Part::Rate => state.rate_body += step,
            Part::Force => state.force_body += step,
            Part::RateDot => state.rate_dot_body += step,
            Part::ForceSlope => state.force_slope_body += step,
            Part::RateDdot => state.rate_ddot_body += step,
            Part::ForceCurve => state.force_curve_body += step,
            Part::RateDddot => state.rate_dddot_body += step,
            Part::Lever => state.lever_body += step,
        }
    }
}
