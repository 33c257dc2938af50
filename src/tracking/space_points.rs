//! Tracks in space: the five markers from the fitted pose, the ball from both rays, and the instant of first contact.

use crate::calibration::{CalibrationSpread, CameraId};
use crate::footage::FrameSource;
use crate::tracking::ball::ball_track::BallFrame;
use crate::tracking::ball::ball_way::StraightLine;
use crate::tracking::racket::face::{self, Sighting};
use crate::tracking::racket::racket_figure::RacketFigure;
use crate::tracking::racket::racket_pose::View;
use crate::tracking::racket::racket_scene::RacketFrame;
use crate::tracking::shot_tracks::{ShotSetup, ShotTracks};
use crate::tracking::track_file::{SpacePoint, Target};
use nalgebra::{Matrix2, Matrix2x3, Matrix3, Point3, Vector3};

/// A marker known worse than this, m, is left out (one camera alone hardly tells depth); its image points stay.
const MOST_SD_M: f64 = 0.005;

/// Correlation of the two cameras' errors of the ball's centre, in either picture axis: both see it under one light, and what is not
/// understood of the light shifts both centres alike. Two upright cameras that err alike err in height, less in depth. Over 84
/// stretches of eight rendered sessions the heights' squared errors were 1.2 and the depths' 0.7 of what independent errors would give.
pub const BALL_ERRORS_ALIKE: f64 = 0.25;

/// Sightings through which a line to the contact is drawn, and fewest of a flight that leads to a hidden one.
const TO_THE_CONTACT: usize = 6;
const LEADING: usize = 4;
/// So many by both cameras, of those or from no longer before the contact, s, do without the others.
const BY_BOTH: usize = 3;
const SEEN_WITHIN_S: f64 = 6e-3;
/// A hidden contact lies this near to the head, m: what the racket's turn bends the ball's way by in its axes.
const AT_THE_HEAD_M: f64 = 0.05;

/// First contact as a fractional frame number: the ball's centre, still in free flight, one radius from the string plane.
///
/// A straight line through the last distances before contact; kinematics refines it. It is looked for back from where the ball meets the
/// head: the plane is crossed at other times too. `None` when the ball never comes that near while both are seen, nor leads there from both
/// ends of a gap.
pub fn first_contact(source: &impl FrameSource, racket: &[Option<RacketFrame>], ball: &[Option<BallFrame>], radius_m: f64, frame_rate_hz: f64) -> Option<f64> {
    let side = face::side_of_approach(racket, ball)?.signum();
    let sighting = |i: usize| Some(Sighting::new(source.number(i) as f64, racket[i].as_ref()?, ball[i].as_ref()?));
    let seen: Vec<Sighting> = (0..source.len()).filter_map(sighting).collect();
    let met = face::first_on_the_head(&seen, radius_m)?;
    // Frame number and place in the racket's axes, as seen from that side.
    let seen: Vec<(bool, (f64, Point3<f64>))> = seen.iter().map(|s| (s.stereo, (s.number, Point3::new(s.local.x, s.local.y, side * s.local.z)))).collect();
    let touching = (0..=met).rev().take_while(|i| seen[*i].1.1.z <= radius_m).last();
    // Frames in which the ball is clear of the strings: the depth of what one camera sees is foretold, and counts where both hardly see it.
    let way = |touching: usize| {
        let clear = touching.saturating_sub(TO_THE_CONTACT)..touching;
        let near = |i: &usize| clear.contains(i) || seen[touching].1.0 - seen[*i].1.0 <= SEEN_WITHIN_S * frame_rate_hz;
        let by_both: Vec<usize> = (0..touching).rev().filter(|i| near(i) && seen[*i].0).take(TO_THE_CONTACT).collect();
        let through = if by_both.len() < BY_BOTH { clear.clone().collect() } else { by_both };
        (through.len() > 1).then(|| StraightLine::through(through.iter().map(|i| seen[*i].1)))
    };
    touching.and_then(|touching| way(touching)?.number_at_height(radius_m)).or_else(|| {
        let in_space: Vec<(f64, Point3<f64>)> = seen.iter().filter(|s| s.0).map(|s| s.1).collect();
        hidden_contact(&in_space, radius_m)
    })
}

