//! How well the calibrated volume is known: predicted spread of points over slices, coverage of both pictures, tilts and
//! number of boards, and plain advice.

use super::calibrator::Calibration;
use super::rays::CalibrationError3d;
use super::{Camera, CameraId, RigidTransform};
use crate::median::median;
use nalgebra::{Isometry3, Matrix3, Point3, Vector2, Vector3};
use serde::{Deserialize, Serialize};

/// Half the side of the volume people measure in (thesis section 5.3: 2 x 2 x 2 m), m.
const HALF_SIDE_M: f64 = 1.0;
/// Points along each side of a slice.
const SLICE_POINTS: usize = 9;
/// Cells along each side of a picture in the coverage map.
const CELLS: usize = 4;
/// Pixel noise the predicted spread of a tracked point is shown for.
const PIXEL_SD: f64 = 0.1;
/// Tilts of boards the thesis recommends (section 3.3), degrees.
const TILT_DEG: std::ops::RangeInclusive<f64> = 20.0..=50.0;

/// A point of a slice: place (global axes, m), in view of both cameras, and spread per axis (mm).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SlicePoint {
    pub at_m: [f64; 3],
    pub in_view: bool,
    /// From the calibration alone, without the common shift and turn.
    pub calibration_sd_mm: [f64; 3],
    /// From pixel noise of `pixel_sd` alone.
    pub pixel_sd_mm: [f64; 3],
}

/// `volume` in `calibration.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Volume {
    /// Middle of the boards, global axes, m.
    pub centre_m: [f64; 3],
    pub side_m: f64,
    pub pixel_sd: f64,
    /// Slices through the middle, named by the axis that stays fixed.
    pub slices: Vec<Slice>,
    /// Corners of the volume's grid in view of both cameras and the boards' middles, left camera's frame, m: over these the
    /// common shift and turn are taken out.
    pub reference_points_m: Vec<[f64; 3]>,
    /// Largest total spread (mm) from the calibration over the points in view, and its root mean square.
    pub worst_calibration_mm: f64,
    pub rms_calibration_mm: f64,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Slice {
    pub fixed_axis: char,
    pub points: Vec<SlicePoint>,
}

/// `coverage` in `calibration.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Coverage {
    /// Corners in each cell of the picture, rows from the top.
    pub left_cells: Vec<Vec<usize>>,
    pub right_cells: Vec<Vec<usize>>,
    /// Predicted calibration spread at each cell, as a multiple of the middle of the picture; `None` where the other camera
    /// does not see that part of the volume.
    pub left_relative_error: Vec<Vec<Option<f64>>>,
    pub right_relative_error: Vec<Vec<Option<f64>>>,
    /// Angle between board and image plane, per used pair, degrees.
    pub left_tilt_deg: Vec<f64>,
    pub right_tilt_deg: Vec<f64>,
    pub pairs_used: usize,
}

impl Calibration {
    /// Middles of the boards both cameras see, left camera's frame.
    fn board_middles(&self) -> Vec<Point3<f64>> {
        let corners = &self.bundle.board;
        let middle = Point3::from(corners.iter().map(|c| c.coords).sum::<Vector3<f64>>() / corners.len().max(1) as f64);
        self.stereo_views().into_iter().map(|v| self.bundle.views[v].pose * middle).collect()
    }

    fn in_view(&self, p: &Point3<f64>) -> bool {
        let inside = |c: &Camera, q: Point3<f64>| {
            c.project(&q).is_some_and(|uv| uv.x > -0.5 && uv.y > -0.5 && uv.x < self.image_size[0] as f64 - 0.5 && uv.y < self.image_size[1] as f64 - 0.5)
        };
        inside(&self.bundle.left, *p) && inside(&self.bundle.right, self.bundle.right_from_left * p)
    }

