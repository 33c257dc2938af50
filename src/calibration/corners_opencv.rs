//! Checkerboard corners by OpenCV: `findChessboardCorners`, with the seeded sector-based detector as a second try, and
//! `cornerSubPix` with a window that follows the size of the squares in the picture.

use super::board::Checkerboard;
use super::calibrator::{Calibration, CalibrationOptions, PairViews, calibrate_views};
use super::error::CalibrationError;
use super::saddle::refine_corners;
use super::view::{BoardView, ViewFault, even_squares_dark};
use crate::footage::GreyImage;
use nalgebra::Vector2;
use opencv::core::{Mat, Point2f, Size, TermCriteria, TermCriteria_Type, Vector};
use opencv::{calib3d, imgproc};
use rayon::prelude::*;

/// Half-window of the sub-pixel search as a share of the smallest corner spacing: a fixed one drags corners of small
/// squares by pixels (0.3 worked on three sets, 0.4 broke one of them).
const WINDOW_SHARE: f64 = 0.3;
/// Seed of OpenCV's random generator before the sector-based detector, which answers differently from call to call.
const SEED: i32 = 20_061;

/// Finds, refines and orders the board's corners in one picture.
///
/// The order is right-handed as seen in the image, with a dark square between the first four corners wherever the board's
/// numbers of corners allow telling its two ends apart.
///
/// # Errors  `CalibrationError::Detector` when OpenCV itself fails; a picture without a usable board is a [`ViewFault`].
pub fn find_corners(image: &GreyImage, board: &Checkerboard) -> Result<Result<BoardView, ViewFault>, CalibrationError> {
    find(image, board).map_err(|e| CalibrationError::Detector(e.to_string()))
}

fn find(image: &GreyImage, board: &Checkerboard) -> opencv::Result<Result<BoardView, ViewFault>> {
    // Our loops run over pictures; OpenCV's own threads would only make its random numbers depend on scheduling.
    opencv::core::set_num_threads(1)?;
    let mat = Mat::new_rows_cols_with_data(i32::try_from(image.height)?, i32::try_from(image.width)?, &image.pixels)?;
    let size = Size::new(board.columns as i32, board.rows as i32);
    let mut fault = ViewFault::NotFound;
    for second_try in [false, true] {
        let mut found = Vector::<Point2f>::new();
        let answered = if second_try {
            opencv::core::set_rng_seed(SEED)?;
            calib3d::find_chessboard_corners_sb(&mat, size, &mut found, calib3d::CALIB_CB_EXHAUSTIVE | calib3d::CALIB_CB_ACCURACY)?
        } else {
            calib3d::find_chessboard_corners(&mat, size, &mut found, calib3d::CALIB_CB_ADAPTIVE_THRESH | calib3d::CALIB_CB_NORMALIZE_IMAGE)?
        };
        if !answered || found.len() != board.corner_count() {
            continue;
        }
        let rough: Vec<Vector2<f64>> = found.iter().map(|p| Vector2::new(f64::from(p.x), f64::from(p.y))).collect();
        // The gate comes before the refinement too: a wrong grid has no meaningful window.
        if let Err(e) = BoardView::from_corners(board, rough.clone()) {
            fault = e;
            continue;
        }
        let half = (WINDOW_SHARE * board.smallest_spacing_px(&rough)).round().clamp(2.0, 40.0) as i32;
        let criteria = TermCriteria::new(TermCriteria_Type::COUNT as i32 + TermCriteria_Type::EPS as i32, 100, 1e-4)?;
        imgproc::corner_sub_pix(&mat, &mut found, Size::new(half, half), Size::new(-1, -1), criteria)?;
        let near = board.right_handed(found.iter().map(|p| Vector2::new(f64::from(p.x), f64::from(p.y))).collect());
        let refined = refine_corners(board, &near, image);
        let ordered = (0..board.turns()).map(|t| board.turned(&refined, t)).find(|c| even_squares_dark(board, c, image)).unwrap_or(refined);
        match BoardView::from_corners(board, ordered).and_then(|v| v.judged(board, image)) {
            Ok(view) => return Ok(Ok(view)),
            Err(e) => fault = e,
        }
    }
    Ok(Err(fault))
}

/// Both cameras' pictures of one position of the board.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PairImages {
    pub name: String,
    pub left: Option<GreyImage>,
    pub right: Option<GreyImage>,
}

/// Calibrates from pictures in memory: corners of all pictures in parallel, then [`calibrate_views`].
///
/// # Errors  those of `find_corners` and `calibrate_views`; pictures of different sizes
pub fn calibrate_images(board: &Checkerboard, pairs: &[PairImages], options: &CalibrationOptions) -> Result<Calibration, CalibrationError> {
    let mut size = None;
    for (name, image) in pairs.iter().flat_map(|p| [(&p.name, &p.left), (&p.name, &p.right)]).filter_map(|(n, i)| Some((n, i.as_ref()?))) {
        let first = *size.get_or_insert([image.width, image.height]);
        if first != [image.width, image.height] {
            let (width, height) = (image.width, image.height);
            return Err(CalibrationError::PictureSize { name: name.clone(), width, height, expected_width: first[0], expected_height: first[1] });
        }
    }
    let look = |image: &Option<GreyImage>| image.as_ref().map_or(Ok(Err(ViewFault::NoPicture)), |i| find_corners(i, board));
    let views = pairs
        .par_iter()
        .map(|p| Ok(PairViews { name: p.name.clone(), left: look(&p.left)?, right: look(&p.right)? }))
        .collect::<Result<Vec<_>, CalibrationError>>()?;
    calibrate_views(board, size.unwrap_or([0, 0]), &views, options)
}
