//! An expression found from the residuals, when the catalogue's effects will not do or have another form.
//!
//! All pairs of a channel and a feature are scored at once (nuisance projected out), the best refitted in the full model,
//! then up to two more terms of the same channel are added, each only if it gains more than its price; the constants are those
//! of the fit, in words rounded to two digits. A dead spot (a bump over the face) has a place and a width to find
//! ([`super::local_spot`]), a step its moment ([`super::step_in_order`]). (docs/diagnosis.md, "The formula".)

use super::carried_noise::noise_grows_by;
use super::diagnosis::{Estimate, SuggestedExpression};
use super::error::ValidationError;
use super::expression_terms::{CHANNELS, FEATURES, TermChannel, feature_inputs};
use super::fit::{Fit, FitOptions, Start, fit};
use super::forward::{Forward, OwnEffect};
use super::heldout::held_out_error;
use super::local_spot::{LocalSpot, strongest_spot};
use super::predicted::difference;
use super::project::{Nuisance, TOLD, project_out};
use super::rank::{Reference, gain_over, log_evidence_over};
use super::screen::Screening;
use super::step_in_order::{StepInOrder, strongest_step};
use super::structure::{ContactInputs, StructureTest, structure_test, swings_in_order};
use crate::impact_table::{OwnColumn, OwnColumns};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use std::collections::{BTreeMap, BTreeSet};

/// Single terms refitted.
const REFITTED: usize = 6;
/// Columns of the user's own that a formula may rest on.
const MOST_COLUMN_FEATURES: usize = 8;
/// Most that a formula may take of a mass, an inertia or a radius; and, as a share of the racket's mass, from a hand that has none.
const LARGEST_LOSS: f64 = 0.8;
const LARGEST_HAND_LOSS: f64 = 0.02;
/// Most that the noise of a prediction and its measurement may grow by, as a variance: 1.2 in seventy sound formulae, 1.8 and more where a formula's
/// own noise stood for what was missing.
const MOST_NOISE: f64 = 1.5;
/// Step of a channel's signature, as a share of its typical strength.
const STEP: f64 = 0.05;
/// The first term must gain this much in chi-square, five deviations: it is chosen among some 2000 pairs.
const FIRST_GAIN: f64 = 25.0;
/// Terms of one expression at most.
const MOST_TERMS: usize = 3;
/// A further term must gain this much in chi-square (its price among some fifty features is about 8) ...
const FURTHER_GAIN: f64 = 14.0;
/// ... and this share of what the terms before it have gained.
const FURTHER_SHARE: f64 = 0.02;
/// Name of the effect in the model file: a model holds one found formula at most.
pub const FOUND_EFFECT: &str = "found-effect";
/// A formula must lower the chi-square of the held-out impacts by this much to be added unasked: it was chosen among thousands.
pub const WORTH_A_FORMULA: f64 = 14.0;

/// A term: its channel, the feature as text, and in words.
#[derive(Clone)]
struct Term {
    channel: usize,
    feature: String,
    words: String,
    /// k of the linear score.
    strength: f64,
    gain: f64,
}

/// An expression fitted to the data.
pub struct Found {
    pub suggestion: SuggestedExpression,
    pub fit: Fit,
    pub structure: StructureTest,
    pub log_evidence: f64,
    /// Fall in minus twice the log posterior, less the price of having looked among all terms for each of those kept.
    pub honest_gain: f64,
    pub goes_with_order: bool,
}

/// The whitened derivative of the prediction with respect to k of a channel with feature 1, at the base fit. `None` when the
/// base does not hold that quantity.
fn channel_signature(reference: &Reference, channel: &TermChannel) -> Option<Vec<DVector<f64>>> {
    let effect = own_effect(reference, channel, &["1".to_owned()]);
    let forward = reference.library.with_expression(&[], &[effect]).ok()?;
    signature_of_last(reference, forward.as_ref(), reference.base, channel)
}

/// The whitened derivative of the prediction at `fit` with respect to the one constant that `forward` has beyond it: a channel's k.
fn signature_of_last(reference: &Reference, forward: &dyn Forward, fit: &Fit, channel: &TermChannel) -> Option<Vec<DVector<f64>>> {
    let h = STEP * channel.typical;
    let (mut up, mut down) = (fit.values.clone(), fit.values.clone());
    up.push(h);
    down.push(-h);
    debug_assert_eq!(forward.parameters().len(), up.len());
    let (above, below) = (forward.prepare(&up).ok()?, forward.prepare(&down).ok()?);
    let moved = difference(above.as_ref(), below.as_ref(), reference.impacts, &fit.impacts);
    Some(moved.into_iter().zip(&fit.impacts).map(|(d, l)| &l.whitener * d / (2.0 * h)).collect())
}

