//! The procedure: is anything missing, what, and how sure is that?

use super::case::{Case, less_likely_than_nothing};
use super::comparison::note_noise;
use super::diagnosis::{CandidateReport, Diagnosis, Estimate, Verdict};
use super::error::ValidationError;
use super::expression::WORTH_A_FORMULA;
use super::fit::{Fit, FitOptions, fit};
use super::forward::{Fixed, FreeParameter, Library};
use super::heldout::held_out_error;
use super::judgement::Judgement;
use super::misread_columns::{fall, misread, share_gone};
use super::observation::Observations;
use super::rank::added_parameters;
use super::refits::{LOG_ODDS, PRIOR, Refits, SHARE, estimates, share_removed};
use super::screen::Screening;
use super::terminal::short;
use super::verdict_words::verdict_words;
use rayon::prelude::*;
use std::collections::{BTreeMap, BTreeSet};

/// Candidates of an adequate model that are refitted.
const REFITTED: usize = 4;
/// What is left of the probability of what could be added, where a strength in the model is what is wrong.
const WRONG_STRENGTH: f64 = 0.1;
/// Impacts with outlying numbers for which these are looked at in full weight.
const FEWEST_ODD: usize = 5;

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
    let as_given = diagnose_as_given(library, observations, options)?;
    let diagnosis = with_fixed_freed(library, observations, options, &as_given)?.unwrap_or(as_given);
    misread_instead(library, observations, options, diagnosis)
}

/// Nothing physical is named where a column that does not hold what its name says accounts for far more. The table is diagnosed once more as it seems to be
/// meant: what is left then must be far less than what all that could be added leaves now, and all but nothing, or what an effect accounts for.
fn misread_instead(library: &dyn Library, observations: &Observations, options: &DiagnoseOptions, diagnosis: Diagnosis) -> Result<Diagnosis, ValidationError> {
    if diagnosis.verdict == Verdict::Adequate {
        return Ok(diagnosis);
    }
    let freed = library.with_fixed_freed();
    let library = freed.as_ref().map_or(library, |(freed, _)| freed.as_ref());
    let value = |p: &FreeParameter| diagnosis.parameters.iter().find(|known| known.name == p.name).map_or(p.value, |known| known.value);
    let fitted: Vec<f64> = library.current().parameters().iter().map(value).collect();
    let Some(found) = misread(library.current(), observations, &fitted, diagnosis.heldout_error)? else { return Ok(diagnosis) };
    // A reading that cannot be judged is none.
    let Ok(read) = diagnose_as_given(library, &found.observations, options) else { return Ok(diagnosis) };
    let (before, after) = (error_left(&diagnosis), error_left(&read));
    let numbers = found.observations.side(true).iter().map(|o| o.measured.len()).sum();
    if fall(numbers, before, after) < WORTH_A_FORMULA || read.verdict == Verdict::Unexplained && share_gone(before, after) < SHARE {
        return Ok(diagnosis);
    }
    let left = match read.verdict {
        Verdict::EffectMissing => format!("{:.2}, and {after:.2} with {}", found.heldout_error, read.recommended.join(" and ")),
        Verdict::Adequate => format!("{:.2}, and nothing is missing", found.heldout_error),
        Verdict::Unexplained => format!("{:.2}, with nothing added", found.heldout_error),
    };
    let words = format!(
        "The table reads as if it held {}. Read so, the error on held-out impacts is {left}. See how these columns were made before any physics is believed.",
        found.words
    );
    let mut doubted = nothing_to_add(diagnosis);
    doubted.words = verdict_words(&doubted, None);
    doubted.words.truncate(doubted.words.len().saturating_sub(1));
    doubted.words.insert(1, words.clone());
    doubted.notes.insert(0, words);
    Ok(doubted)
}

/// The error on held-out impacts that what is named leaves: an effect, or a formula.
fn error_left(d: &Diagnosis) -> f64 {
    let named = if d.verdict == Verdict::EffectMissing { d.with_recommended().map(|(error, _)| error) } else { None };
    let formula = d.suggested_expression.as_ref().map(|e| e.heldout_error_after);
    named.into_iter().chain(formula).fold(d.heldout_error, f64::min)
}

/// What a diagnosis comes to where nothing that could be added is what is wrong.
fn nothing_to_add(mut d: Diagnosis) -> Diagnosis {
    d.candidates.iter_mut().for_each(|c| c.probability *= WRONG_STRENGTH);
    d.next_experiments.clear();
    Diagnosis { verdict: Verdict::Unexplained, suggested_expression: None, recommended: Vec::new(), together: None, other_form: None, ..d }
}

