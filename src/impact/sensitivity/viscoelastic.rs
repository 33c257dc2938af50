//! Derivatives of a visco-elastic impact: through the contact in dual numbers.
//!
//! What happens before the contact (observation, bodies, laws) and after it is plain algebra without steps; its part of the
//! chain is taken by extrapolated central differences, good to ten digits.

use super::{Column, INPUT_SCALE, INPUTS, Sensitivities, SensitivityModel};
use crate::impact::error::ModelError;
use crate::impact::input::{ImpactInput, ImpactOutput};
use crate::impact::prepared_model::{PreparedModel, Staged};
use crate::impact::viscoelastic::{Laws, Slope};

/// Step of the algebra's differences over an input's or parameter's typical size.
const STEP: f64 = 1e-3;

/// Moves an input or a parameter.
type Mover<'a> = dyn Fn(f64) -> Result<(PreparedModel, ImpactInput), ModelError> + 'a;

/// The algebra at a step and half of it, up and down.
struct Around {
    step: f64,
    stages: [(PreparedModel, Staged, f64); 4],
}

/// First-order slope from differences over `step` and half of it.
fn extrapolated(whole: f64, half: f64) -> f64 {
    half + (half - whole) / 3.0
}

impl Around {
    fn new(step: f64, mover: &Mover) -> Result<Self, ModelError> {
        let stage = |by: f64| -> Result<(PreparedModel, Staged, f64), ModelError> {
            let (model, input) = mover(by)?;
            let staged = model.stage(&input)?;
            Ok((model, staged, by))
        };
        Ok(Around { step, stages: [stage(step)?, stage(-step)?, stage(0.5 * step)?, stage(-0.5 * step)?] })
    }

    /// `None` where the step changes what the contact is made of.
    fn slope(&self, centre: &Staged) -> Option<Slope> {
        let [a, b, c, d] = &self.stages;
        if [a, b, c, d].iter().any(|s| !s.1.laws.has_parts_of(&centre.laws)) {
            return None;
        }
        let difference = |a: f64, b: f64, step: f64| (a - b) / (2.0 * step);
        let whole = Laws::<f64>::combine(&a.1.laws, &b.1.laws, |a, b| difference(a, b, self.step));
        let half = Laws::<f64>::combine(&c.1.laws, &d.1.laws, |c, d| difference(c, d, 0.5 * self.step));
        let columns = [a, b, c, d].map(|s| s.1.contact.as_columns());
        let input = std::array::from_fn(|i| {
            extrapolated(difference(columns[0][i], columns[1][i], self.step), difference(columns[2][i], columns[3][i], 0.5 * self.step))
        });
        Some(Slope { input: ImpactInput::from_columns(&input, 0.0), laws: Laws::<f64>::combine(&whole, &half, extrapolated) })
    }

    /// The derivative of what is observed, from that of the contact's outcome.
    fn observed(&self, output: &[f64; 13], slope: &[f64; 13]) -> Result<Column, ModelError> {
        let mut seen = [[0.0; 13]; 4];
        for ((model, staged, by), seen) in self.stages.iter().zip(&mut seen) {
            let moved = std::array::from_fn(|k| output[k] + by * slope[k]);
            *seen = numbers(&model.conclude(staged, ImpactOutput::from_columns(&moved))?);
        }
        let [a, b, c, d] = seen;
        Ok(std::array::from_fn(|k| extrapolated((a[k] - b[k]) / (2.0 * self.step), (c[k] - d[k]) / self.step)))
    }
}

fn numbers(o: &ImpactOutput) -> Column {
    o.as_columns().map(|c| c.unwrap_or(0.0))
}

impl SensitivityModel {
    /// Exact through the contact; a direction in which the contact changes its parts is left to differences, which name the edge.
    pub(super) fn through_contact(&self, input: &ImpactInput) -> Result<Sensitivities, ModelError> {
        let centre = self.centre.stage(input)?;
        let columns = input.as_columns();
        let by_input = |j: usize| {
            move |by: f64| {
                let mut c = columns;
                c[j] += by;
                Ok((self.centre.clone(), ImpactInput::from_columns(&c, input.order)))
            }
        };
        let by_parameter = |index: usize| {
            move |by: f64| {
                let mut model = self.model.clone();
                model.set_at(index, self.model.parameters()[index].value + by)?;
                Ok((PreparedModel::new(model, self.body.clone())?, *input))
            }
        };
        let parameters = self.model.parameters();
        let movers: Vec<Box<Mover>> = (0..INPUTS.len())
            .map(|j| Box::new(by_input(j)) as Box<Mover>)
            .chain((0..parameters.len()).map(|i| Box::new(by_parameter(i)) as Box<Mover>))
            .collect();
        let scale = |n: usize| if n < INPUTS.len() { INPUT_SCALE[n] } else { parameters[n - INPUTS.len()].typical };
        let mut around = Vec::with_capacity(movers.len());
        let (mut places, mut slopes) = (Vec::new(), Vec::new());
        for (n, mover) in movers.iter().enumerate() {
            let here = Around::new(STEP * scale(n), mover.as_ref()).ok().and_then(|a| a.slope(&centre).map(|s| (a, s)));
            around.push(here.map(|(a, slope)| {
                places.push(n);
                slopes.push(slope);
                a
            }));
        }
        let (output, contact) = self.centre.differentiate(&centre, &slopes)?;
        let at = numbers(&output);
        let mut rows: Vec<Option<Column>> = vec![None; movers.len()];
        for (n, slope) in places.iter().zip(&contact) {
            rows[*n] = around[*n].as_ref().map(|a| a.observed(&at, slope)).transpose()?.filter(|row| row.iter().all(|d| d.is_finite()));
        }
        let (mut edges, mut exact) = (Vec::new(), true);
        let mut done = Vec::with_capacity(rows.len());
        for (n, row) in rows.into_iter().enumerate() {
            done.push(match row {
                Some(row) => row,
                None => {
                    let name = if n < INPUTS.len() { INPUTS[n] } else { &parameters[n - INPUTS.len()].name };
                    let before = edges.len();
                    let moved = |by: f64| movers[n](by).and_then(|(model, input)| model.predict(&input));
                    let row = self.slope(scale(n), name, &mut edges, &moved)?;
                    exact &= edges.len() > before;
                    row
                }
            });
        }
        let by_parameter = done.split_off(INPUTS.len());
        Ok(Sensitivities { output: self.centre.conclude(&centre, output)?, by_input: done, by_parameter, edges, exact })
    }
}
