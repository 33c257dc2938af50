//! Marker positions from a photograph of the racket lying on a ruled sheet (thesis 5.3.3).
//!
//! Each tape is found near a place that the user points at: light tape parts the dark tube in two, and its middle lies
//! halfway between the two ends, on the tube's middle line; dark tape on a lighter tube is a dark patch of its own. What is
//! dark is asked at up to three levels, each splitting the darker part of the one before: a grey tube is dark beside a white
//! sheet and light beside its tape, and a shadow lies between sheet and tube; the level at which tube or tape is as wide as
//! the tube counts. The tube lies above the sheet, so what the sheet's squares say is corrected for the camera's place
//! (similar triangles).

use super::grid_photograph::GridPhotograph;
use crate::equipment::{Markers, Racket};
use crate::footage::GreyImage;
use crate::tracking::VISIBLE_DEPTH;
use nalgebra::{Matrix2, Matrix3, Vector2, Vector3};
use serde::Serialize;

/// Half the window about a tape, and its resolution, m.
const REACH_M: f64 = 0.032;
const STEP_M: f64 = 0.00025;
/// Dark things thinner than this are rulings and strings, m.
const THIN_M: f64 = 0.0035;
/// A tube's end or a dark tape covers at least this, m².
const SMALLEST_M2: f64 = 4e-5;
/// Spread of the tube's height over the sheet: rackets lie on the head and on the thicker butt, m.
const HEIGHT_SD_M: f64 = 0.003;
/// A person points within this of a tape's middle, m.
const POINTING_M: f64 = 0.012;
/// How well an end of a tape can be told from its picture, m: tape is cut and laid by hand.
const END_SD_M: f64 = 0.0002;
/// Levels of grey between light and dark that are tried, and how far apart two classes must be to be two, grey values.
const LEVELS: usize = 3;
const CONTRAST: f64 = 20.0;
/// Length of a tape along the tube, m; how far what is seen may be from the tube's stated width, and the share of the
/// difference by which its middle may be off (a shadow widens one side, a wrong radius both).
const TAPE_LENGTH_M: std::ops::Range<f64> = 0.003..0.035;
const WIDTH_SLACK: f64 = 0.35;
const ONE_SIDED: f64 = 0.25;

#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum TapeError {
    #[error("tape {marker} at pixel ({u:.0}, {v:.0}): {why}; point at the middle of the tape (`--tape U,V`, in the order m1 to m5)")]
    NotFound { marker: usize, u: f64, v: f64, why: &'static str },
    #[error("the camera's height of {height_m} m does not go with this picture; measure it from the sheet to the lens")]
    Height { height_m: f64 },
    #[error("tapes 2 and 3 are {distance_m:.3} m apart; allowed: 0.1 to 0.5 m (check the order of the tapes and the size of the squares)")]
    Order { distance_m: f64 },
}

/// One tape.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TapePlace {
    /// Middle of the tape in the picture, px.
    pub uv: [f64; 2],
    /// Local racket axes, m.
    pub local: [f64; 3],
    /// One standard deviation along each of the axes in the face, m.
    pub sd: f64,
}

