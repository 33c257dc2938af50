//! Derivatives of the outcome by inputs and parameters, and the uncertainty that inputs carry into a prediction.
//!
//! They are exact in both bases and with every effect: the model is computed once more in dual numbers (observation, bodies,
//! laws, impulse or contact, outcome), [`TOGETHER`] directions at a time. At a kink the derivative is that of the branch taken.
//! Where the impact stands on the edge between sticking and sliding that edge is named; where a parameter's smallest change adds a
//! part to the contact there is no derivative: that is named too, and the mean slope over a small step to both sides given instead.

#[cfg(test)]
mod differences;

use super::body::Body;
use super::dual::{TOGETHER, Tangent};
use super::error::ModelError;
use super::input::{ImpactInput, ImpactOutput};
use super::model::{Base, Model};
use super::prepared_model::{PreparedModel, add_beam};
use crate::equipment::{Ball, Racket};
use crate::impact_table::{INPUTS, OUTPUTS};
use std::sync::Arc;

/// Outputs of one impact as numbers, in the order of [`OUTPUTS`]; a contact time that the base does not have is 0.
pub type Column = [f64; OUTPUTS.len()];

/// Typical sizes of the inputs, from which steps are taken: m/s, rad/s, m, N m.
const INPUT_SCALE: [f64; INPUTS.len()] = [10.0, 10.0, 10.0, 100.0, 100.0, 100.0, 10.0, 10.0, 10.0, 10.0, 10.0, 10.0, 0.05, 0.05, 5.0];
/// An edge within this share of an input's or parameter's typical size counts as reached.
const AT_EDGE: f64 = 2e-6;
/// Share of a parameter's typical size by which it is moved to see whether the visco-elastic contact keeps its parts, and over
/// which a mean slope is taken where it does not.
const NEIGHBOUR: f64 = 1e-3;

/// Derivatives at one impact.
#[derive(Debug, Clone, PartialEq)]
pub struct Sensitivities {
    pub output: ImpactOutput,
    /// One row per column of [`INPUTS`].
    pub by_input: Vec<Column>,
    /// One row per parameter, in the order of [`Model::parameters`].
    pub by_parameter: Vec<Column>,
    /// Inputs and parameters across which the outcome has an edge here. Between sticking and sliding their rows hold the derivative
    /// of the side taken; where a part of the contact appears, the mean slope over a thousandth of a typical size to both sides.
    pub edges: Vec<String>,
}

impl Sensitivities {
    /// Standard deviations of the outputs from independent ones of the inputs, to first order.
    pub fn output_sd(&self, input_sd: &[f64; INPUTS.len()]) -> Column {
        std::array::from_fn(|k| self.by_input.iter().zip(input_sd).map(|(row, sd)| (row[k] * sd).powi(2)).sum::<f64>().sqrt())
    }
}

/// A model made ready for derivatives on one racket and ball.
#[derive(Debug, Clone)]
pub struct SensitivityModel {
    centre: PreparedModel,
    model: Arc<Model>,
    body: Body,
    /// One per [`TOGETHER`] directions: the inputs, then the parameters.
    passes: Vec<PreparedModel<Tangent>>,
    /// Per parameter the visco-elastic model with a little more and a little less of it, where there is one.
    neighbours: Vec<Vec<PreparedModel>>,
}

/// A number that varies in direction `n`, when that is one of pass `pass`.
fn varied(value: f64, n: usize, pass: usize) -> Tangent {
    match n.checked_sub(pass * TOGETHER) {
        Some(k) if k < TOGETHER => Tangent::variable(value, k),
        _ => Tangent::constant(value),
    }
}

/// An outcome in dual numbers, pass by pass, with the friction that was to spare where that matters.
type Varied = (ImpactOutput<Tangent>, Tangent);

impl SensitivityModel {
    /// # Errors
    /// As [`Model::prepare`].
    pub fn new(model: &Model, racket: &Racket, ball: &Ball) -> Result<Self, ModelError> {
        let (model, body) = (Arc::new(model.clone()), Body::new(racket, ball)?);
        let mut unchanged = body.clone();
        add_beam(&model, &mut unchanged)?;
        let values = model.values();
        let prepare = |pass: usize| {
            let values = values.iter().enumerate().map(|(i, v)| varied(*v, INPUTS.len() + i, pass)).collect();
            PreparedModel::with_values(Arc::clone(&model), values, Body::of(&unchanged))
        };
        let passes = (0..(INPUTS.len() + values.len()).div_ceil(TOGETHER)).map(prepare).collect::<Result<_, _>>()?;
        let centre = PreparedModel::with_values(Arc::clone(&model), values.clone(), unchanged.clone())?;
        let neighbours = model.parameters().iter().enumerate().map(|(i, p)| {
            let moved = |by: f64| {
                let mut values = values.clone();
                values[i] += by * p.typical;
                PreparedModel::with_values(Arc::clone(&model), values, unchanged.clone()).ok()
            };
            if model.base() == Base::Viscoelastic { [-NEIGHBOUR, NEIGHBOUR].into_iter().filter_map(moved).collect() } else { Vec::new() }
        });
        Ok(SensitivityModel { centre, body, passes, neighbours: neighbours.collect(), model })
    }

