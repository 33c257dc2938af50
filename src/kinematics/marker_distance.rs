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

/// Mismatch beyond which racket.toml is doubted, mm: of 213 rendered shots with a right one the worst pair is 0.9 off.
const DOUBTFUL_MM: f64 = 1.5;

/// A sentence about racket.toml when what it says cannot be the points' own error: it names the marker without which the others are as far
/// apart as stated, and the pair that is worst.
pub fn mismatch_remark(distances: &[MarkerDistance]) -> Option<String> {
    let size = |d: &MarkerDistance| d.mismatch_mm.abs();
    let worst_of = |without: Option<Target>| {
        let others = distances.iter().filter(move |d| without.is_none_or(|t| d.pair.0 != t && d.pair.1 != t));
        others.max_by(|a, b| size(a).total_cmp(&size(b)))
    };
    let worst = worst_of(None).filter(|w| size(w) > DOUBTFUL_MM + 3.0 * w.seen_sd_mm)?;
    let left_mm = |t: &Target| worst_of(Some(*t)).map_or(f64::INFINITY, size);
    let wrong = Target::MARKERS.into_iter().min_by(|a, b| left_mm(a).total_cmp(&left_mm(b))).filter(|t| left_mm(t) < DOUBTFUL_MM);
    let what = match wrong {
        Some(marker) => format!("racket.toml puts {} elsewhere than the footage does; measure it again", marker.name()),
        None => "racket.toml puts several markers elsewhere than the footage does; measure them again, and calibrate on boards of this session".to_owned(),
    };
    let (a, b) = (worst.pair.0.name(), worst.pair.1.name());
    Some(format!(
        "{what} ({a} and {b} are {:.1} mm apart in the footage, {:.1} mm in racket.toml: {:+.1} mm)",
        worst.seen_mm, worst.stated_mm, worst.mismatch_mm
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// All pairs of five places, seen where `seen` has them.
    fn distances(stated: &[[f64; 2]; 5], seen: &[[f64; 2]; 5]) -> Vec<MarkerDistance> {
        let apart = |p: &[[f64; 2]; 5], i: usize, j: usize| (p[i][0] - p[j][0]).hypot(p[i][1] - p[j][1]);
        let pairs = (0..5).flat_map(|i| (i + 1..5).map(move |j| (i, j)));
        pairs
            .map(|(i, j)| MarkerDistance {
                pair: (Target::MARKERS[i], Target::MARKERS[j]),
                stated_mm: apart(stated, i, j),
                seen_mm: apart(seen, i, j),
                seen_sd_mm: 0.1,
                frames: 40,
                mismatch_mm: apart(seen, i, j) - apart(stated, i, j),
            })
            .collect()
    }

    #[test]
    fn law_the_marker_that_was_measured_wrongly_is_named() {
        let real = [[170.0, 0.0], [0.0, 130.0], [0.0, -130.0], [-200.0, 50.0], [-200.0, -50.0]];
        let moved = |marker: usize, by: [f64; 2]| {
            let mut stated = real;
            stated[marker] = [real[marker][0] + by[0], real[marker][1] + by[1]];
            stated
        };
        assert_eq!(mismatch_remark(&distances(&moved(1, [0.5, 0.5]), &real)), None);
        for marker in 0..5 {
            for by in [[3.0, 0.0], [0.0, 3.5], [-3.0, 1.0]] {
                let said = mismatch_remark(&distances(&moved(marker, by), &real)).unwrap_or_default();
                assert!(said.contains(&format!("puts {} elsewhere", Target::MARKERS[marker].name())), "{marker} {by:?}: {said}");
            }
        }
        // A scale is no single marker's.
        let larger = real.map(|p| p.map(|x| 1.02 * x));
        assert!(mismatch_remark(&distances(&larger, &real)).is_some_and(|said| said.contains("several markers")));
    }
}
