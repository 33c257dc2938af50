//! The procedure: is anything missing, what, and how sure is that?

use super::comparison::{note_noise, outliers, parameter_values, session_offsets, summarise, varied_inputs};
use super::diagnosis::{CandidateReport, Diagnosis, Estimate, NotVisible, Together, Verdict};
use super::error::ValidationError;
use super::expression::{Found, find_expression, local_spot};
use super::fit::{Fit, FitOptions, fit};
use super::forward::Library;
use super::heldout::{error_of, is_noise_alone, is_shared_error, is_worth, linearise_held_out, log_evidence_of};
use super::observation::Observations;
use super::place::places;
use super::present::Present;
use super::project::Nuisance;
use super::rank::{Reference, Refit, added_parameters, flexible_nuisance, form_overdispersion, gain_over};
use super::refits::{FIRST_LEVEL, LARGEST_NOISE_SCALE, LOG_ODDS, PRIOR, Refits, estimates, excess_at, share_removed};
use super::screen::{Screening, screen_beyond};
use super::structure::{p_text, structure_test};
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
/// Share of the excess that a catalogue effect must take away to be called missing.
pub const SHARE: f64 = 0.75;
/// Log evidence of a formula, or of an effect, that the error on held-out impacts alone does not show.
const CONVINCING: f64 = 10.0;
/// Chi-square by which a formula must beat the named effect, its search paid for, to put the name in doubt.
const FAR_MORE: f64 = 10.0;
/// When nothing is missing, all candidates together are no more likely than that.
const ALL_CANDIDATES: f64 = 0.5;
/// Fall of the held-out impacts' chi-square that an effect beside those already in the model must bring (odds of seven to one), on
/// top of what choosing it among the catalogue is worth: what the first one's form leaves is imitated in part by some other.
const WORTH_A_FURTHER_EFFECT: f64 = 4.0;
/// What is left of an effect's probability when the held-out impacts refuse it.
const REFUSED: f64 = 0.3;

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
    let present = Present::of(library);
    let c_screen = structure.noise_scale_for_screening();
    let nuisance = if present.is_empty() { Nuisance::of(&base) } else { flexible_nuisance(library.current(), &base, observations, &seen, &present.strengths)? };
    let screening = screen_beyond(library, &base, &seen, c_screen, &nuisance, None)?;
    let spot = local_spot(&Reference { library, observations, impacts: &seen, base: &base, c: c_screen, seed: options.seed }, &nuisance);
    let held_base = linearise_held_out(library.current(), &base, observations, &held)?;
    let before = error_of(&held_base);
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
        spot_p_value: spot.map_or(1.0, |s| s.p_value),
        false_alarm_rate: FALSE_ALARM_RATE,
        not_visible: not_visible(library, &screening),
        parameters: parameter_values(library.current(), &base, c),
        outliers: outliers(&seen, &base.impacts, &held, &held_base),
        session_offsets: session_offsets(observations, &base, c),
        words: Vec::new(),
        notes: observations.notes.clone(),
        model: options.model.clone(),
        seed: options.seed,
        provenance: None,
        structure,
    };
    let one_place = diagnosis.spot_p_value < SPOT_LEVEL;
    let alarm = screening.library_p_value < LIBRARY_LEVEL || diagnosis.structure.p_value < STRUCTURE_LEVEL || one_place;
    if !alarm {
        diagnosis.candidates = listed_only(library, &screening, before);
        less_likely_than_nothing(&mut diagnosis.candidates);
        note_noise(diagnosis.noise_floor, true, &mut diagnosis.notes);
        diagnosis.words = verdict_words(&diagnosis);
        return Ok(diagnosis);
    }
    let mut reference = Reference { library, observations, impacts: &seen, base: &base, c, seed: options.seed };
    let refits = Refits::new(&mut reference, &screening, &diagnosis.structure, &held_base)?;
    let c = refits.c;
    // Noise may be misstated by half; what the best model leaves beyond that is not noise but something unexplained.
    let c_believed = c.min(LARGEST_NOISE_SCALE);
    let excess = excess_at(&diagnosis.structure, c_believed);
    let best_left = refits.all().map(|r| excess_at(&r.structure, c_believed)).fold(f64::INFINITY, f64::min);
    let overdispersion = if best_left.is_finite() { form_overdispersion(best_left, diagnosis.structure.rank) } else { 1.0 };
    let beyond_form = |r: &Refit| {
        let stands_out =
            |name: &String| screening.effects.iter().any(|s| library.effects()[s.effect].name == *name && s.p_value * (screening.tested as f64) < FIRST_LEVEL);
        present.is_empty() || r.effects.iter().all(stands_out)
    };
    let chosen = refits.choose(overdispersion).filter(|r| beyond_form(r));
    let imitated = match chosen {
        Some(r) => present.imitated_by(&r.effects, &reference, &diagnosis.structure, c_believed)?,
        None => None,
    };
    let chosen = if let (Some(r), Some((own, share))) = (chosen, imitated) {
        let share = 100.0 * share;
        diagnosis.notes.push(format!(
            "{} would fit what is left, but {} {own}, with which {share:.0} % of the excess is gone: more likely its form than a further effect",
            r.effects.join(" and "),
            if r.effects.len() == 1 { "imitates" } else { "imitate" }
        ));
        None
    } else {
        chosen
    };
    if !present.is_empty() && chosen.is_none() {
        diagnosis.notes.push("what is left looks like the form of the effects already in the model, not like a further effect of the catalogue".to_owned());
    }
    diagnosis.noise_floor = c.sqrt();
    diagnosis.places = places(&seen, &base.impacts, &varied_inputs(observations), c);
    let share = chosen.map_or(0.0, |b| share_removed(excess, excess_at(&b.structure, c_believed)));
    // A share has its own uncertainty: what is left scatters by its deviation, which may not make a right name wrong.
    let give = |left: f64| (left - (2.0 * diagnosis.structure.rank as f64 + 4.0 * left).sqrt()).max(0.0);
    let at_best = chosen.map_or(0.0, |b| share_removed(excess, give(excess_at(&b.structure, c_believed))));
    let forward = chosen.map(|b| library.with(&b.effects.iter().map(String::as_str).collect::<Vec<_>>())).transpose()?;
    let model = chosen.zip(forward.as_deref());
    let after = chosen.map_or(before, |b| error_of(&b.held_out));
    // On the held-out impacts the same is judged with less data and without the fit's help: either may speak for the effect.
    let held_share = share_removed((before.powi(2) - c_believed).max(0.0), (after.powi(2) - c_believed).max(0.0));
    let sound = |b: &Refit| b.structure.p_value >= STRUCTURE_LEVEL && b.structure.noise_scale <= LARGEST_NOISE_SCALE;
    let accounted = chosen.is_some_and(|b| at_best >= SHARE || held_share >= SHARE || sound(b));
    diagnosis.verdict = match (chosen, accounted) {
        (Some(_), true) => Verdict::EffectMissing,
        (None, _) if diagnosis.structure.p_value >= STRUCTURE_LEVEL && !one_place => Verdict::Adequate,
        _ => Verdict::Unexplained,
    };
    // The last word has the impacts the fit never saw: an effect that makes their error worse is not added.
    let mut for_formula = reference;
    let alone = if options.expressions && diagnosis.verdict != Verdict::Adequate {
        find_expression(&mut for_formula, &screening, |t, c| excess_at(t, c.min(LARGEST_NOISE_SCALE)), &diagnosis.structure)?
    } else {
        None
    };
    // What neither the catalogue nor the held-out impacts nor a formula speaks for is chance.
    let told_by_formula = alone.as_ref().is_some_and(|f| f.log_evidence > CONVINCING && f.suggestion.heldout_error_after < before);
    let told_otherwise = screening.library_p_value < LIBRARY_LEVEL;
    let smooth = diagnosis.structure.p_value < STRUCTURE_LEVEL;
    if diagnosis.verdict == Verdict::Unexplained
        && !told_otherwise
        && !told_by_formula
        && (!smooth || is_noise_alone(&held_base, &base, c.sqrt(), diagnosis.structure.residual_freedom))
    {
        diagnosis.verdict = Verdict::Adequate;
        diagnosis.notes.push(if smooth {
            format!(
                "the structure test alone rejects (p = {:.4}), but the error on held-out impacts is that of noise ({before:.3}, floor {:.3}): not believed",
                diagnosis.structure.p_value,
                c.sqrt()
            )
        } else {
            format!(
                "one place on the face alone stands out (p = {:.4}), but a model with it does not lower the error on held-out impacts: not believed",
                diagnosis.spot_p_value
            )
        });
    }
    let mut refused = None;
    if let (Some(best), Verdict::EffectMissing) = (chosen, diagnosis.verdict) {
        let price = WORTH_A_FURTHER_EFFECT + 2.0 * (screening.tested.max(1) as f64).ln();
        let against = after >= before && best.log_evidence / overdispersion + log_evidence_of(&held_base, &best.held_out, c, f64::INFINITY) < CONVINCING;
        if against || !present.is_empty() && !is_worth(price, &held_base, &best.held_out, c) {
            diagnosis.verdict = if diagnosis.structure.p_value >= STRUCTURE_LEVEL { Verdict::Adequate } else { Verdict::Unexplained };
            diagnosis.notes.push(format!(
                "{} would fit these impacts better, but the error on held-out impacts {} ({before:.3} to {after:.3}): not believed",
                best.effects.join(" and "),
                if after >= before { "does not fall" } else { "falls no more than by chance" }
            ));
            refused = Some(best.effects.clone());
        } else if after >= before {
            diagnosis.notes.push(format!(
                "the held-out impacts hardly meet {} (their error: {before:.3} to {after:.3}); it is named for what it explains in the others",
                best.effects.join(" and ")
            ));
        }
    }
    if diagnosis.verdict == Verdict::Unexplained && is_shared_error(observations, &diagnosis.structure, &base, &held_base) {
        diagnosis.verdict = Verdict::Adequate;
        diagnosis.notes.push(format!(
            "some structure is left (p = {}), but it adds less than a tenth to the error of the fit and nothing to that of held-out impacts ({before:.3}, floor {:.3}): not believed of shots that share a calibration",
            p_text(diagnosis.structure.p_value),
            c.sqrt()
        ));
    }
    // A name in any form of it against a formula: one that takes far more, and lowers the held-out error further, says that
    // the name is not it.
    let mut beside = None;
    if let (Some(best), Verdict::EffectMissing, Some(f), None) = (chosen, diagnosis.verdict, &alone, &refused) {
        let gain = gain_over(&base, &best.fit, for_formula.c);
        if gain < SHARE * f.honest_gain && f.honest_gain - gain > FAR_MORE && f.suggestion.heldout_error_after < after {
            let form = form_beside(&for_formula, best, &screening, &diagnosis.structure)?;
            let named = log_evidence_over_at(&base, best, for_formula.c) + form.as_ref().map_or(0.0, |b| b.log_evidence);
            if named + LOG_ODDS < f.log_evidence {
                diagnosis.verdict = Verdict::Unexplained;
                diagnosis.notes.push(format!(
                    "{} fits, but takes only {:.0} % of what a formula takes, and no other form of it does as well",
                    best.effects.join(" and "),
                    100.0 * gain / f.honest_gain
                ));
            }
            beside = form;
        }
    }
    diagnosis.candidates = refits.report(&reference, &screening, before, excess, overdispersion, diagnosis.verdict)?;
    for c in diagnosis.candidates.iter_mut().filter(|c| refused.as_ref().is_some_and(|r| r.contains(&c.effect))) {
        c.probability *= REFUSED;
    }
    diagnosis
        .candidates
        .sort_by(|a, b| b.probability.total_cmp(&a.probability).then(b.log_evidence_gain.total_cmp(&a.log_evidence_gain)).then(a.effect.cmp(&b.effect)));
    if diagnosis.verdict == Verdict::Adequate {
        less_likely_than_nothing(&mut diagnosis.candidates);
    }
    if let Some((best, forward)) = model.filter(|_| refused.is_none()) {
        diagnosis.structure_after = Some(best.structure.clone());
        if diagnosis.verdict == Verdict::EffectMissing {
            diagnosis.recommended = best.effects.clone();
        }
        if best.effects.len() > 1 {
            diagnosis.together = Some(Together {
                effects: best.effects.clone(),
                probability: refits.probability_of(best, overdispersion),
                heldout_error_before: before,
                heldout_error_after: after,
                log_evidence_gain: best.log_evidence,
                share_removed: share,
                parameters: estimates(&added_parameters(forward, &best.fit, base.values.len(), c)),
            });
        }
        diagnosis.outliers = outliers(&seen, &best.fit.impacts, &held, &best.held_out);
    }
    let form_is_off = chosen.filter(|_| refused.is_none()).is_some_and(|b| b.structure.p_value < STRUCTURE_LEVEL);
    if options.expressions && (diagnosis.verdict == Verdict::Unexplained || (diagnosis.verdict == Verdict::EffectMissing && form_is_off)) {
        let catalogue = chosen.map_or(0.0, |b| log_evidence_over_at(&base, b, for_formula.c));
        let alone = alone.filter(|f| diagnosis.verdict == Verdict::Unexplained || f.log_evidence > catalogue + LOG_ODDS);
        if let (Some(b), None, None) = (chosen, &refused, &beside) {
            beside = form_beside(&for_formula, b, &screening, &diagnosis.structure)?;
        }
        let beside = beside.filter(|f| f.suggestion.heldout_error_after < after.min(before));
        // The effect with its form mended, when that says more than a formula in the effect's place.
        let best = match (alone, beside) {
            (Some(a), Some(b)) => Some(if catalogue + b.log_evidence > a.log_evidence + LOG_ODDS { b } else { a }),
            (a, b) => a.or(b),
        };
        if let Some(found) = best {
            diagnosis.noise_floor = diagnosis.noise_floor.min(found.structure.noise_scale.sqrt()).min(for_formula.c.sqrt());
            diagnosis.suggested_expression = Some(found.suggestion);
        }
    }
    if diagnosis.verdict == Verdict::EffectMissing && form_is_off {
        diagnosis.other_form = diagnosis.recommended.first().cloned();
    }
    if diagnosis.verdict != Verdict::Adequate
        && refused.is_none()
        && let Some(why) = refits.refused_pair()
    {
        diagnosis.notes.push(why);
    }
    let at_the_floor = diagnosis.heldout_error < 1.1 * diagnosis.noise_floor;
    let sound = at_the_floor || (chosen.is_none_or(|b| b.structure.p_value >= STRUCTURE_LEVEL) && diagnosis.verdict != Verdict::Unexplained);
    note_noise(diagnosis.noise_floor, sound || diagnosis.suggested_expression.is_some(), &mut diagnosis.notes);
    // Names that take nothing away are not worth an experiment.
    if diagnosis.verdict == Verdict::EffectMissing {
        diagnosis.next_experiments = refits.next_experiments(&reference, &diagnosis.candidates)?;
    }
    diagnosis.words = verdict_words(&diagnosis);
    Ok(diagnosis)
}

