//! The calibration judged in millimetres: boards it has not seen, measured again in 3-D.

use super::SquareSize;
use super::bundle::{Bundle, BundleOptions, GOOD_START};
use super::calibrator::Calibration;
use super::rays::midpoint;
use nalgebra::{Point3, Vector2};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Folds of the held-out measurement: each board is measured by a calibration made without it.
const FOLDS: usize = 10;

/// Lengths re-measured on boards held out in turn, mm. `calibration.json` has it under `verdict`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Verdict {
    /// Sides of squares.
    pub squares: SquareSize,
    /// Mean side minus the stated one.
    pub square_bias_mm: f64,
    /// Both diagonals of each board, minus what they should be.
    pub diagonal_error_mean_mm: f64,
    pub diagonal_error_sd_mm: f64,
    pub diagonal_error_max_mm: f64,
    pub diagonals: usize,
    pub diagonal_stated_mm: f64,
    pub boards: usize,
    /// Mean side along the board's rows and along its columns, and the deviation of their difference (from how it scatters over
    /// boards).
    #[serde(default)]
    pub side_along_rows_mm: f64,
    #[serde(default)]
    pub side_along_columns_mm: f64,
    #[serde(default)]
    pub side_difference_sd_mm: f64,
}

/// Squares whose sides differ by more than this share, and by so many deviations, are not square.
const STRETCHED: (f64, f64) = (3e-4, 4.0);

impl Verdict {
    /// Says so when the squares are longer one way than the other.
    pub fn stretched(&self) -> Option<String> {
        let difference = (self.side_along_rows_mm - self.side_along_columns_mm).abs();
        (difference > STRETCHED.0 * self.squares.mean && difference > STRETCHED.1 * self.side_difference_sd_mm && self.side_difference_sd_mm > 0.0).then(|| {
            format!(
                "the squares come out {:.3} mm along the board's rows and {:.3} mm along its columns: the print is stretched, and all lengths may be off by half of that; measure the board both ways, print it again",
                self.side_along_rows_mm, self.side_along_columns_mm
            )
        })
    }
}

/// One board seen by both cameras, with the corners both found.
pub struct MeasuredBoard {
    pub view: usize,
    /// Place of each corner, left camera's frame, m; `None` where a camera missed it.
    pub corners: Vec<Option<Point3<f64>>>,
}

impl Calibration {
    /// Views that both cameras see, in order.
    pub fn stereo_views(&self) -> Vec<usize> {
        (0..self.bundle.views.len()).filter(|&v| self.bundle.views[v].is_in_both()).collect()
    }

    /// The views split into folds: which are held out together.
    pub fn folds(&self) -> Vec<Vec<usize>> {
        let views = self.stereo_views();
        let k = FOLDS.min(views.len());
        (0..k).map(|f| views.iter().copied().skip(f).step_by(k.max(1)).collect()).collect()
    }

    /// The adjustment without some views, started at the full one. `None` when the rest does not determine the cameras.
    pub fn without(&self, held_out: &[usize]) -> Option<Bundle> {
        let mut bundle = self.bundle.clone();
        bundle.views = self.bundle.views.iter().enumerate().filter(|(i, _)| !held_out.contains(i)).map(|(_, v)| v.clone()).collect();
        bundle
            .adjust(&BundleOptions { active: self.model.active(), huber_px: None, max_iterations: 100, settled_gain: GOOD_START, clustered_errors: false })
            .ok()?;
        Some(bundle)
    }

    /// Corners of a view triangulated with the cameras of `bundle`.
    pub fn measure_board(&self, bundle: &Bundle, view: usize) -> MeasuredBoard {
        let mut uv = vec![[None::<Vector2<f64>>; 2]; self.board.corner_count()];
        for c in &self.bundle.views[view].left {
            uv[c.index][0] = Some(c.uv);
        }
        for c in &self.bundle.views[view].right {
            uv[c.index][1] = Some(c.uv);
        }
        let corners = uv.iter().map(|p| midpoint(&bundle.left, &bundle.right, &bundle.right_from_left, &[p[0]?, p[1]?])).collect();
        MeasuredBoard { view, corners }
    }

