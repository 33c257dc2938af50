//! `frame-vibration`: the frame's first bending mode takes energy away from its node.

use super::Effect;
use crate::impact::body::Body;
use crate::impact::card::{Bases, EffectCard, EffectKind, ParameterCard};
use crate::impact::real::Real;
use crate::impact::rigid::{Contact, Laws};
use crate::impact::viscoelastic;
use std::f64::consts::PI;

pub(super) static CARD: EffectCard = EffectCard {
    name: "frame-vibration",
    kind: EffectKind::Physics,
    physics: "The frame is a free beam whose first bending mode (100 to 200 Hz) is set ringing unless the ball lands on its node. \
              Its half period is about the contact time, so the energy does not come back to the ball.",
    equation: "e'^2 = e^2 - q (1 + e')^2, q = amount phi(s - node)^2 S^2 / (M_k K_zz), S = cos(wT/2) / (1 - (wT/pi)^2), T = contact_time (K_c/K_zz)^1/2 (20/v_n)^0.14",
    parameters: &[
        ParameterCard::strength("amount", "", "share of the beam's own value (1: as computed)", 1.0, (0.0, 5.0), 0.5),
        ParameterCard::shape("frequency_hz", "Hz", "first bending frequency with free ends", 140.0, (60.0, 400.0), 30.0),
        ParameterCard::shape(
            "contact_time_s",
            "s",
            "duration of the contact of 20 m/s at the middle of the face (rigid base only)",
            4.5e-3,
            (1e-3, 1e-2),
            5e-4,
        ),
        ParameterCard::shape("damping_ratio", "", "of the mode (visco-elastic base only)", 0.01, (0.0, 0.3), 0.01),
        ParameterCard::shape("node_m", "m", "how far the node lies from the beam's own, toward the tip", 0.0, (-0.05, 0.05), 0.01).fitted(),
    ],
    source: "Cross 1998, 1999; thesis 2.7.2; free-free beam with mass, balance and swingweight of the racket",
    signature: "Rebound slower than the model on both sides of the node (0.78 to 0.81 of the length from the butt), most at the throat; \
                even in distance to the node, the same across the face, without effect on spin or angle.",
    confused_with: &["stringbed-edge", "racket-inertia", "hand-mass"],
    separated_by: "impacts at five or more places along the axis including the throat; a piezo on the handle",
    check_first: None,
    bases: Bases { rigid: "energy of a half-sine pulse in the mode lowers the restitution", viscoelastic: "the mode is integrated with the contact" },
    effect: &FrameVibration,
};

/// S: the mode's response to a half-sine pulse of duration `t`, relative to that to an instantaneous impulse.
pub(super) fn pulse_response<T: Real>(frequency_hz: T, t: T) -> T {
    let x = frequency_hz * 2.0 * t; // wT/pi
    if (x.value() - 1.0).abs() < 1e-4 {
        // cos(pi x/2)/(1 - x^2) has the limit pi/4 at x = 1, and slope −pi/8 there.
        return (-(x - 1.0) * 0.5 + 1.0) * (PI / 4.0);
    }
    (x * (0.5 * PI)).cos() / (-(x * x) + 1.0)
}

/// In base viscoelastic the mode appears with the strength: at 0 there is no derivative by it.
#[derive(Debug)]
struct FrameVibration;

impl<T: Real> Effect<T> for FrameVibration {
    fn needs_beam(&self) -> bool {
        true
    }

    fn change_laws(&self, p: &[T], at: &Contact<T>, laws: &mut Laws<T>) {
        let Some(beam) = &at.body.beam else { return };
        let phi = beam.shape(0, from_butt(at.body, at.input.position.x) - p[4]);
        let s = pulse_response(p[1] * at.body.beam_frequency_ratio(), at.duration(p[2]));
        laws.mode_loss += p[0] * phi * phi * s * s / (beam.modes[0].modal_mass * at.normal_compliance);
    }

    fn change_viscoelastic(&self, p: &[T], at: &Contact<T>, laws: &mut viscoelastic::Laws<T>) {
        let Some(beam) = &at.body.beam else { return };
        if p[0].value() > 0.0 {
            laws.mode_shape = beam.shape(0, from_butt(at.body, at.input.position.x) - p[4]);
            // `amount` scales the energy that the mode takes, so it divides the modal mass.
            laws.mode_mass = beam.modes[0].modal_mass / p[0];
            laws.mode_rate = p[1] * (2.0 * PI) * at.body.beam_frequency_ratio();
            laws.mode_damping = p[3];
        }
    }
}

fn from_butt<T: Real>(body: &Body<T>, x: T) -> T {
    -x + body.stringbed_centre
}
