//! A change from one impact to the next: a racket strung anew, another can of balls, a camera that was knocked.
//!
//! Drifts and waves in the order of the impacts imitate a step in part and would give it a wrong name. So a step of a quantity
//! is scored between neighbouring impacts, nuisance projected out (docs/diagnosis.md, "The formula").

use super::project::{Nuisance, TOLD, project_out};
use super::rank::Reference;
use nalgebra::{DMatrix, DVector, RowDVector};

/// Steps scored at most, evenly over the table.
const MOST_STEPS: usize = 60;
/// Impacts on either side.
const FEWEST: usize = 6;

/// The step that stands out most: `quantity + strength * step(order - after)`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StepInOrder {
    /// Half way between the orders of two impacts, and the order of the latter.
    pub after: f64,
    pub first: f64,
    pub strength: f64,
    /// Fall in chi-square at the noise scale.
    pub gain: f64,
}

/// The strongest step of one quantity. `signature`: whitened derivative of each impact's prediction by it. `None` when the table has no order or too
/// few impacts.
pub fn strongest_step(reference: &Reference, nuisance: &Nuisance, signature: &[DVector<f64>]) -> Option<StepInOrder> {
    let mut orders: Vec<f64> = reference.impacts.iter().map(|o| o.order).collect();
    orders.sort_by(f64::total_cmp);
    let inner = orders.len().checked_sub(2 * FEWEST).filter(|n| *n > 0)?;
    let count = inner.min(MOST_STEPS);
    let mut steps: Vec<(f64, f64)> = (0..=count)
        .map(|k| FEWEST + k * inner / count)
        .filter(|&at| orders[at] > orders[at - 1])
        .map(|at| (0.5 * (orders[at - 1] + orders[at]), orders[at]))
        .collect();
    steps.dedup();
    let row = |order: f64| RowDVector::from_iterator(steps.len(), steps.iter().map(|s| if order >= s.0 { 1.0 } else { 0.0 }));
    let blocks: Vec<DMatrix<f64>> = signature.iter().zip(reference.impacts).map(|(g, o)| g * row(o.order)).collect();
    let projected = project_out(reference.base, nuisance, &blocks);
    let told = |j: &usize| projected.keeps_more_than(TOLD, *j);
    let one = |j: usize| {
        let strength = projected.score[j] / projected.information[(j, j)];
        StepInOrder { after: steps[j].0, first: steps[j].1, strength, gain: projected.score[j] * strength / reference.c }
    };
    (0..steps.len()).filter(told).map(one).max_by(|a, b| a.gain.total_cmp(&b.gain))
}
