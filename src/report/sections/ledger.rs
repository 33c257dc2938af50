//! The error falls: the staircase from the first model to the noise floor, and the pictures before and after.

use super::residuals::{Trend, panel, reach, strongest, trends};
use crate::impact_table::column_words;
use crate::report::chart::{Bars, Chart, Colour, Points, Rule, Symbol};
use crate::report::markup::{fixed, with_sd};
use crate::report::page::{Layout, Section, Table};
use crate::report::parameter_unit::with_unit;
use crate::validation::ledger::noise_floor;
use crate::validation::structure::floor_text;
use crate::validation::{Comparison, LedgerEntry};

/// Trends shown before and after.
const PAIRS: usize = 4;
/// A trend that changed by less (half-widths of its band) looks the same after the step.
const LEAST_CHANGE: f64 = 0.5;

/// `path`: the versions from the first to this one, measured on the same data. `stages`: comparisons of versions, first to
/// last, for the small multiples before and after each step; the last ones belong to the last versions of the path.
pub fn ledger(path: &[&LedgerEntry], stages: &[&Comparison]) -> Option<Section> {
    if path.len() < 2 && stages.len() < 2 {
        return None;
    }
    let falls = path.first().zip(path.last()).is_none_or(|(first, last)| last.heldout_error <= first.heldout_error);
    let mut section = Section::new("ledger", if falls { "The error falls" } else { "The error, version by version" });
    if path.len() >= 2 {
        section = section.figures(
            Layout::Wide,
            &[(staircase(path), "Root mean square of residual over noise. Bars: on the same held-out impacts, version by version; diamonds: on the impacts the fit used. Dashed: the noise floor as the best of the versions leaves it, what a model without fault would show on this data.".to_owned())],
        );
        section = section.table(table(path));
        let refused: Vec<String> = path
            .iter()
            .flat_map(|e| e.refused.iter())
            .map(|r| {
                format!(
                    "{} was tried and refused: {} (held-out error {} → {})",
                    r.effect,
                    r.reason,
                    fixed(r.heldout_error_before, 3),
                    fixed(r.heldout_error_after, 3)
                )
            })
            .collect();
        section = section.list(&refused);
    }
    for (k, pair) in stages.windows(2).enumerate() {
        let [before, after] = pair else { continue };
        let figures = before_and_after(before, after);
        if !figures.is_empty() {
            let step = (path.len() + k + 1).checked_sub(stages.len()).and_then(|at| path.get(at)).map(|e| step_name(e));
            let heading = step.map_or_else(|| "The same residuals, before and after".to_owned(), |s| format!("The same residuals, before and after: {s}"));
            section = section.heading(&heading).figures(Layout::Small, &figures);
        }
    }
    Some(section)
}

fn step_name(e: &LedgerEntry) -> String {
    e.step.strip_prefix("added ").map_or_else(|| e.step.clone(), |effect| format!("+ {effect}"))
}

fn staircase(path: &[&LedgerEntry]) -> String {
    let names: Vec<String> = path.iter().map(|e| step_name(e)).collect();
    let bars: Vec<(f64, f64, f64)> = path.iter().enumerate().map(|(i, e)| (i as f64 - 0.5, i as f64 + 0.5, e.heldout_error)).collect();
    let fit: Vec<(f64, f64)> = path.iter().enumerate().map(|(i, e)| (i as f64, e.fit_error)).collect();
    let floor = noise_floor(path);
    let (first, last) = (path.first().map_or(f64::NAN, |e| e.heldout_error), path.last().map_or(f64::NAN, |e| e.heldout_error));
    Chart::new("Error on impacts no fit has seen")
        .describe(&format!(
            "The held-out error goes from {} to {} in {} steps; the noise floor is {}.",
            fixed(first, 2),
            fixed(last, 2),
            path.len() - 1,
            floor_text(floor)
        ))
        .size((200.0 + 85.0 * path.len() as f64).clamp(560.0, 900.0), 270.0)
        .x_categories(&names)
        .x("version of the model", "")
        .y("rms residual / noise", "")
        .y_include(0.0)
        .add(Bars::new(&bars).name("held out").colour(Colour::BLUE))
        .add(Points::new(&fit).symbol(Symbol::Diamond).size(7.0).name("impacts of the fit").colour(Colour::ORANGE))
        .add(Rule::horizontal(floor).name("noise floor"))
        .to_svg()
}

fn table(path: &[&LedgerEntry]) -> Table {
    let mut table = Table::new("Versions of the model")
        .column("step")
        .numbers("held-out error")
        .numbers("fit error")
        .column("`compare`")
        .column("parameters (± sd)")
        .column("file")
        .column("date");
    for e in path {
        let parameters: Vec<String> = e.parameters.iter().map(|p| format!("{} {}", p.name, with_unit(&with_sd(p.value, p.sd), &p.name))).collect();
        table = table.row(&[
            step_name(e),
            fixed(e.heldout_error, 3),
            fixed(e.fit_error, 3),
            e.verdict.to_string(),
            parameters.join(", "),
            e.model_file.clone(),
            e.date.clone(),
        ]);
    }
    table
}

fn before_and_after(before: &Comparison, after: &Comparison) -> Vec<(String, String)> {
    let (old, new) = (trends(before), trends(after));
    let twin = |t: &Trend| new.iter().position(|n| n.output == t.output && n.input == t.input);
    let mut figures = Vec::new();
    // Those that changed most; what stayed as it was tells nothing of the step.
    let mut changed: Vec<(&Trend, usize)> = strongest(&old, 1).into_iter().filter_map(|t| Some((t, twin(t)?))).collect();
    let change = |(t, n): &(&Trend, usize)| (t.strength - new[*n].strength).abs();
    changed.retain(|pair| change(pair) > LEAST_CHANGE);
    changed.sort_by(|a, b| change(b).total_cmp(&change(a)));
    for (t, n) in changed.into_iter().take(PAIRS) {
        let every = t.points.len().div_ceil(900).max(1);
        let (output, input) = (column_words(&t.output).words, column_words(&t.input).words);
        let same = reach(&t.points);
        for (trend, when) in [(t, "Before"), (&new[n], "After")] {
            figures.push((panel(trend, &format!("{when}: {output}"), every, (250.0, 190.0), same), format!("against {input}")));
        }
    }
    figures
}
