//! `string-tilt`: the pocket in the strings leans toward the centre.

use super::Effect;
use crate::impact::card::{Bases, EffectCard, EffectKind, ParameterCard};
use crate::impact::real::Real;
use crate::impact::rigid::{Contact, Laws};
use crate::impact::viscoelastic;

pub(super) static CARD: EffectCard = EffectCard {
    name: "string-tilt",
    kind: EffectKind::Physics,
    physics: "Off centre the strings are stiffer on the frame's side, so the pocket's normal leans toward the centre of the face. The \
              ball leaves a few degrees toward the centre, the more the deeper the pocket. At first touch and at release the pocket is \
              shallow: how much of the lean is there says along what the ball slides, and what a ball that holds the strings holds.",
    equation: "tilt = -strength x_S (x / 0.165^2, y / 0.12^2), x_S = 13.1 mm (v_n / 20 m/s), of the normal that points to the ball; the whole \
               contact frame turns, slip is told in one that is turned by at_ends of it",
    parameters: &[
        ParameterCard::strength("strength", "", "0 none; 1: 2.6 degrees at 50 mm across and 20 m/s", 0.5, (-5.0, 5.0), 0.5).one_way(),
        ParameterCard::shape("at_ends", "", "share of the lean that is there at first touch and at release (rigid base only)", 1.0, (0.0, 1.0), 0.5).fitted(),
    ],
    source: "Tennis Warehouse University (rebounds lean toward the centre on both halves)",
    signature: "Exit direction leans toward the centre: odd in x and y, in proportion to approach speed; present on a clamped racket as \
                well.",
    confused_with: &["finite-contact", "face-plane-offset", "grip-torque"],
    separated_by: "odd part of the exit angle on a head-clamped racket",
    check_first: None,
    bases: Bases { rigid: "as given", viscoelastic: "as given, with the momentary deflection, which is none at first touch and at release" },
    effect: &StringTilt,
};

/// Deflection of the strings on a free racket at the reference speed, m.
const DEPTH: f64 = 13.1e-3;
/// m/s.
const REFERENCE_SPEED: f64 = 20.0;
/// Half length and width over which the pocket leans, m.
const ALONG: f64 = 0.165;
const ACROSS: f64 = 0.12;

#[derive(Debug)]
struct StringTilt;

impl<T: Real> Effect<T> for StringTilt {
    fn change_laws(&self, p: &[T], at: &Contact<T>, laws: &mut Laws<T>) {
        // Toward the centre as the ball sees it: the contact's normal is the face's, whichever side the ball is on.
        let depth = at.approach_speed * (at.side * DEPTH / REFERENCE_SPEED);
        laws.tilt[0] -= p[0] * depth * at.input.position.x / (ALONG * ALONG);
        laws.tilt[1] -= p[0] * depth * at.input.position.y / (ACROSS * ACROSS);
        laws.tilt_at_ends = p[1];
    }

    fn change_viscoelastic(&self, p: &[T], at: &Contact<T>, laws: &mut viscoelastic::Laws<T>) {
        laws.tilt_x += p[0] * at.side / (ALONG * ALONG);
        laws.tilt_y += p[0] * at.side / (ACROSS * ACROSS);
    }
}

#[cfg(test)]
mod tests {
    use crate::impact::rigid::tests::{prepared, reference_input};
    use crate::impact::{Base, ImpactInput, ImpactOutput, Model};
    use nalgebra::{Vector2, Vector3};

    /// An impact off the centre both ways, with a slip (m/s) along the racket and across it.
    fn off_centre(along: f64, across: f64) -> ImpactInput {
        ImpactInput {
            ball_velocity: Vector3::new(along, across, -25.0),
            ball_spin: Vector3::zeros(),
            racket_velocity: Vector3::zeros(),
            racket_rate: Vector3::zeros(),
            position: Vector2::new(-0.05, 0.03),
            ..reference_input()
        }
    }

    fn predicted(base: Base, laws: &[(&str, f64)], effect: &[(&str, f64)], input: &ImpactInput) -> ImpactOutput {
        let mut model = Model::new(base);
        if !effect.is_empty() {
            model = model.with_effect("string-tilt").expect("known");
        }
        for (name, value) in laws.iter().chain(effect) {
            model.set(name, *value).expect("allowed");
        }
        prepared(&model).predict(input).expect("contact")
    }

    /// With a pocket that is flat at the ends, a ball that slides meets friction against its slip along the face: the sideways impulse
    /// across that slip is the leaning normal force's alone.
    #[test]
    fn truth_friction_goes_against_the_slip_along_a_face_that_is_flat_at_first_touch() {
        let laws = [("restitution", 0.8), ("friction", 0.1)];
        let tilt = |at_ends: f64| [("string-tilt.strength", 0.3), ("string-tilt.at_ends", at_ends)];
        let input = ImpactInput { position: Vector2::new(-0.05, 0.0), ..off_centre(0.0, 12.0) };
        let ends = [0.0, 1.0].map(|a| predicted(Base::Rigid, &laws, &tilt(a), &input).ball_velocity);
        // The normal leans along the racket alone; turned with it, the slip has a part of the approach in it, along the racket too.
        let lean = 0.3 * 13.1e-3 * (25.0 / 20.0) * 0.05 / (0.165 * 0.165);
        let [flat, throughout] = ends.map(|v| v.x / (v.z + 25.0));
        assert!((flat - lean).abs() < 1e-3 * lean, "{flat} against {lean}");
        assert!(throughout < 0.85 * lean, "{throughout} against {lean}");
    }

    /// What the lean changes for balls that grip, by the rigid base and by the one that steps through the contact, where the pocket is as
    /// deep as the strings then are: share of the change (ball's velocity sideways, its spin times the radius, m/s) that the rigid base
    /// leaves, at its best strength.
    fn left_of_the_stepped_change(at_ends: f64) -> f64 {
        let (mut stepped, mut rigid) = (Vec::new(), Vec::new());
        for (along, across) in [(0.0, 0.0), (3.0, -5.0), (-6.0, 2.0), (2.0, 9.0)] {
            let input = off_centre(along, across);
            let change = |base, laws: &[(&str, f64)], effect: &[(&str, f64)], to: &mut Vec<f64>| {
                let [with, without] = [effect, &[]].map(|e| predicted(base, laws, e, &input));
                let (v, w) = (with.ball_velocity - without.ball_velocity, (with.ball_spin - without.ball_spin) * 0.033);
                to.extend([v.x, v.y, w.x, w.y]);
            };
            change(Base::Viscoelastic, &[("mu", 0.45)], &[("string-tilt.strength", 0.3)], &mut stepped);
            change(Base::Rigid, &[("restitution", 0.8), ("friction", 0.45)], &[("string-tilt.strength", 0.3), ("string-tilt.at_ends", at_ends)], &mut rigid);
        }
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>();
        1.0 - dot(&stepped, &rigid).powi(2) / (dot(&stepped, &stepped) * dot(&rigid, &rigid))
    }

    #[test]
    fn agrees_with_the_stepped_contact_when_the_pocket_is_flat_at_the_ends() {
        let [flat, throughout] = [0.0, 1.0].map(left_of_the_stepped_change);
        assert!(flat < 0.04 && throughout > 5.0 * flat, "{flat} {throughout}");
    }
}
