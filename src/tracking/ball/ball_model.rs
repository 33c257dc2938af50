//! The ball as one camera should see it: a sphere of known size, its light, its cover, the lens' blur, and what lies behind it;
//! and the centre that makes a picture agree with it.
//!
//! [`crate::tracking::ball::ball_fit`] knows nothing but a circle and takes the grey levels along it as they come. Here the levels of the ball
//! are known from all pictures together, so that one side of the outline is enough and a dark line on the outline is
//! expected. What lies behind the outline is continued from just outside it ([`crate::tracking::ball::ball_surroundings`]).

use crate::calibration::CameraId;
use crate::footage::is_cut_off;
use crate::tracking::ball::ball_disc::{BallDisc, PlacesOnBall};
use crate::tracking::ball::ball_light::{BallLight, SeenLight};
use crate::tracking::ball::ball_surroundings::Surroundings;
use crate::tracking::ball::ball_texture::{BallTexture, Spots};
use crate::tracking::lanes::LANES;
use nalgebra::{Matrix2, Matrix3, SMatrix, SVector, Vector2, Vector3};

/// Pixels kept around the ball beyond its radius.
pub const MARGIN_PX: f64 = 5.0;
/// Difference of two blurs that tells how the picture changes with it, px.
const BLUR_STEP_PX: f64 = 0.04;
/// A pixel with more of the ball than this shows nothing else.
pub const CLEAR: f32 = 0.995;
/// How far inside the outline pixels count, in radii: the lines hold the centre too.
const INSIDE: f64 = 0.72;
/// How far outside pixels take part, px, and the least share of the ball they must show.
const OUTSIDE_PX: f64 = 3.0;
const LEAST_SHARE: f32 = 0.03;
/// What the model itself is good to, as a share of the ball's brightness (cover not quite as learnt, light not quite so).
const MODEL: f32 = 0.03;
/// Tukey's limit, in deviations: 95 % efficient for normal residuals.
const TUKEY: f32 = 4.685;
/// How far the light of one picture may differ from one side of the disc to the other from the light of all.
const TILT: f64 = 0.03;
const ROUNDS: usize = 8;
/// Of a fit: centre and gain.
const UNKNOWNS: usize = 3;
/// The first of them weigh pixels by Huber's rule.
const HUBER_ROUNDS: usize = 2;
/// A step below this ends a fit, px.
const SETTLED_PX: f64 = 0.003;
/// As long as the centre has moved by less, the picture is predicted with its slopes: their change is below a grey level, and
/// opposite on both sides of the outline's edge, px.
const STRAIGHT_PX: f64 = 0.08;
/// As long as the centre has moved by less, the surroundings stay as they are, px.
const SAME_SURROUNDINGS_PX: f64 = 0.25;
/// Sectors of the outline whose pulls count as independent: 30 degrees, a line or a panel's border.
const SECTORS: usize = 12;
/// Fewest pixels near the outline from which a centre is fitted.
const FEWEST: usize = 40;

/// One picture of the ball.
pub struct BallPicture {
    /// Grey levels, `side` to a row.
    pub pixels: Vec<f32>,
    /// The same window of the clip's median picture.
    pub behind: Option<Vec<f32>>,
    /// Which of them show something that stands before the ball, if any do.
    pub covered: Option<Vec<bool>>,
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
    pub camera: CameraId,
    /// Before the impact 0, after it 1: each has a cover of its own, because the ball's attitude jumps.
    pub stretch: usize,
}

/// The disc of one picture and the places of the cover that it shows.
pub struct BallFace {
    pub disc: BallDisc,
    /// Directions of its places in the ball's axes.
    pub on_ball: [Vec<f32>; 3],
    spots: Spots,
}

/// What all pictures of a stretch share.
#[derive(Clone, Copy)]
pub struct BallModel<'a> {
    pub light: &'a BallLight,
    pub texture: &'a BallTexture,
    /// Of one pixel, grey levels.
    pub noise: f64,
    /// Of the picture's camera: lens, pixel and motion together, one standard deviation.
    pub blur_px: f64,
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

