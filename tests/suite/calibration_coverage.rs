//! Do the stated intervals cover? Two hundred seeded calibrations of a rig like the practice ones, corners with Gaussian
//! noise, everything else as in everyday use (outlier rejection, choice of the distortion model, clustering).

use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector2, Vector3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;
use sweetspot::calibration::{BoardView, Calibration, CalibrationError3d, CalibrationOptions, Camera, Checkerboard, PairViews, ViewFault, calibrate_views};
use sweetspot::reconstruction::Triangulator;
use sweetspot::tracking::ImagePoint;

const NOISE_PX: f64 = 0.05;
const PAIRS: usize = 20;

fn cameras() -> (Camera, Camera, Isometry3<f64>) {
    let camera = |fx: f64, cx: f64, cy: f64, distortion| Camera { fx, fy: fx - 1.3, cx, cy, distortion, rms_px: 0.0, sd: Default::default() };
    let left = camera(2950.0, 252.0, 268.0, [0.55, -0.4, -9e-4, -7e-4, 0.0]);
    let right = camera(3060.0, 258.0, 249.0, [-0.6, -2.0, -1.4e-3, -6e-4, 0.0]);
    (left, right, Isometry3::new(Vector3::new(-7.4, 0.1, 2.5), Vector3::new(0.02, 0.65, -0.01)))
}

/// What may be wrong with the pictures of the boards.
struct Recording {
    noise_px: f64,
    /// The print's length along its rows over the stated one.
    stretched: f64,
    /// A pair in which the board moved by so many metres before the right camera's picture was taken.
    moved: Option<(usize, f64)>,
    /// How much nearer to the cameras the ends of the board's rows lie than their middles, m.
    bow_m: f64,
}

const GOOD: Recording = Recording { noise_px: NOISE_PX, stretched: 1.0, moved: None, bow_m: 0.0 };

/// A calibration's views with noise, and where the volume's middle is (left camera's frame).
fn views(seed: u64, board: &Checkerboard) -> Vec<PairViews> {
    recorded(seed, board, &GOOD)
}

fn recorded(seed: u64, board: &Checkerboard, recording: &Recording) -> Vec<PairViews> {
    let (left, right, right_from_left) = cameras();
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let middle = Vector3::new((board.columns - 1) as f64, (board.rows - 1) as f64, 0.0) * (board.square_m / 2.0);
    let mut out = Vec::new();
    while out.len() < PAIRS {
        let turn = UnitQuaternion::from_scaled_axis(Vector3::new(rng.random_range(-0.7..0.7), 0.33 + rng.random_range(-0.7..0.7), rng.random_range(-0.5..0.5)));
        let place = Vector3::new(rng.random_range(-0.75..0.75), rng.random_range(-0.75..0.75), 12.3 + rng.random_range(-0.9..0.9));
        let pose = Isometry3::from_parts(place.into(), turn) * Isometry3::translation(-middle.x, -middle.y, 0.0);
        let mut see = |camera: &Camera, pose: Isometry3<f64>| -> Result<BoardView, ViewFault> {
            let mut corners = Vec::new();
            for p in board.corners() {
                let across = p.x / middle.x - 1.0;
                let place = Point3::new(recording.stretched * p.x, p.y, -recording.bow_m * across * across);
                let uv = camera.project(&(pose * place)).ok_or(ViewFault::NotFound)?;
                if uv.x < 5.0 || uv.y < 5.0 || uv.x > 506.0 || uv.y > 506.0 {
                    return Err(ViewFault::NotFound);
                }
                let noise: [f64; 2] = [StandardNormal.sample(&mut rng), StandardNormal.sample(&mut rng)];
                corners.push(uv + Vector2::new(noise[0], noise[1]) * recording.noise_px);
            }
            BoardView::from_corners(board, corners)
        };
        let meanwhile = recording.moved.filter(|(pair, _)| *pair == out.len()).map_or(0.0, |(_, m)| m);
        let later = Isometry3::translation(0.0, meanwhile, 0.0) * pose;
        let pair = PairViews { name: out.len().to_string(), left: see(&left, pose), right: see(&right, right_from_left * later) };
        if pair.left.is_ok() && pair.right.is_ok() {
            out.push(pair);
        }
    }
    out
}

