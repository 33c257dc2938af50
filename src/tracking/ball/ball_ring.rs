//! The sums of one round of the outline's fit ([`crate::tracking::ball::ball_fit`]) over the pixels of the ring, in the widest registers the
//! processor has and in single precision: a picture has eight bits. One pixel of every sector is taken at a time, so that the sums of
//! all sectors stand side by side; their order is fixed, and every processor gives the same bits.

use crate::footage::GreyView;
use crate::tracking::ball::ball_shading::{Limb, LimbProfile, SECTORS};
use nalgebra::Vector2;
use std::collections::BTreeMap;
use std::sync::{Arc, LazyLock};

/// Ring looked at, px inside and outside the outline.
const INSIDE_PX: f64 = 1.6;
const OUTSIDE_PX: f64 = 2.3;
/// Pixels are gathered for a ring wider by this on either side, and serve until the centre has moved by as much from the place
/// whose ring they are.
const SLACK_PX: f64 = 0.5;
/// Centres and radii that share a plan of their ring: so many centres to a pixel each way, radii rounded to as much.
const PHASES: i64 = 4;
const RADII_PER_PX: f64 = 4.0;
/// Most pixels in all plans that are kept.
const MOST_PLANNED: usize = 500_000;
/// Pixels up to so far outside the outline are looked at, px.
pub const REACH_PX: f64 = OUTSIDE_PX + SLACK_PX;
/// One value of every sector.
type Sectors = [f32; SECTORS];

/// What one round finds in every sector.
pub struct SectorFits {
    /// How far outside the outline lies, px, with the levels free, and the information on it, 1/px² at a noise of one grey level.
    pub outward: [f64; SECTORS],
    pub information: [f64; SECTORS],
    /// Mean square of the residuals.
    pub variance: [f64; SECTORS],
    /// How surroundings and ball change where the outline stays, and by how much less for each px that it moves outward.
    pub change: [[f64; SECTORS]; 2],
    pub less_per_px: [[f64; SECTORS]; 2],
    /// One, or zero where the picture's border cuts the sector.
    pub seen: [f64; SECTORS],
}

/// What one round looks for.
pub struct RingModel<'a> {
    pub centre: Vector2<f64>,
    pub profile: &'a LimbProfile,
    /// Of every sector: surroundings, ball.
    pub levels: &'a [[f64; 2]; SECTORS],
    /// Residuals beyond this count less (Huber).
    pub scale: f64,
}

/// One pixel of every sector, px from the ring's middle; far outside where the sector has none left.
#[derive(Clone, Copy)]
struct Slot {
    dx: Sectors,
    dy: Sectors,
    /// Its number in the box around the ring.
    at: [u32; SECTORS],
}

const EMPTY: Slot = Slot { dx: [1e4; SECTORS], dy: [1e4; SECTORS], at: [0; SECTORS] };

/// Which pixels belong to a ring and to which sector, the same for all centres that lie alike between the pixels.
struct Plan {
    slots: Vec<Slot>,
    /// The box reaches so many pixels to every side of the pixel that the middle is nearest to.
    reach: i64,
}

impl Plan {
    /// `phase` is where the middle lies in its pixel.
    fn new(radius_px: f64, phase: Vector2<f64>) -> Self {
        let slack = SLACK_PX + 0.5 / RADII_PER_PX;
        let (inner, outer) = ((radius_px - INSIDE_PX - slack).max(0.0), radius_px + OUTSIDE_PX + slack);
        let reach = (outer + 0.5).ceil() as i64;
        let (mut slots, mut counts) = (Vec::new(), [0usize; SECTORS]);
        let side = 2 * reach + 1;
        for (y, x) in (-reach..=reach).flat_map(|y| (-reach..=reach).map(move |x| (y, x))) {
            let d = Vector2::new(x as f64, y as f64) - phase;
            if (inner..=outer).contains(&d.norm()) {
                let sector = sector_of(d.x, d.y);
                let slot = counts[sector];
                counts[sector] += 1;
                if slot == slots.len() {
                    slots.push(EMPTY);
                }
                let slot = &mut slots[slot];
                (slot.dx[sector], slot.dy[sector], slot.at[sector]) = (d.x as f32, d.y as f32, ((y + reach) * side + x + reach) as u32);
            }
        }
        Plan { slots, reach }
    }
}

/// The pixels around an outline. Memory is used again.
#[derive(Default)]
pub struct BallRing {
    /// By radius and place in the pixel, in whole parts.
    plans: BTreeMap<[i64; 3], Arc<Plan>>,
    planned: usize,
    plan: Option<Arc<Plan>>,
    /// The pixels in the box, and those of every slot.
    pixels: Vec<u8>,
    grey: Vec<Sectors>,
    middle: Vector2<f64>,
    radius_px: f64,
}

impl BallRing {
    /// For another ball or picture.
    pub fn reset(&mut self, radius_px: f64) {
        self.plan = None;
        self.radius_px = radius_px;
    }

