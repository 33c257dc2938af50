//! `sweetspot effects`.

use super::Shell;
use super::error::CliError;
use std::path::PathBuf;

/// The catalogue of physical effects
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// Only this effect
    pub effect: Option<String>,
}

pub fn run(arguments: Arguments, shell: &Shell) -> Result<(), CliError> {
    let _ = (arguments, shell);
    Err(CliError::input("being built"))
}
