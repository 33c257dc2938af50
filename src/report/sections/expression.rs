//! A formula found from the residuals, ready to paste into the model file.

use super::candidates::estimates;
use crate::report::markup::{fixed, percent};
use crate::report::page::Section;
use crate::validation::diagnosis::Diagnosis;
use crate::validation::structure::floor_text;

pub fn expression(d: &Diagnosis) -> Option<Section> {
    let e = d.suggested_expression.as_ref()?;
    let heading = if d.other_form.is_some() { "A better form of the effect" } else { "A formula for what is missing" };
    let mut section = Section::new("expression", heading).paragraph(&e.words).paragraph(&format!(
        "In place of {}: {}. It removes {} of the excess; held-out error after it {} (now {}, noise floor {}).",
        e.replaces,
        e.expression,
        percent(e.share_removed),
        fixed(e.heldout_error_after, 2),
        fixed(d.heldout_error, 2),
        floor_text(d.noise_floor)
    ));
    if !e.parameters.is_empty() {
        section = section.note(&estimates(&e.parameters));
    }
    section = section.paragraph("To use it, paste this into the model file:").code(&e.model_file_text);
    if !e.nearest.is_empty() {
        section = section.paragraph(&format!("The nearest known physics: {}.", e.nearest.join(", ")));
    }
    Some(section)
}