/// Measures the five tapes at the places pointed at (px, m1 to m5) with the camera `height_m` above the sheet.
pub fn tape_places(
    image: &GreyImage,
    sheet: &GridPhotograph,
    pointed: &[Vector2<f64>; 5],
    height_m: f64,
    racket: &Racket,
) -> Result<[TapePlace; 5], TapeError> {
    let camera = sheet.camera(height_m).ok_or(TapeError::Height { height_m })?;
    let radius = racket.head.tube_radius_m;
    let mut places: Vec<(Vector2<f64>, Vector2<f64>, f64)> = Vec::with_capacity(5);
    for (k, uv) in pointed.iter().enumerate() {
        let found = find_tape(image, sheet, uv, radius).map_err(|why| TapeError::NotFound { marker: k + 1, u: uv.x, v: uv.y, why })?;
        // Across the tube the outline's middle is the axis; along it the tape's visible side, (π/4) r higher, is what shows.
        let toward = Vector2::new(camera.x, camera.y) - found.apparent;
        let along = found.along;
        let lifted = radius / height_m;
        let higher = VISIBLE_DEPTH * radius / height_m;
        let place = found.apparent + toward * lifted + along * (toward.dot(&along) * higher);
        let sd = END_SD_M.hypot(ONE_SIDED * found.misfit_m(radius)).hypot(toward.norm() * HEIGHT_SD_M / height_m).hypot(sheet.rms_px / sheet.px_per_m);
        places.push((sheet.to_pixel(&found.apparent), place, sd));
    }
    let [_, (_, m2, sd2), (_, m3, sd3), _, _] = &places[..] else { unreachable!("five tapes") };
    let distance_m = (m3 - m2).norm();
    if !(0.1..=0.5).contains(&distance_m) {
        return Err(TapeError::Order { distance_m });
    }
    // y from marker 2 to marker 3, origin between them, x away from marker 1.
    let (origin, y) = (0.5 * (m2 + m3), (m3 - m2) / distance_m);
    let mut x = Vector2::new(-y.y, y.x);
    if (places[0].1 - origin).dot(&x) > 0.0 {
        x = -x;
    }
    let origin_sd = 0.5 * sd2.hypot(*sd3);
    let local = |k: usize| {
        let (uv, place, sd) = &places[k];
        let d = place - origin;
        // The axes' own turn, from the two side tapes, moves a far tape across.
        let turn = sd2.hypot(*sd3) / distance_m;
        TapePlace {
            uv: (*uv).into(),
            local: [d.dot(&x), d.dot(&y), 0.0],
            sd: if k == 1 || k == 2 { origin_sd } else { sd.hypot(origin_sd).hypot(turn * d.dot(&x)) },
        }
    };
    Ok(std::array::from_fn(local))
}

/// The `[markers]` of racket.toml.
pub fn markers_of(places: &[TapePlace; 5]) -> Markers {
    let round = |k: usize| places[k].local.map(|v| (1e5 * v).round() / 1e5 + 0.0);
    Markers { m1: round(0), m2: round(1), m3: round(2), m4: round(3), m5: round(4) }
}

struct Found {
    /// Where the sheet's squares place it, m, and the tube's direction there.
    apparent: Vector2<f64>,
    along: Vector2<f64>,
    /// Of the tube or the dark tape, m.
    width_m: f64,
}

impl Found {
    /// How far the width is from the tube's, m.
    fn misfit_m(&self, radius: f64) -> f64 {
        (self.width_m - 2.0 * radius).abs()
    }
}

/// A window of the sheet about a place, sampled evenly in sheet coordinates.
struct Window {
    centre: Vector2<f64>,
    half: i64,
    grey: Vec<f64>,
}

impl Window {
    fn side(&self) -> usize {
        (2 * self.half + 1) as usize
    }

    fn offset(&self, k: usize) -> Vector2<f64> {
        let (i, j) = ((k % self.side()) as i64 - self.half, (k / self.side()) as i64 - self.half);
        Vector2::new(i as f64, j as f64) * STEP_M
    }
}

fn find_tape(image: &GreyImage, sheet: &GridPhotograph, pointed: &Vector2<f64>, radius: f64) -> Result<Found, &'static str> {
    let window = sample(image, sheet, pointed)?;
    let mut best = Err("nothing dark is near it");
    let mut darker = window.grey.clone();
    for level in 0..LEVELS {
        let Some(threshold) = two_classes(&darker) else { break };
        // The level at which what is seen is as wide as the tube.
        match (tape_at(&window, threshold, radius), &best) {
            (Ok(found), Ok(earlier)) if found.misfit_m(radius) >= Found::misfit_m(earlier, radius) => {}
            (Ok(found), _) => best = Ok(found),
            (Err(why), _) if level == 0 => best = Err(why),
            (Err(_), _) => {}
        }
        darker.retain(|g| *g < threshold);
    }
    best
}

