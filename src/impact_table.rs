//! The impacts table (contract, section 4): one row per impact, racket-local axes, SI; footage or no footage.
//!
//! Comes in: CSV in which columns may be missing, in any order, with unknown columns kept as grouping columns. Goes out:
//! [`ImpactTable`]. An empty cell is `None`; NaN, infinities, text and negative deviations are faults, told with their lines: they cost their rows where most
//! of a table that somebody gave is sound, else the table.

mod column_words;
mod header;
mod own_columns;
mod pooled;
mod remarks;
mod row_fault;

pub use column_words::{ColumnWords, MEAN, RELATIVE, column_subject, column_words};
pub use header::{LONGEST_NAME, is_own_column};
pub use own_columns::{MOST_OWN_COLUMNS, OwnColumn, OwnColumns, lacking};
pub use remarks::remarks;
pub use row_fault::{RowFault, RowFaults};

use crate::limited_file::{LARGEST_TABLE, LimitedFile, TableFile};
use crate::quantity::as_written;
use header::Header;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Measured inputs of an impact, in the order of the arrays in [`ImpactRow`].
pub const INPUTS: [&str; 15] = [
    "ball_in_vx",
    "ball_in_vy",
    "ball_in_vz",
    "ball_in_wx",
    "ball_in_wy",
    "ball_in_wz",
    "racket_in_vx",
    "racket_in_vy",
    "racket_in_vz",
    "racket_in_wx",
    "racket_in_wy",
    "racket_in_wz",
    "impact_x",
    "impact_y",
    "grip_torque",
];

/// Measured outputs of an impact, in the order of the arrays in [`ImpactRow`].
pub const OUTPUTS: [&str; 13] = [
    "ball_out_vx",
    "ball_out_vy",
    "ball_out_vz",
    "ball_out_wx",
    "ball_out_wy",
    "ball_out_wz",
    "racket_out_vx",
    "racket_out_vy",
    "racket_out_vz",
    "racket_out_wx",
    "racket_out_wy",
    "racket_out_wz",
    "contact_time",
];

/// Errors that all impacts of a session share, as the columns `face_turn_x_sd` ... state them: turn of the face's axes (rad) and
/// shift of the stringbed centre (m), because tape is seen off its middle by the same fraction of a pixel in every shot; shift
/// of the stated balance point along x (m); of the contact time (s), whose end the pictures do not show; and of each component of
/// the velocities and the racket's rates, and of the ball's spins, in proportion to it (relative). Not noise of a single impact,
/// and not physics either.
pub const SHARED: [&str; 10] = [
    "face_turn_x",
    "face_turn_y",
    "face_turn_z",
    "face_shift_x",
    "face_shift_y",
    "face_shift_z",
    "balance_shift",
    "contact_time_shift",
    "speed_scale",
    "spin_scale",
];

/// Unit of a column of [`INPUTS`], [`OUTPUTS`] or [`SHARED`].
pub fn unit(column: &str) -> &'static str {
    match column {
        "impact_x" | "impact_y" => "m",
        c if c.starts_with("face_turn") => "rad",
        c if c.starts_with("face_shift") || c == "balance_shift" => "m",
        "contact_time_shift" => "s",
        "speed_scale" | "spin_scale" => "",
        "grip_torque" => "N m",
        "contact_time" => "s",
        c if c.contains("_w") => "rad/s",
        _ => "m/s",
    }
}

/// Largest size of a value of [`INPUTS`] or [`OUTPUTS`] that an impact can have, in the column's unit, well above every ball game: a larger one is in
/// another unit, or a slip of the pen.
fn largest(column: &str) -> f64 {
    match unit(column) {
        "m" => 0.6,
        "s" => 0.2,
        "N m" => 1e3,
        "rad/s" if column.starts_with("racket") => 2e3,
        "rad/s" => 1e4,
        _ => 500.0,
    }
}

