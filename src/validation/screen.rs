//! Screening the catalogue: how much would each effect, alone and in pairs, explain of what the fit left over?
//!
//! Signature of an effect: the whitened difference of predictions for a fifth of a typical strength either way, nuisance
//! projected out. Its score and information give a p-value and an approximate gain without a refit (docs/diagnosis.md,
//! "In formulas", score). An effect that a typical size would not move by half a deviation is "not visible here" and is left out of
//! the count for which p-values are corrected.

use super::error::ValidationError;
use super::fit::Fit;
use super::forward::{EffectOutline, Library};
use super::linearise::Linearised;
use super::observation::Observation;
use super::predicted::difference;
use super::project::{Nuisance, Projected, beside, project_out};
use super::tails::ratio_tail;
use crate::impact_table::INPUTS;
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

/// Corrected level of the library test.
pub const LIBRARY_LEVEL: f64 = 0.01;

/// Step of the signature, as a share of the typical strength.
const STEP: f64 = 0.2;
/// A typical effect below this many deviations cannot be seen.
const VISIBLE: f64 = 0.5;
/// A nuisance that takes away more than this share of a signature's information hides the effect.
const ABSORBED: f64 = 0.999;
/// A strength of which no more than this share is left after projection carries nothing.
const CARRIES: f64 = 1e-6;

/// Prior deviation of a strength, in typical sizes (docs/diagnosis.md, "In formulas", evidence).
pub const STRENGTH_PRIOR: f64 = 1.5;

/// One effect of the catalogue against the current fit.
#[derive(Debug, Clone)]
pub struct Screened {
    /// Index into [`Library::effects`].
    pub effect: usize,
    /// Its terms: columns of the common projection.
    pub terms: Vec<usize>,
    /// Approximate gain in chi-square, at noise scale c.
    pub gain: f64,
    /// Approximate best strengths, as differences from `absent`.
    pub strengths: Vec<f64>,
    pub p_value: f64,
    /// Deviations by which a typical size would show.
    pub typical_signal: f64,
    pub hidden_because: Option<String>,
}

/// The whole catalogue, screened.
#[derive(Debug, Clone)]
pub struct Screening {
    pub effects: Vec<Screened>,
    pub projected: Projected,
    /// Smallest p-value times the number of effects that could be seen.
    pub library_p_value: f64,
    pub tested: usize,
}

impl Screening {
    /// What was found of an effect, by its name; `None` when it was not screened.
    pub fn of(&self, library: &dyn Library, effect: &str) -> Option<&Screened> {
        self.effects.iter().find(|s| library.effects()[s.effect].name == effect)
    }

    /// Deviations of an effect's strengths at noise scale `c`, in units of their typical sizes; one that these impacts do not tell has that of
    /// its prior, at most.
    pub fn strength_sds(&self, screened: &Screened, c: f64) -> Vec<f64> {
        let n = screened.terms.len();
        // The prior is weak, and keeps what nothing tells finite.
        let information = DMatrix::from_fn(n, n, |i, j| {
            self.projected.information[(screened.terms[i], screened.terms[j])] / c + if i == j { STRENGTH_PRIOR.powi(-2) } else { 0.0 }
        });
        information.cholesky().map_or_else(|| vec![STRENGTH_PRIOR; n], |root| root.inverse().diagonal().iter().map(|v| v.max(0.0).sqrt()).collect())
    }
}

/// Two effects scored together.
#[derive(Debug, Clone)]
pub struct ScreenedPair {
    /// Indices into [`Library::effects`].
    pub effects: [usize; 2],
    pub gain: f64,
}

/// The impacts of the fit at what was measured of their inputs, where something was not: a signature at a spin that only the outputs told meets
/// their noise, and finds it. `None` where all inputs were measured.
fn as_measured(fit: &Fit, impacts: &[&Observation]) -> Option<Vec<Linearised>> {
    let unmeasured = impacts.iter().any(|o| o.without_unmeasured(&[f64::NAN; INPUTS.len()]).iter().any(|v| !v.is_nan()));
    let one = |(o, l): (&&Observation, &Linearised)| Linearised { true_inputs: o.without_unmeasured(&l.true_inputs), ..l.clone() };
    unmeasured.then(|| impacts.iter().zip(&fit.impacts).map(one).collect())
}

