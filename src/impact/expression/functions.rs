//! The functions that an expression may call.

use super::parse::Op;
use crate::impact::real::Real;

/// How a function treats dimensions.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Rule {
    /// Argument and result without dimension.
    Pure,
    /// Result like the argument(s).
    Keeps,
    /// Result has half the powers.
    Root,
    /// Any argument, result without dimension.
    Drops,
}

/// A function by its name.
pub(super) struct Function {
    pub name: &'static str,
    pub op: Op,
    pub rule: Rule,
}

pub(super) const FUNCTIONS: [Function; 17] = [
    Function { name: "abs", op: Op::One(One::Abs), rule: Rule::Keeps },
    Function { name: "sqrt", op: Op::One(One::Sqrt), rule: Rule::Root },
    Function { name: "exp", op: Op::One(One::Exp), rule: Rule::Pure },
    Function { name: "ln", op: Op::One(One::Ln), rule: Rule::Pure },
    Function { name: "sin", op: Op::One(One::Sin), rule: Rule::Pure },
    Function { name: "cos", op: Op::One(One::Cos), rule: Rule::Pure },
    Function { name: "tan", op: Op::One(One::Tan), rule: Rule::Pure },
    Function { name: "tanh", op: Op::One(One::Tanh), rule: Rule::Pure },
    Function { name: "atan", op: Op::One(One::Atan), rule: Rule::Pure },
    Function { name: "atan2", op: Op::Two(Two::Atan2), rule: Rule::Drops },
    Function { name: "sign", op: Op::One(One::Sign), rule: Rule::Drops },
    Function { name: "step", op: Op::One(One::Step), rule: Rule::Drops },
    Function { name: "min", op: Op::Two(Two::Min), rule: Rule::Keeps },
    Function { name: "max", op: Op::Two(Two::Max), rule: Rule::Keeps },
    Function { name: "hypot", op: Op::Two(Two::Hypot), rule: Rule::Keeps },
    Function { name: "mod", op: Op::Two(Two::Mod), rule: Rule::Keeps },
    Function { name: "clamp", op: Op::Clamp, rule: Rule::Keeps },
];

/// Functions of one argument.
#[derive(Debug, Clone, Copy)]
pub(super) enum One {
    Abs,
    Sqrt,
    Exp,
    Ln,
    Sin,
    Cos,
    Tan,
    Tanh,
    Atan,
    Sign,
    Step,
}

impl One {
    /// At a kink with the derivative of the branch taken; [`One::Sign`] and [`One::Step`] have none.
    pub fn of<T: Real>(self, x: T) -> T {
        match self {
            One::Abs => x.abs(),
            One::Sqrt => x.sqrt(),
            One::Exp => x.exp(),
            One::Ln => x.ln(),
            One::Sin => x.sin(),
            One::Cos => x.cos(),
            One::Tan => x.tan(),
            One::Tanh => x.tanh(),
            One::Atan => x.atan(),
            One::Sign if x.value() > 0.0 => T::one(),
            One::Sign if x.value() < 0.0 => -T::one(),
            One::Sign => T::zero(),
            One::Step => T::constant(if x.value() >= 0.0 { 1.0 } else { 0.0 }),
        }
    }
}

/// Functions of two arguments.
#[derive(Debug, Clone, Copy)]
pub(super) enum Two {
    Atan2,
    Min,
    Max,
    Hypot,
    Mod,
}

impl Two {
    pub fn of<T: Real>(self, a: T, b: T) -> T {
        match self {
            Two::Atan2 => a.atan2(b),
            Two::Min => a.min(b),
            Two::Max => a.max(b),
            Two::Hypot => a.hypot(b),
            Two::Mod => a.rem_euclid(b),
        }
    }
}
