//! Derivatives of the outcome by inputs and parameters, and the uncertainty that inputs carry into a prediction.
//!
//! The rigid base alone and every visco-elastic contact are differentiated exactly, in dual numbers. In the rigid base with
//! effects central differences at three steps are extrapolated (Romberg); the last correction bounds their error. Where that
//! error does not fall with the step the outcome has an edge there (stick against slide), which is reported instead of a number
//! nobody can trust.

mod rigid;
mod viscoelastic;

use super::body::Body;
use super::error::ModelError;
use super::input::{ImpactInput, ImpactOutput};
use super::model::{Base, Model};
use super::prepared_model::PreparedModel;
use super::rigid::Sliding;
use crate::equipment::{Ball, Racket};
use crate::impact_table::{INPUTS, OUTPUTS};

/// Outputs of one impact as numbers, in the order of [`OUTPUTS`]; a contact time that the base does not have is 0.
pub type Column = [f64; OUTPUTS.len()];

/// Typical sizes of the inputs, from which steps are taken: m/s, rad/s, m, N m.
const INPUT_SCALE: [f64; INPUTS.len()] = [10.0, 10.0, 10.0, 100.0, 100.0, 100.0, 10.0, 10.0, 10.0, 10.0, 10.0, 10.0, 0.05, 0.05, 5.0];
/// First step over typical size; the contact of the visco-elastic base is stepped to 1e-7, so its steps are larger.
const STEP: [f64; 2] = [1e-3, 1e-2];
/// An extrapolated derivative is trusted when its last correction is below this share of the output's typical change.
const TRUST: [f64; 2] = [1e-6, 1e-3];
/// How often a step that straddles an edge is cut to an eighth.
const CUTS: usize = 3;
/// Sizes of the outputs against which errors are judged: m/s, rad/s, s.
const OUTPUT_SCALE: Column = [10.0, 10.0, 10.0, 100.0, 100.0, 100.0, 10.0, 10.0, 10.0, 10.0, 10.0, 10.0, 1e-3];

/// Derivatives at one impact.
#[derive(Debug, Clone, PartialEq)]
pub struct Sensitivities {
    pub output: ImpactOutput,
    /// One row per column of [`INPUTS`].
    pub by_input: Vec<Column>,
    /// One row per parameter, in the order of [`Model::parameters`].
    pub by_parameter: Vec<Column>,
    /// Inputs and parameters across which the outcome has an edge here; their rows hold the mean slope over the edge.
    pub edges: Vec<String>,
    /// Whether all derivatives but those at edges come from dual numbers.
    pub exact: bool,
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
    model: Model,
    body: Body,
    /// Whether the dual numbers describe it: the rigid base alone.
    exact: bool,
}

impl SensitivityModel {
    /// # Errors
    /// As [`Model::prepare`].
    pub fn new(model: &Model, racket: &Racket, ball: &Ball) -> Result<Self, ModelError> {
        let exact = model.base() == Base::Rigid && model.effects().is_empty() && model.sliding() == Sliding::FirstTouch;
        Ok(SensitivityModel { centre: model.prepare(racket, ball)?, model: model.clone(), body: Body::new(racket, ball)?, exact })
    }

    /// Derivatives at one impact.
    ///
    /// # Errors
    /// As [`PreparedModel::predict`].
    pub fn at(&self, input: &ImpactInput) -> Result<Sensitivities, ModelError> {
        if self.exact {
            self.exactly(input)
        } else if self.model.base() == Base::Viscoelastic {
            self.through_contact(input)
        } else {
            self.numerically(input)
        }
    }

    fn exactly(&self, input: &ImpactInput) -> Result<Sensitivities, ModelError> {
        let output = self.centre.predict(input)?;
        let values = self.model.values();
        let duals = rigid::collide(self.centre.body(), input, values[0], values[1])?;
        let row = |direction: usize| -> Column { std::array::from_fn(|k| duals.get(k).map_or(0.0, |d| d.slope[direction])) };
        let mut by_input: Vec<Column> = (0..rigid::RESTITUTION).map(row).collect();
        // The grip's torque acts through an effect only.
        by_input.push([0.0; OUTPUTS.len()]);
        Ok(Sensitivities { output, by_input, by_parameter: vec![row(rigid::RESTITUTION), row(rigid::FRICTION)], edges: Vec::new(), exact: true })
    }

