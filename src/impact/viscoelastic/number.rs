//! What the stepper computes with: one impact's number, or the numbers of several impacts side by side in a register.
//!
//! Written out for registers, because compilers find the lanes in code of this size only by luck. No operation is fused or
//! reordered, so every kind of register gives the same bits.

use crate::impact::dual::Dual;
use pulp::Simd;
use std::ops::{Add, BitAnd, BitOr, Div, Mul, Neg, Sub};

/// A number of one impact (`f64`) or of several ([`Wide`]).
pub trait Number:
    Copy
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + Add<f64, Output = Self>
    + Sub<f64, Output = Self>
    + Mul<f64, Output = Self>
{
    /// Which lanes something holds for.
    type Mask: Copy + BitAnd<Output = Self::Mask> + BitOr<Output = Self::Mask>;
    /// Impacts side by side.
    const LANES: usize;

    /// `value` in every lane (of the kind of register that `self` is).
    fn same(self, value: f64) -> Self;
    fn sqrt(self) -> Self;
    fn less(self, other: Self) -> Self::Mask;
    /// `a` where the mask holds, else `b`.
    fn choose(mask: Self::Mask, a: Self, b: Self) -> Self;
    fn lane(&self, i: usize) -> f64;
    fn set_lane(&mut self, i: usize, value: f64);

    /// Each lane to a power, one by one.
    #[inline(always)]
    fn power(self, exponent: Self) -> Self {
        let mut out = self;
        for i in 0..Self::LANES {
            out.set_lane(i, self.lane(i).powf(exponent.lane(i)));
        }
        out
    }

    #[inline(always)]
    fn positive_part(self) -> Self {
        let zero = self.same(0.0);
        Self::choose(zero.less(self), self, zero)
    }

    #[inline(always)]
    fn larger(self, other: Self) -> Self {
        Self::choose(self.less(other), other, self)
    }

    #[inline(always)]
    fn smaller(self, other: Self) -> Self {
        Self::choose(other.less(self), other, self)
    }

    #[inline(always)]
    fn size(self) -> Self {
        Self::choose(self.less(self.same(0.0)), -self, self)
    }
}

impl Number for f64 {
    type Mask = bool;
    const LANES: usize = 1;

    #[inline(always)]
    fn same(self, value: f64) -> Self {
        value
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        f64::sqrt(self)
    }
    #[inline(always)]
    fn less(self, other: Self) -> bool {
        self < other
    }
    #[inline(always)]
    fn choose(mask: bool, a: Self, b: Self) -> Self {
        if mask { a } else { b }
    }
    #[inline(always)]
    fn lane(&self, _: usize) -> f64 {
        *self
    }
    #[inline(always)]
    fn set_lane(&mut self, _: usize, value: f64) {
        *self = value;
    }
}

/// One register of the processor.
#[derive(Clone, Copy)]
pub struct Wide<R: Simd> {
    simd: R,
    value: R::f64s,
}

impl<R: Simd> Wide<R> {
    #[inline(always)]
    pub fn zero(simd: R) -> Self {
        Wide { simd, value: simd.splat_f64s(0.0) }
    }
}

macro_rules! operator {
    ($trait:ident $name:ident $function:ident) => {
        impl<R: Simd> $trait for Wide<R> {
            type Output = Self;
            #[inline(always)]
            fn $name(self, other: Self) -> Self {
                Wide { simd: self.simd, value: self.simd.$function(self.value, other.value) }
            }
        }
    };
    ($trait:ident $name:ident $function:ident f64) => {
        operator!($trait $name $function);

        impl<R: Simd> $trait<f64> for Wide<R> {
            type Output = Self;
            #[inline(always)]
            fn $name(self, other: f64) -> Self {
                Wide { simd: self.simd, value: self.simd.$function(self.value, self.simd.splat_f64s(other)) }
            }
        }
    };
}

operator!(Add add add_f64s f64);
operator!(Sub sub sub_f64s f64);
operator!(Mul mul mul_f64s f64);
operator!(Div div div_f64s);

impl<R: Simd> Neg for Wide<R> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Wide { simd: self.simd, value: self.simd.neg_f64s(self.value) }
    }
}

/// Lanes of a [`Wide`].
#[derive(Clone, Copy)]
pub struct Lanes<R: Simd> {
    simd: R,
    mask: R::m64s,
}

impl<R: Simd> BitAnd for Lanes<R> {
    type Output = Self;
    #[inline(always)]
    fn bitand(self, other: Self) -> Self {
        Lanes { simd: self.simd, mask: self.simd.and_m64s(self.mask, other.mask) }
    }
}

impl<R: Simd> BitOr for Lanes<R> {
    type Output = Self;
    #[inline(always)]
    fn bitor(self, other: Self) -> Self {
        Lanes { simd: self.simd, mask: self.simd.or_m64s(self.mask, other.mask) }
    }
}

