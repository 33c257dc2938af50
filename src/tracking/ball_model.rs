//! The ball as one camera should see it: a sphere of known size, its light, its cover, the lens' blur; and the centre
//! that makes a picture agree with it.
//!
//! [`super::ball_fit`] knows nothing but a circle and takes the grey levels along it as they come. Here the levels of the ball
//! are known from all pictures together, so that one side of the outline is enough and a dark line on the outline is
//! expected. Only the surroundings are taken from the picture itself, from just outside the outline.

use super::ball_texture::BallTexture;
use super::band::erf;
use nalgebra::{Matrix2, Matrix3, SMatrix, SVector, Vector2, Vector3, Vector4};

/// Pixels kept around the ball beyond its radius.
pub const MARGIN_PX: f64 = 5.0;
/// How far inside the outline pixels count, in radii. The lines hold the centre too: on practice footage 0.3 radii gave 0.62 to
/// 0.98 mm of the ball in space, 0.7 radii 0.59 to 0.79 mm.
const INSIDE: f64 = 0.72;
/// Pixels nearer to the outline than this show some of the surroundings and teach nothing about the cover.
const CLEAR_PX: f64 = 1.3;
/// A pixel with less of the ball than this shows the surroundings, up to so far outside.
const SURROUNDINGS: (f64, f64) = (0.015, 4.5);
/// What the model itself is good to, as a share of the ball's brightness (cover not evenly bright, light not quite so).
const MODEL: f64 = 0.05;
/// Tukey's limit, in deviations: 95 % efficient for normal residuals.
const TUKEY: f64 = 4.685;
/// How far the light of one picture may differ from one side of the disc to the other from the light of all.
const TILT: f64 = 0.03;
const ROUNDS: usize = 7;
/// Sectors of the outline whose pulls count as independent: 30 degrees, a line or a panel's border.
const SECTORS: usize = 12;

/// Light on the ball in one camera's axes (x right, y down, z away from the camera): ambient plus Lambert's law.
#[derive(Debug, Clone, Copy)]
pub struct BallLight {
    pub ambient: f64,
    /// Toward the light, with its strength, grey levels.
    pub light: Vector3<f64>,
}

impl BallLight {
    #[inline]
    fn at(&self, n: &Vector3<f64>) -> f64 {
        (self.ambient + n.dot(&self.light).max(0.0)).max(0.0)
    }

    /// Brightness where teaching pixels should not be divided by almost nothing.
    fn safe(&self, n: &Vector3<f64>) -> f64 {
        self.at(n).max(5.0)
    }
}

/// One picture of the ball.
pub struct BallPicture {
    /// Grey levels, `side` to a row.
    pub pixels: Vec<f64>,
    pub side: usize,
    /// Of the top left pixel.
    pub origin: Vector2<f64>,
    /// Present estimate, px in the camera's picture.
    pub centre: Vector2<f64>,
    pub radius_px: f64,
    /// Ball's axes from the camera's axes at the ball.
    pub ball_from_camera: Matrix3<f64>,
    /// Light of this picture against the mean of all (flicker).
    pub gain: f64,
    /// Whether the ball is round and free here, so that the cover may be learnt.
    pub teaches: bool,
    /// Weights of the teaching pixels, in the order of [`BallPicture::clear`].
    trust: Vec<f64>,
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
    pub fn new(
        pixels: Vec<f64>,
        side: usize,
        origin: Vector2<f64>,
        centre: Vector2<f64>,
        radius_px: f64,
        ball_from_camera: Matrix3<f64>,
        teaches: bool,
    ) -> Self {
        BallPicture { pixels, side, origin, centre, radius_px, ball_from_camera, gain: 1.0, teaches, trust: Vec::new() }
    }

    /// Normal (camera axes) and grey level of every pixel that shows nothing but the ball.
    fn clear(&self) -> Vec<(Vector3<f64>, f64)> {
        let middle = self.centre - self.origin;
        let mut out = Vec::new();
        for (i, grey) in self.pixels.iter().enumerate() {
            let d = (Vector2::new((i % self.side) as f64, (i / self.side) as f64) - middle) / self.radius_px;
            let q = d.norm_squared();
            if q.sqrt() * self.radius_px < self.radius_px - CLEAR_PX {
                out.push((Vector3::new(d.x, d.y, -(1.0 - q).max(0.0).sqrt()), *grey));
            }
        }
        out
    }

