//! The calibrated stereo rig: two cameras, their relative pose, and the global axes. Read from and written to
//! `calibration.json` (contract, section 3).

use super::camera_model::Camera;
use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector2, Vector3};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Which camera; `left` and `right` are names only, nothing assumes which camera stands where.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum CameraId {
    Left,
    Right,
}

impl CameraId {
    pub const BOTH: [CameraId; 2] = [CameraId::Left, CameraId::Right];

    pub fn name(self) -> &'static str {
        match self {
            CameraId::Left => "left",
            CameraId::Right => "right",
        }
    }

    pub fn index(self) -> usize {
        self as usize
    }
}

/// `p_target = R p_source + t`, row-major R, t in m, with one standard deviation of rotation (rad) and shift (m).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RigidTransform {
    #[serde(rename = "R")]
    pub r: [[f64; 3]; 3],
    pub t: [f64; 3],
    /// `rotation_rad` (3, about the target's axes) and `t_m` (3).
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub sd: BTreeMap<String, [f64; 3]>,
}

impl RigidTransform {
    /// No turn, no shift.
    pub fn identity() -> Self {
        RigidTransform::from_isometry(&Isometry3::identity())
    }

    pub fn from_isometry(iso: &Isometry3<f64>) -> Self {
        RigidTransform { r: rows(iso.rotation.to_rotation_matrix().matrix()), t: iso.translation.vector.into(), sd: BTreeMap::new() }
    }

    pub fn isometry(&self) -> Isometry3<f64> {
        isometry(&self.r, &self.t)
    }
}

/// What became of one checkerboard pair.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PairFate {
    pub name: String,
    pub used: bool,
    /// Why it was dropped, or in what limited way it was used; empty when used in full.
    pub reason: String,
    pub rms_px: Option<f64>,
}

/// Square sizes re-measured in 3-D on boards held out of the fit, mm.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SquareSize {
    pub mean: f64,
    pub sd: f64,
    pub n: usize,
}

/// The rig as `calibration.json` holds it. Lengths in m unless the name says otherwise.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StereoRig {
    pub image_size: [usize; 2],
    pub left: Camera,
    pub right: Camera,
    /// x_right = R x_left + T.
    #[serde(rename = "R")]
    pub r: [[f64; 3]; 3],
    #[serde(rename = "T")]
    pub t: [f64; 3],
    pub rms_stereo_px: f64,
    #[serde(default)]
    pub pairs: Vec<PairFate>,
    /// `null` where too few pairs are used to hold some out.
    #[serde(default)]
    pub square_mm: Option<SquareSize>,
    /// x_global = R x_left + t; the identity when the session has no axes images.
    pub global_from_left: RigidTransform,
    /// Everything else the calibration reports (covariance, advice, provenance); kept as it stands in the file.
    #[serde(flatten)]
    pub more: BTreeMap<String, serde_json::Value>,
}

impl StereoRig {
    pub fn camera(&self, id: CameraId) -> &Camera {
        match id {
            CameraId::Left => &self.left,
            CameraId::Right => &self.right,
        }
    }

    /// Pose `right_from_left`.
    pub fn right_from_left(&self) -> Isometry3<f64> {
        isometry(&self.r, &self.t)
    }

    /// Whether the global axes are the three-sphere frame's; otherwise they are the left camera's, and nothing knows what is up. The transform itself
    /// tells: only without pictures of the frame it is written as the identity, which no frame in front of a camera has. Whether the pictures are
    /// still there does not matter.
    pub fn axes_known(&self) -> bool {
        let left = RigidTransform::identity();
        (self.global_from_left.r, self.global_from_left.t) != (left.r, left.t)
    }

    /// Pose `camera_from_global`.
    pub fn camera_from_global(&self, id: CameraId) -> Isometry3<f64> {
        let left_from_global = self.global_from_left.isometry().inverse();
        match id {
            CameraId::Left => left_from_global,
            CameraId::Right => self.right_from_left() * left_from_global,
        }
    }

    /// Pixel of a global point, `None` behind the camera.
    pub fn project(&self, id: CameraId, global: &Point3<f64>) -> Option<Vector2<f64>> {
        self.camera(id).project(&(self.camera_from_global(id) * global))
    }

    /// Centre of a camera in global axes, m.
    pub fn centre(&self, id: CameraId) -> Point3<f64> {
        self.camera_from_global(id).inverse() * Point3::origin()
    }
}

fn rows(m: &Matrix3<f64>) -> [[f64; 3]; 3] {
    [0, 1, 2].map(|i| [m[(i, 0)], m[(i, 1)], m[(i, 2)]])
}

fn isometry(r: &[[f64; 3]; 3], t: &[f64; 3]) -> Isometry3<f64> {
    let m = Matrix3::from_fn(|i, j| r[i][j]);
    // A file may carry a rotation rounded to a few digits: take the nearest rotation.
    let rotation = Rotation3::from_matrix_eps(&m, 1e-15, 100, Rotation3::from_matrix_unchecked(m));
    Isometry3::from_parts(Translation3::from(Vector3::from(*t)), UnitQuaternion::from_rotation_matrix(&rotation))
}
