//! Speed of the calibration of 40 pairs of 512 x 512 pictures, choice of distortion terms, covariance and held-out boards
//! included: `cargo bench --bench calibration`. The same files by OpenCV in Python, in the same run and with the ratio:
//! `python3 benches/peers/calibrate_opencv.py SESSION --sweetspot target/release/sweetspot`.

use criterion::{Criterion, criterion_group, criterion_main};
use std::collections::BTreeMap;
use std::hint::black_box;
use std::sync::Mutex;
use std::sync::atomic::AtomicBool;
use sweetspot::calibration::{CalibrationOptions, Checkerboard, PairImages, calibrate_images, find_corners};
use sweetspot::footage::read_grey;
use sweetspot::synthetic::footage_spec::FootageSpec;
use sweetspot::synthetic::footage_world::FootageWorld;
use sweetspot::synthetic::look::Setting;

/// The checkerboard pictures of a rendered session.
fn pairs(boards: usize) -> Vec<PairImages> {
    let spec = FootageSpec { boards, ..FootageSpec::new(Setting::Lab, 1, 5) };
    let folder = tempfile::tempdir().expect("a folder");
    let files = Mutex::new(BTreeMap::new());
    let sink = |name: &str, bytes: &[u8]| {
        if let Some(place) = name.strip_prefix("calib/") {
            let path = folder.path().join(place.replace('/', "-"));
            std::fs::write(&path, bytes)?;
            files.lock().expect("no panic").insert(place.to_owned(), path);
        }
        Ok(())
    };
    FootageWorld::new(&spec).and_then(|w| w.film(&sink, &|| (), &AtomicBool::new(false))).expect("rendered");
    let files = files.into_inner().expect("no panic");
    let picture = |side: &str, n: &str| files.get(&format!("{side}/{n}")).map(|p| read_grey(p).expect("readable"));
    let mut names: Vec<&str> = files.keys().filter_map(|k| k.rsplit('/').next()).collect();
    names.sort_unstable();
    names.dedup();
    names.into_iter().map(|n| PairImages { name: n.to_owned(), left: picture("left", n), right: picture("right", n) }).collect()
}

fn calibration(c: &mut Criterion) {
    let board = Checkerboard { columns: 9, rows: 6, square_m: 0.06 };
    let pairs = pairs(40);
    let mut group = c.benchmark_group("calibration");
    group.sample_size(10);
    let one = pairs.iter().find_map(|p| p.left.as_ref()).expect("a picture");
    group.bench_function("corners of one picture", |b| b.iter(|| find_corners(black_box(one), &board)));
    group.bench_function("40 pairs of 512 x 512", |b| {
        b.iter(|| calibrate_images(&board, black_box(&pairs), &CalibrationOptions::default()).expect("calibrated").verdict())
    });
    group.finish();
}

criterion_group!(benches, calibration);
criterion_main!(benches);
