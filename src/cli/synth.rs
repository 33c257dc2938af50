//! `sweetspot synth`.

use super::Shell;
use super::error::CliError;
use super::set_aside::{listed, remove_if_there, set_made_of_table_aside};
use crate::limited_file::{LARGEST_TABLE, LARGEST_TEXT, read_text};
use crate::provenance::holds;
use crate::synthetic::footage_spec::FootageSpec;
use crate::synthetic::footage_world::{FootageWorld, FootageWorldError};
use crate::synthetic::scenario::{Scenario, TableFiles};
use std::path::{Path, PathBuf};

/// Renders a session with known truth from a scenario file
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// Scenario file (TOML)
    pub scenario: PathBuf,
    /// Folder of the session to write
    #[arg(short = 'o', long = "output", value_name = "SESSION")]
    pub output: PathBuf,
}

pub fn run(arguments: Arguments, shell: &Shell) -> Result<(), CliError> {
    let (file, output) = (&arguments.scenario, &arguments.output);
    let named = |e: &dyn std::fmt::Display| CliError::input(format!("{}: {e}", file.display()));
    let text = read_text(file, LARGEST_TEXT).map_err(|e| named(&e).hint("give a scenario file; docs/synthetic.md describes it"))?;
    match Scenario::parse(&text).map_err(|e| named(&e).hint("docs/synthetic.md lists the keys"))? {
        Scenario::Table(table) => {
            let made = table.generate().map_err(|e| named(&e))?;
            if !is_generated(output) {
                refuse_others(output, &["session.toml", "racket.toml", "ball.toml", "model.toml", "impacts.csv", TRUTH])?;
            }
            let files = TableFiles::of(&made).map_err(|e| named(&e))?.0;
            // What was made of another table would stand beside this one as if made of it.
            if files.iter().map(|(name, text)| (output.join(name), text)).any(|(file, text)| file.is_file() && !holds(&file, text.as_bytes())) {
                let kept = set_made_of_table_aside(output)?;
                if !kept.is_empty() {
                    shell.say(format_args!("what was made of the table before is kept as {}", listed(&kept)));
                }
            }
            // The truth first: by it a run that was broken off knows its files again.
            for (name, text) in files.into_iter().rev() {
                shell.write(&output.join(name), text.as_bytes())?;
            }
            shell.say(format!("{} impacts in {}; what is true of them stands in truth.json", made.table.rows.len(), output.display()));
            shell.print_json(&made.truth)
        }
        Scenario::Footage(spec) => {
            let filmed = film(&spec, output, shell).map_err(|mut e| {
                e.message = format!("{}: {}", file.display(), e.message);
                e
            })?;
            shell.print_json(&filmed)
        }
    }
}

/// What was rendered, for `--json`: what is true of it is as large as all tracks together, and stands in its file.
#[derive(Debug, serde::Serialize)]
pub struct Filmed {
    #[serde(serialize_with = "super::as_shown")]
    session: PathBuf,
    #[serde(serialize_with = "super::as_shown")]
    truth: PathBuf,
    pictures: usize,
    shots: usize,
}

/// What is true of a world, beside what it shows.
const TRUTH: &str = "truth.json";

/// The scenario of a session that is being rendered; it goes when all of it is there.
const RENDERING: &str = "rendering.json";

/// What [`film`] makes anew.
const PICTURES: [&str; 3] = ["calib", "axes", "shots"];

/// Refuses a folder with files of these names: they are somebody's.
fn refuse_others(folder: &Path, names: &[&str]) -> Result<(), CliError> {
    match names.iter().find(|name| folder.join(name).symlink_metadata().is_ok()) {
        None => Ok(()),
        Some(name) => Err(CliError::input(format!("{}: there is {name} already, which no earlier `synth` of this kind has written", folder.display()))
            .hint("give another folder")),
    }
}

/// Whether a folder holds a table of an earlier run: what is true of tables is said in other words than what is true of footage.
fn is_generated(folder: &Path) -> bool {
    let truth = read_text(&folder.join(TRUTH), LARGEST_TABLE).ok().and_then(|t| serde_json::from_str::<serde_json::Map<_, serde_json::Value>>(&t).ok());
    truth.is_some_and(|t| ["rows", "session_offsets_sd", "understated"].iter().all(|key| t.contains_key(*key)))
}

