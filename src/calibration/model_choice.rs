//! Which distortion terms the data ask for: the same corners adjusted with each set of terms, weighed by evidence.

use super::board::Checkerboard;
use super::board_shape::BoardShape;
use super::bundle::{Bundle, BundleError, BundleFit, BundleOptions, TO_THE_END};
use super::calibrator::CalibrationOptions;
use super::distortion::DistortionModel;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// One set of distortion terms, adjusted to the same corners.
#[derive(Debug, Clone)]
pub struct ModelFit {
    pub model: DistortionModel,
    pub bundle: Bundle,
    pub fit: BundleFit,
    /// Akaike's criterion with the noise variance unknown, corrected for the number of unknowns:
    /// `n/c ln(SSE/n) + 2 p n / (n - p - 1)`. Lower is better; it estimates the error on corners not used. c: clustering of the
    /// corners' errors, the least of all models, since corners that err together say less than their number (Burnham and Anderson
    /// 2002, section 2.5).
    pub aic: f64,
}

/// How one model did, as `calibration.json` shows it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ModelSummary {
    pub model: DistortionModel,
    pub rms_px: f64,
    pub aic: f64,
    /// Share of the evidence (Akaike weights) among the models compared.
    pub weight: f64,
    /// Whether the data leave room for it (`DEFENSIBLE`).
    pub defensible: bool,
    pub left_fx: f64,
    pub right_fx: f64,
    pub left_cx: f64,
    pub right_cx: f64,
    pub baseline_m: f64,
}

/// Adjusts each model from its start; models that do not settle are left out.
pub fn adjust_all(starts: &[(DistortionModel, Bundle)], options: &CalibrationOptions) -> Result<Vec<ModelFit>, BundleError> {
    let adjusted: Vec<Result<ModelFit, BundleError>> = starts.par_iter().map(|(model, start)| adjust(*model, start, options)).collect();
    let mut last_error = BundleError::Singular;
    let mut fits: Vec<ModelFit> = adjusted.into_iter().filter_map(|a| a.map_err(|e| last_error = e).ok()).collect();
    let clustering = fits.iter().map(|f| f.fit.clustering).fold(f64::INFINITY, f64::min);
    fits.iter_mut().for_each(|f| f.aic = criterion(f, clustering));
    if fits.is_empty() { Err(last_error) } else { Ok(fits) }
}

fn adjust(model: DistortionModel, start: &Bundle, options: &CalibrationOptions) -> Result<ModelFit, BundleError> {
    let mut bundle = start.clone();
    let active = model.active();
    for (camera, at) in [(&mut bundle.left, 4), (&mut bundle.right, 13)] {
        for k in 0..5 {
            if !active[at + k] {
                camera.distortion[k] = 0.0;
            }
        }
    }
    let (max_iterations, clustered_errors) = (options.max_iterations, options.clustered_errors);
    let fit = bundle.adjust(&BundleOptions { active, huber_px: None, max_iterations, settled_gain: TO_THE_END, clustered_errors })?;
    Ok(ModelFit { model, bundle, fit, aic: f64::INFINITY })
}

fn criterion(f: &ModelFit, clustering: f64) -> f64 {
    let n = 2.0 * f.bundle.corners() as f64;
    let p = (f.model.free_parameters() + f.bundle.shape_parameters() + 6 * f.bundle.views.len()) as f64;
    // A world without noise would give minus infinity: the floor is far below any camera.
    n / clustering * (f.fit.squared_error_px2 / n).max(1e-20).ln() + 2.0 * p * n / (n - p - 1.0).max(1.0)
}

/// Difference of the criterion up to which a model cannot be ruled out (Burnham and Anderson 2002, section 2.6).
pub const DEFENSIBLE: f64 = 10.0;
/// How much better the full set with k3 must be than any other: with k1 and k2 it is nearly the same curve.
const K3_MARGIN: f64 = 10.0;

/// Place of the chosen model: of those the data leave room for, the one with the most terms up to k1 k2 p1 p2.
///
/// A superfluous term costs a little width, which the covariance shows; a missing one moves centre and focal length by
/// many standard deviations, which nothing shows. k3 is taken only where the data demand it.
pub fn choose(fits: &[ModelFit]) -> Option<usize> {
    let best_of = |with_k3: bool| least_aic(fits.iter().filter(|f| (f.model == DistortionModel::K1K2P1P2K3) == with_k3));
    let (plain, k3) = (best_of(false), best_of(true));
    if plain.is_infinite() || k3 < plain - K3_MARGIN {
        return fits.iter().position(|f| f.aic == k3);
    }
    fits.iter().rposition(|f| f.model != DistortionModel::K1K2P1P2K3 && f.aic <= plain + DEFENSIBLE)
}

/// How much better a board of its own shape must be than a perfect one.
const SHAPE_MARGIN: f64 = 10.0;

/// The adjustment with the board's own shape, where the corners demand one: bowed, then also stretched. It must foretell corners better and leave
/// boards that pull less against each other; where they err together for other reasons (blur, uneven light) the first alone says little.
pub fn shaped_board(perfect: &ModelFit, board: &Checkerboard, options: &CalibrationOptions) -> Option<Bundle> {
    let mut demanded: Option<ModelFit> = None;
    for stretched in [false, true] {
        let simpler = demanded.as_ref().unwrap_or(perfect);
        let start = Bundle { shape: Some(BoardShape::perfect(board, stretched)), ..simpler.bundle.clone() };
        let Ok(shaped) = adjust(perfect.model, &start, options) else { continue };
        let clustering = simpler.fit.clustering.min(shaped.fit.clustering);
        if criterion(&shaped, clustering) < criterion(simpler, clustering) - SHAPE_MARGIN && shaped.fit.clustering <= simpler.fit.clustering {
            demanded = Some(shaped);
        }
    }
    demanded.map(|m| m.bundle)
}

fn least_aic<'a>(fits: impl Iterator<Item = &'a ModelFit>) -> f64 {
    fits.map(|f| f.aic).fold(f64::INFINITY, f64::min)
}

/// Akaike weights, in the order of the fits.
pub fn weights(fits: &[ModelFit]) -> Vec<f64> {
    let best = least_aic(fits.iter());
    let raw: Vec<f64> = fits.iter().map(|f| (-0.5 * (f.aic - best)).exp()).collect();
    let sum: f64 = raw.iter().sum();
    raw.into_iter().map(|w| w / sum).collect()
}

pub fn summaries(fits: &[ModelFit]) -> Vec<ModelSummary> {
    let best = least_aic(fits.iter());
    fits.iter()
        .zip(weights(fits))
        .map(|(f, weight)| ModelSummary {
            model: f.model,
            rms_px: (f.fit.squared_error_px2 / f.bundle.corners().max(1) as f64).sqrt(),
            aic: f.aic,
            weight,
            defensible: f.aic <= best + DEFENSIBLE,
            left_fx: f.bundle.left.fx,
            right_fx: f.bundle.right.fx,
            left_cx: f.bundle.left.cx,
            right_cx: f.bundle.right.cx,
            baseline_m: f.bundle.right_from_left.translation.vector.norm(),
        })
        .collect()
}
