//! Which effect is missing: candidates with their probability, what else it could be, what cannot be seen here.

use crate::report::chart::{Chart, Colour, Legend, Line, Points, Rule, Symbol};
use crate::report::markup::{fixed, percent, probability, with_sd};
use crate::report::page::{Layout, Section, Table};
use crate::report::parameter_unit::with_unit;
use crate::validation::diagnosis::{CandidateReport, Diagnosis, Estimate, Verdict};
use std::collections::BTreeMap;

/// Candidates with a line of their own; the others are folded.
const LISTED: usize = 8;

/// The candidates, their aliases, and the effects invisible on this data.
pub fn candidates(d: &Diagnosis) -> Option<Section> {
    if d.candidates.is_empty() && d.not_visible.is_empty() {
        return None;
    }
    let mut section = Section::new("candidates", "Which effect it could be");
    if d.verdict == Verdict::Adequate {
        section = section.paragraph("The model is adequate, so none of these is called for; they are listed for completeness.");
    }
    section = section.note(&format!(
        "{} effects were tested, physics and measurement on equal terms. Probability: over the models refitted and “none”. Errors: on impacts no fit saw, in units of the noise. Excess of the fit removed: of the chi-square of the other impacts, those of the fit, beyond what noise leaves.",
        d.n_tested
    ));
    let shown: Vec<&CandidateReport> = d.candidates.iter().take(LISTED).collect();
    section = section.table(table(&shown));
    let refitted: Vec<&CandidateReport> = shown.iter().copied().filter(|c| c.refitted).collect();
    if refitted.len() > 1 {
        section = section.figures(
            Layout::Normal,
            &[(
                fall(&refitted, d.noise_floor),
                "Held-out error before (ring) and after (dot) each candidate is added by itself; dashed: the noise floor, the least that any model tried leaves.".to_owned(),
            )],
        );
    }
    if let Some(t) = &d.together {
        section = section.paragraph(&format!(
            "{} belong together: probability {}, held-out error {} before and {} after, {} of the excess removed ({}).",
            t.effects.join(" and "),
            probability(t.probability),
            fixed(t.heldout_error_before, 2),
            fixed(t.heldout_error_after, 2),
            percent(t.share_removed),
            estimates(&t.parameters)
        ));
    }
    let aliased: Vec<String> = shown.iter().filter(|c| !c.aliases.is_empty() && c.probability > 0.01).map(|c| alias_words(c, &d.candidates)).collect();
    if !aliased.is_empty() {
        section = section.heading("What else it could be").list(&aliased);
    }
    let rest: Vec<&CandidateReport> = d.candidates.iter().skip(LISTED).collect();
    if !rest.is_empty() {
        section = section
            .folded(&if rest.len() == 1 { "one more candidate".to_owned() } else { format!("{} more candidates", rest.len()) }, |s| s.table(table(&rest)));
    }
    if !d.not_visible.is_empty() {
        let list: Vec<String> = d.not_visible.iter().map(|n| format!("{}: {}", n.effect, n.reason)).collect();
        section = section.folded("Effects that cannot be seen on this data", |s| s.list(&list));
    }
    Some(section)
}

fn table(candidates: &[&CandidateReport]) -> Table {
    let mut table = Table::new("")
        .column("effect")
        .column("probability")
        .numbers("error before")
        .numbers("after")
        .numbers("excess of the fit removed")
        .column("parameters (± sd)")
        .column("kind");
    for c in candidates {
        let plain = |text: String| (text, None);
        let refitted = if c.refitted { String::new() } else { " (scored, not refitted)".to_owned() };
        table = table.row_with_bars(&[
            plain(c.effect.clone()),
            (probability(c.probability), Some(c.probability)),
            plain(fixed(c.heldout_error_before, 2)),
            plain(if c.refitted { fixed(c.heldout_error_after, 2) } else { "–".to_owned() }),
            plain(if c.refitted { percent(c.share_removed.clamp(-9.99, 1.0)) } else { "–".to_owned() }),
            plain(estimates(&c.parameters)),
            plain(format!("{}{refitted}", c.kind)),
        ]);
    }
    table
}

/// `frequency_hz 141 ± 3 Hz, ...`, without the effect's name before each.
pub(super) fn estimates(parameters: &BTreeMap<String, Estimate>) -> String {
    let each = |(name, e): (&String, &Estimate)| format!("{} {}", name.rsplit('.').next().unwrap_or(name), with_unit(&with_sd(e.value, e.sd), name));
    parameters.iter().map(each).collect::<Vec<_>>().join(", ")
}

/// Times as likely as another that alone is no alias: twenty to one.
const TOLD: f64 = 20.0;

fn alias_words(c: &CandidateReport, all: &[CandidateReport]) -> String {
    let told = |other: &str| all.iter().any(|o| o.effect == other && c.probability > TOLD * o.probability);
    let each: Vec<String> = c
        .aliases
        .iter()
        .map(|a| match c.alias_cosines.get(a) {
            Some(cosine) if cosine.abs() > 0.95 && told(a) => {
                format!("{a} (small amounts of both look alike, {}; the amount that is here fits better as {})", fixed(*cosine, 2), c.effect)
            }
            Some(cosine) if cosine.abs() > 0.95 => format!("{a} (signatures alike to {}: cannot be told apart on this data)", fixed(*cosine, 2)),
            _ => format!("{a} (takes about as much of the excess away)"),
        })
        .collect();
    format!("{} could also be {}.", c.effect, each.join("; "))
}

fn fall(candidates: &[&CandidateReport], floor: f64) -> String {
    let names: Vec<String> = candidates.iter().rev().map(|c| c.effect.clone()).collect();
    let mut chart = Chart::new("What each candidate does to the error")
        .size(360.0, 70.0 + 24.0 * names.len() as f64)
        .x("held-out error, noise = 1", "")
        .y_categories(&names)
        .legend(Legend::Hidden)
        .describe(&format!("Held-out error of each of {} candidates, before and after it is added.", names.len()))
        .add(Rule::vertical(floor));
    for (row, c) in candidates.iter().rev().enumerate() {
        let y = row as f64;
        chart = chart
            .add(Line::new(&[(c.heldout_error_before, y), (c.heldout_error_after, y)]).colour(Colour::BLUE).width(2.0))
            .add(Points::new(&[(c.heldout_error_before, y)]).symbol(Symbol::Ring).size(7.0).colour(Colour::GREY))
            .add(Points::new(&[(c.heldout_error_after, y)]).size(7.0).colour(Colour::BLUE));
    }
    chart.to_svg()
}
