//! What lies behind the ball in one picture: continued inward from just outside the outline, with the help of the clip's median
//! picture where that is what is seen outside.

use crate::tracking::ball::ball_disc::WIDE;
use crate::tracking::ball::ball_model::BallPicture;
use crate::tracking::lanes::{LANES, Lanes, lanes};
use nalgebra::Vector2;

/// Pixels show the surroundings from so many deviations of the blur outside the outline (up to 1.5 % of the ball) to so many pixels, at
/// least some beyond that.
const CLEAR_OF_BALL: f64 = 2.17;
const SURROUNDINGS_PX: f64 = 4.5;
const LEAST_WIDTH_PX: f64 = 1.5;

/// The surroundings just outside the outline of one picture, continued inward.
pub struct Surroundings {
    side: usize,
    /// Length of a row of the sums.
    stride: usize,
    /// By pixel, over the pixels near it that show the surroundings: weight, grey level and its square, difference from the median
    /// picture and its square. Grey levels are counted from `level`.
    sums: [Vec<f32>; 5],
    level: f32,
}

/// The mean that continues the surroundings inward is weighted by a normal curve of this deviation, px, up to so many deviations; where
/// the blur is more than so many pixels it is wider in proportion, because the ball's edge is.
const NEAR_PX: f64 = 1.2;
const REACH: f64 = 3.3;
const NARROW_BLUR_PX: f64 = 0.8;
/// Less weight than this is nothing: the far corner of the reach has a fifteenth of a thousandth.
const LEAST_WEIGHT: f32 = 1e-6;
/// Variance of a median picture's pixel, grey levels squared.
const MEDIAN_VARIANCE: f32 = 1.0;
/// What is white nearly to the limit is cut off there: how bright it would be beside the ball, where less of it is seen, nobody knows.
const NEARLY_WHITE: f32 = 250.0;
const CUT_OFF_VARIANCE: f32 = 100.0 * 100.0;

impl Surroundings {
    /// `centre` is counted from the window's first pixel.
    pub fn of(picture: &BallPicture, centre: &Vector2<f64>, blur_px: f64) -> Self {
        let side = picture.side;
        let stride = side.next_multiple_of(WIDE) + WIDE;
        let clear = CLEAR_OF_BALL * blur_px;
        let (from, to) = (picture.radius_px + clear, picture.radius_px + SURROUNDINGS_PX.max(clear + LEAST_WIDTH_PX));
        let level = picture.pixels.first().copied().unwrap_or_default();
        let near = NEAR_PX * (blur_px / NARROW_BLUR_PX).max(1.0);
        let reach = ((REACH * near).ceil() as usize).min(WIDE / 2);
        let falling: Vec<f32> = (0..=2 * reach).map(|k| (-0.5 * (k.abs_diff(reach) as f64 / near).powi(2)).exp() as f32).collect();
        // With room for the reach on all sides.
        let mut sums: [Vec<f32>; 5] = std::array::from_fn(|_| vec![0.0; stride * (side + 2 * reach)]);
        for (i, grey) in picture.pixels.iter().enumerate() {
            let (x, y) = (i % side, i / side);
            let d2 = (x as f64 - centre.x).powi(2) + (y as f64 - centre.y).powi(2);
            if d2 > from * from && d2 < to * to && !picture.covered.as_ref().is_some_and(|c| c[i]) {
                let at = (y + reach) * stride + x + reach;
                let g = grey - level;
                let e = picture.behind.as_ref().map_or(0.0, |m| grey - m[i]);
                for (sum, v) in sums.iter_mut().zip([1.0, g, g * g, e, e * e]) {
                    sum[at] = v;
                }
            }
        }
        let count = if picture.behind.is_some() { 5 } else { 3 };
        for sum in sums.iter_mut().take(count) {
            pulp::Arch::new().dispatch(Spread { values: sum, falling: &falling, side, stride });
        }
        Surroundings { side, stride, sums, level }
    }

    /// What lies behind the ball at a pixel, with its variance: the mean of what is seen outside near it, or the median picture
    /// moved by the mean by which it differs from what is seen outside near it, whichever varies less there. `None` when nothing
    /// outside is near.
    pub fn behind(&self, picture: &BallPicture, pixel: usize) -> Option<(f32, f32)> {
        let at = pixel / self.side * self.stride + pixel % self.side;
        let weight = *self.sums[0].get(at)?;
        if weight < LEAST_WEIGHT {
            return None;
        }
        let moments = |sum: &[f32], square: &[f32]| {
            let mean = sum[at] / weight;
            (mean, (square[at] / weight - mean * mean).max(0.0))
        };
        let [_, grey, grey_square, off, off_square] = &self.sums;
        let (mean, spread) = moments(grey, grey_square);
        let known = picture.behind.as_ref().map(|m| {
            let (off, off_spread) = moments(off, off_square);
            (m[pixel] + off, off_spread + MEDIAN_VARIANCE)
        });
        let (behind, variance) = known.filter(|k| k.1 < spread).unwrap_or((mean + self.level, spread));
        Some((behind, if behind > NEARLY_WHITE { variance + CUT_OFF_VARIANCE } else { variance }))
    }
}

/// Sums values over their neighbours with falling weights on either side, rows then columns. The values stand so many pixels from the
/// upper left corner, the sums in it.
struct Spread<'a> {
    values: &'a mut [f32],
    falling: &'a [f32],
    side: usize,
    stride: usize,
}

impl pulp::NullaryFnOnce for Spread<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Spread { values, falling, side, stride } = self;
        let width = side.next_multiple_of(WIDE);
        let mut line = vec![0.0f32; width];
        for row in values.chunks_exact_mut(stride) {
            for at in (0..width).step_by(LANES) {
                let mut sum = Lanes::ZERO;
                for (k, weight) in falling.iter().enumerate() {
                    if let Some(places) = lanes(row, at + k) {
                        sum = sum.plus_times(places, *weight);
                    }
                }
                line[at..at + LANES].copy_from_slice(&sum.0);
            }
            row[..width].copy_from_slice(&line);
        }
        for y in 0..side {
            for at in (y * stride..y * stride + width).step_by(LANES) {
                let mut sum = Lanes::ZERO;
                for (k, weight) in falling.iter().enumerate() {
                    if let Some(places) = lanes(values, at + k * stride) {
                        sum = sum.plus_times(places, *weight);
                    }
                }
                values[at..at + LANES].copy_from_slice(&sum.0);
            }
        }
    }
}
