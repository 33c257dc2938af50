//! The joint adjustment of both cameras, their relative pose and all boards to all corners: Levenberg-Marquardt with an
//! analytic Jacobian, boards eliminated by the Schur complement (Triggs et al. 2000), full covariance at the end.
//!
//! Rotations are changed by small rotations in the target frame: `R' = exp([d]x) R`.

use super::Camera;
use super::board_shape::{BoardShape, MODES, STRETCH};
use super::distortion::{ROTATION, SHARED, SHIFT};
use nalgebra::{Isometry3, Matrix2x3, Matrix6, Point3, SMatrix, SVector, Translation3, UnitQuaternion, Vector2, Vector3, Vector6};

pub type SharedMatrix = SMatrix<f64, SHARED, SHARED>;
/// The shared parameters and, behind them, the board's shape: what is the same in all pictures.
const COMMON: usize = SHARED + MODES;
const SHAPE: usize = SHARED;
type CommonMatrix = SMatrix<f64, COMMON, COMMON>;
type Common = SVector<f64, COMMON>;
type Coupling = SMatrix<f64, COMMON, 6>;

/// One corner in one picture: which corner of the board, and where, px.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CornerPixel {
    pub index: usize,
    pub uv: Vector2<f64>,
}

/// One position of the board, as seen by one or both cameras.
#[derive(Debug, Clone, PartialEq)]
pub struct BundleView {
    /// `left_from_board`; `right_from_board` when the left camera does not see the board.
    pub pose: Isometry3<f64>,
    pub left: Vec<CornerPixel>,
    pub right: Vec<CornerPixel>,
}

impl BundleView {
    /// Whether both cameras see the board.
    pub fn is_in_both(&self) -> bool {
        !self.left.is_empty() && !self.right.is_empty()
    }
}

/// Cameras, rig and boards: the adjustment's start and its answer.
#[derive(Debug, Clone, PartialEq)]
pub struct Bundle {
    /// The board's corners in its own frame, m, were it as it should be.
    pub board: Vec<Point3<f64>>,
    /// How the board differs from that; adjusted with the rest when there.
    pub shape: Option<BoardShape>,
    pub left: Camera,
    pub right: Camera,
    pub right_from_left: Isometry3<f64>,
    pub views: Vec<BundleView>,
}

/// How to adjust.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BundleOptions {
    /// Which shared parameters are free (`DistortionModel::active`).
    pub active: [bool; SHARED],
    /// Residual length beyond which a corner counts linearly (Huber), px; `None` is plain least squares.
    pub huber_px: Option<f64>,
    pub max_iterations: usize,
    /// Settled when a step lowers the cost by less than this share and moves no parameter far (`STEP_PER_GAIN`).
    pub settled_gain: f64,
    /// Widen the covariance when the corners of a board err together.
    pub clustered_errors: bool,
}

/// Boards that pull harder against each other than this are another world's.
const MOST_CLUSTERING: f64 = 100.0;
/// Gain at which nothing but rounding is left to be found.
pub const TO_THE_END: f64 = 1e-11;
/// Largest step of a settled adjustment, rad, m or share of the focal length, per gain. Along the valley of centre, tangential
/// terms and boards' turns the cost is flat to its last digit over far larger steps than elsewhere.
const STEP_PER_GAIN: f64 = 1e5;
/// Gain below which a start need not be better.
pub const GOOD_START: f64 = 1e-6;

/// Quality of an adjustment, besides the adjusted `Bundle` itself.
#[derive(Debug, Clone, PartialEq)]
pub struct BundleFit {
    /// Covariance of the shared parameters (order of `distortion::shared_names`; rows of fixed ones are zero).
    pub covariance: SharedMatrix,
    /// One standard deviation of `BoardShape::values`; 0 where they are not adjusted.
    pub shape_sd: [f64; MODES],
    /// How much more the boards pull against each other than independent corners would, at least 1; `covariance` already
    /// holds it (`clustering`).
    pub clustering: f64,
    /// Variance of one pixel coordinate, from the residuals and the degrees of freedom.
    pub variance_px2: f64,
    pub degrees_of_freedom: usize,
    /// Sum of squared residuals, px².
    pub squared_error_px2: f64,
    pub iterations: usize,
}

#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum BundleError {
    #[error("the corners do not determine the cameras ({corners} corners, {parameters} unknowns)")]
    TooFewCorners { corners: usize, parameters: usize },
    #[error("the adjustment is singular: the boards do not determine all camera parameters")]
    Singular,
    #[error("the adjustment did not settle in {iterations} steps")]
    NotConverged { iterations: usize },
    #[error("a board came to lie behind a camera")]
    BehindCamera,
}

