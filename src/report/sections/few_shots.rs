//! Predicted beside measured when there are too few shots for a verdict: no fit, no test, just the points.

use crate::impact_table::{ColumnWords, Measured, OUTPUTS, column_words};
use crate::report::chart::{Chart, Colour, Legend, Points};
use crate::report::markup::{fixed, rounded, significant, with_sd};
use crate::report::page::{Layout, Section, Table};
use crate::report::session_results::PredictedShot;

/// One output of one shot, in the units people read.
struct Pair<'a> {
    shot: &'a str,
    measured: f64,
    predicted: f64,
    /// Of the measurement, and of the prediction by the inputs' deviations.
    sd: [Option<f64>; 2],
}

impl<'a> Pair<'a> {
    fn of(shot: &'a PredictedShot, output: &str, words: &ColumnWords) -> Option<Self> {
        let number = |m: &Measured| words.factor * m.value;
        let (measured, predicted) = (shot.measured.get(output)?, shot.predicted.get(output)?);
        let by_inputs = shot.predicted_sd.as_ref().and_then(|row| row.get(output));
        let sd = [measured.sd.map(|sd| words.factor * sd), by_inputs.map(|m| number(&m))];
        Some(Pair { shot: &shot.measured.id, measured: number(&measured), predicted: number(&predicted), sd })
    }

    /// Measured less predicted.
    fn difference(&self) -> f64 {
        self.measured - self.predicted
    }

    /// Its deviation: those of output and inputs, as if they were independent.
    fn difference_sd(&self) -> Option<f64> {
        let [measured, predicted] = self.sd;
        Some(measured?.hypot(predicted.unwrap_or(0.0))).filter(|sd| *sd > 0.0)
    }

    /// To the places that `sd` tells.
    fn shown(value: f64, sd: Option<f64>) -> String {
        sd.map_or_else(|| significant(value, 4), |sd| with_sd(value, sd))
    }
}

/// One panel per output that was both measured and predicted, and the numbers; `None` without such a shot. `model` is its file's name.
pub fn few_shots(shots: &[PredictedShot], model: Option<&str>) -> Option<Section> {
    let mut panels = Vec::new();
    let mut of_shots = Table::new(
        "Every output of every shot; ±: one standard deviation, of the prediction by the measured inputs'; difference: measured less predicted, its deviation as if both were independent.",
    )
    .column("shot")
    .column("output")
    .column("unit")
    .numbers("measured (± sd)")
    .numbers("predicted (± sd)")
    .numbers("difference (± sd)")
    .numbers("in sd");
    let mut of_outputs =
        Table::new("Over these shots: mean and root mean square of measured less predicted, and the latter in units of its deviation (1: noise alone).")
            .column("output")
            .column("unit")
            .numbers("shots")
            .numbers("mean difference")
            .numbers("rms difference")
            .numbers("rms / sd");
    for name in OUTPUTS {
        let w = column_words(name);
        let pairs: Vec<Pair> = shots.iter().filter_map(|s| Pair::of(s, name, &w)).collect();
        if pairs.is_empty() {
            continue;
        }
        let bars = |k: usize| -> Vec<f64> { pairs.iter().map(|p| p.sd[k].unwrap_or(0.0)).collect() };
        let at: Vec<(f64, f64)> = pairs.iter().map(|p| (p.measured, p.predicted)).collect();
        let labels: Vec<String> = pairs.iter().map(|p| p.shot.to_owned()).collect();
        let chart = Chart::new(&w.words)
            .size(210.0, 205.0)
            .describe(&format!("{} shots: predicted {} against measured, with the line of equality.", at.len(), w.words))
            .x("measured", w.unit)
            .y("predicted", w.unit)
            .identity_line()
            .legend(Legend::Hidden)
            .add(Points::new(&at).colour(Colour::BLUE).x_error(&bars(0)).y_error(&bars(1)).labels(&labels));
        panels.push((chart.to_svg(), String::new()));
        for p in &pairs {
            let sd = p.difference_sd();
            let in_sd = sd.map_or_else(String::new, |sd| fixed(p.difference() / sd, 1));
            let measured = Pair::shown(p.measured, p.sd[0]);
            let predicted = match p.sd {
                [Some(sd), None] => rounded(p.predicted, sd),
                [_, sd] => Pair::shown(p.predicted, sd),
            };
            of_shots = of_shots.row(&[p.shot.to_owned(), w.words.clone(), w.unit.to_owned(), measured, predicted, Pair::shown(p.difference(), sd), in_sd]);
        }
        let n = pairs.len() as f64;
        let rms = |of: &dyn Fn(&Pair) -> Option<f64>| -> Option<f64> { Some((pairs.iter().map(|p| of(p).map(|v| v * v)).sum::<Option<f64>>()? / n).sqrt()) };
        let mean = pairs.iter().map(Pair::difference).sum::<f64>() / n;
        let (size, in_sd) = (rms(&|p| Some(p.difference())), rms(&|p| Some(p.difference() / p.difference_sd()?)));
        let typical = rms(&|p| p.difference_sd());
        let show = |v: f64| typical.map_or_else(|| significant(v, 3), |sd| rounded(v, sd));
        of_outputs = of_outputs.row(&[
            w.words.clone(),
            w.unit.to_owned(),
            pairs.len().to_string(),
            show(mean),
            size.map_or_else(String::new, show),
            in_sd.map_or_else(String::new, |v| fixed(v, 1)),
        ]);
    }
    if panels.is_empty() {
        return None;
    }
    let named = model.map_or_else(|| "The model".to_owned(), |file| format!("The model `{file}`"));
    let section = Section::new("few-shots", "Predicted against measured")
        .note(&format!("{named} as its file states it, nothing fitted: these are too few shots to judge a model by. Dashed: prediction equals measurement. Bars: one standard deviation, of the prediction by the measured inputs'."))
        .figures(Layout::Small, &panels);
    Some(if shots.len() > 1 { section.table(of_outputs) } else { section }.table(of_shots))
}
