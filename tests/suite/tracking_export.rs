//! Exports read back by programs that are not ours: numpy for DLTdv's tables, the `c3d` package for C3D.

use crate::shared::shared;
use crate::tracking::true_rig;
use nalgebra::{Point3, Vector2, Vector3};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::Command;
use sweetspot::calibration::{CameraId, StereoRig, dltdv_csv};
use sweetspot::tracking::{ImagePoint, PointState, SpacePoint, Target, TrackExport, TrackPoint, Tracks, c3d_bytes, dltdv_tables};

/// The Python that scripts/setup.sh prepares; `None` outside CI when it is missing.
fn python() -> Option<PathBuf> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(".venv/bin/python");
    let ready = Command::new(&path).args(["-c", "import c3d, numpy"]).output().is_ok_and(|o| o.status.success());
    if ready {
        return Some(path);
    }
    assert!(std::env::var_os("CI").is_none(), "{} cannot import c3d and numpy, and CI must: run scripts/setup.sh test", path.display());
    eprintln!("left out: {} cannot import c3d and numpy (scripts/setup.sh test)", path.display());
    None
}

fn run(python: &Path, script: &str, file: &Path) -> Value {
    let out = Command::new(python).args(["-W", "ignore", "-c", script]).arg(file).output().unwrap();
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    serde_json::from_slice(&out.stdout).unwrap()
}

fn rig() -> Option<StereoRig> {
    let text = std::fs::read_to_string(shared("practice/footage/lab-11.truth.json")?).unwrap();
    Some(true_rig(&serde_json::from_str(&text).unwrap()))
}

/// Frames 340 to 343; 342 is a gap; m3 is hidden in frame 341, but the pose tells its place; the ball has only its left
/// point in frame 343 and no place in space.
fn shot() -> (Tracks, Vec<SpacePoint>) {
    let (mut tracks, mut points) = (Tracks::default(), Vec::new());
    for frame in [340u64, 341, 343] {
        for camera in CameraId::BOTH {
            for target in Target::ALL {
                let k = target.index() as f64;
                let uv = Vector2::new(100.25 + 10.0 * k + camera.index() as f64, 200.5 + k + (frame - 340) as f64);
                let hidden = target == Target::M3 && frame == 341 || target == Target::Ball && frame == 343 && camera == CameraId::Right;
                let point = (!hidden).then_some(ImagePoint { uv, sd: Vector2::new(0.1, 0.1) });
                tracks.points.push(TrackPoint { frame, camera, target, point, state: if hidden { PointState::Occluded } else { PointState::Measured } });
            }
        }
        for target in Target::ALL {
            if target == Target::Ball && frame == 343 {
                continue;
            }
            let k = target.index() as f64;
            let position = Point3::new(0.1 * k, 1.0 + 0.001 * (frame - 340) as f64, -0.05 * k);
            points.push(SpacePoint { frame, t: (frame as f64 - 341.25) / 1000.0, target, position, sd: Vector3::repeat(1e-4), residual_px: 0.02 * (k + 1.0) });
        }
    }
    (tracks, points)
}

const READ_C3D: &str = r#"
import c3d, json, sys
with open(sys.argv[1], "rb") as f:
    r = c3d.Reader(f)
    print(json.dumps({
        "rate": float(r.point_rate), "first": int(r.first_frame), "last": int(r.last_frame), "used": int(r.point_used),
        "labels": [l.strip() for l in r.point_labels], "units": r.get("POINT:UNITS").bytes.decode().strip(),
        "zero": float(r.get("SWEETSPOT:TIME_ZERO_FRAME").float_value),
        "frames": [[int(i), p.tolist()] for i, p, a in r.read_frames()],
    }))
"#;