    /// Derivatives at one impact.
    ///
    /// # Errors
    /// As [`PreparedModel::predict`].
    pub fn at(&self, input: &ImpactInput) -> Result<Sensitivities, ModelError> {
        let columns = input.as_columns();
        let inputs: Vec<_> = (0..self.passes.len()).map(|pass| input.with_columns(&std::array::from_fn(|j| varied(columns[j], j, pass)))).collect();
        let (output, outcomes) = match self.model.base() {
            Base::Rigid => (self.centre.predict(input)?, self.through_impulse(&inputs)?),
            Base::Viscoelastic => self.through_contact(input, &inputs)?,
        };
        let appears = self.parts_appear(input);
        let mut edges = Vec::new();
        let mut rows = Vec::with_capacity(INPUTS.len() + self.neighbours.len());
        for n in 0..INPUTS.len() + self.neighbours.len() {
            let (outcome, spare) = &outcomes[n / TOGETHER];
            let row: Column = outcome.as_columns().map(|c| c.map_or(0.0, |d| d.slope[n % TOGETHER]));
            let at_edge = spare.value.abs() < AT_EDGE * self.scale(n) * spare.slope[n % TOGETHER].abs();
            let none = appears.contains(&n) || !row.iter().all(|d| d.is_finite());
            if at_edge || none {
                edges.push(self.name(n).to_owned());
            }
            rows.push(if none { self.mean_slope(input, n, NEIGHBOUR * self.scale(n))? } else { row });
        }
        let by_parameter = rows.split_off(INPUTS.len());
        Ok(Sensitivities { output, by_input: rows, by_parameter, edges })
    }

    fn through_impulse(&self, inputs: &[ImpactInput<Tangent>]) -> Result<Vec<Varied>, ModelError> {
        self.passes.iter().zip(inputs).map(|(pass, input)| pass.predict_rigid(input)).collect()
    }

    /// The steps of the plain contact once more in dual numbers, with the start and laws that the passes give it.
    fn through_contact(&self, input: &ImpactInput, inputs: &[ImpactInput<Tangent>]) -> Result<(ImpactOutput, Vec<Varied>), ModelError> {
        let centre = self.centre.stage(input)?;
        let stages = self.passes.iter().zip(inputs).map(|(pass, input)| pass.stage(input)).collect::<Result<Vec<_>, _>>()?;
        let (ended, contacts) = self.centre.differentiate(&centre, &stages)?;
        let never = Tangent::constant(f64::INFINITY);
        let conclude = |((pass, stage), contact): ((&PreparedModel<Tangent>, _), _)| Ok((pass.conclude(stage, contact)?, never));
        let outcomes = self.passes.iter().zip(&stages).zip(contacts).map(conclude).collect::<Result<_, ModelError>>()?;
        Ok((self.centre.conclude(&centre, ended)?, outcomes))
    }

    /// Directions in which a smallest change adds a part to the visco-elastic contact or takes one away: sideways springs, modes.
    fn parts_appear(&self, input: &ImpactInput) -> Vec<usize> {
        if self.model.base() == Base::Rigid {
            return Vec::new();
        }
        let Ok(centre) = self.centre.stage(input) else { return Vec::new() };
        let differs = |model: &PreparedModel| model.stage(input).is_ok_and(|s| !s.laws.has_parts_of(&centre.laws));
        (0..self.neighbours.len()).filter(|i| self.neighbours[*i].iter().any(differs)).map(|i| INPUTS.len() + i).collect()
    }

    /// Name of direction `n`.
    fn name(&self, n: usize) -> &str {
        n.checked_sub(INPUTS.len()).map_or_else(|| INPUTS[n], |i| self.model.parameters()[i].name.as_str())
    }

    /// Typical size of direction `n`.
    fn scale(&self, n: usize) -> f64 {
        n.checked_sub(INPUTS.len()).map_or_else(|| INPUT_SCALE[n], |i| self.model.parameters()[i].typical)
    }

    /// Mean slope over a step to either side in direction `n`.
    fn mean_slope(&self, input: &ImpactInput, n: usize, step: f64) -> Result<Column, ModelError> {
        let (up, down) = (self.moved(input, n, step)?, self.moved(input, n, -step)?);
        Ok(std::array::from_fn(|k| (up[k] - down[k]) / (2.0 * step)))
    }

    /// The outcome with direction `n` moved.
    fn moved(&self, input: &ImpactInput, n: usize, by: f64) -> Result<Column, ModelError> {
        let output = match n.checked_sub(INPUTS.len()) {
            None => {
                let mut columns = input.as_columns();
                columns[n] += by;
                self.centre.predict(&input.with_columns(&columns))?
            }
            Some(i) => {
                let mut model = Model::clone(&self.model);
                model.set_at(i, self.model.parameters()[i].value + by)?;
                PreparedModel::new(model, self.body.clone())?.predict(input)?
            }
        };
        Ok(output.as_columns().map(|c| c.unwrap_or(0.0)))
    }
}

#[cfg(test)]
mod tests;
