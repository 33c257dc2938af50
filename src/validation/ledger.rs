//! The story of a model: every version with its error on the same held-out impacts (JSON beside the model file).
//!
//! The ledger is a tree: a version knows its parent, so a user can undo (go back to the parent) and branch (add another
//! effect to an earlier version). The error of every version is measured on the same held-out impacts of the same table;
//! a version measured on other data is kept and told apart by its data hash.

use super::comparison::{Adequacy, ParameterValue};
use serde::{Deserialize, Serialize};

/// One version of the model.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct LedgerEntry {
    /// SHA-256 of the model file's text.
    pub model_hash: String,
    /// The file's name, without its folder.
    pub model_file: String,
    /// The version it came from.
    pub parent: Option<String>,
    /// What was done to get here, in words: "first model", "added frame-vibration", "fitted", "changed".
    pub step: String,
    /// Base of the model; empty in a ledger of an earlier version.
    #[serde(default)]
    pub base: String,
    /// SHA-256 of the model file without comments and without what a fit may change, the values of its free parameters.
    #[serde(default)]
    pub form: String,
    pub effects: Vec<String>,
    pub parameters: Vec<ParameterValue>,
    pub heldout_error: f64,
    pub fit_error: f64,
    pub noise_floor: f64,
    pub n_impacts: usize,
    pub n_held_out: usize,
    /// SHA-256 of the impacts table.
    pub data_hash: String,
    /// Day the version was measured (UTC, YYYY-MM-DD); given by the caller, so that results repeat.
    pub date: String,
    pub verdict: Adequacy,
    /// Effects that were tried from here and did not earn their place.
    #[serde(default)]
    pub refused: Vec<Refusal>,
    pub program_version: String,
}

/// An effect that was tried and not added.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Refusal {
    pub effect: String,
    pub reason: String,
    pub heldout_error_before: f64,
    pub heldout_error_after: f64,
}

/// All versions, oldest first.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Ledger {
    pub entries: Vec<LedgerEntry>,
}

impl Ledger {
    /// Adds a version; one with the same model and data replaces its earlier measurement and keeps its place.
    pub fn record(&mut self, entry: LedgerEntry) {
        match self.entries.iter_mut().find(|e| e.model_hash == entry.model_hash && e.data_hash == entry.data_hash) {
            Some(old) => {
                let (parent, step, mut refused) = (old.parent.clone(), old.step.clone(), std::mem::take(&mut old.refused));
                for r in entry.refused.iter().cloned() {
                    refused.retain(|o: &Refusal| o.effect != r.effect);
                    refused.push(r);
                }
                let keep_story = entry.parent.is_none();
                *old = entry;
                old.refused = refused;
                if keep_story {
                    old.parent = parent;
                    old.step = step;
                }
            }
            None => self.entries.push(entry),
        }
    }

    /// Adds what stands in another copy of the ledger alone; of a version in both, the measurement here stays.
    pub fn take_in(&mut self, other: Ledger) {
        let new = other.entries.into_iter().filter(|e| self.find(&e.model_hash, &e.data_hash).is_none()).collect::<Vec<_>>();
        self.entries.extend(new);
    }

    /// The entry of a model file's text on a table.
    pub fn find(&self, model_hash: &str, data_hash: &str) -> Option<&LedgerEntry> {
        self.entries.iter().find(|e| e.model_hash == model_hash && e.data_hash == data_hash)
    }

    /// From the first ancestor to this version: the staircase the report draws.
    pub fn path_to(&self, model_hash: &str, data_hash: &str) -> Vec<&LedgerEntry> {
        let mut path = Vec::new();
        let mut next = self.find(model_hash, data_hash);
        while let Some(entry) = next {
            // A damaged file may hold a circle.
            if path.len() > self.entries.len() {
                break;
            }
            path.push(entry);
            next = entry.parent.as_deref().and_then(|p| self.find(p, data_hash));
        }
        path.reverse();
        path
    }
}

/// The noise floor of a staircase: a version that fails bounds it from above, the lowest of all is nearest to it.
pub fn noise_floor(path: &[&LedgerEntry]) -> f64 {
    path.iter().map(|e| e.noise_floor).reduce(f64::min).unwrap_or(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn entry(hash: &str, parent: Option<&str>, error: f64) -> LedgerEntry {
        LedgerEntry {
            model_hash: hash.into(),
            model_file: format!("{hash}.toml"),
            parent: parent.map(Into::into),
            step: "added something".into(),
            base: "rigid".into(),
            form: String::new(),
            effects: vec![],
            parameters: vec![],
            heldout_error: error,
            fit_error: error,
            noise_floor: 1.0,
            n_impacts: 100,
            n_held_out: 30,
            data_hash: "d".into(),
            date: "2026-11-21".into(),
            verdict: Adequacy::Adequate,
            refused: vec![],
            program_version: "0".into(),
        }
    }

    #[test]
    fn law_the_floor_is_that_of_the_version_that_fails_least() {
        let path = [LedgerEntry { noise_floor: 3.6, ..entry("a", None, 18.0) }, LedgerEntry { noise_floor: 1.05, ..entry("b", Some("a"), 1.1) }];
        assert_eq!(noise_floor(&path.iter().rev().collect::<Vec<_>>()), 1.05);
        assert_eq!(noise_floor(&[]), 1.0);
    }

    #[test]
    fn law_a_branch_keeps_its_own_path() {
        let mut ledger = Ledger::default();
        ledger.record(entry("a", None, 3.0));
        ledger.record(entry("b", Some("a"), 2.0));
        ledger.record(entry("c", Some("a"), 1.5));
        ledger.record(entry("b", None, 2.1));
        let errors: Vec<f64> = ledger.path_to("b", "d").iter().map(|e| e.heldout_error).collect();
        assert_eq!(errors, [3.0, 2.1]);
        assert_eq!(ledger.entries.len(), 3);
        assert_eq!(ledger.path_to("c", "d").len(), 2);
        ledger.entries[0].parent = Some("c".into());
        assert!(ledger.path_to("c", "d").len() <= 4, "a circle must not hang");
    }
}
