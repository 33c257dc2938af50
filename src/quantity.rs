//! A measured number with its standard deviation and unit, as `shot.json` shows it.

use serde::{Deserialize, Serialize};

/// Turns a minute in a radian a second.
pub const RPM: f64 = 60.0 / std::f64::consts::TAU;

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