/// The tape when everything below `threshold` is dark.
fn tape_at(window: &Window, threshold: f64, radius: f64) -> Result<Found, &'static str> {
    let mut dark = opened(window, threshold);
    let parts = parts(window, &mut dark);
    let middle = window.grey.len() / 2;
    if let Some(own) = parts.iter().find(|p| p.contains(&middle)) {
        return dark_tape(window, own, radius);
    }
    let nearest = |p: &Vec<usize>| p.iter().map(|k| window.offset(*k).norm()).fold(f64::INFINITY, f64::min);
    let mut ends: Vec<(f64, &Vec<usize>)> = parts.iter().map(|p| (nearest(p), p)).collect();
    ends.sort_by(|a, b| a.0.total_cmp(&b.0));
    let [(near, a), (far, b), ..] = &ends[..] else { return Err("no two dark ends of the tube are beside it") };
    if *near > 0.02 || *far > 0.025 {
        return Err("the dark ends of the tube are too far from it");
    }
    let found = between(window, a, b, radius).ok_or("the tube's ends do not face each other")?;
    if (found.apparent - window.centre).norm() > POINTING_M {
        return Err("the nearest tape is too far from it");
    }
    Ok(found)
}

/// Dark tape on a lighter tube: a patch as wide as the tube that does not leave the window.
fn dark_tape(window: &Window, patch: &[usize], radius: f64) -> Result<Found, &'static str> {
    if patch.iter().any(|k| window.offset(*k).amax() > REACH_M - 2.0 * STEP_M) {
        return Err("the place is on the dark tube, not on the tape");
    }
    let (mean, moments) = moments(window, patch);
    let eigen = moments.symmetric_eigen();
    // A uniform stripe of width w has the variance w²/12.
    let extent = eigen.eigenvalues.map(|v| (12.0 * v.max(0.0)).sqrt());
    let found = |across: usize| {
        let along = eigen.eigenvectors.column(1 - across).into_owned();
        Found { apparent: window.centre + mean, along, width_m: extent[across] }
    };
    let across = if found(0).misfit_m(radius) < found(1).misfit_m(radius) { 0 } else { 1 };
    if found(across).misfit_m(radius) > WIDTH_SLACK * 2.0 * radius || !TAPE_LENGTH_M.contains(&extent[1 - across]) {
        return Err("the dark patch there is not as wide as the tube");
    }
    Ok(found(across))
}

