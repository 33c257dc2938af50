//! Users' own effects: expressions in the model file.

use crate::impact_scene::{ball, impacts, racket};
use rand::{Rng, SeedableRng};
use std::path::Path;
use sweetspot::equipment_set::EquipmentSet;
use sweetspot::impact::batch::predict_table;
use sweetspot::impact::expression::{channels, quantities};
use sweetspot::impact::{Base, ImpactInput, ImpactOutput, Model, ModelError};
use sweetspot::impact_table::OwnColumns;
use sweetspot::impact_table::{ImpactRow, ImpactTable, Measured};

const BASE: &str = "base = \"rigid\"\n[parameters]\nrestitution = 0.8\nfriction = 0.3\n";
const STEPPED: &str = "base = \"viscoelastic\"\n[parameters]\nmu = 0.3\n";

fn parse(effects: &str) -> Result<Model, ModelError> {
    Model::parse(&format!("{BASE}{effects}"), Path::new("m.toml"))
}

fn predict(effects: &str, inputs: &[ImpactInput]) -> Vec<ImpactOutput> {
    outcomes(&parse(effects).unwrap(), inputs)
}

/// By the text of a whole model file, in either base.
fn predict_whole(model: &str, inputs: &[ImpactInput]) -> Vec<ImpactOutput> {
    outcomes(&Model::parse(model, Path::new("m.toml")).unwrap(), inputs)
}

fn outcomes(model: &Model, inputs: &[ImpactInput]) -> Vec<ImpactOutput> {
    model.prepare(&racket(), &ball()).unwrap().predict_all(inputs).into_iter().map(Result::unwrap).collect()
}

fn close(a: &[ImpactOutput], b: &[ImpactOutput], tolerance: f64) {
    for (a, b) in a.iter().zip(b) {
        for (x, y) in a.as_vector().iter().zip(b.as_vector()) {
            assert!((x - y).abs() <= tolerance * (1.0 + x.abs()), "{a:?} against {b:?}");
        }
    }
}

#[test]
fn agrees_expressions_with_the_catalogue() {
    let inputs = impacts(300, 21);
    for (catalogue, own) in [
        (
            "[effects.stringbed-edge]\ndrop = 0.1",
            "[effects.mine]\nexpression = \"restitution - k * ((impact_x / half_length)^2 + (impact_y / half_width)^2)\"\nreplaces = \"restitution\"\nk = 0.1",
        ),
        (
            "[effects.ball-damping]\nfall = 0.1",
            "[effects.mine]\nexpression = \"restitution - 0.1 * (sqrt(approach_speed / 25) - 1)\"\nreplaces = \"restitution\"",
        ),
        ("[effects.lateral-strings]\nacross = 0.2", "[effects.mine]\nexpression = \"0.2\"\nreplaces = \"tangential_restitution_y\""),
        // What both diagonals do alike is done in every direction.
        (
            "[effects.lateral-strings]\nacross = 0.2\nalong = 0.2",
            "[effects.mine]\nexpression = \"0.2\"\nreplaces = \"tangential_restitution_diagonal\"\n\
             [effects.other]\nexpression = \"0.2\"\nreplaces = \"tangential_restitution_antidiagonal\"",
        ),
        ("[effects.hand-mass]\nmass_kg = 0.15", "[effects.mine]\nexpression = \"m\"\nreplaces = \"hand_mass\"\nm = { value = 0.15, min = 0, max = 1 }"),
        ("[effects.swing-drive]\nforce_n = 80", "[effects.mine]\nexpression = \"drive_z + side * force * contact_time\"\nreplaces = \"drive_z\"\nforce = 80"),
        ("[effects.racket-inertia]\ntwist = 0.1", "[effects.mine]\nexpression = \"1.1 * twist_inertia\"\nreplaces = \"twist_inertia\""),
        (
            "[effects.friction-law]\nslip_exponent = 0\nload_exponent = 0.3",
            "[effects.mine]\nexpression = \"friction * (approach_speed / 25)^0.3\"\nreplaces = \"friction\"",
        ),
    ] {
        close(&predict(catalogue, &inputs), &predict(own, &inputs), 1e-12);
    }
}

