//! What a person reads in the terminal after `compare` and `diagnose`.

use super::comparison::{Adequacy, Comparison};
use super::diagnosis::{Diagnosis, Verdict};
use super::ledger::{LedgerEntry, noise_floor};
use super::structure::{floor_text, p_text, probability_text};
use crate::impact_table::{column_subject, unit};
use crate::short_list::short_list;
use std::fmt::Write;

/// Outlying numbers that are named.
const OUTLIERS_NAMED: usize = 6;

/// Candidates listed in the terminal; the others are in the file.
const LISTED: usize = 5;

/// `compare` in words.
pub fn comparison_text(c: &Comparison) -> String {
    let mut t = String::new();
    let _ = writeln!(t, "{}: {} impacts, {} of them held out for the check", c.model, c.n_impacts, c.n_held_out);
    let names: Vec<String> = c.outputs.iter().map(|o| format!("{} ({})", column_subject(&o.name), o.name)).collect();
    let wide = widest(&names, "output");
    let _ = writeln!(t, "  {:<wide$} {:>5} {:>13} {:>13} {:>13}  chi²/n", "output", "n", "rmse", "bias", "noise");
    for (o, name) in c.outputs.iter().zip(&names) {
        let _ = writeln!(
            t,
            "  {name:<wide$} {:>5} {:>13} {:>13} {:>13}  {:.2}",
            o.n,
            quantity(o.rmse, &o.name),
            quantity(o.bias, &o.name),
            quantity(o.noise_sd, &o.name),
            o.chi2_reduced
        );
    }
    let _ = writeln!(
        t,
        "error on held-out impacts: {:.2} as the model stands, {:.2} with its free parameters fitted; {} {} (in units of the stated noise)",
        c.heldout_error,
        c.heldout_error_refitted,
        if c.verdict == Adequacy::Adequate { "a model without fault has" } else { "no smooth correction gets below" },
        floor_text(c.noise_floor)
    );
    let fitted: Vec<String> = c
        .parameters_refitted
        .iter()
        .zip(&c.parameters_as_stated)
        .map(|(f, s)| {
            if f.is_held() {
                return format!("{} {} (held fixed: its min and max are the same)", f.name, short(s.value));
            }
            if f.undetermined {
                return format!("{} {} (these impacts say nothing about it)", f.name, short(s.value));
            }
            format!("{} {} -> {} ± {}{}", f.name, short(s.value), short(f.value), short(f.sd), if f.at_limit { " (at its limit)" } else { "" })
        })
        .collect();
    if !fitted.is_empty() {
        let _ = writeln!(t, "fitted: {}", fitted.join(", "));
    }
    outliers_text(&mut t, &c.outliers, c.verdict == Adequacy::Adequate);
    for note in &c.notes {
        let _ = writeln!(t, "note: {note}");
    }
    let structure = format!("structure test {}; a sound model fails it in {:.1} % of tables", p_text(c.structure.p_value), 100.0 * c.false_alarm_rate);
    if c.verdict == Adequacy::Adequate {
        let left = if c.keeps_structure() {
            "What structure is left does not show in the error of held-out impacts"
        } else {
            "No structure beyond the noise shows in the residuals"
        };
        let _ = writeln!(t, "verdict: ADEQUATE. {left} ({structure}).");
        for doubt in &c.doubts {
            let _ = writeln!(t, "         {doubt}");
        }
        let _ = writeln!(t, "         `sweetspot diagnose` looks harder: at every effect of the catalogue, and every place on the face, by itself.");
        if c.stated_is_worse() {
            let _ = writeln!(t, "         The numbers in the file are not the best ones: run `sweetspot fit`.");
        }
    } else {
        let why = c.failing_words();
        let capital = why.chars().next().map(|c| c.to_uppercase().to_string()).unwrap_or_default();
        let _ = writeln!(t, "verdict: NOT ADEQUATE. {capital}{} ({structure}).", why.get(1..).unwrap_or_default());
        let _ = writeln!(t, "         Run `sweetspot diagnose` on the same files: it says where, and which effect is missing.");
    }
    t
}

fn outliers_text(t: &mut String, outliers: &[super::comparison::Outlier], adequate: bool) {
    if outliers.is_empty() {
        return;
    }
    let list: Vec<String> = outliers.iter().map(|o| format!("{} {} ({:+.1} sd)", o.id, o.column, o.standardised)).collect();
    let _ = writeln!(
        t,
        "{}: {}",
        if adequate {
            "outlying numbers (they keep little weight, in chi²/n too)"
        } else {
            "numbers far from what this model makes of their impact (while it fails they may show what it lacks, and need not be wrong)"
        },
        short_list(&list, OUTLIERS_NAMED, ", ")
    );
}

/// Letters of the longest of the names of lines and of what else stands in their column.
fn widest(names: &[String], other: &str) -> usize {
    names.iter().map(|name| name.chars().count()).max().unwrap_or(0).max(other.chars().count())
}

fn quantity(value: f64, column: &str) -> String {
    match unit(column) {
        "s" => format!("{:.3} ms", 1e3 * value),
        "rad/s" => format!("{value:.2} rad/s"),
        u => format!("{value:.3} {u}"),
    }
}

