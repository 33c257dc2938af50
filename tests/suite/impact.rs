//! The impact model from outside: the rigid base against an independent solution, laws every effect keeps, the model file.

use crate::impact_scene::{ball, impacts, racket};
use nalgebra::{Matrix3, Vector3};
use std::path::Path;
use sweetspot::impact::card::Role;
use sweetspot::impact::{Base, ImpactInput, ImpactOutput, Model, ModelError, catalogue, model_file};

fn rigid(restitution: f64, friction: f64) -> Model {
    let mut model = Model::new(Base::Rigid);
    model.set("restitution", restitution).unwrap();
    model.set("friction", friction).unwrap();
    model
}

fn predict(model: &Model, inputs: &[ImpactInput]) -> Vec<ImpactOutput> {
    model.prepare(&racket(), &ball()).unwrap().predict_all(inputs).into_iter().map(Result::unwrap).collect()
}

/// The contract's sentences solved another way: full 6-velocity states, a K built by pushing with unit impulses, bisection
/// for the normal impulse instead of a formula.
fn independent(input: &ImpactInput, restitution: f64, friction: f64) -> ImpactOutput {
    let (racket, ball) = (racket(), ball());
    let (m, r) = (ball.mass_kg, ball.diameter_m / 2.0);
    let ib = ball.inertia_factor * m * r * r;
    let mass = racket.mass_kg;
    let d = racket.balance_m - 0.10;
    let iy = racket.swingweight_kgm2 - mass * d * d;
    let iz = racket.swingweight_kgm2 + racket.twistweight_kgm2 - mass * d * d;
    let inverse = Matrix3::from_diagonal(&Vector3::new(1.0 / racket.twistweight_kgm2, 1.0 / iy, 1.0 / iz));
    let com = Vector3::new(racket.stringbed_centre_m - racket.balance_m, 0.0, 0.0);
    let point = Vector3::new(input.position.x, input.position.y, 0.0);
    let rho = point - com;
    let closing = (input.ball_velocity - input.racket_velocity - input.racket_rate.cross(&rho)).z;
    let arm = Vector3::new(0.0, 0.0, if closing < 0.0 { -r } else { r });
    let after = |j: &Vector3<f64>| ImpactOutput {
        ball_velocity: input.ball_velocity + j / m,
        ball_spin: input.ball_spin + arm.cross(j) / ib,
        racket_velocity: input.racket_velocity - j / mass,
        racket_rate: input.racket_rate - inverse * rho.cross(j),
        contact_time: None,
    };
    let slip = |o: &ImpactOutput| o.ball_velocity + o.ball_spin.cross(&arm) - o.racket_velocity - o.racket_rate.cross(&rho);
    let before = slip(&after(&Vector3::zeros()));
    let k = Matrix3::from_fn(|i, c| (slip(&after(&Matrix3::identity().column(c).into())) - before)[i]);
    let stick = k.try_inverse().unwrap() * Vector3::new(-before.x, -before.y, -(1.0 + restitution) * before.z);
    if stick.xy().norm() <= friction * stick.z.abs() {
        return after(&stick);
    }
    let t = Vector3::new(before.x, before.y, 0.0).normalize();
    let n = Vector3::new(0.0, 0.0, -before.z.signum());
    let push = |p: f64| after(&(p * (n - friction * t)));
    let (mut low, mut high) = (0.0, 100.0);
    for _ in 0..200 {
        let middle = 0.5 * (low + high);
        let gone = slip(&push(middle)).z / before.z < -restitution;
        if gone { high = middle } else { low = middle }
    }
    push(0.5 * (low + high))
}

fn difference(a: &ImpactOutput, b: &ImpactOutput) -> f64 {
    a.as_vector().iter().zip(b.as_vector()).map(|(x, y)| (x - y).abs() / (1.0 + x.abs())).fold(0.0, f64::max)
}

#[test]
fn agrees_rigid_base_with_an_independent_solution() {
    let inputs = impacts(20_000, 1);
    let (mut worst, mut slid) = (0.0f64, 0);
    for friction in [0.0, 0.12, 0.45, 1.5] {
        let outputs = predict(&rigid(0.83, friction), &inputs);
        for (i, o) in inputs.iter().zip(&outputs) {
            let other = independent(i, 0.83, friction);
            worst = worst.max(difference(o, &other));
            slid += usize::from(difference(&independent(i, 0.83, 100.0), &other) > 1e-6);
        }
    }
    assert!(worst < 1e-9, "worst relative difference {worst:e}");
    assert!(slid > 10_000, "both regimes must occur: {slid} slid");
}

