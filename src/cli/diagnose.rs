//! `sweetspot diagnose`.

use super::Shell;
use super::error::CliError;
use super::impacts_input::{ImpactsInput, LedgerFile, Loaded, Version, record, write_ledger};
use crate::impact::Model;
use crate::impact::model_file::{with_effect_added, with_values};
use crate::validation::comparison::{Comparison, compare};
use crate::validation::diagnose::{DiagnoseOptions, diagnose, fit_current};
use crate::validation::diagnosis::{Diagnosis, Verdict};
use crate::validation::expression::{FOUND_EFFECT, WORTH_A_FORMULA};
use crate::validation::fit::{FitOptions, fit_with_likely_offsets};
use crate::validation::forward::Library;
use crate::validation::heldout::{error_of, is_worth, linearise_held_out};
use crate::validation::ledger::{Ledger, Refusal};
use crate::validation::linearise::Linearised;
use crate::validation::model_library::ModelLibrary;
use crate::validation::terminal::{diagnosis_text, ledger_text};
use std::path::{Path, PathBuf};

/// Which physical effect the model is missing: diagnosis.json and report.html
#[derive(Debug, clap::Args)]
pub struct Arguments {
    #[command(flatten)]
    pub input: ImpactsInput,
    /// Diagnose, add, fit and compare again, one effect at a time, until nothing more earns its place
    #[arg(long)]
    pub auto: bool,
    /// Where `--auto` writes the model it arrives at (default: MODEL-auto.toml beside the model)
    #[arg(short = 'o', long = "output", value_name = "F2", requires = "auto")]
    pub output: Option<PathBuf>,
    /// Effects that `--auto` adds at most
    #[arg(long, default_value_t = 4, value_name = "N")]
    pub most_effects: usize,
    /// Do not look for a formula when no effect of the catalogue will do
    #[arg(long)]
    pub no_expression: bool,
}

pub fn run(arguments: Arguments, shell: &Shell) -> Result<(), CliError> {
    let input = &arguments.input;
    if let Some(output) = arguments.output.as_deref().filter(|o| crate::provenance::is_stdout(o)) {
        return Err(CliError::input(format!(
            "{}: --auto writes the models on the way beside the last one, and there is no place beside stdout",
            output.display()
        ))
        .hint("give -o a file"));
    }
    let loaded = input.load("diagnose")?;
    let options = DiagnoseOptions { seed: input.seed, model: input.model_name(), expressions: !arguments.no_expression };
    let mut diagnosis = diagnose(&loaded.library, &loaded.observations, &options)?;
    diagnosis.provenance = Some(loaded.provenance.clone());
    let folder = shell.results_beside(&input.files.impacts);
    let json = serde_json::to_string_pretty(&diagnosis).map_err(CliError::output)?;
    shell.write(&folder.join("diagnosis.json"), json.as_bytes())?;
    shell.say(diagnosis_text(&diagnosis).trim_end());
    let comparison = compare(loaded.library.current(), &loaded.observations, &input.model_name(), input.seed)?;
    let mut versions = Vec::new();
    let mut last = (input.files.model.clone(), loaded.model_text.clone());
    let ledger_file = LedgerFile::of(&input.files.model, shell);
    let mut ledger = ledger_file.read()?;
    if arguments.auto {
        let output = arguments.output.clone().unwrap_or_else(|| auto_name(&input.files.model));
        let walk = Walk { arguments: &arguments, shell, loaded: &loaded, ledger_path: &ledger_file.path };
        let (text, stages) = walk.go(&mut ledger, &diagnosis, &comparison, &output, &options)?;
        last = (output, text);
        versions = std::iter::once(comparison.clone()).chain(stages).collect();
    }
    let hash = crate::provenance::sha256_hex(last.1.as_bytes());
    let staircase = ledger.path_to(&hash, &loaded.data_hash);
    // The pictures show what the words speak of: the residuals with the free parameters at their best.
    let shown = at_its_best(&loaded, input, comparison)?;
    let page = crate::report::diagnosis_report(&input.report_title(), &diagnosis, Some(&shown), &versions, loaded.equipment.rackets.first(), &staircase);
    shell.write(&folder.join("report.html"), page.as_bytes())?;
    shell.say(format_args!("written: {}, report.html", folder.join("diagnosis.json").display()));
    shell.print_json(&diagnosis)?;
    loaded.unless_rows_failed()
}

