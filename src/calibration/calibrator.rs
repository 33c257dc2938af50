//! The calibration itself: views of the board from both cameras in, cameras, rig and each pair's fate out.

use super::board::Checkerboard;
use super::bundle::{Bundle, BundleError, BundleFit, BundleOptions, BundleView, GOOD_START};
use super::distortion::{CAMERA_NAMES, DistortionModel, ROTATION, SHARED, SHIFT, shared_names};
use super::error::CalibrationError;
use super::model_choice::{ModelFit, adjust_all, choose, shaped_board, summaries};
use super::stereo_start::{HUBER_PX, common_pose, corner_pixels, single_camera};
use super::view::{BoardView, ViewFault};
use super::{Camera, CameraId, PairFate, RigidTransform, StereoRig};
use crate::median::median;
use crate::short_list::short_list;
use nalgebra::{Isometry3, Vector2};
use serde_json::json;
use std::collections::BTreeMap;

/// Fewest pairs seen by both cameras; below that the shared parameters hang on single boards.
pub const MIN_PAIRS: usize = 3;
/// Reasons, and pictures of each, that an error names.
const NAMED: usize = 12;
/// A view is inconsistent when its residual is above this many times the median view's ...
const VIEW_FACTOR: f64 = 4.0;
/// ... and above this, px: sharp pictures differ among themselves by less. (A board that moved by 5 mm between the cameras is 0.2 px off.)
const VIEW_FLOOR_PX: f64 = 0.06;
/// Corners count in proportion beyond this many deviations of all once the adjustment has begun to settle: where corners are good to
/// 0.01 px a pair that is not of one instant may be far off and yet within a pixel.
const HUBER_SD: f64 = 3.0;
/// Clustering beyond which something is wrong with the boards or their pictures.
const CLUSTERED: f64 = 6.0;
/// A bow of more deviations than this is told.
const BOWED_SD: f64 = 4.0;
/// Cameras that stand apart by less than this many deviations may stand in one place: nothing has a depth then.
const BASELINE_SD: f64 = 5.0;
/// A corner is an outlier beyond this many robust standard deviations of one coordinate.
const CORNER_SD: f64 = 6.0;

/// What both cameras saw of one position of the board.
#[derive(Debug, Clone, PartialEq)]
pub struct PairViews {
    /// The pair's number as the file names show it.
    pub name: String,
    pub left: Result<BoardView, ViewFault>,
    pub right: Result<BoardView, ViewFault>,
}

/// Choices of a calibration; the defaults are right for everyday use.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CalibrationOptions {
    /// Distortion terms; `None` chooses by evidence.
    pub model: Option<DistortionModel>,
    /// Leave out views and corners that do not fit the others. Off: plain least squares over everything.
    pub reject_outliers: bool,
    pub max_iterations: usize,
    /// Widen the covariance when the corners of a board err together (see `BundleFit::clustering`).
    pub clustered_errors: bool,
    /// Let the board be bowed and stretched where the corners demand it.
    pub shaped_board: bool,
}

impl Default for CalibrationOptions {
    fn default() -> Self {
        CalibrationOptions { model: None, reject_outliers: true, max_iterations: 200, clustered_errors: true, shaped_board: true }
    }
}

/// A finished calibration, before it is turned into files.
#[derive(Debug, Clone)]
pub struct Calibration {
    pub image_size: [usize; 2],
    pub board: Checkerboard,
    /// Cameras, rig and boards at the optimum of the chosen model.
    pub bundle: Bundle,
    pub fit: BundleFit,
    pub model: DistortionModel,
    /// Every model that settled, for the comparison.
    pub models: Vec<ModelFit>,
    pub pairs: Vec<PairFate>,
    /// For each view of `bundle`, which pair it is.
    pub pair_of_view: Vec<usize>,
    /// Corners left out as outliers.
    pub corners_left_out: usize,
}

