//! The verdict on a model with which something is wrong: which name to believe, or none, stage by stage.
//!
//! The catalogue's best effect or pair is a first verdict; then chance, the held-out impacts, what shots of one calibration share
//! and a formula found from the residuals may each take it back.

use super::by_group::slow_columns;
use super::case::{Case, less_likely_than_nothing};
use super::comparison::{note_noise, outliers, varied_coordinates};
use super::diagnosis::{CandidateReport, Diagnosis, Estimate, Together, Verdict};
use super::error::ValidationError;
use super::expression::{Found, find_expression};
use super::fit::{FitOptions, Start, fit, fit_with_likely_offsets};
use super::forward::EffectOutline;
use super::heldout::{error_of, held_out_error, is_worth, log_evidence_of, taken_for_chance, taken_for_shared};
use super::local_spot::SPOT_LEVEL;
use super::own_strengths::{Found as FoundByGroup, OwnStrengths, best_ones, own_strengths};
use super::place::places;
use super::rank::{Reference, Refit, added_parameters, form_overdispersion, gain_over, log_evidence_over};
use super::refits::{ALONE_SHARE, FIRST_LEVEL, LARGEST_NOISE_SCALE, LOG_ODDS, Refits, SHARE, estimates, excess_at, share_removed};
use super::screen::STRENGTH_PRIOR;
use super::strength_by_group::{UnlikeStrengths, unlike_strengths};
use super::structure::{STRUCTURE_LEVEL, StructureTest, p_text};
use super::terminal::short;
use super::verdict_words::verdict_words;
use crate::impact::effect_card;
use std::collections::BTreeMap;

/// Log evidence of a formula, or of an effect, that the error on held-out impacts alone does not show.
const CONVINCING: f64 = 10.0;
/// Chi-square by which a formula must beat the named effect, its search paid for, to put the name in doubt.
const FAR_MORE: f64 = 10.0;
/// Fall of the held-out impacts' chi-square that an effect beside those already in the model must bring (odds of seven to one), on
/// top of what choosing it among the catalogue is worth: what the first one's form leaves is imitated in part by some other.
const WORTH_A_FURTHER_EFFECT: f64 = 4.0;
/// What is left of the catalogue's probability when no form of the best effect does what is missing, or only a size of it that it hardly ever has: as
/// likely as not it is none of these.
const IMITATING: f64 = 0.5;
/// Typical sizes that an effect's only strength exceeds once in a hundred, by the prior that it is weighed with: 4.6 deviations of Student's t of 4
/// degrees of freedom.
const UNUSUAL: f64 = 4.604 * STRENGTH_PRIOR;
/// What one of several strengths exceeds so, less two deviations: alone these impacts may hardly tell it.
const UNCERTAIN: f64 = 2.0;
/// Deviations by which a strength that its physics has positive only must be negative to be told as such.
const REVERSED: f64 = 3.0;
/// Typical sizes from its default beyond which a shape parameter is hardly ever found: 2.2 at most in forty right names, 4.5 and more where a restitution
/// that falls along the racket passed for a mode.
const ELSEWHERE: f64 = 3.0;
/// What is left of an effect's probability when the held-out impacts refuse it.
const REFUSED: f64 = 0.3;

/// Effects fitted with the wide prior of what is in a model: the one that weighs an effect against others draws a large strength toward none.
struct Settled {
    strengths: BTreeMap<String, Estimate>,
    at_limit: Vec<AtLimit>,
}

/// A parameter at an end of its range.
struct AtLimit {
    name: String,
    value: f64,
    /// This end is that of no effect at all.
    is_none: bool,
}

impl AtLimit {
    fn words(&self) -> String {
        format!("{} is fitted at the end of its range ({}): the impacts ask for more than the card allows, or for another form", self.name, short(self.value))
    }
}

