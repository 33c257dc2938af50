//! Tracks over the frames around the impact: frames of doubt first, then paths in both pictures and what was seen when.

use super::shots::shot_heading;
use crate::calibration::CameraId;
use crate::report::chart::{Chart, Colour, Line, Picture, Points, Rule, Symbol};
use crate::report::frame_doubt::impact_frame;
use crate::report::markup::fixed;
use crate::report::page::{Layout, Section};
use crate::report::session_results::{FramePicture, SessionResults, ShotResults};
use crate::tracking::{PointState, SpacePoint, Target, Tracks};

/// Frames drawn on either side of the impact.
const AROUND: u64 = 20;
/// Pictures shown for the whole session, those in greatest doubt; all shots' charts are folded below.
const MOST_PICTURES: usize = 12;
/// Notes on the recording shown at once.
const MOST_FAULTS: usize = 10;

pub fn tracks(results: &SessionResults) -> Option<Section> {
    let shots: Vec<&ShotResults> = results.shots.iter().filter(|s| s.tracks.is_some() || !s.pictures.is_empty()).collect();
    if shots.is_empty() {
        return None;
    }
    let mut section = Section::new("tracks", "Tracks");
    let mut pictures: Vec<(&ShotResults, &FramePicture)> = shots.iter().flat_map(|s| s.pictures.iter().map(move |p| (*s, p))).collect();
    pictures.sort_by(|a, b| b.1.doubt.total_cmp(&a.1.doubt).then_with(|| (&a.0.id, a.1.frame, a.1.camera).cmp(&(&b.0.id, b.1.frame, b.1.camera))));
    let shown: Vec<(String, String)> = pictures.iter().take(MOST_PICTURES).map(|(shot, p)| (overlay(shot, p), p.words.clone())).collect();
    let faults: Vec<String> = shots.iter().flat_map(|s| s.recording.iter().map(|note| format!("{}: {note}", s.id))).collect();
    if faults.len() > MOST_FAULTS {
        section = section.folded(&format!("What tracking says of the recording ({} notes)", faults.len()), |s| s.list(&faults));
    } else if !faults.is_empty() {
        section = section.heading("What tracking says of the recording").list(&faults);
    }
    if !shown.is_empty() {
        section = section
            .heading("Frames of doubt first, then the impacts")
            .note("Rings mark what was measured in this frame; dotted: the path through the neighbouring frames. What has no ring was not measured.")
            .figures(Layout::Normal, &shown);
    }
    section = section.note("Paths of the five markers and the ball in both pictures, from 20 frames before to 20 after the impact (as far as the recording goes), and beside them what was measured in which frame. A hidden point is never drawn.");
    for (k, shot) in shots.iter().enumerate() {
        let Some(tracks) = &shot.tracks else { continue };
        let figures = shot_figures(shot, tracks);
        if k == 0 {
            section = section.heading(&shot_heading(&shot.id)).figures(Layout::Normal, &figures);
        } else {
            section = section.folded(&shot_heading(&shot.id), |s| s.figures(Layout::Normal, &figures));
        }
    }
    Some(section)
}

/// A piece of the frame with what was measured in it.
fn overlay(shot: &ShotResults, picture: &FramePicture) -> String {
    let camera = picture.camera.name();
    let (corner, size) = (picture.corner.map(f64::from), picture.size.map(f64::from));
    let mut chart = Chart::new(&format!("{}, frame {}, {camera}", shot.id, picture.frame))
        .describe(&picture.words)
        .size(340.0, 340.0)
        .height_from_width()
        .x("u", "px")
        .y("v", "px")
        .x_range(corner[0] - 0.5, corner[0] + size[0] - 0.5)
        .y_range(corner[1] - 0.5, corner[1] + size[1] - 0.5)
        .y_reversed()
        .without_grid()
        .add(Picture::new(&picture.png, (corner[0], corner[1]), (size[0], size[1])));
    let Some(tracks) = &shot.tracks else { return chart.to_svg() };
    for (k, target) in Target::ALL.iter().enumerate() {
        let near = (picture.frame.saturating_sub(3)..=picture.frame.saturating_add(3)).map(|f| tracks.get(f, picture.camera, *target));
        let path: Vec<(f64, f64)> = near.map(|p| p.map_or((f64::NAN, f64::NAN), |i| (i.uv.x, i.uv.y))).collect();
        let colour = target_colour(k);
        chart = chart.add(Line::new(&path).colour(colour).width(0.9).dotted());
        if let Some(p) = tracks.get(picture.frame, picture.camera, *target) {
            chart = chart.add(Points::new(&[(p.uv.x, p.uv.y)]).symbol(Symbol::Ring).size(9.0).colour(colour).name(target.name()));
        }
    }
    chart.to_svg()
}

