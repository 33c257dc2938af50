//! Every place that may be the centre of a circle of the ball's size: votes of the grey gradients (Hough's transform with
//! the radius known). Works on any surroundings, brighter or darker than the ball.

use crate::footage::{GreyImage, GreyView};
use crate::tracking::ball::dim_picture::Stretch;
use nalgebra::Vector2;
use std::cell::RefCell;

/// A place that may be the ball.
#[derive(Debug, Clone, Copy)]
pub struct BallCandidate {
    pub uv: Vector2<f64>,
    pub votes: f64,
}

/// Most candidates kept per picture.
const MOST: usize = 16;
/// A gradient counts up to this, grey levels over two pixels: bright clutter must not outvote a pale ball. One that large is one vote.
const CAP: f32 = 30.0;
/// Less is noise, grey levels over two pixels.
const LEAST: f32 = 6.0;
/// A pixel belongs to something that moves when it or a neighbour differs from the background by this, in mean differences
/// of the whole picture (most of it is still, so that is the noise) plus a few grey levels.
const MOVING: (f64, f64) = (3.0, 5.0);

/// A box of pixels, inclusive; empty where it ends before it begins.
#[derive(Debug, Clone, Copy)]
struct Region {
    x0: i64,
    y0: i64,
    x1: i64,
    y1: i64,
}

impl Region {
    fn width(&self) -> usize {
        (self.x1 - self.x0 + 1).max(0) as usize
    }

    fn height(&self) -> usize {
        (self.y1 - self.y0 + 1).max(0) as usize
    }
}

/// Candidates in a whole picture, most votes first; only what differs from the background votes.
pub fn candidates(image: &GreyView, background: &GreyImage, radius_px: f64) -> Vec<BallCandidate> {
    let (w, h) = (image.width, image.height);
    if w < 3 || h < 3 || background.width != w || background.height != h || image.rows != h || !(2.5..100.0).contains(&radius_px) {
        return Vec::new();
    }
    let region = Region { x0: 0, y0: 0, x1: w as i64 - 1, y1: h as i64 - 1 };
    let votes = SCRATCH.with_borrow_mut(|scratch| {
        scratch.find_moving(image, background);
        scratch.vote(image, radius_px, &region, &region, true)
    });
    // A ball with a third of its outline against other grey gives about 2 votes for each pixel of radius.
    let (least, gap) = ((2.0 * radius_px * f64::from(CAP)) as u16, (0.5 * radius_px) as i64);
    let mut found: Vec<BallCandidate> = Vec::new();
    for (y, row) in votes.rows() {
        for (x, v) in (votes.place.x0..).zip(row).filter(|(_, v)| **v > least) {
            if (y - 1..=y + 1).all(|j| (x - 1..=x + 1).all(|i| votes.at(i, j) <= *v)) {
                found.push(BallCandidate { uv: Vector2::new(x as f64, y as f64), votes: f64::from(*v) / f64::from(CAP) });
            }
        }
    }
    found.sort_by(|a, b| b.votes.total_cmp(&a.votes).then(a.uv.y.total_cmp(&b.uv.y)).then(a.uv.x.total_cmp(&b.uv.x)));
    votes.leave();
    let mut kept: Vec<BallCandidate> = Vec::new();
    for c in found {
        if kept.len() == MOST {
            break;
        }
        if kept.iter().all(|k| (k.uv - c.uv).amax() > gap as f64) {
            kept.push(c);
        }
    }
    kept
}

/// [`candidates`] in a picture that uses little of the grey scale.
pub fn candidates_in_dim(image: &GreyView, background: &GreyImage, radius_px: f64, stretch: &Stretch) -> Vec<BallCandidate> {
    let (Some(image), Some(background)) = (stretch.whole(image), stretch.whole(&GreyView::of(background))) else { return Vec::new() };
    candidates(&GreyView::of(&image), &background, radius_px)
}

