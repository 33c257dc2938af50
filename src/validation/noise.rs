//! The noise of a measured column: stated, stated as a function of the value, or assumed.
//!
//! Noise that grows with the value must be evaluated at the *fitted* value: at the measured one, large errors would get
//! small weight and small ones large weight. A column whose stated deviations follow `a + b |value|` exactly (to the
//! digits written) tells its own law.

use crate::impact_table::Measured;

/// Deviations assumed where a table states none (SI): footage of this kind reaches 0.1 m/s and 1.2 mm; spin 8 rad/s.
pub fn assumed_sd(column: &str) -> f64 {
    match column {
        "impact_x" | "impact_y" => 1.2e-3,
        "grip_torque" => 0.0,
        "contact_time" => 1.0e-4,
        c if c.starts_with("ball") && c.contains("_w") => 8.0,
        c if c.contains("_w") => 0.5,
        c if c.starts_with("racket") => 0.06,
        _ => 0.1,
    }
}

/// Share of a column's median deviation below which no law takes it: where a column states its noise in proportion to the value, a value
/// of nought is not known exactly.
const LEAST: f64 = 0.1;

/// `sd = constant + slope·|value|`, `least` at least.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NoiseLaw {
    pub constant: f64,
    pub slope: f64,
    pub least: f64,
}

/// How a column's deviations are known.
#[derive(Debug, Clone, PartialEq)]
pub enum ColumnNoise {
    /// As written, row by row; where a row writes none, the median of the others.
    Stated(f64),
    /// The stated deviations follow a law of the value.
    Law(NoiseLaw),
    /// None stated in the whole column; this is used.
    Assumed(f64),
}

impl ColumnNoise {
    /// Looks at one column of a table.
    pub fn of(column: &str, cells: &[Option<Measured>]) -> Self {
        let stated: Vec<(f64, f64)> = cells.iter().flatten().filter_map(|m| m.sd.map(|sd| (m.value.abs(), sd))).collect();
        if stated.is_empty() {
            return ColumnNoise::Assumed(assumed_sd(column));
        }
        let mut sizes: Vec<f64> = stated.iter().map(|s| s.1).filter(|sd| *sd > 0.0).collect();
        sizes.sort_by(f64::total_cmp);
        let typical = sizes.get(sizes.len() / 2).copied().unwrap_or_else(|| assumed_sd(column));
        law(&stated, LEAST * typical).map_or(ColumnNoise::Stated(typical), ColumnNoise::Law)
    }

    /// The noise of the column's values times `factor`.
    pub fn times(&self, factor: f64) -> Self {
        match self {
            ColumnNoise::Law(law) => ColumnNoise::Law(NoiseLaw { constant: factor * law.constant, least: factor * law.least, ..*law }),
            ColumnNoise::Assumed(sd) => ColumnNoise::Assumed(factor * sd),
            ColumnNoise::Stated(typical) => ColumnNoise::Stated(factor * typical),
        }
    }

    /// Deviation of one cell, at `value` where the law is known.
    pub fn sd(&self, stated: Option<f64>, value: f64) -> f64 {
        match self {
            ColumnNoise::Law(law) => (law.constant + law.slope * value.abs()).max(law.least),
            ColumnNoise::Assumed(sd) => *sd,
            ColumnNoise::Stated(typical) => stated.unwrap_or(*typical),
        }
    }
}

/// The exact straight line through the stated deviations, when there is one with a slope.
fn law(stated: &[(f64, f64)], least: f64) -> Option<NoiseLaw> {
    let n = stated.len() as f64;
    if stated.len() < 5 {
        return None;
    }
    let (mx, my) = (stated.iter().map(|s| s.0).sum::<f64>() / n, stated.iter().map(|s| s.1).sum::<f64>() / n);
    let sxx: f64 = stated.iter().map(|s| (s.0 - mx).powi(2)).sum();
    let sxy: f64 = stated.iter().map(|s| (s.0 - mx) * (s.1 - my)).sum();
    if sxx <= 0.0 {
        return None;
    }
    let slope = sxy / sxx;
    let constant = my - slope * mx;
    // Nought, but for rounding.
    let constant = if constant.abs() < 1e-6 * my { 0.0 } else { constant };
    // Six written digits leave 1e-5 of rounding; a tenth of a per cent is far from any measured scatter.
    let exact = stated.iter().all(|s| (s.1 - constant - slope * s.0).abs() <= 1e-3 * s.1);
    (exact && slope > 1e-6 && constant >= 0.0).then_some(NoiseLaw { constant, slope, least })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn truth_a_written_law_is_recognised_and_scatter_is_not() {
        let cells: Vec<_> = (0..20).map(|i| Some(Measured { value: -10.0 * f64::from(i), sd: Some(3.0 + 0.5 * f64::from(i)) })).collect();
        let ColumnNoise::Law(law) = ColumnNoise::of("ball_out_wy", &cells) else { panic!("3 + 5 %") };
        assert!((law.constant - 3.0).abs() < 1e-9 && (law.slope - 0.05).abs() < 1e-9);
        let share: Vec<_> = (0..20).map(|i| Some(Measured { value: 0.7 * f64::from(i), sd: Some(0.014 * f64::from(i)) })).collect();
        let noise = ColumnNoise::of("ball_out_vx", &share);
        assert!(matches!(noise, ColumnNoise::Law(l) if l.constant == 0.0 && (l.slope - 0.02).abs() < 1e-9));
        assert!(noise.sd(None, 0.0) > 0.01 && noise.sd(None, 10.0) > 0.19);
        let constant: Vec<_> = (0..20).map(|i| Some(Measured { value: f64::from(i), sd: Some(8.0) })).collect();
        assert_eq!(ColumnNoise::of("ball_out_wy", &constant), ColumnNoise::Stated(8.0));
        assert_eq!(ColumnNoise::of("impact_x", &[None]), ColumnNoise::Assumed(1.2e-3));
    }
}
