//! `sweetspot calibrate`.

use super::Shell;
use super::error::CliError;
use std::path::PathBuf;

/// Checkerboard pairs to calibration.json and calibration.yml
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// The session folder (holds session.toml)
    pub session: PathBuf,
}

pub fn run(arguments: Arguments, shell: &Shell) -> Result<(), CliError> {
    let _ = (arguments, shell);
    Err(CliError::input("being built"))
}
