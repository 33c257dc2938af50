//! Where a racket that is followed should be in a frame, and how well that is known.

use nalgebra::{Isometry3, Matrix6, Translation3, UnitQuaternion, Vector3, Vector6};

/// Most that a foretold pose may be off, in deviations of its six numbers together.
const MOST_OFF: f64 = 4.0;

/// A pose as it is foretold, and what it is known to: rotation vector about the global axes (rad), then shift (m).
#[derive(Debug, Clone, Copy)]
pub struct Foretold {
    pub pose: Isometry3<f64>,
    covariance: Matrix6<f64>,
    /// Its inverse.
    pub(in crate::tracking) precision: Matrix6<f64>,
}

impl Foretold {
    /// `None` where the covariance is none.
    pub fn new(pose: Isometry3<f64>, covariance: &Matrix6<f64>) -> Option<Self> {
        Some(Foretold { pose, covariance: *covariance, precision: covariance.try_inverse()? })
    }

    /// Known to the same deviation of either angle (rad) and of either coordinate (m).
    pub fn within(pose: Isometry3<f64>, sd_rad: f64, sd_m: f64) -> Self {
        let covariance = Matrix6::from_diagonal(&Vector6::from_fn(|k, _| if k < 3 { sd_rad * sd_rad } else { sd_m * sd_m }));
        Foretold { pose, covariance, precision: Matrix6::from_diagonal(&covariance.diagonal().map(f64::recip)) }
    }

    pub fn covariance(&self) -> &Matrix6<f64> {
        &self.covariance
    }

    /// Whether the racket may be at a pose rather than where it was foretold.
    pub fn allows(&self, pose: &Isometry3<f64>) -> bool {
        self.off(pose) < MOST_OFF
    }

    /// Largest turn (rad) and shift (m) about and along any axis that [`Self::allows`] leaves.
    pub fn reach(&self) -> (f64, f64) {
        let sd = self.covariance.diagonal().map(f64::sqrt);
        (MOST_OFF * sd.rows(0, 3).max(), MOST_OFF * sd.rows(3, 3).max())
    }

    /// How far off a pose is, in deviations of its six numbers together.
    pub fn off(&self, pose: &Isometry3<f64>) -> f64 {
        let off = turn_and_shift(pose, &self.pose);
        off.dot(&(self.precision * off)).sqrt()
    }
}

/// Turn (rotation vector about the global axes) and shift from a pose to another.
pub(in crate::tracking) fn turn_and_shift(from: &Isometry3<f64>, to: &Isometry3<f64>) -> Vector6<f64> {
    let turn = (to.rotation * from.rotation.inverse()).scaled_axis();
    let shift = to.translation.vector - from.translation.vector;
    Vector6::new(turn.x, turn.y, turn.z, shift.x, shift.y, shift.z)
}

pub(in crate::tracking) fn moved(pose: &Isometry3<f64>, [a, b, c, x, y, z]: &[f64; 6]) -> Isometry3<f64> {
    let turn = UnitQuaternion::from_scaled_axis(Vector3::new(*a, *b, *c));
    Isometry3::from_parts(Translation3::from(pose.translation.vector + Vector3::new(*x, *y, *z)), turn * pose.rotation)
}
