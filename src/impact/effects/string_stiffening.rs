//! `string-stiffening`: the stringbed stiffens the deeper it is pressed.

use super::Effect;
use crate::impact::card::{Bases, EffectCard, EffectKind, ParameterCard};
use crate::impact::real::Real;
use crate::impact::rigid::{Contact, Laws};
use crate::impact::viscoelastic;

pub(super) static CARD: EffectCard = EffectCard {
    name: "string-stiffening",
    kind: EffectKind::Physics,
    physics: "Deflected strings are stretched, so the bed stiffens with the square of its deflection. At high speed less energy goes \
              into the strings and more into the lossy ball.",
    equation: "e = e_0 - fall (v_n / 30 m/s)^2",
    parameters: &[ParameterCard::strength("fall", "", "fall of the restitution at 30 m/s", 0.02, (-0.3, 0.5), 0.02).one_way()],
    source: "visco-elastic model: without stiffening +0.004, +0.018, +0.037 in the apparent restitution at 15, 30, 45 m/s; string stiffness 26-53 kN/m",
    signature: "Restitution falls with the square of the approach speed, as damping does; contact shortens at high speed; no dependence \
                on position.",
    confused_with: &["ball-damping", "ball-stiffening", "momentum-flux"],
    separated_by: "contact time and deflection against approach speed",
    check_first: None,
    bases: Bases { rigid: "as given", viscoelastic: "stiffening kS2 multiplied by 1 + fall / 0.024" },
    effect: &StringStiffening,
};

/// m/s.
const REFERENCE_SPEED: f64 = 30.0;

/// Fall that the visco-elastic base's own stiffening causes at 30 m/s.
const FALL_OF_BASE: f64 = 0.024;

#[derive(Debug)]
struct StringStiffening;

impl<T: Real> Effect<T> for StringStiffening {
    fn change_laws(&self, p: &[T], at: &Contact<T>, laws: &mut Laws<T>) {
        laws.restitution -= p[0] * (at.approach_speed / REFERENCE_SPEED).powi(2);
    }

    fn change_viscoelastic(&self, p: &[T], _: &Contact<T>, laws: &mut viscoelastic::Laws<T>) {
        laws.k_s2 *= p[0] / FALL_OF_BASE + 1.0;
    }
}
