//! The visco-elastic base from outside: catalogue, limits, robustness.

use crate::impact_scene::{ball, impacts, racket};
use rand::{Rng, SeedableRng};
use sweetspot::impact::card::Role;
use sweetspot::impact::viscoelastic::{BallLaw, FrictionDirection, NormalForce, Release, StringLaw};
use sweetspot::impact::{Base, ImpactInput, ImpactOutput, Model, ModelError, catalogue};

fn predict(model: &Model, inputs: &[ImpactInput]) -> Vec<ImpactOutput> {
    model.prepare(&racket(), &ball()).unwrap().predict_all(inputs).into_iter().map(Result::unwrap).collect()
}

fn difference(a: &ImpactOutput, b: &ImpactOutput) -> f64 {
    a.as_vector().iter().zip(b.as_vector()).map(|(x, y)| (x - y).abs() / (1.0 + x.abs())).fold(0.0, f64::max)
}

#[test]
fn switch_catalogue_in_the_viscoelastic_base() {
    let inputs = impacts(60, 31);
    let base = Model::new(Base::Viscoelastic);
    let plain = predict(&base, &inputs);
    for card in catalogue() {
        let mut off = base.with_effect(card.name).unwrap();
        for i in off.effect_parameters(card.name) {
            if let Role::Strength { absent, .. } = off.parameters()[i].role {
                off.set_at(i, absent).unwrap();
            }
        }
        assert_eq!(predict(&off, &inputs), plain, "{}: absent, yet it acts", card.name);
        let first = off.effect_parameters(card.name).start;
        for (k, p) in card.strengths() {
            let mut on = off.clone();
            on.set_at(first + k, p.typical).unwrap();
            let moved = predict(&on, &inputs).iter().zip(&plain).map(|(a, b)| difference(a, b)).fold(0.0, f64::max);
            // The contact has a duration of its own here.
            assert!((card.name == "finite-contact") == (moved < 1e-6), "{}.{}: moves outputs by {moved:e}", card.name, p.name);
        }
    }
}

/// A frictionless contact comes nearer to the rigid impulse the harder it is: the face turns during a contact of T seconds,
/// which an impulse cannot know, so the difference falls with T, i.e. with one over the square root of the stiffness.
#[test]
fn ladder_a_harder_contact_comes_nearer_to_the_rigid_impulse() {
    let inputs = impacts(40, 32);
    let worst = |harder: f64| {
        let mut hard = Model::new(Base::Viscoelastic);
        for (name, value) in [
            ("mu", 0.0),
            ("k_B0", 3e7 * harder),
            ("A_K", 0.0),
            ("A_C", 0.0),
            ("c_B0", 0.0),
            ("kS0", 3e8 * harder),
            ("kS2", 0.0),
            ("c_S", 50.0),
            ("lambda_r", 0.0),
            ("kappa_I", 0.0),
        ] {
            hard.set(name, value).unwrap();
        }
        let prepared = hard.prepare(&racket(), &ball()).unwrap();
        let mut worst: f64 = 0.0;
        for input in &inputs {
            let o = prepared.predict(input).unwrap();
            let com = racket().com_local();
            let lever = nalgebra::Vector3::new(input.position.x - com.x, input.position.y, 0.0);
            let normal = |b: &nalgebra::Vector3<f64>, v: &nalgebra::Vector3<f64>, w: &nalgebra::Vector3<f64>| (b - v - w.cross(&lever)).z;
            let e = -normal(&o.ball_velocity, &o.racket_velocity, &o.racket_rate) / normal(&input.ball_velocity, &input.racket_velocity, &input.racket_rate);
            let mut rigid = Model::new(Base::Rigid);
            rigid.set("restitution", e.clamp(0.0, 1.0)).unwrap();
            rigid.set("friction", 0.0).unwrap();
            let r = rigid.prepare(&racket(), &ball()).unwrap().predict(input).unwrap();
            worst = worst.max(difference(&o, &r));
        }
        worst
    };
    let (soft, hard) = (worst(0.25), worst(4.0));
    // Sixteen times the stiffness: a quarter of the contact time.
    assert!(hard < 0.35 * soft, "difference from the rigid impulse {soft} falls to {hard} only");
}

