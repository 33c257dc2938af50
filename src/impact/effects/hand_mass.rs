//! `hand-mass`: the hand counts as a point mass on the handle.

use super::Effect;
use crate::impact::body::Body;
use crate::impact::card::{Bases, EffectCard, EffectKind, ParameterCard};
use crate::impact::real::Real;

pub(super) static CARD: EffectCard = EffectCard {
    name: "hand-mass",
    kind: EffectKind::Physics,
    physics: "During the contact the hand and forearm act like 0.1 to 0.3 kg fixed near the butt, because the impulse reaches the hand within \
              1.5 ms. The racket's mass, centre of mass and swing inertia change with it.",
    equation: "M' = M + m_h, c' = (M c + m_h s_h)/M', I' = I + M m_h/M' (c - s_h)^2 about y and z",
    parameters: &[
        ParameterCard::strength("mass_kg", "kg", "mass that moves with the handle", 0.1, (0.0, 2.0), 0.1),
        ParameterCard::shape("from_butt_m", "m", "where it sits", 0.07, (0.0, 0.25), 0.03),
    ],
    source: "Cross 2010 (about 0.2 kg at the handle's end); Haake, Goodwill, Choppin 2010",
    signature: "Faster rebound toward tip and throat, none where a free racket would turn about the hand (near the face's centre of percussion); \
                the racket turns less about y; no dependence on y, spin or angle.",
    confused_with: &["racket-inertia", "frame-vibration", "swing-drive"],
    separated_by: "the same impacts with the racket held and free, at tip and throat",
    bases: Bases { rigid: "as given; the mode of `frame-vibration` carries it too (lower frequency, other node)", viscoelastic: "as given; the mode of `frame-vibration` carries it too" },
    effect: &HandMass,
};

/// The frame's modes with the mass on them are iterated; their derivatives by mass and place come from the eigenvalue problem
/// (`Beam::with_point_mass`). A mass below 0, where no card lets it, leaves the modes alone: at 0 derivatives are those from above.
#[derive(Debug)]
struct HandMass;

impl<T: Real> Effect<T> for HandMass {
    fn change_body(&self, p: &[T], body: &mut Body<T>) {
        if !p[0].is_zero() {
            body.add_mass_on_axis(p[0], p[1]);
            body.hang_on_beam(p[0], p[1]);
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::impact::rigid::tests::reference_equipment;
    use crate::impact::{Base, Model};

    /// Physics reference, F.4: a hand of 0.2 kg near the end lowers a frame's first frequency by a tenth.
    #[test]
    fn truth_the_frame_mode_carries_the_hand() {
        let (mut racket, ball) = reference_equipment();
        racket.swingweight_kgm2 = 0.0325;
        let body = |kg: f64| {
            let mut model = Model::new(Base::Rigid).with_effect("frame-vibration").and_then(|m| m.with_effect("hand-mass")).expect("known");
            model.set("hand-mass.mass_kg", kg).expect("known");
            model.set("hand-mass.from_butt_m", 0.04).expect("known");
            model.prepare(&racket, &ball).expect("valid").body().clone()
        };
        assert!((body(0.0).beam_frequency_ratio() - 1.0).abs() < 1e-6);
        let held = body(0.2);
        assert!((held.beam_frequency_ratio() - 97.0 / 109.0).abs() < 0.02, "{}", held.beam_frequency_ratio());
    }
}
