//! One impact's geometry and approach: the named quantities an effect or a user's expression may depend on.

use crate::impact::body::Body;
use crate::impact::error::ModelError;
use crate::impact::input::ImpactInput;
use nalgebra::Vector3;

/// Slower than this the ball does not hit the strings in any sense the models describe, m/s.
pub const MIN_APPROACH_M_S: f64 = 1e-3;

/// The contact at its first touch. Racket-local axes throughout.
#[derive(Debug, Clone)]
pub struct Contact<'a> {
    pub body: &'a Body,
    /// True inputs (after undoing errors of measurement).
    pub input: ImpactInput,
    /// +1 when the ball is on the +z side of the strings, −1 on the other.
    pub side: f64,
    /// From the racket's centre of mass to the contact point, m.
    pub lever: Vector3<f64>,
    /// Velocity of the ball's surface relative to the strings at the contact point, m/s.
    pub relative_velocity: Vector3<f64>,
    /// Normal approach speed, m/s, positive.
    pub approach_speed: f64,
    /// Size of the tangential part of `relative_velocity`, m/s.
    pub slip_speed: f64,
    /// 1/m + 1/m_e: relative normal velocity per unit of normal impulse, 1/kg.
    pub normal_compliance: f64,
}

impl<'a> Contact<'a> {
    /// Geometry and approach of one impact.
    ///
    /// # Errors
    /// [`ModelError::NoApproach`] when the ball does not move toward the strings.
    pub fn new(body: &'a Body, input: &ImpactInput) -> Result<Self, ModelError> {
        let lever = body.lever(&input.position);
        let strings = input.racket_velocity + input.racket_rate.cross(&lever);
        let normal = input.ball_velocity.z - strings.z;
        let approach_speed = normal.abs();
        // Written so that NaN is refused as well.
        if !(approach_speed >= MIN_APPROACH_M_S && approach_speed.is_finite()) {
            return Err(ModelError::NoApproach { approach_m_s: approach_speed, min_m_s: MIN_APPROACH_M_S });
        }
        // The ball comes from the side it moves away from: n z · u < 0 before impact.
        let side = -normal.signum();
        let to_contact = Vector3::new(0.0, 0.0, -side * body.ball_radius);
        let relative_velocity = input.ball_velocity + input.ball_spin.cross(&to_contact) - strings;
        Ok(Contact {
            body,
            input: *input,
            side,
            lever,
            relative_velocity,
            approach_speed,
            slip_speed: relative_velocity.x.hypot(relative_velocity.y),
            normal_compliance: 1.0 / body.ball_mass + body.inverse_effective_mass(&lever),
        })
    }

    /// Normal impulse if the restitution were `restitution`, N s.
    pub fn normal_impulse(&self, restitution: f64) -> f64 {
        (1.0 + restitution) * self.approach_speed / self.normal_compliance
    }

    /// Tangential velocity of the ball's centre relative to the strings (without its spin), m/s.
    pub fn tangential_velocity(&self) -> Vector3<f64> {
        let to_contact = Vector3::new(0.0, 0.0, -self.side * self.body.ball_radius);
        let mut u = self.relative_velocity - self.input.ball_spin.cross(&to_contact);
        u.z = 0.0;
        u
    }
}