/// A verdict in the making.
pub(super) struct Judgement<'a> {
    case: &'a Case<'a>,
    refits: &'a Refits<'a>,
    reference: Reference<'a>,
    /// Noise may be misstated by half; what the best model leaves beyond that is not noise but something unexplained.
    c_believed: f64,
    /// Chi-square of the current model beyond noise.
    excess: f64,
    overdispersion: f64,
    verdict: Verdict,
    /// The catalogue's best effect or pair.
    chosen: Option<&'a Refit>,
    /// The held-out impacts refuse it.
    refused: bool,
    /// The held-out error with it.
    after: f64,
    /// A formula in the catalogue's place, one that mends the form of what is chosen, and the noise scale they end with.
    alone: Option<Found>,
    beside: Option<Found>,
    c_of_formula: f64,
    /// An effect whose strength is not alike in all groups.
    own: Option<Box<OwnStrengths>>,
    /// The held-out error with parameters of their own in each group, where these account for what is wrong.
    with_own_parameters: Option<f64>,
    /// What is chosen as it would be in the model.
    settled: Option<Settled>,
    /// Why what is named may only be like what is missing: no form of it takes the rest away.
    imitates: Option<String>,
    /// The same for being found unlike its card.
    unusual: Option<String>,
    notes: Vec<String>,
}

impl<'a> Judgement<'a> {
    /// The first verdict: is there a name, and does it account for what is wrong?
    pub fn new(case: &'a Case<'a>, reference: Reference<'a>, refits: &'a Refits<'a>) -> Result<Self, ValidationError> {
        let c_believed = refits.c.min(LARGEST_NOISE_SCALE);
        let best_left = refits.all().map(|r| excess_at(&r.structure, c_believed)).fold(f64::INFINITY, f64::min);
        let overdispersion = if best_left.is_finite() { form_overdispersion(best_left, case.structure.rank) } else { 1.0 };
        let mut judgement = Judgement {
            case,
            refits,
            c_of_formula: reference.c,
            reference,
            c_believed,
            excess: excess_at(&case.structure, c_believed),
            overdispersion,
            verdict: Verdict::Unexplained,
            chosen: None,
            refused: false,
            after: case.error,
            alone: None,
            beside: None,
            own: None,
            with_own_parameters: None,
            settled: None,
            imitates: None,
            unusual: None,
            notes: Vec::new(),
        };
        judgement.choose()?;
        judgement.settled = judgement.chosen.map(|b| judgement.settle(b)).transpose()?;
        let accounted = match judgement.chosen {
            Some(b) => judgement.accounts(b)?,
            None => false,
        };
        judgement.verdict = match (judgement.chosen, accounted) {
            (Some(_), true) => Verdict::EffectMissing,
            (None, _) if !case.smooth() && !case.one_place() => Verdict::Adequate,
            _ => Verdict::Unexplained,
        };
        if let (Some(b), Verdict::EffectMissing) = (judgement.chosen, judgement.verdict) {
            judgement.imitates = judgement.imitates(b)?;
            judgement.unusual = judgement.unusual(b);
        }
        Ok(judgement)
    }

    /// The best of the catalogue, unless it is the form of what the model has already, or what groups differ by.
    fn choose(&mut self) -> Result<(), ValidationError> {
        let case = self.case;
        let tested = case.screening.tested as f64;
        let stands_out = |name: &String| case.screening.of(case.library, name).is_some_and(|s| s.p_value * tested < FIRST_LEVEL);
        let best = self
            .refits
            .choose(self.overdispersion)
            .filter(|r| case.present.is_empty() && case.structure.by_group.is_empty() || r.effects.iter().all(stands_out));
        let imitated = match best {
            Some(r) => case.present.imitated_by(&r.effects, &self.reference, &case.structure, self.c_believed)?,
            None => None,
        };
        if let (Some(r), Some((own, share))) = (best, &imitated) {
            self.notes.push(format!(
                "{} would fit what is left, but {} {own}, with which {:.0} % of the excess is gone: more likely its form than a further effect",
                r.effects.join(" and "),
                if r.effects.len() == 1 { "imitates" } else { "imitate" },
                100.0 * share
            ));
        }
        self.chosen = best.filter(|_| imitated.is_none());
        if !case.present.is_empty() && self.chosen.is_none() {
            self.notes.push("what is left looks like the form of the effects already in the model, not like a further effect of the catalogue".to_owned());
        }
        self.after = self.chosen.map_or(case.error, |b| error_of(&b.held_out));
        Ok(())
    }

