//! Axes: ranges, round tick values and their labels.

use crate::report::markup::{fixed, superscript};

/// One axis as the user described it.
#[derive(Debug, Clone, Default)]
pub(super) struct Axis {
    pub label: String,
    pub unit: String,
    /// Fixed range; otherwise the data decide.
    pub range: Option<(f64, f64)>,
    /// Values that must be inside.
    pub include: Vec<f64>,
    pub reversed: bool,
    /// Names at 0, 1, 2, ... instead of numbers.
    pub categories: Vec<String>,
    pub hidden: bool,
}

/// An axis laid on paper: value range and tick labels.
#[derive(Debug, Clone)]
pub(super) struct Scale {
    pub low: f64,
    pub high: f64,
    pub ticks: Vec<(f64, String)>,
    /// Power of ten taken out of the labels.
    pub power: i32,
}

impl Axis {
    /// Lays the axis over the data's range with about `count` ticks. Without fixed range the ends get some air.
    pub fn scale(&self, data: Option<(f64, f64)>, count: usize) -> Scale {
        if !self.categories.is_empty() {
            let ticks = self.categories.iter().enumerate().map(|(i, c)| (i as f64, c.clone())).collect();
            return Scale { low: -0.5, high: self.categories.len() as f64 - 0.5, ticks, power: 0 };
        }
        let (low, high) = match self.range.filter(|(a, b)| a.is_finite() && b.is_finite() && a < b) {
            Some(range) => range,
            None => {
                let values = data.into_iter().flat_map(|(a, b)| [a, b]).chain(self.include.iter().copied());
                let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
                pad(low, high)
            }
        };
        Scale::over(low, high, count)
    }

    /// The axis title with its unit: `speed (m/s)`.
    pub fn title(&self, power: i32) -> String {
        let scale = if power == 0 { String::new() } else { format!("10{} ", superscript(power)) };
        match (self.unit.is_empty(), power) {
            (true, 0) => self.label.clone(),
            (true, _) => format!("{} (10{})", self.label, superscript(power)),
            _ => format!("{} ({scale}{})", self.label, self.unit),
        }
    }
}

fn pad(low: f64, high: f64) -> (f64, f64) {
    if !(low.is_finite() && high.is_finite()) {
        return (0.0, 1.0);
    }
    let span = high - low;
    if span <= 1e-12 * low.abs().max(high.abs()) || span <= f64::MIN_POSITIVE {
        let half = if low == 0.0 { 1.0 } else { 0.1 * low.abs() };
        return (low - half, high + half);
    }
    (low - 0.04 * span, high + 0.04 * span)
}

impl Scale {
    pub fn over(low: f64, high: f64, count: usize) -> Scale {
        let ends = |step: f64| ((low / step - 1e-9).ceil(), (high / step + 1e-9).floor());
        let coarse = step(high - low, count);
        // One tick alone tells no scale.
        let step = if ends(coarse).1 - ends(coarse).0 < 1.0 { step(high - low, 2 * count.max(1)) } else { coarse };
        let (first, last) = ends(step);
        let largest = low.abs().max(high.abs());
        // Long labels are unreadable: take powers of a thousand out.
        let power = if !(0.01..1e5).contains(&largest) { 3 * (largest.log10() / 3.0).floor().clamp(-100.0, 100.0) as i32 } else { 0 };
        let unit = 10f64.powi(power);
        let decimals = (-(step / unit).log10() - 1e-9).ceil().max(0.0) as usize;
        let n = (last - first).clamp(0.0, 40.0) as usize;
        let ticks = (0..=n).map(|k| (first + k as f64) * step).map(|v| (v, fixed(v / unit, decimals))).collect();
        Scale { low, high, ticks, power }
    }
}

/// A step of 1, 2 or 5 times a power of ten that cuts `span` into about `count` parts.
pub(super) fn step(span: f64, count: usize) -> f64 {
    let raw = span / count.max(1) as f64;
    if !(raw.is_finite() && raw > 0.0) {
        return 1.0;
    }
    let base = 10f64.powf(raw.log10().floor());
    let ratio = raw / base;
    base * if ratio < 1.5 {
        1.0
    } else if ratio < 3.5 {
        2.0
    } else if ratio < 7.5 {
        5.0
    } else {
        10.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn truth_ticks_are_round_and_inside() {
        let s = Scale::over(-0.13, 0.27, 5);
        let labels: Vec<&str> = s.ticks.iter().map(|t| t.1.as_str()).collect();
        assert_eq!(labels, ["\u{2212}0.1", "0.0", "0.1", "0.2"]);
        let s = Scale::over(0.0, 0.004, 4);
        assert_eq!(s.power, -3);
        assert_eq!(s.ticks.last().map(|t| t.1.clone()), Some("4".to_owned()));
    }

    #[test]
    fn law_any_range_gives_finite_ticks() {
        for (low, high) in [(f64::NAN, 1.0), (1e-300, 2e-300), (5.0, 5.0), (0.0, 0.0), (-1e300, 1e300), (f64::INFINITY, 0.0)] {
            let s = Axis::default().scale(Some((low, high)), 5);
            assert!(s.low.is_finite() && s.high.is_finite() && s.low < s.high, "{low} {high} {s:?}");
            assert!(s.ticks.len() < 50);
        }
    }
}
