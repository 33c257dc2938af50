//! `sweetspot demo`: the whole chain on the sample the program carries, or on a world whose hidden effect nobody chose.

use super::diagnose::session_at_its_best;
use super::error::{CliError, Kind};
use super::ledger_file::LedgerFile;
use super::synth::{film, is_rendered, rendered_from, unfinished};
use super::validate::{Failure, Footage, footage, rigid_model, table_words};
use super::{Shell, undashed};
use crate::calibration::StereoRig;
use crate::impact_table::ImpactTable;
use crate::limited_file::{LARGEST_TEXT, read_text};
use crate::median::upper_median;
use crate::provenance::{sha256_file, sha256_hex};
use crate::quantity::HOLD_95_PERCENT;
use crate::report::{read_session_results, session_report};
use crate::session::Session;
use crate::synthetic::footage_spec::FootageSpec;
use crate::synthetic::hidden::{Entry, Hidden, Seen, entry, playable};
use crate::synthetic::look::Setting;
use crate::synthetic::sample;
use crate::validation::expression::FOUND_EFFECT;
use crate::validation::ledger::LedgerEntry;
use crate::validation::observation::FEWEST_IMPACTS;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};

/// The whole chain on the embedded sample; opens with a report
///
/// With --hidden-effect a session is rendered whose hidden effect is revealed only at the end: play against the
/// diagnosis, or let it play alone.
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// Folder for the sample and its results, as --out (default: demo-results, or demo-hidden-SEED)
    pub dir: Option<PathBuf>,
    /// Render a world with this effect hidden; `random` (or nothing) lets chance choose, `none` hides nothing
    #[arg(long, value_name = "NAME", num_args = 0..=1, default_missing_value = "random")]
    pub hidden_effect: Option<String>,
    /// How strong the hidden effect is (1: as large as it is in the field, which these pictures show a hundredfold)
    #[arg(long, default_value_t = 0.35, requires = "hidden_effect")]
    pub strength: f64,
    /// Shots to render
    #[arg(long, default_value_t = 120, requires = "hidden_effect")]
    pub shots: usize,
    /// Seed of the rendered world (default: from the clock)
    #[arg(long, requires = "hidden_effect")]
    pub seed: Option<u64>,
}

/// What the demonstration found, for `--json`.
#[derive(Debug, serde::Serialize)]
struct Outcome {
    #[serde(serialize_with = "super::as_shown")]
    report: PathBuf,
    shots_measured: usize,
    /// As the session states it, and as measured.
    square_stated_mm: f64,
    square_mm: Option<f64>,
    square_sd_mm: Option<f64>,
    /// Half of the 95 % interval of the ball's speed after impact, median over the shots, m/s.
    ball_speed_95_m_s: Option<f64>,
    heldout_error_first: Option<f64>,
    heldout_error_last: Option<f64>,
    /// Error of a model without fault, in the same units.
    noise_floor: Option<f64>,
    verdict: Option<String>,
    /// The first candidate of the first diagnosis, with its probability.
    named_first: Option<(String, f64)>,
    /// Effects of the catalogue in the last model.
    found: Vec<String>,
    /// Whether a formula was added for what they leave.
    formula: bool,
    #[serde(skip_serializing_if = "Option::is_none")]
    hidden: Option<Vec<String>>,
    /// Shots and rows that failed, with the reason; the others are complete.
    failed: Vec<String>,
}

impl Outcome {
    fn unless_some_failed(&self) -> Result<(), CliError> {
        if self.failed.is_empty() { Ok(()) } else { Err(CliError::some_failed(self.failed.join("\n"))) }
    }
}