    /// Measures every board with a calibration that has not seen it. `None` with too few boards to hold any out.
    pub fn held_out_boards(&self) -> Option<Vec<MeasuredBoard>> {
        let folds = self.folds();
        if self.stereo_views().len() < super::calibrator::MIN_PAIRS + 2 {
            return None;
        }
        let measured: Vec<Vec<MeasuredBoard>> = folds
            .par_iter()
            .map(|held_out| self.without(held_out).map_or_else(Vec::new, |b| held_out.iter().map(|&v| self.measure_board(&b, v)).collect()))
            .collect();
        let mut all: Vec<MeasuredBoard> = measured.into_iter().flatten().collect();
        all.sort_by_key(|b| b.view);
        (!all.is_empty()).then_some(all)
    }

    pub fn verdict(&self) -> Option<Verdict> {
        let boards = self.held_out_boards()?;
        let length = |b: &MeasuredBoard, (i, j): (usize, usize)| Some(1e3 * (b.corners[i]? - b.corners[j]?).norm());
        let sides: Vec<f64> = boards.iter().flat_map(|b| self.board.neighbours().into_iter().filter_map(|p| length(b, p)).collect::<Vec<_>>()).collect();
        let corners = self.board.corners();
        let ends = self.board.diagonals();
        let stated = 1e3 * (corners[ends[0].0] - corners[ends[0].1]).norm();
        let diagonals: Vec<f64> = boards.iter().flat_map(|b| ends.iter().filter_map(|p| length(b, *p)).collect::<Vec<_>>()).map(|d| d - stated).collect();
        let (mean, sd) = mean_sd(&sides)?;
        // Neighbours in a row have neighbouring indices.
        let along = |rows: bool, b: &MeasuredBoard| {
            let lengths: Vec<f64> = self.board.neighbours().into_iter().filter(|(i, j)| (i.abs_diff(*j) == 1) == rows).filter_map(|p| length(b, p)).collect();
            (!lengths.is_empty()).then(|| lengths.iter().sum::<f64>() / lengths.len() as f64)
        };
        let both_ways: Vec<(f64, f64)> = boards.iter().filter_map(|b| along(true, b).zip(along(false, b))).collect();
        let n = both_ways.len().max(1) as f64;
        let (in_rows, in_columns) = both_ways.iter().fold((0.0, 0.0), |sum, b| (sum.0 + b.0 / n, sum.1 + b.1 / n));
        let differences: Vec<f64> = both_ways.iter().map(|b| b.0 - b.1).collect();
        let (diagonal_error_mean_mm, diagonal_error_sd_mm) = mean_sd(&diagonals)?;
        Some(Verdict {
            squares: SquareSize { mean, sd, n: sides.len() },
            square_bias_mm: mean - 1e3 * self.board.square_m,
            diagonal_error_mean_mm,
            diagonal_error_sd_mm,
            diagonal_error_max_mm: diagonals.iter().map(|d| d.abs()).fold(0.0, f64::max),
            diagonals: diagonals.len(),
            diagonal_stated_mm: stated,
            boards: boards.len(),
            side_along_rows_mm: in_rows,
            side_along_columns_mm: in_columns,
            side_difference_sd_mm: mean_sd(&differences).map_or(0.0, |(_, sd)| sd / n.sqrt()),
        })
    }
}

/// Mean and standard deviation (n - 1); `None` for fewer than two values.
pub fn mean_sd(values: &[f64]) -> Option<(f64, f64)> {
    let n = values.len() as f64;
    if values.len() < 2 {
        return None;
    }
    let mean = values.iter().sum::<f64>() / n;
    Some((mean, (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0)).sqrt()))
}
