//! `friction-law`: friction that is not Coulomb's.

use super::Effect;
use crate::impact::card::{Bases, EffectCard, EffectKind, ParameterCard};
use crate::impact::real::Real;
use crate::impact::rigid::{Contact, Laws};
use crate::impact::viscoelastic;

pub(super) static CARD: EffectCard = EffectCard {
    name: "friction-law",
    kind: EffectKind::Physics,
    physics: "Felt on strings does not obey Coulomb: the coefficient depends on the load and on the sliding speed. Both change how hard \
              a ball that slides is held back.",
    equation: "mu = mu_0 (1 + v_s^2 / 25)^(slip_exponent/2) / (1 + 15^2/25)^(slip_exponent/2) x (v_n / 25)^load_exponent",
    parameters: &[
        ParameterCard::strength("slip_exponent", "", "power of the slip speed at first touch", -0.3, (-3.0, 3.0), 0.2),
        ParameterCard::strength("load_exponent", "", "power of the approach speed, which sets the load", 0.0, (-3.0, 3.0), 0.2),
    ],
    source: "Ashcroft and Stronge (0.45 to 0.54 up to 400 N); thesis 2.7.1 (0.11 to 0.42 at lighter load)",
    signature: "Visible only where the ball slides throughout (shallow incidence, heavy backspin): tangential velocity and spin depart together, \
                more or less as the slip or approach speed grows.",
    confused_with: &["lateral-strings", "offset-normal-force"],
    separated_by: "incidence swept to 50-70 degrees from the normal at two speeds",
    check_first: None,
    bases: Bases { rigid: "as given", viscoelastic: "as given, with slip and approach speed at first touch" },
    effect: &FrictionLaw,
};

/// Slip speed below which the coefficient hardly changes, m/s, and the slip and approach speed at which it keeps mu_0.
const SOFT_SLIP: f64 = 5.0;
const REFERENCE_SLIP: f64 = 15.0;
const REFERENCE_APPROACH: f64 = 25.0;

fn factor<T: Real>(p: &[T], at: &Contact<T>) -> T {
    let level = |v: T| (v / SOFT_SLIP).powi(2) + 1.0;
    (level(at.slip_speed()) / level(T::constant(REFERENCE_SLIP))).powf(p[0] * 0.5) * (at.approach_speed / REFERENCE_APPROACH).powf(p[1])
}

#[derive(Debug)]
struct FrictionLaw;

impl<T: Real> Effect<T> for FrictionLaw {
    fn change_laws(&self, p: &[T], at: &Contact<T>, laws: &mut Laws<T>) {
        laws.friction *= factor(p, at);
    }

    fn change_viscoelastic(&self, p: &[T], at: &Contact<T>, laws: &mut viscoelastic::Laws<T>) {
        laws.mu *= factor(p, at);
    }
}
