//! `sweetspot synth`.

use super::Shell;
use super::error::CliError;
use crate::synthetic::scenario::{Scenario, TableFiles};
use std::path::PathBuf;

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
    let text = std::fs::read_to_string(file).map_err(|e| named(&e).hint("give a scenario file; docs/synthetic.md describes it"))?;
    match Scenario::parse(&text).map_err(|e| named(&e).hint("docs/synthetic.md lists the keys"))? {
        Scenario::Table(table) => {
            let made = table.generate().map_err(|e| named(&e))?;
            for (name, text) in TableFiles::of(&made).map_err(|e| named(&e))?.0 {
                shell.write(&arguments.output.join(name), text.as_bytes())?;
            }
            shell.say(format!("{} impacts in {}; what is true of them stands in truth.json", made.table.rows.len(), arguments.output.display()));
            shell.print_json(&made.truth)
        }
    }
}
