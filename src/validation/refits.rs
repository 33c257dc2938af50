//! Single effects and pairs, refitted and weighed against each other: probabilities, the model to recommend, aliases.
//!
//! A pair must earn its place (`Refits::objection`): a catalogue formula that is not quite nature's leaves structure
//! behind which some second effect always imitates in part. So the second effect must explain something beyond *any* form
//! of the first, take a fair share of what the first leaves, and lower the error on impacts that no fit saw by more than
//! chance; effects that are known to imitate each other count as two only when neither does nearly all alone.

mod any_form;

use super::diagnosis::{CandidateReport, Estimate, NextExperiment, Verdict};
use super::error::ValidationError;
use super::experiments::{Rival, next_experiment};
use super::forward::Library;
use super::heldout::{error_of, log_evidence_of};
use super::linearise::Linearised;
use super::rank::{Reference, Refit, added_parameters};
use super::screen::{Screened, Screening, screen_pairs};
use super::structure::StructureTest;
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Noise variance over the stated one that is believed to be noise: deviations understated by half.
pub const LARGEST_NOISE_SCALE: f64 = 2.25;
/// Prior odds: nothing, one effect, two effects.
pub const PRIOR: [f64; 3] = [0.5, 0.35, 0.15];
/// Level of a single effect's likelihood ratio, corrected for the catalogue.
pub const FIRST_LEVEL: f64 = 0.05;
/// Twenty to one.
pub const LOG_ODDS: f64 = 2.995_732_273_553_991;
/// Level of what a second effect explains beyond any form of the first, corrected for the catalogue.
const SECOND_LEVEL: f64 = 0.01;
/// Share of the excess that the better effect leaves, which a second one must take.
const SECOND_SHARE: f64 = 0.1;
/// Share of the whole excess that a second effect must take: few catalogue formulae fit nature's to better than this.
const SMALLEST_SHARE: f64 = 0.01;
/// Share of what the best single effect leaves from which a second one is no form of it, unless the cards say so, and what it takes in units of
/// chance's deviation: a wrong second effect takes a part of what the best one's formula misses, seldom the most of it.
const MOST_OF_THE_REST: f64 = 0.5;
const BEYOND_CHANCE: f64 = 4.0;
/// Share of the excess that a catalogue effect must take away to be called missing.
pub const SHARE: f64 = 0.75;
/// Of two effects that imitate each other, one that takes this share of the excess alone stands alone.
pub const ALONE_SHARE: f64 = 0.9;
/// Candidates refitted alone, and pairs.
const SINGLES: usize = 8;
const PAIRS: usize = 12;
/// Chi-square that each strength of a further effect costs when the most promising ones are chosen.
const STRENGTH_PRICE: f64 = 5.0;
/// An effect that takes nearly as much of the excess away is an alias, whatever the evidence says of its formula.
const ALIAS_SHARE: f64 = 0.9;
/// Cosine of two signatures above which nothing on these impacts tells them apart.
const ALIAS_COSINE: f64 = 0.95;
/// Cosine above which two effects are one on these impacts, and the log odds by which the catalogue's first one is preferred.
const TWIN_COSINE: f64 = 0.99;
const PRECEDENCE: f64 = 0.5 * LOG_ODDS;
/// An effect that one impact carries by more than this share of its gain must be told by the others too.
const ONE_IMPACT: f64 = 0.6;

/// Share of the excess that is gone; an excess of nothing has nothing to remove.
pub fn share_removed(before: f64, after: f64) -> f64 {
    if before <= 0.0 { 0.0 } else { (1.0 - after / before).clamp(0.0, 1.0) }
}

/// The excess of a structure test at another noise scale than its own: the chi-square beyond what noise of scale c leaves.
pub fn excess_at(test: &StructureTest, c: f64) -> f64 {
    ((test.statistic + test.residual_chi2) / c - test.rank as f64 - test.residual_freedom).max(0.0)
}