/// A pixel that shows some of the ball when the centre is at a certain place; what it shows does not depend on the cover.
#[derive(Debug, Clone, Copy)]
pub struct Shown {
    /// In the window.
    pub pixel: usize,
    pub share: f32,
    by_centre: [f32; 2],
    /// What lies behind the ball there, with its variance, which is infinite where nobody knows; 0 where only the ball is seen.
    pub behind: f32,
    pub spread: f32,
}

impl BallFace {
    pub fn new(picture: &BallPicture) -> Self {
        let disc = BallDisc::new(picture.radius_px);
        let on_ball = pulp::Arch::new().dispatch(Turn { by: &picture.ball_from_camera.map(|x| x as f32), directions: &disc.on_ball.normals });
        let spots = Spots::of(&on_ball);
        BallFace { disc, on_ball, spots }
    }

    /// What light makes of the places on the ball, for gain 1 and without a cover; what they hide of the background counted.
    pub fn lit(&self, picture: &BallPicture, light: &BallLight) -> Vec<f32> {
        pulp::Arch::new().dispatch(Lit { places: &self.disc.on_ball, light: &light.seen(&picture.camera_from_global) })
    }

    /// The disc with light (from [`Self::lit`]) and cover.
    pub fn painted(&self, lit: &[f32], texture: &BallTexture) -> Vec<f32> {
        self.disc.painted(lit.iter().enumerate().map(|(i, lit)| lit * texture.at(&self.spots, i)))
    }
}

struct Turn<'a> {
    by: &'a Matrix3<f32>,
    directions: &'a [Vec<f32>; 3],
}

impl pulp::NullaryFnOnce for Turn<'_> {
    type Output = [Vec<f32>; 3];

    #[inline(always)]
    fn call(self) -> [Vec<f32>; 3] {
        let [x, y, z] = self.directions;
        let n = x.len();
        let (y, z) = (&y[..n], &z[..n]);
        [0, 1, 2].map(|k| {
            let (a, b, c) = (self.by[(k, 0)], self.by[(k, 1)], self.by[(k, 2)]);
            let mut out = vec![0.0f32; n];
            for i in 0..n {
                out[i] = a * x[i] + b * y[i] + c * z[i];
            }
            out
        })
    }
}

struct Lit<'a> {
    places: &'a PlacesOnBall,
    light: &'a SeenLight,
}

impl pulp::NullaryFnOnce for Lit<'_> {
    type Output = Vec<f32>;

    #[inline(always)]
    fn call(self) -> Vec<f32> {
        let Lit { places: PlacesOnBall { cover, normals: [x, y, z], .. }, light } = self;
        let n = cover.len();
        let (x, y, z) = (&x[..n], &y[..n], &z[..n]);
        let mut out = vec![0.0f32; n];
        for i in 0..n {
            out[i] = cover[i] * light.at([x[i], y[i], z[i]]);
        }
        out
    }
}

impl BallPicture {
    /// The pixels that show some of the ball when its centre is there (counted from the window's first pixel).
    pub fn shown(&self, disc: &BallDisc, centre: &Vector2<f64>, around: &Surroundings, blur_px: f64) -> Vec<Shown> {
        let [cover] = disc.blurred([&disc.cover], centre, self.side, blur_px, true);
        let mut out = Vec::with_capacity(self.pixels.len());
        for (pixel, &share) in cover.value.iter().enumerate() {
            if share < LEAST_SHARE || self.covered.as_ref().is_some_and(|c| c[pixel]) {
                continue;
            }
            let (behind, spread) = if share > CLEAR { (0.0, 0.0) } else { around.behind(self, pixel).unwrap_or((0.0, f32::INFINITY)) };
            out.push(Shown { pixel, share, by_centre: [cover.by_x[pixel], cover.by_y[pixel]], behind, spread });
        }
        out
    }