/// Residuals of the left and of the right picture, px.
pub type ViewResiduals = (Vec<Vector2<f64>>, Vec<Vector2<f64>>);

/// Normal equations in blocks.
struct Normal {
    cost: f64,
    shared: CommonMatrix,
    shared_gradient: Common,
    boards: Vec<(Matrix6<f64>, Vector6<f64>, Coupling)>,
}

/// Derivatives of one pixel with respect to everything that moves it.
pub(super) struct PixelDerivatives {
    pub residual: Vector2<f64>,
    pub intrinsics: SMatrix<f64, 2, 9>,
    pub point: Matrix2x3<f64>,
}

pub(super) fn pixel_derivatives(camera: &Camera, p: &Point3<f64>, seen: Vector2<f64>) -> Option<PixelDerivatives> {
    let (uv, point) = camera.project_with_jacobian(p)?;
    let (x, y) = (p.x / p.z, p.y / p.z);
    let r2 = x * x + y * y;
    let (d, _) = camera.distort(x, y);
    let (fx, fy) = (camera.fx, camera.fy);
    #[rustfmt::skip]
    let intrinsics = SMatrix::<f64, 2, 9>::from_row_slice(&[
        d.x, 0.0, 1.0, 0.0, fx * x * r2, fx * x * r2 * r2, fx * 2.0 * x * y, fx * (r2 + 2.0 * x * x), fx * x * r2 * r2 * r2,
        0.0, d.y, 0.0, 1.0, fy * y * r2, fy * y * r2 * r2, fy * (r2 + 2.0 * y * y), fy * 2.0 * x * y, fy * y * r2 * r2 * r2,
    ]);
    Some(PixelDerivatives { residual: seen - uv, intrinsics, point })
}

impl Bundle {
    /// Corners seen, by both cameras together.
    pub fn corners(&self) -> usize {
        self.views.iter().map(|v| v.left.len() + v.right.len()).sum()
    }

    /// Place of a corner in the board's frame, m.
    pub fn corner(&self, index: usize) -> Point3<f64> {
        self.shape.as_ref().map_or(self.board[index], |shape| shape.place(index, &self.board[index]))
    }

    /// Numbers of the board's shape that are adjusted.
    pub fn shape_parameters(&self) -> usize {
        self.shape.as_ref().map_or(0, |s| s.told().iter().filter(|t| **t).count())
    }

    fn free(&self, options: &BundleOptions) -> [bool; COMMON] {
        let mut free = [false; COMMON];
        free[..SHARED].copy_from_slice(&options.active);
        free[SHAPE..].copy_from_slice(&self.shape.as_ref().map_or([false; MODES], BoardShape::told));
        free
    }

    /// Residuals (seen minus predicted, px) of one view: left corners, then right ones. `None` behind a camera.
    pub fn residuals(&self, view: &BundleView) -> Option<ViewResiduals> {
        let of = |camera: &Camera, pose: &Isometry3<f64>, corners: &[CornerPixel]| {
            corners.iter().map(|c| Some(c.uv - camera.project(&(pose * self.corner(c.index)))?)).collect::<Option<Vec<_>>>()
        };
        let right_pose = if view.left.is_empty() { view.pose } else { self.right_from_left * view.pose };
        Some((of(&self.left, &view.pose, &view.left)?, of(&self.right, &right_pose, &view.right)?))
    }

    /// Root-mean-square distance over both pictures of one view, px.
    pub fn view_rms_px(&self, view: &BundleView) -> Option<f64> {
        let (l, r) = self.residuals(view)?;
        let n = l.len() + r.len();
        Some((l.iter().chain(&r).map(|d| d.norm_squared()).sum::<f64>() / n.max(1) as f64).sqrt())
    }

