//! One tape band in one image: white between two black bands around a tube, seen at the pose we expect.
//!
//! The appearance follows from the pose: direction of the tube, foreshortened lengths, and the bow of the band's ends (the
//! tape wraps a cylinder). [`fit`] moves that model over the picture, with free grey levels, and answers with the
//! centroid of the visible tape, its covariance and how well the picture agrees.

use super::racket_figure::{RacketFigure, VISIBLE_DEPTH};
use super::racket_pose::View;
use crate::calibration::CameraId;
use crate::footage::GreyView;
use nalgebra::{Isometry3, Matrix2, SMatrix, SVector, Vector2};

/// Lengths of the tape, m, and blur of the picture, px; measured once per shot ([`super::band_shape`]).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BandShape {
    /// Half the length of the white band along the tube.
    pub white_half_m: f64,
    /// Length of each black band.
    pub black_m: f64,
    /// Gaussian blur of the picture (lens, pixel), one standard deviation.
    pub blur_px: f64,
}

impl Default for BandShape {
    /// Tape of 25 mm, the usual width, black on both sides.
    fn default() -> Self {
        BandShape { white_half_m: 0.0115, black_m: 0.020, blur_px: 0.65 }
    }
}

/// What a band should look like in one image.
#[derive(Debug, Clone, Copy)]
pub struct BandView {
    /// Centroid of the visible tape.
    pub centre: Vector2<f64>,
    /// Unit vector along the tube in the image.
    pub along: Vector2<f64>,
    /// Pixels per metre along the tube (foreshortened).
    pub px_per_m: f64,
    /// Half the tube's width.
    pub radius_px: f64,
    /// How far the tube's nearest line is moved along the tube, against its axis.
    pub bow_px: f64,
    /// The tube's own bend: across the tube by this times the square of the way along it, 1/px.
    pub bend: f64,
}

impl BandView {
    /// The band of `marker` at a pose; `None` behind the camera or when the tube points at the camera.
    pub fn at(view: &View, figure: &RacketFigure, pose: &Isometry3<f64>, camera: CameraId, marker: usize) -> Option<Self> {
        let axis_point = pose * figure.points[marker];
        let (_, j) = view.project_with_jacobian(camera, &axis_point)?;
        let axis = pose.rotation * figure.tube[marker].into_inner();
        let along = j * axis;
        let px_per_m = along.norm();
        let toward = (view.eye(camera) - axis_point).normalize();
        let across = toward.cross(&axis).try_normalize(1e-6)?;
        let radius_px = (j * across).norm() * figure.tube_radius_m;
        let patch = figure.patch_in_global(marker, pose, view.eye(camera)).0;
        let n = (toward - toward.dot(&axis) * axis).try_normalize(1e-6)?;
        let centre = view.project(camera, &patch)?;
        let along = along / px_per_m;
        let inward = j * (pose.rotation * figure.bend[marker]);
        let bend = 0.5 * inward.dot(&Vector2::new(-along.y, along.x)) / (px_per_m * px_per_m);
        let bow_px = (j * n).dot(&along) * figure.tube_radius_m;
        (px_per_m > 1e-6 && centre.norm().is_finite()).then_some(BandView { centre, along, px_per_m, radius_px, bow_px, bend })
    }

    /// Image position of a place on the band: `t` px along the tube, `s` px across.
    pub fn place(&self, t: f64, s: f64) -> Vector2<f64> {
        self.centre + self.along * t + Vector2::new(-self.along.y, self.along.x) * (s + self.bend * t * t)
    }

    /// White less black, grey levels, with the band moved by (`t`, `s`) px: the mean of a few places on the white band less
    /// the brighter of the two black bands. `None` outside the picture.
    pub fn contrast(&self, image: &GreyView, shape: &BandShape, t: f64, s: f64) -> Option<f64> {
        let white = shape.white_half_m * self.px_per_m;
        let black = white + 0.5 * shape.black_m * self.px_per_m;
        let side = 0.45 * self.radius_px;
        let shift = self.along * t + Vector2::new(-self.along.y, self.along.x) * s;
        let mean = |places: &[(f64, f64)]| -> Option<f64> {
            let mut sum = 0.0;
            for (a, b) in places {
                let p = self.place(*a, *b) + shift;
                sum += f64::from(image.get(p.x.round() as i64, p.y.round() as i64)?);
            }
            Some(sum / places.len() as f64)
        };
        let w = 0.4 * white;
        let bright = mean(&[(-w, 0.0), (0.0, -side), (0.0, side), (w, 0.0)])?;
        let d1 = mean(&[(black, -side), (black, 0.0), (black, side)])?;
        let d2 = mean(&[(-black, -side), (-black, 0.0), (-black, side)])?;
        Some(bright - d1.max(d2))
    }

