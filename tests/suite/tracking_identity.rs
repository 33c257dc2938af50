//! Names of the markers: none takes another's, whatever is lost on the way; the throat's tubes run as they do.

use crate::shared::shared;
use crate::tracking::true_rig;
use serde_json::Value;
use std::sync::atomic::AtomicBool;
use sweetspot::calibration::CameraId;
use sweetspot::footage::Clip;
use sweetspot::session::Session;
use sweetspot::synthetic::footage_spec::FootageSpec;
use sweetspot::synthetic::footage_world::FootageWorld;
use sweetspot::synthetic::look::Setting;
use sweetspot::tracking::{ShotSetup, Target, Tracks, track_shot};

/// Points that are nearer to another marker's visible tape than to their own and not within 4 px of their own, and all points.
fn swapped(truth: &Value, tracks: &Tracks) -> (usize, usize) {
    let (mut swaps, mut all) = (0, 0);
    for frame in truth["frames"].as_array().unwrap() {
        let number = frame["frame"].as_u64().unwrap();
        for camera in CameraId::BOTH {
            let off = |target: Target, measured: Target| {
                let p = &frame["cameras"][camera.name()][target.name()];
                let point = tracks.get(number, camera, measured)?;
                Some((point.uv.x - p["u"].as_f64()?).hypot(point.uv.y - p["v"].as_f64()?))
            };
            for target in Target::MARKERS {
                let Some(own) = off(target, target) else { continue };
                let nearest = Target::MARKERS.into_iter().filter_map(|other| off(other, target)).fold(f64::INFINITY, f64::min);
                all += 1;
                swaps += usize::from(own > nearest && own > 4.0);
            }
        }
    }
    (swaps, all)
}

#[test]
fn real_markers_keep_their_names_when_five_frames_in_a_row_are_missing_again_and_again() {
    for (kind, id) in [("court-12", "s01"), ("court-12", "s02"), ("hard-13", "s01"), ("lab-11", "s02")] {
        let Some(folder) = shared(&format!("practice/footage/{kind}")) else { return };
        let truth: Value = serde_json::from_str(&std::fs::read_to_string(folder.with_extension("truth.json")).unwrap()).unwrap();
        let session = Session::open(&folder).unwrap();
        let shot = session.shots.iter().find(|s| s.id == id).unwrap();
        let rig = true_rig(&truth);
        let setup = ShotSetup { rig: &rig, racket: &shot.racket, ball: &shot.ball, frame_rate_hz: session.frame_rate_hz };
        let mut clip = Clip::list(&shot.camera("left"), &shot.camera("right")).unwrap();
        // On the court the racket swings by up to 25 px, a third of its width, while five frames are missing.
        let mut index = 0;
        clip.pairs.retain(|_| {
            index += 1;
            index % 9 < 4
        });
        let made = track_shot(&clip, &setup, &AtomicBool::new(false), &|_| ()).unwrap();
        let (swaps, all) = swapped(&truth["shots"][id], &made.tracks);
        assert_eq!(swaps, 0, "{kind} {id}: of {all}");
        assert!(all > 5 * clip.pairs.len(), "{kind} {id}: {all} points in {} frames", clip.pairs.len());
    }
}

/// A white line on the court, seen along, has noise on it that makes figures of faint bands; it was the racket of both shots once.
#[test]
fn truth_noise_along_a_white_line_is_no_racket() {
    let found = found_share(&FootageSpec { boards: 1, ..FootageSpec::new(Setting::Hard, 2, 1013) });
    assert!(found > 0.93, "{found}");
}

