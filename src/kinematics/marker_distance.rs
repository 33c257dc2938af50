//! Distances between markers as the footage shows them against those of racket.toml (thesis 5.3.4: its check of accuracy).

use crate::tracking::{RacketFigure, SpacePoint, Target};
use nalgebra::Point3;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// One pair of markers. Lengths in mm.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MarkerDistance {
    pub pair: (Target, Target),
    /// From racket.toml.
    pub stated_mm: f64,
    /// Mean over the frames that show both, its standard error, and their number.
    pub seen_mm: f64,
    pub seen_sd_mm: f64,
    pub frames: usize,
    pub mismatch_mm: f64,
}

/// Every pair seen in at least three frames.
pub fn marker_distances(points: &[SpacePoint], figure: &RacketFigure) -> Vec<MarkerDistance> {
    let mut frames: BTreeMap<u64, BTreeMap<Target, Point3<f64>>> = BTreeMap::new();
    for p in points.iter().filter(|p| p.target != Target::Ball) {
        frames.entry(p.frame).or_default().insert(p.target, p.position);
    }
    let mut out = Vec::new();
    for (i, a) in Target::MARKERS.into_iter().enumerate() {
        for b in Target::MARKERS.into_iter().skip(i + 1) {
            let seen: Vec<f64> = frames.values().filter_map(|f| Some(1e3 * (f.get(&a)? - f.get(&b)?).norm())).collect();
            let n = seen.len() as f64;
            if seen.len() < 3 {
                continue;
            }
            let mean = seen.iter().sum::<f64>() / n;
            let sd = (seen.iter().map(|d| (d - mean).powi(2)).sum::<f64>() / (n - 1.0)).sqrt();
            let stated = 1e3 * figure.distance_m(a.index(), b.index());
            out.push(MarkerDistance {
                pair: (a, b),
                stated_mm: stated,
                seen_mm: mean,
                seen_sd_mm: sd / n.sqrt(),
                frames: seen.len(),
                mismatch_mm: mean - stated,
            });
        }
    }
    out
}

/// Mismatch beyond which racket.toml is doubted, mm: the thesis's own accuracy of a marker.
const DOUBTFUL_MM: f64 = 2.5;

/// A sentence naming the worst pair when it cannot be the points' own error.
pub(crate) fn mismatch_remark(distances: &[MarkerDistance]) -> Option<String> {
    let worst = distances.iter().max_by(|a, b| a.mismatch_mm.abs().total_cmp(&b.mismatch_mm.abs()))?;
    (worst.mismatch_mm.abs() > DOUBTFUL_MM + 3.0 * worst.seen_sd_mm).then(|| {
        format!(
            "markers {} and {} are {:.1} mm apart in the footage and {:.1} mm in racket.toml (mismatch {:+.1} mm): measure the markers again",
            worst.pair.0.name(),
            worst.pair.1.name(),
            worst.seen_mm,
            worst.stated_mm,
            worst.mismatch_mm
        )
    })
}