#[test]
fn law_momentum_and_energy_of_the_base() {
    let (racket, ball) = (racket(), ball());
    let inertia = racket.inertia_kg_m2();
    let energy = |v: &Vector3<f64>, w: &Vector3<f64>, rv: &Vector3<f64>, rw: &Vector3<f64>| {
        0.5 * (ball.mass_kg * v.norm_squared()
            + ball.inertia_kg_m2() * w.norm_squared()
            + racket.mass_kg * rv.norm_squared()
            + rw.component_mul(&inertia).dot(rw))
    };
    for (i, o) in impacts(5_000, 2).iter().zip(predict(&rigid(0.8, 0.4), &impacts(5_000, 2))) {
        let p = |b: &Vector3<f64>, r: &Vector3<f64>| ball.mass_kg * b + racket.mass_kg * r;
        let before = p(&i.ball_velocity, &i.racket_velocity);
        assert!((p(&o.ball_velocity, &o.racket_velocity) - before).norm() <= 1e-12 * before.norm().max(1.0));
        let closing = (i.ball_velocity - i.racket_velocity).z - (i.racket_rate.cross(&Vector3::new(i.position.x - 0.1675, i.position.y, 0.0))).z;
        let from_com = Vector3::new(i.position.x - 0.1675, i.position.y, -closing.signum() * ball.radius_m());
        let l =
            |v: &Vector3<f64>, w: &Vector3<f64>, rw: &Vector3<f64>| ball.mass_kg * from_com.cross(v) + ball.inertia_kg_m2() * w + rw.component_mul(&inertia);
        let before = l(&i.ball_velocity, &i.ball_spin, &i.racket_rate);
        assert!((l(&o.ball_velocity, &o.ball_spin, &o.racket_rate) - before).norm() <= 1e-12 * before.norm().max(1.0));
        let lost = energy(&i.ball_velocity, &i.ball_spin, &i.racket_velocity, &i.racket_rate)
            - energy(&o.ball_velocity, &o.ball_spin, &o.racket_velocity, &o.racket_rate);
        assert!(lost > -1e-12, "energy gained: {lost}");
    }
}

const CONTRACT_NAMES: [&str; 27] = [
    "frame-vibration",
    "frame-torsion",
    "hand-mass",
    "grip-torque",
    "ball-damping",
    "momentum-flux",
    "ball-stiffening",
    "string-tension",
    "string-stiffening",
    "stringbed-edge",
    "string-damping",
    "lateral-strings",
    "offset-normal-force",
    "ball-deformation",
    "friction-law",
    "ball-wear",
    "swing-drive",
    "finite-contact",
    "string-tilt",
    "racket-inertia",
    "air-flight",
    "scale-error",
    "time-base-error",
    "face-plane-offset",
    "ball-centre-bias",
    "camera-skew",
    "window-bias",
];

#[test]
fn law_every_name_of_the_contract_has_a_complete_card() {
    assert_eq!(catalogue().iter().map(|c| c.name).collect::<Vec<_>>(), CONTRACT_NAMES);
    for card in catalogue() {
        for text in [card.physics, card.equation, card.source, card.signature, card.separated_by, card.bases.rigid, card.bases.viscoelastic] {
            assert!(text.len() > 5, "{}: an empty part", card.name);
        }
        assert!(card.physics.matches(". ").count() >= 1, "{}: two sentences", card.name);
        assert!(card.strengths().count() >= 1, "{}: no strength", card.name);
        assert!(!card.confused_with.is_empty());
        for other in card.confused_with {
            assert!(CONTRACT_NAMES.contains(other) && *other != card.name, "{}: confused with {other}", card.name);
            let back = catalogue().iter().find(|c| c.name == *other).unwrap();
            assert!(back.confused_with.contains(&card.name), "{other} does not name {} as {0} names it", card.name);
        }
        for p in card.parameters {
            assert!(p.min < p.max && (p.min..=p.max).contains(&p.default) && p.typical > 0.0, "{}.{}", card.name, p.name);
        }
    }
}

