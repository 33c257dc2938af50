//! The calibration's share in the deviations of points in space.

use super::rays::CalibrationError3d;
use super::rig::StereoRig;
use nalgebra::{Isometry3, Point3, Vector3};

/// Points nearer to each other than this, m, have the same share: it changes by per cents over the whole volume.
const NEAR_M: f64 = 0.05;

/// Widens the deviations of many points of one recording. The common shift and turn of everything is left out: it belongs to
/// the global axes (contract, section 3).
#[derive(Debug, Clone)]
pub struct CalibrationSpread {
    error: Option<CalibrationError3d>,
    global_from_left: Isometry3<f64>,
    /// Places where the share is known, and its variances along the global axes, m².
    known: Vec<(Point3<f64>, Vector3<f64>)>,
}

impl CalibrationSpread {
    /// A rig without covariance (imported cameras) widens nothing.
    pub fn of_rig(rig: &StereoRig) -> Self {
        CalibrationSpread { error: CalibrationError3d::of_rig(rig), global_from_left: rig.global_from_left.isometry(), known: Vec::new() }
    }

    /// The deviations `sd` (global axes, m) of the point at `position`, with the calibration's.
    pub fn widen(&mut self, position: &Point3<f64>, sd: &Vector3<f64>) -> Vector3<f64> {
        let share = self.variance(position);
        sd.zip_map(&share, |sd, v| (sd * sd + v).sqrt())
    }

    fn variance(&mut self, position: &Point3<f64>) -> Vector3<f64> {
        let Some(error) = &self.error else { return Vector3::zeros() };
        if let Some((_, v)) = self.known.iter().rev().find(|(p, _)| (p - position).norm() < NEAR_M) {
            return *v;
        }
        let turn = self.global_from_left.rotation.to_rotation_matrix();
        let covariance = error.covariance(&self.global_from_left.inverse_transform_point(position));
        let v = covariance.map_or_else(Vector3::zeros, |c| (turn.matrix() * c * turn.matrix().transpose()).diagonal().map(|v| v.max(0.0)));
        self.known.push((*position, v));
        v
    }
}
