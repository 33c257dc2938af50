//! What a model says of many impacts, and the difference between two states of it.

use super::error::ValidationError;
use super::forward::{Asked, Forward, Inputs, Outputs, Prediction};
use super::linearise::Linearised;
use super::observation::{Observation, Observations};
use super::unseen_spin::{TRIED, TRIED_FOR_SLOPES, covariance, mean, spins, with_spin};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Impacts per task: enough to fill the lanes of a time-stepped model, few enough to share a table between threads.
pub const PIECE: usize = 32;

/// Predictions over open spins that are made at once: enough to fill the lanes of a time-stepped model, few enough to stay in a core's cache.
const AT_ONCE: usize = 128;

/// Impacts for which the model as stated has no answer at their measured inputs (the ball does not approach, a user's formula gives no number), by id,
/// with the reason.
///
/// # Errors
/// A model that cannot be prepared at all.
pub fn unpredicted(forward: &dyn Forward, observations: &Observations) -> Result<BTreeMap<String, String>, ValidationError> {
    let stated: Vec<f64> = forward.parameters().iter().map(|p| p.value).collect();
    let prediction = forward.prepare(&stated)?;
    let p = prediction.as_ref();
    let piece = |impacts: &[Observation]| {
        let asked: Vec<(&Observation, Inputs)> = impacts.iter().map(|o| (o, o.inputs)).collect();
        let answers = predict_measured(p, &asked);
        let lost = impacts.iter().zip(answers).filter(|(_, answer)| answer.is_none());
        lost.map(|(o, _)| (o.id.clone(), why_not(p, o))).collect::<Vec<_>>()
    };
    Ok(observations.impacts.par_chunks(PIECE).flat_map_iter(piece).collect())
}

/// Why an impact has no answer, at its measured inputs or with a spin that nobody measured.
fn why_not(p: &dyn Prediction, o: &Observation) -> String {
    let at = |inputs: Inputs| p.why_not(&o.asked_at(inputs));
    let with_unseen_spin = || spins(o, TRIED).filter(|_| o.has_open_spin()).find_map(|spin| at(with_spin(o.inputs, spin)));
    at(o.inputs).or_else(with_unseen_spin).unwrap_or_else(|| "the model gives no finite number for an output that was measured".to_owned())
}

/// Predicted values of the measured outputs of each impact at its inputs, or `None` where the model has no answer. Of an
/// impact whose spin is open the mean over the spins of play ([`super::unseen_spin`]).
pub fn predict_measured(p: &dyn Prediction, asked: &[(&Observation, Inputs)]) -> Vec<Option<DVector<f64>>> {
    predict_with(p, asked, TRIED)
}

/// The same with fewer spins tried, for slopes.
pub fn predict_roughly(p: &dyn Prediction, asked: &[(&Observation, Inputs)]) -> Vec<Option<DVector<f64>>> {
    predict_with(p, asked, TRIED_FOR_SLOPES)
}

fn predict_with(p: &dyn Prediction, asked: &[(&Observation, Inputs)], tried: usize) -> Vec<Option<DVector<f64>>> {
    if !asked.iter().any(|(o, _)| o.has_open_spin()) {
        return predict_as_asked(p, asked);
    }
    let (open, closed): (Vec<usize>, Vec<usize>) = (0..asked.len()).partition(|&i| asked[i].0.has_open_spin());
    let mut all = vec![None; asked.len()];
    let some: Vec<(&Observation, Inputs)> = closed.iter().map(|&i| asked[i]).collect();
    for (i, value) in closed.into_iter().zip(predict_as_asked(p, &some)) {
        all[i] = value;
    }
    let some: Vec<(&Observation, Inputs)> = open.iter().map(|&i| asked[i]).collect();
    for (i, value) in open.into_iter().zip(over_spins(p, &some, tried, mean)) {
        all[i] = value;
    }
    all
}

/// Covariance of the measured outputs over the open spins of each impact.
pub fn scatter_over_spins(p: &dyn Prediction, asked: &[(&Observation, Inputs)]) -> Vec<Option<DMatrix<f64>>> {
    over_spins(p, asked, TRIED, covariance)
}

/// What `of` makes of the predictions with `tried` spins of each impact.
fn over_spins<R>(
    p: &dyn Prediction,
    asked: &[(&Observation, Inputs)],
    tried: usize,
    of: impl Fn(&Observation, &[Option<Outputs>]) -> Option<R>,
) -> Vec<Option<R>> {
    let mut results = Vec::with_capacity(asked.len());
    for some in asked.chunks(AT_ONCE / tried) {
        let mut points = Vec::with_capacity(AT_ONCE);
        for same in some.chunk_by(|a, b| std::ptr::eq(a.0, b.0)) {
            let spins: Vec<[f64; 2]> = spins(same[0].0, tried).collect();
            points.extend(same.iter().flat_map(|(o, x)| spins.iter().map(|spin| o.asked_at(with_spin(*x, *spin)))));
        }
        results.extend(some.iter().zip(p.predict_many(&points).chunks(tried)).map(|((o, _), predictions)| of(o, predictions)));
    }
    results
}

fn predict_as_asked(p: &dyn Prediction, asked: &[(&Observation, Inputs)]) -> Vec<Option<DVector<f64>>> {
    let points: Vec<Asked> = asked.iter().map(|(o, inputs)| o.asked_at(*inputs)).collect();
    p.predict_many(&points).iter().zip(asked).map(|(outputs, (o, _))| o.measured_of(outputs.as_ref()?)).collect()
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
