//! One point from both cameras, with its covariance.

use crate::calibration::{CameraId, StereoRig};
use crate::tracking::ImagePoint;
use nalgebra::{Matrix3, Matrix4x3, Point3, Vector3, Vector4};

/// A triangulated point, global axes, m.
#[derive(Debug, Clone, Copy)]
pub struct StereoPoint {
    pub position: Point3<f64>,
    pub covariance: Matrix3<f64>,
    /// Root mean square of the four image residuals, px.
    pub residual_px: f64,
}

/// Most likely point for one sighting in each camera; `None` when the rays do not meet in front of both cameras.
pub fn stereo_point(rig: &StereoRig, seen: [&ImagePoint; 2]) -> Option<StereoPoint> {
    let mut position = nearest_to_rays(rig, seen)?;
    let poses = CameraId::BOTH.map(|c| rig.camera_from_global(c));
    let mut covariance = Matrix3::zeros();
    let mut residual = Vector4::zeros();
    for _ in 0..6 {
        let mut jacobian = Matrix4x3::zeros();
        let mut whitened = Vector4::zeros();
        for (k, id) in CameraId::BOTH.into_iter().enumerate() {
            let (uv, j) = rig.camera(id).project_with_jacobian(&(poses[k] * position))?;
            let j = j * poses[k].rotation.to_rotation_matrix().matrix();
            for axis in 0..2 {
                let sd = seen[k].sd[axis];
                residual[2 * k + axis] = uv[axis] - seen[k].uv[axis];
                whitened[2 * k + axis] = residual[2 * k + axis] / sd;
                jacobian.set_row(2 * k + axis, &(j.row(axis) / sd));
            }
        }
        covariance = (jacobian.transpose() * jacobian).try_inverse()?;
        let step = covariance * (jacobian.transpose() * whitened);
        position -= step;
        if step.norm() < 1e-10 {
            break;
        }
    }
    position.coords.iter().all(|v| v.is_finite()).then_some(StereoPoint { position, covariance, residual_px: residual.norm() / 2.0 })
}

fn nearest_to_rays(rig: &StereoRig, seen: [&ImagePoint; 2]) -> Option<Point3<f64>> {
    let mut normal = Matrix3::zeros();
    let mut right = Vector3::zeros();
    for (k, id) in CameraId::BOTH.into_iter().enumerate() {
        let n = rig.camera(id).normalise(seen[k].uv)?;
        let global_from_camera = rig.camera_from_global(id).inverse();
        let direction = (global_from_camera.rotation * Vector3::new(n.x, n.y, 1.0)).normalize();
        let across = Matrix3::identity() - direction * direction.transpose();
        normal += across;
        right += across * global_from_camera.translation.vector;
    }
    normal.try_inverse().map(|inverse| Point3::from(inverse * right))
}