    /// Adjusts in place and returns the quality of the answer.
    ///
    /// # Errors  [`BundleError`]; on an error `self` holds the last good state.
    pub fn adjust(&mut self, options: &BundleOptions) -> Result<BundleFit, BundleError> {
        let corners = self.corners();
        let free = self.free(options);
        let parameters = free.iter().filter(|on| **on).count() + 6 * self.views.len();
        if 2 * corners <= parameters {
            return Err(BundleError::TooFewCorners { corners, parameters });
        }
        let mut normal = self.normal_equations(&self.views, options).ok_or(BundleError::BehindCamera)?;
        let mut damping = 1e-4;
        for iteration in 1..=options.max_iterations {
            let (next, next_normal, step_size) = loop {
                let trial = normal.solve(damping, &free).map(|(shared, boards)| {
                    let size = boards.iter().map(|b| b.amax()).fold(relative_step(&shared, self), f64::max);
                    (self.moved(&shared, &boards), size)
                });
                if let Some((candidate, size)) = trial
                    && let Some(equations) = candidate.normal_equations(&candidate.views, options)
                    && equations.cost <= normal.cost * (1.0 + 1e-15)
                {
                    break (candidate, equations, size);
                }
                damping *= 8.0;
                if damping > 1e12 {
                    // No step goes down any more: at the optimum within rounding, or stuck.
                    return self.finish(&normal, options, corners, parameters, iteration);
                }
            };
            let gain = (normal.cost - next_normal.cost) / normal.cost.max(1e-300);
            *self = next;
            normal = next_normal;
            damping = (damping * 0.1).max(1e-15);
            if gain < options.settled_gain && step_size < STEP_PER_GAIN * options.settled_gain || normal.cost < 1e-22 * corners as f64 {
                return self.finish(&normal, options, corners, parameters, iteration);
            }
        }
        Err(BundleError::NotConverged { iterations: options.max_iterations })
    }

    fn finish(&self, normal: &Normal, options: &BundleOptions, corners: usize, parameters: usize, iterations: usize) -> Result<BundleFit, BundleError> {
        let squared_error_px2: f64 = self
            .views
            .iter()
            .map(|v| self.residuals(v).map(|(l, r)| l.iter().chain(&r).map(|d| d.norm_squared()).sum::<f64>()))
            .sum::<Option<f64>>()
            .ok_or(BundleError::BehindCamera)?;
        let degrees_of_freedom = 2 * corners - parameters;
        let variance_px2 = squared_error_px2 / degrees_of_freedom as f64;
        let inverse = normal.shared_inverse(&self.free(options)).ok_or(BundleError::Singular)?;
        let clustering = if options.clustered_errors { self.clustering(options, &inverse, variance_px2) } else { 1.0 };
        let mut covariance = inverse * (variance_px2 * clustering);
        if let Some(shape) = &self.shape {
            // A stretched print leaves open which side of its squares is the stated one: all lengths may be off by half the stretch.
            let shift = self.right_from_left.translation.vector * (shape.values[STRETCH] / 2.0);
            let mut block = covariance.fixed_view_mut::<3, 3>(SHIFT, SHIFT);
            block += shift * shift.transpose();
        }
        let shape_sd = std::array::from_fn(|k| covariance[(SHAPE + k, SHAPE + k)].max(0.0).sqrt());
        Ok(BundleFit {
            covariance: covariance.fixed_view::<SHARED, SHARED>(0, 0).into_owned(),
            shape_sd,
            clustering,
            variance_px2,
            degrees_of_freedom,
            squared_error_px2,
            iterations,
        })
    }

    /// Ratio of the boards' pull on the shared parameters to what independent errors would give, at least 1.
    ///
    /// A board's pull is its gradient `g` on the shared parameters with its pose eliminated. For independent errors the sum
    /// of `g' C g` over boards has expectation `s² (p - Σ tr(C S C S))`, with S the board's own normal matrix and C the
    /// inverse of their sum; errors common to a board (blur, bending, uneven light) make it larger. One factor for all
    /// parameters, because the full cluster-robust matrix needs many more boards than parameters.
    fn clustering(&self, options: &BundleOptions, inverse: &CommonMatrix, variance_px2: f64) -> f64 {
        let (mut pull, mut expected) = (0.0, self.free(options).iter().filter(|on| **on).count() as f64);
        for view in &self.views {
            let Some((s, g, _)) = self.normal_equations(std::slice::from_ref(view), options).and_then(|n| n.reduced(0.0, &[true; COMMON])) else { return 1.0 };
            pull += (g.transpose() * inverse * g)[0];
            let own = inverse * s;
            expected -= (own * own).trace();
        }
        if expected < 1.0 || variance_px2 <= 0.0 {
            return 1.0; // too few boards to tell
        }
        (pull / (variance_px2 * expected)).clamp(1.0, MOST_CLUSTERING)
    }

    /// The same cameras and boards with the corners of another bundle of the same views.
    pub fn with_corners_of(&self, other: &Bundle) -> Bundle {
        let mut out = self.clone();
        for (view, corners) in out.views.iter_mut().zip(&other.views) {
            view.left.clone_from(&corners.left);
            view.right.clone_from(&corners.right);
        }
        out
    }

