//! An effect's card: what it is, in words and numbers, in one place for every reader of it.

use super::effects::DifferentiableEffect;
use serde::Serialize;

/// Whether nature or the measurement does it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum EffectKind {
    Physics,
    /// Acts on the observation: the user's numbers differ from the true ones.
    Measurement,
}

impl EffectKind {
    pub fn name(self) -> &'static str {
        match self {
            EffectKind::Physics => "physics",
            EffectKind::Measurement => "measurement",
        }
    }
}

/// What a parameter does to its effect.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "lowercase", tag = "role")]
pub enum Role {
    /// How much of the effect there is; at `absent` the prediction is exactly that without the effect.
    Strength { absent: f64, one_sided: bool },
    /// The form of the effect; without meaning while the strength is absent.
    Shape,
    /// A parameter of the base model.
    Base,
}

#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ParameterCard {
    pub name: &'static str,
    pub unit: &'static str,
    pub default: f64,
    pub min: f64,
    pub max: f64,
    /// A typical size of the strength, or of the uncertainty of a shape parameter.
    pub typical: f64,
    #[serde(flatten)]
    pub role: Role,
    /// Freed by `fit` when the effect has just been added.
    pub fit: bool,
    /// Of a strength: in base viscoelastic only its size counts, and none is no limit of small ones.
    #[serde(skip)]
    pub size_alone: bool,
    /// Of a strength: its physics has it positive only, though a fit of base rigid may find it the other way round.
    #[serde(skip)]
    pub one_way: bool,
    pub meaning: &'static str,
}

impl ParameterCard {
    /// A strength, absent at 0, fitted once added.
    pub const fn strength(name: &'static str, unit: &'static str, meaning: &'static str, default: f64, range: (f64, f64), typical: f64) -> Self {
        ParameterCard {
            name,
            unit,
            default,
            min: range.0,
            max: range.1,
            typical,
            role: Role::Strength { absent: 0.0, one_sided: range.0 >= 0.0 },
            fit: true,
            size_alone: false,
            one_way: false,
            meaning,
        }
    }

    /// A shape parameter, kept at its default unless the user frees it.
    pub const fn shape(name: &'static str, unit: &'static str, meaning: &'static str, default: f64, range: (f64, f64), typical: f64) -> Self {
        ParameterCard { name, unit, default, min: range.0, max: range.1, typical, role: Role::Shape, fit: false, size_alone: false, one_way: false, meaning }
    }

    /// The same, and the fit may move it.
    #[must_use]
    pub const fn fitted(self) -> Self {
        ParameterCard { fit: true, ..self }
    }

    /// The same, and in base viscoelastic only its size counts.
    #[must_use]
    pub const fn size_alone(self) -> Self {
        ParameterCard { size_alone: true, ..self }
    }

    /// The same, and its physics has it positive only.
    #[must_use]
    pub const fn one_way(self) -> Self {
        ParameterCard { one_way: true, ..self }
    }

    /// A parameter of the base model.
    pub const fn base(name: &'static str, unit: &'static str, meaning: &'static str, default: f64, range: (f64, f64), typical: f64) -> Self {
        ParameterCard { name, unit, default, min: range.0, max: range.1, typical, role: Role::Base, fit: false, size_alone: false, one_way: false, meaning }
    }

    /// True for a strength.
    pub fn is_strength(&self) -> bool {
        matches!(self.role, Role::Strength { .. })
    }
}

/// Where an effect can be used and in which form.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct Bases {
    /// Form in base "rigid".
    pub rigid: &'static str,
    /// Form in base "viscoelastic".
    pub viscoelastic: &'static str,
}

/// The card of one effect of the catalogue.
#[derive(Debug, Serialize)]
pub struct EffectCard {
    pub name: &'static str,
    pub kind: EffectKind,
    /// Two sentences.
    pub physics: &'static str,
    pub equation: &'static str,
    pub parameters: &'static [ParameterCard],
    pub source: &'static str,
    /// What it does to the outputs, and on which inputs that depends.
    pub signature: &'static str,
    /// Names of the catalogue.
    pub confused_with: &'static [&'static str],
    pub separated_by: &'static str,
    /// What is no effect and looks much like it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub check_first: Option<&'static str>,
    pub bases: Bases,
    #[serde(skip)]
    pub effect: &'static dyn DifferentiableEffect,
}

impl EffectCard {
    /// The parameters that say how much of the effect there is, with their place in `parameters`.
    pub fn strengths(&self) -> impl Iterator<Item = (usize, &'static ParameterCard)> {
        self.parameters.iter().enumerate().filter(|(_, p)| p.is_strength())
    }
}
