//! `time-base-error`: the camera's clock ran fast or slow.

use super::Effect;
use crate::impact::body::Body;
use crate::impact::card::{Bases, EffectCard, EffectKind, ParameterCard};
use crate::impact::input::{ImpactInput, ImpactOutput};
use crate::impact::real::Real;

pub(super) static CARD: EffectCard = EffectCard {
    name: "time-base-error",
    kind: EffectKind::Measurement,
    physics: "If the true frame rate differs from the stated one, every velocity and every rate is off by the same factor. Positions \
              are not.",
    equation: "v_measured = (1 + rate) v_true for velocities, angular velocities and spins; times the reverse",
    parameters: &[ParameterCard::strength("rate", "", "relative error of the frame rate", 0.005, (-0.2, 0.2), 0.005)],
    source: "elementary; thesis chapter 3",
    signature: "Velocities and spins of the same impact scale together; positions agree, contact times scale inversely.",
    confused_with: &["scale-error", "air-flight"],
    separated_by: "gravity in free flight goes with the square; a flashing light of known rate",
    check_first: None,
    bases: Bases {
        rigid: "acts on the observation; the impulse laws have no time scale, so a table in base rigid shows it only through speed-dependent effects",
        viscoelastic: "acts on the observation",
    },
    effect: &TimeBaseError,
};

#[derive(Debug)]
struct TimeBaseError;

impl<T: Real> Effect<T> for TimeBaseError {
    fn true_input(&self, p: &[T], _: &Body<T>, input: &mut ImpactInput<T>) {
        let factor = (p[0] + 1.0).recip();
        input.ball_velocity *= factor;
        input.ball_spin *= factor;
        input.racket_velocity *= factor;
        input.racket_rate *= factor;
    }

    fn observed_output(&self, p: &[T], _: &Body<T>, _: &ImpactInput<T>, output: &mut ImpactOutput<T>) {
        let factor = p[0] + 1.0;
        output.ball_velocity *= factor;
        output.ball_spin *= factor;
        output.racket_velocity *= factor;
        output.racket_rate *= factor;
        output.contact_time = output.contact_time.map(|t| t / factor);
    }
}
