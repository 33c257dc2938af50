//! A model file's model, as the statistics see it: [`Forward`] over its free parameters, [`Library`] over the catalogue.

use super::error::ValidationError;
use super::forward::{Asked, EffectOutline, Fixed, Forward, FreeParameter, Library, Outputs, OwnEffect, Prediction, Prior, Strength, Tails};
use super::observation::{Gear, Observations, TableOptions};
use super::predicted::unpredicted;
use super::screen::STRENGTH_PRIOR;
use crate::equipment_set::EquipmentSet;
use crate::impact::viscoelastic::LEAST_STRING_DAMPING;
use crate::impact::{Base, ImpactInput, ImpactOutput, Model, ModelError, Parameter, PreparedModel, Role, catalogue};
use crate::impact_table::ImpactTable;

/// Share of the impacts that a model may have no answer for. A few stand at a limit of physics (the ball does not approach); a model that fails for more
/// would be judged by the impacts that suit it.
const MOST_UNPREDICTED: f64 = 0.1;

/// The bases' parameters that ball and strings of another make change, and no effect of the catalogue is a law of: where one held fixed is wrong, an effect
/// is named that only imitates it. (The others of the visco-elastic base are what its effects act on.)
const OF_NO_EFFECT: [&str; 3] = ["restitution", "friction", "mu"];

/// Width of the prior on a shape parameter that the fit may move, in typical sizes.
const SHAPE_PRIOR: f64 = 1.0;

impl From<ModelError> for ValidationError {
    fn from(e: ModelError) -> Self {
        ValidationError::Model(e.to_string())
    }
}

/// A model with the equipment of a table; free parameters in a fixed order.
pub struct ModelForward {
    model: Model,
    gear: Vec<Gear>,
    free: Vec<FreeParameter>,
    /// Place of each free parameter in the model's flat list.
    places: Vec<usize>,
}

impl ModelForward {
    /// Frees the parameters that the model file says `fit = true` to.
    pub fn new(model: Model, gear: &[Gear]) -> Self {
        let names: Vec<String> = model.parameters().iter().filter(|p| p.fit).map(|p| p.name.clone()).collect();
        Self::with_free(model, gear, &names, names.len())
    }

    /// The first `own` of `names` are the user's: they were asked for, and go where the impacts say.
    fn with_free(model: Model, gear: &[Gear], names: &[String], own: usize) -> Self {
        let mut free = Vec::new();
        let mut places = Vec::new();
        for (n, name) in names.iter().enumerate() {
            let Ok(place) = model.index_of(name) else { continue };
            // Several strengths together imitate other effects, with tails at sizes that no racket has.
            let tails = match n < own {
                true => Tails::Wide,
                false if is_only_strength(&model, place) => Tails::Student,
                false => Tails::Normal,
            };
            let p = &model.parameters()[place];
            let prior = match p.role {
                Role::Base => None,
                Role::Strength { absent, .. } => Some(Prior { mean: absent, sd: STRENGTH_PRIOR * p.typical, tails }),
                Role::Shape => Some(Prior { mean: p.value, sd: SHAPE_PRIOR * p.typical, tails }),
            };
            // No smaller string damping acts: a fit that comes there is at its limit.
            let min = if p.name == "c_S" && p.value > LEAST_STRING_DAMPING { p.min.max(LEAST_STRING_DAMPING) } else { p.min };
            free.push(FreeParameter { name: p.name.clone(), value: p.value, min, max: p.max, typical: p.typical, prior });
            places.push(place);
        }
        ModelForward { model, gear: gear.to_vec(), free, places }
    }

    /// The model at given values of its free parameters.
    pub fn model_at(&self, values: &[f64]) -> Result<Model, ValidationError> {
        let mut model = self.model.clone();
        for (place, value) in self.places.iter().zip(values) {
            model.set_at(*place, *value)?;
        }
        Ok(model)
    }
}

struct Ready(Vec<PreparedModel>);

fn input_of(asked: &Asked) -> ImpactInput {
    ImpactInput { own: asked.own, ..ImpactInput::from_columns(&asked.inputs, asked.order) }
}

fn columns_of(output: &ImpactOutput) -> Outputs {
    output.as_columns().map(|v| v.unwrap_or(f64::NAN))
}

impl Prediction for Ready {
    fn predict(&self, asked: &Asked) -> Option<Outputs> {
        self.0.get(asked.gear)?.predict(&input_of(asked)).ok().map(|o| columns_of(&o))
    }

    fn why_not(&self, asked: &Asked) -> Option<String> {
        Some(self.0.get(asked.gear)?.predict(&input_of(asked)).err()?.to_string())
    }

