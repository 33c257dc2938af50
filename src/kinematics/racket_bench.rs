//! A racket's inertias from measurements on a bench (thesis 5.5.1 cites Brody et al. 2002; formulas derived here).

use crate::equipment::SWINGWEIGHT_AXIS_FROM_BUTT_M;
use crate::quantity::as_written;
use serde::Serialize;

/// A value with its standard deviation, SI.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Uncertain {
    pub value: f64,
    pub sd: f64,
}

/// Swings as a physical pendulum about an axis `pivot_from_butt_m` from the butt, with period `period_s` (small swings).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pendulum {
    pub pivot_from_butt_m: f64,
    pub period_s: f64,
    pub period_sd_s: f64,
}

/// Hangs with its long axis vertical from two parallel threads and turns about it: half distances of the threads above and
/// below, m, length of the threads, m, period, s.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bifilar {
    pub half_distance_above_m: f64,
    pub half_distance_below_m: f64,
    pub thread_m: f64,
    pub period_s: f64,
    pub period_sd_s: f64,
}

#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum BenchError {
    #[error("`{name}` is {}; allowed: {allowed}", as_written(*.seen))]
    Value { name: &'static str, seen: f64, allowed: &'static str },
    #[error("the two supports are {seen_m:.4} m apart; at least {LEAST_APART_M} m are needed to tell where between them the balance point lies")]
    SupportsTogether { seen_m: f64 },
    #[error("the pivot is {seen_m:.4} m from the centre of mass; at least 0.05 m is needed, or the period says nothing")]
    PivotAtBalance { seen_m: f64 },
    #[error("the period gives an inertia of {seen:.5} kg m² about the centre of mass; check mass, balance and period")]
    Negative { seen: f64 },
}

/// Gravity, m/s².
const G: f64 = super::GRAVITY_M_S2;
/// Where a pivot may be, from the butt: on the racket, or on what holds it.
const PIVOT_M: (f64, f64) = (-1.0, 2.0);

fn positive(name: &'static str, seen: f64) -> Result<f64, BenchError> {
    if seen.is_finite() && seen > 0.0 { Ok(seen) } else { Err(BenchError::Value { name, seen, allowed: "a finite number above 0" }) }
}

/// A standard deviation of `value`; as large as the value itself it says nothing, and what follows from it may be no number.
fn deviation(name: &'static str, seen: f64, value: f64) -> Result<f64, BenchError> {
    let allowed = "a standard deviation of 0 or more, smaller than the value it belongs to";
    if seen >= 0.0 && seen < value { Ok(seen) } else { Err(BenchError::Value { name, seen, allowed }) }
}

/// Swingweight (about the axis 0.10 m from the butt) from a pendulum: I_pivot = M g d T²/4π², d the pivot's distance from
/// the centre of mass; I_c = I_pivot − M d²; SW = I_c + M (c − 0.10)². A pendulum swinging across the face gives the
/// swingweight, one swinging in the face's plane the spinweight.
pub fn swingweight_from_pendulum(mass: f64, balance: f64, balance_sd: f64, p: &Pendulum) -> Result<Uncertain, BenchError> {
    let (mass, balance, period) = (positive("mass_kg", mass)?, positive("balance_m", balance)?, positive("period_s", p.period_s)?);
    let (balance_sd, period_sd) = (deviation("balance_sd", balance_sd, balance)?, deviation("period_sd_s", p.period_sd_s, period)?);
    let about_axis = |balance: f64, period: f64| {
        let d = (balance - p.pivot_from_butt_m).abs();
        let central = mass * G * d * (period / std::f64::consts::TAU).powi(2) - mass * d * d;
        (central, central + mass * (balance - SWINGWEIGHT_AXIS_FROM_BUTT_M).powi(2))
    };
    if !(PIVOT_M.0..=PIVOT_M.1).contains(&p.pivot_from_butt_m) {
        return Err(BenchError::Value { name: "pivot_from_butt_m", seen: p.pivot_from_butt_m, allowed: "-1 to 2, on the racket or what holds it" });
    }
    let d = (balance - p.pivot_from_butt_m).abs();
    if !(d >= 0.05) {
        return Err(BenchError::PivotAtBalance { seen_m: d });
    }
    let (central, value) = about_axis(balance, period);
    if !(central > 0.0) {
        return Err(BenchError::Negative { seen: central });
    }
    let by_period = about_axis(balance, period + period_sd).1 - value;
    let by_balance = about_axis(balance + balance_sd, period).1 - value;
    Ok(Uncertain { value, sd: by_period.hypot(by_balance) })
}

/// Twistweight from a bifilar suspension: I_x = M g a b T²/(4π² L) (small turns, parallel threads).
pub fn twistweight_from_bifilar(mass: f64, b: &Bifilar) -> Result<Uncertain, BenchError> {
    let mass = positive("mass_kg", mass)?;
    for (name, v) in [
        ("half_distance_above_m", b.half_distance_above_m),
        ("half_distance_below_m", b.half_distance_below_m),
        ("thread_m", b.thread_m),
        ("period_s", b.period_s),
    ] {
        positive(name, v)?;
    }
    let period_sd = deviation("period_sd_s", b.period_sd_s, b.period_s)?;
    let value = mass * G * b.half_distance_above_m * b.half_distance_below_m * (b.period_s / std::f64::consts::TAU).powi(2) / b.thread_m;
    Ok(Uncertain { value, sd: 2.0 * value * period_sd / b.period_s })
}

/// Supports nearer to each other than this tell no balance, m.
const LEAST_APART_M: f64 = 0.05;

