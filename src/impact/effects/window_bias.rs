//! `window-bias`: the racket's velocity in the middle of the window is taken for that at impact.

use super::Effect;
use crate::impact::body::Body;
use crate::impact::card::{Bases, EffectCard, EffectKind, ParameterCard};
use crate::impact::input::{ImpactInput, ImpactOutput};
use crate::impact::real::Real;

pub(super) static CARD: EffectCard = EffectCard {
    name: "window-bias",
    kind: EffectKind::Measurement,
    physics: "A straight line fitted to the frames before (after) impact gives the velocity at the window's middle. The racket turns \
              about the hand, so its centre of mass is accelerated toward the handle meanwhile.",
    equation: "V_impact = V_measured + (Omega_y^2 + Omega_z^2) R delay_s along x before, minus the same after; R = balance - pivot",
    parameters: &[
        ParameterCard::strength("delay_s", "s", "from the window's middle to the contact", 5e-3, (-0.1, 0.1), 5e-3),
        ParameterCard::shape("pivot_m", "m", "from the butt to the point about which the racket turns", 0.07, (-0.5, 0.5), 0.05),
    ],
    source: "2.5 m/s per 5.5 ms at 30 rad/s and 0.5 m",
    signature: "Racket velocity along its axis off in proportion to the square of its rate, so ball spin and velocity along x as well; \
                nothing on a racket at rest.",
    confused_with: &["swing-drive", "finite-contact", "racket-inertia"],
    separated_by: "fit an arc or a quadratic to the same frames",
    check_first: None,
    bases: Bases { rigid: "acts on the observation", viscoelastic: "acts on the observation" },
    effect: &WindowBias,
};

/// From the pivot to the centre of mass that the user measures, m.
fn arm<T: Real>(body: &Body<T>, pivot_from_butt: T) -> T {
    -body.reported_com_x + body.stringbed_centre - pivot_from_butt
}

#[derive(Debug)]
struct WindowBias;

impl<T: Real> Effect<T> for WindowBias {
    fn true_input(&self, p: &[T], body: &Body<T>, input: &mut ImpactInput<T>) {
        let w = input.racket_rate;
        input.racket_velocity.x += (w.y * w.y + w.z * w.z) * arm(body, p[1]) * p[0];
    }

    fn observed_output(&self, p: &[T], body: &Body<T>, _: &ImpactInput<T>, output: &mut ImpactOutput<T>) {
        let w = output.racket_rate;
        output.racket_velocity.x += (w.y * w.y + w.z * w.z) * arm(body, p[1]) * p[0];
    }
}