/// The model with one effect, its strengths all absent.
fn absent(base: &Model, name: &str) -> Model {
    let mut model = base.with_effect(name).unwrap();
    for i in model.effect_parameters(name) {
        if let Role::Strength { absent, .. } = model.parameters()[i].role {
            model.set_at(i, absent).unwrap();
        }
    }
    model
}

#[test]
fn switch_an_absent_effect_changes_nothing_and_a_present_one_something() {
    let inputs = impacts(400, 3);
    let base = rigid(0.8, 0.3);
    let plain = predict(&base, &inputs);
    for card in catalogue() {
        let off = absent(&base, card.name);
        assert_eq!(predict(&off, &inputs), plain, "{}: absent, yet it acts", card.name);
        for (k, p) in card.strengths() {
            let mut on = off.clone();
            let first = on.effect_parameters(card.name).start;
            on.set_at(first + k, p.typical).unwrap();
            let moved = predict(&on, &inputs).iter().zip(&plain).map(|(a, b)| difference(a, b)).fold(0.0, f64::max);
            // Rigid impulses have no time scale: all velocities and rates may be scaled together.
            let invisible = card.name == "time-base-error";
            assert!(invisible == (moved < 1e-9), "{}.{}: moves outputs by {moved:e}", card.name, p.name);
        }
    }
}

#[test]
fn law_predictions_are_differentiable_where_an_effect_is_absent() {
    // Impacts near the edge of sticking have a kink of their own; all others must have a derivative.
    let inputs: Vec<ImpactInput> = impacts(400, 4)
        .into_iter()
        .filter(|i| {
            difference(&independent(i, 0.8, 0.295), &independent(i, 0.8, 0.305)) < 1e-9
                || difference(&independent(i, 0.8, 0.27), &independent(i, 0.8, 100.0)) > 0.02
        })
        .collect();
    let base = rigid(0.8, 0.3);
    for card in catalogue() {
        let off = absent(&base, card.name);
        let plain = predict(&off, &inputs);
        for (k, p) in card.strengths() {
            let at = |h: f64| {
                let mut on = off.clone();
                let first = on.effect_parameters(card.name).start;
                on.set_at(first + k, h).unwrap();
                predict(&on, &inputs)
            };
            let h = 1e-4 * p.typical;
            let (whole, half) = (at(h), at(0.5 * h));
            for ((a, b), z) in whole.iter().zip(&half).zip(&plain) {
                for ((a, b), z) in a.as_vector().iter().zip(b.as_vector()).zip(z.as_vector()) {
                    let (da, db) = ((a - z) / h, (b - z) / (0.5 * h));
                    // A kink or a jump would make the two slopes differ by a fixed share.
                    assert!((da - db).abs() <= 2e-3 * (da.abs() + 1.0 / p.typical), "{}.{}: slopes {da} and {db}", card.name, p.name);
                }
            }
        }
    }
}

/// Mirrored across the racket's axis (y) and in its face (z): polar vectors change that component, axial ones the other two. No card may break
/// that, except lateral offsets by name; nothing knows a front of the racket.
#[test]
fn law_mirrored_impacts_end_mirrored() {
    for axis in [1, 2] {
        let mirror = |v: &Vector3<f64>| Vector3::from_fn(|i, _| if i == axis { -v[i] } else { v[i] });
        let axial = |v: &Vector3<f64>| -mirror(v);
        let across = if axis == 1 { -1.0 } else { 1.0 };
        for (base, count) in [(rigid(0.8, 0.3), 300), (Model::new(Base::Viscoelastic), 40)] {
            let inputs = impacts(count, 5);
            let mirrored: Vec<ImpactInput> = inputs
                .iter()
                .map(|i| ImpactInput {
                    ball_velocity: mirror(&i.ball_velocity),
                    ball_spin: axial(&i.ball_spin),
                    racket_velocity: mirror(&i.racket_velocity),
                    racket_rate: axial(&i.racket_rate),
                    position: nalgebra::Vector2::new(i.position.x, across * i.position.y),
                    ..*i
                })
                .collect();
            for card in catalogue() {
                // These name a direction of their own.
                if ["ball-centre-bias", "face-plane-offset", "camera-skew"].contains(&card.name) {
                    continue;
                }
                let Ok(mut model) = base.clone().with_effect(card.name) else { continue };
                for (k, p) in card.strengths() {
                    let first = model.effect_parameters(card.name).start;
                    model.set_at(first + k, 0.5 * p.typical).unwrap();
                }
                if card.name == "air-flight" {
                    // Gravity is mirrored with the rest of the scene.
                    model.set("air-flight.gravity_y", 0.0).unwrap();
                    model.set("air-flight.gravity_z", 0.0).unwrap();
                }
                for (a, b) in predict(&model, &inputs).iter().zip(predict(&model, &mirrored)) {
                    let back = ImpactOutput {
                        ball_velocity: mirror(&b.ball_velocity),
                        ball_spin: axial(&b.ball_spin),
                        racket_velocity: mirror(&b.racket_velocity),
                        racket_rate: axial(&b.racket_rate),
                        contact_time: a.contact_time,
                    };
                    assert!(difference(a, &back) < 1e-9, "{}, axis {axis}: {a:?} against {back:?}", card.name);
                }
            }
        }
    }
}

