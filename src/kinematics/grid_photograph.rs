//! A photograph of a sheet ruled in squares: the map from its pixels to the sheet's plane (thesis 5.3.3, where the squares
//! were counted by eye).
//!
//! Comes in: a grey picture in which light squares are parted by darker lines. Every square that shows whole is a patch of
//! light with the moments of a parallelogram; its centroid is a point of the lattice. A homography with one radial term of
//! the lens is laid through all of them.

use crate::calibration::homography;
use crate::footage::GreyImage;
use crate::median::upper_median;
use nalgebra::{Matrix2, Matrix3, Point3, Vector2, Vector3};
use std::collections::{BTreeMap, VecDeque};

/// Fewest squares that make a sheet.
const FEWEST_SQUARES: usize = 40;
/// Smallest square that has an inside, px².
const SMALLEST_PX2: f64 = 25.0;

#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum GridError {
    #[error(
        "only {found} squares of a ruled sheet were found, at least {FEWEST_SQUARES} are needed; show light squares between darker lines, each at least 6 px wide and not blurred"
    )]
    TooFew { found: usize },
    #[error("the squares do not lie on one flat sheet (they miss it by {rms_px:.2} px); lay the sheet flat, or photograph it from farther away")]
    NotFlat { rms_px: f64 },
    #[error("`{name}` is {seen}; allowed: {allowed}")]
    Value { name: &'static str, seen: f64, allowed: &'static str },
}

/// The map from a picture to the sheet. Sheet coordinates in m, origin and axes those of some square.
#[derive(Debug, Clone)]
pub struct GridPhotograph {
    pixel_from_sheet: Matrix3<f64>,
    sheet_from_pixel: Matrix3<f64>,
    /// Middle of the picture, and half its diagonal, px.
    middle: Vector2<f64>,
    half_diagonal: f64,
    radial: f64,
    /// Centres of the squares used, px.
    pub squares: Vec<Vector2<f64>>,
    /// Root mean square distance of the squares from the map, px over both axes.
    pub rms_px: f64,
    /// Mean scale, px/m.
    pub px_per_m: f64,
}

/// A patch of light with the moments of a whole square.
#[derive(Debug, Clone, Copy)]
struct Patch {
    centre: Vector2<f64>,
    side_px: f64,
}

impl GridPhotograph {
    /// Finds the squares and fits the map.
    ///
    /// # Inputs  `square_m`: side of a square (0.01 for centimetres)
    pub fn find(image: &GreyImage, square_m: f64) -> Result<Self, GridError> {
        if !(square_m.is_finite() && (0.001..=0.1).contains(&square_m)) {
            return Err(GridError::Value { name: "square_m", seen: square_m, allowed: "0.001 to 0.1" });
        }
        let patches = patches(image);
        let lattice = largest_lattice(&patches);
        if lattice.len() < FEWEST_SQUARES {
            return Err(GridError::TooFew { found: lattice.len() });
        }
        let middle = Vector2::new(image.width as f64 - 1.0, image.height as f64 - 1.0) / 2.0;
        let mut map = GridPhotograph {
            pixel_from_sheet: Matrix3::identity(),
            sheet_from_pixel: Matrix3::identity(),
            middle,
            half_diagonal: middle.norm().max(1.0),
            radial: 0.0,
            squares: Vec::new(),
            rms_px: 0.0,
            px_per_m: 0.0,
        };
        let mut used: Vec<(Vector2<f64>, (i64, i64))> = lattice.iter().map(|(k, at)| (patches[*k].centre, *at)).collect();
        // Squares that something covers in part have the moments of smaller ones: those off the map go, then all patches on a
        // lattice place of the map join, those beyond the racket included.
        for _ in 0..3 {
            map.fit(&used, square_m).ok_or(GridError::TooFew { found: used.len() })?;
            let off = |(uv, at): &(Vector2<f64>, (i64, i64))| (map.to_sheet(uv) / square_m - Vector2::new(at.0 as f64, at.1 as f64)).norm();
            let limit = (4.0 * upper_median(used.iter().map(off)).unwrap_or(0.0)).max(0.01);
            used = patches
                .iter()
                .map(|p| (p.centre, map.to_sheet(&p.centre) / square_m))
                .map(|(uv, at)| (uv, (at.x.round() as i64, at.y.round() as i64)))
                .filter(|u| off(u) < limit)
                .collect();
            if used.len() < FEWEST_SQUARES {
                return Err(GridError::TooFew { found: used.len() });
            }
        }
        map.fit(&used, square_m).ok_or(GridError::TooFew { found: used.len() })?;
        let sum: f64 = used.iter().map(|(uv, at)| (map.straight(uv) - map.project(&sheet_point(*at, square_m))).norm_squared()).sum();
        map.rms_px = (sum / used.len() as f64).sqrt();
        map.squares = used.iter().map(|u| u.0).collect();
        let here = map.to_sheet(&middle);
        map.px_per_m = (map.straight(&(middle + Vector2::new(1.0, 0.0))) - map.straight(&middle)).norm()
            / (map.to_sheet(&(middle + Vector2::new(1.0, 0.0))) - here).norm().max(1e-12);
        if map.rms_px > 0.05 * square_m * map.px_per_m {
            return Err(GridError::NotFlat { rms_px: map.rms_px });
        }
        Ok(map)
    }

