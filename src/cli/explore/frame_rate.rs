//! The part of `sweetspot explore` that asks what a slower camera would have got wrong (thesis 4.5.1).

use crate::cli::Shell;
use crate::cli::error::{CliError, with_reasons};
use crate::cli::tracked_session::TrackedSession;
use crate::kinematics::{FrameRateStudy, ShotInput, ShotSpin, frame_rate_study};
use crate::report::frame_rate_page;
use crate::tracking::Tracks;
use rayon::prelude::*;
use std::path::Path;

/// Every second and every fourth frame: 500 and 250 of 1000 frames per second.
const KEEP_EVERY: [usize; 2] = [2, 4];

#[derive(serde::Serialize)]
struct Studies {
    shots: Vec<FrameRateStudy>,
    failed: Vec<(String, String)>,
}

pub fn study_session(folder: &Path, only: &[String], shell: &Shell) -> Result<(), CliError> {
    // What was measured need not be where the study goes.
    let results = shell.results_of_session(folder);
    let tracked = if results.join("calibration.json").exists() {
        TrackedSession::open(folder, shell)?
    } else {
        TrackedSession::open(folder, &shell.with_default_results())?
    };
    let session = &tracked.session;
    let outcomes: Vec<(String, Result<FrameRateStudy, CliError>)> = session
        .select(only)?
        .into_par_iter()
        .map(|shot| {
            let study = || -> Result<FrameRateStudy, CliError> {
                shell.check_cancelled()?;
                let tracks = Tracks::read(&tracked.place(shot).join("tracks.csv"))?;
                let input = ShotInput {
                    id: &shot.id,
                    rig: &tracked.rig,
                    tracks: &tracks,
                    racket: &shot.racket,
                    ball: &shot.ball,
                    spin: &ShotSpin::default(),
                    grip_torque_n_m: shot.grip_torque_n_m,
                    ball_flattening: None,
                    groups: &shot.groups,
                    asked_points: &[],
                };
                Ok(frame_rate_study(&input, &tracked.settings(shot), &KEEP_EVERY)?)
            };
            (shot.id.clone(), study())
        })
        .collect();
    shell.check_cancelled()?;
    let mut studies = Studies { shots: Vec::new(), failed: session.broken_shots.clone() };
    for (id, outcome) in outcomes {
        match outcome {
            Ok(study) => studies.shots.push(study),
            Err(e) => studies.failed.push((id, e.message)),
        }
    }
    if studies.shots.is_empty() {
        let why = with_reasons(&studies.failed, "\n  ");
        return Err(CliError::input(format!("no shot could be measured:\n  {why}")).hint("run `sweetspot track` and `sweetspot shots` first"));
    }
    let (page, figures) = frame_rate_page(&session.name, &studies.shots);
    for (name, svg) in &figures {
        shell.write(&results.join("frame-rate").join(format!("{name}.svg")), svg.as_bytes())?;
    }
    let text = serde_json::to_string_pretty(&studies).map_err(CliError::output)?;
    shell.write(&results.join("explore-frame-rate.json"), text.as_bytes())?;
    let path = results.join("explore-frame-rate.html");
    shell.write(&path, page.as_bytes())?;
    shell.say(format_args!("written: {}", path.display()));
    shell.print_json(&studies)?;
    if studies.failed.is_empty() {
        return Ok(());
    }
    Err(CliError::some_failed(format!("{} shots failed:\n  {}", studies.failed.len(), with_reasons(&studies.failed, "\n  "))))
}
