//! `sweetspot demo`: the whole chain on the sample the program carries, or on a world whose hidden effect nobody chose.

use super::Shell;
use super::error::{CliError, Kind};
use super::impacts_input::{ledger_path, read_ledger};
use super::synth::film;
use crate::calibration::StereoRig;
use crate::impact_table::ImpactTable;
use crate::provenance::{sha256_file, sha256_hex};
use crate::report::{read_session_results, session_report};
use crate::session::Session;
use crate::synthetic::footage_world::FootageSpec;
use crate::synthetic::hidden::{Entry, Hidden, Seen, entry, playable};
use crate::synthetic::look::Setting;
use crate::synthetic::sample;
use crate::validation::comparison::Comparison;
use crate::validation::diagnosis::Diagnosis;
use crate::validation::ledger::LedgerEntry;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};

/// The whole chain on the embedded sample; opens with a report
///
/// With --hidden-effect a session is rendered whose hidden effect is revealed only at the end: play against the
/// diagnosis, or let it play alone.
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// Folder for the sample and its results (default: demo-results, or demo-hidden-SEED)
    pub dir: Option<PathBuf>,
    /// Render a world with this effect hidden; `random` (or nothing) lets chance choose, `none` hides nothing
    #[arg(long, value_name = "NAME", num_args = 0..=1, default_missing_value = "random")]
    pub hidden_effect: Option<String>,
    /// How strong the hidden effect is (1: as large as it is in the field)
    #[arg(long, default_value_t = 1.0, requires = "hidden_effect")]
    pub strength: f64,
    /// Shots to render
    #[arg(long, default_value_t = 44, requires = "hidden_effect")]
    pub shots: usize,
    /// Seed of the rendered world (default: from the clock)
    #[arg(long, requires = "hidden_effect")]
    pub seed: Option<u64>,
}

/// What the demonstration found, for `--json`.
#[derive(Debug, serde::Serialize)]
struct Outcome {
    report: PathBuf,
    shots_measured: usize,
    square_mm: Option<f64>,
    square_sd_mm: Option<f64>,
    /// Half of the 95 % interval of the ball's speed after impact, median over the shots, m/s.
    ball_speed_95_m_s: Option<f64>,
    heldout_error_first: Option<f64>,
    heldout_error_last: Option<f64>,
    verdict: Option<String>,
    found: Vec<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    hidden: Option<Vec<String>>,
}

