//! `sweetspot synth`.

use super::Shell;
use super::error::CliError;
use super::set_aside::remove_if_there;
use crate::limited_file::{LARGEST_TEXT, read_text};
use crate::synthetic::scenario::{Scenario, TableFiles};
use crate::synthetic::footage_spec::FootageSpec;
use crate::synthetic::footage_world::{FootageWorld, FootageWorldError};
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
            if output.join("impacts.csv").exists() && !output.join(TRUTH).exists() {
                return Err(CliError::input(format!("{}: there is a table already, and no {TRUTH} beside it", output.display())).hint("give another folder"));
            }
            for (name, text) in TableFiles::of(&made).map_err(|e| named(&e))?.0 {
                shell.write(&output.join(name), text.as_bytes())?;
            }
            shell.say(format!("{} impacts in {}; what is true of them stands in truth.json", made.table.rows.len(), output.display()));
            shell.print_json(&made.truth)
        }
        Scenario::Footage(spec) => make_room(output).and_then(|()| film(&spec, output, shell)).map_err(|mut e| {
            e.message = format!("{}: {}", file.display(), e.message);
            e
        }),
    }
}

/// What is true of a world, beside what it shows.
const TRUTH: &str = "truth.json";

/// A session that was rendered earlier makes room for this one, pictures of both in one folder would be a third; a laboratory's own stays.
fn make_room(folder: &Path) -> Result<(), CliError> {
    let file = folder.join("session.toml");
    if !file.exists() {
        return Ok(());
    }
    if !is_rendered(folder) {
        return Err(CliError::input(format!("{}: there is a session already", folder.display())).hint("give another folder"));
    }
    for part in ["calib", "axes", "shots"] {
        match std::fs::remove_dir_all(folder.join(part)) {
            Err(e) if e.kind() != std::io::ErrorKind::NotFound => return Err(CliError::output(format!("{}: {e}", folder.join(part).display()))),
            _ => {}
        }
    }
    remove_if_there(&folder.join(TRUTH))
}

/// Whether a session is one of [`film`]'s.
pub fn is_rendered(folder: &Path) -> bool {
    read_text(&folder.join("session.toml"), LARGEST_TEXT).is_ok_and(|t| t.starts_with("name = \"synthetic "))
}

/// Renders a session into `folder`, with `truth.json` beside it.
pub fn film(spec: &FootageSpec, folder: &Path, shell: &Shell) -> Result<(), CliError> {
    let world = FootageWorld::new(spec).map_err(CliError::input)?;
    let bar = shell.progress(world.pictures() as u64, "pictures");
    let sink = |name: &str, bytes: &[u8]| -> std::io::Result<()> {
        let path = folder.join(name);
        if let Some(parent) = path.parent() {
            std::fs::create_dir_all(parent)?;
        }
        // Thousands of frames: written plainly, the truth last and whole, so that a broken run is seen as such.
        std::fs::write(&path, bytes)
    };
    let truth = world.film(&sink, &|| bar.inc(1), shell.cancel_flag()).map_err(|e| match e {
        FootageWorldError::Cancelled => CliError::interrupted(),
        FootageWorldError::Sink(e) => CliError::output(e),
        e => CliError::input(e),
    })?;
    bar.finish_and_clear();
    let text = serde_json::to_string(&truth).map_err(CliError::output)?;
    shell.write(&folder.join(TRUTH), text.as_bytes())?;
    shell.say(format!("{} pictures of {} shots in {}; what is true of them stands in truth.json", world.pictures(), spec.shots, folder.display()));
    Ok(())
}
