//! How far out a ball's outline may lie in every direction around a place, each direction by itself.
//!
//! [`super::ball_fit`] goes downhill from an outline that is nearly right. Where the shape is not known either, every sector is asked about
//! all places first, and what they say is added up for any outline. A sector whose ball is as bright as it is in free flight is believed
//! before one that needs another brightness (a line, a panel): the border between the lit and the dark side is no outline.

use super::ball_ring::sector_of;
use super::ball_shading::{LimbProfile, SECTORS};
use crate::footage::GreyView;
use nalgebra::{Matrix2, Vector2};

/// Places of the outline that are tried, px from the free ball's, and how far apart.
const FROM_PX: f64 = -2.0;
const SPACING_PX: f64 = 0.25;
const PLACES: usize = 21;
/// Pixels asked, px inside the free ball's outline (the profile reaches no farther) and beyond those places.
const INSIDE_PX: f64 = 2.2;
const BEYOND_PX: f64 = 1.5;
/// A sector that disagrees adds no more than this (log-likelihood), and what it adds to need another brightness.
const MOST: f64 = 4.5;
const OTHER_BRIGHTNESS: f32 = 2.0;
/// A picture's light against that of free flight.
const GAINS: (f64, f64) = (0.7, 1.4);
/// The centre is found in these steps, px, so many each way; over the last its curvature is taken.
const STEPS_PX: [f64; 4] = [0.6, 0.2, 0.07, 0.025];
const STEPS_AROUND: i32 = 3;
const CURVED_PX: f64 = 0.15;

/// Distances of an outline from its centre in the middle of every sector, px.
pub type Radii = [f64; SECTORS];

/// The middle of a sector, seen from the centre.
pub fn direction(sector: usize) -> Vector2<f64> {
    let a = std::f64::consts::TAU * (sector as f64 + 0.5) / SECTORS as f64;
    Vector2::new(a.cos(), a.sin())
}

/// The pixels of every sector around a place: distance, grey level.
struct Around([Vec<[f32; 2]>; SECTORS]);

impl Around {
    /// `None` where the picture does not show all of it.
    fn of(image: &GreyView, centre: &Vector2<f64>, radius_px: f64) -> Option<Self> {
        let outer = radius_px + FROM_PX + SPACING_PX * (PLACES - 1) as f64 + BEYOND_PX;
        let inner = (radius_px - INSIDE_PX).max(0.0);
        let (x0, x1) = ((centre.x - outer).ceil() as i64, (centre.x + outer).floor() as i64);
        let (y0, y1) = ((centre.y - outer).ceil() as i64, (centre.y + outer).floor() as i64);
        if !(outer < 200.0 && image.contains(x0, y0, x1, y1)) {
            return None;
        }
        let mut pixels: [Vec<[f32; 2]>; SECTORS] = std::array::from_fn(|_| Vec::with_capacity(32));
        for y in y0..=y1 {
            for x in x0..=x1 {
                let d = Vector2::new(x as f64, y as f64) - centre;
                let rho = d.norm();
                if (inner..=outer).contains(&rho) {
                    pixels[sector_of(d.x, d.y)].push([rho as f32, f32::from(image.get(x, y)?)]);
                }
            }
        }
        Some(Around(pixels))
    }

    /// Sums over a sector whose outline lies at a distance.
    fn sums(&self, sector: usize, outline: f64, profile: &LimbProfile) -> Levels {
        let limbs = profile.sector(sector);
        let mut s = Levels { aa: 1e-3, bb: 1e-3, ..Levels::default() };
        for [rho, grey] in &self.0[sector] {
            let (step, beyond) = LimbProfile::step(rho - outline as f32);
            let limb = limbs[(step as usize).min(limbs.len() - 1)];
            let (around, ball) = (1.0 - limb.disc - beyond * limb.disc_slope, limb.ball + beyond * limb.ball_slope);
            s.aa += around * around;
            s.ab += around * ball;
            s.bb += ball * ball;
            s.ag += around * grey;
            s.bg += ball * grey;
            s.gg += grey * grey;
        }
        s
    }
}

/// Normal equations of the two levels of a sector, surroundings (a) and ball (b), from its grey levels (g).
#[derive(Debug, Clone, Copy, Default)]
struct Levels {
    aa: f32,
    ab: f32,
    bb: f32,
    ag: f32,
    bg: f32,
    gg: f32,
}

impl Levels {
    /// The ball's level with both free.
    fn ball(&self) -> f32 {
        (self.aa * self.bg - self.ab * self.ag) / (self.aa * self.bb - self.ab * self.ab).max(1e-6)
    }

    /// Sum of squared misses when the ball's level is given and the surroundings' free.
    fn misses(&self, ball: f32) -> f32 {
        let rest = self.ag - ball * self.ab;
        (self.gg - 2.0 * ball * self.bg + ball * ball * self.bb - rest * rest / self.aa).max(0.0)
    }
}

