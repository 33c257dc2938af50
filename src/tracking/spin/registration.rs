//! Registration: one spin vector, one map of markings, gains and shading, fitted together to all pixels.
//!
//! contrast(pixel) = map(Rᵀ n) + gain(view) + shading(camera, disc) + noise, with R = exp([ω] (t − t₀)) in global axes.
//! Gauss–Newton on ω with the map projected out at every step (variable projection, Golub and Pereyra 1973). Gains and shading
//! follow from what is left over between the steps.

use super::covered_views::clear_marks;
use super::map_equations::{MapEquations, right_of};
use super::pixels::{Design, Moment, Rows};
use super::shading::{Harmonics, Mark, Shading, factors, median_of_sizes};
use super::sphere_map::SphereMap;
use super::view::{Sample, TRACK_TERMS, ViewInfo};
use crate::calibration::CameraId;
use nalgebra::{Matrix3, Rotation3, Vector3};
use std::borrow::Cow;
use std::ops::Range;

/// Degrees of freedom of the Student-t that the residuals are weighted by: strings and frame in front of the ball.
const TAIL: f64 = 4.0;
/// Prior standard deviation of gain and shading corrections, contrast.
const NUISANCE_SD: f64 = 0.1;
/// One pixel of a camera in so many tells its shading.
const LIGHT_STEP: usize = 3;
/// Share of a pixel's own contrast by which the map may miss it: lines are narrower than its cells, and a pixel on a line that
/// the map has not found yet would count as a thing in front of the ball.
const MISSED_SHARE: f32 = 0.1;
/// Longest step, rad/s.
const LONGEST_STEP: f64 = 15.0;
/// Rounds of conjugate gradients for a map from nothing, and from the last step's map.
const ROUNDS: usize = 16;
const MORE_ROUNDS: usize = 8;

/// The fitted spin and how well it is held.
#[derive(Debug, Clone)]
pub(super) struct Registration {
    pub omega: Vector3<f64>,
    /// Inverse of the information about ω left after the map is fitted too, times the noise variance.
    pub model_covariance: Matrix3<f64>,
    /// From the scatter of the views' own contributions (sandwich): holds where residuals are correlated inside a view.
    pub scatter_covariance: Matrix3<f64>,
    /// Covariance of the score (slope of the log-likelihood along ω, the map fitted) by the errors of the centres.
    pub centre_scores: Matrix3<f64>,
    /// What the fit leaves at every pixel, contrast.
    pub residuals: Vec<f32>,
    /// Noise of one pixel of weight 1, contrast.
    pub noise: f64,
    /// Fitted markings at every pixel, contrast.
    pub markings: Vec<f32>,
    state: State,
    /// Root mean square of the fitted markings over the pixels, contrast.
    pub texture: f64,
    /// Length of the last step, rad/s.
    pub last_step_rad_s: f64,
    /// Pixels' share with robust weight below one half.
    pub outliers: f64,
}

/// How long to work on one registration.
#[derive(Debug, Clone, Copy)]
pub(super) struct Effort {
    /// Most Gauss–Newton steps.
    pub steps: usize,
    /// A step shorter than this is the last, rad/s.
    pub last_step_rad_s: f64,
    /// Whether gains and shading are fitted too.
    pub light: bool,
    /// Time over which one camera's residuals stay correlated, s; 0 when no covariance is asked for.
    pub memory_s: f64,
}

/// One camera's pixels: all, and some that tell the shading, with their harmonics.
struct Lit {
    own: Vec<usize>,
    some: Vec<usize>,
    of_own: Harmonics,
    of_some: Harmonics,
}

/// The markings of a turning ball.
#[derive(Debug, Clone)]
pub(super) struct FoundMarkings {
    omega: Vector3<f64>,
    middle_s: f64,
    map: Vec<f32>,
    shading: Shading,
    blur_px: Option<[f64; 2]>,
}