/// Calibrates from corners. Pure: same views, same numbers, on any number of threads.
///
/// # Inputs  `pairs` in any order, corners in the board's order up to a turn of the board in its plane; `image_size` in px
/// # Errors  [`CalibrationError`]: too few pairs, no camera that fits, cameras that do not keep their places
pub fn calibrate_views(
    board: &Checkerboard,
    image_size: [usize; 2],
    pairs: &[PairViews],
    options: &CalibrationOptions,
) -> Result<Calibration, CalibrationError> {
    let mut fates: Vec<PairFate> = pairs.iter().map(|p| PairFate { name: p.name.clone(), used: false, reason: reason(p), rms_px: None }).collect();
    let both: Vec<usize> = (0..pairs.len()).filter(|&i| pairs[i].left.is_ok() && pairs[i].right.is_ok()).collect();
    if both.len() < MIN_PAIRS {
        return Err(too_few(board, both.len(), pairs, &fates));
    }
    let (mut bundle, mut pair_of_view) = start(board, image_size, pairs, &both)?;
    if options.reject_outliers {
        for _ in 0..4 {
            let mut robust = bundle.clone();
            let model = options.model.unwrap_or(DistortionModel::K1K2);
            let mut huber_px = HUBER_PX;
            loop {
                match robust.adjust(&BundleOptions {
                    active: model.active(),
                    huber_px: Some(huber_px),
                    max_iterations: options.max_iterations,
                    settled_gain: GOOD_START,
                    clustered_errors: false,
                }) {
                    Ok(_) | Err(BundleError::NotConverged { .. }) => {}
                    Err(e) => return Err(e.into()),
                }
                let narrower = HUBER_SD * robust_sd_px(&robust).unwrap_or(f64::INFINITY);
                // Twice as narrow at least, or nothing much changes.
                if !(narrower < 0.5 * huber_px) {
                    break;
                }
                huber_px = narrower;
            }
            bundle = robust;
            if !drop_inconsistent(&mut bundle, &mut pair_of_view, pairs, &mut fates) {
                break;
            }
        }
    }
    let in_both = bundle.views.iter().filter(|v| v.is_in_both()).count();
    if in_both < MIN_PAIRS {
        return Err(too_few(board, in_both, pairs, &fates));
    }
    let mut corners_left_out = 0;
    let fit_models = |starts: &[(DistortionModel, Bundle)]| -> Result<(Vec<ModelFit>, usize), CalibrationError> {
        let models = adjust_all(starts, options)?;
        let best = choose(&models).ok_or(BundleError::Singular)?;
        Ok((models, best))
    };
    let asked = DistortionModel::ALL.into_iter().filter(|m| options.model.is_none_or(|only| only == *m));
    let (mut models, mut best) = fit_models(&asked.clone().map(|m| (m, bundle.clone())).collect::<Vec<_>>())?;
    if options.shaped_board
        && let Some(shaped) = shaped_board(&models[best], board, options)
    {
        (models, best) = fit_models(&asked.map(|m| (m, shaped.clone())).collect::<Vec<_>>())?;
    }
    if options.reject_outliers {
        let mut trimmed = models[best].bundle.clone();
        corners_left_out = drop_outlying_corners(&mut trimmed);
        if corners_left_out > 0 {
            let again: Vec<_> = models.iter().map(|m| (m.model, m.bundle.with_corners_of(&trimmed))).collect();
            (models, best) = fit_models(&again)?;
        }
    }
    let ModelFit { model, bundle, fit, .. } = models[best].clone();
    let (baseline_m, sd_m) = (bundle.right_from_left.translation.vector.norm(), (SHIFT..SHIFT + 3).map(|i| fit.covariance[(i, i)]).sum::<f64>().sqrt());
    if baseline_m < BASELINE_SD * sd_m {
        return Err(CalibrationError::NoBaseline { baseline_mm: 1e3 * baseline_m, sd_mm: 1e3 * sd_m });
    }
    for (view, &pair) in bundle.views.iter().zip(&pair_of_view) {
        fates[pair].used = view.is_in_both();
        fates[pair].rms_px = bundle.view_rms_px(view);
    }
    Ok(Calibration { image_size, board: *board, bundle, fit, model, models, pairs: fates, pair_of_view, corners_left_out })
}

fn reason(pair: &PairViews) -> String {
    match (&pair.left, &pair.right) {
        (Ok(_), Ok(_)) => String::new(),
        (Ok(_), Err(e)) => format!("used for the left camera alone; right: {e}"),
        (Err(e), Ok(_)) => format!("used for the right camera alone; left: {e}"),
        (Err(l), Err(r)) if l == r => l.to_string(),
        (Err(l), Err(r)) => format!("left: {l}; right: {r}"),
    }
}

fn too_few(board: &Checkerboard, used: usize, pairs: &[PairViews], fates: &[PairFate]) -> CalibrationError {
    let mut by_reason: Vec<(&str, Vec<&str>)> = Vec::new();
    for fate in fates.iter().filter(|f| !f.reason.is_empty()) {
        match by_reason.iter_mut().find(|(reason, _)| *reason == fate.reason) {
            Some((_, names)) => names.push(&fate.name),
            None => by_reason.push((&fate.reason, vec![&fate.name])),
        }
    }
    let list: Vec<String> = by_reason.iter().take(NAMED).map(|(reason, names)| format!("{}: {reason}", short_list(names, NAMED, ", "))).collect();
    let fates_told = another_board(board, pairs).into_iter().chain(list).collect::<Vec<_>>().join("; ");
    CalibrationError::TooFewPairs { used, given: fates.len(), needed: MIN_PAIRS, fates: fates_told }
}

