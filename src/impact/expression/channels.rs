//! What an expression can replace.

use super::dimension::Dimension;
use super::quantities::Stage;
use crate::impact::body::Body;
use crate::impact::input::ImpactOutput;
use crate::impact::model::Base;
use crate::impact::real::Real;
use crate::impact::rigid::{Contact, Impulse, Laws};
use crate::impact::viscoelastic;
use std::sync::LazyLock;

/// How a channel's value is read and replaced, by the stage of the computation.
#[derive(Clone, Copy)]
pub(super) enum Access<T = f64> {
    Body(fn(&Body<T>) -> T, fn(&mut Body<T>, T)),
    Laws(fn(&Laws<T>) -> T, fn(&mut Laws<T>, T)),
    Viscoelastic(ViscoelasticLaw<T>),
    /// The new value may need the geometry: a contact impulse acts on both bodies at the contact point.
    Impulse(fn(&Contact<T>, &Impulse<T>) -> T, fn(&Contact<T>, &Laws<T>, &mut Impulse<T>, T)),
    Output(fn(&ImpactOutput<T>) -> T, fn(&mut ImpactOutput<T>, T)),
}

/// How a law of a visco-elastic contact is read and replaced, before the contact is stepped.
pub(super) type ViscoelasticLaw<T> = (fn(&viscoelastic::Laws<T>) -> T, fn(&mut viscoelastic::Laws<T>, T));

/// One replaceable quantity.
pub struct Channel {
    pub name: &'static str,
    pub unit: &'static str,
    pub meaning: &'static str,
    place: usize,
}

impl Channel {
    /// At which point of the computation it is replaced.
    pub fn stage(&self) -> Stage {
        match self.access::<f64>() {
            Access::Body(..) => Stage::Body,
            Access::Laws(..) | Access::Viscoelastic(..) => Stage::Laws,
            Access::Impulse(..) => Stage::Impulse,
            Access::Output(..) => Stage::Output,
        }
    }

    pub(super) fn dimension(&self) -> Dimension {
        Dimension::of_unit(self.unit)
    }

    pub(super) fn access<T: Real>(&self) -> Access<T> {
        Accesses::<T>::ALL[self.place]
    }

    pub(super) fn is_restitution(&self) -> bool {
        self.name == "restitution"
    }

    /// The law that it is in base visco-elastic. Of the rigid base's laws friction is one there too; restitution is what such a contact comes to.
    pub(super) fn viscoelastic_law<T: Real>(&self) -> Option<ViscoelasticLaw<T>> {
        match self.access() {
            Access::Viscoelastic(law) => Some(law),
            Access::Laws(..) if self.name == "friction" => Some((|l| l.mu, |l, v| l.mu = v)),
            _ => None,
        }
    }

    /// Whether the base has it.
    pub fn is_in(&self, base: Base) -> bool {
        match (base, self.access::<f64>()) {
            (Base::Rigid, access) => !matches!(access, Access::Viscoelastic(..)),
            (Base::Viscoelastic, Access::Laws(..)) => self.is_restitution() || self.viscoelastic_law::<f64>().is_some(),
            (Base::Viscoelastic, _) => true,
        }
    }
}

/// Where `hand_mass` sits, from the butt, m.
const HAND_FROM_BUTT: f64 = 0.07;

macro_rules! laws {
    ($($field:tt)+) => {
        Access::Laws(|l| l.$($field)+, |l, v| l.$($field)+ = v)
    };
}
macro_rules! viscoelastic {
    ($field:ident) => {
        Access::Viscoelastic((|l| l.$field, |l, v| l.$field = v))
    };
}
macro_rules! contact_impulse {
    ($axis:ident) => {
        Access::Impulse(
            |_, i| i.ball.$axis,
            |at, laws, i, v| {
                let mut delta = nalgebra::Vector3::zeros();
                delta.$axis = v - i.ball.$axis;
                i.shift(at, laws, delta);
            },
        )
    };
}
macro_rules! impulse {
    ($body:ident . $axis:ident) => {
        Access::Impulse(|_, i| i.$body.$axis, |_, _, i, v| i.$body.$axis = v)
    };
}
macro_rules! output {
    ($vector:ident . $axis:ident) => {
        Access::Output(|o| o.$vector.$axis, |o, v| o.$vector.$axis = v)
    };
}

/// The contact impulse's part along (1, `sign`)/√2 in the face.
fn along_diagonal<T: Real>(impulse: &Impulse<T>, sign: f64) -> T {
    (impulse.ball.x + impulse.ball.y * sign) * std::f64::consts::FRAC_1_SQRT_2
}

fn set_diagonal<T: Real>(at: &Contact<T>, laws: &Laws<T>, impulse: &mut Impulse<T>, value: T, sign: f64) {
    let by = (value - along_diagonal(impulse, sign)) * std::f64::consts::FRAC_1_SQRT_2;
    impulse.shift(at, laws, nalgebra::Vector3::new(by, by * sign, T::zero()));
}