impl FoundMarkings {
    /// Contrast at every sample; `map` is laid out as the one they were found on.
    pub fn at(&self, map: &SphereMap, views: &[ViewInfo], samples: &[Sample]) -> Vec<f32> {
        let back = turned_back(views, &self.omega, self.middle_s, &Rotation3::identity());
        let mut looks_at = Rows::default();
        let mut of_view = vec![0..0; views.len()];
        for (i, s) in samples.iter().enumerate() {
            let view = &views[s.view];
            looks_at.push(&(view.axes * blurred_direction(&s.disc, &self.shading, view, self.blur_px)));
            of_view[s.view] = if of_view[s.view].is_empty() { i..i + 1 } else { of_view[s.view].start..i + 1 };
        }
        let mut design = Design::new(samples.len(), Rotation3::identity());
        design.turn(map, &looks_at, &of_view, &back);
        design.spots.values(&map.by_cell(&self.map))
    }
}

/// Rotations from global axes to those of the map's cells, which turn with the ball, by view.
fn turned_back(views: &[ViewInfo], omega: &Vector3<f64>, middle_s: f64, cells: &Rotation3<f64>) -> Vec<[[f32; 3]; 3]> {
    let back = |v: &ViewInfo| {
        let r = cells * Rotation3::new(-omega * (v.time_s - middle_s));
        std::array::from_fn(|i| std::array::from_fn(|j| r[(i, j)] as f32))
    };
    views.iter().map(back).collect()
}

pub(super) struct Registrar<'a> {
    map: &'a SphereMap,
    views: &'a [ViewInfo],
    marks: Cow<'a, [Mark]>,
    shading: &'a Shading,
    blur_px: Option<[f64; 2]>,
    /// By pixel: contrast, weight and its root, and the variance that the map may miss, times the weight.
    contrasts: Vec<f32>,
    weights: Vec<f32>,
    roots: Vec<f32>,
    missed: Vec<f32>,
    lit: [Lit; 2],
    /// By view: its pixels.
    of_view: Vec<Range<usize>>,
    /// Where on the ball, in global axes, each pixel looks on the whole.
    looks_at: Rows,
    middle_s: f64,
    variance: f32,
}

/// Everything but ω.
#[derive(Debug, Clone)]
struct State {
    map: Vec<f32>,
    /// Gain and shading at every pixel, contrast.
    light: Vec<f32>,
    robust: Vec<f32>,
    noise: f64,
}

#[derive(Default)]
struct Information {
    model_covariance: Matrix3<f64>,
    scatter_covariance: Matrix3<f64>,
    centre_scores: Matrix3<f64>,
    information: Matrix3<f64>,
}

impl<'a> Registrar<'a> {
    /// Without `blur_px` every pixel looks at one point of the ball.
    pub fn new(map: &'a SphereMap, views: &'a [ViewInfo], marks: &'a [Mark], shading: &'a Shading, blur_px: Option<[f64; 2]>) -> Self {
        Registrar::of(map, views, Cow::Borrowed(marks), shading, blur_px)
    }

    fn of(map: &'a SphereMap, views: &'a [ViewInfo], marks: Cow<'a, [Mark]>, shading: &'a Shading, blur_px: Option<[f64; 2]>) -> Self {
        let middle_s = marks.iter().map(|m| views[m.view].time_s).sum::<f64>() / marks.len().max(1) as f64;
        let total: f64 = marks.iter().map(|m| m.weight).sum();
        let variance = marks.iter().map(|m| m.weight * m.contrast * m.contrast).sum::<f64>() / total.max(1e-12);
        let mut looks_at = Rows::default();
        for m in marks.iter() {
            let view = &views[m.view];
            looks_at.push(&(view.axes * blurred_direction(&m.disc, shading, view, blur_px)));
        }
        let of_view = (0..views.len()).map(|view| marks.partition_point(|m| m.view < view)..marks.partition_point(|m| m.view <= view)).collect();
        let (contrasts, weights): (Vec<f32>, Vec<f32>) = marks.iter().map(|m| (m.contrast as f32, m.weight as f32)).unzip();
        let roots = weights.iter().map(|w| w.sqrt()).collect();
        let missed = weights.iter().zip(&contrasts).map(|(w, c)| w * (MISSED_SHARE * c).powi(2)).collect();
        let lit = CameraId::BOTH.map(|camera| {
            let own: Vec<usize> = (0..marks.len()).filter(|&i| views[marks[i].view].camera == camera).collect();
            let some: Vec<usize> = own.iter().copied().step_by(LIGHT_STEP).collect();
            // The views' gains are the constants.
            let harmonics = |of: &[usize]| Harmonics::of(of.iter().map(|&i| factors(0.0, &marks[i].disc)));
            Lit { of_own: harmonics(&own), of_some: harmonics(&some), own, some }
        });
        Registrar {
            map,
            views,
            marks,
            shading,
            blur_px,
            contrasts,
            weights,
            roots,
            missed,
            lit,
            of_view,
            looks_at,
            middle_s,
            variance: variance.max(1e-6) as f32,
        }
    }

