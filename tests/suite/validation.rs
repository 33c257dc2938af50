//! Compare, diagnose, add, fit: on the practice tables, on seeded tables of a world that shares no physics with the
//! model, and from the command line. Error rates over many tables are measured by `examples/error_rates.rs` and published
//! in docs/diagnosis.md; here stand few tables, chosen before they were run (seeds 1, 2, ...).

use crate::shared::shared;
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use std::path::{Path, PathBuf};
use std::process::Command;
use sweetspot::equipment::{Ball, Racket};
use sweetspot::equipment_set::EquipmentSet;
use sweetspot::impact::batch::predict_table;
use sweetspot::impact::{ImpactInput, Model};
use sweetspot::impact_table::{INPUTS, ImpactRow, ImpactTable, Measured, OUTPUTS};
use sweetspot::synthetic::hidden::Hidden;
use sweetspot::synthetic::impact_world::{Kind, SyntheticTable, TableSpec, generate_table};
use sweetspot::synthetic::measurement::NoiseOptions;
use sweetspot::synthetic::scenario::{FIRST_MODEL, TableFiles};
use sweetspot::validation::diagnose::{DiagnoseOptions, diagnose};
use sweetspot::validation::fit::{FitOptions, fit, fit_with_likely_offsets};
use sweetspot::validation::forward::Library;
use sweetspot::validation::model_library::ModelLibrary;
use sweetspot::validation::observation::TableOptions;
use sweetspot::validation::{Adequacy, Diagnosis, Observations, ValidationError, Verdict, compare};

fn table(kind: Kind, impacts: usize, hidden: &[(&str, f64)], seed: u64, noise: NoiseOptions) -> SyntheticTable {
    let hidden = hidden.iter().map(|(name, s)| Hidden::new(name, *s)).collect();
    generate_table(&TableSpec { kind, impacts, hidden, seed, noise }).unwrap()
}

fn observations_of(made: &SyntheticTable) -> Observations {
    Observations::new(&made.table, std::slice::from_ref(&made.racket), std::slice::from_ref(&made.ball), &TableOptions::default()).unwrap()
}

fn diagnosis_of(made: &SyntheticTable) -> Diagnosis {
    diagnosis(made, "", &DiagnoseOptions::default())
}

/// The diagnosis of a model that holds `effects` already.
fn diagnosis(made: &SyntheticTable, effects: &str, options: &DiagnoseOptions) -> Diagnosis {
    let observations = observations_of(made);
    let model = Model::parse(&format!("{FIRST_MODEL}\n{effects}"), Path::new("model.toml")).unwrap();
    diagnose(&ModelLibrary::new(model, &observations.gear), &observations, options).unwrap()
}

fn practice(number: usize) -> Option<Diagnosis> {
    let model = shared(&format!("practice/impacts/table-{number:02}/model.toml"))?;
    practice_with(number, Model::read(&model).unwrap())
}

fn practice_with(number: usize, model: Model) -> Option<Diagnosis> {
    let folder = shared(&format!("practice/impacts/table-{number:02}"))?;
    let impacts = ImpactTable::read(&folder.join("impacts.csv")).unwrap();
    let (racket, ball) = (Racket::read(&folder.join("racket.toml")).unwrap(), Ball::read(&folder.join("ball.toml")).unwrap());
    let observations = Observations::new(&impacts, &[racket], &[ball], &TableOptions::default()).unwrap();
    Some(diagnose(&ModelLibrary::new(model, &observations.gear), &observations, &DiagnoseOptions::default()).unwrap())
}

/// 300 impacts of the laboratory to whose outputs the difference is added that `effects` make in the first model.
fn with_formula(effects: &str) -> SyntheticTable {
    let mut made = table(Kind::Lab, 300, &[], 5, NoiseOptions::default());
    let [without, with] = ["", effects].map(|e| Model::parse(&format!("{FIRST_MODEL}\n{e}"), Path::new("model.toml")).unwrap());
    let [without, with] = [&without, &with].map(|m| m.prepare(&made.racket, &made.ball).unwrap());
    for row in &mut made.table.rows {
        let truth = &made.truth.rows[&row.id];
        let inputs: [f64; INPUTS.len()] = std::array::from_fn(|i| truth.get(INPUTS[i]).copied().unwrap_or(0.0));
        let [before, now] = [&without, &with].map(|m| m.predict(&ImpactInput::from_columns(&inputs, row.sequence)).unwrap().as_columns());
        for (cell, (before, now)) in row.outputs.iter_mut().zip(before.into_iter().zip(now)) {
            *cell = cell.map(|m| Measured { value: m.value + now.unwrap() - before.unwrap(), ..m });
        }
    }
    made
}

/// The practice tables' answers (shared/practice/impacts/answers.json), by somebody else's world.
#[test]
fn real_practice_tables_without_a_hidden_effect_are_adequate() {
    for number in [1, 2] {
        let Some(d) = practice(number) else { return };
        assert_eq!(d.verdict, Verdict::Adequate, "table {number}: {:?}", d.words);
        // The first of them are fitted, and help no more than chance does.
        let fitted: Vec<_> = d.candidates.iter().filter(|c| c.refitted).collect();
        assert!(fitted.len() >= 3 && fitted.iter().all(|c| (c.heldout_error_after - c.heldout_error_before).abs() < 0.03), "table {number}");
        assert!(fitted.iter().any(|c| c.heldout_error_after != c.heldout_error_before), "table {number}");
    }
}

#[test]
fn real_practice_tables_with_a_hidden_effect_are_named() {
    let answers: [(usize, &[&str]); 5] =
        [(3, &["ball-damping"]), (4, &["frame-vibration"]), (5, &["lateral-strings"]), (6, &["friction-law"]), (9, &["hand-mass", "racket-inertia"])];
    for (number, names) in answers {
        let Some(d) = practice(number) else { return };
        assert_eq!(d.verdict, Verdict::EffectMissing, "table {number}: {:?}", d.words);
        assert!(names.contains(&d.candidates[0].effect.as_str()), "table {number}: {} first", d.candidates[0].effect);
        let (before, after) = (d.candidates[0].heldout_error_before, d.candidates[0].heldout_error_after);
        let floor = d.noise_floor;
        let gone = (before.powi(2) - after.powi(2)) / (before.powi(2) - floor.powi(2));
        assert!(gone > 0.75, "table {number}: {before:.3} -> {after:.3}, floor {floor:.3}");
    }
}

/// A model that fails asks for offsets of the cameras in the place of what it lacks; its parameters and residuals are told without them, or a file
/// that was fitted would predict worse than before.
/// A model file that says nothing of restitution and friction holds their defaults: where these are wrong no effect is named in their place, and beside them
/// the right one.
#[test]
fn real_a_number_of_the_base_held_fixed_and_wrong_is_told() {
    let bare = || Model::parse("base = \"rigid\"", Path::new("model.toml")).unwrap();
    let Some(nothing) = practice_with(1, bare()) else { return };
    assert!(nothing.verdict == Verdict::Unexplained && nothing.recommended.is_empty() && nothing.suggested_expression.is_none(), "{:?}", nothing.words);
    assert!(nothing.words.iter().any(|w| w.contains("friction is 0.379 ±") && w.contains("With that fitted nothing is missing")), "{:?}", nothing.words);
    assert!(nothing.candidates.iter().all(|c| c.probability < 0.5));
    let Some(vibration) = practice_with(4, bare()) else { return };
    assert_eq!((vibration.verdict, vibration.recommended.as_slice()), (Verdict::EffectMissing, &["frame-vibration".to_owned()][..]), "{:?}", vibration.words);
    assert!(vibration.words.iter().any(|w| w.contains("restitution is 0.790 ±") && w.contains("friction is 0.410 ±")), "{:?}", vibration.words);
}

#[test]
fn real_a_failing_model_is_fitted_without_offsets_that_no_session_has() {
    let Some(folder) = shared("practice/impacts/table-03") else { return };
    let table = ImpactTable::read(&folder.join("impacts.csv")).unwrap();
    let (racket, ball) = (Racket::read(&folder.join("racket.toml")).unwrap(), Ball::read(&folder.join("ball.toml")).unwrap());
    let set = EquipmentSet { rackets: vec![racket], balls: vec![ball] };
    let observations = Observations::new(&table, &set.rackets, &set.balls, &TableOptions::default()).unwrap();
    let model = Model::read(&folder.join("model.toml")).unwrap();
    let library = ModelLibrary::new(model.clone(), &observations.gear);
    let seen = observations.side(false);
    let error = |restitution: f64, friction: f64| {
        let mut model = model.clone();
        model.set("restitution", restitution).unwrap();
        model.set("friction", friction).unwrap();
        let outcomes = predict_table(&model, &set, &table).unwrap();
        let squares = table.rows.iter().zip(&outcomes).map(|(row, o)| (row.get("ball_out_vz").unwrap().value - o.as_ref().unwrap().ball_velocity.z).powi(2));
        (squares.sum::<f64>() / outcomes.len() as f64).sqrt()
    };
    let free = fit(library.current(), &observations, &seen, &FitOptions::default(), None).unwrap();
    let likely = fit_with_likely_offsets(library.current(), &observations, &seen, &FitOptions::default()).unwrap();
    assert!(likely.unlikely.as_ref().is_some_and(|(offset, _)| offset.deviations > 10.0));
    assert_eq!(likely.with_offsets().values, free.values);
    let (with, without, stated) = (error(free.values[0], free.values[1]), error(likely.fit.values[0], likely.fit.values[1]), error(0.8, 0.45));
    assert!(with > 1.2 * stated && without < 1.01 * stated, "{with} and {without}, {stated} as stated");
}

