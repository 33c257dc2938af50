//! From views to a spin estimate: search, registration, and the verdict whether it may be believed.

use super::contest::{Contest, SAME_VALLEY, contest, stands_still};
use super::registration::{Effort, FoundMarkings, Registrar, Registration};
use super::search::{Beam, Search};
use super::shading::{Mark, Shading, divide_out};
use super::sphere_map::SphereMap;
use super::view::{BallView, SampledViews, ViewInfo, sample_views};
use crate::calibration::StereoRig;
use nalgebra::{Matrix3, Rotation3, Vector3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// What the estimator must know about the recording.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpinSettings {
    pub frame_rate_hz: f64,
    /// Fastest spin looked for, rad/s. The default of 650 rad/s (6200 rpm) is above every stroke measured in play.
    pub limit_rad_s: f64,
    /// Blur of the recording by camera, standard deviation in px: lens and pixel together. Between 0.45 and 0.75 px the rate
    /// changes by 0.3 % (docs/spin-experiments.md, "Blur").
    pub blur_px: [f64; 2],
}

impl SpinSettings {
    /// A camera in focus; default limit, lowered to a quarter turn per frame for slow cameras: lines that look the same after half a turn
    /// leave no more.
    pub fn new(frame_rate_hz: f64) -> Self {
        SpinSettings { frame_rate_hz, limit_rad_s: f64::min(650.0, 0.5 * std::f64::consts::PI * frame_rate_hz), blur_px: [BLUR_PX; 2] }
    }
}

