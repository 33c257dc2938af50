//! `sweetspot fit`.

use super::Shell;
use super::error::CliError;
use std::path::PathBuf;

/// Fits the free parameters of the model to the impacts
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// Impacts table (CSV)
    #[arg(long, value_name = "F")]
    pub impacts: PathBuf,
    /// Racket file; may be given more than once, a row's `racket` column picks by name
    #[arg(long, value_name = "F", required = true)]
    pub racket: Vec<PathBuf>,
    /// Ball file; may be given more than once, a row's `ball` column picks by name
    #[arg(long, value_name = "F", required = true)]
    pub ball: Vec<PathBuf>,
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
