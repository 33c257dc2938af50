//! An effect that is not of one strength for all: one player's hand, the vibration of one frame, the batch of balls that wears.
//!
//! Where the model fails by the groups of a column, no single strength of an effect takes the excess away, and the right name would go
//! under. So each promising effect is fitted with strengths of its own in every group of that column, its shape shared. It is weighed against
//! what is simpler: the same effect alike in all groups, and parameters that the model has already (restitution, friction) with values of their own
//! in each group. A group goes with the pair of racket and ball ([`super::observation::Gear`]): every pair stands once for each group.

use super::by_group::groups_of_column;
use super::diagnosis::{CandidateReport, Estimate};
use super::error::ValidationError;
use super::fit::{Fit, FitOptions, Start, fit};
use super::forward::{Asked, Forward, FreeParameter, Outputs, Prediction};
use super::heldout::{error_of, linearise_held_out, log_evidence_of};
use super::linearise::Linearised;
use super::observation::{Observation, Observations};
use super::rank::{Reference, Refit, form_overdispersion, gain_over, log_evidence_over, with_absent_strengths};
use super::refits::{LARGEST_NOISE_SCALE, LOG_ODDS, PRIOR, SHARE, excess_at, share_removed};
use super::structure::{StructureTest, structure_test};
use super::terminal::short;
use std::collections::BTreeMap;

/// Effects tried: the best ones with one strength for all.
const TRIED: usize = 4;
/// Groups with strengths of their own at most: each takes a prediction of all impacts per strength.
const MOST_GROUPS: usize = 8;
/// The same where a prediction is stepped through time.
const MOST_GROUPS_IN_TIME: usize = 4;

/// A model of which some parameters have a value in each group: those of the first group stand where the model has them, then follow those of
/// the second, and so on.
struct ByGroup<'a> {
    inner: Box<dyn Forward + 'a>,
    /// Places of these parameters in the inner model.
    own: Vec<usize>,
    groups: usize,
    /// Pairs of racket and ball in the table; pair `p` of group `g` is number `g * pairs + p`.
    pairs: usize,
    free: Vec<FreeParameter>,
}

impl<'a> ByGroup<'a> {
    fn new(inner: Box<dyn Forward + 'a>, own: Vec<usize>, groups: usize, pairs: usize) -> Self {
        let mut free = inner.parameters().to_vec();
        for g in 1..groups {
            free.extend(own.iter().map(|&at| FreeParameter { name: format!("{} ({g})", inner.parameters()[at].name), ..inner.parameters()[at].clone() }));
        }
        ByGroup { inner, own, groups, pairs, free }
    }

    /// Place of the `k`-th of these parameters in a group.
    fn place(&self, k: usize, group: usize) -> usize {
        if group == 0 { self.own[k] } else { self.inner.parameters().len() + (group - 1) * self.own.len() + k }
    }

    /// All groups alike.
    fn alike(&self, values: &[f64]) -> Vec<f64> {
        let mut all = values.to_vec();
        (1..self.groups).for_each(|_| all.extend(self.own.iter().map(|&at| values[at])));
        all
    }
}

struct Ready<'a> {
    groups: Vec<Box<dyn Prediction + 'a>>,
    pairs: usize,
}

impl Ready<'_> {
    fn group_and(&self, asked: &Asked) -> (&dyn Prediction, Asked) {
        (self.groups[asked.gear / self.pairs].as_ref(), Asked { gear: asked.gear % self.pairs, ..*asked })
    }
}

impl Prediction for Ready<'_> {
    fn predict(&self, asked: &Asked) -> Option<Outputs> {
        let (group, asked) = self.group_and(asked);
        group.predict(&asked)
    }

    fn why_not(&self, asked: &Asked) -> Option<String> {
        let (group, asked) = self.group_and(asked);
        group.why_not(&asked)
    }

    fn predict_many(&self, asked: &[Asked]) -> Vec<Option<Outputs>> {
        let mut outputs = vec![None; asked.len()];
        for (g, group) in self.groups.iter().enumerate() {
            let places: Vec<usize> = (0..asked.len()).filter(|&i| asked[i].gear / self.pairs == g).collect();
            let inside: Vec<Asked> = places.iter().map(|&i| self.group_and(&asked[i]).1).collect();
            for (place, output) in places.into_iter().zip(group.predict_many(&inside)) {
                outputs[place] = output;
            }
        }
        outputs
    }

    fn jump(&self, asked: &Asked) -> Option<Outputs> {
        let (group, asked) = self.group_and(asked);
        group.jump(&asked)
    }
}

