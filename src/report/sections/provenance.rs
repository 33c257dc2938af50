//! What the results were made from: version, command, hashes of the inputs.

use crate::provenance::{Provenance, VERSION};
use crate::report::page::{Section, Table};

/// Methods in a few sentences and the provenance table.
pub fn provenance(methods: &[&str], records: &[&Provenance]) -> Section {
    let mut section = Section::new("provenance", "Methods and provenance");
    for m in methods {
        section = section.paragraph(m);
    }
    let mut table = Table::new("Same program version and same inputs give the same bytes.").column("step").column("version").column("input").column("SHA-256");
    for r in records {
        if r.inputs.is_empty() {
            table = table.row(&[r.command.as_str(), &r.version, "", ""]);
        }
        for (name, hash) in &r.inputs {
            table = table.row(&[r.command.as_str(), &r.version, name, hash]);
        }
    }
    if table.is_empty() {
        table = table.row(&["this report", VERSION, "", ""]);
    }
    section.table(table)
}
