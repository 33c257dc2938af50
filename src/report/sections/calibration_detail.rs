//! What a calibration reports beyond the rig itself, read from the other keys of `calibration.json` where they stand.

use crate::calibration::{AxesReport, CameraId, Coverage, MethodError, Slice, SlicePoint, StereoRig, Verdict, Volume};
use crate::report::chart::{Bars, Cells, Chart, Colour, Rule, bin_edges, histogram};
use crate::report::markup::fixed;
use crate::report::page::{Section, Table};
use nalgebra::{Point3, Vector3};
use serde::de::DeserializeOwned;

/// One corner in one picture, px.
pub(super) struct CornerError {
    pub camera: CameraId,
    pub at: (f64, f64),
    pub error: (f64, f64),
}

pub(super) struct CalibrationDetail {
    /// Outer corners of each board, global axes, m.
    pub boards: Vec<Vec<Point3<f64>>>,
    pub corners: Vec<CornerError>,
    pub advice: Vec<String>,
    pub verdict: Option<Verdict>,
    pub axes: Option<AxesReport>,
    volume: Option<Volume>,
    coverage: Option<Coverage>,
    methods: Vec<MethodError>,
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
        CalibrationDetail {
            boards,
            corners: corners.collect(),
            advice,
            verdict: part(rig, "verdict"),
            axes: part(rig, "axes"),
            volume: part(rig, "volume"),
            coverage: part(rig, "coverage"),
            methods: part(rig, "methods").unwrap_or_default(),
        }
    }

    /// Middle of all boards.
    pub fn centre(&self) -> Option<Point3<f64>> {
        let all: Vec<&Point3<f64>> = self.boards.iter().flatten().collect();
        let sum = all.iter().fold(Vector3::zeros(), |s, p| s + p.coords);
        (!all.is_empty()).then(|| (sum / all.len() as f64).into())
    }

    /// What there is to say in millimetres.
    pub fn sentences(&self) -> Vec<String> {
        let mut out = Vec::new();
        if let Some(v) = &self.verdict {
            out.push(format!(
                "On {} boards, each measured with a calibration made without it, squares come out as {} ± {} mm (bias {} mm) and board diagonals of {} mm are wrong by {} ± {} mm, at most {} mm. The thesis reached ± 2.5 mm on court.",
                v.boards,
                fixed(v.squares.mean, 3),
                fixed(v.squares.sd, 3),
                fixed(v.square_bias_mm, 3),
                fixed(v.diagonal_stated_mm, 1),
                fixed(v.diagonal_error_mean_mm, 3),
                fixed(v.diagonal_error_sd_mm, 3),
                fixed(v.diagonal_error_max_mm, 2)
            ));
        }
        if let Some(v) = &self.volume {
            out.push(format!(
                "Inside a cube of {} m side the calibration's own uncertainty of a point is {} mm (rms over the places both cameras see; {} mm at the worst); a pixel noise of {} px comes on top.",
                fixed(v.side_m, 1),
                fixed(v.rms_calibration_mm, 2),
                fixed(v.worst_calibration_mm, 2),
                fixed(v.pixel_sd, 2)
            ));
        }
        if let Some(a) = &self.axes {
            out.push(format!(
                "Global axes: the frame's arms measure {} and {} mm (± {} mm), their angle is off a right angle by {}° ± {}°.",
                fixed(a.arm_u_mm, 1),
                fixed(a.arm_w_mm, 1),
                fixed(a.arm_sd_mm, 1),
                fixed(a.orthogonality_error_deg, 2),
                fixed(a.orthogonality_sd_deg, 2)
            ));
            out.extend(a.warnings.iter().cloned());
        }
        out
    }

    /// Slices of uncertainty, coverage of both pictures, tilts, methods. Figures of one kind share their colours' scale, so
    /// that they can be compared.
    pub fn figures(&self, image_size: [usize; 2]) -> Vec<(String, String)> {
        let mut out = Vec::new();
        if let Some(v) = &self.volume {
            let all = v.slices.iter().flat_map(|s| &s.points).filter(|p| p.in_view).map(total_sd_mm).filter(|s| s.is_finite());
            let range = all.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), s| (a.min(s), b.max(s)));
            for slice in &v.slices {
                out.extend(slice_map(v, slice, range));
            }
        }
        if let Some(c) = &self.coverage {
            let most = c.left_cells.iter().chain(&c.right_cells).flatten().copied().max().unwrap_or(0);
            for (name, cells) in [("left", &c.left_cells), ("right", &c.right_cells)] {
                out.extend(coverage(name, cells, image_size, most));
            }
            out.extend(tilts(c));
        }
        out.extend(self.method_bars());
        out
    }

    /// Thesis figure 2.24 for the user's own pictures.
    fn method_bars(&self) -> Option<(String, String)> {
        if self.methods.is_empty() {
            return None;
        }
        let short = |m: &MethodError| format!("{} ({})", m.method.split(',').next().unwrap_or_default(), m.parameters);
        let names: Vec<String> = self.methods.iter().map(short).collect();
        let bars = |from: f64, pick: fn(&MethodError) -> f64| -> Vec<(f64, f64, f64)> {
            self.methods.iter().enumerate().map(|(i, m)| (i as f64 + from, i as f64 + from + 0.35, pick(m))).collect()
        };
        let chart = Chart::new("Methods compared on the same pictures")
            .x("method", "")
            .x_categories(&names)
            .y("error of lengths", "mm")
            .add(Bars::new(&bars(-0.37, |m| m.mean_error_mm)).name("mean"))
            .add(Bars::new(&bars(0.02, |m| m.max_error_mm)).name("largest"));
        Some((
            chart.to_svg(),
            "Error of distances between corners by each calibration method (as thesis figure 2.24); in brackets the parameters per camera.".to_owned(),
        ))
    }

    pub fn table(&self) -> Table {
        let mut table = Table::new("Methods compared")
            .column("method")
            .numbers("parameters per camera")
            .numbers("mean error (mm)")
            .numbers("largest (mm)")
            .numbers("rms (px)");
        for m in &self.methods {
            table = table.row(&[m.method.clone(), m.parameters.to_string(), fixed(m.mean_error_mm, 3), fixed(m.max_error_mm, 3), fixed(m.rms_px, 3)]);
        }
        table
    }

    /// The sentences, each a paragraph.
    pub fn say(&self, section: Section) -> Section {
        self.sentences().iter().fold(section, |s, line| s.paragraph(line))
    }
}

