use crate::equipment::{Ball, Head, Racket, Strings};
use crate::impact::{Base, ImpactInput, Model, PreparedModel};
use nalgebra::{Vector2, Vector3};

/// Racket and ball of the reference's test vectors: M 0.33, I = (.0015, .0158, .0173), m 0.0577, r 0.033, beta 0.55.
pub(crate) fn reference_equipment() -> (Racket, Ball) {
    let (mass, balance) = (0.33, 0.325f64);
    let shift = mass * (balance - 0.10f64).powi(2);
    let racket = Racket {
        name: "reference".into(),
        mass_kg: mass,
        length_m: 0.685,
        balance_m: balance,
        stringbed_centre_m: 0.51,
        swingweight_kgm2: 0.0158 + shift,
        twistweight_kgm2: 0.0015,
        spinweight_kgm2: Some(0.0173 + shift),
        head: Head { inner_length_m: 0.33, inner_width_m: 0.24, tube_radius_m: 0.01 },
        strings: Strings { tension_lb: 60.0 },
        markers: None,
    };
    (racket, Ball { name: "reference".into(), mass_kg: 0.0577, diameter_m: 0.066, inertia_factor: 0.55 })
}

pub(crate) fn prepared(model: &Model) -> PreparedModel {
    let (racket, ball) = reference_equipment();
    model.prepare(&racket, &ball).expect("valid")
}

/// Item G.4 of the reference: lever (−0.2, 0.03, 0), ball above.
pub(crate) fn reference_input() -> ImpactInput {
    ImpactInput {
        ball_velocity: Vector3::new(1.0, 9.0, -28.0),
        ball_spin: Vector3::new(100.0, -50.0, 20.0),
        racket_velocity: Vector3::new(-1.0, 2.0, 4.0),
        racket_rate: Vector3::new(2.0, 25.0, -5.0),
        position: Vector2::new(-0.2 + (0.51 - 0.325), 0.03),
        grip_torque: 0.0,
        order: 0.0,
        own: Default::default(),
    }
}

fn base(restitution: f64, friction: f64) -> Model {
    let mut model = Model::new(Base::Rigid);
    model.set("restitution", restitution).expect("known");
    model.set("friction", friction).expect("known");
    model
}

fn close(seen: Vector3<f64>, expected: [f64; 3], digits: f64) {
    let expected = Vector3::from(expected);
    assert!((seen - expected).amax() <= digits, "{seen:?} against {expected:?}");
}

#[test]
fn truth_stick() {
    let out = prepared(&base(0.8, 1.0)).predict(&reference_input()).expect("contact");
    close(out.ball_velocity, [-0.1483923, 6.0327220, 21.2112234], 5.1e-8);
    close(out.ball_spin, [-63.4863938, 13.2723033, 20.0], 5.1e-8);
    close(out.racket_velocity, [-0.7992053, 2.5188241, -4.6045079], 5.1e-8);
    close(out.racket_rate, [-54.7897518, -10.9428809, -7.0942344], 5.1e-8);
}

#[test]
fn truth_tangential_restitution() {
    let mut model = base(0.8, 1.0).with_effect("lateral-strings").expect("known");
    model.set("lateral-strings.across", 0.2).expect("known");
    model.set("lateral-strings.along", 0.2).expect("known");
    let out = prepared(&model).predict(&reference_input()).expect("contact");
    close(out.ball_velocity, [-0.3780708, 5.4392663, 21.2112234], 5.1e-8);
}

#[test]
fn truth_exact_sliding() {
    let mut model = base(0.8, 0.05);
    model.set_sliding(super::Sliding::Exact);
    let out = prepared(&model).predict(&reference_input()).expect("contact");
    // scipy's RK45 at rtol 1e-12 gives 0.121501506, 6.701627249; the reference prints 0.1215019, 6.7016271.
    close(out.ball_velocity, [0.121501506, 6.701627249, 21.21122341], 1e-8);
    close(out.ball_velocity, [0.1215019, 6.7016271, 21.2112234], 5e-7);
    close(out.ball_spin, [-26.6321164, -1.5979023, 20.0], 3e-5);
    // The direction at first touch instead: the friction impulse is 0.05 times the normal one, against (3.5, 9.3).
    let out = prepared(&base(0.8, 0.05)).predict(&reference_input()).expect("contact");
    let j = 0.05 * 2.839487591 / 3.5f64.hypot(9.3);
    close(out.ball_velocity, [1.0 - j * 3.5 / 0.0577, 9.0 - j * 9.3 / 0.0577, 21.2112234], 5.1e-8);
}

/// The last case of the physics reference's item G.8: a moving racket hit off its middle, where the stepped contact sends the ball
/// 0.70 m/s along the handle and an impulse at first touch 0.33 m/s the other way (D.19).
#[test]
fn truth_a_lasting_contact_goes_where_the_stepped_one_does() {
    let input = ImpactInput {
        ball_velocity: Vector3::new(0.0, 8.0, -30.0),
        ball_spin: Vector3::zeros(),
        position: Vector2::new(reference_input().position.x, 0.0),
        ..reference_input()
    };
    let mut model = base(0.763, 0.5).with_effect("finite-contact").expect("known");
    let at = |model: &Model| prepared(model).predict(&input).expect("contact");
    let lasting = at(&model);
    model.set("finite-contact.contact_time_s", 0.0).expect("known");
    let instant = at(&model);
    assert!((instant.ball_velocity.x + 0.33).abs() < 0.1, "{}", instant.ball_velocity.x);
    assert!((lasting.ball_velocity.x - 0.70).abs() < 0.2, "{}", lasting.ball_velocity.x);
    let (racket, ball) = reference_equipment();
    let momentum = |out: &crate::impact::ImpactOutput| out.ball_velocity * ball.mass_kg + out.racket_velocity * racket.mass_kg;
    close(momentum(&lasting) - momentum(&instant), [0.0; 3], 1e-12);
}

/// Without duration a lasting contact is an instantaneous one, sticking or sliding; where something couples the normal impulse with
/// others, the work decides instead of the velocity, which is nearly the same.
#[test]
fn ladder_a_short_contact_becomes_an_instant() {
    let others = ["string-tilt", "offset-normal-force", "lateral-strings", "ball-deformation", "swing-drive"];
    for (friction, others, digits) in [(1.0, &[][..], 1e-5), (0.05, &[], 1e-5), (1.0, &others, 2e-3)] {
        let mut model = base(0.8, friction);
        for name in others.iter().chain(&["finite-contact"]) {
            model = model.with_effect(name).expect("known");
        }
        let at = |model: &Model| prepared(model).predict(&reference_input()).expect("contact");
        model.set("finite-contact.contact_time_s", 1e-9).expect("known");
        let short = at(&model);
        model.set("finite-contact.contact_time_s", 0.0).expect("known");
        let instant = at(&model);
        close(short.ball_velocity, instant.ball_velocity.into(), digits);
        close(short.ball_spin, instant.ball_spin.into(), 30.0 * digits);
        close(short.racket_velocity, instant.racket_velocity.into(), digits);
        close(short.racket_rate, instant.racket_rate.into(), 10.0 * digits);
    }
}
