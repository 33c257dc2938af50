//! Which side marker is m2 and which m3.
//!
//! A figure that is symmetric about its long axis equals itself turned by half a turn about x: no camera can tell the two
//! poses apart, and m2/m3 (m4/m5) are exchanged between them. The whole shot then takes one of them, by convention: z
//! points to the side the ball comes from (physics: z toward the hitting side).

use crate::median::upper_median;
use crate::tracking::ball::ball_track::BallFrame;
use crate::tracking::ball::ball_way::StraightLine;
use crate::tracking::pictures::shot_frames::AT_ONCE;
use crate::tracking::racket::racket_figure::RacketFigure;
use crate::tracking::racket::racket_pose::{View, fit_pose};
use crate::tracking::racket::racket_scene::{ALL_BANDS, RacketFrame};
use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector2, Vector3};
use rayon::prelude::*;
use std::ops::Range;

/// Partner of each marker under the half turn.
const TWIN: [usize; 5] = [0, 2, 1, 4, 3];
/// A figure counts as symmetric when the half turn moves no marker by more than this, m: as far as tape is measured wrongly.
const SYMMETRY_M: f64 = 0.008;
/// One that it moves by more than this, m, may be meant to tell its faces apart: its pictures are asked.
const TOLD_BY_FIGURE_M: f64 = 0.004;
/// They tell them apart where one reading leaves this many times the other's squared misses,
const TOLD_BY_MISSES: f64 = 3.0;
/// in so many frames that show all tapes in both pictures.
const TELLING_FRAMES: usize = 5;
/// Frames that tell from which side the ball comes.
const SIDE_FRAMES: usize = 7;
/// A ball whose centre is farther from the string plane does not touch it, m.
const CLEAR_M: f64 = 0.05;
/// Twins whose attitudes are as far from the expected one to within this cannot be told apart, rad.
const TOLD_APART_RAD: f64 = 0.5;
/// Half of a racket's head, m, about.
const HEAD_M: f64 = 0.17;
/// Sightings on either side of a meeting that tell how the ball's way bends there, fewest of them, and the least bend that strings make, as a
/// share of the faster way.
const BESIDE: usize = 6;
const FEWEST_BESIDE: usize = 2;
const LEAST_BEND: f64 = 0.25;

/// Whether the figure equals itself after half a turn about its long axis, as nearly as tape is measured.
pub fn symmetric(figure: &RacketFigure) -> bool {
    unlike_m(figure) < SYMMETRY_M
}

/// Farthest that the half turn moves a marker, m.
fn unlike_m(figure: &RacketFigure) -> f64 {
    let moved = |i: usize| {
        let (p, q) = (figure.points[i], figure.points[TWIN[i]]);
        Vector3::new(p.x - q.x, p.y + q.y, p.z + q.z).norm()
    };
    (0..5).map(moved).fold(0.0, f64::max)
}

/// The same picture read the other way round.
fn twin(view: &View, figure: &RacketFigure, frame: &RacketFrame) -> RacketFrame {
    let mut out = frame.clone();
    for camera in 0..2 {
        for marker in 0..5 {
            out.points[camera][marker] = frame.points[camera][TWIN[marker]];
        }
    }
    let start = turned(&frame.pose.global_from_racket);
    // Of a figure that is quite symmetric the covariance stays: it is about the global axes, and the origin lies on the axis of the half turn.
    match fit_pose(view, figure, &out.observations(), Some(&start)) {
        Ok(pose) if !frame.foretold => out.pose = pose,
        _ => out.pose.global_from_racket = start,
    }
    out
}

/// About the long axis, in the racket's axes.
pub fn half_turn() -> UnitQuaternion<f64> {
    UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI)
}

fn turned(pose: &Isometry3<f64>) -> Isometry3<f64> {
    Isometry3::from_parts(pose.translation, pose.rotation * half_turn())
}

