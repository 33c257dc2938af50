//! `lateral-strings`: strings that give sideways and snap back.

use super::Effect;
use crate::impact::card::{Bases, EffectCard, EffectKind, ParameterCard};
use crate::impact::real::Real;
use crate::impact::rigid::{Contact, Laws};
use crate::impact::viscoelastic;

pub(super) static CARD: EffectCard = EffectCard {
    name: "lateral-strings",
    kind: EffectKind::Physics,
    physics: "The strings are dragged sideways by friction, store energy and snap back before the ball leaves. A ball that does not slide then leaves \
              with its surface moving against the strings (overspin), more across the racket, where the main strings move, than along it.",
    equation: "u_t' = -e_t u_t for a contact that sticks, e_t separately along x and y",
    parameters: &[
        ParameterCard::strength("across", "", "tangential restitution across the face (y)", 0.15, (-0.95, 0.95), 0.15).size_alone(),
        ParameterCard::strength("along", "", "tangential restitution along the racket (x)", 0.0, (-0.95, 0.95), 0.15).size_alone(),
    ],
    source: "Cross 2002, 2005 (grip-slip behaviour); Goodwill and Haake 2004; thesis 2.7.1",
    signature: "Only tangential velocity and spin change, in proportion to the slip speed of impacts that stick; the ratio of the spin change to the \
                velocity change stays; nothing while the ball slides throughout.",
    confused_with: &["friction-law", "ball-deformation", "offset-normal-force"],
    separated_by: "tangential velocity and spin measured together; steep and shallow incidence; two string types at one tension",
    check_first: None,
    bases: Bases { rigid: "as given", viscoelastic: "tangential spring and damper k_t, c_t in series with friction" },
    effect: &LateralStrings,
};

/// Sideways stiffness of typical strings, N/m, and the strength that stands for it.
const STIFFNESS: f64 = 60e3;
const TYPICAL: f64 = 0.15;
const RIGID_OVER_SOFT: f64 = 50.0;

/// In base viscoelastic a strength of 0 is no limit of small ones (rigid sideways against springs): no derivative there.
#[derive(Debug)]
struct LateralStrings;

impl<T: Real> Effect<T> for LateralStrings {
    fn change_laws(&self, p: &[T], _: &Contact<T>, laws: &mut Laws<T>) {
        laws.tangential_restitution[1] += p[0];
        laws.tangential_restitution[0] += p[1];
    }

    fn change_viscoelastic(&self, p: &[T], _: &Contact<T>, laws: &mut viscoelastic::Laws<T>) {
        for (strength, stiffness) in [(p[0], &mut laws.k_ty), (p[1], &mut laws.k_tx)] {
            // The softer, the more they store: compliance in proportion to the strength.
            if strength.value() != 0.0 {
                *stiffness = T::constant(STIFFNESS) / (strength.abs() / TYPICAL);
            }
        }
        // One direction soft, the other rigid: rigid stands for stiff enough to follow within the contact.
        let rigid = T::constant(STIFFNESS * RIGID_OVER_SOFT);
        let (x, y) = (laws.k_tx.value() > 0.0, laws.k_ty.value() > 0.0);
        if x || y {
            laws.k_tx = if x { laws.k_tx } else { rigid };
            laws.k_ty = if y { laws.k_ty } else { rigid };
        }
    }
}