    /// Whether a model takes most of the excess away, or is likelier than nothing and leaves no structure. On the held-out impacts the same is judged with
    /// less data and without the fit's help: either may speak for it.
    fn accounts(&self, b: &Refit) -> Result<bool, ValidationError> {
        // Where a place on the face alone stands out there is no other excess to take away.
        if self.case.only_one_place() && self.reference.spot_beside(b)?.is_some_and(|s| s.p_value < SPOT_LEVEL) {
            return Ok(false);
        }
        let at_best = self.share_granted(excess_at(&b.structure, self.c_believed));
        let held = |error: f64| (error.powi(2) - self.c_believed).max(0.0);
        let sound = b.structure.p_value >= STRUCTURE_LEVEL && b.structure.noise_scale <= LARGEST_NOISE_SCALE;
        let likely = self.refits.is_likelier_than_nothing(b, self.overdispersion);
        Ok(at_best >= SHARE || share_removed(held(self.case.error), held(self.after)) >= SHARE || sound && likely)
    }

    /// Share of the excess that is gone where `left` is left. A share has its own uncertainty: what is left scatters by its deviation, which may not make
    /// a right name wrong.
    fn share_granted(&self, left: f64) -> f64 {
        share_removed(self.excess, (left - (2.0 * self.case.structure.rank as f64 + 4.0 * left).sqrt()).max(0.0))
    }

    /// That an effect may take much of the excess away for being like what is missing, not for being it, in words. The right effect in a form that is not quite
    /// nature's leaves much as well, but nearly all of that is gone when its strength may vary; what another mechanism does no form of it does. Of a
    /// pair each has shown already what it explains beyond any form of the other.
    fn imitates(&self, b: &Refit) -> Result<Option<String>, ValidationError> {
        let gone = share_removed(self.excess, excess_at(&b.structure, self.c_believed));
        let [name] = &b.effects[..] else { return Ok(None) };
        if b.structure.p_value >= STRUCTURE_LEVEL || gone >= ALONE_SHARE {
            return Ok(None);
        }
        let (left, p_value) = self.reference.left_in_any_form(b, self.c_believed)?;
        Ok((p_value < STRUCTURE_LEVEL && self.share_granted(left) < ALONE_SHARE).then(|| {
            format!(
                "But {name} takes {:.0} % of the excess away, and no form of it the rest ({:.0} % left, {}): it may only imitate, in part, something that the catalogue has not.",
                100.0 * gone,
                100.0 * left / self.excess,
                p_text(p_value),
            )
        }))
    }

    /// Where the model fails by groups and no effect of one strength for all accounts for it: one whose strength is each group's own, or the model's
    /// own parameters.
    pub fn ask_groups(&mut self) -> Result<(), ValidationError> {
        let Some(misfit) = self.case.structure.by_group.first().filter(|_| self.verdict == Verdict::Unexplained) else { return Ok(()) };
        match own_strengths(&self.reference, &misfit.column, self.refits.singles(), &self.case.structure, &self.case.held_out)? {
            // Of effects in the model already the other forms are not known here.
            Some(FoundByGroup::Effect(own)) if self.case.present.is_empty() => self.name_by_group(own),
            Some(FoundByGroup::Parameters { error, words }) => {
                self.with_own_parameters = Some(error);
                self.notes.push(words);
            }
            Some(FoundByGroup::Effect(_)) | None => {}
        }
        Ok(())
    }

    /// An effect with a strength of its own in each group, where one for all is not what the impacts say of the named effect, or of the best ones that
    /// account for too little.
    pub fn ask_groups_of_effects(&mut self) -> Result<(), ValidationError> {
        let case = self.case;
        let asked_before = self.verdict == Verdict::Unexplained && !case.structure.by_group.is_empty();
        let a_pair = self.chosen.is_some_and(|b| b.effects.len() > 1);
        if self.verdict == Verdict::Adequate || self.own.is_some() || self.refused || asked_before || a_pair || !case.present.is_empty() {
            return Ok(());
        }
        let unlike = |single: &Refit| -> Result<Option<UnlikeStrengths>, ValidationError> {
            let forward = case.library.with(&single.names())?;
            let strengths: Vec<usize> = self.reference.strengths_in(forward.as_ref(), &single.names()).iter().map(|s| s.0).collect();
            Ok(unlike_strengths(&single.fit, case.observations, &case.seen, &strengths, self.refits.c))
        };
        let found: Vec<UnlikeStrengths> =
            best_ones(self.refits.singles()).into_iter().filter_map(|single| unlike(single).transpose()).collect::<Result<_, _>>()?;
        let Some(most) = found.into_iter().min_by(|a, b| a.p_value.total_cmp(&b.p_value)) else { return Ok(()) };
        if let Some(FoundByGroup::Effect(own)) = own_strengths(&self.reference, &most.column, self.refits.singles(), &case.structure, &case.held_out)?
            && error_of(&own.held_out) < self.after
        {
            self.name_by_group(own);
        }
        Ok(())
    }

