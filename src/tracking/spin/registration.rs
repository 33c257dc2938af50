//! Registration: one spin vector, one map of markings, gains and shading, fitted together to all pixels.
//!
//! contrast(pixel) = map(Rᵀ n) + gain(view) + shading(camera, disc) + noise, with R = exp([ω] (t − t₀)) in global axes.
//! Gauss–Newton on everything at once; the linear system is solved by conjugate gradients over the pixels. The prior of
//! the map's coefficients is a zero-mean normal, so that the fit is a Gaussian-process regression of the markings.

use super::shading::{Mark, Shading, TERMS, median, terms};
use super::sphere_map::{KernelRow, SphereMap};
use super::view::ViewInfo;
use nalgebra::{Matrix3, Rotation3, Vector3};

/// Degrees of freedom of the Student-t that the residuals are weighted by: strings and frame in front of the ball.
const TAIL: f64 = 4.0;
/// Prior standard deviation of gain and shading corrections, contrast.
const NUISANCE_SD: f64 = 0.1;

/// The fitted spin and how well it is held.
#[derive(Debug, Clone)]
pub(super) struct Registration {
    pub omega: Vector3<f64>,
    /// Inverse of the information about ω left after map, gains and shading are fitted too, times the noise variance.
    pub model_covariance: Matrix3<f64>,
    /// From the scatter of the views' own contributions (sandwich): holds where residuals are correlated inside a view.
    pub scatter_covariance: Matrix3<f64>,
    /// Robust cost: Σ weight ρ(residual / noise), for comparing solutions on the same pixels at a common noise.
    pub residuals: Vec<f64>,
    /// Noise of one pixel of weight 1, contrast.
    pub noise: f64,
    /// Fitted markings at every pixel, contrast.
    pub markings: Vec<f64>,
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
    /// Rounds of conjugate gradients per step. Each step starts from the last one's map, and what a dozen rounds have
    /// not reached are smooth shifts between map and shading that do not touch ω (docs/spin.md, "Rounds").
    pub rounds: usize,
    pub covariance: bool,
    /// Time over which one camera's residuals stay correlated, s.
    pub memory_s: f64,
}

/// Most steps with everything but ω projected out.
const POLISH: usize = 5;

struct Information {
    model_covariance: Matrix3<f64>,
    scatter_covariance: Matrix3<f64>,
    step: Vector3<f64>,
}

/// The pixel's row of the design: kernels, then shading, then gain.
struct Row {
    start: usize,
    end: usize,
    shading: [f64; TERMS],
    /// Offset of the camera's shading unknowns.
    camera_at: usize,
    view_at: usize,
}

struct Design {
    rows: Vec<Row>,
    node: Vec<u16>,
    value: Vec<f64>,
    /// d value / d (small turn of the ball's attitude), body axes.
    moment: Vec<Vector3<f64>>,
    unknowns: usize,
    prior: Vec<f64>,
    omega_at: usize,
}

pub(super) struct Registrar<'a> {
    map: &'a SphereMap,
    views: &'a [ViewInfo],
    marks: &'a [Mark],
    shading: &'a Shading,
    middle_s: f64,
    /// Prior precision of a kernel coefficient in units of 1 / contrast².
    map_precision: f64,
    /// Points of the blur's quadrature: shift on the disc in standard deviations, weight.
    blur: Vec<([f64; 2], f64)>,
    blur_px: f64,
}

impl<'a> Registrar<'a> {
    pub fn new(map: &'a SphereMap, views: &'a [ViewInfo], marks: &'a [Mark], shading: &'a Shading, blur_px: f64) -> Self {
        let a = 3.0_f64.sqrt();
        let sixth = 1.0 / 6.0;
        // Exact for polynomials of order 3 under a normal blur.
        let blur = if blur_px > 0.0 {
            vec![([0.0, 0.0], 2.0 * sixth), ([a, 0.0], sixth), ([-a, 0.0], sixth), ([0.0, a], sixth), ([0.0, -a], sixth)]
        } else {
            vec![([0.0, 0.0], 1.0)]
        };
        let middle_s = marks.iter().map(|m| views[m.view].time_s).sum::<f64>() / marks.len().max(1) as f64;
        let total: f64 = marks.iter().map(|m| m.weight).sum();
        let variance = marks.iter().map(|m| m.weight * m.contrast * m.contrast).sum::<f64>() / total.max(1e-12);
        // A kernel's squares sum to about 2 over the nodes in reach.
        Registrar { map, views, marks, shading, middle_s, map_precision: 2.0 / variance.max(1e-6), blur, blur_px }
    }

