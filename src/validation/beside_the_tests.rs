//! What the tests of a model that none of them faults do not look at: an output that scatters far more than the others do, and residuals that go with the
//! impact before.

use super::comparison::{OutputSummary, summarise};
use super::linearise::Linearised;
use super::neighbours::miss_alike;
use super::observation::Observation;
use crate::median::median;

/// Chi-square per number over that of the other outputs, and deviations of such a ratio, from which an output is told to scatter more than they do.
const SCATTERS: f64 = 1.5;
const SURELY: f64 = 6.0;

/// Sentences that stand beside "adequate": of impacts that were fitted (`seen`) and held out, with the model at its best on each.
pub fn beside_the_tests(seen: &[&Observation], fitted: &[Linearised], held: &[&Observation], held_fitted: &[Linearised]) -> Vec<String> {
    let in_order = miss_alike(seen.iter().zip(fitted).chain(held.iter().zip(held_fitted))).map(|(output, alike)| {
        format!(
            "But impacts that follow each other miss {output} {}: something changes with their order that these tests do not look for (balls in turn, strings exchanged).",
            if alike { "alike" } else { "by turns to either side" }
        )
    });
    scatters(&summarise(fitted, held_fitted)).into_iter().chain(in_order).collect()
}

fn scatters(outputs: &[OutputSummary]) -> Option<String> {
    let usual = median(outputs.iter().map(|o| o.chi2_reduced)).unwrap_or(1.0).max(1.0);
    let beyond = |o: &&OutputSummary| (o.chi2_reduced / usual - 1.0) * (0.5 * o.n as f64).sqrt();
    let widest = outputs.iter().max_by(|a, b| beyond(a).total_cmp(&beyond(b))).filter(|o| o.chi2_reduced > SCATTERS * usual && beyond(o) > SURELY)?;
    Some(format!(
        "But {} scatters {:.1} times as widely as stated, the other outputs {:.1} times: its deviations are understated, or something acts on it that these tests do not look for.",
        widest.name,
        widest.chi2_reduced.sqrt(),
        usual.sqrt()
    ))
}