    fn name_by_group(&mut self, own: Box<OwnStrengths>) {
        self.verdict = Verdict::EffectMissing;
        self.chosen = None;
        self.after = error_of(&own.held_out);
        self.notes.push(own.words());
        self.own = Some(own);
    }

    /// A formula in the catalogue's place.
    pub fn look_for_formula(&mut self, wanted: bool) -> Result<(), ValidationError> {
        if wanted && self.verdict != Verdict::Adequate && self.own.is_none() {
            let mut reference = self.reference;
            // What the groups' own parameters account for, a formula of something else only imitates; one of the column itself says more.
            let imitates =
                |f: &Found| self.with_own_parameters.is_some_and(|e| f.suggestion.heldout_error_after >= e && !f.suggestion.expression.contains("column."));
            let found = find_expression(&mut reference, &self.case.screening, excess_believed, &self.case.structure)?;
            self.alone = found.filter(|f| !imitates(f));
            self.c_of_formula = reference.c;
        }
        Ok(())
    }

    /// What neither the catalogue nor the held-out impacts nor a formula speaks for is chance.
    pub fn leave_to_chance(&mut self) {
        let (case, floor) = (self.case, self.refits.c.sqrt());
        let told_by_formula = self.alone.as_ref().is_some_and(|f| f.log_evidence > CONVINCING && f.suggestion.heldout_error_after < case.error);
        if self.verdict != Verdict::Unexplained || case.in_library() || told_by_formula || !case.structure.by_group.is_empty() {
            return;
        }
        if !case.smooth() {
            self.verdict = Verdict::Adequate;
            self.notes.push(format!(
                "one place on the face alone stands out ({}), but a model with it does not lower the error on held-out impacts: not believed",
                p_text(case.spot_p_value)
            ));
        } else if let Some(why) = taken_for_chance(&case.structure, &case.base, &case.held_out, floor) {
            self.verdict = Verdict::Adequate;
            self.notes.push(why);
        }
    }

    /// An effect that makes the error worse on impacts the fit never saw is not added, unless they hardly meet it and the others
    /// are sure.
    pub fn ask_held_out(&mut self) {
        let (Some(best), Verdict::EffectMissing) = (self.chosen, self.verdict) else { return };
        let (case, c, before, after) = (self.case, self.refits.c, self.case.error, self.after);
        let names = best.effects.join(" and ");
        let price = WORTH_A_FURTHER_EFFECT + 2.0 * (case.screening.tested.max(1) as f64).ln();
        let told = best.log_evidence / self.overdispersion + log_evidence_of(&case.held_out, &best.held_out, c, f64::INFINITY);
        if after >= before && told < CONVINCING || !case.present.is_empty() && !is_worth(price, &case.held_out, &best.held_out, c) {
            self.verdict = if case.smooth() { Verdict::Unexplained } else { Verdict::Adequate };
            let falls = if after >= before { "does not fall" } else { "falls no more than by chance" };
            self.notes
                .push(format!("{names} would fit these impacts better, but the error on held-out impacts {falls} ({before:.3} to {after:.3}): not believed"));
            self.refused = true;
        } else if after >= before {
            // Groups held out whole may be those in which it does not act.
            let against = log_evidence_of(&case.held_out, &best.held_out, c, f64::INFINITY) < -LOG_ODDS;
            let (say, ask) = if against { ("speak against", ": ask whether it acts in all of them") } else { ("hardly meet", "") };
            self.notes.push(format!(
                "the held-out impacts {say} {names} (their error: {before:.3} to {after:.3}); it is named for what it explains in the others{ask}"
            ));
        }
    }

