//! From views to a start of the joint adjustment: each camera by itself, one order of the corners for both cameras, and
//! the relative pose most pairs agree on.

use super::Camera;
use super::board::Checkerboard;
use super::bundle::{Bundle, BundleOptions, BundleView, CornerPixel, GOOD_START};
use super::distortion::{DistortionModel, SHARED};
use super::error::CalibrationError;
use super::homography::homography;
use super::zhang::{board_pose, first_camera};
use nalgebra::{Isometry3, Vector2};

/// Corners beyond this residual count linearly while outliers are still in the data, px.
pub const HUBER_PX: f64 = 1.0;

pub fn corner_pixels(corners: &[Vector2<f64>]) -> Vec<CornerPixel> {
    corners.iter().enumerate().map(|(index, &uv)| CornerPixel { index, uv }).collect()
}

/// One camera from its own views; also `camera_from_board` of each view.
pub fn single_camera(
    board: &Checkerboard,
    views: &[&[Vector2<f64>]],
    image_size: [usize; 2],
    name: &'static str,
) -> Result<(Camera, Vec<Isometry3<f64>>), CalibrationError> {
    let none = || CalibrationError::NoFirstCamera { camera: name };
    let points = board.corners();
    let homographies = views.iter().map(|v| homography(&points, v).ok_or_else(none)).collect::<Result<Vec<_>, _>>()?;
    let camera = first_camera(&homographies, image_size).ok_or_else(none)?;
    let poses = homographies.iter().map(|h| board_pose(h, &camera).ok_or_else(none)).collect::<Result<Vec<_>, _>>()?;
    let views = views.iter().zip(&poses).map(|(corners, pose)| BundleView { pose: *pose, left: corner_pixels(corners), right: Vec::new() }).collect();
    let mut bundle = Bundle { board: points, shape: None, right: camera.clone(), left: camera, right_from_left: Isometry3::identity(), views };
    // First the focal lengths and poses, then the centre and the first distortion terms: far starts stay on the road.
    for model in [None, Some(DistortionModel::None), Some(DistortionModel::K1K2)] {
        let mut active = [false; SHARED];
        match model {
            None => active[..2].fill(true),
            Some(m) => active[..9].copy_from_slice(&m.active()[..9]),
        }
        // A stage that does not settle leaves its last good state; the joint adjustment decides in the end.
        let _ = bundle.adjust(&BundleOptions { active, huber_px: Some(HUBER_PX), max_iterations: 60, settled_gain: GOOD_START, clustered_errors: false });
    }
    Ok((bundle.left, bundle.views.into_iter().map(|v| v.pose).collect()))
}

/// How far two relative poses are apart: angle (rad) plus shift relative to the baseline.
fn distance(a: &Isometry3<f64>, b: &Isometry3<f64>) -> f64 {
    let scale = a.translation.vector.norm().max(b.translation.vector.norm()).max(1e-9);
    a.rotation.angle_to(&b.rotation) + (a.translation.vector - b.translation.vector).norm() / scale
}

/// The relative pose `right_from_left` that agrees best with all pairs, and for each pair the turn of the right camera's
/// corner order that matches it. Also says how many pairs agree within `TOLERANCE`.
///
/// `pairs` holds `left_from_board` and, per possible turn of the right camera's order, `right_from_board`.
pub fn common_pose(pairs: &[(Isometry3<f64>, Vec<Isometry3<f64>>)]) -> Option<(Isometry3<f64>, Vec<usize>, usize)> {
    /// A single view with a long lens places a board to some per cent of its distance; a turned or mismatched board is off by
    /// far more.
    const TOLERANCE: f64 = 0.5;
    let relative: Vec<Vec<Isometry3<f64>>> = pairs.iter().map(|(l, rights)| rights.iter().map(|r| r * l.inverse()).collect()).collect();
    let nearest = |candidate: &Isometry3<f64>, turns: &[Isometry3<f64>]| {
        turns.iter().enumerate().map(|(i, p)| (i, distance(candidate, p))).min_by(|a, b| a.1.total_cmp(&b.1))
    };
    let mut best: Option<(f64, &Isometry3<f64>)> = None;
    for candidate in relative.iter().flatten() {
        let total: f64 = relative.iter().filter_map(|turns| nearest(candidate, turns)).map(|(_, d)| d.min(TOLERANCE)).sum();
        if best.is_none_or(|(b, _)| total < b) {
            best = Some((total, candidate));
        }
    }
    let (_, pose) = best?;
    let chosen: Vec<(usize, f64)> = relative.iter().map(|turns| nearest(pose, turns).unwrap_or((0, f64::INFINITY))).collect();
    let agreeing = chosen.iter().filter(|c| c.1 < TOLERANCE).count();
    Some((*pose, chosen.into_iter().map(|c| c.0).collect(), agreeing))
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Translation3, UnitQuaternion, Vector3};

    #[test]
    fn truth_turned_boards_are_found_out_by_the_common_pose() {
        let rig = Isometry3::from_parts(Translation3::new(-7.0, 0.1, 2.0), UnitQuaternion::from_euler_angles(0.02, 0.6, 0.01));
        let half_turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), std::f64::consts::PI);
        let pairs: Vec<_> = (0..8)
            .map(|i| {
                let a = i as f64;
                let left = Isometry3::from_parts(Translation3::new(0.1 * a, 0.3 - 0.1 * a, 12.0), UnitQuaternion::from_euler_angles(0.3 * a, 0.4, 0.2 * a));
                let right = rig * left;
                let turned = right * Isometry3::from_parts(Translation3::new(0.48, 0.3, 0.0), half_turn);
                (left, if i % 3 == 0 { vec![turned, right] } else { vec![right, turned] })
            })
            .collect();
        let (pose, turns, agreeing) = common_pose(&pairs).expect("pairs");
        assert!(distance(&pose, &rig) < 1e-9);
        assert_eq!(turns, [1, 0, 0, 1, 0, 0, 1, 0]);
        assert_eq!(agreeing, 8);
    }
}
