use super::{BallLaw, DEFAULT_STEPS, FrictionDirection, NormalForce, RUN_STEPS, StringLaw};
use crate::impact::rigid::tests::{reference_equipment, reference_input};
use crate::impact::{Base, ImpactInput, Model, PreparedModel, Run};
use nalgebra::{Vector2, Vector3};

fn model(changes: &[(&str, f64)]) -> PreparedModel {
    let mut model = Model::new(Base::Viscoelastic);
    for (name, value) in changes {
        model.set(name, *value).expect("known");
    }
    let (racket, ball) = reference_equipment();
    let mut prepared = model.prepare(&racket, &ball).expect("valid");
    prepared.set_steps(2000.0);
    prepared
}

fn near(seen: &Vector3<f64>, expected: [f64; 3], relative: f64) {
    let expected = Vector3::from(expected);
    assert!((seen - expected).norm() <= relative * expected.norm(), "{seen:?} against {expected:?}");
}

/// The stated centre of mass is a point of the racket and turns with it: in the racket's own axes it moves by rate times lever about the common one.
#[test]
fn truth_the_stated_centre_of_mass_turns_with_the_racket() {
    let mut held = Model::new(Base::Viscoelastic).with_effect("hand-mass").expect("known");
    held.set("hand-mass.mass_kg", 0.12).expect("known");
    let (racket, ball) = reference_equipment();
    let mut ready = held.prepare(&racket, &ball).expect("valid");
    ready.set_steps(2000.0);
    let run = ready.run_default(&reference_input()).expect("contact");
    let shift = ready.body().com_x - ready.body().reported_com_x;
    let own = run.racket_rate_own_axes;
    let about = ready.predict(&reference_input()).expect("contact").racket_velocity - run.output.racket_velocity;
    assert!((about.norm() - shift.abs() * own.y.hypot(own.z)).abs() < 1e-6, "{about:?}");
    assert!(about.dot(&run.output.racket_rate).abs() < 1e-4, "{about:?}");
}

/// Item G.7: free racket, everything at once. Printed at a step of 2 us with a first-order scheme whose sliding friction points
/// along K⁻¹ times the slip: `friction_direction = "projected"`.
#[test]
fn truth_free_racket() {
    let mut projected = Model::new(Base::Viscoelastic);
    projected.contact_laws_mut().friction_direction = FrictionDirection::Projected;
    let (racket, ball) = reference_equipment();
    let run = projected.prepare(&racket, &ball).expect("valid").run_default(&reference_input()).expect("contact");
    let o = &run.output;
    near(&o.ball_velocity, [0.81700, 7.22909, 19.84558], 1e-4);
    near(&o.ball_spin, [-37.3580, 27.3803, 21.3704], 1e-3);
    near(&o.racket_velocity, [-0.96800, 2.30964, -4.36573], 1e-4);
    near(&run.racket_rate_own_axes, [-60.6410, -8.95042, -7.37044], 1e-4);
    assert!((o.contact_time.expect("timed") - 3.950e-3).abs() < 1e-6);
    assert!((run.peak_force - 1265.35).abs() < 1.0 && (run.peak_compression - 21.700e-3).abs() < 1e-5);
    assert!((run.peak_deflection - 23.796e-3).abs() < 1e-5);
    let l = &run.ledger;
    for (seen, expected) in [
        (l.lost_in_ball_damping, 7.55489),
        (l.lost_in_momentum_flux, 2.65396),
        (l.lost_in_string_damping, 1.40254),
        (l.lost_in_friction, 1.02696),
        (l.given_by_deformation, 0.00295),
        (l.kinetic_before, 33.828758),
        (l.kinetic_after + l.stored_after, 21.193356),
    ] {
        assert!((seen - expected).abs() < 1e-3 * expected.max(1.0), "{seen} against {expected}");
    }
}

/// Coulomb's friction, against the slip itself (the default), turns the friction of G.7 by 0.1 degrees while the ball slides,
/// and changes nothing else: 1.6e-3 of the ball's spin, 1e-5 of the velocities.
#[test]
fn law_the_schemes_of_friction_differ_in_direction_only() {
    let runs = [FrictionDirection::Slip, FrictionDirection::Projected].map(|direction| {
        let mut model = Model::new(Base::Viscoelastic);
        model.contact_laws_mut().friction_direction = direction;
        let (racket, ball) = reference_equipment();
        model.prepare(&racket, &ball).expect("valid").run_default(&reference_input()).expect("contact")
    });
    let spin = (runs[0].output.ball_spin - runs[1].output.ball_spin).norm() / runs[1].output.ball_spin.norm();
    let velocity = (runs[0].output.ball_velocity - runs[1].output.ball_velocity).norm() / runs[1].output.ball_velocity.norm();
    assert!((1e-3..2e-3).contains(&spin) && velocity < 1e-4, "{spin:e} {velocity:e}");
    assert!((runs[0].ledger.lost_in_friction - runs[1].ledger.lost_in_friction).abs() < 1e-3);
}

