//! The ball through a whole shot, where one camera hardly sees it.

use crate::tracking::true_rig;
use std::sync::atomic::AtomicBool;
use sweetspot::calibration::CameraId;
use sweetspot::footage::Clip;
use sweetspot::session::Session;
use sweetspot::synthetic::footage_spec::FootageSpec;
use sweetspot::synthetic::footage_world::FootageWorld;
use sweetspot::synthetic::look::Setting;
use sweetspot::tracking::{ShotSetup, Target, track_shot};

#[test]
fn truth_a_ball_before_lettering_in_one_camera_is_followed_to_the_end() {
    // After the contact of the second shot the right camera sees the ball before lettering for twenty frames.
    let folder = tempfile::tempdir().unwrap();
    let sink = |name: &str, bytes: &[u8]| {
        let path = folder.path().join(name);
        std::fs::create_dir_all(path.parent().unwrap())?;
        std::fs::write(path, bytes)
    };
    let spec = FootageSpec { boards: 1, ..FootageSpec::new(Setting::Court, 2, 1002) };
    let truth = FootageWorld::new(&spec).unwrap().film(&sink, &|| (), &AtomicBool::new(false)).unwrap();
    let session = Session::open(folder.path()).unwrap();
    let (rig, shot) = (true_rig(&truth), &session.shots[1]);
    let setup = ShotSetup { rig: &rig, racket: &shot.racket, ball: &shot.ball, frame_rate_hz: session.frame_rate_hz };
    let clip = Clip::list(&shot.camera("left"), &shot.camera("right")).unwrap();
    let made = track_shot(&clip, &setup, &AtomicBool::new(false), &|_| ()).unwrap();
    let (mut near, mut found, mut there) = (0, 0, 0);
    for frame in truth["shots"][&shot.id]["frames"].as_array().unwrap() {
        for camera in CameraId::BOTH {
            let ball = &frame["cameras"][camera.name()]["ball"];
            let (Some(u), Some(v)) = (ball["u"].as_f64(), ball["v"].as_f64()) else { continue };
            there += 1;
            let Some(point) = made.tracks.get(frame["frame"].as_u64().unwrap(), camera, Target::Ball) else { continue };
            found += 1;
            near += usize::from((point.uv.x - u).hypot(point.uv.y - v) < 2.0);
        }
    }
    // 50 of 92 when a flight needed both cameras from the beginning.
    assert!(found == near && found as f64 > 0.85 * f64::from(there), "{near} near of {found} found of {there}");
}
