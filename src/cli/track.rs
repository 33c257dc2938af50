//! `sweetspot track`.

use super::Shell;
use super::error::CliError;
use std::path::PathBuf;

/// Footage to tracks.csv and points.csv
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// The session folder (holds session.toml)
    pub session: PathBuf,
    /// Only this shot (may be given more than once)
    #[arg(long, value_name = "ID")]
    pub shot: Vec<String>,
}

pub fn run(arguments: Arguments, shell: &Shell) -> Result<(), CliError> {
    let _ = (arguments, shell);
    Err(CliError::input("being built"))
}
