//! A model: a base, its parameters, and the effects added to it; and the model made ready for one racket and ball.

use super::body::Body;
use super::card::{EffectCard, ParameterCard};
use super::effects::{Effect, catalogue, effect_card};
use super::error::{ModelError, near_matches};
use super::expression::ExpressionEffect;
use super::input::{ImpactInput, ImpactOutput};
use super::parameter::Parameter;
use super::rigid::{Contact, Impulse, Laws, Regime, Sliding, collide};
use super::viscoelastic::{self, BallLaw, ContactLaws, DEFAULT_STEPS, Ready, Run, StringLaw};
use crate::equipment::{Ball, Racket};
use nalgebra::Vector3;
use rayon::prelude::*;
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

static VISCOELASTIC: [ParameterCard; 14] = [
    ParameterCard::base("k_B0", "N/m", "ball stiffness at first touch", 24e3, (1e3, 1e6), 3e3),
    ParameterCard::base("A_K", "N/m^(1+alpha)", "growth of the ball's stiffness with its compression", 6.3e7, (0.0, 1e10), 1e7),
    ParameterCard::base("alpha", "", "power of that growth", 2.0, (0.5, 4.0), 0.3),
    ParameterCard::base("A_C", "N s/m^3", "ball damping per contact area", 1393.0, (0.0, 1e5), 300.0),
    ParameterCard::base("beta_c", "", "power of the contact area in the damping", 2.0, (0.0, 4.0), 0.5),
    ParameterCard::base("c_B0", "N s/m", "constant ball damping", 4.6, (0.0, 100.0), 2.0),
    ParameterCard::base("kS0", "N/m", "stringbed stiffness; from the string tension when left out", 39e3, (5e3, 5e5), 4e3),
    ParameterCard::base("kS2", "N/m^3", "stiffening of the stringbed with deflection", 25e6, (0.0, 1e9), 8e6),
    ParameterCard::base("c_S", "N s/m", "string damping", 2.0, (0.0, 100.0), 1.5),
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
    effect: Arc<dyn Effect>,
    range: Range<usize>,
}

