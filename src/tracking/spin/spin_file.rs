//! `shots/<id>/spin.json`: the spin of one shot as `track` leaves it for `shots`.
//!
//! `before`, `after`: each an object with `kind`:
//! - `vector`: `omega_rad_s` [3] in global axes, `covariance` 3×3 (symmetric) in (rad/s)², `frames_used`, `quality`
//!   (`views`, `pixels`, `noise`, `markings`, `outliers`, `unexplained`, `margin`: see [`SpinQuality`](super::SpinQuality));
//! - `one_axis`: `axis` [3] (unit, global), `rate_rad_s`, `sd_rad_s`, `frames_used`, `reason`;
//! - `refused`: `reason` with `cause` and its numbers.

use super::estimate::{BallSpin, SpinEstimate};
use crate::limited_file::{LARGEST_TEXT, read_text};
use std::path::{Path, PathBuf};

/// Name of the file in a shot's results folder.
pub const SPIN_FILE: &str = "spin.json";

#[derive(Debug, thiserror::Error)]
pub enum SpinFileError {
    #[error("{path}: cannot be read ({source}); run `sweetspot track` first", path = .path.display())]
    Unreadable { path: PathBuf, source: std::io::Error },
    #[error("{path}: not a spin file ({source}); run `sweetspot track --force` to write it again", path = .path.display())]
    Format { path: PathBuf, source: serde_json::Error },
    #[error("{path}: `{field}` is {seen}; allowed: {allowed}", path = .path.display())]
    Value { path: PathBuf, field: &'static str, seen: String, allowed: &'static str },
}

/// The file's text.
pub fn spin_to_json(spin: &BallSpin) -> String {
    // Plain numbers and strings: serialising cannot fail.
    serde_json::to_string_pretty(spin).unwrap_or_default() + "\n"
}

/// Reads and checks `spin.json`.
pub fn read_spin(path: &Path) -> Result<BallSpin, SpinFileError> {
    let text = read_text(path, LARGEST_TEXT).map_err(|source| SpinFileError::Unreadable { path: path.into(), source })?;
    let spin: BallSpin = serde_json::from_str(&text).map_err(|source| SpinFileError::Format { path: path.into(), source })?;
    for (field, estimate) in [("before", &spin.before), ("after", &spin.after)] {
        let bad = |seen: String, allowed| SpinFileError::Value { path: path.into(), field, seen, allowed };
        match estimate {
            SpinEstimate::Vector { omega_rad_s, covariance, .. } => {
                if !omega_rad_s.norm().is_finite() || omega_rad_s.norm() > 1e5 {
                    return Err(bad(format!("{omega_rad_s:?}"), "a spin below 1e5 rad/s"));
                }
                let symmetric = (covariance - covariance.transpose()).norm() <= 1e-6 * covariance.norm();
                if !(symmetric && covariance.cholesky().is_some()) {
                    return Err(bad(format!("{covariance:?}"), "a symmetric, positive definite covariance"));
                }
            }
            SpinEstimate::OneAxis { axis, rate_rad_s, sd_rad_s, .. } => {
                if !((axis.norm() - 1.0).abs() < 1e-6 && rate_rad_s.abs() < 1e5 && *sd_rad_s > 0.0 && sd_rad_s.is_finite()) {
                    return Err(bad(format!("{axis:?}, {rate_rad_s}, {sd_rad_s}"), "a unit axis, a rate below 1e5 rad/s and a deviation above 0"));
                }
            }
            SpinEstimate::Refused { .. } => {}
        }
    }
    Ok(spin)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::super::estimate::{SpinQuality, SpinRefusal};
    use super::*;
    use nalgebra::{Matrix3, Vector3};

    fn spin() -> BallSpin {
        let quality = SpinQuality { views: 40, pixels: 6000, noise: 0.02, markings: 0.17, outliers: 0.03, unexplained: 0.1, margin: Some(0.4) };
        BallSpin {
            before: SpinEstimate::Vector { omega_rad_s: Vector3::new(1.0, -200.5, 30.0), covariance: Matrix3::identity() * 0.3, frames_used: 20, quality },
            after: SpinEstimate::Refused { reason: SpinRefusal::TooFewFrames { seen: 2, needed: 4 } },
        }
    }

    #[test]
    fn truth_a_spin_file_reads_back_as_written() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(SPIN_FILE);
        std::fs::write(&path, spin_to_json(&spin())).unwrap();
        assert_eq!(read_spin(&path).unwrap(), spin());
    }

    #[test]
    fn fails_on_a_covariance_that_is_none() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(SPIN_FILE);
        let mut broken = spin();
        if let SpinEstimate::Vector { covariance, .. } = &mut broken.before {
            covariance[(0, 0)] = -1.0;
        }
        std::fs::write(&path, spin_to_json(&broken)).unwrap();
        assert!(matches!(read_spin(&path), Err(SpinFileError::Value { field: "before", .. })));
        std::fs::write(&path, "{}").unwrap();
        assert!(matches!(read_spin(&path), Err(SpinFileError::Format { .. })));
    }
}
