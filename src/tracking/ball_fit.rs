//! The ball's centre in one image, from its outline alone.
//!
//! A ball is a sphere of known size, so its outline is a circle of known radius. Around that circle every sector has its
//! own grey levels: one for the surroundings, one for the ball at its limb and one for how the ball brightens inward. That
//! leaves shading, shadow and drawn lines nothing to pull on; a sector in which ball and surroundings look alike, or in
//! which strings, the frame or a line run through, tells little and weighs little.
//!
//! (Tried first: nine spherical harmonics for the shading of the whole disc with robust weights. Drawn lines pulled the
//! centre by up to 1 px.)

use super::band::erf;
use crate::footage::GreyView;
use nalgebra::{Matrix2, Matrix3, Matrix3x2, Vector2, Vector3};

/// Sectors around the outline: 22 degrees, about three pixels of arc on a ball of 16 px.
const SECTORS: usize = 16;
/// Width of the ring looked at on either side of the outline, px.
const RING_PX: f64 = 3.0;
const ROUNDS: usize = 10;

/// The ball in one image.
#[derive(Debug, Clone)]
pub struct BallFit {
    /// Projected centre, px.
    pub uv: Vector2<f64>,
    /// From the residuals, px².
    pub covariance: Matrix2<f64>,
    /// Share of the sectors in which ball and surroundings differ by more than three residual deviations.
    pub outline: f64,
    /// Median over sectors of the root-mean-square residual, grey levels.
    pub residual: f64,
    /// Mean absolute difference of ball and surroundings at the outline, grey levels.
    pub edge: f64,
}

#[derive(Clone, Copy)]
struct Sector {
    /// Surroundings, limb, brightening toward the middle.
    levels: Vector3<f64>,
    variance: f64,
    levels_known: bool,
}

struct Sums {
    aa: Matrix3<f64>,
    ac: Matrix3x2<f64>,
    cc: Matrix2<f64>,
    ga: Vector3<f64>,
    gc: Vector2<f64>,
    weight: f64,
    chi: f64,
    count: f64,
}

impl Sums {
    fn zero() -> Self {
        Sums { aa: Matrix3::zeros(), ac: Matrix3x2::zeros(), cc: Matrix2::zeros(), ga: Vector3::zeros(), gc: Vector2::zeros(), weight: 0.0, chi: 0.0, count: 0.0 }
    }
}