/// A ball without spin on the long axis or beside it, racket at rest; lever X, Y from the centre of mass.
fn shot(x: f64, y: f64, v: [f64; 3]) -> ImpactInput {
    ImpactInput {
        ball_velocity: Vector3::from(v),
        ball_spin: Vector3::zeros(),
        racket_velocity: Vector3::zeros(),
        racket_rate: Vector3::zeros(),
        position: Vector2::new(x + 0.185, y),
        grip_torque: 0.0,
        order: 0.0,
        own: Default::default(),
    }
}

fn run(changes: &[(&str, f64)], input: &ImpactInput) -> Run {
    model(changes).run(input, 2000.0).expect("contact")
}

/// Item G.8: oblique impact on the long axis with other laws.
#[test]
fn truth_oblique() {
    let input = shot(-0.2, 0.0, [0.0, 8.0, -30.0]);
    let r = run(&[], &input);
    let o = r.output;
    near(&o.ball_velocity, [-0.69544, 5.44128, 10.44525], 2e-4);
    near(&o.ball_spin, [-132.8005, 5.4373, 0.6197], 2e-4);
    near(&r.racket_rate_own_axes, [-14.2667, -29.4858, -2.3532], 2e-4);
    assert!((o.contact_time.expect("timed") - 4.224e-3).abs() < 4e-6);
    let o = run(&[("lambda_r", 0.0), ("kappa_I", 0.0)], &input).output;
    near(&o.ball_velocity, [-0.67413, 5.68208, 10.42703], 1e-3);
    near(&o.ball_spin, [-135.6227, 4.4159, 0.0415], 1e-3);
    let o = run(&[("k_t", 60e3), ("c_t", 20.0)], &input).output;
    near(&o.ball_velocity, [-0.48381, 5.77224, 10.48300], 1e-3);
    near(&o.ball_spin, [-119.0945, -2.3047, 2.5404], 1e-3);
    let moving = ImpactInput { racket_velocity: Vector3::new(-1.0, 2.0, 4.0), racket_rate: Vector3::new(2.0, 25.0, -5.0), ..input };
    near(&run(&[], &moving).output.ball_velocity, [0.69949, 6.28420, 22.16639], 1e-3);
}

/// Item G.9: restitution, contact time and deflection against speed, frictionless, 0.225 m from the centre of mass.
#[test]
fn truth_speeds() {
    let expected = [
        (5.0, 0.874, 0.378, 5.21, 3.1),
        (10.0, 0.849, 0.360, 4.91, 6.3),
        (15.0, 0.830, 0.346, 4.72, 9.7),
        (20.0, 0.813, 0.334, 4.53, 13.1),
        (25.0, 0.798, 0.323, 4.36, 16.4),
        (30.0, 0.785, 0.313, 4.19, 19.6),
        (35.0, 0.774, 0.304, 4.03, 22.6),
        (40.0, 0.763, 0.297, 3.88, 25.5),
    ];
    for (v, e, apparent, ms, mm) in expected {
        let r = run(&[("mu", 0.0)], &shot(-0.225, 0.0, [0.0, 0.0, -v]));
        let o = &r.output;
        let strings = o.racket_velocity.z - o.racket_rate.y * -0.225;
        assert!(((o.ball_velocity.z - strings) / v - e).abs() < 6e-4, "{v} m/s");
        assert!((o.ball_velocity.z / v - apparent).abs() < 6e-4);
        assert!((o.contact_time.expect("timed") * 1e3 - ms).abs() < 6e-3);
        assert!((r.peak_deflection * 1e3 - mm).abs() < 0.06);
    }
}

