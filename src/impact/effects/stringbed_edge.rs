//! `stringbed-edge`: strings are shorter and stiffer near the frame.

use super::Effect;
use crate::impact::body::Body;
use crate::impact::card::{Bases, EffectCard, EffectKind, ParameterCard};
use crate::impact::real::Real;
use crate::impact::rigid::{Contact, Laws};
use crate::impact::viscoelastic;
use nalgebra::Vector2;

pub(super) static CARD: EffectCard = EffectCard {
    name: "stringbed-edge",
    kind: EffectKind::Physics,
    physics: "Near the frame the strings are shorter and the bed is stiffer. Less of the energy goes into the strings there, so the \
              restitution falls toward the edge of the face on all sides.",
    equation: "e = e_0 - drop ((x / a)^2 + (y / b)^2), a, b: half length and width of the stringbed",
    parameters: &[ParameterCard::strength("drop", "", "fall of the restitution from the centre to the frame", 0.05, (-0.5, 1.0), 0.05).one_way()],
    source: "membrane stiffness 1/ln[(R^2 - rho^2)/(R a)]; Tennis Warehouse University maps of the apparent restitution",
    signature: "Rebound slower toward the frame, even in x and y about the stringbed's centre; shorter contact off centre; nothing \
                tangential.",
    confused_with: &["frame-vibration", "frame-torsion", "grip-torque", "racket-inertia"],
    separated_by: "map of the contact time over the face; static pushes; impacts across as well as along the face",
    check_first: None,
    bases: Bases { rigid: "as given", viscoelastic: "stringbed stiffness multiplied by 1 + 10 drop ((x/a)^2 + (y/b)^2)" },
    effect: &StringbedEdge,
};

/// Squared distance from the stringbed's centre, 1 at the frame.
fn from_centre_squared<T: Real>(body: &Body<T>, position: &Vector2<T>) -> T {
    (position.x / body.half_length).powi(2) + (position.y / body.half_width).powi(2)
}

/// Relative growth of the stiffness from centre to frame per unit of drop (0.5 lowers the restitution by about 0.05).
const STIFFNESS_PER_DROP: f64 = 10.0;

#[derive(Debug)]
struct StringbedEdge;

impl<T: Real> Effect<T> for StringbedEdge {
    fn change_laws(&self, p: &[T], at: &Contact<T>, laws: &mut Laws<T>) {
        laws.restitution -= p[0] * from_centre_squared(at.body, &at.input.position);
    }

    fn change_viscoelastic(&self, p: &[T], at: &Contact<T>, laws: &mut viscoelastic::Laws<T>) {
        laws.edge_x += p[0] * STIFFNESS_PER_DROP / (at.body.half_length * at.body.half_length);
        laws.edge_y += p[0] * STIFFNESS_PER_DROP / (at.body.half_width * at.body.half_width);
    }
}