/// Why no spin is reported.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, thiserror::Error)]
#[serde(rename_all = "snake_case", tag = "cause")]
pub enum SpinRefusal {
    #[error("only {seen} usable frames show the ball; {needed} are needed")]
    TooFewFrames { seen: usize, needed: usize },
    #[error("more than half of the ball is white to the limit in {white} of {of} pictures; use less light or a shorter exposure")]
    Overexposed { white: usize, of: usize },
    #[error("the contact is not known (no impact in the clip, or no racket around it), so that no flight is before or after it")]
    NoContact,
    #[error("the ball shows no markings (contrast {contrast:.3}, noise {noise:.3}); draw dark lines on it")]
    NoMarkings { contrast: f64, noise: f64 },
    #[error("two spins fit almost equally well ({first:.0?} and {second:.0?} rad/s); draw markings without symmetry")]
    Ambiguous { first: [f64; 3], second: [f64; 3] },
    #[error("the registration did not settle (last step {step_rad_s:.1} rad/s); the markings hold the spin too loosely")]
    Unsettled { step_rad_s: f64 },
    #[error("the best spin leaves {share:.1} times as much unexplained as it explains; draw larger markings or film more frames")]
    Unexplained { share: f64 },
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
    /// What is left over beyond the noise, in units of what the markings explain.
    #[serde(default)]
    pub unexplained: f64,
    /// Lead over the second-best distinct spin in log-likelihood, as a share of what the markings explain; absent when
    /// there was none.
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

/// A spin as it is found: good enough to know how the ball turns while its pictures are measured better, and where the
/// measurement begins.
#[derive(Debug, Clone)]
pub struct FoundSpin {
    /// What is known so far.
    pub rough: SpinEstimate,
    start: Option<Start>,
}

#[derive(Debug, Clone)]
struct Start {
    contest: Contest,
    omega: Vector3<f64>,
    /// As in [`SpinQuality`].
    unexplained: f64,
    markings: FoundMarkings,
}

/// Least frames from which a spin is tried.
const LEAST_FRAMES: usize = 4;
/// Most overexposed views to one that is not: what is left of a ball that is mostly white tells its spin by chance.
const MOST_OVEREXPOSED: usize = 2;
/// Fewest pixels.
const LEAST_SAMPLES: usize = 200;
/// A registration whose last step is longer has not settled: of a spin that was only found, and of a measured one, rad/s.
const SETTLED: (f64, f64) = (3.0, 1.0);
/// Largest standard deviation of a component that still counts as measured: rad/s (10 % of 1600 rpm), and for faster spins as a
/// share of the rate.
const LARGEST_SD: (f64, f64) = (17.0, 0.1);
/// Most that may be left over beyond the noise, in units of what the markings explain: right spins of rendered balls leave
/// 0.03 to 0.5, in pictures twice as noisy as hard ones 0.66 to 1.0; wrong ones 0.9 and more, one 0.71. In clear pictures right ones leave
/// 0.46 at most and wrong ones 0.55 to 0.69: the first where there is no noise, the second where it is as large as the markings.
const MOST_UNEXPLAINED: (f64, f64) = (0.4, 0.85);
/// The same by the noise of a pixel, contrast, straight between: where it is no larger than in hard pictures (0.043 to 0.05) 1139 of 1140 leave 0.47 at most,
/// and a wrong one 0.74; the pictures twice as noisy have 0.083.
const MOST_BY_NOISE: [(f64, f64); 2] = [(0.055, 0.6), (0.08, 0.85)];
/// The same where a rival follows by less than this share of what the markings explain: right ones leave 0.39 at most, the wrong one 0.71 to 0.74.
const CLOSE_RIVAL: f64 = 0.02;
const MOST_WITH_RIVAL: f64 = 0.55;
/// From here on the right spin may be a slower one, below this share of the rate: places that agree by chance about a fast rate had crowded a line's own
/// rate out of the search, and left 0.48 to 0.55 where that leaves 0.31. It is that one if it leaves less than this share of what the other does.
const DOUBTFUL: f64 = 0.4;
const SLOWER: f64 = 0.7;
const CLEARLY_LESS: f64 = 0.8;
/// Least contrast of the markings (root mean square over the ball); a bare ball shows 0.007 of shading left over.
const LEAST_CONTRAST: f64 = 0.015;
/// Blur of a recording in focus, px.
pub const BLUR_PX: f64 = 0.6;
/// Growth of the covariance with the noise: the map follows some of it, and its slopes there look like information.
const NOISE_SHARE: f64 = 8.0;
/// Displacement of the markings from one end of the window to its middle that no picture shows (steps of the shading, the blur's true
/// shape, the map's cells), px, and relative error of the rate. Measured on rendered balls (docs/spin-experiments.md, "Uncertainty").
const MISFIT_PX: f64 = 0.012;
const SYSTEMATIC_RATE: f64 = 0.003;
/// The same along the turn itself, px, where as much is left unexplained as the markings explain: the map's prior holds down what is drawn on it, and a ball
/// that turns less has less line on it (docs/spin-experiments.md, "Slow by a little").
const ALONG_TURN_PX: f64 = 0.2;
/// Maps with other cells over which the spin is averaged, and the share of one map's scatter that stays in the mean of all:
/// dents that the pictures make lie at the same place on all (docs/spin-experiments.md, "Cells").
const OTHER_CELLS: usize = 3;
const CELLS_SHARE: f64 = 0.5;
/// Frames over which residuals stay correlated.
const MEMORY_FRAMES: f64 = 6.0;
/// Cells along an edge of the map: for choosing among candidates (7 degrees), and for the answer (5.6 degrees).
const COARSE_EDGE: usize = 12;
const FINE_EDGE: usize = 16;
/// Fine map with blur, before the shading is fitted again.
const FIRST: Effort = Effort { steps: 8, last_step_rad_s: 0.3, light: true, memory_s: 0.0 };
const FINAL: Effort = Effort { steps: 30, last_step_rad_s: 0.02, light: true, memory_s: 0.0 };

/// Measures one constant spin vector over the free flight shown by `views`, which may come in any order. `radius_m` is the ball's.
pub fn estimate_spin(views: &[BallView], rig: &StereoRig, radius_m: f64, settings: &SpinSettings) -> SpinEstimate {
    FoundSpin::find(views, rig, radius_m, settings).measure(views, rig, radius_m, settings)
}

impl FoundSpin {
    /// Looks for the spin everywhere; once more, with a beam that loses less and takes more for possible, where what was found explains too
    /// little or does not settle: the right one may have been lost among those that fit by chance. Where what is found then leaves much
    /// unexplained the slower ones are looked at by themselves.
    pub fn find(views: &[BallView], rig: &StereoRig, radius_m: f64, settings: &SpinSettings) -> Self {
        let sampled = sample_views(views, rig, radius_m);
        if let Some(reason) = unusable(&sampled, settings) {
            return FoundSpin { rough: SpinEstimate::Refused { reason }, start: None };
        }
        let SampledViews { infos, samples, .. } = sampled;
        let (shading, marks) = divide_out(&infos, &samples, None);
        let search = Search::new(&infos, &marks, 1.0 / settings.frame_rate_hz);
        let look = |limit_rad_s: f64, beam: Beam| Self::among(&search.candidates(limit_rad_s, beam), &infos, &marks, &shading, settings);
        let mut found = look(settings.limit_rad_s, Beam::Level);
        if found.explains_too_little() {
            let again = look(settings.limit_rad_s, Beam::AllLevels);
            found = if matches!(again.rough, SpinEstimate::Refused { .. }) { found } else { again };
        }
        if let Some(start) = found.start.as_ref().filter(|start| start.unexplained > DOUBTFUL) {
            let slower = look(SLOWER * start.omega.norm(), Beam::Level);
            let less = slower.start.as_ref().is_some_and(|s| s.unexplained < CLEARLY_LESS * start.unexplained);
            if less && matches!(slower.rough, SpinEstimate::Vector { .. }) {
                return slower;
            }
        }
        found
    }

