//! The rackets and rigs of the studies: a player's frame, a Pure Drive, a clamped bed, a wall.

use crate::impact::PreparedModel;
use crate::impact::body::Body;
use crate::impact::error::ModelError;
use crate::impact::input::ImpactInput;
use crate::impact::model::{Base, Model};
use nalgebra::{Vector2, Vector3};

/// Typical strung player's frame of the reference: 0.33 kg, balance 0.325 m, inertias .0015, .0158, .0173 kg m².
pub fn frame() -> Body {
    Body {
        racket_mass: 0.33,
        racket_inertia: Vector3::new(0.0015, 0.0158, 0.0173),
        com_x: 0.185,
        reported_com_x: 0.185,
        ball_mass: 0.0577,
        ball_radius: 0.033,
        ball_inertia: 0.55 * 0.0577 * 0.033 * 0.033,
        racket_length: 0.685,
        stringbed_centre: 0.51,
        half_length: 0.165,
        half_width: 0.12,
        tension_lb: 60.0,
        beam: None,
    }
}

/// Tennis Warehouse University's Pure Drive: 320 g, 330 mm, SW 320, twistweight 14.
pub fn pure_drive() -> Body {
    let mut b = frame();
    b.racket_mass = 0.320;
    b.racket_inertia = Vector3::new(0.0014, 0.0320 - 0.320 * 0.23f64.powi(2), 0.0);
    b.racket_inertia.z = b.racket_inertia.x + b.racket_inertia.y;
    b.com_x = 0.51 - 0.330;
    b.reported_com_x = b.com_x;
    b
}

/// A racket that cannot move: the head-clamped bed.
pub fn clamped(tension_lb: f64) -> Body {
    let mut b = frame();
    b.racket_mass = 1e9;
    b.racket_inertia = Vector3::repeat(1e9);
    (b.com_x, b.reported_com_x) = (0.0, 0.0);
    b.tension_lb = tension_lb;
    b
}

/// The plain base with some values changed.
pub fn prepared(body: Body, changes: &[(&str, f64)]) -> Result<PreparedModel, ModelError> {
    let mut model = Model::new(Base::Viscoelastic);
    for (name, value) in changes {
        model.set(name, *value)?;
    }
    PreparedModel::new(model, body)
}

/// The same with the frame's first bending mode at a frequency.
pub fn ringing(body: Body, frequency_hz: f64, changes: &[(&str, f64)]) -> Result<PreparedModel, ModelError> {
    let mut model = Model::new(Base::Viscoelastic).with_effect("frame-vibration")?;
    for (name, value) in changes.iter().chain(&[("frame-vibration.frequency_hz", frequency_hz)]) {
        model.set(name, *value)?;
    }
    PreparedModel::new(model, body)
}

/// Ball velocity and spin, impact `along` from the centre of mass (tip negative) and `across`, racket at rest.
pub fn at_rest(body: &Body, v: [f64; 3], spin: [f64; 3], along: f64, across: f64) -> ImpactInput {
    ImpactInput {
        ball_velocity: v.into(),
        ball_spin: spin.into(),
        racket_velocity: Vector3::zeros(),
        racket_rate: Vector3::zeros(),
        position: Vector2::new(along + body.com_x, across),
        grip_torque: 0.0,
        order: 0.0,
        own: Default::default(),
    }
}

/// Strings so stiff that the ball alone deforms: the rigid wall. Ten times stiffer ones change the restitution by 2e-4.
pub const WALL: [(&str, f64); 4] = [("kS0", 2e8), ("kS2", 0.0), ("c_S", 3000.0), ("mu", 0.0)];