    /// Every pixel's relative information: of its noise, and of what the map may miss there.
    fn informed(&self, noise: f64) -> Vec<f32> {
        pulp::Arch::new().dispatch(Informed { weights: &self.weights, missed: &self.missed, precision: (noise * noise).recip() as f32 })
    }

    /// What a registration has found.
    pub fn found(&self, registration: &Registration) -> FoundMarkings {
        FoundMarkings {
            omega: registration.omega,
            middle_s: self.middle_s,
            map: registration.state.map.clone(),
            shading: self.shading.clone(),
            blur_px: self.blur_px,
        }
    }

    /// Refines from `start`, and where something passes before the ball in some pictures once more without those: they are gone from here on.
    pub fn refine_on_clear_views(&mut self, start: Vector3<f64>, effort: &Effort) -> Registration {
        let first = self.refine(start, effort);
        let Some(clear) = clear_marks(&first.residuals, &self.marks, self.views.len()) else { return first };
        *self = Registrar::of(self.map, self.views, Cow::Owned(clear), self.shading, self.blur_px);
        self.refine(start, effort)
    }

    /// Refines from `start`.
    pub fn refine(&self, start: Vector3<f64>, effort: &Effort) -> Registration {
        self.refine_on(Rotation3::identity(), start, effort)
    }

    /// The same on a map whose cells lie otherwise on the ball.
    pub fn refine_on(&self, cells: Rotation3<f64>, start: Vector3<f64>, effort: &Effort) -> Registration {
        let mut omega = start;
        let mut design = Design::new(self.marks.len(), cells);
        self.design(&omega, &mut design);
        let mut state = self.first_map(&design, effort);
        let (mut length, mut sizes) = (0.0, Vector3::repeat(1.0));
        // Curvature of the cost and the last step with the score before it, all in units of 1 / noise².
        let mut curvature: Option<Matrix3<f64>> = None;
        let mut before: Option<(Vector3<f64>, Vector3<f64>)> = None;
        for last in (0..effort.steps).rev() {
            let (equations, weights) = self.equations(&design, &state);
            equations.solve(&equations.right, &mut state.map, MORE_ROUNDS);
            let slopes = self.omega_slopes(&design, &omega, &state.map);
            let unit = state.noise * state.noise;
            let score = self.score(&design, &state, &slopes, &weights) * unit;
            let mut holds = match curvature {
                Some(holds) => holds,
                None => {
                    let found = self.information(&design, &state, &slopes, &equations, &weights, 0.0);
                    sizes = found.model_covariance.diagonal().map(f64::sqrt);
                    found.information * unit
                }
            };
            if let Some((step, earlier)) = before {
                holds = secant(&holds, &step, &(earlier - score));
            }
            curvature = Some(holds);
            let mut step = holds.try_inverse().unwrap_or_else(Matrix3::zeros) * score;
            length = step.norm();
            if last == 0 || length < effort.last_step_rad_s || step.component_div(&sizes).norm() < 0.2 {
                break;
            }
            // A curvature learnt from tiny steps may be nonsense.
            let longest = before.map_or(LONGEST_STEP, |(step, _)| LONGEST_STEP.min(3.0 * step.norm()));
            if length > longest {
                step *= longest / length;
            }
            omega += step;
            before = Some((step, score));
            self.design(&omega, &mut design);
            self.settle(&design, &mut state, effort.light);
        }
        let information = (effort.memory_s > 0.0).then(|| {
            let (equations, weights) = self.equations(&design, &state);
            let slopes = self.omega_slopes(&design, &omega, &state.map);
            self.information(&design, &state, &slopes, &equations, &weights, effort.memory_s)
        });
        self.finish(omega, &design, state, information, length)
    }