    fn explains_too_little(&self) -> bool {
        matches!(self.rough, SpinEstimate::Refused { reason: SpinRefusal::Unexplained { .. } | SpinRefusal::Unsettled { .. } })
    }

    /// The spin from pictures of a longer time: which of those that were possible it is.
    pub fn look_longer(&self, views: &[BallView], rig: &StereoRig, radius_m: f64, settings: &SpinSettings) -> Self {
        let sampled = sample_views(views, rig, radius_m);
        let (Some(start), None) = (&self.start, unusable(&sampled, settings)) else { return self.clone() };
        let SampledViews { infos, samples, .. } = sampled;
        let (shading, marks) = divide_out(&infos, &samples, None);
        let possible: Vec<Vector3<f64>> = [start.omega].into_iter().chain(start.contest.rival).chain(start.contest.near.iter().copied()).collect();
        match possible[..] {
            // Nothing to choose from.
            [omega] if !stands_still(&omega, span_s(&infos)) => {
                let contest = Contest { omega, flat: Matrix3::zeros(), ..start.contest.clone() };
                Self::refined(contest, &infos, &marks, &shading, settings)
            }
            _ => Self::among(&possible, &infos, &marks, &shading, settings),
        }
    }

    /// How fast the ball may turn, rad/s, as far as it is known.
    pub fn fastest(&self) -> Option<f64> {
        let open = |reason: &SpinRefusal| matches!(reason, SpinRefusal::Ambiguous { .. } | SpinRefusal::TooUncertain { .. });
        if matches!(&self.rough, SpinEstimate::Refused { reason } if !open(reason)) {
            return None;
        }
        let contest = &self.start.as_ref()?.contest;
        Some([contest.omega].iter().chain(&contest.rival).chain(&contest.near).map(Vector3::norm).fold(0.0, f64::max))
    }

    /// How the lines of the ball turn, where `told` was made of this spin: as the spin that explains the pictures best, also where another
    /// one explains them almost as well or a direction is left free. Any of them tells what the next picture shows, which is all that learning
    /// the cover asks. `None` where no lines were seen or no turn of them explains the pictures.
    pub fn turning(&self, told: &SpinEstimate) -> Option<Vector3<f64>> {
        match told {
            SpinEstimate::Vector { omega_rad_s, .. } => Some(*omega_rad_s),
            SpinEstimate::OneAxis { .. } | SpinEstimate::Refused { reason: SpinRefusal::Ambiguous { .. } | SpinRefusal::TooUncertain { .. } } => {
                self.start.as_ref().map(|s| s.omega)
            }
            SpinEstimate::Refused { .. } => None,
        }
    }