/// First contact in a gap to which the ball's way leads from both ends, in the racket's axes. What is seen of the contact itself belongs to the gap.
fn hidden_contact(seen: &[(f64, Point3<f64>)], radius_m: f64) -> Option<f64> {
    let seen: Vec<(f64, Point3<f64>)> = seen.iter().filter(|(_, local)| face::off_the_face_m(local) > radius_m).copied().collect();
    (LEADING..(seen.len() + 1).saturating_sub(LEADING)).find_map(|end| {
        let (before, after) = (&seen[end.saturating_sub(TO_THE_CONTACT)..end], &seen[end..(end + TO_THE_CONTACT).min(seen.len())]);
        let gap = seen[end - 1].0..seen[end].0;
        let contact = |flight: &[(f64, Point3<f64>)]| {
            let line = StraightLine::through(flight.iter().copied());
            let number = line.number_at_height(radius_m).filter(|number| gap.contains(number))?;
            let there = Point3::new(line.at(number).x, line.at(number).y, 0.0);
            (face::off_the_face_m(&there) < AT_THE_HEAD_M).then_some(number)
        };
        contact(before).zip(contact(after)).filter(|(first, last)| first < last).map(|(first, _)| first)
    })
}

/// Numbers of the frames in which the ball is in contact: its centre, measured by both cameras, is nearer to the string plane
/// than one radius, over the stringbed. Before and after them it flies freely; no track is smoothed across them.
pub fn contact_frames(source: &impl FrameSource, setup: &ShotSetup, shot: &ShotTracks) -> Vec<u64> {
    let radius = setup.ball.radius_m();
    let touches = |i: &usize| {
        let (racket, ball) = (shot.racket.get(*i)?.as_ref()?, shot.ball.get(*i)?.as_ref()?);
        let local = racket.pose.global_from_racket.inverse() * ball.position;
        (ball.stereo && setup.racket.head.is_strung_at(&local.xy().coords) && local.z.abs() < radius).then(|| source.number(*i))
    };
    (0..source.len()).filter_map(|i| touches(&i)).collect()
}

/// Points of `points.csv`, sorted by frame and target; deviations from the image points and the calibration. Without a contact, t = 0 is the first frame.
pub fn space_points(
    source: &impl FrameSource,
    setup: &ShotSetup,
    view: &View,
    figure: &RacketFigure,
    racket: &[Option<RacketFrame>],
    ball: &[Option<BallFrame>],
    contact_frame: Option<f64>,
) -> Vec<SpacePoint> {
    let mut spread = CalibrationSpread::of_rig(setup.rig);
    let zero = contact_frame.unwrap_or(source.number(0) as f64);
    let mut out = Vec::new();
    for index in 0..source.len() {
        let frame = source.number(index);
        let t = (frame as f64 - zero) / setup.frame_rate_hz;
        // What nothing checks is not passed off as measured.
        if let Some(r) = racket[index].as_ref().filter(|r| !r.foretold) {
            for (marker, local) in figure.points.iter().enumerate() {
                if r.points.iter().all(|camera| camera[marker].is_none()) {
                    continue; // predicted, not measured
                }
                let (position, covariance) = r.pose.point(local);
                let residual_px = marker_residual(view, figure, r, marker);
                let sd = covariance.diagonal().map(f64::sqrt);
                if sd.norm() > MOST_SD_M {
                    continue;
                }
                out.push(SpacePoint { frame, t, target: Target::MARKERS[marker], position, sd: spread.widen(&position, &sd), residual_px });
            }
        }
        if let Some((position, covariance, residual_px)) = ball[index].as_ref().and_then(|b| meet(view, b)) {
            let sd = spread.widen(&position, &covariance.diagonal().map(f64::sqrt));
            out.push(SpacePoint { frame, t, target: Target::Ball, position, sd, residual_px });
        }
    }
    out
}

