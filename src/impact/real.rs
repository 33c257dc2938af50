//! The number that effects, laws and expressions are written for: a plain `f64`, or a dual number that carries derivatives.
//!
//! Every branch is taken by the value, so a dual number follows the very path that the plain one takes and its derivative is
//! that of the branch taken. With `f64` every operation is the plain one, bit for bit.

use super::dual::Dual;
use nalgebra::{ClosedAddAssign, ClosedDivAssign, ClosedMulAssign, ClosedSubAssign, Matrix3, Scalar, Vector2, Vector3};
use num_traits::{One, Zero};
use std::ops::{Add, Div, Mul, Neg, Sub};

/// A real number, with or without derivatives.
pub trait Real:
    Scalar
    + Copy
    + Zero
    + One
    + ClosedAddAssign
    + ClosedSubAssign
    + ClosedMulAssign
    + ClosedDivAssign
    + Neg<Output = Self>
    + Add<f64, Output = Self>
    + Sub<f64, Output = Self>
    + Mul<f64, Output = Self>
    + Div<f64, Output = Self>
{
    /// A number without derivatives.
    fn constant(value: f64) -> Self;
    fn value(&self) -> f64;
    /// True when all derivatives are nil; always for a plain number. ([`Zero::is_zero`] asks for both, value and derivatives.)
    fn is_constant(&self) -> bool;
    /// The larger of value and derivatives, all taken positive.
    fn size(&self) -> f64;

    /// At 0, where there is no slope, with none.
    fn sqrt(self) -> Self;
    /// By the base, and where the base is positive by the exponent; where a slope would be infinite or undefined, none.
    fn powf(self, exponent: Self) -> Self;
    fn powi(self, exponent: i32) -> Self;
    fn exp(self) -> Self;
    fn ln(self) -> Self;
    fn sin(self) -> Self;
    fn cos(self) -> Self;
    fn tan(self) -> Self;
    fn tanh(self) -> Self;
    fn atan(self) -> Self;
    fn atan2(self, x: Self) -> Self;
    /// At the origin, where there is no slope, with none.
    fn hypot(self, other: Self) -> Self;
    fn rem_euclid(self, divisor: Self) -> Self;
    fn recip(self) -> Self;
    /// At 0 with the mean slope of both sides: none.
    fn abs(self) -> Self;
    fn min(self, other: Self) -> Self;
    fn max(self, other: Self) -> Self;

    /// `x` of `k x = b`; dual numbers by the implicit function: `k dx = db − dk x`.
    fn solve(k: &Matrix3<Self>, b: &Vector3<Self>) -> Option<Vector3<Self>>;
}

impl Real for f64 {
    #[inline(always)]
    fn constant(value: f64) -> Self {
        value
    }
    #[inline(always)]
    fn value(&self) -> f64 {
        *self
    }
    #[inline(always)]
    fn is_constant(&self) -> bool {
        true
    }
    #[inline(always)]
    fn size(&self) -> f64 {
        f64::abs(*self)
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        f64::sqrt(self)
    }
    #[inline(always)]
    fn powf(self, exponent: Self) -> Self {
        f64::powf(self, exponent)
    }
    #[inline(always)]
    fn powi(self, exponent: i32) -> Self {
        f64::powi(self, exponent)
    }
    #[inline(always)]
    fn exp(self) -> Self {
        f64::exp(self)
    }
    #[inline(always)]
    fn ln(self) -> Self {
        f64::ln(self)
    }
    #[inline(always)]
    fn sin(self) -> Self {
        f64::sin(self)
    }
    #[inline(always)]
    fn cos(self) -> Self {
        f64::cos(self)
    }
    #[inline(always)]
    fn tan(self) -> Self {
        f64::tan(self)
    }
    #[inline(always)]
    fn tanh(self) -> Self {
        f64::tanh(self)
    }
    #[inline(always)]
    fn atan(self) -> Self {
        f64::atan(self)
    }
    #[inline(always)]
    fn atan2(self, x: Self) -> Self {
        f64::atan2(self, x)
    }
    #[inline(always)]
    fn hypot(self, other: Self) -> Self {
        f64::hypot(self, other)
    }
    #[inline(always)]
    fn rem_euclid(self, divisor: Self) -> Self {
        f64::rem_euclid(self, divisor)
    }
    #[inline(always)]
    fn recip(self) -> Self {
        1.0 / self
    }
    #[inline(always)]
    fn abs(self) -> Self {
        f64::abs(self)
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        f64::min(self, other)
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        f64::max(self, other)
    }
    #[inline(always)]
    fn solve(k: &Matrix3<Self>, b: &Vector3<Self>) -> Option<Vector3<Self>> {
        k.lu().solve(b)
    }
}