#[test]
fn agrees_c3d_as_an_independent_reader_sees_it() {
    let (Some(python), Some(rig)) = (python(), rig()) else { return };
    let (tracks, points) = shot();
    let export = TrackExport { tracks: &tracks, points: &points, rig: &rig, frame_rate_hz: 1000.0, frames: 340..=343 };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("points.c3d");
    std::fs::write(&path, c3d_bytes(&export).unwrap()).unwrap();
    let read = run(&python, READ_C3D, &path);
    assert_eq!((read["rate"].as_f64(), read["first"].as_u64(), read["last"].as_u64(), read["used"].as_u64()), (Some(1000.0), Some(340), Some(343), Some(6)));
    assert_eq!(read["labels"], serde_json::json!(["m1", "m2", "m3", "m4", "m5", "ball"]));
    assert_eq!((read["units"].as_str(), read["zero"].as_f64()), (Some("m"), Some(341.25)));
    let frames = read["frames"].as_array().unwrap();
    assert_eq!(frames.iter().map(|f| f[0].as_u64().unwrap()).collect::<Vec<_>>(), [340, 341, 342, 343]);
    let mut checked = 0;
    for frame in frames {
        for target in Target::ALL {
            // x, y, z, residual, cameras (a bit each).
            let seen: Vec<f64> = frame[1][target.index()].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect();
            let number = frame[0].as_u64().unwrap();
            let Some(p) = points.iter().find(|p| p.frame == number && p.target == target) else {
                assert_eq!(seen[3], -1.0, "{number} {target:?} has no place, so no residual");
                continue;
            };
            let place = Vector3::new(seen[0], seen[1], seen[2]);
            assert!((place - p.position.coords).norm() < 1e-6, "{number} {target:?}: {place}");
            // The residual is the two views' disagreement at the point's place, in steps of 1/255 of the largest.
            let px_per_m = CameraId::BOTH.iter().map(|c| rig.camera(*c).fx / (rig.camera_from_global(*c) * p.position).z / 2.0).sum::<f64>();
            assert!((seen[3] - p.residual_px / px_per_m).abs() < 0.6 * 0.12 / px_per_m / 255.0 * 1.5, "{number} {target:?}: {}", seen[3]);
            let cameras: u32 = CameraId::BOTH.iter().filter(|c| tracks.get(number, **c, target).is_some()).map(|c| 1 << c.index()).sum();
            assert_eq!(seen[4], f64::from(cameras));
            checked += 1;
        }
    }
    assert_eq!(checked, 17);
}

const READ_TABLE: &str = r#"
import json, numpy, sys
t = numpy.genfromtxt(sys.argv[1], delimiter=",", names=True)
print(json.dumps({"names": list(t.dtype.names), "rows": [[None if numpy.isnan(v) else float(v) for v in row] for row in t]}))
"#;

#[test]
fn agrees_dltdv_tables_as_numpy_sees_them() {
    let (Some(python), Some(rig)) = (python(), rig()) else { return };
    let (tracks, points) = shot();
    let export = TrackExport { tracks: &tracks, points: &points, rig: &rig, frame_rate_hz: 1000.0, frames: 340..=343 };
    let folder = tempfile::tempdir().unwrap();
    let mut read = std::collections::BTreeMap::new();
    for (name, text) in dltdv_tables(&export).unwrap() {
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        read.insert(name, run(&python, READ_TABLE, &path));
    }
    let cell = |table: &str, row: usize, name: &str| {
        let t = &read[table];
        let column = t["names"].as_array().unwrap().iter().position(|n| n == name).unwrap_or_else(|| panic!("{table} has no {name}"));
        assert_eq!(t["rows"].as_array().unwrap().len(), 4, "{table}: a row per frame, the gap too");
        t["rows"][row][column].as_f64()
    };
    for (row, frame) in [(0usize, 340u64), (1, 341), (3, 343)] {
        for target in Target::ALL {
            let k = target.index() + 1;
            for camera in CameraId::BOTH {
                let point = tracks.get(frame, camera, target);
                // Counted from one in the upper left corner.
                let (x, y) = (point.map(|p| p.uv.x + 1.0), point.map(|p| p.uv.y + 1.0));
                assert_eq!(cell("xypts.csv", row, &format!("pt{k}_cam{}_X", camera.index() + 1)), x);
                assert_eq!(cell("xypts.csv", row, &format!("pt{k}_cam{}_Y", camera.index() + 1)), y);
            }
            let space = points.iter().find(|p| p.frame == frame && p.target == target);
            for (axis, name) in ["X", "Y", "Z"].iter().enumerate() {
                let seen = cell("xyzpts.csv", row, &format!("pt{k}_{name}"));
                assert_eq!(seen.is_some(), space.is_some());
                if let (Some(a), Some(b)) = (seen, space) {
                    assert!((a - b.position[axis]).abs() < 1e-7);
                }
            }
            assert_eq!(cell("xyzres.csv", row, &format!("pt{k}_dltres")).is_some(), space.is_some());
        }
    }
    assert!((1..=6).all(|k| cell("xypts.csv", 2, &format!("pt{k}_cam1_X")).is_none()), "frame 342 is a gap");
    assert_eq!(cell("offsets.csv", 2, "cam2_offset"), Some(0.0));
}

