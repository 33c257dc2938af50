//! `camera-skew`: one camera's clock lags the other's.

use super::Effect;
use crate::impact::body::Body;
use crate::impact::card::{Bases, EffectCard, EffectKind, ParameterCard};
use crate::impact::input::ImpactInput;
use crate::impact::real::Real;
use nalgebra::Vector2;

pub(super) static CARD: EffectCard = EffectCard {
    name: "camera-skew",
    kind: EffectKind::Measurement,
    physics: "With the second camera late by a fraction of a frame, a moving point is triangulated off its place in proportion to its \
              velocity. Speeds survive, but impact position and instant move with the ball's velocity.",
    equation: "position_measured = position_true + skew_s (u_t / 2 + u_z (gain_x, gain_y)), u: ball relative to the strings",
    parameters: &[
        ParameterCard::strength("skew_s", "s", "lag of one camera", 1e-4, (-0.01, 0.01), 1e-4),
        ParameterCard::shape("gain_x", "", "how depth shows as x: half the cotangent of the cameras' angle times the view's direction", 0.0, (-5.0, 5.0), 0.5),
        ParameterCard::shape("gain_y", "", "the same for y", 0.0, (-5.0, 5.0), 0.5),
    ],
    source: "geometry of two views; 3.3 mm at 33 m/s and 0.1 ms",
    signature: "Impact position off in proportion to the ball's tangential velocity relative to the face.",
    confused_with: &["face-plane-offset", "ball-centre-bias", "finite-contact"],
    separated_by: "epipolar residual against image speed; a free flight that crosses",
    check_first: Some(
        "a lag longer than a frame is no camera's: then it is the point of contact that moves over the strings while they hold the ball (finite-contact), or the face's plane",
    ),
    bases: Bases { rigid: "acts on the observation", viscoelastic: "acts on the observation" },
    effect: &CameraSkew,
};

#[derive(Debug)]
struct CameraSkew;

impl<T: Real> Effect<T> for CameraSkew {
    fn true_input(&self, p: &[T], body: &Body<T>, input: &mut ImpactInput<T>) {
        let u = body.reported_approach(input);
        input.position -= (u.xy() * T::constant(0.5) + Vector2::new(p[1], p[2]) * u.z) * p[0];
    }
}
