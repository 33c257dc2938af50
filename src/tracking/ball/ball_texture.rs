//! What the ball's cover looks like all around: brightness relative to a bare ball, by direction on the ball.
//!
//! Lines and panels near the outline are what a fit of the outline alone stumbles over. The ball shows them elsewhere on
//! its disc in other pictures, so once its spin is known they can be collected here and expected where they are.

use crate::tracking::ball::ball_disc::add;
use nalgebra::Vector3;
use std::sync::OnceLock;

/// Cells over latitude and longitude: 3.75 degrees, half a pixel on a ball of 16 px.
const ROWS: usize = 48;
const COLUMNS: usize = 96;
/// Reach of the smoothing kernel, rad (one standard deviation), and where it is cut off.
const KERNEL_RAD: f64 = 0.07;
const CUT_OFF: f64 = 2.8;
/// Weight of "as before" against the pixels of one picture (a pixel of usual brightness has weight 1).
const PRIOR: f32 = 0.3;
/// Share of the last step that every step goes on by: the blur lets fine lines come out only by and by.
const MOMENTUM: f32 = 0.5;
/// No cover is darker or brighter than this.
const RANGE: (f32, f32) = (0.02, 2.5);

/// Cells along the edge of a cube's face, and corners, of the table that is looked up: 3.75 degrees at a face's middle.
const EDGE: usize = 32;
const CORNERS: usize = EDGE + 1;

/// Brightness relative to a bare ball, in axes that turn with the ball.
#[derive(Debug, Clone)]
pub struct BallTexture {
    /// Over latitude and longitude.
    cells: Vec<f32>,
    /// Their last step.
    steps: Vec<f32>,
    /// At the corners of the cells on six faces of a cube.
    corners: Vec<f32>,
}

/// What pictures say against a texture, cell by cell: weighted misses of the relative brightness, and the weights.
#[derive(Debug, Clone)]
pub struct TextureSums {
    misses: Vec<f32>,
    weights: Vec<f32>,
}

impl Default for TextureSums {
    fn default() -> Self {
        TextureSums { misses: vec![0.0; ROWS * COLUMNS], weights: vec![0.0; ROWS * COLUMNS] }
    }
}

impl TextureSums {
    /// Adds a miss times its weight, and the weight, at a cell of [`cells_of`].
    #[inline]
    pub fn add(&mut self, cell: u16, weighted_miss: f32, weight: f32) {
        let at = usize::from(cell);
        if let (Some(m), Some(w)) = (self.misses.get_mut(at), self.weights.get_mut(at)) {
            *m += weighted_miss;
            *w += weight;
        }
    }

    pub fn merge(&mut self, other: &TextureSums) {
        add(&mut self.misses, &other.misses, 1.0);
        add(&mut self.weights, &other.weights, 1.0);
    }
}

/// Cells of directions on the ball, whose coordinates stand in three rows.
pub fn cells_of(directions: &[Vec<f32>; 3]) -> Vec<u16> {
    pulp::Arch::new().dispatch(Cells { directions })
}

struct Cells<'a> {
    directions: &'a [Vec<f32>; 3],
}

impl pulp::NullaryFnOnce for Cells<'_> {
    type Output = Vec<u16>;

    #[inline(always)]
    fn call(self) -> Vec<u16> {
        let [x, y, z] = self.directions;
        let n = x.len().min(y.len()).min(z.len());
        let (x, y, z) = (&x[..n], &y[..n], &z[..n]);
        let mut out = vec![0u16; n];
        for i in 0..n {
            let polar = quick_angle((x[i] * x[i] + y[i] * y[i]).sqrt(), z[i]);
            let row = (polar * (ROWS as f32 / std::f32::consts::PI)).clamp(0.0, (ROWS - 1) as f32) as i32;
            let turn = quick_angle(y[i], x[i]) * (COLUMNS as f32 / std::f32::consts::TAU);
            let column = (if turn < 0.0 { turn + COLUMNS as f32 } else { turn }).clamp(0.0, (COLUMNS - 1) as f32) as i32;
            out[i] = (row * COLUMNS as i32 + column) as u16;
        }
        out
    }
}

