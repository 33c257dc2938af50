//! From text to a checked program: `+ - * / ^`, parentheses, functions, numbers, names.

use super::channels::Channel;
use super::dimension::{Dimension, NONE};
use super::functions::{FUNCTIONS, One, Rule, Two};
use super::quantities::{Quantity, Scope, quantities, quantity};
use crate::impact::real::Real;
use crate::impact_table::OwnColumn;
use crate::near_names::near_names;

/// Longest expression, in bytes: room for any formula, no room for mischief.
const MAX_LENGTH: usize = 4096;
/// Deepest nesting of parentheses and powers; bounds recursion and the value stack.
const MAX_DEPTH: usize = 48;
/// Stands before the name of a column of the user's own.
const COLUMN: &str = "column";
/// Values an evaluation may hold at once.
const STACK: usize = 64;

/// What is wrong with an expression, and at which byte of it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SyntaxError {
    pub at: usize,
    pub message: String,
}

#[derive(Debug, Clone, Copy)]
pub(super) enum Op {
    Number(f64),
    Parameter(usize),
    Quantity(usize),
    /// The number in a column of the table's own.
    Column(OwnColumn),
    /// The replaced channel's value before.
    Own,
    Negate,
    Add,
    Subtract,
    Multiply,
    Divide,
    Power,
    One(One),
    Two(Two),
    /// Held between two others.
    Clamp,
}

impl Op {
    fn arguments(&self) -> usize {
        match self {
            Op::Number(_) | Op::Parameter(_) | Op::Quantity(_) | Op::Column(_) | Op::Own => 0,
            Op::Negate | Op::One(_) => 1,
            Op::Add | Op::Subtract | Op::Multiply | Op::Divide | Op::Power | Op::Two(_) => 2,
            Op::Clamp => 3,
        }
    }
}

/// A parsed and dimension-checked expression.
#[derive(Debug, Clone)]
pub struct Expression {
    program: Vec<Op>,
    uses_node: bool,
    own_columns: Vec<String>,
}

impl Expression {
    /// Parses and checks an expression that replaces `channel`, with the effect's own parameters `names`.
    ///
    /// # Errors
    /// Where and what: syntax, unknown names (with near matches), names not yet known, parameters named like quantities, dimensions that do
    /// not fit.
    pub fn parse(text: &str, channel: &Channel, names: &[&str]) -> Result<Self, SyntaxError> {
        if text.len() > MAX_LENGTH {
            return Err(SyntaxError { at: MAX_LENGTH, message: format!("{} bytes long; allowed: {MAX_LENGTH}", text.len()) });
        }
        let taken = |name: &str| {
            quantities().iter().any(|q| q.name == name) || FUNCTIONS.iter().any(|f| f.name == name) || name == channel.name || ["pi", COLUMN].contains(&name)
        };
        if let Some(name) = names.iter().find(|n| taken(n)) {
            return Err(SyntaxError { at: 0, message: format!("the parameter `{name}` would hide what is called so already; give it another name") });
        }
        let mut parser = Parser { text, at: 0, depth: 0, channel, names, program: Vec::new(), uses_node: false, own_columns: Vec::new() };
        let dimension = parser.sum()?;
        parser.skip_space();
        if parser.at < text.len() {
            return Err(parser.error(format!("an operator or the end expected here{}", parser.instead())));
        }
        if dimension.same(channel.dimension()).is_none() {
            return Err(SyntaxError { at: 0, message: format!("it has {dimension}, but `{}` has {}", channel.name, channel.dimension()) });
        }
        let expression = Expression { program: parser.program, uses_node: parser.uses_node, own_columns: parser.own_columns };
        match expression.most_values() {
            n if n + 2 <= STACK => Ok(expression),
            n => Err(SyntaxError { at: 0, message: format!("{n} values pending at once; allowed: {}; write it with fewer nested parts", STACK - 2) }),
        }
    }

    /// The largest number of values that an evaluation holds at once.
    fn most_values(&self) -> usize {
        let (mut now, mut most) = (0usize, 0);
        for op in &self.program {
            now = now + 1 - op.arguments();
            most = most.max(now);
        }
        most
    }

