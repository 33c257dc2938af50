//! `string-damping`: strings that lose energy themselves.

use super::Effect;
use crate::impact::card::{Bases, EffectCard, EffectKind, ParameterCard};
use crate::impact::real::Real;
use crate::impact::rigid::{Contact, Laws};
use crate::impact::viscoelastic;

pub(super) static CARD: EffectCard = EffectCard {
    name: "string-damping",
    kind: EffectKind::Physics,
    physics: "Strings rub on each other and lose some energy in every stretch. The loss is a nearly constant share, whatever the speed \
              and place.",
    equation: "e = e_0 exp(-extra / 130 N s/m)",
    parameters: &[ParameterCard::strength(
        "extra",
        "N s/m",
        "damping beyond the base's (seed value 2 N s/m in the visco-elastic base)",
        2.0,
        (-20.0, 100.0),
        2.0,
    )],
    source: "thesis 2.7.3 (2 N s/m); visco-elastic model: 2 to 5 N s/m gives -0.022 in the apparent restitution",
    signature: "All rebounds slower by the same share, flat in speed, position and angle: exactly what a lower restitution does.",
    confused_with: &["string-tension", "ball-damping", "scale-error", "momentum-flux"],
    separated_by: "a steel or pool ball dropped on the strings; rebound of the tennis ball from a wall",
    check_first: None,
    bases: Bases {
        rigid: "as given; the restitution absorbs it completely, so data in base rigid cannot show it",
        viscoelastic: "string damping c_S + extra, never less than none",
    },
    effect: &StringDamping,
};

/// 0.022 (1 + m/m_e) of a restitution of 0.8 for 3 N s/m, N s/m.
const SCALE: f64 = 130.0;

#[derive(Debug)]
struct StringDamping;

impl<T: Real> Effect<T> for StringDamping {
    fn change_laws(&self, p: &[T], _: &Contact<T>, laws: &mut Laws<T>) {
        laws.restitution *= (-p[0] / SCALE).exp();
    }

    fn change_viscoelastic(&self, p: &[T], _: &Contact<T>, laws: &mut viscoelastic::Laws<T>) {
        laws.c_s += p[0];
    }
}
