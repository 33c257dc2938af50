//! The ball's disc at a finer spacing than the pixels, and the lens that blurs it into a picture.
//!
//! Light and cover change within a pixel (a drawn line is one pixel wide), so the disc is drawn unblurred, two places per
//! pixel either way, and blurred by two passes of a normal curve that stands for lens and pixel together. Moving the centre by
//! part of a pixel needs the second step only, and the derivatives come with it.

use crate::tracking::lanes::{LANES, Lanes, lanes};
use nalgebra::Vector2;
use std::ops::Range;

/// Values at a time; lengths of rows are multiples of it.
pub const WIDE: usize = 16;
/// Places of the disc that one pixel sees along a row: so many deviations of the blur either way, within these numbers.
const REACH: f64 = 3.2;
const TAPS: (usize, usize) = (10, 20);
/// Places in a pixel: a whole number, so that all pixels of a row see their places with the same weights. The blur is 1.2 places
/// wide, which leaves nothing of what a finer drawing would add.
const PER_PIXEL: usize = 2;
/// Empty places on either side of a row, for pixels that see little or nothing of the ball.
const MARGIN: usize = 24;

/// Places of one disc and how much of each lies on the ball.
pub struct BallDisc {
    /// Rows and columns of the ball's square.
    places: usize,
    /// A row holds every [`PER_PIXEL`]-th column after one another, beginning with the first, then with the second, and so on: what
    /// neighbouring pixels see through one tap stands side by side. Length of each such part.
    part: usize,
    /// Share of each place on the ball.
    pub cover: Vec<f32>,
    pub on_ball: PlacesOnBall,
}

/// The places of a disc that lie on the ball, one after another.
#[derive(Default)]
pub struct PlacesOnBall {
    /// Where among all places.
    pub at: Vec<u32>,
    /// Share on the ball.
    pub cover: Vec<f32>,
    /// Normals, camera axes.
    pub normals: [Vec<f32>; 3],
}

/// How the pixels of a row or column look at the disc: all with the same weights, each [`PER_PIXEL`] places farther on.
struct Look {
    /// First place that the first pixel sees, and how many it sees.
    from: isize,
    taps: usize,
    weight: [f32; TAPS.1],
    /// Derivatives of the weights by the centre.
    by_centre: [f32; TAPS.1],
}

/// A blurred disc: values and derivatives by the centre, row by row of a window.
#[derive(Default, Clone)]
pub struct Blurred {
    pub value: Vec<f32>,
    pub by_x: Vec<f32>,
    pub by_y: Vec<f32>,
}

impl BallDisc {
    pub fn new(radius_px: f64) -> Self {
        let spacing = 1.0 / PER_PIXEL as f32;
        let radius = radius_px as f32;
        let half = ((radius + 1.0) / spacing).ceil() as usize;
        let places = 2 * half + 1;
        let part = (places + 2 * MARGIN).div_ceil(PER_PIXEL).next_multiple_of(WIDE) + WIDE;
        let stride = PER_PIXEL * part;
        let room = (3.3 * (radius / spacing + 1.0).powi(2)) as usize;
        let on_ball = PlacesOnBall { at: Vec::with_capacity(room), cover: Vec::with_capacity(room), normals: [0; 3].map(|_| Vec::with_capacity(room)) };
        let mut disc = BallDisc { places, part, cover: vec![0.0; places * stride], on_ball };
        let (inner, outer) = ((radius - 0.5 * spacing).max(0.0).powi(2), (radius + 0.5 * spacing).powi(2));
        for row in 0..places {
            let y = (row as f32 - half as f32) * spacing;
            for column in 0..places {
                let x = (column as f32 - half as f32) * spacing;
                let square = x * x + y * y;
                if square >= outer {
                    continue;
                }
                let at = row * stride + (MARGIN + column) % PER_PIXEL * part + (MARGIN + column) / PER_PIXEL;
                // Outside the radius what is seen is the limb.
                let (share, out) = if square < inner {
                    (1.0, 1.0 / radius)
                } else {
                    let rho = square.sqrt();
                    ((radius - rho) / spacing + 0.5, 1.0 / rho.max(radius))
                };
                disc.cover[at] = share;
                disc.on_ball.at.push(at as u32);
                disc.on_ball.cover.push(share);
                for (all, n) in disc.on_ball.normals.iter_mut().zip([x * out, y * out, -(1.0 - square * out * out).max(0.0).sqrt()]) {
                    all.push(n);
                }
            }
        }
        disc
    }

