//! Tables as a season makes them: several rackets, players and days, spins that nobody read, a rebound that wanders.

use std::path::Path;
use sweetspot::equipment::Racket;
use sweetspot::impact::Model;
use sweetspot::impact_table::{ImpactRow, Measured};
use sweetspot::synthetic::hidden::Hidden;
use sweetspot::synthetic::impact_world::{Kind, SyntheticTable, TableSpec, generate_table};
use sweetspot::synthetic::measurement::NoiseOptions;
use sweetspot::synthetic::scenario::FIRST_MODEL;
use sweetspot::validation::comparison::compare;
use sweetspot::validation::diagnose::{DiagnoseOptions, diagnose};
use sweetspot::validation::forward::Library;
use sweetspot::validation::model_library::ModelLibrary;
use sweetspot::validation::observation::TableOptions;
use sweetspot::validation::{Adequacy, Comparison, Diagnosis, Observations, Verdict};

const SEED: u64 = 20_080_101;

/// A sound table of the laboratory with every row changed by `change` (its number and the row).
fn changed(impacts: usize, seed: u64, change: impl Fn(usize, &mut ImpactRow)) -> SyntheticTable {
    let mut made = generate_table(&TableSpec { kind: Kind::Lab, impacts, hidden: Vec::new(), seed, noise: NoiseOptions::default() }).unwrap();
    made.table.rows.iter_mut().enumerate().for_each(|(i, row)| change(i, row));
    made
}

fn scaled(row: &mut ImpactRow, column: &str, by: f64) {
    let mut m = row.get(column).unwrap();
    m.value *= by;
    row.set(column, Some(m));
}

fn rackets(made: &SyntheticTable) -> [Racket; 2] {
    [Racket { name: "one".into(), ..made.racket.clone() }, Racket { name: "other".into(), ..made.racket.clone() }]
}

fn observations(made: &SyntheticTable, options: &TableOptions) -> Observations {
    let named = made.table.rows.iter().any(|r| r.racket.as_deref() == Some("other"));
    let rackets = if named { rackets(made).to_vec() } else { vec![made.racket.clone()] };
    Observations::new(&made.table, &rackets, std::slice::from_ref(&made.ball), options).unwrap()
}

fn judged(made: &SyntheticTable, options: &TableOptions) -> (Comparison, Diagnosis) {
    let observations = observations(made, options);
    let model = Model::parse(FIRST_MODEL, Path::new("model.toml")).unwrap();
    let library = ModelLibrary::new(model, &observations.gear);
    let compared = compare(library.current(), &observations, "model.toml", SEED).unwrap();
    (compared, diagnose(&library, &observations, &DiagnoseOptions::default()).unwrap())
}

fn by_turns(i: usize, row: &mut ImpactRow) {
    row.racket = Some(if i.is_multiple_of(2) { "one" } else { "other" }.to_owned());
    row.groups.insert("player".into(), format!("player {}", i % 3));
}

/// Two rackets that a table takes for equal, one of them 3 % livelier: no smooth function of the inputs shows it.
#[test]
fn truth_a_racket_that_rebounds_otherwise_is_named_and_equal_ones_are_not() {
    for seed in [1, 2] {
        let lively = changed(200, seed, |i, row| {
            by_turns(i, row);
            if !i.is_multiple_of(2) {
                scaled(row, "ball_out_vz", 1.03);
            }
        });
        let (compared, d) = judged(&lively, &TableOptions::default());
        let misfit = d.structure.by_group.first().unwrap();
        assert_eq!((misfit.column.as_str(), misfit.what.as_str()), ("racket", "the impulse along the normal"), "table {seed}: {misfit:?}");
        assert_eq!((compared.verdict, d.verdict), (Adequacy::Inadequate, Verdict::Unexplained), "table {seed}: {:?}", d.words);
        assert!((d.noise_floor - 1.0).abs() < 0.1, "table {seed}: what the rackets differ by is no noise ({})", d.noise_floor);
        let (compared, d) = judged(&changed(200, seed, by_turns), &TableOptions::default());
        assert!(d.structure.columns_of_groups == 2 && d.structure.by_group.is_empty(), "table {seed}: {:?}", d.structure.by_group);
        assert_eq!((compared.verdict, d.verdict), (Adequacy::Adequate, Verdict::Adequate), "table {seed}: {:?}", d.words);
    }
}