pub fn run(mut arguments: Arguments, shell: &Shell) -> Result<(), CliError> {
    arguments.dir = match (arguments.dir.map(undashed), &shell.args.out) {
        (Some(dir), Some(out)) if dir != *out => {
            return Err(CliError::input(format!("the folder is given twice: {}, and --out {}", dir.display(), out.display()))
                .hint("everything goes to one folder: give either"));
        }
        (dir, out) => dir.or_else(|| out.clone()),
    };
    if arguments.shots == 0 {
        return Err(CliError::input("--shots is 0; allowed: 1 or more, and the diagnosis needs some 20"));
    }
    // Everything goes to DIR, where the models stand too: they share one ledger.
    let shell = &shell.with_default_results();
    let Some(wish) = &arguments.hidden_effect else {
        let folder = arguments.dir.clone().unwrap_or_else(|| PathBuf::from("demo-results"));
        let files: Vec<_> = sample::files().collect();
        if files.is_empty() {
            return Err(
                CliError::input("this program was built without the sample (footage-samples was missing)").hint("sweetspot demo --hidden-effect random")
            );
        }
        let own = folder.join("session").join("session.toml");
        let of_sample = files.iter().any(|(name, bytes)| *name == "session.toml" && std::fs::read(&own).ok().as_deref() == Some(*bytes));
        if own.exists() && !of_sample && !shell.args.force {
            return Err(CliError::input(format!("{}: there is a session already, and it is not the sample", folder.join("session").display()))
                .hint("give another folder")
                .hint("--force writes the sample over it"));
        }
        shell.say(format_args!("The sample: {} files of one session, into {}", files.len(), folder.join("session").display()));
        for (name, bytes) in files {
            let path = folder.join("session").join(name);
            if std::fs::read(&path).ok().as_deref() != Some(bytes) {
                shell.write(&path, bytes)?;
            }
        }
        let outcome = chain(&folder, shell)?;
        tell(&outcome, shell);
        shell.print_json(&outcome)?;
        return outcome.unless_some_failed();
    };
    // The same command goes on with the world it chose.
    let earlier = |folder: &PathBuf| Some(folder.join("session")).filter(|_| !shell.args.force).and_then(|s| unfinished(&s).or_else(|| rendered_from(&s)));
    let seed = arguments.seed.or_else(|| arguments.dir.as_ref().and_then(earlier).map(|spec| spec.seed));
    let seed = seed.unwrap_or_else(|| std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).map_or(1, |d| d.subsec_nanos().into()));
    let chosen = choose(wish, seed)?;
    let folder = arguments.dir.clone().unwrap_or_else(|| PathBuf::from(format!("demo-hidden-{seed}")));
    let session = folder.join("session");
    let setting = if chosen.is_some_and(|e| e.seen == Seen::Court) { Setting::Court } else { Setting::Lab };
    let hidden = chosen.map(|e| vec![Hidden::new(e.name, arguments.strength)]).unwrap_or_default();
    let spec = FootageSpec { hidden, frames_before: 12, frames_after: 12, ..FootageSpec::new(setting, arguments.shots, seed) };
    let reused = !shell.args.force && rendered_from(&session).is_some_and(|earlier| earlier == spec);
    if !reused {
        make_room(&session, shell)?;
    }
    let from = if reused { ", rendered by an earlier run" } else { "" };
    shell.say(format_args!("A world with seed {seed}{from}: what is hidden in it is told at the end ({} knows it)", session.join("truth.json").display()));
    let filmed = if reused { Ok(()) } else { film(&spec, &session, shell).map(|_| ()) };
    let mut outcome = filmed.and_then(|()| chain(&folder, shell)).map_err(|e| match e.kind {
        Kind::Interrupted if arguments.seed.is_none() && arguments.dir.is_none() => {
            e.hint(format!("--seed {seed} goes on with this world; without it chance chooses another"))
        }
        _ => e,
    })?;
    outcome.hidden = Some(chosen.iter().map(|e| e.name.to_owned()).collect());
    tell(&outcome, shell);
    reveal(&outcome, chosen, shell);
    shell.print_json(&outcome)?;
    outcome.unless_some_failed()
}