/// [`nearby`] in a picture that uses little of the grey scale.
pub fn nearby_in_dim(image: &GreyView, centre: Vector2<f64>, radius_px: f64, reach_px: i64, stretch: &Stretch) -> Option<Vector2<f64>> {
    // All that is looked at, and what smoothing takes in around it.
    let half = reach_px + radius_px.ceil() as i64 + 4;
    let (x, y) = (centre.x.round() as i64, centre.y.round() as i64);
    let part = stretch.part(image, (x - half, y - half), (x + half, y + half))?;
    let corner = Vector2::new((x - half) as f64, (y - half) as f64);
    nearby(&GreyView::of(&part), centre - corner, radius_px, reach_px).map(|place| place + corner)
}

/// The place within `reach_px` of `centre` with the most votes, whole pixels from it; `None` near the picture's border.
pub fn nearby(image: &GreyView, centre: Vector2<f64>, radius_px: f64, reach_px: i64) -> Option<Vector2<f64>> {
    let (cx, cy) = (centre.x.round() as i64, centre.y.round() as i64);
    let centres = Region { x0: cx - reach_px - 1, y0: cy - reach_px - 1, x1: cx + reach_px + 1, y1: cy + reach_px + 1 };
    let margin = radius_px.ceil() as i64 + 1;
    let pixels = Region { x0: centres.x0 - margin, y0: centres.y0 - margin, x1: centres.x1 + margin, y1: centres.y1 + margin };
    if !image.contains(pixels.x0, pixels.y0, pixels.x1, pixels.y1) {
        return None;
    }
    let votes = SCRATCH.with_borrow_mut(|scratch| scratch.vote(image, radius_px, &pixels, &centres, false));
    let mut best = (0, centre);
    for (y, row) in votes.rows() {
        for (x, v) in (votes.place.x0..).zip(row) {
            if *v > best.0 {
                best = (*v, Vector2::new(x as f64, y as f64));
            }
        }
    }
    votes.leave();
    Some(best.1)
}

/// Smoothed votes of a box of centres, [`CAP`] of them to one; none elsewhere.
struct Votes {
    place: Region,
    votes: Vec<u16>,
}

impl Votes {
    #[inline]
    fn at(&self, x: i64, y: i64) -> u16 {
        let p = &self.place;
        if x < p.x0 || x > p.x1 || y < p.y0 || y > p.y1 {
            return 0;
        }
        self.votes[(y - p.y0) as usize * p.width() + (x - p.x0) as usize]
    }

    /// By row: its place down the picture and the votes along it.
    fn rows(&self) -> impl Iterator<Item = (i64, &[u16])> {
        (self.place.y0..).zip(self.votes.chunks_exact(self.place.width().max(1)))
    }

    /// Leaves the memory to the next ones.
    fn leave(self) {
        SCRATCH.with_borrow_mut(|scratch| scratch.votes = self.votes);
    }
}

thread_local! {
    static SCRATCH: RefCell<Scratch> = RefCell::default();
}

/// Memory as large as a picture, used again.
#[derive(Default)]
struct Scratch {
    /// Pixels that differ from the background.
    changed: Vec<u8>,
    /// Those and their neighbours: 1, others 0.
    moving: Vec<u8>,
    /// Votes; all zero between two uses.
    raw: Vec<u16>,
    /// Room for [`Votes`].
    votes: Vec<u16>,
}

impl Scratch {
    /// Votes of the gradients in `pixels` (of a whole picture those that move, if so asked) for centres in `centres`, smoothed over
    /// 3x3; the border of `centres` only gives to its neighbours.
    fn vote(&mut self, image: &GreyView, radius_px: f64, pixels: &Region, centres: &Region, only_moving: bool) -> Votes {
        let w = centres.width();
        if self.raw.len() < w * centres.height() {
            // Written at once: votes come here and there, and each page read before it is written costs twice.
            self.raw.clear();
            self.raw.resize(w * centres.height(), 0);
        }
        let moving = only_moving.then_some(self.moving.as_slice());
        let seen = pulp::Arch::new().dispatch(Voting { raw: &mut self.raw, image, radius: radius_px as f32, pixels, centres, moving });
        let raw = &mut self.raw;
        // One more around it, but not on the border.
        let place = Region {
            x0: (seen.x0 - 1).max(centres.x0 + 1),
            y0: (seen.y0 - 1).max(centres.y0 + 1),
            x1: (seen.x1 + 1).min(centres.x1 - 1),
            y1: (seen.y1 + 1).min(centres.y1 - 1),
        };
        let n = place.width();
        let mut votes = std::mem::take(&mut self.votes);
        votes.clear();
        votes.reserve(n * place.height());
        let mut column = vec![0u16; n + 2];
        for y in place.y0..=place.y1 {
            let at = |y: i64| &raw[(y - centres.y0) as usize * w + (place.x0 - 1 - centres.x0) as usize..][..n + 2];
            let (above, here, below) = (at(y - 1), at(y), at(y + 1));
            for (sum, ((a, h), b)) in column.iter_mut().zip(above.iter().zip(here).zip(below)) {
                *sum = a.saturating_add(*h).saturating_add(*b);
            }
            votes.extend(column.windows(3).map(|three| three[0].saturating_add(three[1]).saturating_add(three[2])));
        }
        for y in seen.y0..=seen.y1 {
            raw[(y - centres.y0) as usize * w..][(seen.x0 - centres.x0) as usize..=(seen.x1 - centres.x0) as usize].fill(0);
        }
        Votes { place, votes }
    }