/// Middle of the gap between the two ends of a tube of this radius. Other dark things, such as the head's tube beside the
/// throat's, stay out: only what lies in the tube's own corridor counts.
fn between(window: &Window, a: &[usize], b: &[usize], radius: f64) -> Option<Found> {
    let every: Vec<Vector2<f64>> = a.iter().chain(b).map(|k| window.offset(*k)).collect();
    let centre_of = |part: &[usize]| {
        let nearest = part.iter().map(|k| window.offset(*k).norm()).fold(f64::INFINITY, f64::min);
        let own: Vec<Vector2<f64>> = part.iter().map(|k| window.offset(*k)).filter(|p| p.norm() < nearest + 0.8 * radius).collect();
        own.iter().sum::<Vector2<f64>>() / own.len().max(1) as f64
    };
    let (end_a, end_b) = (centre_of(a), centre_of(b));
    let middle = 0.5 * (end_a + end_b);
    let mut along = (end_b - end_a).try_normalize(1e-6)?;
    let (mut edges, mut line, mut width_m) = ([0.0; 2], Vector3::zeros(), 0.0);
    for _ in 0..4 {
        let across = Vector2::new(-along.y, along.x);
        let bins = (2.0 * REACH_M / STEP_M) as usize;
        let mut width = vec![(0.0, 0.0); bins];
        let in_corridor = |p: &&Vector2<f64>| ((*p - middle).dot(&across)).abs() < 1.4 * radius && ((*p - middle).dot(&along)).abs() < 2.4 * radius;
        for p in every.iter().filter(in_corridor) {
            let bin = ((p.dot(&along) + REACH_M) / STEP_M).floor();
            if bin >= 0.0 && (bin as usize) < bins {
                let w = &mut width[bin as usize];
                (w.0, w.1) = (w.0 + 1.0, w.1 + p.dot(&across));
            }
        }
        // The tube's own width: the lower quartile, because neighbours in the corridor only widen it.
        let full = {
            let most = width.iter().map(|w| w.0).fold(0.0, f64::max);
            let mut widths: Vec<f64> = width.iter().map(|w| w.0).filter(|w| *w > 0.4 * most).collect();
            widths.sort_by(f64::total_cmp);
            *widths.get(widths.len() / 4)?
        };
        width_m = full * STEP_M;
        // From the middle outward to half the width, on each side.
        let place = |bin: f64| (bin + 0.5) * STEP_M - REACH_M;
        let start = (0..bins).filter(|k| width[*k].0 < 0.5 * full).min_by_key(|k| k.abs_diff(bins / 2))?;
        for (side, out) in edges.iter_mut().enumerate() {
            let mut k = start as i64;
            let step = if side == 0 { -1 } else { 1 };
            while (0..bins as i64).contains(&k) && width[k as usize].0 < 0.5 * full {
                k += step;
            }
            if !(1..bins as i64 - 1).contains(&k) {
                return None;
            }
            let (inside, outside) = (width[k as usize].0, width[(k - step) as usize].0);
            let share = if inside > outside { (0.5 * full - outside) / (inside - outside) } else { 0.5 };
            *out = place((k - step) as f64 + step as f64 * share);
        }
        // The tube's middle line: a parabola through the middles of the full-width parts.
        let (mut normal, mut sum) = (Matrix3::zeros(), Vector3::zeros());
        for (k, w) in width.iter().enumerate().filter(|(_, w)| w.0 > 0.88 * full && w.0 < 1.1 * full) {
            let s = place(k as f64);
            let row = Vector3::new(1.0, s, s * s);
            normal += row * row.transpose();
            sum += row * (w.1 / w.0);
        }
        line = normal.cholesky()?.solve(&sum);
        let s = 0.5 * (edges[0] + edges[1]);
        let slope = line[1] + 2.0 * line[2] * s;
        along = (along + across * slope).normalize();
        if slope.abs() < 1e-4 {
            break;
        }
    }
    let across = Vector2::new(-along.y, along.x);
    let s = 0.5 * (edges[0] + edges[1]);
    let gap = edges[1] - edges[0];
    if !TAPE_LENGTH_M.contains(&gap) {
        return None;
    }
    let found = Found { apparent: window.centre + along * s + across * (line[0] + line[1] * s + line[2] * s * s), along, width_m };
    (found.misfit_m(radius) < WIDTH_SLACK * 2.0 * radius).then_some(found)
}

fn sample(image: &GreyImage, sheet: &GridPhotograph, pointed: &Vector2<f64>) -> Result<Window, &'static str> {
    let half = (REACH_M / STEP_M) as i64;
    let mut window = Window { centre: sheet.to_sheet(pointed), half, grey: Vec::new() };
    let side = window.side();
    window.grey.reserve(side * side);
    for k in 0..side * side {
        let uv = sheet.to_pixel(&(window.centre + window.offset(k)));
        let (x, y) = (uv.x.floor(), uv.y.floor());
        let inside = x >= 0.0 && y >= 0.0 && x + 1.0 < image.width as f64 && y + 1.0 < image.height as f64;
        if !inside {
            return Err("the picture ends within 32 mm of it");
        }
        let (x, y, fx, fy) = (x as usize, y as usize, uv.x - x, uv.y - y);
        let at = |x: usize, y: usize| f64::from(image.pixels[y * image.width + x]);
        window.grey.push((at(x, y) * (1.0 - fx) + at(x + 1, y) * fx) * (1.0 - fy) + (at(x, y + 1) * (1.0 - fx) + at(x + 1, y + 1) * fx) * fy);
    }
    Ok(window)
}