fn own_effect(reference: &Reference, channel: &TermChannel, features: &[String]) -> OwnEffect {
    let names: Vec<String> = (0..features.len()).map(|i| if features.len() == 1 { "k".to_owned() } else { format!("k{}", i + 1) }).collect();
    let terms: Vec<(String, String)> = names.iter().cloned().zip(features.iter().cloned()).collect();
    OwnEffect {
        name: free_name(reference, FOUND_EFFECT),
        replaces: channel.replaces.to_owned(),
        expression: channel.expression(&terms),
        parameters: names.into_iter().map(|n| (n, channel.typical)).collect(),
    }
}

/// The name, or with the first number that makes it one the model does not have: a formula may be looked for beside an earlier one.
fn free_name(reference: &Reference, name: &str) -> String {
    let numbered = (2..).map(|i| format!("{name}-{i}"));
    std::iter::once(name.to_owned()).chain(numbered).find(|n| !reference.library.has_effect(n)).unwrap_or_default()
}

/// A column of the user's own that tells where the model fails, as a feature: about its middle, in units of half its range.
struct ColumnFeature {
    column: String,
    middle: f64,
    half_range: f64,
}

impl ColumnFeature {
    /// `None` where an impact has no number there, or its name is none an expression can hold.
    fn of(reference: &Reference, column: &str) -> Option<Self> {
        let nameable = !column.is_empty() && column.chars().all(|c| c.is_ascii_alphanumeric() || c == '_');
        let at = OwnColumn::named(column);
        let (low, high) = reference.observations.impacts.iter().map(|o| o.own.get(at)).fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| {
            if v.is_nan() {
                (f64::NAN, f64::NAN)
            } else if low.is_nan() {
                (low, high)
            } else {
                (low.min(v), high.max(v))
            }
        });
        // Two digits of the range: people write such a formula down.
        let half_range = rounded(0.5 * (high - low));
        let step = 10f64.powf(half_range.abs().log10().floor() - 1.0);
        let middle = (0.5 * (high + low) / step).round() * step;
        (nameable && half_range > 0.0 && half_range.is_finite()).then(|| ColumnFeature { column: column.to_owned(), middle: tidy(middle), half_range })
    }

    /// Linear and squared, as the model file has it and in words.
    fn names(&self) -> [(String, String); 2] {
        let ColumnFeature { column, middle, half_range } = self;
        let sign = if *middle < 0.0 { '+' } else { '-' };
        let linear = format!("((column.{column} {sign} {}) / {half_range})", middle.abs());
        let squared = format!("{linear}^2");
        [(linear, format!("with the table's column `{column}`")), (squared, format!("away from the middle of the table's column `{column}`"))]
    }

    fn values(&self, own: &OwnColumns) -> [f64; 2] {
        let v = (own.get(OwnColumn::named(&self.column)) - self.middle) / self.half_range;
        [v, v * v]
    }
}

/// A number without what its computation left in the last digits.
fn tidy(value: f64) -> f64 {
    format!("{value:.6e}").parse().unwrap_or(value)
}

/// The features of a table: those of every table, what goes with speed along and across the face, swings with the order of its
/// impacts, then its own columns by whose groups the model fails.
struct TableFeatures {
    /// As the model file has it, and in words.
    names: Vec<(String, String)>,
    /// Impacts × features; one that does not vary (but 1) is all zero.
    values: DMatrix<f64>,
}

