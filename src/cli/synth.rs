//! `sweetspot synth`.

use super::Shell;
use super::error::CliError;
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
    let _ = (arguments, shell);
    Err(CliError::input("being built"))
}