/// Otsu's threshold between the two classes of these grey values; `None` when there are no two.
fn two_classes(grey: &[f64]) -> Option<f64> {
    let mut counts = [0.0f64; 256];
    grey.iter().for_each(|g| counts[g.round().clamp(0.0, 255.0) as usize] += 1.0);
    let (total, sum): (f64, f64) = counts.iter().enumerate().fold((0.0, 0.0), |(n, s), (g, c)| (n + c, s + c * g as f64));
    let (mut below, mut part, mut best) = (0.0, 0.0, (0.0, None));
    for (g, c) in counts.iter().enumerate() {
        below += c;
        part += c * g as f64;
        if below > 0.0 && below < total {
            let apart = (sum - part) / (total - below) - part / below;
            let between = below * (total - below) * apart * apart;
            if between > best.0 {
                best = (between, (apart > CONTRAST).then_some(g as f64 + 0.5));
            }
        }
    }
    best.1
}

/// Dark places without what is thinner than [`THIN_M`].
fn opened(window: &Window, threshold: f64) -> Vec<bool> {
    let dark: Vec<bool> = window.grey.iter().map(|g| *g < threshold).collect();
    let reach = (0.5 * THIN_M / STEP_M) as u64;
    dilated(window, &dilated(window, &dark, reach, false), reach, true)
}

/// Square dilation of the `value` pixels by `reach` cells (of the others it is an erosion), along rows, then columns.
fn dilated(window: &Window, mask: &[bool], reach: u64, value: bool) -> Vec<bool> {
    let side = window.side() as i64;
    let mut out = mask.to_vec();
    for axis in 0..2 {
        let from = out.clone();
        let at = |a: i64, b: i64| (if axis == 0 { b * side + a } else { a * side + b }) as usize;
        for b in 0..side {
            let mut spread = |along: &mut dyn Iterator<Item = i64>| {
                let mut last = None;
                for a in along {
                    if from[at(a, b)] == value {
                        last = Some(a);
                    }
                    if last.is_some_and(|last| a.abs_diff(last) <= reach) {
                        out[at(a, b)] = value;
                    }
                }
            };
            spread(&mut (0..side));
            spread(&mut (0..side).rev());
        }
    }
    out
}

/// Connected dark parts that are large enough.
fn parts(window: &Window, dark: &mut [bool]) -> Vec<Vec<usize>> {
    let side = window.side();
    let mut out = Vec::new();
    for start in 0..dark.len() {
        if !dark[start] {
            continue;
        }
        dark[start] = false;
        let (mut own, mut next) = (vec![start], 0);
        while let Some(&k) = own.get(next) {
            next += 1;
            let (x, y) = (k % side, k / side);
            let around = [(x > 0).then(|| k - 1), (x + 1 < side).then(|| k + 1), (y > 0).then(|| k - side), (y + 1 < side).then(|| k + side)];
            for n in around.into_iter().flatten() {
                if dark[n] {
                    dark[n] = false;
                    own.push(n);
                }
            }
        }
        if own.len() as f64 * STEP_M * STEP_M > SMALLEST_M2 {
            out.push(own);
        }
    }
    out
}

fn moments(window: &Window, part: &[usize]) -> (Vector2<f64>, Matrix2<f64>) {
    let n = part.len() as f64;
    let mean = part.iter().map(|k| window.offset(*k)).sum::<Vector2<f64>>() / n;
    let square = part.iter().map(|k| (window.offset(*k) - mean) * (window.offset(*k) - mean).transpose()).sum::<Matrix2<f64>>() / n;
    (mean, square)
}
