//! The catalogue: one file per effect, one line in the list below.
//!
//! An effect is pure: it reads the impact and its own parameter values and changes what it is given. The order in a model
//! file does not matter: effects act in the order of this list, then the user's own by name.

use super::body::Body;
use super::card::EffectCard;
use super::dual::Tangent;
use super::input::{ImpactInput, ImpactOutput};
use super::real::Real;
use super::rigid::{Contact, Impulse, Laws};
use super::viscoelastic;
use std::fmt;

/// One cause. `p` holds the effect's parameter values in the order of its card.
///
/// Its physics is written once, for any [`Real`] number `T`: with `f64` it gives predictions, with a dual number their exact
/// derivatives. `impl<T: Real> Effect<T> for MyEffect` makes it a [`DifferentiableEffect`], which a model holds. Branches go by
/// [`Real::value`], and a term may be left out only where [`is_zero`](num_traits::Zero::is_zero) says that it has no derivatives either.
///
/// Every method does nothing unless the effect overrides it. With all strengths absent an effect must change nothing at
/// all, bit for bit, and must be differentiable there from the side its range allows.
pub trait Effect<T: Real>: fmt::Debug + Send + Sync {
    /// Changes masses, inertias, centre of mass; called once per racket and ball.
    fn change_body(&self, p: &[T], body: &mut Body<T>) {
        let _ = (p, body);
    }

    /// Same, where the change depends on the impact (`at` holds the bodies before); only called when [`Effect::body_varies`].
    fn change_body_at(&self, p: &[T], at: &Contact<T>, body: &mut Body<T>) {
        let _ = (p, at, body);
    }

    /// Whether [`Effect::change_body_at`] does anything.
    fn body_varies(&self) -> bool {
        false
    }

    /// Whether the effect reads [`Body::beam`].
    fn needs_beam(&self) -> bool {
        false
    }

    /// From the input as the user measured it to the true one (errors of measurement, flight).
    fn true_input(&self, p: &[T], body: &Body<T>, input: &mut ImpactInput<T>) {
        let _ = (p, body, input);
    }

    /// Changes the contact laws of the rigid base.
    fn change_laws(&self, p: &[T], at: &Contact<T>, laws: &mut Laws<T>) {
        let _ = (p, at, laws);
    }

    /// Changes bodies' and contact's laws of the visco-elastic base.
    fn change_viscoelastic(&self, p: &[T], at: &Contact<T>, laws: &mut viscoelastic::Laws<T>) {
        let _ = (p, at, laws);
    }

    /// Changes the impulses that a visco-elastic contact came to, of which `laws` has the restitution.
    fn change_viscoelastic_impulse(&self, p: &[T], at: &Contact<T>, laws: &mut Laws<T>, impulse: &mut Impulse<T>) {
        let _ = (p, at, laws, impulse);
    }

    /// Changes the impulses of the rigid base.
    fn change_impulse(&self, p: &[T], at: &Contact<T>, laws: &Laws<T>, impulse: &mut Impulse<T>) {
        let _ = (p, at, laws, impulse);
    }

    /// Changes the outcome itself.
    fn change_output(&self, p: &[T], at: &Contact<T>, laws: &Laws<T>, impulse: &Impulse<T>, output: &mut ImpactOutput<T>) {
        let _ = (p, at, laws, impulse, output);
    }

    /// From the true outcome to the one the user would measure; the reverse of [`Effect::true_input`].
    fn observed_output(&self, p: &[T], body: &Body<T>, input: &ImpactInput<T>, output: &mut ImpactOutput<T>) {
        let _ = (p, body, input, output);
    }
}

/// An [`Effect`] in plain and in dual numbers, as a model holds it.
pub trait DifferentiableEffect: Effect<f64> + Effect<Tangent> {}

impl<E: Effect<f64> + Effect<Tangent>> DifferentiableEffect for E {}

macro_rules! effects {
    ($($module:ident),* $(,)?) => {
        $(mod $module;)*
        static CATALOGUE: &[&EffectCard] = &[$(&$module::CARD),*];
    };
}

// In the order of the contract's section 8.
effects! {
    frame_vibration,
    frame_torsion,
    hand_mass,
    grip_torque,
    ball_damping,
    momentum_flux,
    ball_stiffening,
    string_tension,
    string_stiffening,
    stringbed_edge,
    string_damping,
    lateral_strings,
    offset_normal_force,
    ball_deformation,
    friction_law,
    ball_wear,
    swing_drive,
    finite_contact,
    string_tilt,
    racket_inertia,
    air_flight,
    scale_error,
    time_base_error,
    face_plane_offset,
    ball_centre_bias,
    camera_skew,
    window_bias,
}

/// The cards of all effects, in a fixed order.
pub fn catalogue() -> &'static [&'static EffectCard] {
    CATALOGUE
}

/// The card of one effect by its name.
pub fn effect_card(name: &str) -> Option<&'static EffectCard> {
    CATALOGUE.iter().copied().find(|c| c.name == name)
}