impl<const N: usize> Real for Dual<N> {
    fn constant(value: f64) -> Self {
        Dual::constant(value)
    }
    fn value(&self) -> f64 {
        self.value
    }
    fn is_constant(&self) -> bool {
        self.slope == [0.0; N]
    }
    fn size(&self) -> f64 {
        self.slope.iter().fold(self.value.abs(), |most, s| most.max(s.abs()))
    }
    fn sqrt(self) -> Self {
        Dual::sqrt(self)
    }
    fn powf(self, exponent: Self) -> Self {
        let (a, b) = (self.value, exponent.value);
        let value = a.powf(b);
        let finite = |slope: f64| if slope.is_finite() { slope } else { 0.0 };
        self.with(exponent, value, finite(b * a.powf(b - 1.0)), if a > 0.0 { value * a.ln() } else { 0.0 })
    }
    fn powi(self, exponent: i32) -> Self {
        let slope = if exponent == 0 { 0.0 } else { f64::from(exponent) * self.value.powi(exponent - 1) };
        self.chain(self.value.powi(exponent), slope)
    }
    fn exp(self) -> Self {
        let value = self.value.exp();
        self.chain(value, value)
    }
    fn ln(self) -> Self {
        self.chain(self.value.ln(), 1.0 / self.value)
    }
    fn sin(self) -> Self {
        self.chain(self.value.sin(), self.value.cos())
    }
    fn cos(self) -> Self {
        self.chain(self.value.cos(), -self.value.sin())
    }
    fn tan(self) -> Self {
        let value = self.value.tan();
        self.chain(value, 1.0 + value * value)
    }
    fn tanh(self) -> Self {
        let value = self.value.tanh();
        self.chain(value, 1.0 - value * value)
    }
    fn atan(self) -> Self {
        self.chain(self.value.atan(), 1.0 / (1.0 + self.value * self.value))
    }
    fn atan2(self, x: Self) -> Self {
        let square = self.value * self.value + x.value * x.value;
        let (of_y, of_x) = if square > 0.0 { (x.value / square, -self.value / square) } else { (0.0, 0.0) };
        self.with(x, self.value.atan2(x.value), of_y, of_x)
    }
    fn hypot(self, other: Self) -> Self {
        let value = self.value.hypot(other.value);
        let (a, b) = if value > 0.0 { (self.value / value, other.value / value) } else { (0.0, 0.0) };
        self.with(other, value, a, b)
    }
    fn rem_euclid(self, divisor: Self) -> Self {
        self.with(divisor, self.value.rem_euclid(divisor.value), 1.0, -self.value.div_euclid(divisor.value))
    }
    fn recip(self) -> Self {
        Dual::recip(self)
    }
    fn abs(self) -> Self {
        self.chain(self.value.abs(), if self.value == 0.0 { 0.0 } else { self.value.signum() })
    }
    fn min(self, other: Self) -> Self {
        if other.value < self.value || self.value.is_nan() { other } else { self }
    }
    fn max(self, other: Self) -> Self {
        if other.value > self.value || self.value.is_nan() { other } else { self }
    }
    fn solve(k: &Matrix3<Self>, b: &Vector3<Self>) -> Option<Vector3<Self>> {
        let lu = k.map(|e| e.value).lu();
        let mut x = lu.solve(&b.map(|e| e.value))?.map(Dual::constant);
        let values = x.map(|e| e.value);
        for n in 0..N {
            let slope = lu.solve(&(b.map(|e| e.slope[n]) - k.map(|e| e.slope[n]) * values))?;
            for i in 0..3 {
                x[i].slope[n] = slope[i];
            }
        }
        Some(x)
    }
}

/// Length of a vector.
#[inline(always)]
pub fn norm<T: Real>(v: &Vector3<T>) -> T {
    (v.x * v.x + v.y * v.y + v.z * v.z).sqrt()
}