    /// The centre nearest to `self.centre` at which picture and model agree best; `None` when the picture does not determine it.
    /// `shown` are the pixels at `self.centre`.
    pub fn fit(&self, face: &BallFace, model: &BallModel, shown: &[Shown]) -> Option<ModelFit> {
        let mut straight = Straight::new(self, face, model);
        let start = self.centre - self.origin;
        straight.predict(&start, shown)?;
        self.settle(&mut straight, (start, self.gain))
    }

    /// What the pixels astride the outline say about the blur, with centre and gain free: pull (weighted misses times the slope by the
    /// blur) and weight. Their ratio is the step toward a better blur, px. `shown` as for [`Self::fit`], under the model's blur.
    pub fn blur_pull(&self, face: &BallFace, model: &BallModel, shown: &[Shown]) -> Option<(f64, f64)> {
        let centre = self.centre - self.origin;
        let painted = face.painted(&face.lit(self, model.light), model.texture);
        let [ball] = face.disc.blurred([&painted], &centre, self.side, model.blur_px, true);
        let [wider_cover, wider_ball] = face.disc.blurred([&face.disc.cover, &painted], &centre, self.side, model.blur_px + BLUR_STEP_PX, false);
        let (gain, noise2) = (self.gain as f32, (model.noise * model.noise) as f32);
        let (mut h, mut g) = (Matrix3::zeros(), Vector3::zeros());
        let (mut cross, mut square, mut pull) = (Vector3::zeros(), 0.0, 0.0);
        for p in shown.iter().filter(|p| (LEAST_SHARE..CLEAR).contains(&p.share) && p.spread.is_finite()) {
            let i = p.pixel;
            let (bright, outside) = (ball.value[i], 1.0 - p.share);
            let expected = gain * bright + outside * p.behind;
            if is_cut_off(self.pixels[i], expected) {
                continue;
            }
            let residual = self.pixels[i] - gain * bright - outside * p.behind;
            let variance = noise2 + (MODEL * gain * bright).powi(2) + outside * outside * p.spread;
            let z = residual.abs() / variance.sqrt();
            let w = f64::from((1.0 - (z / TUKEY).powi(2)).max(0.0).powi(2) / variance);
            let j = [gain * ball.by_x[i] - p.by_centre[0] * p.behind, gain * ball.by_y[i] - p.by_centre[1] * p.behind, bright];
            let j = Vector3::from(j).map(f64::from);
            let by_blur = f64::from(gain * (wider_ball.value[i] - bright) - (wider_cover.value[i] - p.share) * p.behind) / BLUR_STEP_PX;
            let residual = f64::from(residual);
            h += j * j.transpose() * w;
            g += j * (residual * w);
            cross += j * (by_blur * w);
            square += by_blur * by_blur * w;
            pull += by_blur * residual * w;
        }
        let free = h.try_inverse()? * cross;
        let (pull, weight) = (pull - free.dot(&g), square - free.dot(&cross));
        (pull.is_finite() && weight > 0.0 && weight.is_finite()).then_some((pull, weight))
    }

    /// [`Self::fit`], and by how much the centre would be another with the light free to be a little brighter on one side.
    pub fn fit_tilted(&self, face: &BallFace, model: &BallModel) -> Option<(ModelFit, Vector2<f64>)> {
        let mut straight = Straight::new(self, face, model);
        let fit = self.settle(&mut straight, (self.centre - self.origin, self.gain))?;
        let moved = fit.centre - self.origin - straight.centre;
        straight.miss(&moved, fit.gain as f32);
        let scale = straight.scale();
        let (mut h, g) = straight.weigh::<5>(scale, false);
        for k in 3..5 {
            h[(k, k)] += 1.0 / (TILT * fit.gain).powi(2);
        }
        // Where the centre without the tilt is known there is nothing to be careful about: one step.
        let step = h.cholesky()?.solve(&g);
        Some((fit, Vector2::new(step[0].clamp(-0.5, 0.5), step[1].clamp(-0.5, 0.5))))
    }