    /// Exact derivatives by racket mass, inertias about x, y, z, local x of the centre of mass, and ball mass.
    ///
    /// # Errors
    /// As [`SensitivityModel::at`]; [`ModelError::NotInBase`] where only the dual numbers know them.
    pub fn by_body(&self, input: &ImpactInput) -> Result<[Column; 6], ModelError> {
        if !self.exact {
            let reason = "bodies are differentiated for the plain rigid base only; `racket-inertia` has them as parameters elsewhere";
            return Err(ModelError::NotInBase { name: "sensitivity by bodies".into(), base: self.model.base().name(), reason });
        }
        let values = self.model.values();
        let duals = rigid::collide(self.centre.body(), input, values[0], values[1])?;
        Ok(std::array::from_fn(|b| std::array::from_fn(|k| duals.get(k).map_or(0.0, |d| d.slope[rigid::BODIES + b]))))
    }

    /// By extrapolated differences, whatever the model.
    ///
    /// # Errors
    /// As [`SensitivityModel::at`].
    pub fn numerically(&self, input: &ImpactInput) -> Result<Sensitivities, ModelError> {
        let output = self.centre.predict(input)?;
        let mut edges = Vec::new();
        let columns = input.as_columns();
        let mut by_input = Vec::with_capacity(INPUTS.len());
        for (j, scale) in INPUT_SCALE.into_iter().enumerate() {
            let moved = |by: f64| {
                let mut c = columns;
                c[j] += by;
                self.centre.predict(&ImpactInput::from_columns(&c, input.order))
            };
            by_input.push(self.slope(scale, INPUTS[j], &mut edges, &moved)?);
        }
        let mut by_parameter = Vec::new();
        for (index, p) in self.model.parameters().iter().enumerate() {
            let moved = |by: f64| {
                let mut model = self.model.clone();
                model.set_at(index, p.value + by)?;
                PreparedModel::new(model, self.body.clone())?.predict(input)
            };
            by_parameter.push(self.slope(p.typical, &p.name, &mut edges, &moved)?);
        }
        Ok(Sensitivities { output, by_input, by_parameter, edges, exact: false })
    }

    /// One derivative; the step is cut while an edge lies within it.
    fn slope(&self, scale: f64, name: &str, edges: &mut Vec<String>, moved: &dyn Fn(f64) -> Result<ImpactOutput, ModelError>) -> Result<Column, ModelError> {
        let kind = usize::from(self.model.base() == Base::Viscoelastic);
        let numbers = |o: ImpactOutput| -> Column { o.as_columns().map(|c| c.unwrap_or(0.0)) };
        let central = |h: f64| -> Result<Column, ModelError> {
            let (up, down) = (numbers(moved(h)?), numbers(moved(-h)?));
            Ok(std::array::from_fn(|k| (up[k] - down[k]) / (2.0 * h)))
        };
        let mut step = STEP[kind] * scale;
        for cut in 0..=CUTS {
            let [a, b, c] = [central(step)?, central(0.5 * step)?, central(0.25 * step)?];
            let once = |a: f64, b: f64| b + (b - a) / 3.0;
            let rows: [(f64, f64); OUTPUTS.len()] = std::array::from_fn(|k| {
                let (ab, bc) = (once(a[k], b[k]), once(b[k], c[k]));
                (bc + (bc - ab) / 15.0, bc - ab)
            });
            let worst = rows.iter().zip(OUTPUT_SCALE).map(|((_, error), size)| (error * scale / size).abs()).fold(0.0, f64::max);
            if worst <= TRUST[kind] {
                return Ok(rows.map(|r| r.0));
            }
            if cut == CUTS {
                edges.push(name.to_owned());
                return Ok(a);
            }
            step *= 0.125;
        }
        Err(ModelError::NotFinite)
    }
}

#[cfg(test)]
mod tests;