/// `y.atan2(x)` to a ten-thousandth of a radian: the odd polynomial of least largest error up to a slope of one, and what is symmetric.
#[inline(always)]
fn quick_angle(y: f32, x: f32) -> f32 {
    const C: [f32; 5] = [0.999_866, -0.330_299_5, 0.180_141, -0.085_133, 0.020_835_1];
    let (a, b) = (x.abs(), y.abs());
    let (small, large) = (a.min(b), a.max(b).max(1e-20));
    let q = small / large;
    let q2 = q * q;
    let angle = q * (C[0] + q2 * (C[1] + q2 * (C[2] + q2 * (C[3] + q2 * C[4]))));
    let angle = if b > a { std::f32::consts::FRAC_PI_2 - angle } else { angle };
    let angle = if x < 0.0 { std::f32::consts::PI - angle } else { angle };
    if y < 0.0 { -angle } else { angle }
}

impl BallTexture {
    /// A bare ball.
    pub fn bare() -> Self {
        BallTexture { cells: vec![1.0; ROWS * COLUMNS], steps: vec![0.0; ROWS * COLUMNS], corners: vec![1.0; 6 * CORNERS * CORNERS] }
    }

    /// Moves every cell by the weighted mean miss around it and a part of its last step.
    pub fn correct(&mut self, sums: &TextureSums) {
        let lattice = LATTICE.get_or_init(Lattice::new);
        pulp::Arch::new().dispatch(Smooth { cells: &mut self.cells, steps: &mut self.steps, sums, lattice });
        let corner = |(at, shares): &([u16; 4], [f32; 4])| at.iter().zip(shares).map(|(i, share)| self.cells[usize::from(*i)] * share).sum::<f32>();
        self.corners = lattice.corners.iter().map(corner).collect();
    }

    /// Relative brightness at the `i`-th of some places.
    #[inline]
    pub fn at(&self, spots: &Spots, i: usize) -> f32 {
        let at = spots.corner[i] as usize;
        let Some(c) = self.corners.get(at..at + CORNERS + 2) else { return 1.0 };
        let [p, q] = [spots.shares[0][i], spots.shares[1][i]];
        (c[0] * (1.0 - q) + c[1] * q) * (1.0 - p) + (c[CORNERS] * (1.0 - q) + c[CORNERS + 1] * q) * p
    }
}

/// Places on the ball, as the table of the cover is looked up: the first of four corners, and how far from it toward the others.
pub struct Spots {
    corner: Vec<u32>,
    shares: [Vec<f32>; 2],
}

impl Spots {
    /// In directions in the ball's axes, of any length, whose coordinates stand in three rows.
    pub fn of(directions: &[Vec<f32>; 3]) -> Self {
        pulp::Arch::new().dispatch(LookUp { directions })
    }
}

struct LookUp<'a> {
    directions: &'a [Vec<f32>; 3],
}

impl pulp::NullaryFnOnce for LookUp<'_> {
    type Output = Spots;

    #[inline(always)]
    fn call(self) -> Spots {
        let [x, y, z] = self.directions;
        let n = x.len().min(y.len()).min(z.len());
        let (x, y, z) = (&x[..n], &y[..n], &z[..n]);
        let (mut corner, mut p, mut q) = (vec![0u32; n], vec![0.0f32; n], vec![0.0f32; n]);
        for i in 0..n {
            let (x, y, z) = (x[i], y[i], z[i]);
            let (first, second) = ((x.abs() >= y.abs()) & (x.abs() >= z.abs()), y.abs() >= z.abs());
            let choose = |a: f32, b: f32, c: f32| {
                let b_or_c = if second { b } else { c };
                if first { a } else { b_or_c }
            };
            let (main, one, two, axis) = (choose(x, y, z), choose(y, z, x), choose(z, x, y), choose(0.0, 1.0, 2.0));
            let scale = 0.5 * EDGE as f32 / main.abs().max(1e-12);
            let (u, v) = (one * scale + 0.5 * EDGE as f32, two * scale + 0.5 * EDGE as f32);
            let (j, k) = (u.clamp(0.0, EDGE as f32 - 1.0).floor(), v.clamp(0.0, EDGE as f32 - 1.0).floor());
            let face = 2.0 * axis + if main < 0.0 { 1.0 } else { 0.0 };
            // Whole numbers far below 2^24.
            corner[i] = ((face * CORNERS as f32 + j) * CORNERS as f32 + k) as i32 as u32;
            (p[i], q[i]) = (u - j, v - k);
        }
        Spots { corner, shares: [p, q] }
    }
}