    /// The disc with a brightness at each of the places on the ball, what they hide of the background counted.
    pub fn painted(&self, brightness: impl Iterator<Item = f32>) -> Vec<f32> {
        let mut out = vec![0.0; self.cover.len()];
        for (at, brightness) in self.on_ball.at.iter().zip(brightness) {
            if let Some(o) = out.get_mut(*at as usize) {
                *o = brightness;
            }
        }
        out
    }

    /// Which places the pixels at `first`, `first` + 1, ... (px from the centre) look at.
    fn look(&self, first: f64, blur_px: f64) -> Look {
        let spacing = 1.0 / PER_PIXEL as f64;
        // A place's own width is part of the blur.
        let blur_px = (blur_px * blur_px - spacing * spacing / 12.0).max(0.01).sqrt();
        let at = first / spacing + (self.places / 2) as f64;
        let taps = ((2.0 * REACH * blur_px / spacing).ceil() as usize).clamp(TAPS.0, TAPS.1);
        let from = (at - 0.5 * (taps - 1) as f64).ceil();
        let unit = spacing / ((std::f64::consts::TAU).sqrt() * blur_px);
        let (mut weight, mut by_centre) = ([0.0; TAPS.1], [0.0; TAPS.1]);
        for i in 0..taps {
            let t = (at - from - i as f64) * spacing / blur_px;
            let w = unit * (-0.5 * t * t).exp();
            weight[i] = w as f32;
            by_centre[i] = (w * t / blur_px) as f32;
        }
        Look { from: from as isize, taps, weight, by_centre }
    }

    /// Blurs discs (from [`Self::painted`] or the cover) into a window of `side` x `side` pixels whose first pixel is the picture's
    /// (0, 0); `centre` is counted from it.
    pub fn blurred<const K: usize>(&self, discs: [&[f32]; K], centre: &Vector2<f64>, side: usize, blur_px: f64, slopes: bool) -> [Blurred; K] {
        let (columns, rows) = (self.look(-centre.x, blur_px), self.look(-centre.y, blur_px));
        discs.map(|painted| pulp::Arch::new().dispatch(Blur { disc: self, painted, columns: &columns, rows: &rows, side, slopes }))
    }

    /// What the pixels of a window say of each place: the transposed blur.
    pub fn gathered<const K: usize>(&self, windows: [&[f32]; K], centre: &Vector2<f64>, side: usize, blur_px: f64) -> [Vec<f32>; K] {
        let (columns, rows) = (self.look(-centre.x, blur_px), self.look(-centre.y, blur_px));
        windows.map(|window| pulp::Arch::new().dispatch(Gather { disc: self, window, columns: &columns, rows: &rows, side }))
    }

    /// Where in a row the ball's square stands in the `k`-th of its parts.
    #[inline(always)]
    fn middle(&self, k: usize) -> Range<usize> {
        let first = k * self.part + MARGIN / PER_PIXEL;
        first..first + (self.places / PER_PIXEL + 2).next_multiple_of(WIDE)
    }

    /// Where in a row the `count` places stand that the first and following pixels see through a tap; `None` where the row does not
    /// hold them all.
    #[inline(always)]
    fn seen(&self, look: &Look, tap: usize, count: usize) -> Option<Range<usize>> {
        let column = usize::try_from(look.from + (MARGIN + tap) as isize).ok()?;
        let first = column / PER_PIXEL;
        let at = column % PER_PIXEL * self.part + first;
        (first + count <= self.part).then_some(at..at + count)
    }
}

struct Blur<'a> {
    disc: &'a BallDisc,
    painted: &'a [f32],
    columns: &'a Look,
    rows: &'a Look,
    side: usize,
    slopes: bool,
}

