//! What the cameras saw of one body in one window: image points with times, grouped by target and camera.

use super::lasting_error::WindowErrors;
use crate::calibration::CameraId;
use crate::tracking::{Target, Tracks};
use nalgebra::Vector2;

/// One image point of one target. `t` in s from the shot's time origin (a frame number), pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sighting {
    pub frame: u64,
    pub t: f64,
    pub camera: CameraId,
    pub target: Target,
    pub uv: Vector2<f64>,
    pub sd: Vector2<f64>,
}

/// Turns frame numbers into seconds: time = (frame − origin) × period, the middle of the exposure.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrameClock {
    pub origin: u64,
    pub period_s: f64,
}

impl FrameClock {
    pub fn time_s(&self, frame: u64) -> f64 {
        (frame as f64 - self.origin as f64) * self.period_s
    }

    /// Frame number, with its fraction, of a time.
    pub fn frame_at(&self, t: f64) -> f64 {
        self.origin as f64 + t / self.period_s
    }
}

/// The sightings of `targets` with `from ≤ t ≤ to`, sorted by target, camera, frame.
pub fn sightings(tracks: &Tracks, clock: FrameClock, targets: &[Target], from: f64, to: f64) -> Vec<Sighting> {
    let mut seen: Vec<Sighting> = tracks
        .points
        .iter()
        .filter(|p| targets.contains(&p.target))
        .filter_map(|p| {
            let t = clock.time_s(p.frame);
            let point = p.point.filter(|_| (from..=to).contains(&t))?;
            Some(Sighting { frame: p.frame, t, camera: p.camera, target: p.target, uv: point.uv, sd: point.sd })
        })
        .collect();
    seen.sort_by_key(|s| (s.target, s.camera, s.frame));
    seen
}

/// Groups of equal target and camera, as ranges of `sightings` (which must be sorted).
pub(crate) fn groups(sightings: &[Sighting]) -> Vec<std::ops::Range<usize>> {
    let mut ranges = Vec::new();
    let mut start = 0;
    for i in 1..=sightings.len() {
        if i == sightings.len() || (sightings[i].target, sightings[i].camera) != (sightings[start].target, sightings[start].camera) {
            if i > start {
                ranges.push(start..i);
            }
            start = i;
        }
    }
    ranges
}

/// Size of each sighting's residual (both axes, in its own standard deviations) after its group's common error is taken out.
/// The common error is the group's median, so that one bad point cannot hide itself.
pub(crate) fn deviations(sightings: &[Sighting], misfit_px: &[Vector2<f64>], errors: &WindowErrors) -> Vec<f64> {
    let mut out = vec![0.0; sightings.len()];
    for range in groups(sightings) {
        let most = sightings[range.clone()].first().map_or(0.0, |s| 3.0 * errors.of[s.target.index()].size_px());
        for axis in 0..2 {
            let mut values: Vec<f64> = range.clone().map(|i| misfit_px[i][axis]).collect();
            values.sort_by(f64::total_cmp);
            let shift = values[values.len() / 2].clamp(-most, most);
            for i in range.clone() {
                out[i] += ((misfit_px[i][axis] - shift) / sightings[i].sd[axis]).powi(2);
            }
        }
    }
    out.into_iter().map(f64::sqrt).collect()
}
