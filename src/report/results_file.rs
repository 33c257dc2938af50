//! Reads what the commands left in a session's results folder, for its report.

use super::frame_doubt::{Doubt, frames_of_doubt};
use super::session_results::{FramePicture, PredictedShot, SessionResults, ShotResults};
use crate::calibration::StereoRig;
use crate::footage::{Clip, read_grey};
use crate::impact_table::ImpactTable;
use crate::kinematics::{SHOT_FILE, ShotRecord};
use crate::limited_file::{LARGEST_TABLE, read_text};
use crate::session::{Session, ShotFolder};
use crate::tracking::{SpacePoint, TrackRecord, Tracks, read_points};
use serde::de::DeserializeOwned;
use std::fmt::Display;
use std::path::Path;

/// Everything that stands in `results` for this session. A file that is not there is a step not done; one that cannot be
/// read is named among the failures.
pub fn read_session_results(session: &Session, results: &Path) -> SessionResults {
    let mut failed = session.broken_shots.clone();
    let mut steps_failed = Vec::new();
    let rig = read(&results.join("calibration.json"), "calibration", &mut steps_failed, StereoRig::read);
    let mut shots = Vec::new();
    for folder in &session.shots {
        let place = results.join("shots").join(&folder.id);
        let before = failed.len();
        let record = read(&place.join(SHOT_FILE), &folder.id, &mut failed, ShotRecord::read);
        let tracks = read(&place.join("tracks.csv"), &folder.id, &mut failed, Tracks::read);
        let points = read(&place.join("points.csv"), &folder.id, &mut failed, read_points).unwrap_or_default();
        if record.is_none() && failed.len() == before {
            let why = if tracks.is_some() { "tracked, but not measured (see `sweetspot shots`)" } else { "not tracked (see `sweetspot track`)" };
            failed.push((folder.id.clone(), why.to_owned()));
        }
        let tracked = TrackRecord::read(&place).map(|r| r.summary).unwrap_or_default();
        let pictures = tracks.as_ref().map_or_else(Vec::new, |t| pictures(folder, tracked.right_shift, t, &points));
        let recording = if tracks.is_some() { [tracked.notes, tracked.unreadable].concat() } else { Vec::new() };
        shots.push(ShotResults { id: folder.id.clone(), racket: folder.racket.clone(), record, tracks, points, pictures, recording });
    }
    let table = |name: &str, failed: &mut _| read(&results.join(name), name, failed, ImpactTable::read).unwrap_or_default();
    let (measured, predictions) = (table("impacts.csv", &mut steps_failed), table("predictions.csv", &mut steps_failed));
    let deviations = ImpactTable::read(&results.join("predictions_sd.csv")).unwrap_or_default();
    let of = |table: &ImpactTable, id: &str| table.rows.iter().find(|row| row.id == id).cloned();
    let predicted = measured
        .rows
        .into_iter()
        .filter_map(|m| Some(PredictedShot { predicted: of(&predictions, &m.id)?, predicted_sd: of(&deviations, &m.id), measured: m }))
        .collect();
    SessionResults {
        predicted,
        model: None,
        name: session.name.clone(),
        frame_rate_hz: session.frame_rate_hz,
        axes_known: rig.as_ref().is_some_and(StereoRig::axes_known),
        rig,
        shots,
        comparison: json(&results.join("compare.json"), "comparison", &mut steps_failed),
        at_its_best: None,
        diagnosis: json(&results.join("diagnosis.json"), "diagnosis", &mut steps_failed),
        failed,
        steps_failed,
        after: None,
        ledger: Vec::new(),
    }
}

fn read<T, E: Display>(path: &Path, what: &str, failed: &mut Vec<(String, String)>, reader: impl Fn(&Path) -> Result<T, E>) -> Option<T> {
    if !path.exists() {
        return None;
    }
    reader(path).map_err(|why| failed.push((what.to_owned(), why.to_string()))).ok()
}

fn json<T: DeserializeOwned>(path: &Path, what: &str, failed: &mut Vec<(String, String)>) -> Option<T> {
    read(path, what, failed, |p| {
        let text = read_text(p, LARGEST_TABLE).map_err(|e| format!("{}: cannot be read ({e})", p.display()))?;
        serde_json::from_str(&text).map_err(|e| format!("{}: {e}", p.display()))
    })
}

/// Room around the points of a frame, px, and the least size of a piece.
const MARGIN_PX: f64 = 22.0;
const LEAST_PX: f64 = 110.0;

/// Pieces of the frames of doubt. A frame that cannot be read (any more) is left out: the tracks are there all the same.
fn pictures(folder: &ShotFolder, right_shift: i64, tracks: &Tracks, points: &[SpacePoint]) -> Vec<FramePicture> {
    let Ok(clip) = Clip::list(&folder.camera("left"), &folder.camera("right")) else {
        return Vec::new();
    };
    let clip = clip.shifted(right_shift);
    frames_of_doubt(tracks, points).into_iter().filter_map(|d| picture(&clip, tracks, d)).collect()
}

fn picture(clip: &Clip, tracks: &Tracks, doubt: Doubt) -> Option<FramePicture> {
    let pair = clip.pairs.iter().find(|p| p.number == doubt.frame)?;
    let image = read_grey(pair.files[doubt.camera.index()].as_ref()?).ok()?;
    // All targets of the frame and its neighbours, so that a hidden one's place is in the piece too.
    let around = |frame: u64| frame.abs_diff(doubt.frame) <= 3;
    let seen = tracks.points.iter().filter(|p| around(p.frame) && p.camera == doubt.camera).filter_map(|p| p.point);
    let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    for p in seen {
        for k in 0..2 {
            (low[k], high[k]) = (low[k].min(p.uv[k]), high[k].max(p.uv[k]));
        }
    }
    let whole = [image.width as f64, image.height as f64];
    let (mut corner, mut size) = ([0u32; 2], [0u32; 2]);
    for k in 0..2 {
        if !low[k].is_finite() || !high[k].is_finite() {
            return None;
        }
        let (middle, half) = (0.5 * (low[k] + high[k]), (0.5 * (high[k] - low[k]) + MARGIN_PX).max(0.5 * LEAST_PX));
        let from = (middle - half).floor().clamp(0.0, (whole[k] - 1.0).max(0.0));
        let to = (middle + half).ceil().clamp(from + 1.0, whole[k].max(from + 1.0));
        (corner[k], size[k]) = (from as u32, (to - from) as u32);
    }
    let grey = image::GrayImage::from_raw(image.width as u32, image.height as u32, image.pixels)?;
    let piece = image::imageops::crop_imm(&grey, corner[0], corner[1], size[0], size[1]).to_image();
    let mut png = std::io::Cursor::new(Vec::new());
    piece.write_to(&mut png, image::ImageFormat::Png).ok()?;
    Some(FramePicture {
        frame: doubt.frame,
        camera: doubt.camera,
        png: png.into_inner(),
        corner,
        size: [piece.width(), piece.height()],
        words: doubt.words,
        doubt: doubt.score,
    })
}