/// A model that holds the strength of an effect fixed where nature has another, or none of it, or a number of its base, is mended by no effect that could
/// be added, and others are named in the place of what is wrong. So one that fails is asked again with those fitted. That is believed where what it
/// arrives at does better on the held-out impacts than what the model as given does, by what is asked of a formula, with no more effects added, or
/// does nearly as well with fewer.
fn with_fixed_freed(
    library: &dyn Library,
    observations: &Observations,
    options: &DiagnoseOptions,
    as_given: &Diagnosis,
) -> Result<Option<Diagnosis>, ValidationError> {
    if as_given.verdict == Verdict::Adequate {
        return Ok(None);
    }
    let Some((freed, fixed)) = library.with_fixed_freed() else { return Ok(None) };
    let mut second = diagnose_as_given(freed.as_ref(), observations, options)?;
    let named = |d: &Diagnosis| if d.verdict == Verdict::EffectMissing { d.recommended.len() } else { 0 };
    let left = |d: &Diagnosis| if named(d) > 0 { d.with_recommended().map_or(d.heldout_error, |(error, _)| error) } else { d.heldout_error };
    let numbers = second.outputs.iter().map(|o| o.n).sum::<usize>() as f64 * second.n_held_out as f64 / second.n_impacts.max(1) as f64;
    let fall = numbers * (left(as_given).powi(2) - left(&second).powi(2)) / second.noise_floor.powi(2);
    let (fewer, more) = (named(&second) < named(as_given), named(&second) > named(as_given) && named(as_given) > 0);
    if second.verdict == Verdict::Unexplained || more || fall < if fewer { -2.0 * LOG_ODDS } else { WORTH_A_FORMULA } {
        return Ok(None);
    }
    // Those that moved.
    let moved = |f: &&Fixed| second.parameters.iter().any(|p| p.name == f.parameter && (p.value - f.value).abs() > 2.0 * p.sd);
    let moved: Vec<&Fixed> = fixed.iter().filter(moved).collect();
    if moved.is_empty() {
        return Ok(None);
    }
    let words = fixed_words(&moved, &second);
    let error = second.heldout_error;
    if second.verdict == Verdict::EffectMissing {
        second.words.insert(
            1,
            format!(
                "{words} With that fitted the error on held-out impacts is {error:.2} instead of {:.2}, and what is said here is of the model then.",
                as_given.heldout_error
            ),
        );
        second.notes.insert(0, words);
        return Ok(Some(second));
    }
    let mut mended = nothing_to_add(as_given.clone());
    mended.noise_floor = second.noise_floor;
    mended.words = verdict_words(&mended, None);
    mended.words.truncate(mended.words.len().saturating_sub(1));
    mended.words.insert(
        1,
        format!("{words} With that fitted nothing is missing: the error on held-out impacts falls from {:.2} to {error:.2}.", as_given.heldout_error),
    );
    mended.notes.insert(0, words);
    Ok(Some(mended))
}

/// What of a model is held where the impacts say otherwise, as `freed` has fitted it.
fn fixed_words(moved: &[&Fixed], freed: &Diagnosis) -> String {
    let mut said = Vec::new();
    for of_base in [false, true] {
        let of = |f: &&Fixed| {
            let p = freed.parameters.iter().find(|p| p.name == f.parameter)?;
            let (value, sd, held) = (short(p.value), short(p.sd), short(f.value));
            Some(format!("{} is {value} ± {sd} on these impacts, not {held} as the model file holds it", f.parameter)).filter(|_| f.of_base == of_base)
        };
        let words: Vec<String> = moved.iter().filter_map(of).collect();
        if !words.is_empty() {
            let what = if of_base { "A number of the base is held fixed and wrong" } else { "An effect that the model has already is wrong in strength" };
            let ask = if of_base { " (write `fit = true` beside it)" } else { "" };
            said.push(format!("{what}: {}{ask}.", words.join("; ")));
        }
    }
    said.join(" ")
}

