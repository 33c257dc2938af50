//! `kinematics` against worlds with known truth that do not share its laws of motion.

use super::kinematics_world::{Difficulty, FRAME_S, TrueShot, true_shot};
use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Vector3};
use rayon::prelude::*;
use std::collections::BTreeMap;
use sweetspot::calibration::{CameraId, RigidTransform};
use sweetspot::kinematics::{
    BalanceSeen, KinematicsError, MeasureSettings, MeasuredShot, MotionEstimate, Shot, ShotInput, ShotRecord, ShotSpin, SpinVector, TapeErrors, WindowReport,
    Windows, frame_rate_study, measure_shot,
};
use sweetspot::tracking::spin::{BallSpin, SpinEstimate, SpinRefusal};
use sweetspot::tracking::{PointState, Target, TrackPoint};

// As tracked pictures with known truth show it: white noise of a marker 0.03 px in the laboratory and on court, 0.08 px
// where pictures are hard, of the ball 0.08 px; tape errors of 0.04, 0.1 and 0.15 px, nearly constant within a shot. All
// are taken somewhat larger here, and as large as the settings state tape errors.
const COURT: Difficulty = Difficulty {
    noise_px: 0.05,
    ball_noise_px: 0.10,
    tape_error_px: 0.13,
    outliers: 0.004,
    gaps: 0.03,
    laboratory: false,
    air: true,
    drive: 0.0,
    drive_change_s: 0.08,
    hold: 0.0,
    frames: (18, 24),
    hidden: 0,
    ball_untold: 1.25,
    shake_px: 0.0,
    slow_m_s2: 0.0,
    sway_times: 1.0,
};
const DRIVEN: Difficulty = Difficulty { drive: 1.0, ..COURT };
const ABRUPT: Difficulty = Difficulty { drive: 1.0, drive_change_s: 0.03, hold: 1.0, ..COURT };
const HELD: Difficulty = Difficulty { hold: 1.0, ..COURT };
const DRIVEN_HELD: Difficulty = Difficulty { drive: 1.0, hold: 1.0, ..COURT };
const LABORATORY: Difficulty = Difficulty { laboratory: true, ..COURT };
const NOISY: Difficulty = Difficulty { noise_px: 0.11, ball_noise_px: 0.20, tape_error_px: 0.17, outliers: 0.015, gaps: 0.12, ..COURT };
const NOISY_DRIVEN_HELD: Difficulty = Difficulty { drive: 1.0, hold: 1.0, ..NOISY };
const FEW_FRAMES: Difficulty = Difficulty { frames: (8, 10), ..COURT };
const FEWEST_FRAMES: Difficulty = Difficulty { frames: (7, 9), gaps: 0.0, ..COURT };
const SHAKEN: Difficulty = Difficulty { shake_px: 0.3, ..COURT };
const HIDDEN_MARKERS: Difficulty = Difficulty { hidden: 1, ..COURT };

#[derive(Default)]
struct Score {
    /// Errors and stated deviations by column.
    errors: BTreeMap<&'static str, Vec<(f64, f64)>>,
}

impl Score {
    fn rms(&self, columns: &[&str]) -> f64 {
        let all: Vec<f64> = self.errors.iter().filter(|(c, _)| columns.iter().any(|p| c.starts_with(p))).flat_map(|(_, e)| e.iter().map(|e| e.0)).collect();
        (all.iter().map(|e| e * e).sum::<f64>() / all.len() as f64).sqrt()
    }

    fn coverage(&self, columns: &[&str]) -> f64 {
        let all: Vec<bool> = self
            .errors
            .iter()
            .filter(|(c, _)| columns.iter().any(|p| c.starts_with(p)))
            .flat_map(|(_, e)| e.iter().map(|(e, sd)| e.abs() < 1.96 * sd))
            .collect();
        all.iter().filter(|i| **i).count() as f64 / all.len() as f64
    }
}

fn score(difficulty: &Difficulty, seeds: std::ops::Range<u64>) -> Score {
    score_with(difficulty, seeds, &stated(difficulty.tape_error_px))
}

