//! A smooth through scattered residuals with its 95 % band, and means over the racket's face.

use crate::quantity::HOLD_95_PERCENT;
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

/// Widths of the kernel that are tried, in the abscissa's robust deviations: from a node line across a face to nearly a straight line.
const WIDTHS: [f64; 8] = [0.08, 0.12, 0.18, 0.27, 0.4, 0.6, 0.9, 2.0];
/// Bins in which the width is chosen.
const BINS: usize = 64;
/// What a degree of freedom costs; 2 by the criterion itself, with which a curve through noise is wavy now and then.
const PENALTY: f64 = 3.0;
/// A kernel must hold so many points, and how often it may be widened for that.
const FEWEST: f64 = 3.0;
const WIDENINGS: i32 = 14;

/// Local-linear regression with a Gaussian kernel at `count` points between the 2nd and 98th percentile of x.
///
/// The kernel's width is the one of eight with the least corrected Akaike criterion (Hurvich, Simonoff and Tsai 1998), so that a
/// bend which stands out of the scatter is followed and a straight line is not chased. The band uses the local variance about the
/// curve. `None` with fewer than ten points or no spread in x.
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
    let bins = Bin::of(points, from, to);
    let curves = WIDTHS.iter().filter_map(|w| AtBins::with(w * spread, &bins, n));
    let AtBins { width, trace, means, .. } = curves.min_by(|a, b| a.criterion.total_cmp(&b.criterion))?;
    // What scatters about the curve, bin by bin: within it, and its mean off the curve.
    let scatter: Vec<f64> = bins.iter().zip(&means).map(|(b, f)| b.within + b.n * (b.y - f).powi(2)).collect();
    // A curve takes some of the scatter with it.
    let freed = n as f64 / (n as f64 - trace).max(1.0);
    let mut curve = SmoothCurve { x: Vec::new(), mean: Vec::new(), low: Vec::new(), high: Vec::new() };
    for i in 0..count {
        let x0 = from + (to - from) * i as f64 / (count - 1) as f64;
        let Some(line) = LocalLine::at(x0, &bins, width) else { continue };
        let mean: f64 = bins.iter().map(|b| b.n * line.weight_of(b.x) * b.y).sum();
        // Over twice the width, so that a narrow kernel does not take its variance from a handful of points.
        let (mut sum, mut near) = (0.0, 0.0);
        for (b, s) in bins.iter().zip(&scatter) {
            let w = (-0.125 * ((b.x - x0) / line.width).powi(2)).exp();
            sum += w * s;
            near += w * b.n;
        }
        let sd = (freed * sum / near * bins.iter().map(|b| b.n * line.weight_of(b.x).powi(2)).sum::<f64>()).sqrt();
        curve.x.push(x0);
        curve.mean.push(mean);
        curve.low.push(mean - HOLD_95_PERCENT * sd);
        curve.high.push(mean + HOLD_95_PERCENT * sd);
    }
    (curve.x.len() >= 2).then_some(curve)
}

/// Points that lie close together in x.
struct Bin {
    n: f64,
    x: f64,
    y: f64,
    /// Sum of squares about `y`.
    within: f64,
}

impl Bin {
    fn of(points: &[(f64, f64)], from: f64, to: f64) -> Vec<Bin> {
        let mut bins: Vec<Bin> = (0..BINS + 2).map(|_| Bin { n: 0.0, x: 0.0, y: 0.0, within: 0.0 }).collect();
        // What lies beyond the percentiles has a bin of its own at either end.
        let place = |x: f64| (1.0 + (x - from) / (to - from) * BINS as f64).clamp(0.0, BINS as f64 + 1.0) as usize;
        for &(x, y) in points {
            let b = &mut bins[place(x)];
            b.n += 1.0;
            let off = y - b.y;
            b.y += off / b.n;
            b.within += off * (y - b.y);
            b.x += (x - b.x) / b.n;
        }
        bins.retain(|b| b.n > 0.0);
        bins
    }
}