/// The effect to hide; `None` for nothing. `random` is nothing one time in eight.
fn choose(wish: &str, seed: u64) -> Result<Option<&'static Entry>, CliError> {
    match wish {
        "none" => Ok(None),
        "random" => {
            let all: Vec<&Entry> = playable().collect();
            let draw = u64::from_str_radix(&sha256_hex(&seed.to_le_bytes())[..15], 16).unwrap_or(seed);
            Ok(if draw.is_multiple_of(8) { None } else { all.get((draw / 8) as usize % all.len().max(1)).copied() })
        }
        name => Ok(Some(entry(name).map_err(CliError::input)?)),
    }
}

/// Refuses a session that is there, unless an earlier demonstration rendered it and it was broken off or --force gives it up.
fn make_room(session: &Path, shell: &Shell) -> Result<(), CliError> {
    if !session.exists() {
        return Ok(());
    }
    // What was broken off is made anew.
    let own = unfinished(session).is_some() || (shell.args.force && is_rendered(session));
    if !own {
        return Err(CliError::input(format!("{}: there is a session already", session.display()))
            .hint("give another folder")
            .hint("--force replaces a session that an earlier demonstration rendered"));
    }
    Ok(())
}

/// Everything from the checkerboards to the model that explains the shots, and one report.
fn chain(folder: &Path, shell: &Shell) -> Result<Outcome, CliError> {
    let session = Session::open(&folder.join("session"))?;
    let reasons = |failed: Vec<Failure>| failed.iter().map(|f| format!("{}: {}", f.step, f.reason)).collect::<Vec<_>>();
    let mut failed = match footage(&session, folder, &[], shell)? {
        Footage::Measured(failed) => reasons(failed),
        Footage::Ended(failed) => return Err(CliError::input(reasons(failed).join("\n"))),
    };
    let (impacts, first, last) = (folder.join("impacts.csv"), rigid_model(folder, shell)?, folder.join("model-found.toml"));
    let mut step = |words: &[&OsStr], model: &Path, out: &Path| {
        let line: Vec<&OsStr> = words.iter().copied().chain(table_words(&session, &impacts, model)).collect();
        match shell.run_step(&line, out) {
            // What could be used is judged all the same.
            Err(e) if e.kind == Kind::SomeFailed => note_once(&mut failed, e.message),
            other => other?,
        }
        Ok::<(), CliError>(())
    };
    let (mut ledger, mut after) = (Vec::new(), None);
    let table = ImpactTable::read(&impacts)?;
    let judged = table.rows.len() >= FEWEST_IMPACTS;
    if !judged {
        shell.say(format_args!("Fewer than {FEWEST_IMPACTS} shots are too few to judge a model."));
    } else {
        step(&[OsStr::new("compare")], &first, folder)?;
        step(&[OsStr::new("diagnose"), OsStr::new("--auto"), OsStr::new("-o"), last.as_os_str()], &first, folder)?;
        ledger = staircase(&first, &last, &impacts, shell)?;
        if ledger.len() > 1 {
            let again = folder.join("found");
            step(&[OsStr::new("compare")], &last, &again)?;
            after = read(&again.join("compare.json"));
        }
    }
    let mut results = read_session_results(&session, folder);
    (results.ledger, results.after) = (ledger, after);
    // What an earlier run found is of other shots.
    results.comparison = results.comparison.filter(|_| judged);
    results.diagnosis = results.diagnosis.filter(|_| judged);
    if let Some(stated) = &results.comparison {
        results.at_its_best = session_at_its_best(&session, &impacts, &first, stated).ok();
    }
    let diagnosis = results.diagnosis.clone();
    let report = folder.join("report.html");
    shell.write(&report, session_report(&results).as_bytes())?;
    let rig: Option<StereoRig> = read(&folder.join("calibration.json"));
    let square = rig.and_then(|r| r.square_mm);
    let named_first = diagnosis.as_ref().and_then(|d| d.candidates.first()).map(|c| (c.effect.clone(), c.probability));
    Ok(Outcome {
        report,
        shots_measured: table.rows.len(),
        square_stated_mm: 1e3 * session.board.square_m,
        square_mm: square.as_ref().map(|s| s.mean),
        square_sd_mm: square.as_ref().map(|s| s.sd),
        ball_speed_95_m_s: speed_interval(&table),
        heldout_error_first: results.ledger.first().map(|l| l.heldout_error).or_else(|| results.comparison.as_ref().map(|c| c.heldout_error)),
        heldout_error_last: results.ledger.last().map(|l| l.heldout_error),
        noise_floor: results.ledger.last().map(|l| l.noise_floor).or_else(|| results.comparison.as_ref().map(|c| c.noise_floor)),
        verdict: diagnosis.map(|d| d.verdict.to_string()),
        named_first,
        found: results.ledger.last().map(|l| l.effects.iter().filter(|e| *e != FOUND_EFFECT).cloned().collect()).unwrap_or_default(),
        formula: results.ledger.last().is_some_and(|l| l.effects.iter().any(|e| e == FOUND_EFFECT)),
        hidden: None,
        failed,
    })
}

