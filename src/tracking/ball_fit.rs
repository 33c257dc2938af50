//! The ball's centre in one image, from its outline alone.
//!
//! A ball is a sphere of known size, so its outline is a circle of known radius. Around that circle every sector has its
//! own grey levels, one for the surroundings and one for the ball; only how the ball brightens inward from its limb is
//! common ([`super::ball_shading`]). Each sector then says how far out the outline lies, and the centre is what most
//! sectors agree on: drawn lines, panels of another colour, strings and the frame spoil a few sectors, not the centre.
//!
//! (Tried and left: nine spherical harmonics for the whole disc, which drawn lines pulled by up to 1 px; free brightening
//! in every sector, 0.25 px; a ring wider than 2 px inside, where the panels' borders are.)

use super::ball_shading::{LimbProfile, SECTORS};
use crate::footage::GreyView;
use nalgebra::{Matrix2, Vector2};

/// Ring looked at, px inside and outside the outline.
const INSIDE_PX: f64 = 1.6;
const OUTSIDE_PX: f64 = 2.3;
const ROUNDS: usize = 10;
/// What one sector is good to beyond its noise, px: lines and panels that touch the outline.
const SECTOR_SD_PX: f64 = 0.12;
/// Tukey's limit, in deviations.
const TUKEY: f64 = 4.0;

/// The ball in one image.
#[derive(Debug, Clone)]
pub struct BallFit {
    /// Projected centre, px.
    pub uv: Vector2<f64>,
    /// From the scatter of the sectors, px².
    pub covariance: Matrix2<f64>,
    /// Share of the sectors that see the outline (to 0.4 px) and agree with the centre.
    pub outline: f64,
    /// Median over sectors of the root-mean-square residual, grey levels.
    pub residual: f64,
    /// Mean absolute difference of ball and surroundings just inside the outline, grey levels.
    pub edge: f64,
}

#[derive(Clone, Copy, Default)]
struct Sector {
    /// Surroundings, ball.
    levels: [f64; 2],
    // Weighted sums over the pixels: a = (1 - disc, ball), j = slope outward of the model, r = residual.
    aa: [f64; 3],
    aj: [f64; 2],
    ar: [f64; 2],
    jj: f64,
    jr: f64,
    weight: f64,
    chi: f64,
}

impl Sector {
    fn clear(&mut self) {
        *self = Sector { levels: self.levels, ..Sector::default() };
    }

    /// Inverse of the normal matrix of the two levels.
    fn inverse(&self) -> [f64; 3] {
        let (a, b, c) = (self.aa[0] + 1e-3, self.aa[1], self.aa[2] + 1e-3);
        let d = (a * c - b * b).max(1e-9);
        [c / d, -b / d, a / d]
    }

    /// Information on the outline's place and its shift, px, with the levels free.
    fn outline(&self) -> (f64, f64) {
        let [p, q, s] = self.inverse();
        let v = [p * self.aj[0] + q * self.aj[1], q * self.aj[0] + s * self.aj[1]];
        let h = (self.jj - v[0] * self.aj[0] - v[1] * self.aj[1]).max(1e-6);
        let g = self.jr - v[0] * self.ar[0] - v[1] * self.ar[1];
        (h, (g / h).clamp(-1.5, 1.5))
    }

    fn settle_levels(&mut self, shift: f64) {
        let [p, q, s] = self.inverse();
        let g = [self.ar[0] - self.aj[0] * shift, self.ar[1] - self.aj[1] * shift];
        self.levels[0] += p * g[0] + q * g[1];
        self.levels[1] += q * g[0] + s * g[1];
    }

    fn variance(&self) -> f64 {
        self.chi / (self.weight - 2.0).max(1.0)
    }
}

/// Fits the centre, starting at `start`. `None` when the ball leaves the picture, the fit runs away, or the picture does
/// not determine the centre.
pub fn fit(image: &GreyView, start: Vector2<f64>, radius_px: f64, profile: &LimbProfile) -> Option<BallFit> {
    if !(2.5..200.0).contains(&radius_px) {
        return None;
    }
    let directions: [Vector2<f64>; SECTORS] = std::array::from_fn(|k| {
        let a = std::f64::consts::TAU * (k as f64 + 0.5) / SECTORS as f64;
        Vector2::new(a.cos(), a.sin())
    });
    let (inner, outer) = (radius_px - INSIDE_PX, radius_px + OUTSIDE_PX);
    let mut centre = start;
    let mut sectors = [Sector::default(); SECTORS];
    let mut scale = f64::INFINITY;
    for round in 0..ROUNDS {
        sectors.iter_mut().for_each(Sector::clear);
        gather(image, centre, (inner, outer, radius_px), profile, scale, &mut sectors)?;
        if round == 0 {
            sectors.iter_mut().for_each(|s| s.settle_levels(0.0));
            continue;
        }
        let mut variances = sectors.map(|s| s.variance());
        variances.sort_by(f64::total_cmp);
        let usual = variances[SECTORS / 2].max(0.25);
        let seen: [(f64, f64); SECTORS] = std::array::from_fn(|k| {
            let (h, d) = sectors[k].outline();
            // The noise is the same everywhere: no sector is trusted beyond what half of them show.
            (d, sectors[k].variance().max(usual) / h + SECTOR_SD_PX * SECTOR_SD_PX)
        });
        let agreed = agree(&directions, &seen, if round < 3 { f64::INFINITY } else { TUKEY })?;
        let step = agreed.shift.map(|v| v.clamp(-1.0, 1.0));
        centre += step;
        if (centre - start).norm() > 0.8 * radius_px || !centre.norm().is_finite() {
            return None;
        }
        for (s, u) in sectors.iter_mut().zip(&directions) {
            s.settle_levels(u.dot(&step));
        }
        scale = (2.0 * usual.sqrt()).max(1.0);
        if round > 3 && step.norm() < 0.004 || round + 1 == ROUNDS {
            let edge = sectors.iter().map(|s| (s.levels[1] * profile.at(-1.0, 0).map_or(1.0, |l| l.ball) - s.levels[0]).abs()).sum::<f64>() / SECTORS as f64;
            return Some(BallFit { uv: centre, covariance: agreed.covariance, outline: agreed.share, residual: usual.sqrt(), edge });
        }
    }
    None
}

