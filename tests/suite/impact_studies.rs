//! `explore` and `predict --sensitivities` as a user runs them.

use crate::impact_scene::impacts;
use std::path::Path;
use std::process::Command;
use sweetspot::impact_table::{INPUTS, OUTPUTS};

/// What the command says.
fn sweetspot(folder: &Path, arguments: &[&str]) -> String {
    let done = Command::new(env!("CARGO_BIN_EXE_sweetspot")).current_dir(folder).args(arguments).output().unwrap();
    assert!(done.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&done.stderr));
    String::from_utf8_lossy(&done.stdout).into_owned()
}

fn write_racket_and_ball(folder: &Path) {
    let racket = "name = \"test\"\nmass_kg = 0.34\nlength_m = 0.685\nbalance_m = 0.33\nstringbed_centre_m = 0.4975\nswingweight_kgm2 = 0.0325\n\
                  twistweight_kgm2 = 0.0015\n[head]\ninner_length_m = 0.335\ninner_width_m = 0.255\ntube_radius_m = 0.01\n[strings]\ntension_lb = 60.0\n";
    std::fs::write(folder.join("racket.toml"), racket).unwrap();
    std::fs::write(folder.join("ball.toml"), "name = \"test\"\nmass_kg = 0.0577\ndiameter_m = 0.066\ninertia_factor = 0.55\n").unwrap();
}

#[test]
fn cli_explore_writes_every_study() {
    let folder = tempfile::tempdir().unwrap();
    write_racket_and_ball(folder.path());
    sweetspot(folder.path(), &["--out", ".", "explore", "published"]);
    let said = sweetspot(folder.path(), &["--out", ".", "explore", "models", "--ball", "ball.toml"]);
    assert!(said.contains("--ball is for `explore findings`"), "{said}");
    sweetspot(folder.path(), &["--out", ".", "explore", "findings", "--racket", "racket.toml", "--shots", "200"]);
    for (name, needles) in [
        ("published", &["Miller and Messner", "frame mode at 180 Hz", "rebound, e 0.84", "Wimbledon"][..]),
        ("models", &["Kelvin-Voigt", "squeezed flat", "Haake"][..]),
        ("findings", &["Three findings", "Chopping makes more spin", "Ball speed", "Launch angle", "String tension", "Grip: speed"][..]),
    ] {
        let page = std::fs::read_to_string(folder.path().join(format!("explore-{name}.html"))).unwrap();
        assert!(needles.iter().all(|n| page.contains(n)) && !page.contains("NaN"), "{name}");
        let json: serde_json::Value = serde_json::from_slice(&std::fs::read(folder.path().join(format!("explore-{name}.json"))).unwrap()).unwrap();
        assert!(json.as_object().is_some_and(|o| o.len() >= 2), "{name}");
    }
    // The abstract's three findings hold in the numbers.
    let json: serde_json::Value = serde_json::from_slice(&std::fs::read(folder.path().join("explore-findings.json")).unwrap()).unwrap();
    let weighted = |place: &str, kg: f64, part: &str| {
        let all = json["weighting"].as_array().unwrap();
        let one = all.iter().find(|w| w["place"] == place && w["added_kg"] == kg).unwrap();
        one[part]["speed"].as_f64().unwrap()
    };
    assert!(weighted("tip", 0.02, "tip") > weighted("tip", 0.0, "tip") + 1.0);
    let lost = |place: &str, kg: f64| weighted(place, kg, "centre") - weighted(place, kg, "edge");
    assert!(lost("sides", 0.02) < 0.9 * lost("sides", 0.0) && lost("tip", 0.02) > lost("tip", 0.0));
    let spin = |i: usize| json["chop"][i][1]["spin_rad_s"].as_f64().unwrap().abs();
    assert!(spin(5) > spin(0) + 100.0);
}

/// A table with deviations of its inputs: the prediction's own deviations follow, and every derivative is there.
#[test]
fn cli_predict_carries_deviations_into_the_prediction() {
    let folder = tempfile::tempdir().unwrap();
    write_racket_and_ball(folder.path());
    let mut table = String::from("id,") + &INPUTS.join(",") + "," + &INPUTS.map(|c| format!("{c}_sd")).join(",") + "\n";
    for (i, input) in impacts(3, 5).iter().enumerate() {
        let values = input.as_columns().map(|v| v.to_string()).join(",");
        table += &format!("s{i},{values},{}\n", INPUTS.map(|c| if c == "impact_y" { "0.002" } else { "0" }).join(","));
    }
    std::fs::write(folder.path().join("impacts.csv"), table).unwrap();
    std::fs::write(folder.path().join("model.toml"), "base = \"rigid\"\n[effects.ball-damping]\nfall = 0.1\n").unwrap();
    let files = ["--impacts", "impacts.csv", "--racket", "racket.toml", "--ball", "ball.toml", "--model", "model.toml"];
    sweetspot(folder.path(), &[&["--out", ".", "predict", "--sensitivities"][..], &files].concat());
    let read = |name: &str| {
        let mut csv = csv::Reader::from_path(folder.path().join(name)).unwrap();
        let rows: Vec<Vec<String>> = csv.records().map(|r| r.unwrap().iter().map(str::to_owned).collect()).collect();
        rows
    };
    let (slopes, deviations) = (read("sensitivities.csv"), read("predictions_sd.csv"));
    // 15 inputs and four parameters for each of three impacts.
    assert_eq!(slopes.len(), 3 * 19);
    let place = OUTPUTS.iter().position(|c| *c == "ball_out_vz").unwrap();
    for row in &deviations {
        let slope = slopes.iter().find(|s| s[0] == row[0] && s[1] == "impact_y").unwrap();
        let (expected, seen): (f64, f64) = (0.002 * slope[3 + place].parse::<f64>().unwrap().abs(), row[1 + place].parse().unwrap());
        assert!((expected - seen).abs() <= 1e-12 * (1.0 + expected) && seen > 0.0, "{expected} {seen}");
    }
    // Derivatives of another model do not stay under their name.
    let predict = || sweetspot(folder.path(), &[&["--out", ".", "predict"][..], &files].concat());
    let there = |name: &str| folder.path().join(name).exists();
    predict();
    assert!(there("sensitivities.csv") && there("predictions_sd.csv"), "the same predictions");
    std::fs::write(folder.path().join("model.toml"), "base = \"rigid\"\n[effects.ball-damping]\nfall = 0.2\n").unwrap();
    predict();
    assert!(!there("sensitivities.csv") && there("sensitivities.earlier.csv") && there("predictions_sd.earlier.csv"));
}
