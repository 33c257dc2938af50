//! Calibration from pictures: Bouguet's pairs against the published result, the practice sessions against their truth.

use super::shared::shared;
use nalgebra::{Isometry3, Matrix3, Point3, Vector2, Vector3};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use sweetspot::calibration::{
    AxesFrame, Calibration, CalibrationOptions, Camera, CameraId, Checkerboard, DistortionModel, PairImages, StereoRig, ViewFault, calibrate_images,
    find_corners, global_axes,
};
use sweetspot::footage::{GreyImage, numbered_images, read_grey};
use sweetspot::reconstruction::Triangulator;
use sweetspot::tracking::ImagePoint;

/// One of Bouguet's pictures: from `calib/bouguet` where the setup script has unpacked them, else the shared copy.
fn bouguet_picture(side: &str, n: usize) -> Option<PathBuf> {
    let name = format!("{side}{n:02}.jpg");
    let own = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("calib/bouguet/calib").join(side).join(&name);
    if own.exists() { Some(own) } else { shared("real-calibration/opencv-bouguet-stereo").map(|f| f.join(name)) }
}

#[test]
fn real_bouguet_pairs_agree_with_the_published_calibration() {
    if bouguet_picture("left", 1).is_none() {
        return;
    }
    let pairs: Vec<PairImages> = (1..=14)
        .filter(|n| *n != 10) // missing in OpenCV's copy
        .map(|n| {
            let read = |side: &str| bouguet_picture(side, n).map(|p| read_grey(&p).unwrap());
            PairImages { name: format!("{n:02}"), left: read("left"), right: read("right") }
        })
        .collect();
    let board = Checkerboard { columns: 9, rows: 6, square_m: 0.030 };
    // Bouguet's own distortion terms, so that the comparison is of corners and adjustment.
    let options = CalibrationOptions { model: Some(DistortionModel::K1K2P1P2), ..Default::default() };
    let c = calibrate_images(&board, &pairs, &options).unwrap();
    let used = c.pairs.iter().filter(|p| p.used).count();
    let t = 1e3 * c.bundle.right_from_left.translation.vector;
    let om = c.bundle.right_from_left.rotation.scaled_axis();
    let verdict = c.verdict().unwrap();
    eprintln!("{used} pairs, rms {:.4} px, T {t:?} om {om:?} sd {:?} clustering {:.2}", c.rms_px(None), c.pose_sd(), c.fit.clustering);
    eprintln!("{verdict:?}");
    assert_eq!(used, 13, "{:?}", c.pairs);
    assert!(c.rms_px(None) <= 0.25);
    // Published: T = -99.80198 1.12443 0.05041 +- 0.142 0.11352 0.49773 mm, om = 0.00669 0.00452 -0.00350 +- 0.0027 0.00308
    // 0.00029, where +- is three standard deviations.
    for (ours, theirs, three_sd) in [(t.x, -99.80198, 0.142), (t.y, 1.12443, 0.11352)] {
        assert!((ours - theirs).abs() <= three_sd / 3.0, "T {ours} against {theirs}");
    }
    // Along the view the published third (0.166 mm) is missed by every run with correct corners: OpenCV's own joint answer
    // lies 0.22 mm away (SOURCE.md), ours 0.34 mm. Pair 10 is missing here, and the boards' common errors (clustering about 5)
    // make our own deviation 0.36 mm. The published interval itself holds.
    assert!((t.z - 0.05041).abs() <= 0.49773, "T {}", t.z);
    for (ours, theirs, three_sd) in [(om.x, 0.00669, 0.0027), (om.y, 0.00452, 0.00308), (om.z, -0.00350, 0.00029)] {
        assert!((ours - theirs).abs() <= three_sd / 3.0, "om {ours} against {theirs}");
    }
    assert!((verdict.squares.mean - 30.0).abs() <= 0.05 && verdict.squares.sd <= 0.20, "{verdict:?}");
}

/// The practice session's board pictures, paired by number.
fn session_pairs(folder: &Path) -> Vec<PairImages> {
    let list = |side: &str| numbered_images(&folder.join("calib").join(side)).unwrap();
    let (left, right) = (list("left"), list("right"));
    let numbers: BTreeSet<u64> = left.iter().chain(&right).map(|p| p.0).collect();
    let read = |list: &[(u64, PathBuf)], n: u64| list.iter().find(|p| p.0 == n).map(|p| read_grey(&p.1).unwrap());
    numbers.into_iter().map(|n| PairImages { name: format!("{n:03}"), left: read(&left, n), right: read(&right, n) }).collect()
}

fn array<const N: usize>(v: &serde_json::Value) -> [f64; N] {
    std::array::from_fn(|i| v[i].as_f64().unwrap())
}

/// A truth camera as a camera and `camera_from_global`.
fn truth_camera(v: &serde_json::Value) -> (Camera, Isometry3<f64>) {
    let k = |i: usize, j: usize| v["K"][i][j].as_f64().unwrap();
    let camera = Camera { fx: k(0, 0), fy: k(1, 1), cx: k(0, 2), cy: k(1, 2), distortion: array(&v["dist"]), rms_px: 0.0, sd: Default::default() };
    let r = Matrix3::from_fn(|i, j| v["R"][i][j].as_f64().unwrap());
    let rotation = nalgebra::UnitQuaternion::from_rotation_matrix(&nalgebra::Rotation3::from_matrix_unchecked(r));
    (camera, Isometry3::from_parts(Vector3::from(array(&v["t"])).into(), rotation))
}