/// A pair must earn its place: what hand-mass alone leaves is its own form, whatever a second effect could make of it.
#[test]
fn real_practice_table_with_one_hidden_effect_is_not_given_two_names() {
    let Some(d) = practice(9) else { return };
    assert_eq!(d.recommended, ["hand-mass"], "{:?}", d.words);
    assert!(d.together.is_none());
    assert!(d.words[0].ends_with("hand-mass."), "{}", d.words[0]);
    assert!(d.candidates.iter().filter(|c| c.probability > 0.9).all(|c| ["hand-mass", "racket-inertia"].contains(&c.effect.as_str())));
    assert!(d.candidates[0].aliases.contains(&"racket-inertia".to_owned()) && d.candidates[0].effect == "hand-mass");
}

/// With 600 impacts the form in which the frame vibrates here differs plainly from the catalogue's; no second effect may
/// be made of that, and the headline's probability is that of the headline.
#[test]
fn law_what_the_form_of_one_effect_leaves_is_not_called_a_second() {
    let d = diagnosis_of(&table(Kind::Lab, 600, &[("frame-vibration", 1.0)], 5, NoiseOptions::default()));
    assert_eq!(d.recommended, ["frame-vibration"], "{:?}", d.words);
    assert!(d.candidates[0].probability > 0.9 && d.candidates.iter().skip(1).all(|c| c.probability < 0.5));
}

/// As sharp as footage, 120 impacts tell a lean that is there throughout from one of a pocket that is flat when the ball comes and when it
/// leaves, as this world's is. With the first alone a fifth of the noise was left for other names.
#[test]
fn law_what_a_leaning_pocket_does_is_left_to_no_other_name() {
    for seed in [5004, 7001] {
        let d = diagnosis_of(&table(Kind::Lab, 120, &[("string-tilt", 0.35)], seed, NoiseOptions { scale: 0.22, ..NoiseOptions::default() }));
        assert_eq!(d.recommended, ["string-tilt"], "table {seed}: {:?}", d.words);
        let tilt = &d.candidates[0];
        assert!(tilt.heldout_error_after < 1.12 * d.noise_floor, "table {seed}: {} against {}", tilt.heldout_error_after, d.noise_floor);
        let at_ends = &tilt.parameters["string-tilt.at_ends"];
        assert!(at_ends.value < 0.3 && at_ends.sd < 0.1, "table {seed}: {at_ends:?}");
    }
}

/// Few impacts of a table slide throughout, and of those held out hardly any: neither that one impact carries most of the gain,
/// nor that the held-out error stands still, may hide a law of friction (both tables were called adequate once).
#[test]
fn truth_an_effect_that_few_impacts_meet_is_named() {
    for seed in [71021, 71059] {
        let d = diagnosis_of(&table(Kind::Lab, 120, &[("friction-law", 0.92)], seed, NoiseOptions::default()));
        assert_eq!(d.recommended, ["friction-law"], "table {seed}: {:?} {:?}", d.words, d.notes);
    }
}

/// Of two effects that imitate each other the impacts that no fit saw choose: by the fit alone it was the ball's deformation.
#[test]
fn truth_held_out_impacts_help_to_choose() {
    for seed in [171027, 171041] {
        let d = diagnosis_of(&table(Kind::Lab, 120, &[("offset-normal-force", 0.34)], seed, NoiseOptions::default()));
        assert_eq!(d.recommended, ["offset-normal-force"], "table {seed}: {:?}", d.words);
        let other = d.candidates.iter().find(|c| c.effect == "ball-deformation").unwrap();
        assert!(other.log_evidence_gain > d.candidates[0].log_evidence_gain && other.heldout_error_after > d.candidates[0].heldout_error_after);
    }
}

/// A contact that lasts in another form than the catalogue's leaves something that a shifted face plane imitates.
#[test]
fn law_what_imitates_an_effect_in_the_model_is_not_added_to_it() {
    for seed in [1, 2] {
        let made = table(Kind::Lab, 120, &[("finite-contact", 0.5)], seed, NoiseOptions { scale: 0.3, ..NoiseOptions::default() });
        let d = diagnosis(&made, "[effects.finite-contact]\ncontact_time_s = { value = 0.001, fit = true }\n", &DiagnoseOptions::default());
        assert!(d.recommended.is_empty(), "table {seed}: {:?} {:?}", d.recommended, d.words);
        assert!(d.notes.iter().any(|n| n.starts_with("face-plane-offset would fit what is left, but imitates finite-contact")), "table {seed}: {:?}", d.notes);
    }
}

#[test]
fn real_practice_table_with_two_hidden_effects_names_both() {
    let Some(d) = practice(7) else { return };
    assert_eq!(d.verdict, Verdict::EffectMissing);
    let mut first_two: Vec<&str> = d.candidates.iter().take(2).map(|c| c.effect.as_str()).collect();
    first_two.sort_unstable();
    assert_eq!(first_two, ["frame-vibration", "lateral-strings"]);
    assert_eq!(d.recommended.len(), 2);
}

#[test]
fn real_practice_table_outside_the_catalogue_is_unexplained_with_a_formula() {
    let Some(d) = practice(8) else { return };
    assert_eq!(d.verdict, Verdict::Unexplained);
    let e = d.suggested_expression.expect("a formula");
    assert_eq!(e.replaces, "restitution");
    assert!(e.expression.contains("spin"), "{}", e.expression);
    let gone = (d.heldout_error.powi(2) - e.heldout_error_after.powi(2)) / (d.heldout_error.powi(2) - d.noise_floor.powi(2));
    assert!(gone > 0.7, "{gone}");
    assert!(d.candidates.iter().all(|c| c.probability < 0.5));
}

/// A ball that leaves with more spin than the contact gives it is in no card, and no form of a ball with a shorter arm does it: where no formula may
/// tell, that name is not certain; a formula of what it is takes its place. What has the right mechanism in another form stays certain.
#[test]
fn truth_what_imitates_something_outside_the_catalogue_is_not_certain() {
    let mut made = table(Kind::Court, 300, &[], 1, NoiseOptions::default());
    let mut enlarge = |columns: &[&str]| {
        for (name, measured) in made.table.rows.iter_mut().flat_map(|row| OUTPUTS.iter().zip(&mut row.outputs)) {
            if columns.contains(name) {
                *measured = measured.map(|m| Measured { value: 1.1 * m.value, ..m });
            }
        }
        made.clone()
    };
    let d = diagnosis(&enlarge(&["ball_out_wx", "ball_out_wy"]), "", &DiagnoseOptions { expressions: false, ..DiagnoseOptions::default() });
    assert_eq!(d.verdict, Verdict::EffectMissing);
    assert!(d.candidates.iter().all(|c| c.probability <= 0.5), "{:?}", d.words);
    assert!(d.words.iter().any(|w| w.contains("no form of it the rest")), "{:?}", d.words);
    let d = diagnosis_of(&enlarge(&["ball_out_wz"]));
    assert_eq!(d.verdict, Verdict::Unexplained, "{:?}", d.words);
    let e = d.suggested_expression.expect("a formula");
    assert_eq!(e.replaces, "spin_kept", "{:?}", d.words);
    assert!((e.parameters.values().next().unwrap().value - 0.1).abs() < 0.02 && e.heldout_error_after < 1.1 * d.noise_floor, "{e:?}");
    let right = diagnosis_of(&table(Kind::Lab, 200, &[("frame-vibration", 2.0)], 2, NoiseOptions { scale: 0.2, ..NoiseOptions::default() }));
    assert_eq!(right.recommended, ["frame-vibration"], "{:?}", right.words);
    assert!(right.candidates[0].probability > 0.5 && !right.words.iter().any(|w| w.contains("no form of it")), "{:?}", right.words);
}

/// Strings that lie aslant turn the impulse in the face, a contact that the spin drives round turns its axis: vectors, which no term along the racket or across it does.
#[test]
fn truth_what_turns_impulse_or_spin_about_the_normal_is_told_by_its_angle() {
    for turn in ["impulse_turn", "spin_turn"] {
        let d = diagnosis_of(&with_formula(&format!("[effects.mine]\nexpression = \"{turn} + 0.08\"\nreplaces = \"{turn}\"")));
        let e = d.suggested_expression.expect("a formula");
        assert!(d.verdict == Verdict::Unexplained && e.replaces == turn, "{e:?} {:?}", d.words);
        assert!((e.parameters.values().next().unwrap().value - 0.08).abs() < 0.02 && e.heldout_error_after < 1.1 * d.noise_floor, "{e:?}");
    }
}

/// Places told 70 mm too far toward the handle are more than the card of a biased ball centre allows.
#[test]
fn truth_an_effect_at_the_end_of_its_card_is_not_certain() {
    let mut made = table(Kind::Court, 300, &[], 1, NoiseOptions::default());
    for (name, measured) in made.table.rows.iter_mut().flat_map(|row| INPUTS.iter().zip(&mut row.inputs)) {
        if *name == "impact_x" {
            *measured = measured.map(|m| Measured { value: m.value + 0.07, ..m });
        }
    }
    let d = diagnosis_of(&made);
    assert!(d.words.iter().any(|w| w.contains("the end of what its card allows")), "{:#?} {:#?}", d.words, d.candidates);
    assert!(d.candidates.iter().all(|c| c.probability <= 0.5), "{:?}", d.words);
}