    /// The shift (t, s) within `reach_px` at which the contrast is largest, with that contrast.
    pub fn search(&self, image: &GreyView, shape: &BandShape, reach_px: i32) -> Option<(f64, f64, f64)> {
        let mut best: Option<(f64, f64, f64)> = None;
        for i in -reach_px..=reach_px {
            for k in -reach_px..=reach_px {
                let (t, s) = (f64::from(i), f64::from(k));
                if let Some(c) = self.contrast(image, shape, t, s)
                    && best.is_none_or(|b| c > b.2)
                {
                    best = Some((t, s, c));
                }
            }
        }
        best
    }
}

/// Where a band was found and how well.
#[derive(Debug, Clone, Copy)]
pub struct BandFit {
    /// Centroid of the visible tape, px.
    pub uv: Vector2<f64>,
    /// Covariance of `uv`, px², from the residuals around the band.
    pub covariance: Matrix2<f64>,
    pub white: f64,
    pub black: f64,
}

/// Grey levels: white, black, background on either side with its slope along the tube, and how the white brightens across
/// the tube: linearly (light from the side would otherwise pull the band toward it by up to 0.3 px) and from the edges to
/// the middle (light from the camera's side).
const LEVELS: usize = 8;
/// Residuals up to this share of the contrast are the model's own (tape not evenly white, pixels of finite size).
const MISFIT: f64 = 0.1;
const ROUNDS: usize = 8;
/// Shift along and across, and the levels.
const UNKNOWNS: usize = 2 + LEVELS;