    /// Predicted spread over the volume. `None` when it cannot be predicted (no boards, a singular rig).
    pub fn volume(&self, global_from_left: &RigidTransform) -> Option<(Volume, CalibrationError3d)> {
        let global = global_from_left.isometry();
        let middles = self.board_middles();
        let centre = global * Point3::from(middles.iter().map(|p| p.coords).sum::<Vector3<f64>>() / middles.len().max(1) as f64);
        let grid = |i: usize, n: usize| HALF_SIDE_M * (2.0 * i as f64 / (n - 1) as f64 - 1.0);
        let to_left = global.inverse();
        let mut reference: Vec<Point3<f64>> =
            (0..125).map(|k| to_left * (centre + Vector3::new(grid(k % 5, 5), grid(k / 5 % 5, 5), grid(k / 25, 5)))).filter(|p| self.in_view(p)).collect();
        reference.extend(&middles);
        let error = CalibrationError3d::new(&self.bundle.left, &self.bundle.right, &self.bundle.right_from_left, &self.fit.covariance, &reference)?;
        let spread = |c: Matrix3<f64>| {
            let r = global.rotation.to_rotation_matrix();
            let g = r.matrix() * c * r.matrix().transpose();
            [0, 1, 2].map(|i| 1e3 * g[(i, i)].max(0.0).sqrt())
        };
        let mut slices = Vec::new();
        for (axis, name) in ['x', 'y', 'z'].into_iter().enumerate() {
            let mut points = Vec::new();
            for i in 0..SLICE_POINTS {
                for j in 0..SLICE_POINTS {
                    let mut offset = Vector3::zeros();
                    offset[(axis + 1) % 3] = grid(i, SLICE_POINTS);
                    offset[(axis + 2) % 3] = grid(j, SLICE_POINTS);
                    let at = centre + offset;
                    let p = to_left * at;
                    let Some((c, n)) = error.covariance(&p).zip(error.pixel_covariance(&p, PIXEL_SD)) else { continue };
                    points.push(SlicePoint { at_m: at.coords.into(), in_view: self.in_view(&p), calibration_sd_mm: spread(c), pixel_sd_mm: spread(n) });
                }
            }
            slices.push(Slice { fixed_axis: name, points });
        }
        let totals: Vec<f64> = reference.iter().filter_map(|p| error.covariance(p)).map(|c| 1e3 * c.trace().max(0.0).sqrt()).collect();
        let volume = Volume {
            centre_m: centre.coords.into(),
            side_m: 2.0 * HALF_SIDE_M,
            pixel_sd: PIXEL_SD,
            slices,
            reference_points_m: reference.iter().map(|p| p.coords.into()).collect(),
            worst_calibration_mm: totals.iter().copied().fold(0.0, f64::max),
            rms_calibration_mm: (totals.iter().map(|t| t * t).sum::<f64>() / totals.len().max(1) as f64).sqrt(),
        };
        Some((volume, error))
    }

    pub fn coverage(&self, error: &CalibrationError3d) -> Coverage {
        let cells = |id: CameraId| {
            let mut map = vec![vec![0usize; CELLS]; CELLS];
            for v in &self.bundle.views {
                for c in if id == CameraId::Left { &v.left } else { &v.right } {
                    let at = |x: f64, size: usize| ((x + 0.5) / size as f64 * CELLS as f64).clamp(0.0, CELLS as f64 - 1.0) as usize;
                    map[at(c.uv.y, self.image_size[1])][at(c.uv.x, self.image_size[0])] += 1;
                }
            }
            map
        };
        let tilt = |pose: &Isometry3<f64>| (pose.rotation * Vector3::z()).z.abs().clamp(0.0, 1.0).acos().to_degrees();
        let stereo = self.stereo_views();
        Coverage {
            left_cells: cells(CameraId::Left),
            right_cells: cells(CameraId::Right),
            left_relative_error: self.relative_error(CameraId::Left, error),
            right_relative_error: self.relative_error(CameraId::Right, error),
            left_tilt_deg: stereo.iter().map(|&v| tilt(&self.bundle.views[v].pose)).collect(),
            right_tilt_deg: stereo.iter().map(|&v| tilt(&(self.bundle.right_from_left * self.bundle.views[v].pose))).collect(),
            pairs_used: stereo.len(),
        }
    }