/// A hit at the throat that loses speed in proportion is no mode: its node would have to lie 50 mm from where the beam has it. And what falls where its card has it rise
/// only is not certain either.
#[test]
fn truth_an_effect_in_a_form_that_it_hardly_has_is_not_certain() {
    let along = with_formula("[effects.mine]\nexpression = \"restitution * (1 - 0.02 * impact_x / half_length)\"\nreplaces = \"restitution\"");
    let d = diagnosis_of(&along);
    assert!(d.recommended != ["frame-vibration"] || d.words.iter().any(|w| w.contains("deviations from where it usually lies")), "{:?}", d.words);
    assert!(d.candidates.iter().all(|c| c.probability <= 0.5), "{:?}", d.words);
    let rim = with_formula("[effects.mine]\nexpression = \"restitution * (1 + 0.06 * (impact_distance / half_length)^2)\"\nreplaces = \"restitution\"");
    let d = diagnosis_of(&rim);
    assert!(d.recommended != ["stringbed-edge"] || d.words.iter().any(|w| w.contains("is found the other way round")), "{:?}", d.words);
    assert!(d.candidates.iter().all(|c| c.probability <= 0.5), "{:?}", d.words);
}

/// A spin about the normal that goes with something else is not to be explained by what only amplifies the noise of the one before.
#[test]
fn law_no_formula_lets_its_own_noise_stand_for_what_is_missing() {
    let mut made = table(Kind::Lab, 300, &[], 3, NoiseOptions::default());
    for row in &mut made.table.rows {
        let input = |name: &str| row.inputs[INPUTS.iter().position(|c| *c == name).unwrap()].unwrap().value;
        let lever = input("impact_x") * input("ball_in_vy") - input("impact_y") * input("ball_in_vx");
        let at = OUTPUTS.iter().position(|c| *c == "ball_out_wz").unwrap();
        row.outputs[at] = row.outputs[at].map(|m| Measured { value: m.value + 50.0 * (lever / 0.5).tanh(), ..m });
    }
    let d = diagnosis_of(&made);
    assert_eq!(d.verdict, Verdict::Unexplained, "{:?}", d.words);
    let formula = d.suggested_expression.map(|e| e.expression).unwrap_or_default();
    assert!(!formula.contains("ball_in_wz"), "{formula}");
}

/// What goes to and fro with the order of the impacts no smooth correction sees: two kinds of balls in turn.
#[test]
fn truth_an_adequate_model_is_doubted_for_what_goes_with_the_order() {
    let doubted = |d: &Diagnosis| d.words.iter().any(|w| w.contains("by turns to either side"));
    let mut made = table(Kind::Lab, 300, &[], 4, NoiseOptions::default());
    let compared = |made: &SyntheticTable| {
        let observations = observations_of(made);
        let model = Model::parse(FIRST_MODEL, Path::new("model.toml")).unwrap();
        compare(ModelLibrary::new(model, &observations.gear).current(), &observations, "model.toml", 1).unwrap()
    };
    let sound = diagnosis_of(&made);
    assert!(sound.verdict == Verdict::Adequate && sound.words.iter().all(|w| !w.starts_with("But")), "{:?}", sound.words);
    assert_eq!((compared(&made).verdict, compared(&made).doubts), (Adequacy::Adequate, Vec::new()));
    for (n, row) in made.table.rows.iter_mut().enumerate() {
        let at = OUTPUTS.iter().position(|c| *c == "ball_out_vz").unwrap();
        row.outputs[at] = row.outputs[at].map(|m| Measured { value: m.value + if n % 2 == 0 { 0.15 } else { -0.15 }, ..m });
    }
    let d = diagnosis_of(&made);
    assert!(d.verdict != Verdict::Adequate || doubted(&d), "{:?}", d.words);
    let c = compared(&made);
    assert!(c.verdict == Adequacy::Inadequate || c.doubts.iter().any(|w| w.contains("by turns to either side")), "{:?}", c.doubts);
    assert_eq!(c.doubts.is_empty(), c.verdict == Adequacy::Inadequate);
}

#[test]
fn law_nothing_hidden_is_called_adequate() {
    let mut alarms = Vec::new();
    let plain = NoiseOptions::default;
    for (kind, n) in [(Kind::Lab, 60), (Kind::Lab, 300), (Kind::Court, 60), (Kind::Court, 300)] {
        let spoilt = [
            plain(),
            NoiseOptions { understated: 1.25, ..plain() },
            NoiseOptions { outliers: 0.05, outlier_sd: 5.0, ..plain() },
            NoiseOptions { session_offset_sd: 0.3, ..plain() },
        ];
        for (i, noise) in spoilt.into_iter().enumerate() {
            let d = diagnosis_of(&table(kind, n, &[], 1 + i as u64, noise));
            if d.verdict != Verdict::Adequate {
                alarms.push(format!("{kind:?} {n} spoilt {i}: {:?}", d.words));
            }
        }
    }
    // Sixteen tables at a rate of 2.5 %: two alarms or more have a chance of 6 %, three of 0.7 %.
    assert!(alarms.len() < 3, "{alarms:#?}");
}

/// Shots of one calibration share errors that change smoothly over the face, and what the table states of each shot holds them: the shots scatter
/// about them by half of that. Nothing is missing.
#[test]
fn law_errors_that_shots_of_one_calibration_share_are_no_missing_effect() {
    let mut alarms = Vec::new();
    for seed in 1..=24 {
        let mut made = table(Kind::Lab, 14, &[], seed, NoiseOptions { understated: 0.5, ..NoiseOptions::default() });
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
        let mut any = || -> f64 { StandardNormal.sample(&mut rng) };
        let slopes: Vec<[f64; 2]> = (0..OUTPUTS.len()).map(|_| [any(), any()]).collect();
        let place = |row: &ImpactRow| {
            let at = |name: &str| row.inputs[INPUTS.iter().position(|c| *c == name).unwrap()].unwrap().value;
            [at("impact_x") / 0.06, at("impact_y") / 0.04]
        };
        for row in &mut made.table.rows {
            let place = place(row);
            for (measured, slope) in row.outputs.iter_mut().zip(&slopes) {
                let shared = 0.5 * (slope[0] * place[0] + slope[1] * place[1]);
                *measured = measured.map(|m| Measured { value: m.value + m.sd.unwrap() * shared, ..m });
            }
            // As a rendered session states them.
            row.shared_sd = [2e-4, 1.1e-3, 7e-4, 1.9e-4, 3e-5, 3e-5, 1.1e-4, 1e-3, 7e-5, 1.5e-3].map(Some);
        }
        let d = diagnosis_of(&made);
        if d.verdict != Verdict::Adequate {
            alarms.push(format!("{seed}: {:?}", d.words));
        }
    }
    assert!(alarms.len() < 2, "{} of 24: {alarms:#?}", alarms.len());
}

#[test]
fn agrees_two_effects_are_both_found_and_an_impossible_catalogue_gives_a_formula() {
    let both = diagnosis_of(&table(Kind::Lab, 300, &[("frame-vibration", 0.5), ("lateral-strings", 0.5)], 1, NoiseOptions::default()));
    let mut names = both.recommended.clone();
    names.sort();
    assert_eq!(names, ["frame-vibration", "lateral-strings"], "{:?}", both.words);
    let outside = diagnosis_of(&table(Kind::Lab, 300, &[("grip-restitution", 1.0)], 1, NoiseOptions::default()));
    assert_eq!(outside.verdict, Verdict::Unexplained, "{:?}", outside.words);
    let e = outside.suggested_expression.expect("a formula");
    assert!(e.expression.contains("grip_torque") && e.replaces == "restitution", "{}", e.expression);
    // The formula parses as a user's effect, and with it the model is sound.
    let text = format!("{FIRST_MODEL}\n{}", e.model_file_text);
    let model = Model::parse(&text, Path::new("model.toml")).unwrap();
    let made = table(Kind::Lab, 300, &[("grip-restitution", 1.0)], 1, NoiseOptions::default());
    let observations = observations_of(&made);
    let after = diagnose(&ModelLibrary::new(model, &observations.gear), &observations, &DiagnoseOptions::default()).unwrap();
    assert!(after.heldout_error < 1.08 * after.noise_floor, "{} against {}", after.heldout_error, after.noise_floor);
}

/// What only a few impacts see, and what couples the two directions in the face.
#[test]
fn truth_a_dead_spot_and_strings_that_give_along_a_diagonal_are_told_as_formulae() {
    for (hidden, told) in [(("dead-spot", 0.5), "exp(-((impact_x + 0.0"), (("diagonal-strings", 1.0), "diagonal")] {
        let d = diagnosis_of(&table(Kind::Lab, 200, &[hidden], 1, NoiseOptions::default()));
        assert_eq!(d.verdict, Verdict::Unexplained, "{:?}", d.words);
        let e = d.suggested_expression.expect("a formula");
        assert!(e.expression.contains(told), "{}", e.expression);
        // A handful of held-out impacts lie on the spot: their own scatter is as large as what it does to them.
        assert!(e.heldout_error_after < d.heldout_error, "{} to {}", d.heldout_error, e.heldout_error_after);
        assert!(e.share_removed > 0.7, "{} takes {:.2}", e.expression, e.share_removed);
        assert!(d.candidates.iter().all(|c| c.probability < 0.9));
    }
}

/// An adequate model leaves its candidates together no more than nothing has.
#[test]
fn law_probabilities_agree_with_the_verdict() {
    for seed in 1..6 {
        let d = diagnosis_of(&table(Kind::Court, 60, &[("ball-damping", 0.5)], seed, NoiseOptions::default()));
        let sum: f64 = d.candidates.iter().map(|c| c.probability).sum();
        match d.verdict {
            Verdict::Adequate => assert!(sum <= 0.5 + 1e-12, "seed {seed}: {sum}"),
            Verdict::EffectMissing => assert!(!d.recommended.is_empty(), "seed {seed}"),
            Verdict::Unexplained => assert!(d.candidates.iter().all(|c| c.probability <= 0.5), "seed {seed}"),
        }
    }
}

