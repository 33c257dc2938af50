//! `swing-drive`: the player keeps pushing during the contact.

use super::Effect;
use crate::impact::card::{Bases, EffectCard, EffectKind, ParameterCard};
use crate::impact::real::Real;
use crate::impact::rigid::{Contact, Laws};
use crate::impact::viscoelastic;
use nalgebra::Vector3;

pub(super) static CARD: EffectCard = EffectCard {
    name: "swing-drive",
    kind: EffectKind::Physics,
    physics: "The hand goes on accelerating the racket while the ball is on the strings. The extra impulse is force times contact \
              time, whatever the speed of the ball.",
    equation: "u_z' = -e u_z with V += F T_c / M along the ball's side, Omega_y += torque T_c / I_y toward it",
    parameters: &[
        ParameterCard::strength("force_n", "N", "on the centre of mass, toward the ball", 50.0, (-2000.0, 2000.0), 50.0),
        ParameterCard::strength("torque_nm", "N m", "swinging the head toward the ball", 0.0, (-300.0, 300.0), 10.0),
        ParameterCard::shape("contact_time_s", "s", "duration of the contact (rigid base only)", 4.5e-3, (1e-3, 1e-2), 5e-4),
    ],
    source: "Cross 2010 (forces and torques on the hand); visco-elastic model: 100 N adds 0.8 to 1.1 m/s",
    signature: "Ball faster by the same amount at every speed, more toward the throat for a force and toward the tip for a torque; no \
                spin.",
    confused_with: &["hand-mass", "window-bias", "racket-inertia"],
    separated_by: "rebound against approach speed (a shift, not a slope); absent on a passive rig",
    check_first: None,
    bases: Bases { rigid: "impulses on the racket during the contact", viscoelastic: "constant force and torque integrated with the contact" },
    effect: &SwingDrive,
};

#[derive(Debug)]
struct SwingDrive;

impl<T: Real> Effect<T> for SwingDrive {
    fn change_laws(&self, p: &[T], at: &Contact<T>, laws: &mut Laws<T>) {
        laws.drive += Vector3::new(T::zero(), T::zero(), p[0] * at.side * p[2]);
        // Positive rate about y carries the head (negative x) toward +z.
        laws.drive_twist += Vector3::new(T::zero(), p[1] * at.side * p[2], T::zero());
    }

    fn change_viscoelastic(&self, p: &[T], _: &Contact<T>, laws: &mut viscoelastic::Laws<T>) {
        laws.drive_force += p[0];
        laws.drive_torque += p[1];
    }
}
