//! Tails of the distributions that the tests are judged by.

/// P(chi-square with `freedom` degrees > `value`).
pub fn chi2_tail(value: f64, freedom: f64) -> f64 {
    if !(value > 0.0) || !(freedom > 0.0) {
        return 1.0;
    }
    statrs::function::gamma::checked_gamma_ur(0.5 * freedom, 0.5 * value).unwrap_or(0.0).clamp(0.0, 1.0)
}

/// P(F with `freedom` and `of_scale` degrees > `value / freedom`): the tail of chi-square where the scale is itself an estimate of
/// `of_scale` degrees of freedom, or known (infinity).
pub fn ratio_tail(value: f64, freedom: f64, of_scale: f64) -> f64 {
    if of_scale.is_infinite() {
        return chi2_tail(value, freedom);
    }
    if !(value > 0.0) || !(freedom > 0.0) || !(of_scale > 0.0) {
        return 1.0;
    }
    statrs::function::beta::checked_beta_reg(0.5 * of_scale, 0.5 * freedom, of_scale / (of_scale + value)).unwrap_or(1.0).clamp(0.0, 1.0)
}

/// P(standard normal > z).
pub fn normal_tail(z: f64) -> f64 {
    0.5 * statrs::function::erf::erfc(z / std::f64::consts::SQRT_2)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn truth_an_estimated_scale_has_heavier_tails() {
        // Student's t of 10 degrees beyond 2.228 either way, F of 3 and 12 beyond 3.49: 5 % each (tables).
        assert!((ratio_tail(2.228f64.powi(2), 1.0, 10.0) - 0.05).abs() < 1e-4);
        assert!((ratio_tail(3.0 * 3.490, 3.0, 12.0) - 0.05).abs() < 1e-4);
        assert!((ratio_tail(3.841, 1.0, f64::INFINITY) - 0.05).abs() < 1e-4);
        assert!(ratio_tail(25.0, 1.0, 15.0) > 100.0 * ratio_tail(25.0, 1.0, f64::INFINITY));
    }
}