#[test]
fn law_results_do_not_depend_on_the_number_of_threads() {
    let made = table(Kind::Lab, 60, &[("ball-damping", 1.0)], 1, NoiseOptions::default());
    let json = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| serde_json::to_string(&diagnosis_of(&made)).unwrap())
    };
    assert_eq!(json(1), json(3));
}

/// A fit is the data's and the model's, not its beginning's: begun again where it ended it stays there, with effects that are wrong for the table
/// and cells that do not belong.
#[test]
fn law_a_fit_begun_again_stays_where_it_is() {
    for hidden in ["ball-wear", "ball-damping", "frame-vibration"] {
        let made = table(Kind::Lab, 150, &[(hidden, 2.5)], 1, NoiseOptions { outliers: 0.05, outlier_sd: 8.0, ..NoiseOptions::default() });
        let (racket, ball) = (std::slice::from_ref(&made.racket), std::slice::from_ref(&made.ball));
        let observations = Observations::new(&made.table, racket, ball, &TableOptions::default()).unwrap();
        let seen = observations.side(false);
        for effect in ["ball-stiffening", "momentum-flux"] {
            let model = Model::parse(FIRST_MODEL, Path::new("model.toml")).unwrap().with_effect(effect).unwrap();
            let library = ModelLibrary::new(model, &observations.gear);
            let fitted = |start_values| fit(library.current(), &observations, &seen, &FitOptions { start_values, ..FitOptions::default() }, None).unwrap();
            let first = fitted(None);
            let again = fitted(Some(first.values.clone()));
            for (p, name) in first.names.iter().enumerate() {
                let moved = (again.values[p] - first.values[p]).abs() / first.sd(p, 1.0);
                assert!(moved < 0.5, "{hidden}, {effect}: {name} moves by {moved:.2} deviations");
            }
        }
    }
}

/// A model whose parameters do not move is judged where its options say, also where the file says otherwise.
#[test]
fn law_parameters_that_do_not_move_stay_where_they_are_put() {
    let made = table(Kind::Lab, 60, &[], 1, NoiseOptions::default());
    let observations = observations_of(&made);
    let library = ModelLibrary::new(Model::parse(FIRST_MODEL, Path::new("model.toml")).unwrap(), &observations.gear);
    let put = vec![0.7, 0.3];
    let options = FitOptions { move_parameters: false, start_values: Some(put.clone()), ..FitOptions::default() };
    assert_eq!(fit(library.current(), &observations, &observations.side(false), &options, None).unwrap().values, put);
}

#[test]
fn law_the_noise_scale_is_recognised() {
    let d = diagnosis_of(&table(Kind::Lab, 300, &[], 7, NoiseOptions { understated: 1.4, ..NoiseOptions::default() }));
    assert!((d.noise_floor - 1.4).abs() < 0.08, "{}", d.noise_floor);
    assert!(d.notes.iter().any(|n| n.contains("understated by a factor 1.")), "{:?}", d.notes);
}

#[test]
fn law_outliers_are_listed_by_id() {
    let made = table(Kind::Lab, 200, &[], 3, NoiseOptions { outliers: 0.05, outlier_sd: 12.0, ..NoiseOptions::default() });
    let d = diagnosis_of(&made);
    let listed: Vec<(&str, &str)> = d.outliers.iter().map(|o| (o.id.as_str(), o.column.as_str())).collect();
    let found = made.truth.outliers.iter().filter(|(id, column)| listed.contains(&(id.as_str(), column.as_str()))).count();
    // A wrong spin of 12 deviations stands out; a wrong velocity may be taken for a wrong input of the same impact.
    assert!(found * 10 >= made.truth.outliers.len() * 7, "{found} of {}: {listed:?}", made.truth.outliers.len());
    assert!(listed.len() <= made.truth.outliers.len() * 2 + 2, "{listed:?}");
}

/// Spin known about one axis only: the other components count as unknown within the range of play, not as zero.
#[test]
fn truth_an_effect_is_found_when_spin_is_known_about_one_axis_only() {
    let noise = NoiseOptions { one_axis_spin: true, ..NoiseOptions::default() };
    let d = diagnosis_of(&table(Kind::Lab, 150, &[("hand-mass", 0.5)], 9, noise.clone()));
    assert_eq!(d.recommended, ["hand-mass"], "{:?}", d.words);
    assert!(d.candidates[0].heldout_error_after < 1.08, "{:?}", d.words);
    let nothing = diagnosis_of(&table(Kind::Lab, 150, &[], 9, noise));
    assert_eq!(nothing.verdict, Verdict::Adequate, "{:?}", nothing.words);
}

/// Three days whose names all hash to the fit side: one of them is held out all the same, always the same one.
#[test]
fn truth_a_few_groups_are_split_whole() {
    let made = table(Kind::Lab, 90, &[], 2, NoiseOptions { sessions: 3, ..NoiseOptions::default() });
    let options = TableOptions { group: Some("session".into()), ..TableOptions::default() };
    let o = Observations::new(&made.table, std::slice::from_ref(&made.racket), std::slice::from_ref(&made.ball), &options).unwrap();
    let held: std::collections::BTreeSet<&str> = o.impacts.iter().filter(|i| i.held_out).map(|i| i.groups["session"].as_str()).collect();
    let fitted: std::collections::BTreeSet<&str> = o.impacts.iter().filter(|i| !i.held_out).map(|i| i.groups["session"].as_str()).collect();
    assert!(!held.is_empty() && !fitted.is_empty() && held.is_disjoint(&fitted), "{held:?} {fitted:?}");
}

#[test]
fn fails_tables_that_cannot_be_judged_say_why() {
    let mut made = table(Kind::Lab, 60, &[], 1, NoiseOptions::default());
    let observe = |t: &ImpactTable, group: Option<&str>| {
        Observations::new(
            t,
            std::slice::from_ref(&made.racket),
            std::slice::from_ref(&made.ball),
            &TableOptions { group: group.map(Into::into), ..TableOptions::default() },
        )
    };
    assert!(matches!(observe(&made.table, Some("player")), Err(ValidationError::NoGroup { .. })));
    assert!(matches!(observe(&made.table, Some("ball")), Err(ValidationError::OneGroup { column, .. }) if column == "ball"));
    let mut short = made.table.clone();
    short.rows.truncate(5);
    assert!(matches!(observe(&short, None), Err(ValidationError::TooFew { usable: 5, .. })));
    // Two slips of the pen: named, and the other rows are judged as without them.
    let mut odd = made.table.clone();
    odd.rows[7].set("ball_out_vz", Some(Measured { value: 1e9, sd: Some(1e8) }));
    odd.rows[9].set("impact_x", Some(Measured { value: -35.0, sd: None }));
    let observed = observe(&odd, None).unwrap();
    assert_eq!(observed.unusable.iter().map(|(id, _)| id).collect::<Vec<_>>(), [&odd.rows[7].id, &odd.rows[9].id]);
    assert!(observed.unusable[0].1.contains("`ball_out_vz` is 1e9 m/s") && observed.unusable[1].1.contains("up to 0.6 m"), "{:?}", observed.unusable);
    odd.rows.remove(9);
    odd.rows.remove(7);
    let without = observe(&odd, None).unwrap();
    assert_eq!((observed.impacts.len(), observed.output_noise), (without.impacts.len(), without.output_noise));
    made.table.rows[3].racket = Some("another".into());
    let observed = observe(&made.table, None).unwrap();
    assert!(
        matches!(&observed.unusable[..], [(id, why)] if *id == made.table.rows[3].id && why.contains("no racket file has the name \"another\"")),
        "{:?}",
        observed.unusable
    );
    made.table.rows.iter_mut().for_each(|r| r.ball = Some("another".into()));
    assert!(matches!(observe(&made.table, None), Err(ValidationError::TooFew { usable: 0, reason, .. }) if reason.contains("\"another\"")));
}

fn run(folder: &Path, arguments: &[&str]) -> (i32, String) {
    let done = Command::new(env!("CARGO_BIN_EXE_sweetspot")).current_dir(folder).args(arguments).env("SOURCE_DATE_EPOCH", "1795219200").output().unwrap();
    (done.status.code().unwrap_or(-1), crate::cli::said(&done))
}

fn lay_out(made: &SyntheticTable, folder: &Path) {
    for (name, text) in TableFiles::of(made).unwrap().0 {
        std::fs::write(folder.join(name), text).unwrap();
    }
}

