//! Predicted against measured, one panel per output with the line y = x (thesis figure 2.38), and the table of errors.

use super::residuals::parameters_taken;
use crate::impact_table::column_words;
use crate::report::chart::{Chart, Colour, Legend, Points, Symbol};
use crate::report::markup::{fixed, odds, significant, with_sd};
use crate::report::page::{Layout, Section, Table};
use crate::validation::Comparison;
use crate::validation::comparison::{ImpactPoint, OutputPoint, OutputSummary};

/// Error bars are drawn up to this many impacts; beyond it they hide the points.
const MOST_BARS: usize = 120;

/// One panel per measured output and the table of errors; `None` without impacts.
pub fn agreement(comparison: &Comparison) -> Option<Section> {
    if comparison.impacts.is_empty() || comparison.outputs.is_empty() {
        return None;
    }
    let panels: Vec<(String, String)> = comparison.outputs.iter().map(|o| (panel(comparison, &o.name), String::new())).collect();
    let mut table = Table::new("Each output over all impacts; the noise is that of the output and of the inputs, carried through the model. Errors are measured less predicted; ±: one standard deviation of the mean.")
        .column("output")
        .column("column")
        .column("unit")
        .numbers("n")
        .numbers("rms error")
        .numbers("mean error (± sd)")
        .numbers("noise sd")
        .numbers("reduced χ²")
        .numbers("p");
    for o in &comparison.outputs {
        let w = column_words(&o.name);
        let show = |v: f64| significant(v * w.factor, 3);
        let p = odds(o.p_value);
        table = table.row(&[
            w.words.clone(),
            o.name.clone(),
            w.unit.to_owned(),
            o.n.to_string(),
            show(o.rmse),
            with_sd(o.bias * w.factor, standard_error(o) * w.factor),
            show(o.noise_sd),
            fixed(o.chi2_reduced, 2),
            p,
        ]);
    }
    Some(
        Section::new("agreement", "Predicted against measured")
            .note(&format!("{} Blue circles: impacts the fit used; orange squares: impacts held out. Dashed: prediction equals measurement. Bars{}: one standard deviation of the difference, noise of inputs included.", parameters_taken(comparison), if comparison.impacts.len() > MOST_BARS { " (left out here: they would hide the points)" } else { "" }))
            .figures(Layout::Small, &panels)
            .table(table),
    )
}

/// Standard deviation of the mean error: that of the scatter about it, over the root of the number.
fn standard_error(o: &OutputSummary) -> f64 {
    ((o.rmse.powi(2) - o.bias.powi(2)).max(0.0) / (o.n as f64 - 1.0).max(1.0)).sqrt()
}

/// The pairs (impact, point) of one output.
pub(super) fn points_of<'a>(comparison: &'a Comparison, output: &str) -> Vec<(&'a ImpactPoint, &'a OutputPoint)> {
    let Some(k) = comparison.output_names.iter().position(|n| n == output) else {
        return Vec::new();
    };
    comparison.impacts.iter().flat_map(|i| i.outputs.iter().filter(move |p| p.output == k).map(move |p| (i, p))).collect()
}

fn panel(comparison: &Comparison, output: &str) -> String {
    let w = column_words(output);
    let points = points_of(comparison, output);
    let mut chart = Chart::new(&w.words)
        .size(210.0, 205.0)
        .describe(&format!("{} impacts: predicted {} against measured, with the line of equality.", points.len(), w.words))
        .x("measured", w.unit)
        .y("predicted", w.unit)
        .identity_line()
        .legend(Legend::Hidden);
    for held_out in [false, true] {
        let side: Vec<_> = points.iter().filter(|(i, _)| i.held_out == held_out).collect();
        let at: Vec<(f64, f64)> = side.iter().map(|(_, p)| (w.factor * p.measured, w.factor * p.predicted)).collect();
        let (symbol, colour) = if held_out { (Symbol::Square, Colour::ORANGE) } else { (Symbol::Circle, Colour::BLUE) };
        let mut layer = Points::new(&at).symbol(symbol).colour(colour).size(if points.len() > 200 { 2.0 } else { 3.4 });
        if points.len() <= MOST_BARS {
            let bars: Vec<f64> = side.iter().map(|(_, p)| w.factor * p.sd).collect();
            layer = layer.y_error(&bars);
        }
        chart = chart.add(layer);
    }
    chart.to_svg()
}