    /// What every sector says; `None` when the ring leaves the picture, unless its border may `cut` sectors off.
    pub fn round(&mut self, image: &GreyView, model: &RingModel, cut: bool) -> Option<SectorFits> {
        let (centre, outer) = (model.centre, self.radius_px + OUTSIDE_PX);
        let (x0, x1) = ((centre.x - outer).ceil() as i64, (centre.x + outer).floor() as i64);
        let (y0, y1) = ((centre.y - outer).ceil() as i64, (centre.y + outer).floor() as i64);
        let whole = image.contains(x0, y0, x1, y1);
        // A row that was not read is not beyond the border.
        let (last_x, last_y) = (image.width as i64 - 1, image.height as i64 - 1);
        if !(whole || cut && image.contains(x0.max(0), y0.max(0), x1.min(last_x), y1.min(last_y))) {
            return None;
        }
        if self.plan.is_none() || (centre - self.middle).norm() > SLACK_PX {
            self.gather(image, &centre);
        }
        let slots = &self.plan.as_ref()?.slots;
        let mut sectors = pulp::Arch::new().dispatch(Round { slots, grey: &self.grey, radius_px: self.radius_px, model, shift: centre - self.middle });
        if !whole {
            let inside = |p: Vector2<f64>| p.x >= 0.0 && p.y >= 0.0 && p.x <= last_x as f64 && p.y <= last_y as f64;
            let side = |k: usize| {
                let (sin, cos) = (std::f64::consts::TAU * k as f64 / SECTORS as f64).sin_cos();
                Vector2::new(cos, sin)
            };
            let seen = |k: usize| [side(k), DIRECTIONS[k], side(k + 1)].into_iter().all(|u| inside(centre + u * outer));
            sectors.seen = std::array::from_fn(|k| f64::from(u8::from(seen(k))));
        }
        Some(sectors)
    }

    fn gather(&mut self, image: &GreyView, centre: &Vector2<f64>) {
        let part = |v: f64| (v * PHASES as f64).round() as i64;
        let [x, y] = [part(centre.x), part(centre.y)];
        let [column, row] = [x, y].map(|v| (v + PHASES / 2).div_euclid(PHASES));
        let radius = (self.radius_px * RADII_PER_PX).round();
        let key = [radius as i64, x - column * PHASES, y - row * PHASES];
        self.middle = Vector2::new(x as f64, y as f64) / PHASES as f64;
        let plan = match self.plans.get(&key) {
            Some(plan) => plan.clone(),
            None => {
                let plan = Arc::new(Plan::new(radius / RADII_PER_PX, self.middle - Vector2::new(column as f64, row as f64)));
                self.planned += plan.slots.len() * SECTORS;
                if self.planned > MOST_PLANNED {
                    self.plans.clear();
                    self.planned = plan.slots.len() * SECTORS;
                }
                self.plans.insert(key, plan.clone());
                plan
            }
        };
        let (reach, side) = (plan.reach, 2 * plan.reach as usize + 1);
        self.pixels.clear();
        self.pixels.resize(side * side, 0);
        // Beyond the picture there is nothing; the ring itself lies within.
        for (y, line) in (row - reach..).zip(self.pixels.chunks_exact_mut(side)) {
            let Some((first, pixels)) = usize::try_from(y).ok().and_then(|y| image.part_of_row(y)) else { continue };
            let (left, first) = (column - reach, first as i64);
            let (from, to) = (left.max(first), (left + side as i64).min(first + pixels.len() as i64));
            if from < to {
                line[(from - left) as usize..(to - left) as usize].copy_from_slice(&pixels[(from - first) as usize..(to - first) as usize]);
            }
        }
        self.grey.clear();
        self.grey.extend(plan.slots.iter().map(|slot| slot.at.map(|at| f32::from(self.pixels[(at as usize).min(side * side - 1)]))));
        self.plan = Some(plan);
    }
}

struct Round<'a> {
    slots: &'a [Slot],
    grey: &'a [Sectors],
    radius_px: f64,
    model: &'a RingModel<'a>,
    /// The centre, from the ring's middle.
    shift: Vector2<f64>,
}

impl pulp::NullaryFnOnce for Round<'_> {
    type Output = SectorFits;

    #[inline(always)]
    fn call(self) -> Self::Output {
        round(self)
    }
}

