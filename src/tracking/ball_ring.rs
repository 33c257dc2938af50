//! The sums of one round of the outline's fit ([`super::ball_fit`]) over the pixels of the ring, eight at a time in the widest
//! registers the processor has, in single precision: a picture has eight bits. Sums run in eight fixed lanes, so that every
//! processor gives the same bits.

use super::ball_shading::{LimbProfile, SECTORS};
use crate::footage::GreyView;
use nalgebra::Vector2;
use std::ops::Range;

/// Ring looked at, px inside and outside the outline.
const INSIDE_PX: f64 = 1.6;
const OUTSIDE_PX: f64 = 2.3;
/// Pixels are gathered for a ring wider by this on either side and serve until the centre has moved by as much.
const SLACK_PX: f64 = 0.5;
/// Pixels at a time.
pub const LANES: usize = 8;

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
            v.resize(end, 0.0);
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
    ring: &'a BallRing,
    model: &'a RingModel<'a>,
    /// The centre, from where the pixels were gathered.
    shift: Vector2<f64>,
}

impl pulp::NullaryFnOnce for Round<'_> {
    type Output = [SectorSums; SECTORS];

    #[inline(always)]
    fn call(self) -> Self::Output {
        std::array::from_fn(|sector| self.sector(sector))
    }
}

impl Round<'_> {
    #[inline(always)]
    fn sector(&self, sector: usize) -> SectorSums {
        let (ring, model) = (self.ring, self.model);
        let pixels = ring.starts[sector]..ring.starts[sector + 1];
        let (dx, dy) = (chunks(&ring.dx, &pixels), chunks(&ring.dy, &pixels));
        let (grey, real) = (chunks(&ring.grey, &pixels), chunks(&ring.real, &pixels));
        let limbs = model.profile.sector(sector);
        let [radius, inner, outer, sx, sy, scale] =
            [ring.radius_px, ring.radius_px - INSIDE_PX, ring.radius_px + OUTSIDE_PX, self.shift.x, self.shift.y, model.scale].map(|v| v as f32);
        let [surroundings, ball] = model.levels[sector].map(|v| v as f32);
        let mut sums = [[0.0f32; LANES]; 11];
        for (((dx, dy), grey), real) in dx.iter().zip(dy).zip(grey).zip(real) {
            let mut from_limb = [0.0; LANES];
            let mut inside = [0.0; LANES];
            for l in 0..LANES {
                let (x, y) = (dx[l] - sx, dy[l] - sy);
                let rho = (x * x + y * y).sqrt();
                from_limb[l] = rho - radius;
                inside[l] = if rho >= inner && rho <= outer { real[l] } else { 0.0 };
            }
            let [disc, disc_slope, share, share_slope] = LimbProfile::look_up(limbs, &from_limb);
            for l in 0..LANES {
                let a = [1.0 - disc[l], share[l]];
                let r = grey[l] - a[0] * surroundings - a[1] * ball;
                // Moving the centre toward a pixel lessens the pixel's distance.
                let j = disc_slope[l] * surroundings - share_slope[l] * ball;
                let w = inside[l] * (scale / r.abs().max(1e-30)).min(1.0);
                let (wa, wj, wr) = ([w * a[0], w * a[1]], w * j, w * r);
                let terms = [wa[0] * a[0], wa[0] * a[1], wa[1] * a[1], wa[0] * j, wa[1] * j, wa[0] * r, wa[1] * r, wj * j, wj * r, w, wr * r];
                for (sum, term) in sums.iter_mut().zip(terms) {
                    sum[l] += term;
                }
            }
        }
        let [aa, ab, bb, aj, bj, ar, br, jj, jr, weight, chi] = sums.map(|[a, b, c, d, e, f, g, h]| f64::from(((a + e) + (c + g)) + ((b + f) + (d + h))));
        SectorSums { aa: [aa, ab, bb], aj: [aj, bj], ar: [ar, br], jj, jr, weight, chi }
    }
}

#[inline(always)]
fn chunks<'a>(values: &'a [f32], pixels: &Range<usize>) -> &'a [[f32; LANES]] {
    values.get(pixels.clone()).unwrap_or_default().as_chunks::<LANES>().0
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
