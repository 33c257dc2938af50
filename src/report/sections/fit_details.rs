//! Parameters, outliers and session offsets of a comparison or a diagnosis.

use crate::impact_table::column_words;
use crate::report::markup::{fixed, significant, with_sd};
use crate::report::page::{Section, Table};
use crate::report::parameter_unit::parameter_unit;
use crate::validation::comparison::{Outlier, ParameterValue, SessionOffset};

/// Tables of the fit; `None` when all are empty. `stated` are the parameters as the model file has them.
pub fn fit_details(stated: &[ParameterValue], fitted: &[ParameterValue], outliers: &[Outlier], offsets: &[SessionOffset]) -> Option<Section> {
    let mut parameters = Table::new("Free parameters; unit 1: a plain number")
        .column("parameter")
        .column("unit")
        .numbers("in the model file")
        .numbers("fitted (± sd)")
        .column("remark");
    for p in fitted {
        let before = stated.iter().find(|s| s.name == p.name).map_or_else(|| "–".to_owned(), |s| significant(s.value, 4));
        let (after, remark) = match (p.undetermined, p.at_limit) {
            (true, _) if p.is_held() => (significant(p.value, 4), "held fixed: its min and max are the same"),
            (true, _) => (significant(p.value, 4), "not determined by these impacts"),
            (false, true) => (with_sd(p.value, p.sd), p.limit_words()),
            (false, false) => (with_sd(p.value, p.sd), ""),
        };
        parameters = parameters.row(&[p.name.clone(), parameter_unit(&p.name).to_owned(), before, after, remark.to_owned()]);
    }
    let mut odd = Table::new(
        "Measured numbers far from what the model makes of their impact; they were given less weight (while a model fails they may show what it lacks)",
    )
    .column("impact")
    .column("quantity")
    .column("column")
    .numbers("residual (own sd)");
    for o in outliers {
        odd = odd.row(&[o.id.clone(), column_words(&o.column).words, o.column.clone(), fixed(o.standardised, 1)]);
    }
    let mut shared = Table::new("Offsets that all impacts of a session share, fitted with the sd they may have")
        .column("session")
        .column("input")
        .numbers("offset (± sd)")
        .numbers("allowed sd")
        .column("unit");
    for o in offsets.iter().filter(|o| o.prior_sd > 0.0) {
        let w = column_words(&o.input);
        let prior = significant(w.factor * o.prior_sd, 2);
        shared = shared.row(&[o.session.clone(), w.words, with_sd(w.factor * o.value, w.factor * o.sd), prior, w.unit.to_owned()]);
    }
    if parameters.is_empty() && odd.is_empty() && shared.is_empty() {
        return None;
    }
    let section = Section::new("fit", "Parameters, outliers, offsets").table(parameters).table(odd);
    Some(section.folded("Session offsets", |s| s.table(shared)))
}
