//! What the statistics need of a model: free parameters in, predictions out. Nothing else of it is known here.

use super::error::ValidationError;
use crate::impact_table::OwnColumns;
use crate::impact_table::{INPUTS, OUTPUTS};

/// The inputs of one impact in the order of [`INPUTS`], SI, racket-local.
pub type Inputs = [f64; INPUTS.len()];
/// The outputs of one impact in the order of [`OUTPUTS`]; NaN where the model has none (contact time of a rigid base).
pub type Outputs = [f64; OUTPUTS.len()];

/// A parameter the fit may move.
#[derive(Debug, Clone, PartialEq)]
pub struct FreeParameter {
    pub name: String,
    pub value: f64,
    pub min: f64,
    pub max: f64,
    /// Size of a typical change: sets the step of numerical derivatives.
    pub typical: f64,
    /// `None`: a flat one.
    pub prior: Option<Prior>,
}

/// Share of its range within which a parameter is at a limit: a fit comes near to one by steps that grow smaller.
const AT_LIMIT: f64 = 1e-6;

impl FreeParameter {
    /// The limit at which a value lies: 1 the upper one, -1 the lower one.
    pub fn limit_at(&self, value: f64) -> Option<f64> {
        let room = AT_LIMIT * (self.max - self.min).abs();
        if value >= self.max - room {
            Some(1.0)
        } else if value <= self.min + room {
            Some(-1.0)
        } else {
            None
        }
    }
}

/// What is known of a parameter beforehand.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Prior {
    pub mean: f64,
    pub sd: f64,
    pub tails: Tails,
}

/// How much a value far from the prior's mean pays. Near the mean all keep in place what the impacts do not tell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Tails {
    /// By the square.
    Normal,
    /// Student's t of `STUDENT` degrees of freedom: a strength of many typical sizes is rare, but no miracle.
    Student,
    /// By the logarithm: hardly anything draws back what the impacts do tell.
    Wide,
}

/// Degrees of freedom of [`Tails::Student`].
const STUDENT: f64 = 4.0;

impl Prior {
    /// Minus twice the log density at a value, without the constant.
    pub fn cost(&self, value: f64) -> f64 {
        let away = ((value - self.mean) / self.sd).powi(2);
        match self.tails {
            Tails::Normal => away,
            Tails::Student => (STUDENT + 1.0) * (away / STUDENT).ln_1p(),
            Tails::Wide => away.ln_1p(),
        }
    }

    /// What draws a value back, per distance from the mean: half the slope of the cost.
    pub fn precision(&self, value: f64) -> f64 {
        let away = ((value - self.mean) / self.sd).powi(2);
        let share = match self.tails {
            Tails::Normal => 1.0,
            Tails::Student => (STUDENT + 1.0) / (STUDENT + away),
            Tails::Wide => 1.0 / (1.0 + away),
        };
        share / (self.sd * self.sd)
    }
}

/// A family of models over its free parameters.
pub trait Forward: Sync {
    /// The free parameters, in a fixed order, with their starting values.
    fn parameters(&self) -> &[FreeParameter];

    /// The model with these values, made ready once for all impacts.
    fn prepare(&self, values: &[f64]) -> Result<Box<dyn Prediction + '_>, ValidationError>;

    /// Where a free parameter stands, by its name.
    fn place_of(&self, parameter: &str) -> Option<usize> {
        self.parameters().iter().position(|p| p.name == parameter)
    }

    /// Whether one prediction costs so much that input derivatives should be reused between steps (time stepping).
    fn costly(&self) -> bool {
        false
    }
}

/// A model with all its parameters set.
pub trait Prediction: Sync {
    /// Predicts one impact. `None` when the model has no answer (the ball does not approach).
    fn predict(&self, asked: &Asked) -> Option<Outputs>;

    /// Why an impact has no answer, where the model can tell.
    fn why_not(&self, _asked: &Asked) -> Option<String> {
        None
    }

    /// Predicts several impacts, in their order; a model that steps in time does it side by side.
    fn predict_many(&self, asked: &[Asked]) -> Vec<Option<Outputs>> {
        asked.iter().map(|a| self.predict(a)).collect()
    }

