//! `impact`: from an impact's inputs to its outcome, by a model built of named physical effects.
//!
//! Comes in: [`ImpactInput`] (racket-local axes, SI), a [`Racket`], a [`Ball`], a [`Model`]. Goes out: [`ImpactOutput`].
//! Knows nothing of footage, OpenCV or measurements. Sources: physics.md sections A-G, thesis chapter 2.

use crate::equipment::{Ball, Racket};
use nalgebra::{Vector2, Vector3};

/// State at first contact, along the racket's local axes at that instant (contract, section 1).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImpactInput {
    /// Ball centre velocity, m/s.
    pub ball_velocity: Vector3<f64>,
    /// Ball spin, rad/s.
    pub ball_spin: Vector3<f64>,
    /// Velocity of the racket's centre of mass, m/s.
    pub racket_velocity: Vector3<f64>,
    /// Racket angular velocity, rad/s.
    pub racket_rate: Vector3<f64>,
    /// Projection of the ball's centre on the face, from the stringbed centre, m.
    pub position: Vector2<f64>,
    /// Torque of the mount about the handle, N m; 0 when unknown.
    pub grip_torque: f64,
    /// Order of the impact in time (0 for the first), for effects that drift.
    pub order: f64,
}

/// State at last contact, along the local axes at first contact.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImpactOutput {
    pub ball_velocity: Vector3<f64>,
    pub ball_spin: Vector3<f64>,
    pub racket_velocity: Vector3<f64>,
    pub racket_rate: Vector3<f64>,
    /// s; `None` where the base has none (rigid).
    pub contact_time: Option<f64>,
}

impl ImpactOutput {
    /// The 13 outputs in the order of [`crate::impact_table::OUTPUTS`]; the contact time is `None` for the rigid base.
    pub fn as_columns(&self) -> [Option<f64>; 13] {
        let mut c = [None; 13];
        for (k, v) in [self.ball_velocity, self.ball_spin, self.racket_velocity, self.racket_rate].iter().enumerate() {
            for i in 0..3 {
                c[3 * k + i] = Some(v[i]);
            }
        }
        c[12] = self.contact_time;
        c
    }
}