    fn finish(&self, omega: Vector3<f64>, design: &Design, state: State, information: Option<Information>, length: f64) -> Registration {
        let markings = self.markings(design, &state.map);
        let residuals = self.residuals(&markings, &state);
        let Information { model_covariance, scatter_covariance, centre_scores, .. } = information.unwrap_or_default();
        let count = markings.len().max(1) as f64;
        let texture = (markings.iter().map(|m| f64::from(m * m)).sum::<f64>() / count).sqrt();
        let outliers = state.robust.iter().filter(|&&w| w < 0.5).count() as f64 / count;
        Registration {
            omega,
            model_covariance,
            scatter_covariance,
            centre_scores,
            residuals,
            noise: state.noise,
            markings,
            state,
            texture,
            last_step_rad_s: length,
            outliers,
        }
    }

    /// Robust cost at a fixed spin, everything else fitted.
    pub fn cost_at(&self, omega: &Vector3<f64>, noise: f64, effort: &Effort) -> f64 {
        let mut design = Design::new(self.marks.len(), Rotation3::identity());
        self.design(omega, &mut design);
        let state = self.first_map(&design, effort);
        self.cost(&self.residuals(&self.markings(&design, &state.map), &state), noise)
    }

    /// The map at the start's attitude, without turning it: the slopes need a map first.
    fn first_map(&self, design: &Design, effort: &Effort) -> State {
        let sizes: Vec<f32> = self.contrasts.iter().zip(&self.roots).map(|(c, r)| (c * r).abs()).collect();
        let noise = f64::from(1.5 * median_of_sizes(&sizes)).max(1e-4);
        let mut state = State { map: vec![0.0; self.map.nodes()], light: vec![0.0; self.marks.len()], robust: vec![1.0; self.marks.len()], noise };
        for rounds in [ROUNDS, MORE_ROUNDS] {
            let (equations, _) = self.equations(design, &state);
            equations.solve(&equations.right, &mut state.map, rounds);
            self.settle(design, &mut state, effort.light);
        }
        state
    }

    /// Gains, shading, weights and noise from what the map leaves over.
    fn settle(&self, design: &Design, state: &mut State, light: bool) {
        let markings = self.markings(design, &state.map);
        if light {
            self.settle_light(&markings, state);
        }
        let (contrasts, light, informed) = (&self.contrasts, &state.light, &self.informed(state.noise));
        let scaled = pulp::Arch::new().dispatch(Scaled { contrasts, markings: &markings, light, informed });
        let noise = (1.4826 * median_of_sizes(&scaled)).max(1e-4);
        state.noise = f64::from(noise);
        pulp::Arch::new().dispatch(Robust { scaled: &scaled, noise, robust: &mut state.robust });
    }

    fn design(&self, omega: &Vector3<f64>, design: &mut Design) {
        let back = turned_back(self.views, omega, self.middle_s, &design.cells);
        design.turn(self.map, &self.looks_at, &self.of_view, &back);
        design.omega = *omega;
    }

    fn markings(&self, d: &Design, map: &[f32]) -> Vec<f32> {
        d.spots.values(&self.map.by_cell(map))
    }

    fn residuals(&self, markings: &[f32], state: &State) -> Vec<f32> {
        self.contrasts.iter().zip(markings).zip(&state.light).map(|((contrast, on), light)| contrast - on - light).collect()
    }

    /// Every pixel's weight, one over its variance.
    fn precisions(&self, state: &State) -> Vec<f32> {
        let scale = (state.noise * state.noise).recip() as f32;
        state.robust.iter().zip(&self.informed(state.noise)).map(|(r, w)| r * w * scale).collect()
    }

    /// The map's normal equations, and every pixel's weight.
    fn equations(&self, d: &Design, state: &State) -> (MapEquations<'a>, Vec<f32>) {
        let weights = self.precisions(state);
        let values: Vec<f32> = self.contrasts.iter().zip(&state.light).map(|(contrast, light)| contrast - light).collect();
        (MapEquations::new(self.map, &d.spots, &values, &weights, self.variance), weights)
    }

