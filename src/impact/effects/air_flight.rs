//! `air-flight`: drag and lift between the measured frames and the impact.

use super::Effect;
use crate::impact::body::Body;
use crate::impact::card::{Bases, EffectCard, EffectKind, ParameterCard};
use crate::impact::input::{ImpactInput, ImpactOutput};
use nalgebra::Vector3;

pub(super) static CARD: EffectCard = EffectCard {
    name: "air-flight",
    kind: EffectKind::Physics,
    physics: "The ball is seen over a window of frames before and after the impact, and drag and Magnus lift change its velocity \
              between the window's middle and the contact. The measured velocities are therefore not those at the contact.",
    equation: "dv/dt = -(rho A/2m) C_D |v| v + (rho A/2m) C_L |v|^2 (w/|w| x v/|v|), over delay_s; C_D 0.507, C_L = 1/(2.202 + 0.981 |v|/(r |w|))",
    parameters: &[
        ParameterCard::strength("delay_s", "s", "from the window's middle to the contact, before and after", 5e-3, (-0.1, 0.1), 5e-3),
        ParameterCard::shape("drag", "", "drag coefficient", 0.507, (0.0, 2.0), 0.05),
    ],
    source: "Cross and Lindsey (free flight, C_D 0.507 +/- 0.024); Stepanek 1988 (lift)",
    signature: "Rebound (and approach) speeds low by 0.3 % in proportion to speed squared; heavy spin deflects; gravity is left out (the \
                face's attitude is not in the table).",
    confused_with: &["ball-damping", "time-base-error", "scale-error"],
    separated_by: "fit the flight itself instead of a straight line",
    bases: Bases { rigid: "acts on the observation", viscoelastic: "acts on the observation" },
    effect: &AirFlight,
};

/// Density of air, kg/m³.
const AIR: f64 = 1.2;

/// Acceleration of the ball by the air, m/s².
fn flight(body: &Body, v: &Vector3<f64>, spin: &Vector3<f64>, drag: f64) -> Vector3<f64> {
    let (speed, rate) = (v.norm(), spin.norm());
    let per_speed_squared = AIR * std::f64::consts::PI * body.ball_radius * body.ball_radius / (2.0 * body.ball_mass);
    let mut a = -per_speed_squared * drag * speed * v;
    if rate > 0.0 && speed > 0.0 {
        let lift = 1.0 / (2.202 + 0.981 * speed / (body.ball_radius * rate));
        a += per_speed_squared * lift * speed / rate * spin.cross(v);
    }
    a
}

#[derive(Debug)]
struct AirFlight;

impl Effect for AirFlight {
    fn true_input(&self, p: &[f64], body: &Body, input: &mut ImpactInput) {
        input.ball_velocity += flight(body, &input.ball_velocity, &input.ball_spin, p[1]) * p[0];
    }

    fn observed_output(&self, p: &[f64], body: &Body, _: &ImpactInput, output: &mut ImpactOutput) {
        output.ball_velocity += flight(body, &output.ball_velocity, &output.ball_spin, p[1]) * p[0];
    }
}