/// The comparison of the model with its free parameters fitted, the stated ones still on record.
fn at_its_best(loaded: &Loaded, input: &ImpactsInput, stated: Comparison) -> Result<Comparison, CliError> {
    let seen = loaded.observations.side(false);
    let fit = fit_with_likely_offsets(loaded.library.current(), &loaded.observations, &seen, &FitOptions::default())?.fit;
    let values: Vec<(String, f64)> = loaded.library.current().parameters().iter().map(|p| p.name.clone()).zip(fit.values.iter().copied()).collect();
    let text = with_values(&loaded.model_text, &values, &input.files.model)?;
    let library = ModelLibrary::new(Model::parse(&text, &input.files.model)?, &loaded.observations.gear);
    let fitted = compare(library.current(), &loaded.observations, &input.model_name(), input.seed)?;
    Ok(Comparison { parameters_as_stated: stated.parameters_as_stated, provenance: stated.provenance, ..fitted })
}

/// The file of one version on the way: `model-auto.1.toml`, so that any step can be gone back to or branched from.
fn version_name(output: &Path, step: usize) -> PathBuf {
    let stem = output.file_stem().map_or_else(|| "model".to_owned(), |s| s.to_string_lossy().into_owned());
    output.with_file_name(format!("{stem}.{step}.toml"))
}

fn has_formula(model_text: &str, path: &Path) -> bool {
    Model::parse(model_text, path).is_ok_and(|m| m.has_effect(FOUND_EFFECT))
}

fn auto_name(model: &Path) -> PathBuf {
    let stem = model.file_stem().map_or_else(|| "model".to_owned(), |s| s.to_string_lossy().into_owned());
    model.with_file_name(format!("{stem}-auto.toml"))
}

/// `--auto`: one effect at a time, each version in the ledger, an effect refused when the held-out impacts do not gain.
struct Walk<'a> {
    arguments: &'a Arguments,
    shell: &'a Shell,
    loaded: &'a Loaded,
    ledger_path: &'a Path,
}