    /// Point of the sheet that a pixel shows, m.
    pub fn to_sheet(&self, uv: &Vector2<f64>) -> Vector2<f64> {
        let s = self.straight(uv);
        let p = self.sheet_from_pixel * Vector3::new(s.x, s.y, 1.0);
        Vector2::new(p.x / p.z, p.y / p.z)
    }

    /// Pixel that shows a point of the sheet.
    pub fn to_pixel(&self, sheet: &Vector2<f64>) -> Vector2<f64> {
        let goal = self.project(sheet);
        let mut uv = goal;
        for _ in 0..20 {
            uv += goal - self.straight(&uv);
        }
        uv
    }

    /// Place of the camera over the sheet (x, y in sheet coordinates, and height), m, for a camera that stands `height_m`
    /// above it, has square pixels and its axis through the picture's middle: the height fixes the focal length.
    pub fn camera(&self, height_m: f64) -> Option<Point3<f64>> {
        let h = Matrix3::new(1.0, 0.0, -self.middle.x, 0.0, 1.0, -self.middle.y, 0.0, 0.0, 1.0) * self.pixel_from_sheet;
        let place = |f: f64| -> Option<Point3<f64>> {
            let k = Matrix3::from_diagonal(&Vector3::new(1.0 / f, 1.0 / f, 1.0)) * h;
            let scale = 0.5 * (k.column(0).norm() + k.column(1).norm());
            let (x, y) = (k.column(0) / scale, k.column(1) / scale);
            let (x, y): (Vector3<f64>, Vector3<f64>) = (x.into_owned(), y.into_owned());
            let turn = Matrix3::from_columns(&[x, y, x.cross(&y)]).svd(true, true);
            let r = turn.u? * turn.v_t?;
            let c = -(r.transpose() * (k.column(2) / scale));
            c.iter().all(|v| v.is_finite()).then(|| Point3::new(c.x, c.y, c.z.abs()))
        };
        let (mut low, mut high) = (0.05 * self.half_diagonal, 100.0 * self.half_diagonal);
        for _ in 0..80 {
            let f = (low * high).sqrt();
            if place(f)?.z < height_m { low = f } else { high = f }
        }
        let found = place((low * high).sqrt())?;
        ((found.z / height_m - 1.0).abs() < 0.02).then(|| Point3::new(found.x, found.y, height_m))
    }

    fn fit(&mut self, used: &[(Vector2<f64>, (i64, i64))], square_m: f64) -> Option<()> {
        let sheet: Vec<Point3<f64>> = used.iter().map(|u| sheet_point(u.1, square_m)).map(|p| Point3::new(p.x, p.y, 0.0)).collect();
        let mut with = |radial: f64| -> Option<(f64, Matrix3<f64>)> {
            self.radial = radial;
            let pixels: Vec<Vector2<f64>> = used.iter().map(|u| self.straight(&u.0)).collect();
            let h = homography(&sheet, &pixels)?;
            let off = |(p, uv): (&Point3<f64>, &Vector2<f64>)| {
                let q = h * Vector3::new(p.x, p.y, 1.0);
                (Vector2::new(q.x / q.z, q.y / q.z) - uv).norm_squared()
            };
            Some((sheet.iter().zip(&pixels).map(off).sum(), h))
        };
        // Golden section over the lens's radial term (displacement at the picture's corner over half the diagonal).
        let ratio = 0.5 * (5f64.sqrt() - 1.0);
        let (mut a, mut b) = (-0.2, 0.2);
        let (mut c, mut d) = (b - ratio * (b - a), a + ratio * (b - a));
        let (mut at_c, mut at_d) = (with(c)?.0, with(d)?.0);
        for _ in 0..40 {
            if at_c < at_d {
                (b, d, at_d) = (d, c, at_c);
                c = b - ratio * (b - a);
                at_c = with(c)?.0;
            } else {
                (a, c, at_c) = (c, d, at_d);
                d = a + ratio * (b - a);
                at_d = with(d)?.0;
            }
        }
        let (_, h) = with(0.5 * (a + b))?;
        self.pixel_from_sheet = h;
        self.sheet_from_pixel = h.try_inverse()?;
        Some(())
    }

