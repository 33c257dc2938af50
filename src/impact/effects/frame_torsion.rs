//! `frame-torsion`: the head twists against the handle in a mode of its own.

use super::Effect;
use crate::impact::card::{Bases, EffectCard, EffectKind, ParameterCard};
use crate::impact::real::Real;
use crate::impact::rigid::{Contact, Laws};
use crate::impact::viscoelastic;

pub(super) static CARD: EffectCard = EffectCard {
    name: "frame-torsion",
    kind: EffectKind::Physics,
    physics: "The head can twist elastically against the handle (roughly 300 to 450 Hz). Impacts off the long axis feed that mode and \
              its energy is lost to the ball. The twist grows from the throat to the tip.",
    equation: "e'^2 = e^2 - q (1 + e')^2, q = (transfer - toward_tip x / half_length) y^2 / (modal_share I_x K_zz)",
    parameters: &[
        ParameterCard::strength("transfer", "", "S^2 of the pulse: about 0.003 at 380 Hz, 0.1 at 250 Hz, 0.45 at 130 Hz", 0.05, (0.0, 2.0), 0.1),
        ParameterCard::strength("toward_tip", "", "growth of the transfer from the middle of the strings to their tip", 0.0, (0.0, 2.0), 0.1),
        ParameterCard::shape("modal_share", "", "modal inertia over the racket's I_x", 0.45, (0.1, 2.0), 0.1),
        ParameterCard::shape("frequency_hz", "Hz", "of the mode (visco-elastic base only)", 380.0, (150.0, 800.0), 50.0),
    ],
    source: "Banwell et al. 2012 (modal analysis); size estimated from the half-sine response",
    signature: "Rebound slower than the model in proportion to the square of the distance from the long axis, zero on it; nothing \
                tangential; more toward the tip.",
    confused_with: &["grip-torque", "stringbed-edge", "racket-inertia"],
    separated_by: "twist rate of the head against the handle (markers on both); a modal test",
    check_first: None,
    bases: Bases { rigid: "energy in the mode lowers the restitution", viscoelastic: "a second mode, linear across the face, is integrated with the contact" },
    effect: &FrameTorsion,
};

/// Transfer at which the modal inertia is the stated one.
const TYPICAL_TRANSFER: f64 = 0.05;

/// In base viscoelastic the mode appears with the strength: at 0 there is no derivative by it.
#[derive(Debug)]
struct FrameTorsion;

/// Transfer at the impact's distance along the racket; the mode's shape is y times a function of x that has no agreed form,
/// so its square is taken to first order.
fn transfer_at<T: Real>(p: &[T], at: &Contact<T>) -> T {
    (p[0] - p[1] * at.input.position.x / at.body.half_length).max(T::zero())
}

impl<T: Real> Effect<T> for FrameTorsion {
    fn change_laws(&self, p: &[T], at: &Contact<T>, laws: &mut Laws<T>) {
        let y = at.input.position.y;
        laws.mode_loss += transfer_at(p, at) * y * y / (p[2] * at.body.racket_inertia.x * at.normal_compliance);
    }

    fn change_viscoelastic(&self, p: &[T], at: &Contact<T>, laws: &mut viscoelastic::Laws<T>) {
        let transfer = transfer_at(p, at);
        if transfer.value() > 0.0 {
            laws.torsion_shape = at.input.position.y;
            laws.torsion_inertia = p[2] * at.body.racket_inertia.x / (transfer / TYPICAL_TRANSFER);
            laws.torsion_rate = p[3] * (2.0 * std::f64::consts::PI);
        }
    }
}