impl Forward for ByGroup<'_> {
    fn parameters(&self) -> &[FreeParameter] {
        &self.free
    }

    fn prepare(&self, values: &[f64]) -> Result<Box<dyn Prediction + '_>, ValidationError> {
        let in_group = |g: usize| {
            let mut inside = values[..self.inner.parameters().len()].to_vec();
            (0..self.own.len()).for_each(|k| inside[self.own[k]] = values[self.place(k, g)]);
            self.inner.prepare(&inside)
        };
        let groups = (0..self.groups).map(in_group).collect::<Result<Vec<_>, _>>()?;
        Ok(Box::new(Ready { groups, pairs: self.pairs }))
    }

    fn costly(&self) -> bool {
        self.inner.costly()
    }
}

/// A model with values of their own in each group, fitted.
struct Fitted {
    fit: Fit,
    structure: StructureTest,
    held_out: Vec<Linearised>,
    /// Parameter, then group, value, deviation at noise scale 1, all groups in the same order.
    values: Vec<(String, Vec<Estimate>)>,
}

/// An effect whose strengths are each group's own.
struct Candidate {
    effect: String,
    fitted: Fitted,
    /// Log evidence of all impacts over the current model's.
    log_evidence: f64,
    share: f64,
}

/// What the groups of a column differ by, where an effect's strength says it.
pub(super) struct OwnStrengths {
    pub effect: String,
    pub structure: StructureTest,
    pub fit: Fit,
    pub held_out: Vec<Linearised>,
    pub c: f64,
    candidates: Vec<(Candidate, f64)>,
    column: String,
    groups: Vec<String>,
}

/// What was found: an effect, or in words the parameters of the model that have values of their own.
pub(super) enum Found {
    Effect(Box<OwnStrengths>),
    /// With the error on held-out impacts that they leave.
    Parameters {
        error: f64,
        words: String,
    },
}

/// The table with every racket and ball once for each group of a column.
struct Table {
    observations: Observations,
    column: String,
    groups: Vec<String>,
    pairs: usize,
}

impl Table {
    fn of(reference: &Reference, column: &str, most: usize) -> Option<Self> {
        let all: Vec<&Observation> = reference.observations.impacts.iter().collect();
        let (groups, of_impact) = groups_of_column(reference.observations, &all, column)?;
        if groups.len() > most {
            return None;
        }
        let pairs = reference.observations.gear.len();
        let mut observations = reference.observations.clone();
        observations.gear = (0..groups.len()).flat_map(|_| reference.observations.gear.clone()).collect();
        observations.impacts.iter_mut().zip(of_impact).for_each(|(o, g)| o.gear += g * pairs);
        Some(Table { observations, column: column.to_owned(), groups, pairs })
    }

    /// `inner` with the parameters at `own` each group's own, fitted from `start`.
    fn fit(&self, reference: &Reference, inner: Box<dyn Forward + '_>, own: Vec<usize>, start: &Fit) -> Result<(Fitted, Vec<Vec<usize>>), ValidationError> {
        let names: Vec<String> = own.iter().map(|&at| inner.parameters()[at].name.clone()).collect();
        let model = ByGroup::new(inner, own, self.groups.len(), self.pairs);
        let (seen, held) = (self.observations.side(false), self.observations.side(true));
        let options = FitOptions { start_values: Some(model.alike(&start.values)), ..FitOptions::default() };
        let fit = fit(&model, &self.observations, &seen, &options, Some(Start { fit: start, keep_jacobians: model.costly() }))?;
        let structure = structure_test(&fit, &self.observations, &seen, reference.beside_smooth(), reference.seed);
        let held_out = linearise_held_out(&model, &fit, &self.observations, &held)?;
        let places: Vec<Vec<usize>> = (0..self.groups.len()).map(|g| (0..names.len()).map(|k| model.place(k, g)).collect()).collect();
        let estimate = |at: usize| Estimate { value: fit.values[at], sd: fit.sd(at, 1.0) };
        let values = names.into_iter().enumerate().map(|(k, name)| (name, places.iter().map(|group| estimate(group[k])).collect())).collect();
        Ok((Fitted { fit, structure, held_out, values }, places))
    }
}