/// A column of numbers that has nothing to do with the inputs: strings that rebound more on warm days. It is named where the rebound goes with it,
/// and not where it does not.
#[test]
fn truth_a_column_of_numbers_that_the_rebound_goes_with_is_named() {
    for seed in [1, 2] {
        let day = |i: usize| 10.0 + 25.0 * (0.618_033_988_7 * (i as f64 + seed as f64)).fract();
        let warm = changed(160, seed, |i, row| {
            row.groups.insert("temperature".into(), format!("{:.2}", day(i)));
            scaled(row, "ball_out_vz", 1.0 + 0.003 * (day(i) - 22.0));
        });
        let (compared, d) = judged(&warm, &TableOptions::default());
        let misfit = d.structure.by_group.first().unwrap();
        assert_eq!((misfit.column.as_str(), misfit.what.as_str()), ("temperature", "the impulse along the normal"), "table {seed}: {misfit:?}");
        assert!(misfit.group.contains(" to "), "{misfit:?}");
        assert_eq!((compared.verdict, d.verdict), (Adequacy::Inadequate, Verdict::Unexplained), "table {seed}: {:?}", d.words);
        // Where it fails, and by which formula, is told with the column.
        assert!(d.places.iter().any(|p| (p.output.as_str(), p.input.as_str()) == ("ball_out_vz", "temperature")), "table {seed}: {:?}", d.places);
        let formula = d.suggested_expression.as_ref().unwrap();
        assert!(formula.expression.contains("column.temperature") && formula.heldout_error_after < d.heldout_error, "table {seed}: {formula:?}");
        let options = TableOptions { own_columns: vec!["temperature".into()], ..TableOptions::default() };
        let observations = observations(&warm, &options);
        let model = Model::parse(&format!("{FIRST_MODEL}\n{}", formula.model_file_text), Path::new("model.toml")).unwrap();
        assert_eq!(model.own_columns(), ["temperature"]);
        let with = compare(ModelLibrary::new(model, &observations.gear).current(), &observations, "model.toml", SEED).unwrap();
        let lies_with = |c: &Comparison| c.structure.by_group.iter().any(|g| g.column == "temperature");
        assert!(lies_with(&compared) && !lies_with(&with) && with.heldout_error < compared.heldout_error, "table {seed}: {:?}", with.structure.by_group);
        let sound = changed(160, seed, |i, row| {
            row.groups.insert("temperature".into(), format!("{:.2}", day(i)));
            row.groups.insert("speed".into(), format!("{}", row.get("ball_in_vz").unwrap().value));
        });
        let (compared, d) = judged(&sound, &TableOptions::default());
        // A column that is an input in other words is no group.
        assert!(d.structure.columns_of_groups == 1 && d.structure.by_group.is_empty(), "table {seed}: {:?}", d.structure.by_group);
        assert_eq!((compared.verdict, d.verdict), (Adequacy::Adequate, Verdict::Adequate), "table {seed}: {:?}", d.words);
    }
}

/// The group that is held out is the one that is off: the fit never saw it.
#[test]
fn truth_a_group_held_out_that_the_model_misses_is_named() {
    let options = TableOptions { group: Some("player".into()), ..TableOptions::default() };
    let held = {
        let made = changed(240, 4, by_turns);
        observations(&made, &options).impacts.iter().find(|o| o.held_out).unwrap().held_by.clone()
    };
    let made = changed(240, 4, |i, row| {
        by_turns(i, row);
        if row.groups["player"] == held {
            scaled(row, "ball_out_vz", 1.05);
        }
    });
    let (compared, d) = judged(&made, &options);
    assert_eq!((compared.verdict, d.verdict), (Adequacy::Inadequate, Verdict::Unexplained), "{:?}", d.words);
    assert!(d.notes.iter().any(|n| n.contains("does not carry over") && n.contains(&held)), "{:?}", d.notes);
}