    /// Pixel with the lens's radial term taken out.
    fn straight(&self, uv: &Vector2<f64>) -> Vector2<f64> {
        let d = uv - self.middle;
        self.middle + d * (1.0 + self.radial * d.norm_squared() / self.half_diagonal.powi(2))
    }

    fn project(&self, sheet: &Vector2<f64>) -> Vector2<f64> {
        let p = self.pixel_from_sheet * Vector3::new(sheet.x, sheet.y, 1.0);
        Vector2::new(p.x / p.z, p.y / p.z)
    }
}

fn sheet_point(at: (i64, i64), square_m: f64) -> Vector2<f64> {
    Vector2::new(at.0 as f64, at.1 as f64) * square_m
}

/// Light above its surroundings: threshold halfway between the dark and the light of each block's neighbourhood.
fn light(image: &GreyImage) -> Vec<bool> {
    let (w, h) = (image.width, image.height);
    let block = (w.min(h) / 16).clamp(16, 160);
    let (columns, rows) = (w.div_ceil(block), h.div_ceil(block));
    let mut counts = vec![[0u32; 256]; columns * rows];
    for y in 0..h {
        for x in 0..w {
            counts[y / block * columns + x / block][usize::from(image.pixels[y * w + x])] += 1;
        }
    }
    let threshold = |r: usize, c: usize| {
        let mut all = [0u32; 256];
        for i in r.saturating_sub(1)..(r + 2).min(rows) {
            for j in c.saturating_sub(1)..(c + 2).min(columns) {
                all.iter_mut().zip(&counts[i * columns + j]).for_each(|(a, b)| *a += b);
            }
        }
        let total: u32 = all.iter().sum();
        let at = |share: f64| {
            let goal = share * f64::from(total);
            let mut sum = 0.0;
            all.iter().position(|n| {
                sum += f64::from(*n);
                sum >= goal
            })
        };
        0.5 * (at(0.03).unwrap_or(0) as f64 + at(0.90).unwrap_or(255) as f64)
    };
    let thresholds: Vec<f64> = (0..rows * columns).map(|k| threshold(k / columns, k % columns)).collect();
    let mut out = vec![false; w * h];
    for y in 0..h {
        for x in 0..w {
            // Bilinear between the blocks' middles.
            let place = |v: usize, n: usize| {
                let at = ((v as f64 + 0.5) / block as f64 - 0.5).clamp(0.0, (n - 1) as f64);
                (at as usize, (at as usize + 1).min(n - 1), at.fract())
            };
            let ((c0, c1, fx), (r0, r1, fy)) = (place(x, columns), place(y, rows));
            let row = |r: usize| thresholds[r * columns + c0] * (1.0 - fx) + thresholds[r * columns + c1] * fx;
            out[y * w + x] = f64::from(image.pixels[y * w + x]) > row(r0) * (1.0 - fy) + row(r1) * fy;
        }
    }
    out
}

