//! What all pictures of a shot's ball have in common: its light, its cover, the flicker of every picture, the noise.
//!
//! The cover is sharper than the pictures of it. It is found by going round: predict every picture, gather what the pixels miss back
//! onto the places of the disc they see ([`BallDisc::gathered`]), and move the cover by the mean miss around every place. Pixels
//! astride the outline take part, because a line that stays on the outline is seen nowhere else.

use super::ball_disc::BallDisc;
use super::ball_light::{BallLight, LightSums, LitPixel};
use super::ball_model::{BLUR_PX, BallModel, BallPicture, CLEAR, Surroundings};
use super::ball_texture::{BallTexture, TextureSums, cell_of};
use nalgebra::{Vector2, Vector3};
use rayon::prelude::*;

/// Least share of the ball that a pixel must show to teach its cover.
const TEACHING_SHARE: f64 = 0.35;
/// Noise of a pixel before it is known, grey levels.
const FIRST_NOISE: f64 = 3.0;
const LEAST_NOISE: f64 = 0.5;
/// Flicker allowed.
const GAINS: (f64, f64) = (0.2, 5.0);
/// Pictures looked at in one go; the sums are added in this order whatever the number of threads.
const BATCH: usize = 8;
/// Fewest clear pixels of a picture that tell its gain.
const FEWEST: usize = 20;

/// A picture to learn from.
pub struct Lesson<'a> {
    pub picture: &'a mut BallPicture,
    pub disc: BallDisc,
    cells: Vec<u16>,
}

impl<'a> Lesson<'a> {
    pub fn new(picture: &'a mut BallPicture) -> Self {
        let disc = BallDisc::new(picture.radius_px);
        let cells = disc.normals.iter().map(|(_, n)| cell_of(&(picture.ball_from_camera * n))).collect();
        Lesson { picture, disc, cells }
    }

    /// Normal of a pixel in the camera's axes, if it is on the ball.
    fn normal(&self, pixel: usize) -> Vector3<f64> {
        let p = &self.picture;
        let d = (Vector2::new((pixel % p.side) as f64, (pixel / p.side) as f64) - (p.centre - p.origin)) / p.radius_px;
        Vector3::new(d.x, d.y, -(1.0 - d.norm_squared()).max(0.0).sqrt())
    }

    fn lit(&self, pixel: usize, n: &Vector3<f64>, relief: f64, weight: f64) -> LitPixel {
        LitPixel { normal: self.picture.camera_from_global.tr_mul(n), along_sight: n.z, grey: self.picture.pixels[pixel], relief, weight }
    }

    /// One look at the picture: adds what it says to the sums, renews its gain, and answers with the misses of its clear pixels.
    fn look(&mut self, now: &Learnt, textured: bool, sums: &mut Sums) -> Vec<f32> {
        let (stretch, side) = (self.picture.stretch, self.picture.side);
        let centre = self.picture.centre - self.picture.origin;
        let painted = self.picture.painted(&self.disc, &now.light, &now.textures[stretch]);
        let [cover, ball] = self.disc.blurred([&self.disc.cover, &painted], &centre, side, BLUR_PX, false);
        let clear: Vec<usize> = (0..self.picture.pixels.len()).filter(|&i| f64::from(cover.value[i]) > CLEAR).collect();
        if clear.len() < FEWEST {
            return Vec::new();
        }
        let usual_miss = self.settle_gain(&clear, &ball.value);
        let (gain, noise2) = (self.picture.gain, now.noise * now.noise);
        let around = Surroundings::of(self.picture, &centre);
        let (mut misses, mut weights) = (vec![0.0f32; side * side], vec![0.0f32; side * side]);
        let mut residuals = Vec::with_capacity(clear.len());
        for i in 0..side * side {
            let share = f64::from(cover.value[i]);
            if share < TEACHING_SHARE {
                continue;
            }
            let outside = if share > CLEAR { 0.0 } else { 1.0 - share };
            let Some((behind, spread)) = (if outside > 0.0 { around.behind(i) } else { Some((0.0, 0.0)) }) else { continue };
            let residual = self.picture.pixels[i] - gain * f64::from(ball.value[i]) - outside * behind;
            let spread = outside * outside * spread;
            let trust = ((usual_miss * usual_miss + spread).sqrt() / residual.abs().max(1e-9)).min(1.0);
            let weight = trust * noise2 / (noise2 + spread);
            (misses[i], weights[i]) = ((weight * residual) as f32, (weight * share) as f32);
            if outside == 0.0 {
                residuals.push(residual.abs() as f32);
                let n = self.normal(i);
                let bare = now.light.at(&n, &(self.picture.camera_from_global * now.light.light)).max(3.0);
                sums.light.add(&now.light, &self.lit(i, &n, gain * f64::from(ball.value[i]) / bare, weight));
            }
        }
        if textured {
            let [misses, weights] = self.disc.gathered([&misses, &weights], &centre, side, BLUR_PX);
            let (usual, toward) = (now.light.usual(), self.picture.camera_from_global * now.light.light);
            for ((at, n), cell) in self.disc.normals.iter().zip(&self.cells) {
                let at = *at as usize;
                let bare = gain * f64::from(self.disc.cover[at]) * now.light.at(n, &toward) / usual;
                sums.textures[stretch].add(*cell, f64::from(misses[at]) * bare / usual, f64::from(weights[at]) * bare * bare);
            }
        }
        residuals
    }

