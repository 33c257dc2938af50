//! `synthetic`: worlds with known truth.
//!
//! Comes in: a scenario (what kind of session, which effect is hidden, how strongly, how noisy, a seed). Goes out: an
//! impacts table or a rendered session, in the forms of the contract, and the truth beside it.
//!
//! This room is the project's own examiner, so it shares no physics with [`crate::impact`]: contacts are stepped through
//! time in the laboratory frame with a power-law hysteretic spring ([`contact`]), and every hidden effect has another
//! functional form than the catalogue's ([`hidden`]). With nothing hidden the outcome equals the rigid impulse model of
//! the contract (section 7), although no line of it is solved that way. Global axes U, V (up), W; SI.

pub mod backdrop;
pub mod body;
pub mod contact;
pub mod exposure;
pub mod footage_spec;
pub mod footage_world;
pub mod hidden;
pub mod impact_world;
pub mod look;
pub mod measurement;
pub mod motion;
pub mod nature;
pub mod player;
pub mod pressed;
pub mod racket_shape;
pub mod sample;
pub mod sampling;
pub mod scenario;
pub mod targets;
pub mod view;
