//! Numbers that stand in columns of the user's own in a table of impacts (string tension, temperature, age of the ball), for expressions:
//! `column.tension`.

use crate::near_names::near_names;
use std::collections::BTreeMap;

/// Most columns of numbers that a table's impacts carry along.
pub const MOST_OWN_COLUMNS: usize = 16;

/// A column's name, for looking it up fast.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct OwnColumn(u64);

impl OwnColumn {
    /// FNV-1a (64 bits, Fowler, Noll and Vo); 0 is no name's.
    pub fn named(name: &str) -> Self {
        let hash = name.bytes().fold(0xcbf2_9ce4_8422_2325, |h: u64, b| (h ^ u64::from(b)).wrapping_mul(0x0100_0000_01b3));
        OwnColumn(hash.max(1))
    }
}

/// The numbers in an impact's own columns.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OwnColumns([(u64, f64); MOST_OWN_COLUMNS]);

impl Default for OwnColumns {
    fn default() -> Self {
        OwnColumns([(0, f64::NAN); MOST_OWN_COLUMNS])
    }
}

impl OwnColumns {
    /// Of a row's other columns those that hold a finite number: the `wanted` ones, then others while there is room.
    pub fn of(columns: &BTreeMap<String, String>, wanted: &[&str]) -> Self {
        let mut own = OwnColumns::default();
        let others = columns.keys().map(String::as_str).filter(|name| !wanted.contains(name));
        let numbers = wanted.iter().copied().chain(others).filter_map(|name| Some((OwnColumn::named(name).0, number(columns, name)?)));
        own.0.iter_mut().zip(numbers).for_each(|(place, number)| *place = number);
        own
    }

    /// NaN where the impact has no such number.
    pub fn get(&self, column: OwnColumn) -> f64 {
        self.0.iter().find(|(name, _)| *name == column.0).map_or(f64::NAN, |(_, value)| *value)
    }
}

fn number(columns: &BTreeMap<String, String>, name: &str) -> Option<f64> {
    columns.get(name)?.trim().parse::<f64>().ok().filter(|v| v.is_finite())
}

/// What a row lacks of the columns that a model's expressions ask for, in words; `None` where it has all.
pub fn lacking(columns: &BTreeMap<String, String>, wanted: &[&str]) -> Option<String> {
    let name = wanted.iter().find(|name| number(columns, name).is_none())?;
    Some(match columns.get(*name) {
        Some(seen) => format!("`{name}` is {seen:?}, and the model needs a number there (`column.{name}`)"),
        None => format!(
            "there is no number in a column `{name}`{}, and the model needs one (`column.{name}`)",
            near_names(name, columns.keys().map(String::as_str))
        ),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_numbers_are_carried_and_what_is_lacking_is_named() {
        let row: BTreeMap<String, String> = [("tension", " 250.5"), ("player", "A"), ("heat", "nan")].map(|(k, v)| (k.to_owned(), v.to_owned())).into();
        let own = OwnColumns::of(&row, &["heat"]);
        assert_eq!(own.get(OwnColumn::named("tension")), 250.5);
        assert!(own.get(OwnColumn::named("heat")).is_nan() && own.get(OwnColumn::named("player")).is_nan());
        assert_eq!(lacking(&row, &["tension"]), None);
        assert!(lacking(&row, &["tension", "player"]).is_some_and(|why| why.contains("`player` is \"A\"")));
        assert!(lacking(&row, &["tensoin"]).is_some_and(|why| why.contains("tension")));
    }
}
