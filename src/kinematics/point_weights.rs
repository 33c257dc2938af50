//! How much each image point of a window counts: outliers dropped, deviations scaled to what the residuals say.

use super::sighting::{Sighting, groups};
use nalgebra::DVector;

/// Deviations (in scaled standard deviations over both axes) beyond which a point is an outlier. Among 500 good points
/// one is beyond 4.2 in every ten shots (Rayleigh).
const OUTLIER: f64 = 4.2;

/// Drops points whose deviation stands out from the others (scaled by their median); `false` when none does.
pub(crate) fn drop_outliers(seen: &mut Vec<Sighting>, deviations: &[f64]) -> bool {
    let mut sorted = deviations.to_vec();
    sorted.sort_by(f64::total_cmp);
    // The median length of a two-dimensional Gaussian deviation is √(2 ln 2) = 1.177.
    let scale = (sorted.get(sorted.len() / 2).copied().unwrap_or(0.0) / 1.177).max(0.3);
    let keep: Vec<bool> = deviations.iter().map(|d| *d <= OUTLIER * scale).collect();
    let before = seen.len();
    let mut i = 0;
    seen.retain(|_| {
        i += 1;
        keep[i - 1]
    });
    seen.len() < before
}

/// Scales the deviations of each target in each camera by how its residuals stand against those of the others: at rest and in good
/// light one band is seen ten times as well as its neighbour in the shade, whatever the tracks state.
pub(crate) fn weigh_groups(seen: &mut [Sighting], whitened: Option<&DVector<f64>>) {
    /// Residuals that a group's own word is drawn toward the others' by.
    const OTHERS: f64 = 10.0;
    let Some(white) = whitened.filter(|w| w.iter().all(|v| v.is_finite())) else { return };
    let mean = white.norm_squared() / white.len().max(1) as f64;
    if mean <= 0.0 {
        return;
    }
    for range in groups(seen) {
        let n = 2 * range.len();
        let own = white.rows(2 * range.start, n).norm_squared() / mean;
        let factor = ((own + OTHERS) / (n as f64 + OTHERS)).sqrt();
        seen[range].iter_mut().for_each(|s| s.sd *= factor);
    }
}

/// Factor on the stated deviations that makes χ² per degree of freedom one, drawn toward 1 by four degrees of freedom.
pub(crate) fn noise_scale(chi2: f64, residuals: usize, parameters: usize) -> f64 {
    const OWN_WORD: f64 = 4.0;
    let freedom = residuals.saturating_sub(parameters) as f64;
    ((chi2 + OWN_WORD) / (freedom + OWN_WORD)).sqrt().max(0.05)
}

/// Longest time between a sighting and the reference time, s.
pub(crate) fn reach(seen: &[Sighting], reference_t: f64) -> f64 {
    seen.iter().map(|s| (s.t - reference_t).abs()).fold(0.0, f64::max)
}

pub(crate) fn frames_in(seen: &[Sighting]) -> usize {
    let mut frames: Vec<u64> = seen.iter().map(|s| s.frame).collect();
    frames.sort_unstable();
    frames.dedup();
    frames.len()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::CameraId;
    use crate::tracking::Target;
    use nalgebra::Vector2;

    fn seen(target: Target) -> impl Iterator<Item = Sighting> {
        (0..20u64).map(move |frame| Sighting { frame, t: 0.0, camera: CameraId::Left, target, uv: Vector2::zeros(), sd: Vector2::new(0.1, 0.2) })
    }

    #[test]
    fn truth_a_band_seen_better_than_stated_counts_more_than_its_neighbour() {
        let mut all: Vec<Sighting> = seen(Target::M1).chain(seen(Target::M2)).collect();
        // Residuals of 0.2 and 1.4 stated deviations: their mean square is 1.
        let white = DVector::from_fn(80, |i, _| if i < 40 { 0.2 } else { 1.4 });
        weigh_groups(&mut all, Some(&white));
        let expected = |own: f64| ((40.0 * own * own + 10.0) / 50.0f64).sqrt();
        assert!((all[0].sd.x - 0.1 * expected(0.2)).abs() < 1e-12 && (all[0].sd.y - 0.2 * expected(0.2)).abs() < 1e-12);
        assert!((all[39].sd.x - 0.1 * expected(1.4)).abs() < 1e-12);
        let before = all.clone();
        weigh_groups(&mut all, Some(&DVector::from_element(80, f64::NAN)));
        weigh_groups(&mut all, None);
        assert_eq!(all, before, "residuals that do not exist weigh nothing");
    }

    #[test]
    fn truth_one_point_far_off_is_dropped_and_no_other() {
        let mut all: Vec<Sighting> = seen(Target::M1).collect();
        let deviations: Vec<f64> = (0..20).map(|k| if k == 7 { 9.0 } else { 1.0 + 0.05 * f64::from(k) }).collect();
        assert!(drop_outliers(&mut all, &deviations));
        assert!(all.len() == 19 && all.iter().all(|s| s.frame != 7));
    }
}
