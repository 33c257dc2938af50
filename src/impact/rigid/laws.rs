//! The contact laws of one impact, as the base sets them and the effects change them.

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

/// Contact laws of one impact. The base fills in restitution and friction; every other field stands at "none" until an
/// effect changes it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Laws {
    /// Normal relative speed after over before, 0..1.
    pub restitution: f64,
    /// Coulomb coefficient, 0 or more.
    pub friction: f64,
    /// Tangential relative velocity after a stuck contact over minus that before, along x and y; 0: rolling, positive: the
    /// strings snap back.
    pub tangential_restitution: [f64; 2],
    /// The same along the two diagonals of the face, x + y and x − y, beside that along x and y.
    pub diagonal_restitution: [f64; 2],
    pub sliding: Sliding,
    /// From the ball's centre to the contact point, m.
    pub ball_arm: f64,
    /// kg m².
    pub ball_inertia: f64,
    /// Displacement of the normal force behind the ball's centre, against the slip, m.
    pub normal_offset: f64,
    /// Where an expression moves the torque arm of the normal force, along x and y, m.
    pub arm_offset: [f64; 2],
    /// Tilt of the contact's normal: its x and y components (small angles, rad).
    pub tilt: [f64; 2],
    /// Impulse from outside on the racket's centre of mass, N s.
    pub drive: Vector3<f64>,
    /// Angular impulse from outside on the racket, N m s.
    pub drive_twist: Vector3<f64>,
    /// Largest angular impulse with which the mount resists a change of twist about x, N m s.
    pub twist_hold: f64,
    /// Energy taken by frame modes, as q in e'² = e² − q (1 + e')².
    pub mode_loss: f64,
    /// Duration over which the face turns and the ball travels across it, s; 0: an instant.
    pub face_time: f64,
}

impl Laws {
    pub fn new(restitution: f64, friction: f64, sliding: Sliding, ball_arm: f64, ball_inertia: f64) -> Self {
        Laws {
            restitution,
            friction,
            tangential_restitution: [0.0; 2],
            diagonal_restitution: [0.0; 2],
            sliding,
            ball_arm,
            ball_inertia,
            normal_offset: 0.0,
            arm_offset: [0.0; 2],
            tilt: [0.0; 2],
            drive: Vector3::zeros(),
            drive_twist: Vector3::zeros(),
            twist_hold: 0.0,
            mode_loss: 0.0,
            face_time: 0.0,
        }
    }

    /// Restitution with the modes' energy taken out, limited to what conserves or loses energy.
    ///
    /// e'² = e² − q (1 + e')² follows from E_vib = q K J²/2 with J = (1 + e') v/K.
    pub fn effective_restitution(&self) -> f64 {
        let e = self.restitution.clamp(0.0, 1.0);
        let q = self.mode_loss;
        if q == 0.0 || e.is_nan() || q.is_nan() {
            return e + q;
        }
        let root = (e * e * (1.0 + q) - q).max(0.0).sqrt();
        ((root - q) / (1.0 + q)).clamp(0.0, 1.0)
    }

    /// Tangential relative velocity after a stuck contact that came with `u` (x and y), m/s.
    pub fn rebound(&self, u: [f64; 2]) -> [f64; 2] {
        // Along a diagonal d: e (d·u) d, with both components of d 1/√2 in size.
        let (along, other) = (0.5 * self.diagonal_restitution[0] * (u[0] + u[1]), 0.5 * self.diagonal_restitution[1] * (u[0] - u[1]));
        [-self.tangential_restitution[0] * u[0] - along - other, -self.tangential_restitution[1] * u[1] - along + other]
    }

    /// True when the contact is the plain one: no offset, tilt, outside impulse.
    pub fn is_plain(&self) -> bool {
        self.normal_offset == 0.0
            && self.arm_offset == [0.0; 2]
            && self.tilt == [0.0; 2]
            && self.twist_hold == 0.0
            && self.drive == Vector3::zeros()
            && self.drive_twist == Vector3::zeros()
    }
}
