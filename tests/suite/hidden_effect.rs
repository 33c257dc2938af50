//! From pixels to the missing effect: a session is rendered by a world whose physics the models do not share, and the whole
//! chain runs on the pictures alone, as a user would run it: calibrate, track, shots, compare, diagnose, add, fit, compare.

use crate::cli::{said, sweetspot};
use serde_json::Value;

fn json(path: std::path::PathBuf) -> Value {
    serde_json::from_str(&std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))).unwrap()
}

#[test]
fn truth_from_pixels_the_hidden_effect_is_named_first_and_the_error_falls_to_the_noise() {
    let folder = tempfile::tempdir().unwrap();
    let place = folder.path().join("game");
    let out =
        sweetspot(&["--json", "demo", place.to_str().unwrap(), "--hidden-effect", "frame-vibration", "--seed", "44", "--shots", "80", "--strength", "0.35"]);
    let words = said(&out);
    assert!(out.status.success(), "{words}");
    let outcome: Value = serde_json::from_slice(&out.stdout).unwrap();
    assert!(outcome["shots_measured"].as_u64().unwrap() >= 76, "{outcome}");

    // The first model fails, and says so without being told what is hidden.
    let (before, after, diagnosis) = (json(place.join("compare.json")), json(place.join("found/compare.json")), json(place.join("diagnosis.json")));
    assert_eq!(before["verdict"], "inadequate");
    assert_eq!(diagnosis["verdict"], "effect-missing", "{words}");
    let first = &diagnosis["candidates"][0];
    assert_eq!(first["effect"], "frame-vibration", "{words}");
    assert!(first["probability"].as_f64().unwrap() > 0.9, "{first}");
    assert_eq!(outcome["found"], serde_json::json!(["frame-vibration"]), "{words}");

    // With it the error on shots the fit never saw comes down to the noise. (Of eighty shots some twenty are held out, and chance alone moves their error
    // by a twentieth of the floor.)
    let (error, floor) = (after["heldout_error"].as_f64().unwrap(), after["noise_floor"].as_f64().unwrap());
    assert!(error < 0.6 * before["heldout_error_refitted"].as_f64().unwrap(), "the error must fall: {words}");
    assert!(error < 1.1 * floor, "held-out error {error:.3}, floor {floor:.3}");

    assert!(words.contains("Hidden in this world: frame-vibration"), "{words}");
    assert!(words.contains("The diagnosis named frame-vibration: right."), "{words}");
    let report = std::fs::read_to_string(place.join("report.html")).unwrap();
    assert!(report.contains("frame-vibration") && report.contains("<svg"));
}

#[test]
fn truth_from_pixels_nothing_hidden_is_nothing_found() {
    let folder = tempfile::tempdir().unwrap();
    let place = folder.path().join("game");
    let out = sweetspot(&["--json", "demo", place.to_str().unwrap(), "--hidden-effect", "none", "--seed", "45", "--shots", "60"]);
    let words = said(&out);
    let outcome: Value = serde_json::from_slice(&out.stdout).unwrap();
    // Exit status 1 where a shot failed, and only there.
    assert_eq!(out.status.code(), Some(i32::from(!outcome["failed"].as_array().unwrap().is_empty())), "{words}");
    assert!(outcome["shots_measured"].as_u64().unwrap() >= 56, "{outcome}");
    assert_eq!((outcome["verdict"].as_str(), outcome["formula"].as_bool()), (Some("adequate"), Some(false)), "{words}");
    assert_eq!(outcome["found"], serde_json::json!([]), "{words}");
    assert!(words.contains("Hidden in this world: nothing.") && words.contains("The diagnosis added nothing: right."), "{words}");
}
