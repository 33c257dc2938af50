//! A racket that leaps for one frame: a band half hidden, or a picture of another instant, put it where it was neither before nor after.
//!
//! Where a camera shows two or three bands, a single one that is wrong by a pixel moves the racket along the other camera's line of sight by a
//! centimetre, and the bands still agree. Nothing is smoothed along the way: the bands that speak for the leap are left out, and the pose is that of
//! the others alone.

use crate::tracking::racket::foretold_pose::Foretold;
use crate::tracking::racket::racket_figure::RacketFigure;
use crate::tracking::racket::racket_pose::{MarkerObservation, View, fit_pose};
use crate::tracking::racket::racket_scene::RacketFrame;
use nalgebra::Isometry3;
use std::ops::RangeInclusive;

/// Farthest frames before and after between which a racket is expected on a straight way.
const BESIDE: usize = 2;
/// What a racket in play may depart from that way by: turn (rad) and shift (m), and accelerations, rad/s² and m/s², one deviation each. The tip of a fast
/// serve is drawn to its axis by 1800 m/s².
const DEPARTURE: (f64, f64) = (2e-3, 5e-4);
const ACCELERATION: (f64, f64) = (5e3, 1e3);
/// A pose so many deviations off leaps.
const LEAP: f64 = 5.0;
/// What bands are off where the racket is expected, px.
const EXPECTED_PX: f64 = 0.3;

/// Leaves out the bands that make the racket leap for a frame; `numbers` are the frames', and in those of `hit` the ball may turn it.
pub fn drop_strays(view: &View, figure: &RacketFigure, racket: &mut [Option<RacketFrame>], (numbers, frame_rate_hz): (&[f64], f64), hit: &RangeInclusive<f64>) {
    let leap = |racket: &[Option<RacketFrame>], index: usize| -> Option<(f64, Foretold)> {
        let here = racket[index].as_ref().filter(|frame| !frame.foretold && !hit.contains(&numbers[index]))?;
        let expected = expected(racket, numbers, index, frame_rate_hz)?;
        let all = Foretold::new(expected.pose, &(expected.covariance() + here.pose.covariance))?;
        Some((all.off(&here.pose.global_from_racket), expected)).filter(|(off, _)| *off > LEAP)
    };
    let mut leaping: Vec<(usize, f64)> = (0..racket.len()).filter_map(|i| Some((i, leap(racket, i)?.0))).collect();
    // The neighbours of a frame that leaps are off as well, by half; when it is put right they are not.
    leaping.sort_by(|a, b| b.1.total_cmp(&a.1));
    let mut left: Vec<usize> = Vec::new();
    for (index, _) in leaping {
        if left.iter().any(|other| other.abs_diff(index) <= BESIDE) {
            continue;
        }
        let Some((_, expected)) = leap(racket, index) else { continue };
        match racket[index].as_ref().and_then(|frame| without_leap(view, figure, frame, &expected)) {
            Some(frame) => racket[index] = Some(frame),
            None => left.push(index),
        }
    }
}

/// Where the nearest frames before and after put the racket.
fn expected(racket: &[Option<RacketFrame>], numbers: &[f64], index: usize, frame_rate_hz: f64) -> Option<Foretold> {
    let told = |i: usize| racket.get(i)?.as_ref().filter(|frame| !frame.foretold && frame.stereo()).map(|frame| (numbers[i], &frame.pose));
    let (from, before) = (1..=BESIDE).find_map(|k| told(index.checked_sub(k)?))?;
    let (to, after) = (1..=BESIDE).find_map(|k| told(index + k))?;
    let (ago, ahead) = (numbers[index] - from, to - numbers[index]);
    if ago > BESIDE as f64 || ahead > BESIDE as f64 {
        return None;
    }
    let share = ago / (ago + ahead);
    let pose: Isometry3<f64> = before.global_from_racket.lerp_slerp(&after.global_from_racket, share);
    // Half the acceleration times the two times from that way.
    let times = 0.5 * ago * ahead / (frame_rate_hz * frame_rate_hz);
    let (turn, shift) = (DEPARTURE.0 + times * ACCELERATION.0, DEPARTURE.1 + times * ACCELERATION.1);
    let departure = Foretold::within(pose, turn, shift);
    Foretold::new(pose, &(before.covariance * (1.0 - share).powi(2) + after.covariance * share.powi(2) + departure.covariance()))
}

