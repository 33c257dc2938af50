//! A model: a base, its parameters, and the effects added to it.

use super::body::Body;
use super::card::{EffectCard, ParameterCard};
use super::effects::{DifferentiableEffect, catalogue, effect_card};
use super::error::ModelError;
use super::expression::ExpressionEffect;
use super::parameter::Parameter;
use super::prepared_model::PreparedModel;
use super::rigid::Sliding;
use super::viscoelastic::{BallLaw, ContactLaws, StringLaw};
use crate::equipment::{Ball, Racket};
use crate::impact_table::MOST_OWN_COLUMNS;
use crate::near_names::near_names;
use std::ops::Range;
use std::sync::Arc;

/// Which equations stand below the effects.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Base {
    /// One impulse between two rigid bodies.
    Rigid,
    /// Ball and stringbed deform; six degrees of freedom, stepped through time.
    Viscoelastic,
}

impl Base {
    pub fn name(self) -> &'static str {
        match self {
            Base::Rigid => "rigid",
            Base::Viscoelastic => "viscoelastic",
        }
    }

    /// The base's parameters with their documented defaults.
    pub fn parameters(self) -> &'static [ParameterCard] {
        match self {
            Base::Rigid => &RIGID,
            Base::Viscoelastic => &VISCOELASTIC,
        }
    }
}

static RIGID: [ParameterCard; 2] = [
    ParameterCard::base("restitution", "", "normal relative speed after over before, at the contact point", 0.8, (0.0, 1.0), 0.05),
    ParameterCard::base("friction", "", "Coulomb coefficient of ball on strings", 0.45, (0.0, 5.0), 0.1),
];

/// Where `mu` stands among the visco-elastic base's parameters.
pub(super) const MU: usize = 9;

static VISCOELASTIC: [ParameterCard; 14] = [
    ParameterCard::base("k_B0", "N/m", "ball stiffness at first touch", 24e3, (1e3, 1e6), 3e3),
    ParameterCard::base("A_K", "N/m^(1+alpha)", "growth of the ball's stiffness with its compression", 6.3e7, (0.0, 1e10), 1e7),
    ParameterCard::base("alpha", "", "power of that growth", 2.0, (0.5, 4.0), 0.3),
    ParameterCard::base("A_C", "N s/m^3", "ball damping per contact area", 1393.0, (0.0, 1e5), 300.0),
    ParameterCard::base("beta_c", "", "power of the contact area in the damping", 2.0, (0.0, 4.0), 0.5),
    ParameterCard::base("c_B0", "N s/m", "constant ball damping", 4.6, (0.0, 100.0), 2.0),
    ParameterCard::base("kS0", "N/m", "stringbed stiffness; from the string tension when left out", 39e3, (5e3, 5e5), 4e3),
    ParameterCard::base("kS2", "N/m^3", "stiffening of the stringbed with deflection", 25e6, (0.0, 1e9), 8e6),
    ParameterCard::base("c_S", "N s/m", "string damping (at least 0.1 acts while the ball's own grows in from nothing)", 2.0, (0.0, 100.0), 1.5),
    ParameterCard::base("mu", "", "Coulomb coefficient of ball on strings", 0.5, (0.0, 5.0), 0.1),
    ParameterCard::base("lambda_r", "", "share of the compression by which the torque arm shortens", 0.5, (0.0, 1.0), 0.3),
    ParameterCard::base("kappa_I", "1/m", "relative fall of the ball's inertia per metre of compression", 5.0, (0.0, 20.0), 3.0),
    ParameterCard::base("k_t", "N/m", "sideways stiffness of the strings; 0: rigid sideways", 0.0, (0.0, 1e6), 3e4),
    ParameterCard::base("c_t", "N s/m", "sideways damping of the strings", 20.0, (0.1, 1e3), 10.0),
];

/// An effect in a model: its name, what it does, and where its parameters stand in the flat list.
#[derive(Debug, Clone)]
pub struct AddedEffect {
    pub name: String,
    /// The catalogue's card; `None` for a user's own effect.
    pub card: Option<&'static EffectCard>,
    /// The user's expression, when it is one.
    pub expression: Option<Arc<ExpressionEffect>>,
    held: Held,
    pub(super) range: Range<usize>,
}