/// The ball is blue, markers take the other colours.
fn target_colour(index: usize) -> Colour {
    if Target::ALL.get(index) == Some(&Target::Ball) { Colour::BLUE } else { Colour::of_series(index + 1) }
}

fn shot_figures(shot: &ShotResults, tracks: &Tracks) -> Vec<(String, String)> {
    let impact = impact_frame(tracks, &shot.points).unwrap_or(0);
    let (from, to) = (impact.saturating_sub(AROUND), impact.saturating_add(AROUND));
    let mut figures: Vec<(String, String)> = CameraId::BOTH.iter().map(|c| (paths(tracks, *c, from, to), String::new())).collect();
    figures.push((seen(tracks, impact), "What was measured when; blank: hidden or not found.".to_owned()));
    if let Some(svg) = residuals(shot, from, to) {
        figures.push((svg, "Distance between the two cameras' views of each point, in the pictures: small when tracks and calibration agree.".to_owned()));
    }
    figures
}

fn paths(tracks: &Tracks, camera: CameraId, from: u64, to: u64) -> String {
    let mut chart = Chart::new(&format!("Paths in the {} picture", camera.name()))
        .describe("Paths of markers and ball in the picture.")
        .size(340.0, 340.0)
        .height_from_width()
        .x("u", "px")
        .y("v", "px")
        .y_reversed();
    for (k, target) in Target::ALL.iter().enumerate() {
        let at: Vec<(f64, f64)> = tracks
            .points
            .iter()
            .filter(|p| p.camera == camera && p.target == *target && (from..=to).contains(&p.frame))
            .map(|p| p.point.map_or((f64::NAN, f64::NAN), |i| (i.uv.x, i.uv.y)))
            .collect();
        if at.iter().all(|p| !p.0.is_finite()) {
            continue;
        }
        let (colour, symbol) = (target_colour(k), Symbol::of_series(k));
        chart = chart.add(Line::new(&at).colour(colour).width(0.8)).add(Points::new(&at).symbol(symbol).size(3.4).colour(colour).name(target.name()));
    }
    chart.to_svg()
}

/// One row per target and camera, one column per frame.
fn seen(tracks: &Tracks, impact: u64) -> String {
    let mut names = Vec::new();
    let mut chart = Chart::new("What was seen").size(340.0, 250.0).x("frame from impact", "").without_grid();
    let (mut measured, mut manual) = (Vec::new(), Vec::new());
    for camera in CameraId::BOTH {
        for target in Target::ALL.iter().rev() {
            let row = names.len() as f64;
            names.push(format!("{} {}", target.name(), camera.name()));
            for p in tracks.points.iter().filter(|p| p.camera == camera && p.target == *target) {
                let x = p.frame as f64 - impact as f64;
                match p.state {
                    PointState::Measured => measured.push((x, row)),
                    PointState::Manual => manual.push((x, row)),
                    PointState::Occluded => {}
                }
            }
        }
    }
    chart = chart.y_categories(&names).add(Points::new(&measured).symbol(Symbol::Square).size(4.0).name("measured"));
    if !manual.is_empty() {
        chart = chart.add(Points::new(&manual).symbol(Symbol::Square).size(4.0).name("by hand"));
    }
    chart.add(Rule::vertical(0.0).name("impact")).to_svg()
}

fn residuals(shot: &ShotResults, from: u64, to: u64) -> Option<String> {
    // A ball on the strings is measured by both cameras as one place: they cannot disagree.
    let told = |p: &&SpacePoint| p.residual_px.is_finite() && (p.target != Target::Ball || p.residual_px > 0.0);
    let near: Vec<_> = shot.points.iter().filter(|p| (from..=to).contains(&p.frame)).filter(told).collect();
    if near.is_empty() {
        return None;
    }
    let of = |ball: bool| -> Vec<(f64, f64)> { near.iter().filter(|p| (p.target == Target::Ball) == ball).map(|p| (1000.0 * p.t, p.residual_px)).collect() };
    let worst = near.iter().map(|p| p.residual_px).fold(0.0, f64::max);
    let chart = Chart::new("Agreement of the two views")
        .x("time from impact", "ms")
        .y("residual", "px")
        .y_include(0.0)
        .add(Points::new(&of(true)).name("ball").colour(Colour::BLUE))
        .add(Points::new(&of(false)).name("markers").symbol(Symbol::Square).size(3.2).colour(Colour::ORANGE))
        .add(Rule::vertical(0.0))
        .note(&format!("largest: {} px", fixed(worst, 2)));
    Some(chart.to_svg())
}