/// A key of the file in its own type; `None` when it is absent or of another version.
fn part<T: DeserializeOwned>(rig: &StereoRig, key: &str) -> Option<T> {
    serde_json::from_value(rig.more.get(key)?.clone()).ok()
}

/// Root sum of squares over the three axes, calibration and image noise together.
fn total_sd_mm(p: &SlicePoint) -> f64 {
    (Vector3::from(p.calibration_sd_mm).norm_squared() + Vector3::from(p.pixel_sd_mm).norm_squared()).sqrt()
}

fn slice_map(volume: &Volume, slice: &Slice, (low, high): (f64, f64)) -> Option<(String, String)> {
    let names = ['U', 'V', 'W'];
    let fixed_axis = names
        .iter()
        .position(|n| n.eq_ignore_ascii_case(&slice.fixed_axis))
        .or_else(|| ['x', 'y', 'z'].iter().position(|n| n.eq_ignore_ascii_case(&slice.fixed_axis)))?;
    // V upward wherever it is drawn.
    let (across, up) = [(2, 1), (0, 2), (0, 1)][fixed_axis];
    let seen: Vec<_> = slice.points.iter().filter(|p| p.in_view).collect();
    let cells: Vec<(f64, f64, f64)> = seen.iter().map(|p| (p.at_m[across], p.at_m[up], total_sd_mm(p))).collect();
    let pitch = |k: usize| {
        let mut values: Vec<f64> = slice.points.iter().map(|p| p.at_m[k]).collect();
        values.sort_by(f64::total_cmp);
        values.dedup_by(|a, b| (*a - *b).abs() < 1e-6);
        values.windows(2).map(|w| w[1] - w[0]).fold(f64::INFINITY, f64::min)
    };
    let cell = (pitch(across), pitch(up));
    if cells.is_empty() || !(cell.0.is_finite() && cell.1.is_finite()) {
        return None;
    }
    let half = 0.5 * volume.side_m;
    let middle = volume.centre_m;
    let chart = Chart::new(&format!("Uncertainty of a point, {} = {} m", names[fixed_axis], fixed(middle[fixed_axis], 2)))
        .describe("Total standard deviation of a point in a slice of the volume.")
        .size(340.0, 320.0)
        .height_from_width()
        .x(&names[across].to_string(), "m")
        .y(&names[up].to_string(), "m")
        .x_include(middle[across] - half)
        .x_include(middle[across] + half)
        .y_include(middle[up] - half)
        .y_include(middle[up] + half)
        .without_grid()
        .add(Cells::new(&cells, cell, "sd (mm)").range(low, high));
    let caption = format!(
        "Colour: standard deviation of a point (root sum of squares over the three axes), calibration and {} px of image noise together; blank: not in view of both cameras. The slices share one scale.",
        fixed(volume.pixel_sd, 2)
    );
    Some((chart.to_svg(), caption))
}