/// Neither the spin before the impact nor the one after was read: whether a ball slides is open, and no fault of the model.
#[test]
fn law_a_table_without_any_spin_is_no_reason_to_doubt_the_model() {
    for seed in [1, 2, 3] {
        let blind = changed(150, seed, |_, row| {
            ["ball_in_wx", "ball_in_wy", "ball_in_wz", "ball_out_wx", "ball_out_wy", "ball_out_wz"].iter().for_each(|c| {
                row.set(c, None);
            });
        });
        let (compared, d) = judged(&blind, &TableOptions::default());
        assert_eq!((compared.verdict, d.verdict), (Adequacy::Adequate, Verdict::Adequate), "table {seed}: {:?}", d.words);
    }
}

/// From a friction at which every ball sticks no slope leads down to one at which many slide.
#[test]
fn truth_friction_is_found_wherever_it_starts() {
    let observations = observations(&changed(200, 5, |_, _| ()), &TableOptions::default());
    let fitted = |start: f64| {
        let text = FIRST_MODEL.replace("friction = { value = 0.50", &format!("friction = {{ value = {start}"));
        let model = Model::parse(&text, Path::new("model.toml")).unwrap();
        assert!(model.parameters().iter().any(|p| p.value == start), "{text}");
        let library = ModelLibrary::new(model, &observations.gear);
        let c = compare(library.current(), &observations, "model.toml", SEED).unwrap();
        let friction = c.parameters_refitted.iter().find(|p| p.name == "friction").unwrap().clone();
        (friction.value, friction.sd)
    };
    let (usual, sd) = fitted(0.51);
    for start in [0.1, 0.9, 1.4] {
        let (value, _) = fitted(start);
        assert!((value - usual).abs() < 0.5 * sd, "from {start}: {value}, from 0.51: {usual} ± {sd}");
    }
}

/// A rebound that rises and falls by turns over the recording, as with the warmth of the room: no input tells it, the order does.
#[test]
fn truth_a_rebound_that_wanders_is_told_by_the_order_of_the_impacts() {
    let made = changed(300, 6, |i, row| scaled(row, "ball_out_vz", 1.0 + 0.04 * (i as f64 * std::f64::consts::TAU / 120.0).sin()));
    let (compared, d) = judged(&made, &TableOptions::default());
    assert_eq!((compared.verdict, d.verdict), (Adequacy::Inadequate, Verdict::Unexplained), "{:?}", d.words);
    assert!(d.places.iter().any(|p| p.input == "order" && p.output == "ball_out_vz"), "{:?}", d.places);
    let formula = d.suggested_expression.unwrap();
    assert!(formula.expression.contains("order") && formula.heldout_error_after < d.heldout_error, "{}", formula.expression);
}

/// Beside what goes with the order stand the columns that change slowly over the table; what goes with a column is no reason to name them, whatever
/// the column's name.
#[test]
fn truth_columns_that_change_slowly_are_named_beside_what_goes_with_the_order() {
    let border = |i: usize| 25.0 * (0.618_033_988_7 * i as f64).fract();
    let noted = |rebound: &dyn Fn(usize) -> f64| {
        let made = changed(160, 3, |i, row| {
            row.groups.insert("border".into(), format!("{:.2}", border(i)));
            row.groups.insert("hall".into(), if i / 40 % 2 == 0 { "old" } else { "new" }.to_owned());
            scaled(row, "ball_out_vz", rebound(i));
        });
        let (_, d) = judged(&made, &TableOptions::default());
        let note = d.notes.iter().find(|n| n.contains("slowly or in blocks")).cloned();
        (d, note)
    };
    let (d, note) = noted(&|i| 1.0 + 0.003 * (border(i) - 12.0));
    assert!(d.suggested_expression.as_ref().unwrap().expression.contains("column.border"), "{:?}", d.suggested_expression);
    assert_eq!(note, None);
    let (d, note) = noted(&|i| 1.04 - 0.0005 * i as f64);
    assert_eq!(d.recommended, ["ball-wear"], "{:?}", d.words);
    let note = note.unwrap();
    assert!(note.contains("`hall`") && !note.contains("`border`"), "{note}");
}

