//! `sweetspot track`.

use super::Shell;
use super::error::{CliError, existing};
use crate::calibration::StereoRig;
use crate::footage::Clip;
use crate::session::{Session, ShotFolder};
use crate::tracking::spin::{BallSpin, SPIN_FILE, spin_to_json};
use crate::tracking::{PointState, ShotSetup, ShotTracks, TrackingError, points_to_csv, spin_of_shot, track_shot};
use std::path::{Path, PathBuf};

/// Footage to tracks.csv, points.csv and spin.json
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// The session folder (holds session.toml)
    pub session: PathBuf,
    /// Only this shot (may be given more than once)
    #[arg(long, value_name = "ID")]
    pub shot: Vec<String>,
}

/// What `--json` prints for one shot.
#[derive(serde::Serialize)]
struct ShotSummary {
    id: String,
    frames: usize,
    measured: usize,
    occluded: usize,
    contact_frame: Option<f64>,
    notes: Vec<String>,
    error: Option<String>,
}

pub fn run(arguments: Arguments, shell: &Shell) -> Result<(), CliError> {
    let session = Session::open(&arguments.session)?;
    let shots = session.select(&arguments.shot)?;
    let results = shell.results_of_session(&arguments.session);
    let rig = read_rig(&results.join("calibration.json"))?;
    let mut summaries = Vec::new();
    let mut failed: Vec<String> = session.broken_shots.iter().filter(|_| arguments.shot.is_empty()).map(|(id, why)| format!("{id}: {why}")).collect();
    for shot in shots {
        shell.check_cancelled()?;
        let folder = results.join("shots").join(&shot.id);
        if !shell.args.force && folder.join("tracks.csv").exists() && folder.join("points.csv").exists() && folder.join(SPIN_FILE).exists() {
            shell.say(format!("{}: already tracked (--force tracks again)", shot.id));
            continue;
        }
        match one(&session, shot, &rig, shell) {
            Ok((tracked, spin)) => {
                shell.write(&folder.join(SPIN_FILE), spin_to_json(&spin).as_bytes())?;
                shell.write(&folder.join("points.csv"), points_to_csv(&tracked.points).as_bytes())?;
                shell.write(&folder.join("tracks.csv"), tracked.tracks.to_csv().as_bytes())?;
                let summary = summary(&shot.id, &tracked);
                shell.say(format!("{}: {} points measured, {} occluded, in {} frames", shot.id, summary.measured, summary.occluded, summary.frames));
                for note in &summary.notes {
                    shell.say(format!("{}: {note}", shot.id));
                }
                // The shot is measured all the same, but nobody should find out by chance that a picture is broken.
                failed.extend(tracked.unreadable.iter().map(|why| format!("{}: {why}; it counts as missing until it is mended and the shot tracked again with --force", shot.id)));
                summaries.push(summary);
            }
            Err(TrackingError::Cancelled) => return Err(CliError::interrupted()),
            Err(e) => {
                shell.say(format!("{}: {e}", shot.id));
                failed.push(format!("{}: {e}", shot.id));
                summaries.push(ShotSummary { id: shot.id.clone(), frames: 0, measured: 0, occluded: 0, contact_frame: None, notes: Vec::new(), error: Some(e.to_string()) });
            }
        }
    }
    shell.print_json(&summaries)?;
    if failed.is_empty() { Ok(()) } else { Err(CliError::some_failed(failed.join("\n"))) }
}

fn one(session: &Session, shot: &ShotFolder, rig: &StereoRig, shell: &Shell) -> Result<(ShotTracks, BallSpin), TrackingError> {
    let clip = Clip::list(&shot.camera("left"), &shot.camera("right"))?;
    let bar = shell.progress(clip.pairs.len() as u64, "tracking");
    let setup = ShotSetup { rig, racket: &shot.racket, ball: &shot.ball, frame_rate_hz: session.frame_rate_hz };
    let tracked = track_shot(&clip, &setup, shell.cancel_flag(), &|n| bar.inc(n as u64));
    bar.finish_and_clear();
    let tracked = tracked?;
    let spin = spin_of_shot(&clip, &setup, &tracked.tracks, &tracked.points)?;
    Ok((tracked, spin))
}

fn summary(id: &str, tracked: &ShotTracks) -> ShotSummary {
    let measured = tracked.tracks.points.iter().filter(|p| p.state == PointState::Measured).count();
    ShotSummary {
        id: id.to_owned(),
        frames: tracked.tracks.frames().len(),
        measured,
        occluded: tracked.tracks.points.len() - measured,
        contact_frame: tracked.contact_frame,
        notes: tracked.notes.clone(),
        error: None,
    }
}

/// The rig of an earlier `sweetspot calibrate`.
fn read_rig(path: &Path) -> Result<StereoRig, CliError> {
    let path = existing(path, "calibration").map_err(|e| e.hint("run `sweetspot calibrate` on this session first"))?;
    let text = std::fs::read_to_string(path).map_err(|e| CliError::input(format!("{}: cannot be read ({e})", path.display())))?;
    serde_json::from_str(&text).map_err(|e| CliError::input(format!("{}: {e}", path.display())).hint("run `sweetspot calibrate --force` to write it anew"))
}
