//! Predicted beside measured when there are too few shots for a verdict: no fit, no test, just the points.

use crate::impact_table::{OUTPUTS, column_words};
use crate::report::chart::{Chart, Colour, Legend, Points};
use crate::report::markup::{rounded, significant, with_sd};
use crate::report::page::{Layout, Section, Table};
use crate::report::session_results::PredictedShot;

/// One panel per output that was both measured and predicted, and the numbers; `None` without such a shot.
pub fn few_shots(shots: &[PredictedShot]) -> Option<Section> {
    let mut panels = Vec::new();
    let mut table = Table::new("Every output of every shot; ±: one standard deviation of the measured output alone; difference: measured less predicted.")
        .column("shot")
        .column("output")
        .column("unit")
        .numbers("measured (± sd)")
        .numbers("predicted")
        .numbers("difference");
    for name in OUTPUTS {
        let w = column_words(name);
        let pairs: Vec<_> = shots.iter().filter_map(|s| Some((&s.measured.id, s.measured.get(name)?, s.predicted.get(name)?.value))).collect();
        if pairs.is_empty() {
            continue;
        }
        let at: Vec<(f64, f64)> = pairs.iter().map(|(_, m, p)| (w.factor * m.value, w.factor * p)).collect();
        let bars: Vec<f64> = pairs.iter().map(|(_, m, _)| w.factor * m.sd.unwrap_or(0.0)).collect();
        let labels: Vec<String> = pairs.iter().map(|(id, _, _)| (*id).clone()).collect();
        let chart = Chart::new(&w.words)
            .size(210.0, 205.0)
            .describe(&format!("{} shots: predicted {} against measured, with the line of equality.", at.len(), w.words))
            .x("measured", w.unit)
            .y("predicted", w.unit)
            .identity_line()
            .legend(Legend::Hidden)
            .add(Points::new(&at).colour(Colour::BLUE).x_error(&bars).labels(&labels));
        panels.push((chart.to_svg(), String::new()));
        for (id, m, p) in pairs {
            let measured = m.sd.map_or_else(|| significant(w.factor * m.value, 4), |sd| with_sd(w.factor * m.value, w.factor * sd));
            // To the places the measurement is known to.
            let (predicted, difference) = match m.sd {
                Some(sd) => (rounded(w.factor * p, w.factor * sd), rounded(w.factor * (m.value - p), w.factor * sd)),
                None => (significant(w.factor * p, 4), significant(w.factor * (m.value - p), 3)),
            };
            table = table.row(&[id.clone(), w.words.clone(), w.unit.to_owned(), measured, predicted, difference]);
        }
    }
    if panels.is_empty() {
        return None;
    }
    Some(
        Section::new("few-shots", "Predicted against measured")
            .note("The model as its file states it, nothing fitted: these are too few shots to judge a model by. Dashed: prediction equals measurement. Bars: one standard deviation of the measured value.")
            .figures(Layout::Small, &panels)
            .table(table),
    )
}
