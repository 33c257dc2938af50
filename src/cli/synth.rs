//! `sweetspot synth`.

use super::Shell;
use super::error::CliError;
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
    let file = &arguments.scenario;
    let named = |e: &dyn std::fmt::Display| CliError::input(format!("{}: {e}", file.display()));
    let text = read_text(file, LARGEST_TEXT).map_err(|e| named(&e).hint("give a scenario file; docs/synthetic.md describes it"))?;
    match Scenario::parse(&text).map_err(|e| named(&e).hint("docs/synthetic.md lists the keys"))? {
        Scenario::Table(table) => {
            let made = table.generate().map_err(|e| named(&e))?;
            for (name, text) in TableFiles::of(&made).map_err(|e| named(&e))?.0 {
                shell.write(&arguments.output.join(name), text.as_bytes())?;
            }
            shell.say(format!("{} impacts in {}; what is true of them stands in truth.json", made.table.rows.len(), arguments.output.display()));
            shell.print_json(&made.truth)
        }
        Scenario::Footage(spec) => film(&spec, &arguments.output, shell).map_err(|mut e| {
            e.message = format!("{}: {}", file.display(), e.message);
            e
        }),
    }
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
    shell.write(&folder.join("truth.json"), text.as_bytes())?;
    shell.say(format!("{} pictures of {} shots in {}; what is true of them stands in truth.json", world.pictures(), spec.shots, folder.display()));
    Ok(())
}
