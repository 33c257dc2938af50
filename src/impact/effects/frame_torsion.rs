//! `frame-torsion`: the head twists against the handle in a mode of its own.

use super::Effect;
use crate::impact::card::{Bases, EffectCard, EffectKind, ParameterCard};
use crate::impact::rigid::{Contact, Laws};
use crate::impact::viscoelastic;

pub(super) static CARD: EffectCard = EffectCard {
    name: "frame-torsion",
    kind: EffectKind::Physics,
    physics: "The head can twist elastically against the handle (roughly 300 to 450 Hz). Impacts off the long axis feed that mode and \
              its energy is lost to the ball.",
    equation: "e'^2 = e^2 - q (1 + e')^2, q = transfer y^2 / (modal_share I_x K_zz)",
    parameters: &[
        ParameterCard::strength("transfer", "", "S^2 of the pulse: about 0.003 at 380 Hz, 0.1 at 250 Hz, 0.45 at 130 Hz", 0.05, (0.0, 2.0), 0.1),
        ParameterCard::shape("modal_share", "", "modal inertia over the racket's I_x", 0.45, (0.1, 2.0), 0.1),
        ParameterCard::shape("frequency_hz", "Hz", "of the mode (visco-elastic base only)", 380.0, (150.0, 800.0), 50.0),
    ],
    source: "Banwell et al. 2012 (modal analysis); size estimated from the half-sine response",
    signature: "Rebound slower than the model in proportion to the square of the distance from the long axis, zero on it; nothing \
                tangential.",
    confused_with: &["grip-torque", "stringbed-edge", "racket-inertia"],
    separated_by: "twist rate of the head against the handle (markers on both); a modal test",
    bases: Bases { rigid: "energy in the mode lowers the restitution", viscoelastic: "a second mode, linear across the face, is integrated with the contact" },
    effect: &FrameTorsion,
};

/// Transfer at which the modal inertia is the stated one.
const TYPICAL_TRANSFER: f64 = 0.05;

#[derive(Debug)]
struct FrameTorsion;

impl Effect for FrameTorsion {
    fn change_laws(&self, p: &[f64], at: &Contact, laws: &mut Laws) {
        let y = at.input.position.y;
        laws.mode_loss += p[0] * y * y / (p[1] * at.body.racket_inertia.x * at.normal_compliance);
    }

    fn change_viscoelastic(&self, p: &[f64], at: &Contact, laws: &mut viscoelastic::Laws) {
        if p[0] > 0.0 {
            laws.torsion_shape = at.input.position.y;
            laws.torsion_inertia = p[1] * at.body.racket_inertia.x / (p[0] / TYPICAL_TRANSFER);
            laws.torsion_rate = 2.0 * std::f64::consts::PI * p[2];
        }
    }
}
