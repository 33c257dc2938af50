//! A user's expression as an effect among the others.

use super::channels::{Access, Channel, channel, channels};
use super::parse::Expression;
use super::quantities::{Scope, Stage};
use crate::impact::body::Body;
use crate::impact::effects::Effect;
use crate::impact::error::ModelError;
use crate::impact::input::ImpactOutput;
use crate::impact::model::Base;
use crate::impact::real::Real;
use crate::impact::rigid::{Contact, Impulse, Laws};
use crate::impact::viscoelastic;
use crate::near_names::near_names;
use nalgebra::Vector3;
use std::fmt;

/// One channel replaced by an expression.
pub struct ExpressionEffect {
    text: String,
    expression: Expression,
    channel: &'static Channel,
}

impl fmt::Debug for ExpressionEffect {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} = {}", self.channel.name, self.text)
    }
}

impl ExpressionEffect {
    /// Parses and checks the expression of effect `name`; `parameters` are its own, in the order of their values.
    ///
    /// # Errors
    /// [`ModelError::Value`]-like complaints about `replaces`, [`ModelError::Expression`] with the place in the text.
    pub fn new(name: &str, replaces: &str, text: &str, parameters: &[&str]) -> Result<Self, ModelError> {
        let wrong = |at: usize, message: String| ModelError::Expression {
            effect: name.to_owned(),
            expression: text.replace('\n', " "),
            marker: format!("{}^", " ".repeat(text.char_indices().take_while(|(i, _)| *i < at).count())),
            message,
        };
        let channel = channel(replaces).ok_or_else(|| {
            let known: Vec<&str> = channels().iter().map(|c| c.name).collect();
            wrong(0, format!("`replaces = {replaces:?}`{}; it can be: {}", near_names(replaces, known.iter().copied()), known.join(", ")))
        })?;
        let expression = Expression::parse(text, channel, parameters).map_err(|e| wrong(e.at, e.message))?;
        Ok(ExpressionEffect { text: text.to_owned(), expression, channel })
    }

    /// The columns of a table that it asks for, beside the usual ones.
    pub fn own_columns(&self) -> impl Iterator<Item = &str> {
        self.expression.own_columns().iter().map(String::as_str)
    }

    /// Whether its own parameter at this place, in the order given to [`Self::new`], stands in the expression.
    pub(crate) fn uses_parameter(&self, index: usize) -> bool {
        self.expression.uses_parameter(index)
    }

    /// Why the base does not have it; `None` where it does.
    pub(crate) fn missing_in(&self, base: Base) -> Option<String> {
        if !self.channel.is_in(base) {
            let there: Vec<&str> = channels().iter().filter(|c| c.is_in(base)).map(|c| c.name).collect();
            return Some(format!("`{}` is not a quantity of that base; there `replaces` can be: {}", self.channel.name, there.join(", ")));
        }
        let early = base == Base::Viscoelastic && self.channel.viscoelastic_law::<f64>().is_some();
        let unknown = self.expression.quantities().find(|q| early && q.stage != Stage::Body)?;
        Some(format!("`{}` is what a stepped contact comes to, and not known where `{}` is replaced", unknown.name, self.channel.name))
    }
}

impl<T: Real> Effect<T> for ExpressionEffect {
    fn needs_beam(&self) -> bool {
        self.expression.uses_node()
    }

    fn body_varies(&self) -> bool {
        matches!(self.channel.access::<T>(), Access::Body(..))
    }

    fn change_body_at(&self, p: &[T], at: &Contact<T>, body: &mut Body<T>) {
        if let Access::Body(get, set) = self.channel.access::<T>() {
            let value = self.expression.value(&Scope { at, body, laws: None, impulse: None, output: None }, get(body), p);
            set(body, value);
        }
    }

    fn change_laws(&self, p: &[T], at: &Contact<T>, laws: &mut Laws<T>) {
        if let Access::Laws(get, set) = self.channel.access::<T>() {
            let value = self.expression.value(&Scope { at, body: at.body, laws: Some(laws), impulse: None, output: None }, get(laws), p);
            set(laws, value);
        }
    }

    fn change_viscoelastic(&self, p: &[T], at: &Contact<T>, laws: &mut viscoelastic::Laws<T>) {
        if let Some((get, set)) = self.channel.viscoelastic_law::<T>() {
            let value = self.expression.value(&Scope { at, body: at.body, laws: None, impulse: None, output: None }, get(laws), p);
            set(laws, value);
        }
    }

    fn change_viscoelastic_impulse(&self, p: &[T], at: &Contact<T>, laws: &mut Laws<T>, impulse: &mut Impulse<T>) {
        if self.channel.is_restitution() {
            let before = laws.effective_restitution();
            self.change_laws(p, at, laws);
            let more = (laws.effective_restitution() - before) * at.approach_speed / at.normal_compliance;
            impulse.shift(at, laws, Vector3::new(T::zero(), T::zero(), more * at.side));
        } else {
            self.change_impulse(p, at, laws, impulse);
        }
    }

    fn change_impulse(&self, p: &[T], at: &Contact<T>, laws: &Laws<T>, impulse: &mut Impulse<T>) {
        if let Access::Impulse(get, set) = self.channel.access::<T>() {
            let own = get(at, impulse);
            let value = self.expression.value(&Scope { at, body: at.body, laws: Some(laws), impulse: Some(impulse), output: None }, own, p);
            set(at, laws, impulse, value);
        }
    }

    fn change_output(&self, p: &[T], at: &Contact<T>, laws: &Laws<T>, impulse: &Impulse<T>, output: &mut ImpactOutput<T>) {
        if let Access::Output(get, set) = self.channel.access::<T>() {
            let own = get(output);
            let value = self.expression.value(&Scope { at, body: at.body, laws: Some(laws), impulse: Some(impulse), output: Some(output) }, own, p);
            set(output, value);
        }
    }
}
