//! Deviations of the markers' image points as a whole clip shows them.

use crate::median::upper_median;
use crate::tracking::pictures::shot_frames::AT_ONCE;
use crate::tracking::racket::racket_figure::RacketFigure;
use crate::tracking::racket::racket_pose::{MarkerObservation, View, fit_pose};
use crate::tracking::racket::racket_scene::RacketFrame;
use rayon::prelude::*;

/// Misses of the pose, in deviations, beyond which a single point is doubtful.
const DOUBTFUL: f64 = 3.0;
/// Bands' errors against their misses of the common pose, which contain the figure's errors as well: 0.86 to 1.05 on rendered sessions, 0.80 to
/// 0.94 on others' (against the true patches).
const OF_MISSES: f64 = 0.95;
/// A marker known worse than this is not measured, px.
const MOST_SD_PX: f64 = 0.9;
/// A band leaves more unexplained than it usually does where its deviation is so many times the clip's median; most that it grows by for that.
const UNUSUAL: f64 = 1.2;
const MOST_GROWN: f64 = 2.2;
/// Deviations shrink to no less than this share: what stays the same over a clip are few numbers (20 coordinates of ten bands, of which a
/// pose takes six), and they may be small by chance.
const LEAST_SHRUNK: f64 = 0.5;

/// Deviations as the whole clip shows them. What a band's own picture cannot tell (tape not quite where the file says, a tube of
/// another shape, light along the tube) shows as misses of the common pose, marker by marker and camera by camera: those deviations
/// grow until the misses are what they state. A single point that still misses by more than [`DOUBTFUL`]
/// deviations (another thing touches the band) grows by itself. Where all bands together then miss by less than they state, all
/// shrink to what they miss by. Every pose is then fitted again.
pub fn settle(view: &View, figure: &RacketFigure, frames: &mut [Option<RacketFrame>]) {
    let misses = |frame: &RacketFrame| -> Vec<(usize, usize, f64)> {
        let miss = |o: &MarkerObservation| {
            let r = o.point.uv - view.patch(o.camera, figure, o.marker, &frame.pose.global_from_racket)?;
            Some((o.camera.index(), o.marker, 0.5 * ((r.x / o.point.sd.x).powi(2) + (r.y / o.point.sd.y).powi(2))))
        };
        frame.observations().iter().filter_map(miss).collect()
    };
    // By camera and marker: sum of the squared misses and their number.
    let collect = |frames: &[Option<RacketFrame>]| {
        let mut sums = [[(0.0, 0.0); 5]; 2];
        let of_frame = |frame: &RacketFrame| {
            // A fit takes its share of the scatter: that of the observations beyond the pose's six numbers is left.
            let left = frame.pose.dof as f64 / (frame.pose.dof + 6) as f64;
            (left, misses(frame))
        };
        let of_frames: Vec<_> =
            frames.par_iter().with_max_len(AT_ONCE).flatten_iter().filter(|f| f.stereo() && !f.foretold && f.pose.dof >= 4).map(of_frame).collect();
        for (left, misses) in of_frames {
            for (camera, marker, z2) in misses {
                let sum = &mut sums[camera][marker];
                *sum = (sum.0 + z2.min(DOUBTFUL * DOUBTFUL) / left, sum.1 + 1.0);
            }
        }
        sums
    };
    for _ in 0..2 {
        let sums = collect(frames);
        frames.par_iter_mut().with_max_len(AT_ONCE).flatten_iter().for_each(|frame| {
            for (points, sums) in frame.points.iter_mut().zip(&sums) {
                for (point, sum) in points.iter_mut().zip(sums) {
                    if let Some(p) = point.as_mut().filter(|_| sum.1 >= 5.0) {
                        p.sd *= (sum.0 / sum.1).sqrt().max(1.0);
                    }
                }
            }
            refit(view, figure, frame);
        });
    }
    let (sum, count) = collect(frames).iter().flatten().filter(|b| b.1 >= 5.0).fold((0.0, 0.0), |(s, n), b| (s + b.0 / b.1, n + 1.0));
    if count > 0.0 && sum < count {
        let by = (sum / count).sqrt().max(LEAST_SHRUNK);
        frames.par_iter_mut().with_max_len(AT_ONCE).flatten_iter().for_each(|frame| {
            frame.points.iter_mut().flatten().flatten().for_each(|p| p.sd *= by);
            // All alike: the pose stays where it is.
            frame.pose.covariance *= by * by;
            frame.pose.chi2 /= by * by;
        });
    }
    frames.par_iter_mut().with_max_len(AT_ONCE).flatten_iter().for_each(|frame| {
        for _ in 0..2 {
            let worst = misses(frame).into_iter().max_by(|a, b| a.2.total_cmp(&b.2));
            let Some((camera, marker, z2)) = worst.filter(|w| w.2 > DOUBTFUL * DOUBTFUL) else { break };
            if let Some(p) = &mut frame.points[camera][marker] {
                p.sd *= z2.sqrt();
            }
            // What the other bands put so far elsewhere is not the marker.
            frame.points[camera][marker] = frame.points[camera][marker].filter(|p| p.sd.max() < MOST_SD_PX);
            refit(view, figure, frame);
        }
        frame.points.iter_mut().flatten().flatten().for_each(|p| p.sd *= OF_MISSES);
        frame.pose.covariance *= OF_MISSES * OF_MISSES;
        frame.pose.chi2 /= OF_MISSES * OF_MISSES;
    });
}

