//! `sweetspot validate`.

use super::diagnose::session_at_its_best;
use super::error::{CliError, Kind, existing};
use super::set_aside::{listed, set_aside, set_session_aside};
use super::shots::{parse_point, told_apart};
use super::{Shell, undashed};
use crate::calibration::StereoRig;
use crate::limited_file::{LARGEST_TABLE, read_text};
use crate::report::{read_session_results, session_report};
use crate::session::Session;
use crate::validation::observation::FEWEST_IMPACTS;
use nalgebra::Vector2;
use std::collections::{BTreeMap, BTreeSet};
use std::ffi::OsStr;
use std::path::{Path, PathBuf};

/// The model that a session is compared with when the user names none: the rigid base of the contract.
const RIGID_MODEL: &str = "\
base = \"rigid\"

[parameters]
restitution = { value = 0.80, fit = true, min = 0.3, max = 1.0 }
friction    = { value = 0.45, fit = true, min = 0.0, max = 1.5 }
";

/// Its file among the results.
const RIGID_MODEL_FILE: &str = "model.toml";

/// Batch: everything that is still to do for one or more sessions, against a model
///
/// Calibrates, tracks, measures the shots, compares them with the model, diagnoses and writes report.html. What an
/// earlier run finished is kept; a shot that fails, or a session that cannot be opened, is named and the others go on.
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// Session folders (each holds session.toml)
    #[arg(required = true)]
    pub sessions: Vec<PathBuf>,
    /// Model file (default: the rigid base, written to the results as model.toml)
    #[arg(long, value_name = "F")]
    pub model: Option<PathBuf>,
    /// Also give the velocity of this point of every face, as `shots --point` does (may be given more than once)
    #[arg(long, value_name = "X,Y", value_parser = parse_point, allow_hyphen_values = true)]
    pub point: Vec<Vector2<f64>>,
}

/// What became of one session, for `--json`.
#[derive(Debug, serde::Serialize)]
struct Outcome {
    #[serde(serialize_with = "super::as_shown")]
    session: PathBuf,
    #[serde(serialize_with = "super::as_shown")]
    results: PathBuf,
    shots_measured: usize,
    /// What `diagnose` found, where there were shots enough.
    diagnosis: Option<Found>,
    /// Failures by step, in the order they happened.
    failed: Vec<Failure>,
}

/// The head of `diagnosis.json`.
#[derive(Debug, serde::Serialize, serde::Deserialize)]
struct Found {
    verdict: String,
    recommended: Vec<String>,
    heldout_error: f64,
    noise_floor: f64,
}

impl Outcome {
    /// Whether a step on the impacts table was made now. To predict one impact is enough, to judge a model is not.
    fn made(&self, step: &str) -> bool {
        (step == "predict" || self.shots_measured >= FEWEST_IMPACTS) && !self.failed.iter().any(|f| f.step == step && f.ended)
    }
}

#[derive(Debug, serde::Serialize)]
pub(super) struct Failure {
    pub step: &'static str,
    pub reason: String,
    /// Whether the step gave nothing at all; else it did without what failed.
    #[serde(skip)]
    ended: bool,
    /// What to try, said once in the end.
    #[serde(skip)]
    hints: Vec<String>,
    /// Of the shots that failed, by id.
    pub shots: BTreeMap<String, String>,
}

impl Failure {
    fn of(step: &'static str, error: CliError) -> Self {
        let mut shots = BTreeMap::new();
        for (id, reason) in error.shots {
            // What failed first is the cause of what failed after it.
            shots.entry(id).or_insert(reason);
        }
        Failure { step, reason: error.message, ended: error.kind != Kind::SomeFailed, hints: error.hints, shots }
    }
}