/// White lines on a dark floor, far from the racket: they have hundreds of places that are stronger than tape in a dim hall, none of which keeps its
/// place. Too few bands were among the strongest, and the shot failed.
#[test]
fn truth_long_white_lines_do_not_keep_the_racket_from_being_found() {
    let lines = |image: &mut image::GrayImage| {
        for (x, y, pixel) in image.enumerate_pixels_mut() {
            // The camera's noise makes the lines uneven.
            let uneven = 2 * (pixel.0[0] % 8);
            pixel.0[0] /= 2;
            if y >= 448 {
                let off = [465.0, 484.0, 503.0].map(|middle: f64| (f64::from(y) + 0.02 * f64::from(x) - middle).abs());
                let share = (2.0 - off.into_iter().fold(f64::INFINITY, f64::min)).clamp(0.0, 1.0);
                pixel.0[0] = (share * f64::from(235 + uneven) + (1.0 - share) * 20.0) as u8;
            }
        }
    };
    let found = found_share_in(&FootageSpec { boards: 1, ..FootageSpec::new(Setting::Hard, 1, 1013) }, Some(&lines));
    assert!(found > 0.93, "{found}");
}

/// Letters on the back wall are brighter than tape in the shade, and make figures. They were the racket of the second shot of 1303, and of 1302's
/// first, in which one tape is not among the strongest candidates at all.
#[test]
fn truth_lettering_brighter_than_the_tape_is_no_racket() {
    for seed in [1302, 1303] {
        let found = found_share(&FootageSpec { boards: 1, matt: true, ..FootageSpec::new(Setting::Court, 2, seed) });
        assert!(found > 0.98, "{seed}: {found}");
    }
}

/// A racket turns edge-on to one camera: one tube passes behind the other, and the tape on the far side comes out of the shade's side. Before, the
/// hidden band was measured on the tape before it, and shaded ones not at all: 0.975 in the lab, 0.953 on court.
#[test]
fn truth_tubes_that_pass_behind_each_other_and_tape_in_the_shade_are_followed() {
    for (setting, seed, least) in [(Setting::Lab, 1301, 0.995), (Setting::Court, 1308, 0.98)] {
        let found = found_share(&FootageSpec { boards: 1, matt: true, ..FootageSpec::new(setting, 2, seed) });
        assert!(found > least, "{setting:?} {seed}: {found}");
    }
}

/// A long clip: a tenth of a second before it meets the ball a swung racket's face looks anywhere, and it comes into one camera's view long before
/// the other's. The face was told by the clip's first frames, and every marker of both shots had another's name.
#[test]
fn truth_a_racket_that_comes_from_afar_keeps_the_face_it_meets_the_ball_with() {
    let found = found_share(&FootageSpec { boards: 1, frames_before: 130, frames_after: 40, ..FootageSpec::new(Setting::Court, 2, 84) });
    assert!(found > 0.93, "{found}");
}

/// In the laboratory a racket turns edge-on: of the tape at its sides two pixels are seen. A speck had to be as bright as a band, and 0.979 were found.
#[test]
fn truth_tape_of_which_two_pixels_are_seen_is_found() {
    let found = found_share(&FootageSpec { boards: 1, frames_before: 20, frames_after: 130, ..FootageSpec::new(Setting::Lab, 1, 96) });
    assert!(found > 0.987, "{found}");
}

/// Share of the visible tape that was found over all shots; what is found must be where it is.
fn found_share(spec: &FootageSpec) -> f64 {
    found_share_in(spec, None)
}

