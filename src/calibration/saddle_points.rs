//! Points of a picture where it is bright along one diagonal and dark along the other: what every inner corner of a
//! checkerboard is, at any turn and tilt. Found as maxima of minus the Hessian's determinant (Chen and Zhang 2005).

use crate::footage::GreyImage;
use nalgebra::{Matrix2, Vector2};

/// One saddle of the grey values.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SaddlePoint {
    /// Pixel of the full picture.
    pub at: Vector2<f64>,
    /// Minus the determinant of the Hessian, (grey/px²)² of the level it was found on.
    pub strength: f64,
    hessian: Matrix2<f64>,
    /// Unit vectors along the two edges that cross here, either way round.
    pub edges: [Vector2<f64>; 2],
}

impl SaddlePoint {
    /// Whether the sector around `direction` is bright.
    pub fn bright_towards(&self, direction: Vector2<f64>) -> bool {
        direction.dot(&(self.hessian * direction)) > 0.0
    }

    /// The same point in the picture as a linear map draws it; `back` is its inverse.
    pub fn drawn(&self, map: &Matrix2<f64>, back: &Matrix2<f64>) -> SaddlePoint {
        let hessian = back.transpose() * self.hessian * back;
        // Of the edges the smoothed picture tells what lies in the middle between them, and has them at right angles whatever angle they meet at.
        let [a, b] = self.edges;
        let (u, v) = ((map * (a + b)).normalize(), (map * (a - b)).normalize());
        SaddlePoint { at: map * self.at, strength: self.strength, hessian, edges: [(u + v).normalize(), (u - v).normalize()] }
    }
}

/// Saddles kept per picture; clutter has many weak ones, a board's are among the strong.
const MOST: usize = 3000;
/// Weakest saddle that counts: a corner of 4 grey levels of contrast under a blur of 1.7 px (sd).
const WEAKEST: f32 = 0.2;
/// A saddle point this far from the pixel with the largest strength belongs to something else, px.
const FARTHEST_PX: f64 = 1.5;

/// A picture as numbers that can be smoothed and halved.
pub struct Plane {
    width: usize,
    height: usize,
    values: Vec<f32>,
    /// Full-picture pixels per pixel of this plane.
    scale: f64,
}

impl Plane {
    pub fn of(image: &GreyImage) -> Self {
        Plane { width: image.width, height: image.height, values: image.pixels.iter().map(|&v| f32::from(v)).collect(), scale: 1.0 }
    }

    /// Means of two by two pixels. `None` when nothing would be left.
    pub fn halved(&self) -> Option<Plane> {
        let (width, height) = (self.width / 2, self.height / 2);
        if width < 16 || height < 16 {
            return None;
        }
        let mut values = Vec::with_capacity(width * height);
        for rows in self.values.chunks_exact(2 * self.width).take(height) {
            let (upper, lower) = rows.split_at(self.width);
            values.extend(upper.chunks_exact(2).zip(lower.chunks_exact(2)).take(width).map(|(u, l)| (u[0] + u[1] + l[0] + l[1]) / 4.0));
        }
        Some(Plane { width, height, values, scale: 2.0 * self.scale })
    }