    /// Pixels that differ from the background, or whose neighbours do. The pictures are of one size.
    fn find_moving(&mut self, image: &GreyView, background: &GreyImage) {
        let (w, h) = (image.width, image.height);
        let rows = |y: usize| image.row(y).unwrap_or_default().iter().zip(&background.pixels[y * w..][..w]);
        let sum: u64 = (0..h).map(|y| u64::from(rows(y).map(|(a, b)| u32::from(a.abs_diff(*b))).sum::<u32>())).sum();
        let least = (MOVING.0 * sum as f64 / (w * h) as f64 + MOVING.1).min(255.0) as u8;
        let (changed, out) = (&mut self.changed, &mut self.moving);
        changed.resize(w * h, 0);
        out.resize(w * h, 0);
        changed[..w].fill(0);
        changed[(h - 1) * w..].fill(0);
        for y in 1..h.saturating_sub(1) {
            let row = &mut changed[y * w..][..w];
            for (out, (a, b)) in row.iter_mut().zip(rows(y)) {
                *out = u8::from(a.abs_diff(*b) >= least);
            }
            (row[0], row[w - 1]) = (0, 0);
        }
        let mut column = vec![0u8; w];
        for y in 0..h {
            let row = |y: usize| &changed[y.min(h - 1) * w..][..w];
            for (any, ((a, h), b)) in column.iter_mut().zip(row(y.saturating_sub(1)).iter().zip(row(y)).zip(row(y + 1))) {
                *any = a | h | b;
            }
            let row = &mut out[y * w..][..w];
            for (o, three) in row[1..w - 1].iter_mut().zip(column.windows(3)) {
                *o = three[0] | three[1] | three[2];
            }
            (row[0], row[w - 1]) = (column[1], column[w - 2]);
        }
    }
}

/// The votes of the pixels in a box for the centres in another, whose votes lie in `raw` row by row.
struct Voting<'a> {
    raw: &'a mut [u16],
    image: &'a GreyView<'a>,
    radius: f32,
    pixels: &'a Region,
    centres: &'a Region,
    /// By pixel of the whole picture, where only what moves votes.
    moving: Option<&'a [u8]>,
}

impl pulp::NullaryFnOnce for Voting<'_> {
    /// Where votes may have fallen.
    type Output = Region;

    #[inline(always)]
    fn call(self) -> Region {
        cast_votes(self)
    }
}

/// Pixels taken in one step.
const STEP: usize = 32;