    /// Shots of one calibration share more than their table states.
    pub fn allow_shared_errors(&mut self) {
        let case = self.case;
        if self.verdict == Verdict::Unexplained
            && let Some(why) = taken_for_shared(case.observations, &case.structure, &case.base, &case.held_out)
        {
            self.verdict = Verdict::Adequate;
            self.notes.push(why);
        }
    }

    /// What the tests were not believed about may fail by its scatter, or on groups held out.
    pub fn ask_scatter_and_groups(&mut self) {
        if self.verdict == Verdict::Adequate && self.case.fails_without_structure(&mut self.notes) {
            self.verdict = Verdict::Unexplained;
        }
    }

    /// A name in any form of it against a formula: one that takes far more, and lowers the held-out error further, says that the
    /// name is not it.
    pub fn set_formula_against_name(&mut self) -> Result<(), ValidationError> {
        let (Some(best), Verdict::EffectMissing, Some(f)) = (self.chosen, self.verdict, &self.alone) else { return Ok(()) };
        let gain = gain_over(&self.case.base, &best.fit, self.c_of_formula);
        // No form of what only imitates takes more than it does; a formula with its signature is another form of it.
        let like_it = best.effects.iter().all(|name| f.suggestion.nearest.contains(name));
        let takes_most = gain >= SHARE * f.honest_gain && (self.imitates.is_none() || like_it);
        if takes_most || f.honest_gain - gain <= FAR_MORE || f.suggestion.heldout_error_after >= self.after {
            return Ok(());
        }
        let form = self.form_beside(best)?;
        let named = self.log_evidence_of_name(best) + form.as_ref().map_or(0.0, |b| b.log_evidence);
        if named + LOG_ODDS < f.log_evidence {
            self.verdict = Verdict::Unexplained;
            self.notes.push(format!(
                "{} fits, but takes {:.0} % of what a formula takes, and no other form of it does as well",
                best.effects.join(" and "),
                100.0 * gain / f.honest_gain
            ));
        }
        self.beside = form;
        Ok(())
    }

    /// Whether a formula takes more than the name and lowers the held-out error further, by odds of twenty to one, its search paid for.
    fn formula_does_better(&self, chosen: &Refit) -> bool {
        let gain = gain_over(&self.case.base, &chosen.fit, self.c_of_formula);
        self.alone.as_ref().is_some_and(|f| f.honest_gain > gain + 2.0 * LOG_ODDS && f.suggestion.heldout_error_after < self.after)
    }

    fn log_evidence_of_name(&self, chosen: &Refit) -> f64 {
        log_evidence_over(&self.case.base, &chosen.fit, self.c_of_formula, 0)
    }

    /// An expression that mends the form of the chosen effects, found from what they leave.
    fn form_beside(&self, chosen: &Refit) -> Result<Option<Found>, ValidationError> {
        let reference = Reference { c: self.c_of_formula, ..self.reference };
        let names = chosen.names();
        let library = reference.library.extended(&names, &chosen.fit.values)?;
        let mut beside = Reference { library: library.as_ref(), base: &chosen.fit, ..reference };
        let found = find_expression(&mut beside, &self.case.screening, excess_believed, &self.case.structure)?;
        let shared = reference.base.values.len();
        let with = reference.library.with(&names)?;
        Ok(found.filter(|f| f.log_evidence > LOG_ODDS).map(|mut f| {
            f.suggestion.words = format!("with {} in the model, {}", names.join(" and "), f.suggestion.words);
            // As the fit with the formula has them: without it they were the nearest its form could come.
            let beside = effects_text(&added_parameters(with.as_ref(), &f.fit, shared, reference.c));
            f.suggestion.model_file_text = beside + &f.suggestion.model_file_text;
            f
        }))
    }

