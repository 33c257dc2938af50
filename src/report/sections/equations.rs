//! The cards of the effects that matter here: physics, equation, parameters, source, what they are confused with.

use crate::impact::{EffectKind, effect_card};
use crate::report::markup::plain;
use crate::report::page::{Section, Table};
use crate::validation::diagnosis::{Diagnosis, Verdict};

/// Cards shown.
const MOST: usize = 5;
/// A candidate less probable than this is not explained.
const LEAST_PROBABILITY: f64 = 0.005;

/// Cards of the recommended effects, the likely candidates and their aliases; `None` when there are none, or nothing is missing.
pub fn equations(d: &Diagnosis) -> Option<Section> {
    if d.verdict == Verdict::Adequate && d.recommended.is_empty() {
        return None;
    }
    let likely = d.candidates.iter().filter(|c| c.probability >= LEAST_PROBABILITY);
    let mut names: Vec<&str> = d.recommended.iter().map(String::as_str).collect();
    names.extend(likely.clone().map(|c| c.effect.as_str()));
    names.extend(likely.flat_map(|c| c.aliases.iter().map(String::as_str)));
    names.extend(d.suggested_expression.iter().flat_map(|e| e.nearest.iter().map(String::as_str)));
    let mut seen = std::collections::BTreeSet::new();
    names.retain(|n| seen.insert(*n));
    let mut section = Section::new("equations", "The effects in question");
    for card in names.into_iter().filter_map(effect_card).take(MOST) {
        let kind = if card.kind == EffectKind::Physics { "physics" } else { "a measuring error that looks like physics" };
        section = section.heading(&format!("{} ({kind})", card.name)).paragraph(card.physics).code(card.equation);
        let mut table = Table::new("").column("parameter").column("unit").numbers("default").numbers("from").numbers("to").column("meaning");
        for p in card.parameters {
            table = table.row(&[p.name, if p.unit.is_empty() { "1" } else { p.unit }, &plain(p.default), &plain(p.min), &plain(p.max), p.meaning]);
        }
        section = section
            .table(table)
            .paragraph(&format!("Signature: {}", card.signature))
            .paragraph(&format!(
                "Told from {} by: {}",
                if card.confused_with.is_empty() { "others".to_owned() } else { card.confused_with.join(", ") },
                card.separated_by
            ))
            .note(&format!("Source: {}", card.source));
        if let Some(what) = card.check_first {
            section = section.note(&format!("Check first: {what}"));
        }
    }
    (!section.is_empty()).then_some(section)
}
