//! `scale-error`: the calibration's square was not the size it was said to be.

use super::Effect;
use crate::impact::body::Body;
use crate::impact::card::{Bases, EffectCard, EffectKind, ParameterCard};
use crate::impact::input::{ImpactInput, ImpactOutput};
use crate::impact::real::Real;

pub(super) static CARD: EffectCard = EffectCard {
    name: "scale-error",
    kind: EffectKind::Measurement,
    physics: "If the checkerboard's squares are not the stated size, every measured length is off by the same factor. Velocities and impact positions \
              scale, angular velocities and spins do not.",
    equation: "x_measured = (1 + scale) x_true for every length and velocity",
    parameters: &[ParameterCard::strength("scale", "", "relative error of lengths", 0.005, (-0.2, 0.2), 0.005)],
    source: "thesis chapter 3 (square size off by 0.8 to 1 %)",
    signature: "Residuals of the velocities in proportion to speed while spins agree; the ratio of spin change to velocity change is off by -scale.",
    confused_with: &["time-base-error", "ball-centre-bias", "racket-inertia", "string-tension", "string-damping", "air-flight"],
    separated_by: "known distances between markers, the ball's diameter, gravity in free flight",
    check_first: None,
    bases: Bases { rigid: "acts on the observation", viscoelastic: "acts on the observation" },
    effect: &ScaleError,
};

#[derive(Debug)]
struct ScaleError;

impl<T: Real> Effect<T> for ScaleError {
    fn true_input(&self, p: &[T], _: &Body<T>, input: &mut ImpactInput<T>) {
        let factor = (p[0] + 1.0).recip();
        input.ball_velocity *= factor;
        input.racket_velocity *= factor;
        input.position *= factor;
    }

    fn observed_output(&self, p: &[T], _: &Body<T>, _: &ImpactInput<T>, output: &mut ImpactOutput<T>) {
        let factor = p[0] + 1.0;
        output.ball_velocity *= factor;
        output.racket_velocity *= factor;
    }
}
