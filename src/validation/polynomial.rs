//! Statistical models of the measured outputs themselves, beside the mechanistic one.
//!
//! James (2004)-style and multivariate polynomials (thesis 2.8): an output as a second-order polynomial of the inputs
//! that were varied, by least squares. With it the effect of one input can be seen while the others are held at their
//! means. No physics: it says what the data hold, and how close a smooth black box gets.

use super::comparison::ImpactPoint;
use crate::impact_table::{INPUTS, OUTPUTS};
use crate::quantity::HOLD_95_PERCENT;
use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

/// Points of a held-others curve.
const CURVE_POINTS: usize = 21;
/// Of a number that was written and read, relative.
const ROUNDING: f64 = 1e-9;

/// A second-order polynomial of one output.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct PolynomialFit {
    pub output: String,
    /// Root-mean-square residual on the impacts it was fitted to, and on the held-out ones.
    pub rmse: f64,
    pub rmse_heldout: f64,
    /// Share of the variance explained on the held-out impacts.
    pub r2_heldout: f64,
    pub n_terms: usize,
    pub terms: Vec<PolynomialTerm>,
    /// The effect of each input while the others stay at their means.
    pub effects: Vec<HeldEffect>,
}

/// One term: product of standardised inputs (value − mean)/sd, with its coefficient in the output's unit.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct PolynomialTerm {
    pub inputs: Vec<String>,
    pub coefficient: f64,
    pub sd: f64,
}

/// An output against one input, the others at their means, with a 95 % band.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct HeldEffect {
    pub input: String,
    pub x: Vec<f64>,
    pub mean: Vec<f64>,
    pub low: Vec<f64>,
    pub high: Vec<f64>,
}

/// Fits every measured output; squares and products only as far as three impacts a term allow.
pub fn polynomial_fits(impacts: &[ImpactPoint], varied: &[usize]) -> Vec<PolynomialFit> {
    (0..OUTPUTS.len()).filter_map(|k| polynomial_fit(impacts, varied, k)).collect()
}

fn polynomial_fit(impacts: &[ImpactPoint], varied: &[usize], output: usize) -> Option<PolynomialFit> {
    let rows: Vec<(&ImpactPoint, f64)> = impacts.iter().filter_map(|i| i.outputs.iter().find(|p| p.output == output).map(|p| (i, p.measured))).collect();
    let seen: Vec<_> = rows.iter().filter(|(i, _)| !i.held_out).collect();
    let held: Vec<_> = rows.iter().filter(|(i, _)| i.held_out).collect();
    let n = seen.len();
    let d = varied.len();
    if d == 0 || held.len() < 3 || n < 3 * (1 + d) {
        return None;
    }
    let (mut mean, mut sd) = (vec![0.0; d], vec![0.0; d]);
    for (a, &j) in varied.iter().enumerate() {
        mean[a] = seen.iter().map(|(i, _)| i.inputs[j]).sum::<f64>() / n as f64;
        sd[a] = (seen.iter().map(|(i, _)| (i.inputs[j] - mean[a]).powi(2)).sum::<f64>() / n as f64).sqrt();
        if !(sd[a] > 0.0) {
            return None;
        }
    }
    let mut terms: Vec<Vec<usize>> = vec![vec![]];
    terms.extend((0..d).map(|a| vec![a]));
    if n >= 3 * (1 + 2 * d) {
        terms.extend((0..d).map(|a| vec![a, a]));
    }
    if n >= 3 * (1 + 2 * d + d * (d - 1) / 2) {
        terms.extend((0..d).flat_map(|a| (a + 1..d).map(move |b| vec![a, b])));
    }
    let row = |u: &[f64]| DVector::from_iterator(terms.len(), terms.iter().map(|t| t.iter().map(|&a| u[a]).product::<f64>()));
    let scaled = |i: &ImpactPoint| -> Vec<f64> { varied.iter().enumerate().map(|(a, &j)| (i.inputs[j] - mean[a]) / sd[a]).collect() };
    let design = DMatrix::from_rows(&seen.iter().map(|(i, _)| row(&scaled(i)).transpose()).collect::<Vec<_>>());
    let y = DVector::from_iterator(n, seen.iter().map(|(_, v)| *v));
    let inverse = super::fit::invert(&design.tr_mul(&design)).ok()?;
    let coefficients = &inverse * design.tr_mul(&y);
    let residual = &y - &design * &coefficients;
    let variance = residual.norm_squared() / (n - terms.len()).max(1) as f64;
    let rms =
        |list: &[&(&ImpactPoint, f64)]| (list.iter().map(|(i, v)| (v - row(&scaled(i)).dot(&coefficients)).powi(2)).sum::<f64>() / list.len() as f64).sqrt();
    let rmse_heldout = rms(&held);
    let held_mean = held.iter().map(|(_, v)| v).sum::<f64>() / held.len() as f64;
    // An output that is the same in all impacts varies by rounding alone, and there is nothing to explain.
    let rounding = (ROUNDING * held.iter().map(|(_, v)| v.abs()).fold(0.0, f64::max)).powi(2).max(f64::MIN_POSITIVE);
    let held_variance = (held.iter().map(|(_, v)| (v - held_mean).powi(2)).sum::<f64>() / held.len() as f64).max(rounding);
    let effects = varied
        .iter()
        .enumerate()
        .map(|(a, &j)| {
            let mut effect = HeldEffect { input: INPUTS[j].to_owned(), x: vec![], mean: vec![], low: vec![], high: vec![] };
            for step in 0..CURVE_POINTS {
                let mut u = vec![0.0; d];
                u[a] = -2.0 + 4.0 * step as f64 / (CURVE_POINTS - 1) as f64;
                let at = row(&u);
                let (value, spread) = (at.dot(&coefficients), (variance * at.dot(&(&inverse * &at))).max(0.0).sqrt());
                effect.x.push(mean[a] + sd[a] * u[a]);
                effect.mean.push(value);
                effect.low.push(value - HOLD_95_PERCENT * spread);
                effect.high.push(value + HOLD_95_PERCENT * spread);
            }
            effect
        })
        .collect();
    Some(PolynomialFit {
        output: OUTPUTS[output].to_owned(),
        rmse: rms(&seen),
        rmse_heldout,
        r2_heldout: 1.0 - rmse_heldout * rmse_heldout / held_variance,
        n_terms: terms.len(),
        terms: terms
            .iter()
            .enumerate()
            .map(|(t, list)| PolynomialTerm {
                inputs: list.iter().map(|&a| INPUTS[varied[a]].to_owned()).collect(),
                coefficient: coefficients[t],
                sd: (variance * inverse[(t, t)]).max(0.0).sqrt(),
            })
            .collect(),
        effects,
    })
}

#[cfg(test)]
mod tests {
    use super::super::comparison::OutputPoint;
    use super::*;

    #[test]
    fn law_an_output_that_is_the_same_in_all_impacts_is_explained() {
        let impacts: Vec<ImpactPoint> = (0..40)
            .map(|i| ImpactPoint {
                id: i.to_string(),
                held_out: i % 3 == 0,
                inputs: (0..INPUTS.len()).map(|k| 1.0 + (i as f64 * (1.3 + 0.7 * k as f64)).sin()).collect(),
                outputs: vec![OutputPoint { output: 2, measured: 0.1, predicted: 0.2, sd: 0.1 }],
            })
            .collect();
        let fits = polynomial_fits(&impacts, &[2, 12]);
        assert!(fits.len() == 1 && (fits[0].r2_heldout - 1.0).abs() < 1e-6, "{fits:?}");
    }
}
