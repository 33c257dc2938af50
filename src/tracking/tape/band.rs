//! One tape band in one image: white between two black bands around a tube, seen at the pose we expect.
//!
//! The appearance follows from the pose: direction of the tube, foreshortened lengths, and the bow of the band's ends (the
//! tape wraps a cylinder). [`fit`] moves that model over the picture, with free grey levels, and answers with the
//! centroid of the visible tape, its covariance and how well the picture agrees.

use crate::calibration::CameraId;
use crate::footage::GreyView;
use crate::tracking::cholesky::Cholesky;
use crate::tracking::racket::racket_figure::{RacketFigure, VISIBLE_DEPTH};
use crate::tracking::racket::racket_pose::View;
use crate::tracking::tape::band_beside::Beside;
use crate::tracking::tape::band_sums::{BESIDE_UNIT, BandModel, BandPixels, BandSums, BandZone, LEVELS, UNKNOWNS};
use crate::tracking::tape::tape_light::TapeLight;
use nalgebra::{Isometry3, Matrix2, Vector2, Vector3};
use std::cell::RefCell;

/// Blur of a picture in focus, px.
pub const USUAL_BLUR_PX: f64 = 0.65;

/// Lengths of the tape, m, and blur of the picture, px.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BandShape {
    /// Half the length of the white band along the tube.
    pub white_half_m: f64,
    /// Length of each black band.
    pub black_m: f64,
    /// Gaussian blur of either camera's pictures (lens, pixel), one standard deviation.
    pub blur_px: [f64; 2],
    /// The light, once it is known.
    pub light: Option<TapeLight>,
    /// Whether bands tell how their black brightens across, and no longer how their white does beyond the light from the edges to the middle.
    pub black_shaded: bool,
}

impl Default for BandShape {
    /// Tape of 25 mm, the usual width, black on both sides.
    fn default() -> Self {
        BandShape { white_half_m: 0.0115, black_m: 0.020, blur_px: [USUAL_BLUR_PX; 2], light: None, black_shaded: false }
    }
}

/// What a band should look like in one image.
#[derive(Debug, Clone, Copy)]
pub struct BandView {
    pub camera: CameraId,
    /// Centroid of the visible tape.
    pub centre: Vector2<f64>,
    /// Unit vector along the tube in the image.
    pub along: Vector2<f64>,
    /// Pixels per metre along the tube (foreshortened).
    pub px_per_m: f64,
    /// Half the tube's width.
    pub radius_px: f64,
    /// Half the width in which pixels are looked at.
    pub side_px: f64,
    /// How far the tube's nearest line is moved along the tube, against its axis.
    pub bow_px: f64,
    /// Unit vectors, global axes: across the tube as in the picture, and from its axis toward the camera.
    pub sideways: Vector3<f64>,
    pub upward: Vector3<f64>,
    /// The tube's own bend: across the tube by this times the square of the way along it, 1/px.
    pub bend: f64,
}

impl BandView {
    /// The band of `marker` at a pose; `None` behind the camera or when the tube points at the camera.
    pub fn at(view: &View, figure: &RacketFigure, pose: &Isometry3<f64>, camera: CameraId, marker: usize) -> Option<Self> {
        let axis_point = pose * figure.points[marker];
        let (_, j) = view.project_with_jacobian(camera, &axis_point)?;
        let axis = pose.rotation * figure.tube[marker].into_inner();
        let along = j * axis;
        let px_per_m = along.norm();
        let toward = (view.eye(camera) - axis_point).normalize();
        let across = toward.cross(&axis).try_normalize(1e-6)?;
        let radius_px = (j * across).norm() * figure.tube_radius_m[marker];
        let n = (toward - toward.dot(&axis) * axis).try_normalize(1e-6)?;
        let centre = view.patch(camera, figure, marker, pose)?;
        let along = along / px_per_m;
        let inward = j * (pose.rotation * figure.bend[marker]);
        let bend = 0.5 * inward.dot(&Vector2::new(-along.y, along.x)) / (px_per_m * px_per_m);
        let in_picture = (j * across).dot(&Vector2::new(-along.y, along.x));
        let sideways = if in_picture < 0.0 { -across } else { across };
        let bow_px = (j * n).dot(&along) * figure.tube_radius_m[marker];
        (px_per_m > 1e-6 && centre.norm().is_finite()).then_some(BandView {
            camera,
            centre,
            along,
            px_per_m,
            radius_px,
            side_px: radius_px + SIDE_PX,
            bow_px,
            sideways,
            upward: n,
            bend,
        })
    }