/// Of a frame and its twin, the one whose attitude is nearer to the expected one; `None` where both are about as near, for a racket that has turned by a
/// quarter since it was seen shows neither face. A figure that is not symmetric has no twin.
pub fn nearest_twin(view: &View, figure: &RacketFigure, frame: RacketFrame, expected: &Isometry3<f64>) -> Option<RacketFrame> {
    if !symmetric(figure) {
        return Some(frame);
    }
    let own = frame.pose.global_from_racket.rotation.angle_to(&expected.rotation);
    let other = turned(&frame.pose.global_from_racket).rotation.angle_to(&expected.rotation);
    let nearer = if own <= other { frame } else { twin(view, figure, &frame) };
    ((own - other).abs() > TOLD_APART_RAD).then_some(nearer)
}

/// Turns the whole shot, if need be: as the figure tells where it is not quite symmetric, or else so that z points to the side the ball comes from.
/// Without a ball: z toward +U.
pub fn settle(view: &View, figure: &RacketFigure, racket: &mut [Option<RacketFrame>], ball: &[Option<BallFrame>]) {
    if !symmetric(figure) {
        return;
    }
    let by_ball = || side_of_approach(racket, ball).unwrap_or_else(|| racket.iter().flatten().map(|r| r.pose.normal().x).sum()) < 0.0;
    if told_by_figure(view, figure, racket).unwrap_or_else(by_ball) {
        racket.par_iter_mut().with_max_len(AT_ONCE).flatten_iter().for_each(|r| *r = twin(view, figure, r));
    }
}

/// Whether the shot must be turned for its tapes to be where the figure has them; `None` where both readings leave about as much, as those of a
/// symmetric racket do of which one tape is measured wrongly.
fn told_by_figure(view: &View, figure: &RacketFigure, racket: &[Option<RacketFrame>]) -> Option<bool> {
    if unlike_m(figure) < TOLD_BY_FIGURE_M {
        return None;
    }
    // A tape that has been told to be wrong states a large deviation, in one of the readings only: here all count alike.
    let missed = |frame: &RacketFrame| {
        let mut all = frame.observations();
        all.iter_mut().for_each(|o| o.point.sd = Vector2::repeat(1.0));
        Some(fit_pose(view, figure, &all, Some(&frame.pose.global_from_racket)).ok()?.chi2)
    };
    let whole = racket.par_iter().with_max_len(AT_ONCE).flatten_iter().filter(|frame| frame.count() == ALL_BANDS);
    let misses: Vec<(f64, f64)> = whole.filter_map(|frame| Some((missed(frame)?, missed(&twin(view, figure, frame))?))).collect();
    let (own, other) = misses.iter().fold((0.0, 0.0), |(own, other), m| (own + m.0, other + m.1));
    (misses.len() >= TELLING_FRAMES && own.max(other) > TOLD_BY_MISSES * own.min(other)).then_some(other < own)
}

/// The side of the string plane from which the ball comes to the racket, as a height over it, m: in the last frames before the two are nearest,
/// or the first after it, for it goes back to where it came from. A tenth of a second earlier a swung racket's plane lies anywhere.
pub fn side_of_approach(racket: &[Option<RacketFrame>], ball: &[Option<BallFrame>]) -> Option<f64> {
    // The depth of what one camera alone sees is foretold, beyond the impact from the wrong flight: it is asked only when the two never see the
    // ball at once.
    side_seen(racket, ball, true).or_else(|| side_seen(racket, ball, false))
}

/// Distance of a place in the racket's axes from a disc as wide as a racket's head, m.
pub fn off_the_face_m(local: &Point3<f64>) -> f64 {
    local.z.hypot((local.x.hypot(local.y) - HEAD_M).max(0.0))
}

/// The ball seen beside the racket.
#[derive(Debug, Clone, Copy)]
pub struct Sighting {
    /// Frame number.
    pub number: f64,
    /// By both cameras.
    pub stereo: bool,
    /// In the racket's axes, m.
    pub local: Point3<f64>,
    /// In global axes, m.
    pub global: Point3<f64>,
}

