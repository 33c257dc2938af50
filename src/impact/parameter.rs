//! A model's parameters as one flat list, for fits and derivatives.

use super::card::{ParameterCard, Role};
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

    /// The name without the effect's prefix: the key in the model file.
    pub fn key(&self) -> &str {
        self.name.rsplit('.').next().unwrap_or(&self.name)
    }
}
