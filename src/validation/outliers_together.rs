//! Impacts with outlying numbers that lie together: wrong numbers fall on any impact, what acts on a part of the impacts alone (friction, of which
//! only balls that slide tell) falls on its own. Few as they are they pass for wrong numbers, keep little weight, and no other test sees them.

use super::by_group::{MOST_GROUPS, columns};
use super::comparison::Outlier;
use super::observation::{Observation, Observations};
use super::structure::ContactInputs;
use statrs::distribution::{DiscreteCDF, Hypergeometric};
use std::collections::{BTreeMap, BTreeSet};

/// Fewest impacts with outlying numbers that say anything, and the chance that they lie together as they do (everything looked at counted).
const FEWEST: usize = 5;
const LEVEL: f64 = 1e-4;

/// Says where, if they do.
pub fn outliers_together(outliers: &[Outlier], observations: &Observations) -> Option<String> {
    let ids: BTreeSet<&str> = outliers.iter().map(|o| o.id.as_str()).collect();
    let odd: Vec<bool> = observations.impacts.iter().map(|o| ids.contains(o.id.as_str())).collect();
    let all = odd.iter().filter(|o| **o).count();
    if all < FEWEST {
        return None;
    }
    let mut look = Look { impacts: odd.len(), all, looked_at: 0, least: 1.0, words: String::new() };
    let contacts: Vec<ContactInputs> = observations.impacts.iter().map(|o| ContactInputs::of(&o.inputs, &observations.gear[o.gear])).collect();
    for (of, high, low) in ORDERS {
        let values: Vec<f64> = observations.impacts.iter().zip(&contacts).map(|(o, c)| of(o, c)).collect();
        look.along(&values, &odd, high, low);
    }
    let impacts: Vec<&Observation> = observations.impacts.iter().collect();
    for (column, texts) in columns(observations, &impacts) {
        let numbers: Option<Vec<f64>> = texts.iter().map(|t| (*t)?.trim().parse().ok().filter(|v: &f64| v.is_finite())).collect();
        match numbers {
            Some(numbers) => look.along(&numbers, &odd, &format!("of the highest `{column}`"), &format!("of the lowest `{column}`")),
            None => look.by_group(column, &texts, &odd),
        }
    }
    (look.least * look.looked_at as f64 <= LEVEL)
        .then(|| format!("{}: something acts there that the model lacks, or those impacts are of another kind; wrong numbers would fall on any", look.words))
}

type Quantity = fn(&Observation, &ContactInputs) -> f64;

/// What acts on a part of the impacts may go by, and words for the impacts where it is large and small.
const ORDERS: [(Quantity, &str, &str); 8] = [
    (
        |_, c| c.slip_m_s[0].hypot(c.slip_m_s[1]) / c.approach_m_s.max(1.0),
        "where the ball slides the most for its approach",
        "where the ball slides the least for its approach",
    ),
    (|_, c| c.approach_m_s, "of the fastest approach", "of the slowest approach"),
    (|o, _| o.inputs[3].hypot(o.inputs[4]).hypot(o.inputs[5]), "with the most spin before impact", "with the least spin before impact"),
    (|o, _| o.inputs[12], "nearest to the handle", "nearest to the tip"),
    (|o, _| o.inputs[13], "nearest to marker 3", "nearest to marker 2"),
    (|o, _| o.inputs[12].hypot(o.inputs[13]), "farthest from the middle of the face", "nearest to the middle of the face"),
    (|o, _| o.inputs[14], "of the largest grip torque", "of the smallest grip torque"),
    (|o, _| o.order, "recorded last", "recorded first"),
];

/// The least likely of what was looked at.
struct Look {
    impacts: usize,
    /// Impacts with outlying numbers.
    all: usize,
    looked_at: usize,
    least: f64,
    words: String,
}

