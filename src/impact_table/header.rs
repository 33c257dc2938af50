//! The header of an impacts table: what each column is, and a row's cells read by it.

use super::row_fault::{self, RowFault};
use super::{INPUTS, ImpactRow, Measured, OUTPUTS, SHARED, TableError, largest_shared};
use std::collections::BTreeSet;
use std::path::Path;

/// Larger sequence numbers lie too far apart, as doubles, to tell neighbours.
const LARGEST_SEQUENCE: f64 = 1e15;
/// Most impacts of a table (a kilobyte each), most cells in grouping columns (a hundred bytes each), and the longest name of a column, bytes: a small
/// file must not ask for all the memory there is.
const MOST_ROWS: usize = 1_000_000;
const MOST_GROUPING_CELLS: usize = 10_000_000;
pub const LONGEST_NAME: usize = 256;
/// Of a header in a message, letters.
const MOST_SHOWN: usize = 400;

enum Column {
    Id,
    Racket,
    Ball,
    Sequence,
    Value {
        output: bool,
        index: usize,
        sd: bool,
    },
    SharedSd(usize),
    Group(String),
    /// Without a name (a spreadsheet's empty columns, another program's row numbers): nobody can ask for it.
    Nameless,
}

fn column(name: &str) -> Column {
    match name {
        "" => return Column::Nameless,
        "id" => return Column::Id,
        "racket" => return Column::Racket,
        "ball" => return Column::Ball,
        "sequence" => return Column::Sequence,
        _ => {}
    }
    let (base, sd) = name.strip_suffix("_sd").map_or((name, false), |b| (b, true));
    if let Some(index) = INPUTS.iter().position(|c| *c == base) {
        Column::Value { output: false, index, sd }
    } else if let Some(index) = OUTPUTS.iter().position(|c| *c == base) {
        Column::Value { output: true, index, sd }
    } else if let Some(index) = SHARED.iter().position(|c| *c == base).filter(|_| sd) {
        Column::SharedSd(index)
    } else {
        Column::Group(name.to_owned())
    }
}

/// The column that an unknown name is but for capitals, a unit behind it, other signs between its words or one letter more or less, where the header
/// has no such column.
fn meant(name: &str, own_names: &[String], header: &BTreeSet<&str>) -> Option<String> {
    if is_own_column(name) {
        return None;
    }
    let bare = name.split(['[', '(', ' ']).next().unwrap_or_default().trim_end_matches('_').to_lowercase();
    let letters = |name: &str| name.chars().filter(char::is_ascii_alphanumeric).collect::<String>();
    // Short names (`ball`) are one letter away from much.
    let bare_letters = letters(&bare);
    let slip = |own: &str| own.contains('_') && bare.len() < 2 * own.len() && (letters(own) == bare_letters || one_letter_more_or_less(own, &bare));
    own_names.iter().find(|own| (**own == bare || slip(own)) && !header.contains(own.as_str())).cloned()
}

/// The names to which the table gives a meaning of its own.
fn own_names() -> Vec<String> {
    let values = ["id", "racket", "ball", "sequence"].into_iter().chain(INPUTS).chain(OUTPUTS).map(str::to_owned);
    // A deviation that is taken for a group's column is as good as lost.
    let deviations = INPUTS.into_iter().chain(OUTPUTS).chain(SHARED).map(|c| format!("{c}_sd"));
    values.chain(deviations).collect()
}

fn one_letter_more_or_less(a: &str, b: &str) -> bool {
    a.len().abs_diff(b.len()) == 1 && strsim::levenshtein(a, b) == 1
}

/// Whether the table gives this column a meaning of its own, so that no grouping column may bear the name.
pub fn is_own_column(name: &str) -> bool {
    !matches!(column(name), Column::Group(_) | Column::Nameless)
}

/// The columns of a table, checked.
pub(super) struct Header {
    pub(super) names: Vec<String>,
    columns: Vec<Column>,
    /// Without names of their own the rows are numbered.
    numbered: bool,
}

impl Header {
    pub(super) fn of(header: &csv::StringRecord, path: &Path) -> Result<Self, TableError> {
        let names: Vec<String> = header.iter().map(|h| h.trim_start_matches('\u{feff}').to_owned()).collect();
        let numbered = !names.iter().any(|n| n == "id");
        // A file that holds no column of an impact is none.
        let parted = names.len() == 1 && names[0].contains([';', '\t']);
        let (own_names, all): (_, BTreeSet<&str>) = (own_names(), names.iter().map(String::as_str).collect());
        let misspelt: Vec<(String, String)> = names.iter().filter_map(|n| Some((n.clone(), meant(n, &own_names, &all)?))).collect();
        if numbered && !names.iter().any(|n| INPUTS.contains(&n.as_str())) && (parted || misspelt.is_empty()) {
            let numbers = names.iter().any(|n| n.parse::<f64>().is_ok());
            let begins = names.first().map_or("", String::as_str);
            let remedy = if begins.contains('\0') && !begins.starts_with("PK") {
                "; it seems to be UTF-16: save it as CSV in UTF-8"
            } else if begins.starts_with("PK\u{3}\u{4}") {
                "; it is a workbook (or another packed file): save the sheet as CSV in UTF-8"
            } else if begins.starts_with("sep=") {
                "; leave out the first line, which only tells a spreadsheet what parts the fields"
            } else if parted {
                "; part the fields by commas and write decimals with a point"
            } else if numbers {
                "; the first line must name the columns"
            } else {
                ""
            };
            let seen = names.join(", ").replace('\t', " ").chars().filter(|c| !c.is_control()).take(MOST_SHOWN).collect();
            return Err(TableError::NoColumn { path: path.into(), column: "id", seen, remedy });
        }
        if let Some(long) = names.iter().find(|n| n.len() > LONGEST_NAME) {
            let begins = long.chars().take(40).collect();
            return Err(TableError::LongName { path: path.into(), begins, length: long.len(), most: LONGEST_NAME });
        }
        let mut seen = BTreeSet::new();
        let twice: BTreeSet<&String> = names.iter().filter(|n| !n.is_empty() && !seen.insert(n.as_str())).collect();
        if !twice.is_empty() {
            return Err(TableError::Twice { path: path.into(), columns: twice.into_iter().cloned().collect() });
        }
        if !misspelt.is_empty() {
            return Err(TableError::Misspelt { path: path.into(), columns: misspelt });
        }
        let columns = names.iter().map(|n| column(n)).collect();
        Ok(Header { names, columns, numbered })
    }