/// Item G.10: a frame mode of 140 Hz, damping ratio 0.01, 30 m/s, frictionless, along the first racket of table F.4.
#[test]
fn truth_vibration() {
    let (mut racket, ball) = reference_equipment();
    racket.swingweight_kgm2 = 0.0325;
    let mut base = Model::new(Base::Viscoelastic);
    base.set("mu", 0.0).expect("known");
    let ringing = base.with_effect("frame-vibration").expect("known");
    for (s, with, rigid) in [(0.40, 0.352, 0.500), (0.43, 0.351, 0.475), (0.51, 0.355, 0.376), (0.55, 0.313, 0.313), (0.60, 0.181, 0.227), (0.64, 0.036, 0.156)]
    {
        let input = shot(racket.balance_m - s, 0.0, [0.0, 0.0, -30.0]);
        for (model, expected) in [(&ringing, with), (&base, rigid)] {
            let r = model.prepare(&racket, &ball).expect("valid").run(&input, 1000.0).expect("contact");
            assert!((r.output.ball_velocity.z / 30.0 - expected).abs() < 2e-3, "s = {s}: {} against {expected}", r.output.ball_velocity.z / 30.0);
        }
    }
}

/// Momentum, energy, both sides, with everything switched on that the ledger knows, at the steps a run has by default.
#[test]
fn law_ledger_closes() {
    let plain = Model::new(Base::Viscoelastic);
    let mut strings = plain.clone();
    strings.set("k_t", 60e3).expect("known");
    let mut kelvin_voigt = plain.clone();
    kelvin_voigt.set_ball_law(BallLaw::KelvinVoigt).expect("visco-elastic");
    let mut leigh_lui = plain.clone();
    leigh_lui.set_ball_law(BallLaw::LeighLui).expect("visco-elastic");
    leigh_lui.set_string_law(StringLaw::LeighLui).expect("visco-elastic");
    let mut haake = plain.clone();
    haake.contact_laws_mut().normal_force = NormalForce::Haake;
    let rich = ["frame-vibration", "frame-torsion", "stringbed-edge", "string-tilt", "offset-normal-force", "swing-drive", "grip-torque", "ball-deformation"];
    let rich = rich.iter().try_fold(plain.clone(), |m, e| m.with_effect(e)).expect("known");
    let (racket, ball) = reference_equipment();
    for (name, model, free) in [
        ("plain", plain, true),
        ("strings", strings, true),
        ("Kelvin-Voigt", kelvin_voigt, true),
        ("Leigh-Lui", leigh_lui, true),
        ("Haake", haake, true),
        ("rich", rich, false),
    ] {
        let prepared = model.prepare(&racket, &ball).expect("valid");
        for (side, across) in [1.0, -1.0].into_iter().flat_map(|s| [-15.0, -6.0, 0.0, 3.0, 9.0, 20.0].map(|v| (s, v))) {
            let mut input = reference_input();
            input.ball_velocity.z *= side;
            input.racket_velocity.z *= side;
            input.ball_velocity.y = across;
            input.grip_torque = 3.0;
            let l = prepared.run_default(&input).expect("contact").ledger;
            assert!(l.residual_j().abs() < 1e-9, "{name}, {across} m/s across: {:e} J", l.residual_j());
            let p = (l.linear_momentum_after - l.linear_momentum_before).norm() / l.linear_momentum_before.norm();
            let h = (l.angular_momentum_after - l.angular_momentum_before).norm() / l.angular_momentum_before.norm();
            assert!(!free || (p < 1e-12 && h < 1e-12), "{name}: {p:e}, {h:e}");
        }
    }
}

/// On a racket that nothing moves a sliding ball is slowed by the friction coefficient times what turns it back, whichever way it slides.
#[test]
fn law_sliding_friction_is_in_proportion_to_the_normal_force_all_through() {
    let (racket, ball) = reference_equipment();
    let mut text = String::from("base = \"viscoelastic\"\n[parameters]\nmu = 0.05\n");
    for (k, part) in ["racket_mass", "twist_inertia", "swing_inertia", "chop_inertia"].into_iter().enumerate() {
        text += &format!("[effects.fixed-{k}]\nreplaces = \"{part}\"\nexpression = \"{part} * 1e9\"\n");
    }
    let prepared = Model::parse(&text, std::path::Path::new("fixed.toml")).expect("valid").prepare(&racket, &ball).expect("valid");
    for turn in 0..12 {
        let (across, along) = (0.5 * f64::from(turn) + 0.2).sin_cos();
        for side in [1.0, -1.0] {
            let input = ImpactInput {
                ball_velocity: Vector3::new(20.0 * along, 20.0 * across, -15.0 * side),
                ball_spin: Vector3::zeros(),
                racket_velocity: Vector3::zeros(),
                racket_rate: Vector3::zeros(),
                ..reference_input()
            };
            let change = prepared.predict(&input).expect("contact").ball_velocity - input.ball_velocity;
            let ratio = change.x.hypot(change.y) / change.z.abs();
            assert!((ratio - 0.05).abs() < 1e-8, "slip along ({along:.2}, {across:.2}): {ratio}");
        }
    }
}

