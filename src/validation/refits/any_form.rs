//! What tells the strongest single effect from another in whatever form nature has it: no card has quite nature's.

use super::{ALIAS_SHARE, LARGEST_NOISE_SCALE, PRECEDENCE, Refits, excess_at, share_removed};
use crate::validation::holdout::HELD_OUT_SHARE;
use crate::validation::rank::{Reference, Refit};
use rayon::prelude::*;

impl Refits<'_> {
    /// The single effect that all impacts together speak for most, by its card's form; the earlier one of two equal ones.
    pub(super) fn strongest(&self) -> Option<usize> {
        let evidence: Vec<f64> = (0..self.singles.len()).map(|i| self.evidence_as_stated(i)).collect();
        (0..evidence.len()).max_by(|&i, &j| evidence[i].total_cmp(&evidence[j]).then(j.cmp(&i)))
    }

    /// What the single effect `at` explains beyond any form of each of the others, as chi-square of all impacts.
    pub(super) fn beyond_any_form(&self, at: usize, reference: &Reference) -> Vec<f64> {
        let name = self.singles[at].effects[0].as_str();
        let c = self.c.min(LARGEST_NOISE_SCALE);
        let share = |r: &Refit| share_removed(excess_at(&self.base, c), excess_at(&r.structure, c));
        let beyond = |(i, other): (usize, &Refit)| {
            // Any smooth form makes one effect of the restitution another: its own must already come near.
            if i == at || other.log_evidence <= 0.0 || self.is_chance(other) || share(other) < ALIAS_SHARE * share(&self.singles[at]) {
                return f64::INFINITY;
            }
            let screened = reference.screen_second(other, Some(&[name])).ok();
            // The fit saw only a part of the impacts.
            screened.and_then(|s| s.effects.first().map(|e| e.gain / (1.0 - HELD_OUT_SHARE))).unwrap_or(f64::INFINITY)
        };
        self.singles.par_iter().enumerate().map(beyond).collect()
    }

    /// Log evidence of all impacts for a single effect in its card's form.
    fn evidence_as_stated(&self, at: usize) -> f64 {
        self.believed(&self.singles[at]) + self.told_by_held_out(&self.singles[at])
    }

    /// Log evidence of all impacts for a single effect. No card has quite nature's form: in the best one within what is allowed of any, an
    /// effect fits as well as the strongest does, less what that one explains beyond it, and only that much tells the two apart. That
    /// the strongest needs no other form than its card's counts for it, unless these impacts hold an effect that the catalogue lists before.
    pub(super) fn evidence_in_any_form(&self, at: usize) -> f64 {
        let stated = self.evidence_as_stated(at);
        match &self.leader {
            Some((leader, beyond)) if *leader != at => {
                let price = if self.twins.get(*leader).is_some_and(|t| t.contains(&at)) { 0.0 } else { PRECEDENCE };
                in_any_form(stated, self.evidence_as_stated(*leader), beyond[at], price)
            }
            _ => stated,
        }
    }
}

/// Log evidence of an effect that has `stated` in its card's form, beside the strongest one's, which explains a chi-square of `beyond` more than any
/// form of it; another form than the card's costs `price`.
fn in_any_form(stated: f64, strongest: f64, beyond: f64, price: f64) -> f64 {
    stated.max(strongest - 0.5 * beyond - price)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn law_only_what_the_strongest_explains_beyond_any_form_tells_an_effect_from_it() {
        // Another power of the speed: the card's form is behind by 20, any form by nothing.
        assert_eq!(in_any_form(100.0, 120.0, 0.0, PRECEDENCE), 120.0 - PRECEDENCE);
        assert_eq!(in_any_form(100.0, 120.0, 0.0, 0.0), 120.0);
        // Another mechanism: no form of it does what the strongest does.
        assert_eq!(in_any_form(100.0, 120.0, 60.0, PRECEDENCE), 100.0);
        assert_eq!(in_any_form(100.0, 120.0, f64::INFINITY, 0.0), 100.0);
        // Its own form may be the better one.
        assert_eq!(in_any_form(119.5, 120.0, 4.0, PRECEDENCE), 119.5);
    }
}
