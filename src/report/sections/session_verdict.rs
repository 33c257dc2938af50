//! What came of a session, in words and a few figures, at the top of its report.

use super::comparison_verdict::{floor_words, tone_of};
use super::diagnosis_verdict::{VERDICT_WORDS, floors_differ};
use crate::report::markup::{fixed, probability, with_sd};
use crate::report::page::{Section, Tone};
use crate::report::session_results::SessionResults;
use crate::short_list::short_list;
use crate::validation::observation::FEWEST_IMPACTS;
use crate::validation::structure::floor_text;
use crate::validation::{Adequacy, Verdict};
use std::collections::BTreeSet;

/// Shots named in a line at most.
const NAMED: usize = 6;

pub fn session_verdict(r: &SessionResults) -> Section {
    let measured = r.shots.iter().filter(|s| s.record.is_some()).count();
    let all = r.shots.iter().map(|s| &s.id).chain(r.failed.iter().map(|(id, _)| id)).collect::<BTreeSet<_>>().len();
    let mut lines = Vec::new();
    let mut cards = Vec::new();
    if let Some(s) = r.rig.as_ref().and_then(|rig| rig.square_mm.as_ref()) {
        lines.push(format!("The calibration re-measures the checkerboard's squares as {} ± {} mm in space.", fixed(s.mean, 2), fixed(s.sd, 2)));
    }
    if all > 0 {
        lines.push(measured_words(measured, all));
    }
    if !r.steps_failed.is_empty() {
        let steps = r.steps_failed.iter().map(|(step, _)| step.as_str()).collect::<Vec<_>>().join(", ");
        let line = format!("Failed: {steps}; the reason stands below.");
        // Where nothing came of a session this is what there is to say of it.
        lines.insert(if measured == 0 { 0 } else { lines.len() }, line);
    }
    let noted: Vec<&str> = r.shots.iter().filter(|s| !s.recording.is_empty()).map(|s| s.id.as_str()).collect();
    if !noted.is_empty() {
        lines.push(format!("Tracking noted something about the recording of {}; it stands with the tracks.", short_list(&noted, NAMED, ", ")));
    }
    let doubts: Vec<String> = r.shots.iter().filter_map(|s| Some(format!("{}: {}", s.id, s.record.as_ref()?.doubt.as_ref()?))).collect();
    if !doubts.is_empty() {
        let (is, its) = if doubts.len() == 1 { ("shot is", "its") } else { ("shots are", "their") };
        lines.push(format!("{} {is} in doubt, and {its} numbers with it. {}", doubts.len(), doubts.join(" ")));
    }
    cards.extend(ball_speed(r));
    let mut tone = if r.failed.is_empty() && r.steps_failed.is_empty() && doubts.is_empty() { Tone::Good } else { Tone::Doubt };
    if let Some(d) = &r.diagnosis {
        if d.verdict != Verdict::Adequate {
            tone = Tone::Bad;
        }
        lines.insert(
            0,
            match d.verdict {
                Verdict::Adequate if d.keeps_structure() => {
                    format!("The model “{}” explains these shots as far as their held-out error shows; some structure is left in its residuals.", d.model)
                }
                Verdict::Adequate => format!("The model “{}” explains these shots: nothing is missing that they could show.", d.model),
                Verdict::EffectMissing => format!("The model “{}” is missing {}.", d.model, d.recommended.join(" and ")),
                Verdict::Unexplained => format!("The model “{}” fails on these shots, and no effect of the catalogue explains why.", d.model),
            },
        );
        lines.extend(d.words.iter().filter(|w| !VERDICT_WORDS.iter().any(|v| w.starts_with(v))).cloned());
        lines.extend(floors_differ(d, r.comparison.as_ref()));
        cards.push((
            fixed(d.heldout_error, 2),
            format!("held-out error of the model in units of the noise; noise floor {}, the least that any model tried leaves", floor_text(d.noise_floor)),
        ));
        if let Some(c) = d.candidates.first().filter(|_| d.verdict != Verdict::Adequate) {
            cards.push((fixed(c.heldout_error_after, 2), format!("held-out error with {} (probability {})", c.effect, probability(c.probability))));
        }
    } else if let Some(c) = &r.comparison {
        match tone_of(c) {
            Tone::Good => (),
            of_model => tone = of_model,
        }
        lines.insert(0, format!("The model “{}” is {} for these shots.", c.model, if c.verdict == Adequacy::Adequate { "adequate" } else { "not adequate" }));
        lines.extend(c.doubts.iter().cloned());
        cards.push((
            fixed(c.heldout_error_refitted, 2),
            format!("held-out error of the model in units of the noise; {} {}", floor_words(c), floor_text(c.noise_floor)),
        ));
    }
    if r.diagnosis.is_none() && r.comparison.is_none() && (1..FEWEST_IMPACTS).contains(&measured) {
        lines.insert(
            0,
            format!(
                "No model can be judged from {}: {FEWEST_IMPACTS} or more are needed.",
                if measured == 1 { "one shot".to_owned() } else { format!("{measured} shots") }
            ),
        );
    }
    if lines.is_empty() {
        lines.push("Nothing has been measured yet.".to_owned());
        tone = Tone::Plain;
    }
    Section::new("verdict", "Verdict").verdict(tone, &lines).cards(&cards)
}

fn measured_words(measured: usize, all: usize) -> String {
    match (measured, all) {
        (1, 1) => "The one shot was measured.".to_owned(),
        (0, 1) => "The one shot could not be measured; the reason stands below.".to_owned(),
        (0, _) => format!("None of {all} shots could be measured; each is named with its reason below."),
        _ if measured == all => format!("All {all} shots were measured."),
        _ => format!("{measured} of {all} shots were measured; the others are named with their reason below."),
    }
}

/// The card of the ball's speed after the impact: of one shot its own, of several their mean.
fn ball_speed(r: &SessionResults) -> Option<(String, String)> {
    let speeds: Vec<_> = r.shots.iter().filter_map(|s| s.record.as_ref()?.shot.quantities.get("ball_out_speed")).collect();
    if let [one] = speeds.as_slice() {
        return Some((format!("{} m/s", with_sd(one.value, one.sd)), "ball speed after the impact".to_owned()));
    }
    let n = speeds.len() as f64;
    let mean = speeds.iter().map(|q| q.value).sum::<f64>() / n;
    let spread = (speeds.iter().map(|q| (q.value - mean).powi(2)).sum::<f64>() / (n - 1.0)).sqrt();
    let own = speeds.iter().map(|q| q.sd).sum::<f64>() / n;
    let words = format!("mean ball speed after; shots spread by {} m/s, each known to {} m/s (sd)", fixed(spread, 1), fixed(own, 2));
    (!speeds.is_empty()).then(|| (format!("{} m/s", fixed(mean, 1)), words))
}
