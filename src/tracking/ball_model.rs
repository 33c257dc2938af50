//! The ball as one camera should see it: a sphere of known size, its light, its cover, the lens' blur, and what lies behind it;
//! and the centre that makes a picture agree with it.
//!
//! [`super::ball_fit`] knows nothing but a circle and takes the grey levels along it as they come. Here the levels of the ball
//! are known from all pictures together, so that one side of the outline is enough and a dark line on the outline is
//! expected. What lies behind the outline is continued from just outside it, with the help of the clip's median picture
//! where that is what is seen outside.

use super::ball_disc::{BallDisc, WIDE, add};
use super::ball_light::BallLight;
use super::ball_texture::BallTexture;
use nalgebra::{Matrix2, Matrix3, SMatrix, SVector, Vector2};

/// Pixels kept around the ball beyond its radius.
pub const MARGIN_PX: f64 = 5.0;
/// Blur of lens and pixel, px, one standard deviation.
pub const BLUR_PX: f64 = 0.62;
/// A pixel with more of the ball than this shows nothing else.
pub const CLEAR: f64 = 0.995;
/// How far inside the outline pixels count, in radii: the lines hold the centre too.
const INSIDE: f64 = 0.72;
/// Pixels show the surroundings from here to there outside the outline: up to 1.5 % of the ball, px.
const SURROUNDINGS_PX: (f64, f64) = (2.17 * BLUR_PX, 4.5);
/// As long as the centre has moved by less, the surroundings stay as they are, px.
const SAME_SURROUNDINGS_PX: f64 = 0.05;
/// How far outside pixels take part, px, and the least share of the ball they must show.
const OUTSIDE_PX: f64 = 3.0;
const LEAST_SHARE: f64 = 0.03;
/// What the model itself is good to, as a share of the ball's brightness (cover not quite as learnt, light not quite so).
const MODEL: f64 = 0.03;
/// Tukey's limit, in deviations: 95 % efficient for normal residuals.
const TUKEY: f64 = 4.685;
/// How far the light of one picture may differ from one side of the disc to the other from the light of all.
const TILT: f64 = 0.03;
const ROUNDS: usize = 8;
/// The first of them weigh pixels by Huber's rule.
const HUBER_ROUNDS: usize = 2;
/// A step below this ends a fit, px.
const SETTLED_PX: f64 = 0.003;
/// Sectors of the outline whose pulls count as independent: 30 degrees, a line or a panel's border.
const SECTORS: usize = 12;

/// One picture of the ball.
pub struct BallPicture {
    /// Grey levels, `side` to a row.
    pub pixels: Vec<f64>,
    /// The same window of the clip's median picture.
    pub behind: Option<Vec<f64>>,
    pub side: usize,
    /// Of the top left pixel.
    pub origin: Vector2<f64>,
    /// Present estimate, px in the camera's picture.
    pub centre: Vector2<f64>,
    pub radius_px: f64,
    /// Rows: right and down in the picture and away from the camera, at the ball, in global axes.
    pub camera_from_global: Matrix3<f64>,
    /// Ball's axes from the camera's axes at the ball.
    pub ball_from_camera: Matrix3<f64>,
    /// Light of this picture against the mean of all (flicker).
    pub gain: f64,
    /// Whether the ball is round and free here, so that the cover may be learnt.
    pub teaches: bool,
    /// Before the impact 0, after it 1: each has a cover of its own, because the ball's attitude jumps.
    pub stretch: usize,
}

/// What all pictures of a stretch share.
#[derive(Clone, Copy)]
pub struct BallModel<'a> {
    pub light: &'a BallLight,
    pub texture: &'a BallTexture,
    /// Of one pixel, grey levels.
    pub noise: f64,
}

/// A fitted centre.
#[derive(Debug, Clone, Copy)]
pub struct ModelFit {
    pub centre: Vector2<f64>,
    /// px²; from the scatter of the sectors' pulls, so that a misfit shared by neighbouring pixels counts as one.
    pub covariance: Matrix2<f64>,
    pub gain: f64,
    /// Share of the pixels near the outline that agree with the model.
    pub agreeing: f64,
}

impl BallPicture {
    /// The disc with light and cover, for gain 1.
    pub fn painted(&self, disc: &BallDisc, light: &BallLight, texture: &BallTexture) -> Vec<f32> {
        let toward = self.camera_from_global * light.light;
        disc.painted(|n| light.at(n, &toward) * texture.at(&(self.ball_from_camera * n)))
    }

