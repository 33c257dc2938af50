//! Rackets, balls and impacts for the tests of the impact model.

use nalgebra::{Vector2, Vector3};
use rand::{Rng, SeedableRng};
use sweetspot::equipment::{Ball, Head, Racket, Strings};
use sweetspot::impact::ImpactInput;

pub fn racket() -> Racket {
    Racket {
        name: "test".into(),
        mass_kg: 0.34,
        length_m: 0.685,
        balance_m: 0.33,
        stringbed_centre_m: 0.4975,
        swingweight_kgm2: 0.0325,
        twistweight_kgm2: 0.0015,
        spinweight_kgm2: None,
        head: Head { inner_length_m: 0.335, inner_width_m: 0.255, tube_radius_m: 0.01 },
        strings: Strings { tension_lb: 60.0 },
        markers: None,
    }
}

pub fn ball() -> Ball {
    Ball { name: "test".into(), mass_kg: 0.0577, diameter_m: 0.066, inertia_factor: 2.0 / 3.0 }
}

/// Seeded impacts over the range of lab and court: either side, on and off the face's axes, heavy spin, moving racket.
pub fn impacts(n: usize, seed: u64) -> Vec<ImpactInput> {
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
    let mut v = |x: f64, y: f64, z: f64| Vector3::new(rng.random_range(-x..x), rng.random_range(-y..y), rng.random_range(-z..z));
    (0..n)
        .map(|i| {
            let side = if i % 3 == 0 { -1.0 } else { 1.0 };
            let mut ball_velocity = v(12.0, 15.0, 12.0);
            ball_velocity.z = -side * (22.0 + ball_velocity.z);
            let place = v(0.14, 0.09, 1.0);
            let torque = v(10.0, 1.0, 1.0).x.abs();
            ImpactInput {
                ball_velocity,
                ball_spin: v(300.0, 300.0, 100.0),
                racket_velocity: v(4.0, 4.0, 4.0) + Vector3::new(0.0, 0.0, side * 5.0),
                racket_rate: v(10.0, 30.0, 15.0),
                position: Vector2::new(place.x, place.y),
                grip_torque: torque,
                order: i as f64,
                own: Default::default(),
            }
        })
        .collect()
}