/// Sums over the pixels of the ring; `None` when the ring leaves the picture.
fn gather(image: &GreyView, centre: Vector2<f64>, ring: (f64, f64, f64), profile: &LimbProfile, scale: f64, sectors: &mut [Sector; SECTORS]) -> Option<()> {
    let (inner, outer, radius_px) = ring;
    let (x0, x1) = ((centre.x - outer).ceil() as i64, (centre.x + outer).floor() as i64);
    let (y0, y1) = ((centre.y - outer).ceil() as i64, (centre.y + outer).floor() as i64);
    if !image.contains(x0, y0, x1, y1) {
        return None;
    }
    let (inner2, outer2) = (inner.max(0.0).powi(2), outer * outer);
    for y in y0..=y1 {
        let row = image.row(y as usize)?;
        let dy = y as f64 - centre.y;
        for x in x0..=x1 {
            let dx = x as f64 - centre.x;
            let rho2 = dx * dx + dy * dy;
            if rho2 > outer2 || rho2 < inner2 {
                continue;
            }
            let rho = rho2.sqrt();
            let k = sector_of(dx, dy);
            let s = &mut sectors[k];
            let limb = profile.at(rho - radius_px, k)?;
            let a = [1.0 - limb.disc, limb.ball];
            let r = f64::from(*row.get(x as usize)?) - a[0] * s.levels[0] - a[1] * s.levels[1];
            // Moving the centre toward a pixel lessens the pixel's distance.
            let j = limb.disc_slope * s.levels[0] - limb.ball_slope * s.levels[1];
            let w = if r.abs() <= scale { 1.0 } else { scale / r.abs() };
            s.aa[0] += w * a[0] * a[0];
            s.aa[1] += w * a[0] * a[1];
            s.aa[2] += w * a[1] * a[1];
            s.aj[0] += w * a[0] * j;
            s.aj[1] += w * a[1] * j;
            s.ar[0] += w * a[0] * r;
            s.ar[1] += w * a[1] * r;
            s.jj += w * j * j;
            s.jr += w * j * r;
            s.weight += w;
            s.chi += w * r * r;
        }
    }
    Some(())
}

struct Agreed {
    shift: Vector2<f64>,
    covariance: Matrix2<f64>,
    share: f64,
}

/// The shift most sectors agree on, from each sector's shift outward and its variance.
fn agree(directions: &[Vector2<f64>; SECTORS], seen: &[(f64, f64); SECTORS], tukey: f64) -> Option<Agreed> {
    let mut shift = Vector2::zeros();
    let mut out = None;
    for round in 0..5 {
        let (mut h, mut g) = (Matrix2::zeros(), Vector2::zeros());
        let (mut chi, mut weight, mut good) = (0.0, 0.0, 0);
        for (u, (d, variance)) in directions.iter().zip(seen) {
            let z = (d - u.dot(&shift)) / variance.sqrt();
            let w = if round == 0 || tukey.is_infinite() { 1.0 } else { (1.0 - (z / tukey).powi(2)).max(0.0).powi(2) };
            h += u * u.transpose() * (w / variance);
            g += u * (d * w / variance);
            chi += w * z * z;
            weight += w;
            good += usize::from(z.abs() < 2.5 && *variance < 0.16);
        }
        let inverse = h.try_inverse()?;
        shift = inverse * g;
        // The scatter of the sectors corrects their stated deviations, upward only.
        let scatter = (chi / (weight - 2.0).max(1.0)).max(1.0);
        out = Some(Agreed { shift, covariance: inverse * scatter, share: good as f64 / SECTORS as f64 });
    }
    out.filter(|o| o.covariance[(0, 0)] > 0.0 && o.covariance[(1, 1)] > 0.0 && o.covariance.norm().is_finite())
}

/// Sector of a direction, counted from +x toward +y, without an arc tangent: the borders are lines of known slope.
#[inline]
fn sector_of(dx: f64, dy: f64) -> usize {
    // Tangents of 15, 30, ... 75 degrees.
    const SLOPES: [f64; SECTORS / 4 - 1] = [0.267_949_192_431_122_7, 0.577_350_269_189_625_8, 1.0, 1.732_050_807_568_877_2, 3.732_050_807_568_877];
    // Turned back into the first quadrant.
    let (quadrant, x, y) = match (dx >= 0.0, dy >= 0.0) {
        (true, true) => (0, dx, dy),
        (false, true) => (1, dy, -dx),
        (false, false) => (2, -dx, -dy),
        (true, false) => (3, -dy, dx),
    };
    quadrant * (SECTORS / 4) + SLOPES.iter().map(|slope| usize::from(y >= slope * x)).sum::<usize>()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn agrees_with_the_arc_tangent() {
        for k in 0..3600 {
            let a = std::f64::consts::TAU * (k as f64 + 0.5) / 3600.0;
            assert_eq!(sector_of(7.0 * a.cos(), 7.0 * a.sin()), (a / std::f64::consts::TAU * SECTORS as f64) as usize, "{k}");
        }
    }
}
