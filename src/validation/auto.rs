//! `diagnose --auto`: one effect at a time. Which is tried next, when it is refused, when to stop, and whether a formula takes what is left.

use super::comparison::{Comparison, compare};
use super::diagnose::{DiagnoseOptions, diagnose, fit_current};
use super::diagnosis::{Diagnosis, Verdict};
use super::error::ValidationError;
use super::expression::{FOUND_EFFECT, WORTH_A_FORMULA};
use super::fit::{FitOptions, fit_with_likely_offsets};
use super::forward::Library;
use super::heldout::{error_of, held_out_error, is_worth, linearise_held_out};
use super::ledger::Refusal;
use super::linearise::Linearised;
use super::model_library::ModelLibrary;
use super::observation::Observations;
use crate::impact::Model;
use crate::impact::model_file::{with_effect_added, with_values};
use std::path::Path;

/// A model on its way to what explains the impacts.
pub struct Walk<'a> {
    observations: &'a Observations,
    options: &'a DiagnoseOptions,
    /// Name of the model file, for messages.
    path: &'a Path,
    most_effects: usize,
    /// The model file's text, its free parameters at their best, and the held-out impacts with it.
    pub text: String,
    held_out: Vec<Linearised>,
    pub diagnosis: Diagnosis,
    /// Number of effects.
    pub added: usize,
    /// Effects that did not earn their place beside those the model has now.
    pub refused: Vec<Refusal>,
}

/// The held-out error before and after something was added, or why it was not.
pub enum Tried {
    Added { before: f64, after: f64 },
    Refused { reason: String },
}

impl<'a> Walk<'a> {
    /// From the model of a text and what was found of it. It starts with the model at its best: an effect must beat that, not the file's first guesses.
    ///
    /// # Errors
    /// [`ValidationError`] when a model has no answer for an impact, here as in every step.
    pub fn new(
        text: &str,
        path: &'a Path,
        diagnosis: &Diagnosis,
        observations: &'a Observations,
        options: &'a DiagnoseOptions,
        most_effects: usize,
    ) -> Result<Self, ValidationError> {
        let diagnosis = diagnosis.clone();
        let start = Walk { observations, options, path, most_effects, text: text.to_owned(), held_out: Vec::new(), diagnosis, added: 0, refused: Vec::new() };
        let (text, held_out) = start.fitted(text)?;
        Ok(Walk { text, held_out, ..start })
    }

    /// The model against the impacts.
    pub fn comparison(&self) -> Result<Comparison, ValidationError> {
        compare(self.library(&self.text)?.current(), self.observations, &self.options.model, self.options.seed)
    }

    /// The first effect that the diagnosis recommends and that was not refused here; none when there are enough.
    pub fn next_effect(&self) -> Option<String> {
        let untried = |e: &&String| !self.refused.iter().any(|r| r.effect == **e);
        self.diagnosis.recommended.iter().find(untried).filter(|_| self.added < self.most_effects).cloned()
    }

    /// Adds an effect, unless the held-out impacts do not gain by it.
    pub fn try_effect(&mut self, effect: &str) -> Result<Tried, ValidationError> {
        let (text, held_out) = self.fitted(&with_effect_added(&self.text, effect, self.path)?)?;
        let (mut before, mut after) = (error_of(&self.held_out), error_of(&held_out));
        if after >= before {
            // An offset that no session has may hold the place of what is added: then that is no loss.
            (before, after) = (self.error_as_predicted(&self.text)?, self.error_as_predicted(&text)?);
        }
        if after >= before {
            let reason = format!("the error on held-out impacts does not fall ({before:.3} to {after:.3})");
            self.refused.push(Refusal { effect: effect.to_owned(), reason: reason.clone(), heldout_error_before: before, heldout_error_after: after });
            return Ok(Tried::Refused { reason });
        }
        self.added += 1;
        self.refused.clear();
        self.go_on(text, held_out)?;
        Ok(Tried::Added { before, after })
    }

    /// What is left may be nature's own form of the effects found, or something in no catalogue: adds the formula found for it, where it is worth its
    /// search; its words, with the held-out error before and after.
    pub fn try_formula(&mut self) -> Result<Option<(String, f64, f64)>, ValidationError> {
        let offered = self.diagnosis.suggested_expression.as_ref().filter(|_| self.diagnosis.verdict == Verdict::Unexplained);
        let Some(formula) = offered else { return Ok(None) };
        if self.library(&self.text)?.has_effect(FOUND_EFFECT) {
            return Ok(None);
        }
        let with_formula = format!("{}\n\n{}\n", self.text.trim_end(), formula.model_file_text.trim_end());
        // A formula that does not go with what is in the model already is left for the user to look at.
        let Ok((text, held_out)) = self.fitted(&with_formula) else { return Ok(None) };
        if !is_worth(WORTH_A_FORMULA, &self.held_out, &held_out, self.diagnosis.noise_floor.powi(2)) {
            return Ok(None);
        }
        let told = (formula.words.clone(), error_of(&self.held_out), error_of(&held_out));
        self.go_on(text, held_out)?;
        Ok(Some(told))
    }

    fn go_on(&mut self, text: String, held_out: Vec<Linearised>) -> Result<(), ValidationError> {
        self.diagnosis = diagnose(&self.library(&text)?, self.observations, self.options)?;
        (self.text, self.held_out) = (text, held_out);
        Ok(())
    }

    fn library(&self, text: &str) -> Result<ModelLibrary, ValidationError> {
        Ok(ModelLibrary::new(Model::parse(text, self.path)?, &self.observations.gear))
    }

    /// The held-out error of a text's model without offsets that no session has.
    fn error_as_predicted(&self, text: &str) -> Result<f64, ValidationError> {
        let library = self.library(text)?;
        let likely = fit_with_likely_offsets(library.current(), self.observations, &self.observations.side(false), &FitOptions::default())?;
        held_out_error(library.current(), &likely.fit, self.observations)
    }

    /// A text with its free parameters at their best, and the held-out impacts with it.
    fn fitted(&self, text: &str) -> Result<(String, Vec<Linearised>), ValidationError> {
        let library = self.library(text)?;
        let fit = fit_current(&library, self.observations)?;
        let held_out = linearise_held_out(library.current(), &fit, self.observations, &self.observations.side(true))?;
        Ok((with_values(text, &fit.named_values(), self.path)?, held_out))
    }
}
