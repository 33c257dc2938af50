//! The diagnosis in sentences, for the terminal and the report.

use super::diagnosis::{Diagnosis, Verdict};
use super::refits::LARGEST_NOISE_SCALE;
use super::structure::{STRUCTURE_LEVEL, floor_text, p_text, probability_text};

/// Which group the model fails by the most.
fn by_group(d: &Diagnosis) -> Option<String> {
    d.structure.by_group.first().map(|g| format!("It does not fail alike in all groups: {}.", g.words()))
}

/// Outlying numbers, at least, and as a share of the outputs, that a sound verdict does not pass over.
const MANY_OUTLIERS: (usize, f64) = (10, 0.01);

/// An alias, with its probability where that is one to reckon with.
fn with_probability(d: &Diagnosis, alias: &str) -> String {
    match d.candidates.iter().find(|c| c.effect == alias) {
        Some(c) if c.probability >= 0.01 => format!("{alias} ({})", probability_text(c.probability)),
        _ => alias.to_owned(),
    }
}

/// The answer first, then what carries it. `doubts` are sentences about the effect that is named, or about a model that no test faults.
pub fn verdict_words(d: &Diagnosis, doubts: impl IntoIterator<Item = String>) -> Vec<String> {
    let tests = format!(
        "structure test {}, strongest place on the face {}, best of {} effects {} (corrected); together they raise a false alarm in at most {:.1} % of sound tables",
        p_text(d.structure.p_value),
        p_text(d.spot_p_value),
        d.n_tested,
        p_text(d.library_p_value),
        100.0 * d.false_alarm_rate
    );
    let mut words = Vec::new();
    match d.verdict {
        Verdict::Adequate => {
            words.push(if d.keeps_structure() {
                format!("ADEQUATE: what structure is left in {} impacts does not show in the error of those held out.", d.n_impacts)
            } else {
                format!("ADEQUATE: nothing is missing that {} impacts could show.", d.n_impacts)
            });
            words.push(format!("Error on held-out impacts {:.2}, noise floor {}; {tests}.", d.heldout_error, floor_text(d.noise_floor)));
            let numbers: usize = d.outputs.iter().map(|o| o.n).sum();
            if d.outliers.len() >= MANY_OUTLIERS.0 && d.outliers.len() as f64 > MANY_OUTLIERS.1 * numbers as f64 {
                let most = d.outliers.iter().map(|o| o.standardised.abs()).fold(0.0, f64::max);
                words.push(format!(
                    "But {} numbers are outlying (of {numbers} outputs, and the inputs), by up to {most:.0} deviations: the noise has long tails, or something acts on a part of the impacts that no test here looks for. They are listed with their impacts.",
                    d.outliers.len()
                ));
            }
            words.extend(doubts);
        }
        Verdict::EffectMissing => {
            let names = d.recommended.join(" and ");
            words.push(format!("EFFECT MISSING: {names}."));
            if let Some((error, probability)) = d.with_recommended() {
                words.push(format!(
                    "Probability {}. With {} the error on held-out impacts {} from {:.2} to {error:.2} (noise floor {}); {tests}.",
                    probability_text(probability),
                    if d.recommended.len() > 1 { "them" } else { "it" },
                    if error < d.heldout_error { "falls" } else { "goes" },
                    d.heldout_error,
                    floor_text(d.noise_floor)
                ));
            }
            words.extend(doubts);
            words.extend(by_group(d));
            if let Some(c) = d.candidates.iter().find(|c| d.recommended.first() == Some(&c.effect))
                && let others = c.aliases.iter().filter(|a| !d.recommended.contains(a)).map(|a| with_probability(d, a)).collect::<Vec<_>>()
                && !others.is_empty()
            {
                let which = if d.recommended.len() > 1 { c.effect.as_str() } else { "it" };
                words.push(format!("On these impacts {which} could also be {}; further impacts that would tell are listed below.", others.join(", ")));
            }
            if let Some(name) = &d.other_form {
                let left = d.structure_after.as_ref().is_none_or(|s| s.p_value < STRUCTURE_LEVEL);
                words.push(if !left {
                    "A formula fits better, though neither leaves structure.".to_owned()
                } else if d.recommended.len() > 1 {
                    "One of them is not quite in the catalogue's form: some structure is left when both are added.".to_owned()
                } else {
                    format!("It is {name}, but not quite in the catalogue's form: some structure is left when it is added.")
                });
                if let Some(e) = &d.suggested_expression {
                    words.push(format!("A better form: {} (held-out error with it {:.2}).", e.words, e.heldout_error_after));
                }
            }
        }
        Verdict::Unexplained => {
            words.push(if d.noise_floor.powi(2) > LARGEST_NOISE_SCALE && d.structure.p_value >= STRUCTURE_LEVEL && d.recommended.is_empty() {
                format!(
                    "UNEXPLAINED: what is left is {:.1} times the stated noise, and nothing that was measured tells where. The deviations are understated by far, or what is missing was not measured.",
                    d.noise_floor
                )
            } else {
                "UNEXPLAINED: the model fails, and no effect of the catalogue, nor two together, accounts for it.".to_owned()
            });
            words.extend(by_group(d));
            words.push(format!("Error on held-out impacts {:.2}, noise floor {}; {tests}.", d.heldout_error, floor_text(d.noise_floor)));
            match &d.suggested_expression {
                Some(e) => words.push(format!("What the residuals say: {} (held-out error with it {:.2}).", e.words, e.heldout_error_after)),
                None => {
                    words.push(format!("No short formula was found in the residuals either{}.", if d.places.is_empty() { "" } else { "; see where it fails" }))
                }
            }
        }
    }
    words
}
