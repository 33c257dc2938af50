//! A smooth through scattered residuals with its 95 % band, and means over the racket's face.

use serde::{Deserialize, Serialize};

/// A local-linear smooth of y against x.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct SmoothCurve {
    pub x: Vec<f64>,
    pub mean: Vec<f64>,
    /// 95 % band of the mean.
    pub low: Vec<f64>,
    pub high: Vec<f64>,
}

/// Local-linear regression with a Gaussian kernel at `count` points between the 2nd and 98th percentile of x.
///
/// The kernel's deviation is 0.7 of x's robust deviation times (n/100)^(-1/5): narrow enough to show a node line across
/// the face. The band uses the local residual variance. `None` with fewer than ten points or no spread in x.
pub fn smooth(points: &[(f64, f64)], count: usize) -> Option<SmoothCurve> {
    let n = points.len();
    if n < 10 || count < 2 {
        return None;
    }
    let mut sorted: Vec<f64> = points.iter().map(|p| p.0).collect();
    sorted.sort_by(f64::total_cmp);
    let at = |q: f64| sorted[((n - 1) as f64 * q).round() as usize];
    let (from, to) = (at(0.02), at(0.98));
    let spread = (at(0.75) - at(0.25)) / 1.349;
    let spread = if spread > 0.0 { spread } else { (to - from) / 4.0 };
    if !(to > from) || !(spread > 0.0) {
        return None;
    }
    let width = 0.7 * spread * (n as f64 / 100.0).powf(-0.2);
    let mut curve = SmoothCurve { x: Vec::new(), mean: Vec::new(), low: Vec::new(), high: Vec::new() };
    for i in 0..count {
        let x0 = from + (to - from) * i as f64 / (count - 1) as f64;
        let weights: Vec<f64> = points.iter().map(|(x, _)| (-0.5 * ((x - x0) / width).powi(2)).exp()).collect();
        let (mut s0, mut s1, mut s2) = (0.0, 0.0, 0.0);
        for ((x, _), w) in points.iter().zip(&weights) {
            let d = (x - x0) / width;
            s0 += w;
            s1 += w * d;
            s2 += w * d * d;
        }
        let determinant = s0 * s2 - s1 * s1;
        if s0 < 3.0 || determinant < 1e-9 * s0 * s0 {
            continue;
        }
        // Effective weights of the local line at x0.
        let effective: Vec<f64> = points.iter().zip(&weights).map(|((x, _), w)| w * (s2 - s1 * (x - x0) / width) / determinant).collect();
        let mean: f64 = points.iter().zip(&effective).map(|((_, y), l)| l * y).sum();
        let variance = points.iter().zip(&weights).map(|((_, y), w)| w * (y - mean).powi(2)).sum::<f64>() / s0;
        let sd = (variance * effective.iter().map(|l| l * l).sum::<f64>()).sqrt();
        curve.x.push(x0);
        curve.mean.push(mean);
        curve.low.push(mean - 1.96 * sd);
        curve.high.push(mean + 1.96 * sd);
    }
    (curve.x.len() >= 2).then_some(curve)
}

/// Mean of a quantity over one cell of the face (racket-local, m).
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct FaceCell {
    pub x: f64,
    pub y: f64,
    pub n: usize,
    pub mean: f64,
    pub sd: f64,
}

/// Means over square cells of `size_m`; cells without impacts are absent.
pub fn face_map(points: &[(f64, f64, f64)], size_m: f64) -> Vec<FaceCell> {
    let mut cells: std::collections::BTreeMap<(i64, i64), Vec<f64>> = Default::default();
    for (x, y, value) in points {
        let key = ((x / size_m).floor(), (y / size_m).floor());
        if key.0.abs() < 1e3 && key.1.abs() < 1e3 {
            cells.entry((key.0 as i64, key.1 as i64)).or_default().push(*value);
        }
    }
    cells
        .into_iter()
        .map(|((i, j), values)| {
            let n = values.len();
            let mean = values.iter().sum::<f64>() / n as f64;
            let sd = if n > 1 { (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1) as f64).sqrt() } else { 0.0 };
            FaceCell { x: (i as f64 + 0.5) * size_m, y: (j as f64 + 0.5) * size_m, n, mean, sd }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn truth_a_line_is_smoothed_to_itself() {
        let points: Vec<(f64, f64)> = (0..50).map(|i| (f64::from(i), 2.0 * f64::from(i) - 3.0)).collect();
        let curve = smooth(&points, 20).expect("fifty points");
        for (x, m) in curve.x.iter().zip(&curve.mean) {
            assert!((m - (2.0 * x - 3.0)).abs() < 1e-6, "{x} {m}");
        }
    }
}
