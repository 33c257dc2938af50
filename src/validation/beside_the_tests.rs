//! What the tests of a model that none of them faults do not look at: an output that scatters far more than the others do, and residuals that go with the
//! impact before; and what such a model has to take balls to turn by whose spin nobody measured.

use super::comparison::{OutputSummary, SessionOffset, summarise};
use super::linearise::Linearised;
use super::neighbours::miss_alike;
use super::observation::Observation;
use crate::impact_table::MEAN;
use crate::median::median;

/// Chi-square per number over that of the other outputs, and deviations of such a ratio, from which an output is told to scatter more than they do.
const SCATTERS: f64 = 1.5;
const SURELY: f64 = 6.0;
/// A mean of so many deviations is told.
const MEAN_TOLD: f64 = 4.0;

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

/// What balls whose spin nobody measured turn by on average, where the outputs tell it, in words.
pub fn mean_words(offsets: &[SessionOffset]) -> Vec<String> {
    let told = |o: &&SessionOffset| o.input.ends_with(MEAN) && o.value.abs() > MEAN_TOLD * o.sd;
    let words = |o: &SessionOffset| {
        let column = o.input.trim_end_matches(MEAN);
        format!("where `{column}` was not measured the outputs tell {:+.0} ± {:.0} rad/s on average, by this model: taken into account", o.value, o.sd)
    };
    offsets.iter().filter(told).map(words).collect()
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
