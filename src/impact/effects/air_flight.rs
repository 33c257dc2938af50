//! `air-flight`: drag, lift and gravity between the measured frames and the impact.

use super::Effect;
use crate::impact::body::Body;
use crate::impact::card::{Bases, EffectCard, EffectKind, ParameterCard};
use crate::impact::input::{ImpactInput, ImpactOutput};
use crate::impact::real::{Real, norm};
use nalgebra::Vector3;

pub(super) static CARD: EffectCard = EffectCard {
    name: "air-flight",
    kind: EffectKind::Physics,
    physics: "The ball is seen over a window of frames before and after the impact, and drag, Magnus lift and gravity change its velocity \
              between the window's middle and the contact. The measured velocities are therefore not those at the contact.",
    equation: "dv/dt = -(rho A/2m) C_D |v| v + (rho A/2m) C_L |v|^2 (w/|w| x v/|v|) + g, over delay_s; C_D 0.507, C_L = 1/(2.202 + 0.981 |v|/(r |w|))",
    parameters: &[
        ParameterCard::strength("delay_s", "s", "from the window's middle to the contact, before and after", 5e-3, (-0.1, 0.1), 5e-3),
        ParameterCard::shape("drag", "", "drag coefficient", 0.507, (0.0, 2.0), 0.05),
        ParameterCard::shape("gravity_x", "m/s^2", "gravity along the racket, toward the handle", 0.0, (-9.9, 9.9), GRAVITY).fitted(),
        ParameterCard::shape("gravity_y", "m/s^2", "across the face (-9.81: face upright, handle level)", 0.0, (-9.9, 9.9), GRAVITY).fitted(),
        ParameterCard::shape("gravity_z", "m/s^2", "along the face's normal", 0.0, (-9.9, 9.9), GRAVITY).fitted(),
    ],
    source: "Cross and Lindsey (free flight, C_D 0.507 +/- 0.024); Stepanek 1988 (lift)",
    signature: "Rebound (and approach) speeds low by 0.3 % in proportion to speed squared; heavy spin deflects; gravity adds 0.05 m/s in 5 ms to \
                every ball alike. The face's attitude is not in the table: where down is, the fit finds, unless the model file says.",
    confused_with: &["ball-damping", "time-base-error", "scale-error"],
    separated_by: "fit the flight itself instead of a straight line",
    check_first: None,
    bases: Bases { rigid: "acts on the observation", viscoelastic: "acts on the observation" },
    effect: &AirFlight,
};

/// 9.81/√3, m/s²: a component of gravity when nothing is known of its direction.
const GRAVITY: f64 = 5.7;
/// Density of air, kg/m³.
const AIR: f64 = 1.2;

/// Change of the ball's velocity over the delay, m/s, with the acceleration half way through; `p` as on the card.
fn flown<T: Real>(p: &[T], body: &Body<T>, v: &Vector3<T>, spin: &Vector3<T>) -> Vector3<T> {
    let acceleration = |v: &Vector3<T>| acceleration_by_air(body, v, spin, p[1]) + Vector3::new(p[2], p[3], p[4]);
    acceleration(&(v + acceleration(v) * (p[0] * 0.5))) * p[0]
}

/// m/s².
fn acceleration_by_air<T: Real>(body: &Body<T>, v: &Vector3<T>, spin: &Vector3<T>, drag: T) -> Vector3<T> {
    let (speed, rate) = (norm(v), norm(spin));
    let per_speed_squared = T::constant(AIR * std::f64::consts::PI * body.ball_radius * body.ball_radius) / (body.ball_mass * 2.0);
    let mut a = v * (-per_speed_squared * drag * speed);
    if rate.value() > 0.0 && speed.value() > 0.0 {
        let lift = (speed * 0.981 / (rate * body.ball_radius) + 2.202).recip();
        a += spin.cross(v) * (per_speed_squared * lift * speed / rate);
    }
    a
}

#[derive(Debug)]
struct AirFlight;

impl<T: Real> Effect<T> for AirFlight {
    fn true_input(&self, p: &[T], body: &Body<T>, input: &mut ImpactInput<T>) {
        input.ball_velocity += flown(p, body, &input.ball_velocity, &input.ball_spin);
    }

    fn observed_output(&self, p: &[T], body: &Body<T>, _: &ImpactInput<T>, output: &mut ImpactOutput<T>) {
        output.ball_velocity += flown(p, body, &output.ball_velocity, &output.ball_spin);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::impact::rigid::tests::reference_equipment;

    /// A tenth of a second at once, and in a thousand steps: 0.01 m/s of 2.
    #[test]
    fn agrees_a_long_flight_with_one_in_small_steps() {
        let (racket, ball) = reference_equipment();
        let body = Body::new(&racket, &ball).expect("valid");
        let (start, spin) = (Vector3::new(3.0, 2.0, 33.0), Vector3::new(200.0, 50.0, 0.0));
        let over = |delay_s: f64, v: &Vector3<f64>| flown(&[delay_s, 0.507, 0.0, -9.81, 0.0], &body, v, &spin);
        let small = (0..1000).fold(start, |v, _| v + over(1e-4, &v)) - start;
        let once = over(0.1, &start);
        assert!(small.norm() > 1.8 && (once - small).norm() < 0.01, "{once} against {small}");
    }

    /// Physics reference, D.17: at 33 m/s drag is 19.8 m/s², at 1125 rpm Magnus lift 3.7 m/s²; gravity is itself.
    #[test]
    fn truth_published_accelerations() {
        let (racket, ball) = reference_equipment();
        let body = Body::new(&racket, &ball).expect("valid");
        let v = Vector3::new(0.0, 0.0, 33.0);
        let moment = 1e-6;
        let at = |spin: f64, gravity: f64| flown(&[moment, 0.507, 0.0, gravity, 0.0], &body, &v, &Vector3::new(spin, 0.0, 0.0)) / moment;
        assert!((at(0.0, 0.0).z + 19.8).abs() < 0.3, "{}", at(0.0, 0.0));
        assert!((at(117.8, 0.0).y + 3.7).abs() < 0.2, "{}", at(117.8, 0.0));
        // To the moment's own change of the velocity, 5e-6 m/s, times what drag makes of it (0.6 per s).
        assert!((at(0.0, -9.81).y + 9.81).abs() < 1e-5);
    }
}