    /// Whether it needs the frame's node (and so the beam).
    pub(super) fn uses_node(&self) -> bool {
        self.uses_node
    }

    /// Whether the value of its own parameter at this place is asked for anywhere.
    pub(super) fn uses_parameter(&self, index: usize) -> bool {
        self.program.iter().any(|op| matches!(op, Op::Parameter(own) if *own == index))
    }

    /// The quantities that it asks for.
    pub(super) fn quantities(&self) -> impl Iterator<Item = &'static Quantity> {
        self.program.iter().filter_map(|op| if let Op::Quantity(i) = op { quantities().get(*i) } else { None })
    }

    /// The columns of a table that it asks for, beside the usual ones.
    pub fn own_columns(&self) -> &[String] {
        &self.own_columns
    }

    pub(super) fn value<T: Real>(&self, scope: &Scope<T>, own: T, p: &[T]) -> T {
        let mut stack = [T::zero(); STACK];
        let mut top = 0;
        for op in &self.program {
            top -= op.arguments();
            let (a, b, c) = (stack[top], stack[top + 1], stack[top + 2]);
            stack[top] = match *op {
                Op::Number(v) => T::constant(v),
                Op::Parameter(i) => p.get(i).copied().unwrap_or(T::constant(f64::NAN)),
                Op::Quantity(i) => quantity(i, scope),
                Op::Column(column) => T::constant(scope.at.input.own.get(column)),
                Op::Own => own,
                Op::Negate => -a,
                Op::Add => a + b,
                Op::Subtract => a - b,
                Op::Multiply => a * b,
                Op::Divide => a / b,
                Op::Power => a.powf(b),
                Op::One(f) => f.of(a),
                Op::Two(f) => f.of(a, b),
                Op::Clamp => a.max(b).min(c),
            };
            top += 1;
        }
        stack[0]
    }
}

struct Parser<'a> {
    text: &'a str,
    at: usize,
    depth: usize,
    channel: &'a Channel,
    names: &'a [&'a str],
    program: Vec<Op>,
    uses_node: bool,
    own_columns: Vec<String>,
}

impl<'a> Parser<'a> {
    fn error(&self, message: impl Into<String>) -> SyntaxError {
        SyntaxError { at: self.at, message: message.into() }
    }

    fn skip_space(&mut self) {
        self.at += self.text[self.at..].len() - self.text[self.at..].trim_start().len();
    }

    fn peek(&mut self) -> Option<char> {
        self.skip_space();
        self.text[self.at..].chars().next()
    }

    fn take(&mut self, wanted: char) -> bool {
        let found = self.peek() == Some(wanted);
        if found {
            self.at += wanted.len_utf8();
        }
        found
    }

    fn deeper(&mut self) -> Result<(), SyntaxError> {
        self.depth += 1;
        if self.depth > MAX_DEPTH {
            return Err(self.error(format!("nested too deeply; allowed: {MAX_DEPTH} levels")));
        }
        Ok(())
    }

    fn sum(&mut self) -> Result<Dimension, SyntaxError> {
        self.deeper()?;
        let mut left = self.product()?;
        loop {
            let start = self.at;
            let op = if self.take('+') {
                Op::Add
            } else if self.take('-') {
                Op::Subtract
            } else {
                break;
            };
            let right = self.product()?;
            left = left.same(right).ok_or_else(|| SyntaxError { at: start, message: format!("{left} and {right} cannot be added") })?;
            self.program.push(op);
        }
        self.depth -= 1;
        Ok(left)
    }

    fn product(&mut self) -> Result<Dimension, SyntaxError> {
        let mut left = self.signed()?;
        loop {
            let (op, sign) = if self.take('*') {
                (Op::Multiply, 1.0)
            } else if self.take('/') {
                (Op::Divide, -1.0)
            } else {
                return Ok(left);
            };
            left = left.times(self.signed()?, sign);
            self.program.push(op);
        }
    }

