//! What an expression may change and by what: channels of the model times dimensionless features of the impact.
//!
//! Every pair gives one term `channel + k · scale · feature`, written so that the model file reads it and that it has the
//! channel's dimension. The numbers 25 (m/s), 10 (N m) and 30 (rad/s) are references that make features of order one.

use super::fit::Fit;
use super::forward::Inputs;
use super::linearise::Linearised;
use super::observation::{Gear, Observation, Observations};
use super::structure::{ContactInputs, racket_turns};
use nalgebra::DVector;

/// Everything a feature is made of.
pub struct FeatureInputs {
    /// Approach speed / 25 m/s.
    u: f64,
    /// Slip velocity over approach speed, x and y.
    g: [f64; 2],
    /// The ball centre's tangential velocity over approach speed.
    t: [f64; 2],
    /// Radius times spin over approach speed.
    s: [f64; 3],
    /// Place over half length and half width.
    place: [f64; 2],
    torque: f64,
    order: f64,
    swing: f64,
    /// The racket's other rates, x and z.
    rates: [f64; 2],
    side: f64,
}

impl FeatureInputs {
    pub fn of(o: &Observation, x: &Inputs, gear: &Gear) -> Self {
        let x = &o.without_unmeasured(x);
        let contact = ContactInputs::of(x, gear);
        let v = contact.approach_m_s.max(0.1);
        let r = gear.ball.radius_m();
        FeatureInputs {
            u: v / 25.0,
            g: contact.slip_m_s.map(|c| c / v),
            t: contact.tangential_m_s.map(|c| c / v),
            s: [x[3] * r / v, x[4] * r / v, x[5] * r / v],
            place: [x[12] / (0.5 * gear.racket.head.inner_length_m), x[13] / (0.5 * gear.racket.head.inner_width_m)],
            torque: x[14] / 10.0,
            order: o.order,
            swing: x[10] / 30.0,
            rates: [x[9] / 30.0, x[11] / 30.0],
            side: contact.side,
        }
    }

    /// The same before a racket whose rate is nothing but noise.
    fn without_swing(self) -> Self {
        FeatureInputs { swing: 0.0, rates: [0.0; 2], ..self }
    }

    /// The same where only one side of the racket is hit.
    fn without_side(self) -> Self {
        FeatureInputs { side: 0.0, ..self }
    }

    /// Approach speed beyond this one over 25 m/s, times the place along the racket and across the face.
    pub fn speed_times_place(&self, from_m_s: f64) -> [f64; 2] {
        self.place.map(|p| (self.u - from_m_s / 25.0) * p)
    }

    /// Slip velocity over approach speed, x and y.
    pub fn slip(&self) -> [f64; 2] {
        self.g
    }

    /// Place over half length and half width.
    pub fn place(&self) -> [f64; 2] {
        self.place
    }

    /// Square of a speed along the strings, given over the approach speed, plus `least` (m²/s²), over the squared approach speed.
    fn squared_and(&self, along: [f64; 2], least: f64) -> f64 {
        along[0].powi(2) + along[1].powi(2) + least / (25.0 * self.u).powi(2)
    }
}

/// The inputs of all impacts of a fit: without the racket's rates where they are nothing but noise, and without the side where all
/// hit one (what goes with it is what does not).
pub fn feature_inputs(fit: &Fit, observations: &Observations, impacts: &[&Observation]) -> Vec<FeatureInputs> {
    // As measured: those of the fit take up what the model misses.
    let sd = |k: usize| DVector::from_iterator(impacts.len(), impacts.iter().map(|o| o.inputs[k])).variance().sqrt();
    let turns = racket_turns(observations, [9, 10, 11].map(sd).into_iter().fold(0.0, f64::max));
    let from_above = fit.impacts.iter().filter(|l| l.true_inputs[2] < l.true_inputs[8]).count();
    let one_side = from_above == 0 || from_above == impacts.len();
    let inputs = |(o, l): (&&Observation, &Linearised)| {
        let inputs = FeatureInputs::of(o, &l.true_inputs, &observations.gear[o.gear]);
        let inputs = if turns { inputs } else { inputs.without_swing() };
        if one_side { inputs.without_side() } else { inputs }
    };
    impacts.iter().zip(&fit.impacts).map(inputs).collect()
}

/// As an expression's `sign`: 0 in the middle.
fn side_of(place: f64) -> f64 {
    if place == 0.0 { 0.0 } else { place.signum() }
}

/// A dimensionless function of the inputs.
pub struct Feature {
    /// As the model file has it.
    pub text: &'static str,
    /// "with the incoming spin across the face".
    pub words: &'static str,
    pub value: fn(&FeatureInputs) -> f64,
}

