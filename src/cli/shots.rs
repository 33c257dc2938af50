//! `sweetspot shots`.

use super::Shell;
use super::error::{CliError, Kind, with_reasons};
use super::set_aside::{listed, made_of_the_impacts, set_all_aside, set_aside, set_judgements_aside, set_session_aside};
use super::track::renew_c3d;
use super::tracked_session::{TrackedSession, refuse_no_place};
use crate::impact_table::{ImpactRow, ImpactTable};
use crate::kinematics::{
    BalanceSeen, GroupStatistic, RiseInterval, SHOT_FILE, Shot, ShotInput, ShotRecord, ShotSpin, SpinComponent, SpinVector, measure_shot, mismatch_remark,
    point_name, rise_table, season_statistics, season_to_csv,
};
use crate::provenance::{Provenance, sha256_file, sha256_hex};
use crate::report::{SeasonFigure, histograms_to_csv, season_figures};
use crate::session::ShotFolder;
use crate::short_list::short_list;
use crate::tracking::spin::{SPIN_FILE, SpinEstimate, read_spin};
use crate::tracking::{TrackRecord, Tracks, points_to_csv};
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

pub(super) fn parse_point(text: &str) -> Result<Vector2<f64>, String> {
    let parts: Vec<f64> =
        text.split(',').map(|p| p.trim().parse::<f64>()).collect::<Result<_, _>>().map_err(|e| format!("{text:?}: {e}; give X,Y in metres"))?;
    match parts[..] {
        [x, y] if x.abs() < 1.0 && y.abs() < 1.0 => Ok(Vector2::new(x, y)),
        _ => Err(format!("{text:?}; give X,Y in metres from the stringbed centre, each below 1 m")),
    }
}

/// Two points of one name would be one key of shot.json.
pub(super) fn told_apart(points: &[Vector2<f64>]) -> Result<(), CliError> {
    for (k, p) in points.iter().enumerate() {
        if let Some(q) = points[..k].iter().find(|q| point_name(q) == point_name(p)) {
            return Err(CliError::input(format!(
                "--point {},{} and --point {},{} are both {}_*: a point is named by whole millimetres",
                q.x,
                q.y,
                p.x,
                p.y,
                point_name(p)
            ))
            .hint("leave one out, or give points a millimetre apart"));
        }
    }
    Ok(())
}

#[derive(serde::Serialize)]
struct Summary {
    #[serde(serialize_with = "super::as_shown")]
    impacts: PathBuf,
    shots: Vec<ShotRecord>,
    failed: Vec<(String, String)>,
}

pub fn run(arguments: Arguments, shell: &Shell) -> Result<(), CliError> {
    told_apart(&arguments.point)?;
    let tracked = TrackedSession::open(&arguments.session, shell)?;
    let session = &tracked.session;
    if session.shots.is_empty() && session.broken_shots.is_empty() {
        return Err(CliError::no_shots(&arguments.session));
    }
    let (shots, failed) = sorted_out(&tracked, measure_all(&tracked, &arguments, shell)?)?;
    tell_doubts(&tracked, &shots, shell);
    let impacts = tracked.results.join("impacts.csv");
    if shots.is_empty() {
        let kept = set_session_aside(&tracked.results)?;
        if !kept.is_empty() {
            shell.say(format_args!("no shot measured; the impacts of an earlier run, and what was made of them, are kept as {}", listed(&kept)));
        }
    } else {
        write_impacts(&tracked, &shots, !failed.is_empty(), &impacts, shell)?;
        write_season(&tracked, &shots, shell)?;
        shell.say(format_args!("{} of {} shots measured: {}", shots.len(), shots.len() + failed.len(), impacts.display()));
    }
    let summary = Summary { impacts, shots, failed };
    shell.print_json(&summary)?;
    if summary.failed.is_empty() {
        return Ok(());
    }
    let (failed, all) = (summary.failed.len(), summary.shots.len() + summary.failed.len());
    let message = format!("{failed} of {all} shots failed:\n  {}", with_reasons(&summary.failed, "\n  "));
    Err(CliError::some_failed(message).of_shots(summary.failed))
}

