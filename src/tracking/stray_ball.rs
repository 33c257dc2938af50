//! Single balls that do not belong to the flight: another thing was taken for the ball where it left the picture, passed before
//! something like it, or was half hidden.
//!
//! A free ball's image moves smoothly: over a few frames a parabola in time holds it to some hundredths of a pixel. A point that its
//! neighbours, before and after or on one side alone, put elsewhere by more than five joint deviations is not the ball.
//! Nothing is moved: a point stays as it was measured or goes.

use super::ball_track::BallFrame;
use super::contact_length::LONGEST_CONTACT_S;
use super::track_file::ImagePoint;
use crate::calibration::CameraId;
use crate::footage::FrameSource;
use nalgebra::{Matrix3, Matrix3x2, Vector2, Vector3};
use rayon::prelude::*;

/// Neighbours that a point is compared with, from how far away (frames), and fewest of them.
const NEIGHBOURS: usize = 10;
const FARTHEST: f64 = 12.0;
const FEWEST: usize = 6;
/// A stray is farther off than this, deviations.
const LIMIT: f64 = 5.0;
/// And farther than this, px: an outline that a line or a string pulls is measured again with the ball's model, which moves it by up
/// to 1.2 px; a centre that the model has found is final.
pub const OUTLINE_PX: f64 = 1.5;
pub const FINAL_PX: f64 = 0.6;
/// Frames within which another ball must be seen.
const LONELY: u64 = 4;
/// A camera that saw the ball this rarely in a stretch of flight saw no flight.
const SHORTEST: usize = 3;
/// Bend of a flight in a picture, px per frame² at 1000 frames a second, one deviation: gravity and drag of a fast ball make 0.01. Without it
/// a parabola through a few frames far away says nothing.
const BEND_PX: f64 = 0.015;
/// What a parabola is good to, px.
const PARABOLA_PX: f64 = 0.03;
/// Huber's limit, deviations.
const HUBER: f64 = 1.5;

/// Takes away single sightings, and the points of balls in free flight that the flight itself rules out by more than `least_px`. Without a
/// contact nothing is known to fly freely.
pub fn drop_strays(source: &impl FrameSource, ball: &mut [Option<BallFrame>], contact_frame: Option<f64>, frame_rate_hz: f64, least_px: f64) {
    drop_lonely(source, ball);
    let Some(contact) = contact_frame else { return };
    let bend_px = BEND_PX * (1000.0 / frame_rate_hz).powi(2);
    for after in [false, true] {
        let free = |t: f64| if after { t > LONGEST_CONTACT_S } else { t < 0.0 };
        // What the two cameras never see at once is no flight through both pictures.
        let flying: Vec<usize> = (0..ball.len()).filter(|i| ball[*i].is_some() && free((source.number(*i) as f64 - contact) / frame_rate_hz)).collect();
        if flying.iter().all(|i| ball[*i].is_some_and(|b| !b.stereo)) {
            flying.iter().for_each(|i| ball[*i] = None);
        }
        for camera in CameraId::BOTH {
            let mut flight: Vec<(usize, f64, ImagePoint)> = ball
                .iter()
                .enumerate()
                .filter_map(|(i, b)| Some((i, source.number(i) as f64 - contact, b.as_ref()?.points[camera.index()]?)))
                .filter(|(_, frames, _)| free(frames / frame_rate_hz))
                .collect();
            // Worst first: a stray spoils what its neighbours are compared with.
            for _ in 0..flight.len() / 4 {
                let points: Vec<(f64, ImagePoint)> = flight.iter().map(|f| (f.1, f.2)).collect();
                let strays: Vec<(usize, f64)> = (0..points.len()).into_par_iter().filter_map(|k| Some((k, strayed(&points, k, least_px, bend_px)?))).collect();
                let Some((worst, _)) = strays.into_iter().max_by(|a, b| a.1.total_cmp(&b.1)).filter(|s| s.1 > LIMIT) else { break };
                let (index, ..) = flight.remove(worst);
                BallFrame::forget(&mut ball[index], camera.index());
            }
            if flight.len() < SHORTEST {
                flight.iter().for_each(|f| BallFrame::forget(&mut ball[f.0], camera.index()));
            }
        }
    }
}

