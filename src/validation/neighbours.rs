//! Do impacts that follow each other miss alike?
//!
//! What goes up and down with the order of the impacts (two balls in turn, strings that are exchanged, a hall that warms and cools) is seen by no smooth
//! correction. Residuals of an output times those of the impact before it sum up to nothing where impacts are independent; over the root of its own
//! squares the sum is normal whatever the noise's tails (Efron 1969).

use super::linearise::Linearised;
use super::observation::Observation;
use super::tails::normal_tail;
use crate::impact_table::OUTPUTS;
use std::collections::BTreeMap;

/// Level of the test, corrected for the number of outputs.
const ORDER_LEVEL: f64 = 1e-5;
/// Neighbours that can tell.
const FEWEST: usize = 30;

/// The output whose residuals go with those of the impact before by the most, if they do: its column, and whether alike or the other way.
pub fn miss_alike<'a>(impacts: impl Iterator<Item = (&'a &'a Observation, &'a Linearised)>) -> Option<(&'static str, bool)> {
    let impacts: Vec<_> = impacts.collect();
    let mut tried = 0usize;
    let mut most: Option<(f64, usize)> = None;
    for (output, _) in OUTPUTS.iter().enumerate() {
        let mut sessions: BTreeMap<usize, Vec<(f64, f64)>> = BTreeMap::new();
        for (o, l) in &impacts {
            if let Some(row) = l.measured.iter().position(|m| *m == output) {
                sessions.entry(o.session).or_default().push((o.order, l.residual[row] / l.covariance[(row, row)].sqrt()));
            }
        }
        let products: Vec<f64> = sessions
            .into_values()
            .flat_map(|mut residuals| {
                residuals.sort_by(|a, b| a.0.total_cmp(&b.0));
                residuals.windows(2).map(|pair| pair[0].1 * pair[1].1).collect::<Vec<_>>()
            })
            .collect();
        if products.len() < FEWEST {
            continue;
        }
        tried += 1;
        let squares: f64 = products.iter().map(|p| p * p).sum();
        let z = if squares > 0.0 { products.iter().sum::<f64>() / squares.sqrt() } else { 0.0 };
        if most.is_none_or(|m| z.abs() > m.0.abs()) {
            most = Some((z, output));
        }
    }
    let (z, output) = most?;
    (2.0 * normal_tail(z.abs()) * (tried as f64) < ORDER_LEVEL).then(|| (OUTPUTS[output], z > 0.0))
}
