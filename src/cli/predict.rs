//! `sweetspot predict`.

use super::Shell;
use super::earlier_output::Output;
use super::error::CliError;
use super::impacts_input::{ImpactFiles, beyond_racket, doubtful_tensions, hint_at_faults};
use super::set_aside::{listed, set_all_aside};
use crate::equipment_set::EquipmentSet;
use crate::impact::batch::{LimitedLaws, RowError, RowSensitivity, differentiate_table, gained_energies, limited_laws, predict_table, without_spin};
use crate::impact::{ImpactOutput, Model};
use crate::impact_table::{INPUTS, ImpactTable, OUTPUTS, remarks};

/// The model's outcome of every impact, to predictions.csv
#[derive(Debug, clap::Args)]
pub struct Arguments {
    #[command(flatten)]
    pub files: ImpactFiles,
    /// Also write sensitivities.csv (derivatives by every input and parameter) and predictions_sd.csv (what the inputs'
    /// standard deviations carry into the prediction)
    #[arg(long)]
    pub sensitivities: bool,
}

pub fn run(arguments: Arguments, shell: &Shell) -> Result<(), CliError> {
    let ImpactFiles { impacts, racket, ball, model } = &arguments.files;
    shell.keep(arguments.files.measured());
    let table = ImpactTable::read_given(impacts)?;
    let set = EquipmentSet::read(racket, ball)?;
    let model = Model::read(model)?;
    let results = predict_table(&model, &set, &table)?;
    let beside = shell.results_beside(impacts);
    let path = beside.join("predictions.csv");
    let rows: Vec<(&str, Option<&ImpactOutput>)> = table.rows.iter().zip(&results).map(|(r, o)| (r.id.as_str(), o.as_ref().ok())).collect();
    // An impulse has no contact time.
    let timed = results.iter().flatten().any(|o| o.contact_time.is_some());
    let columns = if timed { &OUTPUTS[..] } else { &OUTPUTS[..OUTPUTS.len() - 1] };
    let predictions = predictions_csv(&rows, columns)?;
    if !arguments.sensitivities && std::fs::read(&path).is_ok_and(|earlier| earlier != predictions.as_bytes()) {
        let kept = set_all_aside(&beside, &["sensitivities.csv", "predictions_sd.csv"])?;
        if !kept.is_empty() {
            shell.say(format_args!("of the predictions before (--sensitivities makes them anew), kept as {}", listed(&kept)));
        }
    }
    shell.write_output(&path, Output::Predictions, predictions.as_bytes())?;
    let mut failed: Vec<String> = results.iter().filter_map(|r| r.as_ref().err().map(ToString::to_string)).collect();
    let unpredicted = failed.len();
    if arguments.sensitivities {
        let derivatives = differentiate_table(&model, &set, &table)?;
        let rows: Vec<(&str, &Result<RowSensitivity, RowError>)> = table.rows.iter().map(|r| r.id.as_str()).zip(&derivatives).collect();
        shell.write_output(&beside.join("sensitivities.csv"), Output::Predictions, sensitivities_csv(&rows, &model, columns)?.as_bytes())?;
        let path = beside.join("predictions_sd.csv");
        shell.write_output(&path, Output::Predictions, deviations_csv(&rows, columns)?.as_bytes())?;
        shell.say(format_args!("derivatives and deviations: {}", path.display()));
        // Of an impact without prediction the reason is told already.
        let lost = results.iter().zip(&derivatives).filter(|(r, _)| r.is_ok()).filter_map(|(_, d)| d.as_ref().err());
        failed.extend(lost.map(|e| format!("{e} (its derivatives)")));
    }
    let spinless = without_spin(&table);
    let limited = limited_laws(&model, &set, &table)?;
    // A million impacts as JSON take gigabytes: they are made for who asks for them.
    if shell.args.json {
        let json: Vec<serde_json::Value> = rows.iter().map(|(id, o)| as_json(id, *o)).collect();
        let ids = |of: &[(&str, f64)]| of.iter().map(|(id, _)| (*id).to_owned()).collect::<Vec<_>>();
        shell.print_json(&serde_json::json!({
            "predictions": json,
            "failed": failed,
            "spin_taken_as_zero": spinless,
            "restitution_limited": ids(&limited.restitution),
            "friction_limited": ids(&limited.friction),
            "file": path.to_string_lossy(),
        }))?;
    }
    for remark in remarks(&table).into_iter().chain(beyond_racket(&table, &set)).chain(doubtful_tensions(&model, &set)) {
        shell.say(remark);
    }
    if !spinless.is_empty() {
        shell.say(format_args!("incoming spin not measured, taken as 0, in {} impacts: {}", spinless.len(), spinless.join(", ")));
    }
    for remark in impossible(&limited, &gained_energies(&set, &table, &results)) {
        shell.say(remark);
    }
    shell.say(format_args!("{} of {} impacts predicted: {}", rows.len() - unpredicted, rows.len(), path.display()));
    if failed.is_empty() { Ok(()) } else { Err(hint_at_faults(CliError::some_failed(failed.join("\n")), &table)) }
}