/// Diagnoses the model with what it holds fixed as it is.
fn diagnose_as_given(library: &dyn Library, observations: &Observations, options: &DiagnoseOptions) -> Result<Diagnosis, ValidationError> {
    let case = Case::new(library, observations, options.seed)?;
    let mut diagnosis = case.report(&options.model);
    if !case.alarm() {
        diagnosis.candidates = listed_only(library, &case.screening, case.error, case.structure.noise_scale);
        less_likely_than_nothing(&mut diagnosis.candidates);
        refit_first(&case, &mut diagnosis.candidates);
        if case.fails_without_structure(&mut diagnosis.notes) {
            diagnosis.verdict = Verdict::Unexplained;
        }
        if let Some(with_outliers) = with_outliers_kept(library, observations, options, &diagnosis)? {
            return Ok(with_outliers);
        }
        if diagnosis.verdict == Verdict::Adequate {
            diagnosis.notes.extend(case.not_shown());
        }
        note_noise(diagnosis.noise_floor, diagnosis.verdict == Verdict::Adequate, &mut diagnosis.notes);
        let doubts = if diagnosis.verdict == Verdict::Adequate { case.doubts() } else { Vec::new() };
        diagnosis.words = verdict_words(&diagnosis, doubts);
        case.tell_stopped(&mut diagnosis);
        return Ok(diagnosis);
    }
    let mut reference = case.reference(case.structure.noise_scale);
    let refits = Refits::new(&mut reference, &case.screening, &case.structure, &case.held_out)?;
    let mut judgement = Judgement::new(&case, reference, &refits)?;
    judgement.ask_groups()?;
    judgement.ask_groups_of_effects()?;
    judgement.look_for_formula(options.expressions)?;
    judgement.leave_to_chance();
    judgement.ask_held_out();
    judgement.allow_shared_errors();
    judgement.ask_scatter_and_groups();
    judgement.set_formula_against_name()?;
    let judged = judgement.report(diagnosis, options.expressions)?;
    // A place that stands out and is not believed, or what nothing accounts for: a few impacts may tell more in full weight.
    let told = judged.verdict == Verdict::EffectMissing || judged.suggested_expression.is_some();
    let in_full = if told { None } else { with_outliers_kept(library, observations, options, &judged)? };
    Ok(in_full.unwrap_or(judged))
}

/// What acts on few impacts alone (friction, of which only balls that slide tell) makes their numbers outlying; with little weight these hide it. So a
/// model that no test faults is asked again with outlying numbers in full weight. What that finds is believed where it takes the excess away
/// that those numbers make on impacts held out: wrong numbers follow no formula.
fn with_outliers_kept(
    library: &dyn Library,
    observations: &Observations,
    options: &DiagnoseOptions,
    first: &Diagnosis,
) -> Result<Option<Diagnosis>, ValidationError> {
    let odd: BTreeSet<&str> = first.outliers.iter().map(|o| o.id.as_str()).collect();
    if odd.len() < FEWEST_ODD || observations.keeps_outliers {
        return Ok(None);
    }
    let mut second = diagnose_as_given(library, &Observations { keeps_outliers: true, ..observations.clone() }, options)?;
    let after = match second.verdict {
        Verdict::Adequate => None,
        Verdict::EffectMissing => second.with_recommended().map(|(error, _)| error),
        Verdict::Unexplained => second.suggested_expression.as_ref().map(|e| e.heldout_error_after),
    };
    let excess = |error: f64| (error.powi(2) - second.noise_floor.powi(2)).max(0.0);
    let before = excess(second.heldout_error);
    if !after.is_some_and(|after| before > 0.0 && share_removed(before, excess(after)) >= SHARE) {
        return Ok(None);
    }
    second.notes.insert(
        0,
        format!(
            "where outlying numbers keep little weight nothing is found missing; with their full weight, as here, something is that accounts for them ({} impacts have such numbers)",
            odd.len()
        ),
    );
    let told: Vec<String> = first.notes.iter().filter(|note| !second.notes.contains(note)).cloned().collect();
    second.notes.extend(told);
    second.outliers.clone_from(&first.outliers);
    Ok(Some(second))
}

/// Candidates of an adequate model: listed by score, with what little probability they have.
fn listed_only(library: &dyn Library, screening: &Screening, before: f64, c: f64) -> Vec<CandidateReport> {
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
            let sds = screening.strength_sds(s, c);
            CandidateReport {
                effect: outline.name.clone(),
                probability: odds / (1.0 + odds),
                heldout_error_before: before,
                heldout_error_after: before,
                parameters: outline
                    .strengths
                    .iter()
                    .zip(s.strengths.iter().zip(sds))
                    .map(|(t, (by, sd))| (t.parameter.clone(), Estimate { value: t.absent + by, sd: t.typical * sd }))
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

/// Puts fitted parameters and held-out errors in the place of the approximate ones of the first candidates; one that leaves an impact without an
/// answer stays as it is.
fn refit_first(case: &Case, candidates: &mut [CandidateReport]) {
    let reference = case.reference(case.structure.noise_scale);
    candidates.par_iter_mut().take(REFITTED).for_each(|candidate| {
        let Some(screened) = case.screening.of(case.library, &candidate.effect) else { return };
        let Ok((forward, fit)) = reference.fit_with(&[&candidate.effect], &screened.strengths) else { return };
        let Ok(after) = held_out_error(forward.as_ref(), &fit, case.observations) else { return };
        candidate.parameters = estimates(&added_parameters(forward.as_ref(), &fit, reference.base.values.len(), reference.c));
        candidate.heldout_error_after = after;
        candidate.refitted = true;
    });
}

/// The fit of the current model, for commands that write it out.
pub fn fit_current(library: &dyn Library, observations: &Observations) -> Result<Fit, ValidationError> {
    fit(library.current(), observations, &observations.side(false), &FitOptions::default(), None)
}
