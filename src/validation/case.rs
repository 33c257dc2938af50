//! The current model on a table, before any effect is tried: its best fit, the tests of it, and the held-out impacts.

use super::beside_the_tests::{beside_the_tests, mean_words};
use super::by_group::GROUP_LEVEL;
use super::comparison::{NO_OFFSET, is_more_than_noise, missed_groups, note_groups, outliers, parameter_values, session_offsets, stopped_words, summarise};
use super::diagnosis::{CandidateReport, Diagnosis, NotVisible, Verdict};
use super::error::ValidationError;
use super::expression::local_spot;
use super::fit::{Fit, FitOptions, fit};
use super::forward::{Library, Strength};
use super::heldout::{error_of, linearise_held_out};
use super::linearise::Linearised;
use super::local_spot::SPOT_LEVEL;
use super::lone_term::TERM_LEVEL;
use super::observation::{Observation, Observations};
use super::one_sided::one_sided;
use super::outliers_together::outliers_together;
use super::present::Present;
use super::rank::{Reference, flexible_nuisance};
use super::screen::{LIBRARY_LEVEL, Screening, screen_beyond};
use super::strength_by_group::unlike_strengths;
use super::structure::{BesideSmooth, STRUCTURE_LEVEL, StructureTest, p_text, structure_test};
use super::terminal::short;

/// The tests together (that of the groups only where there are any): how often nothing-missing is called missing, at most.
const FALSE_ALARM_RATE: f64 = LIBRARY_LEVEL + STRUCTURE_LEVEL + SPOT_LEVEL + TERM_LEVEL;

/// Deviation of a strength over its typical size, below which a strength of none is told from one too small to see.
const SURELY_NONE: f64 = 0.25;

/// When nothing is missing, all candidates together are no more likely than that.
const ALL_CANDIDATES: f64 = 0.5;

/// The current model at its best, and the tests of it.
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
    pub fn new(library: &'a dyn Library, observations: &'a Observations, seed: u64) -> Result<Self, ValidationError> {
        let (seen, held) = (observations.side(false), observations.side(true));
        let base = fit(library.current(), observations, &seen, &FitOptions::default(), None)?;
        let structure = structure_test(&base, observations, &seen, BesideSmooth::All, seed);
        // Effects that are in the model already may have another form than the catalogue's; what that leaves is no new effect.
        let present = Present::of(library);
        let c_screen = structure.noise_scale_for_screening();
        let nuisance = flexible_nuisance(library.current(), &base, observations, &seen, &present.strengths, &structure.by_group)?;
        let screening = screen_beyond(library, &base, &seen, c_screen, &nuisance, None)?;
        let held_out = linearise_held_out(library.current(), &base, observations, &held)?;
        let error = error_of(&held_out);
        let mut case = Case { library, observations, seen, held, base, structure, screening, spot_p_value: 1.0, present, held_out, error, seed };
        if let Some(spot) = local_spot(&case.reference(c_screen), &nuisance) {
            case.spot_p_value = spot.p_value;
        }
        Ok(case)
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

    /// Whether one place on the face is all that stands out.
    pub fn only_one_place(&self) -> bool {
        self.one_place() && !self.smooth() && !self.in_library()
    }

    /// Whether any of the tests says that something is missing (that of groups counts into that of structure).
    pub fn alarm(&self) -> bool {
        self.in_library() || self.smooth() || self.one_place()
    }

    /// Whether a model that no test faults fails all the same: by residuals too large for noise, by outliers that lie on one side or
    /// together, or on groups held out (of all but the first a note is made).
    pub fn fails_without_structure(&self, notes: &mut Vec<String>) -> bool {
        let missed = missed_groups(self.observations, &self.held, &self.held_out, &self.base.impacts, self.structure.noise_scale.sqrt());
        let outliers = outliers(&self.seen, &self.base.impacts, &self.held, &self.held_out);
        let odd = one_sided(&outliers, self.observations).or_else(|| outliers_together(&outliers, self.observations));
        let stopped = !stopped_words(self.library.current(), &self.base, NO_OFFSET).is_empty();
        let fails = missed.is_some() || odd.is_some() || stopped || is_more_than_noise(self.observations, &self.structure);
        notes.extend(missed.into_iter().chain(odd));
        fails
    }

    /// What the tests do not look at, in words.
    pub fn doubts(&self) -> Vec<String> {
        let own = self.present.strengths.iter().map(|s| s.0).collect::<Vec<_>>();
        let by_group = unlike_strengths(&self.base, self.observations, &self.seen, &own, self.structure.noise_scale).map(|unlike| {
            format!(
                "But {} is not of one strength in all groups of `{}` ({}): make a model for each group.",
                self.present.names.join(" and "),
                unlike.column,
                p_text(unlike.p_value)
            )
        });
        by_group.into_iter().chain(beside_the_tests(&self.seen, &self.base.impacts, &self.held, &self.held_out)).collect()
    }

    /// Tells which parameters a limit stops: after the verdict of a model that fails, else as a note.
    pub fn tell_stopped(&self, diagnosis: &mut Diagnosis) {
        let words = stopped_words(self.library.current(), &self.base, 0.0);
        if diagnosis.verdict != Verdict::Adequate {
            let after = diagnosis.words.len().min(1);
            diagnosis.words.splice(after..after, words.iter().cloned());
        }
        diagnosis.notes.splice(0..0, words);
    }

    pub fn reference(&self, c: f64) -> Reference<'_> {
        Reference {
            library: self.library,
            observations: self.observations,
            impacts: &self.seen,
            base: &self.base,
            groups: &self.structure.by_group,
            lone_term: self.structure.lone_term,
            c,
            seed: self.seed,
        }
    }

    fn notes(&self) -> Vec<String> {
        let mut notes = self.observations.notes.clone();
        note_groups(&self.structure, &mut notes);
        notes.extend(mean_words(&session_offsets(self.observations, &self.base, self.structure.noise_scale)));
        notes
    }

    /// Effects in the model of which these impacts show none although they would show a usual one, in words.
    pub fn not_shown(&self) -> Vec<String> {
        let c = self.structure.noise_scale;
        let words = |name: &String| {
            let own = || self.present.strengths.iter().filter(|(_, s)| s.parameter.split_once('.').is_some_and(|(effect, _)| effect == name));
            let none = |(at, s): &(usize, Strength)| {
                let sd = self.base.sd(*at, c);
                (self.base.values[*at] - s.absent).abs() < 2.0 * sd && sd < SURELY_NONE * s.typical
            };
            let told = |(at, s): &(usize, Strength)| format!("{} {} ± {}", s.parameter, short(self.base.values[*at]), short(self.base.sd(*at, c)));
            let each = own().map(told).collect::<Vec<_>>().join(", ");
            own().all(none).then(|| format!("{name}, which the model has, does not show on these impacts and may be left out: {each}"))
        };
        self.present.names.iter().filter_map(words).collect()
    }

    /// What is known before any effect is tried: an adequate model.
    pub fn report(&self, model: &str) -> Diagnosis {
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
            false_alarm_rate: FALSE_ALARM_RATE + if self.structure.columns_of_groups > 0 { GROUP_LEVEL } else { 0.0 },
            not_visible: not_visible(self.library, &self.screening),
            parameters: parameter_values(self.library.current(), &self.base, c),
            outliers: outliers(&self.seen, &self.base.impacts, &self.held, &self.held_out),
            session_offsets: session_offsets(self.observations, &self.base, c),
            words: Vec::new(),
            left_out: self.observations.left_out(),
            notes: self.notes(),
            model: model.to_owned(),
            seed: self.seed,
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
