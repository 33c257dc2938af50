//! The ledger of a folder's models as a file: read, and written with every version that a command judges.

use super::Shell;
use super::error::CliError;
use super::impacts_input::file_name;
use super::today::today;
use crate::limited_file::{LARGEST_TEXT, read_text};
use crate::provenance::{VERSION, sha256_hex};
use crate::validation::comparison::{Comparison, ParameterValue};
use crate::validation::ledger::{Ledger, LedgerEntry, Refusal};
use std::path::{Path, PathBuf};

const LEDGER_FILE: &str = "model-ledger.json";

/// The ledger of all models in a folder: as it was read, with what was noted since.
pub struct LedgerFile {
    /// Beside the model, or where `--out` says.
    pub path: PathBuf,
    pub ledger: Ledger,
}

impl LedgerFile {
    /// A ledger begun in another folder goes on from the one beside the model: earlier versions stay a model's history.
    pub fn read(model: &Path, shell: &Shell) -> Result<Self, CliError> {
        let beside_model = model.with_file_name(LEDGER_FILE);
        let path = shell.ledger_folder().map_or_else(|| beside_model.clone(), |folder| folder.join(LEDGER_FILE));
        let ledger = read_ledger(if path.exists() { &path } else { &beside_model })?;
        Ok(LedgerFile { path, ledger })
    }

    /// Notes a version and writes the file, with what other commands noted there meanwhile; the version's hash.
    pub fn note(&mut self, shell: &Shell, version: Version, comparison: &Comparison) -> Result<String, CliError> {
        // One command at a time; a folder that cannot be locked (or is not there yet) has no other that writes to it.
        let folder = self.path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let _alone = std::fs::File::open(folder).and_then(|folder| folder.lock().map(|()| folder));
        self.ledger.take_in(read_ledger(&self.path)?);
        let hash = record(&mut self.ledger, version, comparison);
        let text = serde_json::to_string_pretty(&self.ledger).map_err(CliError::output)?;
        // A model kept where the user may only read has no ledger; what the command is for is done all the same.
        if let Err(e) = shell.write(&self.path, text.as_bytes()) {
            shell.say(format_args!("no ledger kept: {}", e.message));
        }
        Ok(hash)
    }
}

/// A missing ledger is empty, a damaged one is an error that names it.
fn read_ledger(path: &Path) -> Result<Ledger, CliError> {
    match read_text(path, LARGEST_TEXT) {
        Ok(text) => serde_json::from_str(&text)
            .map_err(|e| CliError::input(format!("{}: not a ledger ({e})", path.display())).hint("move it away; a new one will be begun")),
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => Ok(Ledger::default()),
        Err(e) => Err(CliError::input(format!("{}: cannot be read ({e})", path.display()))),
    }
}

/// A version's line in the ledger. Its parent, unless given, is the latest earlier version on the same data with the
/// largest part of its effects.
pub struct Version<'a> {
    pub model: &'a Path,
    pub model_text: &'a str,
    pub effects: Vec<String>,
    pub data_hash: &'a str,
    pub parent: Option<String>,
    pub step: Option<String>,
    pub refused: Vec<Refusal>,
}

/// Deviation of a parameter as its file states it: that of the fit, where it is the fit's value; a first guess has none.
fn sd_as_stated(stated: &ParameterValue, fitted: &ParameterValue) -> f64 {
    if (stated.value - fitted.value).abs() <= fitted.sd { fitted.sd } else { 0.0 }
}

/// A model file's base, and the hash of all in it that no fit changes (see [`LedgerEntry::form`]).
fn base_and_form(model_text: &str) -> (String, String) {
    let Ok(mut model) = model_text.parse::<toml::Table>() else { return Default::default() };
    let base = model.get("base").and_then(toml::Value::as_str).unwrap_or_default().to_owned();
    forget_free_values(&mut model);
    (base, sha256_hex(model.to_string().as_bytes()))
}

fn forget_free_values(table: &mut toml::Table) {
    if table.get("fit").and_then(toml::Value::as_bool) == Some(true) {
        table.remove("value");
    }
    table.iter_mut().filter_map(|(_, value)| value.as_table_mut()).for_each(forget_free_values);
}

pub fn record(ledger: &mut Ledger, version: Version, comparison: &Comparison) -> String {
    let hash = sha256_hex(version.model_text.as_bytes());
    let (base, form) = base_and_form(version.model_text);
    // Another base is another model, no version of this one.
    let of_this_base = |e: &LedgerEntry| e.base.is_empty() || e.base == base;
    // With the same effects a version that does worse did not come from the better one by a fit.
    let falls = |e: &LedgerEntry| e.effects.len() < version.effects.len() || e.heldout_error >= comparison.heldout_error;
    let ancestor = |e: &&LedgerEntry| {
        e.data_hash == version.data_hash && e.model_hash != hash && of_this_base(e) && e.effects.iter().all(|x| version.effects.contains(x)) && falls(e)
    };
    let parent = version.parent.clone().or_else(|| {
        // A version already on record keeps its parent.
        if ledger.find(&hash, version.data_hash).is_some() {
            return None;
        }
        ledger.entries.iter().filter(ancestor).max_by_key(|e| e.effects.len()).map(|e| e.model_hash.clone())
    });
    let came_from = parent.as_deref().and_then(|p| ledger.find(p, version.data_hash));
    let parent_effects: Vec<String> = came_from.map(|e| e.effects.clone()).unwrap_or_default();
    let added: Vec<String> = version.effects.iter().filter(|e| !parent_effects.contains(e)).cloned().collect();
    // A fit changes the values of free parameters, nothing else.
    let by_a_fit = came_from.is_none_or(|e| e.form.is_empty() || e.form == form);
    let step = version.step.unwrap_or_else(|| match (&parent, added.is_empty()) {
        (None, _) => "first model".to_owned(),
        (Some(_), true) if by_a_fit => "fitted".to_owned(),
        (Some(_), true) => "changed".to_owned(),
        (Some(_), false) => format!("added {}", added.join(" and ")),
    });
    ledger.record(LedgerEntry {
        model_hash: hash.clone(),
        model_file: file_name(version.model),
        parent,
        step,
        base,
        form,
        effects: version.effects,
        parameters: comparison
            .parameters_as_stated
            .iter()
            .map(|p| ParameterValue { sd: comparison.parameters_refitted.iter().find(|r| r.name == p.name).map_or(0.0, |r| sd_as_stated(p, r)), ..p.clone() })
            .collect(),
        heldout_error: comparison.heldout_error,
        fit_error: comparison.fit_error,
        noise_floor: comparison.noise_floor,
        n_impacts: comparison.n_impacts,
        n_held_out: comparison.n_held_out,
        data_hash: version.data_hash.to_owned(),
        date: today(),
        verdict: comparison.verdict,
        refused: version.refused,
        program_version: VERSION.to_owned(),
    });
    hash
}