impl TableFeatures {
    fn of(reference: &Reference) -> Self {
        let n = reference.impacts.len();
        // Written with three digits, and meant so.
        let angles: Vec<f64> = swings_in_order(reference.impacts).iter().map(|a| format!("{a:.2e}").parse().unwrap_or(*a)).collect();
        let mut names: Vec<(String, String)> = FEATURES.iter().map(|f| (f.text.to_owned(), f.words.to_owned())).collect();
        // Around the table's own speed: what goes with speed and place is not to be hidden by what goes with place alone.
        let speeds = reference.impacts.iter().zip(&reference.base.impacts);
        let speeds = speeds.map(|(o, l)| ContactInputs::of(&l.true_inputs, &reference.observations.gear[o.gear]).approach_m_s);
        let middle_m_s = (speeds.sum::<f64>() / n.max(1) as f64).round();
        for (place, words) in [
            ("impact_x / half_length", "toward the handle, the other way for slow impacts"),
            ("impact_y / half_width", "toward marker 3, the other way for slow impacts"),
        ] {
            names.push((format!("((approach_speed - {middle_m_s}) / 25) * ({place})"), words.to_owned()));
        }
        names.extend(angles.iter().map(|a| {
            let period = 2.0 * std::f64::consts::PI / a;
            (format!("cos({a} * order)"), format!("in waves of {period:.0} impacts"))
        }));
        // Those by whose groups the model fails first; the others may tell as well what seems to go with the order.
        let failing = reference.groups.iter().map(|g| g.column.as_str());
        let others = reference.impacts.first().into_iter().flat_map(|o| o.groups.keys()).map(String::as_str);
        let mut columns: Vec<&str> = failing.chain(others).collect();
        let mut met = BTreeSet::new();
        columns.retain(|column| met.insert(*column));
        let own: Vec<ColumnFeature> = columns.into_iter().filter_map(|column| ColumnFeature::of(reference, column)).take(MOST_COLUMN_FEATURES).collect();
        names.extend(own.iter().flat_map(ColumnFeature::names));
        let mut values = DMatrix::zeros(n, names.len());
        let inputs = feature_inputs(reference.base, reference.observations, reference.impacts);
        for (i, (o, inputs)) in reference.impacts.iter().zip(&inputs).enumerate() {
            let row = FEATURES.iter().map(|f| (f.value)(inputs)).chain(inputs.speed_times_place(middle_m_s)).chain(angles.iter().map(|a| (a * o.order).cos()));
            let row = row.chain(own.iter().flat_map(|column| column.values(&o.own)));
            row.enumerate().for_each(|(j, value)| values[(i, j)] = value);
        }
        for j in 1..names.len() {
            let column = values.column(j);
            if !(column.variance().sqrt() > 1e-6 * (1.0 + column.amax())) {
                values.column_mut(j).fill(0.0);
            }
        }
        TableFeatures { names, values }
    }
}

/// All terms by their score, best first.
fn score_terms(reference: &Reference, features: &TableFeatures) -> Vec<Term> {
    let signatures: Vec<_> = CHANNELS.par_iter().map(|c| channel_signature(reference, c)).collect();
    let nuisance = Nuisance::of(reference.base);
    let mut terms: Vec<Term> = signatures
        .par_iter()
        .enumerate()
        .map(|(c, channel)| {
            let Some(channel) = channel else { return Vec::new() };
            let mut found = terms_of(reference, &nuisance, channel, features, c);
            found.extend(strongest_step(reference, &nuisance, channel).map(|s| step_term(&s, c)));
            if CHANNELS[c].replaces == "restitution" {
                found.extend(strongest_spot(reference, &nuisance, channel).map(|s| spot_term(&s, c)));
            }
            found
        })
        .collect::<Vec<_>>()
        .into_iter()
        .flatten()
        .collect();
    terms.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    terms
}

fn terms_of(reference: &Reference, nuisance: &Nuisance, channel: &[DVector<f64>], features: &TableFeatures, c: usize) -> Vec<Term> {
    let blocks: Vec<DMatrix<f64>> = channel.iter().enumerate().map(|(i, g)| g * features.values.row(i)).collect();
    let projected = project_out(reference.base, nuisance, &blocks);
    (0..features.names.len())
        .filter(|&j| projected.keeps_more_than(TOLD, j))
        .map(|j| {
            let strength = projected.score[j] / projected.information[(j, j)];
            let gain = projected.score[j] * strength / reference.c;
            let (feature, words) = features.names[j].clone();
            Term { channel: c, feature, words, strength, gain }
        })
        .collect()
}

/// The strongest step in the order of the impacts as a term.
fn step_term(step: &StepInOrder, channel: usize) -> Term {
    Term {
        channel,
        feature: format!("step(order - {})", step.after),
        // People count from one.
        words: format!("from impact {:.0} on, in the order they were recorded", step.first + 1.0),
        strength: step.strength,
        // One number was chosen to get it.
        gain: step.gain - 6.0,
    }
}