    /// The gain that brings prediction and clear pixels together, with Huber's weights; answers with what a pixel usually misses by.
    fn settle_gain(&mut self, clear: &[usize], ball: &[f32]) -> f64 {
        let mut usual = f64::INFINITY;
        for _ in 0..3 {
            let gain = self.picture.gain;
            let miss = |i: usize| (self.picture.pixels[i] - gain * f64::from(ball[i])).abs();
            let mut sorted: Vec<f64> = clear.iter().map(|&i| miss(i)).collect();
            let mid = sorted.len() / 2;
            usual = 1.5 * *sorted.select_nth_unstable_by(mid, f64::total_cmp).1 / 0.6745 + 2.0;
            let (mut a, mut b) = (1e-9, 0.0);
            for &i in clear {
                let (w, m) = ((usual / miss(i).max(1e-9)).min(1.0), f64::from(ball[i]));
                a += w * m * m;
                b += w * m * self.picture.pixels[i];
            }
            self.picture.gain = (b / a).clamp(GAINS.0, GAINS.1);
        }
        usual
    }
}

#[derive(Default)]
struct Sums {
    light: LightSums,
    textures: [TextureSums; 2],
}

/// What was learnt.
pub struct Learnt {
    pub light: BallLight,
    pub textures: [BallTexture; 2],
    pub noise: f64,
}

impl Learnt {
    /// The light that a bare ball would need; the start.
    pub fn start(lessons: &[Lesson]) -> Option<Self> {
        let mut pixels = Vec::new();
        for lesson in lessons {
            let p = &lesson.picture;
            let inside = |i: &usize| {
                let d = Vector2::new((i % p.side) as f64, (i / p.side) as f64) - (p.centre - p.origin);
                d.norm() < p.radius_px - 2.0 * BLUR_PX
            };
            pixels.extend((0..p.pixels.len()).filter(inside).step_by(3).map(|i| lesson.lit(i, &lesson.normal(i), p.gain, 1.0)));
        }
        let axes = lessons.first()?.picture.camera_from_global;
        Some(Learnt { light: BallLight::of(&pixels, &axes)?, textures: [BallTexture::bare(), BallTexture::bare()], noise: FIRST_NOISE })
    }

