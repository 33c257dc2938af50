//! The report's sections: one file each, a pure function from plain results to a [`super::Section`], `None` without data.

mod agreement;
mod candidates;
mod comparison_verdict;
mod diagnosis_verdict;
mod expression;
mod face_maps;
mod fit_details;
mod glossary;
mod ledger;
mod next_experiments;
mod places;
mod polynomials;
mod provenance;
mod residuals;

pub use agreement::agreement;
pub use candidates::candidates;
pub use comparison_verdict::comparison_verdict;
pub use diagnosis_verdict::diagnosis_verdict;
pub use expression::expression;
pub use face_maps::face_maps;
pub use fit_details::fit_details;
pub use glossary::glossary;
pub use ledger::ledger;
pub use next_experiments::next_experiments;
pub use places::places;
pub use polynomials::polynomials;
pub use provenance::provenance;
pub use residuals::residuals;
