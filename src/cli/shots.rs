//! `sweetspot shots`.

use super::Shell;
use super::error::CliError;
use crate::calibration::StereoRig;
use crate::impact_table::ImpactTable;
use crate::kinematics::{
    GroupStatistic, MeasureSettings, RiseInterval, SHOT_FILE, Shot, ShotInput, ShotRecord, ShotSpin, SpinComponent, SpinVector, TapeErrors, measure_shot, rise_table,
    season_statistics, season_to_csv,
};
use crate::provenance::Provenance;
use crate::report::season_figures;
use crate::equipment::Racket;
use crate::session::{Session, ShotFolder};
use crate::tracking::spin::{SPIN_FILE, SpinEstimate, read_spin};
use crate::tracking::{RacketFigure, Tracks, points_to_csv};
use nalgebra::Vector2;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Tracks to shot.json and impacts.csv
///
/// Measures every shot of the session that has tracks: the motions of ball and racket on both sides of the contact, the
/// impact, and all shot characteristics with their uncertainty.
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// The session folder (holds session.toml)
    pub session: PathBuf,
    /// Also give the velocity of this point of the face, m from the stringbed centre (may be given more than once)
    #[arg(long, value_name = "X,Y", value_parser = parse_point, allow_hyphen_values = true)]
    pub point: Vec<Vector2<f64>>,
}

fn parse_point(text: &str) -> Result<Vector2<f64>, String> {
    let parts: Vec<f64> = text.split(',').map(|p| p.trim().parse::<f64>()).collect::<Result<_, _>>().map_err(|e| format!("{text:?}: {e}; give X,Y in metres"))?;
    match parts[..] {
        [x, y] if x.abs() < 1.0 && y.abs() < 1.0 => Ok(Vector2::new(x, y)),
        _ => Err(format!("{text:?}; give X,Y in metres from the stringbed centre, each below 1 m")),
    }
}

#[derive(serde::Serialize)]
struct Summary {
    impacts: PathBuf,
    shots: Vec<ShotRecord>,
    failed: Vec<(String, String)>,
}

pub fn run(arguments: Arguments, shell: &Shell) -> Result<(), CliError> {
    let session = Session::open(&arguments.session)?;
    let results = shell.results_of_session(&arguments.session);
    let rig_file = results.join("calibration.json");
    let rig = read_rig(&rig_file)?;
    if session.shots.is_empty() && session.broken_shots.is_empty() {
        return Err(CliError::input(format!("{}: the session has no shots; put each in shots/<id>/left and right", arguments.session.display())));
    }
    let tapes = tapes(&session, &rig, &results, shell);
    let bar = shell.progress(session.shots.len() as u64, "shots");
    let outcomes: Vec<(String, Result<ShotRecord, CliError>)> = session
        .shots
        .par_iter()
        .map(|folder| {
            let outcome = shell.check_cancelled().and_then(|()| one_shot(&session, folder, &rig, &rig_file, &results, &tapes, &arguments, shell));
            bar.inc(1);
            (folder.id.clone(), outcome)
        })
        .collect();
    bar.finish_and_clear();
    shell.check_cancelled()?;
    let mut failed: Vec<(String, String)> = session.broken_shots.clone();
    let mut shots = Vec::new();
    for (id, outcome) in outcomes {
        match outcome {
            Ok(record) => shots.push(record),
            Err(e) => failed.push((id, e.message)),
        }
    }
    failed.sort();
    let impacts = results.join("impacts.csv");
    if !shots.is_empty() {
        let table = ImpactTable { rows: shots.iter().enumerate().map(|(k, r)| r.shot.impact_row(k as f64)).collect() };
        shell.write(&impacts, table.to_csv().as_bytes())?;
        write_season(&session, &shots, &results, shell)?;
    }
    shell.say(format_args!("{} of {} shots measured: {}", shots.len(), shots.len() + failed.len(), impacts.display()));
    let summary = Summary { impacts, shots, failed };
    shell.print_json(&summary)?;
    if summary.failed.is_empty() {
        return Ok(());
    }
    let lines: Vec<String> = summary.failed.iter().map(|(id, why)| format!("{id}: {why}")).collect();
    let message = format!("{} of {} shots failed:\n  {}", lines.len(), summary.shots.len() + lines.len(), lines.join("\n  "));
    Err(if summary.shots.is_empty() { CliError::input(message) } else { CliError::some_failed(message) })
}

#[derive(serde::Serialize)]
struct Season {
    statistics: Vec<GroupStatistic>,
    /// Table 5.9b: forward speed of the incoming ball by its vertical velocity.
    rise: Vec<RiseInterval>,
}

/// The session as a whole: `season.csv`, `season.json`, and the figures of chapter 5 as `season/*.svg`.
fn write_season(session: &Session, records: &[ShotRecord], results: &Path, shell: &Shell) -> Result<(), CliError> {
    let shots: Vec<&Shot> = records.iter().map(|r| &r.shot).collect();
    let season = Season { statistics: season_statistics(&shots), rise: rise_table(&shots) };
    shell.write(&results.join("season.csv"), season_to_csv(&season.statistics).as_bytes())?;
    let json = serde_json::to_string_pretty(&season).map_err(CliError::output)? + "\n";
    shell.write(&results.join("season.json"), json.as_bytes())?;
    for figure in season_figures(&shots, Some(&session.racket)) {
        shell.write(&results.join("season").join(format!("{}.svg", figure.name)), figure.svg.as_bytes())?;
    }
    Ok(())
}