pub fn run(mut arguments: Arguments, shell: &Shell) -> Result<(), CliError> {
    arguments.sessions = arguments.sessions.into_iter().map(undashed).collect();
    arguments.model = arguments.model.map(undashed);
    told_apart(&arguments.point)?;
    if let Some(model) = &arguments.model {
        crate::impact::Model::read(existing(model, "model file")?)?;
    }
    // Every session is read before the first is worked on: a slip of the pen shows at once, not after an hour.
    let folders = &arguments.sessions;
    let opened: Vec<Result<Session, CliError>> = folders.iter().map(|s| Ok(Session::open(existing(s, "session folder")?)?)).collect();
    if opened.iter().all(Result::is_err) {
        return Err(none_opened(opened.into_iter().filter_map(Result::err).collect()));
    }
    let places: Vec<PathBuf> = folders.iter().map(|s| place(s, folders.len() > 1, shell)).collect();
    for (i, place) in places.iter().enumerate() {
        if let Some(j) = places[..i].iter().position(|p| p == place) {
            let (a, b) = (folders[j].display(), folders[i].display());
            return Err(CliError::input(format!("{a} and {b}: the results of both would be {}", place.display()))
                .hint("give each session folder a name of its own, or run them one by one, each with its own --out"));
        }
    }
    for (folder, e) in folders.iter().zip(&opened).filter_map(|(folder, session)| Some((folder, session.as_ref().err()?))) {
        shell.say(format_args!("{}: left out: {}", folder.display(), e.message));
    }
    let mut outcomes = Vec::new();
    for ((folder, session), results) in folders.iter().zip(opened).zip(places) {
        let session = match session {
            Ok(session) => session,
            Err(e) => {
                let failed = vec![Failure::of("open", e)];
                outcomes.push(Outcome { session: folder.clone(), results, shots_measured: 0, diagnosis: None, failed });
                continue;
            }
        };
        shell.say(format_args!("== {} ({})", session.name, session.root.display()));
        let mut outcome = Outcome { session: session.root.clone(), results: results.clone(), shots_measured: 0, diagnosis: None, failed: Vec::new() };
        let model = arguments.model.clone().unwrap_or_else(|| results.join(RIGID_MODEL_FILE));
        let made = one_session(&session, &results, &arguments, &mut outcome, shell).and_then(|()| write_report(&session, &results, &model, &outcome, shell));
        match made {
            Ok(()) => {}
            Err(e) if e.kind == Kind::Interrupted => return Err(e),
            // A folder that may not be written into, or a result that cannot be read back, is that session's fault alone.
            Err(e) => outcome.failed.push(Failure::of("results", e)),
        }
        outcomes.push(outcome);
    }
    shell.print_json(&outcomes)?;
    if outcomes.len() > 1 {
        shell.say(sessions_text(&outcomes));
    }
    let failures: Vec<String> = outcomes.iter().flat_map(|o| o.failed.iter().map(|f| format!("{}: {}: {}", o.session.display(), f.step, f.reason))).collect();
    if failures.is_empty() {
        return Ok(());
    }
    let message = failures.join("\n");
    let hints: BTreeSet<String> = outcomes.iter_mut().flat_map(|o| &mut o.failed).flat_map(|f| std::mem::take(&mut f.hints)).collect();
    // As the steps by hand: shots that fail are named, input with which nothing could be begun is refused.
    let error = if outcomes.iter().all(|o| o.failed.iter().any(|f| f.ended) && (o.shots_measured == 0 || o.failed.iter().any(|f| f.step == "results"))) {
        CliError::input(message)
    } else {
        CliError::some_failed(message)
    };
    Err(CliError { hints: hints.into_iter().collect(), ..error })
}

/// What came of each session, one line each: a season is more than a screen's length of steps.
fn sessions_text(outcomes: &[Outcome]) -> String {
    let names: Vec<String> = outcomes.iter().map(|o| o.session.display().to_string()).collect();
    let wide = names.iter().map(|name| name.chars().count()).max().unwrap_or(0);
    let mut lines = vec![format!("{:<wide$}  shots  held-out error  verdict", "session")];
    for (name, o) in names.iter().zip(outcomes) {
        let (error, verdict) = match &o.diagnosis {
            Some(found) if found.recommended.is_empty() => (format!("{:.2}", found.heldout_error), found.verdict.clone()),
            Some(found) => (format!("{:.2}", found.heldout_error), format!("{}: {}", found.verdict, found.recommended.join(", "))),
            None if o.shots_measured == 0 || o.failed.iter().any(|f| f.ended) => {
                (String::new(), format!("failed: {}", o.failed.iter().map(|f| f.step).collect::<Vec<_>>().join(", ")))
            }
            None => (String::new(), format!("not judged: fewer than {FEWEST_IMPACTS} impacts")),
        };
        lines.push(format!("{name:<wide$}  {:>5}  {error:>14}  {verdict}", o.shots_measured));
    }
    lines.join("\n")
}

