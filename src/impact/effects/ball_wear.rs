//! `ball-wear`: balls change as they are hit.

use super::Effect;
use crate::impact::card::{Bases, EffectCard, EffectKind, ParameterCard};
use crate::impact::real::Real;
use crate::impact::rigid::{Contact, Laws};
use crate::impact::viscoelastic;

pub(super) static CARD: EffectCard = EffectCard {
    name: "ball-wear",
    kind: EffectKind::Physics,
    physics: "Every hard impact fluffs or wears the felt, and the ball loses pressure and warms. The restitution therefore drifts with \
              the order of the impacts, more so at high speed.",
    equation: "e = e_0 (1 - loss_per_100 (order / 100) (v_n / 25 m/s)^0.5)",
    parameters: &[ParameterCard::strength("loss_per_100", "", "relative fall of the restitution per 100 impacts at 25 m/s", 0.02, (-0.3, 0.3), 0.02).one_way()],
    source: "thesis 2.2 (visible after 100 impacts at 40 m/s); Lane et al. 2017 (105 impacts a ball in play)",
    signature: "Rebound speed drifts with the order of the impacts, whatever their place; stronger at high speed.",
    confused_with: &["ball-damping", "string-tension"],
    separated_by: "ball identity and order in the table; drop tests between",
    check_first: None,
    bases: Bases { rigid: "as given", viscoelastic: "ball damping multiplied by 1 + 8 loss_per_100 order / 100" },
    effect: &BallWear,
};

/// m/s.
const REFERENCE_SPEED: f64 = 25.0;

/// Relative growth of the ball's damping per relative loss of restitution.
const DAMPING_PER_LOSS: f64 = 8.0;

#[derive(Debug)]
struct BallWear;

impl<T: Real> Effect<T> for BallWear {
    fn change_laws(&self, p: &[T], at: &Contact<T>, laws: &mut Laws<T>) {
        laws.restitution *= -(p[0] * at.input.order / 100.0 * (at.approach_speed / REFERENCE_SPEED).sqrt()) + 1.0;
    }

    fn change_viscoelastic(&self, p: &[T], at: &Contact<T>, laws: &mut viscoelastic::Laws<T>) {
        laws.a_c *= p[0] * DAMPING_PER_LOSS * at.input.order / 100.0 + 1.0;
    }
}