#[test]
fn truth_intervals_of_parameters_and_distances_cover_over_seeded_calibrations() {
    let board = Checkerboard { columns: 9, rows: 6, square_m: 0.06 };
    let (left, right, right_from_left) = cameras();
    let runs = 200u64;
    let counts: Vec<([usize; 6], Vec<(String, f64)>)> = (0..runs)
        .into_par_iter()
        .map(|seed| {
            let c = calibrate_views(&board, [512, 512], &views(seed, &board), &CalibrationOptions::default()).unwrap();
            let mut n = [0; 6];
            let mut errors = Vec::new();
            let rig = c.rig();
            for (ours, truth) in [(&rig.left, &left), (&rig.right, &right)] {
                let values = |c: &Camera| [c.fx, c.fy, c.cx, c.cy, c.distortion[0], c.distortion[1], c.distortion[2], c.distortion[3]];
                for ((name, a), b) in ["fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2"].into_iter().zip(values(ours)).zip(values(truth)) {
                    if let Some(sd) = ours.sd.get(name) {
                        n[0] += usize::from((a - b).abs() < 1.96 * sd);
                        n[1] += 1;
                        errors.push((format!("{:?} {name}", c.model), (a - b) / sd));
                    }
                }
            }
            // Distances between points of the volume from their noise-free pixels.
            let (_, error): (_, CalibrationError3d) = c.volume(&rig.global_from_left).unwrap();
            let triangulator = Triangulator::new(&rig);
            let seen = |p: &Point3<f64>| {
                let at = |uv| ImagePoint { uv, sd: Vector2::new(0.1, 0.1) };
                triangulator.triangulate(&at(left.project(p).unwrap()), &at(right.project(&(right_from_left * p)).unwrap())).unwrap().position
            };
            let mut rng = ChaCha8Rng::seed_from_u64(1_000 + seed);
            for _ in 0..20 {
                let [a, b] = [0, 1].map(|_| Point3::new(rng.random_range(-0.8..0.8), rng.random_range(-0.8..0.8), 12.3 + rng.random_range(-0.8..0.8)));
                if (a - b).norm() < 0.2 {
                    continue;
                }
                let off = (seen(&a) - seen(&b)).norm() - (a - b).norm();
                let sd = error.distance_variance(&seen(&a), &seen(&b)).unwrap().sqrt();
                n[2] += usize::from(off.abs() < 1.96 * sd);
                n[3] += 1;
            }
            assert_eq!(c.bundle.shape, None, "a good board is a good board");
            n[4] = usize::from(c.pairs.iter().all(|p| p.used));
            n[5] = 1;
            (n, errors)
        })
        .collect();
    let total: [usize; 6] = std::array::from_fn(|k| counts.iter().map(|c| c.0[k]).sum());
    let mut by_name: std::collections::BTreeMap<&str, Vec<f64>> = Default::default();
    for (name, error) in counts.iter().flat_map(|c| &c.1) {
        by_name.entry(name).or_default().push(*error);
    }
    for (name, errors) in &by_name {
        let n = errors.len() as f64;
        let inside = errors.iter().filter(|e| e.abs() < 1.96).count() as f64;
        let (mean, square) = (errors.iter().sum::<f64>() / n, errors.iter().map(|e| e * e).sum::<f64>() / n);
        eprintln!("{name}: {:.1} % of {n}, errors in sd: mean {mean:+.3}, rms {:.3}", 100.0 * inside / n, square.sqrt());
    }
    let percent = |k: usize| 100.0 * total[k] as f64 / total[k + 1] as f64;
    eprintln!("{runs} calibrations: parameters {:.1} % of {}, distances {:.1} % of {}", percent(0), total[1], percent(2), total[3]);
    assert!((93.0..=97.0).contains(&percent(0)), "parameters: {:.2} %", percent(0));
    assert!((93.0..=97.0).contains(&percent(2)), "distances: {:.2} %", percent(2));
    assert_eq!(total[4], total[5], "no good pair may be dropped");
}

#[test]
fn truth_a_pair_that_is_not_of_one_instant_is_left_out_however_sharp_the_pictures() {
    let board = Checkerboard { columns: 9, rows: 6, square_m: 0.06 };
    for (seed, moved_m) in [(1, 0.005), (2, 0.005), (3, 0.02), (4, 0.1)] {
        let pairs = recorded(seed, &board, &Recording { noise_px: 0.01, moved: Some((4, moved_m)), ..GOOD });
        let c = calibrate_views(&board, [512, 512], &pairs, &CalibrationOptions::default()).unwrap();
        let unused: Vec<&str> = c.pairs.iter().filter(|p| !p.used).map(|p| p.name.as_str()).collect();
        assert_eq!(unused, ["4"], "moved by {moved_m} m");
        assert!(c.rms_px(None) < 0.02, "{}", c.rms_px(None));
    }
}

