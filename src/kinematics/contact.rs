//! First and last contact: ball and face carried to the instant when the ball's centre stands one radius from the strings.

use super::ball_flight::FlightEstimate;
use super::racket_motion::{MotionEstimate, MovingRacket};
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

/// A point mass near a reference time: position, velocity, acceleration; global axes, SI.
#[derive(Debug, Clone, PartialEq)]
pub struct PointMotion {
    pub position: Point3<f64>,
    pub velocity: Vector3<f64>,
    pub acceleration: Vector3<f64>,
}

impl PointMotion {
    pub fn after(&self, dt: f64) -> PointMotion {
        PointMotion {
            position: self.position + self.velocity * dt + self.acceleration * (dt * dt / 2.0),
            velocity: self.velocity + self.acceleration * dt,
            acceleration: self.acceleration,
        }
    }
}

impl From<&FlightEstimate> for PointMotion {
    fn from(f: &FlightEstimate) -> Self {
        PointMotion { position: f.position, velocity: f.velocity, acceleration: f.acceleration }
    }
}

/// A rigid body near a reference time. Linear quantities of the centre of mass in global axes, rates in body axes.
#[derive(Debug, Clone, PartialEq)]
pub struct BodyMotion {
    pub com: Point3<f64>,
    pub attitude: UnitQuaternion<f64>,
    pub velocity: Vector3<f64>,
    pub rate_body: Vector3<f64>,
    pub acceleration: Vector3<f64>,
    pub rate_dot_body: Vector3<f64>,
}

impl BodyMotion {
    pub fn after(&self, dt: f64) -> BodyMotion {
        BodyMotion {
            com: self.com + self.velocity * dt + self.acceleration * (dt * dt / 2.0),
            attitude: self.attitude * UnitQuaternion::from_scaled_axis(self.rate_body * dt + self.rate_dot_body * (dt * dt / 2.0)),
            velocity: self.velocity + self.acceleration * dt,
            rate_body: self.rate_body + self.rate_dot_body * dt,
            acceleration: self.acceleration,
            rate_dot_body: self.rate_dot_body,
        }
    }

    /// Pose with the origin at the stringbed centre.
    pub fn pose(&self, com_local: &Point3<f64>) -> Isometry3<f64> {
        Isometry3::from_parts(Translation3::from(self.com.coords - self.attitude * com_local.coords), self.attitude)
    }

    /// Velocity of a point fixed to the racket, given in local axes from the stringbed centre; global axes.
    pub fn point_velocity(&self, local: &Point3<f64>, com_local: &Point3<f64>) -> Vector3<f64> {
        self.velocity + self.attitude * self.rate_body.cross(&(local - com_local))
    }
}

impl From<&MotionEstimate> for BodyMotion {
    fn from(m: &MotionEstimate) -> Self {
        BodyMotion {
            com: m.state.com,
            attitude: m.state.global_from_racket,
            velocity: m.state.velocity,
            rate_body: m.state.rate_body,
            acceleration: m.acceleration,
            rate_dot_body: m.rate_dot_body,
        }
    }
}

/// Ball centre in local axes.
pub fn ball_in_racket(ball: &PointMotion, racket: &BodyMotion, com_local: &Point3<f64>) -> Point3<f64> {
    racket.pose(com_local).inverse_transform_point(&ball.position)
}

/// Time, near 0, at which the ball's centre stands `distance` from the face on `side` (+1 or −1); Newton's method on the
/// short-time motions (equation 4.11's distance; the thesis bisects to distance 0). `None` when it never does nearby.
pub fn crossing(ball: &PointMotion, racket: &BodyMotion, com_local: &Point3<f64>, side: f64, distance: f64) -> Option<f64> {
    let gap = |t: f64| side * ball_in_racket(&ball.after(t), &racket.after(t), com_local).z - distance;
    let mut t = 0.0;
    for _ in 0..40 {
        let h = 1e-6;
        let slope = (gap(t + h) - gap(t - h)) / (2.0 * h);
        if slope.abs() < 0.1 {
            return None; // slower than 0.1 m/s along the normal: no impact
        }
        let step = (gap(t) / slope).clamp(-0.002, 0.002);
        t -= step;
        if t.abs() > 0.02 {
            return None;
        }
        if step.abs() < 1e-12 {
            return Some(t);
        }
    }
    None
}

/// The motions of a fit carried to another time by its own best law (used while windows are still being settled).
pub(crate) fn body_at(racket: &MovingRacket, m: &MotionEstimate, t: f64) -> BodyMotion {
    let s = racket.state_at(m.best.law, &m.best.state, t - m.reference_t);
    let (acceleration, rate_dot_body) = racket.accelerations(m.best.law, &s);
    BodyMotion { com: s.com, attitude: s.global_from_racket, velocity: s.velocity, rate_body: s.rate_body, acceleration, rate_dot_body }
}
