//! What the ball's cover looks like all around: brightness relative to a bare ball, by direction on the ball.
//!
//! Lines and panels near the outline are what a fit of the outline alone stumbles over. The ball shows them elsewhere on
//! its disc in other pictures, so once its spin is known they can be collected here and expected where they are.

use nalgebra::Vector3;
use std::sync::OnceLock;

/// Cells over latitude and longitude: 3.75 degrees, half a pixel on a ball of 16 px.
const ROWS: usize = 48;
const COLUMNS: usize = 96;
/// Reach of the smoothing kernel, rad (one standard deviation), and where it is cut off.
const KERNEL_RAD: f64 = 0.07;
const CUT_OFF: f64 = 2.8;
/// Weight of "as before" against the pixels of one picture (a pixel of usual brightness has weight 1).
const PRIOR: f64 = 0.3;
/// No cover is darker or brighter than this.
const RANGE: (f64, f64) = (0.02, 2.5);

/// Cells along the edge of a cube's face, and corners, of the table that is looked up: 3.75 degrees at a face's middle.
const EDGE: usize = 32;
const CORNERS: usize = EDGE + 1;

/// Brightness relative to a bare ball, in axes that turn with the ball.
#[derive(Debug, Clone)]
pub struct BallTexture {
    /// Over latitude and longitude.
    cells: Vec<f64>,
    /// At the corners of the cells on six faces of a cube.
    corners: Vec<f32>,
}

/// What pictures say against a texture, cell by cell: weighted misses of the relative brightness, and the weights.
#[derive(Debug, Clone)]
pub struct TextureSums(Vec<(f64, f64)>);

impl Default for TextureSums {
    fn default() -> Self {
        TextureSums(vec![(0.0, 0.0); ROWS * COLUMNS])
    }
}

impl TextureSums {
    /// Adds a miss times its weight, and the weight, at a cell of [`cell_of`].
    #[inline]
    pub fn add(&mut self, cell: u16, weighted_miss: f64, weight: f64) {
        if let Some(sum) = self.0.get_mut(usize::from(cell)) {
            *sum = (sum.0 + weighted_miss, sum.1 + weight);
        }
    }

    pub fn merge(&mut self, other: &TextureSums) {
        self.0.iter_mut().zip(&other.0).for_each(|(a, b)| *a = (a.0 + b.0, a.1 + b.1));
    }
}

/// The cell of a direction on the ball.
pub fn cell_of(n: &Vector3<f64>) -> u16 {
    let (row, column) = place(n);
    ((row.round() as usize).min(ROWS - 1) * COLUMNS + (column.round() as usize) % COLUMNS) as u16
}

impl BallTexture {
    /// A bare ball.
    pub fn bare() -> Self {
        BallTexture { cells: vec![1.0; ROWS * COLUMNS], corners: vec![1.0; 6 * CORNERS * CORNERS] }
    }

    /// Moves every cell by the weighted mean miss around it.
    pub fn correct(&mut self, sums: &TextureSums) {
        let lattice = LATTICE.get_or_init(Lattice::new);
        for (row, kernel) in lattice.kernels.iter().enumerate() {
            for column in 0..COLUMNS {
                let (mut sum, mut weight) = (0.0, PRIOR);
                for (row, shares) in kernel {
                    let reach = shares.len() / 2;
                    let line = &sums.0[row * COLUMNS..(row + 1) * COLUMNS];
                    // Columns wrap around.
                    let first = (column + COLUMNS - reach) % COLUMNS;
                    for (share, cell) in shares.iter().zip(line[first..].iter().chain(line)) {
                        sum += share * cell.0;
                        weight += share * cell.1;
                    }
                }
                let cell = &mut self.cells[row * COLUMNS + column];
                *cell = (*cell + sum / weight).clamp(RANGE.0, RANGE.1);
            }
        }
        let corner = |(at, shares): &([usize; 4], [f64; 4])| at.iter().zip(shares).map(|(i, share)| self.cells[*i] * share).sum::<f64>() as f32;
        self.corners = lattice.corners.iter().map(corner).collect();
    }

    /// Relative brightness in a direction (in the ball's axes, of any length), bilinear.
    #[inline]
    pub fn at(&self, n: &Vector3<f64>) -> f64 {
        let n = [n.x as f32, n.y as f32, n.z as f32];
        let size = n.map(f32::abs);
        let axis = if size[0] >= size[1] && size[0] >= size[2] {
            0
        } else if size[1] >= size[2] {
            1
        } else {
            2
        };
        let scale = 0.5 * EDGE as f32 / size[axis].max(1e-12);
        let place = |v: f32| {
            let x = v * scale + 0.5 * EDGE as f32;
            let i = (x.max(0.0) as usize).min(EDGE - 1);
            (i, f64::from(x - i as f32))
        };
        let ((i, p), (j, q)) = (place(n[(axis + 1) % 3]), place(n[(axis + 2) % 3]));
        let at = ((2 * axis + usize::from(n[axis] < 0.0)) * CORNERS + i) * CORNERS + j;
        let Some(c) = self.corners.get(at..at + CORNERS + 2) else { return 1.0 };
        let c = [c[0], c[1], c[CORNERS], c[CORNERS + 1]].map(f64::from);
        (c[0] * (1.0 - q) + c[1] * q) * (1.0 - p) + (c[2] * (1.0 - q) + c[3] * q) * p
    }
}

