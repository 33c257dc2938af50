//! `offset-normal-force`: the pressure's centre is not below the ball's centre.

use super::Effect;
use crate::impact::card::{Bases, EffectCard, EffectKind, ParameterCard};
use crate::impact::real::Real;
use crate::impact::rigid::{Contact, Laws};
use crate::impact::viscoelastic;

pub(super) static CARD: EffectCard = EffectCard {
    name: "offset-normal-force",
    kind: EffectKind::Physics,
    physics: "On a sliding or gripping ball the pressure centre lies a millimetre or two behind (or ahead of) the ball's centre, seen \
              along the slip. The normal force then has a moment that changes the spin.",
    equation: "L_B += o x J_n n, o = -offset u_t/√(|u_t|² + (0.5 m/s)²); the reverse on the racket",
    parameters: &[ParameterCard::strength("offset_m", "m", "behind the centre, against the slip", 0.0015, (-0.02, 0.02), 0.0015)],
    source: "Cross 2002 (to 3 mm behind on sandpaper); Goodwill and Haake FE (1.6 mm behind); Haake 2005 (0.5 mm ahead)",
    signature: "Spin and tangential velocity change in proportion to the normal impulse, with the sign of the slip and, above 1 m/s, whatever its \
                size; the spin-to-velocity ratio rises with J_n/J_t.",
    confused_with: &["ball-deformation", "lateral-strings", "friction-law"],
    separated_by: "effective arm against J_n/J_t: the slope is the offset, the intercept the arm",
    check_first: None,
    bases: Bases {
        rigid: "as given",
        viscoelastic: "as given, with the momentary slip direction; Haake's own law is `normal_force = \"haake\"` in [parameters]",
    },
    effect: &OffsetNormalForce,
};

/// m/s.
const SOFT_SLIP: f64 = 0.5;

#[derive(Debug)]
struct OffsetNormalForce;

impl<T: Real> Effect<T> for OffsetNormalForce {
    fn change_laws(&self, p: &[T], at: &Contact<T>, laws: &mut Laws<T>) {
        // Without slip there is no direction; the offset grows in over half a metre per second of it.
        let slip = at.slip_speed();
        laws.normal_offset += p[0] * slip / (slip * slip + SOFT_SLIP * SOFT_SLIP).sqrt();
    }

    fn change_viscoelastic(&self, p: &[T], _: &Contact<T>, laws: &mut viscoelastic::Laws<T>) {
        laws.normal_offset += p[0];
    }
}