/// Starting strengths of a pair: from the joint score; none where one of them was not screened.
fn screen_pairs_guess(reference: &Reference, screening: &Screening, names: &[&str]) -> Vec<f64> {
    let Some(terms): Option<Vec<&Screened>> = names.iter().map(|n| screening.of(reference.library, n)).collect() else { return Vec::new() };
    let columns: Vec<usize> = terms.iter().flat_map(|s| s.terms.iter().copied()).collect();
    let typical = terms.iter().flat_map(|s| reference.library.effects()[s.effect].strengths.iter().map(|t| t.typical));
    screening.projected.joint(&columns).map_or_else(Vec::new, |(_, strengths)| strengths.iter().zip(typical).map(|(s, t)| s * t).collect())
}

/// Two effects together, and what the lesser of them explains when the other may have any form.
pub struct Pair {
    pub refit: Refit,
    /// Places of the two alone among the singles.
    halves: [usize; 2],
    /// Gain in chi-square of the lesser one, and its p-value corrected for the catalogue.
    beyond_form: f64,
    p_value: f64,
    /// Each imitates the other, by their cards or by their signatures here.
    aliases: bool,
    /// Why it does not earn its place beside its better half; `None` when it does.
    objection: Option<String>,
}

/// Everything refitted.
pub struct Refits<'a> {
    singles: Vec<Refit>,
    pairs: Vec<Pair>,
    tested: usize,
    /// Noise scale of the best model found.
    pub c: f64,
    /// Structure test of the current model.
    base: StructureTest,
    /// The impacts that no fit saw, under the current model.
    held_base: &'a [Linearised],
    /// For each single effect, earlier ones of the catalogue that nothing on these impacts tells it from.
    twins: Vec<Vec<usize>>,
    /// The single effect that all impacts speak for most, and the chi-square by which it explains more than any form of each of the others.
    leader: Option<(usize, Vec<f64>)>,
}

