//! How far out a ball's outline may lie in every direction around a place, each direction by itself.
//!
//! [`crate::tracking::ball::ball_fit`] goes downhill from an outline that is nearly right. Where the shape is not known either, every sector is asked about
//! all places first, and what they say is added up for any outline. A sector whose ball is as bright as it is in free flight is believed
//! before one that needs another brightness (a line, a panel): the border between the lit and the dark side is no outline.

use crate::footage::GreyView;
use crate::tracking::ball::ball_ring::{DIRECTIONS, sector_of};
use crate::tracking::ball::ball_shading::{Limb, LimbProfile, SECTORS};
use crate::tracking::cholesky::Cholesky;
use nalgebra::{Matrix2, SMatrix, SVector, Vector2};
use std::ops::Add;

/// Places of the outline that are tried, px from the free ball's, and how far apart.
const FROM_PX: f64 = -2.0;
const SPACING_PX: f64 = 0.25;
const PLACES: usize = 21;
/// Pixels asked, px inside the free ball's outline (the profile reaches no farther) and beyond those places.
const INSIDE_PX: f64 = 2.2;
const BEYOND_PX: f64 = 1.5;
/// A sector that disagrees adds no more than this (log-likelihood), and what it adds to need another brightness.
const MOST: f32 = 4.5;
const OTHER_BRIGHTNESS: f32 = 2.0;
/// A picture's light against that of free flight.
const GAINS: (f64, f64) = (0.7, 1.4);
/// The centre is looked for on a grid of this spacing, px, so many places each way.
const GRID_PX: f64 = 0.6;
const GRID: i32 = 3;
/// Steps downhill: how many at most, the longest and the shortest, px.
const STEPS: usize = 25;
const LONGEST_STEP_PX: f64 = 0.6;
const SHORTEST_STEP_PX: f64 = 0.01;
/// A step that gains less is the last.
const SETTLED: f64 = 3e-3;
/// Where no shorter step helps either.
const MOST_DAMPING: f64 = 1e4;
/// Where nothing bends, per px².
const LEAST_BEND: f64 = 0.1;

/// Distances of an outline from its centre in the middle of every sector, px.
pub type Radii = [f64; SECTORS];

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

    /// [`Self::sums`] with the outline at each of the places, side by side.
    #[inline(always)]
    fn sums_by_place(&self, sector: usize, first: f64, profile: &LimbProfile) -> [Levels; PLACES] {
        let limbs = profile.sector(sector);
        let zero = [0.0f32; PLACES];
        let mut sums = [zero; 6];
        let mut places = zero;
        for i in 0..PLACES {
            places[i] = (first + SPACING_PX * i as f64) as f32;
        }
        for [rho, grey] in &self.0[sector] {
            let (mut beyond, mut steps, mut entries) = (zero, [0u32; PLACES], [Limb::NONE; PLACES]);
            for i in 0..PLACES {
                (steps[i], beyond[i]) = LimbProfile::step(rho - places[i]);
            }
            for i in 0..PLACES {
                entries[i] = limbs[(steps[i] as usize).min(limbs.len() - 1)];
            }
            for i in 0..PLACES {
                let limb = entries[i];
                let (around, ball) = (1.0 - limb.disc - beyond[i] * limb.disc_slope, limb.ball + beyond[i] * limb.ball_slope);
                sums[0][i] += around * around;
                sums[1][i] += around * ball;
                sums[2][i] += ball * ball;
                sums[3][i] += around * grey;
                sums[4][i] += ball * grey;
                sums[5][i] += grey * grey;
            }
        }
        let [aa, ab, bb, ag, bg, gg] = &sums;
        std::array::from_fn(|i| Levels { aa: aa[i] + 1e-3, ab: ab[i], bb: bb[i] + 1e-3, ag: ag[i], bg: bg[i], gg: gg[i] })
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

struct AllSums<'a> {
    around: &'a Around,
    /// The first place tried.
    first: f64,
    profile: &'a LimbProfile,
}

impl pulp::NullaryFnOnce for AllSums<'_> {
    type Output = [[Levels; PLACES]; SECTORS];

    #[inline(always)]
    fn call(self) -> Self::Output {
        let mut out = [[Levels::default(); PLACES]; SECTORS];
        for (sector, sums) in out.iter_mut().enumerate() {
            *sums = self.around.sums_by_place(sector, self.first, self.profile);
        }
        out
    }
}

/// A cost around a place in any number of dimensions: how high it is, how steep, and how it bends where it bends upward.
#[derive(Debug, Clone, Copy)]
pub struct Bowl<const N: usize> {
    pub cost: f64,
    pub slope: SVector<f64, N>,
    pub bend: SMatrix<f64, N, N>,
}