/// Delegates to the catalogue's own instance, so that all effects are held alike.
#[derive(Debug)]
struct OfCatalogue(&'static EffectCard);

impl Effect for OfCatalogue {
    fn change_body(&self, p: &[f64], body: &mut Body) {
        self.0.effect.change_body(p, body);
    }
    fn change_body_at(&self, p: &[f64], at: &Contact, body: &mut Body) {
        self.0.effect.change_body_at(p, at, body);
    }
    fn body_varies(&self) -> bool {
        self.0.effect.body_varies()
    }
    fn needs_beam(&self) -> bool {
        self.0.effect.needs_beam()
    }
    fn true_input(&self, p: &[f64], body: &Body, input: &mut ImpactInput) {
        self.0.effect.true_input(p, body, input);
    }
    fn change_laws(&self, p: &[f64], at: &Contact, laws: &mut Laws) {
        self.0.effect.change_laws(p, at, laws);
    }
    fn change_viscoelastic(&self, p: &[f64], at: &Contact, laws: &mut viscoelastic::Laws) {
        self.0.effect.change_viscoelastic(p, at, laws);
    }
    fn change_impulse(&self, p: &[f64], at: &Contact, laws: &Laws, impulse: &mut Impulse) {
        self.0.effect.change_impulse(p, at, laws, impulse);
    }
    fn change_output(&self, p: &[f64], at: &Contact, laws: &Laws, impulse: &Impulse, output: &mut ImpactOutput) {
        self.0.effect.change_output(p, at, laws, impulse, output);
    }
    fn observed_output(&self, p: &[f64], body: &Body, input: &ImpactInput, output: &mut ImpactOutput) {
        self.0.effect.observed_output(p, body, input, output);
    }
}

/// A base with parameters and effects. Cheap to clone; set values by name or index.
#[derive(Debug, Clone)]
pub struct Model {
    base: Base,
    sliding: Sliding,
    contact_laws: ContactLaws,
    /// Base parameters first, then each effect's, in the effects' order.
    parameters: Vec<Parameter>,
    /// In the catalogue's order, then the user's own by name.
    effects: Vec<AddedEffect>,
    /// Whether the stringbed's stiffness follows from racket.toml's tension (`kS0` left out).
    stiffness_from_tension: bool,
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

    pub fn sliding(&self) -> Sliding {
        self.sliding
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
            ModelError::UnknownParameter { name: name.to_owned(), near: near_matches(name, known.clone()), known: known.collect::<Vec<_>>().join(", ") }
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
        let parameters = card.parameters.iter().map(|c| Parameter::from_card(Some(name), c)).collect();
        self.with(name, Some(card), Arc::new(OfCatalogue(card)), parameters)
    }

    /// The model with an effect written in Rust; `parameters` are named `<name>.<key>` and passed to it in this order.
    ///
    /// # Errors
    /// [`ModelError::EffectTwice`].
    pub fn with_own_effect(&self, name: &str, effect: Arc<dyn Effect>, parameters: Vec<Parameter>) -> Result<Model, ModelError> {
        self.with(name, None, effect, parameters)
    }

    fn with(&self, name: &str, card: Option<&'static EffectCard>, effect: Arc<dyn Effect>, parameters: Vec<Parameter>) -> Result<Model, ModelError> {
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
        model.effects.insert(at, AddedEffect { name: name.to_owned(), card, expression: None, effect, range: first..first + count });
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
        if self.base == Base::Viscoelastic && !effect.acts_around_contact() {
            let reason = "contact laws are stepped through time there; replace a quantity of the bodies or of the outcome";
            return Err(ModelError::NotInBase { name: name.to_owned(), base: self.base.name(), reason });
        }
        for p in &mut parameters {
            p.name = format!("{name}.{}", p.key());
        }
        let mut model = self.with(name, None, effect.clone(), parameters)?;
        if let Some(added) = model.effects.iter_mut().find(|e| e.name == name) {
            added.expression = Some(effect);
        }
        Ok(model)
    }

    /// The model without an effect; the same model when it does not have it.
    pub fn without_effect(&self, name: &str) -> Model {
        let mut model = self.clone();
        if let Some(at) = model.effects.iter().position(|e| e.name == name) {
            let range = model.effects.remove(at).range;
            for e in &mut model.effects[at..] {
                e.range = e.range.start - range.len()..e.range.end - range.len();
            }
            model.parameters.drain(range);
        }
        model
    }

    /// The model made ready for one racket and ball: bodies changed by the effects, frame modes computed.
    ///
    /// # Errors
    /// Bodies that cannot be; an effect that does not exist in this base.
    pub fn prepare(&self, racket: &Racket, ball: &Ball) -> Result<PreparedModel, ModelError> {
        PreparedModel::new(self.clone(), Body::new(racket, ball)?)
    }
}

/// Inputs beyond this are mistakes of unit or of measurement, not impacts.
const LIMITS: [(&str, f64); 6] = [
    ("ball_in_v (m/s)", 500.0),
    ("ball_in_w (rad/s)", 20_000.0),
    ("racket_in_v (m/s)", 500.0),
    ("racket_in_w (rad/s)", 2_000.0),
    ("impact_x, impact_y (m)", 2.0),
    ("grip_torque (N m)", 1_000.0),
];

fn check_input(input: &ImpactInput) -> Result<(), ModelError> {
    let sizes = [
        input.ball_velocity.amax(),
        input.ball_spin.amax(),
        input.racket_velocity.amax(),
        input.racket_rate.amax(),
        input.position.amax(),
        input.grip_torque.abs(),
    ];
    // amax skips NaN, so finiteness is asked for apart.
    if !input.is_finite() {
        return Err(ModelError::InputRange { what: "an input or the order", seen: f64::NAN, limit: LIMITS[0].1 });
    }
    for ((what, limit), seen) in LIMITS.into_iter().zip(sizes) {
        if seen > limit {
            return Err(ModelError::InputRange { what, seen, limit });
        }
    }
    Ok(())
}

/// A model with everything that does not depend on the single impact computed once.
#[derive(Debug, Clone)]
pub struct PreparedModel {
    model: Model,
    values: Vec<f64>,
    body: Body,
    body_varies: bool,
    steps: f64,
}

impl PreparedModel {
    /// From bodies instead of files; see [`Model::prepare`].
    ///
    /// # Errors
    /// As [`Model::prepare`].
    pub fn new(model: Model, mut body: Body) -> Result<Self, ModelError> {
        let values = model.values();
        if model.effects.iter().any(|e| e.effect.needs_beam()) {
            body.compute_beam()?;
        }
        for e in &model.effects {
            e.effect.change_body(&values[e.range.clone()], &mut body);
        }
        body.check()?;
        let body_varies = model.effects.iter().any(|e| e.effect.body_varies());
        Ok(PreparedModel { model, values, body, body_varies, steps: DEFAULT_STEPS })
    }

    pub fn model(&self) -> &Model {
        &self.model
    }

    /// The bodies with the effects' changes.
    pub fn body(&self) -> &Body {
        &self.body
    }

    fn each(&self) -> impl DoubleEndedIterator<Item = (&dyn Effect, &[f64])> {
        self.model.effects.iter().map(|e| (&*e.effect, &self.values[e.range.clone()]))
    }

    /// The outcome of one impact, as the user would measure it.
    ///
    /// # Errors
    /// Inputs that are not finite or out of range, no approach, no release, a result that is not finite.
    pub fn predict(&self, input: &ImpactInput) -> Result<ImpactOutput, ModelError> {
        let truth = self.true_input(input)?;
        if self.body_varies {
            let body = self.body_at(&truth)?;
            self.finish(&truth, self.collide(&body, truth)?)
        } else {
            self.finish(&truth, self.collide(&self.body, truth)?)
        }
    }

    /// From the input as measured to the true one.
    fn true_input(&self, input: &ImpactInput) -> Result<ImpactInput, ModelError> {
        check_input(input)?;
        let mut truth = *input;
        for (effect, p) in self.each() {
            effect.true_input(p, &self.body, &mut truth);
        }
        Ok(truth)
    }

    /// The bodies of one impact, where an effect makes them depend on it.
    fn body_at(&self, truth: &ImpactInput) -> Result<Body, ModelError> {
        let mut body = self.body.clone();
        let at = Contact::new(&self.body, truth)?;
        for (effect, p) in self.each() {
            effect.change_body_at(p, &at, &mut body);
        }
        body.check()?;
        Ok(body)
    }

    /// From the true outcome to the one that would be measured.
    fn finish(&self, truth: &ImpactInput, mut output: ImpactOutput) -> Result<ImpactOutput, ModelError> {
        for (effect, p) in self.each().rev() {
            effect.observed_output(p, &self.body, truth, &mut output);
        }
        if output.is_finite() { Ok(output) } else { Err(self.blame(truth)) }
    }

    /// Which effect made the outcome something that is not a number.
    fn blame(&self, input: &ImpactInput) -> ModelError {
        let Ok(at) = Contact::new(&self.body, input) else { return ModelError::NotFinite };
        let mut laws = self.base_laws(&self.body);
        for e in &self.model.effects {
            e.effect.change_laws(&self.values[e.range.clone()], &at, &mut laws);
            let after = collide(&at, &laws, &|_, _, _| {}).1;
            if !after.is_finite() {
                return ModelError::EffectRange { effect: e.name.clone(), quantity: "a contact law", seen: f64::NAN, allowed: "finite numbers" };
            }
        }
        ModelError::NotFinite
    }

    fn base_laws(&self, body: &Body) -> Laws {
        Laws::new(self.values[0], self.values[1], self.model.sliding, body.ball_radius, body.ball_inertia)
    }

    /// The true outcome; the racket's velocity at the centre of mass that its file states, in and out.
    fn collide(&self, body: &Body, input: ImpactInput) -> Result<ImpactOutput, ModelError> {
        let at = contact(body, input)?;
        if self.model.base == Base::Viscoelastic {
            let ready = self.ready(at);
            let output = viscoelastic::collide_all(std::slice::from_ref(&ready), self.steps).pop().unwrap_or(Err(ModelError::NotFinite))?;
            return Ok(self.after_contact(&ready.at, output));
        }
        let mut laws = self.base_laws(body);
        for (effect, p) in self.each() {
            effect.change_laws(p, &at, &mut laws);
        }
        // Not `max`: that would turn NaN into 0.
        if laws.friction < 0.0 {
            laws.friction = 0.0;
        }
        let (impulse, mut output) = collide(&at, &laws, &|at, laws, impulse| {
            for (effect, p) in self.each() {
                effect.change_impulse(p, at, laws, impulse);
            }
        });
        for (effect, p) in self.each() {
            effect.change_output(p, &at, &laws, &impulse, &mut output);
        }
        shift_back(body, &mut output);
        Ok(output)
    }

    /// A contact with the visco-elastic laws of this impact.
    fn ready<'a>(&self, at: Contact<'a>) -> Ready<'a> {
        let mut laws = viscoelastic::Laws::new(&self.values, at.body, self.model.stiffness_from_tension, &self.model.contact_laws);
        for (effect, p) in self.each() {
            effect.change_viscoelastic(p, &at, &mut laws);
        }
        Ready { at, laws }
    }

    /// What effects change in a visco-elastic outcome; the impulses are those that the outcome implies.
    fn after_contact(&self, at: &Contact, mut output: ImpactOutput) -> ImpactOutput {
        let (b, i) = (at.body, &at.input);
        if !self.model.effects.is_empty() {
            let separation = output.ball_velocity.z - output.racket_velocity.z - output.racket_rate.cross(&at.lever).z;
            let restitution = (at.side * separation / at.approach_speed).max(0.0);
            let laws = Laws::new(restitution, self.values[9], Sliding::FirstTouch, b.ball_radius, b.ball_inertia);
            let impulse = Impulse {
                ball: b.ball_mass * (output.ball_velocity - i.ball_velocity),
                ball_angular: b.ball_inertia * (output.ball_spin - i.ball_spin),
                racket: b.racket_mass * (output.racket_velocity - i.racket_velocity),
                racket_angular: (output.racket_rate - i.racket_rate).component_mul(&b.racket_inertia),
                regime: Regime::Stick,
            };
            for (effect, p) in self.each() {
                effect.change_output(p, at, &laws, &impulse, &mut output);
            }
        }
        shift_back(b, &mut output);
        output
    }

    /// About how many steps a visco-elastic contact is divided into (default 72: better than 1e-6 of the velocities).
    pub fn set_steps(&mut self, steps: f64) {
        self.steps = steps.clamp(16.0, 1e5);
    }

    /// One visco-elastic impact with its ledger of energy and momentum, peak force, compression and deflection.
    ///
    /// About `steps` steps of order 8; [`PreparedModel::run_default`] closes the ledger to 1e-9 J. The output is the true one:
    /// effects on the observation are left out.
    ///
    /// # Errors
    /// As [`PreparedModel::predict`]; [`ModelError::NotInBase`] in base rigid, which has no time.
    pub fn run(&self, input: &ImpactInput, steps: f64) -> Result<Run, ModelError> {
        if self.model.base == Base::Rigid {
            return Err(ModelError::NotInBase { name: "run".into(), base: "rigid", reason: "an impulse has no duration" });
        }
        let truth = self.true_input(input)?;
        let body = if self.body_varies { self.body_at(&truth)? } else { self.body.clone() };
        viscoelastic::run(&self.ready(contact(&body, truth)?), steps.clamp(16.0, 1e5))
    }

    /// [`PreparedModel::run`] with as many steps as close the ledger to 1e-9 J.
    ///
    /// # Errors
    /// As [`PreparedModel::run`].
    pub fn run_default(&self, input: &ImpactInput) -> Result<Run, ModelError> {
        self.run(input, viscoelastic::RUN_STEPS)
    }

    /// The outcomes of many impacts, in their order; the same for any number of threads.
    pub fn predict_all(&self, inputs: &[ImpactInput]) -> Vec<Result<ImpactOutput, ModelError>> {
        if self.model.base == Base::Rigid || self.body_varies {
            // Large pieces: one rigid impact takes well under a microsecond.
            return inputs.par_iter().with_min_len(256).map(|input| self.predict(input)).collect();
        }
        inputs.par_chunks(PIECE).flat_map_iter(|piece| self.predict_piece(piece)).collect()
    }

    /// Visco-elastic impacts side by side.
    fn predict_piece(&self, inputs: &[ImpactInput]) -> Vec<Result<ImpactOutput, ModelError>> {
        let mut results: Vec<Result<ImpactOutput, ModelError>> = Vec::with_capacity(inputs.len());
        let (mut places, mut truths, mut ready) = (Vec::new(), Vec::new(), Vec::new());
        for input in inputs {
            let staged = self.true_input(input).and_then(|truth| Ok((truth, self.ready(contact(&self.body, truth)?))));
            match staged {
                Ok((truth, contact)) => {
                    places.push(results.len());
                    truths.push(truth);
                    ready.push(contact);
                    results.push(Err(ModelError::NotFinite));
                }
                Err(e) => results.push(Err(e)),
            }
        }
        let outputs = viscoelastic::collide_all(&ready, self.steps);
        for (((place, truth), contact), output) in places.into_iter().zip(&truths).zip(&ready).zip(outputs) {
            results[place] = output.and_then(|o| self.finish(truth, self.after_contact(&contact.at, o)));
        }
        results
    }
}

/// Impacts per task: enough to fill the lanes many times over, few enough to share 900 impacts between two cores.
const PIECE: usize = 128;

/// The contact at the true centre of mass, where effects have moved it from the stated one.
fn contact(body: &Body, mut input: ImpactInput) -> Result<Contact<'_>, ModelError> {
    let shift = body.com_x - body.reported_com_x;
    if shift != 0.0 {
        input.racket_velocity += input.racket_rate.cross(&Vector3::new(shift, 0.0, 0.0));
    }
    Contact::new(body, &input)
}

/// The racket's velocity back at the stated centre of mass.
fn shift_back(body: &Body, output: &mut ImpactOutput) {
    let shift = body.com_x - body.reported_com_x;
    if shift != 0.0 {
        output.racket_velocity -= output.racket_rate.cross(&Vector3::new(shift, 0.0, 0.0));
    }
}
