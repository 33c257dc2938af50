//! The sums of one round of the outline's fit ([`super::ball_fit`]) over the pixels of the ring, eight at a time in the widest
//! registers the processor has, in single precision: a picture has eight bits. Sums run in eight fixed lanes, so that every
//! processor gives the same bits.

use super::ball_shading::{LimbProfile, SECTORS};
use super::band_sums::{STRIDE, dots};
use super::octet::LANES;
use crate::footage::GreyView;
use nalgebra::Vector2;

/// Ring looked at, px inside and outside the outline.
const INSIDE_PX: f64 = 1.6;
const OUTSIDE_PX: f64 = 2.3;
/// Pixels are gathered for a ring wider by this on either side and serve until the centre has moved by as much.
const SLACK_PX: f64 = 0.5;
/// Arrays of one value per pixel that lead to the sums.
const ARRAYS: usize = 14;

/// Weighted sums over a sector's pixels: a = (surroundings' share, ball's share), j = slope outward of the model, r = residual.
#[derive(Clone, Copy, Default)]
pub struct SectorSums {
    pub aa: [f64; 3],
    pub aj: [f64; 2],
    pub ar: [f64; 2],
    pub jj: f64,
    pub jr: f64,
    pub weight: f64,
    pub chi: f64,
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

/// The pixels around an outline, sector by sector, each sector filled up to whole lanes. Memory is used again.
#[derive(Default)]
pub struct BallRing {
    /// Places from `gathered_at`, px; grey levels; 1 for a pixel, 0 where a sector is only filled up.
    dx: Vec<f32>,
    dy: Vec<f32>,
    grey: Vec<f32>,
    real: Vec<f32>,
    /// Where each sector begins; one more for the end.
    starts: [usize; SECTORS + 1],
    gathered_at: Option<Vector2<f64>>,
    radius_px: f64,
    found: Vec<(usize, f32, f32, u8)>,
    steps: Vec<u32>,
    work: Vec<f32>,
}

impl BallRing {
    /// For another ball or picture.
    pub fn reset(&mut self, radius_px: f64) {
        self.gathered_at = None;
        self.radius_px = radius_px;
    }

    /// The sums of every sector; `None` when the ring leaves the picture.
    pub fn sums(&mut self, image: &GreyView, model: &RingModel) -> Option<[SectorSums; SECTORS]> {
        let (centre, outer) = (model.centre, self.radius_px + OUTSIDE_PX);
        let (x0, x1) = ((centre.x - outer).ceil() as i64, (centre.x + outer).floor() as i64);
        let (y0, y1) = ((centre.y - outer).ceil() as i64, (centre.y + outer).floor() as i64);
        if !image.contains(x0, y0, x1, y1) {
            return None;
        }
        let gathered_at = match self.gathered_at {
            Some(at) if (centre - at).norm() <= SLACK_PX => at,
            _ => {
                self.gather(image, centre);
                centre
            }
        };
        Some(pulp::Arch::new().dispatch(Round { ring: self, model, shift: centre - gathered_at }))
    }

    fn gather(&mut self, image: &GreyView, centre: Vector2<f64>) {
        let (inner, outer) = ((self.radius_px - INSIDE_PX - SLACK_PX).max(0.0), self.radius_px + OUTSIDE_PX + SLACK_PX);
        let (inner2, outer2) = (inner * inner, outer * outer);
        self.found.clear();
        let mut counts = [0usize; SECTORS];
        let (left, right) = ((centre.x - outer).ceil() as i64, (centre.x + outer).floor() as i64);
        for y in (centre.y - outer).ceil() as i64..=(centre.y + outer).floor() as i64 {
            // Beyond the picture there is nothing; the ring itself lies within.
            let Some(row) = usize::try_from(y).ok().and_then(|y| image.row(y)) else { continue };
            let dy = y as f64 - centre.y;
            for x in left.max(0)..=right.min(row.len() as i64 - 1) {
                let dx = x as f64 - centre.x;
                let rho2 = dx * dx + dy * dy;
                if rho2 <= outer2 && rho2 >= inner2 {
                    let sector = sector_of(dx, dy);
                    counts[sector] += 1;
                    self.found.push((sector, dx as f32, dy as f32, row[x as usize]));
                }
            }
        }
        let mut end = 0;
        for (start, count) in self.starts.iter_mut().zip(counts) {
            *start = end;
            end += count.next_multiple_of(LANES);
        }
        self.starts[SECTORS] = end;
        for v in [&mut self.dx, &mut self.dy, &mut self.grey, &mut self.real] {
            v.clear();
            v.resize(end.next_multiple_of(STRIDE), 0.0);
        }
        let mut next = self.starts;
        for (sector, dx, dy, grey) in &self.found {
            let at = &mut next[*sector];
            (self.dx[*at], self.dy[*at], self.grey[*at], self.real[*at]) = (*dx, *dy, f32::from(*grey), 1.0);
            *at += 1;
        }
        self.gathered_at = Some(centre);
    }
}

struct Round<'a> {
    ring: &'a mut BallRing,
    model: &'a RingModel<'a>,
    /// The centre, from where the pixels were gathered.
    shift: Vector2<f64>,
}

