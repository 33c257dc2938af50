//! Global axes on paper: with the three-sphere frame U, V, W as they are; without it the left camera's axes, turned so that
//! up is up.

use crate::calibration::{CameraId, StereoRig};
use nalgebra::{Point3, Vector2, Vector3};

/// How global coordinates go into a scene (whose second axis is up).
#[derive(Debug, Clone, Copy)]
pub(super) struct Room {
    pub axes_known: bool,
}

impl Room {
    pub fn vector(&self, v: &Vector3<f64>) -> Vector3<f64> {
        // Camera axes are x right, y down, z forward: (z, -y, x) is right-handed with the second axis up.
        if self.axes_known { *v } else { Vector3::new(v.z, -v.y, v.x) }
    }

    pub fn point(&self, p: &Point3<f64>) -> Point3<f64> {
        self.vector(&p.coords).into()
    }

    pub fn axis_names(&self) -> [&'static str; 3] {
        if self.axes_known { ["U", "V", "W"] } else { ["left camera: forward", "up", "right"] }
    }
}

/// Directions of the four corners of a camera's picture, global axes, in order around.
pub(super) fn camera_corners(rig: &StereoRig, id: CameraId) -> [Vector3<f64>; 4] {
    let [w, h] = rig.image_size.map(|s| s as f64);
    let turn = rig.camera_from_global(id).rotation.inverse();
    let camera = rig.camera(id);
    [(0.0, 0.0), (w, 0.0), (w, h), (0.0, h)].map(|(u, v)| {
        let plain = Vector2::new((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy);
        let ray = camera.normalise(Vector2::new(u, v)).unwrap_or(plain);
        turn * Vector3::new(ray.x, ray.y, 1.0)
    })
}