    /// The centre nearest to `self.centre` at which picture and model agree best. `tilted` leaves the light free to be a
    /// little brighter on one side, for a centre that was fitted without. `None` when the picture does not determine it.
    pub fn fit(&self, disc: &BallDisc, painted: &[f32], model: &BallModel, tilted: bool) -> Option<ModelFit> {
        let noise = model.noise;
        let (mut centre, mut gain) = (self.centre - self.origin, self.gain);
        let unknowns = if tilted { 5 } else { 3 };
        let mut rows: Vec<(SVector<f64, 5>, f64, f64, Vector2<f64>)> = Vec::with_capacity(400);
        let mut around = Surroundings::of(self, &centre);
        // A tilt is asked for where the centre without it is known: there is nothing to be careful about.
        for round in if tilted { HUBER_ROUNDS } else { 0 }..ROUNDS {
            // A few pixels more or less at their edge do not change them.
            if (centre - around.centre).norm() > SAME_SURROUNDINGS_PX {
                around = Surroundings::of(self, &centre);
            }
            let [cover, ball] = disc.blurred([&disc.cover, painted], &centre, self.side, BLUR_PX, true);
            rows.clear();
            for (i, grey) in self.pixels.iter().enumerate() {
                let d = Vector2::new((i % self.side) as f64, (i / self.side) as f64) - centre;
                let rho = d.norm() - self.radius_px;
                let share = f64::from(cover.value[i]);
                if rho < -INSIDE * self.radius_px || rho > OUTSIDE_PX || share < LEAST_SHARE {
                    continue;
                }
                let bright = f64::from(ball.value[i]);
                let (behind, spread) = if share > CLEAR { (0.0, 0.0) } else { around.behind(i)? };
                let slope = |ball: &[f32], cover: &[f32]| gain * f64::from(ball[i]) - f64::from(cover[i]) * behind;
                let (jx, jy) = (slope(&ball.by_x, &cover.by_x), slope(&ball.by_y, &cover.by_y));
                let outside = if share > CLEAR { 0.0 } else { 1.0 - share };
                let residual = grey - gain * bright - outside * behind;
                let variance = noise * noise + (MODEL * gain * bright).powi(2) + outside * outside * spread;
                let (tx, ty) = if tilted { (bright * d.x / self.radius_px, bright * d.y / self.radius_px) } else { (0.0, 0.0) };
                rows.push((SVector::<f64, 5>::from([jx, jy, bright, tx, ty]), residual, variance, d));
            }
            if rows.len() < 40 {
                return None;
            }
            let mut sizes: Vec<f64> = rows.iter().map(|r| r.1.abs() / r.2.sqrt()).collect();
            let mid = sizes.len() / 2;
            let scale = (*sizes.select_nth_unstable_by(mid, f64::total_cmp).1 / 0.6745).max(1.0);
            let mut h = SMatrix::<f64, 5, 5>::zeros();
            let mut g = SVector::<f64, 5>::zeros();
            // Huber first, so that a start half a pixel off is not taken for an outlier all around.
            let weigh = |r: f64, variance: f64| {
                let z = r.abs() / (variance.sqrt() * scale);
                (z, if round < HUBER_ROUNDS { 1.0 / z.max(1.5) * 1.5 } else { (1.0 - (z / TUKEY).powi(2)).max(0.0).powi(2) } / variance)
            };
            for (j, r, variance, _) in &rows {
                let (_, w) = weigh(*r, *variance);
                for a in 0..unknowns {
                    g[a] += j[a] * r * w;
                    for b in a..unknowns {
                        h[(a, b)] += j[a] * j[b] * w;
                    }
                }
            }
            h.fill_lower_triangle_with_upper_triangle();
            for k in 3..5 {
                h[(k, k)] += if tilted { 1.0 / (TILT * gain).powi(2) } else { 1.0 };
            }
            let inverse = h.try_inverse()?;
            let step = inverse * g;
            centre += step.fixed_rows::<2>(0).map(|v| v.clamp(-0.5, 0.5));
            gain += step[2];
            if !(centre.norm().is_finite() && gain > 0.05 && gain < 20.0) {
                return None;
            }
            if round > HUBER_ROUNDS && step.fixed_rows::<2>(0).norm() < SETTLED_PX || round + 1 == ROUNDS {
                let mut pulls = [SVector::<f64, 5>::zeros(); SECTORS];
                let mut agreeing = 0;
                for (j, r, variance, d) in &rows {
                    let (z, w) = weigh(*r, *variance);
                    agreeing += usize::from(z < 2.5);
                    pulls[sector_of(d)] += j * (r * w);
                }
                let scatter: SMatrix<f64, 5, 5> = pulls.iter().map(|p| p * p.transpose()).sum();
                let freedom = SECTORS as f64 / (SECTORS - unknowns) as f64;
                let covariance = (inverse * scatter * inverse).fixed_view::<2, 2>(0, 0) * freedom + inverse.fixed_view::<2, 2>(0, 0);
                let fit = ModelFit { centre: centre + self.origin, covariance, gain, agreeing: agreeing as f64 / rows.len().max(unknowns) as f64 };
                return (covariance[(0, 0)] > 0.0 && covariance[(1, 1)] > 0.0 && covariance.norm().is_finite()).then_some(fit);
            }
        }
        None
    }
}