    /// Refines from `start`.
    pub fn refine(&self, start: Vector3<f64>, effort: &Effort) -> Registration {
        let mut omega = start;
        let mut design = self.design(&omega);
        let mut robust = vec![1.0; self.marks.len()];
        let mut unknown = vec![0.0; design.unknowns + 3];
        let mut noise = self.noise_guess();
        let no_slopes = vec![Vector3::zeros(); self.marks.len()];
        // The map at the start's attitude, without turning it: the slopes need a map first.
        for _ in 0..2 {
            self.solve(&design, &no_slopes, &robust, noise, &mut unknown, effort.rounds);
            noise = self.reweigh(&self.residuals(&design, &unknown), &mut robust);
        }
        let mut length = 0.0;
        for _ in 0..effort.steps {
            let slopes = self.omega_slopes(&design, &omega, &unknown);
            self.solve(&design, &slopes, &robust, noise, &mut unknown, effort.rounds);
            let at = design.omega_at;
            let mut step = Vector3::new(unknown[at], unknown[at + 1], unknown[at + 2]);
            length = step.norm();
            if length > 15.0 {
                step *= 15.0 / length;
            }
            omega += step;
            unknown[at..].fill(0.0);
            design = self.design(&omega);
            noise = self.reweigh(&self.residuals(&design, &unknown), &mut robust);
            if length < effort.last_step_rad_s {
                break;
            }
        }
        let mut information = None;
        // The steps above share their few rounds with the map and so fall short where ω is held weakly. With map, gains
        // and shading projected out of the slopes first (variable projection), the step is whole.
        for last in (0..if effort.covariance { POLISH } else { 0 }).rev() {
            self.solve(&design, &no_slopes, &robust, noise, &mut unknown, effort.rounds);
            let residuals = self.residuals(&design, &unknown);
            let slopes = self.omega_slopes(&design, &omega, &unknown);
            let found = self.information(&design, &slopes, &robust, noise, &residuals, 2 * effort.rounds, effort.memory_s);
            let mut step = found.step;
            length = step.norm();
            let small = step.component_div(&found.model_covariance.diagonal().map(f64::sqrt)).norm() < 0.3;
            information = Some(found);
            if small || last == 0 {
                break;
            }
            if length > 15.0 {
                step *= 15.0 / length;
            }
            omega += step;
            design = self.design(&omega);
            noise = self.reweigh(&self.residuals(&design, &unknown), &mut robust);
        }
        self.solve(&design, &no_slopes, &robust, noise, &mut unknown, effort.rounds);
        let residuals = self.residuals(&design, &unknown);
        let (model_covariance, scatter_covariance) = information.map_or((Matrix3::zeros(), Matrix3::zeros()), |i| (i.model_covariance, i.scatter_covariance));
        let markings = self.markings(&design, &unknown);
        let texture = (markings.iter().map(|m| m * m).sum::<f64>() / markings.len().max(1) as f64).sqrt();
        let outliers = robust.iter().filter(|&&w| w < 0.5).count() as f64 / robust.len().max(1) as f64;
        Registration { omega, model_covariance, scatter_covariance, residuals, noise, markings, texture, last_step_rad_s: length, outliers }
    }

    /// Robust cost at a fixed spin, everything else fitted.
    pub fn cost_at(&self, omega: &Vector3<f64>, noise: f64, rounds: usize) -> f64 {
        let design = self.design(omega);
        let mut robust = vec![1.0; self.marks.len()];
        let mut unknown = vec![0.0; design.unknowns + 3];
        let none = vec![Vector3::zeros(); self.marks.len()];
        for _ in 0..2 {
            self.solve(&design, &none, &robust, noise, &mut unknown, rounds);
            self.reweigh(&self.residuals(&design, &unknown), &mut robust);
        }
        self.cost(&self.residuals(&design, &unknown), noise)
    }