    fn settle(&self, straight: &mut Straight, start: (Vector2<f64>, f64)) -> Option<ModelFit> {
        let ((mut centre, mut gain), mut scale) = (start, 1.0);
        for round in 0..ROUNDS {
            straight.follow(&centre)?;
            straight.miss(&(centre - straight.centre), gain as f32);
            // What is usual no longer changes when the centre is nearly right.
            if round <= HUBER_ROUNDS {
                scale = straight.scale();
            }
            // Huber first, so that a start half a pixel off is not taken for an outlier all around.
            let huber = round < HUBER_ROUNDS;
            let (h, g) = straight.weigh::<UNKNOWNS>(scale, huber);
            let inverse = h.try_inverse()?;
            let step = inverse * g;
            let moved = Vector2::new(step[0].clamp(-0.5, 0.5), step[1].clamp(-0.5, 0.5));
            centre += moved;
            gain += step[2];
            if !(centre.norm().is_finite() && gain > 0.05 && gain < 20.0) {
                return None;
            }
            if round > HUBER_ROUNDS && moved.norm() < SETTLED_PX || round + 1 == ROUNDS {
                let (scatter, agreeing) = straight.pulls(scale, huber);
                let freedom = SECTORS as f64 / (SECTORS - UNKNOWNS) as f64;
                let covariance = (inverse * scatter * inverse).fixed_view::<2, 2>(0, 0) * freedom + inverse.fixed_view::<2, 2>(0, 0);
                let fit = ModelFit { centre: centre + self.origin, covariance, gain, agreeing };
                return (covariance[(0, 0)] > 0.0 && covariance[(1, 1)] > 0.0 && covariance.norm().is_finite()).then_some(fit);
            }
        }
        None
    }
}

/// Pixels near the outline, side by side: what they show and how that changes with the centre.
#[derive(Clone, Copy, Default)]
struct Bunch {
    grey: [f32; LANES],
    ball: [f32; LANES],
    ball_by: [[f32; LANES]; 2],
    /// What is not the ball, 0 where only the ball is seen, and its change.
    outside: [f32; LANES],
    outside_by: [[f32; LANES]; 2],
    behind: [f32; LANES],
    spread: [f32; LANES],
    /// From the centre, in radii.
    from_centre: [[f32; LANES]; 2],
    /// Pixels that make up the number count for nothing: 0 instead of 1.
    there: [f32; LANES],
    // At the present centre and gain:
    /// 0 where nothing is there or what is there is cut off, else 1.
    counts: [f32; LANES],
    miss: [f32; LANES],
    variance: [f32; LANES],
    /// Derivatives by the centre, gain and tilt.
    slopes: [[f32; LANES]; 5],
}

/// A picture's prediction near one place of the centre, straight on from there.
struct Straight<'a> {
    picture: &'a BallPicture,
    face: &'a BallFace,
    painted: Vec<f32>,
    noise: f32,
    blur_px: f64,
    /// Where the slopes are taken; far away at first.
    centre: Vector2<f64>,
    /// Where the surroundings were looked at.
    around: Option<(Vector2<f64>, Surroundings)>,
    bunches: Vec<Bunch>,
    count: usize,
    sizes: Vec<f32>,
}

impl<'a> Straight<'a> {
    fn new(picture: &'a BallPicture, face: &'a BallFace, model: &BallModel) -> Self {
        let painted = face.painted(&face.lit(picture, model.light), model.texture);
        Straight {
            picture,
            face,
            painted,
            noise: model.noise as f32,
            blur_px: model.blur_px,
            centre: Vector2::repeat(f64::INFINITY),
            around: None,
            bunches: Vec::new(),
            count: 0,
            sizes: Vec::new(),
        }
    }