    fn predict_many(&self, asked: &[Asked]) -> Vec<Option<Outputs>> {
        if self.0.iter().all(|model| model.model().base() == Base::Rigid) {
            return asked.iter().map(|a| self.predict(a)).collect();
        }
        let mut outputs = vec![None; asked.len()];
        for (gear, model) in self.0.iter().enumerate() {
            let places: Vec<usize> = (0..asked.len()).filter(|&i| asked[i].gear == gear).collect();
            let inputs: Vec<ImpactInput> = places.iter().map(|&i| input_of(&asked[i])).collect();
            for (place, output) in places.into_iter().zip(model.predict_piece(&inputs)) {
                outputs[place] = output.ok().map(|o| columns_of(&o));
            }
        }
        outputs
    }

    fn jump(&self, asked: &Asked) -> Option<Outputs> {
        self.0.get(asked.gear)?.short_of_sticking(&input_of(asked)).ok()?
    }
}

impl Forward for ModelForward {
    fn parameters(&self) -> &[FreeParameter] {
        &self.free
    }

    fn prepare(&self, values: &[f64]) -> Result<Box<dyn Prediction + '_>, ValidationError> {
        let model = self.model_at(values)?;
        let prepared = self.gear.iter().map(|g| model.prepare(&g.racket, &g.ball)).collect::<Result<Vec<_>, _>>()?;
        Ok(Box::new(Ready(prepared)))
    }

    fn costly(&self) -> bool {
        self.model.base() == Base::Viscoelastic
    }
}

/// The models one can reach from a model file by adding catalogue effects or expressions.
pub struct ModelLibrary {
    current: ModelForward,
    outlines: Vec<EffectOutline>,
}

impl ModelLibrary {
    pub fn new(model: Model, gear: &[Gear]) -> Self {
        let outlines = catalogue()
            .iter()
            .map(|card| {
                let excluded = if model.has_effect(card.name) {
                    Some("it is in the model already".to_owned())
                } else {
                    // Some effects do not exist in a base; preparing says so.
                    let tried = model.with_effect(card.name).and_then(|m| gear.first().map_or(Ok(()), |g| m.prepare(&g.racket, &g.ball).map(|_| ())));
                    tried.err().map(|e| e.to_string())
                };
                EffectOutline {
                    name: card.name.to_owned(),
                    kind: card.kind.name(),
                    strengths: card
                        .strengths()
                        .filter_map(|(_, p)| match Parameter::from_card(Some(card.name), p).in_base(model.base(), p) {
                            Parameter { name: parameter, role: Role::Strength { absent, one_sided }, typical, value: usual, .. } => {
                                let jumps = p.size_alone && model.base() == Base::Viscoelastic;
                                // The time-stepped base has some of each in itself, and may have too much.
                                let one_way = p.one_way && model.base() == Base::Rigid;
                                Some(Strength { parameter, absent, typical, usual, one_sided, one_way, jumps })
                            }
                            _ => None,
                        })
                        .collect(),
                    confused_with: card.confused_with.iter().map(|s| (*s).to_owned()).collect(),
                    separated_by: card.separated_by.to_owned(),
                    check_first: card.check_first,
                    excluded,
                }
            })
            .collect();
        ModelLibrary { current: ModelForward::new(model, gear), outlines }
    }

    /// A table made ready for this model: the rows for which the model as stated has no answer are left out and named, as rows that nothing can be made of
    /// are.
    ///
    /// # Errors
    /// As [`Observations::new`]; [`ValidationError::NoPrediction`] where the model has no answer for more than a tenth of the impacts.
    pub fn on_table(model: &Model, set: &EquipmentSet, table: &ImpactTable, options: &TableOptions) -> Result<(Self, Observations), ValidationError> {
        let all = Observations::new(table, &set.rackets, &set.balls, options)?;
        let library = ModelLibrary::new(model.clone(), &all.gear);
        let lost = unpredicted(library.current(), &all)?;
        let Some(first) = all.impacts.iter().find(|o| lost.contains_key(&o.id)) else { return Ok((library, all)) };
        let (failed, rows) = (lost.len(), all.impacts.len());
        if failed as f64 > MOST_UNPREDICTED * rows as f64 {
            return Err(ValidationError::NoPrediction { failed, rows, id: first.id.clone(), why: lost.get(&first.id).cloned() });
        }
        let rest = Observations::without(&lost, table, &set.rackets, &set.balls, options)?;
        Ok((ModelLibrary::new(model.clone(), &rest.gear), rest))
    }

    /// Names of the effects in the current model.
    pub fn effect_names(&self) -> Vec<String> {
        self.current.model.effects().iter().map(|e| e.name.clone()).collect()
    }

