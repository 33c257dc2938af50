//! Dimensions of expressions: powers of metre, second and kilogram; angles have none.

use std::fmt;

/// `Known([m, s, kg])`, or `Any` for numbers and parameters that take the dimension they need.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Dimension {
    Any,
    Known([f64; 3]),
}

/// No dimension: a ratio, an angle.
pub const NONE: Dimension = Dimension::Known([0.0; 3]);

impl Dimension {
    pub(super) fn times(self, other: Dimension, sign: f64) -> Dimension {
        match (self, other) {
            (Dimension::Known(a), Dimension::Known(b)) => Dimension::Known(std::array::from_fn(|i| a[i] + sign * b[i])),
            _ => Dimension::Any,
        }
    }

    pub(super) fn power(self, exponent: f64) -> Dimension {
        match self {
            Dimension::Known(a) => Dimension::Known(a.map(|x| x * exponent)),
            Dimension::Any => Dimension::Any,
        }
    }

    /// The common dimension of two terms of a sum, or `None` when they cannot be added.
    pub(super) fn same(self, other: Dimension) -> Option<Dimension> {
        match (self, other) {
            (Dimension::Any, d) | (d, Dimension::Any) => Some(d),
            (Dimension::Known(a), Dimension::Known(b)) => a.iter().zip(b).all(|(x, y)| (x - y).abs() < 1e-9).then_some(self),
        }
    }

    /// From a unit's text as the tables of quantities write it.
    pub(super) fn of_unit(unit: &str) -> Dimension {
        Dimension::Known(match unit {
            "m" => [1.0, 0.0, 0.0],
            "s" => [0.0, 1.0, 0.0],
            "kg" => [0.0, 0.0, 1.0],
            "m/s" => [1.0, -1.0, 0.0],
            "rad/s" => [0.0, -1.0, 0.0],
            "N" => [1.0, -2.0, 1.0],
            "N s" => [1.0, -1.0, 1.0],
            "N m" => [2.0, -2.0, 1.0],
            "N m s" => [2.0, -1.0, 1.0],
            "kg m^2" => [2.0, 0.0, 1.0],
            _ => [0.0; 3],
        })
    }
}

impl fmt::Display for Dimension {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Dimension::Known(powers) = self else { return f.write_str("any dimension") };
        let mut any = false;
        for (power, unit) in powers.iter().zip(["m", "s", "kg"]) {
            if power.abs() > 1e-9 {
                if any {
                    f.write_str(" ")?;
                }
                any = true;
                if (power - 1.0).abs() < 1e-9 { f.write_str(unit)? } else { write!(f, "{unit}^{power}")? }
            }
        }
        if any { Ok(()) } else { f.write_str("no dimension") }
    }
}