/// Rows that cannot be used are named and cost the exit status; the results are of the others.
#[test]
fn cli_rows_that_cannot_be_used_are_left_out_with_exit_1() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let mut made = table(Kind::Lab, 60, &[], 1, NoiseOptions::default());
    made.table.rows[3].racket = Some("another".into());
    made.table.rows[5].set("impact_x", None);
    // Along the strings, whose impact no model can predict.
    for still in ["ball_in_vz", "racket_in_vz", "racket_in_wx", "racket_in_wy"] {
        made.table.rows[8].set(still, Some(Measured { value: 0.0, sd: None }));
    }
    lay_out(&made, at);
    std::fs::write(at.join("model.toml"), FIRST_MODEL).unwrap();
    let commands = [
        ("predict", &[][..], "predictions.csv"),
        ("compare", &[], "compare.json"),
        ("diagnose", &[], "diagnosis.json"),
        ("fit", &["-o", "fitted.toml"], "fitted.toml"),
    ];
    for (command, more, result) in commands {
        let files = [command, "--impacts", "impacts.csv", "--racket", "racket.toml", "--ball", "ball.toml", "--model", "model.toml"];
        let (status, said) = run(at, &[&files[..], more].concat());
        assert_eq!(status, 1, "{command}: {said}");
        let words = ["\"another\"", "`impact_x`", &format!("{}: no contact", made.table.rows[8].id)];
        assert!(words.iter().all(|w| said.contains(w)) && at.join(result).exists(), "{command}: {said}");
        if result.ends_with(".json") {
            let result: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(at.join(result)).unwrap()).unwrap();
            let left_out: Vec<&str> = result["left_out"].as_array().unwrap().iter().map(|l| l["id"].as_str().unwrap()).collect();
            assert_eq!(left_out, [3, 8, 5].map(|k| made.table.rows[k].id.as_str()));
            assert!(std::fs::read_to_string(at.join("report.html")).unwrap().contains(&format!("{} (no contact", made.table.rows[8].id)));
        }
    }
}

/// A cell that cannot be read costs its row: results are those of the table without it, and the cell is named with file, line and column.
#[test]
fn cli_a_cell_that_cannot_be_read_costs_its_row_only() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let made = table(Kind::Lab, 60, &[], 1, NoiseOptions::default());
    lay_out(&made, at);
    std::fs::write(at.join("model.toml"), FIRST_MODEL).unwrap();
    let sound = std::fs::read_to_string(at.join("impacts.csv")).unwrap();
    let column = |name: &str| sound.lines().next().unwrap().split(',').position(|c| c == name).unwrap();
    let with = |changes: &[(usize, &str, &str)]| {
        let mut lines: Vec<Vec<String>> = sound.lines().map(|l| l.split(',').map(ToOwned::to_owned).collect()).collect();
        for (line, name, cell) in changes {
            lines[line - 1][column(name)] = (*cell).to_owned();
        }
        lines.iter().map(|l| l.join(",") + "\n").collect::<String>()
    };
    let broken = with(&[(4, "ball_in_vz", "n/a"), (7, "racket_out_wy", "#REF!"), (9, "ball_out_vx_sd", "NaN"), (11, "impact_x", "\"0,013\"")]);
    // The same with a racket that nobody knows in these rows, whose other cells are sound.
    let lost = with(&[4, 7, 9, 11].map(|line| (line, "racket", "another")));
    let id = |line: usize| made.table.rows[line - 2].id.clone();
    let files = ["--impacts", "impacts.csv", "--racket", "racket.toml", "--ball", "ball.toml", "--model", "model.toml", "--json", "--out"];
    for (command, more) in [("predict", &[][..]), ("compare", &["--no-ledger"]), ("diagnose", &[]), ("fit", &["-o", "fitted.toml"])] {
        let result = |text: &str, out: &str| {
            std::fs::write(at.join("impacts.csv"), text).unwrap();
            let output = Command::new(env!("CARGO_BIN_EXE_sweetspot")).current_dir(at).arg(command).args(files).arg(out).args(more).output().unwrap();
            let told = String::from_utf8_lossy(&output.stderr).into_owned();
            assert_eq!(output.status.code(), Some(1), "{command}: {told}");
            (serde_json::from_slice::<serde_json::Value>(&output.stdout).unwrap(), told)
        };
        let (seen, told) = result(&broken, "a");
        for (line, column, cell) in [(4, "ball_in_vz", "n/a"), (7, "racket_out_wy", "#REF!"), (9, "ball_out_vx_sd", "NaN"), (11, "impact_x", "0,013")] {
            let named = format!("{}: impacts.csv, line {line}: `{column}` is \"{cell}\"; allowed: a finite number", id(line));
            assert!(told.contains(&named), "{command}: {named}\n{told}");
        }
        assert!(told.contains("try: correct the cells named"), "{told}");
        let (without, _) = result(&lost, "b");
        if command == "predict" {
            assert_eq!((&seen["predictions"], seen["failed"].as_array().unwrap().len()), (&without["predictions"], 4));
            let lines = |out: &str| std::fs::read_to_string(at.join(out).join("predictions.csv")).unwrap();
            assert!(lines("a") == lines("b") && lines("a").contains(&format!("\n{},,,", id(4))));
        } else {
            assert_eq!(seen["left_out"].as_array().unwrap().len(), 4);
            let figures = if command == "diagnose" { ["outputs", "candidates"] } else { ["heldout_error", "noise_floor"] };
            assert!(figures.iter().all(|k| !seen[*k].is_null() && seen[*k] == without[*k]), "{command}");
        }
    }
    // What is wrong with the table is not told of its rows.
    std::fs::write(at.join("impacts.csv"), sound.replace('.', ",")).unwrap();
    let (status, told) = run(at, &[&["compare"], &files[..8]].concat());
    assert!(status == 2 && told.contains("60 faults; mend them all") && !at.join("compare.json").exists(), "{told}");
}

/// A model that can use fewer rows is judged by others: its error is no step of the staircase.
#[test]
fn law_versions_judged_by_other_rows_are_not_set_beside_each_other() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let mut made = table(Kind::Lab, 60, &[], 1, NoiseOptions::default());
    for (k, row) in made.table.rows.iter_mut().enumerate() {
        row.groups.insert("tension".into(), if k % 4 == 0 { "NA".into() } else { format!("{}", 50 + k % 7) });
    }
    lay_out(&made, at);
    let own = |column: &str| {
        format!(
            "{FIRST_MODEL}\n[effects.own]\nreplaces = \"restitution\"\nexpression = \"restitution * (1 - k * {column})\"\nk = {{ value = 0.0, fit = true }}\n"
        )
    };
    let models = [("first.toml", FIRST_MODEL.to_owned(), 0), ("second.toml", own("impact_y"), 0), ("third.toml", own("column.tension / 500"), 1)];
    let staircases = models.map(|(name, text, expected)| {
        std::fs::write(at.join(name), text).unwrap();
        let (status, said) = run(at, &["compare", "--impacts", "impacts.csv", "--racket", "racket.toml", "--ball", "ball.toml", "--model", name]);
        assert_eq!(status, expected, "{said}");
        said.contains("error on the same")
    });
    assert_eq!(staircases, [false, true, false]);
}

/// A model that asks for an offset no session has is fitted without any; the error told is that of the new file, not of the one before the fit.
#[test]
fn agrees_fit_tells_the_error_that_compare_finds_in_its_file() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    lay_out(&table(Kind::Lab, 200, &[("frame-vibration", 1.5)], 5, NoiseOptions::default()), at);
    std::fs::write(at.join("model.toml"), FIRST_MODEL).unwrap();
    let files = ["--impacts", "impacts.csv", "--racket", "racket.toml", "--ball", "ball.toml", "--json", "--model"];
    let told = |arguments: &[&str]| -> serde_json::Value {
        let done = Command::new(env!("CARGO_BIN_EXE_sweetspot")).current_dir(at).args(arguments).output().unwrap();
        serde_json::from_slice(&done.stdout).unwrap()
    };
    let before = told(&[&["compare"][..], &files, &["model.toml"]].concat());
    let fitted = told(&[&["fit"][..], &files, &["model.toml", "-o", "fitted.toml"]].concat());
    assert!(fitted["notes"].to_string().contains("fitted without any offset"), "{}", fitted["notes"]);
    let after = told(&[&["compare"][..], &files, &["fitted.toml"]].concat());
    let error = |of: &serde_json::Value| of["heldout_error"].as_f64().unwrap();
    // The file holds the fitted values to the last digit; the offsets are fitted from another beginning.
    assert!((error(&fitted) - error(&after)).abs() < 1e-3 * error(&after), "{} told, {} found", error(&fitted), error(&after));
    assert!((error(&before) - error(&after)).abs() > 0.01, "{} before the fit", error(&before));
}

/// Another model under the name of the result is kept, by the walk of `diagnose --auto` too; the same again is no other.
#[test]
fn cli_fit_and_auto_keep_another_model_under_the_outputs_name() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    lay_out(&table(Kind::Lab, 60, &[], 1, NoiseOptions::default()), at);
    let files = ["--impacts", "impacts.csv", "--racket", "racket.toml", "--ball", "ball.toml", "--model", "model.toml"];
    std::fs::write(at.join("model.toml"), FIRST_MODEL.replace("base", "# read\nbase")).unwrap();
    let kept = at.join("fitted.earlier.toml");
    for command in [&["fit"][..], &["diagnose", "--auto", "--no-expression"]] {
        let again = || run(at, &[command, &files[..], &["-o", "fitted.toml"]].concat()).1;
        std::fs::write(at.join("fitted.toml"), FIRST_MODEL).unwrap();
        let said = again();
        assert!(said.contains("held another model") && std::fs::read_to_string(&kept).unwrap() == FIRST_MODEL, "{command:?}: {said}");
        assert!(!again().contains("held another model") && !at.join("fitted.earlier-2.toml").exists(), "{command:?}");
        std::fs::remove_file(&kept).unwrap();
    }
}

