//! The files that compare, diagnose and fit share: an impacts table, rackets, balls, a model; and the ledger of models.

use super::Shell;
use super::error::{CliError, with_reasons};
use crate::equipment::Racket;
use crate::equipment_set::EquipmentSet;
use crate::impact::{Base, Model};
use crate::impact_table::{ImpactRow, ImpactTable, TableError, remarks};
use crate::kinematics::past_racket;
use crate::limited_file::{LARGEST_TABLE, LARGEST_TEXT, LimitedFile, read_text};
use crate::provenance::{Provenance, VERSION, sha256_hex};
use crate::short_list::short_list;
use crate::validation::ValidationError;
use crate::validation::comparison::{Comparison, ParameterValue};
use crate::validation::ledger::{Ledger, LedgerEntry, Refusal};
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
        Err(CliError::some_failed(format!("{} of {rows} impacts cannot be used:\n  {}", unusable.len(), with_reasons(unusable, "\n  "))))
    }
}

impl ImpactsInput {
    pub fn load(&self, command: &str) -> Result<Loaded, CliError> {
        let files = &self.files;
        let unreadable = |e: std::io::Error| TableError::Unreadable { path: files.impacts.clone(), source: e.into() };
        let mut bytes = Vec::new();
        LimitedFile::open_given(&files.impacts, LARGEST_TABLE).and_then(|mut file| file.read_to_end(&mut bytes)).map_err(unreadable)?;
        let mut table = ImpactTable::from_reader(bytes.as_slice(), &files.impacts)?;
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

fn file_name(path: &Path) -> String {
    path.file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned())
}

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

/// Today in UTC as YYYY-MM-DD; `SOURCE_DATE_EPOCH` fixes it for reproducible output.
pub fn today() -> String {
    let fixed = std::env::var("SOURCE_DATE_EPOCH").ok().and_then(|v| v.parse::<u64>().ok());
    date(fixed.unwrap_or_else(|| std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).map_or(0, |d| d.as_secs())))
}

/// The day of so many seconds since 1970-01-01. Counted in 400-year eras that begin on 1 March.
fn date(seconds: u64) -> String {
    let days = (seconds / 86_400) as i64 + 719_468;
    let era = days.div_euclid(146_097);
    let of_era = days.rem_euclid(146_097);
    let year_of_era = (of_era - of_era / 1_460 + of_era / 36_524 - of_era / 146_096) / 365;
    let day_of_year = of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let month_from_march = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * month_from_march + 2) / 5 + 1;
    let month = if month_from_march < 10 { month_from_march + 3 } else { month_from_march - 9 };
    let year = year_of_era + era * 400 + i64::from(month <= 2);
    format!("{year:04}-{month:02}-{day:02}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fails_more_impacts_than_memory_can_be_counted_on_for() {
        assert!(few_enough(MOST_JUDGED, Path::new("t.csv")).is_ok());
        assert!(few_enough(MOST_JUDGED + 1, Path::new("t.csv")).is_err_and(|e| e.message.contains("t.csv: 100001 impacts; allowed")));
    }

    #[test]
    fn truth_days_of_leap_years_and_of_others() {
        for (seconds, day) in [
            (0, "1970-01-01"),
            (951_782_400, "2000-02-29"),
            (1_709_164_800, "2024-02-29"),
            (1_735_689_599, "2024-12-31"),
            (1_735_689_600, "2025-01-01"),
            (4_107_542_399, "2100-02-28"),
            (4_107_542_400, "2100-03-01"),
        ] {
            assert_eq!(date(seconds), day);
        }
    }
}
