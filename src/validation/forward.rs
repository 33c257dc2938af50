//! What the statistics need of a model: free parameters in, predictions out. Nothing else of it is known here.

use super::error::ValidationError;
use crate::impact_table::{INPUTS, OUTPUTS};

/// The inputs of one impact in the order of [`INPUTS`], SI, racket-local.
pub type Inputs = [f64; INPUTS.len()];
/// The outputs of one impact in the order of [`OUTPUTS`]; NaN where the model has none (contact time of a rigid base).
pub type Outputs = [f64; OUTPUTS.len()];

/// A parameter the fit may move.
#[derive(Debug, Clone, PartialEq)]
pub struct FreeParameter {
    pub name: String,
    pub value: f64,
    pub min: f64,
    pub max: f64,
    /// Size of a typical change: sets the step of numerical derivatives.
    pub typical: f64,
    /// Normal prior (mean, sd); `None` for a flat one.
    pub prior: Option<(f64, f64)>,
}

/// A family of models over its free parameters.
pub trait Forward: Sync {
    /// The free parameters, in a fixed order, with their starting values.
    fn parameters(&self) -> &[FreeParameter];

    /// The model with these values, made ready once for all impacts.
    fn prepare(&self, values: &[f64]) -> Result<Box<dyn Prediction + '_>, ValidationError>;

    /// Whether one prediction costs so much that input derivatives should be reused between steps (time stepping).
    fn costly(&self) -> bool {
        false
    }
}

/// A model with all its parameters set.
pub trait Prediction: Sync {
    /// Predicts one impact; `gear` is the index of its (racket, ball) pair, `order` its place in time (0 first).
    /// `None` when the model has no answer (the ball does not approach).
    fn predict(&self, gear: usize, order: f64, inputs: &Inputs) -> Option<Outputs>;
}
