//! `impact`: from an impact's inputs to its outcome, by a model built of named physical effects.
//!
//! Comes in: [`ImpactInput`] (racket-local axes, SI), a [`Racket`](crate::equipment::Racket), a
//! [`Ball`](crate::equipment::Ball), a [`Model`]. Goes out: [`ImpactOutput`]. Knows nothing of footage, OpenCV or
//! measurements. Sources: the thesis (Choppin 2008) chapter 2 and 5, and the papers named on each effect's card.
//!
//! ```text
//! model file ─> Model ── prepare(racket, ball) ─> PreparedModel ── predict(input) ─> ImpactOutput
//!               │ flat parameters, effects          │ body, beam, constants
//!               └ with_effect(name)                 └ observed input ─> true input ─> laws ─> collision ─> observed output
//! ```
//!
//! An effect is one file in [`effects`] and one line in its list: its [`EffectCard`] feeds the command line, the
//! documentation and the diagnosis; its [`Effect`] changes the body, the contact laws, the outcome, or (for errors of
//! measurement) the observation.

pub mod batch;
pub mod beam;
pub mod body;
pub mod card;
pub mod closed_form;
pub mod dual;
pub mod effects;
mod error;
pub mod expression;
mod input;
pub mod model;
pub mod model_file;
pub mod parameter;
mod prepared_model;
pub mod real;
pub mod rigid;
pub mod sensitivity;
mod sliding_edge;
pub mod study;
pub mod viscoelastic;

pub use body::Body;
pub use card::{EffectCard, EffectKind, ParameterCard, Role};
pub use effects::{DifferentiableEffect, Effect, catalogue, effect_card};
pub use error::ModelError;
pub use input::{ImpactInput, ImpactOutput};
pub use model::{Base, Model};
pub use parameter::Parameter;
pub use prepared_model::PreparedModel;
pub use real::Real;
pub use viscoelastic::{Ledger, Run};
