//! The contact laws of one impact, as the base sets them and the effects change them.

use crate::impact::real::Real;
use nalgebra::Vector3;

/// Which direction friction takes while the ball slides throughout.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Sliding {
    /// Against the sliding direction at first touch (the contract's base).
    #[default]
    FirstTouch,
    /// Follows the direction as it turns (Keller's equations, integrated over the normal impulse).
    Exact,
}

/// Share of the compression that is the strings': 13.1 mm of the 25.8 mm by which a ball of 20 m/s comes nearer to a free racket in
/// the first 2 ms of 4.5 (visco-elastic model).
pub const BED_SHARE: f64 = 0.5;

/// Contact laws of one impact. The base fills in restitution and friction; every other field stands at "none" until an
/// effect changes it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Laws<T = f64> {
    /// Normal relative speed after over before, 0..1.
    pub restitution: T,
    /// Coulomb coefficient, 0 or more.
    pub friction: T,
    /// Tangential relative velocity after a stuck contact over minus that before, along x and y; 0: rolling, positive: the
    /// strings snap back.
    pub tangential_restitution: [T; 2],
    /// The same along the two diagonals of the face, x + y and x − y, beside that along x and y.
    pub diagonal_restitution: [T; 2],
    pub sliding: Sliding,
    /// From the ball's centre to the contact point, m.
    pub ball_arm: T,
    /// kg m².
    pub ball_inertia: T,
    /// Displacement of the normal force behind the ball's centre, against the slip, m.
    pub normal_offset: T,
    /// Where an expression moves the torque arm of the normal force, along x and y, m.
    pub arm_offset: [T; 2],
    /// Tilt of the contact's normal: its x and y components (small angles, rad).
    pub tilt: [T; 2],
    /// Share of that tilt at first touch and at release, where slip is told; 1: throughout.
    pub tilt_at_ends: T,
    /// Impulse from outside on the racket's centre of mass, N s.
    pub drive: Vector3<T>,
    /// Angular impulse from outside on the racket, N m s.
    pub drive_twist: Vector3<T>,
    /// Largest angular impulse with which the mount resists a change of twist about x, N m s.
    pub twist_hold: T,
    /// Energy taken by frame modes, as q in e'² = e² − q (1 + e')².
    pub mode_loss: T,
    /// Duration over which the face turns and the ball travels across it (20 m/s at the middle of the face), s; 0: an instant.
    pub face_time: T,
    /// Share of the compression by which the strings give way meanwhile, the rest being the ball's.
    pub bed_share: T,
}

impl<T: Real> Laws<T> {
    #[inline]
    pub fn new(restitution: T, friction: T, sliding: Sliding, ball_arm: T, ball_inertia: T) -> Self {
        Laws {
            restitution,
            friction,
            tangential_restitution: [T::zero(); 2],
            diagonal_restitution: [T::zero(); 2],
            sliding,
            ball_arm,
            ball_inertia,
            normal_offset: T::zero(),
            arm_offset: [T::zero(); 2],
            tilt: [T::zero(); 2],
            tilt_at_ends: T::one(),
            drive: Vector3::zeros(),
            drive_twist: Vector3::zeros(),
            twist_hold: T::zero(),
            mode_loss: T::zero(),
            face_time: T::zero(),
            bed_share: T::constant(BED_SHARE),
        }
    }

    /// Restitution with the modes' energy taken out, limited to what conserves or loses energy.
    ///
    /// e'² = e² − q (1 + e')² follows from E_vib = q K J²/2 with J = (1 + e') v/K.
    pub fn effective_restitution(&self) -> T {
        let e = clamp(self.restitution);
        let q = self.mode_loss;
        if q.is_zero() || e.value().is_nan() || q.value().is_nan() {
            return e + q;
        }
        let root = (e * e * (q + 1.0) - q).max(T::zero()).sqrt();
        clamp((root - q) / (q + 1.0))
    }

    /// Tangential relative velocity after a stuck contact that came with `u` (x and y), m/s.
    pub fn rebound(&self, u: [T; 2]) -> [T; 2] {
        // Along a diagonal d: e (d·u) d, with both components of d 1/√2 in size.
        let (along, other) = (self.diagonal_restitution[0] * 0.5 * (u[0] + u[1]), self.diagonal_restitution[1] * 0.5 * (u[0] - u[1]));
        [-self.tangential_restitution[0] * u[0] - along - other, -self.tangential_restitution[1] * u[1] - along + other]
    }

    /// A law that no contact has: which, its value, and what is allowed. (Restitution and friction beyond their limits are held there.)
    pub fn impossible(&self) -> Option<(&'static str, f64, &'static str)> {
        const FINITE: &str = "a finite number";
        let positive = [("ball_arm", self.ball_arm.value()), ("ball_inertia", self.ball_inertia.value())];
        let finite = [
            ("restitution", self.restitution.value()),
            ("friction", self.friction.value()),
            ("tangential_restitution_x", self.tangential_restitution[0].value()),
            ("tangential_restitution_y", self.tangential_restitution[1].value()),
            ("normal_offset", self.normal_offset.value()),
            ("tilt_x", self.tilt[0].value()),
            ("tilt_y", self.tilt[1].value()),
            ("tilt_at_ends", self.tilt_at_ends.value()),
            ("mode_loss", self.mode_loss.value()),
            ("grip_hold", self.twist_hold.value()),
        ];
        let nothing = positive.into_iter().find(|(_, v)| v.is_finite() && *v <= 0.0).map(|(what, v)| (what, v, "a positive number"));
        nothing.or_else(|| positive.into_iter().chain(finite).find(|(_, v)| !v.is_finite()).map(|(what, v)| (what, v, FINITE)))
    }

    /// True when the contact is the plain one: no offset, tilt, outside impulse.
    pub fn is_plain(&self) -> bool {
        let none = |numbers: &[T]| numbers.iter().all(T::is_zero);
        self.normal_offset.is_zero()
            && none(&self.arm_offset)
            && none(&self.tilt)
            && self.twist_hold.is_zero()
            && none(self.drive.as_slice())
            && none(self.drive_twist.as_slice())
    }
}

/// Within 0 to 1; what is not a number stays so.
fn clamp<T: Real>(restitution: T) -> T {
    if restitution.value() < 0.0 {
        T::zero()
    } else if restitution.value() > 1.0 {
        T::one()
    } else {
        restitution
    }
}