    fn noise_guess(&self) -> f64 {
        1.5 * median(self.marks.iter().map(|m| (m.contrast * m.weight.sqrt()).abs()).collect()).max(1e-4)
    }

    fn design(&self, omega: &Vector3<f64>) -> Design {
        let nodes = self.map.len();
        let unknowns = nodes + 2 * TERMS + self.views.len();
        let mut prior = vec![self.map_precision; nodes];
        prior.resize(unknowns, NUISANCE_SD.powi(-2));
        let mut d =
            Design { rows: Vec::with_capacity(self.marks.len()), node: Vec::new(), value: Vec::new(), moment: Vec::new(), unknowns, prior, omega_at: unknowns };
        let back: Vec<Rotation3<f64>> = self.views.iter().map(|v| Rotation3::new(-omega * (v.time_s - self.middle_s))).collect();
        let mut row = KernelRow::default();
        let mut place = vec![0usize; nodes];
        for m in self.marks {
            let view = &self.views[m.view];
            let sd = self.blur_px / view.radius_px;
            let start = d.node.len();
            // The lens blurs light, not contrast: a line on a slope of the shading seems to move toward the dark.
            let here = self.shading.at(view.camera, &m.disc);
            for (shift, weight) in &self.blur {
                let (x, y) = (m.disc.x + sd * shift[0], m.disc.y + sd * shift[1]);
                let disc = Vector3::new(x, y, (1.0 - x * x - y * y).max(0.01).sqrt()).normalize();
                let weight = weight * self.shading.at(view.camera, &disc) / here;
                let body = back[m.view] * (view.axes * disc);
                self.map.row(&body, &mut row);
                for ((&node, value), slope) in row.node.iter().zip(&row.value).zip(&row.slope) {
                    let at = match place[node as usize] {
                        at if at >= start && at < d.node.len() && d.node[at] == node => at,
                        _ => {
                            place[node as usize] = d.node.len();
                            d.node.push(node);
                            d.value.push(0.0);
                            d.moment.push(Vector3::zeros());
                            d.node.len() - 1
                        }
                    };
                    d.value[at] += weight * value;
                    d.moment[at] += slope.cross(&body) * weight;
                }
            }
            d.rows.push(Row {
                start,
                end: d.node.len(),
                shading: terms(&m.disc),
                camera_at: nodes + TERMS * self.views[m.view].camera.index(),
                view_at: nodes + 2 * TERMS + m.view,
            });
        }
        d
    }

    /// d contrast / d ω of every pixel: (t − t₀) Jᵀ R (∇map × Rᵀ n), J the left Jacobian of the rotation.
    fn omega_slopes(&self, d: &Design, omega: &Vector3<f64>, unknown: &[f64]) -> Vec<Vector3<f64>> {
        let turns: Vec<(Rotation3<f64>, Matrix3<f64>)> = self
            .views
            .iter()
            .map(|v| {
                let t = v.time_s - self.middle_s;
                (Rotation3::new(omega * t), left_jacobian(&(omega * t)).transpose() * t)
            })
            .collect();
        d.rows
            .iter()
            .zip(self.marks)
            .map(|(r, m)| {
                let moment: Vector3<f64> = (r.start..r.end).map(|i| d.moment[i] * unknown[d.node[i] as usize]).sum();
                let (turn, jacobian) = &turns[m.view];
                jacobian * (turn * moment)
            })
            .collect()
    }

    fn predict(d: &Design, r: &Row, unknown: &[f64]) -> f64 {
        let mut sum = unknown[r.view_at];
        for i in r.start..r.end {
            sum += d.value[i] * unknown[d.node[i] as usize];
        }
        for (s, u) in r.shading.iter().zip(&unknown[r.camera_at..r.camera_at + TERMS]) {
            sum += s * u;
        }
        sum
    }

    fn residuals(&self, d: &Design, unknown: &[f64]) -> Vec<f64> {
        d.rows.iter().zip(self.marks).map(|(r, m)| m.contrast - Self::predict(d, r, unknown)).collect()
    }