/// Fits a frame's pose again, from the bands it was found by.
fn refit(view: &View, figure: &RacketFigure, frame: &mut RacketFrame) {
    if !frame.foretold
        && let Ok(pose) = fit_pose(view, figure, &frame.observations(), Some(&frame.pose.global_from_racket))
    {
        frame.pose = pose;
    }
}

/// Deviations of bands that leave more unexplained in a picture than they do in others: partly hidden, or beside the ball. What hides a band pulls many of its pixels
/// one way, where its deviation counts as many errors of their own. On rendered sessions of all kinds errors were 1.1 to 1.2 times those deviations that were 1.2 times the
/// median, 1.3 to 1.5 where they were 1.8 times, 1.6 to 3 where they were 2.5 times, 1.5 to 4 beyond. The ball is looked for before: what it is told apart by are the
/// poses of [`settle`].
pub fn grow_unusual(view: &View, figure: &RacketFigure, frames: &mut [Option<RacketFrame>]) {
    let mut grown = vec![false; frames.len()];
    for (camera, marker) in (0..2).flat_map(|camera| (0..5).map(move |marker| (camera, marker))) {
        let Some(usual) = upper_median(frames.iter().flatten().filter_map(|f| Some(f.points[camera][marker]?.sd.norm()))) else { continue };
        for (frame, grown) in frames.iter_mut().zip(&mut grown) {
            let Some(point) = frame.as_mut().and_then(|f| f.points[camera][marker].as_mut()) else { continue };
            let times = point.sd.norm() / usual;
            if times > UNUSUAL {
                point.sd *= (0.5 + 0.5 * times * times).sqrt().min(MOST_GROWN);
                *grown = true;
            }
        }
    }
    frames.par_iter_mut().zip(grown).with_max_len(AT_ONCE).filter(|(_, grown)| *grown).for_each(|(frame, _)| {
        if let Some(frame) = frame {
            refit(view, figure, frame);
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::CameraId;
    use crate::tracking::racket::racket_figure::tests::figure;
    use crate::tracking::racket::racket_pose::{RacketPose, tests::rig};
    use crate::tracking::track_file::ImagePoint;
    use nalgebra::{Isometry3, Matrix6, Translation3, UnitQuaternion, Vector2};

    #[test]
    fn law_a_band_that_is_known_worse_than_usual_in_a_picture_counts_less_there() {
        let (rig, figure) = (rig(), figure());
        let view = View::new(&rig);
        let here = Isometry3::from_parts(Translation3::new(0.0, 0.9, -0.1), UnitQuaternion::from_euler_angles(0.3, 0.4, -0.5));
        // Deviations of the left camera's first band, frame by frame; where it is 0.125 px or more the ball beside it pulls it by 0.5 px.
        let sds = [0.05, 0.05, 0.055, 0.05, 0.125, 0.05, 0.5, 0.05, 0.05];
        let mut frames: Vec<Option<RacketFrame>> = Vec::new();
        for sd in sds {
            let mut points = [[None; 5]; 2];
            for camera in CameraId::BOTH {
                for marker in 0..5 {
                    let uv = view.patch(camera, &figure, marker, &here).expect("seen");
                    points[camera.index()][marker] = Some(ImagePoint { uv, sd: Vector2::repeat(0.05) });
                }
            }
            if let Some(first) = &mut points[0][0] {
                first.uv.x += if sd >= 0.125 { 0.5 } else { 0.0 };
                first.sd = Vector2::repeat(sd);
            }
            let unfitted = RacketPose { global_from_racket: here, covariance: Matrix6::identity(), chi2: 0.0, dof: 14 };
            let mut frame = RacketFrame { pose: unfitted, points, foretold: false };
            refit(&view, &figure, &mut frame);
            frames.push(Some(frame));
        }
        let sd = |frames: &[Option<RacketFrame>], k: usize| frames[k].as_ref().and_then(|f| f.points[0][0]).expect("seen").sd.x;
        let off = |frames: &[Option<RacketFrame>], k: usize| {
            let pose = &frames[k].as_ref().expect("seen").pose.global_from_racket;
            (pose * figure.points[0] - here * figure.points[0]).norm()
        };
        let before = off(&frames, 4);
        grow_unusual(&view, &figure, &mut frames);
        // 2.5 times the median: the root of (1 + 2.5²) / 2; ten times: the most. A tenth more is usual.
        assert!((sd(&frames, 4) - 0.125 * 3.625_f64.sqrt()).abs() < 1e-12 && (sd(&frames, 6) - 0.5 * MOST_GROWN).abs() < 1e-12);
        assert!((sd(&frames, 2) - 0.055).abs() < 1e-12 && (sd(&frames, 0) - 0.05).abs() < 1e-12);
        assert!(off(&frames, 4) < 0.5 * before, "{} {before}", off(&frames, 4));
    }
}