/// Takes away what a camera saw in one frame with nothing like it before or after: no ball shows so briefly.
fn drop_lonely(source: &impl FrameSource, ball: &mut [Option<BallFrame>]) {
    for camera in 0..2 {
        let shows = |i: &usize| ball[*i].as_ref().is_some_and(|b| b.points[camera].is_some());
        let seen: Vec<(usize, u64)> = (0..ball.len()).filter(shows).map(|i| (i, source.number(i))).collect();
        for (k, (index, number)) in seen.iter().enumerate() {
            let near = |other: Option<&(usize, u64)>| other.is_some_and(|o| o.1.abs_diff(*number) <= LONELY);
            if !near(k.checked_sub(1).and_then(|b| seen.get(b))) && !near(seen.get(k + 1)) {
                BallFrame::forget(&mut ball[*index], camera);
            }
        }
    }
}

/// How many deviations a point is from where its neighbours put it; `None` where they are too few, or it is near enough in px.
fn strayed(points: &[(f64, ImagePoint)], at: usize, least_px: f64, bend_px: f64) -> Option<f64> {
    let (time, point) = &points[at];
    let mut near: Vec<&(f64, ImagePoint)> = points.iter().enumerate().filter(|(k, p)| *k != at && (p.0 - time).abs() <= FARTHEST).map(|(_, p)| p).collect();
    near.sort_by(|a, b| (a.0 - time).abs().total_cmp(&(b.0 - time).abs()));
    near.truncate(NEIGHBOURS);
    if near.len() < FEWEST {
        return None;
    }
    let row = |t: f64| Vector3::new(1.0, t - time, (t - time).powi(2));
    let sd = |p: &ImagePoint| p.sd.max().hypot(PARABOLA_PX);
    let mut weights = vec![1.0; near.len()];
    let mut found: Option<(Vector2<f64>, f64)> = None;
    for _ in 0..4 {
        let (mut h, mut g) = (Matrix3::zeros(), Matrix3x2::zeros());
        for ((t, p), w) in near.iter().zip(&weights) {
            let (b, w) = (row(*t), w / sd(p).powi(2));
            h += b * b.transpose() * w;
            g += b * p.uv.transpose() * w;
        }
        h[(2, 2)] += bend_px.powi(-2);
        let inverse = h.try_inverse()?;
        let curve = inverse * g;
        let misses: Vec<f64> = near.iter().map(|(t, p)| (p.uv - curve.tr_mul(&row(*t))).norm() / sd(p)).collect();
        weights = misses.iter().map(|z| (HUBER / z.max(1e-9)).min(1.0)).collect();
        let mut sorted = misses;
        sorted.sort_by(f64::total_cmp);
        // The median length of two normal numbers is 1.18 deviations.
        let scale = (sorted[sorted.len() / 2] / 1.18).max(1.0);
        found = Some((curve.row(0).transpose(), inverse[(0, 0)].sqrt() * scale));
    }
    let (expected, expected_sd) = found?;
    let miss = (point.uv - expected).norm();
    (miss > least_px).then(|| miss / sd(point).hypot(expected_sd))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn flight(n: usize) -> Vec<(f64, ImagePoint)> {
        let noise = |k: usize| 0.03 * ((k * 7919 % 13) as f64 / 6.0 - 1.0);
        (0..n)
            .map(|k| {
                let t = k as f64 - n as f64;
                let uv = Vector2::new(200.0 + 6.0 * t + 0.01 * t * t + noise(k), 150.0 - 2.0 * t + 0.004 * t * t + noise(k + 5));
                (t, ImagePoint { uv, sd: Vector2::repeat(0.04) })
            })
            .collect()
    }

    #[test]
    fn truth_a_stray_at_the_end_or_amid_the_flight_is_told_and_no_true_ball_is() {
        for stray in [0, 9, 19] {
            let mut points = flight(20);
            assert!((0..20).all(|k| strayed(&points, k, FINAL_PX, BEND_PX).is_none()));
            points[stray].1.uv += Vector2::new(0.9, -0.8);
            let worst = (0..20).filter_map(|k| Some((k, strayed(&points, k, FINAL_PX, BEND_PX)?))).max_by(|a, b| a.1.total_cmp(&b.1)).expect("a stray");
            assert!(worst.0 == stray && worst.1 > LIMIT, "{stray}: {worst:?}");
        }
        // A point that knows how badly it is known stays.
        let mut points = flight(20);
        points[19].1 = ImagePoint { uv: points[19].1.uv + Vector2::new(0.6, 0.0), sd: Vector2::repeat(0.4) };
        assert!(strayed(&points, 19, FINAL_PX, BEND_PX).is_none_or(|z| z < LIMIT));
    }

    #[test]
    fn fails_quietly_where_too_few_frames_show_the_flight() {
        let mut points = flight(6);
        points[5].1.uv.x += 5.0;
        assert!((0..6).all(|k| strayed(&points, k, FINAL_PX, BEND_PX).is_none()));
    }
}
