//! What all pictures of a shot's ball have in common: its light, its cover, the flicker of every picture, the noise.
//!
//! The cover is sharper than the pictures of it. It is found by going round: predict every picture, gather what the pixels miss back
//! onto the places of the disc they see ([`BallDisc::gathered`]), and move the cover by the mean miss around every place. Pixels
//! astride the outline take part, because a line that stays on the outline is seen nowhere else.

use crate::calibration::CameraId;
use crate::footage::is_cut_off;
use crate::tracking::ball::ball_light::{BallLight, LightSums, LitPixel};
use crate::tracking::ball::ball_model::{BallFace, BallModel, BallPicture, CLEAR, Shown};
use crate::tracking::ball::ball_surroundings::Surroundings;
use crate::tracking::ball::ball_texture::{BallTexture, TextureSums, cells_of};
use crate::tracking::pictures::shot_frames::AT_ONCE;
use nalgebra::{Matrix3, Vector2, Vector3};
use rayon::prelude::*;

/// Least share of the ball that a pixel must show to teach its cover.
const TEACHING_SHARE: f32 = 0.35;
/// Least share that it must show to teach the light: nearer to the limb than clear pixels, out to where a blurred outline makes all the difference.
const LIT_SHARE: f32 = 0.8;
/// Noise of a pixel before it is known, grey levels.
const FIRST_NOISE: f64 = 3.0;
const LEAST_NOISE: f64 = 0.5;
/// Flicker allowed.
const GAINS: (f64, f64) = (0.2, 5.0);
/// Pictures looked at in one go; the sums are added in this order whatever the number of threads.
const BATCH: usize = 8;
/// Longest step of the blur, and its range, px.
const MOST_SHARPER_PX: f64 = 0.3;
const BLURS_PX: (f64, f64) = (0.4, 1.5);
/// Fewest clear pixels of a picture that tell its gain.
const FEWEST: usize = 20;
/// Pixels of all pictures that tell the light to begin with.
const FIRST_PIXELS: usize = 3000;
/// One clear pixel in so many tells the noise.
const NOISE_STEP: usize = 4;

/// A picture to learn from.
pub struct Lesson<'a> {
    pub picture: &'a mut BallPicture,
    pub face: BallFace,
    cells: Vec<u16>,
    /// Pixels that show some of the ball, for the present centre.
    pub shown: Vec<Shown>,
    /// Where among them the clear ones are, and their normals in the camera's axes.
    clear: Vec<(usize, Vector3<f64>)>,
    /// The same of those that teach the light.
    lit: Vec<(usize, Vector3<f64>)>,
}

impl<'a> Lesson<'a> {
    /// `blur_px` by camera.
    pub fn new(picture: &'a mut BallPicture, blur_px: [f64; 2]) -> Self {
        let face = BallFace::new(picture);
        let cells = cells_of(&face.on_ball);
        let mut lesson = Lesson { picture, face, cells, shown: Vec::new(), clear: Vec::new(), lit: Vec::new() };
        lesson.look_again(blur_px[lesson.picture.camera.index()]);
        lesson
    }

    /// What does not depend on light and cover, when the centre has moved.
    pub fn look_again(&mut self, blur_px: f64) {
        let centre = self.picture.centre - self.picture.origin;
        let shown = self.picture.shown(&self.face.disc, &centre, &Surroundings::of(self.picture, &centre, blur_px), blur_px);
        self.clear = shown.iter().enumerate().filter(|(_, p)| p.share > CLEAR).map(|(k, p)| (k, self.normal(p.pixel))).collect();
        self.lit = shown.iter().enumerate().filter(|(_, p)| p.share > LIT_SHARE && p.spread.is_finite()).map(|(k, p)| (k, self.normal(p.pixel))).collect();
        self.shown = shown;
    }

    /// How far clear pixels lie from the mean of their neighbours in the row (second differences), and the grey levels.
    fn roughness(&self) -> impl Iterator<Item = (f32, f32)> {
        let pixels = self.clear.iter().map(|(at, _)| self.shown[*at].pixel);
        let in_a_row = pixels.clone().zip(pixels.clone().skip(1)).zip(pixels.skip(2)).filter(|((a, b), c)| b - a == 1 && c - b == 1);
        in_a_row.map(|((a, b), c)| {
            let [a, b, c] = [a, b, c].map(|i| self.picture.pixels[i]);
            ((a - 2.0 * b + c).abs(), b)
        })
    }

