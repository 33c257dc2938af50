//! Effects of the user's own, written as expressions in the model file (contract, section 7), without recompiling.
//!
//! ```toml
//! [effects.my-edge-loss]
//! expression = "restitution * (1 - k * (impact_y / 0.13)^2)"
//! replaces = "restitution"
//! k = { value = 0.0, fit = true, min = 0.0, max = 1.0 }
//! ```
//!
//! `replaces` names a [`channel`]: what the expression's value takes the place of. Inside, the channel's own name stands for
//! its value before. Names are [`quantities`], the effect's own parameters, numbers. Dimensions are checked when the file
//! is read: quantities have theirs, numbers and own parameters take whichever is needed.

mod channels;
mod dimension;
mod effect;
mod functions;
mod parse;
mod quantities;

pub use channels::{Channel, channel, channels};
pub use dimension::Dimension;
pub use effect::ExpressionEffect;
pub use parse::{Expression, SyntaxError};
pub use quantities::{Quantity, Stage, quantities};
