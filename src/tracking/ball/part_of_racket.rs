//! What belongs to the racket and what comes through it: tape, lettering, throat and hand move with the string plane, a ball goes through it.

use crate::calibration::CameraId;
use crate::footage::FrameSource;
use crate::median::upper_median;
use crate::tracking::ball::ball_track::{BallFrame, FASTEST_M_S};
use crate::tracking::ball::ray_flight::RayPoint;
use crate::tracking::pictures::shot_frames::Shot;
use crate::tracking::racket::racket_scene::RacketFrame;
use nalgebra::{Point2, Point3};

/// From the strings' centre, m: less is in the head.
pub(in crate::tracking) const IN_THE_HEAD_M: f64 = 0.25;
/// A ball in the head this near to the string plane, m, has come to it: what the strings give, and half of what the fastest goes in a frame.
const NEAR_STRINGS_M: f64 = 0.05;
/// What stays as near to one place in the string plane, m, in more of its frames is a part of the racket.
const KEEPS_M: f64 = 0.03;
const MOST_KEEP: f64 = 0.7;
/// Fewer points of one camera do not tell.
const FEWEST_POINTS: usize = 7;
/// What both cameras see come to the string plane, or leave it, by more than this, m, is no part of the racket: a ball that comes straight to a hung
/// racket, between the cameras, and goes back slowly keeps its place in the string plane for both in most frames of a short clip.
const COMES_M: f64 = 0.06;
/// Coming and going it changes its height by no more than so many times the whole of it: what is seen now here and now there changes it all the time.
const TO_AND_FRO: f64 = 3.0;

/// Whether something comes to the string plane or leaves it, by its heights over it, m, from frame to frame.
fn comes_or_goes(heights: &[f64]) -> bool {
    let (low, high) = heights.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), z| (low.min(*z), high.max(*z)));
    let changes: f64 = heights.windows(2).map(|two| (two[1] - two[0]).abs()).sum();
    heights.len() >= FEWEST_POINTS && high - low > COMES_M && changes < TO_AND_FRO * (high - low)
}

impl<S: FrameSource> Shot<'_, S> {
    /// Whether a way (global place by frame number) comes through the head somewhere.
    pub(in crate::tracking) fn crosses_the_head(&self, racket: &[Option<RacketFrame>], way: impl Fn(f64) -> Point3<f64>) -> bool {
        let near_m = f64::max(NEAR_STRINGS_M, 0.5 * FASTEST_M_S / self.setup.frame_rate_hz);
        racket.iter().enumerate().filter_map(|(i, r)| Some((i, r.as_ref()?))).any(|(i, r)| {
            let local = r.pose.global_from_racket.inverse() * way(self.source.number(i) as f64);
            local.z.abs() < near_m && local.xy().coords.norm() < IN_THE_HEAD_M
        })
    }

    /// Whether what was followed keeps its place in the string plane as it moves, for either camera: a ball that comes along one camera's line
    /// of sight does so for that camera only. Both together see whether it comes to the plane.
    pub(in crate::tracking) fn is_part_of_the_racket(&self, frames: &[Option<BallFrame>], racket: &[Option<RacketFrame>]) -> bool {
        let height = |(ball, racket): (&Option<BallFrame>, &Option<RacketFrame>)| {
            let place = ball.as_ref().filter(|b| b.stereo)?.position;
            Some((racket.as_ref()?.pose.global_from_racket.inverse() * place).z)
        };
        if comes_or_goes(&frames.iter().zip(racket).filter_map(height).collect::<Vec<f64>>()) {
            return false;
        }
        CameraId::BOTH.into_iter().all(|camera| {
            let point = |(index, ball): (usize, &Option<BallFrame>)| {
                let uv = ball.as_ref()?.points[camera.index()]?.uv;
                Some(RayPoint { index, number: self.source.number(index) as f64, camera, uv })
            };
            let points: Vec<RayPoint> = frames.iter().enumerate().filter_map(point).collect();
            points.len() >= FEWEST_POINTS && self.keeps_its_place(&points, racket)
        })
    }

    /// Whether points of one camera keep their place in the string plane as it moves: tape, throat and hand do.
    pub(in crate::tracking) fn keeps_its_place(&self, points: &[RayPoint], racket: &[Option<RacketFrame>]) -> bool {
        let in_plane = |p: &RayPoint| {
            let racket_from_global = racket[p.index].as_ref()?.pose.global_from_racket.inverse();
            let (eye, ray) = (racket_from_global * self.view.eye(p.camera), racket_from_global * self.view.ray(p.camera, p.uv)?);
            Some((eye - ray * (eye.z / ray.z)).xy())
        };
        let places: Vec<Point2<f64>> = points.iter().filter_map(in_plane).collect();
        let (Some(x), Some(y)) = (upper_median(places.iter().map(|p| p.x)), upper_median(places.iter().map(|p| p.y))) else { return false };
        let keep = places.iter().filter(|p| (p.x - x).hypot(p.y - y) < KEEPS_M).count();
        keep as f64 > MOST_KEEP * places.len() as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn truth_a_ball_comes_and_goes_and_what_belongs_to_the_racket_does_not() {
        let noise = |k: i32| 0.002 * (f64::from(k * 7919 % 13) / 6.0 - 1.0);
        // 18 mm a frame to the strings of a hung racket, 11 back from them; as fast both ways; only away.
        for (comes, goes) in [(0.018, 0.011), (0.015, 0.015), (0.0, 0.02)] {
            let ball: Vec<f64> = (-12..12).map(|k| 0.033 + noise(k) + f64::from(k) * if k < 0 { -comes } else { goes }).collect();
            assert!(comes_or_goes(&ball), "{comes} {goes}");
            assert!(!comes_or_goes(&ball[10..15]), "too short: {comes} {goes}");
        }
        let tape: Vec<f64> = (0..27).map(noise).collect();
        // Letters of one camera beside other letters of the other, now these, now those.
        let letters: Vec<f64> = (0..27).map(|k| 0.04 * f64::from(k * 7919 % 7)).collect();
        assert!(!comes_or_goes(&tape) && !comes_or_goes(&letters));
    }
}