/// What the model makes of the impacts that no contact does: an effect's equation or parameters are at fault.
pub(super) fn impossible(limited: &LimitedLaws, gained: &[(&str, f64)]) -> Vec<String> {
    let restitution = limited.restitution.first().map(|(id, e)| {
        let n = limited.restitution.len();
        format!("restitution beyond 0 to 1, taken as 0 or 1, in {n} impacts (the first: {e:.3} in {id}); see the effects that change it")
    });
    let friction = limited.friction.first().map(|(id, f)| {
        let n = limited.friction.len();
        format!("friction below 0, taken as 0, in {n} impacts (the first: {f:.3} in {id}); see the effects that change it")
    });
    let energy = gained.iter().max_by(|a, b| a.1.total_cmp(&b.1)).map(|(id, most)| {
        let n = gained.len();
        format!(
            "more energy after the impact than before in {n} impacts (the most: {most:.1} J in {id}): no contact does that; see the effects and their parameters"
        )
    });
    restitution.into_iter().chain(friction).chain(energy).collect()
}

/// `id` and the output columns; `contact_time` where the base has one. An impact without prediction keeps empty cells.
fn predictions_csv(rows: &[(&str, Option<&ImpactOutput>)], columns: &[&str]) -> Result<String, CliError> {
    let mut csv = csv::Writer::from_writer(Vec::new());
    csv.write_field("id").and_then(|()| csv.write_record(columns)).map_err(CliError::output)?;
    for (id, output) in rows {
        let cells = output.map_or([None; OUTPUTS.len()], ImpactOutput::as_columns);
        // `{}` prints the shortest text that reads back as the same number.
        let text = cells[..columns.len()].iter().map(|c| c.map_or_else(String::new, |v| v.to_string()));
        csv.write_field(id).and_then(|()| csv.write_record(text)).map_err(CliError::output)?;
    }
    text_of(csv)
}

fn text_of(csv: csv::Writer<Vec<u8>>) -> Result<String, CliError> {
    String::from_utf8(csv.into_inner().map_err(CliError::output)?).map_err(CliError::output)
}

/// One row per impact and input or parameter (`of`): derivatives of every output, SI; `edge` where the outcome
/// has an edge there (see [`crate::impact::sensitivity::Sensitivities::edges`] for what then stands).
fn sensitivities_csv(rows: &[(&str, &Result<RowSensitivity, RowError>)], model: &Model, columns: &[&str]) -> Result<String, CliError> {
    let mut csv = csv::Writer::from_writer(Vec::new());
    csv.write_record(["id", "of", "edge"].iter().chain(columns)).map_err(CliError::output)?;
    for (id, row) in rows {
        let Ok(row) = row else { continue };
        let s = &row.sensitivities;
        let names = INPUTS.iter().copied().chain(model.parameters().iter().map(|p| p.name.as_str()));
        for (name, column) in names.zip(s.by_input.iter().chain(&s.by_parameter)) {
            let edge = if s.edges.iter().any(|e| e == name) { "yes" } else { "" };
            let cells = column[..columns.len()].iter().map(f64::to_string);
            let record: Vec<String> = [id.to_string(), name.to_owned(), edge.to_owned()].into_iter().chain(cells).collect();
            csv.write_record(record).map_err(CliError::output)?;
        }
    }
    text_of(csv)
}

/// `id` and the standard deviation of every predicted output.
fn deviations_csv(rows: &[(&str, &Result<RowSensitivity, RowError>)], columns: &[&str]) -> Result<String, CliError> {
    let mut csv = csv::Writer::from_writer(Vec::new());
    csv.write_record(["id"].iter().chain(columns)).map_err(CliError::output)?;
    for (id, row) in rows {
        let cells = row.as_ref().map_or_else(|_| vec![String::new(); columns.len()], |r| r.output_sd[..columns.len()].iter().map(f64::to_string).collect());
        csv.write_record(std::iter::once((*id).to_owned()).chain(cells)).map_err(CliError::output)?;
    }
    text_of(csv)
}

fn as_json(id: &str, output: Option<&ImpactOutput>) -> serde_json::Value {
    let mut row = serde_json::Map::new();
    row.insert("id".into(), id.into());
    if let Some(output) = output {
        for (name, value) in OUTPUTS.iter().zip(output.as_columns()) {
            if let Some(v) = value {
                row.insert((*name).into(), v.into());
            }
        }
    }
    row.into()
}
