//! The two bodies of an impact as the model sees them: masses, inertias and where things are.

use super::beam::{Beam, RacketBeam};
use super::error::ModelError;
use super::input::ImpactInput;
use super::real::{Real, constants};
use crate::equipment::{Ball, Racket};
use nalgebra::{Vector2, Vector3};
use std::sync::Arc;

/// Racket and ball in numbers. Effects such as `hand-mass` change it before the impact is computed.
#[derive(Debug, Clone, PartialEq)]
pub struct Body<T = f64> {
    /// kg.
    pub racket_mass: T,
    /// About the centre of mass, along x, y, z, kg m².
    pub racket_inertia: Vector3<T>,
    /// Local x of the centre of mass (positive toward the handle), m.
    pub com_x: T,
    /// Local x of the point whose velocity the user calls that of the centre of mass (racket.toml's), m.
    pub reported_com_x: T,
    /// kg.
    pub ball_mass: T,
    /// m.
    pub ball_radius: f64,
    /// About any axis through the centre, kg m².
    pub ball_inertia: T,
    /// m.
    pub racket_length: f64,
    /// Distance of the local origin from the butt, m.
    pub stringbed_centre: f64,
    /// Half the length of the stringbed along x, m.
    pub half_length: f64,
    /// Half the width of the stringbed along y, m.
    pub half_width: f64,
    /// lb, as strung.
    pub tension_lb: f64,
    /// The frame's bending modes at 140 Hz, when an effect or an expression asks for them.
    pub beam: Option<Arc<Beam<T>>>,
}

/// Frequency at which the beam's shapes are computed, Hz; shapes and modal masses do not depend on it.
const BEAM_FREQUENCY_HZ: f64 = 140.0;

impl Body {
    /// The bodies as their files describe them.
    ///
    /// # Errors
    /// [`ModelError::Body`] when a mass or inertia is not positive (the files' own checks refuse that earlier).
    pub fn new(racket: &Racket, ball: &Ball) -> Result<Self, ModelError> {
        let body = Body {
            racket_mass: racket.mass_kg,
            racket_inertia: racket.inertia_kg_m2(),
            com_x: racket.com_local().x,
            reported_com_x: racket.com_local().x,
            ball_mass: ball.mass_kg,
            ball_radius: ball.radius_m(),
            ball_inertia: ball.inertia_kg_m2(),
            racket_length: racket.length_m,
            stringbed_centre: racket.stringbed_centre_m,
            half_length: 0.5 * racket.head.inner_length_m,
            half_width: 0.5 * racket.head.inner_width_m,
            tension_lb: racket.strings.tension_lb,
            beam: None,
        };
        body.check()?;
        Ok(body)
    }

    /// Computes the frame's bending modes for the racket as it now stands.
    ///
    /// # Errors
    /// [`ModelError::Body`] when no distribution of mass along the length has this mass, balance and inertia.
    pub fn compute_beam(&mut self) -> Result<(), ModelError> {
        let racket = RacketBeam {
            mass: self.racket_mass,
            balance: self.stringbed_centre - self.com_x,
            inertia: self.racket_inertia.y,
            length: self.racket_length,
            frequency_hz: BEAM_FREQUENCY_HZ,
        };
        self.beam = Some(racket.shared()?);
        Ok(())
    }
}

impl<T: Real> Body<T> {
    /// The same bodies in another number.
    pub fn of(plain: &Body) -> Self {
        Body {
            racket_mass: T::constant(plain.racket_mass),
            racket_inertia: constants(&plain.racket_inertia),
            com_x: T::constant(plain.com_x),
            reported_com_x: T::constant(plain.reported_com_x),
            ball_mass: T::constant(plain.ball_mass),
            ball_radius: plain.ball_radius,
            ball_inertia: T::constant(plain.ball_inertia),
            racket_length: plain.racket_length,
            stringbed_centre: plain.stringbed_centre,
            half_length: plain.half_length,
            half_width: plain.half_width,
            tension_lb: plain.tension_lb,
            beam: plain.beam.as_ref().map(|beam| Arc::new(Beam::of(beam))),
        }
    }