#[inline(always)]
fn cast_votes(Voting { raw, image, radius, pixels, centres, moving }: Voting) -> Region {
    let (width, height) = (centres.width() as u32, centres.height() as u32);
    let reach = radius.ceil() as i64 + 1;
    let mut seen = Region { x0: centres.x1, y0: centres.y1, x1: centres.x0, y1: centres.y0 };
    let (x0, x1) = (pixels.x0.max(1) as usize, pixels.x1.min(image.width as i64 - 2));
    for y in pixels.y0.max(image.first_row as i64 + 1)..=pixels.y1.min((image.first_row + image.rows) as i64 - 2) {
        let rows = [y - 1, y, y + 1].map(|r| image.row(r as usize));
        let [Some(above), Some(here), Some(below)] = rows else { continue };
        let moving = moving.map(|moving| &moving[y as usize * image.width..][..image.width]);
        for start in (x0..(x1 + 1).max(0) as usize).step_by(STEP) {
            let n = STEP.min(x1 as usize + 1 - start);
            let moving = moving.map(|moving| &moving[start..start + n]);
            // Most of the picture is still.
            if moving.is_some_and(|moving| !moving.contains(&1)) {
                continue;
            }
            let (mut gx, mut gy) = ([0.0f32; STEP], [0.0f32; STEP]);
            let (left, right, above, below) = (&here[start - 1..][..n], &here[start + 1..][..n], &above[start..][..n], &below[start..][..n]);
            for i in 0..n {
                (gx[i], gy[i]) = (f32::from(right[i]) - f32::from(left[i]), f32::from(below[i]) - f32::from(above[i]));
            }
            let mut weight = [0u32; STEP];
            let (mut places, mut votes) = ([[0u32; STEP]; 2], [[0u32; STEP]; 2]);
            let (column, row) = ((start as i64 - centres.x0) as f32, (y - centres.y0) as f32);
            for i in 0..STEP {
                let g = (gx[i] * gx[i] + gy[i] * gy[i]).sqrt();
                weight[i] = if g >= LEAST { whole(g.min(CAP)) } else { 0 };
                let per = radius / g.max(LEAST);
                (gx[i], gy[i]) = (gx[i] * per, gy[i] * per);
            }
            if let Some(moving) = moving {
                for (weight, moving) in weight.iter_mut().zip(moving) {
                    *weight *= u32::from(*moving);
                }
            }
            for (side, sign) in [1.0, -1.0].into_iter().enumerate() {
                for i in 0..STEP {
                    let (x, y) = (whole(column + i as f32 + sign * gx[i]), whole(row + sign * gy[i]));
                    votes[side][i] = if (x < width) & (y < height) { weight[i] } else { 0 };
                    places[side][i] = y.wrapping_mul(width).wrapping_add(x);
                }
            }
            for (places, votes) in places.iter().zip(&votes) {
                for (place, vote) in places.iter().zip(votes) {
                    if *vote > 0
                        && let Some(sum) = raw.get_mut(*place as usize)
                    {
                        *sum = sum.saturating_add(*vote as u16);
                    }
                }
            }
            seen = Region {
                x0: seen.x0.min(start as i64 - reach).max(centres.x0),
                y0: seen.y0.min(y - reach).max(centres.y0),
                x1: seen.x1.max((start + n) as i64 + reach).min(centres.x1),
                y1: seen.y1.max(y + reach).min(centres.y1),
            };
        }
    }
    seen
}

/// The nearest integer; of a negative one its two's complement. Added to a small number the constant leaves it in the lowest bits: a cast
/// would take the pixels one by one.
#[inline(always)]
fn whole(value: f32) -> u32 {
    const ROUND: f32 = 12_582_912.0;
    (value + ROUND).to_bits().wrapping_sub(ROUND.to_bits())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(centre: (f64, f64), level: u8) -> GreyImage {
        let pixels = (0..120 * 100)
            .map(|i| {
                let (x, y) = ((i % 120) as f64, (i / 120) as f64);
                if (x - centre.0).hypot(y - centre.1) < 8.0 { level } else { 60 }
            })
            .collect();
        GreyImage { width: 120, height: 100, pixels }
    }

    #[test]
    fn truth_a_disc_brighter_or_darker_is_the_first_candidate() {
        let background = GreyImage { width: 120, height: 100, pixels: vec![60; 12_000] };
        for level in [20, 180] {
            let p = picture((70.3, 40.6), level);
            let found = candidates(&GreyView::of(&p), &background, 8.0);
            assert!((found[0].uv - Vector2::new(70.3, 40.6)).norm() < 1.2, "{found:?}");
            let near = nearby(&GreyView::of(&p), Vector2::new(67.0, 43.0), 8.0, 6).expect("inside");
            assert!((near - Vector2::new(70.3, 40.6)).norm() < 1.2, "{near}");
            assert!(nearby(&GreyView::of(&p), Vector2::new(3.0, 43.0), 8.0, 6).is_none());
        }
    }
}
