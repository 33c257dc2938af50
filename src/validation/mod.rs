//! `validation`: where model and measurement meet. Compare, see where the model fails, learn which effect is missing.
//!
//! Comes in: an [`crate::impact_table::ImpactTable`], the rackets and balls it names, a model. Goes out: plain,
//! serialisable results: [`Comparison`], [`Diagnosis`], [`Ledger`]. Racket-local axes, SI. The statistics see the model
//! only through [`Forward`] (parameters in, predictions out), so that tests can put another world behind it.
//!
//! The procedure: errors in inputs and outputs ([`fit`]), fixed held-out impacts ([`holdout`]), adequacy tests
//! ([`structure`], [`by_group`], `screen`, [`local_spot`]), non-linear refits ranked by evidence (`rank`), sparse expressions when no named effect
//! will do (`expression`). `docs/diagnosis.md` gives its measured error rates.

pub mod auto;
mod beside_the_tests;
pub mod by_group;
mod carried_noise;
mod case;
pub mod comparison;
pub mod diagnose;
pub mod diagnosis;
pub mod error;
pub mod experiments;
pub mod expression;
pub mod expression_terms;
pub mod fit;
pub mod forward;
pub mod heldout;
pub mod holdout;
mod judgement;
pub mod ledger;
pub mod linearise;
mod linearise_all;
pub mod local_spot;
pub mod lone_term;
mod misread_columns;
pub mod model_library;
mod neighbours;
pub mod noise;
pub mod observation;
mod one_sided;
mod outliers_together;
mod own_strengths;
pub mod place;
pub mod polynomial;
pub mod predicted;
mod present;
pub mod project;
pub mod rank;
pub mod refits;
pub mod screen;
pub mod session_shift;
pub mod smooth;
pub mod step_in_order;
mod strength_by_group;
pub mod structure;
mod tails;
pub mod terminal;
pub mod unseen_spin;
pub mod verdict_words;

pub use comparison::{Adequacy, Comparison, compare};
pub use diagnosis::{Diagnosis, Verdict};
pub use error::ValidationError;
pub use fit::{Fit, FitOptions};
pub use forward::{Forward, FreeParameter, Prediction};
pub use ledger::{Ledger, LedgerEntry};
pub use observation::{Observation, Observations};