    /// Hangs a point mass on the beam, where it was computed: its modes then carry the mass. A mass too odd for the beam
    /// leaves the modes as they were.
    pub fn hang_on_beam(&mut self, mass: T, from_butt: T) {
        if let Some(loaded) = self.beam.as_ref().and_then(|b| b.with_point_mass(from_butt, mass).ok()) {
            self.beam = Some(Arc::new(loaded));
        }
    }

    /// First bending frequency over that of the racket alone: 1 unless something hangs on the frame.
    pub fn beam_frequency_ratio(&self) -> T {
        self.beam.as_ref().map_or(T::one(), |b| b.modes[0].frequency_hz / BEAM_FREQUENCY_HZ)
    }

    /// Local x of the frame's node in the head, when the beam was computed.
    pub fn head_node_x(&self) -> Option<T> {
        self.beam.as_ref().map(|b| -b.head_node() + self.stringbed_centre)
    }

    /// Refuses masses and inertias that no body has.
    pub fn check(&self) -> Result<(), ModelError> {
        let positive = [
            ("racket mass (kg)", self.racket_mass.value()),
            ("racket inertia about x (kg m²)", self.racket_inertia.x.value()),
            ("racket inertia about y (kg m²)", self.racket_inertia.y.value()),
            ("racket inertia about z (kg m²)", self.racket_inertia.z.value()),
            ("ball mass (kg)", self.ball_mass.value()),
            ("ball radius (m)", self.ball_radius),
            ("ball inertia (kg m²)", self.ball_inertia.value()),
        ];
        for (what, seen) in positive {
            if !(seen.is_finite() && seen > 0.0) {
                return Err(ModelError::Body { what, seen, allowed: "a positive number".into() });
            }
        }
        for (what, seen) in [("centre of mass (m)", self.com_x.value()), ("stringbed centre from the butt (m)", self.stringbed_centre)] {
            if !seen.is_finite() {
                return Err(ModelError::Body { what, seen, allowed: "a finite number".into() });
            }
        }
        Ok(())
    }

    /// From the centre of mass to a point of the string plane, m.
    pub fn lever(&self, position: &Vector2<T>) -> Vector3<T> {
        Vector3::new(position.x - self.com_x, position.y, T::zero())
    }

    /// Velocity of the ball's centre relative to the strings where it hits them, m/s, of an input whose racket velocity still is that of the
    /// centre of mass as it is reported: effects of measurement see it before it is moved to the true one.
    pub fn reported_approach(&self, input: &ImpactInput<T>) -> Vector3<T> {
        let lever = Vector3::new(input.position.x - self.reported_com_x, input.position.y, T::zero());
        let strings = input.racket_velocity + input.racket_rate.cross(&lever);
        input.ball_velocity - strings
    }

    /// Adds a point mass on the long axis, `from_butt` metres from the butt; centre of mass and inertias move with it.
    pub fn add_mass_on_axis(&mut self, mass: T, from_butt: T) {
        let x = -from_butt + self.stringbed_centre;
        let total = self.racket_mass + mass;
        // Reduced mass times distance squared: both parallel-axis terms at once.
        let gain = self.racket_mass * mass / total * (x - self.com_x).powi(2);
        self.com_x += mass / total * (x - self.com_x);
        self.racket_mass = total;
        self.racket_inertia.y += gain;
        self.racket_inertia.z += gain;
    }

    /// `1/m_e` of the racket for a normal impulse at `lever` (body coordinates), 1/kg.
    ///
    /// 1/m_e = 1/M + X²/I_y + Y²/I_x (thesis eq 5.2, generalised).
    pub fn inverse_effective_mass(&self, lever: &Vector3<T>) -> T {
        self.racket_mass.recip() + lever.x * lever.x / self.racket_inertia.y + lever.y * lever.y / self.racket_inertia.x
    }
}