/// A line fitted to the surroundings of a place: how much each point counts in it.
struct LocalLine {
    at: f64,
    width: f64,
    level: f64,
    slope: f64,
}

impl LocalLine {
    /// With a kernel of this width, or where points are few as much wider as it takes to hold enough of them.
    fn at(x0: f64, bins: &[Bin], width: f64) -> Option<LocalLine> {
        (0..WIDENINGS).map(|k| width * 1.4_f64.powi(k)).find_map(|width| {
            let (mut s0, mut s1, mut s2) = (0.0, 0.0, 0.0);
            for b in bins {
                let d = (b.x - x0) / width;
                let w = b.n * (-0.5 * d * d).exp();
                s0 += w;
                s1 += w * d;
                s2 += w * d * d;
            }
            let determinant = s0 * s2 - s1 * s1;
            (s0 >= FEWEST && determinant > 1e-3 * s0 * s0).then(|| LocalLine { at: x0, width, level: s2 / determinant, slope: s1 / determinant })
        })
    }

    /// Weight of one point at `x` in the mean at the line's place.
    fn weight_of(&self, x: f64) -> f64 {
        let d = (x - self.at) / self.width;
        (-0.5 * d * d).exp() * (self.level - self.slope * d)
    }
}

/// The curve of one width at the bins.
struct AtBins {
    width: f64,
    /// Corrected Akaike criterion.
    criterion: f64,
    /// Degrees of freedom that it takes.
    trace: f64,
    means: Vec<f64>,
}

impl AtBins {
    /// `None` where it takes all freedom of the `n` points.
    fn with(width: f64, bins: &[Bin], n: usize) -> Option<AtBins> {
        let (mut left, mut trace, mut means) = (0.0, 0.0, Vec::with_capacity(bins.len()));
        for b in bins {
            let line = LocalLine::at(b.x, bins, width)?;
            let mean: f64 = bins.iter().map(|o| o.n * line.weight_of(o.x) * o.y).sum();
            left += b.within + b.n * (b.y - mean).powi(2);
            trace += b.n * line.weight_of(b.x);
            means.push(mean);
        }
        let n = n as f64;
        let freedom = n - trace - 2.0;
        let criterion = (left / n).max(f64::MIN_POSITIVE).ln() + PENALTY * (trace + 1.0) / freedom;
        (freedom > 0.0).then_some(AtBins { width, criterion, trace, means })
    }
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

    /// A dip as narrow as a node line across the face is followed, and the band holds the truth where it says so: most places of most
    /// curves. A fixed width of 0.7 deviations cut the dip to a third of its depth and its band to nothing of it.
    #[test]
    fn law_the_band_holds_the_local_mean() {
        use rand::{Rng, SeedableRng};
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(5);
        // Of 32 points three or four lie in the dip.
        for (n, least_with_dip) in [(32, 0.7), (200, 0.8), (1000, 0.8)] {
            for (dip, least) in [(0.0, 0.9), (3.0, least_with_dip)] {
                let truth = |x: f64| -dip * (-0.5 * ((x - 0.2) / 0.3_f64).powi(2)).exp();
                let (mut inside, mut places) = (0, 0);
                for _ in 0..60 {
                    let points: Vec<(f64, f64)> = (0..n)
                        .map(|_| {
                            let x: f64 = random.sample(rand_distr::StandardNormal);
                            let noise: f64 = random.sample(rand_distr::StandardNormal);
                            (x, truth(x) + noise)
                        })
                        .collect();
                    let c = smooth(&points, 41).expect("enough points");
                    for (x, (l, h)) in c.x.iter().zip(c.low.iter().zip(&c.high)).filter(|(x, _)| x.abs() < 1.5) {
                        places += 1;
                        inside += usize::from((*l..=*h).contains(&truth(*x)));
                    }
                }
                let share = f64::from(inside as u32) / f64::from(places as u32);
                eprintln!("{n} points, dip {dip}: {share:.3}");
                assert!(share > least, "{n} points, dip of {dip}: the band holds {share:.3} of the places");
            }
        }
    }
}
