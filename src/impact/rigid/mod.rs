//! Base "rigid": two rigid bodies, one impulse at the contact point (contract, section 7; thesis 2.3 generalised to 3-D).
//!
//! `J` acts on the ball at the contact point, `−J` on the racket; the relative velocity of the two contact points changes
//! by `K J`, with `K = (1/m + 1/M) 1 − [r]ₓ[r]ₓ/I_B − [ρ]ₓ I_R⁻¹ [ρ]ₓ` (ρ: centre of mass to contact point, r: ball centre to
//! contact point). Restitution fixes the normal relative velocity afterwards, Coulomb friction limits the tangential impulse.

mod collision;
mod contact;
mod lasting;
mod laws;

#[cfg(test)]
pub(crate) mod tests;

pub use collision::{Impulse, Regime, collide};
pub use contact::Contact;
pub use laws::{BED_SHARE, Laws, Sliding};