impl pulp::NullaryFnOnce for Round<'_> {
    type Output = [SectorSums; SECTORS];

    #[inline(always)]
    fn call(self) -> Self::Output {
        round(self.ring, self.model, &self.shift)
    }
}

// Plain loops over whole arrays throughout: what is called through closures of the standard library would not be compiled for the
// wide registers.
#[inline(always)]
fn round(ring: &mut BallRing, model: &RingModel, shift: &Vector2<f64>) -> [SectorSums; SECTORS] {
    let n = ring.dx.len();
    let mut sums = [SectorSums::default(); SECTORS];
    if ring.work.len() < ARRAYS * n {
        ring.work.resize(ARRAYS * n, 0.0);
    }
    ring.steps.resize(n.max(ring.steps.len()), 0);
    let (dx, dy, grey, real, steps) = (&ring.dx[..n], &ring.dy[..n], &ring.grey[..n], &ring.real[..n], &mut ring.steps[..n]);
    let (weight, rest) = ring.work.split_at_mut(n);
    let (beyond, rest) = rest.split_at_mut(n);
    let (around, rest) = rest.split_at_mut(n);
    let (around_slope, rest) = rest.split_at_mut(n);
    let (ball, rest) = rest.split_at_mut(n);
    let (ball_slope, rest) = rest.split_at_mut(n);
    let (residual, rest) = rest.split_at_mut(n);
    let (slope, rest) = rest.split_at_mut(n);
    let (w_around, rest) = rest.split_at_mut(n);
    let (w_ball, rest) = rest.split_at_mut(n);
    let (w_slope, rest) = rest.split_at_mut(n);
    let (w_residual, rest) = rest.split_at_mut(n);
    let (l0, rest) = rest.split_at_mut(n);
    let l1 = &mut rest[..n];

    let (radius, scale) = (ring.radius_px as f32, model.scale as f32);
    let (inner, outer) = (radius - INSIDE_PX as f32, radius + OUTSIDE_PX as f32);
    let (sx, sy) = (shift.x as f32, shift.y as f32);
    for i in 0..n {
        let (x, y) = (dx[i] - sx, dy[i] - sy);
        let rho = (x * x + y * y).sqrt();
        weight[i] = if (rho >= inner) & (rho <= outer) { real[i] } else { 0.0 };
        let (step, more) = LimbProfile::step(rho - radius);
        (steps[i], beyond[i]) = (step, more);
    }
    for k in 0..SECTORS {
        let part = ring.starts[k]..ring.starts[k + 1];
        let limbs = model.profile.sector(k);
        let (disc, share) =
            (around[part.clone()].iter_mut().zip(&mut around_slope[part.clone()]), ball[part.clone()].iter_mut().zip(&mut ball_slope[part.clone()]));
        for ((disc, share), step) in disc.zip(share).zip(&steps[part.clone()]) {
            let limb = limbs[(*step as usize).min(limbs.len() - 1)];
            (*disc.0, *disc.1, *share.0, *share.1) = (limb.disc, limb.disc_slope, limb.ball, limb.ball_slope);
        }
        l0[part.clone()].fill(model.levels[k][0] as f32);
        l1[part].fill(model.levels[k][1] as f32);
    }
    for i in 0..n {
        around[i] = 1.0 - (around[i] + beyond[i] * around_slope[i]);
        ball[i] += beyond[i] * ball_slope[i];
    }
    for i in 0..n {
        residual[i] = grey[i] - around[i] * l0[i] - ball[i] * l1[i];
        // Moving the centre toward a pixel lessens the pixel's distance.
        slope[i] = around_slope[i] * l0[i] - ball_slope[i] * l1[i];
    }
    for i in 0..n {
        weight[i] *= (scale / residual[i].abs().max(1e-30)).min(1.0);
    }
    for i in 0..n {
        w_around[i] = weight[i] * around[i];
        w_ball[i] = weight[i] * ball[i];
        w_slope[i] = weight[i] * slope[i];
        w_residual[i] = weight[i] * residual[i];
    }
    for (k, sum) in sums.iter_mut().enumerate() {
        let part = ring.starts[k]..ring.starts[k + 1];
        let (a, b, j, r) = (&around[part.clone()], &ball[part.clone()], &slope[part.clone()], &residual[part.clone()]);
        let (wa, wb) = (&w_around[part.clone()], &w_ball[part.clone()]);
        let (wj, wr) = (&w_slope[part.clone()], &w_residual[part.clone()]);
        let [aa, ab, aj, ar] = dots(wa, [a, b, j, r]);
        let [bb, bj, br] = dots(wb, [b, j, r]);
        let [jj, jr] = dots(wj, [j, r]);
        let [chi] = dots(wr, [r]);
        let [weight] = dots(&weight[part.clone()], [&real[part]]);
        *sum = SectorSums { aa: [aa, ab, bb], aj: [aj, bj], ar: [ar, br], jj, jr, weight, chi };
    }
    sums
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
