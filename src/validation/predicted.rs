//! What a model says of many impacts, and the difference between two states of it.

use super::forward::{Asked, Inputs, Prediction};
use super::linearise::Linearised;
use super::observation::Observation;
use nalgebra::DVector;
use rayon::prelude::*;

/// Impacts per task: enough to fill the lanes of a time-stepped model, few enough to share a table between threads.
pub const PIECE: usize = 32;

/// Predicted values of the measured outputs of each impact at its inputs, or `None` where the model has no answer.
pub fn predict_measured(p: &dyn Prediction, asked: &[(&Observation, Inputs)]) -> Vec<Option<DVector<f64>>> {
    let points: Vec<Asked> = asked.iter().map(|(o, inputs)| Asked { gear: o.gear, order: o.order, inputs: *inputs }).collect();
    p.predict_many(&points)
        .into_iter()
        .zip(asked)
        .map(|(outputs, (o, _))| {
            let all = outputs?;
            let picked = DVector::from_iterator(o.measured.len(), o.measured.iter().map(|&k| all[k]));
            picked.iter().all(|v| v.is_finite()).then_some(picked)
        })
        .collect()
}

/// `above` less `below` at the impacts' true inputs: measured outputs of each impact, zero where either has no answer.
pub fn difference(above: &dyn Prediction, below: &dyn Prediction, impacts: &[&Observation], at: &[Linearised]) -> Vec<DVector<f64>> {
    let one = |(observations, places): (&[&Observation], &[Linearised])| {
        let asked: Vec<(&Observation, Inputs)> = observations.iter().zip(places).map(|(o, l)| (*o, l.true_inputs)).collect();
        let pairs = predict_measured(above, &asked).into_iter().zip(predict_measured(below, &asked));
        pairs.zip(places).map(|((a, b), l)| a.zip(b).map_or_else(|| DVector::zeros(l.z.len()), |(a, b)| a - b)).collect::<Vec<_>>()
    };
    impacts.par_chunks(PIECE).zip(at.par_chunks(PIECE)).flat_map_iter(one).collect()
}