impl<R: Simd> Number for Wide<R> {
    type Mask = Lanes<R>;
    const LANES: usize = R::F64_LANES;

    #[inline(always)]
    fn same(self, value: f64) -> Self {
        Wide { simd: self.simd, value: self.simd.splat_f64s(value) }
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        Wide { simd: self.simd, value: self.simd.sqrt_f64s(self.value) }
    }
    #[inline(always)]
    fn less(self, other: Self) -> Lanes<R> {
        Lanes { simd: self.simd, mask: self.simd.less_than_f64s(self.value, other.value) }
    }
    #[inline(always)]
    fn choose(mask: Lanes<R>, a: Self, b: Self) -> Self {
        Wide { simd: a.simd, value: a.simd.select_f64s(mask.mask, a.value, b.value) }
    }
    #[inline(always)]
    fn lane(&self, i: usize) -> f64 {
        pulp::bytemuck::cast_slice::<R::f64s, f64>(std::slice::from_ref(&self.value))[i]
    }
    #[inline(always)]
    fn set_lane(&mut self, i: usize, value: f64) {
        pulp::bytemuck::cast_slice_mut::<R::f64s, f64>(std::slice::from_mut(&mut self.value))[i] = value;
    }
}

impl<const N: usize> Number for Dual<N> {
    type Mask = bool;
    const LANES: usize = 1;

    fn same(self, value: f64) -> Self {
        Dual::constant(value)
    }
    fn sqrt(self) -> Self {
        Dual::sqrt(self)
    }
    fn power(self, exponent: Self) -> Self {
        Dual::power(self, exponent)
    }
    fn less(self, other: Self) -> bool {
        self.value < other.value
    }
    fn choose(mask: bool, a: Self, b: Self) -> Self {
        if mask { a } else { b }
    }
    fn lane(&self, _: usize) -> f64 {
        self.value
    }
    fn set_lane(&mut self, _: usize, value: f64) {
        *self = Dual::constant(value);
    }
}

/// A record of numbers of one impact, and the same of several side by side, field by field.
macro_rules! side_by_side {
    ($(#[$meta:meta])* $vis:vis struct $name:ident { $($(#[$field_meta:meta])* $field:ident),* $(,)? }) => {
        $(#[$meta])*
        #[derive(Debug, Clone, Copy, PartialEq)]
        $vis struct $name<T = f64> {
            $($(#[$field_meta])* pub $field: T,)*
        }

        // Not every record needs every method.
        #[allow(dead_code)]
        impl<T: $crate::impact::viscoelastic::number::Number> $name<T> {
            /// One impact's record in every lane.
            #[inline(always)]
            pub(super) fn same(like: T, one: &$name) -> Self {
                $name { $($field: like.same(one.$field),)* }
            }

            #[inline(always)]
            pub(super) fn lane(&self, i: usize) -> $name {
                $name { $($field: self.$field.lane(i),)* }
            }

            #[inline(always)]
            pub(super) fn set_lane(&mut self, i: usize, one: &$name) {
                $(self.$field.set_lane(i, one.$field);)*
            }

            /// One impact's record as constants among dual numbers.
            pub(super) fn in_dual<const N: usize>(one: &$name) -> $name<$crate::impact::dual::Dual<N>> {
                $name { $($field: $crate::impact::dual::Dual::constant(one.$field),)* }
            }

            /// All numbers, in the record's order.
            #[cfg(test)]
            pub(crate) fn numbers(&self) -> Vec<T> {
                vec![$(self.$field),*]
            }

            /// The other's numbers where the mask holds.
            #[inline(always)]
            pub(super) fn replace(&mut self, mask: T::Mask, other: &Self) {
                $(self.$field = T::choose(mask, other.$field, self.$field);)*
            }
        }
    };
}
pub(super) use side_by_side;

/// Vectors along the racket's axes.
pub type Three<T> = [T; 3];

#[inline(always)]
pub fn cross<T: Number>(a: Three<T>, b: Three<T>) -> Three<T> {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[inline(always)]
pub fn dot<T: Number>(a: Three<T>, b: Three<T>) -> T {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline(always)]
pub fn plus<T: Number>(a: Three<T>, b: Three<T>) -> Three<T> {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

#[inline(always)]
pub fn minus<T: Number>(a: Three<T>, b: Three<T>) -> Three<T> {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

#[inline(always)]
pub fn times<T: Number>(a: Three<T>, by: T) -> Three<T> {
    [a[0] * by, a[1] * by, a[2] * by]
}

/// Component by component.
#[inline(always)]
pub fn each<T: Number>(a: Three<T>, b: Three<T>) -> Three<T> {
    [a[0] * b[0], a[1] * b[1], a[2] * b[2]]
}
