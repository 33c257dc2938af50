//! `sweetspot diagnose`.

use super::Shell;
use super::earlier_output::Output;
use super::error::CliError;
use super::impacts_input::{DEFAULT_SEED, ImpactFiles, ImpactsInput, Loaded};
use super::ledger_file::{LedgerFile, Version};
use super::set_aside::{remove_if_there, set_model_aside};
use crate::impact::Model;
use crate::impact::model_file::with_values;
use crate::provenance::{holds, sha256_hex};
use crate::session::Session;
use crate::validation::auto::{Tried, Walk};
use crate::validation::comparison::{Comparison, ParameterValue, compare};
use crate::validation::diagnose::{DiagnoseOptions, diagnose};
use crate::validation::fit::{FitOptions, fit_with_likely_offsets};
use crate::validation::forward::Library;
use crate::validation::ledger::Refusal;
use crate::validation::model_library::ModelLibrary;
use crate::validation::terminal::{diagnosis_text, ledger_text};
use crate::validation::{Diagnosis, Verdict};
use std::path::{Path, PathBuf};

/// Deviations from its fitted value within which a parameter is at its best for a picture.
const AT_ITS_BEST: f64 = 0.5;

/// Which physical effect the model is missing: diagnosis.json and report.html
#[derive(Debug, clap::Args)]
pub struct Arguments {
    #[command(flatten)]
    pub input: ImpactsInput,
    /// Diagnose, add, fit and compare again, one effect at a time, until nothing more earns its place
    #[arg(long)]
    pub auto: bool,
    /// Where `--auto` writes the model it arrives at (default: MODEL-auto.toml beside the model, or in --out DIR)
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
    shell.keep(input.files.measured());
    let output = arguments.output.clone().unwrap_or_else(|| shell.results_beside(&input.files.model).join(auto_name(&input.files.model)));
    if arguments.auto {
        shell.check_output(&output, Output::Model)?;
    }
    let loaded = input.load("diagnose")?;
    // A damaged one ends the command before it has written anything.
    let mut file = LedgerFile::read(&input.files.model, shell)?;
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
    if arguments.auto {
        let walk = Walk::new(&loaded.model_text, &input.files.model, &diagnosis, &loaded.observations, &options, arguments.most_effects)?;
        // Where the user says: a name of the program's own holds what it wrote. Written at every step, the model is known in the end only.
        let kept = if arguments.output.is_some() { set_model_aside(&output, &input.files.model, &walk.text)? } else { None };
        let story = Story { input, shell, loaded: &loaded, file: &mut file, output: &output, versions };
        let text;
        (text, versions) = story.tell(walk, &comparison)?;
        match kept {
            Some(kept) if holds(&kept, text.as_bytes()) => remove_if_there(&kept)?,
            kept => shell.say_kept(&output, kept.as_deref()),
        }
        last = (output, text);
    }
    let hash = sha256_hex(last.1.as_bytes());
    let staircase = file.ledger.path_to(&hash, &loaded.data_hash);
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
    let text = with_values(&loaded.model_text, &fit.named_values(), &input.files.model)?;
    let library = ModelLibrary::new(Model::parse(&text, &input.files.model)?, &loaded.observations.gear);
    let fitted = compare(library.current(), &loaded.observations, &input.model_name(), input.seed)?;
    Ok(Comparison { parameters_as_stated: stated.parameters_as_stated, provenance: stated.provenance, ..fitted })
}

/// The comparison that the pictures of a session's diagnosis show: the stated one where the model stands at its best already.
pub(super) fn session_at_its_best(session: &Session, impacts: &Path, model: &Path, stated: &Comparison) -> Result<Comparison, CliError> {
    let near = |(s, f): (&ParameterValue, &ParameterValue)| (s.value - f.value).abs() <= AT_ITS_BEST * f.sd;
    if stated.parameters_as_stated.iter().zip(&stated.parameters_refitted).all(near) {
        return Ok(stated.clone());
    }
    let files = ImpactFiles { impacts: impacts.into(), racket: session.racket_files.clone(), ball: session.ball_files.clone(), model: model.into() };
    let input = ImpactsInput { files, group: None, seed: DEFAULT_SEED };
    at_its_best(&input.load("diagnose")?, &input, stated.clone())
}

/// The file of one version on the way: `model-auto.1.toml`, so that any step can be gone back to or branched from.
fn version_name(output: &Path, step: usize) -> PathBuf {
    output.with_file_name(name_with(output, &format!(".{step}")))
}

fn auto_name(model: &Path) -> String {
    name_with(model, "-auto")
}