fn coverage(camera: &str, rows: &[Vec<usize>], image_size: [usize; 2], most: usize) -> Option<(String, String)> {
    let [width, height] = image_size.map(|s| s as f64);
    let cell = (width / rows.first()?.len() as f64, height / rows.len() as f64);
    // Cell i reaches from i to i + 1 cell widths; the first pixel's centre is at 0.
    let middle = |k: usize, side: f64| (k as f64 + 0.5) * side - 0.5;
    let cells: Vec<(f64, f64, f64)> =
        rows.iter().enumerate().flat_map(|(j, row)| row.iter().enumerate().map(move |(i, n)| (middle(i, cell.0), middle(j, cell.1), *n as f64))).collect();
    if cells.is_empty() {
        return None;
    }
    let chart = Chart::new(&format!("Corners over the {camera} picture"))
        .size(340.0, 300.0)
        .height_from_width()
        .x("u", "px")
        .y("v", "px")
        .x_range(-0.5, width - 0.5)
        .y_range(-0.5, height - 0.5)
        .y_reversed()
        .without_grid()
        .describe(&format!("Number of corners in each part of the {camera} picture."))
        .add(Cells::new(&cells, cell, "corners").range(0.0, most.max(1) as f64).numbered());
    Some((
        chart.to_svg(),
        format!("Colour and number: corners found in each part of the {camera} picture, all boards together; dark parts are calibrated by few."),
    ))
}

fn tilts(c: &Coverage) -> Option<(String, String)> {
    let edges = bin_edges(c.left_tilt_deg.iter().chain(&c.right_tilt_deg));
    if edges.is_empty() {
        return None;
    }
    // Side by side within a bin: bars drawn over each other cannot be read.
    let half = |tilts: &[f64], side: f64| -> Vec<(f64, f64, f64)> {
        histogram(tilts, &edges).into_iter().map(|(a, b, n)| (a + 0.5 * side * (b - a), a + 0.5 * (side + 1.0) * (b - a), n)).collect()
    };
    let chart = Chart::new("Tilt of the boards")
        .x("angle between board and image plane", "°")
        .y("number of boards", "")
        .add(Bars::new(&half(&c.left_tilt_deg, 0.0)).name("left camera").colour(Colour::BLUE))
        .add(Bars::new(&half(&c.right_tilt_deg, 1.0)).name("right camera").colour(Colour::ORANGE))
        .add(Rule::vertical(20.0).name("recommended: 20° to 50°"))
        .add(Rule::vertical(50.0));
    let mean = c.left_tilt_deg.iter().chain(&c.right_tilt_deg).sum::<f64>() / (c.left_tilt_deg.len() + c.right_tilt_deg.len()).max(1) as f64;
    Some((chart.to_svg(), format!("Mean tilt {}°: flat boards leave the focal length in doubt.", fixed(mean, 0))))
}
