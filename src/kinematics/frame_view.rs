//! Every frame of a shot by itself: where the ball is, and roughly the racket.

use super::racket_motion::MovingRacket;
use super::sighting::FrameClock;
use crate::calibration::{CameraId, StereoRig};
use crate::reconstruction::{Triangulated, Triangulator};
use crate::tracking::{BALL_ERRORS_ALIKE, MarkerObservation, Target, Tracks, View, fit_pose};
use nalgebra::Isometry3;
use std::collections::BTreeMap;

/// Fewest frames in which both cameras show a body on one side of the contact.
pub const FEWEST_STEREO: usize = 2;

/// One frame seen alone: the ball's place and the racket's rough pose.
#[derive(Debug, Clone)]
pub struct FrameView {
    pub t: f64,
    pub ball: Option<Triangulated>,
    pub pose: Option<Isometry3<f64>>,
}

/// Every frame by itself.
pub fn frame_views(rig: &StereoRig, tracks: &Tracks, moving: &MovingRacket, clock: FrameClock) -> BTreeMap<u64, FrameView> {
    let (view, space) = (View::new(rig), Triangulator::new(rig));
    let mut views = BTreeMap::new();
    let mut last: Option<Isometry3<f64>> = None;
    for frame in tracks.frames() {
        let point = |target| {
            let (l, r) = (tracks.get(frame, CameraId::Left, target)?, tracks.get(frame, CameraId::Right, target)?);
            space.triangulate_alike(&l, &r, BALL_ERRORS_ALIKE).ok()
        };
        let pose = fit_pose(&view, &moving.figure, &MarkerObservation::in_frame(tracks, frame), last.as_ref()).ok().map(|p| p.global_from_racket);
        last = pose.or(last);
        views.insert(frame, FrameView { t: clock.time_s(frame), ball: point(Target::Ball), pose });
    }
    views
}
