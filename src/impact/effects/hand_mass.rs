//! `hand-mass`: the hand counts as a point mass on the handle.

use super::Effect;
use crate::impact::body::Body;
use crate::impact::card::{Bases, EffectCard, EffectKind, ParameterCard};

pub(super) static CARD: EffectCard = EffectCard {
    name: "hand-mass",
    kind: EffectKind::Physics,
    physics: "During the contact the hand and forearm act like 0.1 to 0.3 kg fixed near the butt, because the impulse reaches the hand within \
              1.5 ms. The racket's mass, centre of mass and swing inertia change with it.",
    equation: "M' = M + m_h, c' = (M c + m_h s_h)/M', I' = I + M m_h/M' (c - s_h)^2 about y and z",
    parameters: &[
        ParameterCard::strength("mass_kg", "kg", "mass that moves with the handle", 0.1, (0.0, 2.0), 0.1),
        ParameterCard::shape("from_butt_m", "m", "where it sits", 0.07, (0.0, 0.25), 0.03),
    ],
    source: "Cross 2010 (about 0.2 kg at the handle's end); Haake, Goodwill, Choppin 2010",
    signature: "Faster rebound toward tip and throat, none where a free racket would turn about the hand (near the face's centre of percussion); \
                the racket turns less about y; no dependence on y, spin or angle.",
    confused_with: &["racket-inertia", "frame-vibration", "swing-drive"],
    separated_by: "the same impacts with the racket held and free, at tip and throat",
    bases: Bases { rigid: "as given", viscoelastic: "as given; the frame mode of `frame-vibration` carries it too" },
    effect: &HandMass,
};

#[derive(Debug)]
struct HandMass;

impl Effect for HandMass {
    fn change_body(&self, p: &[f64], body: &mut Body) {
        body.add_mass_on_axis(p[0], p[1]);
    }
}