/// An adequate model is the likeliest: its candidates share what probability that leaves.
fn less_likely_than_nothing(candidates: &mut [CandidateReport]) {
    let sum: f64 = candidates.iter().map(|c| c.probability).sum();
    if sum > ALL_CANDIDATES {
        candidates.iter_mut().for_each(|c| c.probability *= ALL_CANDIDATES / sum);
    }
}

/// An expression that mends the form of the chosen effects, found from what they leave.
fn form_beside(
    reference: &Reference,
    chosen: &Refit,
    screening: &Screening,
    before: &super::structure::StructureTest,
) -> Result<Option<Found>, ValidationError> {
    let names: Vec<&str> = chosen.effects.iter().map(String::as_str).collect();
    let library = reference.library.extended(&names, &chosen.fit.values)?;
    let mut beside = Reference {
        library: library.as_ref(),
        observations: reference.observations,
        impacts: reference.impacts,
        base: &chosen.fit,
        c: reference.c,
        seed: reference.seed,
    };
    let found = find_expression(&mut beside, screening, |t, c| excess_at(t, c.min(LARGEST_NOISE_SCALE)), before)?;
    let shared = reference.base.values.len();
    let with = reference.library.with(&names)?;
    Ok(found.filter(|f| f.log_evidence > LOG_ODDS).map(|mut f| {
        f.suggestion.words = format!("with {} in the model, {}", names.join(" and "), f.suggestion.words);
        f.suggestion.model_file_text =
            format!("{}{}", effects_text(&added_parameters(with.as_ref(), &chosen.fit, shared, reference.c)), f.suggestion.model_file_text);
        f
    }))
}

/// Catalogue effects as a model file holds them.
fn effects_text(parameters: &[(String, f64, f64)]) -> String {
    let mut text = String::new();
    let mut last = "";
    for (name, value, _) in parameters {
        let Some((effect, parameter)) = name.split_once('.') else { continue };
        if effect != last {
            text.push_str(&format!("{}[effects.{effect}]\n", if last.is_empty() { "" } else { "\n" }));
            last = effect;
        }
        text.push_str(&format!("{parameter} = {{ value = {}, fit = true }}\n", super::terminal::short(*value)));
    }
    if !text.is_empty() {
        text.push('\n');
    }
    text
}

fn log_evidence_over_at(base: &Fit, refit: &Refit, c: f64) -> f64 {
    super::rank::log_evidence_over(base, &refit.fit, c, 0)
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