const fn f(text: &'static str, words: &'static str, value: fn(&FeatureInputs) -> f64) -> Feature {
    Feature { text, words, value }
}

/// All features, simple ones first: of two that do equally well the earlier one is taken.
pub static FEATURES: [Feature; 64] = [
    f("1", "everywhere alike", |_| 1.0),
    f("(approach_speed / 25)", "with the approach speed", |i| i.u),
    f("(approach_speed / 25)^2", "with the square of the approach speed", |i| i.u * i.u),
    f("(25 / approach_speed)", "with the inverse of the approach speed", |i| 1.0 / i.u),
    f("(impact_x / half_length)", "with the place along the racket", |i| i.place[0]),
    f("(impact_y / half_width)", "with the place across the face", |i| i.place[1]),
    f("(impact_x / half_length)^2", "with the distance from the middle along the racket", |i| i.place[0].powi(2)),
    f("(impact_y / half_width)^2", "with the distance from the middle across the face", |i| i.place[1].powi(2)),
    f("(impact_x / half_length) * (impact_y / half_width)", "along one diagonal of the face", |i| i.place[0] * i.place[1]),
    f("(impact_x / half_length)^4", "steeply toward tip and throat", |i| i.place[0].powi(4)),
    f("(impact_y / half_width)^4", "steeply toward both sides", |i| i.place[1].powi(4)),
    f("((impact_x / half_length)^2 + (impact_y / half_width)^2)", "toward the rim", |i| i.place[0].powi(2) + i.place[1].powi(2)),
    f("abs(impact_x / half_length)", "with the distance from the middle along the racket", |i| i.place[0].abs()),
    f("abs(impact_y / half_width)", "with the distance from the middle across the face", |i| i.place[1].abs()),
    f("sign(impact_x)", "from the tip's half of the face to the handle's", |i| side_of(i.place[0])),
    f("sign(impact_y)", "from marker 2's half of the face to marker 3's", |i| side_of(i.place[1])),
    f("obliqueness", "with the slip relative to the approach", |i| i.g[0].hypot(i.g[1])),
    f("obliqueness^2", "with the squared slip relative to the approach", |i| i.g[0].powi(2) + i.g[1].powi(2)),
    f("(tangential_speed / approach_speed)", "with the obliqueness of the ball's path", |i| i.t[0].hypot(i.t[1])),
    f("(tangential_speed / approach_speed)^2", "with the squared tangent of incidence", |i| i.t[0].powi(2) + i.t[1].powi(2)),
    f("tanh((tangential_speed / approach_speed)^2)", "with the incidence, saturating", |i| (i.t[0].powi(2) + i.t[1].powi(2)).tanh()),
    f("(slip_x / approach_speed)", "with the slip along the racket", |i| i.g[0]),
    f("(slip_y / approach_speed)", "with the slip across the face", |i| i.g[1]),
    f("((slip_x + slip_y) / approach_speed)", "with the slip along one diagonal of the face", |i| i.g[0] + i.g[1]),
    f("((slip_x - slip_y) / approach_speed)", "with the slip along the other diagonal of the face", |i| i.g[0] - i.g[1]),
    f("(slip_x * slip_y / (slip_x^2 + slip_y^2 + 0.01))", "with the slip's direction, from one diagonal of the face to the other", |i| {
        i.g[0] * i.g[1] / i.squared_and(i.g, 0.01)
    }),
    f("((slip_x^2 - slip_y^2) / (slip_x^2 + slip_y^2 + 0.01))", "with the slip's direction, from across the face to along it", |i| {
        (i.g[0].powi(2) - i.g[1].powi(2)) / i.squared_and(i.g, 0.01)
    }),
    f(
        "(tangential_x * tangential_y / (tangential_x^2 + tangential_y^2 + 0.01))",
        "with the path's direction, from one diagonal of the face to the other",
        |i| i.t[0] * i.t[1] / i.squared_and(i.t, 0.01),
    ),
    f("((tangential_x^2 - tangential_y^2) / (tangential_x^2 + tangential_y^2 + 0.01))", "with the path's direction, from across the face to along it", |i| {
        (i.t[0].powi(2) - i.t[1].powi(2)) / i.squared_and(i.t, 0.01)
    }),
    f("(tangential_x / approach_speed)", "with the ball's path along the racket", |i| i.t[0]),
    f("(tangential_y / approach_speed)", "with the ball's path across the face", |i| i.t[1]),
    f("(slip_x / 25)", "with the slip speed along the racket", |i| i.g[0] * i.u),
    f("(slip_y / 25)", "with the slip speed across the face", |i| i.g[1] * i.u),
    f("spin_ratio", "with the incoming spin across the face, relative to the approach speed", |i| i.s[0].hypot(i.s[1])),
    f("spin_ratio^2", "with the squared spin across the face, relative to the approach speed", |i| i.s[0].powi(2) + i.s[1].powi(2)),
    f("(spin_across * ball_radius / 25)", "with the incoming spin across the face", |i| i.s[0].hypot(i.s[1]) * i.u),
    f("(spin_across * ball_radius / 25)^2", "with the square of the incoming spin across the face", |i| (i.s[0].powi(2) + i.s[1].powi(2)) * i.u * i.u),
    f("(spin_across * ball_radius / 25)^1.5", "with the 1.5th power of the incoming spin across the face", |i| (i.s[0].hypot(i.s[1]) * i.u).powf(1.5)),
    f("(ball_in_wx * ball_radius / approach_speed)", "with the spin about the racket's long axis", |i| i.s[0]),
    f("(ball_in_wy * ball_radius / approach_speed)", "with the spin about the axis across the face", |i| i.s[1]),
    f("(ball_in_wx * ball_radius / 25)", "with the spin about the racket's long axis", |i| i.s[0] * i.u),
    f("(ball_in_wy * ball_radius / 25)", "with the spin about the axis across the face", |i| i.s[1] * i.u),
    f("(ball_in_wz * ball_radius / approach_speed)", "with the spin about the normal", |i| i.s[2]),
    f("(ball_in_wz * ball_radius / 25)", "with the spin about the normal", |i| i.s[2] * i.u),
    f("(ball_in_wz * ball_radius / approach_speed)^2", "with the squared spin about the normal", |i| i.s[2].powi(2)),
    f("abs(ball_in_wz * ball_radius / approach_speed)", "with the size of the spin about the normal", |i| i.s[2].abs()),
    f("(grip_torque / 10)", "with the grip torque", |i| i.torque),
    f("sqrt(abs(grip_torque) / 10)", "with the root of the grip torque", |i| i.torque.abs().sqrt()),
    f("tanh(grip_torque / 10)", "with the grip torque, saturating", |i| i.torque.tanh()),
    f("(order / 100)", "with the order of the impacts", |i| i.order / 100.0),
    f("exp(-order / 50)", "toward the first impacts, over some fifty of them", |i| (-i.order / 50.0).exp()),
    f("(racket_in_wy / 30)", "with the racket's swing rate", |i| i.swing),
    f("(racket_in_wx / 30)", "with the racket's twist rate", |i| i.rates[0]),
    f("(racket_in_wz / 30)", "with the racket's rate in its own plane", |i| i.rates[1]),
    f("(approach_speed / 25) * obliqueness", "with the slip speed", |i| i.u * i.g[0].hypot(i.g[1])),
    f("(approach_speed / 25) * (impact_x / half_length)^2", "with speed, toward tip and throat", |i| i.u * i.place[0].powi(2)),
    f("(approach_speed / 25) * (impact_y / half_width)^2", "with speed, toward both sides", |i| i.u * i.place[1].powi(2)),
    f("(impact_x / half_length) * (tangential_x / approach_speed)", "with the place and the path along the racket", |i| i.place[0] * i.t[0]),
    f("(impact_y / half_width) * (tangential_y / approach_speed)", "with the place and the path across the face", |i| i.place[1] * i.t[1]),
    f("side * (impact_y / half_width)", "with the place across the face, reversed with the side hit", |i| i.side * i.place[1]),
    f("side * (impact_x / half_length)", "with the place along the racket, reversed with the side hit", |i| i.side * i.place[0]),
    f("side * (ball_in_wz * ball_radius / approach_speed)", "with the spin about the normal", |i| i.side * i.s[2]),
    f("(grip_torque / 10) * sign(impact_y)", "with the grip torque, toward the middle", |i| i.torque * side_of(i.place[1])),
    f("(grip_torque / 10) * (impact_y / half_width)^2", "with the grip torque, toward both sides", |i| i.torque * i.place[1].powi(2)),
];