    /// The same band on a tube so many times as wide; the same pixels are looked at.
    pub fn widened(self, by: f64) -> Self {
        BandView { radius_px: by * self.radius_px, bow_px: by * self.bow_px, ..self }
    }

    /// How far the pixels of a fit lie above and below the centre, px, while the band stays there.
    pub fn half_height(&self, shape: &BandShape) -> f64 {
        let along = self.black_end(shape) + BESIDE_END_PX;
        (self.along.y * along).abs() + self.along.x.abs() * (self.side_px + BESIDE_PX + self.bend.abs() * along * along) + 0.5
    }

    /// How far from the centre a fit looks at pixels, px.
    pub fn half_length(&self, shape: &BandShape) -> f64 {
        (self.black_end(shape) + BESIDE_END_PX).hypot(self.side_px + BESIDE_PX)
    }

    /// How far along the tube pixels are looked at, px.
    fn black_end(&self, shape: &BandShape) -> f64 {
        shape.white_half_m * self.px_per_m + (0.8 * shape.black_m * self.px_per_m).max(1.5)
    }

    /// Unit vector across the tube in the image.
    fn across(&self) -> Vector2<f64> {
        Vector2::new(-self.along.y, self.along.x)
    }

    /// Image position of a place on the band: `t` px along the tube, `s` px across.
    pub fn place(&self, t: f64, s: f64) -> Vector2<f64> {
        self.centre + self.along * t + self.across() * (s + self.bend * t * t)
    }

    /// White less black, grey levels, with the band moved by (`t`, `s`) px: the mean of a few places on the white band less
    /// the brighter of the two black bands. `None` outside the picture.
    pub fn contrast(&self, image: &GreyView, shape: &BandShape, t: f64, s: f64) -> Option<f64> {
        self.contrasts(image, shape, t, s).map(|[ahead, behind]| ahead.min(behind))
    }

    /// Places, px along and across, on the white band and on the black ones ahead and behind.
    fn places(&self, shape: &BandShape) -> ([(f64, f64); 4], [[(f64, f64); 3]; 2]) {
        let white = shape.white_half_m * self.px_per_m;
        let black = white + 0.5 * shape.black_m * self.px_per_m;
        let (w, side) = (0.4 * white, 0.45 * self.radius_px);
        ([(-w, 0.0), (0.0, -side), (0.0, side), (w, 0.0)], [black, -black].map(|b| [(b, -side), (b, 0.0), (b, side)]))
    }

    /// Grey of the pixel nearest to a place on the band moved by `shift` px; `None` outside the picture.
    fn grey(&self, image: &GreyView, (along, across): &(f64, f64), shift: &Vector2<f64>) -> Option<f64> {
        let p = self.place(*along, *across) + shift;
        // What lies left of or above the picture stays negative.
        image.get((p.x + 1.5) as i64 - 1, (p.y + 1.5) as i64 - 1).map(f64::from)
    }

    /// [`Self::contrast`] to either black band: ahead along the tube, and behind.
    pub fn contrasts(&self, image: &GreyView, shape: &BandShape, t: f64, s: f64) -> Option<[f64; 2]> {
        let shift = self.along * t + self.across() * s;
        let mean = |places: &[(f64, f64)]| -> Option<f64> {
            let mut sum = 0.0;
            for place in places {
                sum += self.grey(image, place, &shift)?;
            }
            Some(sum / places.len() as f64)
        };
        let (white, [ahead, behind]) = self.places(shape);
        let bright = mean(&white)?;
        Some([bright - mean(&ahead)?, bright - mean(&behind)?])
    }

    /// [`Self::contrast`] where it is expected, of those places that the picture holds: some of the white, and of either black band or of one.
    pub fn contrast_inside(&self, image: &GreyView, shape: &BandShape) -> Option<f64> {
        let mean = |places: &[(f64, f64)]| -> Option<f64> {
            let seen = places.iter().filter_map(|place| self.grey(image, place, &Vector2::zeros()));
            let (sum, n) = seen.fold((0.0, 0.0), |(sum, n), grey| (sum + grey, n + 1.0));
            (n > 0.0).then(|| sum / n)
        };
        let (white, blacks) = self.places(shape);
        let bright = mean(&white)?;
        blacks.iter().filter_map(|black| mean(black)).map(|dark| bright - dark).reduce(f64::min)
    }