/// The strongest place on the face as a term.
fn spot_term(spot: &LocalSpot, channel: usize) -> Term {
    let (a, b, w) = (spot.along_m, spot.across_m, spot.half_width_m);
    let from = |name: &str, at: f64| format!("{name} {} {:.3}", if at < 0.0 { '+' } else { '-' }, at.abs());
    Term {
        channel,
        feature: format!("exp(-(({})^2 + ({})^2) / {w}^2)", from("impact_x", a), from("impact_y", b)),
        words: format!("near one place on the face ({:.0} mm along, {:.0} mm across, within {:.0} mm)", 1e3 * a, 1e3 * b, 1e3 * w),
        strength: spot.strength,
        // Three numbers were chosen to get it.
        gain: spot.gain - 12.0,
    }
}

/// The place on the face whose rebound stands out most, beside what `nuisance` can absorb. `None` when the base has no
/// restitution to change, or no place holds enough impacts.
pub fn local_spot(reference: &Reference, nuisance: &Nuisance) -> Option<LocalSpot> {
    let channel = CHANNELS.iter().find(|c| c.replaces == "restitution")?;
    let signature = channel_signature(reference, channel)?;
    strongest_spot(reference, nuisance, &signature)
}

struct Fitted {
    effect: OwnEffect,
    fit: Fit,
    log_evidence: f64,
}

/// Whether a quantity with these terms stays one that nature has in all impacts: no mass, inertia or radius of next to nothing, no hand that takes mass
/// away. What no table's feature tells (a step, a place) passes.
fn is_possible(reference: &Reference, table: &TableFeatures, channel: &TermChannel, features: &[String], k: &[f64]) -> bool {
    let least = match channel.replaces {
        "racket_mass" | "ball_mass" | "twist_inertia" | "swing_inertia" | "ball_inertia" | "ball_arm" => -LARGEST_LOSS,
        "hand_mass" if !reference.library.has_effect("hand-mass") => -LARGEST_HAND_LOSS,
        _ => return true,
    };
    let place = |feature: &String| table.names.iter().position(|(text, _)| text == feature);
    let Some(columns) = features.iter().map(place).collect::<Option<Vec<_>>>() else { return true };
    (0..table.values.nrows()).all(|i| columns.iter().zip(k).map(|(j, k)| k * table.values[(i, *j)]).sum::<f64>() >= least)
}

fn refit(reference: &Reference, table: &TableFeatures, channel: &TermChannel, features: &[String], start: &[f64]) -> Option<Fitted> {
    let effect = own_effect(reference, channel, features);
    let forward = reference.library.with_expression(&[], std::slice::from_ref(&effect)).ok()?;
    let mut values = reference.base.values.clone();
    values.extend(start.iter().map(|k| k.clamp(-5.0 * channel.typical, 5.0 * channel.typical)));
    let options = FitOptions { start_values: Some(values), ..FitOptions::default() };
    let begin = Start { fit: reference.base, keep_jacobians: forward.costly() };
    let fitted = fit(forward.as_ref(), reference.observations, reference.impacts, &options, Some(begin)).ok()?;
    let possible = is_possible(reference, table, channel, features, &fitted.values[reference.base.values.len()..]);
    if !possible || noise_grows_by(reference.base, &fitted, reference.impacts) > MOST_NOISE {
        return None;
    }
    let log_evidence = log_evidence_over(reference.base, &fitted, reference.c, 0);
    Some(Fitted { effect, fit: fitted, log_evidence })
}