    fn moved(&self, shared: &Common, boards: &[Vector6<f64>]) -> Bundle {
        let mut out = self.clone();
        for (camera, at) in [(&mut out.left, 0), (&mut out.right, 9)] {
            camera.fx += shared[at];
            camera.fy += shared[at + 1];
            camera.cx += shared[at + 2];
            camera.cy += shared[at + 3];
            for k in 0..5 {
                camera.distortion[k] += shared[at + 4 + k];
            }
        }
        let step = Vector6::from_fn(|i, _| shared[ROTATION + i]);
        out.right_from_left = turned_and_shifted(&self.right_from_left, &step);
        if let Some(shape) = &mut out.shape {
            for k in 0..MODES {
                shape.values[k] += shared[SHAPE + k];
            }
        }
        for (view, step) in out.views.iter_mut().zip(boards) {
            view.pose = turned_and_shifted(&view.pose, step);
        }
        out
    }

    fn normal_equations(&self, views: &[BundleView], options: &BundleOptions) -> Option<Normal> {
        let mut out = Normal { cost: 0.0, shared: CommonMatrix::zeros(), shared_gradient: Common::zeros(), boards: Vec::with_capacity(views.len()) };
        let stereo_r = self.right_from_left.rotation.to_rotation_matrix().into_inner();
        for view in views {
            let mut v = Matrix6::zeros();
            let mut g = Vector6::zeros();
            let mut w = Coupling::zeros();
            let r = view.pose.rotation.to_rotation_matrix().into_inner();
            for (right, corners) in [(false, &view.left), (true, &view.right)] {
                for c in corners {
                    let turned = r * self.corner(c.index).coords;
                    let in_first = Point3::from(turned + view.pose.translation.vector);
                    let through_rig = right && !view.left.is_empty();
                    let (camera, at, p) = match (right, through_rig) {
                        (false, _) => (&self.left, 0, in_first),
                        (true, true) => (&self.right, 9, self.right_from_left * in_first),
                        (true, false) => (&self.right, 9, in_first),
                    };
                    let d = pixel_derivatives(camera, &p, c.uv)?;
                    let length = d.residual.norm();
                    let weight = match options.huber_px {
                        Some(k) if length > k => k / length,
                        _ => 1.0,
                    };
                    out.cost += match options.huber_px {
                        Some(k) if length > k => 2.0 * k * length - k * k,
                        _ => length * length,
                    };
                    let to_first = if through_rig { d.point * stereo_r } else { d.point };
                    let mut pose = SMatrix::<f64, 2, 6>::zeros();
                    pose.fixed_view_mut::<2, 3>(0, 0).copy_from(&(to_first * -turned.cross_matrix()));
                    pose.fixed_view_mut::<2, 3>(0, 3).copy_from(&to_first);
                    let weighted_residual = d.residual * weight;
                    v += pose.tr_mul(&pose) * weight;
                    g += pose.tr_mul(&weighted_residual);
                    let own = d.intrinsics;
                    let mut block = out.shared.fixed_view_mut::<9, 9>(at, at);
                    block += own.tr_mul(&own) * weight;
                    let mut gradient = out.shared_gradient.fixed_rows_mut::<9>(at);
                    gradient += own.tr_mul(&weighted_residual);
                    let mut coupling = w.fixed_view_mut::<9, 6>(at, 0);
                    coupling += own.tr_mul(&pose) * weight;
                    let shape = self.shape.as_ref().map(|s| to_first * r * SMatrix::<f64, 3, MODES>::from_columns(s.modes(c.index)));
                    if let Some(shape) = &shape {
                        let mut block = out.shared.fixed_view_mut::<MODES, MODES>(SHAPE, SHAPE);
                        block += shape.tr_mul(shape) * weight;
                        let mut across = out.shared.fixed_view_mut::<9, MODES>(at, SHAPE);
                        across += own.tr_mul(shape) * weight;
                        let mut gradient = out.shared_gradient.fixed_rows_mut::<MODES>(SHAPE);
                        gradient += shape.tr_mul(&weighted_residual);
                        let mut coupling = w.fixed_view_mut::<MODES, 6>(SHAPE, 0);
                        coupling += shape.tr_mul(&pose) * weight;
                    }
                    if through_rig {
                        let mut rig = SMatrix::<f64, 2, 6>::zeros();
                        rig.fixed_view_mut::<2, 3>(0, 0).copy_from(&(d.point * -(stereo_r * in_first.coords).cross_matrix()));
                        rig.fixed_view_mut::<2, 3>(0, 3).copy_from(&d.point);
                        let mut block = out.shared.fixed_view_mut::<6, 6>(ROTATION, ROTATION);
                        block += rig.tr_mul(&rig) * weight;
                        let across = own.tr_mul(&rig) * weight;
                        let mut block = out.shared.fixed_view_mut::<9, 6>(at, ROTATION);
                        block += across;
                        let mut block = out.shared.fixed_view_mut::<6, 9>(ROTATION, at);
                        block += across.transpose();
                        let mut gradient = out.shared_gradient.fixed_rows_mut::<6>(ROTATION);
                        gradient += rig.tr_mul(&weighted_residual);
                        let mut coupling = w.fixed_view_mut::<6, 6>(ROTATION, 0);
                        coupling += rig.tr_mul(&pose) * weight;
                        if let Some(shape) = &shape {
                            let mut across = out.shared.fixed_view_mut::<6, MODES>(ROTATION, SHAPE);
                            across += rig.tr_mul(shape) * weight;
                        }
                    }
                }
            }
            out.boards.push((v, g, w));
        }
        let across = out.shared.fixed_view::<SHARED, MODES>(0, SHAPE).transpose();
        out.shared.fixed_view_mut::<MODES, SHARED>(SHAPE, 0).copy_from(&across);
        out.cost.is_finite().then_some(out)
    }
}

