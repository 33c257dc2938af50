//! What a calibration reports beyond the rig itself, read from the other keys of `calibration.json` where they stand.

use crate::calibration::{CameraId, StereoRig};
use crate::report::page::Table;
use nalgebra::Point3;

/// One corner in one picture, px.
pub(super) struct CornerError {
    pub camera: CameraId,
    pub at: (f64, f64),
    pub error: (f64, f64),
}

#[derive(Default)]
pub(super) struct CalibrationDetail {
    /// Outer corners of each board, global axes, m.
    pub boards: Vec<Vec<Point3<f64>>>,
    pub corners: Vec<CornerError>,
    pub advice: Vec<String>,
}

impl CalibrationDetail {
    pub fn of(rig: &StereoRig) -> Self {
        let advice = rig.more.get("advice").and_then(|v| v.as_array()).into_iter().flatten().filter_map(|v| v.as_str().map(str::to_owned)).collect();
        let global = rig.global_from_left.isometry();
        let reports = rig.board_reports();
        let boards = reports.iter().map(|b| b.outline_left_m.iter().map(|p| global * Point3::from(*p)).collect()).collect();
        let corners = reports.iter().flat_map(|b| {
            let of = |camera, list: &[[f64; 4]]| -> Vec<CornerError> {
                list.iter().map(|c| CornerError { camera, at: (c[0], c[1]), error: (c[2], c[3]) }).collect()
            };
            of(CameraId::Left, &b.left_px).into_iter().chain(of(CameraId::Right, &b.right_px))
        });
        CalibrationDetail { boards, corners: corners.collect(), advice }
    }

    /// Middle of all boards.
    pub fn centre(&self) -> Option<Point3<f64>> {
        let all: Vec<&Point3<f64>> = self.boards.iter().flatten().collect();
        let sum = all.iter().fold(nalgebra::Vector3::zeros(), |s, p| s + p.coords);
        (!all.is_empty()).then(|| (sum / all.len() as f64).into())
    }

    /// Further figures with captions.
    pub fn figures(&self) -> Vec<(String, String)> {
        Vec::new()
    }

    /// Further figures as numbers.
    pub fn table(&self) -> Table {
        Table::default()
    }
}
