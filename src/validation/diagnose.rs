//! The procedure: is anything missing, what, and how sure is that?

use super::comparison::{note_noise, outliers, parameter_values, session_offsets, summarise, varied_inputs};
use super::diagnosis::{CandidateReport, Diagnosis, Estimate, NotVisible, Together, Verdict};
use super::error::ValidationError;
use super::fit::{Fit, FitOptions, fit};
use super::forward::Library;
use super::heldout::{error_of, held_out_error, linearise_held_out};
use super::observation::Observations;
use super::place::places;
use super::rank::{Reference, Refit, added_parameters, form_overdispersion};
use super::screen::{Screening, screen, screen_pairs};
use super::structure::structure_test;
use super::verdict_words::verdict_words;
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Corrected level of the library test.
pub const LIBRARY_LEVEL: f64 = 0.02;
/// Level of the structure test.
pub const STRUCTURE_LEVEL: f64 = 0.005;
/// The two together: how often nothing-missing is called missing, at most.
pub const FALSE_ALARM_RATE: f64 = LIBRARY_LEVEL + STRUCTURE_LEVEL;
/// Share of the excess that a catalogue effect must take away to be called missing.
pub const SHARE: f64 = 0.75;
/// Candidates refitted alone, and pairs.
const SINGLES: usize = 8;
const PAIRS: usize = 8;
/// Twenty to one.
const LOG_ODDS: f64 = 2.995_732_273_553_991;
/// Prior odds: nothing, one effect, two effects.
const PRIOR: [f64; 3] = [0.5, 0.35, 0.15];
/// Level of a single effect's likelihood ratio, corrected for the catalogue, and of the second effect's.
const FIRST_LEVEL: f64 = 0.05;
const SECOND_LEVEL: f64 = 0.01;
/// An effect that one impact carries by more than this share of its gain is not believed.
const ONE_IMPACT: f64 = 0.6;

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
pub fn diagnose(library: &dyn Library, observations: &Observations, options: &DiagnoseOptions) -> Result<Diagnosis, ValidationError> {
    let seen = observations.side(false);
    let held = observations.side(true);
    let base = fit(library.current(), observations, &seen, &FitOptions::default(), None)?;
    let structure = structure_test(&base, observations, &seen, options.seed);
    let c = structure.noise_scale;
    let screening = screen(library, &base, &seen, c)?;
    let held_base = linearise_held_out(library.current(), &base, observations, &held)?;
    let before = error_of(&held_base);
    let mut notes = observations.notes.clone();
    note_noise(&structure, &mut notes);
    let mut diagnosis = Diagnosis {
        verdict: Verdict::Adequate,
        outputs: summarise(&base.impacts, &held_base),
        places: Vec::new(),
        candidates: Vec::new(),
        suggested_expression: None,
        next_experiments: Vec::new(),
        noise_floor: c.sqrt(),
        recommended: Vec::new(),
        together: None,
        other_form: None,
        heldout_error: before,
        n_impacts: observations.impacts.len(),
        n_held_out: held.len(),
        structure_after: None,
        library_p_value: screening.library_p_value,
        n_tested: screening.tested,
        false_alarm_rate: FALSE_ALARM_RATE,
        not_visible: not_visible(library, &screening),
        parameters: parameter_values(library.current(), &base, c),
        outliers: outliers(&seen, &base.impacts, &held, &held_base),
        session_offsets: session_offsets(observations, &base, c),
        words: Vec::new(),
        notes,
        model: options.model.clone(),
        seed: options.seed,
        provenance: None,
        structure,
    };
    let alarm = screening.library_p_value < LIBRARY_LEVEL || diagnosis.structure.p_value < STRUCTURE_LEVEL;
    if !alarm {
        diagnosis.candidates = listed_only(library, &screening, before);
        diagnosis.words = verdict_words(&diagnosis);
        return Ok(diagnosis);
    }
    let reference = Reference { library, observations, impacts: &seen, base: &base, c, seed: options.seed };
    let refits = Refits::new(&reference, &screening)?;
    let chosen = refits.choose(&reference, &screening);
    diagnosis.places = places(&seen, &base.impacts, &varied_inputs(observations), c);
    let overdispersion = refits.best().map_or(1.0, |b| form_overdispersion(&b.structure));
    let remaining = chosen.map(|b| b.structure.clone());
    let share = remaining.as_ref().map_or(0.0, |s| share_removed(diagnosis.structure.excess, s.excess));
    let accounted = remaining.as_ref().is_some_and(|s| share >= SHARE || s.p_value >= STRUCTURE_LEVEL);
    diagnosis.verdict = match (chosen, accounted) {
        (Some(_), true) => Verdict::EffectMissing,
        (None, _) if diagnosis.structure.p_value >= STRUCTURE_LEVEL => Verdict::Adequate,
        _ => Verdict::Unexplained,
    };
    diagnosis.candidates = refits.report(&reference, &screening, before, diagnosis.structure.excess, overdispersion, diagnosis.verdict)?;
    if let Some(best) = chosen {
        diagnosis.structure_after = Some(best.structure.clone());
        if diagnosis.verdict == Verdict::EffectMissing {
            diagnosis.recommended = best.effects.clone();
            if best.structure.p_value < STRUCTURE_LEVEL {
                diagnosis.other_form = best.effects.first().cloned();
            }
        }
        if best.effects.len() > 1 {
            let forward = library.with(&best.effects.iter().map(String::as_str).collect::<Vec<_>>())?;
            diagnosis.together = Some(Together {
                effects: best.effects.clone(),
                probability: refits.probability_of(best, overdispersion),
                heldout_error_before: before,
                heldout_error_after: held_out_error(forward.as_ref(), &best.fit, observations)?,
                log_evidence_gain: best.log_evidence,
                share_removed: share,
                parameters: estimates(&added_parameters(forward.as_ref(), &best.fit, base.values.len(), c)),
            });
        }
    }
    diagnosis.words = verdict_words(&diagnosis);
    Ok(diagnosis)
}