fn score_with(difficulty: &Difficulty, seeds: std::ops::Range<u64>, settings: &MeasureSettings) -> Score {
    let shots: Vec<Vec<(&'static str, f64, f64)>> = seeds
        .into_par_iter()
        .map(|seed| {
            let truth = true_shot(seed, difficulty);
            let spin = ShotSpin::default();
            let input = input_of(&truth, &spin);
            let measured = measure_shot(&input, settings).unwrap_or_else(|e| panic!("seed {seed}: {e}"));
            let quantity = |name: &str| measured.shot.quantities.get(name).unwrap_or_else(|| panic!("seed {seed}: no {name}: {:?}", measured.shot.remarks));
            let mut out: Vec<_> = truth.row.iter().map(|(name, v)| (*name, quantity(name).value - v, quantity(name).sd)).collect();
            let frame = quantity("impact_frame");
            out.push(("instant", (frame.value - truth.impact_frame) * FRAME_S, frame.sd * FRAME_S));
            if std::env::var_os("SWEETSPOT_SHOW").is_some() {
                for (name, e, sd) in out.iter().filter(|(_, e, sd)| e.abs() > 3.5 * sd) {
                    eprintln!(
                        "seed {seed} {name}: error {e:.4} sd {sd:.4} {:.2?}",
                        if name.contains("in") { Some(&measured.shot.windows.racket_in) } else { measured.shot.windows.racket_out.as_ref() }
                    );
                }
            }
            out
        })
        .collect();
    let mut score = Score::default();
    for (name, e, sd) in shots.into_iter().flatten() {
        score.errors.entry(name).or_default().push((e, sd));
    }
    score
}

/// Of 42 values nominally at 95 %, of which the three of a shot hang together, fewer than this lie inside in one of some hundred draws.
const SLOW_COVERS: f64 = 0.84;

const BALL: [&str; 2] = ["ball_in_v", "ball_out_v"];
const RACKET: [&str; 2] = ["racket_in_v", "racket_out_v"];
const RATE: [&str; 2] = ["racket_in_w", "racket_out_w"];
const POSITION: [&str; 1] = ["impact_"];
const INSTANT: [&str; 1] = ["instant"];

fn report(name: &str, s: &Score) {
    eprintln!(
        "{name}: ball {:.3} m/s, racket {:.3} m/s, rate {:.3} rad/s, position {:.3} mm, instant {:.4} ms, contact time {:.3} ms",
        s.rms(&BALL),
        s.rms(&RACKET),
        s.rms(&RATE),
        1e3 * s.rms(&POSITION),
        1e3 * s.rms(&INSTANT),
        1e3 * s.rms(&["contact_time"])
    );
    for group in ["ball_in_v", "ball_out_v", "racket_in_v", "racket_out_v", "racket_in_w", "racket_out_w", "impact_", "instant", "contact_time"] {
        eprintln!("   {group:14} rms {:.4} inside 95 % {:.1} %", s.rms(&[group]), 100.0 * s.coverage(&[group]));
    }
    eprintln!("   all inside 95 %: {:.1} %", 100.0 * s.coverage(&[""]));
}

/// Issue 6: bars of the shot characteristics on laboratory and court, twice as wide where pictures are hard.
fn within_bars(name: &str, s: &Score, times: f64) {
    for (what, columns, bar) in
        [("ball", &BALL[..], 0.10), ("racket", &RACKET, 0.08), ("rate", &RATE, 0.6), ("position", &POSITION, 1.5e-3), ("instant", &INSTANT, 0.15e-3)]
    {
        assert!(s.rms(columns) < bar * times, "{name}, {what}: {} against {}", s.rms(columns), bar * times);
    }
}

/// 280 shots in ten groups; measured figures: docs/kinematics.md.
#[test]
fn truth_errors_stay_within_the_bars_and_intervals_cover_in_every_group_of_simulated_shots() {
    let mut all = Score::default();
    for (name, difficulty, seeds, times) in [
        ("steady", COURT, 0..35, 1.0),
        ("laboratory", LABORATORY, 1000..1030, 1.0),
        ("driven", DRIVEN, 2000..2035, 1.0),
        ("held", HELD, 3000..3035, 1.0),
        ("driven and held", DRIVEN_HELD, 4000..4030, 1.0),
        // A force that changes within 30 ms leaves no more in 20 frames: the intervals say so, and they must hold.
        ("abruptly driven, held", ABRUPT, 4500..4530, 2.0),
        ("noisy", NOISY, 5000..5025, 2.0),
        ("noisy, driven and held", NOISY_DRIVEN_HELD, 6000..6025, 2.0),
        ("few frames", FEW_FRAMES, 7000..7030, 2.0),
        ("hidden markers", HIDDEN_MARKERS, 8000..8030, 1.0),
    ] {
        let s = score(&difficulty, seeds);
        report(name, &s);
        if std::env::var_os("SWEETSPOT_SHOW").is_none() {
            within_bars(name, &s, times);
            let coverage = s.coverage(&[""]);
            // Thirty shots are too few to tell 98 from 99 %: intervals too narrow show in a group, too wide ones in all.
            assert!(coverage >= 0.92, "{name}: {:.1} % of the true values inside 95 % intervals", 100.0 * coverage);
        }
        for (name, e) in s.errors {
            all.errors.entry(name).or_default().extend(e);
        }
    }
    report("all", &all);
    let coverage = all.coverage(&[""]);
    assert!((0.92..=0.98).contains(&coverage), "{:.1} % of the true values inside 95 % intervals", 100.0 * coverage);
}

#[test]
fn truth_intervals_of_a_ball_seen_in_seven_to_nine_frames_a_side_cover() {
    let s = score(&FEWEST_FRAMES, 7100..7140);
    report("seven to nine frames", &s);
    let coverage = s.coverage(&BALL);
    assert!(coverage >= 0.92, "{:.1} %", 100.0 * coverage);
}

#[test]
fn truth_intervals_cover_where_cameras_shake_and_the_shot_says_so() {
    let s = score(&SHAKEN, 7200..7230);
    report("shaken", &s);
    // 180 values of 30 shots scatter by some 3 % about 95 % (measured 92 to 100 %); without the shake in the fits 72 to 84 % of the racket's
    // velocities of rendered shots lay inside.
    for columns in [&BALL[..], &RACKET, &RATE] {
        let coverage = s.coverage(columns);
        assert!(coverage >= 0.88, "{columns:?}: {:.1} %", 100.0 * coverage);
    }
    let told = |difficulty: &Difficulty, seed: u64| {
        let shot = measured(&true_shot(seed, difficulty), &settings()).unwrap().shot;
        shot.remarks.iter().any(|r| r.contains("shake"))
    };
    assert!((7200..7206).all(|seed| told(&SHAKEN, seed) && !told(&COURT, seed)));
}

/// Probability of the laws whose name holds one of these words, mean over shots.
fn probability(difficulty: &Difficulty, window: fn(&Windows) -> &WindowReport, words: &[&str]) -> f64 {
    let shots: Vec<f64> = (9000..9006u64)
        .into_par_iter()
        .map(|seed| {
            let shot = measured(&true_shot(seed, difficulty), &settings()).unwrap();
            window(&shot.shot.windows).laws.iter().filter(|(law, _)| words.iter().any(|w| law.contains(w))).map(|(_, p)| p).sum()
        })
        .collect();
    shots.iter().sum::<f64>() / shots.len() as f64
}

#[test]
fn truth_evidence_finds_drag_and_curvature_where_they_are_and_not_where_they_are_not() {
    fn racket_in(w: &Windows) -> &WindowReport {
        &w.racket_in
    }
    fn racket_out(w: &Windows) -> &WindowReport {
        w.racket_out.as_ref().unwrap()
    }
    fn ball_in(w: &Windows) -> &WindowReport {
        &w.ball_in
    }
    let driven = ["swing", "-hold"];
    for (name, seen, low, high) in [
        // Drag bows a path of 20 ms by less than a millimetre, most of it toward the cameras.
        ("air at 30 m/s", probability(&LABORATORY, ball_in, &["air"]), 0.6, 1.0),
        ("no air at 30 m/s", probability(&Difficulty { air: false, ..LABORATORY }, ball_in, &["air"]), 0.0, 0.5),
        ("a hung racket rests", probability(&LABORATORY, racket_in, &["rest"]), 0.9, 1.0),
        ("a thrown racket is driven", probability(&COURT, racket_in, &driven), 0.0, 0.1),
        ("a driven racket is driven", probability(&DRIVEN, racket_in, &driven), 0.9, 1.0),
        ("a hand that lets go", probability(&HELD, racket_out, &["release"]), 0.5, 1.0),
        ("a free racket is held", probability(&COURT, racket_out, &["release", "swing", "-hold"]), 0.0, 0.1),
    ] {
        eprintln!("{name}: {seen:.3}");
        assert!((low..=high + 1e-9).contains(&seen), "{name}: probability {seen:.3}");
    }
}

const CLEAN: Difficulty =
    Difficulty { noise_px: 0.002, ball_noise_px: 0.002, tape_error_px: 0.0, outliers: 0.0, gaps: 0.0, laboratory: true, air: false, ..COURT };

/// What is measured on in a true shot without groups or points asked for.
fn input_of<'a>(truth: &'a TrueShot, spin: &'a ShotSpin) -> ShotInput<'a> {
    ShotInput {
        id: "s",
        rig: &truth.rig,
        tracks: &truth.tracks,
        racket: &truth.racket,
        ball: &truth.ball,
        spin,
        grip_torque_n_m: None,
        ball_flattening: None,
        groups: &[],
        asked_points: &[],
    }
}

fn measured(truth: &TrueShot, settings: &MeasureSettings) -> Result<MeasuredShot, KinematicsError> {
    let spin = ShotSpin::default();
    measure_shot(&input_of(truth, &spin), settings)
}

/// The tape's errors stated as large as a world draws them, as a session's own tracks tell (`kinematics::tape_session`).
fn stated(tape_error_px: f64) -> MeasureSettings {
    MeasureSettings { tape: TapeErrors { throat: None, shot_px: tape_error_px, shared_px: 0.0 }, ..MeasureSettings::new(1.0 / FRAME_S, 1e-4) }
}

fn settings() -> MeasureSettings {
    stated(COURT.tape_error_px)
}

fn value(shot: &MeasuredShot, name: &str) -> f64 {
    shot.shot.quantities.get(name).unwrap_or_else(|| panic!("no {name}")).value
}

#[test]
fn law_turning_the_court_about_the_vertical_turns_global_quantities_and_leaves_local_ones() {
    let mut truth = true_shot(5, &DRIVEN_HELD);
    let before = measured(&truth, &settings()).unwrap();
    let turn = Isometry3::new(Vector3::new(2.0, -0.3, 1.0), Vector3::new(0.0, 0.8, 0.0));
    truth.rig.global_from_left = RigidTransform::from_isometry(&(turn * truth.rig.global_from_left.isometry()));
    let after = measured(&truth, &settings()).unwrap();
    for name in truth.row.keys() {
        // Both fits stop within a hundredth of a standard deviation of their minimum.
        let sd = before.shot.quantities.get(name).unwrap().sd;
        assert!((value(&before, name) - value(&after, name)).abs() < 0.05 * sd, "{name}");
    }
    let global = |s: &MeasuredShot| Vector3::new(value(s, "ball_in_global_vx"), value(s, "ball_in_global_vy"), value(s, "ball_in_global_vz"));
    assert!((turn.rotation * global(&before) - global(&after)).norm() < 5e-3);
}

#[test]
fn law_exchanging_the_cameras_names_changes_nothing() {
    let mut truth = true_shot(6, &DRIVEN_HELD);
    let before = measured(&truth, &settings()).unwrap();
    let (left_from_right, right) = (truth.rig.right_from_left().inverse(), truth.rig.camera_from_global(CameraId::Right));
    std::mem::swap(&mut truth.rig.left, &mut truth.rig.right);
    let t = RigidTransform::from_isometry(&left_from_right);
    (truth.rig.r, truth.rig.t) = (t.r, t.t);
    truth.rig.global_from_left = RigidTransform::from_isometry(&right.inverse());
    for p in &mut truth.tracks.points {
        p.camera = if p.camera == CameraId::Left { CameraId::Right } else { CameraId::Left };
    }
    truth.tracks.points.sort_by_key(|p| (p.frame, p.camera, p.target));
    let after = measured(&truth, &settings()).unwrap();
    for name in truth.row.keys() {
        // Both fits stop within a hundredth of a standard deviation of their minimum.
        let sd = before.shot.quantities.get(name).unwrap().sd;
        assert!((value(&before, name) - value(&after, name)).abs() < 0.05 * sd, "{name}");
    }
}

#[test]
fn agrees_with_the_thesis_construction_on_clean_pictures_of_a_hung_racket() {
    let truth = true_shot(11, &CLEAN);
    let shot = measured(&truth, &settings()).unwrap();
    let thesis = shot.shot.thesis.as_ref().unwrap();
    for (k, axis) in ["x", "y", "z"].iter().enumerate() {
        // Its line belongs to 5.5 ms before contact: gravity makes 0.05 to 0.07 m/s of that.
        assert!((thesis.ball_in_v[k] - value(&shot, &format!("ball_in_v{axis}"))).abs() < 0.08, "{axis}");
        assert!(thesis.racket_in_v[k].abs() < 0.02 && thesis.racket_in_w[k].abs() < 0.1, "{thesis:?}");
    }
    assert!((thesis.centre_on_plane[0] - value(&shot, "centre_on_plane_x")).abs() < 3e-4);
    assert!((thesis.centre_on_plane[1] - value(&shot, "centre_on_plane_y")).abs() < 3e-4);
    assert!((thesis.centre_on_plane_delay_s - value(&shot, "centre_on_plane_delay")).abs() < 2e-5);
    assert!(shot.shot.marker_distances.len() == 10 && shot.shot.marker_distances.iter().all(|d| d.mismatch_mm.abs() < 0.1));
}

#[test]
fn agrees_at_half_the_frame_rate_within_what_the_study_reports() {
    let truth = true_shot(12, &COURT);
    let spin = ShotSpin::default();
    let input = input_of(&truth, &spin);
    let study = frame_rate_study(&input, &settings(), &[2]).unwrap();
    let [full, half] = &study.cameras[..] else { panic!("{study:?}") };
    assert_eq!((half.phases, half.frame_rate_hz), (2, 500.0), "{:?}", half.failed);
    assert!(half.ball_velocity_m_s.unwrap() > full.ball_velocity_m_s.unwrap());
    assert!(half.ball_velocity_m_s.unwrap() < 0.3 && half.instant_s.unwrap() < 1e-4);
    // A window twice as long is less straight (figures 4.14 to 4.16): an arc bows four times as far.
    assert!(half.tip_bow_m.unwrap() > 3.0 * full.tip_bow_m.unwrap());
}

#[test]
fn truth_a_ball_far_outside_the_calibrated_volume_is_told() {
    // A calibration of a volume around the ball, and the same of one five metres beside it.
    let shot = |aside_m: f64| {
        let mut truth = true_shot(21, &COURT);
        let middle = truth.rig.global_from_left.isometry().inverse() * Point3::new(0.0, 1.0, 0.0);
        let corners: Vec<[f64; 3]> = (0..8).map(|i| [0, 1, 2].map(|k| middle[k] + if i >> k & 1 == 1 { 1.0 } else { -1.0 } + aside_m)).collect();
        // Two cameras of nine numbers each, rotation and translation between them.
        let n = 24;
        let matrix: Vec<Vec<f64>> = (0..n).map(|i| (0..n).map(|k| if i == k { 1e-12 } else { 0.0 }).collect()).collect();
        truth.rig.more.insert("covariance".into(), serde_json::json!({ "matrix": matrix }));
        truth.rig.more.insert("volume".into(), serde_json::json!({ "reference_points_m": corners }));
        measured(&truth, &settings()).expect("measured").shot.remarks
    };
    let told = |remarks: &[String]| remarks.iter().any(|r| r.contains("far outside"));
    assert!(!told(&shot(0.0)) && told(&shot(5.0)), "{:?} {:?}", shot(0.0), shot(5.0));
}

#[test]
fn fails_input_that_shows_no_impact_gets_its_own_error() {
    let truth = true_shot(3, &CLEAN);
    let with = |change: &dyn Fn(&mut TrueShot), s: &MeasureSettings| {
        let mut t = true_shot(3, &CLEAN);
        change(&mut t);
        measured(&t, s).map(|_| ()).unwrap_err().to_string()
    };
    assert!(with(&|t| t.tracks.points.clear(), &settings()).contains("no points"));
    assert!(with(&|t| t.racket.markers = None, &settings()).contains("[markers]"));
    let early = truth.impact_frame as u64 - 12;
    assert!(with(&|t| t.tracks.points.retain(|p| p.frame < early), &settings()).contains("no impact"));
    let far = MeasureSettings { impact_frame: Some(9000), ..settings() };
    assert!(with(&|_| (), &far).contains("9000"));
    // Nothing after contact is no failure: the shot keeps its inputs and says what it lacks.
    let mut cut = true_shot(3, &CLEAN);
    let last = truth.impact_frame as u64 + 3;
    cut.tracks.points.retain(|p| p.frame <= last);
    let shot = measured(&cut, &settings()).unwrap();
    assert!(shot.shot.quantities.get("ball_out_vx").is_none() && shot.shot.quantities.get("ball_in_vx").is_some());
    assert!(shot.shot.remarks.iter().any(|r| r.contains("after contact")), "{:?}", shot.shot.remarks);
}

/// Changes the tracks of a clean shot, measures, and returns the shot or its error's words.
fn with_tracks(seed: u64, keep: impl Fn(&TrackPoint, i64) -> bool) -> (TrueShot, Result<MeasuredShot, String>) {
    let mut truth = true_shot(seed, &COURT);
    let impact = truth.impact_frame as i64;
    for p in truth.tracks.points.iter_mut().filter(|p| !keep(p, p.frame as i64 - impact)) {
        (p.point, p.state) = (None, PointState::Occluded);
    }
    let shot = measured(&truth, &settings()).map_err(|e| e.to_string());
    (truth, shot)
}

/// Largest error over the stated deviation of all columns whose name begins so; `None` when none was measured.
fn worst(truth: &TrueShot, shot: &MeasuredShot, stem: &str) -> Option<f64> {
    let errors = truth.row.iter().filter(|(name, _)| name.starts_with(stem)).filter_map(|(name, v)| {
        let q = shot.shot.quantities.get(name)?;
        Some((q.value - v).abs() / q.sd)
    });
    errors.reduce(f64::max)
}

/// The ball's track bent at a frame: its image drops by so many pixels per frame the farther back (or on) from the contact.
fn with_bounce(seed: u64, at: i64, px_per_frame: f64) -> (TrueShot, MeasuredShot) {
    let truth = bounced(seed, at, px_per_frame);
    let shot = measured(&truth, &settings()).unwrap();
    (truth, shot)
}

fn bounced(seed: u64, at: i64, px_per_frame: f64) -> TrueShot {
    let mut truth = true_shot(seed, &COURT);
    let impact = truth.impact_frame as i64;
    for p in truth.tracks.points.iter_mut().filter(|p| p.target == Target::Ball) {
        let beyond = if at < 0 { impact + at - p.frame as i64 } else { p.frame as i64 - impact - at };
        if let Some(point) = p.point.as_mut() {
            point.uv.y += px_per_frame * beyond.max(0) as f64;
        }
    }
    truth
}

/// Why a shot is refused, or what is remarked of it: a ball that was turned beside the strings is refused where strings that hold it all along could not
/// carry it as far aside.
fn told_of(truth: &TrueShot) -> String {
    measured(truth, &settings()).map_or_else(|refused| refused.to_string(), |shot| shot.shot.remarks.join("; "))
}

#[test]
fn truth_a_bounce_within_the_window_shortens_it_and_nothing_else_does() {
    // 3 px per frame are a change of 12 m/s: a ball on the rise from the court, 12 frames before it is hit, or one that meets
    // the net 17 frames after (its first five or six are contact).
    for (seed, at) in [(51, -12), (52, -14), (53, 19), (54, 17)] {
        let (truth, shot) = with_bounce(seed, at, 3.0);
        let (window, stem) = if at < 0 { (&shot.shot.windows.ball_in, "ball_in_v") } else { (shot.shot.windows.ball_out.as_ref().unwrap(), "ball_out_v") };
        assert!(window.shortened && window.length_s < 1.6e-2 && window.frames >= 9, "seed {seed}: {window:?}");
        assert!(worst(&truth, &shot, stem).unwrap() < 4.0, "seed {seed}: {:?}", worst(&truth, &shot, stem));
    }
    // Right behind the contact ten frames hold the bend: such a flight does not come from the strings.
    let told = told_of(&bounced(55, 12, 3.0));
    assert!(told.contains("court, net or frame"), "{told}");
    // A flight is left alone.
    let shortened: usize = (60..80u64)
        .into_par_iter()
        .map(|seed| {
            let w = measured(&true_shot(seed, &COURT), &settings()).unwrap().shot.windows;
            usize::from(w.ball_in.shortened) + usize::from(w.ball_out.unwrap().shortened)
        })
        .sum();
    assert!(shortened <= 2, "{shortened} of 40 windows shortened though nothing bends");
}

#[test]
fn truth_a_half_volley_is_measured_from_the_frames_behind_its_bounce_or_told() {
    // 12 m/s, seven and eight frames before: five frames and more are behind what the court may have held.
    for (seed, at) in [(51, -7), (52, -8), (53, -7), (54, -8)] {
        let (truth, shot) = with_bounce(seed, at, 3.0);
        let remarks = &shot.shot.remarks;
        assert!(remarks.iter().any(|r| r.contains("half-volley")), "seed {seed}: {:?} {remarks:?}", shot.shot.windows.ball_in);
        assert!(worst(&truth, &shot, "ball_in_v").unwrap() < 4.0, "seed {seed}: {:?}", worst(&truth, &shot, "ball_in_v"));
        assert!(shot.shot.quantities.get("ball_in_vx").unwrap().sd < 1.0);
    }
    // Nearer to the strings, with the ball between seen and unseen.
    for (seed, at) in [(51, -2), (52, -3), (53, -4), (54, -5)] {
        let mut truth = bounced(seed, at, 3.0);
        assert!(told_of(&truth).contains("court"), "seed {seed}: {}", told_of(&truth));
        let turned = (truth.impact_frame as i64 + at) as u64;
        let lost = turned..=truth.impact_frame as u64;
        truth.tracks.points.retain(|p| p.target != Target::Ball || !lost.contains(&p.frame));
        assert!(told_of(&truth).contains("court"), "seed {seed}, unseen: {}", told_of(&truth));
    }
    let told: usize = (60..76u64)
        .into_par_iter()
        .map(|seed| usize::from(measured(&true_shot(seed, &NOISY), &settings()).unwrap().shot.remarks.iter().any(|r| r.contains("half-volley"))))
        .sum();
    assert_eq!(told, 0, "of 16 shots whose ball nothing turned");
}

/// A window of some 20 ms hardly tells the few m/s² of a slow hand from none, nor a hung racket's sway from rest: laws that know of no acceleration are not
/// believed for their fewer numbers there. The racket's intervals of blocks and drop shots cover, and so do those of rackets that sway.
#[test]
fn truth_intervals_cover_where_a_slow_hand_carries_the_racket_and_where_it_sways() {
    let slow = [1.0, 2.0, 4.0, 8.0, 16.0].map(|slow_m_s2| (Difficulty { slow_m_s2, ..COURT }, slow_m_s2));
    let sways = [3.0, 10.0].map(|sway_times| (Difficulty { sway_times, ..LABORATORY }, -sway_times));
    for (k, (difficulty, what)) in slow.into_iter().chain(sways).enumerate() {
        let from = 9900 + 20 * k as u64;
        let s = score(&difficulty, from..from + 14);
        report(&format!("{what}"), &s);
        for group in ["racket_in_v", "racket_in_w", "racket_out_v", "racket_out_w"] {
            assert!(s.coverage(&[group]) > SLOW_COVERS, "{what}, {group}: {:.3}", s.coverage(&[group]));
        }
    }
}

/// The ends of the table in docs/kinematics-experiments.md of errors by the longest window allowed: 30 ms know velocities better than 10 ms, and
/// their intervals are as true.
#[test]
fn law_a_long_window_knows_velocities_better() {
    let long = Difficulty { frames: (40, 42), ..COURT };
    let errors = [0.010, 0.030].map(|window_s| {
        let s = score_with(&long, 9500..9512, &MeasureSettings { window_s, ..stated(long.tape_error_px) });
        assert!(s.coverage(&[""]) > 0.93, "{window_s} s: {:.3} inside", s.coverage(&[""]));
        ["ball_in_v", "ball_out_v", "racket_in_v", "racket_out_v"].map(|c| s.rms(&[c]))
    });
    for k in 0..4 {
        assert!(errors[1][k] < 0.9 * errors[0][k], "{errors:?}");
    }
}

/// Rackets balanced 3 mm nearer to the tip than their file says, as 24 free flights show: where the centre of mass lies, and the
/// velocity of the stated point, which goes round it.
#[test]
fn truth_free_flights_tell_where_the_racket_is_balanced() {
    const OFF_M: f64 = 0.003;
    let shots = |stated_off_m: f64, balance: BalanceSeen| -> (BalanceSeen, f64) {
        let settings = MeasureSettings { balance, ..settings() };
        let each: Vec<(MotionEstimate, f64)> = (9700..9724u64)
            .into_par_iter()
            .map(|seed| {
                let mut truth = true_shot(seed, &COURT);
                truth.racket.balance_m += stated_off_m;
                let shot = measured(&truth, &settings).expect("measured");
                let of = |stem: &str| Vector3::from(["x", "y", "z"].map(|a| truth.row[format!("{stem}{a}").as_str()]));
                // The row is the centre of mass's; the stated point lies along x as the racket then stands.
                let turned = Rotation3::from_scaled_axis((of("racket_in_w") + of("racket_out_w")) * (0.5 * truth.row["contact_time"]));
                let point = of("racket_out_v") + of("racket_out_w").cross(&(turned * Vector3::x() * -stated_off_m));
                let seen = Vector3::from(["x", "y", "z"].map(|a| value(&shot, &format!("racket_out_v{a}"))));
                (shot.motion.racket_out.expect("seen after contact"), (seen - point).x.powi(2))
            })
            .collect();
        let along = (each.iter().map(|(_, e)| e).sum::<f64>() / each.len() as f64).sqrt();
        (BalanceSeen::of(each.iter().map(|(m, _)| m)), along)
    };
    // A balance stated too far from the butt is a point too near to the tip: the centre of mass lies along +x of it.
    let (seen, unaware) = shots(OFF_M, BalanceSeen::expected());
    let off = seen.shift_m - Vector3::new(OFF_M, 0.0, 0.0);
    assert!(seen.flights >= 20 && seen.sd_m.max() < 1e-3, "{seen:?}");
    assert!((0..3).all(|k| off[k].abs() < 3.0 * seen.sd_m[k]), "{seen:?}");
    let (_, aware) = shots(OFF_M, seen);
    // The law of a racket that is balanced elsewhere has done part of it in every shot alone.
    assert!(aware < 0.95 * unaware, "error along the handle {unaware} m/s, with the balance seen {aware}");
    let (right, _) = shots(0.0, BalanceSeen::expected());
    assert!((0..3).all(|k| right.shift_m[k].abs() < 3.0 * right.sd_m[k]), "{right:?}");
}

#[test]
fn fails_thin_tracks_are_measured_or_named() {
    // The ball in one camera only: nothing tells how far away it is.
    let (_, shot) = with_tracks(31, |p, _| p.target != Target::Ball || p.camera == CameraId::Left);
    let words = shot.map(|_| ()).unwrap_err();
    assert!(words.contains("both cameras"), "{words}");
    // One camera loses the ball in half the frames before contact: measured, a little less well.
    let (truth, shot) = with_tracks(32, |p, k| p.target != Target::Ball || p.camera == CameraId::Left || !(-9..=0).contains(&k));
    assert!(worst(&truth, &shot.unwrap(), "ball_in_v").unwrap() < 4.0);
    // Ball and racket hidden for three frames about the contact.
    let (truth, shot) = with_tracks(33, |_, k| !(-2..=1).contains(&k));
    let shot = shot.unwrap();
    for stem in ["ball_in_v", "racket_in_", "ball_out_v", "racket_out_", "impact_"] {
        assert!(worst(&truth, &shot, stem).unwrap() < 4.0, "{stem}");
    }
    // The ball hidden for 23 frames about it, and the racket for none or four of them: where both its flights lead. (The string plane sweeps past the
    // ball beside the gap, too; and a racket carried on from where the ball was last seen does not meet it.)
    for (seed, racket_hidden) in [34, 37, 38, 43].into_iter().flat_map(|seed| [(seed, 0..0), (seed, -2..2)]) {
        let (truth, shot) = with_tracks(seed, |p, k| if p.target == Target::Ball { !(-10..=12).contains(&k) } else { !racket_hidden.contains(&k) });
        let shot = shot.unwrap_or_else(|e| panic!("{seed}: {e}"));
        for stem in ["ball_in_v", "ball_out_v", "racket_in_v", "impact_"] {
            assert!(worst(&truth, &shot, stem).unwrap() < 4.0, "{seed}: {stem}");
        }
    }
    // The racket leaves the picture at the contact (a shot held in front of a body): the ball's rebound is still measured.
    let (truth, shot) = with_tracks(34, |p, k| p.target == Target::Ball || k <= 2);
    let shot = shot.unwrap();
    assert!(worst(&truth, &shot, "racket_out_").is_none() && worst(&truth, &shot, "contact_time").is_none());
    assert!(worst(&truth, &shot, "ball_out_v").unwrap() < 4.0 && shot.shot.quantities.get("apparent_restitution").is_some());
    assert!(shot.shot.remarks.iter().any(|r| r.contains("last contact")), "{:?}", shot.shot.remarks);
    // The ball leaves it.
    let (truth, shot) = with_tracks(35, |p, k| p.target != Target::Ball || k <= 2);
    let shot = shot.unwrap();
    assert!(worst(&truth, &shot, "ball_out_v").is_none() && worst(&truth, &shot, "racket_out_v").unwrap() < 6.0);
    // Never a racket: named.
    let (_, shot) = with_tracks(36, |p, _| p.target == Target::Ball);
    assert!(shot.is_err());
}

#[test]
fn law_no_tracks_however_torn_make_it_panic_or_state_an_empty_deviation() {
    for seed in 0..40u64 {
        // A hash of point and seed decides; from one point in ten to nine in ten are gone.
        let share = (seed % 9 + 1) * 10;
        let torn = |p: &TrackPoint| {
            let key = (p.frame * 31 + p.camera.index() as u64 * 7 + p.target.index() as u64 + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15 ^ (seed << 17));
            (key >> 33) % 100 >= share
        };
        let (_, shot) = with_tracks(40 + seed % 4, |p, _| torn(p));
        if let Ok(shot) = shot {
            assert!(shot.shot.quantities.0.iter().all(|(_, q)| q.value.is_finite() && q.sd.is_finite() && q.sd >= 0.0), "seed {seed}");
        }
    }
}

#[test]
fn cli_shots_goes_on_after_a_failure_and_keeps_what_is_done() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path();
    let write = |name: &str, text: &str| {
        let path = root.join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, text).unwrap();
    };
    let truth = true_shot(21, &COURT);
    write(
        "session.toml",
        "name = \"t\"\nframe_rate_hz = 1000.0\nexposure_s = 1e-4\nracket = \"racket.toml\"\nball = \"ball.toml\"\n[calibration]\nboard_columns = 9\n\
         board_rows = 6\nsquare_m = 0.06\nimages = \"calib\"\n[axes]\nimages = \"axes\"\narm_u_m = 0.6\narm_w_m = 0.4\n",
    );
    write("racket.toml", &toml::to_string(&truth.racket).unwrap());
    write("ball.toml", &toml::to_string(&truth.ball).unwrap());
    write("results/calibration.json", &serde_json::to_string(&truth.rig).unwrap());
    for id in ["good", "untracked", "few-after", "racket-lost", "ball-lost", "one-eyed", "no-spin", "torn"] {
        write(&format!("shots/{id}/shot.toml"), "player = \"A\"\n");
    }
    let tracks = |id: &str, keep: &dyn Fn(&TrackPoint, i64) -> bool| {
        let impact = truth.impact_frame as i64;
        let mut tracks = truth.tracks.clone();
        tracks.points.retain(|p| keep(p, p.frame as i64 - impact));
        write(&format!("results/shots/{id}/tracks.csv"), &tracks.to_csv());
    };
    for id in ["good", "no-spin"] {
        tracks(id, &|_, _| true);
    }
    tracks("few-after", &|_, k| k <= 8);
    tracks("racket-lost", &|p, k| p.target == Target::Ball || k <= 2);
    tracks("ball-lost", &|p, k| p.target != Target::Ball || k <= 2);
    tracks("one-eyed", &|p, _| p.target != Target::Ball || p.camera == CameraId::Left);
    let refused = SpinEstimate::Refused { reason: SpinRefusal::TooFewFrames { seen: 2, needed: 6 } };
    let spin = BallSpin { before: refused.clone(), after: refused };
    write("results/shots/no-spin/spin.json", &serde_json::to_string(&spin).unwrap());
    write("results/shots/torn/tracks.csv", "frame,camera,target,u,v,u_sd,v_sd,state\n3,left,m1,1.0");
    let run = || std::process::Command::new(env!("CARGO_BIN_EXE_sweetspot")).args(["shots", root.to_str().unwrap()]).output().unwrap();
    let first = run();
    assert_eq!(first.status.code(), Some(1), "{}", String::from_utf8_lossy(&first.stderr));
    assert!(String::from_utf8_lossy(&first.stderr).contains("untracked: "));
    let table = std::fs::read_to_string(root.join("results/impacts.csv")).unwrap();
    let header = table.lines().next().unwrap();
    assert!(header.contains("player") && header.contains("balance_shift_sd"), "{header}");
    let measured: Vec<&str> = table.lines().skip(1).filter_map(|l| l.split(',').next()).collect();
    assert_eq!(measured, ["ball-lost", "few-after", "good", "no-spin", "racket-lost"]);
    let said = crate::cli::said(&first);
    assert!(said.contains("one-eyed: ") && said.contains("both cameras") && said.contains("torn: ") && said.contains("3 of 8 shots failed"), "{said}");
    // What was lost is left out and named; what is left is given.
    let shot = |id: &str| ShotRecord::read(&root.join("results/shots").join(id).join("shot.json")).unwrap().shot;
    let has = |s: &Shot, name: &str| s.quantities.get(name).is_some();
    let says = |s: &Shot, words: &str| s.remarks.iter().any(|r| r.contains(words));
    let (few, racketless, ballless, spinless) = (shot("few-after"), shot("racket-lost"), shot("ball-lost"), shot("no-spin"));
    assert!(!has(&few, "contact_time") && has(&few, "ball_in_vx") && says(&few, "after contact"), "{:?}", few.remarks);
    assert!(!has(&racketless, "racket_out_vx") && has(&racketless, "ball_out_vx") && says(&racketless, "last contact"), "{:?}", racketless.remarks);
    assert!(!has(&ballless, "ball_out_vx") && has(&ballless, "racket_out_vx") && !has(&ballless, "restitution"), "{:?}", ballless.remarks);
    assert!(!has(&spinless, "ball_in_spin") && has(&spinless, "restitution") && says(&spinless, "usable frames"), "{:?}", spinless.remarks);
    // The axes stand in the calibration: their pictures need not (session.toml names them, and there are none).
    assert!(shot("good").impact_timing.is_some() && has(&shot("good"), "playing_angle_deg") && !says(&shot("good"), "what is up"));
    let twice = std::process::Command::new(env!("CARGO_BIN_EXE_sweetspot"))
        .args(["shots", root.to_str().unwrap(), "--point", "-0.05,0.0301", "--point", "0,0", "--point", "-0.0502,0.03"])
        .output()
        .unwrap();
    let words = String::from_utf8_lossy(&twice.stderr).into_owned();
    assert!(twice.status.code() == Some(2) && words.contains("point_-50_30_mm") && words.contains("-0.0502"), "{words}");
    for file in ["shots/good/points.csv", "season.csv", "season.json"] {
        assert!(root.join("results").join(file).exists(), "{file}");
    }
    let written = |name: &str| std::fs::metadata(root.join("results").join(name)).unwrap().modified().unwrap();
    let (shot, bytes) = (written("shots/good/shot.json"), table);
    assert_eq!(run().status.code(), Some(1));
    assert_eq!(written("shots/good/shot.json"), shot, "a finished shot is not measured again");
    assert_eq!(std::fs::read_to_string(root.join("results/impacts.csv")).unwrap(), bytes);
    // A shot whose settings are broken now was this session's all the same: its table is no other's.
    write("shots/good/shot.toml", "impact_frame = \"late\"\n");
    let (broken, kept) = (run(), |name: &str| root.join("results").join(name).exists());
    let said = crate::cli::said(&broken);
    assert!(broken.status.code() == Some(1) && said.contains("good: ") && !said.contains("another table"), "{said}");
    assert!(!kept("impacts.earlier.csv") && kept("shots/good/shot.earlier.json") && kept("season.json"));
}