/// Says so when most pictures that could not be used show a board of another size than stated.
fn another_board(board: &Checkerboard, pairs: &[PairViews]) -> Option<String> {
    let faults: Vec<&ViewFault> = pairs.iter().flat_map(|p| [p.left.as_ref().err(), p.right.as_ref().err()]).flatten().collect();
    let sizes: Vec<(usize, usize)> =
        faults.iter().filter_map(|f| if let ViewFault::AnotherBoard { columns, rows } = f { Some((*columns, *rows)) } else { None }).collect();
    let count = |size: &(usize, usize)| sizes.iter().filter(|s| *s == size).count();
    let most = sizes.iter().max_by_key(|size| (count(size), **size))?;
    (2 * count(most) >= faults.len()).then(|| {
        format!(
            "the board in the pictures has {} x {} inner corners, session.toml says {} x {} (board_columns, board_rows count the corners between squares)",
            most.0, most.1, board.columns, board.rows
        )
    })
}

/// Which pairs one camera sees the board in, and the corners there.
fn views_of(pairs: &[PairViews], camera: fn(&PairViews) -> &Result<BoardView, ViewFault>) -> (Vec<usize>, Vec<&[Vector2<f64>]>) {
    pairs.iter().enumerate().filter_map(|(i, pair)| Some((i, camera(pair).as_ref().ok()?.corners.as_slice()))).unzip()
}

/// Each camera alone, one corner order for both, the common relative pose, and all boards in place.
fn start(board: &Checkerboard, image_size: [usize; 2], pairs: &[PairViews], both: &[usize]) -> Result<(Bundle, Vec<usize>), CalibrationError> {
    let (in_left, left_views) = views_of(pairs, |p| &p.left);
    let (in_right, right_views) = views_of(pairs, |p| &p.right);
    let (from_left, from_right) =
        rayon::join(|| single_camera(board, &left_views, image_size, "left"), || single_camera(board, &right_views, image_size, "right"));
    let ((left, left_poses), (right, right_poses)) = (from_left?, from_right?);
    let left_pose = |pair: usize| in_left.iter().position(|i| *i == pair).map(|k| left_poses[k]);
    let right_pose = |pair: usize| in_right.iter().position(|i| *i == pair).map(|k| right_poses[k]);

    // A turn of the order is a turn of the board in its plane about its middle: the pose of the turned order follows.
    let turns: Vec<Isometry3<f64>> = (0..board.turns()).map(|t| board_turn(board, t)).collect();
    let candidates: Vec<(Isometry3<f64>, Vec<Isometry3<f64>>)> =
        both.iter().filter_map(|&i| Some((left_pose(i)?, turns.iter().map(|t| right_pose(i).map(|r| r * t)).collect::<Option<Vec<_>>>()?))).collect();
    let (right_from_left, turn_of, agreeing) = common_pose(&candidates).ok_or(CalibrationError::NoCommonPose { agreeing: 0, pairs: both.len() })?;
    if agreeing < MIN_PAIRS || 2 * agreeing < both.len() {
        return Err(CalibrationError::NoCommonPose { agreeing, pairs: both.len() });
    }
    let mut views = Vec::with_capacity(pairs.len());
    let mut pair_of_view = Vec::with_capacity(pairs.len());
    for (i, pair) in pairs.iter().enumerate() {
        let turn = both.iter().position(|&b| b == i).map_or(0, |k| turn_of[k]);
        let left = pair.left.as_ref().map_or_else(|_| Vec::new(), |v| corner_pixels(&v.corners));
        let right = pair.right.as_ref().map_or_else(|_| Vec::new(), |v| corner_pixels(&board.turned(&v.corners, turn)));
        let Some(pose) = left_pose(i).or_else(|| right_pose(i)) else { continue };
        views.push(BundleView { pose, left, right });
        pair_of_view.push(i);
    }
    Ok((Bundle { board: board.corners(), shape: None, left, right, right_from_left, views }, pair_of_view))
}

/// `board_from_turned_board`: where corner `i` of the turned order lies on the board.
fn board_turn(board: &Checkerboard, turn: usize) -> Isometry3<f64> {
    let corners = board.corners();
    let turned = board.turned(&corners, turn);
    let x = (turned[board.columns - 1] - turned[0]).normalize();
    let y = (turned[corners.len() - board.columns] - turned[0]).normalize();
    let r = nalgebra::Matrix3::from_columns(&[x, y, x.cross(&y)]);
    let rotation = nalgebra::UnitQuaternion::from_rotation_matrix(&nalgebra::Rotation3::from_matrix_unchecked(r));
    Isometry3::from_parts(turned[0].into(), rotation)
}

