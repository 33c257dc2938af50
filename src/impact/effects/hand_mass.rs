//! `hand-mass`: the hand counts as a point mass on the handle.

use super::Effect;
use crate::impact::body::Body;
use crate::impact::card::{Bases, EffectCard, EffectKind, ParameterCard};
use crate::impact::real::Real;
use crate::impact::rigid::{Contact, Laws};

pub(super) static CARD: EffectCard = EffectCard {
    name: "hand-mass",
    kind: EffectKind::Physics,
    physics: "During the contact the hand and forearm act like 0.1 to 0.3 kg fixed near the butt, because the impulse reaches the hand within \
              1.5 ms. The racket's mass, centre of mass and swing inertia change with it. Between handle and bone lies soft tissue, \
              which gives way: part of the energy that the hand takes does not come back.",
    equation: "M' = M + m_h, c' = (M c + m_h s_h)/M', I' = I + M m_h/M' (c - s_h)^2 about y and z; e'^2 = e^2 - q (1 + e')^2, \
               q = give m_h l^2 / K_zz, l = 1/M' + (s_h - c')(s - c')/I_y': speed of the hand per unit of impulse",
    parameters: &[
        ParameterCard::strength("mass_kg", "kg", "mass that moves with the handle", 0.1, (0.0, 2.0), 0.1),
        ParameterCard::shape("from_butt_m", "m", "where it sits", 0.07, (0.0, 0.25), 0.03).fitted(),
        ParameterCard::shape("give", "", "energy lost in soft tissue over that of the hand's motion; 0: a rigid mass (rigid base only)", 0.0, (0.0, 3.0), 0.5)
            .fitted(),
    ],
    source: "Cross 2010 (about 0.2 kg at the handle's end); Haake, Goodwill, Choppin 2010",
    signature: "Faster rebound toward tip and throat, none where a free racket would turn about the hand (near the face's centre of percussion); \
                the racket turns less about y; no dependence on y, spin or angle.",
    confused_with: &["racket-inertia", "frame-vibration", "swing-drive"],
    separated_by: "the same impacts with the racket held and free, at tip and throat",
    check_first: None,
    bases: Bases {
        rigid: "as given; the mode of `frame-vibration` carries it too (lower frequency, other node)",
        viscoelastic: "as given; the mode of `frame-vibration` carries it too",
    },
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

    fn change_laws(&self, p: &[T], at: &Contact<T>, laws: &mut Laws<T>) {
        let b = at.body;
        let hand = -p[1] + b.stringbed_centre - b.com_x;
        let speed = b.racket_mass.recip() + hand * at.lever.x / b.racket_inertia.y;
        laws.mode_loss += p[2] * p[0] * speed * speed / at.normal_compliance;
    }
}

#[cfg(test)]
mod tests {
    use crate::impact::rigid::tests::{reference_equipment, reference_input};
    use crate::impact::{Base, ImpactInput, Model};
    use nalgebra::Vector3;

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

    /// A head-on impact on the long axis: the energy that goes missing beside the restitution's is `give` times that of the hand.
    #[test]
    fn truth_a_soft_hand_keeps_the_stated_share_of_its_energy() {
        let (racket, ball) = reference_equipment();
        let (kg, place, give) = (0.15, 0.07, 0.6);
        let input = ImpactInput {
            ball_velocity: Vector3::new(0.0, 0.0, -25.0),
            ball_spin: Vector3::zeros(),
            racket_velocity: Vector3::zeros(),
            racket_rate: Vector3::zeros(),
            position: nalgebra::Vector2::new(-0.09, 0.0),
            ..reference_input()
        };
        let lost = |give: f64| {
            let mut model = Model::new(Base::Rigid).with_effect("hand-mass").expect("known");
            for (name, value) in [("restitution", 1.0), ("hand-mass.mass_kg", kg), ("hand-mass.from_butt_m", place), ("hand-mass.give", give)] {
                model.set(name, value).expect("allowed");
            }
            let ready = model.prepare(&racket, &ball).expect("valid");
            let (b, out) = (ready.body(), ready.predict(&input).expect("contact"));
            // The velocity given is that of the racket's own centre of mass; the hand's and the common one's follow from the rate.
            let at = |x: f64| out.racket_velocity.z - out.racket_rate.y * (x - b.reported_com_x);
            let (common, hand) = (at(b.com_x), at(b.stringbed_centre - place));
            let energy = 0.5 * (b.ball_mass * out.ball_velocity.z.powi(2) + b.racket_mass * common.powi(2) + b.racket_inertia.y * out.racket_rate.y.powi(2));
            (0.5 * b.ball_mass * 25.0f64.powi(2) - energy, 0.5 * kg * hand * hand)
        };
        assert!(lost(0.0).0.abs() < 1e-9);
        let (missing, of_hand) = lost(give);
        assert!((missing - give * of_hand).abs() < 1e-9, "{missing} J, hand {of_hand} J");
    }
}
