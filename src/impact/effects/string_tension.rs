//! `string-tension`: the strings are not as tight as stated.

use super::Effect;
use crate::impact::card::{Bases, EffectCard, EffectKind, ParameterCard};
use crate::impact::real::Real;
use crate::impact::rigid::{Contact, Laws};
use crate::impact::viscoelastic;

pub(super) static CARD: EffectCard = EffectCard {
    name: "string-tension",
    kind: EffectKind::Physics,
    physics: "Strings lose about 30 % of their tension on stringing and creep afterwards. A softer stringbed stores more of the energy \
              and returns nearly all of it, so the ball leaves faster.",
    equation: "e = e_0 - 0.0013 excess_lb (30 m/s / v_n)^0.2",
    parameters: &[ParameterCard::strength("excess_lb", "lb", "true tension minus the one in racket.toml", -5.0, (-60.0, 60.0), 5.0)],
    source: "Cross and Bower (tension loss); visco-elastic model: +0.013 in the apparent restitution at 40 lb against 60, -0.008 at 70",
    signature: "All rebounds faster (or slower) by nearly the same share, slightly less at high speed; longer (shorter) contact; no \
                dependence on position.",
    confused_with: &["string-damping", "ball-damping", "scale-error", "ball-wear"],
    separated_by: "contact time; a static push on the stringbed",
    check_first: None,
    bases: Bases {
        rigid: "as given; nearly the restitution itself, so seen only through its weak dependence on speed",
        viscoelastic: "stringbed stiffness kS0 + 600 N/m per lb",
    },
    effect: &StringTension,
};

/// Fall of the restitution per lb: 0.021 in the apparent restitution over 30 lb, times 1 + m/m_e.
const PER_LB: f64 = 0.0013;
/// m/s.
const REFERENCE_SPEED: f64 = 30.0;

#[derive(Debug)]
struct StringTension;

impl<T: Real> Effect<T> for StringTension {
    fn change_laws(&self, p: &[T], at: &Contact<T>, laws: &mut Laws<T>) {
        laws.restitution -= p[0] * PER_LB * (T::constant(REFERENCE_SPEED) / at.approach_speed).powf(T::constant(0.2));
    }

    fn change_viscoelastic(&self, p: &[T], _: &Contact<T>, laws: &mut viscoelastic::Laws<T>) {
        laws.k_s0 += p[0] * viscoelastic::STIFFNESS_PER_LB;
    }
}