/// The shot with its ball elsewhere: `place` gives where, from the time since first contact (s) and where it was.
fn with_ball_at(truth: &TrueShot, shot: &MeasuredShot, place: impl Fn(f64, Point3<f64>) -> Point3<f64>) -> Result<MeasuredShot, KinematicsError> {
    let mut moved = TrueShot { tracks: truth.tracks.clone(), ..true_shot(0, &COURT) };
    (moved.rig, moved.racket, moved.ball) = (truth.rig.clone(), truth.racket.clone(), truth.ball.clone());
    for p in moved.tracks.points.iter_mut().filter(|p| p.target == Target::Ball) {
        let was = shot.points.iter().find(|s| s.frame == p.frame && s.target == Target::Ball).map(|s| s.position);
        let Some((seen, was)) = p.point.as_mut().zip(was) else { continue };
        let now = place((p.frame as f64 - truth.impact_frame) * FRAME_S, was);
        let px = |at: &Point3<f64>| truth.rig.project(p.camera, at).expect("before the camera");
        seen.uv += px(&now) - px(&was);
    }
    measured(&moved, &settings())
}

/// A ball that passes the racket, or goes straight through where it stands, is a named failure; one that the frame turns round is a shot with a remark.
#[test]
fn truth_a_ball_that_meets_nothing_is_no_impact_and_one_on_the_frame_is_named() {
    for seed in [1003, 1007, 12] {
        let truth = true_shot(seed, if seed > 1000 { &LABORATORY } else { &COURT });
        let shot = measured(&truth, &settings()).expect("an impact");
        assert!(!shot.shot.remarks.iter().any(|r| r.contains("frame,")), "{:?}", shot.shot.remarks);
        let (b, (x, y)) = (&shot.motion.ball_in, (value(&shot, "impact_x"), value(&shot, "impact_y")));
        let q = shot.motion.racket_in.state.global_from_racket;
        // Where it would be without the strings, its path carried to another place of the face.
        let flies = |to: [f64; 2]| {
            let aside = q * Vector3::new(to[0] - x, to[1] - y, 0.0);
            with_ball_at(&truth, &shot, |t, _| b.position + b.velocity * t + Vector3::new(0.0, -9.80665, 0.0) * (t * t / 2.0) + aside)
                .map(|s| s.shot.quantities)
        };
        // Past by 0.02 m across, where no other racket would say so either, by 0.08, and beyond the tip by 0.03.
        for (to, past_m) in [([0.0, 0.2005], 0.020), ([0.0, -0.2605], 0.080), ([-0.2505, 0.0], 0.030)] {
            match flies(to) {
                Err(KinematicsError::PassesBy { past_m: told, .. }) => assert!((told - past_m).abs() < 0.01, "{seed} {to:?}: {told}"),
                other => panic!("{seed} {to:?}: {other:?}"),
            }
        }
        for to in [[x, y], [0.0, 0.17]] {
            // The plane of a racket that swings sweeps past the ball twice, and nothing tells which time is meant.
            let named = |e: &KinematicsError| matches!(e, KinematicsError::FliesOn { .. }) || seed < 1000 && matches!(e, KinematicsError::PassesBy { .. });
            let outcome = flies(to);
            assert!(outcome.as_ref().is_err_and(named), "{seed} {to:?}: {outcome:?}");
        }
        // Both flights carried to the frame, and far off the racket.
        let turned = |to: f64| {
            let aside = q * Vector3::new(0.0 - x, to - y, 0.0);
            with_ball_at(&truth, &shot, |_, was| was + aside)
        };
        let frame = turned(0.140).unwrap_or_else(|e| panic!("{seed}: {e}")).shot;
        assert!(frame.remarks.iter().any(|r| r.contains("on the frame, 12 mm") || r.contains("on the frame, 13 mm")), "{seed}: {:?}", frame.remarks);
        assert!(matches!(turned(0.196), Err(KinematicsError::OffTheFace { .. })), "{seed}");
    }
}

