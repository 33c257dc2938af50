//! `sweetspot effects`.

use super::Shell;
use super::error::CliError;
use crate::impact::card::{EffectCard, EffectKind, ParameterCard, Role};
use crate::impact::{ModelError, catalogue, effect_card};
use std::fmt::Write as _;
use std::io::Write as _;

/// The catalogue of physical effects
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// Only this effect, in full
    pub effect: Option<String>,
}

pub fn run(arguments: Arguments, shell: &Shell) -> Result<(), CliError> {
    let cards: Vec<&EffectCard> = match &arguments.effect {
        Some(name) => vec![effect_card(name).ok_or_else(|| ModelError::unknown_effect(name))?],
        None => catalogue().to_vec(),
    };
    if shell.args.json {
        return shell.print_json(&cards);
    }
    let text = if arguments.effect.is_some() { cards.iter().map(|c| in_full(c)).collect() } else { list(&cards) };
    std::io::stdout().write_all(text.as_bytes()).map_err(CliError::output)
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
    text
}

fn in_full(card: &EffectCard) -> String {
    let mut t = String::new();
    let kind = if card.kind == EffectKind::Physics { "physics" } else { "measurement" };
    let _ = writeln!(t, "{} ({kind})\n\n  {}\n\n  Equation      {}\n  Parameters", card.name, card.physics, card.equation);
    for p in card.parameters {
        let _ = writeln!(t, "    {}", parameter_line(p));
    }
    let _ = writeln!(t, "  Signature     {}", card.signature);
    let _ = writeln!(t, "  Confused with {}", card.confused_with.join(", "));
    let _ = writeln!(t, "  Separated by  {}", card.separated_by);
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
