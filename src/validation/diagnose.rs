//! The procedure: is anything missing, what, and how sure is that?

use super::comparison::{note_noise, outliers, parameter_values, session_offsets, summarise, varied_inputs};
use super::diagnosis::{CandidateReport, Diagnosis, Estimate, NextExperiment, NotVisible, Together, Verdict};
use super::error::ValidationError;
use super::experiments::{Rival, next_experiment};
use super::expression::find_expression;
use super::fit::{Fit, FitOptions, fit};
use super::forward::{Library, Strength};
use super::heldout::{error_of, held_out_error, linearise_held_out};
use super::observation::Observations;
use super::place::places;
use super::rank::{Reference, Refit, added_parameters, flexible_nuisance, form_overdispersion};
use super::screen::{Screened, Screening, screen, screen_beyond, screen_pairs};
use super::structure::{StructureTest, structure_test};
use super::verdict_words::verdict_words;
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Corrected level of the library test.
pub const LIBRARY_LEVEL: f64 = 0.01;
/// Level of the structure test.
pub const STRUCTURE_LEVEL: f64 = 0.003;
/// The two together: how often nothing-missing is called missing, at most.
pub const FALSE_ALARM_RATE: f64 = LIBRARY_LEVEL + STRUCTURE_LEVEL;
/// Share of the excess that a catalogue effect must take away to be called missing.
pub const SHARE: f64 = 0.75;
/// Noise variance over the stated one that is believed to be noise: deviations understated by half.
const LARGEST_NOISE_SCALE: f64 = 2.25;
/// What is left of an effect's probability when the held-out impacts refuse it.
const REFUSED: f64 = 0.3;
/// Candidates refitted alone, and pairs.
const SINGLES: usize = 8;
const PAIRS: usize = 8;
/// An effect that takes nearly as much of the excess away is an alias, whatever the evidence says of its formula.
const ALIAS_SHARE: f64 = 0.9;
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
    // Effects that are in the model already may have another form than the catalogue's; what that leaves is no new effect.
    let present: Vec<(usize, Strength)> = library
        .effects()
        .iter()
        .filter(|o| o.excluded.is_some())
        .flat_map(|o| &o.strengths)
        .filter_map(|s| library.current().parameters().iter().position(|p| p.name == s.parameter).map(|at| (at, s.clone())))
        .collect();
    let c_screen = structure.noise_scale_for_screening();
    let screening = if present.is_empty() {
        screen(library, &base, &seen, c_screen)?
    } else {
        let nuisance = flexible_nuisance(library.current(), &base, observations, &seen, &present)?;
        screen_beyond(library, &base, &seen, c_screen, &nuisance, None)?
    };
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
    let mut reference = Reference { library, observations, impacts: &seen, base: &base, c, seed: options.seed };
    let refits = Refits::new(&mut reference, &screening)?;
    let c = refits.c;
    let beyond_form = |r: &Refit| {
        let stands_out =
            |name: &String| screening.effects.iter().any(|s| library.effects()[s.effect].name == *name && s.p_value * (screening.tested as f64) < FIRST_LEVEL);
        present.is_empty() || r.effects.iter().all(stands_out)
    };
    let chosen = refits.choose().filter(|r| beyond_form(r));
    if !present.is_empty() && chosen.is_none() {
        diagnosis.notes.push("what is left looks like the form of the effects already in the model, not like a further effect of the catalogue".to_owned());
    }
    diagnosis.noise_floor = c.sqrt();
    diagnosis.places = places(&seen, &base.impacts, &varied_inputs(observations), c);
    // Noise may be misstated by half; what the best model leaves beyond that is not noise but something unexplained.
    let c_believed = c.min(LARGEST_NOISE_SCALE);
    let excess = excess_at(&diagnosis.structure, c_believed);
    let best_left = refits.all().map(|(r, _)| excess_at(&r.structure, c_believed)).fold(f64::INFINITY, f64::min);
    let overdispersion = if best_left.is_finite() { form_overdispersion(best_left, diagnosis.structure.rank) } else { 1.0 };
    let share = chosen.map_or(0.0, |b| share_removed(excess, excess_at(&b.structure, c_believed)));
    let accounted = chosen.is_some_and(|b| share >= SHARE || (b.structure.p_value >= STRUCTURE_LEVEL && b.structure.noise_scale <= LARGEST_NOISE_SCALE));
    diagnosis.verdict = match (chosen, accounted) {
        (Some(_), true) => Verdict::EffectMissing,
        (None, _) if diagnosis.structure.p_value >= STRUCTURE_LEVEL => Verdict::Adequate,
        _ => Verdict::Unexplained,
    };
    // The last word has the impacts the fit never saw: an effect that makes their error worse is not added.
    let mut refused = None;
    if let (Some(best), Verdict::EffectMissing) = (chosen, diagnosis.verdict) {
        let forward = library.with(&best.effects.iter().map(String::as_str).collect::<Vec<_>>())?;
        let after = held_out_error(forward.as_ref(), &best.fit, observations)?;
        if after >= before {
            diagnosis.verdict = if diagnosis.structure.p_value >= STRUCTURE_LEVEL { Verdict::Adequate } else { Verdict::Unexplained };
            diagnosis.notes.push(format!(
                "{} would fit these impacts better, but the error on held-out impacts does not fall ({before:.3} to {after:.3}): not believed",
                best.effects.join(" and ")
            ));
            refused = Some(best.effects.clone());
        }
    }
    diagnosis.candidates = refits.report(&reference, &screening, before, excess, overdispersion, diagnosis.verdict)?;
    for c in diagnosis.candidates.iter_mut().filter(|c| refused.as_ref().is_some_and(|r| r.contains(&c.effect))) {
        c.probability *= REFUSED;
    }
    diagnosis
        .candidates
        .sort_by(|a, b| b.probability.total_cmp(&a.probability).then(b.log_evidence_gain.total_cmp(&a.log_evidence_gain)).then(a.effect.cmp(&b.effect)));
    if let Some(best) = chosen.filter(|_| refused.is_none()) {
        diagnosis.structure_after = Some(best.structure.clone());
        if diagnosis.verdict == Verdict::EffectMissing {
            diagnosis.recommended = best.effects.clone();
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
        let (held, held_best) =
            (&held, linearise_held_out(library.with(&best.effects.iter().map(String::as_str).collect::<Vec<_>>())?.as_ref(), &best.fit, observations, &held)?);
        diagnosis.outliers = outliers(&seen, &best.fit.impacts, held, &held_best);
    }
    let form_is_off = chosen.filter(|_| refused.is_none()).is_some_and(|b| b.structure.p_value < STRUCTURE_LEVEL);
    if options.expressions && (diagnosis.verdict == Verdict::Unexplained || (diagnosis.verdict == Verdict::EffectMissing && form_is_off)) {
        let found = find_expression(&mut reference, &screening, |t, c| excess_at(t, c.min(LARGEST_NOISE_SCALE)), &diagnosis.structure)?;
        if let Some(found) = found {
            let catalogue = chosen.map_or(0.0, |b| log_evidence_over_at(&base, b, reference.c));
            if diagnosis.verdict == Verdict::Unexplained || found.log_evidence > catalogue + LOG_ODDS {
                diagnosis.suggested_expression = Some(found.suggestion);
                diagnosis.noise_floor = diagnosis.noise_floor.min(reference.c.sqrt());
            }
        }
    }
    if diagnosis.verdict == Verdict::EffectMissing && form_is_off {
        diagnosis.other_form = diagnosis.recommended.first().cloned();
    }
    // Names that take nothing away are not worth an experiment.
    if diagnosis.verdict == Verdict::EffectMissing {
        diagnosis.next_experiments = refits.next_experiments(&reference, &diagnosis.candidates)?;
    }
    diagnosis.words = verdict_words(&diagnosis);
    Ok(diagnosis)
}

