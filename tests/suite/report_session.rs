//! A session's report from made-up results: plain and hostile names, everything and next to nothing.

use super::report::{HOSTILE, assert_page, keep, racket};
use super::report_mock::{comparison, diagnosis, ledger_entry, provenance};
use nalgebra::{Isometry3, Point3, Vector2, Vector3};
use std::collections::BTreeMap;
use sweetspot::calibration::{
    BOARDS_KEY, BoardReport, Camera, CameraId, Coverage, MethodError, PairFate, RigidTransform, Slice, SlicePoint, SquareSize, StereoRig, Volume,
};
use sweetspot::impact_table::ImpactTable;
use sweetspot::kinematics::{ImpactTiming, MarkerDistance, MomentumVerdict, Quantities, Shot, ShotRecord, WindowReport, Windows};
use sweetspot::quantity::Quantity;
use sweetspot::report::{FramePicture, PredictedShot, SessionResults, ShotResults, season_figures, session_report};
use sweetspot::tracking::{ImagePoint, PointState, SpacePoint, Target, TrackPoint, Tracks};
use sweetspot::validation::Verdict;

fn rig(name: &str) -> StereoRig {
    let camera =
        |fx| Camera { fx, fy: fx, cx: 256.0, cy: 250.0, distortion: [-0.5, 0.1, 0.0, 0.0, 0.0], rms_px: 0.06, sd: BTreeMap::from([("fx".to_owned(), 1.9)]) };
    let turn = nalgebra::Rotation3::from_euler_angles(0.01, 0.6, -0.02);
    let corner = |i: usize| [40.0 * i as f64 % 512.0, 30.0 * i as f64 % 512.0, 0.02 * (i as f64).sin(), 0.03 * (i as f64).cos()];
    let boards: Vec<BoardReport> = (0..12)
        .map(|k| {
            let c = Vector3::new(0.3 * f64::from(k % 4) - 0.5, 0.4 * f64::from(k / 4) - 0.5, 13.0);
            let outline = [(0.0, 0.0), (0.48, 0.0), (0.48, 0.3), (0.0, 0.3)].map(|(x, y)| [c.x + x, c.y + y, c.z + 0.3 * x]);
            BoardReport { pair: name.to_owned(), outline_left_m: outline, left_px: (0..54).map(corner).collect(), right_px: (0..54).map(corner).collect() }
        })
        .collect();
    StereoRig {
        image_size: [512, 512],
        left: camera(3000.0),
        right: camera(3050.0),
        r: [0, 1, 2].map(|i| [0, 1, 2].map(|j| turn[(i, j)])),
        t: [-7.0, 0.1, 2.0],
        rms_stereo_px: 0.06,
        pairs: vec![
            PairFate { name: name.to_owned(), used: true, reason: String::new(), rms_px: Some(0.05) },
            PairFate { name: name.to_owned(), used: false, reason: name.to_owned(), rms_px: None },
        ],
        square_mm: Some(SquareSize { mean: 60.01, sd: 0.05, n: 900 }),
        global_from_left: RigidTransform::from_isometry(&Isometry3::translation(0.0, 1.0, -13.0)),
        more: BTreeMap::from([
            (BOARDS_KEY.to_owned(), serde_json::to_value(boards).unwrap()),
            ("advice".to_owned(), serde_json::json!([name, 5, { "what": name }])),
            ("axes".to_owned(), serde_json::json!({ "wrong": name })),
            ("verdict".to_owned(), serde_json::to_value(verdict()).unwrap()),
            ("volume".to_owned(), serde_json::to_value(volume()).unwrap()),
            ("coverage".to_owned(), serde_json::to_value(coverage()).unwrap()),
            ("methods".to_owned(), serde_json::to_value(vec![method(name), method("DLT")]).unwrap()),
        ]),
    }
}

fn verdict() -> sweetspot::calibration::Verdict {
    sweetspot::calibration::Verdict {
        squares: SquareSize { mean: 60.01, sd: 0.05, n: 900 },
        square_bias_mm: 0.01,
        diagonal_error_mean_mm: 0.02,
        diagonal_error_sd_mm: 0.08,
        diagonal_error_max_mm: 0.3,
        diagonals: 50,
        diagonal_stated_mm: 566.0,
        boards: 25,
        side_along_rows_mm: 60.001,
        side_along_columns_mm: 59.999,
        side_difference_sd_mm: 0.004,
    }
}