/// Impacts from sliding throughout to sticking early and giving way late.
fn oblique_impacts() -> Vec<ImpactInput> {
    (0..81).map(|k| ImpactInput { ball_velocity: Vector3::new(1.0, 0.5 * f64::from(k) - 20.0, -28.0 + f64::from(k % 5)), ..reference_input() }).collect()
}

/// Halving the step cuts the error by the order of the method, in spite of all kinks; the default is good to 1e-6.
#[test]
fn ladder_of_steps() {
    let mut prepared = model(&[]);
    let inputs = oblique_impacts();
    let exact: Vec<_> = inputs.iter().map(|i| prepared.run(i, 1000.0).expect("contact").output).collect();
    let mut worst = |steps: f64| {
        prepared.set_steps(steps);
        let seen = prepared.predict_all(&inputs);
        seen.iter()
            .zip(&exact)
            .map(|(o, e)| {
                let o = o.as_ref().expect("contact");
                (o.ball_velocity - e.ball_velocity).norm() / e.ball_velocity.norm()
            })
            .fold(0.0, f64::max)
    };
    let errors = [40.0, DEFAULT_STEPS, 80.0, 160.0, 320.0].map(&mut worst);
    eprintln!("steps 40, default, 80, 160, 320: {errors:?}");
    assert!(errors[1] < 1e-6, "{errors:?}");
    // Order 4 until what is left of the slip when it is stopped (1e-3 m/s) shows, at 3e-8.
    assert!(errors[2] < errors[0] / 8.0 && errors[3] < errors[2] / 8.0 + 3e-8 && errors[4] < 5e-8, "{errors:?}");
    // Order 8 where the ledger is kept.
    let high = |steps: f64| {
        let all = inputs.iter().zip(&exact).map(|(i, e)| (prepared.run(i, steps).expect("contact").output.ball_velocity - e.ball_velocity).norm());
        all.fold(0.0, f64::max) / 20.0
    };
    assert!(high(RUN_STEPS) < 1e-7, "{:e}", high(RUN_STEPS));
}

/// Every effect keeps the order of the method: nothing in it makes the outcome depend on the steps.
#[test]
fn ladder_of_steps_with_every_effect() {
    let (racket, ball) = reference_equipment();
    for card in crate::impact::catalogue() {
        let mut prepared = Model::new(Base::Viscoelastic).with_effect(card.name).expect("known").prepare(&racket, &ball).expect("valid");
        let worst = [DEFAULT_STEPS, 4.0 * DEFAULT_STEPS].map(|steps| {
            prepared.set_steps(steps);
            let mut worst = 0.0f64;
            for input in oblique_impacts().iter().step_by(4) {
                let input = ImpactInput { grip_torque: 3.0, ..*input };
                let (seen, exact) = (prepared.predict(&input).expect("contact"), prepared.run(&input, 600.0).expect("contact"));
                // What the run leaves out is only the observation.
                if card.kind == crate::impact::EffectKind::Physics && card.name != "air-flight" {
                    worst = worst.max((seen.ball_velocity - exact.output.ball_velocity).norm() / exact.output.ball_velocity.norm());
                    worst = worst.max(0.1 * (seen.ball_spin - exact.output.ball_spin).norm() / exact.output.ball_spin.norm());
                }
            }
            worst
        });
        eprintln!("{:<22} {:.1e} {:.1e}", card.name, worst[0], worst[1]);
        assert!(worst[0] < 2e-6 && worst[1] < 4e-7, "{}: {worst:?}", card.name);
    }
}

/// Lanes give the numbers that one impact alone gives, bit for bit, whatever stands beside it.
#[test]
fn agrees_lanes_with_single_impacts() {
    let prepared = model(&[]);
    let inputs: Vec<ImpactInput> =
        (0..37).map(|i| ImpactInput { ball_velocity: Vector3::new(1.0, f64::from(i) - 18.0, -12.0 - f64::from(i % 7)), ..reference_input() }).collect();
    for (input, together) in inputs.iter().zip(prepared.predict_all(&inputs)) {
        assert_eq!(prepared.predict(input), together);
    }
}