    /// Writes the verdict, and everything that stands behind it, into the report of the case.
    pub fn report(mut self, mut diagnosis: Diagnosis, expressions: bool) -> Result<Diagnosis, ValidationError> {
        let case = self.case;
        diagnosis.verdict = self.verdict;
        diagnosis.notes.append(&mut self.notes);
        diagnosis.noise_floor = self.refits.c.sqrt();
        self.tell_places(&mut diagnosis)?;
        diagnosis.candidates = self.candidates()?;
        if let Some(own) = &self.own {
            self.tell_own_strengths(own, &mut diagnosis);
        }
        let believed = self.chosen.filter(|_| !self.refused);
        let mut goes_with_order = match believed {
            Some(best) => self.tell_believed(best, &mut diagnosis)?,
            None => false,
        };
        let named = self.verdict == Verdict::EffectMissing;
        let form_is_off = named && believed.is_some_and(|b| b.structure.p_value < STRUCTURE_LEVEL || self.formula_does_better(b));
        if expressions
            && (self.verdict == Verdict::Unexplained || form_is_off)
            && let Some(found) = self.best_formula()?
        {
            diagnosis.noise_floor = diagnosis.noise_floor.min(found.structure.noise_scale.sqrt()).min(self.c_of_formula.sqrt());
            goes_with_order |= found.goes_with_order;
            diagnosis.suggested_expression = Some(found.suggestion);
        }
        if form_is_off {
            diagnosis.other_form = diagnosis.recommended.first().cloned();
        }
        if self.verdict != Verdict::Adequate && !self.refused && self.own.is_none() {
            diagnosis.notes.extend(self.refits.refused_pair());
        }
        let at_the_floor = diagnosis.heldout_error < 1.1 * diagnosis.noise_floor;
        let sound = at_the_floor || (self.chosen.is_none_or(|b| b.structure.p_value >= STRUCTURE_LEVEL) && self.verdict != Verdict::Unexplained);
        note_noise(diagnosis.noise_floor, sound || diagnosis.suggested_expression.is_some(), &mut diagnosis.notes);
        if goes_with_order {
            diagnosis.notes.extend(slow_columns_words(&slow_columns(case.observations, &case.seen)));
        }
        // Names that take nothing away are not worth an experiment.
        if named && self.own.is_none() {
            diagnosis.next_experiments = self.refits.next_experiments(&self.reference, &diagnosis.candidates)?;
        }
        let of_name = self.imitates.take().into_iter().chain(self.unusual.take()).filter(|_| believed.is_some());
        let by_group = self.own.as_ref().map(|own| own.in_short());
        let doubts = if self.verdict == Verdict::Adequate { case.doubts() } else { of_name.chain(by_group).collect() };
        diagnosis.words = verdict_words(&diagnosis, doubts);
        case.tell_stopped(&mut diagnosis);
        Ok(diagnosis)
    }

    /// Where a model fails shows without the offsets of the cameras that it asks for in the place of what it lacks.
    fn tell_places(&self, diagnosis: &mut Diagnosis) -> Result<(), ValidationError> {
        let case = self.case;
        let likely = fit_with_likely_offsets(case.library.current(), case.observations, &case.seen, &FitOptions::default())?;
        if let Some((offset, _)) = &likely.unlikely {
            let error = held_out_error(case.library.current(), &likely.fit, case.observations)?;
            diagnosis
                .notes
                .push(format!("the model asks for {offset}: where it fails is told without any offset (its error on held-out impacts is {error:.2} then)"));
        }
        diagnosis.places = places(&case.seen, &likely.fit.impacts, &varied_coordinates(case.observations), &case.structure.by_group, self.refits.c);
        Ok(())
    }

    fn tell_own_strengths(&self, own: &OwnStrengths, diagnosis: &mut Diagnosis) {
        own.tell_candidates(&mut diagnosis.candidates);
        diagnosis.candidates.sort_by(|a, b| b.probability.total_cmp(&a.probability).then(a.effect.cmp(&b.effect)));
        diagnosis.recommended = vec![own.effect.clone()];
        diagnosis.notes.extend(self.case.library.effects().iter().filter(|o| o.name == own.effect).filter_map(check_first));
        diagnosis.structure_after = Some(own.structure.clone());
        diagnosis.noise_floor = diagnosis.noise_floor.min(own.c.sqrt());
        diagnosis.outliers = outliers(&self.case.seen, &own.fit.impacts, &self.case.held, &own.held_out);
    }

