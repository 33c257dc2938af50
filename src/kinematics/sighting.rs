//! What the cameras saw of one body in one window: image points with times, grouped by target and camera.

use crate::calibration::CameraId;
use crate::tracking::{Target, Tracks};
use nalgebra::{DVector, Matrix3, Vector2, Vector3};

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

/// What one target's image error in one camera has in common over a window (tape, string shadow, edge of the disc), one
/// standard deviation: a constant, px, and as the view turns a drift, px/s, that does not stay the same, px/s². All three are
/// marginalised exactly: residuals of a group share the covariance σ² I + τ² 11ᵀ + κ² ttᵀ + γ² t²t²ᵀ, t from the group's mean
/// time. Without the last the bend of a band's path tells an angular velocity that nothing else does: where a racket turned by
/// 0.8 rad, rates were wrong by three deviations.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CommonError {
    pub constant_px: f64,
    pub drift_px_s: f64,
    pub bend_px_s2: f64,
}

impl CommonError {
    /// The three at `t` from the group's mean time, in units of one point's deviation `sd_px`.
    fn at(&self, t: f64, sd_px: f64) -> Vector3<f64> {
        Vector3::new(self.constant_px, self.drift_px_s * t, self.bend_px_s2 * t * t) / sd_px
    }
}

/// Groups of equal target and camera, as ranges of `sightings` (which must be sorted).
fn groups(sightings: &[Sighting]) -> Vec<std::ops::Range<usize>> {
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

/// Divides residuals by the square root of their covariance, group by group and axis by axis.
///
/// With y = r/σ and U = [τ 1/σ, κ t/σ, γ t²/σ], the inverse root of I + U Uᵀ is I − U V diag((1 − 1/√(1+λ))/λ) Vᵀ Uᵀ, where
/// Uᵀ U = V diag(λ) Vᵀ. None of that depends on the residuals: a fit has it computed once.
pub(crate) struct Whitener {
    groups: Vec<Group>,
    points: usize,
}

/// One group and axis.
struct Group {
    range: std::ops::Range<usize>,
    axis: usize,
    /// Rows of U and σ.
    shared: Vec<(Vector3<f64>, f64)>,
    vectors: Matrix3<f64>,
    shrink: Vector3<f64>,
}

impl Whitener {
    pub fn new(sightings: &[Sighting], common: CommonError, scale: f64) -> Self {
        let group = |range: std::ops::Range<usize>, axis: usize| {
            let mean_t = sightings[range.clone()].iter().map(|s| s.t).sum::<f64>() / range.len() as f64;
            let row = |s: &Sighting| (common.at(s.t - mean_t, s.sd[axis] * scale), s.sd[axis] * scale);
            let shared: Vec<(Vector3<f64>, f64)> = sightings[range.clone()].iter().map(row).collect();
            let gram = shared.iter().fold(Matrix3::zeros(), |sum, (u, _)| sum + u * u.transpose());
            let eigen = gram.symmetric_eigen();
            let shrink = eigen.eigenvalues.map(|l| if l > 1e-12 { (1.0 - 1.0 / (1.0 + l).sqrt()) / l } else { 0.5 });
            Group { range, axis, shared, vectors: eigen.eigenvectors, shrink }
        };
        let groups = groups(sightings).into_iter().flat_map(|range| [(range.clone(), 0), (range, 1)]).map(|(range, axis)| group(range, axis)).collect();
        Whitener { groups, points: sightings.len() }
    }

    pub fn whiten(&self, misfit_px: &[Vector2<f64>]) -> DVector<f64> {
        let mut out = DVector::zeros(2 * self.points);
        for g in &self.groups {
            let own = || misfit_px[g.range.clone()].iter().zip(&g.shared);
            let dot: Vector3<f64> = own().fold(Vector3::zeros(), |sum, (misfit, (u, sd))| sum + u * (misfit[g.axis] / sd));
            let take = g.vectors * g.shrink.component_mul(&(g.vectors.transpose() * dot));
            for (i, (misfit, (u, sd))) in g.range.clone().zip(own()) {
                out[2 * i + g.axis] = misfit[g.axis] / sd - u.dot(&take);
            }
        }
        out
    }
}

/// Factor on the deviations for errors that persist from frame to frame: √((1+ρ)/(1−ρ)) with ρ the residuals' correlation
/// between neighbouring frames, each group's mean taken out; at least 1. `whitened` as [`Whitener::whiten`] gives it.
pub(crate) fn persistence(sightings: &[Sighting], whitened: &DVector<f64>) -> f64 {
    let (mut product, mut square, mut pairs, mut points) = (0.0, 0.0, 0, 0);
    for range in groups(sightings).into_iter().filter(|r| r.len() >= 6) {
        for axis in 0..2 {
            let mean = range.clone().map(|i| whitened[2 * i + axis]).sum::<f64>() / range.len() as f64;
            for i in range.clone() {
                let r = whitened[2 * i + axis] - mean;
                square += r * r;
                points += 1;
                if i + 1 < range.end && sightings[i + 1].frame == sightings[i].frame + 1 {
                    product += r * (whitened[2 * (i + 1) + axis] - mean);
                    pairs += 1;
                }
            }
        }
    }
    if pairs < 20 || square <= 0.0 {
        return 1.0;
    }
    let rho = ((product / pairs as f64) / (square / points as f64)).clamp(0.0, 0.8);
    ((1.0 + rho) / (1.0 - rho)).sqrt()
}

/// Size of each sighting's residual (both axes, in its own standard deviations) after its group's common error is taken out.
/// The common error is the group's median, so that one bad point cannot hide itself.
pub(crate) fn deviations(sightings: &[Sighting], misfit_px: &[Vector2<f64>], common: CommonError) -> Vec<f64> {
    let mut out = vec![0.0; sightings.len()];
    for range in groups(sightings) {
        for axis in 0..2 {
            let mut values: Vec<f64> = range.clone().map(|i| misfit_px[i][axis]).collect();
            values.sort_by(f64::total_cmp);
            let shift = values[values.len() / 2].clamp(-3.0 * common.constant_px, 3.0 * common.constant_px);
            for i in range.clone() {
                out[i] += ((misfit_px[i][axis] - shift) / sightings[i].sd[axis]).powi(2);
            }
        }
    }
    out.into_iter().map(f64::sqrt).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn truth_whitening_is_the_inverse_root_of_the_stated_covariance() {
        // Hand calculation for two points, σ = (1, 2), τ = 3: covariance [[1+9, 9], [9, 4+9]].
        let at = |frame, sd| Sighting { frame, t: 0.0, camera: CameraId::Left, target: Target::M1, uv: Vector2::zeros(), sd: Vector2::new(sd, 1.0) };
        let seen = [at(0, 1.0), at(1, 2.0)];
        let r = [Vector2::new(0.7, 0.0), Vector2::new(-1.3, 0.0)];
        let white = Whitener::new(&seen, CommonError { constant_px: 3.0, drift_px_s: 0.0, bend_px_s2: 0.0 }, 1.0).whiten(&r);
        let covariance = nalgebra::Matrix2::new(10.0, 9.0, 9.0, 13.0);
        let v = nalgebra::Vector2::new(0.7, -1.3);
        let expected = v.dot(&(covariance.try_inverse().expect("positive") * v));
        assert!((white.norm_squared() - expected).abs() < 1e-12);
    }
}