/// One player's racket turns more the farther from the middle it is hit: a push alike for all of his impacts shows nothing of it.
#[test]
fn truth_a_group_that_differs_with_the_place_of_impact_is_named() {
    let made = changed(200, 6, |i, row| {
        by_turns(i, row);
        if row.groups["player"] == "player 1" {
            let (x, mut out) = (row.get("impact_x").unwrap().value, row.get("racket_out_wy").unwrap());
            out.value += 20.0 * x;
            row.set("racket_out_wy", Some(out));
        }
    });
    let (compared, d) = judged(&made, &TableOptions::default());
    let misfit = d.structure.by_group.first().unwrap();
    assert!(misfit.column == "player" && misfit.what.contains("towards the handle"), "{misfit:?}");
    assert_eq!((compared.verdict, d.verdict), (Adequacy::Inadequate, Verdict::Unexplained), "{:?}", d.words);
}

/// Dead balls are outliers that all lie on one side; wrong numbers lie on either.
#[test]
fn truth_outliers_of_one_side_are_no_wrong_numbers() {
    let off = |dead: bool| {
        changed(200, 7, |i, row| {
            if i.is_multiple_of(8) {
                let mut out = row.get("ball_out_vz").unwrap();
                out.value += if dead || i.is_multiple_of(16) { -2.5 } else { 2.5 };
                row.set("ball_out_vz", Some(out));
            }
        })
    };
    let (compared, d) = judged(&off(true), &TableOptions::default());
    assert_eq!((compared.verdict, d.verdict), (Adequacy::Inadequate, Verdict::Unexplained), "{:?}", d.words);
    for notes in [&compared.notes, &d.notes] {
        assert!(notes.iter().any(|n| n.contains("`ball_out_vz`") && n.contains("too small")), "{notes:?}");
    }
    let (compared, d) = judged(&off(false), &TableOptions::default());
    assert_eq!((compared.verdict, d.verdict), (Adequacy::Adequate, Verdict::Adequate), "{:?} {:?}", d.words, d.notes);
}

/// A restitution that falls with speed toward the handle and rises with it toward the tip: neither speed nor place alone shows it.
#[test]
fn truth_what_goes_with_speed_times_place_is_found() {
    let made = changed(200, 8, |_, row| {
        let (x, v) = (row.get("impact_x").unwrap().value, row.get("ball_in_vz").unwrap().value.abs());
        scaled(row, "ball_out_vz", 1.0 - 0.006 * (v - 25.0) * x / 0.05);
    });
    let (_, d) = judged(&made, &TableOptions::default());
    assert_eq!(d.verdict, Verdict::Unexplained, "{:?}", d.words);
    let formula = d.suggested_expression.unwrap();
    // (The ball alone was changed, not the racket that it pushes off: no formula of the restitution takes all of it.)
    assert!(formula.expression.contains("approach_speed - ") && formula.share_removed > 0.9, "{formula:?}");
}

