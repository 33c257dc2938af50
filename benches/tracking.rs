//! Speed of tracking on a rendered clip read from disk: `cargo bench --bench tracking`. Whole processes and the pipelines it is
//! compared with: `benches/peers/track_opencv_*.py`.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use rayon::prelude::*;
use std::path::Path;
use std::sync::atomic::AtomicBool;
use sweetspot::calibration::{CameraId, RigidTransform, StereoRig};
use sweetspot::footage::{Clip, FrameBuffer, FrameSource, Rows};
use sweetspot::session::Session;
use sweetspot::synthetic::footage_spec::FootageSpec;
use sweetspot::synthetic::footage_world::FootageWorld;
use sweetspot::synthetic::look::Setting;
use sweetspot::tracking::{ShotSetup, Target, track_shot};

fn film(folder: &Path) -> serde_json::Value {
    // 4000 frames a second keep racket and ball in the picture for 300 frames.
    let spec = FootageSpec { boards: 1, frames_before: 140, frames_after: 138, frame_rate_hz: 4000.0, ..FootageSpec::new(Setting::Lab, 1, 77) };
    let sink = |name: &str, bytes: &[u8]| {
        let path = folder.join(name);
        std::fs::create_dir_all(path.parent().unwrap_or(folder))?;
        std::fs::write(path, bytes)
    };
    FootageWorld::new(&spec).expect("valid").film(&sink, &|| (), &AtomicBool::new(false)).expect("filmed")
}

/// The true cameras.
fn rig(truth: &serde_json::Value) -> StereoRig {
    let numbers = |v: &serde_json::Value| -> Vec<f64> { v.as_array().expect("list").iter().filter_map(serde_json::Value::as_f64).collect() };
    let camera = |name: &str| {
        let c = &truth["cameras"][name];
        let k: Vec<Vec<f64>> = c["K"].as_array().expect("K").iter().map(numbers).collect();
        serde_json::json!({"fx": k[0][0], "fy": k[1][1], "cx": k[0][2], "cy": k[1][2], "distortion": c["dist"], "rms_px": 0.1})
    };
    let pose = |name: &str| {
        let c = &truth["cameras"][name];
        let r: Vec<Vec<f64>> = c["R"].as_array().expect("R").iter().map(numbers).collect();
        let t = numbers(&c["t"]);
        RigidTransform { r: [0, 1, 2].map(|i| [r[i][0], r[i][1], r[i][2]]), t: [t[0], t[1], t[2]], sd: Default::default() }.isometry()
    };
    let (left, right) = (pose("left"), pose("right"));
    let between = RigidTransform::from_isometry(&(right * left.inverse()));
    serde_json::from_value(serde_json::json!({
        "image_size": [512, 512], "left": camera("left"), "right": camera("right"), "R": between.r, "T": between.t,
        "rms_stereo_px": 0.1, "global_from_left": RigidTransform::from_isometry(&left.inverse()),
    }))
    .expect("a rig")
}

fn tracking(c: &mut Criterion) {
    let folder = tempfile::tempdir().expect("folder");
    let truth = film(folder.path());
    let rig = rig(&truth);
    let session = Session::open(folder.path()).expect("a session");
    let shot = &session.shots[0];
    let clip = Clip::list(&shot.camera("left"), &shot.camera("right")).expect("pictures");
    let mut group = c.benchmark_group("tracking, two cameras");
    group.sample_size(10);
    group.throughput(Throughput::Elements(clip.pairs.len() as u64));
    for rows in [None, Some(96)] {
        let name = rows.map_or("reading whole pictures, one core".to_owned(), |n| format!("reading {n} rows, one core"));
        group.bench_function(name, |b| {
            let mut buffer = FrameBuffer::default();
            b.iter(|| (0..clip.len()).filter(|i| (0..2).all(|c| clip.read(*i, c, rows.map_or(Rows::ALL, |n| Rows::span(200, n)), &mut buffer).is_ok())).count())
        });
    }
    let setup = ShotSetup { rig: &rig, racket: &shot.racket, ball: &shot.ball, frame_rate_hz: session.frame_rate_hz };
    // What no tracker of these pictures can leave out: the folders listed, every file opened, the rows of its targets read, their
    // pixels summed once.
    let tracks = track_shot(&clip, &setup, &AtomicBool::new(false), &|_| ()).expect("tracked").tracks;
    let centres = |number: u64, camera: CameraId| -> Vec<(f64, f64, f64)> {
        let half = |target: Target| if target == Target::Ball { 12.0 } else { 9.0 };
        Target::ALL.iter().filter_map(|t| Some((tracks.get(number, camera, *t)?.uv, half(*t)))).map(|(uv, half)| (uv.x, uv.y, half)).collect()
    };
    let targets: Vec<[Vec<(f64, f64, f64)>; 2]> = clip.pairs.iter().map(|p| CameraId::BOTH.map(|c| centres(p.number, c))).collect();
    for threads in [1, 2] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        group.bench_function(format!("the floor: rows of the targets, one sum over their pixels, {threads} threads"), |b| {
            b.iter(|| {
                let clip = Clip::list(&shot.camera("left"), &shot.camera("right")).expect("pictures");
                let sum = |buffer: &mut FrameBuffer, index: usize| -> u64 {
                    let of_camera = |camera: usize, buffer: &mut FrameBuffer| -> u64 {
                        let rows = Rows::of(targets[index][camera].iter().map(|(_, v, half)| ((v - half).max(0.0) as usize, (v + half) as usize)));
                        assert!(clip.read(index, camera, rows, buffer).expect("read"));
                        let view = buffer.view().expect("rows");
                        let box_sum = |&(u, v, half): &(f64, f64, f64)| -> u64 {
                            let columns = (u - half).max(0.0) as usize..((u + half) as usize).min(view.width);
                            let rows = (v - half).max(0.0) as usize..(v + half) as usize;
                            rows.filter_map(|y| view.row(y)?.get(columns.clone())).flatten().map(|g| u64::from(*g)).sum()
                        };
                        targets[index][camera].iter().map(box_sum).sum()
                    };
                    of_camera(0, buffer) + of_camera(1, buffer)
                };
                pool.install(|| (0..clip.len()).into_par_iter().map_init(FrameBuffer::default, sum).sum::<u64>())
            })
        });
    }
    for threads in [1, 2] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        group.bench_function(format!("markers and ball, {threads} threads"), |b| {
            b.iter(|| pool.install(|| track_shot(&clip, &setup, &AtomicBool::new(false), &|_| ())).expect("tracked").points.len())
        });
    }
    group.finish();
}

criterion_group!(benches, tracking);
criterion_main!(benches);
