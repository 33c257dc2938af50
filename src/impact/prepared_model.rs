//! A model made ready for one racket and ball: from an impact as measured to its outcome as it would be measured.

use super::body::Body;
use super::dual::Tangent;
use super::effects::{DifferentiableEffect, Effect};
use super::error::ModelError;
use super::input::{ImpactInput, ImpactOutput};
use super::model::{Base, MU, Model};
use super::real::Real;
use super::rigid::{Contact, Impulse, Laws, Regime, Sliding, collide};
use super::viscoelastic::{self, DEFAULT_STEPS, Ended, Ready, Run};
use nalgebra::Vector3;
use rayon::prelude::*;
use std::borrow::Cow;
use std::sync::Arc;

/// Inputs beyond this are mistakes of unit or of measurement, not impacts. Twice what a table may hold and more: a fit's estimates of what was measured
/// may lie beyond its cells.
const LIMITS: [(&str, f64); 6] = [
    ("ball_in_v (m/s)", 1_000.0),
    ("ball_in_w (rad/s)", 20_000.0),
    ("racket_in_v (m/s)", 1_000.0),
    ("racket_in_w (rad/s)", 4_000.0),
    ("impact_x, impact_y (m)", 2.0),
    ("grip_torque (N m)", 2_000.0),
];

/// Steps that a visco-elastic contact may be divided into.
const FEWEST_STEPS: f64 = 16.0;
const MOST_STEPS: f64 = 1e5;

fn check_input<T: Real>(input: &ImpactInput<T>) -> Result<(), ModelError> {
    let most = |numbers: &[T]| numbers.iter().fold(0.0f64, |most, n| most.max(n.value().abs()));
    let sizes = [
        most(input.ball_velocity.as_slice()),
        most(input.ball_spin.as_slice()),
        most(input.racket_velocity.as_slice()),
        most(input.racket_rate.as_slice()),
        most(input.position.as_slice()),
        input.grip_torque.value().abs(),
    ];
    // The largest skips NaN, so finiteness is asked for apart.
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
pub(crate) struct Staged<T = f64> {
    truth: ImpactInput<T>,
    body: Body<T>,
    pub contact: ImpactInput<T>,
    pub laws: viscoelastic::Laws<T>,
}

/// A model with everything that does not depend on the single impact computed once.
///
/// In dual numbers ([`Tangent`]) it carries derivatives by whatever its parameters, bodies and inputs are variables of.
#[derive(Debug, Clone)]
pub struct PreparedModel<T = f64> {
    model: Arc<Model>,
    values: Vec<T>,
    body: Body<T>,
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
        add_beam(&model, &mut body)?;
        PreparedModel::with_values(Arc::new(model), values, body)
    }
}

/// Computes the beam of bodies that effects have not changed yet, where one of them reads it.
pub(crate) fn add_beam(model: &Model, body: &mut Body) -> Result<(), ModelError> {
    if model.effects.iter().any(|e| Effect::<f64>::needs_beam(e.effect())) { body.compute_beam() } else { Ok(()) }
}

impl<T> PreparedModel<T> {
    pub fn model(&self) -> &Model {
        &self.model
    }

    /// The bodies with the effects' changes.
    pub fn body(&self) -> &Body<T> {
        &self.body
    }

    /// About how many steps a visco-elastic contact is divided into (default 72: better than 1e-6 of the velocities).
    pub fn set_steps(&mut self, steps: f64) {
        self.steps = steps.clamp(FEWEST_STEPS, MOST_STEPS);
    }
}

