//! The ball's centre in one image, from its outline alone.
//!
//! A ball is a sphere of known size, so its outline is a circle of known radius. Around that circle every sector has its
//! own grey levels, one for the surroundings and one for the ball; only how the ball brightens inward from its limb is
//! common ([`super::ball_shading`]). Each sector then says how far out the outline lies, and the centre is what most
//! sectors agree on: drawn lines, panels of another colour, strings and the frame spoil a few sectors, not the centre.
//!
//! (Tried and left: nine spherical harmonics for the whole disc, which drawn lines pulled by up to 1 px; free brightening
//! in every sector, 0.25 px; a ring wider than 2 px inside, where the panels' borders are.)

use super::ball_ring::{BallRing, DIRECTIONS, RingModel, SectorSums};
use super::ball_shading::{LimbProfile, SECTORS};
use crate::footage::GreyView;
use nalgebra::{Matrix2, Vector2};
use std::cell::RefCell;

const ROUNDS: usize = 10;
/// From this round on sectors that disagree count less.
const ROBUST_FROM: usize = 3;
/// What one sector is good to beyond its noise, px: lines and panels that touch the outline.
const SECTOR_SD_PX: f64 = 0.12;
/// Rounds of the sectors' agreement end where the shift changes by less, px.
const AGREED_PX: f64 = 1e-4;
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
    /// What a fit to the same picture may begin with.
    pub outline_as_seen: OutlineLevels,
}

/// Grey levels of every sector, surroundings and ball, and residuals beyond which a pixel counts less.
#[derive(Debug, Clone, Copy)]
pub struct OutlineLevels {
    levels: [[f32; 2]; SECTORS],
    scale: f32,
}

impl SectorSums {
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

    /// How the two levels change when the outline moves outward by `shift`, px.
    fn change_of_levels(&self, shift: f64) -> [f64; 2] {
        let [p, q, s] = self.inverse();
        let g = [self.ar[0] - self.aj[0] * shift, self.ar[1] - self.aj[1] * shift];
        [p * g[0] + q * g[1], q * g[0] + s * g[1]]
    }

    fn variance(&self) -> f64 {
        self.chi / (self.weight - 2.0).max(1.0)
    }
}

/// Fits the centre, starting at `start` and with the levels of an earlier fit there if there was one, until a step is below `settled_px`. `None` when the ball leaves the picture, the fit runs away, or the picture does
/// not determine the centre.
pub fn fit(image: &GreyView, start: Vector2<f64>, radius_px: f64, profile: &LimbProfile, settled_px: f64, before: Option<&OutlineLevels>) -> Option<BallFit> {
    thread_local! {
        static RING: RefCell<BallRing> = RefCell::default();
    }
    RING.with_borrow_mut(|ring| fit_in(ring, image, start, radius_px, profile, settled_px, before))
}