/// Leaves out whole views whose corners lie far from where all the others put them. Says whether it did.
fn drop_inconsistent(bundle: &mut Bundle, pair_of_view: &mut Vec<usize>, pairs: &[PairViews], fates: &mut [PairFate]) -> bool {
    let rms: Vec<f64> = bundle.views.iter().map(|v| bundle.view_rms_px(v).unwrap_or(f64::INFINITY)).collect();
    let allowed_px = (VIEW_FACTOR * median(rms.iter().copied()).unwrap_or(0.0)).max(VIEW_FLOOR_PX);
    let keep: Vec<bool> = rms.iter().map(|r| *r <= allowed_px).collect();
    for (k, &rms_px) in rms.iter().enumerate().filter(|(k, _)| !keep[*k]) {
        let fate = &mut fates[pair_of_view[k]];
        let alone = reason(&pairs[pair_of_view[k]]);
        let fault = ViewFault::Inconsistent { rms_px, allowed_px };
        fate.reason = if alone.is_empty() { fault.to_string() } else { format!("{fault}; {}", alone.trim_start_matches("used for ")) };
        fate.rms_px = Some(rms_px);
    }
    let mut k = keep.iter();
    bundle.views.retain(|_| k.next().copied().unwrap_or(true));
    let mut k = keep.iter();
    pair_of_view.retain(|_| k.next().copied().unwrap_or(true));
    keep.contains(&false)
}

/// Robust standard deviation of one coordinate over all views, px. `None` where a board lies behind a camera.
fn robust_sd_px(bundle: &Bundle) -> Option<f64> {
    let residuals: Vec<_> = bundle.views.iter().map(|v| bundle.residuals(v)).collect::<Option<_>>()?;
    let sizes = residuals.iter().flat_map(|(l, r)| l.iter().chain(r)).flat_map(|d| [d.x.abs(), d.y.abs()]);
    Some(1.4826 * median(sizes)?)
}

/// Leaves out single corners far outside the spread of all; at most a twentieth of a view, else the view stays whole.
fn drop_outlying_corners(bundle: &mut Bundle) -> usize {
    let residuals: Vec<_> = bundle.views.iter().filter_map(|v| bundle.residuals(v)).collect();
    if residuals.len() != bundle.views.len() {
        return 0;
    }
    let limit = CORNER_SD * robust_sd_px(bundle).unwrap_or(f64::INFINITY);
    let mut left_out = 0;
    for (view, (l, r)) in bundle.views.iter_mut().zip(&residuals) {
        for (corners, residual) in [(&mut view.left, l), (&mut view.right, r)] {
            let outliers = residual.iter().filter(|d| d.norm() > limit).count();
            if outliers > 0 && 20 * outliers <= corners.len() {
                let mut at = residual.iter();
                corners.retain(|_| at.next().is_none_or(|d| d.norm() <= limit));
                left_out += outliers;
            }
        }
    }
    left_out
}

impl Calibration {
    /// Root-mean-square distance between seen and predicted corners of one camera (`None`: both), px.
    pub fn rms_px(&self, camera: Option<CameraId>) -> f64 {
        let (mut sum, mut n) = (0.0, 0usize);
        for (l, r) in self.bundle.views.iter().filter_map(|v| self.bundle.residuals(v)) {
            for (id, residuals) in [(CameraId::Left, l), (CameraId::Right, r)] {
                if camera.is_none_or(|c| c == id) {
                    sum += residuals.iter().map(|d| d.norm_squared()).sum::<f64>();
                    n += residuals.len();
                }
            }
        }
        (sum / n.max(1) as f64).sqrt()
    }

    /// One standard deviation of a shared parameter by its place.
    pub fn sd(&self, place: usize) -> f64 {
        self.fit.covariance[(place, place)].max(0.0).sqrt()
    }

