//! Ball and markers in space, frame by frame, with time counted from first contact (`points.csv`).
//!
//! A marker's image is the centroid of the visible tape; it is first brought to the tube's axis with the offset that the
//! frame's pose predicts, else both cameras would be triangulating different sides of the tube.

use super::shot_motion::ShotMotion;
use crate::calibration::{CameraId, StereoRig};
use crate::reconstruction::Triangulator;
use crate::tracking::{BALL_ERRORS_ALIKE, ImagePoint, MarkerObservation, SpacePoint, Target, Tracks, View, fit_pose};
use std::collections::BTreeMap;

/// Every point that both cameras saw, sorted by frame and target.
pub fn space_points(rig: &StereoRig, tracks: &Tracks, motion: &ShotMotion) -> Vec<SpacePoint> {
    let centres = CameraId::BOTH.map(|c| rig.centre(c));
    let space = Triangulator::new(rig);
    let mut out = Vec::new();
    for (frame, view) in &motion.frames {
        for target in Target::ALL {
            let mut seen = Vec::with_capacity(2);
            for camera in CameraId::BOTH {
                let Some(mut point) = tracks.get(*frame, camera, target) else { continue };
                if target != Target::Ball {
                    let Some(pose) = view.pose else { continue };
                    let eye = pose.inverse_transform_point(&centres[camera.index()]);
                    let (patch, _) = motion.moving.figure.patch_point(target.index(), &eye);
                    let axis = motion.moving.figure.points[target.index()];
                    let (Some(a), Some(b)) = (rig.project(camera, &(pose * axis)), rig.project(camera, &(pose * patch))) else { continue };
                    point = ImagePoint { uv: point.uv + a - b, sd: point.sd };
                }
                seen.push(point);
            }
            let [left, right] = &seen[..] else { continue };
            let alike = if target == Target::Ball { BALL_ERRORS_ALIKE } else { 0.0 };
            if let Ok(p) = space.triangulate_alike(left, right, alike) {
                out.push(SpacePoint {
                    frame: *frame,
                    t: view.t - motion.first_contact_t,
                    target,
                    position: p.position,
                    sd: p.covariance.diagonal().map(f64::sqrt),
                    residual_px: p.residual_px,
                });
            }
        }
    }
    out
}

/// The same with every marker where the frame's rigid pose puts it: all markers of both cameras together know each one's place
/// two to three times as well as its own two rays. A marker that only one camera saw is added, one that neither saw is not. Frames
/// whose markers do not determine a pose keep their single points. `residual_px` stays that of the marker's own images.
pub fn on_rigid_racket(rig: &StereoRig, tracks: &Tracks, motion: &ShotMotion, single: &[SpacePoint]) -> Vec<SpacePoint> {
    let view = View::new(rig);
    let figure = &motion.moving.figure;
    let mut out: BTreeMap<(u64, Target), SpacePoint> = single.iter().map(|p| ((p.frame, p.target), *p)).collect();
    for (frame, seen) in &motion.frames {
        let Some(start) = seen.pose else { continue };
        let observations = MarkerObservation::in_frame(tracks, *frame);
        // From one camera alone depth is poor, and no marker has a point of its own either.
        if CameraId::BOTH.iter().any(|c| observations.iter().all(|o| o.camera != *c)) {
            continue;
        }
        let Ok(pose) = fit_pose(&view, figure, &observations, Some(&start)) else { continue };
        for (marker, target) in Target::MARKERS.into_iter().enumerate() {
            let misses: Vec<f64> = observations
                .iter()
                .filter(|o| o.marker == marker)
                .filter_map(|o| Some((o.point.uv - view.patch(o.camera, figure, marker, &pose.global_from_racket)?).norm_squared()))
                .collect();
            if misses.is_empty() {
                continue;
            }
            let (position, covariance) = pose.point(&figure.points[marker]);
            let residual_px = (misses.iter().sum::<f64>() / misses.len() as f64).sqrt();
            let point =
                SpacePoint { frame: *frame, t: seen.t - motion.first_contact_t, target, position, sd: covariance.diagonal().map(f64::sqrt), residual_px };
            out.insert((*frame, target), point);
        }
    }
    out.into_values().collect()
}