/// Values in each group, in words: "A 0.82 ± 0.001, B 0.79 ± 0.001".
fn values_in_words(groups: &[String], values: &[Estimate], c: f64) -> String {
    let one = |(group, e): (&String, &Estimate)| format!("{group:?} {} ± {}", short(e.value), short(e.sd * c.sqrt()));
    groups.iter().zip(values).map(one).collect::<Vec<_>>().join(", ")
}

/// The effects that are worth strengths of their own in each group: the best ones with one strength for all.
pub(super) fn best_ones(singles: &[Refit]) -> Vec<&Refit> {
    let mut order: Vec<&Refit> = singles.iter().filter(|r| r.log_evidence > 0.0).collect();
    order.sort_by(|a, b| b.log_evidence.total_cmp(&a.log_evidence));
    order.truncate(TRIED);
    order
}

/// Whether the groups of a column differ in the strength of an effect, or in the model's own parameters.
/// `singles`: the effects with one strength for all; `held_base`: the held-out impacts under the current model.
///
/// # Errors
/// As [`fit`].
pub(super) fn own_strengths(
    reference: &Reference,
    column: &str,
    singles: &[Refit],
    base: &StructureTest,
    held_base: &[Linearised],
) -> Result<Option<Found>, ValidationError> {
    let most = if reference.library.current().costly() { MOST_GROUPS_IN_TIME } else { MOST_GROUPS };
    let Some(table) = Table::of(reference, column, most) else { return Ok(None) };
    let groups = table.groups.len();
    // What the model has already, with a value in each group.
    let all: Vec<usize> = (0..reference.base.values.len()).collect();
    let (parameters, places) = table.fit(reference, reference.library.with(&[])?, all, reference.base)?;
    let mut c = reference.c.min(parameters.structure.noise_scale);
    let mut tried = Vec::new();
    for single in best_ones(singles) {
        let inner = reference.library.with(&[&single.effects[0]])?;
        let strengths = reference.strengths_in(inner.as_ref(), &single.names());
        // One that leaves an impact without an answer is out.
        let Ok((fitted, places)) = table.fit(reference, inner, strengths.iter().map(|s| s.0).collect(), &single.fit) else { continue };
        c = c.min(fitted.structure.noise_scale);
        tried.push((single, fitted, places, strengths));
    }
    let left = |structure: &StructureTest| excess_at(structure, c.min(LARGEST_NOISE_SCALE));
    let share = |structure: &StructureTest| share_removed(left(base), left(structure));
    let told = |held_out: &[Linearised]| log_evidence_of(held_base, held_out, c, f64::INFINITY);
    let simplest = singles.iter().map(|r| log_evidence_over(reference.base, &r.fit, c, 0) + told(&r.held_out)).fold(0.0, f64::max);
    // Flat priors have no evidence; a value costs half the log of how many numbers tell it.
    let price = 0.5 * ((groups - 1) * reference.base.values.len()) as f64 * (reference.base.count() as f64).ln();
    let by_parameters = 0.5 * gain_over(reference.base, &parameters.fit, c) - price + told(&parameters.held_out);
    let mut candidates: Vec<Candidate> = tried
        .into_iter()
        .map(|(single, fitted, places, strengths)| {
            let blocks = places.iter().map(|group| {
                let columns = group.iter().zip(&strengths).filter_map(|(&at, s)| Some((fitted.fit.column_of(at)?, s.1.one_sided)));
                columns.collect::<Vec<_>>()
            });
            let spikes: f64 = blocks.map(|block| with_absent_strengths(&fitted.fit, &block, c)).sum();
            let one_sided = groups * strengths.iter().filter(|s| s.1.one_sided).count();
            let log_evidence = log_evidence_over(reference.base, &fitted.fit, c, one_sided) + spikes + told(&fitted.held_out);
            Candidate { effect: single.effects[0].clone(), log_evidence, share: share(&fitted.structure), fitted }
        })
        .collect();
    candidates.sort_by(|a, b| b.log_evidence.total_cmp(&a.log_evidence));
    let error_before = error_of(held_base);
    let lowers = |held_out: &[Linearised]| {
        let excess = |error: f64| (error.powi(2) - c).max(0.0);
        error_of(held_out) < error_before && share_removed(excess(error_before), excess(error_of(held_out))) >= SHARE
    };
    let beats = |b: &Candidate| b.log_evidence > simplest.max(by_parameters) + LOG_ODDS;
    let found = candidates.first().filter(|b| beats(b) && (b.share >= SHARE || lowers(&b.fitted.held_out)) && error_of(&b.fitted.held_out) < error_before);
    if let Some(best) = found {
        let top = best.log_evidence;
        let prior = (PRIOR[1] / reference.library.effects().len().max(1) as f64).ln();
        // None of the cards is quite nature's form: what the best one leaves makes the others less unlikely.
        let overdispersion = form_overdispersion(left(&best.fitted.structure), base.rank);
        let weight = |evidence: f64| ((evidence - top) / overdispersion + prior).exp();
        let others = (PRIOR[0].ln() + (simplest.max(by_parameters) - top) / overdispersion).exp();
        let sum: f64 = candidates.iter().map(|b| weight(b.log_evidence)).sum::<f64>() + others;
        let effect = best.effect.clone();
        let (structure, fit, held_out) = (best.fitted.structure.clone(), best.fitted.fit.clone(), best.fitted.held_out.clone());
        let candidates = candidates
            .into_iter()
            .map(|b| {
                let p = weight(b.log_evidence) / sum;
                (b, p)
            })
            .collect();
        let own = OwnStrengths { effect, structure, fit, held_out, c, candidates, column: table.column, groups: table.groups };
        return Ok(Some(Found::Effect(Box::new(own))));
    }
    if share(&parameters.structure) < SHARE && !lowers(&parameters.held_out) || by_parameters < simplest + LOG_ODDS {
        return Ok(None);
    }
    // What no group tells (friction where balls do not slide) is no finding.
    let told_at = |k: usize| places.iter().all(|group| parameters.fit.is_informed(group[k]));
    let told_by_all = parameters.values.iter().enumerate().filter(|(k, _)| told_at(*k));
    let each = told_by_all.map(|(_, (name, values))| format!("{name} {}", values_in_words(&table.groups, values, c))).collect::<Vec<_>>();
    let error = error_of(&parameters.held_out);
    let words = format!(
        "with parameters of its own in each group of `{}` the model's error on held-out impacts falls from {error_before:.2} to {error:.2}: {}",
        table.column,
        each.join("; ")
    );
    Ok(Some(Found::Parameters { error, words }))
}