#[test]
fn switch_every_channel_acts_and_leaves_everything_alone_at_its_own_value() {
    let inputs = impacts(60, 22);
    for (base, first) in [(Base::Rigid, BASE), (Base::Viscoelastic, STEPPED)] {
        let plain = predict_whole(first, &inputs);
        let (there, elsewhere): (Vec<_>, Vec<_>) = channels().iter().partition(|c| c.is_in(base));
        for c in there {
            let mine = |expression: &str| format!("{first}[effects.mine]\nexpression = \"{expression}\"\nreplaces = \"{}\"", c.name);
            close(&plain, &predict_whole(&mine(c.name), &inputs), 1e-12);
            let typical = match c.unit {
                "m" => "1e-3",
                "kg" | "N s" => "0.01",
                "kg m^2" => "1e-4",
                "N m s" => "1e-3",
                "m/s" | "rad/s" => "0.5",
                "N/m" | "N s/m^3" => "100",
                _ => "0.01",
            };
            let moved = predict_whole(&mine(&format!("{} + {typical}", c.name)), &inputs);
            let acts = c.name == "face_time" && moved != plain
                || plain.iter().zip(&moved).any(|(a, b)| a.as_vector().iter().zip(b.as_vector()).any(|(x, y)| (x - y).abs() > 1e-6));
            assert!(acts, "{} does nothing in base {base:?}", c.name);
        }
        for c in elsewhere {
            let text = format!("{first}[effects.mine]\nexpression = \"{0}\"\nreplaces = \"{0}\"", c.name);
            let error = Model::parse(&text, Path::new("m.toml")).unwrap_err().to_string();
            assert!(error.contains(c.name) && error.contains("normal_impulse"), "{error}");
        }
    }
}

/// Laws of the stepped contact replaced by formulae do what the base's own parameters do; restitution is asked of what the contact came to.
#[test]
fn agrees_formulae_in_the_stepped_base_with_its_parameters() {
    let inputs = impacts(80, 25);
    let stepped = |parameters: &str, effect: &str| predict_whole(&format!("base = \"viscoelastic\"\n[parameters]\n{parameters}\n{effect}"), &inputs);
    for (name, value, own) in [
        ("mu", 0.3, "friction"),
        ("kS0", 39e3, "string_stiffness"),
        ("c_S", 2.0, "string_damping"),
        ("k_B0", 21e3, "ball_stiffness"),
        ("A_C", 1200.0, "ball_damping"),
    ] {
        let formula = format!("[effects.mine]\nexpression = \"{own} * 1.1\"\nreplaces = \"{own}\"");
        close(&stepped(&format!("{name} = {}", 1.1 * value), ""), &stepped(&format!("{name} = {value}"), &formula), 1e-9);
    }
    let (racket, ball) = (racket(), ball());
    let plain = stepped("mu = 0.3", "");
    let lossy = stepped("mu = 0.3", "[effects.mine]\nexpression = \"restitution * 0.9\"\nreplaces = \"restitution\"");
    for ((input, plain), lossy) in inputs.iter().zip(plain).zip(lossy) {
        let at = |o: &ImpactOutput| {
            let lever = nalgebra::Vector3::new(input.position.x - racket.com_local().x, input.position.y, 0.0);
            (o.ball_velocity - o.racket_velocity - o.racket_rate.cross(&lever)).z
        };
        assert!((at(&lossy) - 0.9 * at(&plain)).abs() < 1e-9, "{lossy:?} beside {plain:?}");
        let p = |o: &ImpactOutput| ball.mass_kg * o.ball_velocity + racket.mass_kg * o.racket_velocity;
        assert!((p(&lossy) - p(&plain)).norm() < 1e-12);
    }
    for expression in ["friction * restitution", "friction + 0 * impulse_x / normal_impulse"] {
        let text = format!("{STEPPED}[effects.mine]\nexpression = \"{expression}\"\nreplaces = \"friction\"");
        let error = Model::parse(&text, Path::new("m.toml")).unwrap_err().to_string();
        assert!(error.contains("not known"), "{error}");
    }
    // A stringbed of no stiffness is no contact: which effect, which law, its value.
    let text = format!("{STEPPED}[effects.mine]\nexpression = \"string_stiffness * (1 - 2 * step(impact_x))\"\nreplaces = \"string_stiffness\"");
    let slack = Model::parse(&text, Path::new("m.toml")).unwrap().prepare(&racket, &ball).unwrap();
    for (input, outcome) in inputs.iter().zip(slack.predict_all(&inputs)) {
        match outcome {
            Ok(_) => assert!(input.position.x < 0.0),
            Err(e) => assert!(input.position.x >= 0.0 && e.to_string().contains("`mine`: `string_stiffness` became -"), "{e}"),
        }
    }
}