fn volume() -> Volume {
    let slice = |fixed: usize, fixed_axis: char| {
        let point = |a: i32, b: i32| {
            let mut at_m = [0.0, 1.0, 0.0];
            (at_m[(fixed + 1) % 3], at_m[(fixed + 2) % 3]) = (0.25 * f64::from(a), 0.25 * f64::from(b));
            SlicePoint { at_m, in_view: a != 4, calibration_sd_mm: [0.1 + 0.01 * f64::from(a), 0.1, 0.2 + fixed as f64], pixel_sd_mm: [0.3; 3] }
        };
        Slice { fixed_axis, points: (-4..=4).flat_map(|a| (-4..=4).map(move |b| (a, b))).map(|(a, b)| point(a, b)).collect() }
    };
    Volume {
        centre_m: [0.0, 1.0, 0.0],
        side_m: 2.0,
        pixel_sd: 0.1,
        slices: vec![slice(0, 'U'), slice(1, 'V'), slice(2, 'W'), slice(0, '?')],
        reference_points_m: vec![],
        worst_calibration_mm: 0.8,
        rms_calibration_mm: 0.3,
    }
}

fn coverage() -> Coverage {
    let cells = vec![vec![0, 3, 9, 4], vec![2, 30, 40, 12], vec![1, 20, 33, 0], vec![0, 0, 5, 0]];
    let relative = vec![vec![None; 4]; 4];
    Coverage {
        left_cells: cells.clone(),
        right_cells: cells,
        left_relative_error: relative.clone(),
        right_relative_error: relative,
        left_tilt_deg: vec![5.0, 22.0, 31.0, 44.0, 48.0],
        right_tilt_deg: vec![15.0, 25.0, 38.0, 41.0, 52.0],
        pairs_used: 5,
    }
}

fn method(name: &str) -> MethodError {
    MethodError { method: name.to_owned(), parameters: 11, mean_error_mm: 0.4, max_error_mm: 1.9, rms_px: 0.2, lengths: 900 }
}

fn shot(name: &str, k: u32) -> Shot {
    let quantity = |n: &str, value: f64, sd: f64, unit: &str| (n.to_owned(), Quantity::new(value, sd, unit));
    let v = f64::from(k);
    let window = WindowReport { frames: 10, noise_scale: 1.0, laws: vec![(name.to_owned(), 0.9)], ..WindowReport::default() };
    let mut all = vec![
        quantity("ball_in_speed", 12.0 + v, 0.1, "m/s"),
        quantity("ball_out_speed", 33.0 + v, 0.1, "m/s"),
        quantity("ball_out_topspin_rpm", 1100.0 + 90.0 * v, 40.0, "rpm"),
        quantity("impact_x", 0.01 * v - 0.03, 0.001, "m"),
        quantity("impact_y", 0.02 - 0.01 * v, 0.001, "m"),
        quantity("impact_from_butt", 0.5 - 0.01 * v, 0.001, "m"),
        quantity("playing_angle_deg", -18.0 - 2.0 * v, 0.4, "deg"),
        quantity("planar_racket_velocity", 6.0 + v, 0.1, "m/s"),
        quantity("node_point_from_butt", 0.548, 0.0, "m"),
        quantity("impact_point_in_vx", v, 0.1, "m/s"),
        quantity("impact_point_in_vy", 6.0 - v, 0.1, "m/s"),
        quantity("impact_success_ratio", 1.0 + 0.1 * v, 0.1, ""),
        quantity("efficiency", 0.5, 0.01, ""),
        quantity(name, 1.0, f64::NAN, name),
    ];
    for (stem, unit) in [("racket_in_global_v", "m/s"), ("ball_in_global_v", "m/s"), ("ball_out_global_v", "m/s"), ("racket_in_w", "rad/s")] {
        all.extend(["x", "y", "z"].map(|a| quantity(&format!("{stem}{a}"), 3.0 * v, 0.2, unit)));
    }
    Shot {
        id: format!("{name}{k}"),
        racket: name.to_owned(),
        ball: name.to_owned(),
        ball_side_of_face: "+z".into(),
        groups: vec![("sex".into(), if k.is_multiple_of(2) { name.to_owned() } else { "female".into() })],
        quantities: Quantities(all),
        impact_timing: Some(ImpactTiming::Falling),
        swing_timing: None,
        momentum: Some(MomentumVerdict { chi2: 9.0, p_value: 0.03, hand_interferes: true }),
        windows: Windows { ball_in: window.clone(), racket_in: window, ball_out: None, racket_out: None },
        face_pose_sd: Some([0.001; 6]),
        thesis: None,
        marker_distances: vec![MarkerDistance {
            pair: (Target::M1, Target::M2),
            stated_mm: 224.5,
            seen_mm: 225.1,
            seen_sd_mm: 0.1,
            frames: 40,
            mismatch_mm: 0.6,
        }],
        remarks: vec![name.to_owned()],
    }
}