/// The ball's level in every sector of a picture of free flight.
pub fn levels(image: &GreyView, centre: &Vector2<f64>, radius_px: f64, profile: &LimbProfile) -> Option<[f32; SECTORS]> {
    let around = Around::of(image, centre, radius_px)?;
    Some(std::array::from_fn(|k| around.sums(k, radius_px, profile).ball()))
}

/// What every sector says of every place.
pub struct BallEdges {
    centre: Vector2<f64>,
    radius_px: f64,
    costs: [[f32; PLACES]; SECTORS],
}

/// How badly an outline agrees with a picture where it agrees best.
#[derive(Debug, Clone, Copy)]
pub struct OutlineCost {
    pub centre: Vector2<f64>,
    pub cost: f64,
}

impl BallEdges {
    /// `usual` is the ball's level in free flight. `None` where the picture does not show all around the ball.
    pub fn of(image: &GreyView, centre: Vector2<f64>, radius_px: f64, profile: &LimbProfile, usual: &[f32; SECTORS]) -> Option<Self> {
        let around = Around::of(image, &centre, radius_px)?;
        let place = |i: usize| radius_px + FROM_PX + SPACING_PX * i as f64;
        let sums: [[Levels; PLACES]; SECTORS] = std::array::from_fn(|k| std::array::from_fn(|i| around.sums(k, place(i), profile)));
        let free = sums.map(|s| s.map(|s| s.misses(s.ball())));
        let best = free.map(|m| (0..PLACES).min_by(|a, b| m[*a].total_cmp(&m[*b])).unwrap_or_default());
        let mut gains: [f32; SECTORS] = std::array::from_fn(|k| sums[k][best[k]].ball() / usual[k].max(1.0));
        let gain = gains.select_nth_unstable_by(SECTORS / 2, f32::total_cmp).1.clamp(GAINS.0 as f32, GAINS.1 as f32);
        let own: [f32; SECTORS] = std::array::from_fn(|k| free[k][best[k]] / (around.0[k].len() as f32 - 3.0).max(1.0));
        let mut variances = own;
        let noise = variances.select_nth_unstable_by(SECTORS / 2, f32::total_cmp).1.max(0.25);
        let costs = std::array::from_fn(|k| {
            let per_deviation = 0.5 / own[k].max(noise);
            let all: [f32; PLACES] = std::array::from_fn(|i| {
                let as_usual = per_deviation * sums[k][i].misses(gain * usual[k]);
                as_usual.min(per_deviation * free[k][i] + OTHER_BRIGHTNESS)
            });
            let least = all.iter().copied().fold(f32::INFINITY, f32::min);
            all.map(|c| c - least)
        });
        Some(BallEdges { centre, radius_px, costs })
    }

    fn cost_at(&self, outline: &Radii, shift: &Vector2<f64>) -> f64 {
        let mut sum = 0.0;
        for (k, radius) in outline.iter().enumerate() {
            let out = radius + direction(k).dot(shift) - self.radius_px;
            let at = ((out - FROM_PX) / SPACING_PX).clamp(0.0, (PLACES - 1) as f64 - 1e-3);
            let beyond = (at - at.floor()) as f32;
            let [a, b] = [self.costs[k][at as usize], self.costs[k][at as usize + 1]];
            sum += f64::from(a * (1.0 - beyond) + b * beyond).min(MOST);
        }
        sum
    }

    /// The cost of an outline whose centre is free.
    pub fn cost(&self, outline: &Radii) -> OutlineCost {
        let mut best = (Vector2::zeros(), self.cost_at(outline, &Vector2::zeros()));
        for step in STEPS_PX {
            let from = best.0;
            for i in -STEPS_AROUND..=STEPS_AROUND {
                for j in -STEPS_AROUND..=STEPS_AROUND {
                    let shift = from + Vector2::new(f64::from(i), f64::from(j)) * step;
                    let c = self.cost_at(outline, &shift);
                    if c < best.1 {
                        best = (shift, c);
                    }
                }
            }
        }
        OutlineCost { centre: self.centre + best.0, cost: best.1 }
    }

    /// Covariance of the centre, px², where sectors tell it; the cost is a log-likelihood.
    pub fn covariance(&self, outline: &Radii, centre: &Vector2<f64>) -> Option<Matrix2<f64>> {
        let at = |x: f64, y: f64| self.cost_at(outline, &(centre - self.centre + Vector2::new(x, y)));
        let (h, here) = (CURVED_PX, at(0.0, 0.0));
        let second = |a: f64, b: f64| (a - 2.0 * here + b) / (h * h);
        let mixed = (at(h, h) - at(h, -h) - at(-h, h) + at(-h, -h)) / (4.0 * h * h);
        let c = Matrix2::new(second(at(h, 0.0), at(-h, 0.0)), mixed, mixed, second(at(0.0, h), at(0.0, -h))).try_inverse()?;
        (c[(0, 0)] > 0.0 && c[(1, 1)] > 0.0 && c.determinant() > 0.0).then_some(c)
    }
}
