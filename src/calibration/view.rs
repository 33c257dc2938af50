//! One picture of the board: its corners, how sharp and how well exposed it is, and why a picture is refused.

use super::board::Checkerboard;
use super::homography::{homography, homography_rms_px, mapped};
use crate::footage::GreyImage;
use crate::median::median;
use nalgebra::Vector2;

/// The board's corners in one picture, in the board's order, with what the picture's quality is judged by.
#[derive(Debug, Clone, PartialEq)]
pub struct BoardView {
    /// One per corner of the board, row by row, px.
    pub corners: Vec<Vector2<f64>>,
    /// Smallest distance between neighbouring corners, px.
    pub spacing_px: f64,
    /// Standard deviation of the blur across the edges between squares, px; `None` when it was not measured.
    pub blur_px: Option<f64>,
    /// How far the bright squares have grown over their edges, px; positive where they bloom.
    pub bloom_px: Option<f64>,
}

/// Why one picture of the board is not used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ViewFault {
    #[error("no picture")]
    NoPicture,
    #[error("{0}")]
    Unreadable(String),
    #[error("the very picture of {0}")]
    SamePicture(String),
    #[error("{}x{} px where most pictures are {}x{}; take all with one setting", .size[0], .size[1], .usual[0], .usual[1])]
    AnotherSize { size: [usize; 2], usual: [usize; 2] },
    #[error("board not found")]
    NotFound,
    #[error("{}{}", if .seen < .all { format!("only {seen} of the board's {all} corners found") } else { format!("{seen} corners found, but not in the board's rows and columns (board_rows and board_columns of session.toml count inner corners)") }, if *.cut_by_border { ": it is cut by the picture's border" } else { "" })]
    PartOfBoard { seen: usize, all: usize, cut_by_border: bool },
    #[error("a board of {columns} x {rows} inner corners")]
    AnotherBoard { columns: usize, rows: usize },
    #[error("the corners found do not lie on a plane grid ({rms_px:.1} px off, allowed {allowed_px:.1})")]
    WrongGrid { rms_px: f64, allowed_px: f64 },
    #[error("blurred (edges {blur_px:.2} px wide, allowed {allowed_px:.2})")]
    Blurred { blur_px: f64, allowed_px: f64 },
    #[error("bloomed (bright squares {bloom_px:.2} px too large, allowed {allowed_px:.2})")]
    Bloomed { bloom_px: f64, allowed_px: f64 },
    #[error("bloomed ({saturated_percent:.0} % of the white is saturated and the black is lifted to {black:.0} of 255)")]
    Overexposed { saturated_percent: f64, black: f64 },
    #[error("corners {rms_px:.2} px from where the other boards put them (allowed {allowed_px:.2})")]
    Inconsistent { rms_px: f64, allowed_px: f64 },
}

/// A grid found in the picture is refused when a plane homography misses its corners by more than this share of the
/// smallest spacing. Good views of the Bouguet set (strong lens distortion) stay below 0.04, wrong grids are above 2.
const WRONG_GRID_SHARE: f64 = 0.2;
/// Blur (sd) as a share of the corner spacing at which neighbouring edges begin to pull each other. Good practice views
/// stay below 0.09.
const BLUR_SHARE: f64 = 0.16;
/// Growth of the bright squares as a share of the corner spacing; good practice views stay below 0.03.
const BLOOM_SHARE: f64 = 0.08;
/// A picture is overexposed when more than this share of the white is saturated (in the board and the rim around it) ...
const SATURATED_SHARE: f64 = 0.3;
/// ... and the black squares are lifted above this grey level: light has spread into them. Clipped white alone leaves the
/// edges where they are. Bloomed practice views have 74 to 216, good ones up to 15.
const LIFTED_BLACK: f64 = 50.0;

impl BoardView {
    /// A view of known corners without its picture.
    pub fn from_corners(board: &Checkerboard, corners: Vec<Vector2<f64>>) -> Result<Self, ViewFault> {
        let spacing_px = board.smallest_spacing_px(&corners);
        let points = board.corners();
        let allowed_px = WRONG_GRID_SHARE * spacing_px;
        let rms_px = homography(&points, &corners).map_or(f64::INFINITY, |h| homography_rms_px(&h, &points, &corners));
        if rms_px.is_nan() || rms_px > allowed_px {
            return Err(ViewFault::WrongGrid { rms_px, allowed_px });
        }
        Ok(BoardView { corners, spacing_px, blur_px: None, bloom_px: None })
    }

    /// Measures blur and bloom on the picture; refuses views in which they move the corners.
    pub fn judged(mut self, board: &Checkerboard, image: &GreyImage) -> Result<Self, ViewFault> {
        let (blur_px, bloom_px) = edge_quality(board, &self.corners, image);
        self.blur_px = blur_px;
        self.bloom_px = bloom_px;
        if let Some(blur_px) = blur_px {
            let allowed_px = (BLUR_SHARE * self.spacing_px).max(1.0);
            if blur_px > allowed_px {
                return Err(ViewFault::Blurred { blur_px, allowed_px });
            }
        }
        if let Some(bloom_px) = bloom_px {
            let allowed_px = (BLOOM_SHARE * self.spacing_px).max(0.4);
            if bloom_px.abs() > allowed_px {
                return Err(ViewFault::Bloomed { bloom_px, allowed_px });
            }
        }
        let (saturated, black) = exposure(board, &self.corners, image);
        if saturated > SATURATED_SHARE && black > LIFTED_BLACK {
            return Err(ViewFault::Overexposed { saturated_percent: 100.0 * saturated, black });
        }
        Ok(self)
    }
}

