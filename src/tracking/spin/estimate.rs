//! From views to a spin estimate: search, registration, and the verdict whether it may be believed.

use super::registration::{Effort, Registrar, Registration};
use super::search::Search;
use super::shading::{Mark, divide_out};
use super::sphere_map::SphereMap;
use super::view::{BallView, ViewInfo, sample_views};
use crate::calibration::StereoRig;
use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

/// What the estimator must know about the recording.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpinSettings {
    pub frame_rate_hz: f64,
    /// Fastest spin looked for, rad/s. The default of 650 rad/s (6200 rpm) is above every stroke measured in play.
    pub limit_rad_s: f64,
}

impl SpinSettings {
    /// Default limit, lowered to a quarter turn per frame for slow cameras: lines that look the same after half a turn
    /// leave no more.
    pub fn new(frame_rate_hz: f64) -> Self {
        SpinSettings { frame_rate_hz, limit_rad_s: f64::min(650.0, 0.5 * std::f64::consts::PI * frame_rate_hz) }
    }
}

/// Why no spin is reported.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, thiserror::Error)]
#[serde(rename_all = "snake_case", tag = "cause")]
pub enum SpinRefusal {
    #[error("only {seen} usable frames show the ball; {needed} are needed")]
    TooFewFrames { seen: usize, needed: usize },
    #[error("the ball shows no markings (contrast {contrast:.3}, noise {noise:.3}); draw dark lines on it")]
    NoMarkings { contrast: f64, noise: f64 },
    #[error("two spins fit almost equally well ({first:.0?} and {second:.0?} rad/s); draw markings without symmetry")]
    Ambiguous { first: [f64; 3], second: [f64; 3] },
    #[error("no component of the spin is measured to better than {sd_rad_s:.0} rad/s")]
    TooUncertain { sd_rad_s: f64 },
    #[error("the best spin, {rate_rad_s:.0} rad/s, lies at the limit of {limit_rad_s:.0} rad/s where lines alias; film faster")]
    Aliased { rate_rad_s: f64, limit_rad_s: f64 },
}

/// How well the markings hold the estimate.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct SpinQuality {
    /// Pictures of both cameras used.
    pub views: usize,
    /// Pixels used.
    pub pixels: usize,
    /// Noise of one pixel and root mean square of the markings, relative to the ball's brightness.
    pub noise: f64,
    pub markings: f64,
    /// Share of pixels set aside as strings, frame or glints.
    pub outliers: f64,
    /// Difference of log-likelihood to the second-best distinct spin; absent when there was none.
    pub margin: Option<f64>,
}

/// One spin measurement. Global axes, rad/s.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", tag = "kind")]
pub enum SpinEstimate {
    /// All three components.
    Vector {
        omega_rad_s: Vector3<f64>,
        /// (rad/s)².
        covariance: Matrix3<f64>,
        frames_used: usize,
        quality: SpinQuality,
    },
    /// Only the component along `axis` (unit vector); the thesis's one-axis count in spirit, without its counting.
    OneAxis {
        axis: Vector3<f64>,
        rate_rad_s: f64,
        sd_rad_s: f64,
        frames_used: usize,
        reason: String,
    },
    Refused {
        reason: SpinRefusal,
    },
}

/// Spin before and after one impact.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BallSpin {
    pub before: SpinEstimate,
    pub after: SpinEstimate,
}

/// Measures the spin before first contact and after last contact. `radius_m` is the ball's; views may come in any order.
pub fn measure_spin(before: &[BallView], after: &[BallView], rig: &StereoRig, radius_m: f64, settings: &SpinSettings) -> BallSpin {
    BallSpin { before: estimate_spin(before, rig, radius_m, settings), after: estimate_spin(after, rig, radius_m, settings) }
}

/// Least frames from which a spin is tried.
const LEAST_FRAMES: usize = 4;
/// Largest standard deviation of a component that still counts as measured, rad/s: 10 % of 1600 rpm.
const LARGEST_SD: f64 = 17.0;
/// Least difference of log-likelihood to the second-best spin, in units of the residuals' correlation length.
const LEAST_MARGIN: f64 = 50.0;

/// Frames over which residuals stay correlated.
const LAG: f64 = 6.0;
/// Which candidate: a coarse map without blur.
const COARSE: Effort = Effort { steps: 4, last_step_rad_s: 0.5, rounds: 12, covariance: false, memory_s: 0.0 };
/// Fine map with blur, before the shading is fitted again.
const FIRST: Effort = Effort { steps: 2, last_step_rad_s: 0.3, rounds: 15, covariance: false, memory_s: 0.0 };
const FINAL: Effort = Effort { steps: 3, last_step_rad_s: 0.03, rounds: 20, covariance: true, memory_s: 0.0 };