#[test]
fn law_thread_count_and_order_do_not_matter() {
    let inputs = impacts(3_000, 6);
    let model = rigid(0.8, 0.4).with_effect("string-tilt").unwrap().with_effect("frame-vibration").unwrap();
    let other = rigid(0.8, 0.4).with_effect("frame-vibration").unwrap().with_effect("string-tilt").unwrap();
    let run = |model: &Model, threads: usize| rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(|| predict(model, &inputs));
    let one = run(&model, 1);
    assert_eq!(one, run(&model, 3));
    assert_eq!(one, run(&other, 1));
}

#[test]
fn law_random_models_and_inputs_never_panic_or_return_nan() {
    use rand::{Rng, SeedableRng};
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(7);
    let inputs = impacts(1_000, 8);
    let mut answered = 0;
    for _ in 0..100 {
        let mut model = rigid(rng.random_range(0.0..=1.0), rng.random_range(0.0..=5.0));
        for card in catalogue() {
            if rng.random_bool(0.15) {
                model = model.with_effect(card.name).unwrap();
            }
        }
        for i in 0..model.parameters().len() {
            let p = &model.parameters()[i];
            let v = if rng.random_bool(0.1) { p.max } else { rng.random_range(p.min..=p.max) };
            model.set_at(i, v).unwrap();
        }
        let Ok(prepared) = model.prepare(&racket(), &ball()) else { continue };
        for result in prepared.predict_all(&inputs) {
            match result {
                Ok(o) => {
                    assert!(o.is_finite());
                    answered += 1;
                }
                Err(e) => assert!(!e.to_string().is_empty()),
            }
        }
    }
    assert!(answered > 50_000, "only {answered} of 100000 answered");
}

/// Restitution that falls toward the rim, as a programmer writes it.
#[derive(Debug)]
struct RimLoss;

impl<T: sweetspot::impact::Real> sweetspot::impact::Effect<T> for RimLoss {
    fn change_laws(&self, p: &[T], at: &sweetspot::impact::rigid::Contact<T>, laws: &mut sweetspot::impact::rigid::Laws<T>) {
        laws.restitution *= -(p[0] * (at.input.position.y / 0.13).powi(2)) + 1.0;
    }
}

#[test]
fn agrees_an_effect_of_the_trait_with_the_same_expression() {
    let mut own =
        rigid(0.85, 0.45).with_own_effect("rim-loss", std::sync::Arc::new(RimLoss), vec![sweetspot::impact::Parameter::own("rim-loss.k", 0.3)]).unwrap();
    let text = "base = \"rigid\"\n[parameters]\nrestitution = 0.85\nfriction = 0.45\n[effects.rim-loss]\nreplaces = \"restitution\"\n\
                expression = \"restitution * (1 - k * (impact_y / 0.13)^2)\"\nk = 0.3\n";
    let expression = Model::parse(text, Path::new("m.toml")).unwrap();
    let inputs = impacts(200, 12);
    for (a, b) in predict(&own, &inputs).iter().zip(predict(&expression, &inputs)) {
        assert!(difference(a, &b) < 1e-12);
    }
    own.set("rim-loss.k", 0.0).unwrap();
    assert_eq!(predict(&own, &inputs), predict(&rigid(0.85, 0.45), &inputs));
}

