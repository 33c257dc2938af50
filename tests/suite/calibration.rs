//! Calibration against answers that others have given, and against the practice sessions' truth.

use super::shared::shared;
use nalgebra::{UnitQuaternion, Vector2, Vector3};
use std::collections::BTreeMap;
use std::path::Path;
use sweetspot::calibration::{BoardView, Calibration, CalibrationOptions, Checkerboard, DistortionModel, PairViews, calibrate_views};

/// Board coordinates (mm) and both cameras' pixels of one corner.
type Row = ([f64; 2], [f64; 4]);

/// DuoDIC's corners: MATLAB pixels (first pixel (1, 1)) and board coordinates in mm.
fn duodic_views(path: &Path) -> (Checkerboard, Vec<PairViews>) {
    let mut reader = csv::Reader::from_path(path.join("board_corners.csv")).unwrap();
    let headers = reader.headers().unwrap().clone();
    let at = |name: &str| headers.iter().position(|h| h == name).unwrap();
    let (pair, x, y) = (at("pair"), at("X_mm"), at("Y_mm"));
    let columns = [at("u1_px"), at("v1_px"), at("u2_px"), at("v2_px")];
    let mut rows: Vec<(i64, [f64; 2], [f64; 4])> = Vec::new();
    for record in reader.records() {
        let record = record.unwrap();
        let number = |i: usize| record[i].parse::<f64>().unwrap();
        rows.push((number(pair) as i64, [number(x), number(y)], columns.map(|c| number(c) - 1.0)));
    }
    let steps = |k: usize| (rows.iter().map(|r| r.1[k]).fold(0.0, f64::max) / 10.0).round() as usize + 1;
    let board = Checkerboard { columns: steps(0), rows: steps(1), square_m: 0.010 };
    let mut pairs: BTreeMap<i64, Vec<Row>> = BTreeMap::new();
    for (n, b, uv) in rows {
        pairs.entry(n).or_default().push((b, uv));
    }
    let views = pairs
        .into_iter()
        .map(|(n, mut corners)| {
            corners.sort_by(|a, b| (a.0[1], a.0[0]).partial_cmp(&(b.0[1], b.0[0])).unwrap());
            let side = |k: usize| BoardView::from_corners(&board, corners.iter().map(|c| Vector2::new(c.1[k], c.1[k + 1])).collect());
            PairViews { name: n.to_string(), left: side(0), right: side(2) }
        })
        .collect();
    (board, views)
}

fn plain(model: DistortionModel) -> CalibrationOptions {
    CalibrationOptions { model: Some(model), reject_outliers: false, clustered_errors: false, shaped_board: false, ..Default::default() }
}

/// Standard deviations of the rotation vector from those of small turns about the right camera's axes.
fn rotation_vector_sd(c: &Calibration) -> [f64; 3] {
    let rotation = c.bundle.right_from_left.rotation;
    let jacobian = nalgebra::Matrix3::from_fn(|i, j| {
        let h = 1e-6;
        let turned = |s: f64| (UnitQuaternion::from_scaled_axis(Vector3::ith(j, s)) * rotation).scaled_axis();
        ((turned(h) - turned(-h)) / (2.0 * h))[i]
    });
    let block = c.fit.covariance.fixed_view::<3, 3>(18, 18).into_owned();
    let out = jacobian * block * jacobian.transpose();
    [0, 1, 2].map(|i| out[(i, i)].sqrt())
}

fn agrees(what: &str, ours: f64, theirs: f64, relative: f64) {
    assert!((ours - theirs).abs() <= relative * theirs.abs(), "{what}: {ours} against {theirs}");
}