/// What a vector in the face changes by when it is turned about the normal, from x toward y.
fn turned_by<T: Real>([x, y]: [T; 2], angle: T) -> nalgebra::Vector3<T> {
    let (sin, less) = (angle.sin(), angle.cos() - T::one());
    nalgebra::Vector3::new(x * less - y * sin, x * sin + y * less, T::zero())
}

fn turn_impulse<T: Real>(at: &Contact<T>, laws: &Laws<T>, impulse: &mut Impulse<T>, angle: T) {
    let by = turned_by([impulse.ball.x, impulse.ball.y], angle);
    impulse.shift(at, laws, by);
}

fn turn_spin<T: Real>(at: &Contact<T>, laws: &Laws<T>, impulse: &mut Impulse<T>, angle: T) {
    let by = turned_by([at.input.ball_spin.x, at.input.ball_spin.y], angle) * laws.ball_inertia;
    impulse.ball_angular += by;
    impulse.racket_angular -= by;
}

/// The names, and beside them how each is read and replaced in any number `T`.
macro_rules! channels {
    ($(($name:literal, $unit:literal, $meaning:literal, $access:expr $(,)?)),* $(,)?) => {
        static NAMES: &[[&str; 3]] = &[$([$name, $unit, $meaning]),*];

        struct Accesses<T>(std::marker::PhantomData<T>);

        impl<T: Real> Accesses<T> {
            const ALL: &'static [Access<T>] = &[$($access),*];
        }
    };
}

