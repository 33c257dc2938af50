//! What the results were made from: version, command, hashes of the inputs.

use crate::provenance::{Provenance, VERSION};
use crate::report::page::{Section, Table};

/// Rows of a table that is shown whole.
const SHOWN: usize = 24;

/// Methods in a few sentences and the provenance table. A record may be that of a shot, by its name: what all such records share is
/// listed once.
pub fn provenance(methods: &[&str], records: &[(Option<&str>, &Provenance)]) -> Section {
    let mut section = Section::new("provenance", "Methods and provenance");
    for m in methods {
        section = section.paragraph(m);
    }
    let mut table = Table::new("Same program version and same inputs give the same bytes.").column("step").column("version").column("input").column("SHA-256");
    let mut rows: Vec<[String; 4]> = Vec::new();
    for (shot, r) in records {
        let shared = |input: &str, hash: &String| records.iter().all(|(other, o)| other.is_none() || o.inputs.get(input) == Some(hash));
        let mut inputs: Vec<(String, &str)> =
            r.inputs.iter().map(|(name, hash)| (shot.filter(|_| !shared(name, hash)).map_or(name.clone(), |s| format!("{s}/{name}")), hash.as_str())).collect();
        if inputs.is_empty() {
            inputs.push((String::new(), ""));
        }
        for (name, hash) in inputs {
            let row = [r.command.clone(), r.version.clone(), name, hash.to_owned()];
            if !rows.contains(&row) {
                rows.push(row);
            }
        }
    }
    for row in &rows {
        table = table.row(row);
    }
    if table.is_empty() {
        table = table.row(&["this report", VERSION, "", ""]);
    }
    if rows.len() > SHOWN { section.folded(&format!("{} inputs and their hashes", rows.len()), |s| s.table(table)) } else { section.table(table) }
}