    /// The shift (t, s) within `reach_px` at which the contrast is largest, with that contrast.
    pub fn search(&self, image: &GreyView, shape: &BandShape, reach_px: i32) -> Option<(f64, f64, f64)> {
        let mut best: Option<(f64, f64, f64)> = None;
        for i in -reach_px..=reach_px {
            for k in -reach_px..=reach_px {
                let (t, s) = (f64::from(i), f64::from(k));
                if let Some(c) = self.contrast(image, shape, t, s)
                    && best.is_none_or(|b| c > b.2)
                {
                    best = Some((t, s, c));
                }
            }
        }
        best
    }
}

/// Where a band was found and how well.
#[derive(Debug, Clone, Copy)]
pub struct BandFit {
    /// Centroid of the visible tape, px.
    pub uv: Vector2<f64>,
    /// Covariance of `uv`, px², from the residuals around the band.
    pub covariance: Matrix2<f64>,
    pub white: f64,
    pub black: f64,
    /// Half the tube's width, px.
    pub radius_px: f64,
    /// Mean square of the residuals, grey levels squared, and how many pixels it is of.
    pub misfit: (f64, f64),
    /// Grey levels and noise as found: what a fit to a picture like this one may begin with.
    pub settled: Settled,
}

/// Grey levels of a band's model, and residuals beyond which a pixel counts less.
#[derive(Debug, Clone, Copy)]
pub struct Settled {
    levels: [f64; LEVELS],
    scale: f64,
}

impl BandFit {
    /// Of the white at a place across (in radii) and its height, against the shade there, grey levels.
    pub fn brightness(&self, q: f64, up: f64) -> f64 {
        let [level, .., lit, raised] = self.settled.levels;
        level + lit * q + raised * (up - VISIBLE_DEPTH)
    }
}

/// Residuals up to this share of the contrast are the model's own (tape not evenly white, pixels of finite size).
const MISFIT: f64 = 0.1;
const ROUNDS: usize = 8;
/// Half the length of a tape seen nearly end-on, px: below the first it is a speck, below the second nothing.
pub const SPECK_HALF_PX: f64 = 1.2;
const LEAST_HALF_PX: f64 = 0.15;
/// Levels from this one on are the white's shading.
const SHADING: usize = 6;
/// Levels of what lies beside the band, on either side, and the deviation of their share in the picture of its sides from one.
const BESIDE: [usize; 2] = [3, 5];
const LIKE_BESIDE: f64 = 0.3;
/// With the light known: how unevenly the white may be bright on top of it, as a share of its level (one deviation).
const EVENNESS: f64 = 0.1;
/// The same for the black, as a share of the white's level.
const BLACK_EVENNESS: f64 = 0.05;
/// Residuals count in full up to so many deviations.
const ROBUST: f64 = 1.5;
/// Surroundings that are looked at on either side of the tube, px.
const SIDE_PX: f64 = 1.3;
/// Farther out by so much, across and along, lies what shows what is behind the band's sides.
const BESIDE_PX: f64 = 1.0;
const BESIDE_END_PX: f64 = 1.0;
/// A fit ends when the steps to come are below this, px.
const SETTLED_PX: f64 = 0.01;
/// A band this far from where its pixels were gathered is looked at anew, px.
const LOOK_AGAIN_PX: f64 = 0.5;

/// Which part of a band is looked at.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum BandPart {
    Whole,
    /// The white's middle and what lies ahead of it along the tube; something covers what lies behind.
    Ahead,
    Behind,
    /// What the picture holds of it: its border cuts the rest off.
    Inside,
}

/// Fits the band's place, starting `start` px (along, across) from the expected one, and with the grey levels of a similar picture
/// where there is one. `None` when the band leaves the picture, runs away by more than its own size, or the picture does not
/// determine the place.
pub fn fit(image: &GreyView, band: &BandView, shape: &BandShape, start: (f64, f64), part: BandPart, like: Option<&Settled>) -> Option<BandFit> {
    thread_local! {
        static PIXELS: RefCell<BandPixels> = RefCell::default();
    }
    PIXELS.with_borrow_mut(|pixels| fit_in(pixels, image, band, shape, start, part, like))
}

