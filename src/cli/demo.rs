//! `sweetspot demo`.

use super::Shell;
use super::error::CliError;
use std::path::PathBuf;

/// The whole chain on the embedded sample; opens with a report
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// Folder for the sample and its results (default: demo-results)
    pub dir: Option<PathBuf>,
}

pub fn run(arguments: Arguments, shell: &Shell) -> Result<(), CliError> {
    let _ = (arguments, shell);
    Err(CliError::input("being built"))
}