impl Walk<'_> {
    fn go(
        &self,
        ledger: &mut Ledger,
        first: &Diagnosis,
        comparison: &Comparison,
        output: &Path,
        options: &DiagnoseOptions,
    ) -> Result<(String, Vec<Comparison>), CliError> {
        let input = &self.arguments.input;
        let observations = &self.loaded.observations;
        let mut text = self.loaded.model_text.clone();
        let mut comparison = comparison.clone();
        let mut stages = Vec::new();
        self.note(ledger, &input.files.model, &text, None, Some("first model"), &comparison, Vec::new())?;
        // The first step is the old model at its best: an effect must beat that, not the file's first guesses.
        let (fitted, mut held_out) = self.fitted(&text)?;
        if fitted != text {
            let parent = crate::provenance::sha256_hex(text.as_bytes());
            text = fitted;
            comparison = self.compared(&text)?;
            stages.push(comparison.clone());
            self.keep(ledger, output, stages.len(), &text, parent, "fitted", &comparison)?;
        }
        let mut diagnosis = first.clone();
        let mut refused: Vec<Refusal> = Vec::new();
        let mut additions = 0;
        while additions < self.arguments.most_effects {
            self.shell.check_cancelled()?;
            let tried: Vec<String> = refused.iter().map(|r| r.effect.clone()).collect();
            let Some(effect) = diagnosis.recommended.iter().find(|e| !tried.contains(e)).cloned() else { break };
            self.shell.say(format_args!("\n--auto, effect {}: adding {effect}", additions + 1));
            let added = with_effect_added(&text, &effect, &input.files.model)?;
            let (with, with_held_out) = self.fitted(&added)?;
            let (error, with_error) = (error_of(&held_out), error_of(&with_held_out));
            if with_error >= error {
                let reason = format!("the error on held-out impacts does not fall ({error:.3} to {with_error:.3})");
                self.shell.say(format_args!("  refused: {reason}"));
                refused.push(Refusal { effect, reason, heldout_error_before: error, heldout_error_after: with_error });
                let file = if stages.is_empty() { input.files.model.clone() } else { version_name(output, stages.len()) };
                self.note(ledger, &file, &text, None, None, &comparison, refused.clone())?;
                continue;
            }
            let parent = crate::provenance::sha256_hex(text.as_bytes());
            self.shell.say(format_args!("  held-out error {error:.3} -> {with_error:.3}"));
            additions += 1;
            (text, held_out) = (with, with_held_out);
            refused.clear();
            comparison = self.compared(&text)?;
            stages.push(comparison.clone());
            self.keep(ledger, output, stages.len(), &text, parent, &format!("added {effect}"), &comparison)?;
            let library = self.library(&text)?;
            diagnosis = diagnose(&library, observations, options)?;
            if diagnosis.verdict == Verdict::Adequate {
                break;
            }
        }
        // What is left may be nature's own form of the effects found, or something in no catalogue: a formula for it.
        if let Some(formula) =
            diagnosis.suggested_expression.as_ref().filter(|_| diagnosis.verdict == Verdict::Unexplained && !has_formula(&text, &input.files.model))
        {
            let with_formula = format!("{}\n\n{}\n", text.trim_end(), formula.model_file_text.trim_end());
            // A formula that does not go with what is in the model already is left for the user to look at.
            if let Ok((with, with_held_out)) = self.fitted(&with_formula)
                && is_worth(WORTH_A_FORMULA, &held_out, &with_held_out, diagnosis.noise_floor.powi(2))
            {
                let parent = crate::provenance::sha256_hex(text.as_bytes());
                let (error, with_error) = (error_of(&held_out), error_of(&with_held_out));
                self.shell.say(format_args!("\n--auto: adding a formula ({})\n  held-out error {error:.3} -> {with_error:.3}", formula.words));
                text = with;
                comparison = self.compared(&text)?;
                stages.push(comparison.clone());
                self.keep(ledger, output, stages.len(), &text, parent, "added a formula", &comparison)?;
                diagnosis = diagnose(&self.library(&text)?, observations, options)?;
            }
        }
        self.shell.write(output, text.as_bytes())?;
        let hash = crate::provenance::sha256_hex(text.as_bytes());
        self.shell.say(format_args!("\n{}", ledger_text(&ledger.path_to(&hash, &self.loaded.data_hash)).trim_end()));
        self.shell.say(format_args!("verdict now: {}; model: {} (every version: {})", diagnosis.verdict, output.display(), self.ledger_path.display()));
        if stages.len() > 1 {
            self.shell.say(format_args!(
                "to go back or to branch, go on from an earlier version: {} to {}",
                version_name(output, 1).display(),
                version_name(output, stages.len()).display()
            ));
        }
        Ok((text, stages))
    }

    /// Writes a version into a file of its own and notes it in the ledger under that name.
    fn keep(&self, ledger: &mut Ledger, output: &Path, step: usize, text: &str, parent: String, what: &str, comparison: &Comparison) -> Result<(), CliError> {
        let file = version_name(output, step);
        self.shell.write(&file, text.as_bytes())?;
        self.shell.write(output, text.as_bytes())?;
        self.note(ledger, &file, text, Some(parent), Some(what), comparison, Vec::new())
    }

    fn library(&self, text: &str) -> Result<ModelLibrary, CliError> {
        Ok(ModelLibrary::new(Model::parse(text, &self.arguments.input.files.model)?, &self.loaded.observations.gear))
    }

    /// The text with its free parameters at their best, and the held-out impacts with it.
    fn fitted(&self, text: &str) -> Result<(String, Vec<Linearised>), CliError> {
        let library = self.library(text)?;
        let fit = fit_current(&library, &self.loaded.observations)?;
        let values: Vec<(String, f64)> = library.current().parameters().iter().map(|p| p.name.clone()).zip(fit.values.iter().copied()).collect();
        let observations = &self.loaded.observations;
        let held_out = linearise_held_out(library.current(), &fit, observations, &observations.side(true))?;
        Ok((with_values(text, &values, &self.arguments.input.files.model)?, held_out))
    }

    fn compared(&self, text: &str) -> Result<Comparison, CliError> {
        let library = self.library(text)?;
        Ok(compare(library.current(), &self.loaded.observations, &self.arguments.input.model_name(), self.arguments.input.seed)?)
    }

    fn note(
        &self,
        ledger: &mut Ledger,
        file: &Path,
        text: &str,
        parent: Option<String>,
        step: Option<&str>,
        comparison: &Comparison,
        refused: Vec<Refusal>,
    ) -> Result<(), CliError> {
        let effects = self.library(text)?.effect_names();
        let version = Version { model: file, model_text: text, effects, data_hash: &self.loaded.data_hash, parent, step: step.map(ToOwned::to_owned), refused };
        record(ledger, version, comparison);
        write_ledger(self.shell, self.ledger_path, ledger)
    }
}
