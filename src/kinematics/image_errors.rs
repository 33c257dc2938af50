//! How far off ball and tape are seen, learnt from what the motions of a session's shots leave over.
//!
//! Two cameras give four image coordinates of a ball that has three, and twenty of a racket that has six; over a window the laws
//! of motion leave far fewer numbers free still. What the image points have left over tells, without any truth, how large the
//! errors are that last from frame to frame: those deviations are taken under which the leftovers of all windows are most
//! likely, the motions integrated out (restricted maximum likelihood), within what rendered sessions with known truth showed.

use super::lasting_error::{LastingError, Whitener, WindowErrors};
use super::sighting::{Sighting, groups};
use crate::tracking::{RacketFigure, Target};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

/// How long a ball's error lasts, s, and by how much a racket turns until another side of a band is seen, rad. (Rendered
/// sessions with known truth: 3 to 8 ms, 0.35 to 0.75 rad.)
const BALL_MEMORY_S: f64 = 0.0055;
const TAPE_MEMORY_RAD: f64 = 0.5;
/// What is expected before anything was seen, px: constant and wandering part, of the ball, of bands on the head, and in the
/// throat, whose tubes' direction and width are not in racket.toml.
const EXPECTED_PX: [(f64, f64); 3] = [(0.012, 0.020), (0.025, 0.030), (0.045, 0.050)];
/// One deviation of the logarithm of these from session to session.
const LN_SD: f64 = 0.7;
/// A ball's errors over what its flight leaves over of them, constant and wandering part: what both cameras see alike looks like a
/// place, what changes along the path like a speed. (Rendered sessions with known truth: the wandering part 1.0 to 1.2 in the
/// laboratory, 1.2 to 1.4 on court; the constant one, of which hardly anything is left over, 1.5 to 3.)
const BALL_UNSEEN: (f64, f64) = (2.0, 1.35);
/// Factors by which the search moves one deviation, coarse to fine.
const STEPS: [f64; 3] = [1.6, 1.25, 1.1];

/// Errors of what is seen in pictures that last from frame to frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImageErrors {
    pub ball: LastingError,
    /// Bands on the head, and in the throat.
    pub head: LastingError,
    pub throat: LastingError,
}

impl ImageErrors {
    /// Before anything was seen.
    pub fn expected() -> Self {
        Self::of_sizes(&EXPECTED_PX)
    }

    fn of_sizes(sizes: &[(f64, f64); 3]) -> Self {
        let error = |k: usize, memory: f64| LastingError { constant_px: sizes[k].0, wander_px: sizes[k].1, memory };
        ImageErrors { ball: error(0, BALL_MEMORY_S), head: error(1, TAPE_MEMORY_RAD), throat: error(2, TAPE_MEMORY_RAD) }
    }

    /// By target.
    pub(crate) fn by_target(&self, figure: &RacketFigure) -> [LastingError; 6] {
        let mut of = [self.head; 6];
        figure.in_throat().for_each(|k| of[k] = self.throat);
        of[Target::Ball.index()] = self.ball;
        of
    }

    /// The errors under which what these windows left over is most likely.
    pub fn learnt(leftovers: &[Leftover]) -> Self {
        let (balls, rackets): (Vec<&Leftover>, Vec<&Leftover>) = leftovers.iter().partition(|l| l.is_of_ball());
        let mut sizes = EXPECTED_PX;
        // A flight says nothing of tape, a racket's window nothing of the ball.
        for (windows, classes) in [(balls, 0..1), (rackets, 1..3)] {
            let mut best = cost(&windows, &sizes);
            for step in STEPS {
                while let Some((cost, better)) = neighbours(&sizes, classes.clone(), step)
                    .into_par_iter()
                    .map(|s| (cost(&windows, &s), s))
                    .collect::<Vec<_>>()
                    .into_iter()
                    .min_by(|a, b| a.0.total_cmp(&b.0))
                    .filter(|(c, _)| *c < best - 1e-3)
                {
                    (best, sizes) = (cost, better);
                }
            }
        }
        sizes[0] = (sizes[0].0 * BALL_UNSEEN.0, sizes[0].1 * BALL_UNSEEN.1);
        Self::of_sizes(&sizes)
    }
}

