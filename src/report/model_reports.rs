//! The reports of `compare` and `diagnose`: which sections, in which order.

use super::page::Report;
use super::sections;
use crate::equipment::Racket;
use crate::provenance::Provenance;
use crate::validation::{Comparison, Diagnosis, LedgerEntry};

const COMPARE_METHODS: [&str; 2] = [
    "Predictions are made at estimates of the true inputs: each impact's measured inputs were corrected within their own noise, so that errors in the inputs do not pass for errors of the model. Every residual is weighed with the noise of the output and of the inputs carried through the model.",
    "Impacts are held out by a hash of their id, the same ones for ever. The structure test projects the residuals on smooth corrections of every kind, nuisance parameters taken out, and takes its p-value from random signs (wild bootstrap).",
];

const DIAGNOSE_METHODS: [&str; 1] = [
    "Candidates are screened by their signature at the fit with nuisance parameters projected out, the best refitted with the full model and ranked by Laplace evidence; an effect is accepted only when evidence, a test corrected for the size of the catalogue, and the held-out impacts agree.",
];

/// The report of `compare`. `title`: model and table, as the reader knows them. `ledger`: versions from the first to this one (may be empty); `before`: the comparison of the
/// version this one came from, for pictures before and after.
pub fn comparison_report(title: &str, comparison: &Comparison, racket: Option<&Racket>, ledger: &[&LedgerEntry], before: Option<&Comparison>) -> String {
    let records: Vec<(Option<&str>, &Provenance)> = comparison.provenance.iter().map(|p| (None, p)).collect();
    Report::new(title)
        .command("compare")
        .subtitle("Model against measurement")
        .section(sections::comparison_verdict(comparison))
        .section(sections::ledger(ledger, &before.into_iter().chain([comparison]).collect::<Vec<_>>()))
        .section(sections::agreement(comparison))
        .section(sections::residuals(comparison))
        .section(sections::face_maps(comparison, racket))
        .section(sections::polynomials(comparison))
        .section(sections::fit_details(&comparison.parameters_as_stated, &comparison.parameters_refitted, &comparison.outliers, &comparison.session_offsets))
        .section(sections::provenance(&COMPARE_METHODS, &records))
        .section(sections::glossary())
        .finish()
}

/// The last version, where it has more to fit than the first: an effect was added.
fn extended(versions: &[Comparison]) -> Option<&Comparison> {
    let free = |c: &Comparison| c.parameters_as_stated.len();
    versions.first().zip(versions.last()).filter(|(first, last)| free(last) > free(first)).map(|(_, last)| last)
}

/// The report of `diagnose`, with the same `title`. `comparison`: the diagnosed model's, its free parameters at their best; `versions`: those of all
/// versions of a walk, from the first to the last (may be empty).
pub fn diagnosis_report(
    title: &str,
    diagnosis: &Diagnosis,
    comparison: Option<&Comparison>,
    versions: &[Comparison],
    racket: Option<&Racket>,
    ledger: &[&LedgerEntry],
) -> String {
    let records: Vec<(Option<&str>, &Provenance)> =
        diagnosis.provenance.iter().chain(comparison.and_then(|c| c.provenance.as_ref())).map(|p| (None, p)).collect();
    let stated = comparison.map_or(&[][..], |c| &c.parameters_as_stated);
    let methods: Vec<&str> = DIAGNOSE_METHODS.iter().chain(&COMPARE_METHODS).copied().collect();
    let mut report = Report::new(title)
        .command("diagnose")
        .subtitle("What the model is missing")
        .section(sections::diagnosis_verdict(diagnosis, comparison, extended(versions)))
        .section(sections::ledger(ledger, &versions.iter().collect::<Vec<_>>()))
        .section(sections::places(diagnosis, comparison))
        .section(sections::candidates(diagnosis))
        .section(sections::expression(diagnosis))
        .section(sections::next_experiments(diagnosis, racket))
        .section(sections::equations(diagnosis));
    if let Some(c) = comparison {
        report =
            report.section(sections::agreement(c)).section(sections::residuals(c)).section(sections::face_maps(c, racket)).section(sections::polynomials(c));
    }
    report
        .section(sections::fit_details(stated, &diagnosis.parameters, &diagnosis.outliers, &diagnosis.session_offsets))
        .section(sections::provenance(&methods, &records))
        .section(sections::glossary())
        .finish()
}