    fn signed(&mut self) -> Result<Dimension, SyntaxError> {
        let mut negative = false;
        loop {
            if self.take('-') {
                negative = !negative;
            } else if !self.take('+') {
                break;
            }
        }
        let dimension = self.power()?;
        if negative {
            self.program.push(Op::Negate);
        }
        Ok(dimension)
    }

    fn power(&mut self) -> Result<Dimension, SyntaxError> {
        let base = self.atom()?;
        if !self.take('^') {
            return Ok(base);
        }
        self.deeper()?;
        let start = self.at;
        let first = self.program.len();
        let exponent = self.signed()?; // right-associative, and -x is allowed as exponent
        self.depth -= 1;
        if exponent.same(NONE).is_none() {
            return Err(SyntaxError { at: start, message: format!("an exponent must have no dimension, this has {exponent}") });
        }
        // A fixed exponent carries the dimension along; a free one needs a base without dimension.
        let fixed = match self.program[first..] {
            [Op::Number(v)] => Some(v),
            [Op::Number(v), Op::Negate] => Some(-v),
            _ => None,
        };
        self.program.push(Op::Power);
        match fixed {
            Some(v) => Ok(base.power(v)),
            None if base.same(NONE).is_some() => Ok(base),
            None => Err(SyntaxError {
                at: start,
                message: format!("a power of something with {base} needs a number as exponent; divide it by a reference value first"),
            }),
        }
    }

    fn atom(&mut self) -> Result<Dimension, SyntaxError> {
        match self.peek() {
            Some('(') => {
                self.at += 1;
                let inside = self.sum()?;
                if self.take(')') { Ok(inside) } else { Err(self.error(format!("`)` expected here{}", self.instead()))) }
            }
            Some(c) if c.is_ascii_digit() || c == '.' => self.number(),
            Some(c) if c.is_ascii_alphabetic() || c == '_' => self.name(),
            Some(c) => Err(self.error(format!("`{c}` is not understood; a number, a name or `(` expected{}", self.instead()))),
            None => Err(self.error("it ends where a number, a name or `(` is expected")),
        }
    }