    /// Which of the candidates is the ball's spin: on a coarse map, from every second pixel, without blur.
    fn among(candidates: &[Vector3<f64>], infos: &[ViewInfo], marks: &[Mark], shading: &Shading, settings: &SpinSettings) -> Self {
        let few: Vec<Mark> = marks.iter().copied().step_by(2).collect();
        let coarse_map = SphereMap::new(COARSE_EDGE);
        let coarse = Registrar::new(&coarse_map, infos, &few, shading, None);
        let Some(contest) = contest(&coarse, candidates, span_s(infos)) else {
            let seen = distinct_times(infos, settings.frame_rate_hz);
            return FoundSpin { rough: SpinEstimate::Refused { reason: SpinRefusal::TooFewFrames { seen, needed: LEAST_FRAMES } }, start: None };
        };
        Self::refined(contest, infos, marks, shading, settings)
    }

    /// The winner on a fine map, from all pixels, with blur.
    fn refined(contest: Contest, infos: &[ViewInfo], marks: &[Mark], shading: &Shading, settings: &SpinSettings) -> Self {
        let map = SphereMap::new(FINE_EDGE);
        let effort = Effort { memory_s: MEMORY_FRAMES / settings.frame_rate_hz, ..FIRST };
        let mut registrar = Registrar::new(&map, infos, marks, shading, Some(settings.blur_px));
        let first = registrar.refine_on_clear_views(contest.omega, &effort);
        let start = Start { contest, omega: first.omega, unexplained: unexplained(&first), markings: registrar.found(&first) };
        let rough = match refused(&first, &start.contest, settings, SETTLED.0) {
            Some(reason) => SpinEstimate::Refused { reason },
            None => held(infos, &first, first.omega, stated(&first, &first.model_covariance, infos) + start.contest.flat, &start.contest, settings),
        };
        FoundSpin { rough, start: Some(start) }
    }

