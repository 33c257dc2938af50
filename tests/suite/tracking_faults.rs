//! Faults of real recordings, made from practice shots: a picture missing, repeated, dark or washed out, cameras out of
//! step, long waits without a racket, bright things beside the ball, a second ball.

use crate::shared::shared;
use crate::tracking::true_rig;
use image::GrayImage;
use nalgebra::{Vector2, Vector3};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use sweetspot::calibration::{CameraId, StereoRig};
use sweetspot::footage::{Clip, read_grey};
use sweetspot::session::{Session, ShotFolder};
use sweetspot::tracking::spin::{SpinEstimate, SpinRefusal};
use sweetspot::tracking::{InStep, ShotSetup, SyncMode, Target, TrackingError, measure_spin, track_in_step};

/// A practice shot copied where it may be spoilt.
struct Recording {
    folder: tempfile::TempDir,
    truth: Value,
    rig: StereoRig,
    shot: ShotFolder,
    frame_rate_hz: f64,
}

impl Recording {
    fn of(kind: &str) -> Option<Self> {
        let session = shared(&format!("practice/footage/{kind}"))?;
        let truth: Value = serde_json::from_str(&std::fs::read_to_string(session.with_extension("truth.json")).unwrap()).unwrap();
        let (rig, opened) = (true_rig(&truth), Session::open(&session).unwrap());
        let shot = opened.shots.iter().find(|s| s.id == "s01").unwrap().clone();
        let folder = tempfile::tempdir().unwrap();
        for camera in CameraId::BOTH {
            let place = folder.path().join(camera.name());
            std::fs::create_dir(&place).unwrap();
            let clip = Clip::list(&shot.camera("left"), &shot.camera("right")).unwrap();
            for pair in &clip.pairs {
                if let Some(from) = &pair.files[camera.index()] {
                    std::fs::copy(from, place.join(format!("f_{}.png", pair.number))).unwrap();
                }
            }
        }
        Some(Recording { folder, truth: truth["shots"]["s01"].clone(), rig, shot, frame_rate_hz: opened.frame_rate_hz })
    }

    fn file(&self, camera: CameraId, frame: u64) -> PathBuf {
        self.folder.path().join(camera.name()).join(format!("f_{frame}.png"))
    }

    fn frames(&self) -> Vec<u64> {
        self.truth["frames"].as_array().unwrap().iter().map(|f| f["frame"].as_u64().unwrap()).collect()
    }

    /// Those that are there.
    fn pictures(&self) -> Vec<(CameraId, u64)> {
        let all = CameraId::BOTH.into_iter().flat_map(|camera| self.frames().into_iter().map(move |frame| (camera, frame)));
        all.filter(|(camera, frame)| self.file(*camera, *frame).exists()).collect()
    }

    /// Changes one picture; tells the painter where the true targets are.
    fn paint(&self, camera: CameraId, frame: u64, paint: impl FnOnce(&mut GrayImage)) {
        let path = self.file(camera, frame);
        let grey = read_grey(&path).unwrap();
        let mut image = GrayImage::from_raw(grey.width as u32, grey.height as u32, grey.pixels).unwrap();
        paint(&mut image);
        image.save(&path).unwrap();
    }

    fn place(&self, camera: CameraId, frame: u64, target: Target) -> (f64, f64) {
        let f = self.truth["frames"].as_array().unwrap().iter().find(|f| f["frame"] == frame).unwrap();
        let p = &f["cameras"][camera.name()][target.name()];
        (p["u"].as_f64().unwrap(), p["v"].as_f64().unwrap())
    }

    fn track(&self, mode: SyncMode) -> Result<InStep, TrackingError> {
        let clip = Clip::list(&self.folder.path().join("left"), &self.folder.path().join("right")).unwrap();
        let setup = ShotSetup { rig: &self.rig, racket: &self.shot.racket, ball: &self.shot.ball, frame_rate_hz: self.frame_rate_hz };
        track_in_step(&clip, &setup, mode, &AtomicBool::new(false), &|_| ())
    }

    /// A session of this shot alone, calibrated.
    fn session(&self, practice: &Path) -> tempfile::TempDir {
        let session = tempfile::tempdir().unwrap();
        for name in ["session.toml", "racket.toml", "ball.toml"] {
            std::fs::copy(practice.join(name), session.path().join(name)).unwrap();
        }
        let shot = session.path().join("shots/s01");
        for camera in CameraId::BOTH {
            std::fs::create_dir_all(shot.join(camera.name())).unwrap();
            for entry in std::fs::read_dir(self.folder.path().join(camera.name())).unwrap() {
                let from = entry.unwrap().path();
                std::fs::copy(&from, shot.join(camera.name()).join(from.file_name().unwrap())).unwrap();
            }
        }
        let results = session.path().join("results");
        std::fs::create_dir_all(&results).unwrap();
        std::fs::write(results.join("calibration.json"), serde_json::to_string(&self.rig).unwrap()).unwrap();
        session
    }

    /// Share of the visible targets found, and points farther than 4 px from their target; `left_out` frames do not count.
    fn score(&self, made: &InStep, shift_of_numbers: u64, left_out: &[u64]) -> (f64, usize) {
        let (mut seen, mut found, mut wrong) = (0, 0, 0);
        for f in self.truth["frames"].as_array().unwrap() {
            let number = f["frame"].as_u64().unwrap();
            if left_out.contains(&number) {
                continue;
            }
            for camera in CameraId::BOTH {
                for target in Target::ALL {
                    let p = &f["cameras"][camera.name()][target.name()];
                    let visible = p["visible"] == true && p["fraction"].as_f64().unwrap_or(0.0) >= 0.5;
                    seen += usize::from(visible);
                    let Some(point) = made.tracked.tracks.get(number + shift_of_numbers, camera, target) else { continue };
                    let error = (point.uv.x - p["u"].as_f64().unwrap()).hypot(point.uv.y - p["v"].as_f64().unwrap());
                    found += usize::from(visible && error <= 4.0);
                    wrong += usize::from(error > 4.0);
                }
            }
        }
        (found as f64 / seen as f64, wrong)
    }

