//! The named quantities an expression may use.

use super::dimension::Dimension;
use crate::impact::body::Body;
use crate::impact::input::ImpactOutput;
use crate::impact::real::{Real, norm, norm_xy};
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
pub(super) struct Scope<'a, T = f64> {
    pub at: &'a Contact<'a, T>,
    pub body: &'a Body<T>,
    pub laws: Option<&'a Laws<T>>,
    pub impulse: Option<&'a Impulse<T>>,
    pub output: Option<&'a ImpactOutput<T>>,
}

/// One named quantity.
pub struct Quantity {
    pub name: &'static str,
    pub unit: &'static str,
    pub stage: Stage,
    pub meaning: &'static str,
}

impl Quantity {
    pub(super) fn dimension(&self) -> Dimension {
        Dimension::of_unit(self.unit)
    }
}

/// Contact time that stands in for the rigid base's own, s.
const NOMINAL_CONTACT_TIME: f64 = 4.5e-3;

fn law<T: Real>(s: &Scope<T>, get: fn(&Laws<T>) -> T) -> T {
    s.laws.map_or(T::constant(f64::NAN), get)
}

fn blow<T: Real>(s: &Scope<T>, get: fn(&Impulse<T>) -> T) -> T {
    s.impulse.map_or(T::constant(f64::NAN), get)
}

fn out<T: Real>(s: &Scope<T>, get: fn(&ImpactOutput<T>) -> T) -> T {
    s.output.map_or(T::constant(f64::NAN), get)
}

fn normal_impulse<T: Real>(s: &Scope<T>) -> T {
    match s.impulse {
        Some(i) => i.ball.z * s.at.side,
        None => s.at.normal_impulse(law(s, Laws::effective_restitution)),
    }
}

fn node_distance<T: Real>(s: &Scope<T>) -> T {
    s.at.body.head_node_x().map_or(T::constant(f64::NAN), |node| node - s.at.input.position.x)
}

/// The names, and beside them what they stand for in any number `T`.
macro_rules! quantities {
    ($(($name:literal, $unit:literal, $stage:ident, $meaning:literal, |$s:ident| $value:expr)),* $(,)?) => {
        static QUANTITIES: &[Quantity] = &[$(Quantity { name: $name, unit: $unit, stage: Stage::$stage, meaning: $meaning }),*];

        struct Values<T>(std::marker::PhantomData<T>);

        impl<T: Real> Values<T> {
            const ALL: &'static [fn(&Scope<T>) -> T] = &[$(|$s| $value),*];
        }
    };
}