    /// Predicts anew when the centre has moved; `None` when what lies behind the ball is not known or too little is seen.
    fn follow(&mut self, centre: &Vector2<f64>) -> Option<()> {
        if (centre - self.centre).norm() < STRAIGHT_PX {
            return Some(());
        }
        // A few pixels more or less at their edge do not change the surroundings.
        let around = match self.around.take() {
            Some((at, around)) if (centre - at).norm() < SAME_SURROUNDINGS_PX => (at, around),
            _ => (*centre, Surroundings::of(self.picture, centre, self.blur_px)),
        };
        let shown = self.picture.shown(&self.face.disc, centre, &around.1, self.blur_px);
        self.around = Some(around);
        self.predict(centre, &shown)
    }

    /// Predicts at a place of the centre, where these pixels show something of the ball.
    fn predict(&mut self, centre: &Vector2<f64>, shown: &[Shown]) -> Option<()> {
        let picture = self.picture;
        self.centre = *centre;
        let [ball] = self.face.disc.blurred([&self.painted], centre, picture.side, self.blur_px, true);
        self.bunches.clear();
        self.count = 0;
        let (inner, outer) = (((1.0 - INSIDE) * picture.radius_px).powi(2), (picture.radius_px + OUTSIDE_PX).powi(2));
        let mut bunch = Bunch::default();
        for p in shown {
            let i = p.pixel;
            let d = Vector2::new((i % picture.side) as f64, (i / picture.side) as f64) - centre;
            if !(inner..=outer).contains(&d.norm_squared()) {
                continue;
            }
            if p.spread.is_infinite() {
                return None;
            }
            let l = self.count % LANES;
            bunch.grey[l] = picture.pixels[i];
            bunch.ball[l] = ball.value[i];
            (bunch.ball_by[0][l], bunch.ball_by[1][l]) = (ball.by_x[i], ball.by_y[i]);
            bunch.outside[l] = if p.share > CLEAR { 0.0 } else { 1.0 - p.share };
            (bunch.outside_by[0][l], bunch.outside_by[1][l]) = (-p.by_centre[0], -p.by_centre[1]);
            (bunch.behind[l], bunch.spread[l]) = (p.behind, p.spread);
            let d = d / picture.radius_px;
            (bunch.from_centre[0][l], bunch.from_centre[1][l]) = (d.x as f32, d.y as f32);
            bunch.there[l] = 1.0;
            self.count += 1;
            if l + 1 == LANES {
                self.bunches.push(std::mem::take(&mut bunch));
            }
        }
        if !self.count.is_multiple_of(LANES) {
            self.bunches.push(bunch);
        }
        (self.count >= FEWEST).then_some(())
    }

    /// Misses, deviations and slopes at a centre so far from where they were taken.
    fn miss(&mut self, moved: &Vector2<f64>, gain: f32) {
        pulp::Arch::new().dispatch(Miss { bunches: &mut self.bunches, moved: [moved.x as f32, moved.y as f32], gain, noise: self.noise });
    }

    /// Scale of the misses, in deviations.
    fn scale(&mut self) -> f32 {
        self.sizes.clear();
        for e in &self.bunches {
            self.sizes.extend((0..LANES).map(|l| e.miss[l] * e.miss[l] / e.variance[l]));
        }
        self.sizes.truncate(self.count);
        let mid = self.sizes.len() / 2;
        (self.sizes.select_nth_unstable_by(mid, f32::total_cmp).1.sqrt() / 0.6745).max(1.0)
    }

    /// Normal equations.
    fn weigh<const N: usize>(&self, scale: f32, huber: bool) -> (SMatrix<f64, N, N>, SVector<f64, N>) {
        pulp::Arch::new().dispatch(Weigh::<N> { bunches: &self.bunches, scale, huber })
    }

    /// Scatter of the sectors' pulls, and the share of the pixels that agree.
    fn pulls(&self, scale: f32, huber: bool) -> (Matrix3<f64>, f64) {
        let mut pulls = [Vector3::zeros(); SECTORS];
        let mut agreeing = 0;
        for i in 0..self.count {
            let (e, l) = (&self.bunches[i / LANES], i % LANES);
            let z = e.miss[l].abs() / (e.variance[l].sqrt() * scale);
            agreeing += usize::from(z < 2.5);
            let pull = e.miss[l] * weight(z, huber) / e.variance[l];
            pulls[sector_of(e.from_centre[0][l], e.from_centre[1][l])] += Vector3::from_fn(|k, _| f64::from(e.slopes[k][l] * pull));
        }
        (pulls.iter().map(|p| p * p.transpose()).sum(), agreeing as f64 / self.count.max(UNKNOWNS) as f64)
    }
}

