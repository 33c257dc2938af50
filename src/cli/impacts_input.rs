//! The files that compare, diagnose and fit share: an impacts table, rackets, balls, a model.

use super::error::{CliError, with_reasons};
use crate::equipment::Racket;
use crate::equipment_set::EquipmentSet;
use crate::impact::{Base, Model};
use crate::impact_table::{ImpactRow, ImpactTable, TableError, remarks};
use crate::kinematics::past_racket;
use crate::limited_file::{LARGEST_TABLE, LARGEST_TEXT, LimitedFile, read_text};
use crate::provenance::{Provenance, sha256_hex};
use crate::short_list::short_list;
use crate::validation::ValidationError;
use crate::validation::model_library::ModelLibrary;
use crate::validation::observation::{Observations, TableOptions};
use nalgebra::Vector2;
use std::io::Read;
use std::path::{Path, PathBuf};

/// The files every command on a table of impacts needs.
#[derive(Debug, Clone, clap::Args)]
pub struct ImpactFiles {
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
}

impl ImpactFiles {
    /// The measured table and the gear, which no result may replace (a model may be fitted in place).
    pub fn measured(&self) -> impl Iterator<Item = &PathBuf> {
        std::iter::once(&self.impacts).chain(&self.racket).chain(&self.ball)
    }
}

/// How far beyond the racket's outline an impact may lie unremarked, m: a head is an ellipse to some millimetres only, and a place is measured to some.
const BEYOND_M: f64 = 0.010;
/// Impacts that a remark names.
const NAMED: usize = 5;

/// Impacts that the table puts beyond the racket, where a ball meets nothing: a model goes on as if the strings went on, and nobody should take its word for it.
pub(super) fn beyond_racket(table: &ImpactTable, set: &EquipmentSet) -> Option<String> {
    let past = |row: &ImpactRow| {
        let place = Vector2::new(row.get("impact_x")?.value, row.get("impact_y")?.value);
        let (r, b) = set.pick(row).ok()?;
        let racket = &set.rackets[r];
        // Most lie on the strings, and their distance from the edge need not be known.
        if racket.head.is_strung_at(&place) {
            return None;
        }
        Some(past_racket(racket, &set.balls[b], &place)).filter(|past| *past > BEYOND_M)
    };
    let all: Vec<String> = table.rows.iter().filter_map(|row| Some(format!("{} by {:.0} mm", row.id, 1000.0 * past(row)?))).collect();
    let named = short_list(&all, NAMED, ", ");
    (!all.is_empty()).then(|| {
        format!(
            "{} impacts lie beyond the racket ({named}), where a ball meets nothing: `impact_x` (toward the handle) and `impact_y` are in m from the stringbed's centre; correct \
             them, or leave these rows out",
            all.len()
        )
    })
}

/// Rackets whose tension may be in another unit, where the model takes the stiffness of the strings from it.
pub(super) fn doubtful_tensions(model: &Model, set: &EquipmentSet) -> Vec<String> {
    let doubts = set.rackets.iter().filter(|_| model.takes_tension()).filter_map(Racket::tension_doubt);
    doubts.map(|doubt| format!("{doubt}; the model takes the strings' stiffness from it")).collect()
}

/// Of the bootstrap, where none is given.
pub const DEFAULT_SEED: u64 = 20_080_101;

#[derive(Debug, Clone, clap::Args)]
pub struct ImpactsInput {
    #[command(flatten)]
    pub files: ImpactFiles,
    /// Grouping column (player, session) whose groups stay whole when impacts are held out
    #[arg(long, value_name = "COLUMN")]
    pub group: Option<String>,
    /// Seed of the bootstrap
    #[arg(long, default_value_t = DEFAULT_SEED, value_name = "N")]
    pub seed: u64,
}

/// Everything read and checked.
pub struct Loaded {
    pub table: ImpactTable,
    pub observations: Observations,
    pub equipment: EquipmentSet,
    pub model: Model,
    pub model_text: String,
    pub library: ModelLibrary,
    pub data_hash: String,
    pub provenance: Provenance,
}

impl Loaded {
    /// Once the results are written: they are of the rows that could be used, and the others are named.
    pub fn unless_rows_failed(&self) -> Result<(), CliError> {
        let unusable = &self.observations.unusable;
        if unusable.is_empty() {
            return Ok(());
        }
        let rows = unusable.len() + self.observations.impacts.len();
        let failed = CliError::some_failed(format!("{} of {rows} impacts cannot be used:\n  {}", unusable.len(), with_reasons(unusable, "\n  ")));
        Err(hint_at_faults(failed, &self.table))
    }
}

/// Of a table some rows of which cannot be read: what to do about it.
pub(super) fn hint_at_faults(error: CliError, table: &ImpactTable) -> CliError {
    if table.rows.iter().all(|row| row.fault.is_none()) {
        return error;
    }
    error.hint("correct the cells named, or empty them where nothing was measured, and run the command again; nothing of these rows was used")
}