/// The same in pictures of the shots that are drawn over.
fn found_share_in(spec: &FootageSpec, draw: Option<&(dyn Fn(&mut image::GrayImage) + Sync)>) -> f64 {
    let folder = tempfile::tempdir().unwrap();
    let sink = |name: &str, bytes: &[u8]| {
        let path = folder.path().join(name);
        std::fs::create_dir_all(path.parent().unwrap())?;
        match draw.filter(|_| name.starts_with("shots/") && !name.ends_with(".toml")) {
            Some(draw) => {
                let mut picture = image::load_from_memory(bytes).unwrap().into_luma8();
                draw(&mut picture);
                picture.save(path).map_err(std::io::Error::other)
            }
            None => std::fs::write(path, bytes),
        }
    };
    let truth = FootageWorld::new(spec).unwrap().film(&sink, &|| (), &AtomicBool::new(false)).unwrap();
    let session = Session::open(folder.path()).unwrap();
    let rig = true_rig(&truth);
    let (mut visible, mut found) = (0, 0);
    for shot in &session.shots {
        let setup = ShotSetup { rig: &rig, racket: &shot.racket, ball: &shot.ball, frame_rate_hz: session.frame_rate_hz };
        let clip = Clip::list(&shot.camera("left"), &shot.camera("right")).unwrap();
        let made = track_shot(&clip, &setup, &AtomicBool::new(false), &|_| ()).unwrap();
        let (mut near, mut all) = (0, 0);
        for frame in truth["shots"][&shot.id]["frames"].as_array().unwrap() {
            let number = frame["frame"].as_u64().unwrap();
            for (camera, target) in CameraId::BOTH.into_iter().flat_map(|c| Target::MARKERS.map(|t| (c, t))) {
                let p = &frame["cameras"][camera.name()][target.name()];
                if p["visible"] == true && p["fraction"].as_f64().unwrap() >= 0.5 {
                    visible += 1;
                    found += usize::from(made.tracks.get(number, camera, target).is_some());
                }
                let (Some(point), Some(u), Some(v)) = (made.tracks.get(number, camera, target), p["u"].as_f64(), p["v"].as_f64()) else { continue };
                all += 1;
                near += usize::from((point.uv.x - u).hypot(point.uv.y - v) < 4.0);
            }
        }
        assert!(near == all, "{}: {near} of {all} points are where the markers are", shot.id);
    }
    found as f64 / f64::from(visible)
}

#[test]
fn truth_the_tubes_of_the_throat_run_and_are_as_wide_as_they_were_rendered() {
    for setting in [Setting::Lab, Setting::Hard] {
        let folder = tempfile::tempdir().unwrap();
        let sink = |name: &str, bytes: &[u8]| {
            let path = folder.path().join(name);
            std::fs::create_dir_all(path.parent().unwrap())?;
            std::fs::write(path, bytes)
        };
        let spec = FootageSpec { boards: 1, ..FootageSpec::new(setting, 1, 77) };
        let truth = FootageWorld::new(&spec).unwrap().film(&sink, &|| (), &AtomicBool::new(false)).unwrap();
        let session = Session::open(folder.path()).unwrap();
        let (rig, shot) = (true_rig(&truth), &session.shots[0]);
        let setup = ShotSetup { rig: &rig, racket: &shot.racket, ball: &shot.ball, frame_rate_hz: session.frame_rate_hz };
        let clip = Clip::list(&shot.camera("left"), &shot.camera("right")).unwrap();
        let made = track_shot(&clip, &setup, &AtomicBool::new(false), &|_| ()).unwrap();
        // The rendered throat starts 11 mm beside the axis, 95 mm behind the marker (src/synthetic/racket_shape.rs).
        let marker = shot.racket.markers.as_ref().unwrap().points()[3];
        let rendered = (marker.y.abs() - 0.011).atan2(0.095).to_degrees();
        let found = made.figure.throat_angle().unwrap().to_degrees();
        // Measured: 0.4 degrees where black bands stand out from what is behind, 2.2 before a dark curtain, where only the white
        // shows; the tangent to the head, taken where nothing is seen, is 15 degrees off.
        assert!((found - rendered).abs() < 3.0, "{setting:?}: {found} for {rendered} degrees");
        // They are rendered 0.95 times as wide as the head's, of which racket.toml speaks. Measured: 0.93 to 0.95 in the lab; low
        // contrast tells little, and then the width stays nearly the head's.
        let width = made.figure.tube_radius_m[3] / made.figure.tube_radius_m[0];
        let allowed = if setting == Setting::Lab { 0.92..0.98 } else { 0.92..1.03 };
        assert!(allowed.contains(&width), "{setting:?}: {width}");
    }
}
