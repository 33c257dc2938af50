//! What the effects that a model already holds explain. One that imitates them, where they do nearly all, is their own form.

use super::error::ValidationError;
use super::fit::{FitOptions, fit};
use super::forward::{Forward, FreeParameter, Library, Prediction, Strength};
use super::observation::{Observation, Observations};
use super::rank::Reference;
use super::refits::{ALONE_SHARE, cards_confuse, excess_at, share_removed};
use super::structure::{BesideSmooth, StructureTest, structure_test};

/// Effects of the catalogue in the current model, each with the places of its strengths among the free parameters.
pub struct Present {
    pub names: Vec<String>,
    pub strengths: Vec<(usize, Strength)>,
}

impl Present {
    pub fn of(library: &dyn Library) -> Self {
        let place = |s: &Strength| library.current().place_of(&s.parameter);
        let mut present = Present { names: Vec::new(), strengths: Vec::new() };
        for outline in library.effects().iter().filter(|o| o.excluded.is_some()) {
            let own: Vec<(usize, Strength)> = outline.strengths.iter().filter_map(|s| Some((place(s)?, s.clone()))).collect();
            if !own.is_empty() {
                present.names.push(outline.name.clone());
                present.strengths.extend(own);
            }
        }
        present
    }

    pub fn is_empty(&self) -> bool {
        self.strengths.is_empty()
    }

    /// The effect in the model that `effects` imitate, when those in the model take nearly all of the excess away: what is left is
    /// more likely its form (the rule for pairs, `Refits::objection`, one step later). With the share that they take.
    ///
    /// # Errors
    /// As [`fit`].
    pub fn imitated_by(&self, effects: &[String], reference: &Reference, now: &StructureTest, c: f64) -> Result<Option<(String, f64)>, ValidationError> {
        let Some(own) = self.names.iter().find(|own| effects.iter().any(|e| cards_confuse(reference.library, own, e))) else { return Ok(None) };
        let before = self.absent(reference.library, reference.observations, reference.impacts, reference.seed)?;
        let share = share_removed(excess_at(&before, c), excess_at(now, c));
        Ok((share > ALONE_SHARE).then(|| (own.clone(), share)))
    }

    /// The structure test of the model without its effects.
    fn absent(&self, library: &dyn Library, observations: &Observations, impacts: &[&Observation], seed: u64) -> Result<StructureTest, ValidationError> {
        let without = Without::new(library.current(), &self.strengths);
        let fitted = fit(&without, observations, impacts, &FitOptions::default(), None)?;
        Ok(structure_test(&fitted, observations, impacts, BesideSmooth::Known { groups: &[], lone_term: None }, seed))
    }
}

/// A model with the strengths of its effects held where they are absent.
struct Without<'a> {
    with: &'a dyn Forward,
    held: &'a [(usize, Strength)],
    free: Vec<FreeParameter>,
}

impl<'a> Without<'a> {
    fn new(with: &'a dyn Forward, held: &'a [(usize, Strength)]) -> Self {
        let moves = |i: usize| held.iter().all(|(at, _)| *at != i);
        let free = with.parameters().iter().enumerate().filter(|(i, _)| moves(*i)).map(|(_, p)| p.clone()).collect();
        Without { with, held, free }
    }
}

impl Forward for Without<'_> {
    fn parameters(&self) -> &[FreeParameter] {
        &self.free
    }

    fn prepare(&self, values: &[f64]) -> Result<Box<dyn Prediction + '_>, ValidationError> {
        let mut moving = values.iter();
        let all: Vec<f64> = (0..self.with.parameters().len())
            .filter_map(|i| self.held.iter().find(|(at, _)| *at == i).map(|(_, s)| s.absent).or_else(|| moving.next().copied()))
            .collect();
        self.with.prepare(&all)
    }

    fn costly(&self) -> bool {
        self.with.costly()
    }
}