/// Without the axes' frame nothing knows what is up: what needs it is left out and said, all else is there.
#[test]
fn law_without_axes_what_needs_the_vertical_is_left_out() {
    let truth = true_shot(12, &COURT);
    let spin = SpinVector { omega: Vector3::new(1.0, 2.0, 30.0), covariance: Matrix3::identity() };
    let spin = ShotSpin { before: Some(spin.clone()), after: Some(spin), ..ShotSpin::default() };
    let [with, without] =
        [true, false].map(|axes_known| measure_shot(&input_of(&truth, &spin), &MeasureSettings { axes_known, ..settings() }).expect("measured").shot);
    let says = |s: &Shot| s.remarks.iter().filter(|r| r.contains("nothing knows what is up")).count();
    assert_eq!((says(&with), says(&without)), (0, 1));
    assert!(with.impact_timing.is_some() && with.momentum.is_some() && without.impact_timing.is_none() && without.momentum.is_none());
    let left_out: Vec<&str> = with.quantities.0.iter().map(|(n, _)| n.as_str()).filter(|n| without.quantities.get(n).is_none()).collect();
    for name in ["playing_angle_deg", "planar_relative_velocity_up", "ball_in_topspin_rpm", "unexplained_impulse_y"] {
        assert!(left_out.contains(&name), "{name}: {left_out:?}");
    }
    assert!(without.quantities.get("efficiency").is_some() && without.quantities.get("ball_in_speed").is_some());
}