impl Normal {
    /// Schur complement and reduced gradient on the shared parameters; fixed ones get a unit diagonal and no gradient.
    fn reduced(&self, damping: f64, active: &[bool; COMMON]) -> Option<(CommonMatrix, Common, Vec<Matrix6<f64>>)> {
        let mut s = self.shared;
        let mut g = self.shared_gradient;
        for i in 0..COMMON {
            s[(i, i)] *= 1.0 + damping;
        }
        let mut inverses = Vec::with_capacity(self.boards.len());
        for (v, gb, w) in &self.boards {
            let mut v = *v;
            for i in 0..6 {
                v[(i, i)] *= 1.0 + damping;
            }
            let inverse = v.cholesky()?.inverse();
            let w_inverse = w * inverse;
            s -= w_inverse * w.transpose();
            g -= w_inverse * gb;
            inverses.push(inverse);
        }
        for i in (0..COMMON).filter(|i| !active[*i]) {
            s.row_mut(i).fill(0.0);
            s.column_mut(i).fill(0.0);
            s[(i, i)] = 1.0;
            g[i] = 0.0;
        }
        Some((s, g, inverses))
    }

    fn solve(&self, damping: f64, active: &[bool; COMMON]) -> Option<(Common, Vec<Vector6<f64>>)> {
        let (s, g, inverses) = self.reduced(damping, active)?;
        let (s, scale) = scaled(&s)?;
        let shared = s.cholesky()?.solve(&g.component_mul(&scale)).component_mul(&scale);
        let boards = self.boards.iter().zip(&inverses).map(|((_, gb, w), inverse)| inverse * (gb - w.tr_mul(&shared))).collect();
        Some((shared, boards))
    }

    /// Inverse of the undamped Schur complement, zero for fixed parameters.
    fn shared_inverse(&self, active: &[bool; COMMON]) -> Option<CommonMatrix> {
        let (s, _, _) = self.reduced(0.0, active)?;
        let (s, scale) = scaled(&s)?;
        let inverse = s.cholesky()?.inverse();
        Some(CommonMatrix::from_fn(|i, j| if active[i] && active[j] { inverse[(i, j)] * scale[i] * scale[j] } else { 0.0 }))
    }
}

/// Unit diagonal: focal lengths and distortion terms differ by many orders of magnitude.
fn scaled(s: &CommonMatrix) -> Option<(CommonMatrix, Common)> {
    let scale = Common::from_fn(|i, _| 1.0 / s[(i, i)].sqrt());
    scale.iter().all(|v| v.is_finite()).then(|| (CommonMatrix::from_fn(|i, j| s[(i, j)] * scale[i] * scale[j]), scale))
}

/// Largest step of a shared parameter in units that matter: focal lengths and centres relative to the focal length.
fn relative_step(shared: &Common, bundle: &Bundle) -> f64 {
    let f = bundle.left.fx.abs().max(1.0);
    (0..COMMON).map(|i| if i < SHIFT - 3 && i % 9 < 4 { shared[i].abs() / f } else { shared[i].abs() }).fold(0.0, f64::max)
}

fn turned_and_shifted(pose: &Isometry3<f64>, step: &Vector6<f64>) -> Isometry3<f64> {
    let turn = UnitQuaternion::from_scaled_axis(Vector3::new(step[0], step[1], step[2]));
    let mut rotation = turn * pose.rotation;
    rotation.renormalize();
    Isometry3::from_parts(Translation3::from(pose.translation.vector + Vector3::new(step[3], step[4], step[5])), rotation)
}