/// Looks for the best expression. `None` when no term stands out (a gain of 25, five deviations, among some 2000 pairs).
pub fn find_expression(
    reference: &mut Reference,
    screening: &Screening,
    excess: impl Fn(&StructureTest, f64) -> f64,
    before: &StructureTest,
) -> Result<Option<Found>, ValidationError> {
    let features = TableFeatures::of(reference);
    let terms = score_terms(reference, &features);
    let candidates: Vec<&Term> = terms.iter().filter(|t| t.gain > FIRST_GAIN).take(REFITTED).collect();
    let fixed = &*reference;
    let singles: Vec<(usize, Fitted)> = candidates
        .par_iter()
        .enumerate()
        .map(|(i, t)| refit(fixed, &features, &CHANNELS[t.channel], std::slice::from_ref(&t.feature), &[t.strength]).map(|f| (i, f)))
        .collect::<Vec<_>>()
        .into_iter()
        .flatten()
        .collect();
    let Some((first, mut best)) = singles.into_iter().max_by(|a, b| a.1.log_evidence.total_cmp(&b.1.log_evidence)) else { return Ok(None) };
    let channel = &CHANNELS[candidates[first].channel];
    let mut chosen: Vec<Term> = vec![candidates[first].clone()];
    // Further terms of the same channel, by refits of those that score best beside it at the base fit.
    while chosen.len() < MOST_TERMS {
        let more: Vec<&Term> = terms.iter().filter(|t| t.channel == chosen[0].channel && chosen.iter().all(|c| c.feature != t.feature)).collect();
        let tried: Vec<(Term, Fitted)> = further(fixed, &features, &best, &chosen, &more)
            .into_par_iter()
            .filter_map(|t| {
                let mut names: Vec<String> = chosen.iter().map(|c| c.feature.clone()).collect();
                names.push(t.feature.clone());
                let mut start: Vec<f64> = best.fit.values[fixed.base.values.len()..].to_vec();
                start.push(t.strength);
                refit(fixed, &features, channel, &names, &start).map(|f| (t, f))
            })
            .collect();
        let Some((term, next)) = tried.into_iter().max_by(|a, b| a.1.log_evidence.total_cmp(&b.1.log_evidence)) else { break };
        let gained = 2.0 * (next.log_evidence - best.log_evidence);
        if gained < FURTHER_GAIN || gained < FURTHER_SHARE * 2.0 * best.log_evidence {
            break;
        }
        chosen.push(term);
        best = next;
    }
    let structure = structure_test(&best.fit, reference.observations, reference.impacts, reference.beside_smooth(), reference.seed);
    reference.c = reference.c.min(structure.noise_scale);
    let c = reference.c;
    let log_evidence = log_evidence_over(reference.base, &best.fit, c, 0);
    let forward = reference.library.with_expression(&[], std::slice::from_ref(&best.effect))?;
    let shared = reference.base.values.len();
    let constants: Vec<(String, f64, f64)> =
        best.effect.parameters.iter().enumerate().map(|(i, (name, _))| (name.clone(), best.fit.values[shared + i], best.fit.sd(shared + i, c))).collect();
    // A formula that leaves an impact without an answer is none.
    let Ok(heldout_error_after) = held_out_error(forward.as_ref(), &best.fit, reference.observations) else { return Ok(None) };
    let (before_excess, after_excess) = (excess(before, c), excess(&structure, c));
    let suggestion = SuggestedExpression {
        replaces: channel.replaces.to_owned(),
        expression: with_numbers(&best.effect.expression, &constants),
        heldout_error_after,
        nearest: nearest(reference, screening, channel, &chosen)?,
        parameters: constants.iter().map(|(n, value, sd)| (n.clone(), Estimate { value: *value, sd: *sd })).collect::<BTreeMap<_, _>>(),
        share_removed: if before_excess > 0.0 { (1.0 - after_excess / before_excess).clamp(0.0, 1.0) } else { 0.0 },
        log_evidence_gain: log_evidence,
        words: in_words(channel, &chosen, &constants),
        model_file_text: model_file_text(&best.effect, &constants),
    };
    let honest_gain = gain_over(reference.base, &best.fit, c) - chosen.len() as f64 * 2.0 * ((CHANNELS.len() * features.names.len()) as f64).ln();
    let goes_with_order = reference.adds_what_goes_with_order(forward.as_ref(), &best.fit)?;
    Ok(Some(Found { suggestion, fit: best.fit, structure, log_evidence, honest_gain, goes_with_order }))
}

/// The three terms that score best at the fit that already has the chosen ones.
fn further(reference: &Reference, features: &TableFeatures, best: &Fitted, chosen: &[Term], more: &[&Term]) -> Vec<Term> {
    let Some(first) = chosen.first() else { return Vec::new() };
    let channel = &CHANNELS[first.channel];
    // The derivative of the first term's constant carries the channel's response at this fit; others are in proportion.
    let bare = own_effect(reference, channel, &["1".to_owned()]);
    let own = OwnEffect { name: free_name(reference, "found-further"), ..bare };
    let Ok(forward) = reference.library.with_expression(&[], &[best.effect.clone(), own]) else { return Vec::new() };
    let Some(signature) = signature_of_last(reference, forward.as_ref(), &best.fit, channel) else { return Vec::new() };
    let blocks: Vec<DMatrix<f64>> = signature.iter().enumerate().map(|(i, g)| g * features.values.row(i)).collect();
    let projected = project_out(&best.fit, &Nuisance::of(&best.fit), &blocks);
    let mut found: Vec<Term> = more
        .iter()
        .filter_map(|t| {
            let j = features.names.iter().position(|(text, _)| *text == t.feature)?;
            let information = projected.information[(j, j)];
            projected.keeps_more_than(TOLD, j).then(|| Term {
                strength: projected.score[j] / information,
                gain: projected.score[j].powi(2) / information / reference.c,
                ..(*t).clone()
            })
        })
        .filter(|t| t.gain > FURTHER_GAIN)
        .collect();
    found.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    found.truncate(3);
    found
}

