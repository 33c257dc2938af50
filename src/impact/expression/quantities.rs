//! The named quantities an expression may use.

use super::dimension::Dimension;
use crate::impact::body::Body;
use crate::impact::input::ImpactOutput;
use crate::impact::rigid::{Contact, Impulse, Laws};

/// From which point of the computation a quantity is known, and at which one a channel is replaced.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Stage {
    /// Inputs and bodies as the racket and ball files give them.
    Body,
    /// The contact laws.
    Laws,
    /// The impulses.
    Impulse,
    /// The outcome.
    Output,
}

/// What is known while an expression is evaluated.
#[derive(Clone, Copy)]
pub(super) struct Scope<'a> {
    pub at: &'a Contact<'a>,
    pub body: &'a Body,
    pub laws: Option<&'a Laws>,
    pub impulse: Option<&'a Impulse>,
    pub output: Option<&'a ImpactOutput>,
}

/// One named quantity.
pub struct Quantity {
    pub name: &'static str,
    pub unit: &'static str,
    pub stage: Stage,
    pub meaning: &'static str,
    pub(super) value: fn(&Scope) -> f64,
}

impl Quantity {
    pub(super) fn dimension(&self) -> Dimension {
        Dimension::of_unit(self.unit)
    }
}

const fn q(name: &'static str, unit: &'static str, stage: Stage, meaning: &'static str, value: fn(&Scope) -> f64) -> Quantity {
    Quantity { name, unit, stage, meaning, value }
}

/// Contact time that stands in for the rigid base's own, s.
const NOMINAL_CONTACT_TIME: f64 = 4.5e-3;

fn law(s: &Scope, get: fn(&Laws) -> f64) -> f64 {
    s.laws.map_or(f64::NAN, get)
}

fn out(s: &Scope, get: fn(&ImpactOutput) -> f64) -> f64 {
    s.output.map_or(f64::NAN, get)
}

fn normal_impulse(s: &Scope) -> f64 {
    match s.impulse {
        Some(i) => i.ball.z * s.at.side,
        None => s.at.normal_impulse(law(s, Laws::effective_restitution)),
    }
}

fn node_distance(s: &Scope) -> f64 {
    s.at.body.head_node_x().map_or(f64::NAN, |node| node - s.at.input.position.x)
}

