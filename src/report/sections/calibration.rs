//! The calibration: verdict in mm, cameras and boards in the room, reprojection errors, what became of each pair.

use super::calibration_detail::CalibrationDetail;
use super::room::{Room, camera_corners};
use crate::calibration::{CAMERA_NAMES, Camera, CameraId, StereoRig};
use crate::report::chart::{Arrows, Bars, Chart, Colour, Legend, Points, Rule, Scene, Symbol};
use crate::report::markup::{fixed, plain, significant, with_sd};
use crate::report::page::{Layout, Section, Table};

/// The section on a rig; `axes_known` is false when the global axes are the left camera's own.
pub fn calibration(rig: &StereoRig, axes_known: bool) -> Section {
    let detail = CalibrationDetail::of(rig);
    let mut section = detail.say(Section::new("calibration", "Calibration").cards(&cards(rig))).list(&detail.advice);
    let mut figures = vec![(scene(rig, &detail, axes_known), "Cameras and checkerboard positions in a fixed oblique view.".to_owned())];
    figures.extend(
        volume(rig, &detail, axes_known)
            .map(|svg| (svg, "The boards alone: where they stood, the calibration is tested; elsewhere it is extrapolated.".to_owned())),
    );
    figures.extend(scatter(&detail).map(|svg| {
        (svg, "Reprojection error of every corner: a round cloud without direction is what a good camera model leaves (thesis figure 3.9).".to_owned())
    }));
    let factor = arrow_factor(rig, &detail);
    for camera in CameraId::BOTH {
        figures.extend(quiver(rig, &detail, camera, factor).map(|svg| {
            let caption = format!(
                "Reprojection errors (found less projected) where corners were seen, drawn {factor:.0} times their length: an arrow of 100 px on the axes is an error of {} px. Blank parts of the picture were never calibrated.",
                plain(100.0 / factor)
            );
            (svg, caption)
        }));
    }
    figures.extend(
        pair_errors(rig).map(|svg| (svg, "Root mean square over the corners of each pair used, both cameras; one that sticks out is worth a look.".to_owned())),
    );
    section = section.figures(Layout::Normal, &figures).figures(Layout::Normal, &detail.figures(rig.image_size));
    section = section.table(cameras(rig)).table(detail.table());
    let dropped: Vec<String> = rig.pairs.iter().filter(|p| !p.reason.is_empty()).map(|p| format!("{}: {}", p.name, p.reason)).collect();
    if !dropped.is_empty() {
        section = section.heading("Pairs left out or used in part").list(&dropped);
    }
    section
}

fn cards(rig: &StereoRig) -> Vec<(String, String)> {
    let mut cards = Vec::new();
    if let Some(s) = &rig.square_mm {
        cards.push((
            format!("{} ± {} mm", fixed(s.mean, 2), fixed(s.sd, 2)),
            format!("checkerboard squares re-measured in 3-D on boards held out (n = {}; ±: one sd)", s.n),
        ));
    }
    cards.push((format!("{} px", fixed(rig.rms_stereo_px, 3)), "rms reprojection error, both cameras".to_owned()));
    let used = rig.pairs.iter().filter(|p| p.used).count();
    if !rig.pairs.is_empty() {
        cards.push((format!("{used} of {}", rig.pairs.len()), "checkerboard pairs used (recommended: 20 or more, 40 for a volume of 2 m)".to_owned()));
    }
    let baseline = nalgebra::Vector3::from(rig.t).norm();
    let angle = (rig.right_from_left().rotation.angle()).to_degrees();
    cards.push((format!("{} m, {}°", fixed(baseline, 2), fixed(angle, 1)), "distance between the cameras and angle between their views".to_owned()));
    cards
}

fn scene(rig: &StereoRig, detail: &CalibrationDetail, axes_known: bool) -> String {
    let room = Room { axes_known };
    let mut scene = Scene::new("Cameras and boards").axis_names(room.axis_names());
    let focus = detail.centre().unwrap_or_else(|| rig.centre(CameraId::Left) + 3.0 * camera_corners(rig, CameraId::Left)[0]);
    for id in CameraId::BOTH {
        let centre = rig.centre(id);
        let size = 0.16 * (focus - centre).norm();
        scene = scene.camera(room.point(&centre), &camera_corners(rig, id).map(|c| room.vector(&c)), size, id.name());
    }
    boards(scene, detail, room).describe(&format!("Two cameras and {} checkerboard positions.", detail.boards.len())).to_svg()
}

/// The boards alone, large: far cameras leave little of them in the other view.
fn volume(rig: &StereoRig, detail: &CalibrationDetail, axes_known: bool) -> Option<String> {
    let room = Room { axes_known };
    let centre = detail.centre()?;
    let mut scene = Scene::new("The calibrated volume").axis_names(room.axis_names());
    let reach = detail.boards.iter().flatten().map(|p| (p - centre).norm()).fold(0.0, f64::max);
    for (id, colour) in [(CameraId::Left, Colour::ORANGE), (CameraId::Right, Colour::GREEN)] {
        let toward = (rig.centre(id) - centre).normalize() * 0.6 * reach;
        scene = scene.arrow(room.point(&centre), room.vector(&toward), &format!("to the {} camera", id.name()), colour);
    }
    Some(boards(scene, detail, room).describe("Board positions in the calibrated volume.").to_svg())
}

fn boards(mut scene: Scene, detail: &CalibrationDetail, room: Room) -> Scene {
    for (k, board) in detail.boards.iter().enumerate() {
        let corners: Vec<_> = board.iter().map(|p| room.point(p)).collect();
        scene = scene.outline(&corners, if k == 0 { "boards" } else { "" }, Colour::BLUE);
    }
    scene
}