/// What became of each shot, by its id, in the session's order.
type Outcomes = Vec<(String, Result<ShotRecord, CliError>)>;

/// Measures the shots side by side, and writes of each what was found.
///
/// # Errors  when it is interrupted, or results cannot be written: a full disk is no fault of a shot, and what an earlier run measured stays where it is.
fn measure_all(tracked: &TrackedSession, arguments: &Arguments, shell: &Shell) -> Result<Outcomes, CliError> {
    let shots = &tracked.session.shots;
    let bar = shell.progress(shots.len() as u64, "shots");
    let outcomes: Outcomes = shots
        .par_iter()
        .map(|folder| {
            let outcome = shell.check_cancelled().and_then(|()| one_shot(tracked, folder, arguments, shell));
            bar.inc(1);
            (folder.id.clone(), outcome)
        })
        .collect();
    bar.finish_and_clear();
    shell.check_cancelled()?;
    let (unwritten, outcomes): (Vec<_>, Vec<_>) = outcomes.into_iter().partition(|(_, outcome)| outcome.as_ref().is_err_and(|e| e.kind == Kind::Output));
    if let Some((id, Err(e))) = unwritten.into_iter().next() {
        return Err(CliError { message: format!("{id}: {}", e.message), ..e });
    }
    Ok(outcomes)
}

/// The shots measured, and those that failed, by id, with the reason; what an earlier run measured of these is set aside.
fn sorted_out(tracked: &TrackedSession, outcomes: Outcomes) -> Result<(Vec<ShotRecord>, Vec<(String, String)>), CliError> {
    let (mut shots, mut failed) = (Vec::new(), Vec::new());
    let broken = tracked.session.broken_shots.iter().map(|(id, why)| (id.clone(), Err(why.clone())));
    for (id, outcome) in outcomes.into_iter().map(|(id, outcome)| (id, outcome.map_err(|e| e.message))).chain(broken) {
        match outcome {
            Ok(record) => shots.push(record),
            Err(why) => {
                let kept = set_measured_aside(&tracked.results.join("shots").join(&id))?;
                let kept = if kept.is_empty() { String::new() } else { format!("; what an earlier run measured is kept as {}", listed(&kept)) };
                failed.push((id, why + &kept));
            }
        }
    }
    failed.sort();
    Ok((shots, failed))
}

/// Says what tracking doubts, and where racket.toml does not go with the footage.
fn tell_doubts(tracked: &TrackedSession, shots: &[ShotRecord], shell: &Shell) {
    for folder in &tracked.session.shots {
        if let Some(doubt) = TrackRecord::read(&tracked.place(folder)).and_then(|t| t.summary.doubt) {
            shell.say(format_args!("{}: {doubt}", folder.id));
        }
    }
    for ShotRecord { shot, .. } in shots {
        if let Some(remark) = mismatch_remark(&shot.marker_distances) {
            shell.say(format_args!("{}: {remark}", shot.id));
        }
    }
}