fn fit_in(
    pixels: &mut BandPixels,
    image: &GreyView,
    band: &BandView,
    shape: &BandShape,
    start: (f64, f64),
    part: BandPart,
    like: Option<&Settled>,
) -> Option<BandFit> {
    let white_half = shape.white_half_m * band.px_per_m;
    if white_half < LEAST_HALF_PX || band.radius_px < 0.8 {
        return None; // end-on
    }
    let mut model = model_at(band, shape, white_half, start, like);
    let (window, cut) = ((part.ends(band.black_end(shape), white_half), band.side_px), part == BandPart::Inside);
    let mut looked_at = start;
    let mut last_step = f64::INFINITY;
    gather(pixels, image, band, start, window, cut)?;
    for round in 0..ROUNDS {
        let (t0, s0) = model.middle;
        if (t0 - looked_at.0).abs().max((s0 - looked_at.1).abs()) > LOOK_AGAIN_PX {
            looked_at = model.middle;
            gather(pixels, image, band, looked_at, window, cut)?;
        }
        let sums = pixels.sums(&model);
        if sums.weight < 12.0 {
            return None;
        }
        let Some(levels) = &mut model.levels else {
            model.levels = Some(levels_alone(&sums, white_half)?);
            continue;
        };
        let (h, jtr) = with_priors(&sums, levels, model.scale / ROBUST, white_half, shape);
        let factor = Cholesky::of(&h)?;
        let step = factor.solve(jtr);
        let (dt, ds) = (step[0].clamp(-1.0, 1.0), step[1].clamp(-1.0, 1.0));
        let (t0, s0) = (t0 + dt, s0 + ds);
        model.middle = (t0, s0);
        for (level, change) in levels.iter_mut().zip(step.iter().skip(2)) {
            *level += change;
        }
        let (white, black) = (white_as_seen(levels, &sums, shape), levels[1]);
        if (t0 - start.0).abs() > white_half + 2.0 || (s0 - start.1).abs() > band.radius_px + 1.5 {
            return None;
        }
        // Steps shrink by about the same factor each time: what the next ones would add up to is known. A factor below a third is not
        // trusted: on shaded tape the next one is larger (court: markers 0.33 instead of 0.24 mm).
        let size = dt.abs().max(ds.abs());
        let shrink = if last_step.is_finite() { (size / last_step).clamp(0.33, 0.5) } else { 0.5 };
        last_step = size;
        if size * (shrink / (1.0 - shrink)) < SETTLED_PX || round + 1 == ROUNDS {
            let variance = sums.chi / (sums.weight - UNKNOWNS as f64).max(1.0);
            return Some(BandFit {
                uv: band.centre + band.along * t0 + band.across() * s0,
                covariance: covariance(&factor, variance, band)?,
                white,
                black,
                radius_px: band.radius_px,
                misfit: (variance, sums.weight),
                settled: Settled { levels: *levels, scale: model.scale },
            });
        }
        // Huber's weights: robust deviations (median / 0.6745) keep strings and edges behind from pulling. On a dark
        // curtain most pixels are black and the median is camera noise alone, so the limit also follows the contrast, with
        // which the model's own misfit grows.
        model.scale = (ROBUST * pixels.median_residual() / 0.6745).max(MISFIT * (white - black)).max(1.0);
    }
    None
}

impl BandPart {
    /// From where to where along the tube it is looked at, px from the band's middle; `black_end` is how far the black reaches.
    fn ends(self, black_end: f64, white_half: f64) -> (f64, f64) {
        let inside = -0.3 * white_half;
        match self {
            BandPart::Whole | BandPart::Inside => (-black_end, black_end),
            BandPart::Ahead => (inside, black_end),
            BandPart::Behind => (-black_end, -inside),
        }
    }
}

/// The model a fit begins with.
fn model_at(band: &BandView, shape: &BandShape, white_half: f64, start: (f64, f64), like: Option<&Settled>) -> BandModel {
    BandModel {
        middle: start,
        bend: band.bend,
        white_half,
        radius: band.radius_px,
        bow: band.bow_px,
        blur: 1.0 / (shape.blur_px[band.camera.index()] * std::f64::consts::SQRT_2),
        shade: shape.shade(band),
        black_shaded: shape.black_shaded,
        levels: like.map(|l| l.levels),
        scale: like.map_or(f64::INFINITY, |l| l.scale),
    }
}

