//! `sweetspot fit`.

use super::Shell;
use super::earlier_output::Output;
use super::error::CliError;
use super::impacts_input::ImpactsInput;
use super::set_aside::set_model_aside;
use crate::impact::model_file::with_values;
use crate::validation::comparison::{parameter_values, session_offsets};
use crate::validation::fit::{FitOptions, fit, fit_with_likely_offsets};
use crate::validation::forward::Library;
use crate::validation::heldout::held_out_error;
use crate::validation::structure::{BesideSmooth, structure_test};
use crate::validation::terminal::short;
use std::path::PathBuf;

/// Fits the free parameters of the model to the impacts
#[derive(Debug, clap::Args)]
pub struct Arguments {
    #[command(flatten)]
    pub input: ImpactsInput,
    /// Where the new model goes
    #[arg(short = 'o', long = "output", value_name = "F2")]
    pub output: PathBuf,
    /// Outlying numbers keep their full weight (default: they lose most of it)
    #[arg(long)]
    pub no_robust: bool,
}

/// Correlation beyond which two parameters are named: the impacts hardly tell them apart.
const TIED: f64 = 0.9;

pub fn run(arguments: Arguments, shell: &Shell) -> Result<(), CliError> {
    let input = &arguments.input;
    shell.keep(input.files.measured());
    shell.check_output(&arguments.output, Output::Model)?;
    let mut loaded = input.load("fit")?;
    loaded.observations.keeps_outliers = arguments.no_robust;
    let current = loaded.library.current();
    if current.parameters().is_empty() {
        return Err(
            CliError::input(format!("{}: no parameter is free", input.files.model.display())).hint("write fit = true beside the parameters that may move")
        );
    }
    let seen = loaded.observations.side(false);
    let options = FitOptions::default();
    let likely = fit_with_likely_offsets(current, &loaded.observations, &seen, &options)?;
    let fitted = &likely.fit;
    let structure = structure_test(fitted, &loaded.observations, &seen, BesideSmooth::All, input.seed);
    let parameters = parameter_values(current, fitted, structure.noise_scale);
    // As `compare` tells it of the new file: with offsets.
    let error = match &likely.unlikely {
        None => held_out_error(current, fitted, &loaded.observations)?,
        Some(_) => {
            let held = FitOptions { move_parameters: false, start_values: Some(fitted.values.clone()), ..options };
            held_out_error(current, &fit(current, &loaded.observations, &seen, &held, None)?, &loaded.observations)?
        }
    };
    let values: Vec<(String, f64)> = parameters.iter().map(|p| (p.name.clone(), p.value)).collect();
    let text = with_values(&loaded.model_text, &values, &input.files.model)?;
    let kept = set_model_aside(&arguments.output, &input.files.model, &text)?;
    shell.write_output(&arguments.output, Output::Model, text.as_bytes())?;
    for (p, old) in parameters.iter().zip(current.parameters()) {
        if p.is_held() {
            let value = short(old.value);
            shell.say(format_args!("  {:<40} {value:>10}, held fixed: its min and max are both {value} (give it room, or write fit = false)", p.name));
            continue;
        }
        if p.undetermined {
            shell.say(format_args!(
                "  {:<40} {:>10} -> {}, not determined: these impacts do not bound it within its range",
                p.name,
                short(old.value),
                short(p.value)
            ));
            continue;
        }
        let limit = if p.at_limit { format!("  {}", p.limit_words()) } else { String::new() };
        shell.say(format_args!("  {:<40} {:>10} -> {} ± {}{limit}", p.name, short(old.value), short(p.value), short(p.sd)));
    }
    let mut covariance = fitted.parameter_covariance(structure.noise_scale);
    for (k, p) in parameters.iter().enumerate().filter(|(_, p)| p.undetermined) {
        covariance[k][k] = p.sd * p.sd;
    }
    for (a, row) in covariance.iter().enumerate() {
        for b in 0..a {
            let correlation = row[b] / (row[a] * covariance[b][b]).sqrt();
            if correlation.abs() > TIED {
                shell.say(format_args!("  {} and {} are hardly told apart: correlation {correlation:.2}", parameters[b].name, parameters[a].name));
            }
        }
    }
    shell.say(format_args!(
        "fitted to {} impacts; error on the {} held-out ones: {error:.3} (noise floor {:.3})",
        seen.len(),
        loaded.observations.impacts.len() - seen.len(),
        structure.noise_scale.sqrt()
    ));
    let mut notes = loaded.observations.notes.clone();
    notes.extend(likely.unlikely.as_ref().map(|(offset, _)| {
        format!("the model asks for {offset}: it fails (`sweetspot diagnose` looks for what is missing), and its parameters are fitted without any offset")
    }));
    for note in &notes {
        shell.say(format_args!("note: {note}"));
    }
    shell.say_kept(&arguments.output, kept.as_deref());
    shell.say(format_args!("written: {}", arguments.output.display()));
    shell.print_json(&serde_json::json!({
        "model": arguments.output.to_string_lossy(),
        "parameters": parameters,
        "covariance": covariance,
        "heldout_error": error,
        "noise_floor": structure.noise_scale.sqrt(),
        "n_fitted": seen.len(),
        "session_offsets": session_offsets(&loaded.observations, fitted, structure.noise_scale),
        "notes": notes,
        "left_out": loaded.observations.left_out(),
        "provenance": loaded.provenance,
    }))?;
    loaded.unless_rows_failed()
}