/// A parameter without room says so, and not that the impacts were silent; the others are fitted.
#[test]
fn cli_a_parameter_whose_limits_are_one_number_is_told_as_held() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    lay_out(&table(Kind::Lab, 60, &[], 1, NoiseOptions::default()), at);
    let model = "base = \"rigid\"\n[parameters]\nrestitution = { value = 0.75, fit = true, min = 0.75, max = 0.75 }\nfriction = { value = 0.4, fit = true }\n";
    std::fs::write(at.join("model.toml"), model).unwrap();
    let files = ["--impacts", "impacts.csv", "--racket", "racket.toml", "--ball", "ball.toml", "--model", "model.toml"];
    let (status, said) = run(at, &[&["fit"], &files[..], &["-o", "fitted.toml"]].concat());
    let line = said.lines().find(|l| l.trim_start().starts_with("restitution")).unwrap_or_default();
    assert!(status == 0 && line.contains("0.75") && line.contains("held fixed: its min and max are both 0.75") && !said.contains("not determined"), "{said}");
    let fitted = std::fs::read_to_string(at.join("fitted.toml")).unwrap();
    assert!(fitted.contains("value = 0.75") && !fitted.contains("value = 0.4,"), "{fitted}");
    let (status, said) = run(at, &[&["compare"], &files[..]].concat());
    assert!(status == 0 && said.contains("restitution 0.75") && said.contains("(held fixed: its min and max are the same)"), "{said}");
}

/// A formula that has no value for some impacts is named as the reason, by every command that needs the model for all of them.
#[test]
fn fails_a_model_without_an_answer_says_why() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    lay_out(&table(Kind::Lab, 60, &[], 1, NoiseOptions::default()), at);
    let own = "[effects.own]\nreplaces = \"restitution\"\nexpression = \"restitution * (1 + k * sqrt(impact_y / 0.1))\"\nk = { value = 0.01, fit = true }\n";
    std::fs::write(at.join("model.toml"), format!("{FIRST_MODEL}\n{own}")).unwrap();
    for (command, more) in [("compare", &[][..]), ("diagnose", &[]), ("fit", &["-o", "fitted.toml"])] {
        let files = [command, "--impacts", "impacts.csv", "--racket", "racket.toml", "--ball", "ball.toml", "--model", "model.toml"];
        let (status, said) = run(at, &[&files[..], more].concat());
        assert_eq!(status, 2, "{command}: {said}");
        assert!(["cannot predict", "effect `own`", "`restitution` became NaN (a root or"].iter().all(|w| said.contains(w)), "{command}: {said}");
    }
}

/// A residual alone does not tell that a law was limited or that energy came from nowhere.
#[test]
fn cli_compare_tells_what_no_contact_does() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    lay_out(&table(Kind::Lab, 60, &[], 1, NoiseOptions::default()), at);
    let compare = |own: &str| {
        std::fs::write(at.join("model.toml"), format!("{FIRST_MODEL}\n{own}")).unwrap();
        run(at, &["compare", "--impacts", "impacts.csv", "--racket", "racket.toml", "--ball", "ball.toml", "--model", "model.toml"])
    };
    for (replaces, expression, words) in [
        ("restitution", "restitution + 0.5", "as stated: restitution beyond 0 to 1, taken as 0 or 1, in 60 impacts"),
        ("friction", "-friction", "as stated: friction below 0, taken as 0, in 60 impacts"),
        ("ball_out_vz", "ball_out_vz * 10", "as stated: more energy after the impact than before"),
    ] {
        let (status, said) = compare(&format!("[effects.own]\nreplaces = \"{replaces}\"\nexpression = \"{expression}\"\n"));
        assert!(status == 0 && said.contains(words), "{status}: {said}");
        assert!(std::fs::read_to_string(at.join("compare.json")).unwrap().contains(words));
    }
    assert!(!compare("").1.contains("as stated: "));
}

/// Of versions with the same effects one is called fitted where nothing but the values of free parameters differs; of another base none is a version.
#[test]
fn law_the_ledger_tells_a_fit_from_a_change() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    lay_out(&table(Kind::Lab, 60, &[("frame-vibration", 1.0)], 1, NoiseOptions::default()), at);
    let files = ["--impacts", "impacts.csv", "--racket", "racket.toml", "--ball", "ball.toml", "--model"];
    let own = |across: &str| {
        format!(
            "base = \"rigid\"\n[parameters]\nrestitution = {{ value = 0.5, fit = true }}\nfriction = 0.45\n[effects.own]\nreplaces = \"restitution\"\n\
             expression = \"restitution * (1 - k * ({across} / 0.13)^2)\"\nk = {{ value = 0.0, fit = true }}\n"
        )
    };
    std::fs::write(at.join("stepped.toml"), "base = \"viscoelastic\"\n[parameters]\nmu = { value = 0.0, fit = true }\n").unwrap();
    std::fs::write(at.join("own.toml"), own("impact_y")).unwrap();
    assert_eq!(run(at, &[&["fit"][..], &files, &["own.toml", "-o", "fitted.toml"]].concat()).0, 0);
    let fitted = std::fs::read_to_string(at.join("fitted.toml")).unwrap();
    std::fs::write(at.join("changed.toml"), fitted.replace("impact_y", "impact_x")).unwrap();
    for model in ["stepped.toml", "own.toml", "fitted.toml", "changed.toml"] {
        let (status, said) = run(at, &[&["compare"][..], &files, &[model]].concat());
        assert_eq!(status, 0, "{said}");
    }
    let ledger: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(at.join("model-ledger.json")).unwrap()).unwrap();
    let steps: Vec<&str> = ledger["entries"].as_array().unwrap().iter().map(|e| e["step"].as_str().unwrap()).collect();
    assert_eq!(steps, ["first model", "first model", "fitted", "changed"]);
}

/// The user's walk: compare fails, diagnose names, add, fit, compare again, the error falls; the ledger keeps it.
#[test]
fn cli_compare_diagnose_add_fit_compare_and_the_error_falls() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    lay_out(&table(Kind::Lab, 120, &[("frame-vibration", 1.0)], 1, NoiseOptions::default()), at);
    let commented = format!("# my racket's model\n{FIRST_MODEL}");
    std::fs::write(at.join("model.toml"), commented).unwrap();
    let files = |model: &str| -> Vec<String> {
        ["--impacts", "impacts.csv", "--racket", "racket.toml", "--ball", "ball.toml", "--model", model].map(String::from).to_vec()
    };
    let command = |name: &str, model: &str, more: &[&str]| {
        let mut all = vec![name.to_owned()];
        all.extend(files(model));
        all.extend(more.iter().map(|s| (*s).to_owned()));
        run(at, &all.iter().map(String::as_str).collect::<Vec<_>>())
    };
    let (status, said) = command("compare", "model.toml", &[]);
    assert_eq!(status, 0, "{said}");
    assert!(said.contains("NOT ADEQUATE"), "{said}");
    let (status, said) = command("diagnose", "model.toml", &[]);
    assert_eq!(status, 0, "{said}");
    assert!(said.contains("EFFECT MISSING: frame-vibration"), "{said}");
    let json: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(at.join("diagnosis.json")).unwrap()).unwrap();
    for key in ["verdict", "outputs", "where", "candidates", "suggested_expression", "next_experiments", "noise_floor"] {
        assert!(json.get(key).is_some(), "{key} is missing");
    }
    assert_eq!(json["verdict"], "effect-missing");
    for key in ["effect", "probability", "heldout_error_before", "heldout_error_after", "parameters", "aliases"] {
        assert!(json["candidates"][0].get(key).is_some(), "candidates: {key} is missing");
    }
    let (status, said) = run(at, &["add", "frame-vibration", "--model", "model.toml", "-o", "model-2.toml"]);
    assert_eq!(status, 0, "{said}");
    let (status, said) = command("fit", "model-2.toml", &["-o", "model-3.toml"]);
    assert_eq!(status, 0, "{said}");
    assert!(std::fs::read_to_string(at.join("model-3.toml")).unwrap().starts_with("# my racket's model"));
    let (status, said) = command("compare", "model-3.toml", &[]);
    assert_eq!(status, 0, "{said}");
    assert!(said.contains("noise floor") && said.contains("added frame-vibration"), "{said}");
    let beside = std::fs::read_to_string(at.join("model-ledger.json")).unwrap();
    let ledger: serde_json::Value = serde_json::from_str(&beside).unwrap();
    let errors: Vec<f64> = ledger["entries"].as_array().unwrap().iter().map(|e| e["heldout_error"].as_f64().unwrap()).collect();
    assert_eq!(errors.len(), 2);
    assert!(errors[1] < 0.6 * errors[0], "{errors:?}");
    // A version that does worse did not come from the better one by a fit.
    std::fs::write(at.join("worse.toml"), "base = \"rigid\"\n[parameters]\nrestitution = 0.3\nfriction = 0.0\n[effects.frame-vibration]\namount = 1.0\n")
        .unwrap();
    let (status, said) = command("compare", "worse.toml", &["--out", "worse"]);
    assert_eq!(status, 0, "{said}");
    // Results that go elsewhere leave the ledger beside the model as it was; the new one goes on from it.
    assert_eq!(std::fs::read_to_string(at.join("model-ledger.json")).unwrap(), beside);
    let ledger: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(at.join("worse/model-ledger.json")).unwrap()).unwrap();
    let (fitted, worse) = (&ledger["entries"][1], &ledger["entries"][2]);
    assert!(worse["heldout_error"].as_f64() > fitted["heldout_error"].as_f64());
    assert_ne!(worse["parent"], fitted["model_hash"]);
    // Of commands that run at the same time none loses another's line.
    let versions = ["a.toml", "b.toml", "c.toml"];
    for (i, name) in versions.iter().enumerate() {
        std::fs::write(at.join(name), format!("base = \"rigid\"\n[parameters]\nrestitution = 0.{i}5\nfriction = 0.1\n")).unwrap();
    }
    std::thread::scope(|scope| {
        let compared = versions.map(|name| scope.spawn(|| command("compare", name, &["--out", "together"])));
        assert!(compared.into_iter().all(|c| c.join().unwrap().0 == 0));
    });
    let ledger = std::fs::read_to_string(at.join("together/model-ledger.json")).unwrap();
    assert!(versions.iter().chain(&["model.toml", "model-3.toml"]).all(|name| ledger.contains(&format!("\"{name}\""))), "{ledger}");
    // Among many open reports the tab tells its own, wherever the command was run.
    let report = std::fs::read_to_string(at.join("report.html")).unwrap();
    let title = format!("<title>model-3.toml against {}/impacts.csv – sweetspot compare</title>", at.file_name().unwrap().to_string_lossy());
    assert!(report.contains(&title), "{report:.400}");
    // The same walk by itself, twice, gives the same bytes.
    let results: Vec<PathBuf> = ["one", "two"].map(|d| at.join(d)).to_vec();
    for folder in &results {
        let (status, said) = command("diagnose", "model.toml", &["--auto", "--out", folder.to_str().unwrap()]);
        assert_eq!(status, 0, "{said}");
    }
    for file in ["diagnosis.json", "model-auto.toml", "model-auto.1.toml"] {
        assert_eq!(std::fs::read(results[0].join(file)).unwrap(), std::fs::read(results[1].join(file)).unwrap(), "{file}");
        assert!(!at.join(file).exists() || file == "diagnosis.json", "{file} beside the model");
    }
    assert!(std::fs::read_to_string(results[0].join("model-auto.toml")).unwrap().contains("[effects.frame-vibration]"));
}