// Plain loops over whole arrays throughout: what is called through closures of the standard library would not be compiled for the
// wide registers.
#[inline(always)]
fn round(Round { slots, grey, radius_px, model, shift }: Round) -> SectorFits {
    let zero: Sectors = [0.0; SECTORS];
    let (radius, scale) = (radius_px as f32, model.scale as f32);
    let (inner, outer) = (radius - INSIDE_PX as f32, radius + OUTSIDE_PX as f32);
    let (sx, sy) = (shift.x as f32, shift.y as f32);
    let (mut l0, mut l1) = (zero, zero);
    for k in 0..SECTORS {
        (l0[k], l1[k]) = (model.levels[k][0] as f32, model.levels[k][1] as f32);
    }
    let mut sums = [zero; SUMS];
    for (slot, grey) in slots.iter().zip(grey) {
        let (mut weight, mut beyond, mut steps) = (zero, zero, [0u32; SECTORS]);
        for k in 0..SECTORS {
            let (x, y) = (slot.dx[k] - sx, slot.dy[k] - sy);
            let rho = (x * x + y * y).sqrt();
            weight[k] = if (rho >= inner) & (rho <= outer) { 1.0 } else { 0.0 };
            (steps[k], beyond[k]) = LimbProfile::step(rho - radius);
        }
        // Whole entries first: one load each, where picking number by number takes four.
        let mut limbs = [Limb::NONE; SECTORS];
        for k in 0..SECTORS {
            let sector = model.profile.sector(k);
            limbs[k] = sector[(steps[k] as usize).min(sector.len() - 1)];
        }
        let (mut around, mut around_slope, mut ball, mut ball_slope) = (zero, zero, zero, zero);
        for k in 0..SECTORS {
            let limb = limbs[k];
            (around[k], around_slope[k], ball[k], ball_slope[k]) = (limb.disc, limb.disc_slope, limb.ball, limb.ball_slope);
        }
        let (mut residual, mut slope) = (zero, zero);
        for k in 0..SECTORS {
            around[k] = 1.0 - (around[k] + beyond[k] * around_slope[k]);
            ball[k] += beyond[k] * ball_slope[k];
            residual[k] = grey[k] - around[k] * l0[k] - ball[k] * l1[k];
            // Moving the centre toward a pixel lessens the pixel's distance.
            slope[k] = around_slope[k] * l0[k] - ball_slope[k] * l1[k];
            weight[k] *= (scale / residual[k].abs().max(1e-30)).min(1.0);
        }
        for k in 0..SECTORS {
            let [a, b, j, r, w] = [around[k], ball[k], slope[k], residual[k], weight[k]];
            sums[0][k] += w * a * a;
            sums[1][k] += w * a * b;
            sums[2][k] += w * b * b;
            sums[3][k] += w * a * j;
            sums[4][k] += w * b * j;
            sums[5][k] += w * a * r;
            sums[6][k] += w * b * r;
            sums[7][k] += w * j * j;
            sums[8][k] += w * j * r;
            sums[9][k] += w;
            sums[10][k] += w * r * r;
        }
    }
    sectors_of(&sums)
}

/// Solves the normal equations of every sector: a = (surroundings' share, ball's share), j = slope outward of the model, r = residual.
#[inline(always)]
fn sectors_of(sums: &[Sectors; SUMS]) -> SectorFits {
    let zero = [0.0f64; SECTORS];
    let mut wide = [zero; SUMS];
    for i in 0..SUMS {
        for k in 0..SECTORS {
            wide[i][k] = f64::from(sums[i][k]);
        }
    }
    let [aa, ab, bb, aj, bj, ar, br, jj, jr, weight, chi] = &wide;
    let mut out = SectorFits { outward: zero, information: zero, variance: zero, change: [zero; 2], less_per_px: [zero; 2], seen: [1.0; SECTORS] };
    for k in 0..SECTORS {
        let (a, b, c) = (aa[k] + 1e-3, ab[k], bb[k] + 1e-3);
        // Inverse of the normal matrix of the two levels.
        let per = 1.0 / (a * c - b * b).max(1e-9);
        let (p, q, s) = (c * per, -b * per, a * per);
        let (v, w) = (p * aj[k] + q * bj[k], q * aj[k] + s * bj[k]);
        let information = (jj[k] - v * aj[k] - w * bj[k]).max(1e-6);
        out.outward[k] = ((jr[k] - v * ar[k] - w * br[k]) / information).clamp(-MOST_PX, MOST_PX);
        out.information[k] = information;
        out.variance[k] = chi[k] / (weight[k] - 2.0).max(1.0);
        (out.change[0][k], out.change[1][k]) = (p * ar[k] + q * br[k], q * ar[k] + s * br[k]);
        (out.less_per_px[0][k], out.less_per_px[1][k]) = (v, w);
    }
    out
}

/// One sector's outline moves by no more in a round, px.
const MOST_PX: f64 = 1.5;
/// Weighted sums over a sector's pixels.
const SUMS: usize = 11;

/// The middle of every sector, seen from the centre.
pub static DIRECTIONS: LazyLock<[Vector2<f64>; SECTORS]> = LazyLock::new(|| {
    std::array::from_fn(|k| {
        let a = std::f64::consts::TAU * (k as f64 + 0.5) / SECTORS as f64;
        Vector2::new(a.cos(), a.sin())
    })
});

/// Sector of a direction, counted from +x toward +y, without an arc tangent: the borders are lines of known slope.
#[inline]
pub fn sector_of(dx: f64, dy: f64) -> usize {
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
