//! A board that is not flat: paper on foam or card bows with damp and its own weight.
//!
//! Heights over the board's plane are quadratic: a bow along the rows, one along the columns, and a twist. What is of higher order
//! is small beside these in a board that is not broken; offsets and slopes belong to the board's pose. (Releasing the board's points
//! one by one, Strobl and Hirzinger 2011, needs far more pictures than these three numbers.)

use super::board::Checkerboard;

/// Along the rows, along the columns, twist.
pub const MODES: usize = 3;

/// Heights of a board's corners.
#[derive(Debug, Clone, PartialEq)]
pub struct Bow {
    /// Height of each corner for each number of `sagitta_m`; no mean over the board.
    modes: Vec<[f64; MODES]>,
    /// How much farther from the cameras the ends of the middle row, of the middle column and of the diagonal from the first corner
    /// lie than the board's middle, m. (The twist is that of the diagonal alone.)
    pub sagitta_m: [f64; MODES],
}

impl Bow {
    pub fn none(board: &Checkerboard) -> Self {
        let place = |i: usize, count: usize| if count > 1 { 2.0 * i as f64 / (count - 1) as f64 - 1.0 } else { 0.0 };
        let mut modes: Vec<[f64; MODES]> = (0..board.corner_count())
            .map(|i| {
                let (u, v) = (place(i % board.columns, board.columns), place(i / board.columns, board.rows));
                // A square board's quarter turns cannot be told apart from one picture to the next: only the dome is the same for all.
                if board.columns == board.rows { [0.5 * (u * u + v * v), 0.0, 0.0] } else { [u * u, v * v, u * v] }
            })
            .collect();
        let n = modes.len() as f64;
        for k in 0..MODES {
            let mean = modes.iter().map(|m| m[k]).sum::<f64>() / n;
            modes.iter_mut().for_each(|m| m[k] -= mean);
        }
        Bow { modes, sagitta_m: [0.0; MODES] }
    }

    /// Height of each mode at a corner, per m of its sagitta.
    pub fn modes(&self, corner: usize) -> &[f64; MODES] {
        &self.modes[corner]
    }

    /// Height of a corner, m.
    pub fn height_m(&self, corner: usize) -> f64 {
        self.modes[corner].iter().zip(&self.sagitta_m).map(|(m, s)| m * s).sum()
    }

    /// Which modes the board's corners can tell: two corners in a row cannot tell a bow.
    pub fn told(&self) -> [bool; MODES] {
        [0, 1, 2].map(|k| self.modes.iter().any(|m| m[k].abs() > 1e-9))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn law_a_half_turn_of_the_board_keeps_its_heights() {
        let board = Checkerboard { columns: 5, rows: 4, square_m: 0.1 };
        let bow = Bow { sagitta_m: [1e-3, -2e-3, 3e-3], ..Bow::none(&board) };
        let heights: Vec<f64> = (0..20).map(|i| bow.height_m(i)).collect();
        let turned = board.turned(&heights, 1);
        assert!(heights.iter().zip(&turned).all(|(a, b)| (a - b).abs() < 1e-15));
        assert!(heights.iter().sum::<f64>().abs() < 1e-15);
        // The ends of a row lie that much behind its middle.
        assert!((heights[5] - heights[7] - 1e-3 - 3e-3 / 3.0).abs() < 1e-12, "{heights:?}");
    }

    #[test]
    fn law_a_quarter_turn_of_a_square_board_keeps_its_dome() {
        let board = Checkerboard { columns: 4, rows: 4, square_m: 0.1 };
        let bow = Bow { sagitta_m: [1e-3, 0.0, 0.0], ..Bow::none(&board) };
        let heights: Vec<f64> = (0..16).map(|i| bow.height_m(i)).collect();
        assert!(heights.iter().zip(&board.turned(&heights, 1)).all(|(a, b)| (a - b).abs() < 1e-15));
        assert_eq!(bow.told(), [true, false, false]);
    }

    #[test]
    fn edge_two_rows_cannot_tell_a_bow_along_the_columns() {
        assert_eq!(Bow::none(&Checkerboard { columns: 5, rows: 2, square_m: 0.1 }).told(), [true, false, true]);
    }
}