    /// How what stands here is written, for those who are used to other languages.
    fn instead(&self) -> &'static str {
        let rest = self.text[self.at..].trim_start();
        match rest.chars().next() {
            Some('*') => "; a power is written `a ^ b`",
            Some('×' | '·' | '(' | '_') => "; a product is written `a * b`",
            Some(c) if c.is_alphanumeric() => "; a product is written `a * b`",
            Some('−' | '–' | '—') => "; minus is written `-`",
            Some('÷') => "; a quotient is written `a / b`",
            Some('%') => "; a share is written as a number, 0.9",
            Some('<' | '>' | '=' | '!' | '?' | '&' | '|') => "; a condition is written `step(a - b)`: 1 where a >= b, 0 elsewhere",
            Some(',') => "; a decimal is written with a point, 0.5",
            _ => "",
        }
    }

    fn number(&mut self) -> Result<Dimension, SyntaxError> {
        let rest = &self.text.as_bytes()[self.at..];
        let mut n = 0;
        while n < rest.len() {
            let exponent_sign = (rest[n] == b'-' || rest[n] == b'+') && n > 0 && (rest[n - 1] | 32) == b'e';
            if !(rest[n].is_ascii_digit() || rest[n] == b'.' || (rest[n] | 32) == b'e' || exponent_sign) {
                break;
            }
            n += 1;
        }
        let digits = &self.text[self.at..self.at + n];
        let value = digits.parse::<f64>().ok().filter(|v| v.is_finite()).ok_or_else(|| self.error(format!("`{digits}` is no number")))?;
        self.at += n;
        self.program.push(Op::Number(value));
        Ok(Dimension::Any)
    }

    /// Letters, digits and low lines from here on.
    fn word(&mut self) -> &'a str {
        let text: &'a str = self.text;
        let rest = &text[self.at..];
        let n = rest.find(|c: char| !(c.is_ascii_alphanumeric() || c == '_')).unwrap_or(rest.len());
        self.at += n;
        &rest[..n]
    }

    /// What follows `column`: a point and the name of a column of the table. Its number takes whatever dimension is needed.
    fn column(&mut self, start: usize) -> Result<Dimension, SyntaxError> {
        let name = if self.text[self.at..].starts_with('.') {
            self.at += 1;
            self.word().to_owned()
        } else {
            String::new()
        };
        if name.is_empty() {
            let message = format!("the name of a column is missing: `{COLUMN}.NAME`, of letters, digits and low lines; another one cannot be used here");
            return Err(SyntaxError { at: start, message });
        }
        if let Some(usual) = quantities().iter().find(|q| q.name == name) {
            return Err(SyntaxError { at: start, message: format!("`{name}` is a quantity of every impact; write it without `{COLUMN}.`", name = usual.name) });
        }
        self.program.push(Op::Column(OwnColumn::named(&name)));
        self.own_columns.push(name);
        Ok(Dimension::Any)
    }

    fn name(&mut self) -> Result<Dimension, SyntaxError> {
        let start = self.at;
        let name = self.word();
        if name == COLUMN {
            return self.column(start);
        }
        if self.peek() == Some('(') {
            return self.call(name, start);
        }
        if let Some(i) = self.names.iter().position(|p| *p == name) {
            self.program.push(Op::Parameter(i));
            return Ok(Dimension::Any);
        }
        if name == self.channel.name {
            self.program.push(Op::Own);
            return Ok(self.channel.dimension());
        }
        if name == "pi" {
            self.program.push(Op::Number(std::f64::consts::PI));
            return Ok(NONE);
        }
        let Some((i, quantity)) = quantities().iter().enumerate().find(|(_, q)| q.name == name) else {
            let known = quantities().iter().map(|q| q.name).chain(self.names.iter().copied()).chain([self.channel.name]);
            let near = near_names(name, known);
            return Err(SyntaxError {
                at: start,
                message: format!(
                    "no quantity or parameter `{name}`{near}; `sweetspot effects --quantities` lists them, and a column of your own in the table is \
                     written `{COLUMN}.NAME`"
                ),
            });
        };
        if quantity.stage > self.channel.stage() {
            return Err(SyntaxError { at: start, message: format!("`{name}` is not known yet where `{}` is replaced", self.channel.name) });
        }
        self.uses_node |= name == "node_distance";
        self.program.push(Op::Quantity(i));
        Ok(quantity.dimension())
    }

    fn call(&mut self, name: &str, start: usize) -> Result<Dimension, SyntaxError> {
        let Some(function) = FUNCTIONS.iter().find(|f| f.name == name) else {
            let known: Vec<&str> = FUNCTIONS.iter().map(|f| f.name).collect();
            return Err(SyntaxError { at: start, message: format!("no function `{name}`; there are: {}", known.join(", ")) });
        };
        let wanted = function.op.arguments();
        self.take('(');
        let mut dimension = Dimension::Any;
        for i in 0..wanted {
            if i > 0 && !self.take(',') {
                return Err(self.error(format!("`{name}` takes {wanted} arguments; `,` expected here")));
            }
            let argument = self.sum()?;
            if function.rule == Rule::Pure && argument.same(NONE).is_none() {
                return Err(SyntaxError { at: start, message: format!("`{name}` needs an argument without dimension, this has {argument}") });
            }
            dimension = dimension
                .same(argument)
                .ok_or_else(|| SyntaxError { at: start, message: format!("the arguments of `{name}` have {dimension} and {argument}") })?;
        }
        if !self.take(')') {
            // A comma here is one argument too many, no decimal comma.
            let instead = if self.peek() == Some(',') { "" } else { self.instead() };
            return Err(self.error(format!("`)` expected here; `{name}` takes {wanted} argument{}{instead}", if wanted == 1 { "" } else { "s" })));
        }
        if let (Op::Clamp, [.., Op::Number(low), Op::Number(high)]) = (function.op, self.program.as_slice())
            && low > high
        {
            return Err(SyntaxError {
                at: start,
                message: format!("`{name}` takes a value, the least and the most it may be, in this order; {low} is more than {high}"),
            });
        }
        self.program.push(function.op);
        Ok(match function.rule {
            Rule::Pure | Rule::Drops => NONE,
            Rule::Keeps => dimension,
            Rule::Root => dimension.power(0.5),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::channel;
    use super::*;
    use crate::impact::rigid::tests::{prepared, reference_input};
    use crate::impact::rigid::{Contact, Laws, Sliding};
    use crate::impact::{Base, Model};

    fn parse(text: &str) -> Result<Expression, SyntaxError> {
        Expression::parse(text, channel("restitution").expect("known"), &["k", "v0"])
    }

    fn value(text: &str) -> f64 {
        let model = prepared(&Model::new(Base::Rigid));
        let body = model.body().clone();
        let at = Contact::new(&body, &reference_input()).expect("contact");
        let laws = Laws::new(0.8, 0.45, Sliding::FirstTouch, body.ball_radius, body.ball_inertia);
        let scope = Scope { at: &at, body: &body, laws: Some(&laws), impulse: None, output: None };
        parse(text).expect(text).value(&scope, 0.8, &[0.5, 20.0])
    }

    #[test]
    fn truth_values() {
        for (text, expected) in [
            ("1 + 2 * 3 ^ 2 / 6", 4.0),
            ("2 ^ 3 ^ 2", 512.0),
            ("-2 ^ 2", -4.0),
            ("2 ^ -1", 0.5),
            ("1 - - 2", 3.0),
            ("(1 - 2) * -3", 3.0),
            ("1.5e1 + .5E-1", 15.05),
            ("restitution * (1 - k * (impact_y / 0.13)^2)", 0.8 * (1.0 - 0.5 * (0.03f64 / 0.13).powi(2))),
            ("max(1, 2) + min(3, hypot(3, 4)) + clamp(7, 0, 1)", 6.0),
            ("sqrt(approach_speed / 25) + ln(exp(1)) + sign(-3) + step(0)", (37.06f64 / 25.0).sqrt() + 1.0),
            ("approach_speed / v0", 37.06 / 20.0),
            ("tanh(0) + abs(-2) + mod(7, 4) + sin(0) + cos(pi)", 4.0),
        ] {
            assert!((value(text) - expected).abs() < 1e-12, "{text} = {}", value(text));
        }
    }

    #[test]
    fn fails_with_place_and_reason() {
        for (text, at, word) in [
            ("restitution + approach_speed", 12, "cannot be added"),
            ("approach_speed", 0, "has m s^-1, but `restitution`"),
            ("exp(slip_speed)", 0, "without dimension"),
            ("restitution ^ slip_speed", 13, "exponent"),
            ("(approach_speed ^ k) / 3", 17, "reference value"),
            ("restituton * 2", 0, "did you mean `restitution`"),
            ("1 +", 3, "ends"),
            ("2 3", 2, "operator"),
            ("(1", 2, "`)`"),
            ("sqr(2)", 0, "there are"),
            ("max(1)", 5, "2 arguments"),
            ("1 $ 2", 2, "operator"),
            ("k ** 2", 3, "`a ^ b`"),
            ("step(k > 1)", 7, "`step(a - b)`"),
            ("0,5 * k", 1, "with a point"),
            ("ball_age * k", 0, "effects --quantities"),
            ("ball_out_vz / 10", 0, "not known yet"),
            ("1..2", 0, "no number"),
        ] {
            let e = parse(text).expect_err(text);
            assert!(e.at == at && e.message.contains(word), "{text}: {e:?}");
        }
        assert!(parse(&"(".repeat(3000)).expect_err("deep").message.contains("nested"));
        assert!(parse(&"-".repeat(4000)).expect_err("no end").message.contains("ends"));
        assert!(parse(&"1+".repeat(3000)).expect_err("long").message.contains("allowed"));
        assert!(parse(&format!("{}1", "2^".repeat(500))).expect_err("deep").message.contains("nested"));
        assert!(parse(&format!("{}1{}", "1+2*clamp(1,1,".repeat(20), ")".repeat(20))).expect_err("wide").message.contains("pending"));
        assert!(parse("é").is_err() && parse("1 + é").is_err());
    }
}