/// Where an effect lives.
#[derive(Debug, Clone)]
enum Held {
    OfCatalogue(&'static dyn DifferentiableEffect),
    Own(Arc<dyn DifferentiableEffect>),
}

impl AddedEffect {
    /// What it does.
    pub(super) fn effect(&self) -> &(dyn DifferentiableEffect + 'static) {
        match &self.held {
            Held::OfCatalogue(effect) => *effect,
            Held::Own(effect) => &**effect,
        }
    }
}

/// A base with parameters and effects. Cheap to clone; set values by name or index.
#[derive(Debug, Clone)]
pub struct Model {
    pub(super) base: Base,
    pub(super) sliding: Sliding,
    pub(super) contact_laws: ContactLaws,
    /// Base parameters first, then each effect's, in the effects' order.
    parameters: Vec<Parameter>,
    /// In the catalogue's order, then the user's own by name.
    pub(super) effects: Vec<AddedEffect>,
    /// Whether the stringbed's stiffness follows from racket.toml's tension (`kS0` left out).
    pub(super) stiffness_from_tension: bool,
}

impl Model {
    /// The base alone, at its documented defaults.
    pub fn new(base: Base) -> Self {
        Model {
            base,
            sliding: Sliding::FirstTouch,
            contact_laws: ContactLaws::default(),
            parameters: base.parameters().iter().map(|c| Parameter::from_card(None, c)).collect(),
            effects: Vec::new(),
            stiffness_from_tension: true,
        }
    }

    pub fn base(&self) -> Base {
        self.base
    }

    pub fn set_sliding(&mut self, sliding: Sliding) {
        self.sliding = sliding;
    }

    /// Which published laws the visco-elastic contact follows; without meaning in base rigid.
    pub fn contact_laws(&self) -> ContactLaws {
        self.contact_laws
    }

    /// Changes release, place of the normal force and direction of friction; see [`Model::set_ball_law`] for the others.
    pub fn contact_laws_mut(&mut self) -> &mut ContactLaws {
        &mut self.contact_laws
    }

    /// Gives the ball another law: parameters it replaces take that law's defaults, and the contact ends as that law has it.
    ///
    /// # Errors
    /// [`ModelError::UnknownParameter`] in base rigid, which has no such parameters.
    pub fn set_ball_law(&mut self, law: BallLaw) -> Result<(), ModelError> {
        for (name, value) in law.defaults() {
            self.set(name, *value)?;
        }
        self.contact_laws.ball = law;
        self.contact_laws.release = law.release();
        Ok(())
    }

    /// Gives the stringbed another law, as [`Model::set_ball_law`].
    ///
    /// # Errors
    /// As [`Model::set_ball_law`].
    pub fn set_string_law(&mut self, law: StringLaw) -> Result<(), ModelError> {
        for (name, value) in law.defaults() {
            self.set(name, *value)?;
        }
        self.contact_laws.strings = law;
        Ok(())
    }

    /// All parameters: the base's, then each effect's.
    pub fn parameters(&self) -> &[Parameter] {
        &self.parameters
    }

    /// One parameter's settings (`fit`, bounds, typical size), to change them. Values go through [`Model::set`].
    pub fn parameter_mut(&mut self, index: usize) -> Option<&mut Parameter> {
        self.parameters.get_mut(index)
    }

    /// Where a parameter stands in [`Model::parameters`].
    ///
    /// # Errors
    /// [`ModelError::UnknownParameter`], naming near matches.
    pub fn index_of(&self, name: &str) -> Result<usize, ModelError> {
        self.parameters.iter().position(|p| p.name == name).ok_or_else(|| {
            let known = self.parameters.iter().map(|p| p.name.as_str());
            ModelError::UnknownParameter { name: name.to_owned(), near: near_names(name, known.clone()), known: known.collect::<Vec<_>>().join(", ") }
        })
    }

    /// Sets a parameter by name.
    ///
    /// # Errors
    /// Unknown name; a value that is not finite. Bounds are the fit's business: derivatives step across them.
    pub fn set(&mut self, name: &str, value: f64) -> Result<(), ModelError> {
        let index = self.index_of(name)?;
        self.set_at(index, value)
    }

    /// Sets a parameter by its place in [`Model::parameters`].
    ///
    /// # Errors
    /// As [`Model::set`].
    pub fn set_at(&mut self, index: usize, value: f64) -> Result<(), ModelError> {
        let Some(p) = self.parameters.get_mut(index) else {
            return Err(ModelError::UnknownParameter {
                name: format!("number {index}"),
                near: String::new(),
                known: format!("0 to {}", self.parameters.len()),
            });
        };
        if !value.is_finite() {
            return Err(ModelError::ParameterRange { name: p.name.clone(), seen: value, min: p.min, max: p.max });
        }
        p.value = value;
        if p.name == "kS0" {
            self.stiffness_from_tension = false;
        }
        Ok(())
    }

    /// All values, in the order of [`Model::parameters`].
    pub fn values(&self) -> Vec<f64> {
        self.parameters.iter().map(|p| p.value).collect()
    }

    /// Effects in the order in which they act.
    pub fn effects(&self) -> &[AddedEffect] {
        &self.effects
    }

    /// Whether the stringbed's stiffness is the one that the racket's tension gives.
    pub fn takes_tension(&self) -> bool {
        self.base == Base::Viscoelastic && self.stiffness_from_tension
    }