    /// The effect or pair that is chosen and not refused. Says whether what it adds goes with the order of the impacts.
    fn tell_believed(&self, best: &Refit, diagnosis: &mut Diagnosis) -> Result<bool, ValidationError> {
        let case = self.case;
        let mut goes_with_order = false;
        diagnosis.structure_after = Some(best.structure.clone());
        if self.verdict == Verdict::EffectMissing {
            diagnosis.recommended = best.effects.clone();
            goes_with_order = self.reference.adds_what_goes_with_order(case.library.with(&best.names())?.as_ref(), &best.fit)?;
        }
        let Some(Settled { strengths, at_limit }) = &self.settled else { return Ok(goes_with_order) };
        diagnosis.notes.extend(at_limit.iter().map(AtLimit::words));
        let named = case.library.effects().iter().filter(|o| diagnosis.recommended.contains(&o.name));
        diagnosis.notes.extend(named.filter_map(check_first));
        match best.effects.as_slice() {
            [only] => diagnosis.candidates.iter_mut().filter(|c| c.effect == *only).for_each(|c| c.parameters.clone_from(strengths)),
            _ => diagnosis.together = Some(self.together(best, strengths.clone())),
        }
        diagnosis.outliers = outliers(&case.seen, &best.fit.impacts, &case.held, &best.held_out);
        Ok(goes_with_order)
    }

    /// What doubts leave of the catalogue's probability.
    fn kept(&self) -> f64 {
        if self.imitates.is_some() || self.unusual.is_some() { IMITATING } else { 1.0 }
    }

    fn candidates(&self) -> Result<Vec<CandidateReport>, ValidationError> {
        let mut list = self.refits.report(&self.reference, &self.case.screening, self.case.error, self.excess, self.overdispersion, self.verdict)?;
        if let (true, Some(refused)) = (self.refused, self.chosen) {
            list.iter_mut().filter(|c| refused.effects.contains(&c.effect)).for_each(|c| c.probability *= REFUSED);
        }
        list.iter_mut().for_each(|c| c.probability *= self.kept());
        list.sort_by(|a, b| b.probability.total_cmp(&a.probability).then(b.log_evidence_gain.total_cmp(&a.log_evidence_gain)).then(a.effect.cmp(&b.effect)));
        if self.verdict == Verdict::Adequate {
            less_likely_than_nothing(&mut list);
        }
        Ok(list)
    }

    /// Fits the effects as they would be in the model.
    fn settle(&self, best: &Refit) -> Result<Settled, ValidationError> {
        let library = self.case.library.extended(&best.names(), &best.fit.values)?;
        let (forward, start) = (library.current(), Start { fit: &best.fit, keep_jacobians: library.current().costly() });
        let options = FitOptions { start_values: Some(best.fit.values.clone()), ..FitOptions::default() };
        let fit = fit(forward, self.case.observations, &self.case.seen, &options, Some(start))?;
        let shared = self.case.base.values.len();
        let added = forward.parameters().iter().zip(&fit.values).skip(shared);
        let at_limit = added
            .filter(|(p, v)| **v <= p.min || **v >= p.max)
            .map(|(p, v)| AtLimit { name: p.name.clone(), value: *v, is_none: p.prior.is_some_and(|prior| prior.mean == *v) })
            .collect();
        Ok(Settled { strengths: estimates(&added_parameters(forward, &fit, shared, self.refits.c)), at_limit })
    }

    /// That an effect is named at a size or in a form that it hardly ever has, in words: it may be something else that has its signature.
    fn unusual(&self, b: &Refit) -> Option<String> {
        let (name, how) = match (&b.strengths[..], &b.effects[..]) {
            ([strength], [only]) if strength.abs() > UNUSUAL => (only, format!("at {:.0} times its usual size", strength.abs())),
            (_, effects) => effects.iter().find_map(|name| Some((name, self.unlike_its_card(name)?)))?,
        };
        Some(format!("But {name} is found {how}: something else with the same signature may be at work, and these impacts cannot tell."))
    }