    /// Gain per view and shading per camera from what the map leaves over, each with its prior.
    fn settle_light(&self, markings: &[f32], state: &mut State) {
        let prior = NUISANCE_SD.powi(-2);
        let left: Vec<f32> = self.contrasts.iter().zip(markings).map(|(contrast, on)| contrast - on).collect();
        let weights = self.precisions(state);
        for lit in &self.lit {
            let values: Vec<f32> = lit.some.iter().map(|&i| left[i]).collect();
            let of_some: Vec<f32> = lit.some.iter().map(|&i| LIGHT_STEP as f32 * weights[i]).collect();
            let Some(coefficients) = lit.of_some.least_squares(&values, &of_some, prior) else { continue };
            for (&i, light) in lit.own.iter().zip(lit.of_own.sums(&coefficients)) {
                state.light[i] = light;
            }
        }
        for pixels in &self.of_view {
            let (weights, left, light) = (&weights[pixels.clone()], &left[pixels.clone()], &mut state.light[pixels.clone()]);
            let pull = weights.iter().zip(left).zip(light.iter()).map(|((w, left), light)| w * (left - light)).sum::<f32>();
            let gain = pull / (prior as f32 + weights.iter().sum::<f32>());
            light.iter_mut().for_each(|light| *light += gain);
        }
    }

    /// d contrast / d ω of every pixel: (t − t₀) Jᵀ R (∇map × Rᵀ n), J the left Jacobian of the rotation.
    fn omega_slopes(&self, d: &Design, omega: &Vector3<f64>, map: &[f32]) -> [Vec<f32>; 3] {
        let mut slopes = self.map.gradients(d.body.of(&(0..self.marks.len())), &d.spots, &self.map.by_cell(map));
        for (pixels, v) in self.of_view.iter().zip(self.views) {
            let t = v.time_s - self.middle_s;
            let m = (left_jacobian(&(omega * t)).transpose() * t) * (Rotation3::new(omega * t) * d.cells.inverse()).matrix();
            let by = std::array::from_fn(|i| std::array::from_fn(|j| m[(i, j)] as f32));
            pulp::Arch::new().dispatch(Moment { by, body: d.body.of(pixels), slopes: slopes.each_mut().map(|row| &mut row[pixels.clone()]) });
        }
        slopes
    }

    /// Slope of the log-likelihood along ω; the map is at its best, so that it has no part in it.
    fn score(&self, d: &Design, state: &State, slopes: &[Vec<f32>; 3], weights: &[f32]) -> Vector3<f64> {
        let residuals = self.residuals(&self.markings(d, &state.map), state);
        let weighted: Vec<f32> = residuals.iter().zip(weights).map(|(r, w)| r * w).collect();
        Vector3::from_fn(|k, _| {
            let products = |(slopes, weighted): (&[f32], &[f32])| slopes.iter().zip(weighted).map(|(s, w)| s * w).sum::<f32>();
            slopes[k].chunks(64).zip(weighted.chunks(64)).map(|some| f64::from(products(some))).sum()
        })
    }