/// Largest deviation of a column of [`SHARED`], and what is allowed in words: with a larger one, another unit's as a rule, an offset of the session
/// takes up whatever a model misses.
fn largest_shared(column: &str) -> (f64, &'static str) {
    match unit(column) {
        "rad" => (1.0, "a standard deviation of at most 1 rad, or empty when not known"),
        "m" => (0.6, "a standard deviation of at most 0.6 m, or empty when not known"),
        "s" => (0.2, "a standard deviation of at most 0.2 s, or empty when not known"),
        _ => (1.0, "a standard deviation of at most 1, relative, or empty when not known"),
    }
}

/// A column's largest value over the smallest deviation beside 0: no number has as many digits, and a fit to smaller deviations fails by rounding.
const LARGEST_OVER_SD: f64 = 1e15;

/// Why cells cannot be those of an impact: the first value, or deviation, that none can have.
pub fn impossible<'a>(mut cells: impl Iterator<Item = (&'a &'static str, &'a Option<Measured>)>) -> Option<String> {
    cells.find_map(|(name, measured)| {
        let (most, unit, Measured { value, sd }) = (largest(name), unit(name), (*measured)?);
        if value.abs() > most {
            let value = as_written(value);
            return Some(format!("`{name}` is {value} {unit}, allowed: up to {most} {unit} either way; give it in SI units, or correct the number"));
        }
        // A deviation as large as all that is possible says nothing, and its square may be no number; one smaller than any measurement's is as bad.
        let least = most / LARGEST_OVER_SD;
        let sd = sd.filter(|sd| *sd > most || (*sd > 0.0 && *sd < least))?;
        let (small, sd) = (sd < least, as_written(sd));
        if small {
            let allowed = format!("{} {unit} or more, or 0", as_written(least));
            return Some(format!("`{name}_sd` is {sd} {unit}, allowed: {allowed}; leave the cell empty where the deviation is not known"));
        }
        Some(format!("`{name}_sd` is {sd} {unit}, allowed: up to {most} {unit}; leave the cell empty where the deviation is not known"))
    })
}

#[derive(Debug, thiserror::Error)]
pub enum TableError {
    #[error("{path}: cannot be read ({source}); give a CSV file with a header line", path = .path.display())]
    Unreadable { path: PathBuf, source: csv::Error },
    #[error("{path}: the table holds no impacts; give at least one row below the header", path = .path.display())]
    Empty { path: PathBuf },
    #[error("{path}: no column `{column}`{remedy}; the header has: {seen}", path = .path.display())]
    NoColumn { path: PathBuf, column: &'static str, seen: String, remedy: &'static str },
    #[error("{path}: column {} in the header; rename or remove one of each", stand_twice(.columns), path = .path.display())]
    Twice { path: PathBuf, columns: Vec<String> },
    #[error("{path}{faults}", path = .path.display())]
    Rows { path: PathBuf, faults: RowFaults },
    #[error("{path}: {}", misspelt_words(.columns), path = .path.display())]
    Misspelt {
        path: PathBuf,
        /// As the header has it, and the name that seems to be meant.
        columns: Vec<(String, String)>,
    },
    #[error("{path}: a column's name has {length} bytes (it begins {begins:?}); allowed: {most}", path = .path.display())]
    LongName { path: PathBuf, begins: String, length: usize, most: usize },
    #[error("{path}, line {line}: more than {most} impacts, the most allowed with {grouping} columns of the table's own; give it in parts, or leave columns out", path = .path.display())]
    TooLarge { path: PathBuf, line: u64, most: usize, grouping: usize },
    #[error("{path}: not a text in UTF-8 ({source}); save it as CSV in UTF-8", path = .path.display())]
    Encoding { path: PathBuf, source: csv::Error },
}

/// Columns that stand more than once, at most [`row_fault::MOST_SHOWN`] of them.
fn stand_twice(columns: &[String]) -> String {
    let named: Vec<String> = columns.iter().map(|c| format!("`{c}`")).collect();
    format!("{} {} twice", row_fault::at_most(&named, ", "), if columns.len() > 1 { "stand" } else { "stands" })
}