/// Adds what two cameras that shake by `shake_px` per axis put into every place; no picture tells its own shake.
pub fn widen_by_shake(view: &View, points: &mut [SpacePoint], shake_px: [f64; 2]) {
    if shake_px == [0.0, 0.0] {
        return;
    }
    for point in points {
        let jacobians = CameraId::BOTH.map(|camera| view.project_with_jacobian(camera, &point.position).map(|(_, j)| j));
        let [Some(left), Some(right)] = jacobians else { continue };
        let Some(inverse) = (left.tr_mul(&left) + right.tr_mul(&right)).try_inverse() else { continue };
        let variances = |j: Matrix2x3<f64>, px: f64| (inverse * j.transpose() * px).map(|x| x * x).column_sum();
        let shaken = variances(left, shake_px[0]) + variances(right, shake_px[1]);
        point.sd = point.sd.zip_map(&shaken, |sd, variance| (sd * sd + variance).sqrt());
    }
}

/// Root-mean-square distance of a marker's image points from the pose's own, px.
fn marker_residual(view: &View, figure: &RacketFigure, frame: &RacketFrame, marker: usize) -> f64 {
    let (mut sum, mut n) = (0.0, 0);
    for camera in CameraId::BOTH {
        let Some(point) = frame.points[camera.index()][marker] else { continue };
        if let Some(uv) = view.patch(camera, figure, marker, &frame.pose.global_from_racket) {
            sum += (point.uv - uv).norm_squared();
            n += 1;
        }
    }
    if n == 0 { 0.0 } else { (sum / n as f64).sqrt() }
}

/// The ball's place that fits both image points best, with covariance (m²) and residual, px. `None` from one camera.
pub fn meet(view: &View, ball: &BallFrame) -> Option<(Point3<f64>, Matrix3<f64>, f64)> {
    let points = [ball.points[0]?, ball.points[1]?];
    let mut p = ball.position;
    let mut h = Matrix3::zeros();
    let mut weighted = [Matrix2x3::zeros(); 2];
    let mut miss = 0.0;
    for _ in 0..4 {
        h = Matrix3::zeros();
        let mut g = Vector3::zeros();
        miss = 0.0;
        for camera in CameraId::BOTH {
            let o = points[camera.index()];
            let (uv, j) = view.project_with_jacobian(camera, &p)?;
            let whiten = Matrix2::from_diagonal(&o.sd.map(f64::recip));
            let (j, r) = (whiten * j, whiten * (o.uv - uv));
            h += j.tr_mul(&j);
            g += j.tr_mul(&r);
            miss += (o.uv - uv).norm_squared() / 2.0;
            weighted[camera.index()] = j;
        }
        p += h.cholesky()?.solve(&g);
    }
    Some((p, with_errors_alike(&h.try_inverse()?, &weighted, BALL_ERRORS_ALIKE), miss.sqrt()))
}

/// Covariance of a point whose two pictures err alike: `alone` is that of independent errors, `whitened` the change of either image point
/// with the place, in its deviations, `alike` the correlation in either picture axis.
pub fn with_errors_alike(alone: &Matrix3<f64>, whitened: &[Matrix2x3<f64>; 2], alike: f64) -> Matrix3<f64> {
    let [left, right] = whitened.map(|j| alone * j.transpose());
    let together = left * right.transpose();
    alone + (together + together.transpose()) * alike
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn truth_a_contact_that_no_frame_shows_is_told_by_the_flights_beside_it() {
        // Comes at 20 mm a frame to be one radius away at frame 20.3, leaves at 40 from frame 24.6.
        let radius_m = 0.033;
        let at = |number: i32, beside: f64| {
            let t = f64::from(number);
            let z = if t < 22.0 { radius_m + 0.02 * (20.3 - t) } else { radius_m + 0.04 * (t - 24.6) };
            (t, Point3::new(beside + 0.002 * t, -0.05, z))
        };
        let seen = |beside: f64| (0..10).chain(34..45).map(|n| at(n, beside)).collect::<Vec<_>>();
        assert!((hidden_contact(&seen(0.0), radius_m).expect("told") - 20.3).abs() < 1e-6);
        // Its last frame is seen.
        let with_last: Vec<_> = (0..10).chain(24..45).map(|n| at(n, 0.0)).collect();
        assert!((hidden_contact(&with_last, radius_m).expect("told") - 20.3).abs() < 1e-6);
        // Past the head.
        assert!(hidden_contact(&seen(0.3), radius_m).is_none());
        // Half of a flight leads nowhere.
        assert!(hidden_contact(&seen(0.0)[..12], radius_m).is_none());
    }
}
