//! Dual numbers: a value with its derivatives in `N` directions, carried exactly through every operation.

use num_traits::{One, Zero};
use std::ops::{Add, AddAssign, Div, DivAssign, Mul, MulAssign, Neg, Sub, SubAssign};

/// Directions that the impact model is differentiated in at a time: as many as fit two registers.
pub const TOGETHER: usize = 8;

/// The dual number that effects, laws and expressions are evaluated in beside `f64`.
pub type Tangent = Dual<TOGETHER>;

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Dual<const N: usize> {
    pub value: f64,
    pub slope: [f64; N],
}

impl<const N: usize> Dual<N> {
    pub fn constant(value: f64) -> Self {
        Dual { value, slope: [0.0; N] }
    }

    /// The variable of direction `k`.
    pub fn variable(value: f64, k: usize) -> Self {
        let mut slope = [0.0; N];
        slope[k] = 1.0;
        Dual { value, slope }
    }

    /// A function of this number with the value and derivative given.
    pub(super) fn chain(self, value: f64, derivative: f64) -> Self {
        Dual { value, slope: self.slope.map(|s| derivative * s) }
    }

    /// At 0, where there is no slope, with none.
    pub fn sqrt(self) -> Self {
        let root = self.value.sqrt();
        self.chain(root, if root > 0.0 { 0.5 / root } else { 0.0 })
    }

    /// A number that is not negative to a power; at 0, where there may be no slope, with none.
    pub fn power(self, exponent: Self) -> Self {
        let value = self.value.powf(exponent.value);
        if self.value > 0.0 { self.with(exponent, value, exponent.value * value / self.value, value * self.value.ln()) } else { Self::constant(value) }
    }

    pub fn recip(self) -> Self {
        let r = 1.0 / self.value;
        self.chain(r, -r * r)
    }

    pub(super) fn with(self, other: Self, value: f64, of_self: f64, of_other: f64) -> Self {
        Dual { value, slope: std::array::from_fn(|k| of_self * self.slope[k] + of_other * other.slope[k]) }
    }
}

impl<const N: usize> Add for Dual<N> {
    type Output = Self;
    fn add(self, o: Self) -> Self {
        self.with(o, self.value + o.value, 1.0, 1.0)
    }
}

impl<const N: usize> Sub for Dual<N> {
    type Output = Self;
    fn sub(self, o: Self) -> Self {
        self.with(o, self.value - o.value, 1.0, -1.0)
    }
}

impl<const N: usize> Mul for Dual<N> {
    type Output = Self;
    fn mul(self, o: Self) -> Self {
        self.with(o, self.value * o.value, o.value, self.value)
    }
}

impl<const N: usize> Div for Dual<N> {
    type Output = Self;
    fn div(self, o: Self) -> Self {
        let q = self.value / o.value;
        self.with(o, q, 1.0 / o.value, -q / o.value)
    }
}

impl<const N: usize> Neg for Dual<N> {
    type Output = Self;
    fn neg(self) -> Self {
        self.chain(-self.value, -1.0)
    }
}

impl<const N: usize> Mul<f64> for Dual<N> {
    type Output = Self;
    fn mul(self, o: f64) -> Self {
        self.chain(self.value * o, o)
    }
}

impl<const N: usize> Sub<f64> for Dual<N> {
    type Output = Self;
    fn sub(self, o: f64) -> Self {
        self.chain(self.value - o, 1.0)
    }
}

impl<const N: usize> Add<f64> for Dual<N> {
    type Output = Self;
    fn add(self, o: f64) -> Self {
        self.chain(self.value + o, 1.0)
    }
}

impl<const N: usize> Div<f64> for Dual<N> {
    type Output = Self;
    fn div(self, o: f64) -> Self {
        Dual { value: self.value / o, slope: self.slope.map(|s| s / o) }
    }
}

macro_rules! assign {
    ($($trait:ident $name:ident $by:ident),*) => {$(
        impl<const N: usize> $trait for Dual<N> {
            fn $name(&mut self, o: Self) {
                *self = self.$by(o);
            }
        }
    )*};
}
assign!(AddAssign add_assign add, SubAssign sub_assign sub, MulAssign mul_assign mul, DivAssign div_assign div);

/// Nil with nil derivatives.
impl<const N: usize> Zero for Dual<N> {
    fn zero() -> Self {
        Self::constant(0.0)
    }
    fn is_zero(&self) -> bool {
        self.value == 0.0 && self.slope == [0.0; N]
    }
}

impl<const N: usize> One for Dual<N> {
    fn one() -> Self {
        Self::constant(1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn agrees_with_calculus() {
        let (x, y) = (Dual::<2>::variable(1.7, 0), Dual::<2>::variable(-0.6, 1));
        let f = (x * x + y * 3.0).sqrt() / (y - x) + x.recip() * -2.0 + -y * (x + 0.25) + x.power(y - 1.0);
        let value = |x: f64, y: f64| (x * x + 3.0 * y).sqrt() / (y - x) - 2.0 / x - y * (x + 0.25) + x.powf(y - 1.0);
        let h = 1e-6;
        assert!((f.value - value(1.7, -0.6)).abs() < 1e-15);
        assert!((f.slope[0] - (value(1.7 + h, -0.6) - value(1.7 - h, -0.6)) / (2.0 * h)).abs() < 1e-8);
        assert!((f.slope[1] - (value(1.7, -0.6 + h) - value(1.7, -0.6 - h)) / (2.0 * h)).abs() < 1e-8);
    }
}