/// Of sessions none of which can be opened.
fn none_opened(mut errors: Vec<CliError>) -> CliError {
    let message = errors.iter().map(|e| e.message.as_str()).collect::<Vec<_>>().join("\n");
    let hints = errors.iter_mut().flat_map(|e| std::mem::take(&mut e.hints)).collect::<BTreeSet<_>>();
    CliError { hints: hints.into_iter().collect(), ..CliError::input(message) }
}

/// One report of the whole session, in place of those that single steps wrote.
fn write_report(session: &Session, results: &Path, model: &Path, outcome: &Outcome, shell: &Shell) -> Result<(), CliError> {
    let mut all = read_session_results(session, results);
    if let (Some(stated), true) = (&all.comparison, outcome.made("diagnose")) {
        // Without it words and table stand alone.
        all.at_its_best = session_at_its_best(session, &results.join("impacts.csv"), model, stated).ok();
    }
    all.model = model.file_name().map(|name| name.to_string_lossy().into_owned());
    // What the first step to miss a shot said of it beats the bare fact that its file is missing; what is of no shot is of the step.
    for (id, why) in &mut all.failed {
        if let Some(reason) = outcome.failed.iter().find_map(|f| f.shots.get(id)) {
            why.clone_from(reason);
        }
    }
    let of_no_shot = outcome.failed.iter().filter(|f| f.shots.is_empty());
    all.steps_failed.extend(of_no_shot.map(|f| (f.step.to_owned(), f.reason.clone())));
    let path = results.join("report.html");
    shell.write(&path, session_report(&all).as_bytes())?;
    shell.say(format_args!("report: {}", path.display()));
    Ok(())
}

/// Results of a session; with several sessions and `--out`, each gets a folder of its own name there.
fn place(session: &Path, several: bool, shell: &Shell) -> PathBuf {
    let root = std::fs::canonicalize(session).unwrap_or_else(|_| session.to_path_buf());
    match (&shell.args.out, several, root.file_name()) {
        (Some(out), true, Some(name)) => undashed(out.join(name)),
        _ => undashed(shell.results_of_session(session)),
    }
}

/// What the steps from the pictures to the impacts table came to.
pub(super) enum Footage {
    /// There is a table; the failures of single shots.
    Measured(Vec<Failure>),
    /// A step failed altogether.
    Ended(Vec<Failure>),
}

/// Calibrates, tracks and measures, points of the faces as well. A step that fails for some shots leaves the others to the next step; one that fails
/// altogether ends the session.
pub(super) fn footage(session: &Session, results: &Path, points: &[Vector2<f64>], shell: &Shell) -> Result<Footage, CliError> {
    let mut failed = Vec::new();
    let points: Vec<String> = points.iter().map(|p| format!("--point={},{}", p.x, p.y)).collect();
    for step in ["calibrate", "track", "shots"] {
        shell.check_cancelled()?;
        if step == "calibrate" && is_imported(results) {
            shell.say("calibration.json was not made from checkerboards and stays (`sweetspot calibrate SESSION` makes one from them)");
            continue;
        }
        if step == "calibrate" && cfg!(not(feature = "vision")) && results.join("calibration.json").exists() {
            continue; // a program without OpenCV works from a calibration made elsewhere
        }
        let points = points.iter().map(OsStr::new).filter(|_| step == "shots");
        let line: Vec<&OsStr> = [OsStr::new(step), session.root.as_os_str()].into_iter().chain(points).collect();
        match shell.run_step(&line, results) {
            Ok(()) => {}
            Err(e) if e.kind == Kind::Interrupted => return Err(e),
            Err(e) => {
                let failure = Failure::of(step, e);
                let ends = failure.ended;
                failed.push(failure);
                if ends {
                    // The impacts of an earlier run are of another calibration or other tracks.
                    let kept = set_session_aside(results)?;
                    if !kept.is_empty() {
                        shell.say(format_args!("the impacts of an earlier run, and what was made of them, are kept as {}", listed(&kept)));
                    }
                    return Ok(Footage::Ended(failed));
                }
            }
        }
    }
    // Where every shot failed there is no table.
    Ok(if results.join("impacts.csv").exists() { Footage::Measured(failed) } else { Footage::Ended(failed) })
}

