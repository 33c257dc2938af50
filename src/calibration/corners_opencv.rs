//! Checkerboard corners of one picture: our own grid of saddles first; where that is not whole OpenCV's
//! `findChessboardCorners`, then its seeded sector-based detector. `cornerSubPix` with a window that follows the size of the
//! squares serves where the fit of the grey values does not settle.

use super::board::Checkerboard;
use super::calibrator::{Calibration, CalibrationOptions, PairViews, calibrate_views};
use super::corner_grid::{GridSearch, find_grid};
use super::error::CalibrationError;
use super::saddle::refine_corners;
use super::view::{BoardView, ViewFault, even_squares_dark};
use crate::footage::GreyImage;
use nalgebra::Vector2;
use opencv::core::{Mat, Point2f, Size, TermCriteria, TermCriteria_Type, Vector};
use opencv::{calib3d, imgproc};
use rayon::prelude::*;
use std::sync::{Mutex, PoisonError};

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
    one_thread()?;
    let mat = Mat::new_rows_cols_with_data(i32::try_from(image.height)?, i32::try_from(image.width)?, &image.pixels)?;
    let all = board.corner_count();
    // What is tried later is slow when it fails: little is tried where there is little to be found.
    let (mut fault, later): (ViewFault, &[Detector]) = match find_grid(image, board) {
        GridSearch::Complete(rough) => match finished(rough, board, image, &mat)? {
            Err(fault @ ViewFault::WrongGrid { .. }) => (fault, &[Detector::Quads, Detector::Sectors]),
            view_or_fault => return Ok(view_or_fault),
        },
        GridSearch::Another { columns, rows } => return Ok(Err(ViewFault::AnotherBoard { columns, rows })),
        GridSearch::Partial { corners, .. } if 3 * corners < all => (ViewFault::NotFound, &[Detector::Glance]),
        GridSearch::Partial { corners: seen, cut_by_border: true, .. } => return Ok(Err(ViewFault::PartOfBoard { seen, all, cut_by_border: true })),
        GridSearch::Partial { corners: seen, whole_part, .. } => {
            // The part that was seen tells whether blur or too much light took the rest.
            if let Some((part, corners)) = whole_part
                && let Err(fault) = finished(corners, &part, image, &mat)?
            {
                return Ok(Err(fault));
            }
            (ViewFault::PartOfBoard { seen, all, cut_by_border: false }, &[Detector::Quads, Detector::Sectors])
        }
    };
    for detector in later {
        let Some(rough) = detect(&mat, board, *detector)? else { continue };
        match finished(rough, board, image, &mat)? {
            Ok(view) => return Ok(Ok(view)),
            Err(e) => fault = e,
        }
    }
    Ok(Err(fault))
}

/// Our loops run over pictures; OpenCV's own threads would only make its random numbers depend on scheduling. Once: it builds its pool anew
/// with every call, whoever uses it meanwhile, and crashes where two threads do so at a time.
fn one_thread() -> opencv::Result<()> {
    static ONCE: Mutex<bool> = Mutex::new(false);
    let mut done = ONCE.lock().unwrap_or_else(PoisonError::into_inner);
    if !*done {
        opencv::core::set_num_threads(1)?;
        *done = true;
    }
    Ok(())
}

/// OpenCV's detectors.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Detector {
    /// `findChessboardCorners`, which gives up at once where nothing looks like a board.
    Glance,
    Quads,
    /// The sector-based one.
    Sectors,
}

fn detect(mat: &impl opencv::core::ToInputArray, board: &Checkerboard, detector: Detector) -> opencv::Result<Option<Vec<Vector2<f64>>>> {
    let size = Size::new(board.columns as i32, board.rows as i32);
    let mut found = Vector::<Point2f>::new();
    let usual = calib3d::CALIB_CB_ADAPTIVE_THRESH | calib3d::CALIB_CB_NORMALIZE_IMAGE;
    let answered = match detector {
        Detector::Glance => calib3d::find_chessboard_corners(mat, size, &mut found, usual | calib3d::CALIB_CB_FAST_CHECK)?,
        Detector::Quads => calib3d::find_chessboard_corners(mat, size, &mut found, usual)?,
        Detector::Sectors => {
            opencv::core::set_rng_seed(SEED)?;
            calib3d::find_chessboard_corners_sb(mat, size, &mut found, calib3d::CALIB_CB_EXHAUSTIVE | calib3d::CALIB_CB_ACCURACY)?
        }
    };
    Ok((answered && found.len() == board.corner_count()).then(|| found.iter().map(|p| Vector2::new(f64::from(p.x), f64::from(p.y))).collect()))
}

/// Refines, orders and judges the corners of a view.
fn finished(
    rough: Vec<Vector2<f64>>,
    board: &Checkerboard,
    image: &GreyImage,
    mat: &impl opencv::core::ToInputArray,
) -> opencv::Result<Result<BoardView, ViewFault>> {
    // The gate comes before the refinement too: a wrong grid has no meaningful window.
    let rough = match BoardView::from_corners(board, rough) {
        Ok(view) => board.right_handed(view.corners),
        Err(e) => return Ok(Err(e)),
    };
    let (mut refined, settled) = refine_corners(board, &rough, image);
    if !settled {
        let mut near: Vector<Point2f> = rough.iter().map(|p| Point2f::new(p.x as f32, p.y as f32)).collect();
        let half = (WINDOW_SHARE * board.smallest_spacing_px(&rough)).round().clamp(2.0, 40.0) as i32;
        let criteria = TermCriteria::new(TermCriteria_Type::COUNT as i32 + TermCriteria_Type::EPS as i32, 100, 1e-4)?;
        imgproc::corner_sub_pix(mat, &mut near, Size::new(half, half), Size::new(-1, -1), criteria)?;
        let near: Vec<Vector2<f64>> = near.iter().map(|p| Vector2::new(f64::from(p.x), f64::from(p.y))).collect();
        (refined, _) = refine_corners(board, &near, image);
    }
    let ordered = (0..board.turns()).map(|t| board.turned(&refined, t)).find(|c| even_squares_dark(board, c, image)).unwrap_or(refined);
    Ok(BoardView::from_corners(board, ordered).and_then(|v| v.judged(board, image)))
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
