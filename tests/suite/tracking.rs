//! Tracking on practice sessions with known truth: found, named rightly, as near as the tape and ball allow.

use crate::shared::shared;
use serde_json::Value;
use std::sync::atomic::AtomicBool;
use sweetspot::calibration::{CameraId, RigidTransform, StereoRig};
use sweetspot::footage::Clip;
use sweetspot::session::Session;
use sweetspot::tracking::{ShotSetup, Target, measure_spin, track_shot};

fn numbers(v: &Value) -> Vec<f64> {
    v.as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect()
}

/// The true cameras as a rig, global axes included.
pub fn true_rig(truth: &Value) -> StereoRig {
    let pose = |name: &str| {
        let c = &truth["cameras"][name];
        let r: Vec<Vec<f64>> = c["R"].as_array().unwrap().iter().map(numbers).collect();
        let t = numbers(&c["t"]);
        RigidTransform { r: [0, 1, 2].map(|i| [r[i][0], r[i][1], r[i][2]]), t: [t[0], t[1], t[2]], sd: Default::default() }.isometry()
    };
    let camera = |name: &str| {
        let c = &truth["cameras"][name];
        let k: Vec<Vec<f64>> = c["K"].as_array().unwrap().iter().map(numbers).collect();
        serde_json::json!({"fx": k[0][0], "fy": k[1][1], "cx": k[0][2], "cy": k[1][2], "distortion": c["dist"], "rms_px": 0.1})
    };
    let (left, right) = (pose("left"), pose("right"));
    let between = RigidTransform::from_isometry(&(right * left.inverse()));
    serde_json::from_value(serde_json::json!({
        "image_size": [512, 512], "left": camera("left"), "right": camera("right"), "R": between.r, "T": between.t,
        "rms_stereo_px": 0.1, "global_from_left": RigidTransform::from_isometry(&left.inverse()),
    }))
    .unwrap()
}

/// Share of visible targets found, points farther than 4 px from their target, and root-mean-square error of the ball, px,
/// outside contact.
fn score(kind: &str, shot_id: &str) -> Option<(f64, usize, f64)> {
    let folder = shared(&format!("practice/footage/{kind}"))?;
    let truth: Value = serde_json::from_str(&std::fs::read_to_string(folder.with_extension("truth.json")).unwrap()).unwrap();
    let session = Session::open(&folder).unwrap();
    let shot = session.shots.iter().find(|s| s.id == shot_id).unwrap();
    let rig = true_rig(&truth);
    let setup = ShotSetup { rig: &rig, racket: &shot.racket, ball: &shot.ball, frame_rate_hz: session.frame_rate_hz };
    let clip = Clip::list(&shot.camera("left"), &shot.camera("right")).unwrap();
    let mut tracked = track_shot(&clip, &setup, &AtomicBool::new(false), &|_| ()).unwrap();
    measure_spin(&clip, &setup, &mut tracked).unwrap();
    let truth = &truth["shots"][shot_id];
    let last_contact = truth["contact_time"].as_f64().unwrap();
    let (mut seen, mut found, mut wrong, mut ball) = (0, 0, 0, Vec::new());
    for frame in truth["frames"].as_array().unwrap() {
        let (number, t) = (frame["frame"].as_u64().unwrap(), frame["t"].as_f64().unwrap());
        for camera in CameraId::BOTH {
            for target in Target::ALL {
                let p = &frame["cameras"][camera.name()][target.name()];
                let visible = p["visible"].as_bool() == Some(true) && p["fraction"].as_f64().unwrap_or(0.0) >= 0.5;
                seen += usize::from(visible);
                let Some(point) = tracked.tracks.get(number, camera, target) else { continue };
                let error = (point.uv.x - p["u"].as_f64().unwrap()).hypot(point.uv.y - p["v"].as_f64().unwrap());
                if error > 4.0 {
                    wrong += 1;
                    continue;
                }
                found += usize::from(visible);
                if target == Target::Ball && !(-5e-4..last_contact + 5e-4).contains(&t) {
                    ball.push(error);
                }
            }
        }
    }
    let rms = (ball.iter().map(|e| e * e).sum::<f64>() / ball.len() as f64).sqrt();
    Some((found as f64 / seen as f64, wrong, rms))
}

#[test]
fn real_lab_and_hard_sessions_are_tracked_without_a_false_point() {
    // Bars of the tracking room: 99.5 % and 93 % found; 96.7 % are in hard light. The ball's centre: 0.08 and 0.10 px measured; the outline alone gave 0.16
    // and 0.17 px.
    for (kind, shot, share, most) in [("lab-11", "s01", 0.995, 0.10), ("hard-13", "s01", 0.96, 0.12)] {
        let Some((found, wrong, ball)) = score(kind, shot) else { return };
        assert!(found >= share, "{kind}: {found}");
        assert_eq!(wrong, 0, "{kind}");
        assert!(ball < most, "{kind}: ball {ball} px");
    }
}