fn scatter(detail: &CalibrationDetail) -> Option<String> {
    if detail.corners.is_empty() {
        return None;
    }
    let of = |id: CameraId| -> Vec<(f64, f64)> { detail.corners.iter().filter(|c| c.camera == id).map(|c| c.error).collect() };
    let (left, right) = (of(CameraId::Left), of(CameraId::Right));
    let chart = Chart::new("Reprojection error")
        .describe(&format!("{} corners of the left and {} of the right camera.", left.len(), right.len()))
        .size(340.0, 320.0)
        .x("error along u", "px")
        .y("error along v", "px")
        .equal_scales()
        .add(Points::new(&left).name("left").size(2.4))
        .add(Points::new(&right).name("right").symbol(Symbol::Square).size(2.6))
        .add(Rule::horizontal(0.0))
        .add(Rule::vertical(0.0));
    Some(chart.to_svg())
}

/// Most arrows of a quiver; more would only be grey.
const MOST_ARROWS: usize = 700;

/// How many times their length errors are drawn, the same for both cameras: a typical arrow is a thirtieth of the picture
/// long. One, two or five times a power of ten, so that lengths can be read off the axes.
fn arrow_factor(rig: &StereoRig, detail: &CalibrationDetail) -> f64 {
    let squares = detail.corners.iter().map(|c| c.error.0.powi(2) + c.error.1.powi(2));
    let rms = (squares.sum::<f64>() / detail.corners.len().max(1) as f64).sqrt().max(1e-6);
    let wanted = (0.03 * rig.image_size[0] as f64 / rms).max(1.0);
    let power = 10f64.powf(wanted.log10().floor());
    power * [5.0, 2.0, 1.0].into_iter().find(|f| f * power <= wanted).unwrap_or(1.0)
}

fn quiver(rig: &StereoRig, detail: &CalibrationDetail, camera: CameraId, factor: f64) -> Option<String> {
    let corners: Vec<_> = detail.corners.iter().filter(|c| c.camera == camera).collect();
    if corners.is_empty() {
        return None;
    }
    let every = corners.len().div_ceil(MOST_ARROWS);
    let from: Vec<(f64, f64)> = corners.iter().step_by(every).map(|c| c.at).collect();
    let by: Vec<(f64, f64)> = corners.iter().step_by(every).map(|c| c.error).collect();
    let [width, height] = rig.image_size.map(|s| s as f64);
    let chart = Chart::new(&format!("Reprojection error over the {} picture", camera.name()))
        .size(340.0, 340.0)
        .height_from_width()
        .x("u", "px")
        .y("v", "px")
        .x_range(0.0, width)
        .y_range(0.0, height)
        .y_reversed()
        .add(Arrows::new(&from, &by, factor).name(&format!("error × {factor:.0} (100 px: {} px)", plain(100.0 / factor))));
    Some(chart.to_svg())
}

/// Pairs whose names stand under their bars.
const MOST_NAMED: usize = 24;

fn pair_errors(rig: &StereoRig) -> Option<String> {
    let pairs: Vec<(&str, f64)> = rig.pairs.iter().filter(|p| p.used).filter_map(|p| Some((p.name.as_str(), p.rms_px?))).collect();
    if pairs.is_empty() {
        return None;
    }
    // Pairs by their names while these find room; a season's worth of pairs by their order.
    let named = pairs.len() <= MOST_NAMED;
    let first = if named { 0.0 } else { 1.0 };
    let bars: Vec<(f64, f64, f64)> = pairs.iter().enumerate().map(|(i, (_, e))| (first + i as f64 - 0.4, first + i as f64 + 0.4, *e)).collect();
    let names: Vec<String> = if named { pairs.iter().map(|(name, _)| (*name).to_owned()).collect() } else { Vec::new() };
    let worst = pairs.iter().max_by(|a, b| a.1.total_cmp(&b.1));
    let chart = Chart::new("Error of each pair")
        .describe(&format!("{} pairs.", pairs.len()))
        .x(if named { "pair used" } else { "pair used, in order" }, "")
        .x_categories(&names)
        .y("rms reprojection error", "px")
        .legend(Legend::Hidden)
        .add(Bars::new(&bars));
    Some(worst.map_or(chart.clone(), |(name, e)| chart.note(&format!("worst: {name}, {} px", fixed(*e, 3)))).to_svg())
}

fn cameras(rig: &StereoRig) -> Table {
    let mut table = Table::new("Camera parameters (± one standard deviation); distortion as OpenCV has it, of coordinates in units of the focal length")
        .column("parameter")
        .column("unit")
        .numbers("left")
        .numbers("right");
    let show = |c: &Camera, name: &str, value: f64| c.sd.get(name).map_or_else(|| significant(value, 5), |sd| with_sd(value, *sd));
    let meaning = |k: usize| match k {
        0 | 1 => "focal length",
        2 | 3 => "principal point",
        6 | 7 => "tangential distortion",
        _ => "radial distortion",
    };
    let pick = |c: &Camera, k: usize| -> (&'static str, f64) {
        let values = [c.fx, c.fy, c.cx, c.cy, c.distortion[0], c.distortion[1], c.distortion[2], c.distortion[3], c.distortion[4]];
        (CAMERA_NAMES[k], values[k])
    };
    for k in 0..9 {
        let ((name, l), (_, r)) = (pick(&rig.left, k), pick(&rig.right, k));
        if k >= 4 && l == 0.0 && r == 0.0 {
            continue;
        }
        table = table.row(&[format!("{name}, {}", meaning(k)), if k < 4 { "px" } else { "1" }.to_owned(), show(&rig.left, name, l), show(&rig.right, name, r)]);
    }
    table = table.row(&["rms reprojection error".to_owned(), "px".to_owned(), fixed(rig.left.rms_px, 3), fixed(rig.right.rms_px, 3)]);
    table
}