    /// The ball's share of a pixel at `d` px from the centre, and its brightness times that share, for gain 1.
    #[inline]
    fn expected(&self, d: &Vector2<f64>, light: &BallLight, texture: &BallTexture, rim: &Rim) -> (f64, f64) {
        let rho = d.norm();
        let from_outline = rho - self.radius_px;
        let out = if rho > 1e-6 { d / rho } else { Vector2::x() };
        let normal = |rho: f64| {
            let q = (rho / self.radius_px).clamp(-1.0, 1.0);
            Vector3::new(out.x * q, out.y * q, -(1.0 - q * q).sqrt())
        };
        let on_ball = |n: &Vector3<f64>| texture.at(&(self.ball_from_camera * n));
        if from_outline <= -rim.reach_px {
            let n = normal(rho);
            return (1.0, light.at(&n) * on_ball(&n));
        }
        let Some(RimShare { share, mean, sd }) = rim.at(from_outline) else { return (0.0, 0.0) };
        let (middle, brightness) = (normal(rho - mean), |rho: f64| light.at(&normal(rho)));
        let lit = 0.5 * (brightness(rho - mean - sd) + brightness((rho - mean + sd).min(self.radius_px)));
        (share, share * lit * on_ball(&middle))
    }

    /// The centre nearest to `self.centre` at which picture and model agree best. `tilted` leaves the light free to be a
    /// little brighter on one side. `None` when the picture does not determine it.
    pub fn fit(&self, light: &BallLight, texture: &BallTexture, rim: &Rim, noise: f64, tilted: bool) -> Option<ModelFit> {
        const STEP: f64 = 0.05;
        let (mut centre, mut gain) = (self.centre - self.origin, self.gain);
        let unknowns = if tilted { 5 } else { 3 };
        let mut rows: Vec<(SVector<f64, 5>, f64, f64, Vector2<f64>)> = Vec::with_capacity(400);
        for round in 0..ROUNDS {
            let around = Surroundings::of(self, &centre, rim);
            rows.clear();
            for (i, grey) in self.pixels.iter().enumerate() {
                let d = Vector2::new((i % self.side) as f64, (i / self.side) as f64) - centre;
                let rho = d.norm() - self.radius_px;
                if rho < -INSIDE * self.radius_px || rho > 3.0 {
                    continue;
                }
                let at = |dx: f64, dy: f64| self.expected(&(d - Vector2::new(dx, dy)), light, texture, rim);
                let (share, ball) = at(0.0, 0.0);
                if share < 0.03 {
                    continue;
                }
                let (behind, spread) = if share > 0.999 { (0.0, 0.0) } else { around.behind(i)? };
                let slope = |p: (f64, f64), m: (f64, f64)| (gain * (p.1 - m.1) - (p.0 - m.0) * behind) / (2.0 * STEP);
                let (jx, jy) = (slope(at(STEP, 0.0), at(-STEP, 0.0)), slope(at(0.0, STEP), at(0.0, -STEP)));
                let residual = grey - gain * ball - (1.0 - share) * behind;
                let variance = noise * noise + (MODEL * gain * ball).powi(2) + (1.0 - share).powi(2) * spread;
                let (tx, ty) = if tilted { (ball * d.x / self.radius_px, ball * d.y / self.radius_px) } else { (0.0, 0.0) };
                rows.push((SVector::<f64, 5>::from([jx, jy, ball, tx, ty]), residual, variance, d));
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
                (z, if round < 2 { 1.0 / z.max(1.5) * 1.5 } else { (1.0 - (z / TUKEY).powi(2)).max(0.0).powi(2) } / variance)
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
            if round >= 3 && step.fixed_rows::<2>(0).norm() < 0.003 || round + 1 == ROUNDS {
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

/// What a blurred pixel shows of the ball by its distance from the outline: computed once for a blur.
#[derive(Debug, Clone)]
pub struct Rim {
    /// Beyond this distance inward a pixel shows nothing but the ball, and outward nothing of it.
    reach_px: f64,
    /// Distance at which less of the ball shows than [`SURROUNDINGS`] allows.
    clear_px: f64,
    table: Vec<RimShare>,
}

/// Share of the ball, and the part of the ball that is seen: how far inside of the pixel its mean lies, and its deviation, px.
#[derive(Debug, Clone, Copy)]
struct RimShare {
    share: f64,
    mean: f64,
    sd: f64,
}

impl Rim {
    const SPACING_PX: f64 = 0.01;

    pub fn new(blur_px: f64) -> Self {
        let reach_px = 4.0 * blur_px;
        let count = (2.0 * reach_px / Self::SPACING_PX).ceil() as usize + 2;
        let at = |i: usize| {
            let x = (i as f64 * Self::SPACING_PX - reach_px) / blur_px;
            let share = 0.5 * (1.0 - erf(x * std::f64::consts::FRAC_1_SQRT_2));
            // Of a blurred pixel astride the outline only the part on the ball counts: mean and variance of a normal
            // distribution cut off at the outline.
            let hazard = (-0.5 * x * x).exp() / (std::f64::consts::TAU.sqrt() * share.max(1e-12));
            RimShare { share, mean: blur_px * hazard, sd: blur_px * (1.0 + x * hazard - hazard * hazard).max(1e-4).sqrt() }
        };
        let table: Vec<RimShare> = (0..count).map(at).collect();
        let clear = table.iter().position(|r| r.share < SURROUNDINGS.0).unwrap_or(count);
        Rim { reach_px, clear_px: clear as f64 * Self::SPACING_PX - reach_px, table }
    }

    #[inline]
    fn at(&self, from_outline_px: f64) -> Option<RimShare> {
        let x = (from_outline_px + self.reach_px) / Self::SPACING_PX;
        let i = x as usize;
        let (a, b) = (self.table.get(i)?, self.table.get(i + 1)?);
        let p = x - i as f64;
        Some(RimShare { share: a.share + p * (b.share - a.share), mean: a.mean + p * (b.mean - a.mean), sd: a.sd + p * (b.sd - a.sd) })
    }
}

/// The surroundings just outside the outline of one picture.
struct Surroundings<'a> {
    picture: &'a BallPicture,
    /// Whether a pixel shows them.
    outside: Vec<bool>,
}

/// Reach of the mean that continues the surroundings inward, px, and the weights of pixels 0 to 4 columns or rows away: a
/// normal curve of 1.2 px.
const NEAR: usize = 4;
const FALLING: [f64; NEAR + 1] = [1.0, 0.706_648, 0.249_352, 0.043_937, 0.003_866];

impl<'a> Surroundings<'a> {
    fn of(picture: &'a BallPicture, centre: &Vector2<f64>, rim: &Rim) -> Self {
        let seen = |i: usize| {
            let d = Vector2::new((i % picture.side) as f64, (i / picture.side) as f64) - centre;
            let rho = d.norm() - picture.radius_px;
            rho < SURROUNDINGS.1 && rho >= rim.clear_px
        };
        Surroundings { picture, outside: (0..picture.pixels.len()).map(seen).collect() }
    }

    /// What lies behind the ball at a pixel, with its variance; `None` when nothing outside is near.
    fn behind(&self, pixel: usize) -> Option<(f64, f64)> {
        let side = self.picture.side;
        let (column, row) = (pixel % side, pixel / side);
        let (mut weight, mut sum, mut square) = (1e-12, 0.0, 0.0);
        for y in row.saturating_sub(NEAR)..(row + NEAR + 1).min(side) {
            for x in column.saturating_sub(NEAR)..(column + NEAR + 1).min(side) {
                let at = y * side + x;
                if self.outside[at] {
                    let w = FALLING[x.abs_diff(column)] * FALLING[y.abs_diff(row)];
                    let grey = self.picture.pixels[at];
                    weight += w;
                    sum += w * grey;
                    square += w * grey * grey;
                }
            }
        }
        let mean = sum / weight;
        (weight > 1e-6).then(|| (mean, (square / weight - mean * mean).max(0.0)))
    }
}

/// Light, gains and cover from all pictures: `pictures` are grouped by stretch of flight (before, after), each with a cover of
/// its own because the ball's attitude jumps at the impact; `light` is common. Answers with the noise of one pixel.
pub fn learn(stretches: &mut [Vec<&mut BallPicture>], textures: &mut [BallTexture], light: &mut Option<BallLight>, textured: &[bool]) -> Option<f64> {
    let pixels: Vec<Vec<Vec<(Vector3<f64>, f64)>>> =
        stretches.iter().map(|s| s.iter().map(|p| if p.teaches { p.clear() } else { Vec::new() }).collect()).collect();
    let mut residuals: Vec<f64> = Vec::new();
    // A light that is known already settles sooner.
    let rounds = if light.is_some() { 3 } else { 6 };
    for round in 0..rounds {
        // The light, given cover and gains.
        let mut data: Vec<(Vector3<f64>, f64, f64, f64)> = Vec::new();
        for (k, stretch) in stretches.iter().enumerate() {
            for (picture, clear) in stretch.iter().zip(&pixels[k]) {
                for (i, (n, grey)) in clear.iter().enumerate() {
                    let relief = picture.gain * textures[k].at(&(picture.ball_from_camera * n));
                    data.push((*n, *grey, relief, picture.trust.get(i).copied().unwrap_or(1.0)));
                }
            }
        }
        let now = fit_light(&data, light.as_ref())?;
        *light = Some(now);
        // Gains and the trust in each pixel.
        residuals.clear();
        let (mut total, mut count) = (0.0, 0.0);
        for (k, stretch) in stretches.iter_mut().enumerate() {
            for (picture, clear) in stretch.iter_mut().zip(&pixels[k]).filter(|(_, c)| !c.is_empty()) {
                let model: Vec<f64> = clear.iter().map(|(n, _)| now.at(n) * textures[k].at(&(picture.ball_from_camera * n))).collect();
                picture.trust.resize(clear.len(), 1.0);
                let (mut a, mut b) = (1e-9, 0.0);
                for ((m, (_, grey)), w) in model.iter().zip(clear).zip(&picture.trust) {
                    a += w * m * m;
                    b += w * m * grey;
                }
                picture.gain = (b / a).clamp(0.2, 5.0);
                let misses: Vec<f64> = model.iter().zip(clear).map(|(m, (_, grey))| (grey - picture.gain * m).abs()).collect();
                let mut sorted = misses.clone();
                let mid = sorted.len() / 2;
                let usual = 1.5 * *sorted.select_nth_unstable_by(mid, f64::total_cmp).1 / 0.6745 + 2.0;
                picture.trust.iter_mut().zip(&misses).for_each(|(t, r)| *t = (usual / r.max(1e-9)).min(1.0));
                residuals.extend(misses);
                total += picture.gain;
                count += 1.0;
            }
        }
        if count == 0.0 {
            return None;
        }
        let mean = total / count;
        for picture in stretches.iter_mut().flatten() {
            picture.gain /= mean;
        }
        let now = BallLight { ambient: now.ambient * mean, light: now.light * mean };
        *light = Some(now);
        // The cover; not in the last round, so that light and gains belong to it.
        if round + 1 == rounds {
            break;
        }
        let usual = (now.ambient + 0.5 * now.light.norm()).max(1.0);
        for (k, stretch) in stretches.iter().enumerate().filter(|(k, _)| textured[*k]) {
            let samples = stretch.iter().zip(&pixels[k]).flat_map(|(picture, clear)| {
                clear.iter().enumerate().map(move |(i, (n, grey))| {
                    let bare = picture.gain * now.safe(n);
                    (picture.ball_from_camera * n, grey / bare, (bare / usual).powi(2) * picture.trust.get(i).copied().unwrap_or(1.0))
                })
            });
            textures[k] = BallTexture::of(samples);
        }
    }
    let mid = residuals.len() / 2;
    Some((*residuals.select_nth_unstable_by(mid, f64::total_cmp).1 / 0.6745).max(0.5))
}

/// Least squares over (normal, grey, gain times cover, weight); which pixels are lit depends on the answer, so several
/// starts unless there is one already.
fn fit_light(data: &[(Vector3<f64>, f64, f64, f64)], start: Option<&BallLight>) -> Option<BallLight> {
    if data.len() < 60 {
        return None;
    }
    let starts: Vec<Vector4<f64>> = match start {
        Some(l) => vec![l.light.push(l.ambient)],
        None => [[0.0, -0.3, -0.95], [0.0, -0.95, -0.3], [0.7, -0.6, -0.4], [-0.7, -0.6, -0.4], [0.7, -0.6, 0.4], [-0.7, -0.6, 0.4]]
            .map(|[x, y, z]| Vector4::new(x, y, z, 0.3) * 100.0)
            .to_vec(),
    };
    let mut best: Option<(f64, Vector4<f64>)> = None;
    for start in starts {
        let mut p = start;
        for _ in 0..12 {
            let (mut h, mut g) = (SMatrix::<f64, 4, 4>::identity() * 1e-6, Vector4::zeros());
            for (n, grey, relief, weight) in data {
                let lit = n.dot(&p.xyz()) > 0.0;
                let row = if lit { n.push(1.0) } else { Vector4::new(0.0, 0.0, 0.0, 1.0) } * *relief;
                h += row * row.transpose() * *weight;
                g += row * (*grey * *weight);
            }
            let next = h.cholesky()?.solve(&g);
            let done = (next - p).norm() < 1e-5 * p.norm();
            p = next;
            if done {
                break;
            }
        }
        let cost: f64 = data.iter().map(|(n, grey, relief, weight)| weight * (grey - relief * (p.w + n.dot(&p.xyz()).max(0.0))).powi(2)).sum();
        if cost.is_finite() && best.is_none_or(|b| cost < b.0) {
            best = Some((cost, p));
        }
    }
    best.map(|(_, p)| BallLight { ambient: p.w, light: p.xyz() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Rotation3;

    const RADIUS_PX: f64 = 8.3;

    /// A lit ball with a dark line around it before a dim background that is brighter on one side; every pixel the mean of
    /// 81 places under a normal blur, drawn without the model's approximations.
    fn drawn(centre: Vector2<f64>, turned: &Rotation3<f64>) -> Vec<f64> {
        let sun = Vector3::new(-0.5, -0.7, -0.5).normalize();
        let grey = |p: Vector2<f64>| {
            let d = (p - centre) / RADIUS_PX;
            let q = d.norm_squared();
            if q > 1.0 {
                return if p.x > 15.0 { 60.0 } else { 20.0 };
            }
            let n = Vector3::new(d.x, d.y, -(1.0 - q).sqrt());
            let cover = if (turned * n).x.abs() < 0.09 { 0.3 } else { 1.0 };
            cover * (50.0 + 110.0 * n.dot(&sun).max(0.0))
        };
        (0..27 * 27)
            .map(|i| {
                let (mut sum, mut weight) = (0.0, 0.0);
                for k in 0..81 {
                    let o = Vector2::new((k % 9) as f64 - 4.0, (k / 9) as f64 - 4.0) * 0.4;
                    let w = (-0.5 * o.norm_squared() / (0.62 * 0.62)).exp();
                    sum += w * grey(Vector2::new((i % 27) as f64, (i / 27) as f64) + o);
                    weight += w;
                }
                (sum / weight).round()
            })
            .collect()
    }

    #[test]
    fn truth_a_line_on_the_outline_and_uneven_surroundings_do_not_pull_the_centre() {
        let mut pictures: Vec<BallPicture> = Vec::new();
        let mut truth = Vec::new();
        for k in 0..16 {
            let centre = Vector2::new(13.0 + 0.4 * (k as f64 * 1.7).sin(), 13.0 + 0.4 * (k as f64 * 2.3).cos());
            let turned = Rotation3::from_scaled_axis(Vector3::new(0.05, 0.2, 0.1) * k as f64);
            let start = centre + Vector2::new(0.25 * (k as f64 * 0.9).cos(), 0.25 * (k as f64 * 1.3).sin());
            pictures.push(BallPicture::new(drawn(centre, &turned), 27, Vector2::zeros(), start, RADIUS_PX, *turned.matrix(), true));
            truth.push(centre);
        }
        let mut textures = [BallTexture::bare()];
        let mut light = None;
        for _ in 0..2 {
            let noise = learn(&mut [pictures.iter_mut().collect()], &mut textures, &mut light, &[true]).expect("learnt");
            for p in &mut pictures {
                let fit = p.fit(&light.expect("light"), &textures[0], &Rim::new(0.62), noise, false).expect("fitted");
                (p.centre, p.gain) = (fit.centre, fit.gain);
            }
        }
        let rms = (pictures.iter().zip(&truth).map(|(p, t)| (p.centre - t).norm_squared()).sum::<f64>() / 32.0).sqrt();
        assert!(rms < 0.05, "{rms} px per axis");
    }
}