/// Weight of a pixel that misses by so many deviations.
#[inline(always)]
fn weight(z: f32, huber: bool) -> f32 {
    let within = (1.0 - (z / TUKEY) * (z / TUKEY)).max(0.0);
    if huber { 1.5 / z.max(1.5) } else { within * within }
}

struct Miss<'a> {
    bunches: &'a mut [Bunch],
    moved: [f32; 2],
    gain: f32,
    noise: f32,
}

impl pulp::NullaryFnOnce for Miss<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Miss { bunches, moved: [x, y], gain, noise } = self;
        for e in bunches {
            for l in 0..LANES {
                let ball = e.ball[l] + e.ball_by[0][l] * x + e.ball_by[1][l] * y;
                let clear = e.outside[l] == 0.0;
                let outside = if clear { 0.0 } else { e.outside[l] + e.outside_by[0][l] * x + e.outside_by[1][l] * y };
                e.counts[l] = if is_cut_off(e.grey[l], gain * ball + outside * e.behind[l]) { 0.0 } else { e.there[l] };
                e.miss[l] = (e.grey[l] - gain * ball - outside * e.behind[l]) * e.counts[l];
                e.variance[l] = noise * noise + (MODEL * gain * ball) * (MODEL * gain * ball) + outside * outside * e.spread[l];
                for k in 0..2 {
                    e.slopes[k][l] = gain * e.ball_by[k][l] + e.outside_by[k][l] * e.behind[l];
                    e.slopes[3 + k][l] = ball * e.from_centre[k][l];
                }
                e.slopes[2][l] = ball;
            }
        }
    }
}

struct Weigh<'a, const N: usize> {
    bunches: &'a [Bunch],
    scale: f32,
    huber: bool,
}

impl<const N: usize> pulp::NullaryFnOnce for Weigh<'_, N> {
    type Output = (SMatrix<f64, N, N>, SVector<f64, N>);

    #[inline(always)]
    fn call(self) -> Self::Output {
        let Weigh { bunches, scale, huber } = self;
        let mut h = [[[0.0f32; LANES]; N]; N];
        let mut g = [[0.0f32; LANES]; N];
        for e in bunches {
            let mut w = [0.0f32; LANES];
            for l in 0..LANES {
                let z = e.miss[l].abs() / (e.variance[l].sqrt() * scale);
                w[l] = weight(z, huber) / e.variance[l] * e.counts[l];
            }
            for a in 0..N {
                for l in 0..LANES {
                    let weighted = e.slopes[a][l] * w[l];
                    g[a][l] += weighted * e.miss[l];
                    for b in a..N {
                        h[a][b][l] += weighted * e.slopes[b][l];
                    }
                }
            }
        }
        let sum = |lanes: &[f32; LANES]| lanes.iter().map(|x| f64::from(*x)).sum::<f64>();
        (SMatrix::from_fn(|i, j| sum(&h[i.min(j)][i.max(j)])), SVector::from_fn(|i, _| sum(&g[i])))
    }
}

/// Twelve sectors of 30 degrees each.
fn sector_of(x: f32, y: f32) -> usize {
    // Within a quarter turn: tangents of 30 and 60 degrees. Quarters begin where x or y changes sign.
    let (quarter, a, b) = match (x >= 0.0, y >= 0.0) {
        (true, true) => (0, x, y),
        (false, true) => (1, y, -x),
        (false, false) => (2, -x, -y),
        (true, false) => (3, -y, x),
    };
    const TAN_30: f32 = 0.577_350_26;
    3 * quarter + if b < a * TAN_30 { 0 } else { usize::from(b * TAN_30 >= a) + 1 }
}
