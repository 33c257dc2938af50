//! Which impacts to record next: a table to take to the laboratory for each pair of effects that look alike.

use crate::equipment::Racket;
use crate::report::chart::{Legend, Points, Symbol, face};
use crate::report::column::column_words;
use crate::report::markup::{fixed, significant};
use crate::report::page::{Section, Table};
use crate::validation::diagnosis::{Diagnosis, NextExperiment};
use std::collections::BTreeSet;

pub fn next_experiments(d: &Diagnosis, racket: Option<&Racket>) -> Option<Section> {
    if d.next_experiments.is_empty() {
        return None;
    }
    let mut section = Section::new("next", "Which impacts to record next");
    for e in &d.next_experiments {
        let times = if e.repeats == 1 { "once".to_owned() } else { format!("{} times", e.repeats) };
        section = section
            .heading(&format!("{} or {}?", e.separates[0], e.separates[1]))
            .paragraph(&e.why)
            .paragraph(&format!(
                "The whole set, {times}, is expected to bring odds of twenty to one (expected log evidence of one set: {}).",
                fixed(e.expected_log_evidence, 1)
            ))
            .table(table(e));
        if let Some(svg) = racket.and_then(|r| picture(e, r)) {
            section = section.figure(&svg, "Where to hit.");
        }
    }
    Some(section)
}

fn table(e: &NextExperiment) -> Table {
    let columns: BTreeSet<&str> = e.impacts.iter().flat_map(|i| i.keys().map(String::as_str)).collect();
    let mut table = Table::new("").numbers("impact");
    for c in &columns {
        let w = column_words(c);
        table = table.numbers(&if w.unit.is_empty() { w.words } else { format!("{} ({})", w.words, w.unit) });
    }
    for (k, impact) in e.impacts.iter().enumerate() {
        let mut cells = vec![(k + 1).to_string()];
        cells.extend(columns.iter().map(|c| impact.get(*c).map_or_else(String::new, |v| significant(column_words(c).factor * v, 3))));
        table = table.row(&cells);
    }
    table
}

fn picture(e: &NextExperiment, racket: &Racket) -> Option<String> {
    let at: Vec<(f64, f64)> = e.impacts.iter().filter_map(|i| Some((1000.0 * i.get("impact_y")?, 1000.0 * i.get("impact_x")?))).collect();
    if at.is_empty() {
        return None;
    }
    let labels: Vec<String> = (1..=at.len()).map(|k| k.to_string()).collect();
    let chart = face::face("Positions of the next impacts", racket).legend(Legend::Hidden);
    Some(chart.add(Points::new(&at).symbol(Symbol::Diamond).size(7.0).labels(&labels)).to_svg())
}