impl Look {
    /// Every cut through the impacts in order of a number.
    fn along(&mut self, values: &[f64], odd: &[bool], high: &str, low: &str) {
        let mut sorted: Vec<(f64, bool)> = values.iter().copied().zip(odd.iter().copied()).collect();
        sorted.sort_by(|a, b| a.0.total_cmp(&b.0));
        for end in [low, high] {
            let (mut passed, mut together) = (0, 0);
            // Equal values are not parted.
            for equal in sorted.chunk_by(|a, b| a.0 == b.0) {
                passed += equal.len();
                let more = equal.iter().filter(|v| v.1).count();
                together += more;
                if more > 0 && passed < sorted.len() {
                    self.at(together, passed, || end.to_owned());
                }
            }
            sorted.reverse();
        }
    }

    /// Every group of a column of words that has not too many.
    fn by_group(&mut self, column: &str, texts: &[Option<&str>], odd: &[bool]) {
        let mut groups: BTreeMap<&str, (usize, usize)> = BTreeMap::new();
        for (text, odd) in texts.iter().zip(odd).filter_map(|(text, odd)| Some(((*text)?, *odd))) {
            let (together, among) = groups.entry(text).or_default();
            *together += usize::from(odd);
            *among += 1;
        }
        if (2..=MOST_GROUPS).contains(&groups.len()) {
            groups.into_iter().for_each(|(group, (together, among))| self.at(together, among, || format!("where `{column}` is \"{group}\"")));
        }
    }

    fn at(&mut self, together: usize, among: usize, words: impl FnOnce() -> String) {
        self.looked_at += 1;
        // No more than chance puts there.
        if together * self.impacts <= self.all * among {
            return;
        }
        let p = self.chance(together, among);
        if p < self.least {
            self.least = p;
            self.words = format!("{together} of {} impacts with outlying numbers are among the {among} {}", self.all, words());
        }
    }

    /// That at least `together` of `all` impacts drawn at random lie among so many.
    fn chance(&self, together: usize, among: usize) -> f64 {
        let drawn = Hypergeometric::new(self.impacts as u64, among as u64, self.all as u64);
        drawn.map_or(1.0, |drawn| together.checked_sub(1).map_or(1.0, |fewer| drawn.sf(fewer as u64)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn look(impacts: usize, all: usize) -> Look {
        Look { impacts, all, looked_at: 0, least: 1.0, words: String::new() }
    }

    #[test]
    fn truth_the_chance_of_draws_without_putting_back() {
        // Of 10 impacts 4 are odd: all among 5 of them, C(5,4)/C(10,4); at least none, always.
        let drawn = look(10, 4);
        assert!((drawn.chance(4, 5) - 5.0 / 210.0).abs() < 1e-12);
        assert!((drawn.chance(0, 5) - 1.0).abs() < 1e-12);
        assert!((drawn.chance(2, 3) - (3.0 * 21.0 + 7.0) / 210.0).abs() < 1e-12);
    }

    #[test]
    fn truth_equal_values_are_not_parted_and_either_end_is_looked_at() {
        let odd: Vec<bool> = (0..40).map(|i| i >= 35).collect();
        let mut low_and_high = look(40, 5);
        low_and_high.along(&(0..40).map(f64::from).collect::<Vec<_>>(), &odd, "high", "low");
        assert!(low_and_high.words.ends_with("5 impacts with outlying numbers are among the 5 high"), "{}", low_and_high.words);
        let mut equal = look(40, 5);
        equal.along(&(0..40).map(|i| f64::from(i / 20)).collect::<Vec<_>>(), &odd, "high", "low");
        assert!(equal.words.contains("among the 20 high"), "{}", equal.words);
    }

    /// A column of remarks, no two alike, is no column of groups.
    #[test]
    fn truth_only_few_groups_are_looked_at() {
        let texts: Vec<String> = (0..60).map(|i| format!("remark {i}")).collect();
        let texts: Vec<Option<&str>> = texts.iter().map(|t| Some(t.as_str())).collect();
        let mut remarks = look(60, 5);
        remarks.by_group("remark", &texts, &[true; 60]);
        assert_eq!(remarks.looked_at, 0);
    }
}
