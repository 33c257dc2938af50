//! The ball's centre in one image, from its outline and its shading together.
//!
//! A ball is a sphere of known size: its outline is a circle of known radius, its shading a smooth function of the
//! surface normal. Diffuse shading under any lighting is, to about 2 %, a sum of the nine spherical harmonics up to the
//! second order (Basri and Jacobs 2003; Ramamoorthi and Hanrahan 2001), so those are fitted with the centre: a bright side
//! does not pull the centre toward it. The surroundings get their own grey level all around, and what fits neither
//! (drawn lines, strings, the frame) loses weight (Huber).

use super::band::erf;
use crate::footage::GreyView;
use nalgebra::{DMatrix, DVector, Matrix2, Vector2};

/// Shading terms on the ball.
const SHADE: usize = 9;
/// Grey levels of the surroundings, evenly spaced around the ball and linear in between.
const AROUND: usize = 12;
const UNKNOWNS: usize = 2 + SHADE + AROUND;

/// The ball in one image.
#[derive(Debug, Clone)]
pub struct BallFit {
    /// Projected centre, px.
    pub uv: Vector2<f64>,
    /// From the residuals, px².
    pub covariance: Matrix2<f64>,
    /// Share of the outline at which ball and surroundings differ by more than three residual deviations.
    pub outline: f64,
    /// Root-mean-square residual, grey levels.
    pub residual: f64,
    /// Mean absolute difference of ball and surroundings along the outline, grey levels.
    pub edge: f64,
}

/// Fits the centre, starting at `start`; `radius_px` and `blur_px` are known. `None` when the ball leaves the picture, the
/// fit runs away, or the picture does not determine the centre.
pub fn fit(image: &GreyView, start: Vector2<f64>, radius_px: f64, blur_px: f64) -> Option<BallFit> {
    if !(2.0..200.0).contains(&radius_px) {
        return None;
    }
    let outer = radius_px + 3.0;
    let blur = 1.0 / (blur_px * std::f64::consts::SQRT_2);
    let mut centre = start;
    let mut levels: Option<DVector<f64>> = None;
    let mut scale = f64::INFINITY;
    let mut residuals: Vec<f64> = Vec::with_capacity(512);
    const ROUNDS: usize = 8;
    for round in 0..ROUNDS {
        let mut jtj = DMatrix::<f64>::zeros(UNKNOWNS, UNKNOWNS);
        let mut jtr = DVector::<f64>::zeros(UNKNOWNS);
        let (mut weight, mut chi) = (0.0, 0.0);
        residuals.clear();
        let (x0, x1) = ((centre.x - outer).ceil() as i64, (centre.x + outer).floor() as i64);
        let (y0, y1) = ((centre.y - outer).ceil() as i64, (centre.y + outer).floor() as i64);
        if !image.contains(x0, y0, x1, y1) {
            return None;
        }
        for y in y0..=y1 {
            let row = image.row(y as usize)?;
            for x in x0..=x1 {
                let d = Vector2::new(x as f64, y as f64) - centre;
                let rho = d.norm();
                if rho > outer {
                    continue;
                }
                let grey = f64::from(*row.get(x as usize)?);
                let z = (radius_px - rho) * blur;
                let disc = 0.5 * (1.0 + erf(z));
                let mut j = [0.0; UNKNOWNS];
                let shade = shading(d, rho, radius_px);
                for (k, s) in shade.iter().enumerate() {
                    j[2 + k] = disc * s;
                }
                let (node, next, part) = around(d);
                j[2 + SHADE + node] += (1.0 - disc) * (1.0 - part);
                j[2 + SHADE + next] += (1.0 - disc) * part;
                let r = match &levels {
                    None => grey,
                    Some(l) => {
                        let ball: f64 = (0..SHADE).map(|k| shade[k] * l[k]).sum();
                        let outside = l[SHADE + node] * (1.0 - part) + l[SHADE + next] * part;
                        let edge = (-z * z).exp() * blur / std::f64::consts::PI.sqrt();
                        let out = if rho > 1e-6 { d / rho } else { Vector2::zeros() };
                        // The outline moves with the centre; the shading's own shift is second order and left out.
                        j[0] = edge * out.x * (ball - outside);
                        j[1] = edge * out.y * (ball - outside);
                        grey - disc * ball - (1.0 - disc) * outside
                    }
                };
                let w = if levels.is_none() || r.abs() <= scale { 1.0 } else { scale / r.abs() };
                for a in 0..UNKNOWNS {
                    if j[a] == 0.0 {
                        continue;
                    }
                    jtr[a] += w * j[a] * r;
                    for b in 0..=a {
                        jtj[(a, b)] += w * j[a] * j[b];
                    }
                }
                weight += w;
                chi += w * r * r;
                if levels.is_some() {
                    residuals.push(r.abs());
                }
            }
        }
        if weight < 2.0 * UNKNOWNS as f64 {
            return None;
        }
        for a in 0..UNKNOWNS {
            // A weak pull of the shading terms toward zero: a few pixels cannot swing nine of them.
            jtj[(a, a)] += if (3..2 + SHADE).contains(&a) { 0.5 } else { 1e-3 };
            for b in 0..a {
                jtj[(b, a)] = jtj[(a, b)];
            }
        }
        let Some(l) = &mut levels else {
            let h = jtj.view((2, 2), (UNKNOWNS - 2, UNKNOWNS - 2)).into_owned();
            levels = Some(h.cholesky()?.solve(&jtr.rows(2, UNKNOWNS - 2).into_owned()));
            continue;
        };
        let cholesky = jtj.cholesky()?;
        let step = cholesky.solve(&jtr);
        let limit = 0.2 * radius_px;
        let move_by = Vector2::new(step[0].clamp(-limit, limit), step[1].clamp(-limit, limit));
        centre += move_by;
        *l += step.rows(2, UNKNOWNS - 2);
        if (centre - start).norm() > 0.8 * radius_px {
            return None;
        }
        let mid = residuals.len() / 2;
        scale = (1.5 * *residuals.select_nth_unstable_by(mid, f64::total_cmp).1 / 0.6745).max(1.0);
        if move_by.norm() < 0.003 || round + 1 == ROUNDS {
            let variance = chi / (weight - UNKNOWNS as f64).max(1.0);
            let inverse = cholesky.inverse();
            let covariance = Matrix2::new(inverse[(0, 0)], inverse[(0, 1)], inverse[(1, 0)], inverse[(1, 1)]) * variance;
            if !(covariance[(0, 0)] > 0.0 && covariance[(1, 1)] > 0.0 && covariance.norm().is_finite()) {
                return None;
            }
            return Some(judged(l, centre, covariance, radius_px, variance.sqrt()));
        }
    }
    None
}