quantities![
    ("approach_speed", "m/s", Body, "speed at which the ball's centre and the impact point approach along the normal, positive", |s| s.at.approach_speed),
    ("slip_speed", "m/s", Body, "speed of the ball's surface along the strings at first touch, spin included", |s| s.at.slip_speed()),
    ("slip_x", "m/s", Body, "its part along x (toward the handle), ball less strings", |s| s.at.relative_velocity.x),
    ("slip_y", "m/s", Body, "its part along y (across the face)", |s| s.at.relative_velocity.y),
    ("tangential_speed", "m/s", Body, "speed of the ball's centre along the strings, without spin", |s| norm(&s.at.tangential_velocity())),
    ("tangential_x", "m/s", Body, "its part along x, ball less strings", |s| s.at.tangential_velocity().x),
    ("tangential_y", "m/s", Body, "its part along y", |s| s.at.tangential_velocity().y),
    ("incidence", "", Body, "angle of the centre's approach from the normal, rad: tangential speed against approach speed", |s| norm(
        &s.at.tangential_velocity()
    )
    .atan2(s.at.approach_speed)),
    ("obliqueness", "", Body, "slip speed over approach speed", |s| s.at.slip_speed() / s.at.approach_speed),
    ("spin_ratio", "", Body, "ball radius times spin_across over approach speed", |s| {
        norm_xy(&s.at.input.ball_spin.xy()) * s.at.body.ball_radius / s.at.approach_speed
    }),
    ("impact_x", "m", Body, "position from the stringbed's centre, toward the handle", |s| s.at.input.position.x),
    ("impact_y", "m", Body, "position across the face", |s| s.at.input.position.y),
    ("impact_distance", "m", Body, "distance from the stringbed's centre", |s| norm_xy(&s.at.input.position)),
    ("from_butt", "m", Body, "distance of the impact from the butt", |s| -s.at.input.position.x + s.at.body.stringbed_centre),
    ("from_com", "m", Body, "distance from the centre of mass toward the tip", |s| -s.at.lever.x),
    ("node_distance", "m", Body, "distance from the frame's node in the head, toward the tip positive", |s| node_distance(s)),
    ("half_length", "m", Body, "of the stringbed, along x", |s| T::constant(s.at.body.half_length)),
    ("half_width", "m", Body, "of the stringbed, along y", |s| T::constant(s.at.body.half_width)),
    ("ball_radius", "m", Body, "of the ball", |s| T::constant(s.at.body.ball_radius)),
    ("side", "", Body, "+1: the ball comes from +z, -1: from -z", |s| T::constant(s.at.side)),
    ("ball_in_vx", "m/s", Body, "incoming ball velocity", |s| s.at.input.ball_velocity.x),
    ("ball_in_vy", "m/s", Body, "incoming ball velocity", |s| s.at.input.ball_velocity.y),
    ("ball_in_vz", "m/s", Body, "incoming ball velocity", |s| s.at.input.ball_velocity.z),
    ("ball_in_wx", "rad/s", Body, "incoming spin", |s| s.at.input.ball_spin.x),
    ("ball_in_wy", "rad/s", Body, "incoming spin", |s| s.at.input.ball_spin.y),
    ("ball_in_wz", "rad/s", Body, "incoming spin", |s| s.at.input.ball_spin.z),
    ("spin", "rad/s", Body, "size of the incoming spin", |s| norm(&s.at.input.ball_spin)),
    ("spin_across", "rad/s", Body, "size of its part in the face's plane (x and y)", |s| norm_xy(&s.at.input.ball_spin.xy())),
    ("racket_in_vx", "m/s", Body, "racket velocity", |s| s.at.input.racket_velocity.x),
    ("racket_in_vy", "m/s", Body, "racket velocity", |s| s.at.input.racket_velocity.y),
    ("racket_in_vz", "m/s", Body, "racket velocity", |s| s.at.input.racket_velocity.z),
    ("racket_in_wx", "rad/s", Body, "racket twist rate", |s| s.at.input.racket_rate.x),
    ("racket_in_wy", "rad/s", Body, "racket swing rate", |s| s.at.input.racket_rate.y),
    ("racket_in_wz", "rad/s", Body, "racket chop rate", |s| s.at.input.racket_rate.z),
    ("grip_torque", "N m", Body, "of the mount about the handle", |s| s.at.input.grip_torque),
    ("order", "", Body, "of the impact in time, 0 for the first", |s| T::constant(s.at.input.order)),
    ("effective_mass", "kg", Body, "of the racket at the impact point", |s| s.body.inverse_effective_mass(&s.at.lever).recip()),
    ("contact_time", "s", Body, "4.5 ms in base rigid", |_s| T::constant(NOMINAL_CONTACT_TIME)),
    ("ball_mass", "kg", Body, "of the ball", |s| s.body.ball_mass),
    ("racket_mass", "kg", Body, "of the racket", |s| s.body.racket_mass),
    ("twist_inertia", "kg m^2", Body, "of the racket about x", |s| s.body.racket_inertia.x),
    ("swing_inertia", "kg m^2", Body, "of the racket about y", |s| s.body.racket_inertia.y),
    ("chop_inertia", "kg m^2", Body, "of the racket about z", |s| s.body.racket_inertia.z),
    ("restitution", "", Laws, "normal restitution", |s| law(s, |l| l.restitution)),
    ("friction", "", Laws, "Coulomb coefficient", |s| law(s, |l| l.friction)),
    ("tangential_restitution_x", "", Laws, "along the racket", |s| law(s, |l| l.tangential_restitution[0])),
    ("tangential_restitution_y", "", Laws, "across the face", |s| law(s, |l| l.tangential_restitution[1])),
    ("tangential_restitution_diagonal", "", Laws, "along the face's diagonal x + y", |s| law(s, |l| l.diagonal_restitution[0])),
    ("tangential_restitution_antidiagonal", "", Laws, "along the diagonal x - y", |s| law(s, |l| l.diagonal_restitution[1])),
    ("ball_inertia", "kg m^2", Laws, "of the ball", |s| law(s, |l| l.ball_inertia)),
    ("ball_arm", "m", Laws, "from the ball's centre to the contact point", |s| law(s, |l| l.ball_arm)),
    ("grip_hold", "N m s", Laws, "largest angular impulse of the mount", |s| law(s, |l| l.twist_hold)),
    ("normal_impulse", "N s", Laws, "on the ball, away from the strings", |s| normal_impulse(s)),
    ("impulse_x", "N s", Impulse, "on the ball, along the racket", |s| blow(s, |i| i.ball.x)),
    ("impulse_y", "N s", Impulse, "on the ball, across the face", |s| blow(s, |i| i.ball.y)),
    ("tangential_impulse", "N s", Impulse, "size of both", |s| blow(s, |i| norm_xy(&i.ball.xy()))),
    ("ball_out_vx", "m/s", Output, "outgoing ball velocity", |s| out(s, |o| o.ball_velocity.x)),
    ("ball_out_vy", "m/s", Output, "outgoing ball velocity", |s| out(s, |o| o.ball_velocity.y)),
    ("ball_out_vz", "m/s", Output, "outgoing ball velocity", |s| out(s, |o| o.ball_velocity.z)),
    ("ball_out_wx", "rad/s", Output, "outgoing spin", |s| out(s, |o| o.ball_spin.x)),
    ("ball_out_wy", "rad/s", Output, "outgoing spin", |s| out(s, |o| o.ball_spin.y)),
    ("ball_out_wz", "rad/s", Output, "outgoing spin", |s| out(s, |o| o.ball_spin.z)),
    ("racket_out_vx", "m/s", Output, "racket velocity after", |s| out(s, |o| o.racket_velocity.x)),
    ("racket_out_vy", "m/s", Output, "racket velocity after", |s| out(s, |o| o.racket_velocity.y)),
    ("racket_out_vz", "m/s", Output, "racket velocity after", |s| out(s, |o| o.racket_velocity.z)),
    ("racket_out_wx", "rad/s", Output, "racket twist rate after", |s| out(s, |o| o.racket_rate.x)),
    ("racket_out_wy", "rad/s", Output, "racket swing rate after", |s| out(s, |o| o.racket_rate.y)),
    ("racket_out_wz", "rad/s", Output, "racket chop rate after", |s| out(s, |o| o.racket_rate.z)),
];

/// The value of the quantity at a place in [`quantities`].
pub(super) fn quantity<T: Real>(i: usize, scope: &Scope<T>) -> T {
    Values::<T>::ALL[i](scope)
}

/// All quantities, in a fixed order.
pub fn quantities() -> &'static [Quantity] {
    QUANTITIES
}
