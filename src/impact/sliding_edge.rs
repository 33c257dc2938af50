//! The edge of sliding, where a rigid contact's outcome jumps and nature's does not.
//!
//! A contact that needs less friction than Coulomb's limit sticks, one that needs more slides along its first slip. The two do not meet
//! at the limit: the impulse that stops the ball in both directions points elsewhere than the first slip, by an angle α of some hundredths
//! of a radian that the racket's levers make, so that a hair's breadth of friction moves a ball by 0.1 to 0.4 m/s and 10 rad/s. A contact
//! that lasts slides along its first slip until that is used up; what friction is then left turns the impulse toward that of sticking.
//! To turn it all the way takes the share α of all friction: with a share d < α to spare the ball ends (1 − d/α) of the jump short of it.

use super::error::ModelError;
use super::input::{ImpactInput, ImpactOutput};
use super::model::Base;
use super::prepared_model::PreparedModel;
use super::rigid::Regime;
use crate::impact_table::OUTPUTS;

/// The two impulses never lie farther apart than this, relative.
const WIDEST: f64 = 0.2;
/// Halvings of the interval that holds the edge: to 5e-5 of all friction.
const HALVINGS: usize = 12;

impl PreparedModel {
    /// By how much the outcome of a contact that sticks may fall short of sticking, toward sliding, in the order of [`OUTPUTS`]; `None`
    /// for a contact that slides or has friction enough to spare, and in a visco-elastic base, whose own springs end the slip.
    ///
    /// # Errors
    /// As [`PreparedModel::predict`].
    pub fn short_of_sticking(&self, input: &ImpactInput) -> Result<Option<[f64; OUTPUTS.len()]>, ModelError> {
        if self.model().base() != Base::Rigid {
            return Ok(None);
        }
        let with = |grip: f64| self.predict_gripping(input, grip).map(|(output, regime, _)| (output, regime));
        let (here, regime) = with(1.0)?;
        if regime == Regime::Slide {
            return Ok(None);
        }
        let (mut sliding, least) = with(1.0 - WIDEST)?;
        if least == Regime::Stick {
            return Ok(None);
        }
        let (mut slides, mut sticks) = (1.0 - WIDEST, 1.0);
        for _ in 0..HALVINGS {
            let middle = 0.5 * (slides + sticks);
            match with(middle)? {
                (_, Regime::Stick) => sticks = middle,
                (output, Regime::Slide) => (slides, sliding) = (middle, output),
            }
        }
        let jump = sliding.ball_velocity - here.ball_velocity;
        let along = sliding.ball_velocity - input.ball_velocity;
        let angle = jump.xy().norm() / along.xy().norm().max(f64::MIN_POSITIVE);
        let short = 1.0 - (1.0 - slides) / angle;
        if !(short > 0.0) {
            return Ok(None);
        }
        let columns = |o: &ImpactOutput| o.as_columns().map(|c| c.unwrap_or(0.0));
        let (slid, stuck) = (columns(&sliding), columns(&here));
        Ok(Some(std::array::from_fn(|k| short * (slid[k] - stuck[k]))))
    }
}

#[cfg(test)]
mod tests {
    use crate::impact::rigid::tests::{reference_equipment, reference_input};
    use crate::impact::{Base, ImpactInput, Model};
    use nalgebra::Vector3;

    /// A ball off both axes that needs a friction f to stick: by hand, from the outcomes just below and above f.
    #[test]
    fn truth_what_falls_short_shrinks_from_the_whole_jump_to_nothing() {
        let (racket, ball) = reference_equipment();
        let input = ImpactInput { ball_velocity: Vector3::new(6.0, -9.0, -20.0), position: nalgebra::Vector2::new(-0.08, 0.05), ..reference_input() };
        let with = |friction: f64| {
            let mut model = Model::new(Base::Rigid);
            model.set("friction", friction).expect("allowed");
            model.prepare(&racket, &ball).expect("valid")
        };
        let out = |friction: f64| with(friction).predict(&input).expect("contact").ball_velocity;
        // Sliding, the ball's velocity along the face goes with friction; sticking, it does not.
        let (mut slides, mut sticks) = (0.01, 1.4);
        while sticks - slides > 1e-8 {
            let f = 0.5 * (slides + sticks);
            if (out(f + 1e-6) - out(f)).norm() > 1e-9 { slides = f } else { sticks = f }
        }
        let jump = out(slides - 1e-6) - out(sticks + 1e-6);
        let angle = jump.norm() / (out(slides - 1e-6) - input.ball_velocity).xy().norm();
        assert!(angle > 2e-3, "the two ways meet: {jump}");
        for share in [0.05, 0.5, 0.9] {
            let short = with(sticks * (1.0 + share * angle)).short_of_sticking(&input).expect("contact").expect("near the edge");
            for k in 0..3 {
                let expected = (1.0 - share) * jump[k];
                assert!((short[k] - expected).abs() < 0.02 * jump.norm() + 1e-3, "{share}, {k}: {} against {expected}", short[k]);
            }
        }
        for friction in [0.99 * slides, sticks * (1.0 + 1.2 * angle)] {
            assert!(with(friction).short_of_sticking(&input).expect("contact").is_none());
        }
    }
}
