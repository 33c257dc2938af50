//! `sweetspot add`.

use super::Shell;
use super::error::CliError;
use std::path::PathBuf;

/// The model file with an effect added
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// Name of the effect (see `sweetspot effects`)
    pub effect: String,
    /// Model file
    #[arg(long, value_name = "F")]
    pub model: PathBuf,
    /// Where the new model goes
    #[arg(short = 'o', long = "output", value_name = "F2")]
    pub output: PathBuf,
}

pub fn run(arguments: Arguments, shell: &Shell) -> Result<(), CliError> {
    let _ = (arguments, shell);
    Err(CliError::input("being built"))
}
