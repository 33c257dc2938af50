//! `lateral-strings`: strings that give sideways and snap back.

use super::Effect;
use crate::impact::card::{Bases, EffectCard, EffectKind, ParameterCard};
use crate::impact::rigid::{Contact, Laws};

pub(super) static CARD: EffectCard = EffectCard {
    name: "lateral-strings",
    kind: EffectKind::Physics,
    physics: "The strings are dragged sideways by friction, store energy and snap back before the ball leaves. A ball that does not slide then leaves \
              with its surface moving against the strings (overspin), more across the racket, where the main strings move, than along it.",
    equation: "u_t' = -e_t u_t for a contact that sticks, e_t separately along x and y",
    parameters: &[
        ParameterCard::strength("across", "", "tangential restitution across the face (y)", 0.15, (-0.95, 0.95), 0.15),
        ParameterCard::strength("along", "", "tangential restitution along the racket (x)", 0.0, (-0.95, 0.95), 0.15),
    ],
    source: "Cross 2002, 2005 (grip-slip behaviour); Goodwill and Haake 2004; thesis 2.6",
    signature: "Only tangential velocity and spin change, in proportion to the slip speed of impacts that stick; the ratio of the spin change to the \
                velocity change stays; nothing while the ball slides throughout.",
    confused_with: &["friction-law", "ball-deformation", "offset-normal-force"],
    separated_by: "tangential velocity and spin measured together; steep and shallow incidence; two string types at one tension",
    bases: Bases { rigid: "as given", viscoelastic: "tangential spring and damper k_t, c_t in series with friction" },
    effect: &LateralStrings,
};

#[derive(Debug)]
struct LateralStrings;

impl Effect for LateralStrings {
    fn change_laws(&self, p: &[f64], _: &Contact, laws: &mut Laws) {
        laws.tangential_restitution[1] += p[0];
        laws.tangential_restitution[0] += p[1];
    }
}