/// Whether the session's calibration came from elsewhere (`calibrate --import`): no board stands behind it.
fn is_imported(results: &Path) -> bool {
    StereoRig::read(&results.join("calibration.json")).is_ok_and(|rig| rig.pairs.is_empty())
}

/// The rigid base as `model.toml` among the results; one that is there already stays.
pub(super) fn rigid_model(results: &Path, shell: &Shell) -> Result<PathBuf, CliError> {
    let path = results.join(RIGID_MODEL_FILE);
    if !path.exists() {
        shell.write(&path, RIGID_MODEL.as_bytes())?;
    }
    Ok(path)
}

/// `--impacts F --racket F ... --ball F ... --model F` of a session's own files.
pub(super) fn table_words<'a>(session: &'a Session, impacts: &'a Path, model: &'a Path) -> Vec<&'a OsStr> {
    let gear = [("--racket", &session.racket_files), ("--ball", &session.ball_files)];
    let gear = gear.into_iter().flat_map(|(flag, files)| files.iter().map(move |f| (flag, f.as_path())));
    let all = [("--impacts", impacts), ("--model", model)].into_iter().chain(gear);
    all.flat_map(|(flag, file)| [OsStr::new(flag), file.as_os_str()]).collect()
}

/// All steps of one session; what came of them stands in `outcome`, also where this ends early.
fn one_session(session: &Session, results: &Path, arguments: &Arguments, outcome: &mut Outcome, shell: &Shell) -> Result<(), CliError> {
    let (failed, measured) = match footage(session, results, &arguments.point, shell)? {
        Footage::Measured(failed) => (failed, true),
        Footage::Ended(failed) => (failed, false),
    };
    outcome.failed = failed;
    if !measured {
        return Ok(());
    }
    let impacts = results.join("impacts.csv");
    outcome.shots_measured = crate::impact_table::ImpactTable::read(&impacts)?.rows.len();
    let model = match &arguments.model {
        Some(path) => path.clone(),
        None => rigid_model(results, shell)?,
    };
    let mut words = table_words(session, &impacts, &model);
    let mut steps = vec!["predict"];
    if outcome.shots_measured >= FEWEST_IMPACTS {
        steps.extend(["compare", "diagnose"]);
    } else {
        shell.say(format_args!(
            "compare, diagnose: {} measured {} too few to judge a model; {FEWEST_IMPACTS} or more are needed, better 60.",
            outcome.shots_measured,
            if outcome.shots_measured == 1 { "shot is" } else { "shots are" }
        ));
        // The report sets what is predicted beside what was measured, each with its deviation.
        words.push(OsStr::new("--sensitivities"));
    }
    for step in steps {
        shell.check_cancelled()?;
        let line: Vec<&OsStr> = std::iter::once(OsStr::new(step)).chain(words.iter().copied()).collect();
        match shell.run_step(&line, results) {
            Ok(()) => {}
            Err(e) if e.kind == Kind::Interrupted => return Err(e),
            Err(e) => outcome.failed.push(Failure::of(step, e)),
        }
    }
    // What an earlier run found is of other shots.
    for (step, file) in [("predict", "predictions.csv"), ("compare", "compare.json"), ("diagnose", "diagnosis.json")] {
        if !outcome.made(step)
            && let Some(kept) = set_aside(&results.join(file), "earlier")?
        {
            shell.say(format_args!("{step}: what an earlier run made is kept as {}", kept.display()));
        }
    }
    if outcome.made("diagnose") {
        let text = read_text(&results.join("diagnosis.json"), LARGEST_TABLE).map_err(CliError::input)?;
        outcome.diagnosis = Some(serde_json::from_str(&text).map_err(CliError::input)?);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn truth_of_several_reasons_of_a_shot_the_first_is_told() {
        let reasons = [("shot-1", "the racket was lost"), ("shot-2", "no ball"), ("shot-1", "no velocity of the racket")];
        let error = CliError::some_failed("2 of 9 shots failed").of_shots(reasons.map(|(id, why)| (id.to_owned(), why.to_owned())).into());
        let shots = Failure::of("track", error).shots;
        assert_eq!(shots.iter().map(|(id, why)| (id.as_str(), why.as_str())).collect::<Vec<_>>(), reasons[..2]);
    }
}