    /// The rig as the other rooms use it; global axes are the left camera's until the axes are measured.
    pub fn rig(&self) -> StereoRig {
        let camera = |c: &Camera, id: CameraId| {
            let on = self.model.active();
            let sd =
                CAMERA_NAMES.iter().enumerate().filter(|(i, _)| on[9 * id.index() + i]).map(|(i, n)| ((*n).to_owned(), self.sd(9 * id.index() + i))).collect();
            Camera { rms_px: self.rms_px(Some(id)), sd, ..c.clone() }
        };
        let pose = RigidTransform::from_isometry(&self.bundle.right_from_left);
        StereoRig {
            image_size: self.image_size,
            left: camera(&self.bundle.left, CameraId::Left),
            right: camera(&self.bundle.right, CameraId::Right),
            r: pose.r,
            t: pose.t,
            rms_stereo_px: self.rms_px(None),
            pairs: self.pairs.clone(),
            square_mm: None,
            global_from_left: RigidTransform::identity(),
            more: Default::default(),
        }
    }

    /// What `calibration.json` holds besides the cameras (documented in `docs/calibration.md`).
    pub fn details(&self) -> Result<BTreeMap<String, serde_json::Value>, serde_json::Error> {
        let (rotation_rad, t_m) = self.pose_sd();
        let covariance: Vec<Vec<f64>> = (0..SHARED).map(|i| (0..SHARED).map(|j| self.fit.covariance[(i, j)]).collect()).collect();
        let mut more = BTreeMap::new();
        more.insert("distortion_model".into(), serde_json::to_value(self.model)?);
        more.insert("models".into(), serde_json::to_value(summaries(&self.models))?);
        more.insert(
            "stereo".into(),
            json!({ "sd": { "rotation_rad": rotation_rad, "t_m": t_m }, "noise_px": self.fit.variance_px2.sqrt(),
            "degrees_of_freedom": self.fit.degrees_of_freedom, "clustering": self.fit.clustering, "corners_left_out": self.corners_left_out }),
        );
        if let Some(shape) = &self.bundle.shape {
            let told = |v: [f64; 4]| json!({ "bow_along_rows_mm": 1e3 * v[0], "bow_along_columns_mm": 1e3 * v[1], "twist_mm": 1e3 * v[2], "stretch": v[3] });
            more.insert("board_shape".into(), json!({ "value": told(shape.values), "sd": told(self.fit.shape_sd) }));
        }
        more.insert("covariance".into(), json!({ "names": shared_names(), "matrix": covariance }));
        Ok(more)
    }

    /// Says so when the board is not flat.
    fn not_flat(&self) -> Option<String> {
        let (bow, sd) = (self.bundle.shape.as_ref()?.values, self.fit.shape_sd);
        let beside_middle = |k: usize| format!("{:.2} ± {:.2} mm {}", 1e3 * bow[k].abs(), 1e3 * sd[k], if bow[k] < 0.0 { "nearer" } else { "farther" });
        (0..3).any(|k| bow[k].abs() > BOWED_SD * sd[k]).then(|| {
            format!(
                "the board is not flat: seen from the cameras the ends of its rows lie {} than its middle, those of its columns {}; this is allowed for, a flat board is better",
                beside_middle(0),
                beside_middle(1)
            )
        })
    }

    /// Adds what is judged in millimetres to a rig whose global axes are laid: `square_mm`, `verdict`, `volume`, `coverage`,
    /// `advice`.
    pub fn add_quality(&self, rig: &mut StereoRig) -> Result<(), serde_json::Error> {
        let mut stretched = None;
        if let Some(verdict) = self.verdict() {
            stretched = verdict.stretched();
            rig.square_mm = Some(verdict.squares.clone());
            rig.more.insert("verdict".into(), serde_json::to_value(verdict)?);
        }
        let mut advice = Vec::new();
        if let Some((volume, error)) = self.volume(&rig.global_from_left) {
            let coverage = self.coverage(&error);
            advice = self.advice(&coverage);
            rig.more.insert("coverage".into(), serde_json::to_value(coverage)?);
            rig.more.insert("volume".into(), serde_json::to_value(volume)?);
        }
        advice.extend(self.not_flat());
        if rig.square_mm.is_none() {
            advice.push("too few pairs to hold some out: how large the squares come out in space is not known".to_owned());
        }
        if self.fit.clustering > CLUSTERED {
            advice.push(format!(
                "the corners of a board err together, {:.0} times the variance of single ones (deviations are widened for it): a board that is not flat or not square, or pairs whose pictures are not of one instant",
                self.fit.clustering
            ));
        }
        advice.extend(stretched);
        rig.more.insert("advice".into(), serde_json::to_value(advice)?);
        Ok(())
    }

    /// One standard deviation of the rotation (rad, about the right camera's axes) and shift (m) of `right_from_left`.
    pub fn pose_sd(&self) -> ([f64; 3], [f64; 3]) {
        ([0, 1, 2].map(|i| self.sd(ROTATION + i)), [0, 1, 2].map(|i| self.sd(SHIFT + i)))
    }
}