/// Share of the excess that is gone; an excess of nothing has nothing to remove.
pub fn share_removed(before: f64, after: f64) -> f64 {
    if before <= 0.0 { 0.0 } else { (1.0 - after / before).clamp(0.0, 1.0) }
}

fn estimates(parameters: &[(String, f64, f64)]) -> BTreeMap<String, Estimate> {
    parameters.iter().map(|(name, value, sd)| (name.clone(), Estimate { value: *value, sd: *sd })).collect()
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

/// Everything refitted.
struct Refits {
    singles: Vec<Refit>,
    pairs: Vec<Refit>,
    tested: usize,
}

impl Refits {
    fn new(reference: &Reference, screening: &Screening) -> Result<Self, ValidationError> {
        let library = reference.library;
        let name = |e: usize| library.effects()[e].name.as_str();
        let mut order: Vec<_> = screening.effects.iter().filter(|s| s.hidden_because.is_none() && s.gain > 0.0).collect();
        order.sort_by(|a, b| (b.gain - b.terms.len() as f64).total_cmp(&(a.gain - a.terms.len() as f64)).then(a.effect.cmp(&b.effect)));
        order.truncate(SINGLES);
        let singles: Vec<Refit> =
            order.par_iter().map(|s| reference.refit(&[name(s.effect)], &s.strengths)).collect::<Vec<_>>().into_iter().filter_map(Result::ok).collect();
        let mut tried = screen_pairs(screening, library, reference.c);
        let best_single = singles.iter().map(|s| s.gain).fold(0.0, f64::max);
        // A pair must promise more than its better half by the price of another effect.
        tried.retain(|p| p.gain > 0.8 * best_single);
        tried.truncate(PAIRS);
        let pairs: Vec<Refit> = tried
            .par_iter()
            .map(|p| reference.refit(&[name(p.effects[0]), name(p.effects[1])], &p.strengths))
            .collect::<Vec<_>>()
            .into_iter()
            .filter_map(Result::ok)
            .collect();
        Ok(Refits { singles, pairs, tested: screening.tested.max(1) })
    }

    fn all(&self) -> impl Iterator<Item = &Refit> {
        self.singles.iter().chain(&self.pairs)
    }

    fn log_prior(&self, effects: usize) -> f64 {
        let n = self.tested as f64;
        match effects {
            1 => (PRIOR[1] / n).ln(),
            _ => (PRIOR[2] / (0.5 * n * (n - 1.0)).max(1.0)).ln(),
        }
    }

    fn best_of<'a>(&self, list: impl Iterator<Item = &'a Refit>) -> Option<&'a Refit> {
        list.max_by(|a, b| (a.log_evidence + self.log_prior(a.effects.len())).total_cmp(&(b.log_evidence + self.log_prior(b.effects.len()))))
    }

    fn best(&self) -> Option<&Refit> {
        self.best_of(self.all())
    }

    /// The model to recommend: the best single effect, or the best pair when both halves earn their place.
    fn choose(&self, _reference: &Reference, _screening: &Screening) -> Option<&Refit> {
        let earns = |r: &Refit, level: f64| r.log_evidence > 0.5 * LOG_ODDS && r.p_value * (self.tested as f64) < level && r.largest_share < ONE_IMPACT;
        let single = self.best_of(self.singles.iter().filter(|r| earns(r, FIRST_LEVEL)));
        let pair = self.best_of(self.pairs.iter().filter(|r| {
            // Without either half the evidence must fall.
            let halves = self.singles.iter().filter(|s| r.effects.contains(&s.effects[0]));
            let best_half = halves.map(|s| (s.log_evidence, s.gain)).fold((0.0, 0.0), |a: (f64, f64), b| (a.0.max(b.0), a.1.max(b.1)));
            let extra = super::structure::chi2_tail(r.gain - best_half.1, (r.strengths.len().max(2) - 1) as f64) * self.tested as f64;
            r.log_evidence - best_half.0 > 0.5 * LOG_ODDS && extra < SECOND_LEVEL && r.largest_share < ONE_IMPACT
        }));
        match (single, pair) {
            (Some(s), Some(p)) => {
                let overdispersion = form_overdispersion(&p.structure);
                // The second effect must also be more than the first one's wrong form.
                let better = (p.log_evidence - s.log_evidence) / overdispersion + self.log_prior(2) - self.log_prior(1);
                if better > 0.5 * LOG_ODDS { Some(p) } else { Some(s) }
            }
            (s, p) => s.or(p),
        }
    }

    /// Log posterior weights of nothing, every single, every pair.
    fn log_weights(&self, overdispersion: f64) -> Vec<f64> {
        std::iter::once(PRIOR[0].ln()).chain(self.all().map(|r| r.log_evidence / overdispersion + self.log_prior(r.effects.len()))).collect()
    }

    fn normalised(&self, overdispersion: f64) -> Vec<f64> {
        let logs = self.log_weights(overdispersion);
        let top = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let weights: Vec<f64> = logs.iter().map(|l| (l - top).exp()).collect();
        let sum: f64 = weights.iter().sum();
        weights.into_iter().map(|w| w / sum).collect()
    }

    fn probability_of(&self, refit: &Refit, overdispersion: f64) -> f64 {
        let weights = self.normalised(overdispersion);
        self.all().zip(&weights[1..]).find(|(r, _)| std::ptr::eq(*r, refit)).map_or(0.0, |(_, w)| *w)
    }

    fn report(
        &self,
        reference: &Reference,
        screening: &Screening,
        before: f64,
        excess: f64,
        overdispersion: f64,
        verdict: Verdict,
    ) -> Result<Vec<CandidateReport>, ValidationError> {
        let library = reference.library;
        let weights = self.normalised(overdispersion);
        let mut list: Vec<CandidateReport> = self
            .singles
            .par_iter()
            .map(|s| {
                let effect = s.effects[0].clone();
                let forward = library.with(&[&effect])?;
                let mut probability: f64 = self.all().zip(&weights[1..]).filter(|(r, _)| r.effects.contains(&effect)).map(|(_, w)| w).sum();
                let share = share_removed(excess, s.structure.excess);
                if verdict == Verdict::Unexplained {
                    // No name is likely when none takes the excess away.
                    let joint = self.all().filter(|r| r.effects.contains(&effect)).map(|r| share_removed(excess, r.structure.excess)).fold(share, f64::max);
                    probability *= 0.5 * (joint / SHARE).min(1.0);
                }
                let outline = library.effects().iter().find(|o| o.name == effect);
                Ok(CandidateReport {
                    probability,
                    heldout_error_before: before,
                    heldout_error_after: held_out_error(forward.as_ref(), &s.fit, reference.observations)?,
                    parameters: estimates(&added_parameters(forward.as_ref(), &s.fit, reference.base.values.len(), reference.c)),
                    aliases: Vec::new(),
                    kind: outline.map_or("physics", |o| o.kind).to_owned(),
                    log_evidence_gain: s.log_evidence,
                    chi2_gain: s.gain,
                    p_value: (s.p_value * self.tested as f64).min(1.0),
                    share_removed: share,
                    alias_cosines: BTreeMap::new(),
                    refitted: true,
                    effect,
                })
            })
            .collect::<Result<Vec<_>, ValidationError>>()?;
        list.sort_by(|a, b| b.probability.total_cmp(&a.probability).then(b.log_evidence_gain.total_cmp(&a.log_evidence_gain)).then(a.effect.cmp(&b.effect)));
        self.add_aliases(library, screening, overdispersion, &mut list);
        Ok(list)
    }

    /// An alias explains these impacts about as well (within twenty to one), or has the same signature.
    fn add_aliases(&self, library: &dyn Library, screening: &Screening, overdispersion: f64, list: &mut [CandidateReport]) {
        let term = |name: &str| screening.effects.iter().find(|s| library.effects()[s.effect].name == name);
        let cosine = |a: &str, b: &str| -> f64 {
            let (Some(a), Some(b)) = (term(a), term(b)) else { return 0.0 };
            a.terms
                .iter()
                .flat_map(|&i| b.terms.iter().map(move |&j| (i, j)))
                .map(|(i, j)| screening.projected.cosine(i, j))
                .fold(0.0, |m: f64, v| if v.abs() > m.abs() { v } else { m })
        };
        let facts: Vec<(String, f64)> = list.iter().map(|c| (c.effect.clone(), c.log_evidence_gain)).collect();
        for candidate in list.iter_mut() {
            for (other, evidence) in &facts {
                if *other == candidate.effect {
                    continue;
                }
                let like = cosine(&candidate.effect, other);
                let close = (candidate.log_evidence_gain - evidence).abs() / overdispersion < LOG_ODDS && *evidence > 0.0;
                if close || like.abs() > 0.95 {
                    candidate.aliases.push(other.clone());
                    candidate.alias_cosines.insert(other.clone(), like);
                }
            }
        }
    }
}

/// The fit of the current model, for commands that write it out.
pub fn fit_current(library: &dyn Library, observations: &Observations) -> Result<Fit, ValidationError> {
    fit(library.current(), observations, &observations.side(false), &FitOptions::default(), None)
}