fn sector_of(d: &Vector2<f64>) -> usize {
    let turn = (d.y.atan2(d.x) / std::f64::consts::TAU).rem_euclid(1.0);
    ((turn * SECTORS as f64) as usize).min(SECTORS - 1)
}

/// The surroundings just outside the outline of one picture, continued inward.
pub struct Surroundings<'a> {
    picture: &'a BallPicture,
    /// Where the outline was, from the window's first pixel.
    centre: Vector2<f64>,
    /// Length of a row of the sums.
    stride: usize,
    /// By pixel, over the pixels near it that show the surroundings: weight, grey level and its square, difference from the median
    /// picture and its square. Grey levels are counted from `level`.
    sums: [Vec<f32>; 5],
    level: f64,
}

/// Reach of the mean that continues the surroundings inward, px, and the weights of pixels 0 to 4 columns or rows away: a
/// normal curve of 1.2 px.
const NEAR: usize = 4;
const FALLING: [f32; NEAR + 1] = [1.0, 0.706_648, 0.249_352, 0.043_937, 0.003_866];
/// Less weight than this is nothing: the far corner of the reach has a fifteenth of a thousandth.
const LEAST_WEIGHT: f32 = 1e-6;
/// Variance of a median picture's pixel, grey levels squared.
const MEDIAN_VARIANCE: f64 = 1.0;

impl<'a> Surroundings<'a> {
    /// `centre` is counted from the window's first pixel.
    pub fn of(picture: &'a BallPicture, centre: &Vector2<f64>) -> Self {
        let side = picture.side;
        let stride = side.next_multiple_of(WIDE) + WIDE;
        let (from, to) = (picture.radius_px + SURROUNDINGS_PX.0, picture.radius_px + SURROUNDINGS_PX.1);
        let level = picture.pixels.first().copied().unwrap_or_default();
        // With room for the reach on all sides.
        let mut sums: [Vec<f32>; 5] = std::array::from_fn(|_| vec![0.0; stride * (side + 2 * NEAR)]);
        for (i, grey) in picture.pixels.iter().enumerate() {
            let (x, y) = (i % side, i / side);
            let d2 = (x as f64 - centre.x).powi(2) + (y as f64 - centre.y).powi(2);
            if d2 > from * from && d2 < to * to {
                let at = (y + NEAR) * stride + x + NEAR;
                let g = (grey - level) as f32;
                let e = picture.behind.as_ref().map_or(0.0, |m| (grey - m[i]) as f32);
                for (sum, v) in sums.iter_mut().zip([1.0, g, g * g, e, e * e]) {
                    sum[at] = v;
                }
            }
        }
        let count = if picture.behind.is_some() { 5 } else { 3 };
        for sum in sums.iter_mut().take(count) {
            pulp::Arch::new().dispatch(Spread { values: sum, side, stride });
        }
        Surroundings { picture, centre: *centre, stride, sums, level }
    }

    /// What lies behind the ball at a pixel, with its variance: the mean of what is seen outside near it, or the median picture
    /// moved by the mean by which it differs from what is seen outside near it, whichever varies less there. `None` when nothing
    /// outside is near.
    pub fn behind(&self, pixel: usize) -> Option<(f64, f64)> {
        let at = pixel / self.picture.side * self.stride + pixel % self.picture.side;
        let weight = *self.sums[0].get(at)?;
        if weight < LEAST_WEIGHT {
            return None;
        }
        let moments = |sum: &[f32], square: &[f32]| {
            let mean = f64::from(sum[at] / weight);
            (mean, (f64::from(square[at] / weight) - mean * mean).max(0.0))
        };
        let [_, grey, grey_square, off, off_square] = &self.sums;
        let (mean, spread) = moments(grey, grey_square);
        let known = self.picture.behind.as_ref().map(|m| {
            let (off, off_spread) = moments(off, off_square);
            (m[pixel] + off, off_spread + MEDIAN_VARIANCE)
        });
        Some(known.filter(|k| k.1 < spread).unwrap_or((mean + self.level, spread)))
    }
}

/// Sums values over their neighbours with [`FALLING`] weights, rows then columns. The values stand [`NEAR`] pixels from the upper left
/// corner, the sums in it.
struct Spread<'a> {
    values: &'a mut [f32],
    side: usize,
    stride: usize,
}

impl pulp::NullaryFnOnce for Spread<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Spread { values, side, stride } = self;
        let width = side.next_multiple_of(WIDE);
        let mut line = vec![0.0f32; width];
        for row in values.chunks_exact_mut(stride) {
            line.fill(0.0);
            for k in 0..=2 * NEAR {
                add(&mut line, &row[k..k + width], FALLING[k.abs_diff(NEAR)]);
            }
            row[..width].copy_from_slice(&line);
        }
        for y in 0..side {
            line.fill(0.0);
            for k in 0..=2 * NEAR {
                let from = (y + k) * stride;
                add(&mut line, &values[from..from + width], FALLING[k.abs_diff(NEAR)]);
            }
            values[y * stride..y * stride + width].copy_from_slice(&line);
        }
    }
}