    /// What of an effect as it is found is not as its card has it.
    fn unlike_its_card(&self, name: &str) -> Option<String> {
        let settled = self.settled.as_ref()?;
        let outline = self.case.library.effects().iter().find(|o| o.name == name)?;
        for s in outline.strengths.iter().filter(|s| s.one_way) {
            let found = settled.strengths.get(&s.parameter)?;
            if found.value < s.absent - REVERSED * found.sd {
                return Some(format!("the other way round ({} {} ± {})", s.parameter, short(found.value), short(found.sd)));
            }
        }
        for p in effect_card(name)?.parameters.iter().filter(|p| !p.is_strength()) {
            let Some(found) = settled.strengths.get(&format!("{name}.{}", p.name)) else { continue };
            let sizes = (found.value - p.default).abs() / p.typical;
            if sizes > ELSEWHERE {
                return Some(format!("with {} {sizes:.0} deviations from where it usually lies", p.name));
            }
        }
        if let Some(end) = settled.at_limit.iter().find(|l| !l.is_none && l.name.starts_with(&format!("{name}."))) {
            return Some(format!("at the end of what its card allows ({} {})", end.name, short(end.value)));
        }
        for s in outline.strengths.iter().filter(|_| outline.strengths.len() > 1) {
            let found = settled.strengths.get(&s.parameter)?;
            if (found.value - s.absent).abs() - UNCERTAIN * found.sd > UNUSUAL * s.typical {
                let sizes = (found.value - s.absent).abs() / s.typical;
                return Some(format!("at {sizes:.0} times its usual size ({} {} ± {})", s.parameter, short(found.value), short(found.sd)));
            }
        }
        None
    }

    /// Two effects as one model.
    fn together(&self, best: &Refit, strengths: BTreeMap<String, Estimate>) -> Together {
        Together {
            effects: best.effects.clone(),
            probability: self.refits.probability_of(best, self.overdispersion) * self.kept(),
            heldout_error_before: self.case.error,
            heldout_error_after: self.after,
            log_evidence_gain: best.log_evidence,
            share_removed: share_removed(self.excess, excess_at(&best.structure, self.c_believed)),
            parameters: strengths,
        }
    }

    /// The formula to offer: in the effect's place, or beside it when the effect with its form mended says more.
    fn best_formula(&mut self) -> Result<Option<Found>, ValidationError> {
        let catalogue = self.chosen.map_or(0.0, |b| self.log_evidence_of_name(b));
        let unexplained = self.verdict == Verdict::Unexplained;
        let lowers = |f: &Found| f.suggestion.heldout_error_after < self.case.error;
        let alone = self.alone.take().filter(|f| lowers(f) && (unexplained || f.log_evidence > catalogue + LOG_ODDS));
        if let (Some(b), false, None) = (self.chosen, self.refused, &self.beside) {
            self.beside = self.form_beside(b)?;
        }
        let least = self.after.min(self.case.error);
        let beside = self.beside.take().filter(|f| f.suggestion.heldout_error_after < least);
        Ok(match (alone, beside) {
            (Some(a), Some(b)) => Some(if catalogue + b.log_evidence > a.log_evidence + LOG_ODDS { b } else { a }),
            (a, b) => a.or(b),
        })
    }
}

fn check_first(effect: &EffectOutline) -> Option<String> {
    Some(format!("check before {} is added: {}", effect.name, effect.check_first?))
}

/// The excess of a structure test at a noise scale that is believed.
fn excess_believed(test: &StructureTest, c: f64) -> f64 {
    excess_at(test, c.min(LARGEST_NOISE_SCALE))
}

/// What else may stand behind what goes with the order of the impacts.
fn slow_columns_words(columns: &[String]) -> Option<String> {
    let names: Vec<String> = columns.iter().map(|c| format!("`{c}`")).collect();
    (!names.is_empty()).then(|| {
        format!(
            "over the table {} {} slowly or in blocks: what seems to go with the order of the impacts may go with that; impacts in a mixed order would tell",
            names.join(" and "),
            if names.len() == 1 { "changes" } else { "change" }
        )
    })
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
        text.push_str(&format!("{parameter} = {{ value = {}, fit = true }}\n", short(*value)));
    }
    if !text.is_empty() {
        text.push('\n');
    }
    text
}