/// What keeps a level from running away. Of a speck only the place and the level can be told, not its shading.
fn ridge(level: usize, white_half: f64) -> f64 {
    if level >= SHADING && white_half < SPECK_HALF_PX { 1e4 } else { 1e-3 }
}

/// The grey levels that suit the pixels best where the band is taken to be.
fn levels_alone(sums: &BandSums, white_half: f64) -> Option<[f64; LEVELS]> {
    let mut h: [[f64; LEVELS]; LEVELS] = std::array::from_fn(|i| std::array::from_fn(|k| sums.jtj[2 + i][2 + k]));
    for i in 0..LEVELS {
        h[i][i] += ridge(i, white_half);
    }
    Some(Cholesky::of(&h)?.solve(std::array::from_fn(|i| sums.jtr[2 + i])))
}

/// The normal equations of place and levels with what is known of the levels beforehand. `noise`: deviation of a pixel, grey levels; infinite
/// before the first step.
fn with_priors(sums: &BandSums, levels: &[f64; LEVELS], noise: f64, white_half: f64, shape: &BandShape) -> ([[f64; UNKNOWNS]; UNKNOWNS], [f64; UNKNOWNS]) {
    let (mut h, mut jtr) = (sums.jtj, sums.jtr);
    for i in 0..UNKNOWNS {
        h[i][i] += ridge(i.saturating_sub(2), white_half);
    }
    if !noise.is_finite() {
        return (h, jtr);
    }
    // What lies beside the band goes on behind its sides, nearly as it is.
    let prior = (noise / (LIKE_BESIDE * BESIDE_UNIT)).powi(2);
    for k in BESIDE {
        h[2 + k][2 + k] += prior;
        jtr[2 + k] += prior * (BESIDE_UNIT - levels[k]);
    }
    if shape.light.is_some() {
        // Beyond the light the white is as bright on one side as on the other, nearly.
        let black_evenness = if shape.black_shaded { BLACK_EVENNESS } else { EVENNESS };
        for (k, evenness) in (SHADING..LEVELS).zip([EVENNESS, black_evenness]) {
            let prior = (noise / (evenness * levels[0]).abs().max(1.0)).powi(2);
            h[2 + k][2 + k] += prior;
            jtr[2 + k] -= prior * levels[k];
        }
    }
    (h, jtr)
}

/// The white as seen: its level where it is level, and what the shading adds on the mean of its pixels.
fn white_as_seen(levels: &[f64; LEVELS], sums: &BandSums, shape: &BandShape) -> f64 {
    let shading = if shape.black_shaded { 7 } else { LEVELS };
    [0].into_iter().chain(SHADING..shading).map(|k| levels[k] * sums.jtj[2][2 + k]).sum::<f64>() / sums.jtj[2][2].max(1e-9)
}

/// Covariance of the band's place in the picture, px²; `None` where it is none.
fn covariance(factor: &Cholesky<UNKNOWNS>, variance: f64, band: &BandView) -> Option<Matrix2<f64>> {
    // The first two rows and columns of the inverse, which is the product of L's inverse with itself turned over.
    let [a, b] = [0, 1].map(|k| factor.solve_lower(std::array::from_fn(|i| if i == k { 1.0 } else { 0.0 })));
    let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let c = Matrix2::new(product(&a, &a), product(&a, &b), product(&a, &b), product(&b, &b)) * variance;
    let turn = Matrix2::from_columns(&[band.along, band.across()]);
    let covariance = turn * c * turn.transpose();
    let sound = covariance[(0, 0)] > 0.0 && covariance[(1, 1)] > 0.0 && covariance.norm().is_finite();
    sound.then_some(covariance)
}

/// The pixels of a band whose middle is at `middle` (along, across), between `ends` along and up to `side` across, px from it, with what
/// lies beside them; `None` where they leave the picture, unless its border may `cut` them off.
fn gather(pixels: &mut BandPixels, image: &GreyView, band: &BandView, middle: (f64, f64), (ends, side): ((f64, f64), f64), cut: bool) -> Option<()> {
    pulp::Arch::new().dispatch(Gathering { pixels: &mut *pixels, image, band, middle, ends, side, cut })?;
    let mut beside = Beside::new(ends.0 - BESIDE_END_PX, ends.1 + BESIDE_END_PX);
    for [along, aside, grey] in pixels.beside_it() {
        beside.add(*along, *aside >= 0.0, *grey);
    }
    beside.complete();
    pixels.complete(|t, s| beside.at(t - middle.0 as f32, s - middle.1 as f32));
    Some(())
}

