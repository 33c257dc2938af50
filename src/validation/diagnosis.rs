//! What a diagnosis says (diagnosis.json, contract section 9; more keys than the contract's stand after them).

use super::comparison::{LeftOut, Outlier, OutputSummary, ParameterValue, SessionOffset};
use super::structure::STRUCTURE_LEVEL;
use super::structure::StructureTest;
use crate::provenance::Provenance;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// The answer in one word.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// No structure beyond the noise.
    Adequate,
    /// One or two catalogue effects take away at least three quarters of the excess, or leave no structure and are likelier
    /// than nothing.
    EffectMissing,
    /// The model fails and no catalogue effect does that, or none that the held-out impacts, and a formula, would bear out.
    Unexplained,
}

impl std::fmt::Display for Verdict {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Verdict::Adequate => "adequate",
            Verdict::EffectMissing => "effect-missing",
            Verdict::Unexplained => "unexplained",
        })
    }
}

/// Where the model fails: a range of one input over which one output is off.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Place {
    pub output: String,
    pub input: String,
    pub from: f64,
    pub to: f64,
    /// Measured less predicted; mean of the impacts there that were not held out, weighted by their noise.
    pub mean_residual: f64,
    /// 95 % interval of the mean.
    pub ci_low: f64,
    pub ci_high: f64,
    /// Mean residual outside the range.
    pub mean_elsewhere: f64,
    pub n: usize,
    /// Of the range against the rest, for the number of ranges looked at.
    pub p_value: f64,
    pub words: String,
}

/// A fitted parameter of a candidate.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Estimate {
    pub value: f64,
    pub sd: f64,
}

/// A catalogue effect that could be what is missing.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct CandidateReport {
    pub effect: String,
    /// Posterior probability that the effect is there, over the models refitted.
    pub probability: f64,
    pub heldout_error_before: f64,
    /// With this effect alone added.
    pub heldout_error_after: f64,
    pub parameters: BTreeMap<String, Estimate>,
    pub aliases: Vec<String>,
    /// "physics" or "measurement".
    pub kind: String,
    /// Gain of the log evidence over the model without it.
    pub log_evidence_gain: f64,
    /// Fall in chi-square, at the noise found.
    pub chi2_gain: f64,
    /// For the whole catalogue looked at.
    pub p_value: f64,
    /// Share of the excess over the noise floor that it takes away, on the impacts of the fit.
    pub share_removed: f64,
    /// Cosine of its signature with each alias's, nuisance projected out.
    pub alias_cosines: BTreeMap<String, f64>,
    /// Whether the non-linear model was refitted, or only its signature scored.
    pub refitted: bool,
}

/// Effects that must stand together.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Together {
    pub effects: Vec<String>,
    pub probability: f64,
    pub heldout_error_before: f64,
    pub heldout_error_after: f64,
    pub log_evidence_gain: f64,
    pub share_removed: f64,
    pub parameters: BTreeMap<String, Estimate>,
}

/// An effect that these impacts cannot show.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct NotVisible {
    pub effect: String,
    pub reason: String,
}

/// A formula found from the residuals, ready for the model file.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct SuggestedExpression {
    pub replaces: String,
    pub expression: String,
    pub heldout_error_after: f64,
    pub nearest: Vec<String>,
    pub parameters: BTreeMap<String, Estimate>,
    pub share_removed: f64,
    pub log_evidence_gain: f64,
    pub words: String,
    /// Text to paste into the model file.
    pub model_file_text: String,
}

/// Impacts that would tell two effects apart.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct NextExperiment {
    pub separates: [String; 2],
    /// Inputs by column name, one map per impact to set up.
    pub impacts: Vec<BTreeMap<String, f64>>,
    pub why: String,
    /// Repeats of the whole set after which the odds reach twenty to one.
    pub repeats: usize,
    /// Expected log evidence of one repeat.
    pub expected_log_evidence: f64,
}

/// What a test says that was not made.
fn certain() -> f64 {
    1.0
}

/// diagnosis.json.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Diagnosis {
    pub verdict: Verdict,
    pub outputs: Vec<OutputSummary>,
    #[serde(rename = "where")]
    pub places: Vec<Place>,
    pub candidates: Vec<CandidateReport>,
    pub suggested_expression: Option<SuggestedExpression>,
    pub next_experiments: Vec<NextExperiment>,
    pub noise_floor: f64,
    /// The effects that `--auto` would add now, in order.
    pub recommended: Vec<String>,
    pub together: Option<Together>,
    /// "this effect, with another form": the name, when the catalogue's formula leaves structure behind.
    pub other_form: Option<String>,
    pub heldout_error: f64,
    pub n_impacts: usize,
    pub n_held_out: usize,
    pub structure: StructureTest,
    /// Structure test with the recommended effects in the model.
    pub structure_after: Option<StructureTest>,
    /// Smallest p-value of the catalogue times the number of effects tested.
    pub library_p_value: f64,
    pub n_tested: usize,
    /// Of the place on the face whose rebound stands out most, for all places looked at.
    #[serde(default = "certain")]
    pub spot_p_value: f64,
    /// How often nothing-missing is called missing, by design.
    pub false_alarm_rate: f64,
    pub not_visible: Vec<NotVisible>,
    pub parameters: Vec<ParameterValue>,
    pub outliers: Vec<Outlier>,
    pub session_offsets: Vec<SessionOffset>,
    /// The answer in sentences.
    pub words: Vec<String>,
    #[serde(default)]
    pub left_out: Vec<LeftOut>,
    pub notes: Vec<String>,
    pub model: String,
    pub seed: u64,
    pub provenance: Option<Provenance>,
}

impl Diagnosis {
    /// The error on held-out impacts with what is recommended, and how probable that is.
    pub fn with_recommended(&self) -> Option<(f64, f64)> {
        let together = self.together.as_ref().filter(|t| t.effects == self.recommended).map(|t| (t.heldout_error_after, t.probability));
        let first = || self.candidates.iter().find(|c| self.recommended.first() == Some(&c.effect)).map(|c| (c.heldout_error_after, c.probability));
        together.or_else(first)
    }

    /// Whether the model is called adequate although structure is left in its residuals: too little to show in the error of held-out
    /// impacts.
    pub fn keeps_structure(&self) -> bool {
        self.verdict == Verdict::Adequate && self.structure.p_value < STRUCTURE_LEVEL
    }
}