/// Root-mean-square distance after the best rotation and shift, and the angle of that rotation (Kabsch).
fn aligned(measured: &[Point3<f64>], truth: &[Point3<f64>]) -> (f64, f64) {
    let n = measured.len() as f64;
    let mean = |p: &[Point3<f64>]| p.iter().map(|q| q.coords).sum::<Vector3<f64>>() / n;
    let (a, b) = (mean(measured), mean(truth));
    let h: Matrix3<f64> = measured.iter().zip(truth).map(|(p, q)| (p.coords - a) * (q.coords - b).transpose()).sum();
    let svd = h.svd(true, true);
    let (u, vt) = (svd.u.unwrap(), svd.v_t.unwrap());
    let flip = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, (vt.transpose() * u.transpose()).determinant().signum()));
    let r = vt.transpose() * flip * u.transpose();
    let squares: f64 = measured.iter().zip(truth).map(|(p, q)| (r * (p.coords - a) + b - q.coords).norm_squared()).sum();
    ((squares / n).sqrt(), ((r.trace() - 1.0) / 2.0).clamp(-1.0, 1.0).acos())
}

fn practice(kind: &str) -> Option<(Calibration, StereoRig, serde_json::Value)> {
    let folder = shared("practice/footage")?;
    let truth = serde_json::from_str(&std::fs::read_to_string(folder.join(format!("{kind}.truth.json"))).unwrap()).unwrap();
    let folder = folder.join(kind);
    let board = Checkerboard { columns: 9, rows: 6, square_m: 0.06 };
    let c = calibrate_images(&board, &session_pairs(&folder), &CalibrationOptions::default()).unwrap();
    let mut rig = c.rig();
    let picture = |side: &str| read_grey(&folder.join("axes").join(format!("{side}.png"))).unwrap();
    rig.global_from_left = global_axes(&rig, &picture("left"), &picture("right"), &AxesFrame { arm_u_m: 0.6, arm_w_m: 0.4 }).unwrap().0;
    Some((c, rig, truth))
}

#[test]
fn truth_practice_sessions_are_calibrated_within_the_bars() {
    let (mut inside, mut parameters) = (0, 0);
    for kind in ["lab-11", "court-12", "hard-13"] {
        let Some((c, rig, truth)) = practice(kind) else { return };
        let bad: BTreeSet<&str> = truth["calib"]["bad"].as_object().unwrap().keys().map(String::as_str).collect();
        for p in &rig.pairs {
            assert_eq!(p.used, !bad.contains(p.name.as_str()), "{kind} {p:?}");
            assert_eq!(p.used, p.reason.is_empty(), "{kind} {p:?}");
        }
        // Noise-free pixels of the true cameras over the whole volume that both see.
        let cameras = [truth_camera(&truth["cameras"]["left"]), truth_camera(&truth["cameras"]["right"])];
        let triangulator = Triangulator::new(&rig);
        let (mut measured, mut true_points) = (Vec::new(), Vec::new());
        for i in 0..343 {
            let p = Point3::new((i % 7) as f64 / 3.0 - 1.0, 0.1 + (i / 7 % 7) as f64 / 3.0, (i / 49) as f64 / 3.0 - 1.0);
            let uv = [0, 1].map(|k| cameras[k].0.project(&(cameras[k].1 * p)).unwrap());
            if uv.iter().all(|q| q.x >= 0.0 && q.y >= 0.0 && q.x <= 511.0 && q.y <= 511.0) {
                let seen = uv.map(|uv| ImagePoint { uv, sd: Vector2::new(0.1, 0.1) });
                measured.push(triangulator.triangulate(&seen[0], &seen[1]).unwrap().position);
                true_points.push(p);
            }
        }
        let (rms, angle) = aligned(&measured, &true_points);
        eprintln!("{kind}: {} points, {:.3} mm, axes turned by {:.3} mrad", measured.len(), 1e3 * rms, 1e3 * angle);
        assert!(measured.len() > 150 && rms < 0.25e-3, "{kind}: {rms}");
        assert!(angle < 1.5e-3, "{kind}: {angle}");
        for (id, (camera, _)) in CameraId::BOTH.into_iter().zip(&cameras) {
            let ours = rig.camera(id);
            let values = |c: &Camera| [c.fx, c.fy, c.cx, c.cy, c.distortion[0], c.distortion[1], c.distortion[2], c.distortion[3]];
            for ((name, a), b) in ["fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2"].into_iter().zip(values(ours)).zip(values(camera)) {
                if let Some(sd) = ours.sd.get(name) {
                    parameters += 1;
                    inside += usize::from((a - b).abs() < 1.96 * sd);
                    eprintln!("  {} {name} {:+.2} sd", id.name(), (a - b) / sd);
                }
            }
        }
        eprintln!("{kind}: model {:?}, clustering {:.2}", c.model, c.fit.clustering);
    }
    eprintln!("{inside} of {parameters} camera parameters inside their 95 % intervals");
    // Sixteen correlated numbers a session: 95 % of 48 is 45.6; fewer than 42 would have a chance below one in a hundred if
    // they came in independent groups of two.
    assert!(inside >= 42, "{inside} of {parameters}");
}

#[test]
fn law_corners_are_looked_for_by_many_threads_at_a_time() {
    // OpenCV's pool was set anew for every picture, which ended the process when two threads met there.
    let board = Checkerboard { columns: 9, rows: 6, square_m: 0.06 };
    let bare = GreyImage { width: 64, height: 64, pixels: vec![90; 64 * 64] };
    std::thread::scope(|scope| {
        for _ in 0..8 {
            scope.spawn(|| (0..2000).for_each(|_| assert!(matches!(find_corners(&bare, &board), Ok(Err(ViewFault::NotFound))))));
        }
    });
}
