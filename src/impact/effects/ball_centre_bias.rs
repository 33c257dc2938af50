//! `ball-centre-bias`: the ball's centre is seen off its place.

use super::Effect;
use crate::impact::body::Body;
use crate::impact::card::{Bases, EffectCard, EffectKind, ParameterCard};
use crate::impact::input::ImpactInput;
use crate::impact::real::Real;

pub(super) static CARD: EffectCard = EffectCard {
    name: "ball-centre-bias",
    kind: EffectKind::Measurement,
    physics: "A ball lit from one side is found up to some millimetres toward the light. Its velocity is right, but every impact \
              position is off by the same vector.",
    equation: "position_measured = position_true + (x_m, y_m)",
    parameters: &[
        ParameterCard::strength("x_m", "m", "along the racket", 0.0, (-0.05, 0.05), 0.002),
        ParameterCard::strength("y_m", "m", "across the face", 0.0, (-0.05, 0.05), 0.002),
    ],
    source: "thesis chapter 4 (circle fit)",
    signature: "The axis of symmetry of the rebound over y is not at y = 0; twist and rebound off axis depart oddly in y.",
    confused_with: &["face-plane-offset", "camera-skew", "scale-error"],
    separated_by: "opposite lighting; symmetry of the restitution in y",
    check_first: None,
    bases: Bases { rigid: "acts on the observation", viscoelastic: "acts on the observation" },
    effect: &BallCentreBias,
};

#[derive(Debug)]
struct BallCentreBias;

impl<T: Real> Effect<T> for BallCentreBias {
    fn true_input(&self, p: &[T], _: &Body<T>, input: &mut ImpactInput<T>) {
        input.position.x -= p[0];
        input.position.y -= p[1];
    }
}
