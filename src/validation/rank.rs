//! Refits of the full non-linear model with one or two effects, ranked by evidence.
//!
//! Laplace evidence at noise scale c: log likelihood, priors of 1.5 typical sizes on the strengths (one half of it
//! where only one side is physical), half the log determinant (docs/diagnosis.md, "In formulas", evidence; MacKay 1992).
//!
//! A formula of the catalogue is never quite nature's. When the best model still leaves structure behind, differences of
//! evidence between candidates are worth less than they seem: the part of the signal that no formula catches could favour
//! either. The remaining excess is spread over [`FORM_FREEDOM`] directions of misfit, and all log evidences are divided by
//! that overdispersion before they become probabilities.
//!
//! A second effect must not be the first one's wrong form: it counts only by what it explains after the first one's
//! strength was allowed to vary smoothly with speed, place, obliqueness and spin.

use super::by_group::{FREE, GroupMisfit, known_signatures};
use super::error::ValidationError;
use super::expression::local_spot;
use super::fit::{Column, Fit, FitOptions, Start, fit};
use super::forward::{Forward, Library, Strength};
use super::heldout::linearise_held_out;
use super::linearise::Linearised;
use super::local_spot::LocalSpot;
use super::lone_term::LoneTerm;
use super::observation::{Observation, Observations};
use super::predicted::difference;
use super::project::{Nuisance, beside};
use super::screen::{Screening, screen_beyond};
use super::structure::{BesideSmooth, StructureTest, form_features, structure_beyond, structure_test};
use super::tails::chi2_tail;
use nalgebra::DMatrix;

/// Directions in which a catalogue formula may differ from nature's (see the module's text).
pub const FORM_FREEDOM: f64 = 4.0;
/// Prior deviation of each smooth variation of an effect's strength, relative to the strength itself.
const FORM_SHARE: f64 = 0.5;
/// Chi-square by which what is added to a model must change with the order of the impacts to be said to go with it. An effect without the order that meets
/// one with it, in a model that has both, changes by less.
const GOES_WITH_ORDER: f64 = 10.0;

/// The current model with effects, refitted.
pub struct Refit {
    /// Names, in the order given to the library.
    pub effects: Vec<String>,
    pub fit: Fit,
    pub structure: StructureTest,
    /// The impacts that the fit did not see.
    pub held_out: Vec<Linearised>,
    /// Strengths, as differences from `absent`, in typical sizes.
    pub strengths: Vec<f64>,
    one_sided: usize,
    /// An effect's only strength has the other sign than its card gives it: a ball that softens as it is squeezed.
    pub against_card: bool,
    /// For each effect, its strengths: place among the fit's columns, and whether only one side is physical.
    blocks: Vec<Vec<(usize, bool)>>,
    /// The following hold at the noise scale last given to [`Refit::judge`].
    ///
    /// Log evidence less that of the current model.
    pub log_evidence: f64,
    /// Fall in minus twice the log likelihood.
    pub gain: f64,
    pub p_value: f64,
    /// Largest share of the gain that comes from one impact.
    pub largest_share: f64,
    /// p-value of the gain of all other impacts.
    pub p_of_others: f64,
}

impl Refit {
    /// The effects' names, as a library asks for them.
    pub fn names(&self) -> Vec<&str> {
        self.effects.iter().map(String::as_str).collect()
    }

    /// Evidence and gain over the current model at noise scale `c`.
    pub fn judge(&mut self, base: &Fit, c: f64) {
        let by_impact: Vec<f64> =
            base.impacts.iter().zip(&self.fit.impacts).map(|(b, f)| (b.z.norm_squared() - f.z.norm_squared()) / c + b.log_det - f.log_det).collect();
        let largest = by_impact.iter().copied().fold(0.0, f64::max);
        // With the offsets' priors: what a session's offsets had to bend for is relieved by the effect.
        self.gain = gain_over(base, &self.fit, c);
        self.largest_share = if self.gain > 0.0 { largest / self.gain } else { 1.0 };
        let freedom = self.strengths.len().max(1) as f64;
        self.p_value = chi2_tail(self.gain, freedom);
        self.p_of_others = chi2_tail((self.gain - largest).max(0.0), freedom);
        let spikes: f64 = self.blocks.iter().map(|b| with_absent_strengths(&self.fit, b, c)).sum();
        self.log_evidence = log_evidence_over(base, &self.fit, c, self.one_sided) + spikes;
    }
}

