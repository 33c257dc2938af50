//! `sweetspot explore`.

use super::Shell;
use super::error::CliError;

/// What-if studies of the model and of the measurement
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// Which study
    pub study: String,
}

pub fn run(arguments: Arguments, shell: &Shell) -> Result<(), CliError> {
    let _ = (arguments, shell);
    Err(CliError::input("being built"))
}
