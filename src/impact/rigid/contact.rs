//! One impact's geometry and approach: the named quantities an effect or a user's expression may depend on.

use crate::impact::body::Body;
use crate::impact::error::ModelError;
use crate::impact::input::ImpactInput;
use crate::impact::real::Real;
use nalgebra::Vector3;

/// Slower than this the ball does not hit the strings in any sense the models describe, m/s.
pub const MIN_APPROACH_M_S: f64 = 1e-3;

/// Approach speed to which a stated duration belongs, m/s, and the exponent of the speed by which it falls: 5.2 to 3.9 ms from 5 to
/// 40 m/s (visco-elastic model on a free racket, physics reference G.9).
const DURATION_SPEED_M_S: f64 = 20.0;
const DURATION_EXPONENT: f64 = -0.14;

/// The contact at its first touch. Racket-local axes throughout.
#[derive(Debug, Clone)]
pub struct Contact<'a, T = f64> {
    pub body: &'a Body<T>,
    /// True inputs (after undoing errors of measurement).
    pub input: ImpactInput<T>,
    /// +1 when the ball is on the +z side of the strings, −1 on the other.
    pub side: f64,
    /// From the racket's centre of mass to the contact point, m.
    pub lever: Vector3<T>,
    /// Velocity of the ball's surface relative to the strings at the contact point, m/s.
    pub relative_velocity: Vector3<T>,
    /// Normal approach speed, m/s, positive.
    pub approach_speed: T,
    /// 1/m + 1/m_e: relative normal velocity per unit of normal impulse, 1/kg.
    pub normal_compliance: T,
}

impl<'a, T: Real> Contact<'a, T> {
    /// Geometry and approach of one impact.
    ///
    /// # Errors
    /// [`ModelError::NoApproach`] when the ball does not move toward the strings.
    #[inline]
    pub fn new(body: &'a Body<T>, input: &ImpactInput<T>) -> Result<Self, ModelError> {
        let lever = body.lever(&input.position);
        let strings = input.racket_velocity + input.racket_rate.cross(&lever);
        let normal = input.ball_velocity.z - strings.z;
        let approach_speed = normal.abs();
        // Written so that NaN is refused as well.
        let seen = approach_speed.value();
        if !(seen >= MIN_APPROACH_M_S && seen.is_finite()) {
            return Err(ModelError::NoApproach { approach_m_s: seen, min_m_s: MIN_APPROACH_M_S });
        }
        // The ball comes from the side it moves away from: n z · u < 0 before impact.
        let side = -normal.value().signum();
        let to_contact = Vector3::new(T::zero(), T::zero(), T::constant(-side * body.ball_radius));
        let relative_velocity = input.ball_velocity + input.ball_spin.cross(&to_contact) - strings;
        Ok(Contact {
            body,
            input: *input,
            side,
            lever,
            relative_velocity,
            approach_speed,
            normal_compliance: body.ball_mass.recip() + body.inverse_effective_mass(&lever),
        })
    }

    /// Size of the tangential part of the relative velocity, m/s. Few ask for it, and it takes as long as all the rest.
    pub fn slip_speed(&self) -> T {
        self.relative_velocity.x.hypot(self.relative_velocity.y)
    }

    /// How long this contact lasts, `reference` being the duration at 20 m/s in the middle of the face: a spring under a smaller mass
    /// swings faster.
    pub fn duration(&self, reference: T) -> T {
        let middle = self.body.ball_mass.recip() + self.body.inverse_effective_mass(&Vector3::new(-self.body.com_x, T::zero(), T::zero()));
        reference * (middle / self.normal_compliance).sqrt() * (self.approach_speed / DURATION_SPEED_M_S).powf(T::constant(DURATION_EXPONENT))
    }

    /// Normal impulse if the restitution were `restitution`, N s.
    pub fn normal_impulse(&self, restitution: T) -> T {
        (restitution + 1.0) * self.approach_speed / self.normal_compliance
    }

    /// Tangential velocity of the ball's centre relative to the strings (without its spin), m/s.
    pub fn tangential_velocity(&self) -> Vector3<T> {
        let to_contact = Vector3::new(T::zero(), T::zero(), T::constant(-self.side * self.body.ball_radius));
        let mut u = self.relative_velocity - self.input.ball_spin.cross(&to_contact);
        u.z = T::zero();
        u
    }
}