impl<T: Real> PreparedModel<T>
where
    dyn DifferentiableEffect: Effect<T>,
{
    /// With parameters and bodies (their beam included) in any number.
    ///
    /// # Errors
    /// As [`Model::prepare`].
    pub(crate) fn with_values(model: Arc<Model>, values: Vec<T>, mut body: Body<T>) -> Result<Self, ModelError> {
        for e in &model.effects {
            Effect::<T>::change_body(e.effect(), &values[e.range.clone()], &mut body);
        }
        body.check()?;
        let body_varies = model.effects.iter().any(|e| Effect::<T>::body_varies(e.effect()));
        Ok(PreparedModel { model, values, body, body_varies, steps: DEFAULT_STEPS })
    }

    fn each(&self) -> impl DoubleEndedIterator<Item = (&(dyn DifferentiableEffect + 'static), &[T])> {
        self.model.effects.iter().map(|e| (e.effect(), &self.values[e.range.clone()]))
    }

    /// From the input as measured to the true one.
    fn true_input(&self, input: &ImpactInput<T>) -> Result<ImpactInput<T>, ModelError> {
        check_input(input)?;
        let mut truth = *input;
        for (effect, p) in self.each() {
            effect.true_input(p, &self.body, &mut truth);
        }
        Ok(truth)
    }

    /// The bodies of one impact: those of all, unless an effect makes them depend on it.
    fn body_at(&self, truth: &ImpactInput<T>) -> Result<Cow<'_, Body<T>>, ModelError> {
        if !self.body_varies {
            return Ok(Cow::Borrowed(&self.body));
        }
        let mut body = self.body.clone();
        let at = contact(&self.body, truth)?;
        for (effect, p) in self.each() {
            effect.change_body_at(p, &at, &mut body);
        }
        body.check()?;
        Ok(Cow::Owned(body))
    }

    /// From the true outcome to the one that would be measured.
    fn finish(&self, truth: &ImpactInput<T>, mut output: ImpactOutput<T>) -> Result<ImpactOutput<T>, ModelError> {
        let truly = output;
        for (effect, p) in self.each().rev() {
            effect.observed_output(p, &self.body, truth, &mut output);
        }
        if output.is_finite() { Ok(output) } else { Err(self.blame(truth, truly)) }
    }

    /// Which effect made the outcome something that is not a number; `output` as it was before the effects of observation.
    fn blame(&self, input: &ImpactInput<T>, mut output: ImpactOutput<T>) -> ModelError {
        let beyond = |effect: &str, quantity| ModelError::EffectRange { effect: effect.to_owned(), quantity, seen: f64::NAN, allowed: "finite numbers" };
        if output.is_finite() {
            for e in self.model.effects.iter().rev() {
                e.effect().observed_output(&self.values[e.range.clone()], &self.body, input, &mut output);
                if !output.is_finite() {
                    return beyond(&e.name, "an outcome as observed");
                }
            }
        }
        let Ok(at) = contact(&self.body, input) else { return ModelError::NotFinite };
        let mut laws = self.base_laws(&self.body);
        for e in &self.model.effects {
            e.effect().change_laws(&self.values[e.range.clone()], &at, &mut laws);
            if !collide(&at, &laws, &|_, _, _| {}).1.is_finite() {
                return beyond(&e.name, "a contact law");
            }
        }
        let (impulse, mut output) = collide(&at, &laws, &|_, _, _| {});
        for e in &self.model.effects {
            e.effect().change_output(&self.values[e.range.clone()], &at, &laws, &impulse, &mut output);
            if !output.is_finite() {
                return beyond(&e.name, "an outcome");
            }
        }
        ModelError::NotFinite
    }

    /// Which effect made the contact laws what no contact has.
    fn blame_law(&self, at: &Contact<T>) -> ModelError {
        let mut laws = self.base_laws(at.body);
        for e in &self.model.effects {
            e.effect().change_laws(&self.values[e.range.clone()], at, &mut laws);
            if let Some((quantity, seen, allowed)) = laws.impossible() {
                return ModelError::EffectRange { effect: e.name.clone(), quantity, seen, allowed };
            }
        }
        ModelError::NotFinite
    }

    fn base_laws(&self, body: &Body<T>) -> Laws<T> {
        Laws::new(self.values[0], self.values[1], self.model.sliding, T::constant(body.ball_radius), body.ball_inertia)
    }

    /// The outcome of one impact in base rigid as the user would measure it, and the friction it had to spare.
    pub(crate) fn predict_rigid(&self, input: &ImpactInput<T>) -> Result<(ImpactOutput<T>, T), ModelError> {
        self.predict_gripping(input, 1.0).map(|(output, _, spare)| (output, spare))
    }

    /// The same with all friction multiplied by `grip`, and how the contact ended.
    pub(crate) fn predict_gripping(&self, input: &ImpactInput<T>, grip: f64) -> Result<(ImpactOutput<T>, Regime, T), ModelError> {
        let truth = self.true_input(input)?;
        let body = self.body_at(&truth)?;
        let (output, regime, spare) = self.collide(&body, &truth, grip)?;
        Ok((self.finish(&truth, output)?, regime, spare))
    }

    /// The true outcome in base rigid; the racket's velocity at the centre of mass that its file states, in and out.
    fn collide(&self, body: &Body<T>, input: &ImpactInput<T>, grip: f64) -> Result<(ImpactOutput<T>, Regime, T), ModelError> {
        let at = contact(body, input)?;
        let mut laws = self.laws_at(&at);
        if laws.impossible().is_some() {
            return Err(self.blame_law(&at));
        }
        laws.friction = laws.friction * grip;
        // Not `max`: that would turn NaN into 0.
        if laws.friction.value() < 0.0 {
            laws.friction = T::zero();
        }
        let (impulse, mut output) = collide(&at, &laws, &|at, laws, impulse| {
            for (effect, p) in self.each() {
                effect.change_impulse(p, at, laws, impulse);
            }
        });
        for (effect, p) in self.each() {
            effect.change_output(p, &at, &laws, &impulse, &mut output);
        }
        shift_back(body, &Vector3::new(T::one(), T::zero(), T::zero()), &mut output);
        Ok((output, impulse.regime, impulse.spare_friction))
    }

    /// The laws of one contact in base rigid.
    fn laws_at(&self, at: &Contact<T>) -> Laws<T> {
        let mut laws = self.base_laws(at.body);
        for (effect, p) in self.each() {
            effect.change_laws(p, at, &mut laws);
        }
        laws
    }

    /// The visco-elastic laws of one contact.
    fn viscoelastic_laws(&self, at: &Contact<T>) -> Result<viscoelastic::Laws<T>, ModelError> {
        let mut laws = viscoelastic::Laws::new(&self.values, at.body, self.model.stiffness_from_tension, &self.model.contact_laws);
        for e in &self.model.effects {
            e.effect().change_viscoelastic(&self.values[e.range.clone()], at, &mut laws);
            if let Some((quantity, seen, allowed)) = laws.impossible() {
                return Err(ModelError::EffectRange { effect: e.name.clone(), quantity, seen, allowed });
            }
        }
        laws.keep_within_limits();
        Ok(laws)
    }

    /// What effects change in a visco-elastic outcome; the impulses are those that the outcome implies.
    fn after_contact(&self, at: &Contact<T>, ended: Ended<T>) -> ImpactOutput<T> {
        let Ended { mut output, handle } = ended;
        let (b, i) = (at.body, &at.input);
        if !self.model.effects.is_empty() {
            let separation = output.ball_velocity.z - output.racket_velocity.z - output.racket_rate.cross(&at.lever).z;
            let restitution = (separation * at.side / at.approach_speed).max(T::zero());
            let mut laws = Laws::new(restitution, self.values[MU], Sliding::FirstTouch, T::constant(b.ball_radius), b.ball_inertia);
            let before = Impulse {
                ball: (output.ball_velocity - i.ball_velocity) * b.ball_mass,
                ball_angular: (output.ball_spin - i.ball_spin) * b.ball_inertia,
                racket: (output.racket_velocity - i.racket_velocity) * b.racket_mass,
                racket_angular: (output.racket_rate - i.racket_rate).component_mul(&b.racket_inertia),
                regime: Regime::Stick,
                spare_friction: T::zero(),
            };
            let mut impulse = before;
            for (effect, p) in self.each() {
                effect.change_viscoelastic_impulse(p, at, &mut laws, &mut impulse);
            }
            impulse.change_outcome(&before, at, &laws, &mut output);
            for (effect, p) in self.each() {
                effect.change_output(p, at, &laws, &impulse, &mut output);
            }
        }
        shift_back(b, &handle, &mut output);
        output
    }

    /// All that happens before a visco-elastic contact is stepped.
    pub(crate) fn stage(&self, input: &ImpactInput<T>) -> Result<Staged<T>, ModelError> {
        let truth = self.true_input(input)?;
        let body = self.body_at(&truth)?.into_owned();
        let at = contact(&body, &truth)?;
        let (contact, laws) = (at.input, self.viscoelastic_laws(&at)?);
        Ok(Staged { truth, body, contact, laws })
    }

    /// All that happens after the contact.
    pub(crate) fn conclude(&self, staged: &Staged<T>, ended: Ended<T>) -> Result<ImpactOutput<T>, ModelError> {
        self.finish(&staged.truth, self.after_contact(&Contact::new(&staged.body, &staged.contact)?, ended))
    }
}