fn judged(l: &DVector<f64>, uv: Vector2<f64>, covariance: Matrix2<f64>, radius_px: f64, residual: f64) -> BallFit {
    let (mut seen, mut edge, n) = (0, 0.0, 48);
    for k in 0..n {
        let a = std::f64::consts::TAU * k as f64 / n as f64;
        let d = Vector2::new(a.cos(), a.sin()) * 0.85 * radius_px;
        let ball: f64 = shading(d, 0.85 * radius_px, radius_px).iter().zip(l.iter()).map(|(s, v)| s * v).sum();
        let (node, next, part) = around(d);
        let around = l[SHADE + node] * (1.0 - part) + l[SHADE + next] * part;
        seen += usize::from((ball - around).abs() > 3.0 * residual);
        edge += (ball - around).abs() / n as f64;
    }
    BallFit { uv, covariance, outline: seen as f64 / n as f64, residual, edge }
}

/// The nine harmonics of the surface normal at an image place `d` from the centre; beyond the outline, those at it.
fn shading(d: Vector2<f64>, rho: f64, radius_px: f64) -> [f64; SHADE] {
    let scale = if rho > radius_px { 1.0 / rho } else { 1.0 / radius_px };
    let (x, y) = (d.x * scale, d.y * scale);
    let z = (1.0 - x * x - y * y).max(0.0).sqrt();
    // `z` less its mean over the disc (2/3), so that the first term is the mean grey level.
    [1.0, x, y, z - 2.0 / 3.0, x * y, x * z, y * z, x * x - y * y, z * z - 0.5]
}

/// The two levels of the surroundings that count in a direction, and the share of the second.
fn around(d: Vector2<f64>) -> (usize, usize, f64) {
    let at = d.y.atan2(d.x).rem_euclid(std::f64::consts::TAU) / std::f64::consts::TAU * AROUND as f64;
    let node = (at.floor() as usize) % AROUND;
    (node, (node + 1) % AROUND, at - at.floor())
}