/// Every deviation of the classes one step up and one down.
fn neighbours(sizes: &[(f64, f64); 3], classes: std::ops::Range<usize>, step: f64) -> Vec<[(f64, f64); 3]> {
    let mut all = Vec::new();
    for class in classes {
        for factor in [step, 1.0 / step] {
            let (mut constant, mut wander) = (*sizes, *sizes);
            constant[class].0 *= factor;
            wander[class].1 *= factor;
            all.extend([constant, wander]);
        }
    }
    all
}

/// Minus twice the logarithm of the likelihood and of what is expected, up to a constant.
fn cost(windows: &[&Leftover], sizes: &[(f64, f64); 3]) -> f64 {
    let errors = ImageErrors::of_sizes(sizes);
    let seen: f64 = windows.iter().filter_map(|w| w.cost(&errors)).sum();
    let ln = |size: f64, expected: f64| ((size / expected).ln() / LN_SD).powi(2);
    seen + sizes.iter().zip(EXPECTED_PX).map(|(s, e)| ln(s.0, e.0) + ln(s.1, e.1)).sum::<f64>()
}

/// What a window's motion left over: raw residuals, px, and their derivatives by the motion's unknowns.
#[derive(Debug, Clone)]
pub struct Leftover {
    sightings: Vec<Sighting>,
    throat: Vec<usize>,
    change_per_s: f64,
    /// Rows 2i and 2i + 1 belong to sighting i, px; those beyond are what was known of the motion before, in deviations. The
    /// last column holds the residuals, the others the derivatives.
    rows: DMatrix<f64>,
    /// Factor on the sightings' own deviations.
    scale: f64,
}

impl Leftover {
    pub(crate) fn new(sightings: Vec<Sighting>, figure: &RacketFigure, change_per_s: f64, residuals: &DVector<f64>, derivatives: DMatrix<f64>) -> Self {
        let scale = own_scale(&sightings, residuals);
        let mut rows = derivatives;
        let last = rows.ncols();
        rows = rows.insert_column(last, 0.0);
        rows.set_column(last, residuals);
        Leftover { throat: figure.in_throat().collect(), sightings, change_per_s, rows, scale }
    }

    fn is_of_ball(&self) -> bool {
        self.sightings.first().is_some_and(|s| s.target == Target::Ball)
    }

    /// Minus twice the logarithm of the likelihood of the residuals, the motion integrated out, up to a constant. `None` when
    /// the points do not determine the motion.
    fn cost(&self, errors: &ImageErrors) -> Option<f64> {
        let mut of = [errors.head; 6];
        self.throat.iter().for_each(|&k| of[k] = errors.throat);
        of[Target::Ball.index()] = errors.ball;
        let whitener = Whitener::new(&self.sightings, &WindowErrors { of, change_per_s: self.change_per_s }, self.scale)?;
        let rows = whitener.matrix(&self.rows);
        // The root of the whole normal matrix: its last diagonal element is the length of what no motion explains.
        let root = rows.tr_mul(&rows).cholesky()?.unpack();
        let unknowns = root.ncols() - 1;
        let motion: f64 = (0..unknowns).map(|k| 2.0 * root[(k, k)].ln()).sum();
        let cost = whitener.ln_det() + motion + root[(unknowns, unknowns)].powi(2);
        cost.is_finite().then_some(cost)
    }
}

/// Factor on the deviations that the residuals' changes from one frame to the next ask for: what lasts does not enter.
fn own_scale(sightings: &[Sighting], residuals: &DVector<f64>) -> f64 {
    let (mut seen, mut stated) = (0.0, 0.0);
    for range in groups(sightings) {
        for i in range.start..range.end.saturating_sub(1) {
            if sightings[i + 1].frame != sightings[i].frame + 1 {
                continue;
            }
            for axis in 0..2 {
                let variance = |k: usize| sightings[k].sd[axis].powi(2);
                let difference = residuals[2 * (i + 1) + axis] - residuals[2 * i + axis];
                // Each in its own deviations: one bad point must not speak for the window.
                seen += (difference.powi(2) / (variance(i) + variance(i + 1))).min(9.0);
                stated += 1.0;
            }
        }
    }
    if stated > 0.0 { (seen / stated).sqrt().max(0.05) } else { 1.0 }
}