/// How a session's shot is measured.
pub(super) fn settings_of(session: &Session, folder: &ShotFolder) -> MeasureSettings {
    let mut settings = MeasureSettings::new(session.frame_rate_hz, session.exposure_s);
    settings.impact_frame = folder.impact_frame;
    settings.axes_known = session.axes.is_some();
    settings
}

/// The rig of `calibration.json`.
pub(super) fn read_rig(path: &Path) -> Result<StereoRig, CliError> {
    let text = std::fs::read_to_string(path)
        .map_err(|e| CliError::input(format!("{}: cannot be read ({e})", path.display())).hint("run `sweetspot calibrate SESSION` first"))?;
    serde_json::from_str(&text).map_err(|e| CliError::input(format!("{}: {e}", path.display())).hint("run `sweetspot calibrate --force SESSION`"))
}

/// What the tracks of the session say about each racket's tape. Damaged tracks are named when their shot is measured.
fn tapes(session: &Session, rig: &StereoRig, results: &Path, shell: &Shell) -> BTreeMap<String, TapeErrors> {
    let mut by_racket: BTreeMap<&str, (&Racket, Vec<Tracks>)> = BTreeMap::new();
    for folder in &session.shots {
        let Ok(tracks) = Tracks::read(&results.join("shots").join(&folder.id).join("tracks.csv")) else { continue };
        by_racket.entry(&folder.racket.name).or_insert((&folder.racket, Vec::new())).1.push(tracks);
    }
    let mut tapes = BTreeMap::new();
    for (name, (racket, tracks)) in by_racket {
        let Some(figure) = RacketFigure::of(racket) else { continue };
        let tape = TapeErrors::of(rig, &figure, &tracks.iter().collect::<Vec<_>>());
        let throat = tape.throat_angle_rad.map_or_else(String::new, |a| format!(", throat at {:.1}° from the axis", a.to_degrees()));
        shell.say(format_args!("tape of {name}: seen {:.2} px off in one shot, {:.2} px in all{throat}", tape.shot_px, tape.shared_px));
        tapes.insert(name.to_owned(), tape);
    }
    tapes
}

#[allow(clippy::too_many_arguments)]
fn one_shot(
    session: &Session,
    folder: &ShotFolder,
    rig: &StereoRig,
    rig_file: &Path,
    results: &Path,
    tapes: &BTreeMap<String, TapeErrors>,
    arguments: &Arguments,
    shell: &Shell,
) -> Result<ShotRecord, CliError> {
    let place = results.join("shots").join(&folder.id);
    let (tracks_file, spin_file, shot_file) = (place.join("tracks.csv"), place.join(SPIN_FILE), place.join(SHOT_FILE));
    if !tracks_file.exists() {
        return Err(CliError::input(format!("{}: no tracks; run `sweetspot track` first", tracks_file.display())));
    }
    let mut provenance = Provenance::new("shots").with_file(&tracks_file).and_then(|p| p.with_file(rig_file)).map_err(CliError::input)?;
    if spin_file.exists() {
        provenance = provenance.with_file(&spin_file).map_err(CliError::input)?;
    }
    // Everything else that enters: equipment, timing, groups, points asked for.
    let tape = tapes.get(&folder.racket.name).copied().unwrap_or_else(TapeErrors::expected);
    let settings_text = format!("{:?}", (&folder.racket, &folder.ball, folder.impact_frame, &folder.groups, session.frame_rate_hz, session.exposure_s, &arguments.point, tape));
    provenance.inputs.insert("settings".into(), crate::provenance::sha256_hex(settings_text.as_bytes()));
    if !shell.args.force
        && let Ok(earlier) = ShotRecord::read(&shot_file)
        && earlier.provenance == provenance
    {
        return Ok(earlier);
    }
    let tracks = Tracks::read(&tracks_file)?;
    let spin = if spin_file.exists() { shot_spin(&spin_file)? } else { ShotSpin::default() };
    let settings = MeasureSettings { tape, ..settings_of(session, folder) };
    let input = ShotInput {
        id: &folder.id,
        rig,
        tracks: &tracks,
        racket: &folder.racket,
        ball: &folder.ball,
        spin: &spin,
        groups: &folder.groups,
        asked_points: &arguments.point,
    };
    let measured = measure_shot(&input, &settings)?;
    let record = ShotRecord { shot: measured.shot, provenance };
    shell.write(&place.join("points.csv"), points_to_csv(&measured.points).as_bytes())?;
    shell.write(&shot_file, record.to_json().as_bytes())?;
    Ok(record)
}

/// The vectors of `spin.json`; what was refused or measured about one axis only becomes a remark.
fn shot_spin(path: &Path) -> Result<ShotSpin, CliError> {
    let spin = read_spin(path)?;
    let mut remarks = Vec::new();
    let mut vector = |when: &str, e: &SpinEstimate| match e {
        SpinEstimate::Vector { omega_rad_s, covariance, .. } => (Some(SpinVector { omega: *omega_rad_s, covariance: *covariance }), None),
        SpinEstimate::OneAxis { axis, rate_rad_s, sd_rad_s, reason, .. } => {
            let [x, y, z]: [f64; 3] = (*axis).into();
            remarks.push(format!("spin {when}: only {rate_rad_s:.1} ± {sd_rad_s:.1} rad/s about ({x:.2}, {y:.2}, {z:.2}) was measured ({reason})"));
            (None, Some(SpinComponent { rate_rad_s: *rate_rad_s, sd_rad_s: *sd_rad_s }))
        }
        SpinEstimate::Refused { reason } => {
            remarks.push(format!("spin {when}: {reason}"));
            (None, None)
        }
    };
    let ((before, before_component), (after, after_component)) = (vector("before", &spin.before), vector("after", &spin.after));
    Ok(ShotSpin { before, after, before_component, after_component, remarks })
}
