//! A board that is not quite what it should be: paper on foam or card bows with damp and its own weight, and printers stretch.
//!
//! Four numbers, the same in all pictures: heights over the board's plane that are quadratic (a bow along the rows, one along the columns,
//! a twist), and squares that are longer one way than the other. What is of higher order is small beside these in a board that is not
//! broken; offsets and slopes belong to the board's pose, its size cannot be told from pictures. (Releasing the board's points one
//! by one, Strobl and Hirzinger 2011, needs far more pictures.)

use super::board::Checkerboard;
use nalgebra::{Point3, Vector3};

/// Sagitta along the rows, along the columns, of the twist (m); stretch.
pub const MODES: usize = 4;

/// Place of the stretch among the values.
pub const STRETCH: usize = 3;

/// How a board differs from a flat one of squares.
#[derive(Debug, Clone, PartialEq)]
pub struct BoardShape {
    /// Displacement of each corner per unit of each of `values`, m; no mean over the board.
    modes: Vec<[Vector3<f64>; MODES]>,
    /// How much farther from the cameras the ends of the middle row, of the middle column and of the diagonal from the first corner
    /// lie than the board's middle, m (the twist is that of the diagonal alone); then how much longer squares are along the rows than
    /// along the columns, as a share (their mean is as stated).
    pub values: [f64; MODES],
}

impl BoardShape {
    /// The board as it should be; what differs from it is adjusted, a stretch only where asked for.
    pub fn perfect(board: &Checkerboard, stretched: bool) -> Self {
        let place = |i: usize, count: usize| if count > 1 { 2.0 * i as f64 / (count - 1) as f64 - 1.0 } else { 0.0 };
        let middle = Vector3::new((board.columns - 1) as f64, (board.rows - 1) as f64, 0.0) * (board.square_m / 2.0);
        let mut modes: Vec<[Vector3<f64>; MODES]> = (0..board.corner_count())
            .map(|i| {
                let (u, v) = (place(i % board.columns, board.columns), place(i / board.columns, board.rows));
                let height = |z: f64| Vector3::new(0.0, 0.0, z);
                // A square board's quarter turns cannot be told apart from one picture to the next: only the dome is the same for all.
                if board.columns == board.rows {
                    return [height(0.5 * (u * u + v * v)), Vector3::zeros(), Vector3::zeros(), Vector3::zeros()];
                }
                let from_middle = board.corner(i).coords - middle;
                let stretch = if stretched { Vector3::new(from_middle.x, -from_middle.y, 0.0) / 2.0 } else { Vector3::zeros() };
                [height(u * u), height(v * v), height(u * v), stretch]
            })
            .collect();
        let n = modes.len() as f64;
        for k in 0..MODES {
            let mean = modes.iter().map(|m| m[k]).sum::<Vector3<f64>>() / n;
            modes.iter_mut().for_each(|m| m[k] -= mean);
        }
        BoardShape { modes, values: [0.0; MODES] }
    }

    /// Displacement of a corner per unit of each of `values`.
    pub fn modes(&self, corner: usize) -> &[Vector3<f64>; MODES] {
        &self.modes[corner]
    }

    /// Where a corner lies that lies at `flat` on the board as it should be, m.
    pub fn place(&self, corner: usize, flat: &Point3<f64>) -> Point3<f64> {
        flat + self.modes[corner].iter().zip(self.values).map(|(m, v)| m * v).sum::<Vector3<f64>>()
    }

    /// Which values the board's corners can tell: two corners in a row cannot tell a bow.
    pub fn told(&self) -> [bool; MODES] {
        std::array::from_fn(|k| self.modes.iter().any(|m| m[k].amax() > 1e-9))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn displaced(board: &Checkerboard, values: [f64; MODES]) -> Vec<Vector3<f64>> {
        let shape = BoardShape { values, ..BoardShape::perfect(board, true) };
        (0..board.corner_count()).map(|i| shape.place(i, &Point3::origin()).coords).collect()
    }

    #[test]
    fn law_a_half_turn_of_the_board_keeps_its_shape() {
        let board = Checkerboard { columns: 5, rows: 4, square_m: 0.1 };
        let places = displaced(&board, [1e-3, -2e-3, 3e-3, 4e-3]);
        let half_turn = |p: &Vector3<f64>| Vector3::new(-p.x, -p.y, p.z);
        assert!(places.iter().zip(&board.turned(&places, 1)).all(|(a, b)| (a - half_turn(b)).amax() < 1e-15));
        assert!(places.iter().sum::<Vector3<f64>>().amax() < 1e-15);
        // The ends of a row lie that much behind its middle, and the row is longer.
        assert!((places[5].z - places[7].z - 1e-3 - 3e-3 / 3.0).abs() < 1e-12, "{places:?}");
        assert!((places[9].x - places[5].x - 0.4 * 2e-3).abs() < 1e-12 && (places[15].y - places[0].y + 0.3 * 2e-3).abs() < 1e-12, "{places:?}");
    }

    #[test]
    fn law_a_quarter_turn_of_a_square_board_keeps_its_dome() {
        let board = Checkerboard { columns: 4, rows: 4, square_m: 0.1 };
        let heights: Vec<f64> = displaced(&board, [1e-3, 2.0, 3.0, 4.0]).iter().map(|p| p.z).collect();
        assert!(heights.iter().zip(&board.turned(&heights, 1)).all(|(a, b)| (a - b).abs() < 1e-15));
        assert_eq!(BoardShape::perfect(&board, true).told(), [true, false, false, false]);
    }

    #[test]
    fn edge_two_rows_cannot_tell_a_bow_along_the_columns() {
        let told = |stretched| BoardShape::perfect(&Checkerboard { columns: 5, rows: 2, square_m: 0.1 }, stretched).told();
        assert_eq!((told(true), told(false)), ([true, false, true, true], [true, false, true, false]));
    }
}