/// Fits the band's place, starting `start` px (along, across) from the expected one. `None` when the band leaves the
/// picture, runs away by more than its own size, or the picture does not determine the place.
pub fn fit(image: &GreyView, band: &BandView, shape: &BandShape, start: (f64, f64)) -> Option<BandFit> {
    let white_half = shape.white_half_m * band.px_per_m;
    if white_half < 0.8 || band.radius_px < 0.8 {
        return None; // end-on: less than two pixels of tape
    }
    let black_end = white_half + (0.8 * shape.black_m * band.px_per_m).max(1.5);
    let side = band.radius_px + 2.5;
    let across = Vector2::new(-band.along.y, band.along.x);
    let blur = 1.0 / (shape.blur_px * std::f64::consts::SQRT_2);
    let (mut t0, mut s0) = start;
    let mut levels: Option<SVector<f64, LEVELS>> = None;
    let mut scale = f64::INFINITY;
    let mut out = None;
    let corner = band.place(start.0, start.1);
    let reach = black_end.hypot(side) + 1.0;
    let (x0, x1) = ((corner.x - reach).floor() as i64, (corner.x + reach).ceil() as i64);
    let (y0, y1) = ((corner.y - reach).floor() as i64, (corner.y + reach).ceil() as i64);
    let mut residuals: Vec<f64> = Vec::with_capacity(256);
    for round in 0..ROUNDS {
        let mut jtj = SMatrix::<f64, UNKNOWNS, UNKNOWNS>::zeros();
        let mut jtr = SVector::<f64, UNKNOWNS>::zeros();
        let (mut weight, mut chi) = (0.0, 0.0);
        residuals.clear();
        for y in y0..=y1 {
            for x in x0..=x1 {
                let d = Vector2::new(x as f64, y as f64) - band.centre;
                let t = d.dot(&band.along) - t0;
                let s = d.dot(&across) - s0 - band.bend * t * t;
                if t.abs() > black_end || s.abs() > side {
                    continue;
                }
                let grey = f64::from(image.get(x, y)?);
                // Where the ends of the band lie at this distance from the tube's middle line.
                let q = (s / band.radius_px).clamp(-1.0, 1.0);
                let depth = (1.0 - q * q).sqrt();
                let bow = band.bow_px * (depth - VISIBLE_DEPTH);
                let (a, b) = ((t - bow + white_half) * blur, (t - bow - white_half) * blur);
                let along = 0.5 * (erf(a) - erf(b));
                let (c, e) = ((s + band.radius_px) * blur, (s - band.radius_px) * blur);
                let tube = 0.5 * (erf(c) - erf(e));
                let (plus, minus) = (0.5 * (1.0 + erf(e)), 0.5 * (1.0 - erf(c)));
                let slope = t / black_end;
                let row =
                    [tube * along, tube * (1.0 - along), plus, plus * slope, minus, minus * slope, tube * along * q, tube * along * (depth - VISIBLE_DEPTH)];
                let (jt, js, r) = match &levels {
                    None => (0.0, 0.0, grey),
                    Some(l) => {
                        let model: f64 = row.iter().zip(l.iter()).map(|(k, v)| k * v).sum();
                        let bell = |z: f64| (-z * z).exp() * blur / std::f64::consts::PI.sqrt();
                        // Derivatives by a shift of the band: along, the white ends move; across, the tube's sides move.
                        let along_t = -(bell(a) - bell(b));
                        let (side_plus, side_minus) = (bell(e), bell(c));
                        let white = l[0] + l[6] * q + l[7] * (depth - VISIBLE_DEPTH);
                        let inside = white * along + l[1] * (1.0 - along);
                        let jt = tube * along_t * (white - l[1]);
                        let turn = if q.abs() < 1.0 { (l[7] * q / depth.max(0.3) - l[6]) / band.radius_px * tube * along } else { 0.0 };
                        let js = turn + inside * (side_plus - side_minus) - side_plus * (l[2] + l[3] * slope) + side_minus * (l[4] + l[5] * slope);
                        (jt, js, grey - model)
                    }
                };
                let w = if r.abs() <= scale || levels.is_none() { 1.0 } else { scale / r.abs() };
                let j = SVector::<f64, UNKNOWNS>::from([jt, js, row[0], row[1], row[2], row[3], row[4], row[5], row[6], row[7]]);
                jtj += j * j.transpose() * w;
                jtr += j * (r * w);
                weight += w;
                chi += w * r * r;
                if levels.is_some() {
                    residuals.push(r.abs());
                }
            }
        }
        if weight < 12.0 {
            return None;
        }
        match &mut levels {
            None => {
                let mut h = jtj.fixed_view::<LEVELS, LEVELS>(2, 2).into_owned();
                for i in 0..LEVELS {
                    h[(i, i)] += 1e-3;
                }
                levels = Some(h.cholesky()?.solve(&jtr.fixed_rows::<LEVELS>(2).into_owned()));
            }
            Some(l) => {
                let mut h = jtj;
                for i in 0..UNKNOWNS {
                    h[(i, i)] += 1e-3;
                }
                let step = h.cholesky()?.solve(&jtr);
                let (dt, ds) = (step[0].clamp(-1.0, 1.0), step[1].clamp(-1.0, 1.0));
                t0 += dt;
                s0 += ds;
                *l += step.fixed_rows::<LEVELS>(2);
                // Huber's weights: 1.5 robust deviations (median / 0.6745) keep strings and edges behind from pulling.
                let mid = residuals.len() / 2;
                let median = *residuals.select_nth_unstable_by(mid, f64::total_cmp).1;
                // On a dark curtain most pixels are black and the median is camera noise alone, so the limit also follows
                // the contrast, with which the model's own misfit grows.
                scale = (1.5 * median / 0.6745).max(MISFIT * (l[0] - l[1])).max(1.0);
                let variance = chi / (weight - UNKNOWNS as f64).max(1.0);
                if (t0 - start.0).abs() > white_half + 2.0 || (s0 - start.1).abs() > band.radius_px + 1.5 {
                    return None;
                }
                let settled = dt.abs().max(ds.abs()) < 0.005;
                if settled || round + 1 == ROUNDS {
                    let c = jtj.try_inverse()?.fixed_view::<2, 2>(0, 0).into_owned() * variance;
                    let turn = Matrix2::from_columns(&[band.along, across]);
                    let covariance = turn * c * turn.transpose();
                    if !(covariance[(0, 0)] > 0.0 && covariance[(1, 1)] > 0.0 && covariance.norm().is_finite()) {
                        return None;
                    }
                    out = Some(BandFit { uv: band.place(t0, s0), covariance, white: l[0], black: l[1] });
                    if settled {
                        break;
                    }
                }
            }
        }
    }
    out
}

/// Error function (Abramowitz and Stegun 7.1.26, absolute error below 1.5e-7, far below a grey level).
#[inline]
pub(crate) fn erf(x: f64) -> f64 {
    let z = x.abs();
    if z > 4.0 {
        return x.signum();
    }
    let t = 1.0 / (1.0 + 0.327_591_1 * z);
    let p = t * (0.254_829_592 + t * (-0.284_496_736 + t * (1.421_413_741 + t * (-1.453_152_027 + t * 1.061_405_429))));
    (1.0 - p * (-z * z).exp()).copysign(x)
}
