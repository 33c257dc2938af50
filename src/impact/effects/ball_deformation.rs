//! `ball-deformation`: a squeezed ball has a shorter arm and a smaller inertia.

use super::Effect;
use crate::impact::card::{Bases, EffectCard, EffectKind, ParameterCard};
use crate::impact::real::Real;
use crate::impact::rigid::{Contact, Laws};
use crate::impact::viscoelastic;

pub(super) static CARD: EffectCard = EffectCard {
    name: "ball-deformation",
    kind: EffectKind::Physics,
    physics: "While the ball is flattened its surface is nearer to its centre, so friction has a shorter arm. Its moment of inertia \
              falls as well, by about 5 % at 10 mm.",
    equation: "arm = r - lambda (pi/4) x_c, I_B' = I_B (1 - kappa (pi/4) x_c), x_c = 17.5 mm (v_n / 20 m/s)^0.7",
    parameters: &[
        ParameterCard::strength("arm_share", "", "lambda: share of the compression by which the arm shortens", 0.5, (-1.0, 1.0), 0.5).one_way(),
        ParameterCard::strength("inertia_per_m", "1/m", "kappa: relative fall of the inertia per metre of compression", 5.0, (-20.0, 20.0), 5.0).one_way(),
    ],
    source: "Brody (thesis eq 2.22, sign put right); Haake 2005; thesis 2.7.2 (5 % at 10 mm)",
    signature: "Spin change per change of tangential velocity falls as the approach speed rises; tangential velocity and spin of impacts \
                that stick change with it.",
    confused_with: &["offset-normal-force", "lateral-strings"],
    separated_by: "effective arm against approach speed; its limit at low speed gives the ball's inertia",
    check_first: Some(
        "spins that are all read too large or too small by one factor, and an inertia_factor in ball.toml that is not the ball's, look much like it",
    ),
    bases: Bases { rigid: "impulse-weighted mean of the arm and inertia", viscoelastic: "lambda_r and kappa_I of the base plus these" },
    effect: &BallDeformation,
};

/// Peak compression of the ball on a free racket at the reference speed (visco-elastic model), m.
const COMPRESSION: f64 = 17.5e-3;
/// m/s.
const REFERENCE_SPEED: f64 = 20.0;
/// How the peak compression grows with speed in the visco-elastic model between 10 and 40 m/s.
const SPEED_POWER: f64 = 0.7;
/// Mean of a half-sine compression weighted with a half-sine force.
const MEAN_SHARE: f64 = std::f64::consts::FRAC_PI_4;
/// No ball is squeezed beyond this share of its radius.
const MOST: f64 = 0.8;

#[derive(Debug)]
struct BallDeformation;

impl<T: Real> Effect<T> for BallDeformation {
    fn change_laws(&self, p: &[T], at: &Contact<T>, laws: &mut Laws<T>) {
        let x = (at.approach_speed / REFERENCE_SPEED).powf(T::constant(SPEED_POWER)) * (MEAN_SHARE * COMPRESSION);
        laws.ball_arm -= (p[0] * x).min(laws.ball_arm * MOST);
        laws.ball_inertia *= -(p[1] * x).min(T::constant(MOST)) + 1.0;
    }

    fn change_viscoelastic(&self, p: &[T], _: &Contact<T>, laws: &mut viscoelastic::Laws<T>) {
        laws.lambda_r += p[0];
        laws.kappa_i += p[1];
    }
}