/// Patches of light that could be whole squares.
fn patches(image: &GreyImage) -> Vec<Patch> {
    let (w, h) = (image.width, image.height);
    let mut free = light(image);
    let largest = (w.min(h) as f64 / 6.0).powi(2);
    let mut out = Vec::new();
    let mut stack = Vec::new();
    for start in 0..w * h {
        if !free[start] {
            continue;
        }
        free[start] = false;
        stack.push(start);
        let (mut n, mut sum, mut square, mut edge) = (0.0, Vector2::zeros(), Matrix2::zeros(), false);
        let origin = Vector2::new((start % w) as f64, (start / w) as f64);
        while let Some(k) = stack.pop() {
            let (x, y) = (k % w, k / w);
            let p = Vector2::new(x as f64, y as f64) - origin;
            n += 1.0;
            sum += p;
            square += p * p.transpose();
            edge |= x == 0 || y == 0 || x + 1 == w || y + 1 == h;
            let mut visit = |k: usize| {
                if free[k] {
                    free[k] = false;
                    stack.push(k);
                }
            };
            if x > 0 {
                visit(k - 1);
            }
            if x + 1 < w {
                visit(k + 1);
            }
            if y > 0 {
                visit(k - w);
            }
            if y + 1 < h {
                visit(k + w);
            }
        }
        if edge || n < SMALLEST_PX2 || n > largest {
            continue;
        }
        let mean = sum / n;
        // A pixel is a square, not a point: 1/12 px² more on each axis.
        let moments = square / n - mean * mean.transpose() + Matrix2::identity() / 12.0;
        // Area over 12 √det of the second moments is one for every parallelogram.
        let fullness = n / (12.0 * moments.determinant().max(1e-9).sqrt());
        if (0.93..1.04).contains(&fullness) {
            out.push(Patch { centre: origin + mean, side_px: n.sqrt() });
        }
    }
    out
}

/// The largest set of patches that lie on one lattice, with their places in it.
fn largest_lattice(patches: &[Patch]) -> Vec<(usize, (i64, i64))> {
    let Some(cell) = upper_median(patches.iter().map(|p| p.side_px)).map(|side| 1.5 * side) else { return Vec::new() };
    let key = |p: &Vector2<f64>| ((p.x / cell).floor() as i64, (p.y / cell).floor() as i64);
    let mut shelves: BTreeMap<(i64, i64), Vec<usize>> = BTreeMap::new();
    for (k, p) in patches.iter().enumerate() {
        shelves.entry(key(&p.centre)).or_default().push(k);
    }
    let near = |at: &Vector2<f64>, reach: f64| -> Vec<usize> {
        let (i, j) = key(at);
        let span = (reach / cell).ceil() as i64;
        let mut found: Vec<usize> = (i - span..=i + span)
            .flat_map(|a| (j - span..=j + span).map(move |b| (a, b)))
            .filter_map(|k| shelves.get(&k))
            .flatten()
            .copied()
            .filter(|k| (patches[*k].centre - at).norm() <= reach)
            .collect();
        found.sort_by(|a, b| (patches[*a].centre - at).norm_squared().total_cmp(&(patches[*b].centre - at).norm_squared()).then(a.cmp(b)));
        found
    };
    let mut taken = vec![false; patches.len()];
    let mut best: Vec<(usize, (i64, i64))> = Vec::new();
    for seed in 0..patches.len() {
        if taken[seed] {
            continue;
        }
        taken[seed] = true;
        let centre = patches[seed].centre;
        let around: Vec<Vector2<f64>> =
            near(&centre, 1.6 * patches[seed].side_px).into_iter().filter(|k| *k != seed).map(|k| patches[k].centre - centre).collect();
        let Some(a) = around.first().copied() else { continue };
        let Some(b) = around.iter().copied().find(|v| v.dot(&a).abs() < 0.4 * v.norm() * a.norm()) else { continue };
        let mut own = vec![(seed, (0i64, 0i64))];
        let mut queue = VecDeque::from([(seed, (0i64, 0i64), a, b)]);
        while let Some((k, (i, j), a, b)) = queue.pop_front() {
            for (di, dj) in [(1, 0), (-1, 0), (0, 1), (0, -1)] {
                let step = a * di as f64 + b * dj as f64;
                let goal = patches[k].centre + step;
                let Some(next) = near(&goal, 0.2 * step.norm()).first().copied().filter(|n| !taken[*n]) else { continue };
                taken[next] = true;
                let seen = (patches[next].centre - patches[k].centre) * (di + dj) as f64;
                // The lattice's sides change slowly over the picture: follow what is seen.
                let (a, b) = if di != 0 { (0.5 * (a + seen), b) } else { (a, 0.5 * (b + seen)) };
                own.push((next, (i + di, j + dj)));
                queue.push_back((next, (i + di, j + dj), a, b));
            }
        }
        if own.len() > best.len() {
            best = own;
        }
    }
    best
}