    /// Two passes of the binomial kernel 1 4 6 4 1 along both axes: a blur of 1.4 px (sd). Border pixels repeat.
    fn smoothed(&self) -> Plane {
        let (w, h) = (self.width, self.height);
        let mut values = self.values.clone();
        let mut between = vec![0f32; w * h];
        let kernel = |a: f32, b: f32, c: f32, d: f32, e: f32| (a + e + 4.0 * (b + d) + 6.0 * c) / 16.0;
        for _ in 0..2 {
            for (row, out) in values.chunks_exact(w).zip(between.chunks_exact_mut(w)) {
                let at = |x: usize, by: i64| row[(x as i64 + by).clamp(0, w as i64 - 1) as usize];
                for x in (0..2.min(w)).chain(w.saturating_sub(2).max(2)..w) {
                    out[x] = kernel(at(x, -2), at(x, -1), row[x], at(x, 1), at(x, 2));
                }
                for (o, s) in out.iter_mut().skip(2).zip(row.windows(5)) {
                    *o = kernel(s[0], s[1], s[2], s[3], s[4]);
                }
            }
            for y in 0..h {
                let row = |by: i64| {
                    let at = (y as i64 + by).clamp(0, h as i64 - 1) as usize * w;
                    &between[at..at + w]
                };
                let (a, b, c, d, e) = (row(-2), row(-1), row(0), row(1), row(2));
                for (x, out) in values[y * w..(y + 1) * w].iter_mut().enumerate() {
                    *out = kernel(a[x], b[x], c[x], d[x], e[x]);
                }
            }
        }
        Plane { width: w, height: h, values, scale: self.scale }
    }

    /// Saddles of the smoothed plane, strongest first (then from the top left).
    pub fn saddle_points(&self) -> Vec<SaddlePoint> {
        let s = self.smoothed();
        let (w, h) = (s.width, s.height);
        if w < 9 || h < 9 {
            return Vec::new();
        }
        let v = &s.values;
        let second =
            |i: usize| (v[i + 1] + v[i - 1] - 2.0 * v[i], v[i + w] + v[i - w] - 2.0 * v[i], (v[i + w + 1] + v[i - w - 1] - v[i - w + 1] - v[i + w - 1]) / 4.0);
        let mut strength = vec![0f32; w * h];
        for y in 1..h - 1 {
            for i in y * w + 1..(y + 1) * w - 1 {
                let (xx, yy, xy) = second(i);
                strength[i] = xy * xy - xx * yy;
            }
        }
        let mut out = Vec::new();
        for y in 3..h - 3 {
            for x in 3..w - 3 {
                let i = y * w + x;
                let here = strength[i];
                if here < WEAKEST || here < strength[i - 1] || here <= strength[i + 1] || here < strength[i - w] || here <= strength[i + w] {
                    continue;
                }
                let greatest = (0..5).flat_map(|r| &strength[i + r * w - 2 * w - 2..i + r * w - 2 * w + 3]).fold(0f32, |a, b| a.max(*b));
                if here < greatest {
                    continue;
                }
                let (xx, yy, xy) = second(i);
                let hessian = Matrix2::new(f64::from(xx), f64::from(xy), f64::from(xy), f64::from(yy));
                let gradient = Vector2::new(f64::from(v[i + 1] - v[i - 1]) / 2.0, f64::from(v[i + w] - v[i - w]) / 2.0);
                let Some(inverse) = hessian.try_inverse() else { continue };
                let offset = -inverse * gradient;
                if !(offset.amax() <= FARTHEST_PX) {
                    continue;
                }
                let half = (s.scale - 1.0) / 2.0;
                let at = (Vector2::new(x as f64, y as f64) + offset) * s.scale + Vector2::new(half, half);
                out.push(SaddlePoint { at, strength: f64::from(here), hessian, edges: edges(&hessian) });
            }
        }
        out.sort_by(|a, b| b.strength.total_cmp(&a.strength).then(a.at.y.total_cmp(&b.at.y)).then(a.at.x.total_cmp(&b.at.x)));
        out.truncate(MOST);
        out
    }
}

/// Directions along which a saddle neither rises nor falls: the two edges that make the corner.
fn edges(hessian: &Matrix2<f64>) -> [Vector2<f64>; 2] {
    let eigen = hessian.symmetric_eigen();
    let (up, down) = if eigen.eigenvalues[0] > eigen.eigenvalues[1] { (0, 1) } else { (1, 0) };
    let rising = eigen.eigenvectors.column(up) * (-eigen.eigenvalues[down]).max(0.0).sqrt();
    let falling = eigen.eigenvectors.column(down) * eigen.eigenvalues[up].max(0.0).sqrt();
    [(rising + falling).normalize(), (rising - falling).normalize()]
}
