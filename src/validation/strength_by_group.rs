//! Whether an effect that the model has is of one strength in all groups of a column: one player's delay, one racket's tilt.
//!
//! The test of groups ([`super::by_group`]) asks for impulses that each group has of its own, and knows nothing of what an effect does to places and
//! inputs. At the fit with the effect the score of its strengths in each group is asked instead, with all that the fit moves projected out.

use super::by_group::parts;
use super::fit::Fit;
use super::observation::{Observation, Observations};
use super::project::{Nuisance, TOLD, project_out};
use super::tails::chi2_tail;
use nalgebra::DMatrix;

/// Level of the test, corrected for the columns of the table.
const LEVEL: f64 = 1e-4;

/// A column of the table whose groups differ in an effect's strength.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct UnlikeStrengths {
    pub column: String,
    /// Corrected for the number of columns.
    pub p_value: f64,
}

/// The column by whose groups the strengths at `parameters` differ most, where that is no chance. `fit` is that of `impacts`, `c` their noise scale.
pub(super) fn unlike_strengths(fit: &Fit, observations: &Observations, impacts: &[&Observation], parameters: &[usize], c: f64) -> Option<UnlikeStrengths> {
    let strengths: Vec<usize> = parameters.iter().filter(|p| fit.is_informed(**p)).filter_map(|p| fit.column_of(*p)).collect();
    if strengths.is_empty() {
        return None;
    }
    let nuisance = Nuisance::of(fit);
    let parted = parts(observations, impacts);
    let columns = parted.len() as f64;
    let unlike = |(column, of, groups): (String, Vec<Option<usize>>, usize)| {
        // The last group's strengths are those of all less the others'.
        let terms = (groups - 1) * strengths.len();
        let signature = |(design, group): (&DMatrix<f64>, &Option<usize>)| {
            let mut own = DMatrix::zeros(design.nrows(), terms);
            if let Some(g) = group.filter(|g| *g + 1 < groups) {
                strengths.iter().enumerate().for_each(|(k, at)| own.set_column(g * strengths.len() + k, &design.column(*at)));
            }
            own
        };
        let signatures: Vec<DMatrix<f64>> = fit.design.iter().zip(&of).map(signature).collect();
        let projected = project_out(fit, &nuisance, &signatures);
        let told: Vec<usize> = (0..terms).filter(|t| projected.keeps_more_than(TOLD, *t)).collect();
        let (gain, _) = projected.joint(&told).filter(|_| !told.is_empty())?;
        Some(UnlikeStrengths { column, p_value: (columns * chi2_tail(gain / c, told.len() as f64)).min(1.0) })
    };
    let all = parted.into_iter().filter_map(unlike);
    all.min_by(|a, b| a.p_value.total_cmp(&b.p_value)).filter(|u| u.p_value < LEVEL)
}