/// What a refit is judged against.
#[derive(Clone, Copy)]
pub struct Reference<'a> {
    pub library: &'a dyn Library,
    pub observations: &'a Observations,
    pub impacts: &'a [&'a Observation],
    pub base: &'a Fit,
    /// Columns whose groups the base fails by.
    pub groups: &'a [GroupMisfit],
    /// The single term it fails by.
    pub lone_term: Option<LoneTerm>,
    /// Noise scale c.
    pub c: f64,
    pub seed: u64,
}

/// Minus twice the log posterior of a fit at noise scale c.
fn minus_two_log(fit: &Fit, c: f64) -> f64 {
    let log_det: f64 = fit.impacts.iter().map(|l| l.log_det).sum();
    (fit.objective - log_det) / c + log_det
}

/// Fall in minus twice the log posterior from `base` to `fit`, at noise scale c.
pub fn gain_over(base: &Fit, fit: &Fit, c: f64) -> f64 {
    minus_two_log(base, c) - minus_two_log(fit, c)
}

/// ln |information / c|, over the columns that are informed at all.
fn log_det_information(fit: &Fit, c: f64) -> f64 {
    let informed: Vec<usize> = (0..fit.information.nrows()).filter(|&i| fit.information[(i, i)] > 0.0).collect();
    let n = informed.len();
    let root: Vec<f64> = informed.iter().map(|&i| fit.information[(i, i)].sqrt()).collect();
    let scaled = DMatrix::from_fn(n, n, |i, j| fit.information[(informed[i], informed[j])] / (root[i] * root[j]));
    let correlation: f64 = scaled.symmetric_eigen().eigenvalues.iter().map(|l| l.max(1e-12).ln()).sum();
    correlation + root.iter().map(|r| 2.0 * r.ln()).sum::<f64>() - n as f64 * c.ln()
}

/// Log evidence of `fit` over `base`, both at noise scale `c`; `one_sided` of the added strengths are half-normal.
pub fn log_evidence_over(base: &Fit, fit: &Fit, c: f64, one_sided: usize) -> f64 {
    let shared = base.values.len();
    let prior: f64 = fit
        .columns
        .iter()
        .zip(fit.prior_sd.iter())
        .filter(|(column, _)| matches!(column, Column::Parameter(i) if *i >= shared))
        .map(|(_, sd)| -0.5 * (sd * sd * c).ln())
        .sum();
    -0.5 * (minus_two_log(fit, c) - minus_two_log(base, c)) - 0.5 * (log_det_information(fit, c) - log_det_information(base, c))
        + prior
        + one_sided as f64 * std::f64::consts::LN_2
}

/// What an effect of several strengths gains in log evidence when each of them may be absent: half for the first of its card
/// alone, which is what gives the effect its name, the other half for all other combinations but none. Without it an effect
/// pays for every strength its card lists, and loses against a narrower one that does the same. Each combination's evidence
/// by the density ratio at absence (Dickey 1971), on the Laplace approximation.
pub(super) fn with_absent_strengths(fit: &Fit, strengths: &[(usize, bool)], c: f64) -> f64 {
    let m = strengths.len();
    if !(2..=8).contains(&m) {
        return 0.0;
    }
    let combinations = (1usize << m) - 1;
    let first_alone = combinations - 1;
    let logs: Vec<f64> = (0..combinations)
        .map(|dropped| {
            let which: Vec<(usize, bool)> = (0..m).filter(|i| dropped >> i & 1 == 1).map(|i| strengths[i]).collect();
            let d = which.len();
            let covariance = DMatrix::from_fn(d, d, |i, j| c * fit.covariance[(which[i].0, which[j].0)]);
            let away = nalgebra::DVector::from_fn(d, |i, _| fit.column_values[which[i].0] - fit.prior_mean[which[i].0]);
            let odds = if dropped == first_alone { 0.5 } else { 0.5 / (combinations - 1) as f64 };
            if d == 0 {
                return odds.ln();
            }
            let Some(root) = covariance.cholesky() else { return f64::NEG_INFINITY };
            let log_det: f64 = root.l().diagonal().iter().map(|v| 2.0 * v.ln()).sum();
            let posterior = -0.5 * (away.dot(&root.solve(&away)) + log_det);
            // The factors of 2π cancel; a half-normal prior is twice as dense.
            let prior: f64 =
                which.iter().map(|(at, half)| -0.5 * (fit.prior_sd[*at].powi(2) * c).ln() + if *half { std::f64::consts::LN_2 } else { 0.0 }).sum();
            posterior - prior + odds.ln()
        })
        .collect();
    let top = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    top + logs.iter().map(|l| (l - top).exp()).sum::<f64>().ln()
}

