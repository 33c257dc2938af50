//! Which impacts to record next: a table to take to the laboratory for each pair of effects that look alike.

use crate::equipment::Racket;
use crate::impact_table::column_words;
use crate::report::chart::{Legend, Points, Symbol, face};
use crate::report::markup::{fixed, significant};
use crate::report::page::{Section, Table};
use crate::validation::diagnosis::{Diagnosis, NextExperiment};
use std::collections::{BTreeMap, BTreeSet};

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
            section = section.figure(&svg, "Where to hit, by setting.");
        }
    }
    Some(section)
}

/// Settings in the order proposed, each with the number of impacts to record there.
fn settings(e: &NextExperiment) -> Vec<(&BTreeMap<String, f64>, usize)> {
    let mut settings: Vec<(&BTreeMap<String, f64>, usize)> = Vec::new();
    for impact in &e.impacts {
        match settings.iter_mut().find(|(s, _)| *s == impact) {
            Some((_, n)) => *n += 1,
            None => settings.push((impact, 1)),
        }
    }
    settings
}

/// The place first, then what differs between settings; what is the same for all stands in the note.
fn table(e: &NextExperiment) -> Table {
    let settings = settings(e);
    let shown = |c: &str, v: f64| significant(column_words(c).factor * v, 3);
    let mut columns: Vec<&str> = e.impacts.iter().flat_map(|i| i.keys().map(String::as_str)).collect::<BTreeSet<_>>().into_iter().collect();
    columns.sort_by_key(|c| (!c.starts_with("impact_"), *c));
    let (kept, same): (Vec<&str>, Vec<&str>) = columns.into_iter().partition(|c| {
        let values: BTreeSet<String> = settings.iter().filter_map(|(s, _)| s.get(*c)).map(|v| shown(c, *v)).collect();
        c.starts_with("impact_") || values.len() > 1
    });
    let named = |c: &str| {
        let w = column_words(c);
        (w.words, w.unit)
    };
    let rest: Vec<String> = same
        .iter()
        .filter_map(|c| {
            let value = settings.first()?.0.get(*c)?;
            let (words, unit) = named(c);
            (*value != 0.0).then(|| format!("{words} {} {unit}", shown(c, *value)))
        })
        .collect();
    let note = if rest.is_empty() { String::new() } else { format!("In all settings: {}; everything else 0.", rest.join(", ")) };
    let mut table = Table::new(&note).numbers("setting").numbers("impacts");
    for c in &kept {
        let (words, unit) = named(c);
        table = table.numbers(&if unit.is_empty() { words } else { format!("{words} ({unit})") });
    }
    for (k, (setting, n)) in settings.iter().enumerate() {
        let mut cells = vec![(k + 1).to_string(), n.to_string()];
        cells.extend(kept.iter().map(|c| setting.get(*c).map_or_else(String::new, |v| shown(c, *v))));
        table = table.row(&cells);
    }
    table
}

fn picture(e: &NextExperiment, racket: &Racket) -> Option<String> {
    let at: Vec<(f64, f64)> = settings(e).iter().filter_map(|(i, _)| Some((1000.0 * i.get("impact_y")?, 1000.0 * i.get("impact_x")?))).collect();
    if at.is_empty() {
        return None;
    }
    let labels: Vec<String> = (1..=at.len()).map(|k| k.to_string()).collect();
    let chart = face::face("Positions of the next impacts", racket).legend(Legend::Hidden);
    Some(chart.add(Points::new(&at).symbol(Symbol::Diamond).size(7.0).labels(&labels)).to_svg())
}