/// Share of the excess that is gone; an excess of nothing has nothing to remove.
pub fn share_removed(before: f64, after: f64) -> f64 {
    if before <= 0.0 { 0.0 } else { (1.0 - after / before).clamp(0.0, 1.0) }
}

/// The excess of a structure test at another noise scale than its own: the chi-square beyond what noise of scale c leaves.
fn excess_at(test: &StructureTest, c: f64) -> f64 {
    let chi2 = test.statistic + test.noise_scale * test.residual_freedom;
    (chi2 / c - test.rank as f64 - test.residual_freedom).max(0.0)
}

fn log_evidence_over_at(base: &Fit, refit: &Refit, c: f64) -> f64 {
    super::rank::log_evidence_over(base, &refit.fit, c, 0)
}

/// Starting strengths of a pair: from the joint score where there is one, else typical halves.
fn screen_pairs_guess(reference: &Reference, screening: &Screening, names: &[&str]) -> Vec<f64> {
    let of = |name: &str| screening.effects.iter().find(|s| reference.library.effects()[s.effect].name == name);
    let Some(terms): Option<Vec<&Screened>> = names.iter().map(|n| of(n)).collect() else { return Vec::new() };
    let columns: Vec<usize> = terms.iter().flat_map(|s| s.terms.iter().copied()).collect();
    let typical = terms.iter().flat_map(|s| reference.library.effects()[s.effect].strengths.iter().map(|t| t.typical));
    screening.projected.joint(&columns).map_or_else(Vec::new, |(_, strengths)| strengths.iter().zip(typical).map(|(s, t)| s * t).collect())
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

/// Two effects together, and what the lesser of them explains when the other may have any form.
struct Pair {
    refit: Refit,
    /// Gain in chi-square of the lesser one, and its p-value corrected for the catalogue.
    beyond_form: f64,
    p_value: f64,
}

/// Everything refitted.
struct Refits {
    singles: Vec<Refit>,
    pairs: Vec<Pair>,
    tested: usize,
    /// Noise scale of the best model found.
    c: f64,
}

impl Refits {
    fn new(reference: &mut Reference, screening: &Screening) -> Result<Self, ValidationError> {
        let library = reference.library;
        let name = |e: usize| library.effects()[e].name.as_str();
        let mut order: Vec<_> = screening.effects.iter().filter(|s| s.hidden_because.is_none() && s.gain > 0.0).collect();
        order.sort_by(|a, b| (b.gain - b.terms.len() as f64).total_cmp(&(a.gain - a.terms.len() as f64)).then(a.effect.cmp(&b.effect)));
        order.truncate(SINGLES);
        let fixed = &*reference;
        let singles: Vec<Refit> =
            order.par_iter().map(|s| fixed.refit(&[name(s.effect)], &s.strengths)).collect::<Vec<_>>().into_iter().filter_map(Result::ok).collect();
        let mut refits = Refits { singles, pairs: Vec::new(), tested: screening.tested.max(1), c: reference.c };
        refits.settle_noise(reference);
        refits.find_pairs(reference, screening)?;
        refits.settle_noise(reference);
        Ok(refits)
    }

    /// A model that misses leaves misfit in the noise scale; the best model's is nearest to the truth.
    fn settle_noise(&mut self, reference: &mut Reference) {
        self.c = self.singles.iter().chain(self.pairs.iter().map(|p| &p.refit)).map(|r| r.structure.noise_scale).fold(self.c, f64::min);
        reference.c = self.c;
        for r in self.singles.iter_mut().chain(self.pairs.iter_mut().map(|p| &mut p.refit)) {
            r.judge(reference.base, self.c);
        }
    }

    fn find_pairs(&mut self, reference: &Reference, screening: &Screening) -> Result<(), ValidationError> {
        let library = reference.library;
        let mut leaders: Vec<usize> = (0..self.singles.len()).filter(|&i| self.singles[i].log_evidence > 0.0).collect();
        leaders.sort_by(|&a, &b| self.singles[b].log_evidence.total_cmp(&self.singles[a].log_evidence).then(a.cmp(&b)));
        leaders.truncate(2);
        // What stands out beside a leader in any form.
        let mut wanted: Vec<[String; 2]> = Vec::new();
        let mut want = |a: &str, b: &str| {
            let pair = if a < b { [a.to_owned(), b.to_owned()] } else { [b.to_owned(), a.to_owned()] };
            if !wanted.contains(&pair) {
                wanted.push(pair);
            }
        };
        for &leader in &leaders {
            let first = &self.singles[leader];
            let second = reference.screen_second(first, None)?;
            let mut order: Vec<_> = second.effects.iter().filter(|s| s.p_value * (self.tested as f64) < SECOND_LEVEL).collect();
            order.sort_by(|a, b| b.gain.total_cmp(&a.gain).then(a.effect.cmp(&b.effect)));
            for s in order.iter().take(3) {
                want(&first.effects[0], &library.effects()[s.effect].name);
            }
        }
        // Pairs that hide each other: much better together than the best one alone.
        let best_gain = screening.effects.iter().map(|s| s.gain).fold(0.0, f64::max);
        for p in screen_pairs(screening, library, reference.c).iter().take(3).filter(|p| p.gain > 1.3 * best_gain + 30.0) {
            want(&library.effects()[p.effects[0]].name, &library.effects()[p.effects[1]].name);
        }
        wanted.truncate(PAIRS);
        let singles = &self.singles;
        let tested = self.tested as f64;
        let pairs: Vec<Option<Pair>> = wanted
            .par_iter()
            .map(|names| {
                let pair: Vec<&str> = names.iter().map(String::as_str).collect();
                let guess = screen_pairs_guess(reference, screening, &pair);
                let refit = reference.refit(&pair, &guess).ok()?;
                // Each half beyond the other in any form.
                let mut least = (f64::INFINITY, 0.0f64);
                for (own, other) in [(0, 1), (1, 0)] {
                    let alone = singles.iter().find(|s| s.effects[0] == names[own]);
                    let made;
                    let first = match alone {
                        Some(s) => s,
                        None => {
                            made = reference.refit(&[pair[own]], &[]).ok()?;
                            &made
                        }
                    };
                    let beyond = reference.screen_second(first, Some(&[pair[other]])).ok()?;
                    let s = beyond.effects.first()?;
                    least = (least.0.min(s.gain), least.1.max((s.p_value * tested).min(1.0)));
                }
                Some(Pair { refit, beyond_form: least.0, p_value: least.1 })
            })
            .collect();
        self.pairs = pairs.into_iter().flatten().collect();
        Ok(())
    }

    fn log_prior(&self, effects: usize) -> f64 {
        let n = self.tested as f64;
        match effects {
            1 => (PRIOR[1] / n).ln(),
            _ => (PRIOR[2] / (0.5 * n * (n - 1.0)).max(1.0)).ln(),
        }
    }

    /// Evidence of a pair: no more over its better half than the lesser one explains beyond the other's form.
    fn pair_evidence(&self, pair: &Pair) -> f64 {
        let half = self.singles.iter().filter(|s| pair.refit.effects.contains(&s.effects[0])).map(|s| s.log_evidence).fold(0.0, f64::max);
        let beyond = 0.5 * pair.beyond_form - (1.0 + pair.beyond_form).ln();
        half + (pair.refit.log_evidence - half).min(beyond)
    }

    /// Every model with its log evidence.
    fn all(&self) -> impl Iterator<Item = (&Refit, f64)> {
        self.singles.iter().map(|s| (s, s.log_evidence)).chain(self.pairs.iter().map(|p| (&p.refit, self.pair_evidence(p))))
    }

    /// The model to recommend: the best single effect, or the best pair when both halves earn their place.
    fn choose(&self) -> Option<&Refit> {
        let single = self
            .singles
            .iter()
            .filter(|r| r.log_evidence > 0.5 * LOG_ODDS && r.p_value * (self.tested as f64) < FIRST_LEVEL && r.largest_share < ONE_IMPACT)
            .max_by(|a, b| a.log_evidence.total_cmp(&b.log_evidence));
        let pair = self
            .pairs
            .iter()
            .filter(|p| p.p_value < SECOND_LEVEL && p.refit.largest_share < ONE_IMPACT && self.pair_evidence(p) > 0.5 * LOG_ODDS)
            .max_by(|a, b| self.pair_evidence(a).total_cmp(&self.pair_evidence(b)));
        match (single, pair) {
            (Some(s), Some(p)) => {
                let better = self.pair_evidence(p) + self.log_prior(2) - s.log_evidence - self.log_prior(1);
                if better > 0.5 * LOG_ODDS { Some(&p.refit) } else { Some(s) }
            }
            (s, p) => s.or(p.map(|p| &p.refit)),
        }
    }

    /// Log posterior weights of nothing, every single, every pair.
    fn log_weights(&self, overdispersion: f64) -> Vec<f64> {
        std::iter::once(PRIOR[0].ln()).chain(self.all().map(|(r, e)| e / overdispersion + self.log_prior(r.effects.len()))).collect()
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
        self.all().zip(&weights[1..]).find(|((r, _), _)| std::ptr::eq(*r, refit)).map_or(0.0, |(_, w)| *w)
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
                let mut probability: f64 = self.all().zip(&weights[1..]).filter(|((r, _), _)| r.effects.contains(&effect)).map(|(_, w)| w).sum();
                let share = share_removed(excess, excess_at(&s.structure, self.c.min(LARGEST_NOISE_SCALE)));
                if verdict == Verdict::Unexplained {
                    // No name is likely when none takes the excess away.
                    let joint = self
                        .all()
                        .filter(|(r, _)| r.effects.contains(&effect))
                        .map(|(r, _)| share_removed(excess, excess_at(&r.structure, self.c.min(LARGEST_NOISE_SCALE))))
                        .fold(share, f64::max);
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

    /// For the best candidate and each of its first two aliases: the impacts that would tell.
    fn next_experiments(&self, reference: &Reference, candidates: &[CandidateReport]) -> Result<Vec<NextExperiment>, ValidationError> {
        let Some(best) = candidates.first() else { return Ok(Vec::new()) };
        let Some(first) = self.singles.iter().find(|s| s.effects[0] == best.effect) else { return Ok(Vec::new()) };
        let a = reference.library.with(&[&best.effect])?;
        let at_a = a.prepare(&first.fit.values)?;
        let mut all = Vec::new();
        for alias in best.aliases.iter().take(2) {
            let Some(second) = self.singles.iter().find(|s| s.effects[0] == *alias) else { continue };
            let b = reference.library.with(&[alias])?;
            let at_b = b.prepare(&second.fit.values)?;
            let separated_by = reference.library.effects().iter().find(|o| o.name == best.effect).map_or("", |o| o.separated_by.as_str());
            let (first, second) = (Rival { name: &best.effect, prediction: at_a.as_ref() }, Rival { name: alias, prediction: at_b.as_ref() });
            all.extend(next_experiment(&first, &second, reference.observations, reference.impacts, &reference.base.impacts, separated_by));
        }
        Ok(all)
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
        let facts: Vec<(String, f64, f64)> = list.iter().map(|c| (c.effect.clone(), c.log_evidence_gain, c.share_removed)).collect();
        for candidate in list.iter_mut() {
            for (other, evidence, share) in &facts {
                if *other == candidate.effect {
                    continue;
                }
                let like = cosine(&candidate.effect, other);
                let close = (candidate.log_evidence_gain - evidence).abs() / overdispersion < LOG_ODDS && *evidence > 0.0;
                let as_good = candidate.share_removed > 0.3 && *share > ALIAS_SHARE * candidate.share_removed;
                if close || as_good || like.abs() > 0.95 {
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