fn fit_in(
    ring: &mut BallRing,
    image: &GreyView,
    start: Vector2<f64>,
    radius_px: f64,
    profile: &LimbProfile,
    settled_px: f64,
    before: Option<&OutlineLevels>,
) -> Option<BallFit> {
    if !(2.5..200.0).contains(&radius_px) {
        return None;
    }
    let directions = &*DIRECTIONS;
    ring.reset(radius_px);
    let mut centre = start;
    let mut levels = before.map_or([[0.0; 2]; SECTORS], |b| b.levels.map(|l| l.map(f64::from)));
    let mut scale = before.map_or(f64::INFINITY, |b| f64::from(b.scale));
    // The first rounds find levels and place roughly: both are known where the picture has been measured before.
    for round in if before.is_some() { ROBUST_FROM } else { 0 }..ROUNDS {
        let sectors = ring.sums(image, &RingModel { centre, profile, levels: &levels, scale })?;
        let mut settle = |step: &Vector2<f64>| {
            for ((levels, sector), u) in levels.iter_mut().zip(&sectors).zip(directions) {
                let change = sector.change_of_levels(u.dot(step));
                *levels = [levels[0] + change[0], levels[1] + change[1]];
            }
        };
        if round == 0 {
            settle(&Vector2::zeros());
            continue;
        }
        let mut variances = sectors.map(|s| s.variance());
        let usual = variances.select_nth_unstable_by(SECTORS / 2, f64::total_cmp).1.max(0.25);
        let seen: [(f64, f64); SECTORS] = std::array::from_fn(|k| {
            let (h, d) = sectors[k].outline();
            // The noise is the same everywhere: no sector is trusted beyond what half of them show.
            (d, sectors[k].variance().max(usual) / h + SECTOR_SD_PX * SECTOR_SD_PX)
        });
        let agreed = agree(directions, &seen, if round < ROBUST_FROM { f64::INFINITY } else { TUKEY })?;
        let step = agreed.shift.map(|v| v.clamp(-1.0, 1.0));
        centre += step;
        if (centre - start).norm() > 0.8 * radius_px || !centre.norm().is_finite() {
            return None;
        }
        settle(&step);
        scale = (2.0 * usual.sqrt()).max(1.0);
        if round > ROBUST_FROM && step.norm() < settled_px || round + 1 == ROUNDS {
            let outline_as_seen = OutlineLevels { levels: levels.map(|l| l.map(|v| v as f32)), scale: scale as f32 };
            let limb = profile.at(-1.0, 0).map_or(1.0, |l| f64::from(l.ball));
            let edge = levels.iter().map(|l| (l[1] * limb - l[0]).abs()).sum::<f64>() / SECTORS as f64;
            return Some(BallFit { uv: centre, covariance: agreed.covariance, outline: agreed.share, residual: usual.sqrt(), edge, outline_as_seen });
        }
    }
    None
}

struct Agreed {
    shift: Vector2<f64>,
    covariance: Matrix2<f64>,
    share: f64,
}

/// The shift most sectors agree on, from each sector's shift outward and its variance.
fn agree(directions: &[Vector2<f64>; SECTORS], seen: &[(f64, f64); SECTORS], tukey: f64) -> Option<Agreed> {
    let precision = seen.map(|(_, variance)| 1.0 / variance);
    let per_sd = precision.map(f64::sqrt);
    let mut shift = Vector2::zeros();
    let mut out: Option<Agreed> = None;
    // Without a limit all count the same, and the first round is the answer.
    for round in 0..if tukey.is_infinite() { 1 } else { 5 } {
        let (mut h, mut g) = ([0.0; 3], [0.0; 2]);
        let (mut chi, mut weight, mut good) = (0.0, 0.0, 0);
        for (k, u) in directions.iter().enumerate() {
            let (d, variance) = seen[k];
            let z = (d - u.dot(&shift)) * per_sd[k];
            let w = if round == 0 { 1.0 } else { (1.0 - (z / tukey).powi(2)).max(0.0).powi(2) };
            let p = w * precision[k];
            h = [h[0] + p * u.x * u.x, h[1] + p * u.x * u.y, h[2] + p * u.y * u.y];
            g = [g[0] + p * d * u.x, g[1] + p * d * u.y];
            chi += w * z * z;
            weight += w;
            good += usize::from(z.abs() < 2.5 && variance < 0.16);
        }
        let inverse = Matrix2::new(h[0], h[1], h[1], h[2]).try_inverse()?;
        let next = inverse * Vector2::from(g);
        // The scatter of the sectors corrects their stated deviations, upward only.
        let scatter = (chi / (weight - 2.0).max(1.0)).max(1.0);
        out = Some(Agreed { shift: next, covariance: inverse * scatter, share: good as f64 / SECTORS as f64 });
        if round > 0 && (next - shift).amax() < AGREED_PX {
            break;
        }
        shift = next;
    }
    out.filter(|o| o.covariance[(0, 0)] > 0.0 && o.covariance[(1, 1)] > 0.0 && o.covariance.norm().is_finite())
}