#[test]
fn law_contact_impulses_keep_momentum() {
    let inputs = impacts(60, 23);
    let (racket, ball) = (racket(), ball());
    for channel in ["normal_impulse", "impulse_x", "impulse_y"] {
        let outputs = predict(&format!("[effects.mine]\nexpression = \"{channel} + 0.02\"\nreplaces = \"{channel}\""), &inputs);
        for (i, o) in inputs.iter().zip(outputs) {
            let p = |b: nalgebra::Vector3<f64>, r: nalgebra::Vector3<f64>| ball.mass_kg * b + racket.mass_kg * r;
            assert!((p(i.ball_velocity, i.racket_velocity) - p(o.ball_velocity, o.racket_velocity)).norm() < 1e-12);
        }
    }
}

#[test]
fn law_every_quantity_can_be_used_and_is_finite() {
    let inputs = impacts(40, 24);
    for q in quantities() {
        // `step` drops the dimension; times zero it changes nothing unless the quantity is NaN.
        let text =
            format!("[effects.mine]\nexpression = \"ball_out_vx * (1 + 0 * step({0})) + 0 * ball_out_vx * sign({0})\"\nreplaces = \"ball_out_vx\"", q.name);
        close(&predict("", &inputs), &predict(&text, &inputs), 1e-12);
        assert!(!q.meaning.is_empty());
    }
}

/// A column of the user's own in a table: each impact has its number; one that lacks it has no prediction, with the reason.
#[test]
fn switch_a_column_of_the_table_acts_on_each_impact_by_its_number() {
    let own = "[effects.mine]\nexpression = \"restitution + 0.01 * (column.tension - 50)\"\nreplaces = \"restitution\"";
    let columns = |text: &str| [("tension".to_owned(), text.to_owned())].into();
    let mut inputs = impacts(20, 31);
    inputs.iter_mut().for_each(|i| i.own = OwnColumns::of(&columns("54.0"), &[]));
    close(&predict(own, &inputs), &predict("[effects.mine]\nexpression = \"restitution + 0.04\"\nreplaces = \"restitution\"", &inputs), 1e-12);
    let model = parse(own).unwrap();
    assert_eq!(model.own_columns(), ["tension"]);
    let row = |text: Option<&str>| {
        let mut row = ImpactRow::new("a");
        for (column, value) in [("ball_in_vx", 1.0), ("ball_in_vy", 0.0), ("ball_in_vz", -25.0), ("impact_x", 0.01), ("impact_y", 0.0)] {
            row.set(column, Some(Measured { value, sd: None }));
        }
        ["racket_in_vx", "racket_in_vy", "racket_in_vz", "racket_in_wx", "racket_in_wy", "racket_in_wz"].iter().for_each(|c| {
            row.set(c, Some(Measured { value: 0.0, sd: None }));
        });
        row.groups = text.map(columns).unwrap_or_default();
        row
    };
    let set = EquipmentSet { rackets: vec![racket()], balls: vec![ball()] };
    let outcomes = predict_table(&model, &set, &ImpactTable { rows: vec![row(Some("54")), row(Some("tight"))], ..ImpactTable::default() }).unwrap();
    assert!(outcomes[0].is_ok());
    let why = outcomes[1].as_ref().unwrap_err().to_string();
    assert!(why.contains("`tension` is \"tight\""), "{why}");
    let none = predict_table(&model, &set, &ImpactTable { rows: vec![row(None)], ..ImpactTable::default() }).unwrap_err().to_string();
    assert!(none.contains("column.tension"), "{none}");
    for (wrong, said) in
        [("column.spin * restitution", "write it without"), ("column * restitution", "name of a column"), ("tension * restitution", "`column.NAME`")]
    {
        let error = parse(&format!("[effects.mine]\nexpression = \"{wrong}\"\nreplaces = \"restitution\"")).unwrap_err().to_string();
        assert!(error.contains(said), "{wrong}: {error}");
    }
}

