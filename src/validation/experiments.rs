//! Which impacts to record next, to tell two effects apart that these impacts cannot.
//!
//! Over a grid of impacts a person can set up, both candidates predict at their own best fit; half the squared difference
//! in units of the noise is the log evidence one impact is expected to bring (T-optimality; Hunter and Reiner 1965, Box
//! and Hill 1967). The best settings, well apart from each other, are proposed, three impacts of each.

use super::diagnosis::NextExperiment;
use super::forward::{Asked, Inputs, Outputs, Prediction};
use super::linearise::Linearised;
use super::observation::{Observation, Observations};
use super::predicted::PIECE;
use super::refits::LOG_ODDS;
use super::terminal::short;
use crate::impact_table::{INPUTS, OUTPUTS, column_subject, unit};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Speeds of the ball further apart than this are different ones, m/s.
const OTHER_SPEED_M_S: f64 = 4.0;
/// Settings proposed at most, and impacts of each.
const SETTINGS: usize = 4;
const EACH: usize = 3;

/// A candidate at its best fit.
pub struct Rival<'a> {
    pub name: &'a str,
    pub prediction: &'a dyn Prediction,
}

struct Setting {
    inputs: Inputs,
    log_evidence: f64,
    /// Output that differs most, in noise, and by how much (first less second).
    output: usize,
    difference: f64,
}

/// Proposes impacts; `None` when no feasible impact tells the two apart (less than a hundredth of a unit each).
pub fn next_experiment(
    first: &Rival,
    second: &Rival,
    observations: &Observations,
    impacts: &[&Observation],
    fitted: &[Linearised],
    separated_by: &str,
) -> Option<NextExperiment> {
    let (columns, whitener, sd) = typical_noise(fitted)?;
    // With the user's own columns as in the impacts' middle.
    let own = impacts.get(impacts.len() / 2).map(|o| o.own).unwrap_or_default();
    let asked: Vec<Asked> = grid(observations, impacts).into_iter().map(|inputs| Asked { gear: 0, order: 0.0, own, inputs }).collect();
    let all = |p: &dyn Prediction| -> Vec<Option<Outputs>> { asked.par_chunks(PIECE).flat_map_iter(|piece| p.predict_many(piece)).collect() };
    let (by_first, by_second) = (all(first.prediction), all(second.prediction));
    let mut settings: Vec<Setting> = asked
        .iter()
        .zip(by_first.into_iter().zip(by_second))
        .filter_map(|(Asked { inputs, .. }, (a, b))| {
            let (a, b) = (a?, b?);
            let difference = DVector::from_iterator(columns.len(), columns.iter().map(|&k| a[k] - b[k]));
            if difference.iter().any(|d| !d.is_finite()) {
                return None;
            }
            let z = &whitener * &difference;
            let most = (0..columns.len()).max_by(|&i, &j| (difference[i] / sd[i]).abs().total_cmp(&(difference[j] / sd[j]).abs()))?;
            Some(Setting { inputs: *inputs, log_evidence: 0.5 * z.norm_squared(), output: columns[most], difference: difference[most] })
        })
        .collect();
    settings.sort_by(|a, b| b.log_evidence.total_cmp(&a.log_evidence));
    // The first one, then the best at another speed, then the others.
    let other = settings.first().and_then(|first| settings.iter().position(|s| (s.inputs[2] - first.inputs[2]).abs() > OTHER_SPEED_M_S));
    if let Some(k) = other {
        settings[1..=k].rotate_right(1);
    }
    let mut chosen: Vec<Setting> = Vec::new();
    for s in settings {
        // Settings a person would call different: another place or another speed of the ball. Speeds are wanted apart
        // because a rival that is wrong at one speed only can be bent to it by its free parameters.
        let apart = chosen.iter().all(|c| {
            (c.inputs[12] - s.inputs[12]).abs() > 0.03 || (c.inputs[13] - s.inputs[13]).abs() > 0.025 || (c.inputs[2] - s.inputs[2]).abs() > OTHER_SPEED_M_S
        });
        if apart && chosen.len() < SETTINGS && s.log_evidence > 0.01 {
            chosen.push(s);
        }
    }
    let expected: f64 = chosen.iter().map(|s| EACH as f64 * s.log_evidence).sum();
    if chosen.is_empty() || expected < 0.1 {
        return None;
    }
    let mut why: Vec<String> = chosen
        .iter()
        .map(|s| {
            format!(
                "{} with {} {} is {} {} {} than with {}",
                place_words(&s.inputs),
                first.name,
                column_subject(OUTPUTS[s.output]),
                short(s.difference.abs()),
                unit(OUTPUTS[s.output]),
                if s.difference > 0.0 { "more" } else { "less" },
                second.name
            )
        })
        .collect();
    // Settings that differ in what the words leave out read the same.
    why.dedup();
    why.truncate(2);
    Some(NextExperiment {
        separates: [first.name.to_owned(), second.name.to_owned()],
        impacts: chosen
            .iter()
            .flat_map(|s| std::iter::repeat_n(s.inputs, EACH))
            .map(|x| INPUTS.iter().zip(x).map(|(n, v)| ((*n).to_owned(), (v * 1e6).round() / 1e6)).collect::<BTreeMap<_, _>>())
            .collect(),
        why: format!("{}. In general: {separated_by}", why.join("; ")),
        repeats: (LOG_ODDS / expected).ceil().max(1.0) as usize,
        expected_log_evidence: expected,
    })
}