/// Notes the rows that a step could not use: the steps on the table have them in common.
fn note_once(failed: &mut Vec<String>, rows: String) {
    if !failed.contains(&rows) {
        failed.push(rows);
    }
}

/// The models from the first to the one `diagnose --auto` arrived at.
fn staircase(first: &Path, last: &Path, impacts: &Path, shell: &Shell) -> Result<Vec<LedgerEntry>, CliError> {
    let ledger = LedgerFile::read(first, shell)?.ledger;
    let text = std::fs::read(last).map_err(|e| CliError::input(format!("{}: {e}", last.display())))?;
    let data = sha256_file(impacts).map_err(CliError::input)?;
    Ok(ledger.path_to(&sha256_hex(&text), &data).into_iter().cloned().collect())
}

fn read<T: serde::de::DeserializeOwned>(path: &Path) -> Option<T> {
    read_text(path, LARGEST_TEXT).ok().and_then(|t| serde_json::from_str(&t).ok())
}

/// Median half width of the 95 % interval of the ball's speed after impact, m/s.
fn speed_interval(table: &ImpactTable) -> Option<f64> {
    upper_median(table.rows.iter().filter_map(|r| {
        let v = ["ball_out_vx", "ball_out_vy", "ball_out_vz"].map(|c| r.get(c).map(|m| (m.value, m.sd)));
        let [Some((x, Some(sx))), Some((y, Some(sy))), Some((z, Some(sz)))] = v else { return None };
        let speed = (x * x + y * y + z * z).sqrt().max(1e-9);
        Some(HOLD_95_PERCENT * ((x * sx).powi(2) + (y * sy).powi(2) + (z * sz).powi(2)).sqrt() / speed)
    }))
}

/// What was done, the three figures that matter, and where the report is.
fn tell(o: &Outcome, shell: &Shell) {
    shell.say("\nDone: cameras calibrated from the checkerboards, racket and ball followed through every frame, the shots measured,");
    shell.say(match o.verdict {
        Some(_) => "compared with a rigid racket and ball, and searched for what that model is missing.",
        None => "and that is where this ends: they are too few to judge a model by.",
    });
    if let (Some(mean), Some(sd)) = (o.square_mm, o.square_sd_mm) {
        shell.say(format_args!("  1. a {:.0} mm square, measured again in 3-D on boards held out: {mean:.3} mm, scatter {sd:.3} mm", o.square_stated_mm));
    }
    if let Some(width) = o.ball_speed_95_m_s {
        shell.say(format_args!("  2. the ball's speed after impact, over {} shots: known to ±{width:.2} m/s (95 %)", o.shots_measured));
    }
    let floor = o.noise_floor.map_or_else(String::new, |f| format!("; without fault it would be {f:.2}"));
    match (o.heldout_error_first, o.heldout_error_last) {
        (Some(first), Some(last)) if o.formula || !o.found.is_empty() => shell.say(format_args!(
            "  3. error on shots the fit never saw, in units of their noise: {first:.2} with the rigid model, {last:.2} with {} added{floor}",
            added(o)
        )),
        (Some(first), last) => {
            let error = last.unwrap_or(first);
            shell.say(format_args!("  3. error on shots the fit never saw, in units of their noise: {error:.2}; nothing had to be added{floor}"));
        }
        _ => {}
    }
    shell.say(format_args!("Report: {}", o.report.display()));
}