    /// Spread at the boards' mean distance behind each cell's middle, relative to the picture's middle.
    fn relative_error(&self, id: CameraId, error: &CalibrationError3d) -> Vec<Vec<Option<f64>>> {
        let camera = if id == CameraId::Left { &self.bundle.left } else { &self.bundle.right };
        let from_left = if id == CameraId::Left { Isometry3::identity() } else { self.bundle.right_from_left };
        let middles = self.board_middles();
        let depth = middles.iter().map(|p| (from_left * p).z).sum::<f64>() / middles.len().max(1) as f64;
        let spread = |u: f64, v: f64| {
            let n = camera.normalise(Vector2::new(u, v))?;
            let p = from_left.inverse() * Point3::new(n.x * depth, n.y * depth, depth);
            self.in_view(&p).then(|| error.covariance(&p).map(|c| c.trace().max(0.0).sqrt())).flatten()
        };
        let at = |i: usize, size: usize| (i as f64 + 0.5) / CELLS as f64 * size as f64 - 0.5;
        let all: Vec<Vec<Option<f64>>> =
            (0..CELLS).map(|r| (0..CELLS).map(|c| spread(at(c, self.image_size[0]), at(r, self.image_size[1]))).collect()).collect();
        let middle = median(all.iter().flatten().flatten().copied());
        all.into_iter().map(|row| row.into_iter().map(|s| s.zip(middle).filter(|(_, m)| *m > 0.0).map(|(s, m)| s / m)).collect()).collect()
    }

    /// What to do better next time, in plain words; empty when nothing is to be said.
    pub fn advice(&self, coverage: &Coverage) -> Vec<String> {
        let mut out = Vec::new();
        let n = coverage.pairs_used;
        match n {
            0..=14 => out.push(format!("{n} pairs are used; take at least 15, better 20 (below 15 the error still falls with every pair)")),
            15..=19 => out.push(format!("{n} pairs are used; 20 or more are recommended, which leaves room for pictures that fail, 40 for a volume of 2 m")),
            _ => {}
        }
        for (name, cells, relative) in
            [("left", &coverage.left_cells, &coverage.left_relative_error), ("right", &coverage.right_cells, &coverage.right_relative_error)]
        {
            for (region, rows, columns) in [
                ("upper left", 0..CELLS / 2, 0..CELLS / 2),
                ("upper right", 0..CELLS / 2, CELLS / 2..CELLS),
                ("lower left", CELLS / 2..CELLS, 0..CELLS / 2),
                ("lower right", CELLS / 2..CELLS, CELLS / 2..CELLS),
            ] {
                let places: Vec<(usize, usize)> = rows.flat_map(|r| columns.clone().map(move |c| (r, c))).collect();
                let empty = places.iter().filter(|&&(r, c)| cells[r][c] == 0).count();
                let worst = places.iter().filter_map(|&(r, c)| relative[r][c]).fold(0.0, f64::max);
                if empty == places.len() || (2 * empty >= places.len() && worst > 2.0) {
                    let much = if worst > 1.5 { format!(": expect {worst:.0}x the error there") } else { String::new() };
                    out.push(format!("{} boards in the {region} of the {name} camera{much}", if empty == places.len() { "no" } else { "hardly any" }));
                }
            }
        }
        for (name, tilts) in [("left", &coverage.left_tilt_deg), ("right", &coverage.right_tilt_deg)] {
            let good = tilts.iter().filter(|t| TILT_DEG.contains(*t)).count();
            if 2 * good < tilts.len() {
                out.push(format!("only {good} of {} boards are tilted by 20 to 50 degrees to the {name} camera", tilts.len()));
            }
        }
        let defensible: Vec<_> = super::model_choice::summaries(&self.models).into_iter().filter(|m| m.defensible).collect();
        for (name, value, sd) in
            [("left", (|m: &super::model_choice::ModelSummary| m.left_cx) as fn(&_) -> f64, self.sd(2)), ("right", |m| m.right_cx, self.sd(11))]
        {
            let (low, high) = defensible.iter().map(value).fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
            if high - low > 4.0 * sd {
                out.push(format!(
                    "the {name} principal point moves by {:.1} px between defensible distortion models, its stated deviation is {sd:.1} px",
                    high - low
                ));
            }
        }
        out
    }
}
