//! The error on impacts the fit never saw.
//!
//! Root-mean-square of the residual over its noise (outputs, and inputs through the model), each impact's true inputs
//! estimated from its own data alone; 1 is the noise floor when the noise is stated rightly. Outlying cells keep the
//! reduced weight that the fit's own spread gives them, or one wild number would hide what a better model gains.

use super::error::ValidationError;
use super::fit::Fit;
use super::forward::Forward;
use super::linearise::Linearised;
use super::linearise_all::linearise_all;
use super::observation::{Observation, Observations};
use super::structure::{StructureTest, p_text};

/// Times the noise beyond which the error on held-out impacts alone says that the model fails: with few impacts the structure test has hardly any
/// power against something large.
pub const CLEARLY: f64 = 1.5;
/// Passes for the true inputs: they settle to a thousandth of their deviation in three.
const PASSES: usize = 3;

/// Held-out impacts at a fit's parameters and offsets.
pub fn linearise_held_out(
    forward: &dyn Forward,
    fit: &Fit,
    observations: &Observations,
    held_out: &[&Observation],
) -> Result<Vec<Linearised>, ValidationError> {
    let prediction = forward.prepare(&fit.values)?;
    let begin: Vec<_> = held_out.iter().map(|o| fit.shifts[o.session].inputs_of(o, &observations.gear[o.gear])).collect();
    linearise_all(prediction.as_ref(), observations, held_out, &fit.shifts, &fit.spread, &begin, None, None, PASSES)
}

/// Root-mean-square of the whitened residuals.
pub fn error_of(impacts: &[Linearised]) -> f64 {
    let (sum, count) = impacts.iter().fold((0.0, 0usize), |(s, n), l| (s + l.z.norm_squared(), n + l.z.len()));
    if count == 0 { 0.0 } else { (sum / count as f64).sqrt() }
}

/// Whether the error on held-out impacts is that of noise and of what `fit` could know alone, within two deviations of their
/// ratio: each is known to 1/√2N of it, the floor from the `floor_freedom` degrees of freedom that it was estimated from.
fn is_noise_alone(impacts: &[Linearised], fit: &Fit, floor: f64, floor_freedom: f64) -> bool {
    let count: usize = impacts.iter().map(|l| l.z.len()).sum();
    let expected = floor * (1.0 + fit.own_uncertainty()).sqrt();
    count > 0 && error_of(impacts) <= expected * (1.0 + 2.0 * (0.5 / count as f64 + 0.5 / floor_freedom.max(1.0)).sqrt())
}

/// Whether that error lies so far above the noise (by more than half, and beyond chance; of footage above the stated noise, which shots may
/// share) that the model fails though no structure shows.
pub fn is_clearly_above_noise(observations: &Observations, impacts: &[Linearised], fit: &Fit, structure: &StructureTest) -> bool {
    let scale = if observations.is_footage() { structure.noise_scale.max(1.0) } else { structure.noise_scale };
    error_of(impacts) > CLEARLY * scale.sqrt() && !is_noise_alone(impacts, fit, scale.sqrt(), structure.residual_freedom)
}

/// Fall of the held-out impacts' chi-square, in units of the noise `c`, that something must bring: its own price, and twice what
/// single impacts scatter it by, so that no two or three of them carry it alone.
pub fn is_worth(price: f64, before: &[Linearised], after: &[Linearised], c: f64) -> bool {
    let (sum, squares) = before.iter().zip(after).map(|(b, a)| (b.z.norm_squared() - a.z.norm_squared()) / c).fold((0.0, 0.0), |(s, q), g| (s + g, q + g * g));
    sum > price && sum > 2.0 * squares.sqrt()
}

/// Log evidence of held-out impacts for what takes them from `before` to `after`, nothing of it fitted to them: half the fall of their
/// chi-square, in units of the noise `c`. Where they hardly meet it they say little either way. No impact alone says more than `most`.
pub fn log_evidence_of(before: &[Linearised], after: &[Linearised], c: f64, most: f64) -> f64 {
    let of = |(b, a): (&Linearised, &Linearised)| 0.5 * ((b.z.norm_squared() - a.z.norm_squared()) / c + b.log_det - a.log_det);
    before.iter().zip(after).map(|pair| of(pair).clamp(-most, most)).sum()
}

/// Structure less likely than this is no chance, whatever the held-out impacts say.
const NO_CHANCE: f64 = 1e-4;

/// Why structure that the test finds is taken for chance: the error on held-out impacts is that of noise.
pub fn taken_for_chance(structure: &StructureTest, fit: &Fit, held_out: &[Linearised], floor: f64) -> Option<String> {
    let chance = structure.p_value > NO_CHANCE && structure.by_group.is_empty() && is_noise_alone(held_out, fit, floor, structure.residual_freedom);
    chance.then(|| {
        format!(
            "the structure test alone rejects ({}), but the error on held-out impacts is that of noise ({:.3}, floor {floor:.3}): not believed",
            p_text(structure.p_value),
            error_of(held_out)
        )
    })
}

/// Why it is taken for what the shots of a calibration share.
pub fn taken_for_shared(observations: &Observations, structure: &StructureTest, fit: &Fit, held_out: &[Linearised]) -> Option<String> {
    is_shared_error(observations, structure, fit, held_out).then(|| {
        format!(
            "some structure is left ({}), but beside what the table states it adds less than a tenth to the error of the fit and nothing to that of held-out impacts ({:.3}): not believed of shots that share a calibration",
            p_text(structure.p_value),
            error_of(held_out)
        )
    })
}

/// Share of the variance that structure may add before it counts as more than what the shots of a calibration share: a tenth of the
/// error.
const SMALL: f64 = 0.21;

/// Whether structure in the impacts of `fit` is no more than shots of footage, which share more errors than their table states, may
/// have: it adds less than a tenth to their error and nothing to that of the held-out ones. What a table states of a shot holds what all
/// have in common, so that structure below the stated noise may be that, however little the shots scatter about it.
fn is_shared_error(observations: &Observations, structure: &StructureTest, fit: &Fit, held_out: &[Linearised]) -> bool {
    let stated = structure.noise_scale.max(1.0);
    observations.is_footage()
        && structure.statistic / stated - (structure.rank as f64) < SMALL * fit.count() as f64
        && is_noise_alone(held_out, fit, stated.sqrt(), structure.residual_freedom)
}

/// The held-out error of a fit.
pub fn held_out_error(forward: &dyn Forward, fit: &Fit, observations: &Observations) -> Result<f64, ValidationError> {
    Ok(error_of(&linearise_held_out(forward, fit, observations, &observations.side(true))?))
}