/// A table whose outputs are a model's own, with the noise it states: not a test of physics, but of whether the statistics see what is there.
fn of_its_own_world(kind: Kind, impacts: usize, seed: u64, nature: &Model) -> (SyntheticTable, EquipmentSet) {
    by_nature(table(kind, impacts, &[], seed, NoiseOptions::default()), seed, nature)
}

fn by_nature(mut made: SyntheticTable, seed: u64, nature: &Model) -> (SyntheticTable, EquipmentSet) {
    let set = EquipmentSet { rackets: vec![made.racket.clone()], balls: vec![made.ball.clone()] };
    let outcomes = predict_table(nature, &set, &made.table).unwrap();
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
    for (row, outcome) in made.table.rows.iter_mut().zip(outcomes) {
        for (measured, predicted) in row.outputs.iter_mut().zip(outcome.unwrap().as_columns()) {
            let noise: f64 = StandardNormal.sample(&mut rng);
            *measured = measured.zip(predicted).map(|(m, p)| Measured { value: p + m.sd.unwrap() * noise, ..m });
        }
    }
    (made, set)
}

/// Restitution that goes with the sign of a spin is none of the smooth corrections; 200 impacts tell it at thirty deviations all the same.
#[test]
fn truth_what_no_smooth_correction_holds_is_found_as_one_term() {
    for (replaces, expression, named) in [
        ("restitution", "restitution * (1 - 0.3 * (ball_in_wx * ball_radius / 25))", "ball_in_wx"),
        ("restitution", "restitution * (1 + 0.05 * (racket_in_wx / 3))", "racket_in_wx"),
        ("tangential_restitution", "tangential_restitution + 0.15 * (impact_x / half_length)", "impact_x"),
        (
            "restitution",
            "restitution * (1 + 0.05 * (tangential_x^2 - tangential_y^2) / (tangential_x^2 + tangential_y^2 + 0.01))",
            "(tangential_x^2 - tangential_y^2)",
        ),
    ] {
        let nature = format!("{FIRST_MODEL}\n[effects.odd]\nreplaces = {replaces:?}\nexpression = {expression:?}\n");
        let nature = Model::parse(&nature, Path::new("nature.toml")).unwrap();
        let (mut made, _) = of_its_own_world(Kind::Court, 200, 3, &nature);
        // A racket that twists from shot to shot.
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(3);
        let twist = INPUTS.iter().position(|c| *c == "racket_in_wx").unwrap();
        for row in &mut made.table.rows {
            let by: f64 = StandardNormal.sample(&mut rng);
            row.inputs[twist] = row.inputs[twist].map(|m| Measured { value: m.value + 3.0 * by, ..m });
        }
        let (made, _) = by_nature(made, 3, &nature);
        let d = diagnosis_of(&made);
        assert!(d.verdict != Verdict::Adequate, "{expression}: {:?}", d.words);
        let found = d.suggested_expression.unwrap_or_else(|| panic!("{expression}: {:?}", d.words));
        assert!(found.expression.contains(named) && found.heldout_error_after < 1.1, "{expression}: {found:?}");
    }
}

/// In the time-stepped base only the size of a sideways softness counts: the derivative at none is nought, and it passed for invisible.
#[test]
fn law_sideways_strings_are_found_in_the_viscoelastic_base() {
    let first = "base = \"viscoelastic\"\n\n[parameters]\nA_C = { value = 1200.0, fit = true }\nmu = { value = 0.45, fit = true }\n";
    let nature = Model::parse(&format!("{first}\n[effects.lateral-strings]\nacross = 0.2\nalong = 0.1\n"), Path::new("nature.toml")).unwrap();
    let (made, set) = of_its_own_world(Kind::Lab, 40, 3, &nature);
    let observations = Observations::new(&made.table, &set.rackets, &set.balls, &TableOptions::default()).unwrap();
    let library = ModelLibrary::new(Model::parse(first, Path::new("model.toml")).unwrap(), &observations.gear);
    let d = diagnose(&library, &observations, &DiagnoseOptions { expressions: false, ..DiagnoseOptions::default() }).unwrap();
    assert_eq!(d.recommended, ["lateral-strings"], "{:?}", d.words);
    let across = &d.candidates[0].parameters["lateral-strings.across"];
    assert!((across.value - 0.2).abs() < 4.0 * across.sd && across.sd < 0.05, "{across:?}");
}

/// What is in no catalogue has its formula in the time-stepped base too, where restitution is no law but what the contact comes to.
#[test]
fn truth_a_formula_is_found_in_the_viscoelastic_base() {
    let first = "base = \"viscoelastic\"\n\n[parameters]\nA_C = { value = 1200.0, fit = true }\nmu = { value = 0.45, fit = true }\n";
    for (replaces, k, feature) in
        [("restitution", 0.1, "(impact_y / half_width)"), ("friction", 0.5, "(impact_x / half_length)"), ("string_stiffness", 0.3, "sign(impact_y)")]
    {
        let expression = format!("{replaces} * (1 + {k} * {feature})");
        let nature = format!("{first}\n[effects.odd]\nreplaces = {replaces:?}\nexpression = {expression:?}\n");
        let (made, set) = of_its_own_world(Kind::Lab, 60, 3, &Model::parse(&nature, Path::new("nature.toml")).unwrap());
        let observations = Observations::new(&made.table, &set.rackets, &set.balls, &TableOptions::default()).unwrap();
        let library = ModelLibrary::new(Model::parse(first, Path::new("model.toml")).unwrap(), &observations.gear);
        let d = diagnose(&library, &observations, &DiagnoseOptions::default()).unwrap();
        let found = d.suggested_expression.unwrap_or_else(|| panic!("{expression}: {:?}", d.words));
        assert!(found.replaces == replaces && found.expression.contains(feature) && found.heldout_error_after < 1.15, "{expression}: {found:?}");
    }
}

/// A strength that the user asks for goes where the impacts say, six typical sizes as well as one.
#[test]
fn truth_a_large_strength_is_fitted_and_told_as_it_is() {
    let first = format!("{FIRST_MODEL}\n[effects.scale-error]\nscale = {{ value = 0.0, fit = true }}\n");
    let mut nature = Model::parse(&first, Path::new("nature.toml")).unwrap();
    nature.set("scale-error.scale", 0.06).unwrap();
    let (made, set) = of_its_own_world(Kind::Court, 100, 8, &nature);
    let observations = Observations::new(&made.table, &set.rackets, &set.balls, &TableOptions::default()).unwrap();
    let library = ModelLibrary::new(Model::parse(&first, Path::new("model.toml")).unwrap(), &observations.gear);
    let fitted = fit(library.current(), &observations, &observations.side(false), &FitOptions::default(), None).unwrap();
    let at = fitted.names.iter().position(|n| n == "scale-error.scale").unwrap();
    let (value, sd) = (fitted.values[at], fitted.sd(at, 1.0));
    assert!((value - 0.06).abs() < 2.5 * sd && sd < 0.01, "{value} ± {sd}");
}

/// Any form of a tilt would take half of what more damping in the strings does; the momentum that stays in the ball fits worse, but no tilt takes that.
#[test]
fn truth_a_pair_whose_halves_could_take_from_each_other_is_named_where_it_fits_best() {
    let first = "base = \"viscoelastic\"\n\n[parameters]\nA_C = { value = 1200.0, fit = true }\nmu = { value = 0.45, fit = true }\n";
    let nature = format!("{first}\n[effects.string-damping]\nextra = 8.6\n[effects.string-tilt]\nstrength = 0.28\nat_ends = 1.0\n");
    let (made, set) = of_its_own_world(Kind::Lab, 170, 4, &Model::parse(&nature, Path::new("nature.toml")).unwrap());
    let observations = Observations::new(&made.table, &set.rackets, &set.balls, &TableOptions::default()).unwrap();
    let library = ModelLibrary::new(Model::parse(first, Path::new("model.toml")).unwrap(), &observations.gear);
    let d = diagnose(&library, &observations, &DiagnoseOptions { expressions: false, ..DiagnoseOptions::default() }).unwrap();
    assert_eq!(d.recommended, ["string-damping", "string-tilt"], "{:?}", d.words);
}