channels![
    ("restitution", "", "normal restitution (held within 0 to 1)", laws!(restitution)),
    ("friction", "", "Coulomb coefficient (held at 0 or more)", laws!(friction)),
    (
        "tangential_restitution",
        "",
        "along and across the racket alike",
        Access::Laws(|l| l.tangential_restitution[1], |l, v| l.tangential_restitution = [v; 2]),
    ),
    ("tangential_restitution_x", "", "along the racket", laws!(tangential_restitution[0])),
    ("tangential_restitution_y", "", "across the face", laws!(tangential_restitution[1])),
    ("tangential_restitution_diagonal", "", "along the face's diagonal x + y, beside that along x and y", laws!(diagonal_restitution[0])),
    ("tangential_restitution_antidiagonal", "", "along the diagonal x - y", laws!(diagonal_restitution[1])),
    ("torque_arm_x", "m", "where the normal force acts, from the ball's centre along x", laws!(arm_offset[0])),
    ("torque_arm_y", "m", "the same along y", laws!(arm_offset[1])),
    ("normal_offset", "m", "where the normal force acts behind the centre, against the slip", laws!(normal_offset)),
    ("ball_arm", "m", "from the ball's centre to the contact point", laws!(ball_arm)),
    ("ball_inertia", "kg m^2", "of the ball", laws!(ball_inertia)),
    ("tilt_x", "", "tilt of the contact's normal toward x, rad", laws!(tilt[0])),
    ("tilt_y", "", "tilt toward y, rad", laws!(tilt[1])),
    ("mode_loss", "", "q of the frame modes: e'^2 = e^2 - q (1 + e')^2", laws!(mode_loss)),
    ("grip_hold", "N m s", "largest angular impulse of the mount about the handle", laws!(twist_hold)),
    ("face_time", "s", "duration over which the face turns under the ball", laws!(face_time)),
    ("drive_x", "N s", "impulse from outside on the racket, along x", laws!(drive.x)),
    ("drive_y", "N s", "along y", laws!(drive.y)),
    ("drive_z", "N s", "along z", laws!(drive.z)),
    ("drive_twist_x", "N m s", "angular impulse from outside on the racket about x", laws!(drive_twist.x)),
    ("drive_twist_y", "N m s", "about y", laws!(drive_twist.y)),
    ("drive_twist_z", "N m s", "about z", laws!(drive_twist.z)),
    ("string_stiffness", "N/m", "of the stringbed at rest (base viscoelastic)", viscoelastic!(k_s0)),
    ("string_damping", "N s/m", "of the stringbed (base viscoelastic)", viscoelastic!(c_s)),
    ("ball_stiffness", "N/m", "of the ball at rest (base viscoelastic)", viscoelastic!(k_b0)),
    ("ball_damping", "N s/m^3", "of the ball, per contact area (base viscoelastic)", viscoelastic!(a_c)),
    ("ball_mass", "kg", "of the ball", Access::Body(|b| b.ball_mass, |b, v| b.ball_mass = v)),
    ("racket_mass", "kg", "of the racket, same centre and inertia", Access::Body(|b| b.racket_mass, |b, v| b.racket_mass = v)),
    ("twist_inertia", "kg m^2", "of the racket about x", Access::Body(|b| b.racket_inertia.x, |b, v| b.racket_inertia.x = v)),
    ("swing_inertia", "kg m^2", "of the racket about y", Access::Body(|b| b.racket_inertia.y, |b, v| b.racket_inertia.y = v)),
    ("chop_inertia", "kg m^2", "of the racket about z", Access::Body(|b| b.racket_inertia.z, |b, v| b.racket_inertia.z = v)),
    ("hand_mass", "kg", "point mass 0.07 m from the butt; 0 before", Access::Body(|_| T::zero(), |b, v| b.add_mass_on_axis(v, T::constant(HAND_FROM_BUTT)))),
    (
        "normal_impulse",
        "N s",
        "on the ball, away from the strings; the racket gets the reverse",
        Access::Impulse(|at, i| i.ball.z * at.side, |at, laws, i, v| i.shift(at, laws, nalgebra::Vector3::new(T::zero(), T::zero(), v * at.side - i.ball.z))),
    ),
    ("impulse_x", "N s", "on the ball at the contact point along x; the racket gets the reverse", contact_impulse!(x)),
    ("impulse_y", "N s", "the same along y", contact_impulse!(y)),
    (
        "impulse_diagonal",
        "N s",
        "the same along the face's diagonal x + y",
        Access::Impulse(|_, i| along_diagonal(i, 1.0), |at, laws, i, v| set_diagonal(at, laws, i, v, 1.0))
    ),
    (
        "impulse_antidiagonal",
        "N s",
        "along the diagonal x - y",
        Access::Impulse(|_, i| along_diagonal(i, -1.0), |at, laws, i, v| set_diagonal(at, laws, i, v, -1.0))
    ),
    ("spin_impulse_x", "N m s", "angular impulse on the ball alone, about x", impulse!(ball_angular.x)),
    ("spin_impulse_y", "N m s", "about y", impulse!(ball_angular.y)),
    ("spin_impulse_z", "N m s", "about z", impulse!(ball_angular.z)),
    (
        "impulse_turn",
        "",
        "turn of the impulse's part in the face about the normal, rad, from x toward y; 0 before",
        Access::Impulse(|_, _| T::zero(), turn_impulse)
    ),
    (
        "spin_impulse_turn",
        "",
        "the same of the angular impulse on the ball alone",
        Access::Impulse(|_, _| T::zero(), |_, _, i, v| i.ball_angular += turned_by([i.ball_angular.x, i.ball_angular.y], v))
    ),
    ("spin_turn", "", "the same of the spin the ball comes with; the racket gets the reverse torque", Access::Impulse(|_, _| T::zero(), turn_spin)),
    ("racket_impulse_x", "N s", "on the racket alone, along x", impulse!(racket.x)),
    ("racket_impulse_y", "N s", "along y", impulse!(racket.y)),
    ("racket_impulse_z", "N s", "along z", impulse!(racket.z)),
    ("racket_angular_impulse_x", "N m s", "on the racket alone, about x", impulse!(racket_angular.x)),
    ("racket_angular_impulse_y", "N m s", "about y", impulse!(racket_angular.y)),
    ("racket_angular_impulse_z", "N m s", "about z", impulse!(racket_angular.z)),
    ("ball_out_vx", "m/s", "outgoing ball velocity", output!(ball_velocity.x)),
    ("ball_out_vy", "m/s", "outgoing ball velocity", output!(ball_velocity.y)),
    ("ball_out_vz", "m/s", "outgoing ball velocity", output!(ball_velocity.z)),
    ("ball_out_wx", "rad/s", "outgoing spin", output!(ball_spin.x)),
    ("ball_out_wy", "rad/s", "outgoing spin", output!(ball_spin.y)),
    ("ball_out_wz", "rad/s", "outgoing spin", output!(ball_spin.z)),
    (
        "spin_kept",
        "",
        "share of its spin that the ball keeps as it leaves, about all axes; 1 before",
        Access::Output(|_| T::one(), |o, kept| o.ball_spin *= kept)
    ),
    ("racket_out_vz", "m/s", "racket velocity after", output!(racket_velocity.z)),
    ("racket_out_wx", "rad/s", "racket twist rate after", output!(racket_rate.x)),
    ("racket_out_wy", "rad/s", "racket swing rate after", output!(racket_rate.y)),
    ("racket_out_wz", "rad/s", "racket chop rate after", output!(racket_rate.z)),
];

static CHANNELS: LazyLock<Vec<Channel>> =
    LazyLock::new(|| NAMES.iter().enumerate().map(|(place, [name, unit, meaning])| Channel { name, unit, meaning, place }).collect());

/// All channels, in a fixed order.
pub fn channels() -> &'static [Channel] {
    &CHANNELS
}

/// A channel by its name.
pub fn channel(name: &str) -> Option<&'static Channel> {
    CHANNELS.iter().find(|c| c.name == name)
}