impl OwnStrengths {
    /// What differs, in words: "the strength of hand-mass is not alike in all groups of `player`: mass_kg "A" 0.00 ± 0.01, …".
    pub fn words(&self) -> String {
        let of = |b: &Candidate| {
            let name = |full: &str| full.split_once('.').map_or(full, |(_, own)| own).to_owned();
            let each = b.fitted.values.iter().map(|(full, values)| format!("{} {}", name(full), values_in_words(&self.groups, values, self.c)));
            each.collect::<Vec<_>>().join("; ")
        };
        let values = self.candidates.first().map(|(b, _)| of(b)).unwrap_or_default();
        format!(
            "the strength of {} is not alike in all groups of `{}`: {values} (error on held-out impacts with these {:.2}); a model file holds one strength for all, so make a model for each group",
            self.effect,
            self.column,
            error_of(&self.held_out)
        )
    }

    /// The same in a sentence beside the name.
    pub fn in_short(&self) -> String {
        format!("That is with a strength of its own in each group of `{}` (in the notes); one strength for all does not hold.", self.column)
    }

    /// Puts what strengths in each group say in the place of what one strength for all does.
    pub fn tell_candidates(&self, list: &mut [CandidateReport]) {
        for report in list.iter_mut() {
            report.probability = 0.0;
            let Some((own, probability)) = self.candidates.iter().find(|(b, _)| b.effect == report.effect) else { continue };
            report.probability = *probability;
            report.log_evidence_gain = own.log_evidence;
            report.share_removed = own.share;
            report.heldout_error_after = error_of(&own.fitted.held_out);
            let mut parameters = BTreeMap::new();
            for (name, values) in &own.fitted.values {
                for (group, e) in self.groups.iter().zip(values) {
                    parameters.insert(format!("{name} ({} {group:?})", self.column), Estimate { value: e.value, sd: e.sd * self.c.sqrt() });
                }
            }
            report.parameters = parameters;
            let near = |(b, p): &&(Candidate, f64)| b.effect != own.effect && p.min(*probability) > (-LOG_ODDS).exp() * p.max(*probability);
            report.aliases = self.candidates.iter().filter(near).map(|(b, _)| b.effect.clone()).collect();
            report.alias_cosines.retain(|name, _| report.aliases.contains(name));
        }
    }
}