fn misspelt_words(columns: &[(String, String)]) -> String {
    match columns {
        [(column, meant)] => format!("column `{column}` has no meaning, and would be a group's; if it is `{meant}`, write it so, else name it otherwise"),
        _ => {
            let named: Vec<String> = columns.iter().map(|(column, meant)| format!("`{column}` (if it is `{meant}`)")).collect();
            format!(
                "{} columns have no meaning, and would be groups'; write them so, or name them otherwise:\n  {}",
                columns.len(),
                row_fault::at_most(&named, "\n  ")
            )
        }
    }
}

/// A measured value with its standard deviation, where the table gives one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measured {
    pub value: f64,
    pub sd: Option<f64>,
}

#[derive(Debug, Clone, PartialEq)]
pub struct ImpactRow {
    pub id: String,
    pub racket: Option<String>,
    pub ball: Option<String>,
    /// Order in time; the row's place (from 0) unless a column `sequence` says otherwise.
    pub sequence: f64,
    /// In the order of [`INPUTS`].
    pub inputs: [Option<Measured>; INPUTS.len()],
    /// In the order of [`OUTPUTS`].
    pub outputs: [Option<Measured>; OUTPUTS.len()],
    /// Deviations of what the session's impacts share, in the order of [`SHARED`].
    pub shared_sd: [Option<f64>; SHARED.len()],
    /// Unknown columns: player, sex, session, ...
    pub groups: BTreeMap<String, String>,
    /// Why nothing of the row counts but its name, its place in time and its groups: a cell of it cannot be read, or its id is another's too.
    pub fault: Option<Box<str>>,
}

impl ImpactRow {
    pub fn new(id: &str) -> Self {
        ImpactRow {
            id: id.to_owned(),
            racket: None,
            ball: None,
            sequence: 0.0,
            inputs: [None; INPUTS.len()],
            outputs: [None; OUTPUTS.len()],
            shared_sd: [None; SHARED.len()],
            groups: BTreeMap::new(),
            fault: None,
        }
    }

    /// The row without what was measured. What was read of it may be right, but who can tell which cell is not.
    fn faulty(self, fault: Box<str>) -> Self {
        ImpactRow { sequence: self.sequence, groups: self.groups, fault: Some(fault), ..ImpactRow::new(&self.id) }
    }

    /// The value of a named input or output column, if it was measured.
    pub fn get(&self, column: &str) -> Option<Measured> {
        if let Some(i) = INPUTS.iter().position(|c| *c == column) {
            return self.inputs[i];
        }
        OUTPUTS.iter().position(|c| *c == column).and_then(|i| self.outputs[i])
    }

    /// Sets a named input or output column; `false` when the name is neither.
    pub fn set(&mut self, column: &str, measured: Option<Measured>) -> bool {
        if let Some(i) = INPUTS.iter().position(|c| *c == column) {
            self.inputs[i] = measured;
            return true;
        }
        match OUTPUTS.iter().position(|c| *c == column) {
            Some(i) => {
                self.outputs[i] = measured;
                true
            }
            None => false,
        }
    }
}

#[derive(Debug, Clone, Default, PartialEq)]
pub struct ImpactTable {
    pub rows: Vec<ImpactRow>,
    /// Whether the file's `sequence` was no count of impacts, and the rows have their ranks by it instead.
    pub has_ranks: bool,
}

/// Larger steps from impact to impact, in the mean, are no count of impacts of which some are not in the table.
pub(crate) const LONGEST_STEP: f64 = 20.0;

/// A column `sequence` counts impacts (not all of them need be in the table). Times of day, dates or parts of a count tell the order alone: the ranks take
/// their place; whether they do.
fn rank_unless_counted(rows: &mut [ImpactRow]) -> bool {
    let known: Vec<f64> = rows.iter().map(|r| r.sequence).filter(|s| s.is_finite()).collect();
    let (first, last) = known.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(first, last), s| (s.min(first), s.max(last)));
    if known.iter().all(|s| s.fract() == 0.0) && last - first <= LONGEST_STEP * known.len() as f64 {
        return false;
    }
    let mut ranks = known;
    ranks.sort_by(f64::total_cmp);
    ranks.dedup();
    for row in rows.iter_mut().filter(|r| r.sequence.is_finite()) {
        row.sequence = ranks.partition_point(|s| *s < row.sequence) as f64;
    }
    true
}

