//! `sweetspot compare`.

use super::Shell;
use super::error::CliError;
use super::impacts_input::{ImpactsInput, Loaded};
use super::ledger_file::{LedgerFile, Version, record};
use super::predict::impossible;
use crate::impact::Model;
use crate::impact::batch::{gained_energies, limited_laws, predict_table};
use crate::limited_file::{LARGEST_TEXT, read_text};
use crate::provenance::sha256_hex;
use crate::validation::comparison::compare;
use crate::validation::forward::Library;
use crate::validation::model_library::ModelLibrary;
use crate::validation::terminal::{comparison_text, ledger_text};
use std::ffi::OsStr;
use std::path::Path;

/// Model against measurement: compare.json and report.html
#[derive(Debug, clap::Args)]
pub struct Arguments {
    #[command(flatten)]
    pub input: ImpactsInput,
    /// Do not write the model's line into model-ledger.json (beside the model file, or in the folder of --out)
    #[arg(long)]
    pub no_ledger: bool,
}

pub fn run(arguments: Arguments, shell: &Shell) -> Result<(), CliError> {
    let input = &arguments.input;
    shell.keep(input.files.measured());
    let loaded = input.load("compare")?;
    // A damaged one ends the command before it has written anything.
    let mut file = LedgerFile::read(&input.files.model, shell)?;
    let mut comparison = compare(loaded.library.current(), &loaded.observations, &input.model_name(), input.seed)?;
    comparison.notes.extend(impossible_as_stated(&loaded)?.into_iter().map(|remark| format!("as stated: {remark}")));
    comparison.provenance = Some(loaded.provenance.clone());
    let folder = shell.results_beside(&input.files.impacts);
    let json = serde_json::to_string_pretty(&comparison).map_err(CliError::output)?;
    shell.write(&folder.join("compare.json"), json.as_bytes())?;
    shell.say(comparison_text(&comparison).trim_end());
    let effects = loaded.library.effect_names();
    let version = Version {
        model: &input.files.model,
        model_text: &loaded.model_text,
        effects,
        data_hash: &loaded.data_hash,
        parent: None,
        step: None,
        refused: Vec::new(),
    };
    let hash = if arguments.no_ledger { record(&mut file.ledger, version, &comparison) } else { file.note(shell, version, &comparison)? };
    let staircase = file.ledger.path_to(&hash, &loaded.data_hash);
    if staircase.len() > 1 {
        shell.say(ledger_text(&staircase).trim_end());
    }
    // The version this one came from, when its file still stands beside it: the same residuals before and after.
    let before = staircase.iter().rev().nth(1).and_then(|parent| {
        // The ledger is a file like any other: what it names is looked for beside the model, nowhere else.
        let beside = Path::new(&parent.model_file).file_name().filter(|name| *name == OsStr::new(&parent.model_file))?;
        let file = input.files.model.with_file_name(beside);
        let text = read_text(&file, LARGEST_TEXT).ok().filter(|t| sha256_hex(t.as_bytes()) == parent.model_hash)?;
        let library = ModelLibrary::new(Model::parse(&text, &file).ok()?, &loaded.observations.gear);
        compare(library.current(), &loaded.observations, &parent.model_file, input.seed).ok()
    });
    let page = crate::report::comparison_report(&input.report_title(), &comparison, loaded.equipment.rackets.first(), &staircase, before.as_ref());
    shell.write(&folder.join("report.html"), page.as_bytes())?;
    shell.say(format_args!("written: {}, report.html", folder.join("compare.json").display()));
    shell.print_json(&comparison)?;
    loaded.unless_rows_failed()
}

/// What the model as its file states it makes of the measured impacts that no contact does. A residual alone does not tell it.
fn impossible_as_stated(loaded: &Loaded) -> Result<Vec<String>, CliError> {
    let Loaded { model, equipment, table, .. } = loaded;
    let outcomes = predict_table(model, equipment, table)?;
    Ok(impossible(&limited_laws(model, equipment, table)?, &gained_energies(equipment, table, &outcomes)))
}