impl Bowl<2> {
    /// The same cost over the places that a picture shows `across` apart per unit.
    pub fn seen<const N: usize>(&self, across: &SMatrix<f64, 2, N>) -> Bowl<N> {
        Bowl { cost: self.cost, slope: across.transpose() * self.slope, bend: across.transpose() * self.bend * across }
    }
}

impl<const N: usize> Add for Bowl<N> {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Bowl { cost: self.cost + other.cost, slope: self.slope + other.slope, bend: self.bend + other.bend }
    }
}

/// Goes downhill from a place (Levenberg and Marquardt); `px` is how long a pixel is. Place and cost.
pub fn downhill<const N: usize>(from: SVector<f64, N>, px: f64, bowl: impl Fn(&SVector<f64, N>) -> Bowl<N>) -> (SVector<f64, N>, f64) {
    let (mut place, mut here, mut damping) = (from, bowl(&from), 1e-2);
    for _ in 0..STEPS {
        let flat = SMatrix::<f64, N, N>::from_diagonal(&here.bend.diagonal().map(|bend| damping * bend + LEAST_BEND / (px * px)));
        let Some(normal) = Cholesky::of(&(here.bend + flat).data.0) else { break };
        let step = -SVector::from(normal.solve(here.slope.data.0[0]));
        let step = step * (LONGEST_STEP_PX * px / step.norm()).min(1.0);
        let there = bowl(&(place + step));
        if there.cost < here.cost {
            let gain = here.cost - there.cost;
            (place, here, damping) = (place + step, there, 0.2 * damping);
            if gain < SETTLED {
                break;
            }
        } else if damping > MOST_DAMPING || step.norm() < SHORTEST_STEP_PX * px {
            break;
        } else {
            damping *= 10.0;
        }
    }
    (place, here.cost)
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

impl BallEdges {
    /// `usual` is the ball's level in free flight. `None` where the picture does not show all around the ball.
    pub fn of(image: &GreyView, centre: Vector2<f64>, radius_px: f64, profile: &LimbProfile, usual: &[f32; SECTORS]) -> Option<Self> {
        let around = Around::of(image, &centre, radius_px)?;
        let sums = pulp::Arch::new().dispatch(AllSums { around: &around, first: radius_px + FROM_PX, profile });
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
            all.map(|c| (c - least).min(MOST))
        });
        Some(BallEdges { centre, radius_px, costs })
    }

    /// Where the outlines of all sectors lie for a centre: between which costs, and what they say there.
    #[inline]
    fn sectors(&self, outline: &Radii, centre: &Vector2<f64>) -> impl Iterator<Item = (&Vector2<f64>, Spline)> {
        let shift = (centre - self.centre).map(|v| v as f32);
        let from = self.radius_px as f32 + FROM_PX as f32;
        outline.iter().zip(&*DIRECTIONS).zip(&self.costs).map(move |((radius, u), costs)| {
            let out = *radius as f32 + u.x as f32 * shift.x + u.y as f32 * shift.y - from;
            (u, Spline::at(costs, out * (1.0 / SPACING_PX) as f32))
        })
    }

    /// The cost of an outline around a centre.
    pub fn cost_at(&self, outline: &Radii, centre: &Vector2<f64>) -> f64 {
        self.sectors(outline, centre).map(|(_, s)| f64::from(s.value())).sum()
    }

    /// The same with how it changes with the centre, per px.
    pub fn bowl_at(&self, outline: &Radii, centre: &Vector2<f64>) -> Bowl<2> {
        let mut bowl = Bowl { cost: 0.0, slope: Vector2::zeros(), bend: Matrix2::zeros() };
        for (u, spline) in self.sectors(outline, centre) {
            let (slope, bend) = (f64::from(spline.slope()) / SPACING_PX, f64::from(spline.bend().max(0.0)) / (SPACING_PX * SPACING_PX));
            bowl.cost += f64::from(spline.value());
            bowl.slope += slope * u;
            bowl.bend += bend * u * u.transpose();
        }
        bowl
    }

    /// Where on a grid around the place looked at an outline agrees best.
    pub fn best_on_grid(&self, outline: &Radii) -> Vector2<f64> {
        let places = (-GRID..=GRID).flat_map(|i| (-GRID..=GRID).map(move |j| self.centre + Vector2::new(f64::from(i), f64::from(j)) * GRID_PX));
        let costs = places.map(|centre| (self.cost_at(outline, &centre), centre));
        costs.min_by(|a, b| a.0.total_cmp(&b.0)).map_or(self.centre, |best| best.1)
    }

    /// Covariance of the centre, px², where sectors tell it; the cost is a log-likelihood.
    pub fn covariance(&self, outline: &Radii, centre: &Vector2<f64>) -> Option<Matrix2<f64>> {
        let mut bend = Matrix2::zeros();
        for (u, spline) in self.sectors(outline, centre) {
            bend += f64::from(spline.bend()) / (SPACING_PX * SPACING_PX) * u * u.transpose();
        }
        let c = bend.try_inverse()?;
        (c[(0, 0)] > 0.0 && c[(1, 1)] > 0.0 && c.determinant() > 0.0).then_some(c)
    }
}