    /// Normal of a pixel in the camera's axes, if it is on the ball.
    fn normal(&self, pixel: usize) -> Vector3<f64> {
        let p = &self.picture;
        let d = (Vector2::new((pixel % p.side) as f64, (pixel / p.side) as f64) - (p.centre - p.origin)) / p.radius_px;
        Vector3::new(d.x, d.y, -(1.0 - d.norm_squared()).max(0.0).sqrt())
    }

    /// One look at the picture: adds what it says to the sums, renews its gain, and adds the misses of some of its clear pixels.
    fn look(&mut self, now: &Learnt, textured: bool, sums: &mut Sums) {
        if self.clear.len() < FEWEST {
            return;
        }
        let (stretch, side, blur_px) = (self.picture.stretch, self.picture.side, now.blur_px[self.picture.camera.index()]);
        let centre = self.picture.centre - self.picture.origin;
        let lit = self.face.lit(self.picture, &now.light);
        let painted = self.face.painted(&lit, &now.textures[stretch]);
        let [ball] = self.face.disc.blurred([&painted], &centre, side, blur_px, false);
        let usual_miss = self.settle_gain(&ball.value) as f32;
        let (gain, noise2) = (self.picture.gain as f32, (now.noise * now.noise) as f32);
        let (mut misses, mut weights) = (vec![0.0f32; side * side], vec![0.0f32; side * side]);
        for p in self.shown.iter().filter(|p| p.share >= TEACHING_SHARE && p.spread.is_finite()) {
            let outside = if p.share > CLEAR { 0.0 } else { 1.0 - p.share };
            if is_cut_off(self.picture.pixels[p.pixel], gain * ball.value[p.pixel] + outside * p.behind) {
                continue;
            }
            let residual = self.picture.pixels[p.pixel] - gain * ball.value[p.pixel] - outside * p.behind;
            let spread = outside * outside * p.spread;
            let trust = ((usual_miss * usual_miss + spread).sqrt() / residual.abs().max(1e-9)).min(1.0);
            let weight = trust * noise2 / (noise2 + spread);
            (misses[p.pixel], weights[p.pixel]) = (weight * residual, weight * p.share);
        }
        let axes = &self.picture.camera_from_global;
        let (directions, seen, mut light) = (now.light.directions(axes), now.light.seen(axes), LightSums::default());
        let miss = |(at, _): &(usize, Vector3<f64>)| {
            let i = self.shown[*at].pixel;
            let (grey, expected) = (self.picture.pixels[i], gain * ball.value[i]);
            (!is_cut_off(grey, expected)).then(|| (grey - expected).abs())
        };
        sums.misses.extend(self.clear.iter().step_by(NOISE_STEP).filter_map(miss));
        for (at, normal) in &self.lit {
            let p = &self.shown[*at];
            let outside = if p.share > CLEAR { 0.0 } else { 1.0 - p.share };
            let (grey, expected) = (self.picture.pixels[p.pixel] - outside * p.behind, gain * ball.value[p.pixel]);
            let relief = f64::from(expected / seen.at(normal.map(|x| x as f32).into()).max(3.0));
            let weight = f64::from(weights[p.pixel] / p.share);
            let pixel = LitPixel { normal: *normal, toward_limb: 1.0 + normal.z, grey: f64::from(grey), relief, weight };
            light.add(&now.light, &directions, &pixel);
        }
        sums.light.merge(&light, &self.picture.camera_from_global);
        if textured {
            let [misses, weights] = self.face.disc.gathered([&misses, &weights], &centre, side, blur_px);
            let per_usual = 1.0 / now.light.usual() as f32;
            let texture = sums.textures[stretch].get_or_insert_default();
            for ((at, lit), cell) in self.face.disc.on_ball.at.iter().zip(&lit).zip(&self.cells) {
                let at = *at as usize;
                let bare = gain * lit * per_usual;
                texture.add(*cell, misses[at] * bare * per_usual, weights[at] * bare * bare);
            }
        }
    }

