//! `ball-stiffening`: a ball that grows stiffer the more it is squeezed.

use super::Effect;
use crate::impact::card::{Bases, EffectCard, EffectKind, ParameterCard};
use crate::impact::real::Real;
use crate::impact::rigid::{Contact, Laws};
use crate::impact::viscoelastic;

pub(super) static CARD: EffectCard = EffectCard {
    name: "ball-stiffening",
    kind: EffectKind::Physics,
    physics: "A ball stiffens as its shell buckles and its gas is compressed. A stiffer ball leaves more of the energy to the strings, \
              which return it, so the restitution gains at high speed.",
    equation: "e = e_0 + gain ((v_n / 25 m/s)^2 - 1)",
    parameters: &[ParameterCard::strength("gain", "", "gain of the restitution per unit of (v_n/25)^2", 0.02, (-0.5, 0.5), 0.03).one_way()],
    source: "visco-elastic model: a constant 40 kN/m gives +0.034, -0.009, -0.075 in the apparent restitution at 15, 30, 45 m/s",
    signature: "Restitution departs from the model in proportion to the square of the approach speed; shorter contact; nothing on \
                position, angle, spin.",
    confused_with: &["ball-damping", "string-stiffening", "momentum-flux"],
    separated_by: "contact time and compression against approach speed",
    check_first: None,
    bases: Bases { rigid: "as given", viscoelastic: "growth of the ball's stiffness A_K multiplied by 1 + gain / 0.2" },
    effect: &BallStiffening,
};

/// m/s.
const REFERENCE_SPEED: f64 = 25.0;

/// Gain at which the visco-elastic base's growth of stiffness doubles.
const GAIN_OF_BASE: f64 = 0.2;

#[derive(Debug)]
struct BallStiffening;

impl<T: Real> Effect<T> for BallStiffening {
    fn change_laws(&self, p: &[T], at: &Contact<T>, laws: &mut Laws<T>) {
        laws.restitution += p[0] * ((at.approach_speed / REFERENCE_SPEED).powi(2) - 1.0);
    }

    fn change_viscoelastic(&self, p: &[T], _: &Contact<T>, laws: &mut viscoelastic::Laws<T>) {
        laws.a_k *= p[0] / GAIN_OF_BASE + 1.0;
    }
}
