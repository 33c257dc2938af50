//! Ball and markers in space, frame by frame, with time counted from first contact (`points.csv`).
//!
//! A marker's image is the centroid of the visible tape; it is first brought to the tube's axis with the offset that the
//! frame's pose predicts, else both cameras would be triangulating different sides of the tube.

use super::shot_motion::ShotMotion;
use super::stereo_point::stereo_point;
use crate::calibration::{CameraId, StereoRig};
use crate::tracking::{ImagePoint, SpacePoint, Target, Tracks};

/// Every point that both cameras saw, sorted by frame and target.
pub fn space_points(rig: &StereoRig, tracks: &Tracks, motion: &ShotMotion) -> Vec<SpacePoint> {
    let centres = CameraId::BOTH.map(|c| rig.centre(c));
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
            if let Some(p) = stereo_point(rig, [left, right]) {
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