/// Catalogue effects whose signature is most like the expression's, best first: cosine above 0.5, at most three.
fn nearest(reference: &Reference, screening: &Screening, channel: &TermChannel, chosen: &[Term]) -> Result<Vec<String>, ValidationError> {
    let features: Vec<String> = chosen.iter().map(|t| t.feature.clone()).collect();
    let effect = own_effect(reference, channel, &features);
    let forward = reference.library.with_expression(&[], &[effect])?;
    let mut values = reference.base.values.clone();
    values.extend(chosen.iter().map(|t| t.strength));
    let mut absent = reference.base.values.clone();
    absent.extend(chosen.iter().map(|_| 0.0));
    let (with, without) = (forward.prepare(&values)?, forward.prepare(&absent)?);
    let moved = difference(with.as_ref(), without.as_ref(), reference.impacts, &reference.base.impacts);
    let signature: Vec<DMatrix<f64>> = moved.into_iter().zip(&reference.base.impacts).map(|(d, l)| DMatrix::from_columns(&[&l.whitener * d])).collect();
    let cosines = super::screen::cosines_with(reference.library, reference.base, reference.impacts, &signature)?;
    let mut near: Vec<(f64, &str)> = screening
        .effects
        .iter()
        .filter(|s| s.hidden_because.is_none())
        .filter_map(|s| cosines.iter().find(|(e, _)| *e == s.effect).map(|(e, cos)| (*cos, reference.library.effects()[*e].name.as_str())))
        .filter(|(cos, _)| *cos > 0.5)
        .collect();
    near.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(b.1)));
    Ok(near.into_iter().take(3).map(|(_, n)| n.to_owned()).collect())
}

/// Two significant digits.
fn rounded(value: f64) -> f64 {
    format!("{value:.1e}").parse().unwrap_or(value)
}

/// The expression with its constants as numbers, to two digits.
fn with_numbers(expression: &str, constants: &[(String, f64, f64)]) -> String {
    // Longest names first, whole words only.
    let mut text = expression.to_owned();
    for (name, value, _) in constants.iter().rev() {
        let number = rounded(*value);
        let shown = if number < 0.0 { format!("({number})") } else { format!("{number}") };
        let words: Vec<String> = text
            .split(' ')
            .map(|w| {
                let bare = w.trim_start_matches('(');
                if bare == name {
                    format!("{}{}", &w[..w.len() - bare.len()], shown)
                } else if bare == format!("{name})") {
                    format!("{}{shown})", &w[..w.len() - bare.len()])
                } else {
                    w.to_owned()
                }
            })
            .collect();
        text = words.join(" ");
    }
    text
}

fn model_file_text(effect: &OwnEffect, constants: &[(String, f64, f64)]) -> String {
    let mut text = format!("[effects.{}]\nexpression = \"{}\"\nreplaces = \"{}\"\n", effect.name, effect.expression, effect.replaces);
    for (name, value, _) in constants {
        text.push_str(&format!("{name} = {{ value = {}, fit = true }}\n", rounded(*value)));
    }
    text
}

/// "the normal restitution falls with the incoming spin across the face".
fn in_words(channel: &TermChannel, chosen: &[Term], constants: &[(String, f64, f64)]) -> String {
    let parts: Vec<String> = chosen
        .iter()
        .zip(constants)
        .map(|(t, (_, k, _))| {
            format!(
                "{} {}",
                match (t.feature.as_str(), *k < 0.0) {
                    ("1", true) => "is smaller than in the model,",
                    ("1", false) => "is larger than in the model,",
                    (_, true) => "falls",
                    (_, false) => "rises",
                },
                t.words
            )
        })
        .collect();
    format!("{} {}", channel.words, parts.join(" and "))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn truth_numbers_take_the_place_of_whole_names_only() {
        let text = with_numbers("restitution * (1 + k1 * (ball_in_wx * ball_radius / 25) + k2)", &[("k1".into(), -0.1234, 0.0), ("k2".into(), 0.05, 0.0)]);
        assert_eq!(text, "restitution * (1 + (-0.12) * (ball_in_wx * ball_radius / 25) + 0.05)");
    }
}