/// A session that was rendered earlier makes room for this one, and so does one that was broken off: pictures of both in one folder would be a
/// third. A laboratory's own stays.
fn make_room(spec: &FootageSpec, folder: &Path, shell: &Shell) -> Result<(), CliError> {
    if !is_rendered(folder) && unfinished(folder).is_none() {
        let names = [&PICTURES[..], &["session.toml", "racket.toml", "ball.toml", TRUTH]].concat();
        refuse_others(folder, &names)?;
    }
    let scenario = serde_json::to_string_pretty(spec).map_err(CliError::output)? + "\n";
    shell.write(&folder.join(RENDERING), scenario.as_bytes())?;
    for file in ["session.toml", TRUTH] {
        remove_if_there(&folder.join(file))?;
    }
    for part in PICTURES {
        match std::fs::remove_dir_all(folder.join(part)) {
            Err(e) if e.kind() != std::io::ErrorKind::NotFound => return Err(CliError::output(format!("{}: {e}", folder.join(part).display()))),
            _ => {}
        }
    }
    Ok(())
}

/// Whether a session is one of [`film`]'s, whole.
pub fn is_rendered(folder: &Path) -> bool {
    let named = read_text(&folder.join("session.toml"), LARGEST_TEXT).is_ok_and(|t| t.starts_with("name = \"synthetic "));
    named && folder.join(TRUTH).exists() && !folder.join(RENDERING).exists()
}

/// The scenario of a session of [`film`]'s that was broken off.
pub fn unfinished(folder: &Path) -> Option<FootageSpec> {
    read_text(&folder.join(RENDERING), LARGEST_TEXT).ok().and_then(|t| serde_json::from_str(&t).ok())
}

/// The scenario of a session of [`film`]'s, whole.
pub fn rendered_from(folder: &Path) -> Option<FootageSpec> {
    #[derive(serde::Deserialize)]
    struct Truth {
        rendered_from: FootageSpec,
    }
    if !is_rendered(folder) {
        return None;
    }
    read_text(&folder.join(TRUTH), LARGEST_TABLE).ok().and_then(|t| serde_json::from_str::<Truth>(&t).ok()).map(|t| t.rendered_from)
}

/// Renders a session into `folder`, with `truth.json` beside it.
pub fn film(spec: &FootageSpec, folder: &Path, shell: &Shell) -> Result<Filmed, CliError> {
    let world = FootageWorld::new(spec).map_err(CliError::input)?;
    make_room(spec, folder, shell)?;
    let bar = shell.progress(world.pictures() as u64, "pictures");
    let sink = |name: &str, bytes: &[u8]| -> std::io::Result<()> {
        let path = folder.join(name);
        if let Some(parent) = path.parent() {
            std::fs::create_dir_all(parent)?;
        }
        // Thousands of frames: written plainly; by the scenario that still stands beside them a broken run is seen as such.
        std::fs::write(&path, bytes)
    };
    let mut truth = world.film(&sink, &|| bar.inc(1), shell.cancel_flag()).map_err(|e| match e {
        FootageWorldError::Cancelled => CliError::interrupted(),
        FootageWorldError::Sink(e) => CliError::output(e),
        e => CliError::input(e),
    })?;
    bar.finish_and_clear();
    if let Some(truth) = truth.as_object_mut() {
        truth.insert("rendered_from".into(), serde_json::to_value(spec).map_err(CliError::output)?);
    }
    let text = serde_json::to_string(&truth).map_err(CliError::output)?;
    shell.write(&folder.join(TRUTH), text.as_bytes())?;
    remove_if_there(&folder.join(RENDERING))?;
    shell.say(format!("{} pictures of {} shots in {}; what is true of them stands in truth.json", world.pictures(), spec.shots, folder.display()));
    Ok(Filmed { session: folder.to_path_buf(), truth: folder.join(TRUTH), pictures: world.pictures(), shots: spec.shots })
}