impl ImpactTable {
    /// The smallest sequence number: the order of an impact counts from it, whichever rows can be used. (One that cannot be read is no number.)
    pub fn first_sequence(&self) -> f64 {
        self.rows.iter().map(|r| r.sequence).fold(f64::INFINITY, f64::min)
    }

    /// Reads and checks a table of the program's own: it is whole, or it is damaged.
    pub fn read(path: &Path) -> Result<Self, TableError> {
        let file = LimitedFile::open(path, LARGEST_TABLE).map_err(|e| TableError::Unreadable { path: path.into(), source: e.into() })?;
        Self::from_reader(file, path)
    }

    /// A table that the user named, which may be a pipe; see [`Self::given`].
    pub fn read_given(path: &Path) -> Result<Self, TableError> {
        let file = LimitedFile::open_given(path, LARGEST_TABLE).map_err(|e| TableError::Unreadable { path: path.into(), source: e.into() })?;
        Self::given(file, path)
    }

    /// Reads from any reader; `path` is for messages. A fault in one row is one of the table.
    pub fn from_reader(reader: impl std::io::Read, path: &Path) -> Result<Self, TableError> {
        let (table, faults) = Self::with_faults(reader, path)?;
        if faults.is_empty() { Ok(table) } else { Err(TableError::Rows { path: path.into(), faults }) }
    }

    /// [`Self::from_reader`] of a table that somebody made: a row with a fault costs itself only ([`ImpactRow::fault`]).
    ///
    /// # Errors
    /// Where half of the rows or more have one it is the table that is wrong (decimal commas, another program's words for "not measured").
    pub fn given(reader: impl std::io::Read, path: &Path) -> Result<Self, TableError> {
        let (table, faults) = Self::with_faults(reader, path)?;
        let faulty = table.rows.iter().filter(|row| row.fault.is_some()).count();
        if 2 * faulty < table.rows.len() { Ok(table) } else { Err(TableError::Rows { path: path.into(), faults }) }
    }

    fn with_faults(reader: impl std::io::Read, path: &Path) -> Result<(Self, RowFaults), TableError> {
        let unreadable = |source: csv::Error| match source.kind() {
            csv::ErrorKind::Utf8 { .. } => TableError::Encoding { path: path.into(), source },
            _ => TableError::Unreadable { path: path.into(), source },
        };
        // A row of another length is a fault like any other, and named with them.
        let mut csv = csv::ReaderBuilder::new().trim(csv::Trim::All).flexible(true).from_reader(TableFile::new(reader));
        let names = csv.headers().map_err(unreadable)?;
        if names.is_empty() {
            return Err(TableError::Empty { path: path.into() });
        }
        let header = Header::of(names, path)?;
        let most_rows = header.most_rows();
        let mut rows: Vec<ImpactRow> = Vec::new();
        // The line in which each id stands, and its place among the rows.
        let mut ids: BTreeMap<String, (u64, usize)> = BTreeMap::new();
        let mut faults = RowFaults::default();
        for record in csv.records() {
            let record = record.map_err(unreadable)?;
            let line = record.position().map_or(0, csv::Position::line);
            // What a spreadsheet makes of an emptied row is an empty line.
            if record.iter().all(str::is_empty) {
                continue;
            }
            let n = rows.len();
            if n >= most_rows {
                return Err(TableError::TooLarge { path: path.into(), line, most: most_rows, grouping: header.grouping() });
            }
            let mut of_row = Vec::new();
            let row = if record.len() == header.names.len() {
                header.row(&record, line, n, &mut of_row)
            } else {
                of_row.push(RowFault::Fields { line, seen: record.len(), allowed: header.names.len() });
                header.unread(line, n)
            };
            match ids.get(&row.id) {
                // Which of the two is meant nobody can tell: neither counts.
                Some(&(first, at)) => {
                    of_row.push(RowFault::same_id(line, &row.id, first));
                    let earlier = std::mem::replace(&mut rows[at], ImpactRow::new(""));
                    let reason = earlier.fault.clone().unwrap_or_else(|| row_fault::reason(path, &[RowFault::same_id(first, &row.id, line)]));
                    rows[at] = earlier.faulty(reason);
                }
                None => {
                    ids.insert(row.id.clone(), (line, n));
                }
            }
            rows.push(if of_row.is_empty() { row } else { row.faulty(row_fault::reason(path, &of_row)) });
            faults.add(of_row);
        }
        if rows.is_empty() {
            return Err(TableError::Empty { path: path.into() });
        }
        let has_ranks = rank_unless_counted(&mut rows);
        Ok((ImpactTable { rows, has_ranks }, faults))
    }

