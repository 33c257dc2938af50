//! `sweetspot add`.

use super::Shell;
use super::earlier_output::Output;
use super::error::CliError;
use super::set_aside::set_model_aside;
use crate::impact::model_file::with_effect_added;
use crate::impact::{Base, Model, ModelError, effect_card};
use crate::limited_file::{LARGEST_TEXT, read_text};
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
    let unreadable = |e: std::io::Error| ModelError::Unreadable { path: arguments.model.clone(), message: e.to_string() };
    let text = read_text(&arguments.model, LARGEST_TEXT).map_err(unreadable)?;
    let changed = with_effect_added(&text, &arguments.effect, &arguments.model)?;
    shell.check_output(&arguments.output, Output::Model)?;
    let kept = set_model_aside(&arguments.output, &arguments.model, &changed)?;
    shell.write_output(&arguments.output, Output::Model, changed.as_bytes())?;
    let card = effect_card(&arguments.effect);
    shell.print_json(&serde_json::json!({ "model": arguments.output.to_string_lossy(), "added": card }))?;
    let free: Vec<&str> = card.iter().flat_map(|c| c.parameters).filter(|p| p.fit).map(|p| p.name).collect();
    shell.say(format_args!("{}: `{}` added; free for `sweetspot fit`: {}", arguments.output.display(), arguments.effect, free.join(", ")));
    shell.say_kept(&arguments.output, kept.as_deref());
    let base = Model::parse(&changed, &arguments.model)?.base();
    if let Some(card) = card {
        let (name, how) = if base == Base::Rigid { ("rigid", card.bases.rigid) } else { ("viscoelastic", card.bases.viscoelastic) };
        shell.say(format_args!("in base \"{name}\": {how}"));
    }
    Ok(())
}