    /// How many columns are nobody's but the user's.
    pub(super) fn grouping(&self) -> usize {
        self.columns.iter().filter(|c| matches!(c, Column::Group(_))).count()
    }

    pub(super) fn most_rows(&self) -> usize {
        MOST_ROWS.min(MOST_GROUPING_CELLS / self.grouping().max(1))
    }

    /// What is left of the row at place `n`, in line `line`, whose cells cannot be told apart. It is named by its line.
    pub(super) fn unread(&self, line: u64, n: usize) -> ImpactRow {
        let mut row = ImpactRow::new(&self.name(line, n, ""));
        row.sequence = if self.columns.iter().any(|c| matches!(c, Column::Sequence)) { f64::NAN } else { n as f64 };
        // Whoever asks which columns there are may ask this row.
        row.groups = self.columns.iter().filter_map(|c| if let Column::Group(g) = c { Some((g.clone(), String::new())) } else { None }).collect();
        row
    }

    /// The id of a row at place `n`.
    fn name(&self, line: u64, n: usize, cell: &str) -> String {
        match cell {
            _ if self.numbered => (n + 1).to_string(),
            "" => format!("line {line}"),
            id => id.to_owned(),
        }
    }

    /// The row at place `n`, in line `line` of the file. What is wrong with its cells is added to `faults`; such a cell counts as empty.
    pub(super) fn row(&self, record: &csv::StringRecord, line: u64, n: usize, faults: &mut Vec<RowFault>) -> ImpactRow {
        let mut row = ImpactRow::new("");
        row.sequence = n as f64;
        let mut sds: Vec<(bool, usize, f64)> = Vec::new();
        for ((cell, kind), name) in record.iter().zip(&self.columns).zip(&self.names) {
            let mut bad = |allowed| faults.push(RowFault::cell(line, name, cell, allowed));
            let read = cell.parse::<f64>().ok().filter(|v| v.is_finite());
            let mut number = || -> Option<f64> {
                if read.is_none() && !cell.is_empty() {
                    bad(row_fault::a_number(cell));
                }
                read
            };
            match kind {
                Column::Id => row.id = cell.to_owned(),
                Column::Racket => row.racket = Some(cell.to_owned()).filter(|c| !c.is_empty()),
                Column::Ball => row.ball = Some(cell.to_owned()).filter(|c| !c.is_empty()),
                Column::Sequence => match read {
                    Some(sequence) if sequence.abs() <= LARGEST_SEQUENCE => row.sequence = sequence,
                    other => {
                        row.sequence = f64::NAN;
                        bad(if other.is_some() { "a number up to 1e15" } else { "a number in every row; or leave the column out, and the rows' order counts" });
                    }
                },
                Column::Group(g) => {
                    row.groups.insert(g.clone(), cell.to_owned());
                }
                Column::Nameless => {}
                Column::Value { output, index, sd: false } => {
                    let measured = number().map(|value| Measured { value, sd: None });
                    if *output { row.outputs[*index] = measured } else { row.inputs[*index] = measured }
                }
                Column::Value { sd: true, .. } | Column::SharedSd(_) => match (number(), kind) {
                    (Some(sd), _) if sd < 0.0 => bad("a standard deviation of 0 or more"),
                    (Some(sd), Column::SharedSd(index)) if sd > largest_shared(SHARED[*index]).0 => bad(largest_shared(SHARED[*index]).1),
                    (sd, Column::SharedSd(index)) => row.shared_sd[*index] = sd,
                    (sd, Column::Value { output, index, .. }) => sds.extend(sd.map(|sd| (*output, *index, sd))),
                    _ => {}
                },
            }
        }
        for (output, index, sd) in sds {
            if let Some(m) = if output { &mut row.outputs[index] } else { &mut row.inputs[index] } {
                m.sd = Some(sd);
            }
        }
        if row.id.is_empty() && !self.numbered {
            faults.push(RowFault::cell(line, "id", "", "a name of its own for every impact"));
        }
        row.id = self.name(line, n, &row.id);
        row
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fails_a_table_that_asks_for_more_memory_than_its_size_says() {
        let header = |grouping: usize| {
            let names: Vec<String> = (0..grouping).map(|k| format!("g{k}")).collect();
            Header::of(&csv::StringRecord::from([vec!["id".to_owned()], names].concat()), Path::new("t.csv")).expect("a header")
        };
        assert_eq!([header(0), header(3), header(1000)].map(|h| h.most_rows()), [1_000_000, 1_000_000, 10_000]);
        // Of so many columns not one row may come.
        let wide = Header { columns: (0..=MOST_GROUPING_CELLS).map(|_| Column::Group(String::new())).collect(), ..header(0) };
        assert_eq!(wide.most_rows(), 0);
    }
}