impl<'a> Refits<'a> {
    pub fn new(reference: &mut Reference, screening: &Screening, base: &StructureTest, held_base: &'a [Linearised]) -> Result<Self, ValidationError> {
        let library = reference.library;
        let name = |e: usize| library.effects()[e].name.as_str();
        let mut order: Vec<_> = screening.effects.iter().filter(|s| s.hidden_because.is_none() && s.gain > 0.0).collect();
        order.sort_by(|a, b| (b.gain - b.terms.len() as f64).total_cmp(&(a.gain - a.terms.len() as f64)).then(a.effect.cmp(&b.effect)));
        order.truncate(SINGLES);
        let fixed = &*reference;
        let singles: Vec<Refit> =
            order.par_iter().map(|s| fixed.refit(&[name(s.effect)], &s.strengths)).collect::<Vec<_>>().into_iter().filter_map(Result::ok).collect();
        let mut refits = Refits {
            singles,
            pairs: Vec::new(),
            tested: screening.tested.max(1),
            c: reference.c,
            base: base.clone(),
            held_base,
            twins: Vec::new(),
            leader: None,
        };
        refits.settle_noise(reference);
        refits.find_pairs(reference, screening)?;
        refits.settle_noise(reference);
        let objections: Vec<Option<String>> = refits.pairs.iter().map(|p| refits.objection(p)).collect();
        refits.pairs.iter_mut().zip(objections).for_each(|(pair, objection)| pair.objection = objection);
        // With the sign of its card before one against it, then in the catalogue's order.
        let place = |r: &Refit| (r.against_card, library.effects().iter().position(|o| o.name == r.effects[0]));
        refits.twins = refits
            .singles
            .iter()
            .map(|own| {
                let same = |other: &Refit| cosine(library, screening, &own.effects[0], &other.effects[0]).abs() > TWIN_COSINE;
                (0..refits.singles.len()).filter(|&i| place(&refits.singles[i]) < place(own) && same(&refits.singles[i])).collect()
            })
            .collect();
        refits.leader = refits.strongest().map(|at| (at, refits.beyond_any_form(at, reference)));
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
            // One of several twins is enough, the catalogue's first.
            let name = |s: &Screened| library.effects()[s.effect].name.as_str();
            let second_to = |s: &Screened| order.iter().any(|o| o.effect < s.effect && cosine(library, screening, name(o), name(s)).abs() > TWIN_COSINE);
            for s in order.iter().filter(|s| !second_to(s)).take(3) {
                want(&first.effects[0], name(s));
            }
            // And what a further step would add, each strength of it paid for: any form of the leader may take much of the right one away.
            let next = reference.screen_next(first)?;
            let mut order: Vec<_> = next.effects.iter().filter(|s| s.hidden_because.is_none() && s.p_value * (self.tested as f64) < SECOND_LEVEL).collect();
            let worth = |s: &Screened| s.gain - STRENGTH_PRICE * s.terms.len() as f64;
            order.sort_by(|a, b| worth(b).total_cmp(&worth(a)).then(a.effect.cmp(&b.effect)));
            for s in order.iter().take(2) {
                want(&first.effects[0], name(s));
            }
        }
        // Pairs that hide each other: much better together than the best one alone.
        let best_gain = screening.effects.iter().map(|s| s.gain).fold(0.0, f64::max);
        for p in screen_pairs(screening, library, reference.c).iter().take(3).filter(|p| p.gain > 1.3 * best_gain + 30.0) {
            want(&library.effects()[p.effects[0]].name, &library.effects()[p.effects[1]].name);
        }
        wanted.truncate(PAIRS);
        // Both halves of a pair are candidates too.
        let known = |name: &String| self.singles.iter().any(|s| s.effects[0] == *name);
        let mut more: Vec<&String> = wanted.iter().flatten().filter(|n| !known(n)).collect();
        more.sort();
        more.dedup();
        let made: Vec<Refit> = more.par_iter().filter_map(|n| reference.refit(&[n], &[]).ok()).collect();
        self.singles.extend(made);
        let singles = &self.singles;
        let tested = self.tested as f64;
        let pairs: Vec<Option<Pair>> = wanted
            .par_iter()
            .map(|names| {
                let pair: Vec<&str> = names.iter().map(String::as_str).collect();
                let guess = screen_pairs_guess(reference, screening, &pair);
                let refit = reference.refit(&pair, &guess).ok()?;
                let at = |name: &String| singles.iter().position(|s| s.effects[0] == *name);
                let halves = [at(&names[0])?, at(&names[1])?];
                // Each half beyond the other in any form.
                let mut least = (f64::INFINITY, 0.0f64);
                for (own, other) in [(0, 1), (1, 0)] {
                    let beyond = reference.screen_second(&singles[halves[own]], Some(&[pair[other]])).ok()?;
                    let s = beyond.effects.first()?;
                    least = (least.0.min(s.gain), least.1.max((s.p_value * tested).min(1.0)));
                }
                let aliases = imitate_each_other(library, screening, pair[0], pair[1]);
                Some(Pair { refit, halves, beyond_form: least.0, p_value: least.1, aliases, objection: None })
            })
            .collect();
        self.pairs = pairs.into_iter().flatten().collect();
        Ok(())
    }

    /// The half of a pair that leaves less.
    fn better_half(&self, pair: &Pair) -> usize {
        let left = |i: usize| excess_at(&self.singles[i].structure, self.c.min(LARGEST_NOISE_SCALE));
        if left(pair.halves[1]) < left(pair.halves[0]) { pair.halves[1] } else { pair.halves[0] }
    }

    /// Deviation of the excess that chance alone makes.
    fn chance(&self) -> f64 {
        (2.0 * self.base.rank as f64).sqrt()
    }

    /// Whether the lesser half of a pair takes this share of what the better one leaves, clearly more than chance would.
    fn takes_of_the_rest(&self, pair: &Pair, share: f64) -> bool {
        let c = self.c.min(LARGEST_NOISE_SCALE);
        let (left, both) = (excess_at(&self.singles[self.better_half(pair)].structure, c), excess_at(&pair.refit.structure, c));
        left - both > BEYOND_CHANCE * self.chance() && share_removed(left, both) > share
    }

    /// Two effects that imitate each other, one of which does nearly all alone: the first in another form.
    fn is_one_in_another_form(&self, pair: &Pair) -> bool {
        let c = self.c.min(LARGEST_NOISE_SCALE);
        let left = excess_at(&self.singles[self.better_half(pair)].structure, c);
        pair.aliases && share_removed(excess_at(&self.base, c), left) > ALONE_SHARE
    }

    /// Why a pair does not earn its place beside its better half, at the noise scale that all refits settled on.
    fn objection(&self, pair: &Pair) -> Option<String> {
        let c = self.c.min(LARGEST_NOISE_SCALE);
        let (base, both) = (excess_at(&self.base, c), excess_at(&pair.refit.structure, c));
        let at = self.better_half(pair);
        let better = &self.singles[at];
        let left = excess_at(&better.structure, c);
        let alone = share_removed(base, left);
        if pair.p_value >= SECOND_LEVEL {
            return Some(format!("one of them explains nothing beyond another form of the other (p = {:.2})", pair.p_value));
        }
        if self.is_one_in_another_form(pair) {
            return Some(format!(
                "they imitate each other, and {} alone takes {:.0} % of the excess away: what is left is more likely its form",
                better.effects[0],
                100.0 * alone
            ));
        }
        let form = self.pairs.iter().find(|q| self.is_one_in_another_form(q) && self.better_half(q) == at && q.refit.log_evidence > pair.refit.log_evidence);
        if form.is_some() {
            return Some(format!("another form of {} explains what it leaves better", better.effects[0]));
        }
        // What chance leaves (two deviations) is nobody's to take.
        let too_small = left - both < SMALLEST_SHARE * base && !self.takes_of_the_rest(pair, SHARE);
        if left - both < SECOND_SHARE * (left - 2.0 * self.chance()).max(0.0) || too_small {
            return Some(format!("the second takes only {:.0} % of what {} leaves", 100.0 * share_removed(left, both), better.effects[0]));
        }
        for alone in pair.halves.map(|i| &self.singles[i].held_out) {
            let gain = |(a, p): (&Linearised, &Linearised)| (a.z.norm_squared() - p.z.norm_squared()) / self.c + a.log_det - p.log_det;
            let gains: Vec<f64> = alone.iter().zip(&pair.refit.held_out).map(gain).collect();
            let (sum, spread) = (gains.iter().sum::<f64>(), gains.iter().map(|g| g * g).sum::<f64>().sqrt());
            if !(sum > spread) {
                return Some("together they do not lower the error on held-out impacts by more than chance".to_owned());
            }
        }
        None
    }

    /// The pair that fits much better than the best single effect and yet does not earn its place, in words.
    pub fn refused_pair(&self) -> Option<String> {
        let single = self.singles.iter().map(|s| s.log_evidence).fold(0.0, f64::max);
        let best = self.pairs.iter().max_by(|a, b| a.refit.log_evidence.total_cmp(&b.refit.log_evidence))?;
        if best.refit.log_evidence < single + LOG_ODDS {
            return None;
        }
        best.objection.as_ref().map(|why| format!("{} together would fit still better, but {why}", best.refit.effects.join(" and ")))
    }

    fn earned(&self) -> impl Iterator<Item = &Pair> {
        self.pairs.iter().filter(|p| p.refit.largest_share < ONE_IMPACT && p.objection.is_none())
    }

    /// Whether chance, or one odd impact, could have made the gain of a single effect. Few impacts meet some effects (those
    /// that slide a law of friction): one of them may well carry most of it, when the others alone would do.
    fn is_chance(&self, r: &Refit) -> bool {
        let chance = |p: f64| p * (self.tested as f64) >= FIRST_LEVEL;
        chance(r.p_value) || r.largest_share >= ONE_IMPACT && chance(r.p_of_others)
    }

    fn log_prior(&self, effects: usize) -> f64 {
        let n = self.tested as f64;
        match effects {
            1 => (PRIOR[1] / n).ln(),
            _ => (PRIOR[2] / (0.5 * n * (n - 1.0)).max(1.0)).ln(),
        }
    }

    /// Log evidence of a pair's better half, and what the pair adds to it: no more than the lesser one explains beyond the
    /// other's form. Only the former is subject to overdispersion: no form of the first could explain the latter.
    fn pair_evidence(&self, pair: &Pair) -> (f64, f64) {
        let half = pair.halves.iter().map(|&i| self.singles[i].log_evidence).fold(0.0, f64::max);
        let beyond = 0.5 * pair.beyond_form - (1.0 + pair.beyond_form).ln();
        (half, (pair.refit.log_evidence - half).min(beyond))
    }

    /// The single effects, as far as chance does not make them.
    pub fn singles(&self) -> &[Refit] {
        &self.singles
    }

    /// Every model that stands: single effects, and pairs that earn their place.
    pub fn all(&self) -> impl Iterator<Item = &Refit> {
        self.singles.iter().chain(self.earned().map(|p| &p.refit))
    }

    /// What the impacts that no fit saw say for a model: together with the others they weigh the effects against each other.
    /// Between it and the best single effect none of them alone tells more than twenty to one, or one that the catalogue's form
    /// misses would outweigh all.
    fn told_by_held_out(&self, r: &Refit) -> f64 {
        let Some(best) = self.best_single().map(|at| &self.singles[at]) else { return 0.0 };
        log_evidence_of(self.held_base, &best.held_out, self.c, f64::INFINITY) + log_evidence_of(&best.held_out, &r.held_out, self.c, LOG_ODDS)
    }

    /// The single effect with the most evidence, the earlier one of two equal ones.
    fn best_single(&self) -> Option<usize> {
        (0..self.singles.len()).max_by(|&i, &j| self.singles[i].log_evidence.total_cmp(&self.singles[j].log_evidence).then(j.cmp(&i)))
    }

    /// Log evidence of a single effect, none of which is believed when it is chance: that is not weighed for it either.
    fn believed(&self, r: &Refit) -> f64 {
        if self.is_chance(r) { r.log_evidence.min(0.0) } else { r.log_evidence }
    }

    /// Of effects that these impacts cannot tell apart, the one the catalogue lists first is the more common one, and one that acts as its
    /// card says is more common than one that acts the other way round.
    fn single_weight(&self, at: usize, overdispersion: f64) -> f64 {
        let own = &self.singles[at];
        let evidence = self.believed(own);
        let before: Vec<&Refit> =
            self.twins.get(at).into_iter().flatten().map(|&i| &self.singles[i]).filter(|r| r.log_evidence > evidence - LOG_ODDS).collect();
        let reversed = own.against_card && before.iter().any(|r| !r.against_card);
        let steps = f64::from(u8::from(!before.is_empty()) + u8::from(reversed));
        self.evidence_in_any_form(at) / overdispersion + self.log_prior(1) - steps * PRECEDENCE
    }

    /// The second effect of the best single one's pair is weighed in full, any other pair against the best single effect's
    /// possible forms; but no pair more than its whole evidence allows beside that of another that stands: what the forms of one half could take
    /// from the other speaks for a single effect, not for another pair. Where the pair that explains most is the best single effect with one that
    /// takes most of what it leaves, a pair without it does not count: two wrong effects can share what a strong one and a weak one do.
    fn pair_weight(&self, pair: &Pair, overdispersion: f64) -> f64 {
        let whole = |p: &Pair| {
            let (half, more) = self.pair_evidence(p);
            half + more + self.told_by_held_out(&p.refit)
        };
        let is_of_best = |p: &Pair| self.best_single().is_some_and(|b| p.halves.contains(&b));
        let by_itself = |p: &Pair| {
            let more = self.pair_evidence(p).1;
            let in_full = if is_of_best(p) { more - more / overdispersion } else { 0.0 };
            whole(p) / overdispersion + in_full
        };
        let in_all = |p: &Pair| p.refit.log_evidence + self.told_by_held_out(&p.refit);
        let beside = |other: &Pair| by_itself(other) + (whole(pair) - whole(other)).min(in_all(pair) - in_all(other)) / overdispersion;
        let explains_most = self.earned().all(|other| in_all(other) <= in_all(pair));
        let of_the_rest = explains_most && is_of_best(pair) && !pair.aliases && self.takes_of_the_rest(pair, MOST_OF_THE_REST);
        let counts = |other: &&Pair| !of_the_rest || is_of_best(other);
        self.earned().filter(counts).map(beside).fold(by_itself(pair), f64::min) + self.log_prior(2)
    }

    /// The model to recommend: the best single effect, or the best pair, by the same weights as their probabilities, when it
    /// is more likely than nothing at all.
    pub fn choose(&self, overdispersion: f64) -> Option<&Refit> {
        let single = self
            .singles
            .iter()
            .enumerate()
            .filter(|(_, r)| r.log_evidence + self.log_prior(1) > PRIOR[0].ln() && !self.is_chance(r))
            .map(|(i, r)| (self.single_weight(i, overdispersion), r))
            .max_by(|a, b| a.0.total_cmp(&b.0));
        let sum = |p: &Pair| {
            let (half, more) = self.pair_evidence(p);
            half + more
        };
        let weight = |p: &Pair| self.pair_weight(p, overdispersion);
        let pair = self.earned().filter(|p| sum(p) + self.log_prior(2) > PRIOR[0].ln()).max_by(|a, b| weight(a).total_cmp(&weight(b)));
        match (single, pair) {
            (Some(s), Some(p)) => {
                let better = self.pair_weight(p, overdispersion) - s.0;
                if better > 0.5 * LOG_ODDS { Some(&p.refit) } else { Some(s.1) }
            }
            (s, p) => s.map(|s| s.1).or(p.map(|p| &p.refit)),
        }
    }

    /// Log posterior weights of nothing, every single, every pair that stands.
    fn log_weights(&self, overdispersion: f64) -> Vec<f64> {
        let singles = (0..self.singles.len()).map(|i| self.single_weight(i, overdispersion));
        std::iter::once(PRIOR[0].ln()).chain(singles).chain(self.earned().map(|p| self.pair_weight(p, overdispersion))).collect()
    }

    fn normalised(&self, overdispersion: f64) -> Vec<f64> {
        let logs = self.log_weights(overdispersion);
        let top = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let weights: Vec<f64> = logs.iter().map(|l| (l - top).exp()).collect();
        let sum: f64 = weights.iter().sum();
        weights.into_iter().map(|w| w / sum).collect()
    }

    pub fn probability_of(&self, refit: &Refit, overdispersion: f64) -> f64 {
        let weights = self.normalised(overdispersion);
        self.all().zip(&weights[1..]).find(|(r, _)| std::ptr::eq(*r, refit)).map_or(0.0, |(_, w)| *w)
    }

    /// By the probabilities that are told.
    pub fn is_likelier_than_nothing(&self, refit: &Refit, overdispersion: f64) -> bool {
        self.probability_of(refit, overdispersion) > self.normalised(overdispersion)[0]
    }

    pub fn report(
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
                let share = share_removed(excess, excess_at(&s.structure, self.c.min(LARGEST_NOISE_SCALE)));
                if verdict == Verdict::Unexplained {
                    // No name is likely when none takes the excess away.
                    let joint = self
                        .all()
                        .filter(|r| r.effects.contains(&effect))
                        .map(|r| share_removed(excess, excess_at(&r.structure, self.c.min(LARGEST_NOISE_SCALE))))
                        .fold(share, f64::max);
                    probability *= 0.5 * (joint / SHARE).min(1.0);
                }
                let outline = library.outline(&effect);
                Ok(CandidateReport {
                    probability,
                    heldout_error_before: before,
                    heldout_error_after: error_of(&s.held_out),
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
    pub fn next_experiments(&self, reference: &Reference, candidates: &[CandidateReport]) -> Result<Vec<NextExperiment>, ValidationError> {
        let Some(best) = candidates.first() else { return Ok(Vec::new()) };
        let Some(first) = self.singles.iter().find(|s| s.effects[0] == best.effect) else { return Ok(Vec::new()) };
        let a = reference.library.with(&[&best.effect])?;
        let at_a = a.prepare(&first.fit.values)?;
        let mut all = Vec::new();
        for alias in best.aliases.iter().take(2) {
            let Some(second) = self.singles.iter().find(|s| s.effects[0] == *alias) else { continue };
            let b = reference.library.with(&[alias])?;
            let at_b = b.prepare(&second.fit.values)?;
            let separated_by = reference.library.outline(&best.effect).map_or("", |o| o.separated_by.as_str());
            let (first, second) = (Rival { name: &best.effect, prediction: at_a.as_ref() }, Rival { name: alias, prediction: at_b.as_ref() });
            all.extend(next_experiment(&first, &second, reference.observations, reference.impacts, &reference.base.impacts, separated_by));
        }
        Ok(all)
    }

    /// An alias explains these impacts about as well (within twenty to one), or has the same signature.
    fn add_aliases(&self, library: &dyn Library, screening: &Screening, overdispersion: f64, list: &mut [CandidateReport]) {
        let facts: Vec<(String, f64, f64, f64)> = list.iter().map(|c| (c.effect.clone(), c.log_evidence_gain, c.share_removed, c.probability)).collect();
        for candidate in list.iter_mut() {
            for (other, evidence, share, probability) in &facts {
                if *other == candidate.effect {
                    continue;
                }
                let like = cosine(library, screening, &candidate.effect, other);
                let close = (candidate.log_evidence_gain - evidence).abs() / overdispersion < LOG_ODDS && *evidence > 0.0;
                // Of two that are likely together neither is the other's.
                let within_odds = probability.min(candidate.probability) > (-LOG_ODDS).exp() * probability.max(candidate.probability);
                let likely = within_odds && *probability > 0.01 && probability + candidate.probability < 1.01;
                // One that takes far more, and is likelier, is no alias of what it beats.
                let beaten = *evidence > candidate.log_evidence_gain && candidate.share_removed < ALIAS_SHARE * share;
                let as_good = candidate.share_removed > 0.3 && *share > ALIAS_SHARE * candidate.share_removed && !beaten;
                if close || likely || as_good || like.abs() > ALIAS_COSINE {
                    candidate.aliases.push(other.clone());
                    candidate.alias_cosines.insert(other.clone(), like);
                }
            }
        }
    }
}

/// Largest cosine between the signatures of two effects, nuisance projected out.
fn cosine(library: &dyn Library, screening: &Screening, a: &str, b: &str) -> f64 {
    let (Some(a), Some(b)) = (screening.of(library, a), screening.of(library, b)) else { return 0.0 };
    a.terms
        .iter()
        .flat_map(|&i| b.terms.iter().map(move |&j| (i, j)))
        .map(|(i, j)| screening.projected.cosine(i, j))
        .fold(0.0, |m: f64, v| if v.abs() > m.abs() { v } else { m })
}

/// Whether two effects are known to be confused, by either one's card.
pub fn cards_confuse(library: &dyn Library, a: &str, b: &str) -> bool {
    let lists = |name: &str, other: &str| library.outline(name).is_some_and(|o| o.confused_with.iter().any(|c| c == other));
    lists(a, b) || lists(b, a)
}

/// Whether two effects are known to be confused, or cannot be told apart on these impacts.
fn imitate_each_other(library: &dyn Library, screening: &Screening, a: &str, b: &str) -> bool {
    cards_confuse(library, a, b) || cosine(library, screening, a, b).abs() > ALIAS_COSINE
}

pub fn estimates(parameters: &[(String, f64, f64)]) -> BTreeMap<String, Estimate> {
    parameters.iter().map(|(name, value, sd)| (name.clone(), Estimate { value: *value, sd: *sd })).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn truth_excess_counts_what_noise_of_the_scale_does_not_explain() {
        let test = StructureTest {
            statistic: 300.0,
            rank: 100,
            p_value: 0.0,
            noise_scale: 1.0,
            noise_by_group: Vec::new(),
            columns_of_groups: 0,
            by_group: Vec::new(),
            lone_term: None,
            residual_chi2: 900.0,
            residual_freedom: 900.0,
            excess: 200.0,
            seed: 1,
        };
        assert_eq!(excess_at(&test, 1.0), 200.0);
        // Noise of twice the variance explains it all.
        assert_eq!(excess_at(&test, 2.0), 0.0);
        assert_eq!(share_removed(200.0, 50.0), 0.75);
        assert_eq!(share_removed(0.0, 0.0), 0.0);
        assert_eq!(share_removed(100.0, 150.0), 0.0);
    }
}