    /// The gain that brings prediction and clear pixels together, with Huber's weights; answers with what a pixel usually misses by.
    fn settle_gain(&mut self, ball: &[f32]) -> f64 {
        let seen: Vec<[f32; 2]> = self.clear.iter().map(|(at, _)| self.shown[*at].pixel).map(|i| [self.picture.pixels[i], ball[i]]).collect();
        let mut sorted = Vec::with_capacity(seen.len());
        let mut usual = f32::INFINITY;
        for _ in 0..3 {
            let gain = self.picture.gain as f32;
            let told = || seen.iter().filter(|[grey, ball]| !is_cut_off(*grey, gain * ball));
            sorted.clear();
            sorted.extend(told().map(|[grey, ball]| (grey - gain * ball).abs()));
            if sorted.is_empty() {
                break;
            }
            let mid = sorted.len() / 2;
            usual = 1.5 * *sorted.select_nth_unstable_by(mid, f32::total_cmp).1 / 0.6745 + 2.0;
            let (mut a, mut b) = (1e-9, 0.0);
            for [grey, ball] in told() {
                let w = (usual / (grey - gain * ball).abs().max(1e-9)).min(1.0) * ball;
                a += f64::from(w * ball);
                b += f64::from(w * grey);
            }
            self.picture.gain = (b / a).clamp(GAINS.0, GAINS.1);
        }
        f64::from(usual)
    }
}

/// Noise of a pixel as a share of the ball's brightness, before anything is known of the ball. The half of the second differences that are
/// smaller is asked, in which lines have little part; their mean, because they are whole numbers.
pub fn noise_share(lessons: &[Lesson]) -> Option<f64> {
    // The mean of the smaller half of all normal values; a second difference has the sum of the squares of 1, 2 and 1.
    const SMALLER_HALF: f64 = 0.324_66;
    let (mut differences, mut greys): (Vec<f32>, Vec<f32>) = lessons.iter().flat_map(Lesson::roughness).unzip();
    let (half, high) = (differences.len() / 2, greys.len() / 4 * 3);
    if half == 0 {
        return None;
    }
    differences.select_nth_unstable_by(half, f32::total_cmp);
    let difference = f64::from(differences[..half].iter().sum::<f32>()) / half as f64;
    let bright = f64::from(*greys.select_nth_unstable_by(high, f32::total_cmp).1);
    Some(difference / SMALLER_HALF / 6.0f64.sqrt() / bright.max(1.0))
}

#[derive(Default)]
struct Sums {
    light: LightSums,
    textures: [Option<TextureSums>; 2],
    misses: Vec<f32>,
}

/// The stretch of pictures before or after a bounce: the light is the same, and nothing is learnt from them.
pub const BEYOND_A_BOUNCE: usize = 2;

/// What was learnt.
pub struct Learnt {
    pub light: BallLight,
    /// Of either stretch of flight, and the bare one that pictures [`BEYOND_A_BOUNCE`] are compared with.
    pub textures: [BallTexture; 3],
    pub noise: f64,
    /// By camera.
    pub blur_px: [f64; 2],
}

impl Learnt {
    /// The light that a bare ball would need; the start.
    pub fn start(lessons: &[Lesson], blur_px: [f64; 2]) -> Option<Self> {
        let step = (lessons.iter().map(|l| l.clear.len()).sum::<usize>() / FIRST_PIXELS).max(1);
        let lit = |lesson: &Lesson| {
            let (p, clear) = (&lesson.picture, &lesson.clear);
            let pixel = |(at, n): &(usize, Vector3<f64>)| {
                let grey = f64::from(p.pixels[lesson.shown[*at].pixel]);
                LitPixel { normal: p.camera_from_global.tr_mul(n), toward_limb: 1.0 + n.z, grey, relief: p.gain, weight: 1.0 }
            };
            clear.iter().step_by(step).map(pixel).collect::<Vec<_>>()
        };
        let pixels: Vec<LitPixel> = lessons.iter().flat_map(lit).collect();
        let light = BallLight::of(&pixels, &lessons.first()?.picture.camera_from_global)?;
        Some(Learnt { light, textures: std::array::from_fn(|_| BallTexture::bare()), noise: FIRST_NOISE, blur_px })
    }

