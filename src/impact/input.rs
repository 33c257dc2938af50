//! What goes into an impact and what comes out of it.

use super::real::Real;
use crate::impact_table::OwnColumns;
use nalgebra::{Vector2, Vector3};

/// State at first contact, along the racket's local axes at that instant (contract, section 1).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImpactInput<T = f64> {
    /// Ball centre velocity, m/s.
    pub ball_velocity: Vector3<T>,
    /// Ball spin, rad/s.
    pub ball_spin: Vector3<T>,
    /// Velocity of the racket's centre of mass, m/s.
    pub racket_velocity: Vector3<T>,
    /// Racket angular velocity, rad/s.
    pub racket_rate: Vector3<T>,
    /// Projection of the ball's centre on the face, from the stringbed centre, m.
    pub position: Vector2<T>,
    /// Torque of the mount about the handle, N m; 0 when unknown.
    pub grip_torque: T,
    /// Order of the impact in time (0 for the first), for effects that drift.
    pub order: f64,
    /// Numbers in columns of the user's own, for expressions.
    pub own: OwnColumns,
}

/// State at last contact, along the local axes at first contact.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImpactOutput<T = f64> {
    pub ball_velocity: Vector3<T>,
    pub ball_spin: Vector3<T>,
    /// Of the centre of mass of the racket as its file states it.
    pub racket_velocity: Vector3<T>,
    pub racket_rate: Vector3<T>,
    /// s; `None` where the base has none (rigid).
    pub contact_time: Option<T>,
}

/// The components of velocity and spin of the ball, velocity and rate of the racket, one after the other.
fn in_a_row<T: Real>(vectors: [Vector3<T>; 4]) -> [T; 12] {
    std::array::from_fn(|i| vectors[i / 3][i % 3])
}

impl<T: Real> ImpactInput<T> {
    /// From the 15 columns of [`crate::impact_table::INPUTS`], in that order, plus the order in time.
    pub fn from_columns(c: &[T; 15], order: f64) -> Self {
        let v = |i: usize| Vector3::new(c[i], c[i + 1], c[i + 2]);
        ImpactInput {
            ball_velocity: v(0),
            ball_spin: v(3),
            racket_velocity: v(6),
            racket_rate: v(9),
            position: Vector2::new(c[12], c[13]),
            grip_torque: c[14],
            order,
            own: OwnColumns::default(),
        }
    }

    /// The same impact with other values in those columns.
    pub fn with_columns<U: Real>(&self, c: &[U; 15]) -> ImpactInput<U> {
        ImpactInput { own: self.own, ..ImpactInput::from_columns(c, self.order) }
    }

    /// The 15 columns of [`crate::impact_table::INPUTS`], in that order.
    pub fn as_columns(&self) -> [T; 15] {
        let mut c = [T::zero(); 15];
        c[..12].copy_from_slice(&in_a_row([self.ball_velocity, self.ball_spin, self.racket_velocity, self.racket_rate]));
        c[12] = self.position.x;
        c[13] = self.position.y;
        c[14] = self.grip_torque;
        c
    }

    /// True when no value is NaN or infinite.
    pub fn is_finite(&self) -> bool {
        self.as_columns().iter().all(|v| v.value().is_finite()) && self.order.is_finite()
    }
}

impl<T: Real> ImpactOutput<T> {
    /// From the 13 columns of [`crate::impact_table::OUTPUTS`], with a contact time.
    pub fn from_columns(c: &[T; 13]) -> Self {
        let v = |i: usize| Vector3::new(c[i], c[i + 1], c[i + 2]);
        ImpactOutput { ball_velocity: v(0), ball_spin: v(3), racket_velocity: v(6), racket_rate: v(9), contact_time: Some(c[12]) }
    }

    /// The 13 outputs in the order of [`crate::impact_table::OUTPUTS`]; the contact time is `None` for the rigid base.
    pub fn as_columns(&self) -> [Option<T>; 13] {
        let vector = self.as_vector();
        std::array::from_fn(|i| vector.get(i).copied().or(self.contact_time))
    }

    /// The 12 velocities and rates in the order of [`crate::impact_table::OUTPUTS`], without the contact time.
    pub fn as_vector(&self) -> [T; 12] {
        in_a_row([self.ball_velocity, self.ball_spin, self.racket_velocity, self.racket_rate])
    }

    /// True when no value is NaN or infinite.
    pub fn is_finite(&self) -> bool {
        self.as_vector().iter().all(|v| v.value().is_finite()) && self.contact_time.is_none_or(|t| t.value().is_finite())
    }
}
