//! Worlds with known truth: that the plain world is the contract's rigid model, that truth and pictures agree.

use crate::cli::{refused, said, sweetspot};
use std::collections::BTreeMap;
use std::sync::Mutex;
use std::sync::atomic::AtomicBool;
use sweetspot::impact_table::ImpactTable;
use sweetspot::session::Session;
use sweetspot::synthetic::footage_spec::FootageSpec;
use sweetspot::synthetic::footage_world::FootageWorld;
use sweetspot::synthetic::hidden::Hidden;
use sweetspot::synthetic::impact_world::{Kind, TableSpec, generate_table};
use sweetspot::synthetic::look::Setting;
use sweetspot::synthetic::scenario::TableFiles;

/// Writes a table's files and lets `sweetspot predict` answer with the world's own restitution and friction.
fn predicted(spec: &TableSpec, folder: &std::path::Path) -> (ImpactTable, ImpactTable) {
    let made = generate_table(spec).unwrap();
    for (name, text) in TableFiles::of(&made).unwrap().0 {
        std::fs::write(folder.join(name), text).unwrap();
    }
    let model =
        format!("base = \"rigid\"\n[parameters]\nrestitution = {{ value = {} }}\nfriction = {{ value = {} }}\n", made.truth.restitution, made.truth.friction);
    std::fs::write(folder.join("model.toml"), model).unwrap();
    let file = |name: &str| folder.join(name).to_str().unwrap().to_owned();
    let out = sweetspot(&[
        "predict",
        "--impacts",
        &file("impacts.csv"),
        "--racket",
        &file("racket.toml"),
        "--ball",
        &file("ball.toml"),
        "--model",
        &file("model.toml"),
    ]);
    assert!(out.status.success(), "{}", said(&out));
    (made.table, ImpactTable::read(&folder.join("predictions.csv")).unwrap())
}

#[test]
fn agrees_with_nothing_hidden_the_stepped_contact_is_the_rigid_model() {
    for kind in [Kind::Lab, Kind::Court] {
        let folder = tempfile::tempdir().unwrap();
        let mut spec = TableSpec::new(kind, 200, 5);
        spec.noise.scale = 1e-9;
        let (table, predictions) = predicted(&spec, folder.path());
        // An impact at the very edge between sliding and sticking may end on the other side of it.
        let mut beyond = 0;
        for (row, p) in table.rows.iter().zip(&predictions.rows) {
            let off = |c: &str| (row.get(c).unwrap().value - p.get(c).unwrap().value).abs();
            let speed = ["ball_out_vx", "ball_out_vy", "ball_out_vz"].map(off).into_iter().fold(0.0, f64::max);
            let spin = ["ball_out_wx", "ball_out_wy", "ball_out_wz"].map(off).into_iter().fold(0.0, f64::max);
            assert!(off("ball_out_vz") < 0.005, "{}: {}", row.id, off("ball_out_vz"));
            beyond += usize::from(speed > 0.01 || spin > 0.8); // a tenth of the noise
        }
        assert!(beyond <= 2, "{kind:?}: {beyond} of 200 impacts differ by more than a tenth of the noise");
    }
}

#[test]
fn switch_a_hidden_effect_is_far_from_the_rigid_model() {
    let folder = tempfile::tempdir().unwrap();
    let mut spec = TableSpec { hidden: vec![Hidden::new("frame-vibration", 1.0)], ..TableSpec::new(Kind::Lab, 60, 5) };
    spec.noise.scale = 1e-9;
    let (table, predictions) = predicted(&spec, folder.path());
    let worst =
        table.rows.iter().zip(&predictions.rows).map(|(r, p)| r.get("ball_out_vz").unwrap().value - p.get("ball_out_vz").unwrap().value).fold(0.0, f64::min);
    assert!(worst < -2.0, "throat hits lose metres per second: {worst}");
}

#[test]
fn law_the_same_seed_gives_the_same_table_on_any_number_of_threads() {
    let spec = TableSpec { hidden: vec![Hidden::new("lateral-strings", 0.7)], ..TableSpec::new(Kind::Lab, 40, 9) };
    let here = generate_table(&spec).unwrap();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let alone = pool.install(|| generate_table(&spec).unwrap());
    assert_eq!(here.table.to_csv(), alone.table.to_csv());
    let other = generate_table(&TableSpec { seed: 10, ..spec }).unwrap();
    assert_ne!(here.table.to_csv(), other.table.to_csv());
}

fn filmed(spec: &FootageSpec) -> (BTreeMap<String, Vec<u8>>, serde_json::Value) {
    let files = Mutex::new(BTreeMap::new());
    let world = FootageWorld::new(spec).unwrap();
    let sink = |name: &str, bytes: &[u8]| {
        files.lock().unwrap().insert(name.to_owned(), bytes.to_vec());
        Ok(())
    };
    let truth = world.film(&sink, &|| (), &AtomicBool::new(false)).unwrap();
    (files.into_inner().unwrap(), truth)
}

