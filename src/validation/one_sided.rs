//! Outlying numbers that all lie on one side: wrong numbers fall on either, impacts of another kind (dead balls, a frame hit,
//! another racket) do not.

use super::comparison::Outlier;
use super::observation::Observations;
use crate::impact_table::column_subject;
use std::collections::BTreeMap;

/// Fewest outliers of an output that say anything, their share of the impacts, and the chance that as many of them lie on one side
/// (all outputs counted).
const FEWEST: usize = 10;
const SHARE: f64 = 0.03;
const LEVEL: f64 = 1e-4;

/// Says so, of the output whose outliers lie on one side the most.
pub fn one_sided(outliers: &[Outlier], observations: &Observations) -> Option<String> {
    let mut by_column: BTreeMap<&str, (usize, usize)> = BTreeMap::new();
    for o in outliers.iter().filter(|o| o.column.contains("_out_")) {
        let (below, all) = by_column.entry(&o.column).or_default();
        *below += usize::from(o.standardised < 0.0);
        *all += 1;
    }
    let fewest = FEWEST.max((SHARE * observations.impacts.len() as f64).ceil() as usize);
    let chance = |(below, all): (usize, usize)| 2.0 * at_least(below.max(all - below), all) * by_column.len() as f64;
    let (column, (below, all)) = by_column
        .iter()
        .filter(|(_, (_, all))| *all >= fewest)
        .map(|(column, counts)| (*column, *counts))
        .min_by(|a, b| chance(a.1).total_cmp(&chance(b.1)))
        .filter(|(_, counts)| chance(*counts) < LEVEL)?;
    Some(format!(
        "{} of {all} outlying numbers of {} (`{column}`) are too {}: those impacts are of another kind (a dead ball, the frame, another racket), not wrongly measured; give them a column of their own, or leave them out",
        below.max(all - below),
        column_subject(column),
        if 2 * below > all { "small" } else { "large" }
    ))
}

/// P(at least `k` of `n` fair coins). By logarithms: 0.5^n is no double from 1075 coins on.
fn at_least(k: usize, n: usize) -> f64 {
    let mut term = n as f64 * 0.5f64.ln();
    let mut sum = 0.0;
    for i in 0..=n {
        if i >= k {
            sum += term.exp();
        }
        term += ((n - i) as f64 / (i + 1) as f64).ln();
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn truth_the_tail_of_fair_coins() {
        assert!((at_least(10, 10) - 1.0 / 1024.0).abs() < 1e-15);
        assert!((at_least(8, 10) - 56.0 / 1024.0).abs() < 1e-15);
        assert!((at_least(0, 30) - 1.0).abs() < 1e-12);
        // Half of many: a half, and half of the chance of just as many, sqrt(2 / (pi n)).
        let half = 0.5 + 0.5 * (2.0 / (std::f64::consts::PI * 3000.0)).sqrt();
        assert!((at_least(1500, 3000) - half).abs() < 1e-5);
    }
}
