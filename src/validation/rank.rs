//! Refits of the full non-linear model with one or two effects, ranked by evidence.
//!
//! Laplace evidence at noise scale c: log likelihood, normal priors of 1.5 typical sizes on the strengths (half-normal
//! where only one side is physical), half the log determinant (missing-physics.md, section 5; MacKay 1992).
//!
//! A formula of the catalogue is never quite nature's. When the best model still leaves structure behind, differences of
//! evidence between candidates are worth less than they seem: the part of the signal that no formula catches could favour
//! either. The remaining excess is spread over [`FORM_FREEDOM`] directions of misfit, and all log evidences are divided by
//! that overdispersion before they become probabilities.

use super::error::ValidationError;
use super::fit::{Fit, FitOptions, Start, fit};
use super::forward::{Forward, Library};
use super::observation::{Observation, Observations};
use super::structure::{StructureTest, chi2_tail, structure_test};

/// Directions in which a catalogue formula may differ from nature's (see the module's text).
pub const FORM_FREEDOM: f64 = 4.0;

/// The current model with effects, refitted.
pub struct Refit {
    /// Names, in the order of the library.
    pub effects: Vec<String>,
    pub fit: Fit,
    /// Log evidence less that of the current model.
    pub log_evidence: f64,
    /// Fall in minus twice the log likelihood, at noise scale c.
    pub gain: f64,
    pub p_value: f64,
    pub structure: StructureTest,
    /// Strengths, as differences from `absent`, in typical sizes.
    pub strengths: Vec<f64>,
    /// Largest share of the gain that comes from one impact.
    pub largest_share: f64,
}

/// What a refit is judged against.
pub struct Reference<'a> {
    pub library: &'a dyn Library,
    pub observations: &'a Observations,
    pub impacts: &'a [&'a Observation],
    pub base: &'a Fit,
    /// Noise scale c.
    pub c: f64,
    pub seed: u64,
}

/// Minus twice the log posterior of a fit at noise scale c, and half the log determinant of its information.
fn minus_two_log(fit: &Fit, c: f64) -> f64 {
    let log_det: f64 = fit.impacts.iter().map(|l| l.log_det).sum();
    (fit.objective - log_det) / c + log_det
}

fn log_det_information(fit: &Fit, c: f64) -> f64 {
    let n = fit.information.nrows();
    // Directions that nothing informs (friction where nothing slides) cancel between models: the same floor for all.
    fit.information.clone().symmetric_eigen().eigenvalues.iter().map(|l| (l.max(1e-12) / c).ln()).sum::<f64>() + 0.0 * n as f64
}

/// Log evidence of `fit` over `base`, both at noise scale `c`; `one_sided` of the added strengths are half-normal.
pub fn log_evidence_over(base: &Fit, fit: &Fit, c: f64, one_sided: usize) -> f64 {
    let shared = base.values.len();
    let prior: f64 = fit
        .columns
        .iter()
        .zip(fit.prior_precision.iter())
        .filter(|(column, p)| matches!(column, super::fit::Column::Parameter(i) if *i >= shared) && **p > 0.0)
        .map(|(_, p)| 0.5 * (p / c).ln())
        .sum();
    -0.5 * (minus_two_log(fit, c) - minus_two_log(base, c)) - 0.5 * (log_det_information(fit, c) - log_det_information(base, c))
        + prior
        + one_sided as f64 * std::f64::consts::LN_2
}

impl Reference<'_> {
    /// Refits the current model with `effects`, from the screening's strengths (and from their opposite when that may be).
    pub fn refit(&self, effects: &[&str], strengths: &[f64]) -> Result<Refit, ValidationError> {
        let forward = self.library.with(effects)?;
        let outlines: Vec<_> = effects.iter().filter_map(|name| self.library.effects().iter().find(|o| o.name == *name)).collect();
        let shared = self.base.values.len();
        let mut start = self.base.values.clone();
        start.extend(forward.parameters()[shared..].iter().map(|p| p.value));
        // Columns of the strengths within the free parameters: each effect's strengths come first among its own.
        let mut places = Vec::new();
        for outline in &outlines {
            for s in &outline.strengths {
                if let Some(at) = forward.parameters().iter().position(|p| p.name == s.parameter) {
                    places.push((at, s.clone()));
                }
            }
        }
        for ((at, s), by) in places.iter().zip(strengths) {
            let limits = &forward.parameters()[*at];
            // A linear guess beyond three typical sizes is no guide.
            start[*at] = (s.absent + by.clamp(-3.0 * s.typical, 3.0 * s.typical)).clamp(limits.min, limits.max);
        }
        let options = FitOptions { start_values: Some(start), ..FitOptions::default() };
        let begin = Start { fit: self.base, keep_jacobians: forward.costly() };
        let fitted = fit(forward.as_ref(), self.observations, self.impacts, &options, Some(begin))?;
        let one_sided = places.iter().filter(|(_, s)| s.one_sided).count();
        let log_evidence = log_evidence_over(self.base, &fitted, self.c, one_sided);
        let by_impact: Vec<f64> =
            self.base.impacts.iter().zip(&fitted.impacts).map(|(b, f)| (b.z.norm_squared() - f.z.norm_squared()) / self.c + b.log_det - f.log_det).collect();
        let gain = by_impact.iter().sum::<f64>();
        let largest = by_impact.iter().copied().fold(0.0, f64::max);
        let structure = structure_test(&fitted, self.observations, self.impacts, self.seed);
        Ok(Refit {
            effects: effects.iter().map(|s| (*s).to_owned()).collect(),
            p_value: chi2_tail(gain, places.len().max(1) as f64),
            strengths: places.iter().map(|(at, s)| (fitted.values[*at] - s.absent) / s.typical).collect(),
            largest_share: if gain > 0.0 { largest / gain } else { 1.0 },
            fit: fitted,
            log_evidence,
            gain,
            structure,
        })
    }
}

/// Overdispersion by which log evidences are divided: 1 when the best model leaves no structure.
pub fn form_overdispersion(best: &StructureTest) -> f64 {
    let beyond_chance = best.excess - 2.0 * (2.0 * best.rank as f64).sqrt();
    1.0 + beyond_chance.max(0.0) / FORM_FREEDOM
}

/// The name of every free parameter beyond those of the current model, with value and deviation at noise scale c.
pub fn added_parameters(forward: &dyn Forward, fit: &Fit, shared: usize, c: f64) -> Vec<(String, f64, f64)> {
    forward.parameters().iter().enumerate().skip(shared).map(|(i, p)| (p.name.clone(), fit.values[i], fit.sd(i, c))).collect()
}