    /// The current model with effects, its free parameters in the order of [`Library::with`].
    pub fn forward_with(&self, effects: &[&str]) -> Result<ModelForward, ValidationError> {
        let mut model = self.current.model.clone();
        let mut names: Vec<String> = self.current.free.iter().map(|p| p.name.clone()).collect();
        for effect in effects {
            model = model.with_effect(effect)?;
            let outline = self.outline(effect).ok_or_else(|| ValidationError::UnknownEffect { name: (*effect).to_owned() })?;
            for s in &outline.strengths {
                model.set(&s.parameter, s.absent)?;
                names.push(s.parameter.clone());
            }
            for i in model.effect_parameters(effect) {
                let p = &model.parameters()[i];
                if p.fit && !outline.strengths.iter().any(|s| s.parameter == p.name) {
                    names.push(p.name.clone());
                }
            }
        }
        Ok(ModelForward::with_free(model, &self.current.gear, &names, self.current.free.len()))
    }
}

/// Whether the parameter at this place is a strength, the only one of its effect.
fn is_only_strength(model: &Model, place: usize) -> bool {
    let effect = |name: &str| name.split_once('.').map(|(effect, _)| effect.to_owned());
    let is_strength = |p: &&Parameter| matches!(p.role, Role::Strength { .. });
    let asked = &model.parameters()[place];
    is_strength(&asked) && model.parameters().iter().filter(is_strength).filter(|p| effect(&p.name) == effect(&asked.name)).count() == 1
}

impl Library for ModelLibrary {
    fn current(&self) -> &dyn Forward {
        &self.current
    }

    fn effects(&self) -> &[EffectOutline] {
        &self.outlines
    }

    fn with(&self, effects: &[&str]) -> Result<Box<dyn Forward + '_>, ValidationError> {
        Ok(Box::new(self.forward_with(effects)?))
    }

    fn extended(&self, effects: &[&str], values: &[f64]) -> Result<Box<dyn Library + '_>, ValidationError> {
        let mut current = self.forward_with(effects)?;
        current.model = current.model_at(values)?;
        for (p, v) in current.free.iter_mut().zip(values) {
            p.value = *v;
            // What is in the model goes where the impacts say.
            p.prior = p.prior.map(|prior| Prior { tails: Tails::Wide, ..prior });
        }
        let mut outlines = self.outlines.clone();
        for o in outlines.iter_mut().filter(|o| effects.contains(&o.name.as_str())) {
            o.excluded = Some("it is in the model already".to_owned());
        }
        Ok(Box::new(ModelLibrary { current, outlines }))
    }

    fn with_fixed_freed(&self) -> Option<(Box<dyn Library + '_>, Vec<Fixed>)> {
        let model = &self.current.model;
        let may_be_wrong = |p: &Parameter| match p.role {
            Role::Strength { .. } => true,
            Role::Base => OF_NO_EFFECT.contains(&p.name.as_str()),
            Role::Shape => false,
        };
        let free = |name: &str| self.current.free.iter().any(|p| p.name == name);
        let fixed: Vec<Fixed> = model
            .parameters()
            .iter()
            .filter(|p| may_be_wrong(p) && !free(&p.name))
            .map(|p| Fixed { parameter: p.name.clone(), value: p.value, of_base: p.role == Role::Base })
            .collect();
        if fixed.is_empty() {
            return None;
        }
        let names: Vec<String> = self.current.free.iter().map(|p| p.name.clone()).chain(fixed.iter().map(|f| f.parameter.clone())).collect();
        let current = ModelForward::with_free(model.clone(), &self.current.gear, &names, names.len());
        Some((Box::new(ModelLibrary { current, outlines: self.outlines.clone() }), fixed))
    }

    fn has_effect(&self, name: &str) -> bool {
        self.current.model.has_effect(name)
    }

    fn with_expression(&self, effects: &[&str], expressions: &[OwnEffect]) -> Result<Box<dyn Forward + '_>, ValidationError> {
        let mut forward = self.forward_with(effects)?;
        let mut names: Vec<String> = forward.free.iter().map(|p| p.name.clone()).collect();
        let mut model = forward.model;
        for own in expressions {
            let parameters = own
                .parameters
                .iter()
                .map(|(name, typical)| Parameter { fit: true, min: -20.0 * typical, max: 20.0 * typical, typical: *typical, ..Parameter::own(name, 0.0) })
                .collect();
            model = model.with_expression(&own.name, &own.replaces, &own.expression, parameters)?;
            names.extend(own.parameters.iter().map(|(name, _)| format!("{}.{name}", own.name)));
        }
        forward = ModelForward::with_free(model, &self.current.gear, &names, self.current.free.len());
        let first = forward.free.len() - expressions.iter().map(|e| e.parameters.len()).sum::<usize>();
        for (p, (_, typical)) in forward.free[first..].iter_mut().zip(expressions.iter().flat_map(|e| &e.parameters)) {
            p.typical = *typical;
            p.prior = Some(Prior { mean: 0.0, sd: STRENGTH_PRIOR * typical, tails: Tails::Normal });
        }
        Ok(Box::new(forward))
    }
}
