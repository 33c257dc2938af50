//! Reads what the commands left in a session's results folder, for its report.

use super::session_results::{SessionResults, ShotResults};
use crate::calibration::StereoRig;
use crate::kinematics::{SHOT_FILE, ShotRecord};
use crate::session::Session;
use crate::tracking::{Tracks, read_points};
use serde::de::DeserializeOwned;
use std::path::Path;

/// Everything that stands in `results` for this session. A file that is not there is a step not done; one that cannot be
/// read is named among the failures.
pub fn read_session_results(session: &Session, results: &Path) -> SessionResults {
    let mut failed = session.broken_shots.clone();
    let rig = json::<StereoRig>(&results.join("calibration.json"), "calibration", &mut failed);
    let mut shots = Vec::new();
    for folder in &session.shots {
        let place = results.join("shots").join(&folder.id);
        let before = failed.len();
        let record = read(&place.join(SHOT_FILE), &folder.id, &mut failed, |p| ShotRecord::read(p).map_err(|e| e.to_string()));
        let tracks = read(&place.join("tracks.csv"), &folder.id, &mut failed, |p| Tracks::read(p).map_err(|e| e.to_string()));
        let points = read(&place.join("points.csv"), &folder.id, &mut failed, |p| read_points(p).map_err(|e| e.to_string())).unwrap_or_default();
        if record.is_none() && failed.len() == before {
            let why = if tracks.is_some() { "tracked, but not measured (see `sweetspot shots`)" } else { "not tracked (see `sweetspot track`)" };
            failed.push((folder.id.clone(), why.to_owned()));
        }
        shots.push(ShotResults { id: folder.id.clone(), racket: folder.racket.clone(), record, tracks, points, pictures: Vec::new() });
    }
    SessionResults {
        name: session.name.clone(),
        frame_rate_hz: session.frame_rate_hz,
        rig,
        axes_known: session.axes.is_some(),
        shots,
        comparison: json(&results.join("compare.json"), "comparison", &mut failed),
        diagnosis: json(&results.join("diagnosis.json"), "diagnosis", &mut failed),
        failed,
        after: None,
        ledger: Vec::new(),
    }
}

fn read<T>(path: &Path, what: &str, failed: &mut Vec<(String, String)>, reader: impl Fn(&Path) -> Result<T, String>) -> Option<T> {
    if !path.exists() {
        return None;
    }
    reader(path).map_err(|why| failed.push((what.to_owned(), why))).ok()
}

fn json<T: DeserializeOwned>(path: &Path, what: &str, failed: &mut Vec<(String, String)>) -> Option<T> {
    read(path, what, failed, |p| {
        let text = std::fs::read_to_string(p).map_err(|e| format!("{}: cannot be read ({e})", p.display()))?;
        serde_json::from_str(&text).map_err(|e| format!("{}: {e}", p.display()))
    })
}