pub fn run(arguments: Arguments, shell: &Shell) -> Result<(), CliError> {
    let Some(wish) = &arguments.hidden_effect else {
        let folder = arguments.dir.clone().unwrap_or_else(|| PathBuf::from("demo-results"));
        let files: Vec<_> = sample::files().collect();
        if files.is_empty() {
            return Err(CliError::input("this program was built without the sample (footage-samples was missing)").hint("sweetspot demo --hidden-effect random"));
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
        return shell.print_json(&outcome);
    };
    let seed = arguments.seed.unwrap_or_else(|| std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).map_or(1, |d| d.subsec_nanos().into()));
    let chosen = choose(wish, seed)?;
    let folder = arguments.dir.clone().unwrap_or_else(|| PathBuf::from(format!("demo-hidden-{seed}")));
    let session = folder.join("session");
    make_room(&session, shell)?;
    let setting = if chosen.is_some_and(|e| e.seen == Seen::Court) { Setting::Court } else { Setting::Lab };
    let hidden = chosen.map(|e| vec![Hidden::new(e.name, arguments.strength)]).unwrap_or_default();
    let spec = FootageSpec { hidden, frames_before: 16, frames_after: 16, ..FootageSpec::new(setting, arguments.shots, seed) };
    shell.say(format_args!("A world with seed {seed}: what is hidden in it is told at the end ({} knows it)", session.join("truth.json").display()));
    film(&spec, &session, shell)?;
    let mut outcome = chain(&folder, shell)?;
    outcome.hidden = Some(chosen.iter().map(|e| e.name.to_owned()).collect());
    tell(&outcome, shell);
    reveal(&outcome, chosen, shell);
    shell.print_json(&outcome)
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

/// An earlier rendered session must go before another takes its place; nothing else is ever removed.
fn make_room(session: &Path, shell: &Shell) -> Result<(), CliError> {
    if !session.exists() {
        return Ok(());
    }
    let ours = std::fs::read_to_string(session.join("session.toml")).is_ok_and(|t| t.starts_with("name = \"synthetic "));
    if !shell.args.force || !ours {
        return Err(CliError::input(format!("{}: there is a session already", session.display()))
            .hint("give another folder")
            .hint("--force replaces a session that an earlier demonstration rendered"));
    }
    std::fs::remove_dir_all(session).map_err(CliError::output)
}

/// Everything from the checkerboards to the model that explains the shots, and one report.
fn chain(folder: &Path, shell: &Shell) -> Result<Outcome, CliError> {
    let session = Session::open(&folder.join("session"))?;
    match shell.run_step(&[OsStr::new("validate"), session.root.as_os_str()], folder) {
        Ok(()) => {}
        Err(e) if e.kind == Kind::SomeFailed => shell.say(&e.message),
        Err(e) => return Err(e),
    }
    let (impacts, first, last) = (folder.join("impacts.csv"), folder.join("model.toml"), folder.join("model-found.toml"));
    let diagnosis: Option<Diagnosis> = read(&folder.join("diagnosis.json"));
    let mut results = read_session_results(&session, folder);
    if diagnosis.is_some() {
        let mut words: Vec<&OsStr> = vec![OsStr::new("diagnose"), OsStr::new("--auto"), OsStr::new("-o"), last.as_os_str()];
        words.extend([OsStr::new("--impacts"), impacts.as_os_str(), OsStr::new("--model"), first.as_os_str()]);
        for (flag, files) in [("--racket", &session.racket_files), ("--ball", &session.ball_files)] {
            words.extend(files.iter().flat_map(|f| [OsStr::new(flag), f.as_os_str()]));
        }
        shell.run_step(&words, folder)?;
        results = read_session_results(&session, folder);
        results.ledger = staircase(&first, &last, &impacts)?;
        if results.ledger.len() > 1 {
            let before: Option<Comparison> = read(&folder.join("compare.json"));
            let again = folder.join("found");
            words.retain(|w| !["diagnose", "--auto", "-o"].contains(&w.to_string_lossy().as_ref()) && *w != last.as_os_str());
            words.insert(0, OsStr::new("compare"));
            if let Some(model) = words.iter_mut().find(|w| **w == first.as_os_str()) {
                *model = last.as_os_str();
            }
            shell.run_step(&words, &again)?;
            results.comparison = before;
            results.after = read(&again.join("compare.json"));
        }
    }
    let report = folder.join("report.html");
    shell.write(&report, session_report(&results).as_bytes())?;
    let rig: Option<StereoRig> = read(&folder.join("calibration.json"));
    let square = rig.and_then(|r| r.square_mm);
    let diagnosis: Option<Diagnosis> = read(&folder.join("diagnosis.json"));
    let table = ImpactTable::read(&impacts)?;
    Ok(Outcome {
        report,
        shots_measured: table.rows.len(),
        square_mm: square.as_ref().map(|s| s.mean),
        square_sd_mm: square.as_ref().map(|s| s.sd),
        ball_speed_95_m_s: speed_interval(&table),
        heldout_error_first: results.ledger.first().map(|l| l.heldout_error).or_else(|| results.comparison.as_ref().map(|c| c.heldout_error)),
        heldout_error_last: results.ledger.last().map(|l| l.heldout_error),
        verdict: diagnosis.map(|d| d.verdict.to_string()),
        found: results.ledger.last().map(|l| l.effects.clone()).unwrap_or_default(),
        hidden: None,
    })
}

/// The models from the first to the one `diagnose --auto` arrived at.
fn staircase(first: &Path, last: &Path, impacts: &Path) -> Result<Vec<LedgerEntry>, CliError> {
    let ledger = read_ledger(&ledger_path(first))?;
    let text = std::fs::read(last).map_err(|e| CliError::input(format!("{}: {e}", last.display())))?;
    let data = sha256_file(impacts).map_err(CliError::input)?;
    Ok(ledger.path_to(&sha256_hex(&text), &data).into_iter().cloned().collect())
}

fn read<T: serde::de::DeserializeOwned>(path: &Path) -> Option<T> {
    std::fs::read_to_string(path).ok().and_then(|t| serde_json::from_str(&t).ok())
}

/// Median half width of the 95 % interval of the ball's speed after impact, m/s.
fn speed_interval(table: &ImpactTable) -> Option<f64> {
    let mut widths: Vec<f64> = table
        .rows
        .iter()
        .filter_map(|r| {
            let v = ["ball_out_vx", "ball_out_vy", "ball_out_vz"].map(|c| r.get(c).map(|m| (m.value, m.sd)));
            let [Some((x, Some(sx))), Some((y, Some(sy))), Some((z, Some(sz)))] = v else { return None };
            let speed = (x * x + y * y + z * z).sqrt().max(1e-9);
            Some(1.96 * ((x * sx).powi(2) + (y * sy).powi(2) + (z * sz).powi(2)).sqrt() / speed)
        })
        .collect();
    widths.sort_by(f64::total_cmp);
    widths.get(widths.len() / 2).copied()
}

/// What was done, the three figures that matter, and where the report is.
fn tell(o: &Outcome, shell: &Shell) {
    shell.say("\nDone: cameras calibrated from the checkerboards, racket and ball followed through every frame, the shots measured,");
    shell.say("compared with a rigid racket and ball, and searched for what that model is missing.");
    if let (Some(mean), Some(sd)) = (o.square_mm, o.square_sd_mm) {
        shell.say(format_args!("  1. a 60 mm square, measured again in 3-D on boards held out: {mean:.3} mm, scatter {sd:.3} mm"));
    }
    if let Some(width) = o.ball_speed_95_m_s {
        shell.say(format_args!("  2. the ball's speed after impact, over {} shots: known to ±{width:.2} m/s (95 %)", o.shots_measured));
    }
    match (o.heldout_error_first, o.heldout_error_last) {
        (Some(first), Some(last)) => {
            let added = if o.found.is_empty() { "nothing had to be added".to_owned() } else { format!("with {} added", o.found.join(" and ")) };
            shell.say(format_args!("  3. error on shots the fit never saw, in units of their noise: {first:.2} with the rigid model, {last:.2} {added}"));
        }
        (Some(first), None) => shell.say(format_args!("  3. error on shots the fit never saw, in units of their noise: {first:.2} with the rigid model")),
        _ => {}
    }
    shell.say(format_args!("Report: {}", o.report.display()));
}

/// The end of the game.
fn reveal(o: &Outcome, hidden: Option<&Entry>, shell: &Shell) {
    let named = if o.found.is_empty() { "nothing".to_owned() } else { o.found.join(" and ") };
    match hidden {
        None => {
            shell.say("\nHidden in this world: nothing.");
            shell.say(if o.found.is_empty() { "The diagnosis found nothing missing: right." } else { "The diagnosis added something: a false alarm." });
        }
        Some(e) => {
            shell.say(format_args!("\nHidden in this world: {} ({}).", e.name, e.law));
            let right = if o.found.iter().any(|f| f == e.name) {
                "right"
            } else if o.found.iter().any(|f| e.aliases.contains(&f.as_str())) {
                "an effect that these data can hardly tell from it"
            } else if !e.in_catalogue && o.verdict.as_deref() == Some("unexplained") {
                "right: it is in no catalogue, and the verdict is `unexplained`"
            } else {
                "wrong"
            };
            shell.say(format_args!("The diagnosis named {named}: {right}."));
        }
    }
}