/// Whitened signatures of the strengths of every effect that can be added: `[impact]` blocks of outputs × terms.
fn signatures(library: &dyn Library, fit: &Fit, impacts: &[&Observation], which: &[usize]) -> Result<(Vec<DMatrix<f64>>, Vec<Vec<usize>>), ValidationError> {
    let base = fit.values.len();
    let told = as_measured(fit, impacts);
    let at = told.as_deref().unwrap_or(&fit.impacts);
    let columns: Vec<Vec<Vec<DVector<f64>>>> = which
        .par_iter()
        .map(|&e| {
            let outline = &library.effects()[e];
            let forward = library.with(&[&outline.name])?;
            let mut values = fit.values.clone();
            values.extend(forward.parameters()[base..].iter().map(|p| p.value));
            outline
                .strengths
                .iter()
                .enumerate()
                .map(|(s, strength)| {
                    let limits = &forward.parameters()[base + s];
                    let h = if strength.jumps { 1.0 } else { STEP } * strength.typical;
                    let (mut up, mut down) = (values.clone(), values.clone());
                    up[base + s] = (strength.absent + h).min(limits.max);
                    down[base + s] = (strength.absent - h).max(limits.min);
                    let width = up[base + s] - down[base + s];
                    let (above, below) = (forward.prepare(&up)?, forward.prepare(&down)?);
                    // In units of the typical strength, so that all columns are of like size.
                    let unit = if width > 0.0 { strength.typical / width } else { 0.0 };
                    let moved = difference(above.as_ref(), below.as_ref(), impacts, at);
                    Ok(moved.into_iter().zip(&fit.impacts).map(|(d, l)| &l.whitener * d * unit).collect())
                })
                .collect::<Result<Vec<_>, ValidationError>>()
        })
        .collect::<Result<Vec<_>, ValidationError>>()?;
    let mut next = 0;
    let terms: Vec<Vec<usize>> = columns
        .iter()
        .map(|c| {
            let range = (next..next + c.len()).collect();
            next += c.len();
            range
        })
        .collect();
    let blocks = (0..impacts.len())
        .map(|i| {
            let mut block = DMatrix::zeros(fit.impacts[i].z.len(), next);
            for (column, v) in columns.iter().flatten().enumerate() {
                block.set_column(column, &v[i]);
            }
            block
        })
        .collect();
    Ok((blocks, terms))
}

/// Largest cosine between a signature (one column) and each effect's terms, nuisance projected out of both.
pub fn cosines_with(library: &dyn Library, fit: &Fit, impacts: &[&Observation], signature: &[DMatrix<f64>]) -> Result<Vec<(usize, f64)>, ValidationError> {
    let which: Vec<usize> = (0..library.effects().len()).filter(|&e| library.effects()[e].can_be_added()).collect();
    let (blocks, terms) = signatures(library, fit, impacts, &which)?;
    let last = blocks.first().map_or(0, DMatrix::ncols);
    let joined: Vec<DMatrix<f64>> = blocks.iter().zip(signature).map(|(b, s)| beside(b, s)).collect();
    let projected = project_out(fit, &Nuisance::of(fit), &joined);
    Ok(which.iter().zip(terms).map(|(&e, t)| (e, t.iter().map(|&i| projected.cosine(i, last).abs()).fold(0.0, f64::max))).collect())
}

/// Screens every effect that can be added, beyond what `nuisance` absorbs; `c` is the noise scale of the structure test,
/// `only` names the effects to look at.
pub fn screen_beyond(
    library: &dyn Library,
    fit: &Fit,
    impacts: &[&Observation],
    c: f64,
    nuisance: &Nuisance,
    only: Option<&[&str]>,
) -> Result<Screening, ValidationError> {
    let which: Vec<usize> = (0..library.effects().len())
        .filter(|&e| {
            let o = &library.effects()[e];
            o.can_be_added() && only.is_none_or(|names| names.contains(&o.name.as_str()))
        })
        .collect();
    let (blocks, terms) = signatures(library, fit, impacts, &which)?;
    let projected = project_out(fit, nuisance, &blocks);
    let effects: Vec<Screened> = which.iter().zip(terms).map(|(&e, terms)| screen_one(&projected, &library.effects()[e], e, terms, c)).collect();
    let tested = effects.iter().filter(|s| s.hidden_because.is_none()).count();
    let smallest = effects.iter().filter(|s| s.hidden_because.is_none()).map(|s| s.p_value).fold(1.0, f64::min);
    Ok(Screening { library_p_value: (smallest * tested as f64).min(1.0), effects, projected, tested })
}

