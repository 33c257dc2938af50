//! Units of a model's parameters, from the cards that describe them.

use crate::impact::{Base, ParameterCard, effect_card};

/// Unit of a parameter by its full name (`restitution`, `frame-vibration.frequency_hz`); `1` where the catalogue says it
/// has none, empty where nobody says (a user's own expression).
pub(super) fn parameter_unit(name: &str) -> &'static str {
    let named = |cards: &[ParameterCard], key: &str| cards.iter().find(|c| c.name == key).map(|c| if c.unit.is_empty() { "1" } else { c.unit });
    let unit = match name.split_once('.') {
        Some((effect, key)) => effect_card(effect).and_then(|card| named(card.parameters, key)),
        None => [Base::Rigid, Base::Viscoelastic].iter().find_map(|b| named(b.parameters(), name)),
    };
    unit.unwrap_or("")
}

/// A value's text with its unit, where it has one.
pub(super) fn with_unit(value: &str, name: &str) -> String {
    match parameter_unit(name) {
        "" | "1" => value.to_owned(),
        unit => format!("{value} {unit}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::impact::catalogue;

    #[test]
    fn truth_units_come_from_the_cards() {
        assert_eq!(parameter_unit("frame-vibration.frequency_hz"), "Hz");
        assert_eq!(parameter_unit("frame-vibration.amount"), "1");
        assert_eq!((parameter_unit("restitution"), parameter_unit("k_B0")), ("1", "N/m"));
        assert_eq!((parameter_unit("my-own.gain"), parameter_unit("gain")), ("", ""));
        assert_eq!((with_unit("141 ± 3", "frame-vibration.frequency_hz"), with_unit("0.8", "restitution")), ("141 ± 3 Hz".to_owned(), "0.8".to_owned()));
    }

    #[test]
    fn law_every_parameter_of_the_catalogue_has_a_unit() {
        for card in catalogue() {
            for p in card.parameters {
                assert!(!parameter_unit(&format!("{}.{}", card.name, p.name)).is_empty(), "{}.{}", card.name, p.name);
            }
        }
    }
}