static QUANTITIES: [Quantity; 68] = [
    q("approach_speed", "m/s", Stage::Body, "normal speed at which ball and strings approach", |s| s.at.approach_speed),
    q("slip_speed", "m/s", Stage::Body, "speed of the ball's surface along the strings at first touch", |s| s.at.slip_speed),
    q("slip_x", "m/s", Stage::Body, "its part along the racket", |s| s.at.relative_velocity.x),
    q("slip_y", "m/s", Stage::Body, "its part across the face", |s| s.at.relative_velocity.y),
    q("tangential_speed", "m/s", Stage::Body, "speed of the ball's centre along the strings, without spin", |s| s.at.tangential_velocity().norm()),
    q("tangential_x", "m/s", Stage::Body, "its part along the racket", |s| s.at.tangential_velocity().x),
    q("tangential_y", "m/s", Stage::Body, "its part across the face", |s| s.at.tangential_velocity().y),
    q("incidence", "", Stage::Body, "angle of the approach from the normal, rad", |s| s.at.tangential_velocity().norm().atan2(s.at.approach_speed)),
    q("obliqueness", "", Stage::Body, "slip speed over approach speed", |s| s.at.slip_speed / s.at.approach_speed),
    q("spin_ratio", "", Stage::Body, "radius times spin across the face over approach speed", |s| {
        s.at.body.ball_radius * s.at.input.ball_spin.xy().norm() / s.at.approach_speed
    }),
    q("impact_x", "m", Stage::Body, "position from the stringbed's centre, toward the handle", |s| s.at.input.position.x),
    q("impact_y", "m", Stage::Body, "position across the face", |s| s.at.input.position.y),
    q("impact_distance", "m", Stage::Body, "distance from the stringbed's centre", |s| s.at.input.position.norm()),
    q("from_butt", "m", Stage::Body, "distance of the impact from the butt", |s| s.at.body.stringbed_centre - s.at.input.position.x),
    q("from_com", "m", Stage::Body, "distance from the centre of mass toward the tip", |s| -s.at.lever.x),
    q("node_distance", "m", Stage::Body, "distance from the frame's node in the head, toward the tip positive", node_distance),
    q("half_length", "m", Stage::Body, "of the stringbed, along x", |s| s.at.body.half_length),
    q("half_width", "m", Stage::Body, "of the stringbed, along y", |s| s.at.body.half_width),
    q("ball_radius", "m", Stage::Body, "of the ball", |s| s.at.body.ball_radius),
    q("side", "", Stage::Body, "+1: the ball comes from +z, -1: from -z", |s| s.at.side),
    q("ball_in_vx", "m/s", Stage::Body, "incoming ball velocity", |s| s.at.input.ball_velocity.x),
    q("ball_in_vy", "m/s", Stage::Body, "incoming ball velocity", |s| s.at.input.ball_velocity.y),
    q("ball_in_vz", "m/s", Stage::Body, "incoming ball velocity", |s| s.at.input.ball_velocity.z),
    q("ball_in_wx", "rad/s", Stage::Body, "incoming spin", |s| s.at.input.ball_spin.x),
    q("ball_in_wy", "rad/s", Stage::Body, "incoming spin", |s| s.at.input.ball_spin.y),
    q("ball_in_wz", "rad/s", Stage::Body, "incoming spin", |s| s.at.input.ball_spin.z),
    q("spin", "rad/s", Stage::Body, "size of the incoming spin", |s| s.at.input.ball_spin.norm()),
    q("spin_across", "rad/s", Stage::Body, "size of its part in the face's plane (x and y)", |s| s.at.input.ball_spin.xy().norm()),
    q("racket_in_vx", "m/s", Stage::Body, "racket velocity", |s| s.at.input.racket_velocity.x),
    q("racket_in_vy", "m/s", Stage::Body, "racket velocity", |s| s.at.input.racket_velocity.y),
    q("racket_in_vz", "m/s", Stage::Body, "racket velocity", |s| s.at.input.racket_velocity.z),
    q("racket_in_wx", "rad/s", Stage::Body, "racket twist rate", |s| s.at.input.racket_rate.x),
    q("racket_in_wy", "rad/s", Stage::Body, "racket swing rate", |s| s.at.input.racket_rate.y),
    q("racket_in_wz", "rad/s", Stage::Body, "racket chop rate", |s| s.at.input.racket_rate.z),
    q("grip_torque", "N m", Stage::Body, "of the mount about the handle", |s| s.at.input.grip_torque),
    q("order", "", Stage::Body, "of the impact in time, 0 for the first", |s| s.at.input.order),
    q("effective_mass", "kg", Stage::Body, "of the racket at the impact point", |s| 1.0 / s.body.inverse_effective_mass(&s.at.lever)),
    q("contact_time", "s", Stage::Body, "4.5 ms in base rigid", |_| NOMINAL_CONTACT_TIME),
    q("ball_mass", "kg", Stage::Body, "of the ball", |s| s.body.ball_mass),
    q("racket_mass", "kg", Stage::Body, "of the racket", |s| s.body.racket_mass),
    q("twist_inertia", "kg m^2", Stage::Body, "of the racket about x", |s| s.body.racket_inertia.x),
    q("swing_inertia", "kg m^2", Stage::Body, "of the racket about y", |s| s.body.racket_inertia.y),
    q("chop_inertia", "kg m^2", Stage::Body, "of the racket about z", |s| s.body.racket_inertia.z),
    q("restitution", "", Stage::Laws, "normal restitution", |s| law(s, |l| l.restitution)),
    q("friction", "", Stage::Laws, "Coulomb coefficient", |s| law(s, |l| l.friction)),
    q("tangential_restitution_x", "", Stage::Laws, "along the racket", |s| law(s, |l| l.tangential_restitution[0])),
    q("tangential_restitution_y", "", Stage::Laws, "across the face", |s| law(s, |l| l.tangential_restitution[1])),
    q("tangential_restitution_diagonal", "", Stage::Laws, "along the face's diagonal x + y", |s| law(s, |l| l.diagonal_restitution[0])),
    q("tangential_restitution_antidiagonal", "", Stage::Laws, "along the diagonal x - y", |s| law(s, |l| l.diagonal_restitution[1])),
    q("ball_inertia", "kg m^2", Stage::Laws, "of the ball", |s| law(s, |l| l.ball_inertia)),
    q("ball_arm", "m", Stage::Laws, "from the ball's centre to the contact point", |s| law(s, |l| l.ball_arm)),
    q("grip_hold", "N m s", Stage::Laws, "largest angular impulse of the mount", |s| law(s, |l| l.twist_hold)),
    q("normal_impulse", "N s", Stage::Laws, "on the ball, away from the strings", normal_impulse),
    q("impulse_x", "N s", Stage::Impulse, "on the ball, along the racket", |s| s.impulse.map_or(f64::NAN, |i| i.ball.x)),
    q("impulse_y", "N s", Stage::Impulse, "on the ball, across the face", |s| s.impulse.map_or(f64::NAN, |i| i.ball.y)),
    q("tangential_impulse", "N s", Stage::Impulse, "size of both", |s| s.impulse.map_or(f64::NAN, |i| i.ball.xy().norm())),
    q("ball_out_vx", "m/s", Stage::Output, "outgoing ball velocity", |s| out(s, |o| o.ball_velocity.x)),
    q("ball_out_vy", "m/s", Stage::Output, "outgoing ball velocity", |s| out(s, |o| o.ball_velocity.y)),
    q("ball_out_vz", "m/s", Stage::Output, "outgoing ball velocity", |s| out(s, |o| o.ball_velocity.z)),
    q("ball_out_wx", "rad/s", Stage::Output, "outgoing spin", |s| out(s, |o| o.ball_spin.x)),
    q("ball_out_wy", "rad/s", Stage::Output, "outgoing spin", |s| out(s, |o| o.ball_spin.y)),
    q("ball_out_wz", "rad/s", Stage::Output, "outgoing spin", |s| out(s, |o| o.ball_spin.z)),
    q("racket_out_vx", "m/s", Stage::Output, "racket velocity after", |s| out(s, |o| o.racket_velocity.x)),
    q("racket_out_vy", "m/s", Stage::Output, "racket velocity after", |s| out(s, |o| o.racket_velocity.y)),
    q("racket_out_vz", "m/s", Stage::Output, "racket velocity after", |s| out(s, |o| o.racket_velocity.z)),
    q("racket_out_wx", "rad/s", Stage::Output, "racket twist rate after", |s| out(s, |o| o.racket_rate.x)),
    q("racket_out_wy", "rad/s", Stage::Output, "racket swing rate after", |s| out(s, |o| o.racket_rate.y)),
    q("racket_out_wz", "rad/s", Stage::Output, "racket chop rate after", |s| out(s, |o| o.racket_rate.z)),
];

/// All quantities, in a fixed order.
pub fn quantities() -> &'static [Quantity] {
    &QUANTITIES
}