impl Reference<'_> {
    /// What the base fails by beside the smooth corrections.
    pub fn beside_smooth(&self) -> BesideSmooth<'_> {
        BesideSmooth::Known { groups: self.groups, lone_term: self.lone_term }
    }

    /// Places of the effects' strengths among the free parameters.
    pub(super) fn strengths_in(&self, forward: &dyn Forward, effects: &[&str]) -> Vec<(usize, Strength)> {
        effects
            .iter()
            .filter_map(|name| self.library.outline(name))
            .flat_map(|o| &o.strengths)
            .filter_map(|s| Some((forward.place_of(&s.parameter)?, s.clone())))
            .collect()
    }

    /// The current model with `effects`, fitted from the screening's strengths.
    ///
    /// # Errors
    /// [`ValidationError::NoPrediction`] when it has no answer for an impact.
    pub fn fit_with(&self, effects: &[&str], strengths: &[f64]) -> Result<(Box<dyn Forward + '_>, Fit), ValidationError> {
        let forward = self.library.with(effects)?;
        let shared = self.base.values.len();
        let mut start = self.base.values.clone();
        start.extend(forward.parameters()[shared..].iter().map(|p| p.value));
        let places = self.strengths_in(forward.as_ref(), effects);
        for ((at, s), by) in places.iter().zip(strengths) {
            let limits = &forward.parameters()[*at];
            // A linear guess beyond three typical sizes is no guide.
            start[*at] = (s.absent + by.clamp(-3.0 * s.typical, 3.0 * s.typical)).clamp(limits.min, limits.max);
        }
        let options = FitOptions { start_values: Some(start), ..FitOptions::default() };
        let begin = Start { fit: self.base, keep_jacobians: forward.costly() };
        let fitted = fit(forward.as_ref(), self.observations, self.impacts, &options, Some(begin))?;
        Ok((forward, fitted))
    }

    /// [`Self::fit_with`], judged.
    ///
    /// # Errors
    /// [`ValidationError::NoPrediction`] when the refitted model has no answer for an impact, held out or not.
    pub fn refit(&self, effects: &[&str], strengths: &[f64]) -> Result<Refit, ValidationError> {
        let (forward, fitted) = self.fit_with(effects, strengths)?;
        let places = self.strengths_in(forward.as_ref(), effects);
        let structure = structure_test(&fitted, self.observations, self.impacts, self.beside_smooth(), self.seed);
        let held_out = linearise_held_out(forward.as_ref(), &fitted, self.observations, &self.observations.side(true))?;
        let mut refit = Refit {
            effects: effects.iter().map(|s| (*s).to_owned()).collect(),
            strengths: places.iter().map(|(at, s)| (fitted.values[*at] - s.absent) / s.typical).collect(),
            one_sided: places.iter().filter(|(_, s)| s.one_sided).count(),
            against_card: match places.as_slice() {
                [(at, s)] => (s.usual - s.absent) * (fitted.values[*at] - s.absent) < 0.0,
                _ => false,
            },
            blocks: effects
                .iter()
                .map(|name| {
                    let own = self.strengths_in(forward.as_ref(), &[name]);
                    own.iter().filter_map(|(at, s)| Some((fitted.column_of(*at)?, s.one_sided))).collect()
                })
                .collect(),
            fit: fitted,
            structure,
            held_out,
            log_evidence: 0.0,
            gain: 0.0,
            p_value: 1.0,
            largest_share: 1.0,
            p_of_others: 1.0,
        };
        refit.judge(self.base, self.c);
        Ok(refit)
    }

    /// Whether what `forward` adds to the current model would be another if all impacts were the first in time.
    pub fn adds_what_goes_with_order(&self, forward: &dyn Forward, fit: &Fit) -> Result<bool, ValidationError> {
        let without = self.library.current().prepare(&fit.values[..self.base.values.len()])?;
        let with = forward.prepare(&fit.values)?;
        let added = |impacts: &[&Observation]| difference(with.as_ref(), without.as_ref(), impacts, &fit.impacts);
        let first = self.impacts.iter().map(|o| o.order).fold(f64::INFINITY, f64::min);
        let as_first: Vec<Observation> = self.impacts.iter().map(|o| Observation { order: first, ..(*o).clone() }).collect();
        let changes = added(self.impacts).into_iter().zip(added(&as_first.iter().collect::<Vec<_>>()));
        let chi2: f64 = changes.zip(&fit.impacts).map(|((own, as_first), l)| (&l.whitener * (own - as_first)).norm_squared()).sum();
        Ok(chi2 > GOES_WITH_ORDER * self.c)
    }

    /// What further effects explain at `first`'s fit, in its own form.
    pub fn screen_next(&self, first: &Refit) -> Result<Screening, ValidationError> {
        let names = first.names();
        let library = self.library.extended(&names, &first.fit.values)?;
        screen_beyond(library.as_ref(), &first.fit, self.impacts, self.c, &Nuisance::of(&first.fit), None)
    }

    /// The place on the face that stands out most once `first` is in the model, in any form of it.
    pub fn spot_beside(&self, first: &Refit) -> Result<Option<LocalSpot>, ValidationError> {
        let (library, nuisance) = self.beside_any_form(first)?;
        Ok(local_spot(&Reference { library: library.as_ref(), base: &first.fit, ..*self }, &nuisance))
    }

    /// The excess that smooth corrections find beside any form of `first`, at a noise scale that is believed, and its p-value.
    pub fn left_in_any_form(&self, first: &Refit, c: f64) -> Result<(f64, f64), ValidationError> {
        let (_, nuisance) = self.beside_any_form(first)?;
        Ok(structure_beyond(&first.fit, self.observations, self.impacts, &nuisance, c, self.seed))
    }

    /// The model with `first` in it, and what any form of it can absorb.
    fn beside_any_form(&self, first: &Refit) -> Result<(Box<dyn Library + '_>, Nuisance), ValidationError> {
        let names = first.names();
        let forward = self.library.with(&names)?;
        let library = self.library.extended(&names, &first.fit.values)?;
        let places = self.strengths_in(forward.as_ref(), &names);
        let nuisance = flexible_nuisance(forward.as_ref(), &first.fit, self.observations, self.impacts, &places, self.groups)?;
        Ok((library, nuisance))
    }

    /// What further effects explain at `first`'s fit, once `first` may have another form. `only`: the effects to look at.
    pub fn screen_second(&self, first: &Refit, only: Option<&[&str]>) -> Result<Screening, ValidationError> {
        let (library, nuisance) = self.beside_any_form(first)?;
        screen_beyond(library.as_ref(), &first.fit, self.impacts, self.c, &nuisance, only)
    }
}