#[test]
fn fails_inputs_that_are_no_impact() {
    let prepared = rigid(0.8, 0.3).prepare(&racket(), &ball()).unwrap();
    let good = impacts(1, 9)[0];
    let strings = good.racket_velocity + good.racket_rate.cross(&Vector3::new(good.position.x - 0.1675, good.position.y, 0.0));
    let resting = ImpactInput { ball_velocity: strings, ..good };
    assert!(matches!(prepared.predict(&resting), Err(ModelError::NoApproach { .. })));
    let nan = ImpactInput { grip_torque: f64::NAN, ..good };
    assert!(matches!(prepared.predict(&nan), Err(ModelError::InputRange { .. })));
    let rpm = ImpactInput { ball_spin: good.ball_spin * 1e3, ..good };
    assert!(prepared.predict(&rpm).unwrap_err().to_string().contains("ball_in_w"));
    let mut negative = racket();
    negative.mass_kg = -0.3;
    assert!(matches!(rigid(0.8, 0.3).prepare(&negative, &ball()), Err(ModelError::Body { .. })));
}

const FILE: &str = "# my model\nbase = \"rigid\" # impulse\n\n[parameters]\nrestitution = { value = 0.85, fit = true, min = 0.3, max = 1.0 } # from drop test\nfriction = 0.45\n\n[effects.frame-vibration]\nfrequency_hz = { value = 140.0, fit = true }\n";

#[test]
fn truth_model_file_is_read_and_changed_without_losing_comments() {
    let path = Path::new("m.toml");
    let model = Model::parse(FILE, path).unwrap();
    let free: Vec<&str> = model.parameters().iter().filter(|p| p.fit).map(|p| p.name.as_str()).collect();
    assert_eq!(free, ["restitution", "frame-vibration.frequency_hz"]);
    let text = model_file::with_effect_added(FILE, "grip-torque", path).unwrap();
    assert!(text.contains("# my model") && text.contains("# impulse") && text.contains("# from drop test"), "{text}");
    assert_eq!(Model::parse(&text, path).unwrap().parameters(), {
        let mut m = model.with_effect("grip-torque").unwrap();
        for i in m.effect_parameters("grip-torque") {
            let shape = m.parameters()[i].role == Role::Shape;
            m.parameter_mut(i).unwrap().fit = !shape;
        }
        m.parameters().to_vec()
    });
    let values = [("restitution".to_owned(), 0.8125), ("frame-vibration.amount".to_owned(), 0.5), ("friction".to_owned(), 0.5)];
    let text = model_file::with_values(&text, &values, path).unwrap();
    assert!(text.contains("value = 0.8125, fit = true") && text.contains("# from drop test"), "{text}");
    let back = Model::parse(&text, path).unwrap();
    for (name, value) in values {
        assert_eq!(back.parameters()[back.index_of(&name).unwrap()].value, value);
    }
}

/// A friction at which nothing slips may be stated, though none so large is fitted.
#[test]
fn switch_a_friction_beyond_any_makes_every_ball_stick() {
    let model = |friction: f64| Model::parse(&format!("base = \"rigid\"\n[parameters]\nfriction = {friction}\n"), Path::new("m.toml")).unwrap();
    assert_eq!(Model::new(Base::Rigid).parameters()[1].max, 5.0);
    let [large, larger] = [60.0, 900.0].map(|friction| model(friction).prepare(&racket(), &ball()).unwrap().predict(&impacts(1, 3)[0]).unwrap());
    assert_eq!(large, larger);
}

#[test]
fn fails_model_files_name_the_key_and_its_neighbours() {
    for (from, to, words) in [
        ("friction", "fricton", ["`fricton`", "`friction`"]),
        ("frame-vibration", "frame-vibrations", ["frame-vibrations", "did you mean `frame-vibration`"]),
        ("\"rigid\"", "\"solid\"", ["solid", "viscoelastic"]),
        ("value = 0.85", "value = 1.85", ["1.85", "0.3 to 1"]),
        ("fit = true, min", "fit = 1, min", ["parameters.restitution.fit", "true or false"]),
        ("frequency_hz", "frequency", ["`frequency`", "frequency_hz"]),
        ("[effects.frame-vibration]", "[effects.own]\nreplaces = \"restitution\"\nexpresion = \"0.9\"", ["effects.own.expression", "`expresion` holds one"]),
        ("0.45", "nan", ["parameters.friction", "0 to 1000000"]),
        ("[parameters]", "[parameters", ["m.toml", "line 4"]),
    ] {
        let message = Model::parse(&FILE.replacen(from, to, 1), Path::new("m.toml")).unwrap_err().to_string();
        assert!(words.iter().all(|w| message.contains(w)), "{message}");
    }
}