#[test]
fn fails_expressions_say_where() {
    for (effect, words) in [
        ("expression = \"restitution + impact_x\"\nreplaces = \"restitution\"", ["cannot be added", "            ^"]),
        ("expression = \"1\"\nreplaces = \"restitutio\"", ["restitutio", "did you mean `restitution`"]),
        ("expression = \"1\"", ["effects.mine.replaces", "missing"]),
        ("expression = \"k\"\nreplaces = \"restitution\"\nk = { value = 2.0, min = 3.0, max = 4.0 }", ["effects.mine.k.value", "3 to 4"]),
        ("expression = \"k\"\nreplaces = \"restitution\"\nk = \"a\"", ["effects.mine.k", "a number"]),
        ("expression = \"restitution - k\"\nreplaces = \"restitution\"\nk = 0.1\nk2 = 0.2", ["`effects.mine.k2`", "not in the expression"]),
        ("expression = \"column.k\"\nreplaces = \"restitution\"\nk = 0.1", ["`effects.mine.k`", "not in the expression"]),
        ("expression = \"1 +\"\nreplaces = \"restitution\"", ["ends", "1 +"]),
        ("expression = \"0.9 restitution\"\nreplaces = \"restitution\"", ["a product is written `a * b`", "      ^"]),
        ("expression = \"2 (restitution)\"\nreplaces = \"restitution\"", ["a product is written `a * b`", "    ^"]),
        ("expression = \"restitution − 0.1\"\nreplaces = \"restitution\"", ["minus is written `-`", "              ^"]),
        ("expression = \"restitution * 90 %\"\nreplaces = \"restitution\"", ["written as a number, 0.9", "^"]),
    ] {
        let message = parse(&format!("[effects.mine]\n{effect}")).unwrap_err().to_string();
        assert!(words.iter().all(|w| message.contains(w)), "{message}");
    }
    let own = "[effects.hand-mass]\nexpression = \"1\"\nreplaces = \"restitution\"";
    assert!(parse(own).unwrap_err().to_string().contains("in the catalogue"));
    // Not a number: the error names the effect.
    let model = parse("[effects.mine]\nexpression = \"ln(-1 * obliqueness)\"\nreplaces = \"friction\"").unwrap();
    let error = model.prepare(&racket(), &ball()).unwrap().predict(&impacts(1, 25)[0]).unwrap_err();
    assert!(error.to_string().contains("`mine`"), "{error}");
    let model = parse("[effects.mine]\nexpression = \"racket_mass - 5\"\nreplaces = \"racket_mass\"").unwrap();
    assert!(matches!(model.prepare(&racket(), &ball()).unwrap().predict(&impacts(1, 25)[0]), Err(ModelError::Body { .. })));
}

#[test]
fn fails_more_effects_or_free_parameters_than_a_fit_can_bear_are_refused() {
    let effects = |n: usize, own: usize, fit: bool| -> String {
        let names: Vec<String> = (0..own).map(|k| format!("k{k}")).collect();
        let parameters: String = names.iter().map(|k| format!("{k} = {{ value = 0.0, fit = {fit} }}\n")).collect();
        let formula = format!("expression = \"restitution + {}\"\nreplaces = \"restitution\"", names.join(" + "));
        (0..n).map(|i| format!("[effects.e{i}]\n{formula}\n{parameters}")).collect()
    };
    let told = |text: &str| parse(text).unwrap_err().to_string();
    assert!(told(&effects(257, 1, false)).contains("m.toml: `effects` is 257 tables; allowed: at most 256"));
    let message = told(&effects(10, 60, true));
    assert!(message.contains("m.toml: `fit` is true for 60") && message.contains("allowed: at most 500"), "{message}");
    assert!(parse(&effects(10, 60, false)).is_ok());
}

#[test]
fn fails_random_text_never_panics() {
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(26);
    let pieces = ["restitution", "impact_x", "(", ")", "+", "-", "*", "/", "^", "2", ".", "e", "max", ",", "sqrt(", " ", "é", "k", "1e5", "\\u0000"];
    for _ in 0..20_000 {
        let n = rng.random_range(0..12);
        let text: String = (0..n).map(|_| pieces[rng.random_range(0..pieces.len())]).collect();
        let _ = parse(&format!("[effects.mine]\nexpression = \"{text}\"\nreplaces = \"restitution\"\nk = 0.5")).and_then(|m| {
            let prepared = m.prepare(&racket(), &ball())?;
            for input in impacts(2, 27) {
                let _ = prepared.predict(&input);
            }
            Ok(())
        });
    }
}