/// An effect that acts on the impacts of one player alone: with one strength for all it takes too little away to be named (or, as a tilt of the strings,
/// does not say of whom), with one for each group it is. Where the rebound alone is another, no effect is.
#[test]
fn truth_an_effect_in_one_group_alone_is_named_with_its_strength_in_each() {
    for (effect, strength, seed) in [("hand-mass", "mass_kg", 3), ("frame-vibration", "amount", 4), ("string-tilt", "strength", 6)] {
        let spec = |hidden: Vec<Hidden>, seed: u64| TableSpec { kind: Kind::Lab, impacts: 200, hidden, seed, noise: NoiseOptions::default() };
        let without = generate_table(&spec(Vec::new(), seed)).unwrap();
        let mut made = generate_table(&spec(vec![Hidden::new(effect, 0.4)], seed + 100)).unwrap();
        for (i, (row, other)) in made.table.rows.iter_mut().zip(&without.table.rows).enumerate() {
            let bare = i.is_multiple_of(2);
            if bare {
                *row = ImpactRow { id: row.id.clone(), ..other.clone() };
            }
            row.groups.insert("player".into(), if bare { "free" } else { "held" }.to_owned());
        }
        let (_, d) = judged(&made, &TableOptions::default());
        assert_eq!(d.verdict, Verdict::EffectMissing, "{effect}: {:?} {:?}", d.words, d.notes);
        assert_eq!(d.recommended, [effect], "{:?}", d.words);
        let named = &d.candidates[0];
        assert!(named.effect == effect && named.probability > 0.5 && named.heldout_error_after < d.heldout_error, "{named:?}");
        let of = |group: &str| named.parameters[&format!("{effect}.{strength} (player {group:?})")].clone();
        assert!(of("held").value > 5.0 * of("held").sd && of("free").value < 0.3 * of("held").value, "{:?}", named.parameters);
        assert!(d.notes.iter().any(|n| n.contains("not alike in all groups of `player`")), "{:?}", d.notes);
        assert!(d.words.iter().any(|w| w.contains("a strength of its own in each group of `player`")), "{:?}", d.words);
    }
    let lively = changed(200, 5, |i, row| {
        by_turns(i, row);
        if row.groups["player"] == "player 1" {
            scaled(row, "ball_out_vz", 1.04);
        }
    });
    let (_, d) = judged(&lively, &TableOptions::default());
    assert_eq!(d.verdict, Verdict::Unexplained, "{:?} {:?}", d.words, d.notes);
}

/// A model that holds the strength of an effect fixed which nature has none of: no effect that could be added mends that, and none is named in its place.
#[test]
fn truth_a_wrong_strength_that_the_model_holds_fixed_is_told() {
    let judged_with = |hidden: Vec<Hidden>, effects: &str| {
        let made = generate_table(&TableSpec { kind: Kind::Lab, impacts: 160, hidden, seed: 9, noise: NoiseOptions::default() }).unwrap();
        let observations = observations(&made, &TableOptions::default());
        let model = Model::parse(&format!("{FIRST_MODEL}\n{effects}"), Path::new("model.toml")).unwrap();
        diagnose(&ModelLibrary::new(model, &observations.gear), &observations, &DiagnoseOptions::default()).unwrap()
    };
    let wrong = "[effects.string-tilt]\nstrength = 1.0\n";
    let d = judged_with(Vec::new(), wrong);
    assert_eq!(d.verdict, Verdict::Unexplained, "{:?}", d.words);
    assert!(d.words[1].contains("string-tilt.strength is") && d.words[1].contains("nothing is missing"), "{:?}", d.words);
    assert!(d.recommended.is_empty() && d.candidates.iter().all(|c| c.probability < 0.5), "{:?}", d.candidates);
    let d = judged_with(vec![Hidden::new("frame-vibration", 0.5)], wrong);
    assert_eq!((d.verdict, d.recommended.clone()), (Verdict::EffectMissing, vec!["frame-vibration".to_owned()]), "{:?}", d.words);
    assert!(d.words[1].contains("string-tilt.strength is"), "{:?}", d.words);
    // Left to the fit, it is found to be none.
    let d = judged_with(Vec::new(), "[effects.string-tilt]\nstrength = { value = 1.0, fit = true }\n");
    assert_eq!(d.verdict, Verdict::Adequate, "{:?}", d.words);
    assert!(d.notes.iter().any(|n| n.contains("string-tilt, which the model has, does not show")), "{:?}", d.notes);
}