    /// How far the ball's centres lie from the true ones outside the contact, root mean square, px.
    fn ball_off_px(&self, made: &InStep) -> f64 {
        let contact = self.truth["contact_time"].as_f64().unwrap();
        let mut squares = Vec::new();
        for f in self.truth["frames"].as_array().unwrap() {
            let (number, t) = (f["frame"].as_u64().unwrap(), f["t"].as_f64().unwrap());
            for camera in CameraId::BOTH {
                let Some(point) = made.tracked.tracks.get(number, camera, Target::Ball).filter(|_| !(-5e-4..contact + 5e-4).contains(&t)) else { continue };
                let (u, v) = self.place(camera, number, Target::Ball);
                squares.push((point.uv.x - u).powi(2) + (point.uv.y - v).powi(2));
            }
        }
        (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
    }

    /// How far a marker's points lie from the centroids of its visible tape in one camera, median along either side of the picture, px.
    fn band_off_px(&self, made: &InStep, camera: CameraId, marker: Target) -> [f64; 2] {
        let off = |f: &Value| {
            let tape = &f["cameras"][camera.name()][marker.name()];
            let uv = made.tracked.tracks.get(f["frame"].as_u64()?, camera, marker)?.uv;
            Some([uv.x - tape["patch_u"].as_f64()?, uv.y - tape["patch_v"].as_f64()?])
        };
        let off: Vec<[f64; 2]> = self.truth["frames"].as_array().unwrap().iter().filter_map(off).collect();
        [0, 1].map(|k| {
            let mut own: Vec<f64> = off.iter().map(|off| off[k]).collect();
            own.sort_by(f64::total_cmp);
            own[own.len() / 2]
        })
    }
}

/// A lens out of focus: every picture of both cameras blurred by another 0.9 px on top of its own 0.65. While the blur of pictures in focus was
/// taken for theirs, the spins came out 7 % wrong and the ball 0.42 px off.
#[test]
fn real_pictures_out_of_focus_tell_their_blur_and_ball_and_spin_stay_right() {
    let Some(r) = Recording::of("lab-11") else { return };
    for camera in CameraId::BOTH {
        r.frames().into_iter().for_each(|frame| r.paint(camera, frame, |p| *p = image::imageops::blur(p, 0.9)));
    }
    let mut made = r.track(SyncMode::Report).unwrap();
    let setup = ShotSetup { rig: &r.rig, racket: &r.shot.racket, ball: &r.shot.ball, frame_rate_hz: r.frame_rate_hz };
    let spin = measure_spin(&made.clip, &setup, &mut made.tracked).unwrap();
    let (found, wrong) = r.score(&made, 0, &[]);
    assert!(found > 0.985 && wrong == 0, "{found} {wrong}");
    for (name, estimate) in [("ball_in_w", &spin.before), ("ball_out_w", &spin.after)] {
        let SpinEstimate::Vector { omega_rad_s, .. } = estimate else { panic!("{name}: {estimate:?}") };
        let truth = Vector3::from_iterator(r.truth["global"][name].as_array().unwrap().iter().map(|x| x.as_f64().unwrap()));
        let off = (omega_rad_s - truth).norm() / truth.norm();
        assert!(off < 0.02, "{name}: {omega_rad_s} against {truth}, {off}");
    }
    let rms = r.ball_off_px(&made);
    assert!(rms < 0.1, "ball {rms} px");
}

/// Takes the tape of these markers off.
fn paint_out(r: &Recording, markers: &[Target]) {
    for (camera, frame) in r.pictures() {
        r.paint(camera, frame, |p| {
            for (u, v) in markers.iter().map(|m| r.place(camera, frame, *m)) {
                let behind = p.get_pixel(((u + 14.0) as u32).min(p.width() - 1), v as u32).to_owned();
                for (x, y) in (-9..=9).flat_map(|x| (-9..=9).map(move |y| (x, y))).filter(|(x, y)| x * x + y * y < 90) {
                    if let Some(pixel) = p.get_pixel_mut_checked((u as i32 + x) as u32, (v as i32 + y) as u32) {
                        *pixel = behind;
                    }
                }
            }
        });
    }
}

/// Letters, folds, the arm and what else looks like tape make figures of six bands; those of a court were followed as the racket.
#[test]
fn real_a_racket_without_tape_is_not_found() {
    for kind in ["lab-11", "court-12", "hard-13"] {
        let Some(r) = Recording::of(kind) else { return };
        paint_out(&r, &[Target::M1, Target::M2, Target::M3, Target::M4, Target::M5]);
        let refused = r.track(SyncMode::Report).err().map(|e| e.to_string());
        assert!(refused.as_ref().is_some_and(|e| e.starts_with("no racket found") && e.contains("racket.toml")), "{kind} {refused:?}");
    }
}

/// Two of the five tapes are redundant: any three carry the whole shot. Of three the figure holds other triangles that differ by 4 mm;
/// before a dark curtain chance makes figures of more bands than six, and while only the most numerous were followed up nothing was found.
#[test]
fn real_any_three_tapes_are_enough() {
    for (kind, painted_out) in [("lab-11", [Target::M1, Target::M4]), ("lab-11", [Target::M2, Target::M4]), ("court-12", [Target::M2, Target::M3])] {
        let Some(r) = Recording::of(kind) else { return };
        paint_out(&r, &painted_out);
        let made = r.track(SyncMode::Report).unwrap();
        let (found, wrong) = r.score(&made, 0, &[]);
        // Two thirds of all targets are left.
        assert!(found > 0.63 && wrong == 0, "{kind} {painted_out:?} {found} {wrong}");
        for marker in painted_out {
            assert!(made.tracked.notes.iter().any(|n| n.starts_with(&format!("{} was seen in no picture", marker.name()))), "{:?}", made.tracked.notes);
        }
    }
}

/// The spin of a ball that comes was once written as that of one that leaves, to 2 rad/s.
#[test]
fn real_in_a_clip_that_ends_before_the_contact_no_spin_has_a_side() {
    let Some(r) = Recording::of("court-12") else { return };
    for f in r.truth["frames"].as_array().unwrap().iter().filter(|f| f["t"].as_f64().unwrap() > -0.002) {
        CameraId::BOTH.into_iter().for_each(|c| std::fs::remove_file(r.file(c, f["frame"].as_u64().unwrap())).unwrap());
    }
    let mut made = r.track(SyncMode::Report).unwrap();
    assert!(made.tracked.contact_frame.is_none() && made.tracked.points.iter().any(|p| p.target == Target::Ball));
    let setup = ShotSetup { rig: &r.rig, racket: &r.shot.racket, ball: &r.shot.ball, frame_rate_hz: r.frame_rate_hz };
    let spin = measure_spin(&made.clip, &setup, &mut made.tracked).unwrap();
    for estimate in [&spin.before, &spin.after] {
        assert!(matches!(estimate, SpinEstimate::Refused { reason: SpinRefusal::NoContact }), "{estimate:?}");
    }
}

#[test]
fn real_a_missing_picture_is_told_and_its_frame_keeps_the_other_cameras_points() {
    let Some(r) = Recording::of("lab-11") else { return };
    let frame = r.frames()[9];
    std::fs::remove_file(r.file(CameraId::Right, frame)).unwrap();
    let made = r.track(SyncMode::Report).unwrap();
    assert_eq!(made.clip.gap_notes(), [format!("right camera: no picture of frame {frame}")]);
    let (found, wrong) = r.score(&made, 0, &[frame]);
    assert!(found > 0.98 && wrong == 0, "{found} {wrong}");
    let there = |camera| Target::ALL.iter().filter(|t| made.tracked.tracks.get(frame, camera, **t).is_some()).count();
    assert!(there(CameraId::Left) >= 5 && there(CameraId::Right) == 0, "{} {}", there(CameraId::Left), there(CameraId::Right));
}

#[test]
fn real_a_repeated_picture_is_named_and_none_of_its_points_kept() {
    let Some(r) = Recording::of("lab-11") else { return };
    let frame = r.frames()[12];
    std::fs::copy(r.file(CameraId::Left, frame - 1), r.file(CameraId::Left, frame)).unwrap();
    let made = r.track(SyncMode::Report).unwrap();
    assert!(made.tracked.notes.iter().any(|n| n.contains(&format!("left frame {frame} repeats"))), "{:?}", made.tracked.notes);
    assert!(Target::ALL.iter().all(|t| made.tracked.tracks.get(frame, CameraId::Left, *t).is_none()));
    let (found, wrong) = r.score(&made, 0, &[frame]);
    assert!(found > 0.98 && wrong == 0, "{found} {wrong}");
}

#[test]
fn real_dark_and_washed_out_pictures_are_named_and_the_rest_is_tracked() {
    let Some(r) = Recording::of("court-12") else { return };
    let frames = r.frames();
    let (dark, bright) = (frames[8], frames[34]);
    r.paint(CameraId::Left, dark, |p| p.pixels_mut().for_each(|p| p.0[0] /= 12));
    r.paint(CameraId::Right, bright, |p| p.pixels_mut().for_each(|p| p.0[0] = 255));
    let made = r.track(SyncMode::Report).unwrap();
    let told = |words: &str| made.tracked.notes.iter().any(|n| n.starts_with(words));
    assert!(told(&format!("left frame {dark} is dark")) && told(&format!("right frame {bright} is washed out")), "{:?}", made.tracked.notes);
    let (found, wrong) = r.score(&made, 0, &[dark, bright]);
    assert!(found > 0.97 && wrong == 0, "{found} {wrong}");
    // What a spoilt picture still gives must be right, or be missing.
    assert!(Target::ALL.iter().all(|t| made.tracked.tracks.get(bright, CameraId::Right, *t).is_none()));
}

#[test]
fn real_cameras_one_frame_out_of_step_are_reported_and_with_auto_paired_anew() {
    for (kind, late) in [("lab-11", true), ("court-12", true), ("court-12", false)] {
        let Some(r) = Recording::of(kind) else { return };
        assert!(!r.track(SyncMode::Report).unwrap().tracked.notes.iter().any(|n| n.contains("frame late") || n.contains("frame early")), "{kind}: in step");
        // The right camera's pictures get the number after (before) their own.
        let mut frames = r.frames();
        if late {
            frames.reverse();
        }
        for n in frames {
            std::fs::rename(r.file(CameraId::Right, n), r.file(CameraId::Right, if late { n + 1 } else { n - 1 })).unwrap();
        }
        // A picture of instant n under the number n + 1 belongs to left n: "early" by its number means paired with n + 1.
        let shift = if late { 1 } else { -1 };
        match r.track(SyncMode::Report) {
            Ok(made) => assert!(made.tracked.notes.iter().any(|n| n.contains("one frame") && n.contains("--sync auto")), "{kind}: {:?}", made.tracked.notes),
            Err(e) => assert!(matches!(e, TrackingError::OutOfStep { .. }), "{kind}: {e}"),
        }
        let made = r.track(SyncMode::Auto).unwrap();
        assert_eq!(made.right_shift, shift, "{kind}: {:?}", made.tracked.notes);
        let (found, wrong) = r.score(&made, 0, &[]);
        assert!(found > 0.97 && wrong == 0, "{kind}: {found} {wrong}");
    }
}

#[test]
fn real_a_racket_that_shows_in_a_sixth_of_the_clip_is_found() {
    let Some(r) = Recording::of("lab-11") else { return };
    let (frames, before) = (r.frames(), 120u64);
    // An empty dark room: the noise of the curtain, which never repeats, for 120 frames before and 120 after.
    let seed = |n: u64| (n.wrapping_mul(0x9E37_79B9_7F4A_7C15)).rotate_left(17);
    let (first, last) = (frames[0], frames[frames.len() - 1]);
    for camera in CameraId::BOTH {
        for n in (first - before..first).chain(last + 1..last + 1 + before) {
            let mut state = seed(n + 1000 * camera.index() as u64);
            let noise = |_, _| {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                image::Luma([18 + (state >> 60) as u8 / 3])
            };
            GrayImage::from_fn(512, 512, noise).save(r.file(camera, n)).unwrap();
        }
    }
    let made = r.track(SyncMode::Report).unwrap();
    assert_eq!(made.clip.pairs.len(), frames.len() + 240);
    let (found, wrong) = r.score(&made, 0, &[]);
    assert!(found > 0.98 && wrong == 0, "{found} {wrong}");
    let invented = made.tracked.tracks.points.iter().filter(|p| p.point.is_some() && (p.frame < first || p.frame > last)).count();
    assert_eq!(invented, 0, "points in the empty room");
}

/// Somebody walks through before the racket: a grey box over all of it in both cameras for six frames. It is looked for in few of the frames
/// after, and from where it is found followed back to the first of them.
#[test]
fn real_a_racket_hidden_for_a_while_is_found_again_and_followed_back() {
    for kind in ["lab-11", "court-12"] {
        let Some(r) = Recording::of(kind) else { return };
        let frames = r.frames();
        let hidden: Vec<u64> = frames[30..36].to_vec();
        for camera in CameraId::BOTH {
            for n in &hidden {
                let markers = Target::MARKERS.map(|m| r.place(camera, *n, m));
                let over = |of: fn(&(f64, f64)) -> f64| {
                    (markers.iter().map(of).fold(f64::INFINITY, f64::min) - 20.0, markers.iter().map(of).fold(0.0, f64::max) + 20.0)
                };
                let ((left, right), (top, bottom)) = (over(|p| p.0), over(|p| p.1));
                r.paint(camera, *n, |p| {
                    for (x, y, pixel) in p.enumerate_pixels_mut() {
                        if (left..right).contains(&f64::from(x)) && (top..bottom).contains(&f64::from(y)) {
                            pixel.0[0] = 90 + ((x * 7 + y * 13 + *n as u32) % 3) as u8;
                        }
                    }
                });
            }
        }
        let made = r.track(SyncMode::Report).unwrap();
        let markers = |frame: u64| {
            CameraId::BOTH.into_iter().flat_map(|c| Target::MARKERS.map(|m| (c, m))).filter(|(c, m)| made.tracked.tracks.get(frame, *c, *m).is_some()).count()
        };
        assert!(hidden.iter().all(|n| markers(*n) == 0), "{kind}: markers seen through a box");
        let (_, wrong) = r.score(&made, 0, &hidden);
        let others: Vec<usize> = frames.iter().filter(|n| !hidden.contains(n)).map(|n| markers(*n)).collect();
        assert!(wrong == 0 && others.iter().all(|n| *n >= 9), "{kind}: {wrong} {others:?}");
    }
}

/// Both pictures end where markers and, in the laboratory, the ball pass: what the border cuts is found, and is where the whole pictures show it to
/// within what it states. (On court the ball flies along that border for its whole flight, and is not found.)
#[test]
fn real_bands_and_balls_that_the_border_cuts_are_where_whole_pictures_show_them() {
    for (kind, height, most) in [("lab-11", 282u32, 2), ("court-12", 258, 1)] {
        let Some(mut r) = Recording::of(kind) else { return };
        let whole = r.track(SyncMode::Report).unwrap();
        for camera in CameraId::BOTH {
            r.frames().into_iter().for_each(|frame| r.paint(camera, frame, |p| *p = image::imageops::crop_imm(p, 0, 0, 512, height).to_image()));
        }
        r.rig.image_size = [512, height as usize];
        let cut = r.track(SyncMode::Report).unwrap();
        let inside = |place: &Vector2<f64>| f64::from(height) - 0.5 - place.y;
        for (targets, cut_from_px, fewest) in [(&Target::MARKERS[..], 4.0, 25), (&[Target::Ball][..], 8.0, 8)].into_iter().take(most) {
            let (mut asked, mut squares) = (0, Vec::new());
            for (frame, camera, target) in
                r.frames().into_iter().flat_map(|f| CameraId::BOTH.into_iter().flat_map(move |c| targets.iter().map(move |t| (f, c, *t))))
            {
                let Some(there) = whole.tracked.tracks.get(frame, camera, target) else { continue };
                let found = cut.tracked.tracks.get(frame, camera, target);
                assert!(inside(&there.uv) > -1.0 || found.is_none(), "{kind} {frame}: {target:?} beyond the border");
                if (0.5..cut_from_px).contains(&inside(&there.uv)) {
                    asked += 1;
                    squares.extend(found.map(|f| (f.uv - there.uv).component_div(&f.sd).norm_squared() / 2.0));
                }
            }
            let z2 = squares.iter().sum::<f64>() / squares.len() as f64;
            assert!(asked >= fewest && 2 * squares.len() > asked, "{kind}, {targets:?}: {} of {asked}", squares.len());
            assert!(z2 < 2.5, "{kind}, {targets:?}: {z2}");
        }
    }
}

/// The other camera sees no ball where the border begins to cut it: it is followed out of the picture that shows it all the same.
#[test]
fn real_a_ball_that_one_camera_alone_sees_is_followed_to_the_border() {
    let Some(mut r) = Recording::of("lab-11") else { return };
    let whole = r.track(SyncMode::Report).unwrap();
    let height = 282u32;
    let inside = |frame: u64| whole.tracked.tracks.get(frame, CameraId::Left, Target::Ball).map(|ball| (f64::from(height) - 0.5 - ball.uv.y, ball));
    for frame in r.frames() {
        let near = inside(frame).is_none_or(|(inside, _)| inside < 10.0);
        for camera in CameraId::BOTH {
            r.paint(camera, frame, |p| *p = image::imageops::crop_imm(p, 0, 0, 512, height).to_image());
        }
        if near {
            r.paint(CameraId::Right, frame, |p| p.fill(30));
        }
    }
    r.rig.image_size = [512, height as usize];
    let cut = r.track(SyncMode::Report).unwrap();
    let (mut asked, mut squares) = (0, Vec::new());
    for (frame, (inside, ball)) in r.frames().into_iter().filter_map(|frame| Some((frame, inside(frame)?))) {
        let found = cut.tracked.tracks.get(frame, CameraId::Left, Target::Ball);
        assert!(inside > -1.0 || found.is_none(), "{frame}: a ball beyond the border");
        if (0.5..12.0).contains(&inside) {
            asked += 1;
            squares.extend(found.map(|found| (found.uv - ball.uv).component_div(&found.sd).norm_squared() / 2.0));
        }
    }
    let z2 = squares.iter().sum::<f64>() / squares.len() as f64;
    assert!(asked >= 4 && squares.len() + 1 >= asked && z2 < 2.5, "{} of {asked}, {z2}", squares.len());
}

/// The share of the markers visible in these frames that one camera's tracks hold.
fn markers_found(r: &Recording, made: &InStep, camera: CameraId, frames: &[u64]) -> f64 {
    let (mut seen, mut found) = (0, 0);
    for f in r.truth["frames"].as_array().unwrap().iter().filter(|f| frames.contains(&f["frame"].as_u64().unwrap())) {
        for target in Target::MARKERS {
            let p = &f["cameras"][camera.name()][target.name()];
            if p["visible"] == true && p["fraction"].as_f64().unwrap_or(0.0) >= 0.5 {
                seen += 1;
                found += usize::from(made.tracked.tracks.get(f["frame"].as_u64().unwrap(), camera, target).is_some());
            }
        }
    }
    found as f64 / f64::from(seen.max(1))
}

/// One camera is blind while the racket is swung: the other follows it alone, and it is found again at once in the first picture after that.
#[test]
fn real_a_racket_that_one_camera_lost_is_found_again_along_the_others_line_of_sight() {
    let Some(r) = Recording::of("court-12") else { return };
    let frames = r.frames();
    let (blind, after) = (&frames[2..16], &frames[..2]);
    blind.iter().for_each(|frame| r.paint(CameraId::Right, *frame, |p| p.fill(60)));
    let made = r.track(SyncMode::Report).unwrap();
    let (found, wrong) = r.score(&made, 0, blind);
    assert!(found > 0.98 && wrong == 0, "{found} {wrong}");
    let [left, right] = [(CameraId::Left, blind), (CameraId::Right, after)].map(|(camera, frames)| markers_found(&r, &made, camera, frames));
    assert!(left > 0.9 && right > 0.9, "{left} {right}");
}

/// The racket is hidden for some frames, and comes out in one picture only: all of it, or with one marker less.
#[test]
fn real_a_racket_that_comes_out_in_one_picture_only_is_found_there() {
    for covered in [None, Some(Target::MARKERS[3])] {
        let Some(r) = Recording::of("lab-11") else { return };
        let frames = r.frames();
        let (alone, hidden) = (&frames[..8], &frames[8..15]);
        hidden.iter().for_each(|frame| CameraId::BOTH.into_iter().for_each(|camera| r.paint(camera, *frame, |p| p.fill(30))));
        alone.iter().for_each(|frame| r.paint(CameraId::Right, *frame, |p| p.fill(30)));
        if let Some(marker) = covered {
            for frame in alone {
                let (u, v) = r.place(CameraId::Left, *frame, marker);
                let near = |x: u32, y: u32| (f64::from(x) - u).hypot(f64::from(y) - v) < 9.0;
                r.paint(CameraId::Left, *frame, |p| p.enumerate_pixels_mut().filter(|(x, y, _)| near(*x, *y)).for_each(|(_, _, pixel)| pixel.0[0] = 30));
            }
        }
        let made = r.track(SyncMode::Report).unwrap();
        let (found, wrong) = r.score(&made, 0, &frames[..15]);
        let left = markers_found(&r, &made, CameraId::Left, alone);
        let least = if covered.is_some() { 0.7 } else { 0.9 };
        assert!(found > 0.98 && wrong == 0 && left > least, "{covered:?}: {found} {wrong} {left}");
        let seen = |camera, marker| alone.iter().any(|frame| made.tracked.tracks.get(*frame, camera, marker).is_some());
        assert!(!Target::MARKERS.iter().any(|m| seen(CameraId::Right, *m)) && !covered.is_some_and(|m| seen(CameraId::Left, m)));
    }
}

/// All markers but one are covered from some frame on: the one is followed where it goes, in either picture, until it is covered too.
#[test]
fn real_a_single_marker_that_is_left_is_followed_where_it_goes() {
    for (kind, left) in [("lab-11", Target::MARKERS[1]), ("court-12", Target::MARKERS[3])] {
        let Some(r) = Recording::of(kind) else { return };
        let frames = r.frames();
        let (gone, alone) = (&frames[..4], &frames[4..12]);
        for frame in &frames[..12] {
            for (camera, marker) in CameraId::BOTH.into_iter().flat_map(|camera| Target::MARKERS.map(|marker| (camera, marker))) {
                if marker != left || gone.contains(frame) {
                    let (u, v) = r.place(camera, *frame, marker);
                    let near = |x: u32, y: u32| (f64::from(x) - u).hypot(f64::from(y) - v) < 9.0;
                    r.paint(camera, *frame, |p| p.enumerate_pixels_mut().filter(|(x, y, _)| near(*x, *y)).for_each(|(_, _, pixel)| pixel.0[0] = 60));
                }
            }
        }
        let made = r.track(SyncMode::Report).unwrap();
        let (found, wrong) = r.score(&made, 0, &frames[..12]);
        let (_, wrong_too) = r.score(&made, 0, &[]);
        let seen = |camera, frames: &[u64], marker| frames.iter().filter(|frame| made.tracked.tracks.get(**frame, camera, marker).is_some()).count();
        let one = CameraId::BOTH.map(|camera| seen(camera, alone, left));
        let others = CameraId::BOTH.into_iter().flat_map(|camera| Target::MARKERS.map(|marker| seen(camera, gone, marker))).sum::<usize>();
        assert!(
            found > 0.98 && wrong + wrong_too + others == 0 && one.iter().all(|n| n + 1 >= alone.len()),
            "{kind}: {found} {wrong} {wrong_too} {one:?} {others}"
        );
    }
}

#[test]
fn real_a_bright_thing_that_the_ball_touches_does_not_pull_it() {
    let Some(r) = Recording::of("lab-11") else { return };
    let frames = r.frames();
    for camera in CameraId::BOTH {
        // A lamp of 15 px beside the ball's way, touching the ball in the sixth frame.
        let (u, v) = r.place(camera, frames[5], Target::Ball);
        for n in &frames {
            r.paint(camera, *n, |p| {
                for (x, y, pixel) in p.enumerate_pixels_mut() {
                    if (f64::from(x) - u).hypot(f64::from(y) - v - 16.0) < 7.5 {
                        pixel.0[0] = 235;
                    }
                }
            });
        }
    }
    let made = r.track(SyncMode::Report).unwrap();
    let (found, wrong) = r.score(&made, 0, &[]);
    assert!(found > 0.97 && wrong == 0, "{found} {wrong}");
}

#[test]
fn real_of_two_balls_the_one_that_meets_the_racket_is_tracked() {
    let Some(r) = Recording::of("lab-11") else { return };
    let frames = r.frames();
    let ball = |f: &Value| -> nalgebra::Point3<f64> {
        let p: Vec<f64> = f["points"]["ball"].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect();
        nalgebra::Point3::new(p[0], p[1], p[2])
    };
    let truth = r.truth["frames"].as_array().unwrap();
    // A second ball flies beside the first, 35 cm above, and goes on where the first is hit.
    let (start, step) = (ball(&truth[0]) + nalgebra::Vector3::new(0.0, 0.35, 0.0), ball(&truth[1]) - ball(&truth[0]));
    for camera in CameraId::BOTH {
        let (u, v) = r.place(camera, frames[0], Target::Ball);
        let stamp = read_grey(&r.file(camera, frames[0])).unwrap();
        for (k, n) in frames.iter().enumerate() {
            let Some(at) = r.rig.project(camera, &(start + step * k as f64)) else { continue };
            r.paint(camera, *n, |p| {
                let (dx, dy) = ((at.x - u).round() as i64, (at.y - v).round() as i64);
                for y in -9..=9i64 {
                    for x in -9..=9i64 {
                        let (sx, sy) = (u.round() as i64 + x, v.round() as i64 + y);
                        let (tx, ty) = (sx + dx, sy + dy);
                        let inside = |x: i64, y: i64| (0..512).contains(&x) && (0..512).contains(&y);
                        if x * x + y * y <= 81 && inside(sx, sy) && inside(tx, ty) {
                            p.put_pixel(tx as u32, ty as u32, image::Luma([stamp.pixels[(sy * 512 + sx) as usize]]));
                        }
                    }
                }
            });
        }
    }
    let made = r.track(SyncMode::Report).unwrap();
    let (found, wrong) = r.score(&made, 0, &[]);
    assert!(found > 0.97 && wrong == 0, "{found} {wrong}");
}

/// The command: gaps printed, files for other programs and sheets written, also from an earlier run's tables.
#[test]
fn cli_track_prints_gaps_and_writes_exports_and_sheets() {
    let Some(r) = Recording::of("lab-11") else { return };
    let Some(practice) = shared("practice/footage/lab-11") else { return };
    let frame = r.frames()[3];
    std::fs::remove_file(r.file(CameraId::Left, frame)).unwrap();
    let session = r.session(&practice);
    let results = session.path().join("results");
    let track = |words: &[&str]| {
        let out = std::process::Command::new(env!("CARGO_BIN_EXE_sweetspot")).arg("track").arg(session.path()).args(words).output().unwrap();
        assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
        crate::cli::said(&out)
    };
    let said = track(&["--no-spin"]);
    assert!(said.contains(&format!("s01: left camera: no picture of frame {frame}")), "{said}");
    let made = results.join("shots/s01");
    assert!(!made.join("spin.json").exists() && !made.join("points.c3d").exists());
    // Written from the tables of the run before: the shot is not tracked again.
    let said = track(&["--no-spin", "--export", "dltdv,c3d", "--overlay=8"]);
    assert!(said.contains("already tracked"), "{said}");
    for name in ["dltdv_xypts.csv", "dltdv_xyzpts.csv", "dltdv_xyzres.csv", "dltdv_offsets.csv", "points.c3d"] {
        assert!(std::fs::metadata(made.join(name)).unwrap().len() > 80, "{name}");
    }
    for name in ["overlay_left.png", "overlay_right.png"] {
        let sheet = image::open(made.join(name)).unwrap().to_rgb8();
        let drawn = sheet.pixels().filter(|p| p.0[1] > p.0[0].saturating_add(90) || p.0[0] > p.0[1].saturating_add(90)).count();
        assert!(drawn > 500, "{name}: {drawn} coloured pixels in {}x{}", sheet.width(), sheet.height());
    }
    // `shots` knows the first contact better: the file for other programs follows.
    let first = std::fs::read(made.join("points.c3d")).unwrap();
    let shots = std::process::Command::new(env!("CARGO_BIN_EXE_sweetspot")).arg("shots").arg(session.path()).output().unwrap();
    assert!(shots.status.success(), "{}", String::from_utf8_lossy(&shots.stderr));
    assert_ne!(std::fs::read(made.join("points.c3d")).unwrap(), first);
    // Exports of other tracks do not stay under their name; those that are asked for are made anew.
    let tracks = std::fs::read_to_string(made.join("tracks.csv")).unwrap();
    std::fs::write(made.join("tracks.csv"), tracks.lines().take(40).collect::<Vec<_>>().join("\n") + "\n").unwrap();
    track(&["--no-spin", "--force", "--export", "c3d"]);
    assert!(made.join("points.c3d").exists() && !made.join("points.earlier.c3d").exists());
    assert!(!made.join("dltdv_xyzpts.csv").exists() && made.join("dltdv_xyzpts.earlier.csv").exists() && made.join("overlay_left.earlier.png").exists());
}

/// A ball with the real one's velocity flies past the strings, 12 cm above it: as near to them, as fast, as straight. Only the real one is turned.
#[test]
fn real_of_two_balls_that_fly_side_by_side_the_one_that_the_strings_turn_is_tracked() {
    for kind in ["lab-11", "court-12"] {
        let Some(r) = Recording::of(kind) else { return };
        let alone = r.track(SyncMode::Report).unwrap();
        let place = |frame: u64| alone.tracked.points.iter().find(|p| p.target == Target::Ball && p.frame == frame).unwrap().position;
        let frames = r.frames();
        let (from, step) = (place(frames[1]), (place(frames[5]) - place(frames[1])) / 4.0);
        for camera in CameraId::BOTH {
            // The real ball of the second frame, moved.
            let grey = read_grey(&r.file(camera, frames[1])).unwrap();
            let (u, v) = r.place(camera, frames[1], Target::Ball);
            for (k, frame) in frames.iter().enumerate() {
                let there = r.rig.project(camera, &(from + step * (k as f64 - 1.0) + Vector3::y() * 0.12)).unwrap();
                r.paint(camera, *frame, |picture| {
                    for (x, y, pixel) in picture.enumerate_pixels_mut() {
                        let off = nalgebra::Vector2::new(f64::from(x) - there.x, f64::from(y) - there.y);
                        let share = (8.5 - off.norm()).clamp(0.0, 1.0);
                        if share > 0.0 {
                            let (at_u, at_v) = ((u + off.x).clamp(0.0, 510.0), (v + off.y).clamp(0.0, 510.0));
                            let (x0, y0) = (at_u.floor(), at_v.floor());
                            let grey = |dx: f64, dy: f64| f64::from(grey.pixels[(y0 + dy) as usize * grey.width + (x0 + dx) as usize]);
                            let (fx, fy) = (at_u - x0, at_v - y0);
                            let ball =
                                (grey(0.0, 0.0) * (1.0 - fx) + grey(1.0, 0.0) * fx) * (1.0 - fy) + (grey(0.0, 1.0) * (1.0 - fx) + grey(1.0, 1.0) * fx) * fy;
                            pixel.0[0] = (f64::from(pixel.0[0]) * (1.0 - share) + ball * share).round() as u8;
                        }
                    }
                });
            }
        }
        let (found, wrong) = r.score(&r.track(SyncMode::Report).unwrap(), 0, &[]);
        assert!(found > 0.95 && wrong == 0, "{kind}: {found} {wrong}");
    }
}

#[test]
fn real_cameras_three_frames_out_of_step_are_told_and_paired_anew() {
    for kind in ["lab-11", "court-12"] {
        let Some(r) = Recording::of(kind) else { return };
        for n in r.frames().into_iter().rev() {
            std::fs::rename(r.file(CameraId::Right, n), r.file(CameraId::Right, n + 3)).unwrap();
        }
        match r.track(SyncMode::Report) {
            Ok(made) => assert!(made.doubt.as_ref().is_some_and(|n| n.contains("3 frames early") && n.contains("--sync auto")), "{kind}: {:?}", made.doubt),
            Err(e) => assert!(matches!(e, TrackingError::OutOfStep { .. }), "{kind}: {e}"),
        }
        let made = r.track(SyncMode::Auto).unwrap();
        let (found, wrong) = r.score(&made, 0, &[]);
        assert!(made.right_shift == 3 && made.doubt.is_none() && found > 0.97 && wrong == 0, "{kind}: {} {found} {wrong}", made.right_shift);
    }
}

/// Letters behind the ball that are white to the limit are brighter than they look: where they are partly covered the outline seemed to lie elsewhere,
/// by 0.14 px in the root mean square (0.10 now).
#[test]
fn real_what_is_white_to_the_limit_beside_the_ball_is_told_and_moves_it_little() {
    let Some(r) = Recording::of("hard-13") else { return };
    for (camera, frame) in r.pictures() {
        r.paint(camera, frame, |p| p.pixels_mut().for_each(|grey| grey.0[0] = grey.0[0].saturating_mul(2)));
    }
    let mut made = r.track(SyncMode::Report).unwrap();
    assert!(made.tracked.notes.iter().any(|n| n.contains("seen beside the ball is white to the limit")), "{:?}", made.tracked.notes);
    let setup = ShotSetup { rig: &r.rig, racket: &r.shot.racket, ball: &r.shot.ball, frame_rate_hz: r.frame_rate_hz };
    measure_spin(&made.clip, &setup, &mut made.tracked).unwrap();
    let balls = made.tracked.tracks.points.iter().filter(|p| p.target == Target::Ball);
    let off: Vec<f64> = balls
        .filter_map(|p| {
            let (u, v) = r.place(p.camera, p.frame, Target::Ball);
            let uv = p.point.as_ref()?.uv;
            Some(0.5 * ((uv.x - u).powi(2) + (uv.y - v).powi(2)))
        })
        .collect();
    let rms_px = (off.iter().sum::<f64>() / off.len() as f64).sqrt();
    assert!(off.len() > 100 && rms_px < 0.125, "{} {rms_px}", off.len());
}

/// Twice as much light as the sensor holds, nearly: a third of the ball and most of the tape is white to the limit. Taken as it looks, tape lay up to 0.3 px
/// beside its place, always to the same side, and the ball 0.15 px beside its own.
#[test]
fn real_overexposed_tape_and_ball_are_where_they_are() {
    for kind in ["lab-11", "court-12"] {
        let Some(r) = Recording::of(kind) else { return };
        for (camera, frame) in r.pictures() {
            r.paint(camera, frame, |p| p.pixels_mut().for_each(|grey| grey.0[0] = (1.8 * f32::from(grey.0[0])).round().min(255.0) as u8));
        }
        let mut made = r.track(SyncMode::Report).unwrap();
        let setup = ShotSetup { rig: &r.rig, racket: &r.shot.racket, ball: &r.shot.ball, frame_rate_hz: r.frame_rate_hz };
        measure_spin(&made.clip, &setup, &mut made.tracked).unwrap();
        let (found, wrong) = r.score(&made, 0, &[]);
        assert!(found > 0.98 && wrong == 0, "{kind}: {found} {wrong}");
        let off: Vec<[f64; 2]> = CameraId::BOTH.into_iter().flat_map(|c| Target::MARKERS.map(|m| r.band_off_px(&made, c, m))).collect();
        let rms = (off.iter().flatten().map(|x| x * x).sum::<f64>() / (2 * off.len()) as f64).sqrt();
        assert!(rms < 0.06, "{kind}: tape {rms} px, {off:.2?}");
        let ball = r.ball_off_px(&made);
        assert!(ball < 0.16, "{kind}: ball {ball} px");
    }
}

#[test]
fn fails_clearly_when_a_camera_was_moved_or_the_folders_were_exchanged() {
    for moved in [true, false] {
        let Some(r) = Recording::of("lab-11") else { return };
        for n in r.frames() {
            if moved {
                // Tilted by 0.03 degrees: two pixels down.
                r.paint(CameraId::Right, n, |p| *p = GrayImage::from_fn(p.width(), p.height(), |x, y| *p.get_pixel(x, y.saturating_sub(2))));
            } else {
                let aside = r.folder.path().join("aside.png");
                std::fs::rename(r.file(CameraId::Left, n), &aside).unwrap();
                std::fs::rename(r.file(CameraId::Right, n), r.file(CameraId::Left, n)).unwrap();
                std::fs::rename(&aside, r.file(CameraId::Right, n)).unwrap();
            }
        }
        let told = r.track(SyncMode::Report).unwrap_err();
        match &told {
            TrackingError::Contradiction { found } => assert!(moved && found.contains("one camera only"), "{told}"),
            TrackingError::Exchanged { found } => assert!(!moved && found.contains("in 16 frames"), "{told}"),
            _ => panic!("{moved}: {told}"),
        }
    }
}

#[test]
fn cli_shots_repeats_what_tracking_doubts() {
    let Some(r) = Recording::of("lab-11") else { return };
    let Some(practice) = shared("practice/footage/lab-11") else { return };
    for n in r.frames().into_iter().rev() {
        std::fs::rename(r.file(CameraId::Right, n), r.file(CameraId::Right, n + 2)).unwrap();
    }
    let session = r.session(&practice);
    for words in [["track", "--no-spin"].as_slice(), &["shots"]] {
        let out = std::process::Command::new(env!("CARGO_BIN_EXE_sweetspot")).args(words).arg(session.path()).output().unwrap();
        let said = crate::cli::said(&out);
        assert!(said.contains("s01: the right camera's pictures are 2 frames early"), "{words:?}: {said}");
    }
}
