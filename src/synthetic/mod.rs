//! `synthetic`: worlds with known truth.
//!
//! Comes in: a scenario (what kind of session, which effect is hidden, how strongly, how noisy, a seed). Goes out: an
//! impacts table or a rendered session, in the forms of the contract, and the truth beside it.
//!
//! This room is the project's own examiner, so it shares no physics with [`crate::impact`]: contacts are stepped through
//! time in the laboratory frame with a power-law hysteretic spring ([`contact`]), and every hidden effect has another
//! functional form than the catalogue's ([`hidden`]). With nothing hidden the outcome equals the rigid impulse model of
//! the contract (section 7), although no line of it is solved that way. Global axes U, V (up), W; SI.

pub mod body;
pub mod contact;
pub mod hidden;
pub mod impact_world;
pub mod measurement;
pub mod nature;
pub mod scenario;