    /// Where the model jumps and nature does not: by how much its prediction may be off, one deviation, all outputs together.
    fn jump(&self, _asked: &Asked) -> Option<Outputs> {
        None
    }
}

/// An impact to be predicted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Asked {
    /// Index of its (racket, ball) pair.
    pub gear: usize,
    /// Its place in time, 0 first.
    pub order: f64,
    /// Numbers in columns of the user's own.
    pub own: OwnColumns,
    pub inputs: Inputs,
}

/// A strength of an effect: how much of it there is.
#[derive(Debug, Clone, PartialEq)]
pub struct Strength {
    /// The free parameter's name in the model with the effect.
    pub parameter: String,
    /// Value at which the prediction is that without the effect.
    pub absent: f64,
    pub typical: f64,
    /// As its card has it: on the usual side of `absent`.
    pub usual: f64,
    /// Physically only on one side of `absent` (above it).
    pub one_sided: bool,
    /// Above `absent`, though a fit may go below: that says something else is at work.
    pub one_way: bool,
    /// Small ones are not near `absent`: their signature is that of a typical size.
    pub jumps: bool,
}

/// A number that a model holds fixed: a strength of an effect, or of its base what no effect of the catalogue is a law of.
#[derive(Debug, Clone, PartialEq)]
pub struct Fixed {
    /// The parameter's full name, in its own unit.
    pub parameter: String,
    pub value: f64,
    pub of_base: bool,
}

/// What is known of an effect before it is added.
#[derive(Debug, Clone, PartialEq)]
pub struct EffectOutline {
    pub name: String,
    /// "physics" or "measurement".
    pub kind: &'static str,
    pub strengths: Vec<Strength>,
    pub confused_with: Vec<String>,
    pub separated_by: String,
    /// What is no effect and looks much like it.
    pub check_first: Option<&'static str>,
    /// Why it cannot be added to this model, when it cannot (there already, not in this base).
    pub excluded: Option<String>,
}

impl EffectOutline {
    /// Whether there is something of it that a model can be given.
    pub fn can_be_added(&self) -> bool {
        self.excluded.is_none() && !self.strengths.is_empty()
    }
}

/// The models that can be reached from the current one by adding effects.
pub trait Library: Sync {
    /// The current model.
    fn current(&self) -> &dyn Forward;

    /// Every effect of the catalogue, in a fixed order.
    fn effects(&self) -> &[EffectOutline];

    /// What is known of an effect of the catalogue, by its name.
    fn outline(&self, effect: &str) -> Option<&EffectOutline> {
        self.effects().iter().find(|o| o.name == effect)
    }

    /// The current model with these effects. Its parameters are the current ones first, in the same order, then those of
    /// each effect in the order given: strengths as outlined, at `absent`, then shapes that the fit may move.
    fn with(&self, effects: &[&str]) -> Result<Box<dyn Forward + '_>, ValidationError>;

    /// The library that stands on the current model with these effects, its free parameters (as [`Library::with`] orders
    /// them) at `values`.
    fn extended(&self, effects: &[&str], values: &[f64]) -> Result<Box<dyn Library + '_>, ValidationError>;

    /// The same with those numbers of the current model fitted that it holds fixed, and these with their values; `None` where there are none.
    fn with_fixed_freed(&self) -> Option<(Box<dyn Library + '_>, Vec<Fixed>)> {
        None
    }

    /// Whether the current model has an effect of that name, a user's own included.
    fn has_effect(&self, name: &str) -> bool;

    /// The same plus the user's own effect: an expression that replaces a quantity, with parameters that start at 0.
    fn with_expression(&self, effects: &[&str], expressions: &[OwnEffect]) -> Result<Box<dyn Forward + '_>, ValidationError>;
}

/// An effect written as an expression, as the model file holds it.
#[derive(Debug, Clone, PartialEq)]
pub struct OwnEffect {
    pub name: String,
    pub replaces: String,
    pub expression: String,
    /// Name and typical size of each parameter; all start at 0.
    pub parameters: Vec<(String, f64)>,
}
