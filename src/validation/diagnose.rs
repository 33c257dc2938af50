//! The procedure: is anything missing, what, and how sure is that?

use super::comparison::{note_noise, outliers, parameter_values, session_offsets, summarise};
use super::diagnosis::{CandidateReport, Diagnosis, Estimate, NotVisible, Verdict};
use super::error::ValidationError;
use super::expression::local_spot;
use super::fit::{Fit, FitOptions, fit};
use super::forward::Library;
use super::heldout::{error_of, linearise_held_out};
use super::judgement::Judgement;
use super::linearise::Linearised;
use super::observation::{Observation, Observations};
use super::present::Present;
use super::project::Nuisance;
use super::rank::{Reference, flexible_nuisance};
use super::refits::{PRIOR, Refits};
use super::screen::{Screening, screen_beyond};
use super::structure::{StructureTest, structure_test};
use super::verdict_words::verdict_words;
use std::collections::BTreeMap;

/// Corrected level of the library test.
pub const LIBRARY_LEVEL: f64 = 0.01;
/// Level of the structure test.
pub const STRUCTURE_LEVEL: f64 = 0.003;
/// Corrected level of the test for one place on the face.
pub const SPOT_LEVEL: f64 = 0.002;
/// The three together: how often nothing-missing is called missing, at most.
pub const FALSE_ALARM_RATE: f64 = LIBRARY_LEVEL + STRUCTURE_LEVEL + SPOT_LEVEL;
/// When nothing is missing, all candidates together are no more likely than that.
const ALL_CANDIDATES: f64 = 0.5;

#[derive(Debug, Clone)]
pub struct DiagnoseOptions {
    pub seed: u64,
    pub model: String,
    /// Looks for an expression when the catalogue does not do.
    pub expressions: bool,
}

impl Default for DiagnoseOptions {
    fn default() -> Self {
        DiagnoseOptions { seed: 20_080_101, model: String::new(), expressions: true }
    }
}

/// Diagnoses the current model of a library on a table.
///
/// # Errors
/// [`ValidationError`] when a model has no answer for an impact.
pub fn diagnose(library: &dyn Library, observations: &Observations, options: &DiagnoseOptions) -> Result<Diagnosis, ValidationError> {
    let case = Case::new(library, observations, options)?;
    let mut diagnosis = case.report(options);
    if !case.alarm() {
        diagnosis.candidates = listed_only(library, &case.screening, case.error);
        less_likely_than_nothing(&mut diagnosis.candidates);
        note_noise(diagnosis.noise_floor, true, &mut diagnosis.notes);
        diagnosis.words = verdict_words(&diagnosis);
        return Ok(diagnosis);
    }
    let mut reference = case.reference(case.structure.noise_scale);
    let refits = Refits::new(&mut reference, &case.screening, &case.structure, &case.held_out)?;
    let mut judgement = Judgement::new(&case, reference, &refits)?;
    judgement.look_for_formula(options.expressions)?;
    judgement.leave_to_chance();
    judgement.ask_held_out();
    judgement.allow_shared_errors();
    judgement.set_formula_against_name()?;
    judgement.report(diagnosis, options.expressions)
}

/// The current model at its best, and the three tests of it.
pub(super) struct Case<'a> {
    pub library: &'a dyn Library,
    pub observations: &'a Observations,
    pub seen: Vec<&'a Observation>,
    pub held: Vec<&'a Observation>,
    pub base: Fit,
    pub structure: StructureTest,
    pub screening: Screening,
    pub spot_p_value: f64,
    /// Catalogue effects in the model already.
    pub present: Present,
    /// The impacts that no fit sees, at the base fit, and their error.
    pub held_out: Vec<Linearised>,
    pub error: f64,
    pub seed: u64,
}

impl<'a> Case<'a> {
    fn new(library: &'a dyn Library, observations: &'a Observations, options: &DiagnoseOptions) -> Result<Self, ValidationError> {
        let (seen, held) = (observations.side(false), observations.side(true));
        let base = fit(library.current(), observations, &seen, &FitOptions::default(), None)?;
        let structure = structure_test(&base, observations, &seen, options.seed);
        // Effects that are in the model already may have another form than the catalogue's; what that leaves is no new effect.
        let present = Present::of(library);
        let c_screen = structure.noise_scale_for_screening();
        let nuisance =
            if present.is_empty() { Nuisance::of(&base) } else { flexible_nuisance(library.current(), &base, observations, &seen, &present.strengths)? };
        let screening = screen_beyond(library, &base, &seen, c_screen, &nuisance, None)?;
        let spot = local_spot(&Reference { library, observations, impacts: &seen, base: &base, c: c_screen, seed: options.seed }, &nuisance);
        let held_out = linearise_held_out(library.current(), &base, observations, &held)?;
        let (error, spot_p_value) = (error_of(&held_out), spot.map_or(1.0, |s| s.p_value));
        Ok(Case { library, observations, seen, held, base, structure, screening, spot_p_value, present, held_out, error, seed: options.seed })
    }