    /// The spin from the same pictures, or from pictures with better centres, beginning where it was found.
    pub fn measure(&self, views: &[BallView], rig: &StereoRig, radius_m: f64, settings: &SpinSettings) -> SpinEstimate {
        let Some(start) = &self.start else { return self.rough.clone() };
        let sampled = sample_views(views, rig, radius_m);
        if let Some(reason) = unusable(&sampled, settings) {
            return SpinEstimate::Refused { reason };
        }
        let SampledViews { infos, samples, .. } = sampled;
        // The lines darken the first estimate of the shading where they pass most often; now that they are known, again.
        let map = SphereMap::new(FINE_EDGE);
        let (shading, marks) = divide_out(&infos, &samples, Some(&start.markings.at(&map, &infos, &samples)));
        let effort = Effort { memory_s: MEMORY_FRAMES / settings.frame_rate_hz, ..FINAL };
        let mut registrar = Registrar::new(&map, &infos, &marks, &shading, Some(settings.blur_px));
        let best = registrar.refine_on_clear_views(start.omega, &effort);
        if let Some(reason) = refused(&best, &start.contest, settings, SETTLED.1) {
            return SpinEstimate::Refused { reason };
        }
        // It was chosen among others where it was found, and nobody knows what is beside the place that it has come to.
        let step_rad_s = (best.omega - start.omega).norm();
        if step_rad_s * span_s(&infos) > SAME_VALLEY {
            return SpinEstimate::Refused { reason: SpinRefusal::Unsettled { step_rad_s } };
        }
        let on_first = stated(&best, &widened(&registrar, &best), &infos);
        let (omega, scatter) = over_cells(&registrar, &best.omega, &start.omega, &start.contest.near);
        held(&infos, &best, omega, on_first + scatter * CELLS_SHARE + start.contest.flat, &start.contest, settings)
    }
}

/// Why no spin can be seen in the pictures.
fn unusable(sampled: &SampledViews, settings: &SpinSettings) -> Option<SpinRefusal> {
    let SampledViews { infos, samples, overexposed } = sampled;
    if *overexposed > MOST_OVEREXPOSED * infos.len() {
        return Some(SpinRefusal::Overexposed { white: *overexposed, of: infos.len() + overexposed });
    }
    let seen = distinct_times(infos, settings.frame_rate_hz);
    let usable = samples.iter().filter(|s| !s.is_white()).count();
    (seen < LEAST_FRAMES || usable < LEAST_SAMPLES).then_some(SpinRefusal::TooFewFrames { seen, needed: LEAST_FRAMES })
}

/// The covariance that one registration states; `held` is the covariance of its curvature, perhaps widened.
fn stated(best: &Registration, held: &Matrix3<f64>, infos: &[ViewInfo]) -> Matrix3<f64> {
    let map_noise = 1.0 + NOISE_SHARE * (best.noise / best.texture).powi(2);
    let own = larger(held, &best.scatter_covariance) + misfit(&best.model_covariance, infos);
    let centres = held * best.centre_scores * held;
    let rate = best.omega.norm();
    let along_turn = turned_at_ends(ALONG_TURN_PX * unexplained(best), infos).powi(2) / rate.max(1.0).powi(2) + SYSTEMATIC_RATE.powi(2);
    own * map_noise + centres + best.omega * best.omega.transpose() * along_turn
}

/// Why a registration may not be believed.
fn refused(best: &Registration, contest: &Contest, settings: &SpinSettings, settled_rad_s: f64) -> Option<SpinRefusal> {
    let (omega, share) = (best.omega, unexplained(best));
    if best.texture < f64::max(LEAST_CONTRAST, 0.4 * best.noise) {
        Some(SpinRefusal::NoMarkings { contrast: best.texture, noise: best.noise })
    } else if omega.norm() > 0.98 * settings.limit_rad_s {
        Some(SpinRefusal::Aliased { rate_rad_s: omega.norm(), limit_rad_s: settings.limit_rad_s })
    } else if let Some(rival) = contest.rival {
        Some(SpinRefusal::Ambiguous { first: omega.into(), second: rival.into() })
    } else if best.last_step_rad_s > settled_rad_s {
        Some(SpinRefusal::Unsettled { step_rad_s: best.last_step_rad_s })
    } else {
        let (clear, noisy) = MOST_UNEXPLAINED;
        let most = clear + (noisy - clear) * (best.noise / best.texture).min(1.0);
        let [quiet, loud] = MOST_BY_NOISE;
        let most = most.min(quiet.1 + (loud.1 - quiet.1) * ((best.noise - quiet.0) / (loud.0 - quiet.0)).clamp(0.0, 1.0));
        let most = if contest.margin.is_some_and(|lead| lead < CLOSE_RIVAL) { most.min(MOST_WITH_RIVAL) } else { most };
        (share > most).then_some(SpinRefusal::Unexplained { share })
    }
}

/// How much of a believed spin its covariance holds: all of it, one axis, or nothing.
fn held(infos: &[ViewInfo], best: &Registration, omega: Vector3<f64>, covariance: Matrix3<f64>, contest: &Contest, settings: &SpinSettings) -> SpinEstimate {
    let quality = SpinQuality {
        views: infos.len(),
        pixels: best.residuals.len(),
        noise: best.noise,
        markings: best.texture,
        outliers: best.outliers,
        unexplained: unexplained(best),
        margin: contest.margin,
    };
    let frames_used = distinct_times(infos, settings.frame_rate_hz);
    let eigen = covariance.symmetric_eigen();
    let worst = eigen.eigenvalues.max().sqrt();
    let largest = LARGEST_SD.0.max(LARGEST_SD.1 * omega.norm());
    if worst <= largest {
        return SpinEstimate::Vector { omega_rad_s: omega, covariance, frames_used, quality };
    }
    // The direction of the spin itself when it is held, else the best-held direction.
    let along = omega.try_normalize(1e-9).map(|a| (a, a.dot(&(covariance * a)).sqrt())).filter(|(_, sd)| *sd <= largest);
    let (axis, sd) = along.unwrap_or_else(|| {
        let k = eigen.eigenvalues.imin();
        (eigen.eigenvectors.column(k).into(), eigen.eigenvalues[k].sqrt())
    });
    if sd <= largest {
        return SpinEstimate::OneAxis {
            axis,
            rate_rad_s: omega.dot(&axis),
            sd_rad_s: sd,
            frames_used,
            reason: format!("the markings leave one direction free (standard deviation {worst:.0} rad/s)"),
        };
    }
    SpinEstimate::Refused { reason: SpinRefusal::TooUncertain { sd_rad_s: sd } }
}

/// The mean spin over maps whose cells lie differently on the ball, and the scatter of one of them. Along a line that slides
/// along itself the cost is nearly flat, and the cells' own corners make dents in it, in one of which every registration
/// stays; on other cells the dents lie elsewhere. `near`: where else in the same valley to begin.
fn over_cells(registrar: &Registrar, on_first: &Vector3<f64>, start: &Vector3<f64>, near: &[Vector3<f64>]) -> (Vector3<f64>, Matrix3<f64>) {
    let on_others = (0..OTHER_CELLS).into_par_iter().with_max_len(1).map(|i| {
        // Attitudes far from one another and from the cube's own symmetries.
        let k = i as f64;
        let cells = Rotation3::new(Vector3::new((1.7 * k + 0.3).sin(), (2.9 * k + 1.0).cos(), (0.77 * k).sin()) * 1.3);
        registrar.refine_on(cells, *near.get(i).unwrap_or(start), &FINAL).omega
    });
    let mut all = vec![*on_first];
    all.par_extend(on_others);
    let mean = all.iter().sum::<Vector3<f64>>() / all.len() as f64;
    let scatter = all.iter().map(|w| (w - mean) * (w - mean).transpose()).sum::<Matrix3<f64>>() / (all.len() - 1) as f64;
    (mean, scatter)
}

/// What the best spin leaves over beyond the noise of most pixels, in units of the markings it explains. At a wrong spin the
/// markings themselves are what most pixels do not share.
fn unexplained(best: &Registration) -> f64 {
    let left = best.residuals.iter().map(|r| f64::from(r * r)).sum::<f64>() / best.residuals.len().max(1) as f64;
    (left - best.noise.powi(2)).max(0.0) / best.texture.powi(2).max(1e-12)
}

/// The covariance, wider along its longest axis where the cost itself rises more slowly than its curvature says: two
/// deviations to either side the log-likelihood should have fallen by two.
fn widened(registrar: &Registrar, best: &Registration) -> Matrix3<f64> {
    let eigen = best.model_covariance.symmetric_eigen();
    let k = eigen.eigenvalues.imax();
    let (axis, variance) = (eigen.eigenvectors.column(k), eigen.eigenvalues[k]);
    let reach = axis * (2.0 * variance.max(0.0).sqrt());
    let cost = |omega: &Vector3<f64>| registrar.cost_at(omega, best.noise, &FINAL);
    let rise = 0.5 * (cost(&(best.omega + reach)) + cost(&(best.omega - reach))) - cost(&best.omega);
    let factor = (2.0 / rise.max(0.05)).clamp(1.0, 40.0);
    best.model_covariance + axis * axis.transpose() * (variance * (factor - 1.0))
}

/// What frames of the same flight have in common and no scatter shows. In the direction that the markings hold best a
/// displacement is a turn of as much; what pulls there pulls elsewhere too, and moves the spin by so much more as the markings hold it
/// less: along a line that nearly slides along itself a hundredth of a pixel is worth many rad/s.
fn misfit(held: &Matrix3<f64>, views: &[ViewInfo]) -> Matrix3<f64> {
    let best_held = held.symmetric_eigenvalues().min().max(1e-12);
    held * held * (turned_at_ends(MISFIT_PX, views) / best_held).powi(2)
}

/// The spin, rad/s, whose markings are displaced by `px` from one end of the views' window to its middle.
fn turned_at_ends(px: f64, views: &[ViewInfo]) -> f64 {
    let radius_px = views.iter().map(|v| v.radius_px).sum::<f64>() / views.len().max(1) as f64;
    px / radius_px.max(1.0) / (0.5 * span_s(views)).max(1e-6)
}

fn span_s(views: &[ViewInfo]) -> f64 {
    let (first, last) = views.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v.time_s), b.max(v.time_s)));
    (last - first).max(0.0)
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