/// Share of the bright samples that are saturated, and the median grey of the dark ones, over the board's squares and the
/// rim around them.
fn exposure(board: &Checkerboard, corners: &[Vector2<f64>], image: &GreyImage) -> (f64, f64) {
    let Some(h) = homography(&board.corners(), corners) else { return (0.0, 0.0) };
    let s = board.square_m;
    let mut greys = Vec::new();
    for i in -6..=4 * board.rows as i64 + 2 {
        for j in -6..=4 * board.columns as i64 + 2 {
            greys.extend(sample(image, mapped(&h, (j as f64 + 0.5) * s / 4.0, (i as f64 + 0.5) * s / 4.0)));
        }
    }
    let Some(middle) = greys.iter().copied().reduce(f64::max).zip(greys.iter().copied().reduce(f64::min)).map(|(a, b)| (a + b) / 2.0) else {
        return (0.0, 0.0);
    };
    let (dark, bright): (Vec<f64>, Vec<f64>) = greys.into_iter().partition(|g| *g < middle);
    let saturated = bright.iter().filter(|g| **g >= 253.5).count() as f64 / bright.len().max(1) as f64;
    (saturated, median(dark).unwrap_or(0.0))
}

/// Whether the inner squares at even places (row + column even) are the dark ones.
#[cfg(feature = "vision")]
pub fn even_squares_dark(board: &Checkerboard, corners: &[Vector2<f64>], image: &GreyImage) -> bool {
    let mut sums = [0.0; 2];
    let mut counts = [0usize; 2];
    for r in 0..board.rows - 1 {
        for c in 0..board.columns - 1 {
            let i = r * board.columns + c;
            let centre = (corners[i] + corners[i + 1] + corners[i + board.columns] + corners[i + board.columns + 1]) / 4.0;
            if let Some(v) = sample(image, centre) {
                sums[(r + c) % 2] += v;
                counts[(r + c) % 2] += 1;
            }
        }
    }
    sums[0] / counts[0].max(1) as f64 <= sums[1] / counts[1].max(1) as f64
}

/// Bilinear grey value; `None` outside.
pub fn sample(image: &GreyImage, p: Vector2<f64>) -> Option<f64> {
    if !(p.x >= 0.0 && p.y >= 0.0) {
        return None;
    }
    let (x, y) = (p.x.floor() as usize, p.y.floor() as usize);
    let (fx, fy) = (p.x - x as f64, p.y - y as f64);
    let at = |dx: usize, dy: usize| image.get(x + dx, y + dy).map(f64::from);
    let (a, b, c, d) = (at(0, 0)?, at(1, 0)?, at(0, 1)?, at(1, 1)?);
    Some((a * (1.0 - fx) + b * fx) * (1.0 - fy) + (c * (1.0 - fx) + d * fx) * fy)
}

/// Blur (sd, px) and median growth of the bright side (px) over the edges between inner corners. The blur is the larger of
/// the medians over edges along the columns and along the rows: a board in motion is sharp in one direction.
///
/// Across the middle of each edge the profile is sampled: its steepest slope gives the blur of a straight edge,
/// `sd = contrast / (slope sqrt(2 pi))`; where it crosses the mean of both sides gives the edge's place.
fn edge_quality(board: &Checkerboard, corners: &[Vector2<f64>], image: &GreyImage) -> (Option<f64>, Option<f64>) {
    let (mut blurs, mut blooms) = ([Vec::new(), Vec::new()], Vec::new());
    for (a, b) in board.neighbours() {
        let along = corners[b] - corners[a];
        let (ra, ca) = (a / board.columns, a % board.columns);
        let horizontal = b == a + 1;
        // Only edges with a full square on both sides: at the board's rim the neighbour may be cut.
        let inner = if horizontal { ra > 0 && ra + 1 < board.rows } else { ca > 0 && ca + 1 < board.columns };
        if !inner {
            continue;
        }
        let (before, after) = if horizontal { (a - board.columns, a + board.columns) } else { (a - 1, a + 1) };
        let across = (corners[after] - corners[before]) / 2.0;
        let normal = Vector2::new(-along.y, along.x) / along.norm().max(1e-9);
        let reach = 0.5 * across.dot(&normal).abs();
        let middle = (corners[a] + corners[b]) / 2.0;
        let step = 0.25;
        let n = (reach / step) as i64;
        if n < 4 {
            continue;
        }
        let Some(profile) = (-n..=n).map(|i| sample(image, middle + normal * (i as f64 * step))).collect::<Option<Vec<f64>>>() else { continue };
        let ends = (profile.len() / 8).max(1);
        let mean = |s: &[f64]| s.iter().sum::<f64>() / s.len() as f64;
        let (low, high) = (mean(&profile[..ends]), mean(&profile[profile.len() - ends..]));
        let contrast = high - low;
        if contrast.abs() < 8.0 {
            continue;
        }
        let slope = profile.windows(5).map(|w| ((w[4] - w[0]) / (4.0 * step) / contrast).max(0.0)).fold(0.0, f64::max);
        if slope <= 0.0 {
            continue;
        }
        blurs[usize::from(horizontal)].push(1.0 / (slope * (2.0 * std::f64::consts::PI).sqrt()));
        // The signed area under the normalised profile is the edge's place without a threshold's noise.
        let share: f64 = profile.iter().map(|v| (v - low) / contrast).sum::<f64>() / profile.len() as f64;
        let edge = (0.5 - share) * 2.0 * n as f64 * step;
        blooms.push(if contrast > 0.0 { -edge } else { edge });
    }
    let blur = blurs.into_iter().filter_map(median).reduce(f64::max);
    (blur, median(blooms))
}