impl Sighting {
    pub fn new(number: f64, racket: &RacketFrame, ball: &BallFrame) -> Self {
        let local = racket.pose.global_from_racket.inverse() * ball.position;
        Sighting { number, stereo: ball.stereo, local, global: ball.position }
    }
}

/// Which of the sightings, by time, is the ball's on the head: the first that is as near as one radius where it meets it, else the nearest. A racket that the impact
/// has turned may swing its plane across the rebound: of several times that the ball comes near, the one at which its way bends most is the meeting.
pub fn first_on_the_head(seen: &[Sighting], radius_m: f64) -> Option<usize> {
    let nearest = meeting(seen)?;
    let near = |i: &usize| off_the_face_m(&seen[*i].local) < CLEAR_M;
    let time = (0..=nearest).rev().take_while(near);
    Some(time.filter(|i| off_the_face_m(&seen[*i].local) < radius_m).last().unwrap_or(nearest))
}

/// The nearest sighting of the meeting.
fn meeting(seen: &[Sighting]) -> Option<usize> {
    let off = |i: usize| off_the_face_m(&seen[i].local);
    let nearest = |among: Range<usize>| among.min_by(|a, b| off(*a).total_cmp(&off(*b)));
    let begins = |i: &usize| off(*i) < CLEAR_M && (*i == 0 || off(i - 1) >= CLEAR_M);
    let near = (0..seen.len()).filter(begins).map(|start| start..(start..seen.len()).find(|i| off(*i) >= CLEAR_M).unwrap_or(seen.len()));
    let times: Vec<Range<usize>> = near.collect();
    if times.len() < 2 {
        return nearest(0..seen.len());
    }
    let bend = |time: &Range<usize>| -> Option<f64> {
        let way = |beside: &[Sighting]| {
            let places: Vec<_> = beside.iter().filter(|s| s.stereo).map(|s| (s.number, s.global)).collect();
            (places.len() >= FEWEST_BESIDE).then(|| StraightLine::through(places.into_iter()).step)
        };
        let before = way(&seen[time.start.saturating_sub(BESIDE)..time.start])?;
        let after = way(&seen[time.end..(time.end + BESIDE).min(seen.len())])?;
        Some((after - before).norm() / before.norm().max(after.norm()).max(1e-9)).filter(|share| *share > LEAST_BEND)
    };
    let bent = times.into_iter().filter_map(|time| Some((bend(&time)?, time))).max_by(|a, b| a.0.total_cmp(&b.0));
    bent.and_then(|(_, time)| nearest(time)).or_else(|| nearest(0..seen.len()))
}