fn shot_results(name: &str, k: u32) -> ShotResults {
    let (mut tracks, mut points) = (Tracks::default(), Vec::new());
    for frame in 90..131u64 {
        let t = (frame as f64 - 110.0) * 1e-3;
        for camera in CameraId::BOTH {
            for target in Target::ALL {
                let hidden = target == Target::M2 && frame.is_multiple_of(7);
                let at = Vector2::new(200.0 + 8.0 * target.index() as f64 + t * 900.0, 220.0 + 9.0 * target.index() as f64);
                let point = (!hidden).then_some(ImagePoint { uv: at, sd: Vector2::new(0.04, 0.04) });
                tracks.points.push(TrackPoint { frame, camera, target, point, state: if hidden { PointState::Occluded } else { PointState::Measured } });
            }
        }
        for target in Target::ALL {
            let position = Point3::new(0.4 + t * 10.0, 1.0 + 0.03 * target.index() as f64, 0.02 * target.index() as f64);
            points.push(SpacePoint { frame, t, target, position, sd: Vector3::new(1e-3, 1e-3, 1e-3), residual_px: 0.1 });
        }
    }
    let mut png = std::io::Cursor::new(Vec::new());
    image::GrayImage::from_pixel(120, 110, image::Luma([90])).write_to(&mut png, image::ImageFormat::Png).unwrap();
    let picture =
        FramePicture { frame: 110, camera: CameraId::Left, png: png.into_inner(), corner: [180, 200], size: [120, 110], words: name.to_owned(), doubt: 2.0 };
    let record = ShotRecord { shot: shot(name, k), doubt: None, note: None, points: String::new(), provenance: provenance(name) };
    ShotResults {
        id: format!("{name}{k}"),
        racket: racket(name),
        record: Some(record),
        tracks: Some(tracks),
        points,
        pictures: vec![picture],
        recording: vec![name.to_owned()],
    }
}

fn session(name: &str, shots: u32) -> SessionResults {
    SessionResults {
        name: name.to_owned(),
        frame_rate_hz: 1000.0,
        rig: Some(rig(name)),
        axes_known: true,
        predicted: Vec::new(),
        model: None,
        shots: (0..shots).map(|k| shot_results(name, k)).collect(),
        failed: vec![(name.to_owned(), name.to_owned())],
        steps_failed: vec![(name.to_owned(), name.to_owned())],
        comparison: Some(comparison(60, 0.8, name)),
        at_its_best: Some(comparison(60, 0.8, name)),
        diagnosis: Some(diagnosis(Verdict::EffectMissing, name)),
        after: Some(comparison(60, 0.0, name)),
        ledger: vec![ledger_entry("first model", 1.8, name), ledger_entry("added frame-vibration", 1.0, name)],
    }
}

/// What there is to say of a session that came to nothing is which step failed.
#[test]
fn truth_a_session_without_results_is_headed_by_the_step_that_failed() {
    let shots = vec![ShotResults { record: None, tracks: None, points: Vec::new(), pictures: Vec::new(), ..shot_results("s1", 0) }];
    let steps_failed = vec![("calibrate".to_owned(), "only 0 of 30 pairs can be used".to_owned())];
    let page = session_report(&SessionResults { name: "lab".into(), frame_rate_hz: 1000.0, shots, steps_failed, ..SessionResults::default() });
    let at = |words: &str| page.find(words).unwrap_or_else(|| panic!("{words} is missing"));
    assert!(at("Failed: calibrate; the reason stands below.") < at("The one shot could not be measured"), "the step comes first");
    assert!(at("only 0 of 30 pairs") > at("The one shot could not be measured"));
}

