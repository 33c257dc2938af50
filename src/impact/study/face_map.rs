//! The outcome over the face, and what scatter of the impact position does to it.

use super::shot::{Launch, Shot};
use crate::impact::PreparedModel;
use crate::impact::error::ModelError;
use nalgebra::Vector2;
use rand::SeedableRng;
use rand_distr::{Distribution, Normal};

/// Launches of the same swing at many places of the face.
///
/// # Errors
/// As [`PreparedModel::predict`], for any of the places.
pub fn over_face(model: &PreparedModel, shot: &Shot, places: &[Vector2<f64>]) -> Result<Vec<Launch>, ModelError> {
    places.iter().map(|p| Shot { position: *p, ..*shot }.launch(model)).collect()
}

/// Mean and scatter of the launch.
#[derive(Debug, Clone, Copy, serde::Serialize)]
pub struct Scatter {
    /// Standard deviation of the impact position along and across, m.
    pub position_sd_m: (f64, f64),
    pub n: usize,
    pub mean_speed: f64,
    pub sd_speed: f64,
    pub sd_launch_angle_rad: f64,
    pub sd_side_angle_rad: f64,
    pub sd_spin_rad_s: f64,
}

/// Scatter of the impact position into scatter of the launch, by Monte Carlo; the same for the same seed.
///
/// Impacts that miss the strings (more than half their length or width from the centre) count as misses, not as shots.
///
/// # Errors
/// As [`PreparedModel::predict`].
pub fn scatter(model: &PreparedModel, shot: &Shot, sd: (f64, f64), n: usize, seed: u64) -> Result<Scatter, ModelError> {
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
    let body = model.body();
    let unit = Normal::new(0.0, 1.0).map_err(|_| ModelError::NotFinite)?;
    let mut launches = Vec::with_capacity(n);
    for _ in 0..n {
        let p = shot.position + Vector2::new(sd.0 * unit.sample(&mut rng), sd.1 * unit.sample(&mut rng));
        if (p.x / body.half_length).powi(2) + (p.y / body.half_width).powi(2) < 1.0 {
            launches.push(Shot { position: p, ..*shot }.launch(model)?);
        }
    }
    let moments = |get: fn(&Launch) -> f64| {
        let count = launches.len().max(1) as f64;
        let mean = launches.iter().map(get).sum::<f64>() / count;
        (mean, (launches.iter().map(|l| (get(l) - mean).powi(2)).sum::<f64>() / count).sqrt())
    };
    let (mean_speed, sd_speed) = moments(|l| l.speed);
    Ok(Scatter {
        position_sd_m: sd,
        n: launches.len(),
        mean_speed,
        sd_speed,
        sd_launch_angle_rad: moments(|l| l.launch_angle_rad).1,
        sd_side_angle_rad: moments(|l| l.side_angle_rad).1,
        sd_spin_rad_s: moments(|l| l.spin_rad_s).1,
    })
}
