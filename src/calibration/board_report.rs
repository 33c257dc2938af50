//! Where each board stood and how far its corners are from where the calibration puts them: what a reader looks at to
//! believe a calibration. Key `boards` of `calibration.json`.

use super::calibrator::Calibration;
use super::rig::StereoRig;
use nalgebra::Vector2;
use serde::{Deserialize, Serialize};

/// Key in `calibration.json`.
pub const BOARDS_KEY: &str = "boards";

/// One position of the board at the optimum.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BoardReport {
    /// The pair's number as the file names show it.
    pub pair: String,
    /// The board's four outer inner-corners in order around, left camera's axes, m.
    pub outline_left_m: [[f64; 3]; 4],
    /// Corners used in the left picture: u, v seen, then seen minus predicted, px.
    pub left_px: Vec<[f64; 4]>,
    /// The same in the right picture.
    pub right_px: Vec<[f64; 4]>,
}

impl Calibration {
    /// Every board that entered the adjustment; numbers rounded to 1 µm and 0.1 mpx, so that the file stays small.
    pub fn board_reports(&self) -> Vec<BoardReport> {
        let (columns, n) = (self.board.columns, self.board.corner_count());
        let around = [0, columns - 1, n - 1, n - columns];
        let round = |v: f64, unit: f64| (v / unit).round() * unit;
        let list = |seen: &[super::bundle::CornerPixel], residuals: &[Vector2<f64>]| -> Vec<[f64; 4]> {
            seen.iter().zip(residuals).map(|(c, d)| [c.uv.x, c.uv.y, d.x, d.y].map(|v| round(v, 1e-4))).collect()
        };
        self.bundle
            .views
            .iter()
            .zip(&self.pair_of_view)
            .filter_map(|(view, &pair)| {
                let (left, right) = self.bundle.residuals(view)?;
                let left_from_board = if view.left.is_empty() { self.bundle.right_from_left.inverse() * view.pose } else { view.pose };
                let outline = around.map(|i| {
                    let p = left_from_board * self.bundle.corner(i);
                    [p.x, p.y, p.z].map(|v| round(v, 1e-6))
                });
                Some(BoardReport {
                    pair: self.pairs.get(pair).map_or_else(String::new, |p| p.name.clone()),
                    outline_left_m: outline,
                    left_px: list(&view.left, &left),
                    right_px: list(&view.right, &right),
                })
            })
            .collect()
    }
}

impl StereoRig {
    /// The boards of `calibration.json`; empty when the file does not hold them.
    pub fn board_reports(&self) -> Vec<BoardReport> {
        self.more.get(BOARDS_KEY).and_then(|v| serde_json::from_value(v.clone()).ok()).unwrap_or_default()
    }
}