/// The diagnosis speaks of the model at its best: its pictures show that one, the rest of the page the model as its file states it.
#[test]
fn law_where_it_fails_is_drawn_of_the_model_at_its_best() {
    let places = |results: &SessionResults| {
        let page = session_report(results);
        let from = page.find("id=\"where-").unwrap();
        page[from..from + page[from..].find("</section>").unwrap()].to_owned()
    };
    let best = SessionResults { at_its_best: Some(comparison(60, 0.1, "lab")), ..session("lab", 2) };
    assert_ne!(places(&best), places(&session("lab", 2)));
    assert_eq!(places(&best), places(&SessionResults { comparison: Some(comparison(60, 0.4, "lab")), ..best.clone() }));
    // The model as its file states it is not drawn in its place.
    let unknown = places(&SessionResults { at_its_best: None, ..best.clone() });
    assert!(places(&best).contains("<svg") && !unknown.contains("<svg") && unknown.contains("<table"), "{unknown}");
}

#[test]
fn law_a_session_report_holds_with_plain_and_hostile_names() {
    for (file, name) in [("plain", "lab 2026"), ("hostile", HOSTILE)] {
        let results = session(name, 6);
        let page = session_report(&results);
        assert_page(&page);
        assert_eq!(page, session_report(&results));
        assert_eq!(page.matches("<title>Uncertainty of a point").count(), 3, "one figure a slice, none for an axis that does not exist");
        keep(&format!("session-{file}.html"), &page);
    }
    let page = session_report(&session("forty", 40));
    assert_page(&page);
}

/// The markup of the figure with this title.
fn figure<'a>(page: &'a str, title: &str) -> &'a str {
    let at = page.find(&format!("<title>{title}")).unwrap_or_else(|| panic!("no figure {title}"));
    &page[at..at + page[at..].find("</svg>").unwrap()]
}

#[test]
fn law_calibration_maps_have_axes_units_and_a_common_scale() {
    let page = session_report(&session("lab 2026", 6));
    for title in ["Corners over the left picture", "Corners over the right picture", "Reprojection error over the left picture"] {
        let svg = figure(&page, title);
        assert!(svg.contains(">u (px)<") && svg.contains(">v (px)<") && svg.contains(">500<"), "{title}: {svg:.600}");
    }
    // Every cell says how many corners it holds.
    let svg = figure(&page, "Corners over the left picture");
    assert!(svg.contains(">33</text>") && svg.contains(">corners</text>"), "{svg}");
    // Each slice of these has values of its own; the colours of all span the same range.
    let ticks = |axis: char| -> Vec<&str> {
        let svg = figure(&page, &format!("Uncertainty of a point, {axis}"));
        assert!(svg.contains(">sd (mm)</text>"), "{svg}");
        svg.split("<text ").filter(|t| t.contains("font-size=\"10\"")).filter_map(|t| t.split(['>', '<']).nth(1)).collect()
    };
    assert!(ticks('U').len() > 1 && ticks('U') == ticks('V') && ticks('V') == ticks('W'), "{:?} {:?}", ticks('U'), ticks('V'));
}

#[test]
fn law_next_to_nothing_still_makes_a_page() {
    assert_page(&session_report(&SessionResults::default()));
    let mut bare = session("bare", 1);
    bare.axes_known = false;
    bare.rig = bare.rig.map(|r| StereoRig { more: BTreeMap::new(), pairs: Vec::new(), square_mm: None, ..r });
    (bare.comparison, bare.diagnosis, bare.after) = (None, None, None);
    bare.shots[0].tracks = None;
    bare.shots[0].points.clear();
    let page = session_report(&bare);
    assert_page(&page);
    assert!(page.contains("Cameras and boards") && !page.contains("Uncertainty of a point") && !page.contains("Trajectories in space"));
}

