//! What a table's numbers make one wonder about: units other than SI, the same impact twice.

use super::{INPUTS, ImpactRow, ImpactTable, LONGEST_STEP, Measured, OUTPUTS, unit};
use crate::short_list::short_list;
use std::collections::BTreeMap;
use std::hash::{DefaultHasher, Hash, Hasher};

/// Half of a column's values above this are another unit's: m/s of ball and racket (the fastest strokes and serves of many games stay below), rad/s of
/// a ball (10 000 revolutions a minute) and of a racket.
const FAST_M_S: f64 = 80.0;
const FAST_BALL_RAD_S: f64 = 1000.0;
/// Beyond this they are no revolutions a minute either.
const FAST_BALL_RPM: f64 = 5000.0;
const FAST_RACKET_RAD_S: f64 = 150.0;
const DEGREES: &str = "degrees a second, divide them by 57.30";
/// Fewer values are no habit.
const FEWEST: usize = 3;
/// Pairs that a remark names.
const NAMED: usize = 5;

/// Remarks on a table, in words; none on a sound one.
pub fn remarks(table: &ImpactTable) -> Vec<String> {
    INPUTS
        .iter()
        .chain(&OUTPUTS)
        .filter_map(|column| another_unit(table, column))
        .chain(through_the_strings(table))
        .chain(repeated(table))
        .chain(ranks(table))
        .collect()
}

/// Where a time stands for the order, an effect that grows from impact to impact would take each second for one.
fn ranks(table: &ImpactTable) -> Option<String> {
    table.has_ranks.then(|| {
        format!("`sequence` does not count impacts (fractions, or steps of more than {LONGEST_STEP} in the mean): it is taken for the order of the rows alone")
    })
}

/// A ball that leaves on the other side of the strings than it came from, as the racket goes; a few may, where it has hardly struck them.
fn through_the_strings(table: &ImpactTable) -> Option<String> {
    let beside_racket = |row: &ImpactRow, column: &str| Some(row.get(column)?.value - row.get("racket_in_vz").map_or(0.0, |m| m.value));
    let ways: Vec<(f64, f64)> = table.rows.iter().filter_map(|row| Some((beside_racket(row, "ball_in_vz")?, beside_racket(row, "ball_out_vz")?))).collect();
    let through = ways.iter().filter(|(before, after)| before * after > 0.0).count();
    (ways.len() >= FEWEST && 2 * through > ways.len()).then(|| {
        format!(
            "`ball_out_vz`: in {through} of {} impacts the ball goes on through the strings; the axes are the same before and after the impact: is a sign turned?",
            ways.len()
        )
    })
}

fn another_unit(table: &ImpactTable, column: &str) -> Option<String> {
    let (fast, meant) = match unit(column) {
        "m/s" => (FAST_M_S, "km/h, divide them by 3.6"),
        "rad/s" if column.starts_with("ball") => (FAST_BALL_RAD_S, "revolutions a minute, divide them by 9.549"),
        "rad/s" => (FAST_RACKET_RAD_S, DEGREES),
        _ => return None,
    };
    let mut sizes: Vec<f64> = table.rows.iter().filter_map(|row| Some(row.get(column)?.value.abs())).collect();
    if sizes.len() < FEWEST {
        return None;
    }
    let at = sizes.len() / 2;
    let median = *sizes.select_nth_unstable_by(at, f64::total_cmp).1;
    let unit = unit(column);
    let meant = if column.starts_with("ball") && median > FAST_BALL_RPM { DEGREES } else { meant };
    (median > fast).then(|| format!("`{column}`: half of the values are beyond {fast} {unit} (the median is {median:.0}); if they are in {meant}"))
}