const RECONSTRUCT: &str = r#"
import json, numpy, os, sys
xy, c = numpy.genfromtxt(sys.argv[1], delimiter=",", names=True), numpy.loadtxt(os.path.join(os.path.dirname(sys.argv[1]), "dlt-coefficients.csv"), delimiter=",")
out = []
for row in numpy.atleast_1d(xy):
    a, b = [], []
    for k in range(2):
        l = c[:, k]
        for value, first in ((row[f"pt6_cam{k + 1}_X"], 0), (row[f"pt6_cam{k + 1}_Y"], 4)):
            a.append([l[first + i] - value * l[8 + i] for i in range(3)])
            b.append(value - l[first + 3])
    out.append(numpy.linalg.lstsq(numpy.array(a), numpy.array(b), rcond=None)[0].tolist())
print(json.dumps(out))
"#;

/// The direct linear transform of the written coefficients, solved by numpy for the written pixels, gives the points in space.
#[test]
fn agrees_dltdv_pixels_and_coefficients() {
    let (Some(python), Some(mut rig)) = (python(), rig()) else { return };
    // The coefficients belong to pixels without distortion.
    (rig.left.distortion, rig.right.distortion) = ([0.0; 5], [0.0; 5]);
    let places = [Point3::new(0.1, 1.0, -0.2), Point3::new(-0.3, 0.6, 0.4), Point3::new(0.5, 1.4, 0.1)];
    let (mut tracks, mut points) = (Tracks::default(), Vec::new());
    for (frame, position) in (1u64..).zip(places) {
        for camera in CameraId::BOTH {
            let uv = rig.camera(camera).project(&(rig.camera_from_global(camera) * position)).unwrap();
            let point = Some(ImagePoint { uv, sd: Vector2::new(0.1, 0.1) });
            tracks.points.push(TrackPoint { frame, camera, target: Target::Ball, point, state: PointState::Measured });
        }
        points.push(SpacePoint { frame, t: 0.001 * frame as f64, target: Target::Ball, position, sd: Vector3::repeat(1e-4), residual_px: 0.0 });
    }
    let export = TrackExport { tracks: &tracks, points: &points, rig: &rig, frame_rate_hz: 1000.0, frames: 1..=3 };
    let folder = tempfile::tempdir().unwrap();
    let [(name, xypts), ..] = dltdv_tables(&export).unwrap();
    std::fs::write(folder.path().join(name), xypts).unwrap();
    std::fs::write(folder.path().join("dlt-coefficients.csv"), dltdv_csv(&rig).unwrap()).unwrap();
    let read = run(&python, RECONSTRUCT, &folder.path().join(name));
    for (row, place) in read.as_array().unwrap().iter().zip(places) {
        let seen = Point3::from(Vector3::from_fn(|i, _| row[i].as_f64().unwrap()));
        // Pixels are written to 0.0001.
        assert!((seen - place).norm() < 1e-5, "{seen} for {place}");
    }
}
