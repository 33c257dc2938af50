//! The tables of several sessions as one, by which a model is judged as a whole: every impact keeps where it comes from.

use super::{ImpactRow, ImpactTable};

/// The grouping column by which offsets of sessions are told apart.
const SESSION: &str = "session";

impl ImpactTable {
    /// Named tables one after the other. An `id` becomes `name/id`, the column `session` holds the name (`name/session` where the table has sessions of
    /// its own). Places in time go on from one table to the next; each keeps the gaps between its own. The names must differ.
    pub fn pooled(tables: Vec<(String, ImpactTable)>) -> ImpactTable {
        let mut rows = Vec::with_capacity(tables.iter().map(|(_, table)| table.rows.len()).sum());
        let mut begin = 0.0;
        for (name, table) in tables {
            let first = table.first_sequence();
            let mut last = begin;
            for row in table.rows {
                let sequence = row.sequence - first + begin;
                last = sequence.max(last);
                let mut groups = row.groups;
                let own = groups.get(SESSION).filter(|own| !own.is_empty());
                let session = own.map_or_else(|| name.clone(), |own| format!("{name}/{own}"));
                groups.insert(SESSION.to_owned(), session);
                rows.push(ImpactRow { id: format!("{name}/{}", row.id), sequence, groups, ..row });
            }
            begin = last + 1.0;
        }
        ImpactTable { rows, has_ranks: false }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    #[test]
    fn law_every_impact_keeps_its_values_its_session_and_its_place_in_time() {
        let read = |text: &str| ImpactTable::from_reader(text.as_bytes(), Path::new("t.csv")).expect("a table");
        let monday = read("id,sequence,ball_in_vz,ball_in_vz_sd\na,7,-20,0.1\nb,5,-21,0.1\nc,9,-22,0.1\n");
        let friday = read("id,ball_in_vz,player,session\na,-30,X,morning\nb,-31,Y,\n");
        let pooled = ImpactTable::pooled(vec![("mon".to_owned(), monday.clone()), ("fri".to_owned(), friday.clone())]);
        let told: Vec<(&str, f64, &str)> = pooled.rows.iter().map(|r| (r.id.as_str(), r.sequence, r.groups["session"].as_str())).collect();
        assert_eq!(told, [("mon/a", 2.0, "mon"), ("mon/b", 0.0, "mon"), ("mon/c", 4.0, "mon"), ("fri/a", 5.0, "fri/morning"), ("fri/b", 6.0, "fri")]);
        for (row, own) in pooled.rows.iter().zip(monday.rows.iter().chain(&friday.rows)) {
            assert_eq!((row.inputs, row.outputs), (own.inputs, own.outputs));
        }
        // As a file it is a table like any other; who has no player has an empty one.
        let again = read(&pooled.to_csv());
        assert_eq!((again.rows.len(), again.rows[0].groups["player"].as_str(), again.rows[3].groups["player"].as_str()), (5, "", "X"));
        assert_eq!(again.rows[1].get("ball_in_vz"), pooled.rows[1].get("ball_in_vz"));
    }
}
