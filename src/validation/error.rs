//! What can stop a comparison, by cause.

use crate::equipment::EquipmentError;

#[derive(Debug, thiserror::Error)]
pub enum ValidationError {
    #[error(
        "only {usable} of {rows} impacts can be used ({reason}); at least {needed} are needed to judge a model (`sweetspot predict` works with any number)"
    )]
    TooFew { usable: usize, rows: usize, needed: usize, reason: String },
    #[error("the ids of all impacts hash to one side of the held-out split, and none is left to check or to fit with; add impacts")]
    NothingHeldOut,
    #[error(
        "all impacts are of one group of `{column}` ({name:?}), and groups stay whole: there is none to hold out beside one to fit; leave out --group, or name a column with several"
    )]
    OneGroup { column: String, name: String },
    #[error("the table has no grouping column `{column}`; it has: {}; or leave out --group", if .seen.is_empty() { "none" } else { .seen })]
    NoGroup { column: String, seen: String },
    #[error("the model cannot predict {failed} of {rows} impacts (first: {id:?}{}); check its parameters and the table's units", .why.as_ref().map_or_else(String::new, |w| format!(": {w}")))]
    NoPrediction { failed: usize, rows: usize, id: String, why: Option<String> },
    #[error("the fit did not settle: {reason}; fix some of the free parameters (fit = false) or narrow their limits")]
    NoFit { reason: String },
    #[error("effect {name:?} is not in the catalogue and not in the model; `sweetspot effects` lists what there is")]
    UnknownEffect { name: String },
    #[error("model: {0}")]
    Model(String),
    #[error("interrupted")]
    Interrupted,
    #[error(transparent)]
    Equipment(#[from] EquipmentError),
}