#[test]
fn truth_a_session_is_doubted_as_its_comparison_is() {
    let mut doubted = session("lab", 2);
    (doubted.comparison, doubted.diagnosis) = (Some(comparison(60, 0.0, "rigid")), None);
    (doubted.failed, doubted.steps_failed) = (Vec::new(), Vec::new());
    let mut clear = doubted.clone();
    clear.comparison.as_mut().expect("compared").doubts.clear();
    let mut failing = doubted.clone();
    failing.comparison = Some(comparison(60, 0.8, "rigid"));
    for (session, tone) in [(&doubted, "doubt"), (&clear, "good"), (&failing, "bad")] {
        let page = session_report(session);
        assert!(page.contains(&format!("<div class=\"verdict {tone}\">")), "{tone}: {:.600}", page.split("class=\"verdict").nth(1).unwrap_or_default());
    }
}

#[test]
fn truth_season_figures_follow_the_thesis_and_split_by_sex() {
    let shots: Vec<Shot> = (0..6).map(|k| shot("male", k)).collect();
    let figures = season_figures(&shots.iter().collect::<Vec<_>>(), Some(&racket("r")));
    let names: Vec<&str> = figures.iter().map(|f| f.name.as_str()).collect();
    let own: std::collections::BTreeSet<&str> = names.iter().copied().collect();
    assert_eq!(own.len(), names.len(), "names repeat: {names:?}");
    for (name, times) in
        [("racket-velocity", 2), ("ball-velocity-after", 2), ("impact-along", 1), ("playing-angle", 1), ("effective-mass", 1), ("spin-planar-velocity", 1)]
    {
        assert_eq!(names.iter().filter(|n| n.starts_with(name)).count(), times, "{name}: {names:?}");
    }
    // Spin rises by 90 rpm and the planar velocity by 1 m/s per shot.
    let trend = figures.iter().find(|f| f.name == "spin-planar-velocity").unwrap();
    assert!(trend.caption.contains("slope 90.00") && trend.caption.contains("R² = 1.00"), "{}", trend.caption);
    assert!(season_figures(&shots.iter().take(3).collect::<Vec<_>>(), None).is_empty());
    // A column that two of six shots have parts none of them off.
    let mut some: Vec<Shot> = shots.clone();
    for (shot, player) in some.iter_mut().zip(["Ann", "Ben"]) {
        shot.groups.push(("player".to_owned(), player.to_owned()));
    }
    some.iter_mut().for_each(|shot| shot.groups.retain(|(key, _)| key == "player"));
    let figures = season_figures(&some.iter().collect::<Vec<_>>(), None);
    let counted: usize = figures.iter().find(|f| f.name == "playing-angle").unwrap().bins.iter().map(|b| b.shots).sum();
    assert_eq!(counted, 6);
}

#[test]
fn truth_few_shots_show_what_prediction_and_difference_are_good_to() {
    let folder = tempfile::tempdir().unwrap();
    let table = |name: &str, text: &str| {
        std::fs::write(folder.path().join(name), text).unwrap();
        ImpactTable::read(&folder.path().join(name)).unwrap().rows
    };
    let head = "id,ball_in_vx,ball_in_vy,ball_in_vz,racket_in_vx,racket_in_vy,racket_in_vz,racket_in_wx,racket_in_wy,racket_in_wz,impact_x,impact_y";
    let row = |id: &str, out: f64| format!("{id},0,0,-20,0,0,0,0,0,0,0,0,{out},0.3\n");
    let measured = table("impacts.csv", &format!("{head},ball_out_vz,ball_out_vz_sd\n{}{}", row("s01", 10.0), row("s02", 11.0)));
    let predicted = table("predictions.csv", "id,ball_out_vz\ns01,9\ns02,11.5\n");
    let deviations = table("predictions_sd.csv", "id,ball_out_vz\ns01,0.4\ns02,0.4\n");
    let shots = measured.into_iter().zip(predicted).zip(deviations);
    let predicted = shots.map(|((measured, predicted), sd)| PredictedShot { measured, predicted, predicted_sd: Some(sd) }).collect();
    let page = session_report(&SessionResults { predicted, model: Some("stiff.toml".to_owned()), ..SessionResults::default() });
    assert_page(&page);
    // Differences of 1 and -0.5 with a deviation of 0.5: their mean 0.25, root mean square 0.79, 1.6 deviations.
    for text in ["The model <code>stiff.toml</code>", "9.00 ±\u{a0}0.40", "1.00 ±\u{a0}0.50", "\u{2212}0.50 ±\u{a0}0.50", ">2.0<", ">0.25<", ">0.79<", ">1.6<"]
    {
        assert!(page.contains(text), "{text}");
    }
}
