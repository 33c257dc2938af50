//! How well the racket face's own axes are known when every tape band is seen a little off its middle.
//!
//! Part of a band's image error belongs to the shot; part is the same in every shot in which the racket is seen alike
//! (shading of the tape, string ends, the far side of the tube). Both are in the deviations of the shot; the second turns and
//! shifts the face's axes by the same amount in all shots of a session and is also stated beside them, for whoever compares
//! many shots with a model.

use crate::calibration::{CameraId, StereoRig};
use crate::tracking::{RacketFigure, View};
use nalgebra::{Isometry3, SMatrix, Vector3};

/// Deviations of the face's axes: turn about local x, y, z (rad), shift of the stringbed centre along them (m), from an
/// independent error of `shared_px` of every band in each camera and image axis. `None` when the pose cannot be told.
pub fn face_pose_sd(rig: &StereoRig, figure: &RacketFigure, global_from_racket: &Isometry3<f64>, shared_px: f64) -> Option<[f64; 6]> {
    let view = View::new(rig);
    let mut information = SMatrix::<f64, 6, 6>::zeros();
    for camera in CameraId::BOTH {
        for marker in 0..figure.points.len() {
            let (_, j) = view.patch_with_jacobian(camera, figure, marker, global_from_racket)?;
            information += j.transpose() * j / shared_px.powi(2);
        }
    }
    let covariance = information.try_inverse()?;
    let local = |block: usize, k: usize| {
        let axis = global_from_racket.rotation * Vector3::ith(k, 1.0);
        axis.dot(&(covariance.fixed_view::<3, 3>(block, block) * axis)).max(0.0).sqrt()
    };
    let sd = [local(0, 0), local(0, 1), local(0, 2), local(3, 0), local(3, 1), local(3, 2)];
    sd.iter().all(|v| v.is_finite()).then_some(sd)
}