    /// What a picture is compared with.
    pub fn model(&self, picture: &BallPicture) -> BallModel<'_> {
        BallModel { light: &self.light, texture: &self.textures[picture.stretch], noise: self.noise, blur_px: self.blur_px[picture.camera.index()] }
    }

    /// One step toward either camera's blur: a ball out of focus, at a lens' edge, or moving is less sharp than another, and with a wrong
    /// blur the darker side of every outline seems to lie elsewhere than the brighter one.
    pub fn sharpen(&mut self, lessons: &mut [Lesson]) {
        let now: &Learnt = self;
        let pull = |lesson: &Lesson| lesson.picture.blur_pull(&lesson.face, &now.model(lesson.picture), &lesson.shown);
        let pulls: Vec<Option<(f64, f64)>> = lessons.par_iter().with_max_len(AT_ONCE).map(pull).collect();
        for camera in CameraId::BOTH {
            let own = lessons.iter().zip(&pulls).filter(|(l, _)| l.picture.camera == camera);
            let (pull, weight) = own.filter_map(|(_, p)| *p).fold((0.0, 0.0), |(a, b), p| (a + p.0, b + p.1));
            let blur = &mut self.blur_px[camera.index()];
            if weight > 0.0 {
                *blur = (*blur + (pull / weight).clamp(-MOST_SHARPER_PX, MOST_SHARPER_PX)).clamp(BLURS_PX.0, BLURS_PX.1);
            }
        }
        let blur_px = self.blur_px;
        lessons.par_iter_mut().with_max_len(AT_ONCE).for_each(|lesson| lesson.look_again(blur_px[lesson.picture.camera.index()]));
    }

    /// Goes round once; `textured` says which stretches have a cover to learn.
    pub fn improve(&mut self, lessons: &mut [Lesson], textured: &[bool; 2]) -> Option<()> {
        let now: &Learnt = self;
        let seen: Vec<Sums> = lessons
            .par_chunks_mut(BATCH)
            .with_max_len(1)
            .map(|batch| {
                let mut sums = Sums::default();
                batch.iter_mut().for_each(|l| l.look(now, textured[l.picture.stretch.min(1)], &mut sums));
                sums
            })
            .collect();
        let mut sums = Sums::default();
        for some in seen {
            sums.light.merge(&some.light, &Matrix3::identity());
            sums.misses.extend_from_slice(&some.misses);
            for (all, some) in sums.textures.iter_mut().zip(some.textures) {
                match (all, some) {
                    (Some(all), Some(some)) => all.merge(&some),
                    (all, some) => *all = some.or(all.take()),
                }
            }
        }
        if sums.misses.is_empty() {
            return None;
        }
        let Sums { light, textures, mut misses } = sums;
        self.light = light.step(&self.light)?;
        let correct = || {
            self.textures.par_iter_mut().zip(&textures).for_each(|(texture, sums)| {
                if let Some(sums) = sums {
                    texture.correct(sums);
                }
            });
        };
        let mid = misses.len() / 2;
        let ((), noise) = rayon::join(correct, || f64::from(*misses.select_nth_unstable_by(mid, f32::total_cmp).1) / 0.6745);
        // The mean gain belongs to the light.
        let mean = lessons.iter().map(|l| l.picture.gain).sum::<f64>() / lessons.len() as f64;
        lessons.iter_mut().for_each(|l| l.picture.gain /= mean);
        self.light = self.light.scaled(mean);
        self.noise = noise.max(LEAST_NOISE);
        Some(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Rotation3;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, Normal};

    const RADIUS_PX: f64 = 8.3;
    const BLUR_PX: [f64; 2] = [0.62; 2];

    /// A lit ball of felt with a dark line around it, and another that stays on the outline, before a dim background that is
    /// brighter on one side; every pixel the mean of 81 places under a normal blur, drawn without the model's approximations.
    fn drawn(centre: Vector2<f64>, turned: &Rotation3<f64>) -> Vec<f32> {
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
                (sum / weight).round() as f32
            })
            .collect()
    }

    fn picture(pixels: Vec<f32>, centre: Vector2<f64>, turned: &Rotation3<f64>) -> BallPicture {
        BallPicture {
            pixels,
            behind: None,
            covered: None,
            side: 27,
            origin: Vector2::zeros(),
            centre,
            radius_px: RADIUS_PX,
            camera_from_global: Matrix3::identity(),
            ball_from_camera: *turned.matrix(),
            gain: 1.0,
            teaches: true,
            camera: CameraId::Left,
            stretch: 0,
        }
    }

    #[test]
    fn truth_noise_is_told_and_lines_make_it_seem_more() {
        let centre = Vector2::new(13.1, 12.9);
        let bare = |_: &Rotation3<f64>| -> Vec<f32> {
            let rho2 = |i: usize| (Vector2::new((i % 27) as f64, (i / 27) as f64) - centre).norm_squared() / (RADIUS_PX * RADIUS_PX);
            (0..27 * 27).map(|i| if rho2(i) < 1.0 { (120.0 - 30.0 * rho2(i)) as f32 } else { 20.0 }).collect()
        };
        let with_lines = |turned: &Rotation3<f64>| drawn(centre, turned);
        let share = |clear: &dyn Fn(&Rotation3<f64>) -> Vec<f32>, noise: f64| {
            let (mut rng, normal) = (ChaCha8Rng::seed_from_u64(1), Normal::new(0.0, noise).expect("a deviation"));
            let mut pictures: Vec<BallPicture> = (0..8)
                .map(|k| {
                    let turned = Rotation3::from_scaled_axis(Vector3::new(0.0, 0.4, 0.1) * f64::from(k));
                    let noisy = clear(&turned).into_iter().map(|grey| (f64::from(grey) + normal.sample(&mut rng)).round() as f32);
                    picture(noisy.collect(), centre, &turned)
                })
                .collect();
            let lessons: Vec<Lesson> = pictures.iter_mut().map(|p| Lesson::new(p, BLUR_PX)).collect();
            noise_share(&lessons).expect("clear pixels")
        };
        for noise in [3.0, 6.0, 9.0] {
            // Three quarters of the bare ball's clear pixels are darker than 117 grey levels and the noise above that; of the other one's than 116.
            let (bare, lined) = (share(&bare, noise) * (117.0 + 0.3 * noise), share(&with_lines, noise) * 116.0);
            assert!((bare / noise - 1.0).abs() < 0.1, "{noise}: {bare}");
            assert!((1.0..1.5).contains(&(lined / noise)), "{noise}: {lined}");
        }
    }

    #[test]
    fn truth_lines_even_one_that_stays_on_the_outline_and_uneven_surroundings_do_not_pull_the_centre() {
        let (rms, learnt) = measured(1.0);
        assert!(rms < 0.03, "{rms} px per axis");
        assert!((learnt.light.limb - 0.2).abs() < 0.06, "{:?}", learnt.light);
        // Drawn under 0.62 px; places of 0.4 px between them, and whole grey levels, leave that much.
        assert!((learnt.blur_px[0] - 0.62).abs() < 0.04, "{:?}", learnt.blur_px);
    }

    /// A third of the disc is white then; taken as it looks it moves the centre by 0.07 px along either side of the picture.
    #[test]
    fn truth_what_is_cut_off_at_white_does_not_pull_the_centre() {
        let (rms, learnt) = measured(2.2);
        assert!(rms < 0.03, "{rms} px per axis");
        assert!((learnt.blur_px[0] - 0.62).abs() < 0.04, "{:?}", learnt.blur_px);
    }

    /// Error of the centres, px per axis, in pictures so many times as bright as drawn, and what was learnt of the ball.
    fn measured(brighter: f32) -> (f64, Learnt) {
        let mut pictures: Vec<BallPicture> = Vec::new();
        let mut truth = Vec::new();
        for k in 0..16 {
            let centre = Vector2::new(13.0 + 0.4 * (k as f64 * 1.7).sin(), 13.0 + 0.4 * (k as f64 * 2.3).cos());
            // Turning about the picture's vertical keeps the upper line where it is.
            let turned = Rotation3::from_scaled_axis(Vector3::new(0.0, 0.2, 0.0) * k as f64);
            let start = centre + Vector2::new(0.15 * (k as f64 * 0.9).cos(), 0.1 + 0.15 * (k as f64 * 1.3).sin());
            let pixels = drawn(centre, &turned).into_iter().map(|grey| (brighter * grey).round().min(255.0)).collect();
            pictures.push(picture(pixels, start, &turned));
            truth.push(centre);
        }
        let mut lessons: Vec<Lesson> = pictures.iter_mut().map(|p| Lesson::new(p, BLUR_PX)).collect();
        let mut learnt = Learnt::start(&lessons, BLUR_PX).expect("a light");
        for rounds in [6, 4, 4, 4] {
            (0..rounds).for_each(|_| learnt.improve(&mut lessons, &[true, false]).expect("learnt"));
            for lesson in &mut lessons {
                let model = learnt.model(lesson.picture);
                let fit = lesson.picture.fit(&lesson.face, &model, &lesson.shown).expect("fitted");
                (lesson.picture.centre, lesson.picture.gain) = (fit.centre, fit.gain);
                lesson.look_again(model.blur_px);
            }
            learnt.sharpen(&mut lessons);
        }
        ((pictures.iter().zip(&truth).map(|(p, t)| (p.centre - t).norm_squared()).sum::<f64>() / 32.0).sqrt(), learnt)
    }
}
