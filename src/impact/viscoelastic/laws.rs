//! The numbers of one visco-elastic impact, singly and side by side.

use super::contact_laws::{BallLaw, ContactLaws, FrictionDirection, NormalForce, Release};
use super::kernel::DEEPEST;
use super::number::{Number, side_by_side};
use crate::impact::body::Body;
use crate::impact::model::MU;
use crate::impact::real::Real;

side_by_side! {
    /// Bodies and contact laws of one impact. Effects change it before the impact is stepped.
    pub struct Laws {
        /// kg.
        ball_mass,
        /// m.
        ball_radius,
        /// Undeformed, kg m².
        ball_inertia,
        /// kg.
        racket_mass,
        /// kg m².
        inertia_x,
        /// kg m².
        inertia_y,
        /// kg m².
        inertia_z,
        /// N/m.
        k_b0,
        /// N/m^(1+alpha).
        a_k,
        alpha,
        /// N s/m³.
        a_c,
        beta_c,
        /// N s/m.
        c_b0,
        /// 1: the constant damping grows in over the first millimetre; 0: it acts in full from first touch (Kelvin-Voigt).
        onset,
        /// 1: the contact ends when ball and strings are back in place, whatever the force; 0: when the force is nil.
        by_displacement,
        /// Factor on the momentum-flux force.
        flux,
        /// Factor on the moment of the momentum flux of a spinning ball (Haake 2005).
        flux_offset,
        /// N/m.
        k_s0,
        /// N/m³.
        k_s2,
        /// N s/m.
        c_s,
        mu,
        /// 1: sliding friction points along the impulse that would stop the slip; 0: against the slip itself (Coulomb).
        projected,
        lambda_r,
        /// 1/m.
        kappa_i,
        /// Relative growth of the stringbed's stiffness with x² and y² from the centre, 1/m².
        edge_x,
        edge_y,
        /// Local position of the centre of mass, m.
        com_x,
        /// Sideways stiffness and damping of the strings, N/m and N s/m; 0: rigid sideways.
        k_tx,
        k_ty,
        c_t,
        /// Normal force behind the centre, m.
        normal_offset,
        /// Lean of the pocket per metre of deflection and metre from the centre, 1/m.
        tilt_x,
        tilt_y,
        /// Largest torque of the mount about x, N m.
        grip,
        /// Rate about x at first touch, rad/s.
        twist_start,
        /// Force (along z) and torque (about y) of the player, N and N m.
        drive_force,
        drive_torque,
        /// Bending mode: shape at the impact point, modal mass (kg), frequency (rad/s), damping ratio; a mass of 0: no mode.
        mode_shape,
        mode_mass,
        mode_rate,
        mode_damping,
        /// Torsional mode: shape at the impact point (m), modal inertia (kg m²), frequency (rad/s); an inertia of 0: none.
        torsion_shape,
        torsion_inertia,
        torsion_rate,
    }
}

side_by_side! {
    /// What the rates need of the laws again and again.
    pub(super) struct Constants {
        /// Compression beyond which the ball's geometry no longer follows, m.
        deepest,
        /// Mass at rest on the strings per contact area (over pi), kg/m².
        resting_per_area,
        /// Fall of the ball's inertia per compression, kg m.
        inertia_fall,
        /// Inverse masses and inertias: of the racket, of both bodies together, about x, y, z.
        per_racket_mass,
        per_mass,
        per_inertia_x,
        per_inertia_y,
        per_inertia_z,
        /// Differences of the racket's inertias.
        gyro_x,
        gyro_y,
        gyro_z,
        /// Inverse of the sideways strings' damping and of the modes' masses; 0 where there are none.
        per_side_damping,
        per_mode_mass,
        per_torsion_inertia,
    }
}

impl<T: Number> Laws<T> {
    pub(super) fn constants(&self) -> Constants<T> {
        let (zero, one) = (self.ball_mass.same(0.0), self.ball_mass.same(1.0));
        let inverse = |x: T| T::choose(zero.less(x), one / x, zero);
        Constants {
            deepest: self.ball_radius * DEEPEST,
            resting_per_area: self.ball_mass / (self.ball_radius * self.ball_radius * 4.0),
            inertia_fall: self.ball_inertia * self.kappa_i,
            per_racket_mass: one / self.racket_mass,
            per_mass: one / self.ball_mass + one / self.racket_mass,
            per_inertia_x: one / self.inertia_x,
            per_inertia_y: one / self.inertia_y,
            per_inertia_z: one / self.inertia_z,
            gyro_x: self.inertia_z - self.inertia_y,
            gyro_y: self.inertia_x - self.inertia_z,
            gyro_z: self.inertia_y - self.inertia_x,
            per_side_damping: inverse(self.c_t),
            per_mode_mass: inverse(self.mode_mass),
            per_torsion_inertia: inverse(self.torsion_inertia),
        }
    }

    /// Slip velocity per unit of tangential impulse at first touch, 1/kg.
    pub(super) fn slip_compliance(&self) -> T {
        let one = self.ball_mass.same(1.0);
        one / self.ball_mass + one / self.racket_mass + self.ball_radius * self.ball_radius / self.ball_inertia
    }
}

/// N s/m: a twentieth of the seed value.
pub(crate) const LEAST_STRING_DAMPING: f64 = 0.1;

