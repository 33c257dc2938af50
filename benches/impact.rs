//! Speed of the impact model on one core: `cargo bench --bench impact`. Compare with `benches/peers/impact_scipy.py`.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use nalgebra::{Vector2, Vector3};
use std::hint::black_box;
use std::path::Path;
use sweetspot::equipment::{Ball, Head, Racket, Strings};
use sweetspot::impact::{ImpactInput, Model};

fn equipment() -> (Racket, Ball) {
    let racket = Racket {
        name: "reference".into(),
        mass_kg: 0.33,
        length_m: 0.685,
        balance_m: 0.325,
        stringbed_centre_m: 0.51,
        swingweight_kgm2: 0.0158 + 0.33 * 0.225 * 0.225,
        twistweight_kgm2: 0.0015,
        spinweight_kgm2: Some(0.0173 + 0.33 * 0.225 * 0.225),
        head: Head { inner_length_m: 0.33, inner_width_m: 0.24, tube_radius_m: 0.01 },
        strings: Strings { tension_lb: 60.0 },
        markers: None,
    };
    (racket, Ball { name: "reference".into(), mass_kg: 0.0577, diameter_m: 0.066, inertia_factor: 0.55 })
}

/// The same oblique impacts as the script in `peers`.
fn inputs(n: usize) -> Vec<ImpactInput> {
    (0..n)
        .map(|i| ImpactInput {
            ball_velocity: Vector3::new(1.0, 0.5 * (i % 40) as f64, -28.0),
            ball_spin: Vector3::new(100.0, -50.0, 20.0),
            racket_velocity: Vector3::new(-1.0, 2.0, 4.0),
            racket_rate: Vector3::new(2.0, 25.0, -5.0),
            position: Vector2::new(-0.015, 0.03),
            grip_torque: 0.0,
            order: i as f64,
            own: Default::default(),
        })
        .collect()
}

fn impact(c: &mut Criterion) {
    let (racket, ball) = equipment();
    let one_core = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread");
    let model = |text: &str| Model::parse(text, Path::new("bench")).expect("valid").prepare(&racket, &ball).expect("valid");
    let mut group = c.benchmark_group("impact, one core");
    let rigid = model("base = \"rigid\"");
    let many = inputs(10_000);
    group.throughput(Throughput::Elements(many.len() as u64));
    group.bench_function("rigid", |b| b.iter(|| many.iter().filter(|i| rigid.predict(black_box(i)).is_ok()).count()));
    let elastic = model("base = \"viscoelastic\"");
    let some = inputs(1024);
    group.throughput(Throughput::Elements(some.len() as u64));
    group.sample_size(10);
    group.bench_function("viscoelastic", |b| b.iter(|| one_core.install(|| elastic.predict_all(black_box(&some)))));
    let ringing = model("base = \"viscoelastic\"\n[effects.frame-vibration]");
    group.bench_function("viscoelastic with frame-vibration", |b| b.iter(|| one_core.install(|| ringing.predict_all(black_box(&some)))));
    group.finish();
}

criterion_group!(benches, impact);
criterion_main!(benches);