/// A column that does not hold what its name says is no physics: it is told, and nothing physical is named in its place.
#[test]
fn truth_columns_that_hold_something_else_are_told() {
    let turned = |row: &mut ImpactRow| scaled(row, "ball_out_wx", -1.0);
    let miles_an_hour = |row: &mut ImpactRow| {
        for column in ["ball_in_vx", "ball_in_vy", "ball_in_vz", "ball_out_vx", "ball_out_vy", "ball_out_vz"] {
            let m = row.get(column).unwrap();
            row.set(column, Some(Measured { value: m.value / 0.447_04, sd: m.sd.map(|sd| sd / 0.447_04) }));
        }
    };
    let exchanged = |row: &mut ImpactRow| {
        let [x, y] = ["impact_x", "impact_y"].map(|c| row.get(c));
        row.set("impact_x", y);
        row.set("impact_y", x);
    };
    // The mass centre of the typical racket lies 0.1675 m nearer to the butt than the stringbed's.
    let at_the_strings = |row: &mut ImpactRow| {
        let turn = row.get("racket_out_wy").unwrap().value;
        let m = row.get("racket_out_vz").unwrap();
        row.set("racket_out_vz", Some(Measured { value: m.value - 0.1675 * turn, ..m }));
        let turn = row.get("racket_out_wz").unwrap().value;
        let m = row.get("racket_out_vy").unwrap();
        row.set("racket_out_vy", Some(Measured { value: m.value + 0.1675 * turn, ..m }));
    };
    let mistakes: [(&dyn Fn(&mut ImpactRow), &str); 4] = [
        (&turned, "`ball_out_wx` with its sign turned"),
        (&miles_an_hour, "in miles an hour (times 0.4470)"),
        (&exchanged, "`impact_x` and `impact_y` exchanged"),
        (&at_the_strings, "of the stringbed centre, not of the mass centre"),
    ];
    for (mistake, words) in mistakes {
        let (_, d) = judged(&changed(160, 3, |_, row| mistake(row)), &TableOptions::default());
        assert!(d.verdict == Verdict::Unexplained && d.recommended.is_empty() && d.candidates.iter().all(|c| c.probability < 0.5), "{words}: {:?}", d.words);
        assert!(d.words[1].contains(words) && d.notes[0].contains(words), "{words}: {:?}", d.words);
    }
    // Also where an effect is missing beside it, which stays as the error that is left.
    let mut made = generate_table(&TableSpec {
        kind: Kind::Lab,
        impacts: 160,
        hidden: vec![Hidden::new("frame-vibration", 1.0)],
        seed: 9,
        noise: NoiseOptions::default(),
    })
    .unwrap();
    let (_, d) = judged(&made, &TableOptions::default());
    assert!(d.recommended == ["frame-vibration"] && !d.words.iter().any(|w| w.contains("reads as if")), "{:?}", d.words);
    made.table.rows.iter_mut().for_each(turned);
    let (_, d) = judged(&made, &TableOptions::default());
    assert!(d.recommended.is_empty() && d.words[1].contains("`ball_out_wx` with its sign turned"), "{:?}", d.words);
}

/// What a limit of the model file keeps a number from taking up is misfit, not noise.
#[test]
fn truth_a_number_at_its_limit_leaves_a_misfit() {
    let made = changed(160, 3, |_, _| {});
    let observations = observations(&made, &TableOptions::default());
    let judged_with = |restitution: &str| {
        let text = format!("base = \"rigid\"\n[parameters]\nrestitution = {restitution}\nfriction = {{ value = 0.45, fit = true }}\n");
        let library = ModelLibrary::new(Model::parse(&text, Path::new("model.toml")).unwrap(), &observations.gear);
        let compared = compare(library.current(), &observations, "model.toml", SEED).unwrap();
        (compared, diagnose(&library, &observations, &DiagnoseOptions::default()).unwrap())
    };
    let (compared, d) = judged_with("{ value = 0.75, fit = true }");
    assert_eq!((compared.verdict, d.verdict), (Adequacy::Adequate, Verdict::Adequate), "{:?}", d.words);
    let free = compared.parameters_refitted.iter().find(|p| p.name == "restitution").unwrap();
    let most = free.value - 10.0 * free.sd;
    let (compared, d) = judged_with(&format!("{{ value = 0.5, fit = true, max = {most} }}"));
    assert!(compared.verdict == Adequacy::Inadequate && d.verdict != Verdict::Adequate, "{:?}", d.words);
    assert!(d.words[1].starts_with("restitution is at 0.") && d.words[1].contains("the most that the model allows"), "{:?}", d.words);
    let stopped = d.parameters.iter().find(|p| p.name == "restitution").unwrap();
    assert!(stopped.at_limit && !stopped.undetermined && stopped.sd < 3.0 * free.sd, "{stopped:?}");
}