/// One step of every cell.
struct Smooth<'a> {
    cells: &'a mut [f32],
    steps: &'a mut [f32],
    sums: &'a TextureSums,
    lattice: &'a Lattice,
}

impl pulp::NullaryFnOnce for Smooth<'_> {
    type Output = ();

    /// All columns of a row side by side. Columns wrap around, so that lines stand three times after one another.
    #[inline(always)]
    fn call(self) {
        let Smooth { cells, steps, sums, lattice } = self;
        let around = |values: &[f32]| {
            let mut lines = Vec::with_capacity(3 * values.len());
            values.chunks_exact(COLUMNS).for_each(|line| (0..3).for_each(|_| lines.extend_from_slice(line)));
            lines
        };
        let (misses, weights) = (around(&sums.misses), around(&sums.weights));
        for ((cells, steps), kernel) in cells.chunks_exact_mut(COLUMNS).zip(steps.chunks_exact_mut(COLUMNS)).zip(&lattice.kernels) {
            let (mut miss, mut weight) = ([0.0f32; COLUMNS], [PRIOR; COLUMNS]);
            for (row, shares) in kernel {
                let first = 3 * COLUMNS * row + COLUMNS - shares.len() / 2;
                for (k, share) in shares.iter().enumerate() {
                    add(&mut miss, &misses[first + k..first + k + COLUMNS], *share);
                    add(&mut weight, &weights[first + k..first + k + COLUMNS], *share);
                }
            }
            for (((cell, step), miss), weight) in cells.iter_mut().zip(steps).zip(miss).zip(weight) {
                *step = MOMENTUM * *step + miss / weight;
                *cell = (*cell + *step).clamp(RANGE.0, RANGE.1);
            }
        }
    }
}

/// What does not depend on the ball: shares of the smoothing, and where the cube's corners lie on the grid.
struct Lattice {
    /// By row of the smoothed cell: rows in reach with the shares of their cells, from the farthest column on one side to the
    /// farthest on the other.
    kernels: Vec<Vec<(usize, Vec<f32>)>>,
    /// Four cells around each of the cube's corners, with their shares.
    corners: Vec<([u16; 4], [f32; 4])>,
}

static LATTICE: OnceLock<Lattice> = OnceLock::new();

impl Lattice {
    fn new() -> Self {
        let rows = (CUT_OFF * KERNEL_RAD / std::f64::consts::PI * ROWS as f64).ceil() as usize;
        let kernel = |row: usize| {
            let line = |r: usize| {
                let narrowest = (std::f64::consts::PI * (r as f64 + 0.5) / ROWS as f64).sin();
                let reach = (CUT_OFF * KERNEL_RAD / narrowest / std::f64::consts::TAU * COLUMNS as f64).ceil().min((COLUMNS / 2 - 1) as f64) as usize;
                let share = |k: usize| ((direction(row, reach).dot(&direction(r, k)) - 1.0) / (KERNEL_RAD * KERNEL_RAD)).exp() as f32;
                (r, (0..=2 * reach).map(share).collect())
            };
            (row.saturating_sub(rows)..=(row + rows).min(ROWS - 1)).map(line).collect()
        };
        let corner = |i: usize| {
            let (face, a, b) = (i / (CORNERS * CORNERS), i / CORNERS % CORNERS, i % CORNERS);
            let side = |k: usize| 2.0 * k as f32 / EDGE as f32 - 1.0;
            let (axis, main) = (face / 2, if face % 2 == 0 { 1.0 } else { -1.0 });
            let mut n = Vector3::zeros();
            (n[axis], n[(axis + 1) % 3], n[(axis + 2) % 3]) = (main, side(a), side(b));
            between(&n.normalize())
        };
        Lattice { kernels: (0..ROWS).map(kernel).collect(), corners: (0..6 * CORNERS * CORNERS).map(corner).collect() }
    }
}

