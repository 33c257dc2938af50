//! `finite-contact`: the face turns and the ball travels while they touch.

use super::Effect;
use crate::impact::card::{Bases, EffectCard, EffectKind, ParameterCard};
use crate::impact::real::Real;
use crate::impact::rigid::{BED_SHARE, Contact, Laws};

pub(super) static CARD: EffectCard = EffectCard {
    name: "finite-contact",
    kind: EffectKind::Physics,
    physics: "During the 4 to 5 ms of contact the face turns by several degrees, the ball rolls across it and the contact plane sits \
              up to 20 mm behind the frame. An impulse at the first touch misses all three.",
    equation: "the impulse in parts, along a spring's time law of duration T = T_c (K_c/K_zz)^1/2 (20/v_n)^0.14, each where racket and ball \
               then are; work returned e^2 times the work absorbed; contact plane bed_share times the compression behind the frame",
    parameters: &[
        ParameterCard::strength("contact_time_s", "s", "duration of the contact of 20 m/s at the middle of the face", 4.5e-3, (0.0, 1e-2), 4e-3),
        ParameterCard::shape("bed_share", "", "share of the compression by which the strings give way, the rest being the ball's", BED_SHARE, (0.0, 1.5), 0.25)
            .fitted(),
    ],
    source: "Stronge 2000 (energetic restitution, impulse in the course of time); visco-elastic model (this program)",
    signature: "Ball leaves with up to 1 m/s more along the handle off the centre of the axis; more twist off axis; all in proportion to \
                contact time and turning rate.",
    confused_with: &["string-tilt", "face-plane-offset", "window-bias", "camera-skew"],
    separated_by: "scales with the racket's rate; contact time",
    check_first: None,
    bases: Bases { rigid: "as given", viscoelastic: "inherent: the contact has a duration, so the effect adds nothing" },
    effect: &FiniteContact,
};

#[derive(Debug)]
struct FiniteContact;

impl<T: Real> Effect<T> for FiniteContact {
    fn change_laws(&self, p: &[T], _: &Contact<T>, laws: &mut Laws<T>) {
        laws.face_time += p[0];
        laws.bed_share = p[1];
    }
}
