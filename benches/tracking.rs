//! Speed of tracking on a rendered clip read from disk: `cargo bench --bench tracking`. Whole processes and the pipelines it is
//! compared with: `benches/peers/track_opencv_*.py`.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use std::path::Path;
use std::sync::atomic::AtomicBool;
use sweetspot::calibration::{RigidTransform, StereoRig};
use sweetspot::footage::{Clip, FrameBuffer, FrameSource};
use sweetspot::session::Session;
use sweetspot::synthetic::footage_world::{FootageSpec, FootageWorld};
use sweetspot::synthetic::look::Setting;
use sweetspot::tracking::{ShotSetup, track_shot};

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
    for rows in [None, Some((200, 96))] {
        let name = rows.map_or("reading whole pictures, one core".to_owned(), |(_, n)| format!("reading {n} rows, one core"));
        group.bench_function(name, |b| {
            let mut buffer = FrameBuffer::default();
            b.iter(|| (0..clip.len()).filter(|i| (0..2).all(|c| clip.read(*i, c, rows, &mut buffer).is_ok())).count())
        });
    }
    let setup = ShotSetup { rig: &rig, racket: &shot.racket, ball: &shot.ball, frame_rate_hz: session.frame_rate_hz };
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