    /// Robust weights from residuals; returns the noise of a pixel of weight 1.
    fn reweigh(&self, residuals: &[f64], robust: &mut [f64]) -> f64 {
        let scaled: Vec<f64> = residuals.iter().zip(self.marks).map(|(r, m)| (r * m.weight.sqrt()).abs()).collect();
        let noise = (1.4826 * median(scaled.clone())).max(1e-4);
        for (w, s) in robust.iter_mut().zip(&scaled) {
            *w = ((TAIL + 1.0) / (TAIL + (s / noise).powi(2))).min(1.0);
        }
        noise
    }

    /// Applies (Aᵀ W A + P) to `x`; A's last three columns are `slopes`.
    fn apply(&self, d: &Design, slopes: &[Vector3<f64>], weights: &[f64], x: &[f64], out: &mut [f64]) {
        let at = d.omega_at;
        for ((o, p), x) in out.iter_mut().zip(&d.prior).zip(x) {
            *o = p * x;
        }
        out[at..].fill(0.0);
        let w3 = Vector3::new(x[at], x[at + 1], x[at + 2]);
        let mut o3 = Vector3::zeros();
        for ((r, s), &w) in d.rows.iter().zip(slopes).zip(weights) {
            let y = w * (Self::predict(d, r, x) + s.dot(&w3));
            Self::scatter(d, r, y, out);
            o3 += s * y;
        }
        for k in 0..3 {
            // A little stiffness (one per 1000 rad/s) keeps an unobservable direction finite.
            out[at + k] += o3[k] + 1e-6 * x[at + k];
        }
    }

    fn scatter(d: &Design, r: &Row, y: f64, out: &mut [f64]) {
        out[r.view_at] += y;
        for i in r.start..r.end {
            out[d.node[i] as usize] += d.value[i] * y;
        }
        for (s, o) in r.shading.iter().zip(&mut out[r.camera_at..r.camera_at + TERMS]) {
            *o += s * y;
        }
    }

    fn weights(&self, robust: &[f64], noise: f64) -> Vec<f64> {
        robust.iter().zip(self.marks).map(|(r, m)| r * m.weight / (noise * noise)).collect()
    }

    /// Solves for map, gains, shading and the step of ω, from the present `unknown`.
    fn solve(&self, d: &Design, slopes: &[Vector3<f64>], robust: &[f64], noise: f64, unknown: &mut [f64], rounds: usize) {
        let weights = self.weights(robust, noise);
        let mut right = vec![0.0; unknown.len()];
        for (((r, m), s), &w) in d.rows.iter().zip(self.marks).zip(slopes).zip(&weights) {
            let y = w * m.contrast;
            Self::scatter(d, r, y, &mut right);
            for k in 0..3 {
                right[d.omega_at + k] += s[k] * y;
            }
        }
        self.conjugate_gradients(d, slopes, &weights, &right, unknown, rounds);
    }

    fn diagonal(&self, d: &Design, slopes: &[Vector3<f64>], weights: &[f64]) -> Vec<f64> {
        let mut diagonal = d.prior.clone();
        diagonal.extend([1e-6; 3]);
        for ((r, s), &w) in d.rows.iter().zip(slopes).zip(weights) {
            diagonal[r.view_at] += w;
            for i in r.start..r.end {
                diagonal[d.node[i] as usize] += w * d.value[i] * d.value[i];
            }
            for (t, o) in r.shading.iter().zip(&mut diagonal[r.camera_at..r.camera_at + TERMS]) {
                *o += w * t * t;
            }
            for k in 0..3 {
                diagonal[d.omega_at + k] += w * s[k] * s[k];
            }
        }
        diagonal
    }

    fn conjugate_gradients(&self, d: &Design, slopes: &[Vector3<f64>], weights: &[f64], right: &[f64], x: &mut [f64], rounds: usize) {
        let n = x.len();
        let diagonal = self.diagonal(d, slopes, weights);
        let mut image = vec![0.0; n];
        self.apply(d, slopes, weights, x, &mut image);
        let mut residual: Vec<f64> = right.iter().zip(&image).map(|(a, b)| a - b).collect();
        let mut z: Vec<f64> = residual.iter().zip(&diagonal).map(|(r, d)| r / d).collect();
        let mut direction = z.clone();
        let mut rz = dot(&residual, &z);
        let end = 1e-8 * dot(right, &right.iter().zip(&diagonal).map(|(r, d)| r / d).collect::<Vec<_>>()) + 1e-300;
        for _ in 0..rounds {
            if rz <= end {
                break;
            }
            self.apply(d, slopes, weights, &direction, &mut image);
            let alpha = rz / dot(&direction, &image).max(1e-300);
            for i in 0..n {
                x[i] += alpha * direction[i];
                residual[i] -= alpha * image[i];
                z[i] = residual[i] / diagonal[i];
            }
            let next = dot(&residual, &z);
            let beta = next / rz;
            rz = next;
            for i in 0..n {
                direction[i] = z[i] + beta * direction[i];
            }
        }
    }