/// What does not depend on the ball: shares of the smoothing, and where the cube's corners lie on the grid.
struct Lattice {
    /// By row of the smoothed cell: rows in reach with the shares of their cells, from the farthest column on one side to the
    /// farthest on the other.
    kernels: Vec<Vec<(usize, Vec<f64>)>>,
    /// Four cells around each of the cube's corners, with their shares.
    corners: Vec<([usize; 4], [f64; 4])>,
}

static LATTICE: OnceLock<Lattice> = OnceLock::new();

impl Lattice {
    fn new() -> Self {
        let rows = (CUT_OFF * KERNEL_RAD / std::f64::consts::PI * ROWS as f64).ceil() as usize;
        let kernel = |row: usize| {
            let line = |r: usize| {
                let narrowest = (std::f64::consts::PI * (r as f64 + 0.5) / ROWS as f64).sin();
                let reach = (CUT_OFF * KERNEL_RAD / narrowest / std::f64::consts::TAU * COLUMNS as f64).ceil().min((COLUMNS / 2 - 1) as f64) as usize;
                let share = |k: usize| ((direction(row, reach).dot(&direction(r, k)) - 1.0) / (KERNEL_RAD * KERNEL_RAD)).exp();
                (r, (0..=2 * reach).map(share).collect())
            };
            (row.saturating_sub(rows)..=(row + rows).min(ROWS - 1)).map(line).collect()
        };
        let corner = |i: usize| {
            let (face, a, b) = (i / (CORNERS * CORNERS), i / CORNERS % CORNERS, i % CORNERS);
            let side = |k: usize| 2.0 * k as f64 / EDGE as f64 - 1.0;
            let (axis, main) = (face / 2, if face % 2 == 0 { 1.0 } else { -1.0 });
            let mut n = Vector3::zeros();
            (n[axis], n[(axis + 1) % 3], n[(axis + 2) % 3]) = (main, side(a), side(b));
            between(&n.normalize())
        };
        Lattice { kernels: (0..ROWS).map(kernel).collect(), corners: (0..6 * CORNERS * CORNERS).map(corner).collect() }
    }
}

/// The four cells around a direction with their shares, bilinear.
fn between(n: &Vector3<f64>) -> ([usize; 4], [f64; 4]) {
    let (row, column) = place(n);
    let row = row.clamp(0.0, (ROWS - 1) as f64);
    let (i, j) = (row as usize, column as usize);
    let (p, q) = (row - i as f64, column - j as f64);
    let (i1, j, j1) = ((i + 1).min(ROWS - 1), j % COLUMNS, (j + 1) % COLUMNS);
    let at = [(i, j), (i, j1), (i1, j), (i1, j1)].map(|(i, j)| i * COLUMNS + j);
    (at, [(1.0 - p) * (1.0 - q), (1.0 - p) * q, p * (1.0 - q), p * q])
}

/// Fractional row and column of a direction; cell centres are whole numbers, columns wrap around.
#[inline]
fn place(n: &Vector3<f64>) -> (f64, f64) {
    let row = n.z.clamp(-1.0, 1.0).acos() / std::f64::consts::PI * ROWS as f64 - 0.5;
    let turn = n.y.atan2(n.x) / std::f64::consts::TAU;
    let column = turn.rem_euclid(1.0) * COLUMNS as f64 - 0.5;
    (row.max(0.0), if column < 0.0 { column + COLUMNS as f64 } else { column })
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
    fn truth_a_band_around_the_ball_is_found_where_it_is() {
        let band = |n: &Vector3<f64>| if n.dot(&Vector3::new(0.6, 0.0, 0.8)).abs() < 0.15 { 0.3 } else { 1.0 };
        let many = (0..40_000).map(|i| {
            // Fibonacci's lattice: even all over the sphere.
            let z = 1.0 - (2.0 * i as f64 + 1.0) / 40_000.0;
            let a = i as f64 * 2.399_963_229_728_653;
            let n = Vector3::new((1.0 - z * z).sqrt() * a.cos(), (1.0 - z * z).sqrt() * a.sin(), z);
            (n, band(&n), 1.0)
        });
        let mut sums = TextureSums::default();
        many.for_each(|(n, value, weight)| sums.add(cell_of(&n), weight * (value - 1.0), weight));
        let mut texture = BallTexture::bare();
        texture.correct(&sums);
        for n in [Vector3::new(0.8, 0.0, -0.6), Vector3::y(), -Vector3::y()] {
            assert!(texture.at(&n) < 0.45, "{n}: {}", texture.at(&n));
        }
        for n in [Vector3::new(0.6, 0.0, 0.8), Vector3::z(), -Vector3::z(), Vector3::x()] {
            assert!(texture.at(&n) > 0.95, "{n}: {}", texture.at(&n));
        }
        assert!((BallTexture::bare().at(&Vector3::new(0.0, -0.6, 0.8)) - 1.0).abs() < 1e-12);
    }
}
