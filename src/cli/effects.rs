//! `sweetspot effects`.

use super::Shell;
use super::error::CliError;
use crate::impact::card::{EffectCard, EffectKind, ParameterCard, Role};
use crate::impact::expression::{Stage, channels, quantities};
use crate::impact::{ModelError, catalogue, effect_card};
use crate::provenance::read_no_further;
use std::fmt::Write as _;
use std::io::Write as _;

/// The catalogue of physical effects
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// Only this effect, in full
    pub effect: Option<String>,
    /// What an expression may use and replace: every name with its unit and meaning
    #[arg(long, conflicts_with = "effect")]
    pub quantities: bool,
}

pub fn run(arguments: Arguments, shell: &Shell) -> Result<(), CliError> {
    if arguments.quantities {
        if shell.args.json {
            return shell.print_json(&serde_json::json!({ "usable": names(usable()), "replaceable": names(replaceable()) }));
        }
        let text = format!(
            "An expression may use (each from the point on at which it is known: bodies, contact laws, impulses, outcome)\n{}\nIt may replace, one at a time (`replaces`)\n{}",
            table(usable()),
            table(replaceable())
        );
        return print(&text);
    }
    let cards: Vec<&EffectCard> = match &arguments.effect {
        Some(name) => vec![effect_card(name).ok_or_else(|| ModelError::unknown_effect(name))?],
        None => catalogue().to_vec(),
    };
    if shell.args.json {
        return shell.print_json(&cards);
    }
    let text = if arguments.effect.is_some() { cards.iter().map(|c| in_full(c)).collect() } else { list(&cards) };
    print(&text)
}

fn print(text: &str) -> Result<(), CliError> {
    read_no_further(std::io::stdout().write_all(text.as_bytes())).map_err(CliError::output)
}

/// Name, unit, where in the computation, meaning.
type Named = (&'static str, &'static str, Stage, &'static str);

fn usable() -> impl Iterator<Item = Named> {
    quantities().iter().map(|q| (q.name, q.unit, q.stage, q.meaning))
}

fn replaceable() -> impl Iterator<Item = Named> {
    channels().iter().map(|c| (c.name, c.unit, c.stage(), c.meaning))
}

fn stage_name(stage: Stage) -> &'static str {
    match stage {
        Stage::Body => "bodies",
        Stage::Laws => "contact laws",
        Stage::Impulse => "impulses",
        Stage::Output => "outcome",
    }
}

fn names(named: impl Iterator<Item = Named>) -> Vec<serde_json::Value> {
    named.map(|(name, unit, stage, meaning)| serde_json::json!({ "name": name, "unit": unit, "at": stage_name(stage), "meaning": meaning })).collect()
}

fn table(named: impl Iterator<Item = Named>) -> String {
    named.fold(String::new(), |mut text, (name, unit, stage, meaning)| {
        let _ = writeln!(text, "  {name:<36} {unit:<8} {:<13} {meaning}", stage_name(stage));
        text
    })
}

fn list(cards: &[&EffectCard]) -> String {
    let mut text = String::new();
    for (kind, title) in [(EffectKind::Physics, "Physics"), (EffectKind::Measurement, "Measurement, mimicking physics")] {
        let _ = writeln!(text, "{title}");
        for card in cards.iter().filter(|c| c.kind == kind) {
            let first = card.physics.split(". ").next().unwrap_or(card.physics).trim_end_matches('.');
            let _ = writeln!(text, "  {:<20} {first}.", card.name);
        }
    }
    text.push_str("`sweetspot effects NAME` shows one in full: equation, parameters, signature, what it is confused with.\n");
    text.push_str("`sweetspot effects --quantities` lists what an effect of your own may use and replace.\n");
    text
}

fn in_full(card: &EffectCard) -> String {
    let mut t = String::new();
    let kind = card.kind.name();
    let _ = writeln!(t, "{} ({kind})\n\n  {}\n\n  Equation      {}\n  Parameters", card.name, card.physics, card.equation);
    for p in card.parameters {
        let _ = writeln!(t, "    {}", parameter_line(p));
    }
    let _ = writeln!(t, "  Signature     {}", card.signature);
    let _ = writeln!(t, "  Confused with {}", card.confused_with.join(", "));
    let _ = writeln!(t, "  Separated by  {}", card.separated_by);
    if let Some(what) = card.check_first {
        let _ = writeln!(t, "  Check first   {what}");
    }
    let _ = writeln!(t, "  Rigid         {}\n  Viscoelastic  {}", card.bases.rigid, card.bases.viscoelastic);
    let _ = writeln!(t, "  Source        {}", card.source);
    t
}

fn parameter_line(p: &ParameterCard) -> String {
    let unit = if p.unit.is_empty() { String::new() } else { format!(" {}", p.unit) };
    let role = match p.role {
        Role::Strength { absent, .. } => format!("strength, absent at {absent}"),
        Role::Shape => "shape".into(),
        Role::Base => "base".into(),
    };
    format!("{} = {}{unit} ({} to {}; {role}): {}", p.name, p.default, p.min, p.max, p.meaning)
}