#[test]
fn truth_a_stretched_print_is_told() {
    let board = Checkerboard { columns: 9, rows: 6, square_m: 0.06 };
    let calibrated = |stretched: f64| {
        let pairs = recorded(5, &board, &Recording { noise_px: 0.02, stretched, ..GOOD });
        calibrate_views(&board, [512, 512], &pairs, &CalibrationOptions::default()).unwrap()
    };
    let (good, c) = (calibrated(1.0), calibrated(1.003));
    assert_eq!(good.verdict().unwrap().stretched(), None);
    assert!(c.verdict().unwrap().stretched().is_some_and(|w| w.contains("along the board's rows")));
    // The shape is right, the size is not known better than to half the stretch.
    let (found, sd) = (c.bundle.shape.as_ref().expect("the board is stretched").values[3], c.fit.shape_sd[3]);
    assert!((found - 0.003).abs() < 1e-5 + 3.0 * sd && sd < 1e-4, "{found} ± {sd}");
    let baseline = |c: &Calibration| c.bundle.right_from_left.translation.vector.norm();
    let sd = |c: &Calibration| (21..24).map(|i| c.sd(i).powi(2)).sum::<f64>().sqrt();
    let off = baseline(&c) / baseline(&good) - 1.0 + 0.0015;
    assert!(off.abs() < 1e-4, "{off}");
    let of_size = (sd(&c).powi(2) - sd(&good).powi(2)).sqrt() / baseline(&c);
    assert!((of_size - 0.0015).abs() < 2e-4, "{of_size}");
}

#[test]
fn truth_a_bowed_board_is_allowed_for() {
    let board = Checkerboard { columns: 9, rows: 6, square_m: 0.06 };
    let (left, right, right_from_left) = cameras();
    let (mut inside, mut all) = (0, 0);
    let (mut with, mut without) = (0.0, 0.0);
    for seed in 20..32 {
        let pairs = recorded(seed, &board, &Recording { noise_px: 0.02, bow_m: 1.0e-3, ..GOOD });
        let calibrated = |shaped_board: bool| {
            let c = calibrate_views(&board, [512, 512], &pairs, &CalibrationOptions { shaped_board, ..Default::default() }).unwrap();
            let rig = c.rig();
            let triangulator = Triangulator::new(&rig);
            let seen = |p: &Point3<f64>| {
                let at = |uv| ImagePoint { uv, sd: Vector2::new(0.1, 0.1) };
                triangulator.triangulate(&at(left.project(p).unwrap()), &at(right.project(&(right_from_left * p)).unwrap())).unwrap().position
            };
            let corner = |k: usize| Point3::new(1.2 * (k & 1) as f64 - 0.6, 0.6 * (k & 2) as f64 - 0.6, 11.8 + 0.3 * (k & 4) as f64);
            let middle = Point3::new(0.0, 0.0, 12.4);
            let square_mm2 = (0..8).map(|k| (1e3 * ((seen(&corner(k)) - seen(&middle)).norm() - (corner(k) - middle).norm())).powi(2)).sum::<f64>() / 8.0;
            (c, square_mm2)
        };
        let (c, square_mm2) = calibrated(true);
        with += square_mm2 / 12.0;
        without += calibrated(false).1 / 12.0;
        let shape = c.bundle.shape.as_ref().expect("the board is bowed");
        assert_eq!(shape.told(), [true, true, true, false], "bowed, not stretched");
        for (found, sd, truth) in [(0, -1.0e-3), (1, 0.0), (2, 0.0)].map(|(k, truth)| (shape.values[k], c.fit.shape_sd[k], truth)) {
            inside += usize::from((found - truth).abs() < 1.96 * sd);
            all += 1;
        }
    }
    eprintln!("distances {:.3} mm off with the bow, {:.3} without; {inside} of {all} sagittas inside", with.sqrt(), without.sqrt());
    assert!(with < 0.25 * without, "{with} mm² with the bow, {without} without");
    // Of 36 that cover 95 %, fewer than 30 are inside once in 7000.
    assert!(inside >= 30, "{inside} of {all} sagittas inside their 95 % intervals");
}

#[test]
fn truth_one_camera_twice_is_no_pair_of_cameras() {
    let board = Checkerboard { columns: 9, rows: 6, square_m: 0.06 };
    let mut pairs = views(6, &board);
    pairs.iter_mut().for_each(|p| p.right = p.left.clone());
    let error = calibrate_views(&board, [512, 512], &pairs, &CalibrationOptions::default()).unwrap_err();
    assert!(error.to_string().contains("stand in one place"), "{error}");
}