#[test]
fn truth_what_stands_in_the_pictures_is_what_the_truth_says() {
    let spec = FootageSpec { boards: 4, frames_before: 6, frames_after: 6, noise: 0.2, ..FootageSpec::new(Setting::Lab, 1, 4) };
    let (files, truth) = filmed(&spec);
    let folder = tempfile::tempdir().unwrap();
    for (name, bytes) in &files {
        let path = folder.path().join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, bytes).unwrap();
    }
    let session = Session::open(folder.path()).unwrap();
    assert_eq!(session.shots.len(), 1);
    // The light's centroid over the background, inside a small window, is the visible tape's centroid.
    let mut compared = 0;
    for frame in truth["shots"]["shot-01"]["frames"].as_array().unwrap() {
        for camera in ["left", "right"] {
            let name = format!("shots/shot-01/{camera}/frame_{:06}.bmp", frame["frame"].as_u64().unwrap());
            let picture = image::load_from_memory(&files[&name]).unwrap().to_luma8();
            let ball = &frame["cameras"][camera]["ball"];
            for target in ["m1", "m2", "m3"] {
                let m = &frame["cameras"][camera][target];
                let at = |k: &str| m[k].as_f64().unwrap();
                let near_ball = (ball["u"].as_f64().unwrap() - at("u")).hypot(ball["v"].as_f64().unwrap() - at("v")) < 22.0;
                if at("fraction") < 1.0 || near_ball {
                    continue;
                }
                let (mut sum, mut su, mut sv) = (0.0, 0.0, 0.0);
                for v in at("patch_v") as u32 - 6..=at("patch_v") as u32 + 6 {
                    for u in at("patch_u") as u32 - 6..=at("patch_u") as u32 + 6 {
                        let bright = (f64::from(picture.get_pixel(u, v).0[0]) - 70.0).max(0.0);
                        (sum, su, sv) = (sum + bright, su + bright * f64::from(u), sv + bright * f64::from(v));
                    }
                }
                let miss = (su / sum - at("patch_u")).hypot(sv / sum - at("patch_v"));
                assert!(miss < 0.35, "{name} {target}: {miss} px");
                compared += 1;
            }
        }
    }
    assert!(compared > 50, "{compared}");
}

#[test]
fn switch_matt_surfaces_shade_the_tape_and_darken_the_balls_limb() {
    let plain = FootageSpec { boards: 1, frames_before: 6, frames_after: 6, noise: 0.2, ..FootageSpec::new(Setting::Lab, 1, 4) };
    let matt = FootageSpec { matt: true, ..plain.clone() };
    let [(plain, truth), (matt, _)] = [&plain, &matt].map(filmed);
    let mean = |files: &BTreeMap<String, Vec<u8>>, name: &str, centre: (f64, f64), ring: std::ops::Range<f64>| {
        let picture = image::load_from_memory(&files[name]).unwrap().to_luma8();
        let inside = |(u, v, _): &(u32, u32, &image::Luma<u8>)| ring.contains(&(f64::from(*u) - centre.0).hypot(f64::from(*v) - centre.1));
        let greys: Vec<f64> = picture.enumerate_pixels().filter(inside).map(|p| f64::from(p.2.0[0])).collect();
        greys.iter().sum::<f64>() / greys.len() as f64
    };
    // Long before the impact nothing is near the ball.
    let frame = &truth["shots"]["shot-01"]["frames"][0];
    let name = format!("shots/shot-01/left/frame_{:06}.bmp", frame["frame"].as_u64().unwrap());
    let at = |target: &str, u: &str, v: &str| (frame["cameras"]["left"][target][u].as_f64().unwrap(), frame["cameras"]["left"][target][v].as_f64().unwrap());
    let ball = at("ball", "u", "v");
    let limb = |files| mean(files, &name, ball, 6.0..7.0) / mean(files, &name, ball, 0.0..3.0);
    let darker = limb(&matt) / limb(&plain);
    assert!((0.85..0.95).contains(&darker), "{darker}");
    let tape = at("m2", "patch_u", "patch_v");
    let dimmer = mean(&matt, &name, tape, 0.0..2.0) / mean(&plain, &name, tape, 0.0..2.0);
    assert!((0.6..0.95).contains(&dimmer), "{dimmer}");
}

#[test]
fn cli_synth_names_what_is_wrong_with_a_scenario() {
    let folder = tempfile::tempdir().unwrap();
    let path = |n: &str| folder.path().join(n).to_str().unwrap().to_owned();
    for (text, words) in [
        ("kind = \"table\"\nsetting = \"lab\"\nimpacts = 0\nseed = 1\n", vec!["impacts", "100000"]),
        ("kind = \"table\"\nsetting = \"lab\"\nimpacts = 5\nseed = 1\ncolour = 3\n", vec!["colour"]),
        ("kind = \"footage\"\nsetting = \"lab\"\nshots = 1\nseed = 1\n[[hidden]]\neffect = \"scale-error\"\n", vec!["scale-error", "table"]),
        ("kind = \"footage\"\nsetting = \"lab\"\nshots = 1\nseed = 1\n[[hidden]]\neffect = \"moonlight\"\n", vec!["moonlight", "frame-vibration"]),
    ] {
        std::fs::write(path("s.toml"), text).unwrap();
        refused(&["synth", &path("s.toml"), "-o", &path("out")], &words);
    }
    refused(&["synth", &path("absent.toml"), "-o", &path("out")], &["absent.toml"]);
}
