//! What belongs to the racket and what comes through it: tape, lettering, throat and hand move with the string plane, a ball goes through it.

use crate::calibration::CameraId;
use crate::footage::FrameSource;
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
    /// of sight does so for that camera only.
    pub(in crate::tracking) fn is_part_of_the_racket(&self, frames: &[Option<BallFrame>], racket: &[Option<RacketFrame>]) -> bool {
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
        let middle = |of: fn(&Point2<f64>) -> f64| {
            let mut along: Vec<f64> = places.iter().map(of).collect();
            along.sort_by(f64::total_cmp);
            along.get(along.len() / 2).copied()
        };
        let (Some(x), Some(y)) = (middle(|p| p.x), middle(|p| p.y)) else { return false };
        let keep = places.iter().filter(|p| (p.x - x).hypot(p.y - y) < KEEPS_M).count();
        keep as f64 > MOST_KEEP * places.len() as f64
    }
}
