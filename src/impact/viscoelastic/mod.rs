//! Base "viscoelastic": ball and stringbed deform, six degrees of freedom each, stepped through the contact.
//!
//! Ball: truncated sphere with stiffness growing in compression, damping growing with contact area, momentum flux while
//! it is being compressed (Goodwill and Haake 2001; thesis 2.7.3, restitution put right). Stringbed: massless, stiffening.
//! Friction: Coulomb with stick and slip, an arm that shortens and an inertia that falls with compression. Racket: rigid,
//! free, or with frame modes, grip torque and drive. Equations: physics reference, section C.
//!
//! Everything is integrated in the racket's own axes: ball position and velocity relative to the racket's centre of mass,
//! the ball's spin angular momentum, the racket's rates and attitude, the strings' deflection. Linear momentum is exact by
//! construction. Steps end at every kink (first touch, first millimetre, greatest compression, stick to slip and back, last
//! contact), so the fourth-order method keeps its order.

mod contact_laws;
mod job;
mod kernel;
mod lane;
mod lanes;
mod laws;
mod number;
mod run;
mod tableau;
mod tangent;

#[cfg(test)]
mod tests;

pub use contact_laws::{BallLaw, ContactLaws, FrictionDirection, NormalForce, Release, StringLaw};
pub(crate) use laws::LEAST_STRING_DAMPING;
pub use laws::Laws;
pub use run::{Ledger, Moment, Run};

pub(crate) use job::Ended;
pub(crate) use lanes::{DEFAULT_STEPS, Ready, collide_all};
pub(crate) use laws::STIFFNESS_PER_LB;
pub(crate) use run::{RUN_STEPS, run};
pub(crate) use tangent::{DERIVATIVE_STEPS, differentiate};
