//! `ball-damping`: restitution falls with approach speed.

use super::Effect;
use crate::impact::card::{Bases, EffectCard, EffectKind, ParameterCard};
use crate::impact::real::Real;
use crate::impact::rigid::{Contact, Laws};
use crate::impact::viscoelastic;

pub(super) static CARD: EffectCard = EffectCard {
    name: "ball-damping",
    kind: EffectKind::Physics,
    physics: "Rubber and felt lose more energy the more they are deformed. So the restitution falls with the approach speed, \
              everywhere on the face alike.",
    equation: "e = e_0 - fall ((v_n / 25 m/s)^exponent - 1)",
    parameters: &[
        ParameterCard::strength("fall", "", "fall of the restitution per unit of (v_n/25)^exponent", 0.13, (-0.5, 2.0), 0.1).one_way(),
        ParameterCard::shape("exponent", "", "power of the approach speed; 0.5 fits the visco-elastic model", 0.5, (0.1, 3.0), 0.5),
    ],
    source: "Miller and Messner 2003 (0.575 at 20 m/s, 0.40 at 45 m/s on a rigid wall); visco-elastic model on strings: e = 0.925 - 0.0257 sqrt(v_n)",
    signature: "Rebound speed falls below the model as the approach speed rises; no dependence on position, angle or spin.",
    confused_with: &["string-stiffening", "momentum-flux", "ball-stiffening", "ball-wear", "air-flight", "string-tension", "string-damping"],
    separated_by: "contact time against approach speed; rebound of the same balls from a rigid wall at two speeds",
    check_first: None,
    bases: Bases { rigid: "as given", viscoelastic: "damping c_B multiplied by 1 + fall / 0.13 x (area law)" },
    effect: &BallDamping,
};

/// Speed at which the restitution keeps its base value, m/s.
const REFERENCE_SPEED: f64 = 25.0;

/// Fall at which the visco-elastic base's area damping doubles.
const TYPICAL_FALL: f64 = 0.13;

#[derive(Debug)]
struct BallDamping;

impl<T: Real> Effect<T> for BallDamping {
    fn change_laws(&self, p: &[T], at: &Contact<T>, laws: &mut Laws<T>) {
        laws.restitution -= p[0] * ((at.approach_speed / REFERENCE_SPEED).powf(p[1]) - 1.0);
    }

    fn change_viscoelastic(&self, p: &[T], _: &Contact<T>, laws: &mut viscoelastic::Laws<T>) {
        laws.a_c *= p[0] / TYPICAL_FALL + 1.0;
    }
}
