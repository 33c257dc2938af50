//! Impacts with outlying numbers that lie together: wrong numbers fall on any impact, what acts on a part of the impacts alone (friction, of which
//! only balls that slide tell) falls on its own. Few as they are they pass for wrong numbers, keep little weight, and no other test sees them.

use super::comparison::Outlier;
use super::observation::{Observation, Observations};
use super::structure::ContactInputs;
use std::collections::{BTreeMap, BTreeSet};

/// Fewest impacts with outlying numbers that say anything, and the chance that they lie together as they do (everything looked at counted).
const FEWEST: usize = 5;
const LEVEL: f64 = 1e-4;

/// A number by which impacts are put in order: its values, and the words for the impacts at its high and low end.
type Order = (Vec<f64>, String, String);

/// Says where, if they do.
pub fn outliers_together(outliers: &[Outlier], observations: &Observations) -> Option<String> {
    let ids: BTreeSet<&str> = outliers.iter().map(|o| o.id.as_str()).collect();
    let impacts = &observations.impacts;
    let odd: Vec<bool> = impacts.iter().map(|o| ids.contains(o.id.as_str())).collect();
    let all = odd.iter().filter(|o| **o).count();
    if all < FEWEST || all == impacts.len() {
        return None;
    }
    let tail = Tail::of(impacts.len());
    let mut looked_at = 0;
    let mut least = (1.0, String::new());
    let mut look = |together: usize, among: usize, words: &dyn Fn() -> String| {
        looked_at += 1;
        let p = tail.at_least(together, all, among);
        if p < least.0 {
            least = (p, format!("{together} of {all} impacts with outlying numbers are among the {among} {}", words()));
        }
    };
    for (values, high, low) in orders(observations) {
        for (sign, end) in [(-1.0, &high), (1.0, &low)] {
            let mut sorted: Vec<(f64, bool)> = values.iter().zip(&odd).filter(|(v, _)| v.is_finite()).map(|(v, odd)| (sign * v, *odd)).collect();
            sorted.sort_by(|a, b| a.0.total_cmp(&b.0));
            let mut together = 0;
            for (i, (value, is_odd)) in sorted.iter().enumerate() {
                together += usize::from(*is_odd);
                // Equal values are not parted.
                if sorted.get(i + 1).is_some_and(|next| next.0 == *value || !is_odd && !next.1) || together == 0 {
                    continue;
                }
                look(together, i + 1, &|| end.clone());
            }
        }
    }
    for (column, labels) in labels(observations) {
        let distinct: BTreeSet<&str> = labels.iter().copied().collect();
        for label in distinct.into_iter().filter(|_| labels.len() > 1) {
            let inside = labels.iter().zip(&odd).filter(|(l, _)| **l == label);
            look(inside.clone().filter(|(_, odd)| **odd).count(), inside.count(), &|| format!("where `{column}` is \"{label}\""));
        }
    }
    (least.0 * f64::from(looked_at) < LEVEL)
        .then(|| format!("{}: something acts there that the model lacks, or those impacts are of another kind; wrong numbers would fall on any", least.1))
}

