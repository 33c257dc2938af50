//! `sweetspot shots`.

use super::Shell;
use super::error::CliError;
use std::path::PathBuf;

/// Tracks to shot.json and impacts.csv
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// The session folder (holds session.toml)
    pub session: PathBuf,
}

pub fn run(arguments: Arguments, shell: &Shell) -> Result<(), CliError> {
    let _ = (arguments, shell);
    Err(CliError::input("being built"))
}