/// Balance from two scales: the racket rests on supports at `first_m` and `second_m` from the butt that read masses in kg.
/// Mass and balance follow from sum and moment.
pub fn balance_from_scales(first_m: f64, first_kg: f64, second_m: f64, second_kg: f64) -> Result<(f64, f64), BenchError> {
    if !((first_m - second_m).abs() >= LEAST_APART_M) {
        return Err(BenchError::SupportsTogether { seen_m: (first_m - second_m).abs() });
    }
    let mass = positive("first_kg", first_kg)? + positive("second_kg", second_kg)?;
    let balance = (first_m * first_kg + second_m * second_kg) / mass;
    positive("balance_m", balance)?;
    Ok((mass, balance))
}

/// An RDC-type machine's reading in kg cm² as kg m².
pub fn from_rdc_kg_cm2(reading: f64) -> Result<f64, BenchError> {
    Ok(positive("rdc_kg_cm2", reading)? * 1e-4)
}

/// Perpendicular axis theorem for a flat body: spin − (swing + twist), relative to spin. Rackets keep it within some 5 %.
pub fn perpendicular_axis_mismatch(swing: f64, twist: f64, spin: f64) -> f64 {
    (spin - swing - twist) / spin
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn truth_pendulum_of_a_known_racket() {
        // I_c 0.0158, M 0.33, c 0.325: about the butt I = 0.0158 + 0.33·0.325² = 0.05065625; T = 2π √(I/(M g c)) = 1.379 s.
        let period = std::f64::consts::TAU * (0.05065625f64 / (0.33 * G * 0.325)).sqrt();
        let p = Pendulum { pivot_from_butt_m: 0.0, period_s: period, period_sd_s: 0.001 };
        let sw = swingweight_from_pendulum(0.33, 0.325, 0.0005, &p).expect("valid");
        // SW = 0.0158 + 0.33·0.225² = 0.03250625.
        assert!((sw.value - 0.03250625).abs() < 1e-12, "{sw:?}");
        // dI/dT = 2 I/T: 2·0.05065625·0.001/1.379 = 7.3e-5, the balance adds less than 1e-4.
        assert!(sw.sd > 7e-5 && sw.sd < 1.5e-4, "{sw:?}");
        // Another pivot, the same racket.
        let d: f64 = 0.685 - 0.325;
        let tip = Pendulum { pivot_from_butt_m: 0.685, period_s: std::f64::consts::TAU * ((0.0158 + 0.33 * d * d) / (0.33 * G * d)).sqrt(), period_sd_s: 0.0 };
        assert!((swingweight_from_pendulum(0.33, 0.325, 0.0, &tip).expect("valid").value - 0.03250625).abs() < 1e-12);
    }

    #[test]
    fn truth_bifilar_scales_and_rdc_by_hand() {
        // 0.33·9.80665·0.1·0.1·(1.2/2π)²/1 = 1.18042e-3.
        let b = Bifilar { half_distance_above_m: 0.1, half_distance_below_m: 0.1, thread_m: 1.0, period_s: 1.2, period_sd_s: 0.006 };
        let twist = twistweight_from_bifilar(0.33, &b).expect("valid");
        assert!((twist.value - 1.18042e-3).abs() < 1e-8 && (twist.sd / twist.value - 0.01).abs() < 1e-12, "{twist:?}");
        assert!(matches!(balance_from_scales(0.1, 0.1, 0.1, 0.2), Err(BenchError::SupportsTogether { .. })));
        let (mass, balance) = balance_from_scales(0.05, 0.11, 0.45, 0.22).expect("valid");
        assert!((mass - 0.33).abs() < 1e-15 && (balance - (0.0055 + 0.099) / 0.33).abs() < 1e-15);
        assert!((from_rdc_kg_cm2(325.0).expect("valid") - 0.0325).abs() < 1e-15);
        assert!((perpendicular_axis_mismatch(0.0325, 0.0015, 0.034)).abs() < 1e-12);
    }

    #[test]
    fn fails_nonsense_is_named() {
        let p = |pivot, period| Pendulum { pivot_from_butt_m: pivot, period_s: period, period_sd_s: 0.0 };
        assert!(matches!(swingweight_from_pendulum(0.33, 0.325, 0.0, &p(0.33, 1.0)), Err(BenchError::PivotAtBalance { .. })));
        assert!(matches!(swingweight_from_pendulum(0.33, 0.325, 0.0, &p(0.0, 0.3)), Err(BenchError::Negative { .. })));
        assert!(matches!(swingweight_from_pendulum(f64::NAN, 0.325, 0.0, &p(0.0, 1.0)), Err(BenchError::Value { name: "mass_kg", .. })));
        for sd in [f64::NAN, f64::INFINITY, 1e308, -0.0011] {
            let timed = Pendulum { period_sd_s: sd, ..p(0.0, 1.3) };
            let of = |result: Result<Uncertain, BenchError>| if let Err(BenchError::Value { name, .. }) = result { name } else { "taken" };
            assert_eq!(of(swingweight_from_pendulum(0.33, 0.325, 0.001, &timed)), "period_sd_s", "{sd}");
            assert_eq!(of(swingweight_from_pendulum(0.33, 0.325, 0.001, &p(1e3 * sd, 1.3))), "pivot_from_butt_m", "{sd}");
            assert_eq!(of(swingweight_from_pendulum(0.33, 0.325, sd, &p(0.0, 1.3))), "balance_sd", "{sd}");
            let threads = Bifilar { half_distance_above_m: 0.1, half_distance_below_m: 0.1, thread_m: 1.0, period_s: 1.2, period_sd_s: sd };
            assert_eq!(of(twistweight_from_bifilar(0.33, &threads)), "period_sd_s", "{sd}");
        }
    }
}