/// What acts on a part of the impacts may go by.
fn orders(observations: &Observations) -> Vec<Order> {
    let impacts = &observations.impacts;
    let by = |of: &dyn Fn(&Observation, &ContactInputs) -> f64, high: &str, low: &str| -> Order {
        let values = impacts.iter().map(|o| of(o, &ContactInputs::of(&o.inputs, &observations.gear[o.gear])));
        (values.collect(), high.to_owned(), low.to_owned())
    };
    let slide = |c: &ContactInputs| c.slip_m_s[0].hypot(c.slip_m_s[1]) / c.approach_m_s.max(1.0);
    let mut all = vec![
        by(&|_, c| slide(c), "where the ball slides the most for its approach", "where the ball slides the least for its approach"),
        by(&|_, c| c.approach_m_s, "of the fastest approach", "of the slowest approach"),
        by(&|o, _| o.inputs[3].hypot(o.inputs[4]).hypot(o.inputs[5]), "with the most spin before impact", "with the least spin before impact"),
        by(&|o, _| o.inputs[12], "nearest to the handle", "nearest to the tip"),
        by(&|o, _| o.inputs[13], "nearest to marker 3", "nearest to marker 2"),
        by(&|o, _| o.inputs[12].hypot(o.inputs[13]), "farthest from the middle of the face", "nearest to the middle of the face"),
        by(&|o, _| o.inputs[14], "of the largest grip torque", "of the smallest grip torque"),
        by(&|o, _| o.order, "recorded last", "recorded first"),
    ];
    all.extend(own(observations).into_iter().filter_map(|(column, texts)| {
        let number = |t: &&str| t.trim().parse::<f64>().unwrap_or(f64::NAN);
        let values: Vec<f64> = texts.iter().map(number).collect();
        let words = |end: &str| format!("of the {end} `{column}`");
        values.iter().all(|v| v.is_finite()).then(|| (values, words("highest"), words("lowest")))
    }));
    all.retain(|(values, ..)| values.iter().any(|v| *v != values[0]));
    all
}

/// Columns of words: racket, ball, and those of the user's own that hold no numbers.
fn labels(observations: &Observations) -> Vec<(&str, Vec<&str>)> {
    let gear = &observations.gear;
    let of = |name: &dyn Fn(&Observation) -> usize| observations.impacts.iter().map(name).collect::<Vec<_>>();
    let place = of(&|o| o.gear);
    let mut all = vec![
        ("racket", place.iter().map(|g| gear[*g].racket.name.as_str()).collect::<Vec<_>>()),
        ("ball", place.iter().map(|g| gear[*g].ball.name.as_str()).collect()),
    ];
    all.extend(own(observations).into_iter().filter(|(_, texts)| texts.iter().any(|t| t.trim().parse::<f64>().is_err())));
    all.retain(|(_, texts)| texts.iter().any(|t| *t != texts[0]));
    all
}

/// Columns of the user's own, impact by impact; empty where a row has none.
fn own(observations: &Observations) -> BTreeMap<&str, Vec<&str>> {
    let keys: BTreeSet<&str> = observations.impacts.iter().flat_map(|o| o.groups.keys()).map(String::as_str).collect();
    keys.into_iter().map(|key| (key, observations.impacts.iter().map(|o| o.groups.get(key).map_or("", String::as_str)).collect())).collect()
}

/// Logarithms of the factorials up to the number of impacts.
struct Tail(Vec<f64>);

impl Tail {
    fn of(impacts: usize) -> Self {
        let mut sum = 0.0;
        Tail(
            (0..=impacts)
                .map(|k| {
                    sum += (k.max(1) as f64).ln();
                    sum
                })
                .collect(),
        )
    }

    /// P(at least `together` of `odd` impacts drawn at random lie among `among` of all): the upper tail of the hypergeometric distribution.
    fn at_least(&self, together: usize, odd: usize, among: usize) -> f64 {
        let all = self.0.len() - 1;
        let choose = |n: usize, k: usize| self.0[n] - self.0[k] - self.0[n - k];
        (together..=odd.min(among)).filter(|k| odd - k <= all - among).map(|k| (choose(among, k) + choose(all - among, odd - k) - choose(all, odd)).exp()).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn truth_the_tail_of_draws_without_putting_back() {
        // Of 10 impacts 4 are odd: all among 5 of them, C(5,4)/C(10,4); at least none, always.
        let tail = Tail::of(10);
        assert!((tail.at_least(4, 4, 5) - 5.0 / 210.0).abs() < 1e-12);
        assert!((tail.at_least(0, 4, 5) - 1.0).abs() < 1e-12);
        assert!((tail.at_least(2, 4, 3) - (3.0 * 21.0 + 7.0) / 210.0).abs() < 1e-12);
    }
}