impl pulp::NullaryFnOnce for Blur<'_> {
    type Output = Blurred;

    /// Each pixel row's line of the disc first, then its pixels, all of them side by side.
    #[inline(always)]
    fn call(self) -> Blurred {
        let Blur { disc, painted, columns, rows, side, slopes } = self;
        let n = side * side;
        let empty = if slopes { n } else { 0 };
        let mut out = Blurred { value: vec![0.0; n], by_x: vec![0.0; empty], by_y: vec![0.0; empty] };
        let width = side.next_multiple_of(WIDE);
        let stride = PER_PIXEL * disc.part;
        let (mut line, mut slope) = (vec![0.0f32; stride], vec![0.0f32; stride]);
        let (mut value, mut by_x, mut by_y) = (vec![0.0f32; width], vec![0.0f32; width], vec![0.0f32; width]);
        let mut seen = [None; TAPS.1];
        for (tap, start) in seen.iter_mut().enumerate().take(columns.taps) {
            *start = disc.seen(columns, tap, width).map(|r| r.start);
        }
        for v in 0..side {
            // The rows that this pixel row sees, of those that the disc has.
            let first = rows.from + (v * PER_PIXEL) as isize;
            let taps = (-first).clamp(0, rows.taps as isize) as usize..(disc.places as isize - first).clamp(0, rows.taps as isize) as usize;
            for k in 0..PER_PIXEL {
                for at in disc.middle(k).step_by(LANES) {
                    let (mut sum, mut change) = (Lanes::ZERO, Lanes::ZERO);
                    for tap in taps.clone() {
                        let Some(places) = lanes(painted, (first + tap as isize) as usize * stride + at) else { break };
                        sum = sum.plus_times(places, rows.weight[tap]);
                        if slopes {
                            change = change.plus_times(places, rows.by_centre[tap]);
                        }
                    }
                    line[at..at + LANES].copy_from_slice(&sum.0);
                    slope[at..at + LANES].copy_from_slice(&change.0);
                }
            }
            for at in (0..width).step_by(LANES) {
                let (mut sum, mut change_x, mut change_y) = (Lanes::ZERO, Lanes::ZERO, Lanes::ZERO);
                for (tap, start) in seen.iter().enumerate().take(columns.taps) {
                    let Some(start) = start else { continue };
                    let (Some(places), Some(changes)) = (lanes(&line, start + at), lanes(&slope, start + at)) else { continue };
                    sum = sum.plus_times(places, columns.weight[tap]);
                    if slopes {
                        change_x = change_x.plus_times(places, columns.by_centre[tap]);
                        change_y = change_y.plus_times(changes, columns.weight[tap]);
                    }
                }
                value[at..at + LANES].copy_from_slice(&sum.0);
                by_x[at..at + LANES].copy_from_slice(&change_x.0);
                by_y[at..at + LANES].copy_from_slice(&change_y.0);
            }
            let row = v * side..(v + 1) * side;
            out.value[row.clone()].copy_from_slice(&value[..side]);
            if slopes {
                out.by_x[row.clone()].copy_from_slice(&by_x[..side]);
                out.by_y[row].copy_from_slice(&by_y[..side]);
            }
        }
        out
    }
}

struct Gather<'a> {
    disc: &'a BallDisc,
    window: &'a [f32],
    columns: &'a Look,
    rows: &'a Look,
    side: usize,
}

impl pulp::NullaryFnOnce for Gather<'_> {
    type Output = Vec<f32>;

    /// Each pixel row spread over its line of the disc first, then each row of the disc from the lines of the pixel rows that see it.
    #[inline(always)]
    fn call(self) -> Vec<f32> {
        let Gather { disc, window, columns, rows, side } = self;
        let mut out = vec![0.0f32; disc.cover.len()];
        let width = disc.middle(0).len();
        let mut lines = vec![0.0f32; side * PER_PIXEL * width];
        // A row of pixels with nothing on either side.
        let mut padded = vec![0.0f32; side + 2 * (MARGIN + width)];
        for (pixels, lines) in window.chunks_exact(side.max(1)).zip(lines.chunks_exact_mut(PER_PIXEL * width)) {
            padded[MARGIN + width..MARGIN + width + side].copy_from_slice(pixels);
            for (k, line) in lines.chunks_exact_mut(width).enumerate() {
                let first = disc.middle(k).start - k * disc.part + MARGIN + width;
                for at in (0..width).step_by(LANES) {
                    let mut sum = Lanes::ZERO;
                    for tap in 0..columns.taps {
                        let column = columns.from + (MARGIN + tap) as isize;
                        if column.rem_euclid(PER_PIXEL as isize) as usize != k {
                            continue;
                        }
                        let from = usize::try_from((first + at) as isize - column.div_euclid(PER_PIXEL as isize));
                        if let Some(pixels) = from.ok().and_then(|from| lanes(&padded, from)) {
                            sum = sum.plus_times(pixels, columns.weight[tap]);
                        }
                    }
                    line[at..at + LANES].copy_from_slice(&sum.0);
                }
            }
        }
        for row in 0..disc.places {
            let seen_from = row as isize - rows.from;
            let first = (seen_from - rows.taps as isize).div_euclid(PER_PIXEL as isize) + 1;
            let seen = first.clamp(0, side as isize) as usize..(seen_from.div_euclid(PER_PIXEL as isize) + 1).clamp(0, side as isize) as usize;
            for k in 0..PER_PIXEL {
                let to = row * PER_PIXEL * disc.part + disc.middle(k).start;
                for at in (0..width).step_by(LANES) {
                    let mut sum = Lanes::ZERO;
                    for v in seen.clone() {
                        let tap = (seen_from - (v * PER_PIXEL) as isize) as usize;
                        if let (Some(line), Some(weight)) = (lanes(&lines, (v * PER_PIXEL + k) * width + at), rows.weight.get(tap)) {
                            sum = sum.plus_times(line, *weight);
                        }
                    }
                    out[to + at..to + at + LANES].copy_from_slice(&sum.0);
                }
            }
        }
        out
    }
}