impl<T: Real> Laws<T> {
    /// Values of the base's 14 parameters, in the order of [`crate::impact::Base::parameters`], and the body.
    pub(crate) fn new(p: &[T], body: &Body<T>, stiffness_from_tension: bool, laws: &ContactLaws) -> Self {
        let flag = |on: bool| T::constant(if on { 1.0 } else { 0.0 });
        Laws {
            ball_mass: body.ball_mass,
            ball_radius: T::constant(body.ball_radius),
            ball_inertia: body.ball_inertia,
            racket_mass: body.racket_mass,
            inertia_x: body.racket_inertia.x,
            inertia_y: body.racket_inertia.y,
            inertia_z: body.racket_inertia.z,
            k_b0: p[0],
            a_k: p[1],
            alpha: p[2],
            a_c: p[3],
            beta_c: p[4],
            c_b0: p[5],
            onset: flag(laws.ball == BallLaw::Goodwill),
            by_displacement: flag(laws.release == Release::Displacement),
            flux: flag(laws.ball == BallLaw::Goodwill),
            flux_offset: flag(laws.normal_force == NormalForce::Haake),
            // A derivative by `kS0` is that by the stiffness itself, wherever its value comes from.
            k_s0: if stiffness_from_tension { p[6] - p[6].value() + stringbed_stiffness(body.tension_lb) } else { p[6] },
            k_s2: p[7],
            c_s: p[8],
            mu: p[MU],
            projected: flag(laws.friction_direction == FrictionDirection::Projected),
            lambda_r: p[10],
            kappa_i: p[11],
            edge_x: T::zero(),
            edge_y: T::zero(),
            com_x: body.com_x,
            k_tx: p[12],
            k_ty: p[12],
            c_t: p[13],
            normal_offset: T::zero(),
            tilt_x: T::zero(),
            tilt_y: T::zero(),
            grip: T::zero(),
            twist_start: T::zero(),
            drive_force: T::zero(),
            drive_torque: T::zero(),
            mode_shape: T::zero(),
            mode_mass: T::zero(),
            mode_rate: T::zero(),
            mode_damping: T::zero(),
            torsion_shape: T::zero(),
            torsion_inertia: T::zero(),
            torsion_rate: T::zero(),
        }
    }

    /// A law that no contact has: which, its value, and what is allowed.
    pub(crate) fn impossible(&self) -> Option<(&'static str, f64, &'static str)> {
        let stiffness = [("string_stiffness", self.k_s0.value()), ("ball_stiffness", self.k_b0.value())];
        let others = [("string_damping", self.c_s.value()), ("ball_damping", self.a_c.value()), ("friction", self.mu.value())];
        let slack = stiffness.into_iter().find(|(_, v)| !(v.is_finite() && *v > 0.0)).map(|(what, v)| (what, v, "a positive number"));
        slack.or_else(|| others.into_iter().find(|(_, v)| !v.is_finite()).map(|(what, v)| (what, v, "a finite number")))
    }

    /// The massless strings need a damper at first touch, or their velocity is undefined: where the ball's own grows in from
    /// nothing, at least [`LEAST_STRING_DAMPING`] acts. Effects cannot take more damping or friction away than there is.
    pub(crate) fn keep_within_limits(&mut self) {
        let least = if self.onset.value() > 0.0 || self.c_b0.value() <= 0.0 { LEAST_STRING_DAMPING } else { 0.0 };
        // Not `max`: that would turn NaN into a number.
        if self.c_s.value() < least {
            self.c_s = T::constant(least);
        }
        for law in [&mut self.mu, &mut self.a_c] {
            if law.value() < 0.0 {
                *law = T::zero();
            }
        }
    }
}

impl Laws {
    /// Whether both have the same parts: sideways springs, frame modes.
    pub(crate) fn has_parts_of(&self, other: &Laws) -> bool {
        let parts = |l: &Laws| [l.k_tx > 0.0, l.k_ty > 0.0, l.mode_mass > 0.0, l.torsion_inertia > 0.0];
        parts(self) == parts(other)
    }

    /// True when stiffening and damping grow with squares: no powers to take.
    pub(super) fn has_square_powers(&self) -> bool {
        self.alpha == 2.0 && self.beta_c == 2.0
    }

    /// True when the short kernel describes the impact: no effect beyond the plain base, powers of 2.
    pub(super) fn is_plain(&self) -> bool {
        self.has_square_powers()
            && self.onset == 1.0
            && self.by_displacement == 0.0
            && self.flux_offset == 0.0
            && self.projected == 0.0
            && self.edge_x == 0.0
            && self.edge_y == 0.0
            && self.k_tx == 0.0
            && self.k_ty == 0.0
            && self.normal_offset == 0.0
            && self.tilt_x == 0.0
            && self.tilt_y == 0.0
            && self.grip == 0.0
            && self.drive_force == 0.0
            && self.drive_torque == 0.0
            && self.mode_mass == 0.0
            && self.torsion_inertia == 0.0
    }
}

/// Stringbed stiffness per lb of tension, N/m: 27, 36, 39, 45 kN/m at 40, 55, 60, 70 lb lie on one line ...
pub(crate) const STIFFNESS_PER_LB: f64 = 600.0;
/// ... which would begin here without tension, N/m.
const STIFFNESS_SLACK: f64 = 3e3;

/// Stringbed stiffness from the tension, N/m.
fn stringbed_stiffness(tension_lb: f64) -> f64 {
    STIFFNESS_SLACK + STIFFNESS_PER_LB * tension_lb
}
