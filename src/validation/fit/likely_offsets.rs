//! Offsets that no session has: a model that fails asks for an error of the cameras in the place of what it lacks.

use super::{Column, Fit, FitOptions, ValidationError, fit};
use crate::impact_table::{INPUTS, OUTPUTS, unit};
use crate::validation::forward::Forward;
use crate::validation::observation::{Observation, Observations};

/// An offset of so many deviations of what a session may have is none.
const UNLIKELY: f64 = 4.0;

/// An offset that no session has: a model that fails asks for it, in the place of what it lacks.
#[derive(Debug, Clone, PartialEq)]
pub struct UnlikelyOffset {
    /// Column of the table.
    pub column: &'static str,
    pub value: f64,
    /// In deviations of what a session may have.
    pub deviations: f64,
}

impl std::fmt::Display for UnlikelyOffset {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let UnlikelyOffset { column, value, deviations } = self;
        write!(f, "an offset of {value:+.3} {} in `{column}` for a whole session, {deviations:.0} times what one may be off by", unit(column))
    }
}

/// A fit without the offsets that no session has.
pub struct LikelyFit {
    /// Without any offset, where it asked for unlikely ones: parameters and residuals are then the model's as it predicts, not those of a model with an
    /// error of the cameras in the place of what it lacks.
    pub fit: Fit,
    /// The most unlikely offset it asked for, and the fit with it.
    pub unlikely: Option<(UnlikelyOffset, Fit)>,
}

impl LikelyFit {
    /// With offsets, however unlikely: errors on held-out impacts are compared with these.
    pub fn with_offsets(&self) -> &Fit {
        self.unlikely.as_ref().map_or(&self.fit, |(_, with)| with)
    }
}

/// [`fit`], and where it asks for offsets that no session has, once more without any.
///
/// # Errors
/// As [`fit`].
pub fn fit_with_likely_offsets(
    forward: &dyn Forward,
    observations: &Observations,
    impacts: &[&Observation],
    options: &FitOptions,
) -> Result<LikelyFit, ValidationError> {
    let with = fit(forward, observations, impacts, options, None)?;
    let Some(offset) = with.unlikely_offset() else { return Ok(LikelyFit { fit: with, unlikely: None }) };
    let without = fit(forward, observations, impacts, &FitOptions { offset_share: 0.0, ..options.clone() }, None)?;
    Ok(LikelyFit { fit: without, unlikely: Some((offset, with)) })
}

impl Fit {
    /// The offset farthest beyond what a session may have, if any is beyond [`UNLIKELY`].
    pub(in crate::validation) fn unlikely_offset(&self) -> Option<UnlikelyOffset> {
        let offsets = self.columns.iter().enumerate().filter_map(|(i, column)| {
            let column = match *column {
                Column::Offset { input, .. } => INPUTS[input],
                Column::OutputOffset { output, .. } => OUTPUTS[output],
                _ => return None,
            };
            Some(UnlikelyOffset { column, value: self.column_values[i], deviations: self.column_values[i].abs() * self.prior_precision[i].sqrt() })
        });
        offsets.filter(|o| o.deviations > UNLIKELY).max_by(|a, b| a.deviations.total_cmp(&b.deviations))
    }
}
