//! A model's parameters as one flat list, for fits and derivatives.

use super::card::{ParameterCard, Role};
use super::model::Base;
use serde::Serialize;

/// One number of the model that a user can set and a fit can free.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Parameter {
    /// `restitution`, or `frame-vibration.frequency_hz` for an effect's.
    pub name: String,
    pub value: f64,
    /// Freed by `fit`.
    pub fit: bool,
    pub min: f64,
    pub max: f64,
    pub unit: String,
    /// A typical size: steps of derivatives and widths of priors scale with it.
    pub typical: f64,
    pub role: Role,
}

impl Parameter {
    /// A card's parameter at its default, named `<prefix>.<name>` (or just the name).
    pub fn from_card(prefix: Option<&str>, card: &ParameterCard) -> Self {
        Parameter {
            name: prefix.map_or_else(|| card.name.to_owned(), |p| format!("{p}.{}", card.name)),
            value: card.default,
            fit: card.fit,
            min: card.min,
            max: card.max,
            unit: card.unit.to_owned(),
            typical: card.typical,
            role: card.role,
        }
    }

    /// What it is in a base: where only its size counts, it is 0 or more.
    #[must_use]
    pub(crate) fn in_base(mut self, base: Base, card: &ParameterCard) -> Self {
        if let (Base::Viscoelastic, Role::Strength { absent, .. }, true) = (base, self.role, card.size_alone) {
            self.min = absent;
            self.role = Role::Strength { absent, one_sided: true };
        }
        self
    }

    /// A parameter of a user's own effect: any finite value, scaled by its value or bounds.
    pub fn own(name: &str, value: f64) -> Self {
        Parameter {
            name: name.to_owned(),
            value,
            fit: false,
            min: -1e9,
            max: 1e9,
            unit: String::new(),
            typical: own_scale(value, -1e9, 1e9),
            role: Role::Shape,
        }
    }

    /// Brings `typical` of a user's own parameter in line with its value and bounds.
    pub(crate) fn rescale_own(&mut self) {
        self.typical = own_scale(self.value, self.min, self.max);
    }

    /// The name without the effect's prefix: the key in the model file.
    pub fn key(&self) -> &str {
        self.name.rsplit('.').next().unwrap_or(&self.name)
    }
}

/// A tenth of the bounds' width where the user gave bounds, else the value itself, else 1.
fn own_scale(value: f64, min: f64, max: f64) -> f64 {
    let width = max - min;
    if width > 0.0 && width < 1e8 {
        0.1 * width
    } else if value != 0.0 {
        value.abs()
    } else {
        1.0
    }
}
