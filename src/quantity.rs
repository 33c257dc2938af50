//! A measured number with its standard deviation and unit, as `shot.json` shows it.

use serde::{Deserialize, Serialize};

/// Turns a minute in a radian a second.
pub const RPM: f64 = 60.0 / std::f64::consts::TAU;

/// A number as one would write it by hand, not with hundreds of zeros.
pub fn as_written(value: f64) -> String {
    if value == 0.0 || (1e-7..1e7).contains(&value.abs()) { format!("{value}") } else { format!("{value:e}") }
}

/// `value ± sd` (one standard deviation) in `unit`. A quantity that was not measured is an absent `Quantity`, never NaN.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Quantity {
    pub value: f64,
    pub sd: f64,
    pub unit: String,
}

impl Quantity {
    pub fn new(value: f64, sd: f64, unit: &str) -> Self {
        Quantity { value, sd, unit: unit.to_owned() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn law_no_number_is_written_with_hundreds_of_zeros() {
        let usual = [(-0.34, "-0.34"), (0.0, "0"), (500.0, "500")];
        let odd = [(1e308, "1e308"), (-5e-324, "-5e-324"), (f64::NAN, "NaN"), (f64::INFINITY, "inf")];
        for (value, text) in usual.into_iter().chain(odd) {
            assert_eq!(as_written(value), text);
        }
    }
}