/// A model file's name with more behind it.
fn name_with(model: &Path, more: &str) -> String {
    let stem = model.file_stem().map_or_else(|| "model".to_owned(), |s| s.to_string_lossy().into_owned());
    format!("{stem}{more}.toml")
}

/// `--auto`: what is said of a [`Walk`], its versions in files of their own and in the ledger.
struct Story<'a> {
    input: &'a ImpactsInput,
    shell: &'a Shell,
    loaded: &'a Loaded,
    file: &'a mut LedgerFile,
    output: &'a Path,
    /// The first model, then those on the way.
    versions: Vec<Comparison>,
}

impl Story<'_> {
    /// The text arrived at, and all versions.
    fn tell(mut self, mut walk: Walk, first: &Comparison) -> Result<(String, Vec<Comparison>), CliError> {
        let shell = self.shell;
        let mut text = self.loaded.model_text.clone();
        self.versions.push(first.clone());
        self.note(&text, None, Some("first model"), Vec::new())?;
        if walk.text != text {
            text = self.keep(&walk, &text, "fitted")?;
        }
        while let Some(effect) = walk.next_effect() {
            shell.check_cancelled()?;
            shell.say(format_args!("\n--auto, effect {}: adding {effect}", walk.added + 1));
            match walk.try_effect(&effect)? {
                Tried::Refused { reason } => {
                    shell.say(format_args!("  refused: {reason}"));
                    self.note(&text, None, None, walk.refused.clone())?;
                }
                Tried::Added { before, after } => {
                    shell.say(format_args!("  held-out error {before:.3} -> {after:.3}"));
                    text = self.keep(&walk, &text, &format!("added {effect}"))?;
                }
            }
        }
        if let Some((words, before, after)) = walk.try_formula()? {
            shell.say(format_args!("\n--auto: adding a formula ({words})\n  held-out error {before:.3} -> {after:.3}"));
            text = self.keep(&walk, &text, "added a formula")?;
        }
        shell.write_output(self.output, Output::Model, text.as_bytes())?;
        let staircase = self.file.ledger.path_to(&sha256_hex(text.as_bytes()), &self.loaded.data_hash);
        shell.say(format_args!("\n{}", ledger_text(&staircase).trim_end()));
        shell.say(format_args!("verdict now: {}; model: {} (every version: {})", walk.diagnosis.verdict, self.output.display(), self.file.path.display()));
        let Diagnosis { words, notes, verdict, .. } = &walk.diagnosis;
        // Beside "adequate" only what makes one doubt it: the words after the verdict and its figures.
        let (words, notes) = if *verdict == Verdict::Adequate { (words.get(2..).unwrap_or_default(), &[][..]) } else { (&words[..], &notes[..]) };
        for line in words.iter().chain(notes) {
            shell.say(format_args!("  {line}"));
        }
        if self.versions.len() > 2 {
            shell.say(format_args!(
                "to go back or to branch, go on from an earlier version: {} to {}",
                version_name(self.output, 1).display(),
                self.model_file().display()
            ));
        }
        Ok((text, self.versions))
    }

    /// Writes the version that the walk has come to into a file of its own and notes it in the ledger under that name; its text.
    fn keep(&mut self, walk: &Walk, parent: &str, step: &str) -> Result<String, CliError> {
        self.versions.push(walk.comparison()?);
        let version = self.model_file();
        self.shell.check_output(&version, Output::Model)?;
        self.shell.write(&version, walk.text.as_bytes())?;
        self.shell.write_output(self.output, Output::Model, walk.text.as_bytes())?;
        self.note(&walk.text, Some(sha256_hex(parent.as_bytes())), Some(step), Vec::new())?;
        Ok(walk.text.clone())
    }

    /// The file of the last version.
    fn model_file(&self) -> PathBuf {
        if self.versions.len() > 1 { version_name(self.output, self.versions.len() - 1) } else { self.input.files.model.clone() }
    }

    fn note(&mut self, text: &str, parent: Option<String>, step: Option<&str>, refused: Vec<Refusal>) -> Result<(), CliError> {
        let Some(comparison) = self.versions.last() else { return Ok(()) };
        let effects = Model::parse(text, &self.input.files.model)?.effects().iter().map(|e| e.name.clone()).collect();
        let data_hash = &self.loaded.data_hash;
        let version = Version { model: &self.model_file(), model_text: text, effects, data_hash, parent, step: step.map(ToOwned::to_owned), refused };
        self.file.note(self.shell, version, comparison).map(|_| ())
    }
}
