//! What is wrong with the rows of a table, all of it at once: who mends a season's table wants to run the program once more, not once for each cell.
//! Of a table that somebody gave, a row with a fault costs itself only, and the row says why.

use std::path::Path;

/// Faults that a message lists, and names of columns; how many more there are is said.
pub(super) const MOST_SHOWN: usize = 20;
/// Letters of a cell that a message shows.
const MOST_LETTERS: usize = 60;
/// Faults of one row that its reason lists: half a million such rows are kept in the memory.
const MOST_OF_A_ROW: usize = 3;

/// Why a row cannot be read, with its line in the file (the header's is 1).
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum RowFault {
    #[error("line {line}: `{column}` is {seen:?}; allowed: {allowed}")]
    Cell { line: u64, column: String, seen: String, allowed: &'static str },
    #[error(
        "line {line}: {seen} fields; allowed: {allowed}, as in the header; a field that holds a comma must stand in quotes, and decimals are written with a point"
    )]
    Fields { line: u64, seen: usize, allowed: usize },
    #[error("line {line}: id {id:?} stands twice (also in line {other}); ids fix which impacts are held out, so each must be its own")]
    SameId { line: u64, id: String, other: u64 },
}

impl RowFault {
    pub(super) fn cell(line: u64, column: &str, seen: &str, allowed: &'static str) -> Self {
        RowFault::Cell { line, column: column.to_owned(), seen: shortened(seen), allowed }
    }

    pub(super) fn same_id(line: u64, id: &str, other: u64) -> Self {
        RowFault::SameId { line, id: shortened(id), other }
    }
}

/// Why a row of this file counts for nothing, in words.
pub(super) fn reason(file: &Path, faults: &[RowFault]) -> Box<str> {
    let told: Vec<String> = faults.iter().take(MOST_OF_A_ROW).map(ToString::to_string).collect();
    let more = faults.len().saturating_sub(MOST_OF_A_ROW);
    let more = if more == 0 { String::new() } else { format!("; and {more} more") };
    // Results hold the file's name alone: they are the same in whatever folder it stands.
    format!("{}, {}{more}", file.file_name().unwrap_or_default().to_string_lossy(), told.join("; ")).into_boxed_str()
}

/// What is allowed where `seen` stands and is no number.
pub(super) fn a_number(seen: &str) -> &'static str {
    if seen.contains(',') && seen.replacen(',', ".", 1).parse::<f64>().is_ok() {
        "a finite number, its decimals after a point, or empty when not measured"
    } else {
        "a finite number, or empty when not measured"
    }
}

fn shortened(text: &str) -> String {
    let mut short: String = text.chars().take(MOST_LETTERS).collect();
    if short.len() < text.len() {
        short.push('…');
    }
    short
}

/// The faults of a table: the first ones, in the order of its lines, and how many there are.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct RowFaults {
    first: Vec<RowFault>,
    all: usize,
}

impl RowFaults {
    /// A file of nothing but faults must not fill the memory with them.
    pub(super) fn add(&mut self, of_a_row: Vec<RowFault>) {
        self.all += of_a_row.len();
        let room = MOST_SHOWN - self.first.len();
        self.first.extend(of_a_row.into_iter().take(room));
    }

    pub fn is_empty(&self) -> bool {
        self.all == 0
    }
}

/// Goes on from the file's name.
impl std::fmt::Display for RowFaults {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if let ([fault], 1) = (self.first.as_slice(), self.all) {
            return write!(f, ", {fault}");
        }
        write!(f, ": {} faults; mend them all, nothing of the table is used until then:", self.all)?;
        self.first.iter().try_for_each(|fault| write!(f, "\n  {fault}"))?;
        match self.all - self.first.len() {
            0 => Ok(()),
            more => write!(f, "\n  and {more} more"),
        }
    }
}

/// The first ones of some words, and how many more there are.
pub(super) fn at_most(words: &[String], between: &str) -> String {
    let shown = words.iter().take(MOST_SHOWN).map(String::as_str).collect::<Vec<_>>().join(between);
    match words.len().saturating_sub(MOST_SHOWN) {
        0 => shown,
        more => format!("{shown}{between}and {more} more"),
    }
}