/// The four cells around a direction with their shares, bilinear.
fn between(n: &Vector3<f32>) -> ([u16; 4], [f32; 4]) {
    let (row, column) = place(n);
    let row = row.clamp(0.0, (ROWS - 1) as f32);
    let (i, j) = (row as usize, column as usize);
    let (p, q) = (row - i as f32, column - j as f32);
    let (i1, j, j1) = ((i + 1).min(ROWS - 1), j % COLUMNS, (j + 1) % COLUMNS);
    let at = [(i, j), (i, j1), (i1, j), (i1, j1)].map(|(i, j)| (i * COLUMNS + j) as u16);
    (at, [(1.0 - p) * (1.0 - q), (1.0 - p) * q, p * (1.0 - q), p * q])
}

/// Fractional row and column of a direction; cell centres are whole numbers, columns wrap around.
#[inline]
fn place(n: &Vector3<f32>) -> (f32, f32) {
    let row = n.z.clamp(-1.0, 1.0).acos() / std::f32::consts::PI * ROWS as f32 - 0.5;
    let turn = n.y.atan2(n.x) / std::f32::consts::TAU;
    let column = turn.rem_euclid(1.0) * COLUMNS as f32 - 0.5;
    (row.max(0.0), if column < 0.0 { column + COLUMNS as f32 } else { column })
}

fn direction(row: usize, column: usize) -> Vector3<f64> {
    let polar = std::f64::consts::PI * (row as f64 + 0.5) / ROWS as f64;
    let turn = std::f64::consts::TAU * (column as f64 + 0.5) / COLUMNS as f64;
    Vector3::new(polar.sin() * turn.cos(), polar.sin() * turn.sin(), polar.cos())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn agrees_with_the_exact_angle() {
        for k in 0..1000 {
            let a = (k as f32 - 499.5) * 0.00628;
            for r in [1e-3, 1.0, 40.0] {
                assert!((quick_angle(r * a.sin(), r * a.cos()) - a).abs() < 1e-4, "{a}");
            }
        }
    }

    #[test]
    fn truth_a_band_around_the_ball_is_found_where_it_is() {
        let band = |n: &Vector3<f32>| if n.dot(&Vector3::new(0.6, 0.0, 0.8)).abs() < 0.15 { 0.3 } else { 1.0 };
        let many = (0..40_000).map(|i| {
            // Fibonacci's lattice: even all over the sphere.
            let z = 1.0 - (2.0 * i as f64 + 1.0) / 40_000.0;
            let a = i as f64 * 2.399_963_229_728_653;
            let n = Vector3::new((1.0 - z * z).sqrt() * a.cos(), (1.0 - z * z).sqrt() * a.sin(), z).map(|x| x as f32);
            (n, band(&n), 1.0)
        });
        let mut sums = TextureSums::default();
        many.for_each(|(n, value, weight)| sums.add(cells_of(&[vec![n.x], vec![n.y], vec![n.z]])[0], weight * (value - 1.0), weight));
        let mut texture = BallTexture::bare();
        texture.correct(&sums);
        let at = |texture: &BallTexture, n: Vector3<f32>| texture.at(&Spots::of(&[vec![n.x], vec![n.y], vec![n.z]]), 0);
        for n in [Vector3::new(0.8, 0.0, -0.6), Vector3::y(), -Vector3::y()] {
            assert!(at(&texture, n) < 0.45, "{n}: {}", at(&texture, n));
        }
        for n in [Vector3::new(0.6, 0.0, 0.8), Vector3::z(), -Vector3::z(), Vector3::x()] {
            assert!(at(&texture, n) > 0.95, "{n}: {}", at(&texture, n));
        }
        assert!((at(&BallTexture::bare(), Vector3::new(0.0, -0.6, 0.8)) - 1.0).abs() < 1e-6);
    }
}