/// The fit's columns, each strength's contribution times smooth features (the effects in any other form), and what groups that the model
/// fails by have of their own.
pub fn flexible_nuisance(
    forward: &dyn Forward,
    fit: &Fit,
    observations: &Observations,
    impacts: &[&Observation],
    places: &[(usize, Strength)],
    groups: &[GroupMisfit],
) -> Result<Nuisance, ValidationError> {
    if places.is_empty() && groups.is_empty() {
        return Ok(Nuisance::of(fit));
    }
    let features = form_features(fit, observations, impacts);
    let with = forward.prepare(&fit.values)?;
    // One contribution per strength: what the model loses when this strength alone is absent.
    let contributions = places
        .iter()
        .map(|(at, s)| {
            let mut values = fit.values.clone();
            values[*at] = s.absent;
            let without = forward.prepare(&values)?;
            Ok(difference(with.as_ref(), without.as_ref(), impacts, &fit.impacts))
        })
        .collect::<Result<Vec<_>, ValidationError>>()?;
    let width = features.ncols();
    let blocks: Vec<DMatrix<f64>> = fit
        .impacts
        .iter()
        .enumerate()
        .map(|(i, l)| {
            let mut block = DMatrix::zeros(l.z.len(), width * contributions.len());
            for (s, contribution) in contributions.iter().enumerate() {
                let contribution = &l.whitener * &contribution[i];
                for f in 0..width {
                    block.set_column(s * width + f, &(&contribution * features[(i, f)]));
                }
            }
            block
        })
        .collect();
    let own = known_signatures(fit, observations, impacts, groups);
    let both: Vec<DMatrix<f64>> = blocks.iter().zip(&own).map(|(a, b)| beside(a, b)).collect();
    Nuisance::with_columns(fit, &both, |column| if column < width * contributions.len() { FORM_SHARE.powi(-2) } else { FREE })
}

/// Overdispersion by which log evidences are divided: 1 when the best model leaves no structure. `left` is its excess over
/// `rank` generic directions; what chance leaves (two deviations) does not count.
pub fn form_overdispersion(left: f64, rank: usize) -> f64 {
    1.0 + (left - 2.0 * (2.0 * rank as f64).sqrt()).max(0.0) / FORM_FREEDOM
}

/// The name of every free parameter beyond those of the current model, with value and deviation at noise scale c.
pub fn added_parameters(forward: &dyn Forward, fit: &Fit, shared: usize, c: f64) -> Vec<(String, f64, f64)> {
    forward.parameters().iter().enumerate().skip(shared).map(|(i, p)| (p.name.clone(), fit.values[i], fit.sd(i, c))).collect()
}