    /// Covariance from the curvature with everything else profiled out, and from the scatter of the views' scores; the step.
    fn information(&self, d: &Design, slopes: &[Vector3<f64>], robust: &[f64], noise: f64, residuals: &[f64], rounds: usize, memory_s: f64) -> Information {
        let weights = self.weights(robust, noise);
        let none = vec![Vector3::zeros(); self.marks.len()];
        // Slopes with what map, gains and shading can imitate taken out.
        let mut own: Vec<Vector3<f64>> = slopes.to_vec();
        for k in 0..3 {
            let mut right = vec![0.0; d.unknowns + 3];
            for ((r, s), &w) in d.rows.iter().zip(slopes).zip(&weights) {
                Self::scatter(d, r, w * s[k], &mut right);
            }
            let mut x = vec![0.0; d.unknowns + 3];
            self.conjugate_gradients(d, &none, &weights, &right, &mut x, rounds);
            for (r, o) in d.rows.iter().zip(&mut own) {
                o[k] -= Self::predict(d, r, &x);
            }
        }
        let mut information = Matrix3::identity() * 1e-6;
        for ((o, s), &w) in own.iter().zip(slopes).zip(&weights) {
            information += o * s.transpose() * w;
        }
        information = 0.5 * (information + information.transpose());
        let covariance = information.try_inverse().unwrap_or_else(|| Matrix3::identity() * 1e6);
        let mut scores = vec![Vector3::zeros(); self.views.len()];
        for (((o, m), &w), r) in own.iter().zip(self.marks).zip(&weights).zip(residuals) {
            scores[m.view] += o * (w * r);
        }
        // What the model misses (a line's edge, a step of the shading) stays nearly the same from one frame to the next:
        // scores of neighbouring frames of one camera count as correlated, with weights falling to 0 (Newey and West 1987).
        let mut scatter = Matrix3::zeros();
        for (i, a) in scores.iter().enumerate() {
            for (j, b) in scores.iter().enumerate() {
                let (v, u) = (&self.views[i], &self.views[j]);
                if v.camera == u.camera {
                    let near = 1.0 - (v.time_s - u.time_s).abs() / memory_s;
                    if near > 0.0 {
                        scatter += a * b.transpose() * near;
                    }
                }
            }
        }
        let n = scores.len() as f64;
        let c = covariance * scatter * covariance * (n / (n - 3.0).max(1.0));
        let step = covariance * scores.iter().sum::<Vector3<f64>>();
        Information { model_covariance: covariance, scatter_covariance: 0.5 * (c + c.transpose()), step }
    }

    fn markings(&self, d: &Design, unknown: &[f64]) -> Vec<f64> {
        d.rows.iter().map(|r| (r.start..r.end).map(|i| d.value[i] * unknown[d.node[i] as usize]).sum()).collect()
    }

    /// Robust cost of residuals at a common noise: Student-t log-likelihood ratio, so that 2 × difference is a χ².
    pub fn cost(&self, residuals: &[f64], noise: f64) -> f64 {
        residuals.iter().zip(self.marks).map(|(r, m)| 0.5 * (TAIL + 1.0) * (1.0 + r * r * m.weight / (noise * noise * TAIL)).ln()).sum()
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

/// Left Jacobian of the exponential map: exp(φ + δ) = exp(J(φ) δ) exp(φ) to first order.
fn left_jacobian(phi: &Vector3<f64>) -> Matrix3<f64> {
    let angle = phi.norm();
    let k = phi.cross_matrix();
    let (a, b) = if angle < 1e-4 { (0.5, 1.0 / 6.0) } else { ((1.0 - angle.cos()) / (angle * angle), (angle - angle.sin()) / angle.powi(3)) };
    Matrix3::identity() + k * a + k * k * b
}