/// Adds `weight` times one array to another; quickest where lengths are multiples of [`WIDE`].
#[inline(always)]
pub fn add(to: &mut [f32], from: &[f32], weight: f32) {
    for (to, from) in to.iter_mut().zip(from) {
        *to += weight * from;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn truth_the_blurred_cover_is_half_at_the_outline_and_its_sum_is_the_discs_area() {
        let (disc, centre) = (BallDisc::new(8.3), Vector2::new(13.27, 12.61));
        let [b] = disc.blurred([&disc.cover], &centre, 27, 0.62, false);
        let area: f64 = b.value.iter().map(|v| f64::from(*v)).sum();
        assert!((area / (std::f64::consts::PI * 8.3 * 8.3) - 1.0).abs() < 2e-3, "{area}");
        for (i, v) in b.value.iter().enumerate() {
            let rho = (Vector2::new((i % 27) as f64, (i / 27) as f64) - centre).norm() - 8.3;
            // A curved edge: the share half a blur's square over the radius lower than a straight one's.
            let straight = 0.5 * (1.0 - crate::tracking::tape::band::erf(rho / (0.62 * std::f64::consts::SQRT_2)));
            assert!((f64::from(*v) - straight).abs() < 0.03, "{rho} {v} {straight}");
        }
    }

    #[test]
    fn law_slopes_are_differences_and_gathering_is_the_transpose_of_blurring() {
        let disc = BallDisc::new(6.1);
        let PlacesOnBall { cover, normals: [x, y, z], .. } = &disc.on_ball;
        let painted = disc.painted((0..cover.len()).map(|i| cover[i] * (100.0 + 50.0 * x[i] - 30.0 * y[i] * z[i])));
        let (centre, h) = (Vector2::new(10.3, 9.8), 1e-2);
        let at = |x: f64, y: f64| disc.blurred([&painted], &Vector2::new(x, y), 21, 0.62, true)[0].clone();
        let (now, right, left, down, up) = (at(10.3, 9.8), at(10.3 + h, 9.8), at(10.3 - h, 9.8), at(10.3, 9.8 + h), at(10.3, 9.8 - h));
        for i in 0..441 {
            assert!((f64::from(right.value[i] - left.value[i]) / (2.0 * h) - f64::from(now.by_x[i])).abs() < 0.3);
            assert!((f64::from(down.value[i] - up.value[i]) / (2.0 * h) - f64::from(now.by_y[i])).abs() < 0.3);
        }
        let window: Vec<f32> = (0..441).map(|i| ((i * 37) % 11) as f32 - 4.0).collect();
        let [gathered] = disc.gathered([&window], &centre, 21, 0.62);
        let one: f64 = now.value.iter().zip(&window).map(|(a, b)| f64::from(a * b)).sum();
        let other: f64 = painted.iter().zip(&gathered).map(|(a, b)| f64::from(a * b)).sum();
        assert!((one / other - 1.0).abs() < 1e-3, "{one} {other}");
    }
}