    /// The columns of a table that its expressions ask for, beside the usual ones.
    pub fn own_columns(&self) -> Vec<&str> {
        let mut names: Vec<&str> = self.effects.iter().filter_map(|e| e.expression.as_ref()).flat_map(|e| e.own_columns()).collect();
        names.sort_unstable();
        names.dedup();
        names
    }

    pub fn has_effect(&self, name: &str) -> bool {
        self.effects.iter().any(|e| e.name == name)
    }

    /// The parameters of one effect, as indices into [`Model::parameters`]; empty when the model does not have it.
    pub fn effect_parameters(&self, name: &str) -> Range<usize> {
        self.effects.iter().find(|e| e.name == name).map_or(0..0, |e| e.range.clone())
    }

    /// The model with a catalogue effect added at its card's defaults.
    ///
    /// # Errors
    /// [`ModelError::UnknownEffect`] with near matches, [`ModelError::EffectTwice`].
    pub fn with_effect(&self, name: &str) -> Result<Model, ModelError> {
        let card = effect_card(name).ok_or_else(|| ModelError::unknown_effect(name))?;
        let parameters = card.parameters.iter().map(|c| Parameter::from_card(Some(name), c).in_base(self.base, c)).collect();
        self.with(name, Some(card), Held::OfCatalogue(card.effect), parameters)
    }

    /// The model with an effect written in Rust; `parameters` are named `<name>.<key>` and passed to it in this order.
    ///
    /// # Errors
    /// [`ModelError::EffectTwice`].
    pub fn with_own_effect(&self, name: &str, effect: Arc<dyn DifferentiableEffect>, parameters: Vec<Parameter>) -> Result<Model, ModelError> {
        self.with(name, None, Held::Own(effect), parameters)
    }

    fn with(&self, name: &str, card: Option<&'static EffectCard>, held: Held, parameters: Vec<Parameter>) -> Result<Model, ModelError> {
        if self.has_effect(name) {
            return Err(ModelError::EffectTwice { name: name.to_owned() });
        }
        let place = |card: Option<&'static EffectCard>, name: &str| -> (usize, String) {
            (card.map_or(usize::MAX, |c| catalogue().iter().position(|k| k.name == c.name).unwrap_or(usize::MAX)), name.to_owned())
        };
        let own = place(card, name);
        let at = self.effects.iter().position(|e| place(e.card, &e.name) > own).unwrap_or(self.effects.len());
        let first = self.effects.get(at).map_or(self.parameters.len(), |e| e.range.start);
        let count = parameters.len();
        let mut model = self.clone();
        model.parameters.splice(first..first, parameters);
        for e in &mut model.effects[at..] {
            e.range = e.range.start + count..e.range.end + count;
        }
        model.effects.insert(at, AddedEffect { name: name.to_owned(), card, expression: None, held, range: first..first + count });
        Ok(model)
    }

    /// The model with an effect given as an expression (see [`super::expression`]); `parameters` are its own, by bare name.
    ///
    /// # Errors
    /// [`ModelError::Expression`] with the place, [`ModelError::EffectTwice`], a catalogue name.
    pub fn with_expression(&self, name: &str, replaces: &str, expression: &str, mut parameters: Vec<Parameter>) -> Result<Model, ModelError> {
        if effect_card(name).is_some() {
            return Err(ModelError::EffectTwice { name: name.to_owned() });
        }
        let names: Vec<String> = parameters.iter().map(|p| p.key().to_owned()).collect();
        let names: Vec<&str> = names.iter().map(String::as_str).collect();
        let effect = Arc::new(ExpressionEffect::new(name, replaces, expression, &names)?);
        if let Some(reason) = effect.missing_in(self.base) {
            return Err(ModelError::NotInBase { name: name.to_owned(), base: self.base.name(), reason });
        }
        for p in &mut parameters {
            p.name = format!("{name}.{}", p.key());
        }
        let mut model = self.with(name, None, Held::Own(effect.clone()), parameters)?;
        if let Some(added) = model.effects.iter_mut().find(|e| e.name == name) {
            added.expression = Some(effect);
        }
        match model.own_columns().len() {
            n if n > MOST_OWN_COLUMNS => Err(ModelError::TooManyColumns { seen: n, most: MOST_OWN_COLUMNS }),
            _ => Ok(model),
        }
    }

    /// The model made ready for one racket and ball: bodies changed by the effects, frame modes computed.
    ///
    /// # Errors
    /// Bodies that cannot be; an effect that does not exist in this base.
    pub fn prepare(&self, racket: &Racket, ball: &Ball) -> Result<PreparedModel, ModelError> {
        PreparedModel::new(self.clone(), Body::new(racket, ball)?)
    }
}
