//! A measured number with its standard deviation and unit, as `shot.json` shows it.

use serde::{Deserialize, Serialize};

/// Turns a minute in a radian a second.
pub const RPM: f64 = 60.0 / std::f64::consts::TAU;

/// Deviations either side of the mean that hold 95 % of a normal distribution.
pub const HOLD_95_PERCENT: f64 = 1.96;

/// A number as one would write it by hand, for a message: 5e-324 and 1e308 not in three hundred digits.
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
    fn truth_a_number_in_a_message_is_short() {
        let shown = [0.0, -0.0579, 16.0, 5e-324, 1e308, f64::NAN, f64::NEG_INFINITY].map(as_written);
        assert_eq!(shown, ["0", "-0.0579", "16", "5e-324", "1e308", "NaN", "-inf"]);
    }
}