struct Gathering<'a> {
    pixels: &'a mut BandPixels,
    image: &'a GreyView<'a>,
    band: &'a BandView,
    middle: (f64, f64),
    ends: (f64, f64),
    side: f64,
    cut: bool,
}

impl pulp::NullaryFnOnce for Gathering<'_> {
    type Output = Option<()>;

    #[inline(always)]
    fn call(self) -> Option<()> {
        gather_rows(self)
    }
}

#[inline(always)]
fn gather_rows(Gathering { pixels, image, band, middle, ends, side, cut }: Gathering) -> Option<()> {
    pixels.clear();
    let across = band.across();
    let length = ends.1.max(-ends.0) + BESIDE_END_PX;
    let far = side + BESIDE_PX;
    let zone = BandZone {
        middle: [middle.0, middle.1].map(|v| v as f32),
        bend: band.bend as f32,
        ends: [ends.0, ends.1].map(|v| v as f32),
        side: side as f32,
        beside: [side - SIDE_PX + BESIDE_PX, far].map(|v| v as f32),
    };
    // How far the tube's own bend carries the band's ends across.
    let bowed = band.bend.abs() * length * length;
    let corner = band.place(middle.0, middle.1);
    let half = length.hypot(far) + 1.0;
    let (x0, x1) = ((corner.x - half).floor() as i64, (corner.x + half).ceil() as i64);
    let step = [band.along.x as f32, across.x as f32];
    for y in (corner.y - half).floor() as i64..=(corner.y + half).ceil() as i64 {
        let row = usize::try_from(y).ok().and_then(|y| image.row(y));
        let dy = y as f64 - band.centre.y;
        let (from, to) = reached(dy, (middle.0, length), (middle.1, far + bowed), band);
        let (from, to) = (from.max(x0), to.min(x1));
        let place = |x: i64| {
            let dx = x as f64 - band.centre.x;
            [(dx * band.along.x + dy * band.along.y) as f32, (dx * across.x + dy * across.y) as f32]
        };
        let seen = usize::try_from(from).ok().zip(usize::try_from(to).ok()).and_then(|(from, to)| row?.get(from..=to));
        if let Some(seen) = seen {
            pixels.push_row(place(from), step, seen, &zone);
            continue;
        }
        // Partly beyond what is there: is the band?
        for x in from..=to {
            match row.and_then(|row| row.get(usize::try_from(x).ok()?)) {
                Some(grey) => pixels.push_row(place(x), step, std::slice::from_ref(grey), &zone),
                // A row that was not read is not beyond the border.
                None if zone.holds(place(x)) && !(cut && image.is_beyond(x, y)) => return None,
                None => {}
            }
        }
    }
    Some(())
}

/// Columns of one row that may lie on the band: |t - t0| and |s - s0| within their limits, for a row `dy` below the centre.
#[inline(always)]
fn reached(dy: f64, t: (f64, f64), s: (f64, f64), band: &BandView) -> (i64, i64) {
    let (mut from, mut to) = (-1e9f64, 1e9f64);
    // t = x cos + dy sin, s = -x sin + dy cos, x from the centre.
    let (cos, sin) = (band.along.x, band.along.y);
    for (slope, offset, (middle, limit)) in [(cos, dy * sin, t), (-sin, dy * cos, s)] {
        if slope.abs() > 1e-3 {
            let per_px = 1.0 / slope;
            let (a, b) = ((middle - limit - offset) * per_px, (middle + limit - offset) * per_px);
            (from, to) = (from.max(a.min(b)), to.min(a.max(b)));
        }
    }
    // A pixel more than needed: every pixel is still asked itself.
    ((from + band.centre.x) as i64 - 1, (to + band.centre.x) as i64 + 1)
}

/// Error function (Abramowitz and Stegun 7.1.26, absolute error below 1.5e-7, far below a grey level).
#[inline]
pub(crate) fn erf(x: f64) -> f64 {
    let z = x.abs();
    if z > 4.0 {
        return x.signum();
    }
    let t = 1.0 / (1.0 + 0.327_591_1 * z);
    let p = t * (0.254_829_592 + t * (-0.284_496_736 + t * (1.421_413_741 + t * (-1.453_152_027 + t * 1.061_405_429))));
    (1.0 - p * (-z * z).exp()).copysign(x)
}