/// Writes the impacts table. One of other impacts that is there already, and what was made of an earlier one, are set aside.
fn write_impacts(tracked: &TrackedSession, shots: &[ShotRecord], some_failed: bool, impacts: &Path, shell: &Shell) -> Result<(), CliError> {
    let doubted = shots.iter().any(|r| r.doubt.is_some());
    let orders: BTreeMap<&str, usize> = tracked.session.shots.iter().map(|s| (s.id.as_str(), s.order)).collect();
    let row = |r: &ShotRecord| {
        // A shot that failed leaves its place in time empty.
        let mut row = r.shot.impact_row(orders.get(r.shot.id.as_str()).map_or(0.0, |k| *k as f64));
        if doubted {
            row.groups.insert(DOUBT_COLUMN.to_owned(), if r.doubt.is_some() { "yes" } else { "no" }.to_owned());
        }
        row
    };
    let table = ImpactTable { rows: shots.iter().map(row).collect(), ..ImpactTable::default() }.to_csv();
    // A table with other impacts is another session's, or the user's own.
    let own = |row: &ImpactRow| orders.contains_key(row.id.as_str()) || tracked.session.broken_shots.iter().any(|(id, _)| *id == row.id);
    if impacts.exists() && !ImpactTable::read(impacts).is_ok_and(|earlier| earlier.rows.iter().all(own)) {
        let kept = set_session_aside(&tracked.results)?;
        shell.say(format_args!("another table of impacts was there, with what was made of it; kept as {}", listed(&kept)));
    }
    // What was made of a table with the shots that fail now is not of this one.
    let others = std::fs::read(impacts).is_ok_and(|earlier| earlier != table.as_bytes());
    if some_failed && others {
        let kept = set_judgements_aside(&tracked.results)?;
        if !kept.is_empty() {
            shell.say(format_args!("what was made of the impacts of an earlier run is kept as {}", listed(&kept)));
        }
    }
    shell.write(impacts, table.as_bytes())?;
    // A command that goes on from here makes them anew.
    let stale = if others && !shell.is_step { made_of_the_impacts(&tracked.results) } else { Vec::new() };
    if !stale.is_empty() {
        shell.say(format_args!("made of the impacts as they were before: {}; `sweetspot validate` makes them anew", listed(&stale)));
    }
    Ok(())
}

/// What an earlier run measured of a shot is not this one's. Points in space that `track` has found since are, and stay.
fn set_measured_aside(place: &Path) -> Result<Vec<PathBuf>, CliError> {
    let (shot, points) = (place.join(SHOT_FILE), place.join("points.csv"));
    let of_the_shot = ShotRecord::read(&shot).is_ok_and(|earlier| sha256_file(&points).is_ok_and(|hash| hash == earlier.points));
    let points = if of_the_shot || !place.join("tracks.csv").exists() { set_aside(&points, "earlier")? } else { None };
    Ok(set_aside(&shot, "earlier")?.into_iter().chain(points).collect())
}

#[derive(serde::Serialize)]
struct Season<'a> {
    statistics: Vec<GroupStatistic>,
    /// Table 5.9b: forward speed of the incoming ball by its vertical velocity.
    rise: Vec<RiseInterval>,
    /// By the racket's name: where its free flights put the centre of mass.
    balance: &'a BTreeMap<String, BalanceSeen>,
}

/// The session as a whole: `season.csv`, `season.json`, the figures of chapter 5 as `season/*.svg`, and what their histograms
/// count as `season/histograms.csv`.
fn write_season(tracked: &TrackedSession, records: &[ShotRecord], shell: &Shell) -> Result<(), CliError> {
    let results = &tracked.results;
    let shots: Vec<&Shot> = records.iter().map(|r| &r.shot).collect();
    let season = Season { statistics: season_statistics(&shots), rise: rise_table(&shots), balance: &tracked.balances };
    shell.write(&results.join("season.csv"), season_to_csv(&season.statistics).as_bytes())?;
    let json = serde_json::to_string_pretty(&season).map_err(CliError::output)? + "\n";
    shell.write(&results.join("season.json"), json.as_bytes())?;
    let figures = season_figures(&shots, Some(&tracked.session.racket));
    set_figures_aside(&results.join("season"), &figures, shell)?;
    if !figures.is_empty() {
        shell.write(&results.join("season").join("histograms.csv"), histograms_to_csv(&figures).as_bytes())?;
    }
    for figure in figures {
        shell.write(&results.join("season").join(format!("{}.svg", figure.name)), figure.svg.as_bytes())?;
    }
    Ok(())
}

