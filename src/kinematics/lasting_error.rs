//! Image errors that last from frame to frame, and residuals freed of them.
//!
//! A tape band or a ball is seen a little off its place, and nearly as much off in the next frame: light, felt, the tube's
//! far side and what lies behind change only as the view changes. Such an error counts once, however many frames show it, and
//! what of it changes over a window is taken for a velocity.

use super::sighting::{Sighting, groups};
use nalgebra::{DMatrix, DVector, Vector2};
use std::ops::Range;

/// What one target's image error in one camera has in common over a window, one standard deviation per axis: a part that
/// stays, and a part that is forgotten as the view changes. Residuals of one target in one camera share the covariance
/// σ² I + c² 11ᵀ + w² exp(−(Δ/memory)²/2), Δ being by how much the view has changed between two frames: s for the ball, rad for
/// tape.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LastingError {
    pub constant_px: f64,
    pub wander_px: f64,
    pub memory: f64,
}

impl LastingError {
    /// Covariance of the errors in two frames between which the view has changed by so much, px².
    fn shared_px2(&self, change: f64) -> f64 {
        self.constant_px.powi(2) + self.wander_px.powi(2) * (-0.5 * (change / self.memory).powi(2)).exp()
    }

    /// Of one frame, px.
    pub fn size_px(&self) -> f64 {
        self.constant_px.hypot(self.wander_px)
    }
}

/// The lasting errors of one window's sightings.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct WindowErrors {
    /// By target.
    pub of: [LastingError; 6],
    /// How fast the view changes: rad/s of tape; 1, which is seconds, of the ball.
    pub change_per_s: f64,
}

/// Inverse roots of the covariance of every group (target and camera) and axis.
pub(crate) struct Whitener {
    groups: Vec<(Range<usize>, [DMatrix<f64>; 2])>,
}

impl Whitener {
    /// `scale` is the factor on the sightings' own deviations. `None` when a covariance has no root (deviations of zero).
    pub fn new(sightings: &[Sighting], errors: &WindowErrors, scale: f64) -> Option<Self> {
        let root = |range: &Range<usize>, axis: usize| {
            let seen = &sightings[range.clone()];
            let error = errors.of[seen.first()?.target.index()];
            let covariance = DMatrix::from_fn(seen.len(), seen.len(), |i, j| {
                let own = if i == j { (seen[i].sd[axis] * scale).powi(2) } else { 0.0 };
                own + error.shared_px2((seen[i].t - seen[j].t) * errors.change_per_s)
            });
            covariance.cholesky().map(|c| c.unpack())
        };
        let groups = groups(sightings).into_iter().map(|range| {
            let roots = [root(&range, 0)?, root(&range, 1)?];
            Some((range, roots))
        });
        Some(Whitener { groups: groups.collect::<Option<_>>()? })
    }

    /// Residuals divided by the root of their covariance: rows 2i and 2i + 1 belong to sighting i.
    pub fn vector(&self, misfit_px: &[Vector2<f64>]) -> DVector<f64> {
        let mut out = DVector::zeros(2 * misfit_px.len());
        for (range, roots) in &self.groups {
            for (axis, root) in roots.iter().enumerate() {
                let mut own = DVector::from_iterator(range.len(), misfit_px[range.clone()].iter().map(|m| m[axis]));
                root.solve_lower_triangular_mut(&mut own);
                range.clone().zip(own.iter()).for_each(|(i, v)| out[2 * i + axis] = *v);
            }
        }
        out
    }

    /// The same for each column of a matrix whose rows are laid out like that; further rows stay as they are.
    pub fn matrix(&self, rows: &DMatrix<f64>) -> DMatrix<f64> {
        let mut out = rows.clone();
        for (range, roots) in &self.groups {
            for (axis, root) in roots.iter().enumerate() {
                let mut own = DMatrix::from_fn(range.len(), rows.ncols(), |i, j| rows[(2 * (range.start + i) + axis, j)]);
                root.solve_lower_triangular_mut(&mut own);
                for i in range.clone() {
                    out.row_mut(2 * i + axis).copy_from(&own.row(i - range.start));
                }
            }
        }
        out
    }

    /// Logarithm of the determinant of the whole covariance.
    pub fn ln_det(&self) -> f64 {
        self.groups.iter().flat_map(|(_, roots)| roots).map(|root| 2.0 * root.diagonal().map(f64::ln).sum()).sum()
    }
}

/// Factor on the deviations for errors that persist from frame to frame beyond the lasting ones: √((1+ρ)/(1−ρ)) with ρ the
/// residuals' correlation between neighbouring frames, each group's mean taken out; at least 1. `whitened` as
/// [`Whitener::vector`] gives it.
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::CameraId;
    use crate::tracking::Target;

    fn seen(sd: &[f64]) -> Vec<Sighting> {
        let at = |(k, sd): (usize, &f64)| Sighting {
            frame: k as u64,
            t: k as f64,
            camera: CameraId::Left,
            target: Target::M1,
            uv: Vector2::zeros(),
            sd: Vector2::new(*sd, 1.0),
        };
        sd.iter().enumerate().map(at).collect()
    }

    #[test]
    fn truth_whitening_is_the_inverse_root_of_the_stated_covariance() {
        // Hand calculation for two points one memory apart, σ = (1, 2), c = 3, w = 2: shared 9 + 4, and 9 + 4 e^(-1/2) between them.
        let errors = WindowErrors { of: [LastingError { constant_px: 3.0, wander_px: 2.0, memory: 1.0 }; 6], change_per_s: 1.0 };
        let whitener = Whitener::new(&seen(&[1.0, 2.0]), &errors, 1.0).expect("positive");
        let between = 9.0 + 4.0 * (-0.5f64).exp();
        let covariance = nalgebra::Matrix2::new(14.0, between, between, 17.0);
        let v = nalgebra::Vector2::new(0.7, -1.3);
        let expected = v.dot(&(covariance.try_inverse().expect("positive") * v));
        let white = whitener.vector(&[Vector2::new(0.7, 0.0), Vector2::new(-1.3, 0.0)]);
        assert!((white.norm_squared() - expected).abs() < 1e-12);
        let rows = DMatrix::from_column_slice(4, 1, &[0.7, 0.0, -1.3, 0.0]);
        assert!((whitener.matrix(&rows).norm_squared() - expected).abs() < 1e-12);
        // The other axis: σ = 1 twice.
        assert!((whitener.ln_det() - (covariance.determinant() * (14.0 * 14.0 - between * between)).ln()).abs() < 1e-12);
    }

    #[test]
    fn truth_independent_residuals_do_not_persist_and_alike_ones_do() {
        let sightings = seen(&[1.0; 40]);
        let pattern = |period: usize| DVector::from_fn(80, |i, _| if (i / 2 / period).is_multiple_of(2) { 1.0 } else { -1.0 });
        assert_eq!(persistence(&sightings, &pattern(1)), 1.0);
        assert!(persistence(&sightings, &pattern(5)) > 1.5);
    }
}
