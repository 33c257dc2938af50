//! A straight line through a scatter with the 95 % band of its mean (ordinary least squares).

use statrs::distribution::{ContinuousCDF, StudentsT};

pub(super) struct Regression {
    pub slope: f64,
    pub slope_sd: f64,
    pub r2: f64,
    pub line: Vec<(f64, f64)>,
    /// (x, low, high)
    pub band: Vec<(f64, f64, f64)>,
}

/// `None` below four points or without spread in x.
pub(super) fn regression(points: &[(f64, f64)]) -> Option<Regression> {
    let p: Vec<(f64, f64)> = points.iter().copied().filter(|(x, y)| x.is_finite() && y.is_finite()).collect();
    if p.len() < 4 {
        return None;
    }
    let n = p.len() as f64;
    let (mx, my) = (p.iter().map(|q| q.0).sum::<f64>() / n, p.iter().map(|q| q.1).sum::<f64>() / n);
    let sxx: f64 = p.iter().map(|q| (q.0 - mx).powi(2)).sum();
    let syy: f64 = p.iter().map(|q| (q.1 - my).powi(2)).sum();
    let sxy: f64 = p.iter().map(|q| (q.0 - mx) * (q.1 - my)).sum();
    if sxx <= 1e-12 * (1.0 + mx * mx) || syy <= 0.0 {
        return None;
    }
    let slope = sxy / sxx;
    let rest: f64 = p.iter().map(|q| (q.1 - my - slope * (q.0 - mx)).powi(2)).sum();
    let variance = rest / (n - 2.0);
    let t = StudentsT::new(0.0, 1.0, n - 2.0).ok()?.inverse_cdf(0.975);
    let low = p.iter().map(|q| q.0).fold(f64::INFINITY, f64::min);
    let high = p.iter().map(|q| q.0).fold(f64::NEG_INFINITY, f64::max);
    let at = |x: f64| my + slope * (x - mx);
    let half = |x: f64| t * (variance * (1.0 / n + (x - mx).powi(2) / sxx)).sqrt();
    let grid: Vec<f64> = (0..=40).map(|k| low + (high - low) * f64::from(k) / 40.0).collect();
    Some(Regression {
        slope,
        slope_sd: (variance / sxx).sqrt(),
        r2: 1.0 - rest / syy,
        line: vec![(low, at(low)), (high, at(high))],
        band: grid.iter().map(|&x| (x, at(x) - half(x), at(x) + half(x))).collect(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By hand: x 1 2 3 4, y 2 4 5 8: slope 1.9, residual sum of squares 0.7, sd of the slope √(0.35/5).
    #[test]
    fn truth_four_points_by_hand() {
        let r = regression(&[(1.0, 2.0), (2.0, 4.0), (3.0, 5.0), (4.0, 8.0)]).expect("four points");
        assert!((r.slope - 1.9).abs() < 1e-12);
        assert!((r.slope_sd - (0.35f64 / 5.0).sqrt()).abs() < 1e-12);
        assert!((r.r2 - (1.0 - 0.7 / 18.75)).abs() < 1e-12);
        // t(0.975, 2) = 4.30265; half-width at the mean: t √(0.35/4).
        let middle = r.band[20];
        assert!((middle.2 - middle.1 - 2.0 * 4.302_653 * (0.35f64 / 4.0).sqrt()).abs() < 1e-4);
    }
}
