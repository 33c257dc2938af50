//! The checkerboard: its corners in its own plane, and the order in which an image's corners are read.

use nalgebra::{Point3, Vector2};

/// A flat board of squares; `columns` x `rows` inner corners, `square_m` apart. Board frame: x along the columns, y along
/// the rows, z = 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Checkerboard {
    pub columns: usize,
    pub rows: usize,
    pub square_m: f64,
}

impl Checkerboard {
    pub fn corner_count(&self) -> usize {
        self.columns * self.rows
    }

    /// Board coordinates of corner `index` (row by row), m.
    pub fn corner(&self, index: usize) -> Point3<f64> {
        Point3::new((index % self.columns) as f64 * self.square_m, (index / self.columns) as f64 * self.square_m, 0.0)
    }

    pub fn corners(&self) -> Vec<Point3<f64>> {
        (0..self.corner_count()).map(|i| self.corner(i)).collect()
    }

    /// Index pairs of neighbouring corners, along columns and along rows.
    pub fn neighbours(&self) -> Vec<(usize, usize)> {
        let mut out = Vec::with_capacity(2 * self.corner_count());
        for r in 0..self.rows {
            for c in 0..self.columns {
                let i = r * self.columns + c;
                if c + 1 < self.columns {
                    out.push((i, i + 1));
                }
                if r + 1 < self.rows {
                    out.push((i, i + self.columns));
                }
            }
        }
        out
    }

    /// The two longest diagonals, as index pairs.
    pub fn diagonals(&self) -> [(usize, usize); 2] {
        let n = self.corner_count();
        [(0, n - 1), (self.columns - 1, n - self.columns)]
    }

    /// Turns of the board in its plane that keep its outline: 2 for a rectangle (0 and 180 degrees), 4 for a square.
    pub fn turns(&self) -> usize {
        if self.columns == self.rows { 4 } else { 2 }
    }

    /// The corners in the order they have after `turn` (0 to `turns() - 1`); a turn is 180 degrees on a rectangular board
    /// and 90 degrees on a square one. Chirality is kept.
    pub fn turned<T: Copy>(&self, corners: &[T], turn: usize) -> Vec<T> {
        let n = self.columns;
        match (self.columns == self.rows, turn) {
            (_, 0) => corners.to_vec(),
            (false, _) | (true, 2) => corners.iter().rev().copied().collect(),
            (true, 1) => (0..n * n).map(|i| corners[(n - 1 - i % n) * n + i / n]).collect(),
            (true, _) => (0..n * n).map(|i| corners[(i % n) * n + (n - 1 - i / n)]).collect(),
        }
    }

    /// Makes the order right-handed as seen in the image (columns to rows turns like x to y): a board shows its front.
    pub fn right_handed(&self, corners: Vec<Vector2<f64>>) -> Vec<Vector2<f64>> {
        let (c, n) = (self.columns, self.corner_count());
        let along = corners[c - 1] - corners[0] + corners[n - 1] - corners[n - c];
        let down = corners[n - c] - corners[0] + corners[n - 1] - corners[c - 1];
        if along.perp(&down) >= 0.0 {
            return corners;
        }
        corners.chunks(c).flat_map(|row| row.iter().rev().copied().collect::<Vec<_>>()).collect()
    }

    /// Smallest distance between neighbouring corners of a view, px.
    pub fn smallest_spacing_px(&self, corners: &[Vector2<f64>]) -> f64 {
        self.neighbours().iter().map(|&(a, b)| (corners[a] - corners[b]).norm()).fold(f64::INFINITY, f64::min)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn law_four_quarter_turns_are_none_and_two_are_a_half_turn() {
        let b = Checkerboard { columns: 5, rows: 5, square_m: 0.1 };
        let order: Vec<usize> = (0..25).collect();
        let mut o = order.clone();
        for _ in 0..4 {
            o = b.turned(&o, 1);
        }
        assert_eq!(o, order);
        assert_eq!(b.turned(&b.turned(&order, 1), 1), b.turned(&order, 2));
        assert_eq!(b.turned(&b.turned(&order, 1), 3), order);
    }

    #[test]
    fn truth_a_mirrored_order_is_made_right_handed() {
        let b = Checkerboard { columns: 4, rows: 3, square_m: 1.0 };
        let good: Vec<_> = b.corners().iter().map(|p| Vector2::new(p.x, p.y)).collect();
        let mirrored: Vec<_> = good.chunks(4).flat_map(|r| r.iter().rev().copied().collect::<Vec<_>>()).collect();
        assert_eq!(b.right_handed(mirrored), good);
        assert_eq!(b.right_handed(good.clone()), good);
        // Turning keeps the handedness.
        assert_eq!(b.right_handed(b.turned(&good, 1)), b.turned(&good, 1));
    }
}