#[test]
fn agrees_duodic_reproduces_matlab_optimum_and_standard_errors() {
    let Some(path) = shared("real-calibration/duodic-rigid-translation") else { return };
    let (board, views) = duodic_views(&path);
    assert_eq!((board.corner_count(), views.len()), (70, 37));
    let c = calibrate_views(&board, [2448, 2048], &views, &plain(DistortionModel::K1K2)).unwrap();
    let (l, r) = (&c.bundle.left, &c.bundle.right);
    // The optimum as MATLAB states it: four significant digits where the number has them (1e-4 of itself).
    for (what, ours, theirs) in [
        ("f1x", l.fx, 7012.609),
        ("f1y", l.fy, 7018.322),
        ("f2x", r.fx, 7034.931),
        ("f2y", r.fy, 7037.059),
        ("Tx", 1e3 * c.bundle.right_from_left.translation.x, -158.415),
        ("Tz", 1e3 * c.bundle.right_from_left.translation.z, 25.283),
        ("om y", c.bundle.right_from_left.rotation.scaled_axis().y, 0.355893),
        ("rms", c.rms_px(None), 0.58700),
    ] {
        agrees(what, ours, theirs, 1e-4);
        eprintln!("{what}: {ours:.5}, MATLAB {theirs}");
    }
    // Four significant digits against the independent adjustment quoted in SOURCE.md, standard errors against MATLAB.
    agrees("f1x", l.fx, 7012.539, 0.5e-4);
    agrees("Tx", 1e3 * c.bundle.right_from_left.translation.x, -158.4153, 0.5e-4);
    agrees("Ty", 1e3 * c.bundle.right_from_left.translation.y, -1.3664, 0.5e-3);
    agrees("Tz", 1e3 * c.bundle.right_from_left.translation.z, 25.2807, 0.5e-4);
    agrees("se f1x", c.sd(0), 4.875, 2e-4);
    agrees("se f1y", c.sd(1), 4.932, 2e-4);
    let (_, t) = c.pose_sd();
    for (i, theirs) in [0.0838, 0.0285, 0.3094].into_iter().enumerate() {
        agrees("se T", 1e3 * t[i], theirs, 2e-3);
    }
    for (ours, theirs) in rotation_vector_sd(&c).into_iter().zip([0.00078, 0.00073, 0.00015]) {
        assert!((ours - theirs).abs() < 0.6e-5, "{ours} {theirs}");
    }
}

fn corner_views(pairs: &[(String, [Vec<Vector2<f64>>; 2])], board: &Checkerboard) -> Vec<PairViews> {
    let view = |c: &Vec<Vector2<f64>>| BoardView::from_corners(board, c.clone());
    pairs.iter().map(|(n, [l, r])| PairViews { name: n.clone(), left: view(l), right: view(r) }).collect()
}

/// Bouguet's corners as stored with the reference runs (same corners for every tool).
#[test]
fn agrees_bouguet_corners_reproduce_the_reference_adjustment() {
    let Some(path) = shared("real-calibration/opencv-bouguet-stereo") else { return };
    let mut reader = csv::Reader::from_path(path.join("corners_cv460_adaptive0.3.csv")).unwrap();
    let headers = reader.headers().unwrap().clone();
    let board = Checkerboard { columns: 9, rows: 6, square_m: 0.030 };
    let at = |n: &str| headers.iter().position(|h| h == n).unwrap();
    let mut pairs: BTreeMap<String, [Vec<Vector2<f64>>; 2]> = BTreeMap::new();
    for record in reader.records() {
        let record = record.unwrap();
        let number = |i: usize| record[i].parse::<f64>().unwrap();
        let entry = pairs.entry(record[at("pair")].to_owned()).or_default();
        entry[0].push(Vector2::new(number(at("uL_px")), number(at("vL_px"))));
        entry[1].push(Vector2::new(number(at("uR_px")), number(at("vR_px"))));
    }
    let list: Vec<_> = pairs.into_iter().collect();
    let c = calibrate_views(&board, [640, 480], &corner_views(&list, &board), &plain(DistortionModel::K1K2P1P2)).unwrap();
    let (l, r) = (&c.bundle.left, &c.bundle.right);
    for (what, ours, theirs, sd, sd_theirs) in [
        ("L fx", l.fx, 533.785, c.sd(0), 0.288),
        ("L fy", l.fy, 533.780, c.sd(1), 0.294),
        ("L cx", l.cx, 342.114, c.sd(2), 0.420),
        ("L cy", l.cy, 234.986, c.sd(3), 0.418),
        ("R fx", r.fx, 537.009, c.sd(9), 0.303),
        ("R fy", r.fy, 536.582, c.sd(10), 0.301),
        ("R cx", r.cx, 327.116, c.sd(11), 0.447),
        ("R cy", r.cy, 249.864, c.sd(12), 0.405),
    ] {
        assert!((ours - theirs).abs() < 0.002, "{what}: {ours} against {theirs}");
        assert!((sd - sd_theirs).abs() < 0.001, "sd {what}: {sd} against {sd_theirs}");
    }
    agrees("rms", c.rms_px(None), 0.1969, 1e-3);
}