/// A quantity of the model that a term changes.
pub struct TermChannel {
    /// The model file's name.
    pub replaces: &'static str,
    /// What k and the feature are multiplied with.
    pub scale: &'static str,
    pub words: &'static str,
    /// A plausible size of k.
    pub typical: f64,
}

const fn t(replaces: &'static str, scale: &'static str, words: &'static str, typical: f64) -> TermChannel {
    TermChannel { replaces, scale, words, typical }
}

/// All channels; a base leaves out those that it does not have.
pub static CHANNELS: [TermChannel; 39] = [
    t("restitution", "restitution", "the normal restitution", 0.2),
    t("friction", "friction", "the friction", 0.5),
    t("tangential_restitution", "1", "the tangential restitution", 0.3),
    t("tangential_restitution_x", "1", "the tangential restitution along the racket", 0.3),
    t("tangential_restitution_y", "1", "the tangential restitution across the face", 0.3),
    t("tangential_restitution_diagonal", "1", "the tangential restitution along the face's diagonal to handle and marker 3", 0.3),
    t("tangential_restitution_antidiagonal", "1", "the tangential restitution along the face's diagonal to handle and marker 2", 0.3),
    t("normal_offset", "ball_radius", "the point where the normal force acts", 0.1),
    t("torque_arm_x", "ball_radius", "the place of the normal force along the racket", 0.1),
    t("torque_arm_y", "ball_radius", "the place of the normal force across the face", 0.1),
    t("tilt_x", "1", "the tilt of the strings along the racket", 0.1),
    t("tilt_y", "1", "the tilt of the strings across the face", 0.1),
    t("ball_arm", "ball_radius", "the ball's radius in contact", 0.2),
    t("ball_inertia", "ball_inertia", "the ball's inertia", 0.2),
    t("impulse_x", "normal_impulse", "the impulse along the racket", 0.1),
    t("impulse_y", "normal_impulse", "the impulse across the face", 0.1),
    t("impulse_diagonal", "normal_impulse", "the impulse along the face's diagonal to handle and marker 3", 0.1),
    t("impulse_antidiagonal", "normal_impulse", "the impulse along the face's diagonal to handle and marker 2", 0.1),
    t("spin_impulse_x", "ball_radius * normal_impulse", "the torque on the ball about the racket's long axis", 0.1),
    t("spin_impulse_y", "ball_radius * normal_impulse", "the torque on the ball about the axis across the face", 0.1),
    t("spin_impulse_z", "ball_radius * normal_impulse", "the torque on the ball about the normal", 0.1),
    t("impulse_turn", "1", "the turn of the impulse in the face about the normal", 0.1),
    t("spin_impulse_turn", "1", "the turn of the spin that the strings give about the normal", 0.1),
    t("spin_turn", "1", "the turn of the incoming spin about the normal", 0.1),
    t("spin_kept", "1", "the share of its spin that the ball keeps", 0.1),
    t("hand_mass", "racket_mass", "a mass held by the hand", 0.3),
    t("racket_mass", "racket_mass", "the racket's mass", 0.2),
    t("twist_inertia", "twist_inertia", "the racket's twist inertia", 0.3),
    t("swing_inertia", "swing_inertia", "the racket's swing inertia", 0.2),
    t("ball_mass", "ball_mass", "the ball's mass", 0.1),
    t("grip_hold", "grip_torque * contact_time", "the hold of the grip against twist", 1.0),
    t("racket_angular_impulse_x", "ball_radius * normal_impulse", "the torque on the racket about its long axis", 0.2),
    t("racket_angular_impulse_y", "ball_radius * normal_impulse", "the torque on the racket about the axis across the face", 0.5),
    t("racket_angular_impulse_z", "ball_radius * normal_impulse", "the torque on the racket about the normal", 0.5),
    t("racket_impulse_x", "normal_impulse", "the impulse on the racket along its axis", 0.1),
    t("racket_impulse_y", "normal_impulse", "the impulse on the racket across the face", 0.1),
    t("string_stiffness", "string_stiffness", "the strings' stiffness", 0.3),
    t("ball_damping", "ball_damping", "the ball's damping", 0.3),
    t("drive_z", "normal_impulse", "the push on the racket during contact", 0.2),
];

impl TermChannel {
    /// `k · scale · feature` with the parameter's name for k.
    pub fn term(&self, parameter: &str, feature: &str) -> String {
        match (self.scale, feature) {
            ("1", "1") => parameter.to_owned(),
            ("1", f) => format!("{parameter} * {f}"),
            (s, "1") => format!("{parameter} * {s}"),
            (s, f) => format!("{parameter} * {s} * {f}"),
        }
    }

    /// The whole expression with several terms.
    pub fn expression(&self, terms: &[(String, String)]) -> String {
        if self.scale == self.replaces {
            let inside: Vec<String> = terms.iter().map(|(k, f)| if f == "1" { k.clone() } else { format!("{k} * {f}") }).collect();
            return format!("{} * (1 + {})", self.replaces, inside.join(" + "));
        }
        let sum: Vec<String> = terms.iter().map(|(k, f)| self.term(k, f)).collect();
        format!("{} + {}", self.replaces, sum.join(" + "))
    }
}