/// What the last model has that the first had not, in words.
fn added(o: &Outcome) -> String {
    match (o.found.is_empty(), o.formula) {
        (true, true) => "a formula".to_owned(),
        (false, true) => format!("{} and a formula for what its form leaves", o.found.join(" and ")),
        (_, false) => o.found.join(" and "),
    }
}

/// The end of the game.
fn reveal(o: &Outcome, hidden: Option<&Entry>, shell: &Shell) {
    let name = hidden.map_or_else(|| "nothing".to_owned(), |e| format!("{} ({})", e.name, e.law));
    shell.say(format_args!("\nHidden in this world: {name}."));
    shell.say(judged(o, hidden));
}

/// What the diagnosis is worth.
fn judged(o: &Outcome, hidden: Option<&Entry>) -> String {
    if o.verdict.is_none() {
        return "So few shots cannot show it: no diagnosis was made.".to_owned();
    }
    let named = if o.found.is_empty() && !o.formula { "nothing".to_owned() } else { added(o) };
    let Some(e) = hidden else {
        return format!("The diagnosis added {named}: {}.", if named == "nothing" { "right" } else { "a false alarm" });
    };
    let right = if o.found == [e.name] {
        if o.formula { "right, and the formula takes up what its form here is other than the catalogue's" } else { "right" }
    } else if o.found.iter().any(|f| f == e.name) {
        "right, and more beside it that is not there"
    } else if o.found.iter().any(|f| e.aliases.contains(&f.as_str())) {
        "an effect that these data can hardly tell from it"
    } else if !e.in_catalogue && o.verdict.as_deref() == Some("unexplained") {
        "right: it is in no catalogue, and the verdict is `unexplained`"
    } else {
        "wrong"
    };
    format!("The diagnosis named {named}: {right}.")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn truth_rows_that_fail_in_every_step_are_named_once() {
        let mut failed = vec!["shots: 1 of 80 shots failed:\n  shot-3: no ball".to_owned()];
        let rows = "1 of 79 impacts cannot be used:\n  shot-7: no deviation";
        ["compare", "diagnose", "compare"].iter().for_each(|_| note_once(&mut failed, rows.to_owned()));
        assert_eq!(failed[1..], [rows]);
    }

    #[test]
    fn truth_the_end_of_the_game_counts_what_is_not_there() {
        let hidden = entry("frame-vibration").expect("known");
        let after = |found: &[&str], formula: bool, verdict: Option<&str>, hidden: Option<&Entry>| {
            let outcome = Outcome {
                report: PathBuf::new(),
                shots_measured: 80,
                square_stated_mm: 60.0,
                square_mm: None,
                square_sd_mm: None,
                ball_speed_95_m_s: None,
                heldout_error_first: None,
                heldout_error_last: None,
                noise_floor: None,
                verdict: verdict.map(str::to_owned),
                named_first: None,
                found: found.iter().map(|f| (*f).to_owned()).collect(),
                formula,
                hidden: None,
                failed: Vec::new(),
            };
            judged(&outcome, hidden)
        };
        let missing = Some("effect-missing");
        assert_eq!(after(&["frame-vibration"], false, missing, Some(hidden)), "The diagnosis named frame-vibration: right.");
        assert!(after(&["frame-vibration", "hand-mass"], false, missing, Some(hidden)).contains("more beside it that is not there"));
        assert!(after(&["frame-vibration"], true, missing, Some(hidden)).contains("takes up"));
        assert!(after(&["string-tilt"], false, missing, Some(hidden)).ends_with("wrong."));
        assert!(after(&[], false, Some("adequate"), Some(hidden)).ends_with("named nothing: wrong."));
        assert!(after(&[], false, Some("adequate"), None).ends_with("nothing: right."));
        assert!(after(&[], true, missing, None).ends_with("a false alarm."));
        assert!(after(&[], false, None, Some(hidden)).contains("no diagnosis was made"));
    }
}
