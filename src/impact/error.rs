//! Everything that can be wrong with a model, its file, or an impact given to it.

use crate::near_names::near_names;
use std::path::PathBuf;

#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ModelError {
    #[error("{path}: cannot be read ({message}); check the name", path = .path.display())]
    Unreadable { path: PathBuf, message: String },
    #[error("{path}: {message}", path = .path.display())]
    Toml { path: PathBuf, message: String },
    #[error("{path}: `{place}` has no key `{key}`{near}; it has: {known}", path = .path.display())]
    UnknownKey { path: PathBuf, place: String, key: String, near: String, known: String },
    #[error("{path}: `{key}` is {seen}; allowed: {allowed}", path = .path.display())]
    Value { path: PathBuf, key: String, seen: String, allowed: String },
    #[error("the expressions ask for {seen} columns of the table's own; allowed: {most}; put what belongs together into one column")]
    TooManyColumns { seen: usize, most: usize },
    #[error("the model asks for `column.{name}`{near}, and the table has no such column of its own; it has: {}", if .seen.is_empty() { "none" } else { .seen })]
    NoColumn { name: String, near: String, seen: String },
    #[error("no effect `{name}`{near}; `sweetspot effects` lists the catalogue")]
    UnknownEffect { name: String, near: String },
    /// An error that says nothing of the file, found while reading one.
    #[error("{path}: {cause}", path = .path.display())]
    InFile { path: PathBuf, cause: Box<ModelError> },
    #[error("effect `{name}` is in the model already; change its parameters instead")]
    EffectTwice { name: String },
    #[error("effect `{name}` does not exist in base \"{base}\": {reason}")]
    NotInBase { name: String, base: &'static str, reason: String },
    #[error("the model has no parameter `{name}`{near}; it has: {known}")]
    UnknownParameter { name: String, near: String, known: String },
    #[error("parameter `{name}` = {seen}; allowed: {min} to {max}")]
    ParameterRange { name: String, seen: f64, min: f64, max: f64 },
    #[error("{what} = {seen}; allowed: {allowed}")]
    Body { what: &'static str, seen: f64, allowed: String },
    #[error("input `{what}` = {seen}; allowed: a finite number within ±{limit}")]
    InputRange { what: &'static str, seen: f64, limit: f64 },
    #[error("no contact: ball and impact point approach at {approach_m_s:.4} m/s; the ball must move toward the strings (at least {min_m_s} m/s)")]
    NoApproach { approach_m_s: f64, min_m_s: f64 },
    #[error("the ball has not left the strings after {elapsed_s} s (force {force_n:.1} N); check mass, stiffness and damping of the model")]
    NoRelease { elapsed_s: f64, force_n: f64 },
    #[error("effect `{effect}`: `{quantity}` became {seen}{}; allowed: {allowed}", not_finite(*.seen))]
    EffectRange { effect: String, quantity: &'static str, seen: f64, allowed: &'static str },
    #[error("the outcome is not a finite number; an effect's parameters are outside what its equation can bear")]
    NotFinite,
    #[error("expression of `{effect}`: {message}\n  {expression}\n  {marker}")]
    Expression { effect: String, expression: String, marker: String, message: String },
}

/// What makes a formula's value no finite number, as a rule.
fn not_finite(seen: f64) -> &'static str {
    match seen {
        s if s.is_nan() => " (a root or logarithm of a negative number, or a division by 0)",
        s if s.is_infinite() => " (a division by 0, or a number beyond all bounds)",
        _ => "",
    }
}

impl ModelError {
    /// The same error with the file it was found in, unless it names the file already.
    pub(crate) fn in_file(self, path: &std::path::Path) -> Self {
        match self {
            ModelError::Unreadable { .. } | ModelError::Toml { .. } | ModelError::UnknownKey { .. } | ModelError::Value { .. } | ModelError::InFile { .. } => {
                self
            }
            cause => ModelError::InFile { path: path.into(), cause: Box::new(cause) },
        }
    }

    /// An effect the catalogue does not have, with the names nearest to it.
    pub fn unknown_effect(name: &str) -> Self {
        let near = near_names(name, super::catalogue().iter().map(|c| c.name));
        ModelError::UnknownEffect { name: name.to_owned(), near }
    }
}