    pub fn one_place(&self) -> bool {
        self.spot_p_value < SPOT_LEVEL
    }

    /// Whether generic corrections find structure.
    pub fn smooth(&self) -> bool {
        self.structure.p_value < STRUCTURE_LEVEL
    }

    /// Whether an effect of the catalogue finds itself.
    pub fn in_library(&self) -> bool {
        self.screening.library_p_value < LIBRARY_LEVEL
    }

    fn alarm(&self) -> bool {
        self.in_library() || self.smooth() || self.one_place()
    }

    fn reference(&self, c: f64) -> Reference<'_> {
        Reference { library: self.library, observations: self.observations, impacts: &self.seen, base: &self.base, c, seed: self.seed }
    }

    /// What is known before any effect is tried: an adequate model.
    fn report(&self, options: &DiagnoseOptions) -> Diagnosis {
        let c = self.structure.noise_scale;
        Diagnosis {
            verdict: Verdict::Adequate,
            outputs: summarise(&self.base.impacts, &self.held_out),
            places: Vec::new(),
            candidates: Vec::new(),
            suggested_expression: None,
            next_experiments: Vec::new(),
            noise_floor: c.sqrt(),
            recommended: Vec::new(),
            together: None,
            other_form: None,
            heldout_error: self.error,
            n_impacts: self.observations.impacts.len(),
            n_held_out: self.held.len(),
            structure_after: None,
            library_p_value: self.screening.library_p_value,
            n_tested: self.screening.tested,
            spot_p_value: self.spot_p_value,
            false_alarm_rate: FALSE_ALARM_RATE,
            not_visible: not_visible(self.library, &self.screening),
            parameters: parameter_values(self.library.current(), &self.base, c),
            outliers: outliers(&self.seen, &self.base.impacts, &self.held, &self.held_out),
            session_offsets: session_offsets(self.observations, &self.base, c),
            words: Vec::new(),
            notes: self.observations.notes.clone(),
            model: options.model.clone(),
            seed: options.seed,
            provenance: None,
            structure: self.structure.clone(),
        }
    }
}

/// An adequate model is the likeliest: its candidates share what probability that leaves.
pub(super) fn less_likely_than_nothing(candidates: &mut [CandidateReport]) {
    let sum: f64 = candidates.iter().map(|c| c.probability).sum();
    if sum > ALL_CANDIDATES {
        candidates.iter_mut().for_each(|c| c.probability *= ALL_CANDIDATES / sum);
    }
}

fn not_visible(library: &dyn Library, screening: &Screening) -> Vec<NotVisible> {
    let unseen =
        screening.effects.iter().filter_map(|s| s.hidden_because.clone().map(|reason| NotVisible { effect: library.effects()[s.effect].name.clone(), reason }));
    let excluded = library.effects().iter().filter_map(|o| o.excluded.clone().map(|reason| NotVisible { effect: o.name.clone(), reason }));
    unseen.chain(excluded).collect()
}

/// Candidates of an adequate model: listed by score, with what little probability they have.
fn listed_only(library: &dyn Library, screening: &Screening, before: f64) -> Vec<CandidateReport> {
    let tested = screening.tested.max(1) as f64;
    let mut list: Vec<CandidateReport> = screening
        .effects
        .iter()
        .filter(|s| s.hidden_because.is_none())
        .map(|s| {
            let outline = &library.effects()[s.effect];
            // Score-based evidence: half the gain less the Occam factor of a strength of typical size.
            let occam: f64 = (1.0 + s.typical_signal.powi(2)).ln() * 0.5 * s.terms.len() as f64;
            let log_evidence = 0.5 * s.gain - occam;
            let odds = log_evidence.min(50.0).exp() * PRIOR[1] / tested / PRIOR[0];
            CandidateReport {
                effect: outline.name.clone(),
                probability: odds / (1.0 + odds),
                heldout_error_before: before,
                heldout_error_after: before,
                parameters: outline
                    .strengths
                    .iter()
                    .zip(&s.strengths)
                    .map(|(t, by)| (t.parameter.clone(), Estimate { value: t.absent + by, sd: t.typical / s.typical_signal.max(1e-9) }))
                    .collect(),
                aliases: Vec::new(),
                kind: outline.kind.to_owned(),
                log_evidence_gain: log_evidence,
                chi2_gain: s.gain,
                p_value: (s.p_value * tested).min(1.0),
                share_removed: 0.0,
                alias_cosines: BTreeMap::new(),
                refitted: false,
            }
        })
        .collect();
    list.sort_by(|a, b| b.probability.total_cmp(&a.probability).then(a.effect.cmp(&b.effect)));
    list
}

/// The fit of the current model, for commands that write it out.
pub fn fit_current(library: &dyn Library, observations: &Observations) -> Result<Fit, ValidationError> {
    fit(library.current(), observations, &observations.side(false), &FitOptions::default(), None)
}