    /// Covariance from the curvature with the map profiled out and, where residuals stay correlated for a time, from the scatter of
    /// the views' scores.
    fn information(&self, d: &Design, state: &State, slopes: &[Vec<f32>; 3], e: &MapEquations, weights: &[f32], memory_s: f64) -> Information {
        // What a change of the map can imitate of the slopes: taken out of them.
        let imitation = |slopes: &[f32]| {
            let mut x = vec![0.0; self.map.nodes()];
            e.solve(&right_of(self.map, &d.spots, slopes, weights), &mut x, ROUNDS);
            d.spots.values(&self.map.by_cell(&x))
        };
        let (first, (second, third)) = rayon::join(|| imitation(&slopes[0]), || rayon::join(|| imitation(&slopes[1]), || imitation(&slopes[2])));
        let imitated = [first, second, third];
        let own = |i: usize| Vector3::from_fn(|k, _| f64::from(slopes[k][i]) - f64::from(imitated[k][i]));
        let mut information = Matrix3::identity() * 1e-6;
        for (i, w) in weights.iter().enumerate() {
            information += own(i) * Vector3::from_fn(|k, _| f64::from(slopes[k][i])).transpose() * f64::from(*w);
        }
        information = 0.5 * (information + information.transpose());
        let covariance = information.try_inverse().unwrap_or_else(|| Matrix3::identity() * 1e6);
        if memory_s <= 0.0 {
            return Information { model_covariance: covariance, information, ..Information::default() };
        }
        let gradients = self.map.gradients(d.body.of(&(0..self.marks.len())), &d.spots, &self.map.by_cell(&state.map));
        let residuals = self.residuals(&self.markings(d, &state.map), state);
        let mut scores = vec![Vector3::zeros(); self.views.len()];
        // What the score gains when a picture's disc moves a pixel to the right, and down.
        let mut moved = vec![[Vector3::<f64>::zeros(); 2]; self.views.len()];
        let to_body: Vec<Matrix3<f64>> = turned_back(self.views, &d.omega, self.middle_s, &d.cells)
            .iter()
            .zip(self.views)
            .map(|(back, v)| Matrix3::from_fn(|i, k| f64::from(back[i][k])) * v.axes)
            .collect();
        for (i, ((&w, r), m)) in weights.iter().zip(&residuals).zip(self.marks.iter()).enumerate() {
            let own = own(i);
            scores[m.view] += own * f64::from(w * r);
            let slope = to_body[m.view].tr_mul(&Vector3::from_fn(|k, _| f64::from(gradients[k][i]))) / self.views[m.view].radius_px;
            for (moved, (along, at)) in moved[m.view].iter_mut().zip([(slope.x, m.disc.x), (slope.y, m.disc.y)]) {
                *moved += own * (f64::from(w) * (along - slope.z * at / m.disc.z));
            }
        }
        // What the model misses (a line's edge, a step of the shading) stays nearly the same from one frame to the next:
        // scores of neighbouring frames of one camera count as correlated, with weights falling to 0 (Newey and West 1987).
        let mut scatter = Matrix3::zeros();
        for (a, v) in scores.iter().zip(self.views) {
            for (b, u) in scores.iter().zip(self.views).filter(|(_, u)| u.camera == v.camera) {
                let near = 1.0 - (v.time_s - u.time_s).abs() / memory_s.max(1e-12);
                if near > 0.0 {
                    scatter += a * b.transpose() * near;
                }
            }
        }
        let n = scores.len() as f64;
        let c = covariance * scatter * covariance * (n / (n - 3.0).max(1.0));
        let mut centre_scores = Matrix3::zeros();
        for camera in CameraId::BOTH {
            for (error, side) in (0..TRACK_TERMS).flat_map(|k| [(k, 0), (k, 1)]) {
                let own = self.views.iter().zip(&moved).filter(|(v, _)| v.camera == camera);
                let pull: Vector3<f64> = own.map(|(v, moved)| moved[side] * v.centre_errors[error]).sum();
                centre_scores += pull * pull.transpose();
            }
        }
        Information { model_covariance: covariance, centre_scores, scatter_covariance: 0.5 * (c + c.transpose()), information }
    }

    /// Robust cost of residuals at a common noise: Student-t log-likelihood ratio, so that 2 × difference is a χ².
    pub fn cost(&self, residuals: &[f32], noise: f64) -> f64 {
        let scale = (noise * noise * TAIL).recip();
        // The logarithm of a product of eight is eight logarithms.
        let terms: Vec<f64> = residuals.iter().zip(&self.informed(noise)).map(|(r, w)| 1.0 + f64::from(r * r) * f64::from(*w) * scale).collect();
        0.5 * (TAIL + 1.0) * terms.chunks(8).map(|c| c.iter().product::<f64>().ln()).sum::<f64>()
    }
}