impl ImpactsInput {
    pub fn load(&self, command: &str) -> Result<Loaded, CliError> {
        let files = &self.files;
        let unreadable = |e: std::io::Error| TableError::Unreadable { path: files.impacts.clone(), source: e.into() };
        let mut bytes = Vec::new();
        LimitedFile::open_given(&files.impacts, LARGEST_TABLE).and_then(|mut file| file.read_to_end(&mut bytes)).map_err(unreadable)?;
        let mut table = ImpactTable::given(bytes.as_slice(), &files.impacts)?;
        few_enough(table.rows.len(), &files.impacts)?;
        let equipment = EquipmentSet::read(&files.racket, &files.ball)?;
        let model_text =
            read_text(&files.model, LARGEST_TEXT).map_err(|e| CliError::input(format!("{}: cannot be read ({e}); check the name", files.model.display())))?;
        let model = Model::parse(&model_text, &files.model)?;
        // Footage gives a contact time, an impulse model has none: it is left out, or no impact could be compared.
        let timed = model.base() == Base::Rigid && table.rows.iter().any(|r| r.get("contact_time").is_some());
        if timed {
            table.rows.iter_mut().for_each(|r| {
                r.set("contact_time", None);
            });
        }
        let options = TableOptions { group: self.group.clone(), own_columns: model.own_columns().into_iter().map(str::to_owned).collect() };
        let (library, mut observations) = ModelLibrary::on_table(&model, &equipment, &table, &options).map_err(|e| of_table(e, &files.impacts))?;
        observations.notes.splice(0..0, remarks(&table).into_iter().chain(beyond_racket(&table, &equipment)).chain(doubtful_tensions(&model, &equipment)));
        if timed {
            observations.notes.push("`contact_time` is left out: base \"rigid\" is an impulse and has none".to_owned());
        }
        let table_hash = sha256_hex(&bytes);
        let mut provenance = Provenance::new(command).with_hash(&files.impacts, table_hash.clone()).with_hash(&files.model, sha256_hex(model_text.as_bytes()));
        for path in files.racket.iter().chain(&files.ball) {
            provenance = provenance.with_file(path).map_err(CliError::input)?;
        }
        // Other groups held out are other data, and so are the rows that are left where a model cannot use all: errors on them are not to be set beside
        // each other.
        let mut data_hash = self.group.as_ref().map_or(table_hash.clone(), |column| sha256_hex(format!("{table_hash} by {column}").as_bytes()));
        if !observations.lost_to_model.is_empty() {
            data_hash = sha256_hex(format!("{data_hash} without {:?}", observations.lost_to_model).as_bytes());
        }
        Ok(Loaded { table, observations, equipment, model, model_text, library, data_hash, provenance })
    }

    pub fn model_name(&self) -> String {
        file_name(&self.files.model)
    }

    /// Title of a report on model and table. Tables are mostly called `impacts.csv`: their folder tells which.
    pub fn report_title(&self) -> String {
        let impacts = &self.files.impacts;
        let folder = std::path::absolute(impacts).ok().and_then(|p| Some(file_name(p.parent()?))).filter(|f| !f.is_empty());
        format!("{} against {}{}", self.model_name(), folder.map_or_else(String::new, |f| format!("{f}/")), file_name(impacts))
    }
}

/// Most impacts by which a model is judged or fitted: each takes some 60 kB on the way, and there must be an end before that of the memory.
const MOST_JUDGED: usize = 100_000;

fn few_enough(impacts: usize, table: &Path) -> Result<(), CliError> {
    if impacts <= MOST_JUDGED {
        return Ok(());
    }
    let what = format!("{}: {impacts} impacts; allowed to judge or fit a model: {MOST_JUDGED}", table.display());
    Err(CliError::input(what).hint("leave some out, or give it in parts (`sweetspot predict` takes a million)"))
}

/// What a table lacks is said of its file.
fn of_table(error: ValidationError, table: &Path) -> CliError {
    match error {
        ValidationError::TooFew { .. }
        | ValidationError::NothingHeldOut
        | ValidationError::OneGroup { .. }
        | ValidationError::NoGroup { .. }
        | ValidationError::NoPrediction { .. } => CliError::input(format!("{}: {error}", table.display())),
        other => other.into(),
    }
}

pub(super) fn file_name(path: &Path) -> String {
    path.file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fails_more_impacts_than_memory_can_be_counted_on_for() {
        assert!(few_enough(MOST_JUDGED, Path::new("t.csv")).is_ok());
        assert!(few_enough(MOST_JUDGED + 1, Path::new("t.csv")).is_err_and(|e| e.message.contains("t.csv: 100001 impacts; allowed")));
    }
}