#[test]
fn law_random_parameters_never_hang_panic_or_return_nan() {
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(33);
    let inputs = impacts(1000, 34);
    let (mut answered, mut refused) = (0, 0);
    for _ in 0..100 {
        let mut model = Model::new(Base::Viscoelastic);
        for i in 0..model.parameters().len() {
            // Two thirds of the parameters move within a factor of three of their defaults, as far as the documented range goes.
            let p = &model.parameters()[i];
            let value = if rng.random_bool(0.33) { p.value } else { (p.value * 3f64.powf(rng.random_range(-1.0..1.0))).clamp(p.min, p.max) };
            model.set_at(i, value).unwrap();
        }
        for result in model.prepare(&racket(), &ball()).unwrap().predict_all(&inputs) {
            match result {
                Ok(o) => {
                    assert!(o.is_finite() && o.contact_time.unwrap() > 0.0);
                    answered += 1;
                }
                Err(e) => {
                    assert!(matches!(e, ModelError::NoRelease { .. } | ModelError::NotFinite | ModelError::NoApproach { .. }), "{e}");
                    refused += 1;
                }
            }
        }
    }
    assert!(answered > 95_000, "{answered} answered, {refused} refused");
}

/// The same with effects at random places of their documented ranges and the older laws: 100 000 impacts.
#[test]
fn law_random_effects_and_laws_never_hang_panic_or_return_nan() {
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(37);
    let inputs = impacts(500, 38);
    let (mut answered, mut asked, mut k) = (0, 0, 0);
    while asked < 100_000 {
        let mut model = Model::new(Base::Viscoelastic);
        model.set_ball_law([BallLaw::Goodwill, BallLaw::KelvinVoigt, BallLaw::LeighLui][k % 3]).unwrap();
        model.set_string_law([StringLaw::Goodwill, StringLaw::KelvinVoigt, StringLaw::LeighLui][k / 3 % 3]).unwrap();
        k += 1;
        let laws = model.contact_laws_mut();
        laws.normal_force = if rng.random_bool(0.3) { NormalForce::Haake } else { NormalForce::Central };
        laws.friction_direction = if rng.random_bool(0.3) { FrictionDirection::Projected } else { FrictionDirection::Slip };
        for card in catalogue() {
            if rng.random_bool(0.12) {
                model = model.with_effect(card.name).unwrap();
                for (at, p) in model.effect_parameters(card.name).zip(card.parameters) {
                    let value = match rng.random_range(0..20) {
                        0 => p.max,
                        1 => p.min,
                        2..6 => rng.random_range(p.min..=p.max),
                        // Within three typical sizes of the default.
                        _ => (p.default + p.typical * rng.random_range(-3.0..3.0)).clamp(p.min, p.max),
                    };
                    model.set_at(at, value).unwrap();
                }
            }
        }
        let prepared = match model.prepare(&racket(), &ball()) {
            Ok(prepared) => prepared,
            // Parameters that leave no mass or inertia, or no beam that has them.
            Err(e) => {
                assert!(matches!(e, ModelError::Body { .. }), "{e}");
                continue;
            }
        };
        for result in prepared.predict_all(&inputs) {
            asked += 1;
            match result {
                Ok(o) => {
                    assert!(o.is_finite() && o.contact_time.unwrap() > 0.0);
                    answered += 1;
                }
                Err(e) => assert!(
                    matches!(e, ModelError::NoRelease { .. } | ModelError::NotFinite | ModelError::NoApproach { .. } | ModelError::EffectRange { .. }),
                    "{e}"
                ),
            }
        }
    }
    eprintln!("{answered} of {asked} answered, {k} models");
    assert!(answered > asked / 2, "{answered} of {asked} answered");
}