/// Figures of an earlier run that these shots do not have.
fn set_figures_aside(folder: &Path, figures: &[SeasonFigure], shell: &Shell) -> Result<(), CliError> {
    let Ok(entries) = std::fs::read_dir(folder) else { return Ok(()) };
    let drawn = |name: &str| name.strip_suffix(".svg").is_some_and(|stem| !stem.contains(".earlier") && figures.iter().all(|f| f.name != stem));
    let stale = |name: &str| drawn(name) || figures.is_empty() && name == "histograms.csv";
    let mut names: Vec<String> = entries.flatten().map(|e| e.file_name().to_string_lossy().into_owned()).filter(|name| stale(name)).collect();
    names.sort();
    let kept = set_all_aside(folder, &names.iter().map(String::as_str).collect::<Vec<_>>())?;
    if !kept.is_empty() {
        shell.say(format_args!(
            "figures of the season that these shots do not have are kept as {}",
            short_list(&kept.iter().map(|p| p.display().to_string()).collect::<Vec<_>>(), 3, ", ")
        ));
    }
    Ok(())
}

/// Column of impacts.csv that tells shots apart whose tracks are in doubt; there is none where no shot is.
const DOUBT_COLUMN: &str = "in_doubt";

fn one_shot(tracked: &TrackedSession, folder: &ShotFolder, arguments: &Arguments, shell: &Shell) -> Result<ShotRecord, CliError> {
    let place = tracked.place(folder);
    refuse_no_place(&place).map_err(CliError::input)?;
    let (tracks_file, spin_file, shot_file) = (place.join("tracks.csv"), place.join(SPIN_FILE), place.join(SHOT_FILE));
    if !tracks_file.exists() {
        return Err(CliError::input(format!("{}: no tracks; run `sweetspot track` first", tracks_file.display())));
    }
    let mut provenance =
        Provenance::new("shots").with_file(&tracks_file).and_then(|p| p.with_file(&tracked.results.join("calibration.json"))).map_err(CliError::input)?;
    if spin_file.exists() {
        provenance = provenance.with_file(&spin_file).map_err(CliError::input)?;
    }
    // Everything else that enters: equipment, timing, groups, points asked for.
    let settings = tracked.settings(folder);
    let tracking = TrackRecord::read(&place);
    let ball_flattening = tracking.as_ref().and_then(TrackRecord::flattening);
    let doubt = tracking.and_then(|t| t.summary.doubt);
    let settings_text = format!(
        "{:?}",
        (&doubt, &folder.racket, &folder.ball, folder.grip_torque_n_m, &ball_flattening, &folder.groups, &folder.note, &arguments.point, &settings)
    );
    provenance.inputs.insert("settings".into(), sha256_hex(settings_text.as_bytes()));
    let points_file = place.join("points.csv");
    if !shell.args.force
        && let Ok(earlier) = ShotRecord::read(&shot_file)
        && earlier.provenance == provenance
        && sha256_file(&points_file).is_ok_and(|points| points == earlier.points)
    {
        return Ok(earlier);
    }
    let tracks = Tracks::read(&tracks_file)?;
    let spin = if spin_file.exists() { shot_spin(&spin_file)? } else { ShotSpin::default() };
    let input = ShotInput {
        id: &folder.id,
        rig: &tracked.rig,
        tracks: &tracks,
        racket: &folder.racket,
        ball: &folder.ball,
        spin: &spin,
        grip_torque_n_m: folder.grip_torque_n_m,
        ball_flattening,
        groups: &folder.groups,
        asked_points: &arguments.point,
    };
    let mut measured = measure_shot(&input, &settings)?;
    // The first thing to know of it.
    measured.shot.remarks.splice(0..0, doubt.clone());
    let points = points_to_csv(&measured.points);
    let record = ShotRecord { shot: measured.shot, doubt, note: folder.note.clone(), points: sha256_hex(points.as_bytes()), provenance };
    shell.write(&points_file, points.as_bytes())?;
    renew_c3d(&tracked.session, folder, &tracked.rig, &place, shell)?;
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
