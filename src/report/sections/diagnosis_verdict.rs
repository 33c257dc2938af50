//! The diagnosis in words: is something missing, and what.

use crate::report::markup::{fixed, probability};
use crate::report::page::{Section, Tone};
use crate::validation::diagnosis::{Diagnosis, Verdict};
use crate::validation::structure::floor_text;
use crate::validation::{Adequacy, Comparison};

/// How the terminal text begins; the heading says it already.
pub(super) const VERDICT_WORDS: [&str; 3] = ["ADEQUATE", "EFFECT MISSING", "UNEXPLAINED"];

/// Why a diagnosis and a comparison of the same model print different noise floors, where they do so.
pub(super) fn floors_differ(d: &Diagnosis, comparison: Option<&Comparison>) -> Option<String> {
    let (here, there) = (floor_text(d.noise_floor), floor_text(comparison?.noise_floor));
    (here != there).then(|| {
        format!(
            "The noise floor of {here} is the least that any model tried leaves; `compare`, which knows this model alone, puts it at {there}: what its residuals hold when every smooth trend is taken out."
        )
    })
}

/// Verdict, the answer's sentences and the figures that matter; `comparison`: the diagnosed model's; `after`: the model with
/// the recommended effects added.
pub fn diagnosis_verdict(d: &Diagnosis, comparison: Option<&Comparison>, after: Option<&Comparison>) -> Section {
    let (tone, head) = match d.verdict {
        Verdict::Adequate if d.keeps_structure() => {
            (Tone::Good, format!("Nothing is missing that shows in the error of held-out impacts; some structure is left in these {} impacts.", d.n_impacts))
        }
        Verdict::Adequate => (Tone::Good, format!("Nothing is missing that these {} impacts could show.", d.n_impacts)),
        Verdict::EffectMissing if d.recommended.is_empty() => (Tone::Bad, "The model is missing an effect.".to_owned()),
        Verdict::EffectMissing => (Tone::Bad, format!("The model is missing {}.", d.recommended.join(" and "))),
        Verdict::Unexplained => (Tone::Doubt, "The model fails, and no effect of the catalogue explains why.".to_owned()),
    };
    let mut lines = vec![head];
    // The first of its words is the verdict itself.
    lines.extend(d.words.iter().filter(|w| !VERDICT_WORDS.iter().any(|v| w.starts_with(v))).cloned());
    if let Some(name) = d.other_form.as_ref().filter(|_| d.suggested_expression.is_some()) {
        lines.push(format!("The better form stands below, ready for the model file ({name}, otherwise than in the catalogue)."));
    }
    if let Some(a) = after {
        let state = if a.verdict == Adequacy::Adequate { "adequate" } else { "still not adequate" };
        lines.push(format!("Added and fitted, the model is {state}: held-out error {}, noise floor {}.", fixed(a.heldout_error, 2), floor_text(a.noise_floor)));
    }
    lines.extend(floors_differ(d, comparison));
    let best = d.candidates.first().filter(|_| d.verdict != Verdict::Adequate);
    let mut cards = vec![(fixed(d.heldout_error, 2), "held-out error now (1 = the stated noise)".to_owned())];
    // What the verdict names: a pair, an effect, or a formula where no effect will do.
    let named = match (&d.together, best, &d.suggested_expression) {
        (_, None, _) => None,
        (Some(t), ..) => Some((t.heldout_error_after, t.effects.join(" and "), Some(t.probability))),
        (None, _, Some(e)) if d.verdict == Verdict::Unexplained => Some((e.heldout_error_after, "the formula found".to_owned(), None)),
        (None, Some(c), _) => Some((c.heldout_error_after, c.effect.clone(), Some(c.probability))),
    };
    if let Some((error, with, _)) = &named {
        cards.push((fixed(*error, 2), format!("held-out error with {with}")));
    }
    cards.push((floor_text(d.noise_floor), "noise floor: the least that any model tried leaves".to_owned()));
    if let Some((_, with, Some(p))) = &named {
        cards.push((probability(*p), format!("probability of {with}")));
    }
    Section::new("verdict", "Verdict").verdict(tone, &lines).cards(&cards).list(&d.notes)
}
