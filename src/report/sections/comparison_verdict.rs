//! The comparison's verdict in words, with the figures that matter.

use crate::impact_table::column_words;
use crate::report::markup::{fixed, percent, significant};
use crate::report::page::{Section, Tone};
use crate::validation::Comparison;
use crate::validation::comparison::{Adequacy, OutputSummary};
use crate::validation::structure::{floor_text, p_text};

/// What the noise floor of a comparison is. Where the model fails, part of its failure is finer than any smooth trend and
/// stays in: `diagnose`, which tries other models, may find a lower one.
pub(super) fn floor_words(c: &Comparison) -> &'static str {
    if c.verdict == Adequacy::Adequate { "noise floor" } else { "upper bound of the noise floor" }
}

/// Verdict, cards and notes of a comparison.
pub fn comparison_verdict(c: &Comparison) -> Section {
    let adequate = c.verdict == Adequacy::Adequate;
    let mut lines = vec![if c.keeps_structure() {
        format!(
            "The model “{}” is adequate for these {} impacts, but the structure test finds something in them: too little to show in the error of those held out.",
            c.model, c.n_impacts
        )
    } else if adequate {
        let best = if c.stated_is_worse() { " once its free parameters are at their best" } else { "" };
        format!("The model “{}” is adequate{best}: nothing in these {} impacts speaks against it beyond their noise.", c.model, c.n_impacts)
    } else if !c.shows_structure() {
        format!("The model “{}” is not adequate: {}.", c.model, c.failing_words())
    } else {
        format!("The model “{}” is not adequate: its errors on these {} impacts have structure that noise does not explain.", c.model, c.n_impacts)
    }];
    lines.extend(c.doubts.iter().cloned());
    lines.push(format!(
        "With its free parameters at their best, the error on {} impacts that the fit never saw is {} times the noise (as its file states them: {}); a model without fault would have {}{}.",
        c.n_held_out,
        fixed(c.heldout_error_refitted, 2),
        fixed(c.heldout_error, 2),
        if adequate { "" } else { "at most about " },
        floor_text(c.noise_floor)
    ));
    if c.stated_is_worse() {
        lines.push(
            "The numbers in the model file are not the best ones for this data: run `sweetspot fit`. The figures below show the model as its file states it."
                .to_owned(),
        );
    }
    if let Some(worst) = worst(&c.outputs) {
        let w = column_words(&worst.name);
        lines.push(format!(
            "Furthest from its noise: {}, rms error {} {u} where the noise is {} {u}.",
            w.words,
            significant(w.factor * worst.rmse, 3),
            significant(w.factor * worst.noise_sd, 3),
            u = w.unit
        ));
    }
    lines.push(format!(
        "Structure test: {} ({} directions looked at, wild bootstrap). A sound model fails it in {} of tables, by design.",
        p_text(c.structure.p_value),
        c.structure.rank,
        percent(c.false_alarm_rate)
    ));
    let cards = [
        (fixed(c.heldout_error_refitted, 2), "held-out error, in units of the noise (fitted)".to_owned()),
        (floor_text(c.noise_floor), format!("{}: what is left when every smooth trend is taken out of this model's residuals", floor_words(c))),
        (format!("{} + {}", c.n_impacts.saturating_sub(c.n_held_out), c.n_held_out), "impacts to fit + held out".to_owned()),
    ];
    Section::new("verdict", "Verdict").verdict(tone_of(c), &lines).cards(&cards).list(&c.notes)
}

/// How a comparison's verdict is to be taken.
pub(super) fn tone_of(c: &Comparison) -> Tone {
    match (c.verdict == Adequacy::Adequate, c.keeps_structure() || !c.doubts.is_empty()) {
        (false, _) => Tone::Bad,
        (true, true) => Tone::Doubt,
        (true, false) => Tone::Good,
    }
}

/// The output furthest above its noise.
fn worst(outputs: &[OutputSummary]) -> Option<&OutputSummary> {
    outputs.iter().filter(|o| o.chi2_reduced.is_finite()).max_by(|a, b| a.chi2_reduced.total_cmp(&b.chi2_reduced))
}