/// A sector's costs around a place, smoothed by a quadratic B-spline so that slopes do not jump.
#[derive(Clone, Copy)]
struct Spline {
    costs: [f32; 3],
    /// Between the middles before and after the second, 0 to 1.
    beyond: f32,
}

impl Spline {
    /// `at` counts places.
    #[inline]
    fn at(costs: &[f32; PLACES], at: f32) -> Self {
        let at = (at + 0.5).clamp(1.0, PLACES as f32 - 1.001);
        let middle = (at as usize).min(PLACES - 2);
        Spline { costs: [costs[middle - 1], costs[middle], costs[middle + 1]], beyond: at - middle as f32 }
    }

    #[inline]
    fn value(&self) -> f32 {
        let ([a, b, c], t) = (self.costs, self.beyond);
        let rest = 1.0 - t;
        0.5 * (rest * rest * a + t * t * c) + (0.5 + t * rest) * b
    }

    /// Per place.
    #[inline]
    fn slope(&self) -> f32 {
        let ([a, b, c], t) = (self.costs, self.beyond);
        (b - a) * (1.0 - t) + (c - b) * t
    }

    /// Per place squared.
    #[inline]
    fn bend(&self) -> f32 {
        let [a, b, c] = self.costs;
        a - 2.0 * b + c
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::footage::GreyImage;
    use crate::tracking::ball::ball_shading::BallShading;

    /// An ellipse of felt, bright above and hardly brighter than what is behind it below, with a dark line across, under a blur of 0.6 px.
    fn picture(centre: Vector2<f64>, half: [f64; 2]) -> GreyImage {
        let grey = |p: Vector2<f64>| {
            let d = (p - centre).component_div(&Vector2::from(half));
            if d.norm_squared() > 1.0 {
                return 40.0;
            }
            let line = if (d.x - 0.4 * d.y).abs() < 0.06 { 0.4 } else { 1.0 };
            line * (60.0 - 110.0 * d.y.min(0.0))
        };
        let mean = |i: usize| {
            let (mut sum, mut weight) = (0.0, 0.0);
            for k in 0..81 {
                let o = Vector2::new((k % 9) as f64 - 4.0, (k / 9) as f64 - 4.0) * 0.4;
                let w = (-0.5 * o.norm_squared() / 0.36).exp();
                sum += w * grey(Vector2::new((i % 64) as f64, (i / 64) as f64) + o);
                weight += w;
            }
            (sum / weight).round() as u8
        };
        GreyImage { width: 64, height: 64, pixels: (0..64 * 64).map(mean).collect() }
    }

    fn ellipse(half: [f64; 2]) -> Radii {
        std::array::from_fn(|k| DIRECTIONS[k].component_div(&Vector2::from(half)).norm().recip())
    }

    #[test]
    fn truth_the_right_ellipse_costs_least_and_lies_where_it_is_drawn() {
        let (free, pressed) = (Vector2::new(31.2, 32.7), Vector2::new(32.6, 30.4));
        let profile = LimbProfile::new(&BallShading { ambient: 0.5, light: nalgebra::Vector3::new(0.0, -1.0, -0.2).normalize() }, 8.0, 0.6);
        let usual = levels(&GreyView::of(&picture(free, [8.0, 8.0])), &free, 8.0, &profile).expect("seen");
        let image = picture(pressed, [9.0, 7.2]);
        // Begun 1.3 px away.
        let edges = BallEdges::of(&GreyView::of(&image), pressed + Vector2::new(-0.9, 0.9), 8.0, &profile, &usual).expect("seen");
        let best = |half: [f64; 2]| {
            let outline = ellipse(half);
            downhill(edges.best_on_grid(&outline), 1.0, |c| edges.bowl_at(&outline, c))
        };
        let [right, round, turned] = [[9.0, 7.2], [8.0, 8.0], [7.2, 9.0]].map(best);
        assert!(right.1 + 5.0 < round.1 && round.1 < turned.1, "{right:?} {round:?} {turned:?}");
        assert!((right.0 - pressed).norm() < 0.25, "{right:?}");
        let sd = edges.covariance(&ellipse([9.0, 7.2]), &right.0).expect("told").trace().sqrt();
        assert!(sd > 0.005 && sd < 0.3, "{sd}");
    }

    #[test]
    fn fails_quietly_where_the_picture_ends() {
        let image = picture(Vector2::new(32.0, 32.0), [8.0, 8.0]);
        let profile = LimbProfile::new(&BallShading::default(), 8.0, 0.6);
        assert!(BallEdges::of(&GreyView::of(&image), Vector2::new(5.0, 32.0), 8.0, &profile, &[100.0; SECTORS]).is_none());
    }
}