/// Impacts that are another one number for number: measured twice they would differ.
fn repeated(table: &ImpactTable) -> Option<String> {
    let mut first: BTreeMap<u64, &ImpactRow> = BTreeMap::new();
    let mut pairs = Vec::new();
    for row in table.rows.iter().filter(|row| row.outputs.iter().any(Option::is_some)) {
        let mut hash = DefaultHasher::new();
        numbers(row).for_each(|n| n.map(f64::to_bits).hash(&mut hash));
        match first.entry(hash.finish()) {
            std::collections::btree_map::Entry::Vacant(place) => {
                place.insert(row);
            }
            std::collections::btree_map::Entry::Occupied(earlier) if numbers(row).eq(numbers(earlier.get())) => pairs.push((&row.id, &earlier.get().id)),
            std::collections::btree_map::Entry::Occupied(_) => {}
        }
    }
    let named: Vec<String> = pairs.iter().map(|(row, earlier)| format!("{row} that of {earlier}")).collect();
    (!named.is_empty()).then(|| {
        format!(
            "{} impacts hold the very numbers of another ({}): one impact that stands twice counts double; leave the copies out",
            named.len(),
            short_list(&named, NAMED, ", ")
        )
    })
}

fn numbers(row: &ImpactRow) -> impl Iterator<Item = Option<f64>> {
    row.inputs.iter().chain(&row.outputs).map(|measured: &Option<Measured>| measured.map(|m| m.value))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    fn told(text: &str) -> Vec<String> {
        remarks(&ImpactTable::from_reader(text.as_bytes(), Path::new("t.csv")).expect("a table"))
    }

    #[test]
    fn truth_units_other_than_si_and_copies_are_remarked() {
        let sound = "id,ball_in_vz,ball_in_wx,racket_in_wy,ball_out_vz\na,-30,300,20,31\nb,-38,-250,30,28\nc,-90,1200,40,35\n";
        assert_eq!(told(sound), Vec::<String>::new());
        let (km_h, rpm, degrees) = (
            told("id,ball_in_vz\na,-108\nb,-137\nc,-70\n"),
            told("id,ball_in_wy\na,1500\nb,-2500\nc,300\n"),
            told("id,racket_out_wy\na,1500\nb,-1700\nc,300\n"),
        );
        assert!(km_h.len() == 1 && km_h[0].contains("`ball_in_vz`") && km_h[0].contains("km/h"), "{km_h:?}");
        assert!(rpm.len() == 1 && rpm[0].contains("revolutions a minute"), "{rpm:?}");
        let degrees_of_ball = told("id,ball_in_wy\na,15000\nb,-25000\nc,3000\n");
        assert!(degrees_of_ball.len() == 1 && degrees_of_ball[0].contains("degrees a second"), "{degrees_of_ball:?}");
        assert!(degrees.len() == 1 && degrees[0].contains("degrees a second"), "{degrees:?}");
        // The ball of a moving racket may go on as it came, and most balls come back from the strings.
        assert_eq!(told("id,ball_in_vz,racket_in_vz,ball_out_vz\na,-10,12,26\nb,3,14,27\nc,-9,0,-1\n"), Vec::<String>::new());
        let through = told("id,ball_in_vz,ball_out_vz\na,-30,-19\nb,31,18\nc,-28,17\n");
        assert!(through.len() == 1 && through[0].contains("2 of 3 impacts"), "{through:?}");
        let timed = told("id,sequence,ball_in_vz\na,1764500000,-30\nb,1764500060,-31\n");
        assert!(timed.len() == 1 && timed[0].contains("the order of the rows alone"), "{timed:?}");
        // Inputs alone may be chosen alike.
        assert_eq!(told("id,ball_in_vz\na,-30\nb,-30\n"), Vec::<String>::new());
        let copies = told("id,ball_in_vz,ball_out_vz,player\na,-30,20,A\nb,-31,21,A\nc,-30,20,B\nd,-30,,B\n");
        assert!(copies.len() == 1 && copies[0].starts_with("1 impacts") && copies[0].contains("c that of a"), "{copies:?}");
    }
}
