//! `momentum-flux`: shell mass brought to rest on the strings.

use super::Effect;
use crate::impact::card::{Bases, EffectCard, EffectKind, ParameterCard};
use crate::impact::real::Real;
use crate::impact::rigid::{Contact, Laws};
use crate::impact::viscoelastic;

pub(super) static CARD: EffectCard = EffectCard {
    name: "momentum-flux",
    kind: EffectKind::Physics,
    physics: "While the ball flattens, parts of its shell are stopped by the strings one after the other and their energy is lost. The \
              lost share grows with the compression, so with speed.",
    equation: "e'^2 = e^2 - share (v_n / 30 m/s)^0.52",
    parameters: &[ParameterCard::strength("share", "", "share of the normal energy lost at 30 m/s beyond the base", 0.05, (-0.3, 0.8), 0.05).one_way()],
    source: "thesis 2.7.3, eq 2.33 (compression only); 15 % of the energy at 7 m/s and 32 % at 30 m/s on a rigid wall",
    signature: "Rebound speed lower, slightly more so at high speed, alike over the whole face; nothing tangential.",
    confused_with: &["ball-damping", "string-damping", "string-stiffening", "ball-stiffening"],
    separated_by: "the early part of the force-time curve; low- and high-speed rebound from a rigid wall",
    check_first: None,
    bases: Bases { rigid: "as given", viscoelastic: "the momentum-flux force c_M of the base multiplied by 1 + share / 0.15" },
    effect: &MomentumFlux,
};

/// m/s.
const REFERENCE_SPEED: f64 = 30.0;
/// ln(0.32/0.15) / ln(30/7): how the share grows from 7 to 30 m/s.
const SPEED_POWER: f64 = 0.52;

/// Share of the energy that the visco-elastic base's own momentum flux takes.
const SHARE_OF_BASE: f64 = 0.15;

#[derive(Debug)]
struct MomentumFlux;

impl<T: Real> Effect<T> for MomentumFlux {
    fn change_laws(&self, p: &[T], at: &Contact<T>, laws: &mut Laws<T>) {
        let left = laws.restitution * laws.restitution - p[0] * (at.approach_speed / REFERENCE_SPEED).powf(T::constant(SPEED_POWER));
        if !p[0].is_zero() {
            laws.restitution = left.max(T::zero()).sqrt();
        }
    }

    fn change_viscoelastic(&self, p: &[T], _: &Contact<T>, laws: &mut viscoelastic::Laws<T>) {
        laws.flux *= p[0] / SHARE_OF_BASE + 1.0;
    }
}
