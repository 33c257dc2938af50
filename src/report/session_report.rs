//! The report of a session: from the calibration to what the model is missing.

use super::page::Report;
use super::sections;
use super::session_results::SessionResults;
use crate::provenance::Provenance;

const METHODS: [&str; 2] = [
    "Cameras are calibrated from checkerboard pairs by one adjustment over both cameras; points are triangulated where their pixels are most likely; velocities come from laws of motion fitted to the image points of each side of the contact, never across it.",
    "Every value carries one standard deviation, propagated from the image points and the calibration.",
];

/// The whole page. Sections without data are left out.
pub fn session_report(results: &SessionResults) -> String {
    let of_shots = results.shots.iter().filter_map(|s| Some((Some(s.id.as_str()), &s.record.as_ref()?.provenance)));
    let of_tables = results.comparison.iter().filter_map(|c| c.provenance.as_ref()).chain(results.diagnosis.iter().filter_map(|d| d.provenance.as_ref()));
    let records: Vec<(Option<&str>, &Provenance)> = of_shots.chain(of_tables.map(|p| (None, p))).collect();
    let racket = results.shots.first().map(|s| &s.racket);
    let path: Vec<_> = results.ledger.iter().collect();
    // Footage alone has no model; what was compared belongs in the title where there is one.
    let judged = results.comparison.as_ref().map(|c| c.model.as_str()).or(results.diagnosis.as_ref().map(|d| d.model.as_str()));
    let model = judged.or(results.model.as_deref().filter(|_| !results.predicted.is_empty()));
    let mut report = Report::new(&results.name)
        .command(&model.map_or_else(|| "session report".to_owned(), |m| format!("session report with {m}")))
        .subtitle(&format!(
            "{} shot{}, {} frames a second",
            results.shots.len(),
            if results.shots.len() == 1 { "" } else { "s" },
            super::markup::fixed(results.frame_rate_hz, 0)
        ))
        .section(sections::session_verdict(results));
    if let Some(d) = &results.diagnosis {
        // The pictures show what the words speak of.
        report = report
            .section(sections::places(d, results.at_its_best.as_ref()))
            .section(sections::candidates(d))
            .section(sections::expression(d))
            .section(sections::next_experiments(d, racket))
            .section(sections::equations(d));
    }
    report = report
        .section(sections::ledger(&path, &results.comparison.iter().filter(|_| results.after.is_some()).chain(&results.after).collect::<Vec<_>>()))
        .section(results.rig.as_ref().map(|rig| sections::calibration(rig, results.axes_known)))
        .section(sections::tracks(results))
        .section(sections::trajectories(results))
        .section(sections::shots(results))
        .section(sections::season(results));
    if results.comparison.is_none() {
        report = report.section(sections::few_shots(&results.predicted, results.model.as_deref()));
    }
    if let Some(c) = &results.comparison {
        report = report
            .section(sections::agreement(c))
            .section(sections::residuals(c))
            .section(sections::face_maps(c, racket))
            .section(sections::polynomials(c))
            .section(sections::fit_details(&c.parameters_as_stated, &c.parameters_refitted, &c.outliers, &c.session_offsets));
    }
    report.section(sections::provenance(&METHODS, &records)).section(sections::glossary()).finish()
}