/// `diagnose` in words.
pub fn diagnosis_text(d: &Diagnosis) -> String {
    let mut t = String::new();
    for line in &d.words {
        let _ = writeln!(t, "{line}");
    }
    if d.verdict == Verdict::Adequate {
        notes_text(&mut t, d);
        return t;
    }
    if !d.places.is_empty() {
        let _ = writeln!(t, "\nWhere it fails:");
        for p in &d.places {
            let _ = writeln!(t, "  - {} ({} impacts)", p.words, p.n);
        }
    }
    let _ = writeln!(t, "\nWhat could be missing (error on held-out impacts, floor {:.2}):", d.noise_floor);
    let _ = writeln!(t, "  {:<22} {:>11} {:>8} {:>8}  fitted; could also be", "effect", "probability", "before", "after");
    for c in d.candidates.iter().take(LISTED) {
        let fitted: Vec<String> =
            c.parameters.iter().map(|(name, e)| format!("{} {} ± {}", name.rsplit('.').next().unwrap_or(name), short(e.value), short(e.sd))).collect();
        let _ = writeln!(
            t,
            "  {:<22} {:>11} {:>8.2} {:>8.2}  {}{}",
            c.effect,
            probability_text(c.probability),
            c.heldout_error_before,
            c.heldout_error_after,
            fitted.join(", "),
            if c.aliases.is_empty() { String::new() } else { format!("; {}", c.aliases.join(", ")) }
        );
    }
    if let Some(pair) = &d.together {
        let _ = writeln!(t, "  together {}: held-out error {:.2} -> {:.2}", pair.effects.join(" and "), pair.heldout_error_before, pair.heldout_error_after);
    }
    if let Some(e) = &d.suggested_expression {
        let _ = writeln!(t, "\nA formula found from the residuals ({}):", e.words);
        let _ = writeln!(t, "  {} -> {}   (held-out error {:.2})", e.replaces, e.expression, e.heldout_error_after);
        let _ = writeln!(t, "  behaves most like: {}", if e.nearest.is_empty() { "no effect of the catalogue".to_owned() } else { e.nearest.join(", ") });
        let _ = writeln!(t, "  for the model file:\n{}", e.model_file_text.lines().map(|l| format!("    {l}")).collect::<Vec<_>>().join("\n"));
    }
    for x in &d.next_experiments {
        let _ = writeln!(t, "\nTo tell {} from {}: {}", x.separates[0], x.separates[1], x.why);
        let _ =
            writeln!(t, "  {} impacts to set up (listed in diagnosis.json), {} time{} over", x.impacts.len(), x.repeats, if x.repeats == 1 { "" } else { "s" });
    }
    if let [only] = d.recommended.as_slice() {
        let _ = writeln!(t, "\nNext: sweetspot add {only} --model <your model> -o <new model>, then fit, then compare again (or diagnose --auto).");
    } else if d.recommended.len() > 1 {
        let _ = writeln!(t, "\nNext: add {} one after the other, fit, compare again (or diagnose --auto).", d.recommended.join(" and "));
    }
    let unseen: Vec<&str> = d.not_visible.iter().map(|n| n.effect.as_str()).collect();
    if !unseen.is_empty() {
        let _ = writeln!(t, "\nCannot be seen on these impacts (reasons in diagnosis.json): {}", unseen.join(", "));
    }
    notes_text(&mut t, d);
    t
}

fn notes_text(t: &mut String, d: &Diagnosis) {
    outliers_text(t, &d.outliers, d.verdict == Verdict::Adequate);
    for note in &d.notes {
        let _ = writeln!(t, "note: {note}");
    }
}

/// Three significant digits.
pub fn short(value: f64) -> String {
    if value == 0.0 {
        return "0".to_owned();
    }
    let digits = (2 - value.abs().log10().floor() as i32).clamp(0, 9) as usize;
    if value.abs() >= 1e6 || value.abs() < 1e-6 { format!("{value:.2e}") } else { format!("{value:.digits$}") }
}

/// The staircase: every version's error on the same held-out impacts.
pub fn ledger_text(path: &[&LedgerEntry]) -> String {
    let mut t = String::new();
    let Some(last) = path.last() else { return t };
    let _ = writeln!(t, "error on the same {} held-out impacts:", last.n_held_out);
    let floor = noise_floor(path);
    let largest = path.iter().map(|e| e.heldout_error).fold(floor, f64::max);
    let bar = |letter: &str, error: f64| letter.repeat(((40.0 * error / largest).round() as usize).clamp(1, 40));
    let names: Vec<String> = path.iter().map(|e| format!("{} ({})", e.step, e.model_file)).collect();
    let wide = widest(&names, "noise floor");
    for (e, name) in path.iter().zip(&names) {
        let _ = writeln!(t, "  {name:<wide$} {:>7.3} {}", e.heldout_error, bar("#", e.heldout_error));
    }
    let _ = writeln!(t, "  {:<wide$} {floor:>7.3} {}", "noise floor", bar("-", floor));
    t
}