/// Fits the centre, starting at `start`; `radius_px` and `blur_px` are known. `None` when the ball leaves the picture, the
/// fit runs away, or the picture does not determine the centre.
pub fn fit(image: &GreyView, start: Vector2<f64>, radius_px: f64, blur_px: f64) -> Option<BallFit> {
    if !(2.0..200.0).contains(&radius_px) {
        return None;
    }
    let blur = 1.0 / (blur_px * std::f64::consts::SQRT_2);
    let (inner, outer) = ((radius_px - RING_PX).max(0.5), radius_px + RING_PX);
    let mut centre = start;
    let mut sectors = [Sector { levels: Vector3::zeros(), variance: 1.0, levels_known: false }; SECTORS];
    let mut scale = f64::INFINITY;
    for round in 0..ROUNDS {
        let (x0, x1) = ((centre.x - outer).ceil() as i64, (centre.x + outer).floor() as i64);
        let (y0, y1) = ((centre.y - outer).ceil() as i64, (centre.y + outer).floor() as i64);
        if !image.contains(x0, y0, x1, y1) {
            return None;
        }
        let mut sums: [Sums; SECTORS] = std::array::from_fn(|_| Sums::zero());
        for y in y0..=y1 {
            let row = image.row(y as usize)?;
            for x in x0..=x1 {
                let d = Vector2::new(x as f64, y as f64) - centre;
                let rho = d.norm();
                if rho > outer || rho < inner {
                    continue;
                }
                let grey = f64::from(*row.get(x as usize)?);
                let k = sector_of(d);
                let (sector, sum) = (&sectors[k], &mut sums[k]);
                let z = (radius_px - rho) * blur;
                let disc = 0.5 * (1.0 + erf(z));
                let inward = (1.0 - (rho / radius_px).powi(2)).max(0.0).sqrt();
                let a = Vector3::new(1.0 - disc, disc, disc * inward);
                let r = grey - a.dot(&sector.levels);
                let w = if r.abs() <= scale { 1.0 } else { scale / r.abs() };
                sum.aa += a * a.transpose() * w;
                sum.ga += a * (r * w);
                if sector.levels_known {
                    let edge = (-z * z).exp() * blur / std::f64::consts::PI.sqrt();
                    // The whole model moves with the centre: the outline, and the brightening inside it.
                    let steepness = if rho < radius_px { disc * rho / (radius_px * radius_px) / inward.max(0.3) } else { 0.0 };
                    let l = &sector.levels;
                    let c = d / rho * (edge * (l.y + l.z * inward - l.x) + l.z * steepness);
                    sum.ac += a * c.transpose() * w;
                    sum.cc += c * c.transpose() * w;
                    sum.gc += c * (r * w);
                }
                sum.weight += w;
                sum.chi += w * r * r;
                sum.count += 1.0;
            }
        }
        let mut h = Matrix2::zeros();
        let mut g = Vector2::zeros();
        let mut inverse = [Matrix3::zeros(); SECTORS];
        for (k, sum) in sums.iter_mut().enumerate() {
            // A weak pull: a brightening of a whole grey scale over the ring is the most that shading can do.
            sum.aa[(0, 0)] += 1e-3;
            sum.aa[(1, 1)] += 1e-3;
            sum.aa[(2, 2)] += 0.05;
            inverse[k] = sum.aa.try_inverse()?;
            if sectors[k].levels_known {
                let e = sum.ac.transpose() * inverse[k];
                h += (sum.cc - e * sum.ac) / sectors[k].variance;
                g += (sum.gc - e * sum.ga) / sectors[k].variance;
            }
        }
        let mut step = Vector2::zeros();
        let mut covariance = Matrix2::zeros();
        if round > 0 {
            covariance = h.try_inverse()?;
            let limit = 0.2 * radius_px;
            step = (covariance * g).map(|v| v.clamp(-limit, limit));
            centre += step;
            if (centre - start).norm() > 0.8 * radius_px || !centre.norm().is_finite() {
                return None;
            }
        }
        for (k, sum) in sums.iter().enumerate() {
            let s = &mut sectors[k];
            s.levels += inverse[k] * (sum.ga - if s.levels_known { sum.ac * step } else { Vector3::zeros() });
            if s.levels_known {
                s.variance = sum.chi / (sum.weight - 3.0).max(1.0);
            }
            s.levels_known = true;
        }
        if round > 0 {
            let mut variances = sectors.map(|s| s.variance);
            variances.sort_by(f64::total_cmp);
            let usual = variances[SECTORS / 2].max(0.25);
            for s in &mut sectors {
                // The noise is the same everywhere: no sector is trusted beyond what half of them show.
                s.variance = s.variance.max(usual);
            }
            scale = (2.0 * usual.sqrt()).max(1.0);
            if round > 2 && step.norm() < 0.003 || round + 1 == ROUNDS {
                if !(covariance[(0, 0)] > 0.0 && covariance[(1, 1)] > 0.0 && covariance.norm().is_finite()) {
                    return None;
                }
                let residual = usual.sqrt();
                let seen = sectors.iter().filter(|s| (s.levels.y - s.levels.x).abs() > 3.0 * s.variance.sqrt()).count();
                let edge = sectors.iter().map(|s| (s.levels.y - s.levels.x).abs()).sum::<f64>() / SECTORS as f64;
                return Some(BallFit { uv: centre, covariance, outline: seen as f64 / SECTORS as f64, residual, edge });
            }
        }
    }
    None
}

fn sector_of(d: Vector2<f64>) -> usize {
    let turn = d.y.atan2(d.x).rem_euclid(std::f64::consts::TAU) / std::f64::consts::TAU;
    ((turn * SECTORS as f64) as usize).min(SECTORS - 1)
}