impl PreparedModel {
    /// The outcome of one impact, as the user would measure it.
    ///
    /// # Errors
    /// Inputs that are not finite or out of range, no approach, no release, a result that is not finite.
    pub fn predict(&self, input: &ImpactInput) -> Result<ImpactOutput, ModelError> {
        if self.model.base == Base::Rigid {
            return Ok(self.predict_rigid(input)?.0);
        }
        let staged = self.stage(input)?;
        let ready = staged.ready()?;
        let ended = viscoelastic::collide_all(std::slice::from_ref(&ready), self.steps).pop().unwrap_or(Err(ModelError::NotFinite))?;
        self.finish(&staged.truth, self.after_contact(&ready.at, ended))
    }

    /// Restitution and friction that model and effects give for an impact in base rigid, before they are limited to 0 to 1 and to 0 or more.
    /// `None` in base visco-elastic, which has no such laws, and where there is no contact.
    pub fn unlimited_laws(&self, input: &ImpactInput) -> Option<(f64, f64)> {
        let truth = self.true_input(input).ok().filter(|_| self.model.base == Base::Rigid)?;
        let body = self.body_at(&truth).ok()?;
        let laws = self.laws_at(&contact(&body, &truth).ok()?);
        Some((laws.restitution, laws.friction))
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
            return Err(ModelError::NotInBase { name: "run".into(), base: "rigid", reason: "an impulse has no duration".into() });
        }
        viscoelastic::run(&self.stage(input)?.ready()?, steps.clamp(FEWEST_STEPS, MOST_STEPS))
    }

    /// The contact's outcome, and the same with derivatives for each of `variations` of it.
    pub(crate) fn differentiate(&self, staged: &Staged, variations: &[Staged<Tangent>]) -> Result<(Ended, Vec<Ended<Tangent>>), ModelError> {
        let variations: Vec<_> = variations.iter().map(|v| (v.contact, v.laws)).collect();
        viscoelastic::differentiate(&staged.ready()?, self.steps.max(viscoelastic::DERIVATIVE_STEPS), &variations)
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
        if self.model.base == Base::Rigid {
            return inputs.iter().map(|input| self.predict(input)).collect();
        }
        // Bodies that depend on the impact stay with its true input: contacts borrow them while all are stepped together.
        let begun: Vec<Result<_, ModelError>> = inputs
            .iter()
            .map(|input| {
                let truth = self.true_input(input)?;
                Ok((truth, self.body_at(&truth)?))
            })
            .collect();
        let mut results: Vec<Result<ImpactOutput, ModelError>> = Vec::with_capacity(inputs.len());
        let (mut places, mut truths, mut ready) = (Vec::new(), Vec::new(), Vec::new());
        for begun in &begun {
            let staged = begun.as_ref().map_err(ModelError::clone).and_then(|(truth, body)| Ok((*truth, self.ready(contact(body, truth)?)?)));
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

    /// A contact with the visco-elastic laws of this impact.
    fn ready<'a>(&self, at: Contact<'a>) -> Result<Ready<'a>, ModelError> {
        let laws = self.viscoelastic_laws(&at)?;
        Ok(Ready { at, laws })
    }
}

impl Staged {
    fn ready(&self) -> Result<Ready<'_>, ModelError> {
        Ok(Ready { at: Contact::new(&self.body, &self.contact)?, laws: self.laws })
    }
}

/// Impacts per task: enough to fill the lanes many times over, few enough to share 900 impacts between two cores.
const PIECE: usize = 128;

/// The contact at the true centre of mass, where effects have moved it from the stated one.
fn contact<'a, T: Real>(body: &'a Body<T>, input: &ImpactInput<T>) -> Result<Contact<'a, T>, ModelError> {
    let shift = body.com_x - body.reported_com_x;
    if shift.is_zero() {
        return Contact::new(body, input);
    }
    let mut input = *input;
    input.racket_velocity += input.racket_rate.cross(&Vector3::new(shift, T::zero(), T::zero()));
    Contact::new(body, &input)
}

/// The racket's velocity back at the stated centre of mass; `handle`: the racket's x axis at the end of the contact, which it has turned in.
fn shift_back<T: Real>(body: &Body<T>, handle: &Vector3<T>, output: &mut ImpactOutput<T>) {
    let shift = body.com_x - body.reported_com_x;
    if !shift.is_zero() {
        output.racket_velocity -= output.racket_rate.cross(&(*handle * shift));
    }
}
