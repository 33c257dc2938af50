//! Whether what was followed as the ball is one thing for both cameras.
//!
//! A ball that is lost before a white wall, or white to the limit itself, leaves its follower in that picture to whatever has an outline of its
//! size, while the other camera goes on seeing the ball: the two rays then meet nearly, at a depth that makes up for everything along the
//! epipolar line, and not quite. Cameras out of step make rays of a ball pass each other too, by no more than it moves in either picture in that
//! time. One that a camera sees nearly stand flies along that camera's line of sight, and so along the epipolar line in the other picture: its
//! rays meet whatever the pictures' instants are. If they do not, and the tape's do, these are two things.

use crate::calibration::CameraId;
use crate::median::upper_median;
use crate::tracking::ball::ball_track::{BallFrame, outline_radius_px};
use crate::tracking::racket::racket_pose::View;
use crate::tracking::racket::racket_scene::RacketFrame;
use nalgebra::Vector2;

/// Half of the views are farther from the common place than this, px: of a ball they are to 0.05.
const APART_PX: f64 = 0.3;
/// Most of the tape is nearer to its own, px: the cameras stand where they were calibrated.
const TAPE_PX: f64 = 0.2;
/// Fewest frames in which both cameras tell it.
const FEWEST: usize = 6;
/// Over so many frames its pace in a picture is taken.
const SPAN: usize = 5;

/// What the user should know of a ball that is none; it is taken away.
pub fn drop_two_things(view: &View, racket: &[Option<RacketFrame>], ball: &mut [Option<BallFrame>], radius_m: f64) -> Option<String> {
    let apart_px = median(ball.iter().flatten().filter_map(|b| views_apart_px(view, b, radius_m)).collect())?;
    if apart_px <= APART_PX || !CameraId::BOTH.into_iter().any(|camera| pace_px(ball, camera).is_some_and(|pace| pace < apart_px)) {
        return None;
    }
    let tape_px = median(racket.iter().flatten().filter(|r| r.stereo()).map(RacketFrame::miss_px).collect())?;
    if tape_px >= TAPE_PX {
        return None;
    }
    ball.iter_mut().for_each(|frame| *frame = None);
    Some(format!(
        "what looked like the ball is two things: the cameras' views of it are {apart_px:.2} px off a common place, those of the tape {tape_px:.2} px; no ball is given (is it white before something white, or as grey as the wall, or are the cameras out of step?)"
    ))
}

/// How far each view of a ball that both cameras see is from their common place, px.
fn views_apart_px(view: &View, ball: &BallFrame, radius_m: f64) -> Option<f64> {
    let [Some(left), Some(right)] = ball.points else { return None };
    let (place, gap_m) = view.triangulate(left.uv, right.uv).filter(|_| ball.stereo)?;
    Some(0.5 * gap_m / radius_m * outline_radius_px(view, CameraId::Left, &place, radius_m)?)
}

/// Pace of a ball that both cameras see in one of the pictures, px a frame.
fn pace_px(ball: &[Option<BallFrame>], camera: CameraId) -> Option<f64> {
    let uv = |frame: &Option<BallFrame>| -> Option<Vector2<f64>> { Some(frame.filter(|b| b.stereo)?.points[camera.index()]?.uv) };
    let paces = ball.iter().zip(ball.iter().skip(SPAN)).filter_map(|(a, b)| Some((uv(b)? - uv(a)?).norm() / SPAN as f64));
    median(paces.collect())
}

/// The middle of these; `None` of too few.
fn median(values: Vec<f64>) -> Option<f64> {
    if values.len() < FEWEST { None } else { upper_median(values) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tracking::racket::racket_pose::{RacketPose, tests::rig};
    use crate::tracking::track_file::ImagePoint;
    use nalgebra::{Isometry3, Matrix6, Point3, Vector3};

    const RADIUS_M: f64 = 0.033;

    /// A racket at rest whose tape agrees.
    fn racket() -> Vec<Option<RacketFrame>> {
        let point = Some(ImagePoint { uv: Vector2::new(250.0, 250.0), sd: Vector2::repeat(0.05) });
        let pose = RacketPose { global_from_racket: Isometry3::identity(), covariance: Matrix6::identity() * 1e-8, chi2: 1.0, dof: 14 };
        vec![Some(RacketFrame { pose, points: [[point; 5]; 2], foretold: false }); 20]
    }

    fn seen(view: &View, at: &[Point3<f64>; 2]) -> Option<BallFrame> {
        let point = |camera: CameraId| view.project(camera, &at[camera.index()]).map(|uv| ImagePoint { uv, sd: Vector2::repeat(0.1) });
        Some(BallFrame { points: [point(CameraId::Left), point(CameraId::Right)], position: at[1], stereo: true, flattening: None })
    }

    #[test]
    fn truth_what_stands_in_one_picture_and_misses_the_other_ray_is_no_ball_and_one_that_flies_toward_a_camera_is() {
        let rig = rig();
        let view = View::new(&rig);
        let toward = (view.eye(CameraId::Left) - Point3::new(0.1, 1.0, 0.0)).normalize();
        let flies = |k: usize| Point3::new(0.1, 1.0, 0.0) + toward * (0.02 * k as f64);
        let along: Vec<_> = (0..20).map(|k| seen(&view, &[flies(k); 2])).collect();
        let mut ball = along.clone();
        assert_eq!(drop_two_things(&view, &racket(), &mut ball, RADIUS_M), None);
        assert!(ball.iter().all(Option::is_some));
        // The left camera holds to a thing 4 mm beside it.
        let beside = toward.cross(&Vector3::x()).normalize() * 0.004;
        let mut ball: Vec<_> = (0..20).map(|k| seen(&view, &[flies(0) + beside, flies(k)])).collect();
        assert!(drop_two_things(&view, &racket(), &mut ball, RADIUS_M).is_some() && ball.iter().all(Option::is_none));
        // One that crosses both pictures may be seen by cameras out of step.
        let crosses = |k: f64| Point3::new(0.03 * k - 0.3, 1.0 + 0.01 * k, 0.0);
        let mut ball: Vec<_> = (0..20).map(|k| seen(&view, &[crosses(k as f64), crosses(k as f64 + 0.6)])).collect();
        assert_eq!(drop_two_things(&view, &racket(), &mut ball, RADIUS_M), None);
    }
}