    pub fn model(&self, stretch: usize) -> BallModel<'_> {
        BallModel { light: &self.light, texture: &self.textures[stretch.min(1)], noise: self.noise }
    }

    /// Goes round once; `textured` says which stretches have a cover to learn.
    pub fn improve(&mut self, lessons: &mut [Lesson], textured: &[bool; 2]) -> Option<()> {
        let now: &Learnt = self;
        let seen: Vec<(Sums, Vec<f32>)> = lessons
            .par_chunks_mut(BATCH)
            .map(|batch| {
                let mut sums = Sums::default();
                let misses = batch.iter_mut().flat_map(|l| l.look(now, textured[l.picture.stretch.min(1)], &mut sums)).collect();
                (sums, misses)
            })
            .collect();
        let (mut sums, mut misses) = (Sums::default(), Vec::new());
        for (some, more) in &seen {
            sums.light.merge(&some.light);
            sums.textures.iter_mut().zip(&some.textures).for_each(|(a, b)| a.merge(b));
            misses.extend_from_slice(more);
        }
        if misses.is_empty() {
            return None;
        }
        self.light = sums.light.step(&self.light)?;
        for k in (0..2).filter(|&k| textured[k]) {
            self.textures[k].correct(&sums.textures[k]);
        }
        // The mean gain belongs to the light.
        let mean = lessons.iter().map(|l| l.picture.gain).sum::<f64>() / lessons.len() as f64;
        lessons.iter_mut().for_each(|l| l.picture.gain /= mean);
        self.light = self.light.scaled(mean);
        let mid = misses.len() / 2;
        self.noise = (f64::from(*misses.select_nth_unstable_by(mid, f32::total_cmp).1) / 0.6745).max(LEAST_NOISE);
        Some(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix3, Rotation3};

    const RADIUS_PX: f64 = 8.3;

    /// A lit ball of felt with a dark line around it, and another that stays on the outline, before a dim background that is
    /// brighter on one side; every pixel the mean of 81 places under a normal blur, drawn without the model's approximations.
    fn drawn(centre: Vector2<f64>, turned: &Rotation3<f64>) -> Vec<f64> {
        let sun = Vector3::new(-0.5, -0.7, -0.5).normalize();
        let grey = |p: Vector2<f64>| {
            let d = (p - centre) / RADIUS_PX;
            let q = d.norm_squared();
            if q > 1.0 {
                return if p.x > 15.0 { 60.0 } else { 20.0 };
            }
            let n = Vector3::new(d.x, d.y, -(1.0 - q).sqrt());
            let on_ball = turned * n;
            let cover = if on_ball.x.abs() < 0.09 || (on_ball.y + 0.93).abs() < 0.03 { 0.3 } else { 1.0 };
            cover * (50.0 + 110.0 * n.dot(&sun).max(0.0)) * (1.0 - 0.2 * (1.0 + n.z))
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
    fn truth_lines_even_one_that_stays_on_the_outline_and_uneven_surroundings_do_not_pull_the_centre() {
        let mut pictures: Vec<BallPicture> = Vec::new();
        let mut truth = Vec::new();
        for k in 0..16 {
            let centre = Vector2::new(13.0 + 0.4 * (k as f64 * 1.7).sin(), 13.0 + 0.4 * (k as f64 * 2.3).cos());
            // Turning about the picture's vertical keeps the upper line where it is.
            let turned = Rotation3::from_scaled_axis(Vector3::new(0.0, 0.2, 0.0) * k as f64);
            let start = centre + Vector2::new(0.15 * (k as f64 * 0.9).cos(), 0.1 + 0.15 * (k as f64 * 1.3).sin());
            pictures.push(BallPicture {
                pixels: drawn(centre, &turned),
                behind: None,
                side: 27,
                origin: Vector2::zeros(),
                centre: start,
                radius_px: RADIUS_PX,
                camera_from_global: Matrix3::identity(),
                ball_from_camera: *turned.matrix(),
                gain: 1.0,
                teaches: true,
                stretch: 0,
            });
            truth.push(centre);
        }
        let mut lessons: Vec<Lesson> = pictures.iter_mut().map(Lesson::new).collect();
        let mut learnt = Learnt::start(&lessons).expect("a light");
        for rounds in [6, 4, 4, 4] {
            (0..rounds).for_each(|_| learnt.improve(&mut lessons, &[true, false]).expect("learnt"));
            for lesson in &mut lessons {
                let model = learnt.model(0);
                let painted = lesson.picture.painted(&lesson.disc, model.light, model.texture);
                let fit = lesson.picture.fit(&lesson.disc, &painted, &model, false).expect("fitted");
                (lesson.picture.centre, lesson.picture.gain) = (fit.centre, fit.gain);
            }
        }
        let rms = (pictures.iter().zip(&truth).map(|(p, t)| (p.centre - t).norm_squared()).sum::<f64>() / 32.0).sqrt();
        assert!(rms < 0.03, "{rms} px per axis");
        assert!((learnt.light.limb - 0.2).abs() < 0.06, "{:?}", learnt.light);
    }
}
