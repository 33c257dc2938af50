//! What the ball's cover looks like all around: brightness relative to a bare ball, by direction on the ball.
//!
//! Lines and panels near the outline are what a fit of the outline alone stumbles over. The ball shows them elsewhere on
//! its disc in other pictures, so once its spin is known they can be collected here and expected where they are.

use nalgebra::Vector3;

/// Cells over latitude and longitude: 3.75 degrees, half a pixel on a ball of 16 px.
const ROWS: usize = 48;
const COLUMNS: usize = 96;
/// Reach of the smoothing kernel, rad (one standard deviation), and where it is cut off.
const KERNEL_RAD: f64 = 0.07;
const CUT_OFF: f64 = 2.8;
/// Weight of "a bare ball" against the pixels of one picture (a pixel of usual brightness has weight 1).
const PRIOR: f64 = 0.3;

/// Brightness relative to a bare ball, in axes that turn with the ball.
#[derive(Debug, Clone)]
pub struct BallTexture {
    cells: Vec<f64>,
}

impl BallTexture {
    /// A bare ball.
    pub fn bare() -> Self {
        BallTexture { cells: vec![1.0; ROWS * COLUMNS] }
    }

    /// The weighted mean around every direction of (direction on the ball, relative brightness, weight).
    pub fn of(samples: impl Iterator<Item = (Vector3<f64>, f64, f64)>) -> Self {
        let mut sums = vec![(0.0, 0.0); ROWS * COLUMNS];
        for (n, value, weight) in samples {
            let (row, column) = place(&n);
            let cell = &mut sums[(row.round() as usize).min(ROWS - 1) * COLUMNS + (column.round() as usize) % COLUMNS];
            *cell = (cell.0 + weight * value, cell.1 + weight);
        }
        let centres: Vec<Vector3<f64>> = (0..ROWS * COLUMNS).map(|i| direction(i / COLUMNS, i % COLUMNS)).collect();
        let rows = (CUT_OFF * KERNEL_RAD / std::f64::consts::PI * ROWS as f64).ceil() as usize;
        let mut cells = Vec::with_capacity(ROWS * COLUMNS);
        for (i, centre) in centres.iter().enumerate() {
            let (row, column) = (i / COLUMNS, i % COLUMNS);
            let (mut sum, mut weight) = (PRIOR, PRIOR);
            for r in row.saturating_sub(rows)..=(row + rows).min(ROWS - 1) {
                let narrowest = (std::f64::consts::PI * (r as f64 + 0.5) / ROWS as f64).sin();
                let reach = (CUT_OFF * KERNEL_RAD / narrowest / std::f64::consts::TAU * COLUMNS as f64).ceil().min((COLUMNS / 2) as f64) as usize;
                for k in 0..(2 * reach + 1).min(COLUMNS) {
                    let j = r * COLUMNS + (column + COLUMNS + k - reach) % COLUMNS;
                    if sums[j].1 > 0.0 {
                        let share = ((centre.dot(&centres[j]) - 1.0) / (KERNEL_RAD * KERNEL_RAD)).exp();
                        sum += share * sums[j].0;
                        weight += share * sums[j].1;
                    }
                }
            }
            cells.push(sum / weight);
        }
        BallTexture { cells }
    }

    /// Relative brightness in a direction (unit vector in the ball's axes), bilinear.
    #[inline]
    pub fn at(&self, n: &Vector3<f64>) -> f64 {
        let (row, column) = place(n);
        let row = row.clamp(0.0, (ROWS - 1) as f64);
        let (i, j) = (row as usize, column as usize);
        let (p, q) = (row - i as f64, column - j as f64);
        let (i1, j, j1) = ((i + 1).min(ROWS - 1), j % COLUMNS, (j + 1) % COLUMNS);
        let line = |i: usize| self.cells[i * COLUMNS + j] * (1.0 - q) + self.cells[i * COLUMNS + j1] * q;
        line(i) * (1.0 - p) + line(i1) * p
    }
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
        let texture = BallTexture::of(many);
        for n in [Vector3::new(0.8, 0.0, -0.6), Vector3::y(), -Vector3::y()] {
            assert!(texture.at(&n) < 0.45, "{n}: {}", texture.at(&n));
        }
        for n in [Vector3::new(0.6, 0.0, 0.8), Vector3::z(), -Vector3::z(), Vector3::x()] {
            assert!(texture.at(&n) > 0.95, "{n}: {}", texture.at(&n));
        }
        assert!((BallTexture::bare().at(&Vector3::new(0.0, -0.6, 0.8)) - 1.0).abs() < 1e-12);
    }
}
