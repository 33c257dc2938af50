//! Tracks over the frames around the impact: frames of doubt first, then paths in both pictures and what was seen when.

use crate::calibration::CameraId;
use crate::report::chart::{Chart, Colour, Legend, Line, Points, Rule, SERIES, Symbol};
use crate::report::markup::fixed;
use crate::report::page::{Layout, Section};
use crate::report::session_results::{SessionResults, ShotResults};
use crate::tracking::{PointState, Target, Tracks};

/// Frames drawn on either side of the impact.
const AROUND: u64 = 20;
/// Pictures shown for the whole session, those in greatest doubt; all shots' charts are folded below.
const MOST_PICTURES: usize = 12;

pub fn tracks(results: &SessionResults) -> Option<Section> {
    let shots: Vec<&ShotResults> = results.shots.iter().filter(|s| s.tracks.is_some() || !s.pictures.is_empty()).collect();
    if shots.is_empty() {
        return None;
    }
    let mut section = Section::new("tracks", "Tracks");
    let mut pictures: Vec<(&str, &crate::report::session_results::FramePicture)> =
        shots.iter().flat_map(|s| s.pictures.iter().map(|p| (s.id.as_str(), p))).collect();
    pictures.sort_by(|a, b| b.1.doubt.total_cmp(&a.1.doubt).then_with(|| (a.0, a.1.frame, a.1.camera).cmp(&(b.0, b.1.frame, b.1.camera))));
    let shown: Vec<(Vec<u8>, String)> =
        pictures.iter().take(MOST_PICTURES).map(|(id, p)| (p.png.clone(), format!("{id}, frame {}, {}: {}", p.frame, p.camera.name(), p.words))).collect();
    if !shown.is_empty() {
        section = section.heading("Frames of doubt first").pictures(Layout::Small, &shown);
    }
    section = section.note("Paths of the five markers and the ball in both pictures, from 20 frames before to 20 after the impact, and below them what was measured in which frame. A hidden point is never drawn.");
    for (k, shot) in shots.iter().enumerate() {
        let Some(tracks) = &shot.tracks else { continue };
        let figures = shot_figures(shot, tracks);
        if k == 0 {
            section = section.heading(&format!("Shot {}", shot.id)).figures(Layout::Normal, &figures);
        } else {
            section = section.folded(&format!("Shot {}", shot.id), |s| s.figures(Layout::Normal, &figures));
        }
    }
    Some(section)
}

/// Frame at t = 0 of the reconstructed points, or the middle of the tracks.
fn impact_frame(shot: &ShotResults, tracks: &Tracks) -> u64 {
    let nearest = shot.points.iter().filter(|p| p.t.is_finite()).min_by(|a, b| a.t.abs().total_cmp(&b.t.abs()));
    let frames = tracks.frames();
    nearest.map(|p| p.frame).or_else(|| frames.get(frames.len() / 2).copied()).unwrap_or(0)
}

fn shot_figures(shot: &ShotResults, tracks: &Tracks) -> Vec<(String, String)> {
    let impact = impact_frame(shot, tracks);
    let (from, to) = (impact.saturating_sub(AROUND), impact.saturating_add(AROUND));
    let mut figures: Vec<(String, String)> = CameraId::BOTH.iter().map(|c| (paths(tracks, *c, from, to), String::new())).collect();
    figures.push((seen(tracks, impact), "What was measured when; blank: hidden or not found.".to_owned()));
    if let Some(svg) = residuals(shot, from, to) {
        figures.push((svg, "Distance between the two cameras' views of each point, in the pictures: small when tracks and calibration agree.".to_owned()));
    }
    figures
}

fn paths(tracks: &Tracks, camera: CameraId, from: u64, to: u64) -> String {
    let mut chart = Chart::new(&format!("{} picture", if camera == CameraId::Left { "Left" } else { "Right" }))
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
        let colour = SERIES[(k + 1) % SERIES.len()];
        let symbol = Symbol::SERIES[k % Symbol::SERIES.len()];
        let colour = if *target == Target::Ball { Colour::BLUE } else { colour };
        chart = chart.add(Line::new(&at).colour(colour).width(0.8)).add(Points::new(&at).symbol(symbol).size(3.4).colour(colour).name(target.name()));
    }
    chart.to_svg()
}

/// One row per target and camera, one column per frame.
fn seen(tracks: &Tracks, impact: u64) -> String {
    let mut names = Vec::new();
    let mut chart = Chart::new("What was seen").size(340.0, 250.0).x("frame from impact", "").without_grid().legend(Legend::Above);
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
    let near: Vec<_> = shot.points.iter().filter(|p| (from..=to).contains(&p.frame) && p.residual_px.is_finite()).collect();
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