    /// The table as CSV: every contract column that is measured anywhere, its `_sd`, then the grouping columns.
    pub fn to_csv(&self) -> String {
        let has = |output: bool, i: usize, sd: bool| {
            self.rows.iter().any(|r| (if output { r.outputs[i] } else { r.inputs[i] }).is_some_and(|m| !sd || m.sd.is_some()))
        };
        let mut cells: Vec<(bool, usize, bool)> = Vec::new();
        for sd in [false, true] {
            for (output, names) in [(false, &INPUTS[..]), (true, &OUTPUTS[..])] {
                // Values always stand in the file, so that a reader finds every column; deviations only where known.
                cells.extend((0..names.len()).filter(|&i| !sd || has(output, i, true)).map(|i| (output, i, sd)));
            }
        }
        let shared: Vec<usize> = (0..SHARED.len()).filter(|&i| self.rows.iter().any(|r| r.shared_sd[i].is_some())).collect();
        let groups: BTreeSet<&str> = self.rows.iter().flat_map(|r| r.groups.keys().map(String::as_str)).collect();
        let name = |&(output, i, sd): &(bool, usize, bool)| format!("{}{}", if output { OUTPUTS[i] } else { INPUTS[i] }, if sd { "_sd" } else { "" });
        let mut csv = csv::Writer::from_writer(Vec::new());
        let header = ["id", "racket", "ball", "sequence"]
            .iter()
            .map(|s| (*s).to_owned())
            .chain(cells.iter().map(name))
            .chain(shared.iter().map(|&i| format!("{}_sd", SHARED[i])))
            .chain(groups.iter().map(|g| (*g).to_owned()));
        let mut write = |fields: Vec<String>| csv.write_record(&fields).unwrap_or_else(|e| unreachable!("writing to memory: {e}"));
        write(header.collect());
        for r in &self.rows {
            let mut fields = vec![r.id.clone(), r.racket.clone().unwrap_or_default(), r.ball.clone().unwrap_or_default(), r.sequence.to_string()];
            for &(output, i, sd) in &cells {
                let m = if output { r.outputs[i] } else { r.inputs[i] };
                fields.push(m.and_then(|m| if sd { m.sd } else { Some(m.value) }).map_or_else(String::new, |v| v.to_string()));
            }
            fields.extend(shared.iter().map(|&i| r.shared_sd[i].map_or_else(String::new, |v| v.to_string())));
            fields.extend(groups.iter().map(|g| r.groups.get(*g).cloned().unwrap_or_default()));
            write(fields);
        }
        String::from_utf8(csv.into_inner().unwrap_or_default()).unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<ImpactTable, TableError> {
        ImpactTable::from_reader(text.as_bytes(), Path::new("t.csv"))
    }

    #[test]
    fn law_a_table_survives_writing_and_reading() {
        let t = read("player,ball_out_vz_sd,id,ball_in_vz,ball_out_vz,face_turn_y_sd,balance_shift_sd\nA,0.1,a,-20.5,,,\nB,0.25,b,,11.125,0.002,0.001\n")
            .expect("valid");
        assert_eq!((t.rows[0].shared_sd[1], t.rows[1].shared_sd[1], t.rows[1].shared_sd[6]), (None, Some(0.002), Some(0.001)));
        assert_eq!(t.rows[1].get("ball_out_vz"), Some(Measured { value: 11.125, sd: Some(0.25) }));
        assert_eq!(t.rows[0].get("ball_out_vz"), None);
        assert_eq!(read(&t.to_csv()).expect("own output"), t);
    }

    #[test]
    fn fails_a_column_with_a_letter_wrong_is_not_taken_for_a_group() {
        for (column, own) in [
            ("Ball_In_Vx", "ball_in_vx"),
            ("ball_in_vx [m/s]", "ball_in_vx"),
            ("ball-in-vx", "ball_in_vx"),
            ("ball_in_vxx", "ball_in_vx"),
            ("balll_in_vx", "ball_in_vx"),
            ("impact_ (m)", ""),
            ("contact_tim", "contact_time"),
            ("Racket", "racket"),
            ("Ball_in_vy_SD", "ball_in_vy_sd"),
            ("ball_in_vy_sd (m/s)", "ball_in_vy_sd"),
            ("ball_in_vy_std", "ball_in_vy_sd"),
            ("Face_turn_x_sd", "face_turn_x_sd"),
            ("player", ""),
            ("balls", ""),
        ] {
            let refused = read(&format!("id,ball_in_vy,{column}\na,1,2\n")).err();
            let meant = refused.as_ref().map_or("", |e| if let TableError::Misspelt { columns, .. } = e { &columns[0].1 } else { "another fault" });
            assert_eq!(meant, own, "{column}");
        }
        let all = read("Id,Ball_in_vx,Ball_in_vx_sd,player\na,1,2,A\n").expect_err("three columns").to_string();
        assert!(["3 columns", "`Id` (if it is `id`)", "`Ball_in_vx` (if it is `ball_in_vx`)", "`Ball_in_vx_sd` (if"].iter().all(|w| all.contains(w)), "{all}");
        // Where the column itself is there, the other is the table's own.
        let both = read("id,ball_in_vx,ball_in_vxx\na,1,2\n").expect("two columns");
        assert_eq!(both.rows[0].groups["ball_in_vxx"], "2");
    }

    #[test]
    fn fails_a_table_in_another_encoding_says_which_to_use() {
        let latin = b"id,player\na,J\xf6rg\n";
        let message = ImpactTable::from_reader(&latin[..], Path::new("t.csv")).expect_err("not UTF-8").to_string();
        assert!(message.contains("save it as CSV in UTF-8"), "{message}");
    }

    #[test]
    fn fails_a_deviation_that_says_nothing() {
        let told = |text: &str| impossible(INPUTS.iter().zip(&read(text).expect("a table").rows[0].inputs));
        assert_eq!(told("id,ball_in_vz,ball_in_vz_sd\na,-20,0.5\n"), None);
        assert!(told("id,ball_in_vz,ball_in_vz_sd\na,-20,1e308\n").is_some_and(|why| why.contains("`ball_in_vz_sd` is 1e308 m/s, allowed: up to 500")));
        assert_eq!(told("id,ball_in_vz,ball_in_vz_sd\na,-20,0\n"), None);
        let tiny = told("id,ball_in_vz,ball_in_vz_sd\na,-20,1e-300\n");
        assert!(tiny.is_some_and(|why| why.contains("`ball_in_vz_sd` is 1e-300 m/s, allowed: 5e-13 m/s or more, or 0")));
        assert!(told("id,ball_in_vz\na,-2000\n").is_some_and(|why| why.contains("`ball_in_vz` is -2000 m/s")));
    }

    #[test]
    fn rows_without_names_are_numbered() {
        let table = read("ball_in_vz,player\n-20,A\n-21,B\n").expect("a table");
        assert_eq!(table.rows.iter().map(|r| r.id.as_str()).collect::<Vec<_>>(), ["1", "2"]);
    }

    #[test]
    fn fails_nan_negative_sd_doubles_and_empty_tables_are_refused() {
        for (text, word) in [
            ("id,ball_in_vz\na,NaN\n", "line 2: `ball_in_vz` is \"NaN\""),
            ("id,ball_in_vz,ball_in_vz_sd\na,1,-2\n", "0 or more"),
            ("id,face_shift_z_sd\na,-2\n", "0 or more"),
            ("id,face_turn_x_sd\na,1e300\n", "line 2: `face_turn_x_sd` is \"1e300\"; allowed: a standard deviation of at most 1 rad"),
            ("id,speed_scale_sd\na,1.5\n", "at most 1, relative"),
            ("id\na\na\n", "stands twice"),
            ("id,ball_in_vz\n", "no impacts"),
            ("", "no impacts"),
            ("name\na\n", "no column `id`"),
            ("id;ball_in_vz\na;-20,5\n", "part the fields by commas"),
            ("sep=,\nid,ball_in_vz\na,-20\n", "leave out the first line"),
            ("id,id\na,b\n", "stands twice in the header"),
            ("id,Ball_in_vz\na,-20\n", "if it is `ball_in_vz`, write it so"),
            ("id,ball_out_vz [m/s]\na,20\n", "if it is `ball_out_vz`, write it so"),
            ("id,sequence\na,1\nb,\n", "line 3: `sequence` is \"\""),
            ("id,ball_in_vz\r\na,1\r\nb,NaN\r\n", "line 3: `ball_in_vz` is \"NaN\""),
            (&format!("id,{}\na,1\n", "n".repeat(300)), "has 300 bytes"),
        ] {
            let message = read(text).expect_err(text).to_string();
            assert!(message.contains(word), "{message}");
        }
    }

    #[test]
    fn fails_all_faults_of_a_table_are_told_at_once() {
        let text = "id,sequence,ball_in_vz,ball_in_vz_sd\na,1,NaN,-2\nb,2,-20,0.5\nb,,\"20,5\",#N/A\nc,4,-20\n,5,1,0\nd,x,1,0\n";
        let message = read(text).expect_err("faults").to_string();
        let lines: Vec<&str> = message.lines().collect();
        let told = [
            "t.csv: 9 faults; mend them all, nothing of the table is used until then:",
            "  line 2: `ball_in_vz` is \"NaN\"; allowed: a finite number, or empty when not measured",
            "  line 2: `ball_in_vz_sd` is \"-2\"; allowed: a standard deviation of 0 or more",
            "  line 4: `sequence` is \"\"; allowed: a number in every row; or leave the column out, and the rows' order counts",
            "  line 4: `ball_in_vz` is \"20,5\"; allowed: a finite number, its decimals after a point, or empty when not measured",
            "  line 4: `ball_in_vz_sd` is \"#N/A\"; allowed: a finite number, or empty when not measured",
            "  line 4: id \"b\" stands twice (also in line 3); ids fix which impacts are held out, so each must be its own",
            "  line 5: 3 fields; allowed: 4, as in the header; a field that holds a comma must stand in quotes, and decimals are written with a point",
            "  line 6: `id` is \"\"; allowed: a name of its own for every impact",
            "  line 7: `sequence` is \"x\"; allowed: a number in every row; or leave the column out, and the rows' order counts",
        ];
        assert_eq!(lines, told);
        // A file of nothing but faults neither fills the screen nor the memory.
        let many = format!("id,ball_in_vz\n{}", (0..500).map(|k| format!("s{k},{}\n", "x".repeat(100))).collect::<String>());
        let message = read(&many).expect_err("500 faults").to_string();
        assert!(message.lines().count() == 22 && message.contains(": 500 faults") && message.ends_with("\n  and 480 more"), "{message}");
        assert!(message.contains(&format!("\"{}…\"", "x".repeat(60))), "{message}");
    }

    #[test]
    fn fails_a_bad_cell_of_a_given_table_costs_its_row_only() {
        let given = |text: &str| ImpactTable::given(text.as_bytes(), Path::new("of/t.csv"));
        let head = "id,player,ball_in_vz,ball_in_vz_sd,impact_x,speed_scale_sd\n";
        let sound: String = (0..20).map(|k| format!("s{k},A,-20.{k},0.5,0.01,\n")).collect();
        let fault = |table: &ImpactTable, id: &str| {
            let row = table.rows.iter().find(|r| r.id == id).expect("the row keeps its place").clone();
            assert!(row.inputs.iter().all(Option::is_none), "{row:?}");
            row.fault.map(String::from).unwrap_or_default()
        };
        for (row, id, words) in [
            ("a,B,n/a,0.5,0.01,", "a", &["t.csv, line 22: `ball_in_vz` is \"n/a\"; allowed: a finite number"][..]),
            ("a,B,#REF!,NaN,0.01,", "a", &["`ball_in_vz` is \"#REF!\"", "`ball_in_vz_sd` is \"NaN\""]),
            ("a,B,\"-20,5\",0.5,0.01,", "a", &["`ball_in_vz` is \"-20,5\"", "decimals after a point"]),
            ("a,B,-20.5,0.5,inf,", "a", &["`impact_x` is \"inf\""]),
            ("a,B,-20.5,-0.5,0.01,", "a", &["a standard deviation of 0 or more"]),
            ("a,B,-20.5,0.5,0.01,7", "a", &["`speed_scale_sd` is \"7\""]),
            ("a,B,-20,5,0.5,0.01,", "line 22", &["line 22: 7 fields; allowed: 6"]),
            (",B,-20.5,0.5,0.01,", "line 22", &["`id` is \"\""]),
            ("s3,B,-20.5,0.5,0.01,", "s3", &["line 5: id \"s3\" stands twice (also in line 22)"]),
        ] {
            let table = given(&format!("{head}{sound}{row}\nz,A,-21,0.5,0.01,\n")).expect("most rows are sound");
            let told = fault(&table, id);
            assert!(words.iter().all(|word| told.contains(word)), "{row}: {told}");
            // The rows after it keep their place in time, whose beginning is that of all.
            assert_eq!((table.rows.len(), table.rows[21].sequence, table.first_sequence()), (22, 21.0, 0.0));
            let lost = table.rows.iter().filter(|r| r.fault.is_some()).count();
            assert_eq!(lost, if id == "s3" { 2 } else { 1 }, "{row}");
        }
        // A place in time that cannot be read is none, least of all the first.
        let timed = given("id,sequence,ball_in_vz\na,x,-20\nb,100,-20\nc,101,-20\n").expect("two sound rows");
        assert!(timed.first_sequence() == 100.0 && timed.rows[0].fault.is_some());
        // Counts may leave impacts out; times, and parts of a count, tell the order alone.
        for (written, meant) in
            [("100 103 101", [100.0, 103.0, 101.0]), ("20260101120000 20260101140000 20260101130000", [0.0, 2.0, 1.0]), ("0.5 0.9 0.5", [0.0, 1.0, 0.0])]
        {
            let rows = written.split(' ').enumerate().map(|(i, s)| format!("{i},{s},-20\n")).collect::<String>();
            let order: Vec<f64> = given(&format!("id,sequence,ball_in_vz\n{rows}")).expect("three rows").rows.iter().map(|r| r.sequence).collect();
            assert_eq!(order, meant, "{written}");
        }
        // The table is wrong, not a row of it.
        for text in [
            "id,ball_in_vz\na,\"-20,5\"\nb,\"-21,5\"\nc,-20\n",
            "id,ball_in_vz\na,-20,5\nb,-21,5\nc,-20\n",
            "id,ball_in_vz\na,n/a\nb,-20\n",
            "id,ball_in_vz\na,-20\nb,-20\na,-21\nb,-21\n",
        ] {
            let refused = given(text).expect_err(text).to_string();
            assert!(refused.contains("2 faults; mend them all, nothing of the table is used") || refused.contains("line 2: `ball_in_vz`"), "{refused}");
        }
    }

    #[test]
    fn what_a_spreadsheet_leaves_empty_is_no_fault() {
        let sound = read("id,ball_in_vz\na,-20\nb,-21\n").expect("a table");
        assert_eq!(read("\u{feff}id,ball_in_vz,,\r\na,-20,,\r\n,,,\r\nb,-21,,\r\n,,,\r\n").expect("the same"), sound);
        // Another program's row numbers have no name either, and are no group of the user's.
        assert_eq!(read(",id,ball_in_vz\n1,a,-20\n2,b,-21\n").expect("the same"), sound);
        assert_eq!(read("ball_in_vz,\n-20,\n,\n-21,\n").expect("numbered").rows[1].id, "2");
    }
}