fn side_seen(racket: &[Option<RacketFrame>], ball: &[Option<BallFrame>], stereo: bool) -> Option<f64> {
    let sighting = |(i, (r, b)): (usize, (&Option<RacketFrame>, &Option<BallFrame>))| {
        Some(Sighting::new(i as f64, r.as_ref()?, b.as_ref().filter(|b| b.stereo == stereo)?))
    };
    let seen: Vec<Sighting> = racket.iter().zip(ball).enumerate().filter_map(sighting).collect();
    let met = meeting(&seen)?;
    let heights = |clear_m: f64| -> Vec<f64> {
        let clear = |z: &f64| z.abs() > clear_m;
        let before: Vec<f64> = seen[..=met].iter().rev().map(|s| s.local.z).filter(clear).take(SIDE_FRAMES).collect();
        if before.is_empty() { seen[met..].iter().map(|s| s.local.z).filter(clear).take(SIDE_FRAMES).collect() } else { before }
    };
    upper_median(heights(CLEAR_M)).or_else(|| upper_median(heights(0.0)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tracking::racket::racket_figure::tests::figure;
    use crate::tracking::racket::racket_pose::{RacketPose, tests::rig};
    use crate::tracking::track_file::ImagePoint;
    use nalgebra::Matrix6;

    #[test]
    fn law_the_depth_that_one_camera_guesses_does_not_choose_the_face() {
        let pose = RacketPose { global_from_racket: Isometry3::identity(), covariance: Matrix6::identity(), chi2: 0.0, dof: 1 };
        let racket = vec![Some(RacketFrame { pose, points: [[None; 5]; 2], foretold: false }); 20];
        let ball = |stereo: bool, z: f64| Some(BallFrame { points: [None; 2], position: Point3::new(0.0, 0.0, z), stereo, flattening: None });
        // Left camera alone before the impact, followed backward from the rebound: guessed behind the strings. Both cameras after it.
        let seen: Vec<Option<BallFrame>> =
            (0..20).map(|i| if i < 10 { ball(false, -0.02 * f64::from(10 - i)) } else { ball(true, 0.03 * f64::from(i - 9)) }).collect();
        let up = |balls: &[Option<BallFrame>]| {
            let mut frames = racket.clone();
            settle(&View::new(&rig()), &figure(), &mut frames, balls);
            frames[0].as_ref().is_some_and(|r| r.pose.normal().z > 0.0)
        };
        assert!(up(&seen));
        // Never both: what one camera guesses is all there is.
        let one_eyed: Vec<Option<BallFrame>> = (0..20).map(|_| ball(false, -0.3)).collect();
        assert!(!up(&one_eyed));
    }

    #[test]
    fn law_the_face_of_a_racket_found_again_is_the_one_expected_or_unknown() {
        let rig = rig();
        let about_x = |angle: f64| Isometry3::rotation(Vector3::x() * angle);
        let frame = |angle: f64| {
            let pose = RacketPose { global_from_racket: about_x(angle), covariance: Matrix6::identity(), chi2: 0.0, dof: 1 };
            RacketFrame { pose, points: [[None; 5]; 2], foretold: false }
        };
        let angle_of = |found: RacketFrame| found.pose.global_from_racket.rotation.scaled_axis().x;
        // Read with either face.
        for read in [0.4, 0.4 - std::f64::consts::PI] {
            assert!((nearest_twin(&View::new(&rig), &figure(), frame(read), &about_x(0.1)).map(angle_of).expect("told") - 0.4).abs() < 1e-9);
        }
        // A quarter of a turn from where it should be.
        assert!(nearest_twin(&View::new(&rig), &figure(), frame(1.5), &about_x(0.0)).is_none());
    }

    #[test]
    fn law_the_face_is_told_where_the_ball_meets_it() {
        // A swing through half a turn about the long axis while the ball flies along z, bounces off at frame 60 and goes back.
        let pose = |i: usize| Isometry3::from_parts(Vector3::zeros().into(), UnitQuaternion::from_axis_angle(&Vector3::x_axis(), 0.05 * (i as f64 - 60.0)));
        let frame = |i: usize| {
            let pose = RacketPose { global_from_racket: pose(i), covariance: Matrix6::identity(), chi2: 0.0, dof: 1 };
            Some(RacketFrame { pose, points: [[None; 5]; 2], foretold: false })
        };
        let mut racket: Vec<_> = (0..120).map(frame).collect();
        assert!(racket[0].as_ref().is_some_and(|r| r.pose.normal().z < 0.0), "the ball seems to come from behind at first");
        let height = |i: usize| 0.03 + 0.03 * (i as f64 - 60.0).abs();
        let ball: Vec<_> =
            (0..120).map(|i| Some(BallFrame { points: [None; 2], position: Point3::new(0.1, 0.0, height(i)), stereo: true, flattening: None })).collect();
        settle(&View::new(&rig()), &figure(), &mut racket, &ball);
        assert!(racket[60].as_ref().is_some_and(|r| r.pose.normal().z > 0.9));
    }

    #[test]
    fn law_a_plane_that_swings_across_the_rebound_is_no_second_meeting() {
        // Comes at 20 mm a frame, is on the strings at frame 14, goes back at 8 mm; at frame 30 the racket, turned by the impact, passes it more closely.
        let sighting = |i: u8| {
            let number = f64::from(i);
            let z = if i < 14 { 0.034 + 0.02 * (13.0 - number) } else { 0.025 + 0.008 * (number - 14.0) };
            let height = if i < 22 { z } else { 0.008 * (30.0 - number) };
            Sighting { number, stereo: true, local: Point3::new(0.02, 0.05, height), global: Point3::new(0.02, 0.05, z) }
        };
        let seen: Vec<Sighting> = (0..38).map(sighting).collect();
        assert_eq!((meeting(&seen), first_on_the_head(&seen, 0.033)), (Some(14), Some(14)));
        // The plane follows the rebound so closely that the ball is not clear of it between: the first touch counts, not the nearest.
        let followed: Vec<Sighting> =
            seen.iter().map(|s| Sighting { local: Point3::new(0.02, 0.05, if s.number > 15.0 { s.local.z.min(0.04) } else { s.local.z }), ..*s }).collect();
        assert_eq!((meeting(&followed), first_on_the_head(&followed, 0.033)), (Some(30), Some(14)));
        // Where no way bends the nearest counts, and of a single time always.
        let straight: Vec<Sighting> = seen.iter().map(|s| Sighting { global: Point3::new(0.02, 0.05, 0.02 * s.number), ..*s }).collect();
        assert_eq!(meeting(&straight), Some(30));
        assert_eq!(meeting(&seen[24..]), Some(6));
    }

    #[test]
    fn law_a_figure_that_is_not_quite_symmetric_tells_the_face_and_one_measured_wrongly_leaves_it_to_the_ball() {
        let rig = rig();
        let view = View::new(&rig);
        let moved = |marker: usize, y: f64| {
            let mut figure = figure();
            figure.points[marker].y += y;
            figure
        };
        let ball: Vec<_> = (0..20)
            .map(|i| Some(BallFrame { points: [None; 2], position: Point3::new(0.0, 0.9, -0.02 * f64::from(20 - i)), stereo: true, flattening: None }))
            .collect();
        // Frames of a racket at rest, its hitting side up, tracked with `stated`; the ball comes from below.
        let up = |real: &RacketFigure, stated: &RacketFigure, turned_first: bool| {
            let pose = Isometry3::from_parts(Vector3::new(0.0, 0.9, 0.0).into(), UnitQuaternion::from_euler_angles(0.2, 0.3, 0.1));
            let point = |camera, marker| {
                let uv = view.patch(camera, real, marker, &pose).expect("seen");
                ImagePoint { uv, sd: Vector2::repeat(0.05) }
            };
            let points = crate::calibration::CameraId::BOTH.map(|camera| std::array::from_fn(|marker| Some(point(camera, marker))));
            let unfitted = RacketPose { global_from_racket: pose, covariance: Matrix6::identity(), chi2: 0.0, dof: 14 };
            let mut frame = RacketFrame { pose: unfitted, points, foretold: false };
            frame.pose = fit_pose(&view, stated, &frame.observations(), Some(&pose)).expect("seen");
            let frame = if turned_first { twin(&view, stated, &frame) } else { frame };
            let mut racket = vec![Some(frame); 20];
            settle(&view, stated, &mut racket, &ball);
            racket[0].as_ref().is_some_and(|r| r.pose.normal().z > 0.0)
        };
        for turned_first in [false, true] {
            // As measured: what the tapes say counts, wherever the ball comes from.
            assert!(up(&moved(1, 0.006), &moved(1, 0.006), turned_first));
            // The tapes are symmetric, racket.toml is wrong in one: the ball's side, below.
            assert!(!up(&figure(), &moved(1, 0.006), turned_first) && !up(&figure(), &moved(4, -0.005), turned_first));
            // Quite symmetric.
            assert!(!up(&figure(), &figure(), turned_first));
        }
    }
}
