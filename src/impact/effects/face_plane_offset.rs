//! `face-plane-offset`: the markers' plane is not the strings' plane.

use super::Effect;
use crate::impact::body::Body;
use crate::impact::card::{Bases, EffectCard, EffectKind, ParameterCard};
use crate::impact::input::{ImpactInput, ImpactOutput};
use crate::impact::real::{Real, rotation};
use nalgebra::Vector3;

pub(super) static CARD: EffectCard = EffectCard {
    name: "face-plane-offset",
    kind: EffectKind::Measurement,
    physics: "Tape wraps the frame, so the plane of the markers can lie some millimetres from the strings and be tilted against them. \
              The contact then comes earlier or later, elsewhere on the face, and with another normal.",
    equation: "strings at z = offset_m: position += offset_m u_t/u_z, V += Omega x offset_m z; axes turned by (tilt_x_rad, tilt_y_rad)",
    parameters: &[
        ParameterCard::strength("offset_m", "m", "string plane above the markers' plane along z", 0.005, (-0.05, 0.05), 0.005),
        ParameterCard::strength("tilt_x_rad", "rad", "turn of the true face about x against the markers' plane", 0.0, (-0.3, 0.3), 0.01),
        ParameterCard::strength("tilt_y_rad", "rad", "turn about y", 0.0, (-0.3, 0.3), 0.01),
    ],
    source: "thesis 4.4 and 5.5 (markers around the frame)",
    signature: "Impact position off in proportion to the tangent of the incidence; a tilt bends every exit direction the same way over \
                the whole face.",
    confused_with: &["string-tilt", "ball-centre-bias", "finite-contact", "camera-skew"],
    separated_by: "impact dye on the strings; balls at opposite incidence",
    check_first: Some(
        "a contact that creeps along the strings by a share of the ball's way looks the same as an offset of the plane, outgoing velocities told turned by \
         one angle as a tilt: dye on the strings, and balls at normal incidence, tell",
    ),
    bases: Bases { rigid: "acts on the observation", viscoelastic: "acts on the observation" },
    effect: &FacePlaneOffset,
};

/// Approach speed below which the instant of contact cannot be moved, m/s.
const SLOWEST: f64 = 0.5;

#[derive(Debug)]
struct FacePlaneOffset;

impl<T: Real> Effect<T> for FacePlaneOffset {
    fn true_input(&self, p: &[T], body: &Body<T>, input: &mut ImpactInput<T>) {
        if !(p[1].is_zero() && p[2].is_zero()) {
            let seen_from_true = rotation(&Vector3::new(p[1], p[2], T::zero()));
            for v in [&mut input.ball_velocity, &mut input.ball_spin, &mut input.racket_velocity, &mut input.racket_rate] {
                *v = seen_from_true.tr_mul(v);
            }
        }
        if !p[0].is_zero() {
            let up = Vector3::new(T::zero(), T::zero(), p[0]);
            let u = body.reported_approach(input);
            if u.z.value().abs() > SLOWEST {
                input.position += u.xy() * (p[0] / u.z);
            }
            input.racket_velocity += input.racket_rate.cross(&up);
        }
    }

    fn observed_output(&self, p: &[T], _: &Body<T>, input: &ImpactInput<T>, output: &mut ImpactOutput<T>) {
        if !p[0].is_zero() {
            // What `true_input` added; the centre of mass itself is where the racket's file has it, before and after.
            output.racket_velocity -= input.racket_rate.cross(&Vector3::new(T::zero(), T::zero(), p[0]));
        }
        if !(p[1].is_zero() && p[2].is_zero()) {
            let seen_from_true = rotation(&Vector3::new(p[1], p[2], T::zero()));
            for v in [&mut output.ball_velocity, &mut output.ball_spin, &mut output.racket_velocity, &mut output.racket_rate] {
                *v = seen_from_true * *v;
            }
        }
    }
}
