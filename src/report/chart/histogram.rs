//! Histograms with round bin edges.

use super::axis::step;

/// Common bin edges for several samples: width after Freedman and Diaconis (2 IQR n^(-1/3)), rounded to 1, 2 or 5 times a
/// power of ten, edges on multiples of it. Empty when no value is finite.
pub fn bin_edges<'a>(values: impl IntoIterator<Item = &'a f64>) -> Vec<f64> {
    let mut sorted: Vec<f64> = values.into_iter().copied().filter(|v| v.is_finite()).collect();
    sorted.sort_by(f64::total_cmp);
    let (Some(&low), Some(&high)) = (sorted.first(), sorted.last()) else {
        return Vec::new();
    };
    let n = sorted.len();
    let iqr = sorted[(3 * n / 4).min(n - 1)] - sorted[n / 4];
    let span = if high > low { high - low } else { 0.1 * low.abs().max(1e-3) };
    // Between eight and forty bins, however odd the sample (a mixture of groups has a wide quartile range).
    let wanted = (2.0 * iqr / (n as f64).cbrt()).clamp(span / 40.0, span / 10.0);
    let width = step(wanted, 1);
    let first = (low / width).floor();
    let count = ((high / width).floor() - first + 1.0).clamp(1.0, 100.0) as usize;
    (0..=count).map(|k| (first + k as f64) * width).collect()
}

/// Counts per bin as (from, to, count); a value on an inner edge belongs to the bin above it.
pub fn histogram(values: &[f64], edges: &[f64]) -> Vec<(f64, f64, f64)> {
    let last = edges.len().saturating_sub(2);
    let mut bars: Vec<(f64, f64, f64)> = edges.windows(2).map(|e| (e[0], e[1], 0.0)).collect();
    for v in values.iter().filter(|v| v.is_finite()) {
        let at = edges.partition_point(|e| e <= v);
        if at >= 1
            && let Some(bar) = bars.get_mut((at - 1).min(last))
            && *v <= bar.1
        {
            bar.2 += 1.0;
        }
    }
    bars
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn law_every_value_falls_into_one_bin() {
        for n in [1usize, 2, 7, 500] {
            let values: Vec<f64> = (0..n).map(|i| (i as f64 * 0.7).sin() * 3.0 - 10.0).collect();
            let total: f64 = histogram(&values, &bin_edges(&values)).iter().map(|b| b.2).sum();
            assert_eq!(total as usize, n);
        }
    }

    #[test]
    fn truth_bins_are_round() {
        let edges = bin_edges(&[0.0, 10.0, 20.0, 30.0]);
        assert_eq!(edges.first(), Some(&0.0));
        // Ten bins or more asks for a width of 3 or less; the round one below it is 2.
        assert!(edges.windows(2).all(|e| e[1] - e[0] == 2.0), "{edges:?}");
        assert!(bin_edges(&[f64::NAN]).is_empty());
    }
}
