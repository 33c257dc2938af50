//! `grip-torque`: the mount or hand resists twisting about the handle.

use super::Effect;
use crate::impact::card::{Bases, EffectCard, EffectKind, ParameterCard};
use crate::impact::real::Real;
use crate::impact::rigid::{Contact, Laws};
use crate::impact::viscoelastic;

pub(super) static CARD: EffectCard = EffectCard {
    name: "grip-torque",
    kind: EffectKind::Physics,
    physics: "The mount (or the hand) holds the handle by friction and resists its twist about the long axis with at most a certain torque. \
              Over the contact this takes away a fixed angular impulse, or all of the twist when the impact is weak.",
    equation: "H_x = -sign(d Omega_x) min((share T_grip + base_torque_nm) T_c, what keeps Omega_x)",
    parameters: &[
        ParameterCard::strength("share", "", "of the table's grip_torque that acts", 1.0, (0.0, 5.0), 1.0),
        ParameterCard::strength("base_torque_nm", "N m", "torque that acts whatever the table says (a hand)", 0.0, (0.0, 60.0), 5.0),
        ParameterCard::shape("contact_time_s", "s", "duration over which it acts (rigid base only)", 4.5e-3, (1e-3, 1e-2), 5e-4),
    ],
    source: "Haake, Goodwill, Choppin 2010 (900 impacts with set torque); Elliott 1982",
    signature: "Off-axis impacts only: the racket twists less, the ball leaves faster and less away from the axis; fades as the speed rises.",
    confused_with: &["racket-inertia", "stringbed-edge", "string-tilt", "frame-torsion"],
    separated_by: "grip torque varied at one place off the axis; approach speed varied at one place; the racket's twist after impact",
    check_first: None,
    bases: Bases { rigid: "angular impulse during the contact", viscoelastic: "Coulomb torque integrated with the contact" },
    effect: &GripTorque,
};

/// Kinks: at a table's torque of 0 the derivative by it is the mean of both sides, none; between holding and giving way it is that
/// of the side taken.
#[derive(Debug)]
struct GripTorque;

impl<T: Real> Effect<T> for GripTorque {
    fn change_laws(&self, p: &[T], at: &Contact<T>, laws: &mut Laws<T>) {
        laws.twist_hold += (p[0] * at.input.grip_torque.abs() + p[1]) * p[2];
    }

    fn change_viscoelastic(&self, p: &[T], at: &Contact<T>, laws: &mut viscoelastic::Laws<T>) {
        laws.grip += p[0] * at.input.grip_torque.abs() + p[1];
        laws.twist_start = at.input.racket_rate.x;
    }
}
