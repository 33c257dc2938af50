//! A model made ready for one racket and ball: from an impact as measured to its outcome as it would be measured.

use super::body::Body;
use super::effects::Effect;
use super::error::ModelError;
use super::input::{ImpactInput, ImpactOutput};
use super::model::{Base, Model};
use super::rigid::{Contact, Impulse, Laws, Regime, Sliding, collide};
use super::viscoelastic::{self, DEFAULT_STEPS, Ready, Run};
use nalgebra::Vector3;
use rayon::prelude::*;

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

/// A visco-elastic impact between its two observations: the true input, the bodies, the contact's input at the true centre of
/// mass, its laws.
pub(crate) struct Staged {
    truth: ImpactInput,
    body: Body,
    pub contact: ImpactInput,
    pub laws: viscoelastic::Laws,
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
        laws.keep_strings_damped();
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

    /// All that happens before a visco-elastic contact is stepped.
    pub(crate) fn stage(&self, input: &ImpactInput) -> Result<Staged, ModelError> {
        let truth = self.true_input(input)?;
        let body = if self.body_varies { self.body_at(&truth)? } else { self.body.clone() };
        let ready = self.ready(contact(&body, truth)?);
        let (contact, laws) = (ready.at.input, ready.laws);
        Ok(Staged { truth, body, contact, laws })
    }

    /// The contact's outcome and its derivatives along `slopes`.
    pub(crate) fn differentiate(&self, staged: &Staged, slopes: &[viscoelastic::Slope]) -> Result<(ImpactOutput, Vec<[f64; 13]>), ModelError> {
        let ready = Ready { at: Contact::new(&staged.body, &staged.contact)?, laws: staged.laws };
        viscoelastic::differentiate(&ready, self.steps.max(viscoelastic::DERIVATIVE_STEPS), slopes)
    }

    /// All that happens after the contact.
    pub(crate) fn conclude(&self, staged: &Staged, output: ImpactOutput) -> Result<ImpactOutput, ModelError> {
        self.finish(&staged.truth, self.after_contact(&Contact::new(&staged.body, &staged.contact)?, output))
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
        inputs.par_chunks(PIECE).flat_map_iter(|piece| self.predict_piece(piece)).collect()
    }

    /// The outcomes of some impacts, in their order, on this thread; visco-elastic ones are stepped side by side.
    pub fn predict_piece(&self, inputs: &[ImpactInput]) -> Vec<Result<ImpactOutput, ModelError>> {
        if self.model.base == Base::Rigid || self.body_varies {
            return inputs.iter().map(|input| self.predict(input)).collect();
        }
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
