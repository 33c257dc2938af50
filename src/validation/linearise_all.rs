//! All impacts of a table linearised side by side, in their order.

use super::error::ValidationError;
use super::forward::{Inputs, Prediction};
use super::linearise::{Linearised, Setting, Spread, linearise, weigh_again};
use super::observation::{Observation, Observations};
use super::predicted::PIECE;
use super::session_shift::SessionShift;
use nalgebra::DMatrix;
use rayon::prelude::*;

/// Impacts linearised at the current parameters; as [`linearise`].
///
/// # Errors
/// Impacts for which the model has no answer.
pub fn linearise_all(
    prediction: &dyn Prediction,
    observations: &Observations,
    impacts: &[&Observation],
    shifts: &[SessionShift],
    spread: &Spread,
    begin: &[Inputs],
    reuse: Option<&[Linearised]>,
    open: Option<&[DMatrix<f64>]>,
    passes: usize,
) -> Result<Vec<Linearised>, ValidationError> {
    let setting = Setting { observations, shifts, spread };
    let piece = |(i, o): (usize, &[&Observation])| {
        let range = i * PIECE..i * PIECE + o.len();
        linearise(prediction, o, &setting, &begin[range.clone()], reuse.map(|r| &r[range.clone()]), open.map(|r| &r[range]), passes)
    };
    // An estimate of the true inputs may have gone where the model has no answer though it has one where the estimate began: then nothing is told.
    let why_not = |i: usize| {
        let (o, inputs) = (impacts.get(i)?, *begin.get(i)?);
        prediction.why_not(&o.asked_at(inputs))
    };
    all_of(impacts.par_chunks(PIECE).enumerate().flat_map_iter(piece).collect(), impacts, why_not)
}

/// The same impacts with the weights that another spread gives their cells; as [`weigh_again`].
///
/// # Errors
/// Impacts for which the model has no answer.
pub fn weigh_all_again(impacts: &[&Observation], setting: &Setting, known: Vec<Linearised>) -> Result<Vec<Linearised>, ValidationError> {
    let known = impacts.par_iter().with_min_len(PIECE).zip(known);
    all_of(known.map(|(o, known)| weigh_again(o, setting, known)).collect(), impacts, |_| None)
}

/// All of them, or how many have no answer, and why the first has none.
fn all_of(results: Vec<Option<Linearised>>, impacts: &[&Observation], why_not: impl Fn(usize) -> Option<String>) -> Result<Vec<Linearised>, ValidationError> {
    if let Some(first) = results.iter().position(Option::is_none) {
        let failed = results.iter().filter(|r| r.is_none()).count();
        let id = impacts.get(first).map(|o| o.id.clone()).unwrap_or_default();
        return Err(ValidationError::NoPrediction { failed, rows: impacts.len(), id, why: why_not(first) });
    }
    Ok(results.into_iter().flatten().collect())
}