/// Measures one constant spin vector over the free flight shown by `views`.
pub fn estimate_spin(views: &[BallView], rig: &StereoRig, radius_m: f64, settings: &SpinSettings) -> SpinEstimate {
    let (infos, samples) = sample_views(views, rig, radius_m);
    let frames = distinct_times(&infos, settings.frame_rate_hz);
    if frames < LEAST_FRAMES || samples.len() < 200 {
        return SpinEstimate::Refused { reason: SpinRefusal::TooFewFrames { seen: frames, needed: LEAST_FRAMES } };
    }
    let t0 = cpu();
    let (shading, marks) = divide_out(&infos, &samples, None);
    let search = Search::new(&infos, &marks);
    let candidates = search.candidates(1.0 / settings.frame_rate_hz, settings.limit_rad_s);
    let t1 = cpu();
    // Which candidate: a coarse map, every second pixel, no blur.
    let coarse_map = SphereMap::new(600);
    let few: Vec<Mark> = marks.iter().copied().step_by(2).collect();
    let coarse = Registrar::new(&coarse_map, &infos, &few, &shading, 0.0);
    let fits: Vec<Registration> = candidates.iter().take(3).map(|c| coarse.refine(c.omega, &COARSE)).collect();
    let t2 = cpu();
    if std::env::var_os("TIMES").is_some() { eprintln!("sim search {:?} coarse {:?} candidates {} pixels {}", t1 - t0, t2 - t1, candidates.len(), marks.len()); }
    let Some(noise) = fits.iter().map(|f| f.noise).min_by(f64::total_cmp) else {
        return SpinEstimate::Refused { reason: SpinRefusal::TooFewFrames { seen: frames, needed: LEAST_FRAMES } };
    };
    let mut ranked: Vec<(f64, Registration)> = fits.into_iter().map(|f| (coarse.cost(&f.residuals, noise), f)).collect();
    ranked.sort_by(|a, b| a.0.total_cmp(&b.0));
    let span = infos.iter().map(|v| v.time_s).fold(f64::NEG_INFINITY, f64::max) - infos.iter().map(|v| v.time_s).fold(f64::INFINITY, f64::min);
    let (best_cost, found) = (ranked[0].0, &ranked[0].1);
    // Candidates that ran into the same minimum are one.
    let second = ranked.iter().skip(1).find(|(_, f)| (f.omega - found.omega).norm() > 0.2 / span.max(1e-6));
    let margin = second.map(|(c, _)| c - best_cost);
    let blur_px = std::env::var("BLUR").ok().and_then(|s| s.parse().ok()).unwrap_or(0.6);
    let map = SphereMap::new(1400);
    let t3 = cpu();
    let first = Registrar::new(&map, &infos, &marks, &shading, blur_px).refine(found.omega, &FIRST);
    // The lines darken the first estimate of the shading where they pass most often; once they are known, again.
    let (shading, marks) = divide_out(&infos, &samples, Some(&first.markings));
    let best = Registrar::new(&map, &infos, &marks, &shading, blur_px).refine(first.omega, &Effort { memory_s: LAG / settings.frame_rate_hz, ..FINAL });
    if std::env::var_os("TIMES").is_some() { eprintln!("sim fine {:?}", cpu() - t3); }
    let quality = SpinQuality { views: infos.len(), pixels: marks.len(), noise: best.noise, markings: best.texture, outliers: best.outliers, margin };
    if best.omega.norm() > 0.98 * settings.limit_rad_s {
        return SpinEstimate::Refused { reason: SpinRefusal::Aliased { rate_rad_s: best.omega.norm(), limit_rad_s: settings.limit_rad_s } };
    }
    if best.texture < 0.01 {
        return SpinEstimate::Refused { reason: SpinRefusal::NoMarkings { contrast: best.texture, noise: best.noise } };
    }
    if let (Some(m), Some((_, other))) = (margin, second)
        && m < LEAST_MARGIN
    {
        return SpinEstimate::Refused { reason: SpinRefusal::Ambiguous { first: best.omega.into(), second: other.omega.into() } };
    }
    let covariance = larger(&best.model_covariance, &best.scatter_covariance);
    let eigen = covariance.symmetric_eigen();
    let worst = eigen.eigenvalues.max().sqrt();
    if worst <= LARGEST_SD {
        return SpinEstimate::Vector { omega_rad_s: best.omega, covariance, frames_used: frames, quality };
    }
    // The direction of the spin itself when it is held, else the best-held direction.
    let along = best.omega.try_normalize(1e-9).map(|a| (a, a.dot(&(covariance * a)).sqrt())).filter(|(_, sd)| *sd <= LARGEST_SD);
    let (axis, sd) = along.unwrap_or_else(|| {
        let k = eigen.eigenvalues.imin();
        (eigen.eigenvectors.column(k).into(), eigen.eigenvalues[k].sqrt())
    });
    if sd <= LARGEST_SD {
        return SpinEstimate::OneAxis {
            axis,
            rate_rad_s: best.omega.dot(&axis),
            sd_rad_s: sd,
            frames_used: frames,
            reason: format!("the markings leave one direction free (standard deviation {worst:.0} rad/s)"),
        };
    }
    SpinEstimate::Refused { reason: SpinRefusal::TooUncertain { sd_rad_s: sd } }
}

/// Number of distinct frame times, counted in whole frame periods.
fn distinct_times(views: &[ViewInfo], frame_rate_hz: f64) -> usize {
    let mut n: Vec<i64> = views.iter().map(|v| (v.time_s * frame_rate_hz).round() as i64).collect();
    n.sort_unstable();
    n.dedup();
    n.len()
}

/// A covariance at least as large as both in every direction that is a joint axis of the two.
fn larger(a: &Matrix3<f64>, b: &Matrix3<f64>) -> Matrix3<f64> {
    // In the axes where a is the identity, take each eigenvalue of b, but at least 1.
    let Some(root) = a.cholesky().map(|c| c.l()) else { return *b };
    let Some(inverse) = root.try_inverse() else { return *b };
    let relative = (inverse * b * inverse.transpose()).symmetric_eigen();
    let grown = Matrix3::from_diagonal(&relative.eigenvalues.map(|v| v.max(1.0)));
    let joint = root * relative.eigenvectors;
    let c = joint * grown * joint.transpose();
    0.5 * (c + c.transpose())
}

fn cpu() -> f64 {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap_or_default();
    text.split_whitespace().next().and_then(|n| n.parse::<f64>().ok()).unwrap_or(0.0) * 1e-6
}