/// Curvature that agrees with how the score changed over the last step (Broyden, Fletcher, Goldfarb and Shanno 1970): the map's
/// noise has slopes that look like information, and the weights follow a step only by and by, so that Gauss and Newton's
/// curvature is up to four times too large.
fn secant(holds: &Matrix3<f64>, step: &Vector3<f64>, change: &Vector3<f64>) -> Matrix3<f64> {
    let expected = holds * step;
    let (along, usual) = (step.dot(change), step.dot(&expected));
    // Damped, so that the curvature stays positive (Powell 1978).
    let share = if along < 0.15 * usual { 0.85 * usual / (usual - along).max(1e-300) } else { 1.0 };
    let change = change * share + expected * (1.0 - share);
    holds + change * change.transpose() / step.dot(&change).max(1e-300) - expected * expected.transpose() / usual.max(1e-300)
}

/// Where a line lies that a pixel sees in the middle of it. The lens blurs light, not contrast: on a slope of the shading a
/// line seems to move toward the dark, by the blur's variance times the slope of the light's logarithm. (The mean direction
/// under the blur would lie farther out still, but lines are narrower than the blur, and a line's blurred picture is
/// symmetric about its place in the picture, not on the ball; docs/spin-experiments.md, "Blur in the present map".)
fn blurred_direction(disc: &Vector3<f64>, shading: &Shading, view: &ViewInfo, blur_px: Option<[f64; 2]>) -> Vector3<f64> {
    const H: f64 = 0.02;
    let Some(blur_px) = blur_px else { return *disc };
    let variance = (blur_px[view.camera.index()] / view.radius_px).powi(2);
    let light = |dx: f64, dy: f64| {
        let (x, y) = (disc.x + dx, disc.y + dy);
        shading.at(view.camera, &Vector3::new(x, y, (1.0 - x * x - y * y).max(0.01).sqrt()))
    };
    let here = light(0.0, 0.0);
    let slope = |there: f64| variance * (there - here) / (H * here);
    let (x, y) = (disc.x + slope(light(H, 0.0)), disc.y + slope(light(0.0, H)));
    Vector3::new(x, y, (1.0 - x * x - y * y).max(0.01).sqrt()).normalize()
}

struct Informed<'a> {
    weights: &'a [f32],
    missed: &'a [f32],
    precision: f32,
}

impl pulp::NullaryFnOnce for Informed<'_> {
    type Output = Vec<f32>;

    #[inline(always)]
    fn call(self) -> Vec<f32> {
        self.weights.iter().zip(self.missed).map(|(w, m)| w / (1.0 + m * self.precision)).collect()
    }
}

/// What is left over at every pixel in units of what a pixel of weight 1 is uncertain by.
struct Scaled<'a> {
    contrasts: &'a [f32],
    markings: &'a [f32],
    light: &'a [f32],
    informed: &'a [f32],
}

impl pulp::NullaryFnOnce for Scaled<'_> {
    type Output = Vec<f32>;

    #[inline(always)]
    fn call(self) -> Vec<f32> {
        let on_and_light = self.markings.iter().zip(self.light);
        self.contrasts.iter().zip(on_and_light).zip(self.informed).map(|((contrast, (on, light)), w)| (contrast - on - light).abs() * w.sqrt()).collect()
    }
}

/// Weights of a Student-t's residuals.
struct Robust<'a> {
    scaled: &'a [f32],
    noise: f32,
    robust: &'a mut [f32],
}

impl pulp::NullaryFnOnce for Robust<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let (tail, per_noise) = (TAIL as f32, 1.0 / self.noise);
        for (w, s) in self.robust.iter_mut().zip(self.scaled) {
            *w = ((tail + 1.0) / (tail + (s * per_noise) * (s * per_noise))).min(1.0);
        }
    }
}

/// Left Jacobian of the exponential map: exp(φ + δ) = exp(J(φ) δ) exp(φ) to first order.
fn left_jacobian(phi: &Vector3<f64>) -> Matrix3<f64> {
    let angle = phi.norm();
    let k = phi.cross_matrix();
    let (a, b) = if angle < 1e-4 { (0.5, 1.0 / 6.0) } else { ((1.0 - angle.cos()) / (angle * angle), (angle - angle.sin()) / angle.powi(3)) };
    Matrix3::identity() + k * a + k * k * b
}