/// Of two pairs that stand the one with more evidence is named, though the other holds the best single effect.
#[test]
fn truth_a_pair_is_named_by_its_whole_evidence() {
    let mut nature =
        Model::parse(FIRST_MODEL, Path::new("nature.toml")).unwrap().with_effect("lateral-strings").unwrap().with_effect("stringbed-edge").unwrap();
    for (name, value) in [("lateral-strings.across", 0.12), ("lateral-strings.along", 0.0), ("stringbed-edge.drop", 0.15)] {
        nature.set(name, value).unwrap();
    }
    let (made, _) = of_its_own_world(Kind::Court, 300, 9, &nature);
    let d = diagnosis_of(&made);
    assert_eq!(d.recommended, ["lateral-strings", "stringbed-edge"], "{:?}", d.words);
}

/// The weaker of two effects takes most of what the strong one leaves: two wrong ones that share what both do are no objection, nor that it is little of all.
#[test]
fn truth_the_weaker_effect_is_named_beside_a_strong_one_of_another_form() {
    for hidden in [[("frame-vibration", 1.0), ("friction-law", 2.0)], [("ball-damping", 0.7), ("hand-mass", 2.0)]] {
        let d = diagnosis_of(&table(Kind::Lab, 250, &hidden, 11, NoiseOptions::default()));
        let mut named = d.recommended.clone();
        named.sort();
        assert_eq!(named, hidden.map(|(name, _)| name), "{:?}", d.words);
    }
}

/// The restitution goes with the speed alone, which four effects say, each with its own power: the one that acts as its card says goes first, and those that
/// fit as well in another form share the probability.
#[test]
fn truth_effects_that_differ_in_form_alone_share_the_probability() {
    for (by, first) in [(0.03, "ball-stiffening"), (-0.03, "string-stiffening")] {
        let expression = format!("restitution + {by} * ((approach_speed / 25)^2 - 1)");
        let nature = format!("{FIRST_MODEL}\n[effects.odd]\nreplaces = \"restitution\"\nexpression = {expression:?}\n");
        let (made, _) = of_its_own_world(Kind::Lab, 120, 4, &Model::parse(&nature, Path::new("nature.toml")).unwrap());
        let d = diagnosis_of(&made);
        assert_eq!(d.recommended, [first], "{:?}", d.words);
        let best = &d.candidates[0];
        assert!(best.effect == first && best.probability < 0.99, "{} {}", best.effect, best.probability);
        let of_speed = ["ball-damping", "momentum-flux", "ball-stiffening", "string-stiffening"];
        let together: f64 = d.candidates.iter().filter(|c| of_speed.contains(&c.effect.as_str())).map(|c| c.probability).sum();
        assert!(together > 0.99, "{together}");
        assert!(best.aliases.iter().any(|a| a == "ball-damping"), "{:?}", best.aliases);
    }
}

/// A place that is off by eight times what a session may be off by leaves its trace in the offset alone, and `compare` says so as `diagnose` does.
#[test]
fn agrees_a_place_that_is_off_is_called_inadequate_and_named() {
    let (mut made, set) = of_its_own_world(Kind::Lab, 100, 5, &Model::parse(FIRST_MODEL, Path::new("nature.toml")).unwrap());
    let across = INPUTS.iter().position(|c| *c == "impact_y").unwrap();
    for row in &mut made.table.rows {
        row.inputs[across] = row.inputs[across].map(|m| Measured { value: m.value + 4.0 * m.sd.unwrap(), ..m });
    }
    let d = diagnosis_of(&made);
    assert_eq!(d.recommended, ["ball-centre-bias"], "{:?}", d.words);
    let observations = Observations::new(&made.table, &set.rackets, &set.balls, &TableOptions::default()).unwrap();
    let library = ModelLibrary::new(Model::parse(FIRST_MODEL, Path::new("model.toml")).unwrap(), &observations.gear);
    let c = compare(library.current(), &observations, "model.toml", 1).unwrap();
    assert_eq!(c.verdict, Adequacy::Inadequate);
    assert!(c.notes.iter().any(|n| n.contains("impact_y")), "{:?}", c.notes);
}

/// Balls that nobody saw turn may all turn one way: their mean is asked of the outputs, and is nothing that the model lacks.
#[test]
fn law_spins_that_nobody_measured_may_have_a_mean() {
    for kind in [Kind::Court, Kind::Lab] {
        let mut made = table(kind, 400, &[], 11, NoiseOptions::default());
        made.table.rows.retain(|row| row.get("ball_in_wx").is_some_and(|wx| wx.value > 0.0));
        let mean = made.table.rows.iter().map(|row| row.get("ball_in_wx").unwrap().value).sum::<f64>() / made.table.rows.len() as f64;
        for row in &mut made.table.rows {
            INPUTS.iter().zip(&mut row.inputs).filter(|(name, _)| name.starts_with("ball_in_w")).for_each(|(_, value)| *value = None);
            if kind == Kind::Court {
                OUTPUTS.iter().zip(&mut row.outputs).filter(|(name, _)| name.starts_with("ball_out_w")).for_each(|(_, value)| *value = None);
            }
        }
        let d = diagnosis_of(&made);
        assert_eq!(d.verdict, Verdict::Adequate, "{kind:?}: {:?} {:?}", d.words, d.notes);
        let told = d.session_offsets.iter().find(|o| o.input.starts_with("ball_in_wx") && o.prior_sd > 100.0).unwrap();
        assert!((told.value - mean).abs() < 3.0 * told.sd.max(0.1 * mean) && told.value > 4.0 * told.sd, "{kind:?}: {mean} {told:?}");
        assert!(d.notes.iter().any(|n| n.contains("`ball_in_wx` was not measured the outputs tell +")), "{kind:?}: {:?}", d.notes);
    }
}

/// What the ball's spin after the impact tells of one that nobody measured before it turns the slip's estimated direction, and met its own noise there.
#[test]
fn law_spins_that_nobody_measured_make_no_structure() {
    for seed in 1..4 {
        let (mut made, _) = of_its_own_world(Kind::Lab, 80, seed, &Model::parse(FIRST_MODEL, Path::new("nature.toml")).unwrap());
        for row in &mut made.table.rows {
            INPUTS.iter().zip(&mut row.inputs).filter(|(name, _)| name.starts_with("ball_in_w")).for_each(|(_, value)| *value = None);
            OUTPUTS.iter().zip(&mut row.outputs).filter(|(name, _)| name.starts_with("racket_out")).for_each(|(_, value)| *value = None);
        }
        let d = diagnosis_of(&made);
        assert_eq!(d.verdict, Verdict::Adequate, "seed {seed}: {:?}", d.words);
    }
}

/// A friction that rises with the temperature, on strings so rough that few balls slide: their numbers stick out of the others', and with little weight
/// they would hide what they alone tell.
#[test]
fn truth_friction_that_few_balls_meet_is_not_taken_for_wrong_numbers() {
    let warm = |seed: u64| {
        let mut made = table(Kind::Lab, 200, &[], seed, NoiseOptions::default());
        for (i, row) in made.table.rows.iter_mut().enumerate() {
            row.groups.insert("temperature".into(), format!("{:.2}", 12.0 + 20.0 * (0.618_033_988_7 * i as f64).fract()));
        }
        made
    };
    let own = "\n[effects.warm-strings]\nexpression = \"friction * (1 + 0.03 * (column.temperature - 22))\"\nreplaces = \"friction\"\n";
    let rough = |mu: &str| FIRST_MODEL.replace("friction = { value = 0.50", &format!("friction = {{ value = {mu}"));
    let nature = |text: &str| Model::parse(text, Path::new("nature.toml")).unwrap();
    for (mu, seed) in [("0.50", 1), ("0.50", 3), ("0.55", 2)] {
        let d = diagnosis_of(&by_nature(warm(seed), seed, &nature(&format!("{}{own}", rough(mu)))).0);
        assert_eq!(d.verdict, Verdict::Unexplained, "{mu}, table {seed}: {:?}", d.words);
        let formula = d.suggested_expression.unwrap();
        assert!(formula.replaces == "friction" && formula.expression.contains("column.temperature"), "{mu}, table {seed}: {formula:?}");
        assert!(d.notes[0].contains("full weight") && d.outliers.len() >= 5, "{mu}, table {seed}: {:?}", d.notes);
    }
    // Too few to tell by what; that they lie together they tell.
    let d = diagnosis_of(&by_nature(warm(4), 4, &nature(&format!("{}{own}", rough("0.55")))).0);
    assert_eq!(d.verdict, Verdict::Unexplained, "{:?}", d.words);
    assert!(d.notes.iter().any(|n| n.contains("where the ball slides the most")), "{:?}", d.notes);
    // Wrong numbers are what they seem.
    let (mut made, _) = by_nature(warm(1), 1, &nature(&rough("0.50")));
    for (i, row) in made.table.rows.iter_mut().enumerate().filter(|(i, _)| i.is_multiple_of(15)) {
        let m = row.outputs.iter_mut().flatten().nth(i / 15 % 6).unwrap();
        m.value += m.sd.unwrap() * if i.is_multiple_of(2) { 8.0 } else { -8.0 };
    }
    let d = diagnosis_of(&made);
    assert!(d.verdict == Verdict::Adequate && d.outliers.len() >= 10, "{:?} {:?}", d.words, d.outliers);
}
