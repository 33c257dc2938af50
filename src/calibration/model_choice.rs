//! Which distortion terms the data ask for: the same corners adjusted with each set of terms, weighed by evidence.

use super::bundle::{Bundle, BundleError, BundleFit, BundleOptions};
use super::distortion::DistortionModel;
use serde::{Deserialize, Serialize};

/// One set of distortion terms, adjusted to the same corners.
#[derive(Debug, Clone)]
pub struct ModelFit {
    pub model: DistortionModel,
    pub bundle: Bundle,
    pub fit: BundleFit,
    /// Bayesian information criterion with the noise variance unknown: `n ln(SSE/n) + p ln n`. Lower is better.
    pub bic: f64,
}

/// How one model did, as `calibration.json` shows it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ModelSummary {
    pub model: DistortionModel,
    pub rms_px: f64,
    pub bic: f64,
    /// Share of the evidence (BIC weights) among the models compared.
    pub weight: f64,
    pub left_fx: f64,
    pub right_fx: f64,
    pub left_cx: f64,
    pub right_cx: f64,
    pub baseline_m: f64,
}

/// Adjusts every model, each starting at the one before; models that do not settle are left out.
pub fn adjust_all(start: &Bundle, max_iterations: usize) -> Result<Vec<ModelFit>, BundleError> {
    let mut fits: Vec<ModelFit> = Vec::new();
    let mut last_error = BundleError::Singular;
    for model in DistortionModel::ALL {
        let mut bundle = fits.last().map_or_else(|| start.clone(), |f| f.bundle.clone());
        let on = model.active();
        for (camera, at) in [(&mut bundle.left, 4), (&mut bundle.right, 13)] {
            for k in 0..5 {
                if !on[at + k] {
                    camera.distortion[k] = 0.0;
                }
            }
        }
        match bundle.adjust(&BundleOptions { active: on, huber_px: None, max_iterations }) {
            Ok(fit) => {
                let n = 2.0 * bundle.views.iter().map(|v| v.left.len() + v.right.len()).sum::<usize>() as f64;
                let p = (model.free_parameters() + 6 * bundle.views.len()) as f64;
                // A world without noise would give minus infinity: the floor is far below any camera.
                let bic = n * (fit.squared_error_px2 / n).max(1e-20).ln() + p * n.ln();
                fits.push(ModelFit { model, bundle, fit, bic });
            }
            Err(e) => last_error = e,
        }
    }
    if fits.is_empty() { Err(last_error) } else { Ok(fits) }
}

/// BIC weights, in the order of the fits.
pub fn weights(fits: &[ModelFit]) -> Vec<f64> {
    let best = fits.iter().map(|f| f.bic).fold(f64::INFINITY, f64::min);
    let raw: Vec<f64> = fits.iter().map(|f| (-0.5 * (f.bic - best)).exp()).collect();
    let sum: f64 = raw.iter().sum();
    raw.into_iter().map(|w| w / sum).collect()
}

pub fn summaries(fits: &[ModelFit]) -> Vec<ModelSummary> {
    fits.iter()
        .zip(weights(fits))
        .map(|(f, weight)| {
            let corners: usize = f.bundle.views.iter().map(|v| v.left.len() + v.right.len()).sum();
            ModelSummary {
                model: f.model,
                rms_px: (f.fit.squared_error_px2 / corners.max(1) as f64).sqrt(),
                bic: f.bic,
                weight,
                left_fx: f.bundle.left.fx,
                right_fx: f.bundle.right.fx,
                left_cx: f.bundle.left.cx,
                right_cx: f.bundle.right.cx,
                baseline_m: f.bundle.right_from_left.translation.vector.norm(),
            }
        })
        .collect()
}