fn screen_one(projected: &Projected, outline: &EffectOutline, effect: usize, terms: Vec<usize>, c: f64) -> Screened {
    // The strengths are in units of their typical size: information is the squared signal of a typical effect.
    let signal = terms.iter().map(|&t| projected.information[(t, t)].max(0.0) / c).fold(0.0, f64::max).sqrt();
    let raw = terms.iter().map(|&t| projected.raw[t].max(0.0) / c).fold(0.0, f64::max).sqrt();
    let hidden_because = if raw < VISIBLE {
        Some(format!("an effect of typical size would move the measured outputs by only {raw:.2} of their noise on these impacts"))
    } else if signal < VISIBLE || terms.iter().all(|&t| projected.information[(t, t)] < (1.0 - ABSORBED) * projected.raw[t]) {
        Some(format!(
            "on these impacts its signature is absorbed by the base model's own parameters and the session's offsets ({:.0} % of it)",
            100.0 * (1.0 - (signal / raw).powi(2))
        ))
    } else {
        None
    };
    let mut screened = Screened { effect, gain: 0.0, strengths: vec![0.0; terms.len()], p_value: 1.0, typical_signal: signal, hidden_because, terms };
    // Terms that carry nothing, or point to the impossible side, drop out one after the other.
    let mut active: Vec<usize> = (0..screened.terms.len()).filter(|&i| projected.keeps_more_than(CARRIES, screened.terms[i])).collect();
    while !active.is_empty() {
        let columns: Vec<usize> = active.iter().map(|&i| screened.terms[i]).collect();
        let Some((gain, strengths)) = projected.joint(&columns) else {
            active.pop();
            continue;
        };
        if let Some(worst) = (0..active.len()).find(|&k| outline.strengths[active[k]].one_sided && strengths[k] < 0.0) {
            active.remove(worst);
            continue;
        }
        screened.gain = gain / c;
        for (k, &i) in active.iter().enumerate() {
            screened.strengths[i] = strengths[k] * outline.strengths[i].typical;
        }
        screened.p_value = if columns.len() == 1 {
            let t = columns[0];
            let spread = projected.spread(t, &columns, &strengths, c);
            let z = projected.score[t] / (spread.variance * c).max(1e-300).sqrt();
            let both_sides = ratio_tail(z * z, 1.0, spread.freedom);
            let p = match (outline.strengths[active[0]].one_sided, z > 0.0) {
                (true, true) => 0.5 * both_sides,
                (true, false) => 1.0 - 0.5 * both_sides,
                (false, _) => both_sides,
            };
            // The other strengths were looked at too.
            (p * screened.terms.len() as f64).min(1.0)
        } else {
            // Each term's sandwich may exceed its information: shrink the joint gain by the worst of them.
            let inflation = |&t: &usize| {
                let spread = projected.spread(t, &columns, &strengths, c);
                (spread.variance / projected.information[(t, t)].max(1e-300), spread.freedom)
            };
            let (by, freedom) = columns.iter().map(inflation).fold((1.0, f64::INFINITY), |worst, i| if i.0 > worst.0 { i } else { worst });
            ratio_tail(screened.gain / by, columns.len() as f64, freedom)
        };
        break;
    }
    screened
}

/// All pairs of effects by their joint score, best first; pairs that cannot be told apart are left out.
pub fn screen_pairs(screening: &Screening, library: &dyn Library, c: f64) -> Vec<ScreenedPair> {
    let visible: Vec<&Screened> = screening.effects.iter().filter(|s| s.hidden_because.is_none()).collect();
    let mut pairs = Vec::new();
    for (i, a) in visible.iter().enumerate() {
        for b in &visible[i + 1..] {
            let mut active: Vec<(usize, bool, usize, usize)> = Vec::new();
            for (which, s) in [(0usize, a), (1, b)] {
                for (k, &t) in s.terms.iter().enumerate() {
                    if screening.projected.keeps_more_than(CARRIES, t) {
                        active.push((t, library.effects()[s.effect].strengths[k].one_sided, which, k));
                    }
                }
            }
            while !active.is_empty() {
                let columns: Vec<usize> = active.iter().map(|x| x.0).collect();
                let Some((gain, strengths)) = screening.projected.joint(&columns) else { break };
                if let Some(worst) = (0..active.len()).find(|&k| active[k].1 && strengths[k] < 0.0) {
                    active.remove(worst);
                    continue;
                }
                let both = active.iter().any(|x| x.2 == 0) && active.iter().any(|x| x.2 == 1);
                if both {
                    pairs.push(ScreenedPair { effects: [a.effect, b.effect], gain: gain / c });
                }
                break;
            }
        }
    }
    pairs.sort_by(|a, b| b.gain.total_cmp(&a.gain).then(a.effects.cmp(&b.effects)));
    pairs
}