/// The model file chooses among the published laws; a law brings its own defaults, which the file may overrule.
#[test]
fn law_the_model_file_chooses_ball_and_string_laws() {
    let path = std::path::Path::new("model.toml");
    let read = |text: &str| Model::parse(&format!("base = \"viscoelastic\"\n[parameters]\n{text}"), path);
    let value = |m: &Model, name: &str| m.parameters()[m.index_of(name).unwrap()].value;
    let kelvin_voigt = read("ball_law = \"kelvin-voigt\"\nstring_law = \"leigh-lui\"\nc_B0 = 12.5").unwrap();
    assert_eq!(kelvin_voigt.contact_laws().ball, BallLaw::KelvinVoigt);
    assert_eq!(kelvin_voigt.contact_laws().release, Release::Displacement);
    assert_eq!((value(&kelvin_voigt, "k_B0"), value(&kelvin_voigt, "c_B0"), value(&kelvin_voigt, "c_S")), (45.3e3, 12.5, 0.0));
    let pushed = read("ball_law = \"kelvin-voigt\"\nrelease = \"force\"\nnormal_force = \"haake\"\nfriction_direction = \"projected\"").unwrap();
    assert_eq!(pushed.contact_laws().release, Release::Force);
    assert_eq!(pushed.contact_laws().normal_force, NormalForce::Haake);
    assert_eq!(pushed.contact_laws().friction_direction, FrictionDirection::Projected);
    let wrong = read("ball_law = \"hertz\"").unwrap_err().to_string();
    assert!(wrong.contains("model.toml") && wrong.contains("hertz") && wrong.contains("kelvin-voigt"), "{wrong}");
    let rigid = Model::parse("base = \"rigid\"\n[parameters]\nball_law = \"goodwill\"", path).unwrap_err().to_string();
    assert!(rigid.contains("ball_law"), "{rigid}");
}

#[test]
fn fails_a_contact_without_release_is_said() {
    let mut sticky = Model::new(Base::Viscoelastic);
    sticky.set("k_B0", 1e3).unwrap();
    sticky.set("kS0", 5e3).unwrap();
    sticky.set("A_K", 0.0).unwrap();
    sticky.set("kS2", 0.0).unwrap();
    let mut heavy = ball();
    heavy.mass_kg = 1.0;
    let result = sticky.prepare(&racket(), &heavy).unwrap().predict(&impacts(1, 35)[0]);
    assert!(matches!(result, Err(ModelError::NoRelease { .. })), "{result:?}");
}

/// What is no impact is refused before a step is taken, and says what was seen and what is allowed.
#[test]
fn fails_inputs_that_are_no_impact() {
    let good = impacts(1, 39)[0];
    for base in [Base::Rigid, Base::Viscoelastic] {
        let model = Model::new(base);
        let prepared = model.prepare(&racket(), &ball()).unwrap();
        let com = racket().com_local();
        let strings = good.racket_velocity + good.racket_rate.cross(&nalgebra::Vector3::new(good.position.x - com.x, good.position.y, 0.0));
        let along = ImpactInput { ball_velocity: strings + nalgebra::Vector3::new(3.0, 4.0, 0.0), ..good };
        let e = prepared.predict(&along).unwrap_err();
        assert!(matches!(e, ModelError::NoApproach { .. }) && e.to_string().contains("must move toward"), "{e}");
        let mut negative = ball();
        negative.mass_kg = -0.0577;
        let e = model.prepare(&racket(), &negative).unwrap_err();
        assert!(matches!(e, ModelError::Body { .. }) && e.to_string().contains("ball mass"), "{e}");
        let mut hand = model.with_effect("hand-mass").unwrap();
        hand.set("hand-mass.mass_kg", -1.0).unwrap();
        let e = hand.prepare(&racket(), &ball()).unwrap_err();
        assert!(matches!(e, ModelError::Body { .. }), "{e}");
        let slow = prepared.predict(&ImpactInput { ball_velocity: good.ball_velocity * f64::INFINITY, ..good });
        assert!(matches!(slow, Err(ModelError::InputRange { .. })), "{slow:?}");
    }
}

#[test]
fn law_threads_do_not_matter_in_lanes() {
    let inputs = impacts(700, 36);
    let model = Model::new(Base::Viscoelastic);
    let run = |threads: usize| rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(|| predict(&model, &inputs));
    assert_eq!(run(1), run(3));
}

/// Bodies that an expression makes depend on the impact are stepped in lanes too.
#[test]
fn law_neighbours_do_not_matter_where_bodies_vary() {
    let inputs = impacts(70, 37);
    let text = "base = \"viscoelastic\"\n[effects.own]\nexpression = \"racket_mass * (1 - 0.2 * (impact_x / half_length)^2)\"\nreplaces = \"racket_mass\"\n";
    let prepared = Model::parse(text, std::path::Path::new("model.toml")).unwrap().prepare(&racket(), &ball()).unwrap();
    let alone: Vec<ImpactOutput> = inputs.iter().map(|input| prepared.predict(input).unwrap()).collect();
    assert_eq!(prepared.predict_all(&inputs).into_iter().map(Result::unwrap).collect::<Vec<_>>(), alone);
}