/// Mean covariance over the impacts whose measured outputs are the usual ones: output columns, whitening, deviations.
fn typical_noise(fitted: &[Linearised]) -> Option<(Vec<usize>, DMatrix<f64>, Vec<f64>)> {
    let mut counts: BTreeMap<&[usize], usize> = BTreeMap::new();
    for l in fitted {
        *counts.entry(&l.measured).or_default() += 1;
    }
    let usual = counts.into_iter().max_by_key(|(_, n)| *n)?.0.to_vec();
    let mut mean = DMatrix::zeros(usual.len(), usual.len());
    let mut n = 0.0;
    for l in fitted.iter().filter(|l| l.measured == usual) {
        mean += &l.covariance;
        n += 1.0;
    }
    mean /= n;
    let sd = mean.diagonal().iter().map(|v| v.sqrt()).collect();
    let lower = mean.cholesky()?.l();
    let whitener = lower.solve_lower_triangular(&DMatrix::identity(usual.len(), usual.len()))?;
    Some((usual, whitener, sd))
}

/// Impacts a person can set up around those recorded: the racket's motion as usual, ball speed, angle, spin, place and
/// grip torque varied within what has been seen, a little beyond for the place.
fn grid(observations: &Observations, impacts: &[&Observation]) -> Vec<Inputs> {
    let quantile = |j: usize, q: f64| {
        let mut v: Vec<f64> = impacts.iter().map(|o| o.inputs[j]).collect();
        v.sort_by(f64::total_cmp);
        v[((v.len() - 1) as f64 * q).round() as usize]
    };
    // What is zero within the noise is meant to be zero: nobody sets up a racket at a millimetre per second.
    let noise = observations.usual_input_sd();
    let usual: Inputs = std::array::from_fn(|j| Some(quantile(j, 0.5)).filter(|v| v.abs() >= 2.0 * noise[j]).unwrap_or(0.0));
    let head = observations.gear.first().map(|g| (0.5 * g.racket.head.inner_length_m, 0.5 * g.racket.head.inner_width_m)).unwrap_or((0.15, 0.12));
    let two = |j: usize| {
        let (low, high) = (quantile(j, 0.05), quantile(j, 0.95));
        if high - low > 1e-9 { vec![low, high] } else { vec![usual[j]] }
    };
    let speeds = [quantile(2, 0.05), usual[2], quantile(2, 0.95)];
    let mut all = Vec::new();
    for fx in [-0.65, -0.4, -0.15, 0.15, 0.4, 0.65] {
        for fy in [-0.5, -0.25, 0.0, 0.25, 0.5] {
            for vz in speeds {
                for vy in [quantile(1, 0.05), usual[1], quantile(1, 0.95)] {
                    for wx in [quantile(3, 0.05), usual[3], quantile(3, 0.95)] {
                        for &torque in &two(14) {
                            let mut x = usual;
                            (x[12], x[13]) = (fx * head.0, fy * head.1);
                            (x[2], x[1], x[3], x[14]) = (vz, vy, wx, torque);
                            all.push(x);
                        }
                    }
                }
            }
        }
    }
    all
}

fn place_words(x: &Inputs) -> String {
    let along = if x[12] < -0.02 {
        format!("{:.0} mm toward the tip", -1e3 * x[12])
    } else if x[12] > 0.02 {
        format!("{:.0} mm toward the handle", 1e3 * x[12])
    } else {
        "at mid-length".to_owned()
    };
    let across = if x[13].abs() > 0.015 { format!(", {:.0} mm toward marker {}", 1e3 * x[13].abs(), if x[13] < 0.0 { 2 } else { 3 }) } else { String::new() };
    format!("{along}{across}, ball at {:.0} m/s:", x[0].hypot(x[1]).hypot(x[2]))
}
