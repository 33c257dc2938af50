//! `sweetspot validate`.

use super::Shell;
use super::error::CliError;
use std::path::PathBuf;

/// Batch: everything that is still to do for a session, against a model
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// The session folder (holds session.toml)
    pub session: PathBuf,
    /// Model file
    #[arg(long, value_name = "F")]
    pub model: PathBuf,
}

pub fn run(arguments: Arguments, shell: &Shell) -> Result<(), CliError> {
    let _ = (arguments, shell);
    Err(CliError::input("being built"))
}