/// A frame without the bands that speak for its leap, those that do most first; `None` where too few would be left.
fn without_leap(view: &View, figure: &RacketFigure, frame: &RacketFrame, expected: &Foretold) -> Option<RacketFrame> {
    let mut bands = frame.observations();
    loop {
        let miss = |o: &MarkerObservation| {
            let r = o.point.uv - view.patch(o.camera, figure, o.marker, &expected.pose)?;
            Some((r.x / o.point.sd.x.hypot(EXPECTED_PX)).hypot(r.y / o.point.sd.y.hypot(EXPECTED_PX)))
        };
        let misses: Option<Vec<f64>> = bands.iter().map(miss).collect();
        let worst = misses?.into_iter().enumerate().max_by(|a, b| a.1.total_cmp(&b.1))?.0;
        bands.remove(worst);
        let pose = fit_pose(view, figure, &bands, Some(&expected.pose)).ok()?;
        if Foretold::new(expected.pose, &(expected.covariance() + pose.covariance))?.off(&pose.global_from_racket) < LEAP {
            let mut points = [[None; 5]; 2];
            bands.iter().for_each(|o| points[o.camera.index()][o.marker] = Some(o.point));
            return Some(RacketFrame { pose, points, foretold: false });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::CameraId;
    use crate::tracking::racket::racket_figure::tests::figure;
    use crate::tracking::racket::racket_pose::{RacketPose, tests::rig};
    use crate::tracking::track_file::ImagePoint;
    use nalgebra::{Matrix6, Translation3, UnitQuaternion, Vector2};

    const RATE_HZ: f64 = 1000.0;

    /// A racket in a swing, at a frame.
    fn swung(k: f64) -> Isometry3<f64> {
        let turn = UnitQuaternion::from_euler_angles(0.3, 0.4 + 0.02 * k + 2e-4 * k * k, -0.5);
        Isometry3::from_parts(Translation3::new(0.012 * k + 1e-4 * k * k, 0.9, -0.1), turn)
    }

    /// Twelve frames of which the right camera shows as many bands; `change` makes a frame's image points others.
    fn seen(place: impl Fn(f64) -> Isometry3<f64>, right: &[usize], change: impl Fn(usize, usize, usize, &mut Vector2<f64>)) -> Vec<Option<RacketFrame>> {
        let (rig, figure) = (rig(), figure());
        let view = View::new(&rig);
        let frame = |k: usize| {
            let mut points = [[None; 5]; 2];
            for camera in CameraId::BOTH {
                for marker in (0..5).filter(|m| camera == CameraId::Left || right.contains(m)) {
                    let mut uv = view.patch(camera, &figure, marker, &place(k as f64)).expect("seen");
                    change(k, camera.index(), marker, &mut uv);
                    points[camera.index()][marker] = Some(ImagePoint { uv, sd: Vector2::repeat(0.06) });
                }
            }
            let mut frame = RacketFrame { pose: unfitted(place(k as f64)), points, foretold: false };
            frame.pose = fit_pose(&view, &figure, &frame.observations(), Some(&place(k as f64))).expect("settles");
            Some(frame)
        };
        (0..12).map(frame).collect()
    }

    fn unfitted(global_from_racket: Isometry3<f64>) -> RacketPose {
        RacketPose { global_from_racket, covariance: Matrix6::identity(), chi2: 0.0, dof: 8 }
    }

    /// How far the first marker is off in a frame, m, before and after; which bands of it the right camera is left with.
    fn dropped(mut frames: Vec<Option<RacketFrame>>, place: impl Fn(f64) -> Isometry3<f64>, hit: RangeInclusive<f64>) -> ([f64; 2], Vec<usize>) {
        let (rig, figure) = (rig(), figure());
        let numbers: Vec<f64> = (0..12).map(f64::from).collect();
        let off = |frames: &[Option<RacketFrame>]| {
            let pose = frames[6].as_ref().expect("seen").pose.global_from_racket;
            (pose * figure.points[0] - place(6.0) * figure.points[0]).norm()
        };
        let (before, bands) = (off(&frames), frames.iter().flatten().map(RacketFrame::count).collect::<Vec<_>>());
        drop_strays(&View::new(&rig), &figure, &mut frames, (&numbers, RATE_HZ), &hit);
        let others = |counts: &[usize]| counts.iter().enumerate().filter(|(k, _)| *k != 6).map(|(_, n)| *n).collect::<Vec<_>>();
        assert_eq!(others(&frames.iter().flatten().map(RacketFrame::count).collect::<Vec<_>>()), others(&bands), "other frames stay");
        let left = frames[6].as_ref().expect("seen").points[1];
        ([before, off(&frames)], (0..5).filter(|m| left[*m].is_some()).collect())
    }

    const NO_HIT: RangeInclusive<f64> = f64::INFINITY..=f64::INFINITY;

    #[test]
    fn truth_the_bands_that_make_the_racket_leap_for_a_frame_are_left_out() {
        // One of two bands is half hidden and measured 2 px off.
        let half_hidden = seen(swung, &[0, 4], |k, camera, marker, uv| uv.x += if (k, camera, marker) == (6, 1, 0) { 2.0 } else { 0.0 });
        let ([before, after], left) = dropped(half_hidden, swung, NO_HIT);
        assert!(before > 0.006 && after < 0.0005 && left == [4], "{before} {after} {left:?}");
        // The right camera's picture is that of three frames ago.
        let (rig, figure) = (rig(), figure());
        let view = View::new(&rig);
        let late = seen(swung, &[0, 1, 2, 3, 4], |k, camera, marker, uv| {
            if (k, camera) == (6, 1) {
                *uv = view.patch(CameraId::Right, &figure, marker, &swung(3.0)).expect("seen");
            }
        });
        let ([before, after], left) = dropped(late, swung, NO_HIT);
        assert!(before > 0.006 && after < 0.003 && left.len() < 3, "{before} {after} {left:?}");
    }

    #[test]
    fn law_a_racket_in_play_keeps_all_its_bands() {
        let still = |_: usize, _: usize, _: usize, _: &mut Vector2<f64>| ();
        assert_eq!(dropped(seen(swung, &[0, 4], still), swung, NO_HIT).1, [0, 4]);
        // Struck hard: the ball stops it from one frame to the next.
        let struck = |k: f64| swung(k.min(6.0));
        assert_eq!(dropped(seen(struck, &[0, 1, 2, 3, 4], still), struck, 5.0..=12.0).1, [0, 1, 2, 3, 4]);
    }
}