/// Length of a vector in the plane.
#[inline(always)]
pub fn norm_xy<T: Real>(v: &Vector2<T>) -> T {
    (v.x * v.x + v.y * v.y).sqrt()
}

/// A plain vector as one of another number.
#[inline(always)]
pub fn constants<T: Real>(v: &Vector3<f64>) -> Vector3<T> {
    v.map(T::constant)
}

/// The rotation by a vector's length about its direction (Rodrigues); where the length is 0, to first order in it.
#[inline(always)]
pub fn rotation<T: Real>(by: &Vector3<T>) -> Matrix3<T> {
    let angle = norm(by);
    let one = T::one();
    if angle.value() == 0.0 {
        return Matrix3::new(one, -by.z, by.y, by.z, one, -by.x, -by.y, by.x, one);
    }
    let (x, y, z) = (by.x / angle, by.y / angle, by.z / angle);
    let (sin, cos) = (angle.sin(), angle.cos());
    let versine = one - cos;
    Matrix3::new(
        x * x + (one - x * x) * cos,
        x * y * versine - z * sin,
        x * z * versine + y * sin,
        x * y * versine + z * sin,
        y * y + (one - y * y) * cos,
        y * z * versine - x * sin,
        x * z * versine - y * sin,
        y * z * versine + x * sin,
        z * z + (one - z * z) * cos,
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Rotation3;

    type D = Dual<2>;

    fn near(seen: D, f: impl Fn(f64, f64) -> f64, what: &str) {
        let (x, y, h) = (0.7, -0.4, 1e-6);
        assert_eq!(seen.value, f(x, y), "{what}");
        for (slope, expected) in [(seen.slope[0], (f(x + h, y) - f(x - h, y)) / (2.0 * h)), (seen.slope[1], (f(x, y + h) - f(x, y - h)) / (2.0 * h))] {
            assert!((slope - expected).abs() < 1e-8, "{what}: {slope} against {expected}");
        }
    }

    #[test]
    fn agrees_functions_with_differences() {
        let (x, y) = (D::variable(0.7, 0), D::variable(-0.4, 1));
        near(x.powf(y), f64::powf, "power");
        near(y.powi(3) + y.powf(D::constant(2.0)), |_, y| y.powi(3) + y.powf(2.0), "power of a negative number");
        near(Real::exp(x * y), |x, y| (x * y).exp(), "exp");
        near(x.ln() + x.sin() + y.cos() + x.tan() + y.tanh() + y.atan(), |x, y| x.ln() + x.sin() + y.cos() + x.tan() + y.tanh() + y.atan(), "functions");
        near(y.atan2(x) + x.hypot(y), |x, y| y.atan2(x) + x.hypot(y), "atan2, hypot");
        near((y * 4.0).rem_euclid(x), |x, y| (y * 4.0).rem_euclid(x), "mod");
        near(y.abs() + x.min(y) + x.max(y) + (x / 2.0).recip() + Real::sqrt(x), |x, y| y.abs() + y + x + 1.0 / (x / 2.0) + x.sqrt(), "abs, min, max");
    }

    #[test]
    fn agrees_rotation_and_solution_with_differences() {
        let turn = |x: f64, y: f64| Rotation3::from_scaled_axis(Vector3::new(x, y, 0.2)).into_inner();
        let seen = rotation(&Vector3::new(D::variable(0.7, 0), D::variable(-0.4, 1), D::constant(0.2)));
        assert_eq!(rotation(&Vector3::new(0.7, -0.4, 0.2)), turn(0.7, -0.4));
        assert_eq!(rotation(&Vector3::<f64>::zeros()), Matrix3::identity());
        let answer = |k: Matrix3<f64>| k.lu().solve(&Vector3::new(1.0, 2.0, 3.0)).expect("regular");
        let solved = D::solve(&seen, &Vector3::new(1.0, 2.0, 3.0).map(D::constant)).expect("regular");
        for i in 0..3 {
            near(solved[i], |x, y| answer(turn(x, y))[i], "solution");
            for j in 0..3 {
                near(seen[(i, j)], |x, y| turn(x, y)[(i, j)], "rotation");
            }
        }
        let small = rotation(&Vector3::new(D::variable(0.0, 0), D::variable(0.0, 1), D::constant(0.0)));
        assert_eq!((small[(2, 1)].slope, small[(0, 2)].slope), ([1.0, 0.0], [0.0, 1.0]));
    }
}
