//! Residuals in units of their own deviation against every input, with a smooth and its 95 % band: where the model fails.

use super::agreement::points_of;
use crate::impact_table::column_words;
use crate::quantity::HOLD_95_PERCENT;
use crate::report::chart::{Band, Cells, Chart, Colour, Legend, Line, Points, Rule};
use crate::report::markup::fixed;
use crate::report::page::{Layout, Section};
use crate::validation::Comparison;
use crate::validation::comparison::NormalSigns;
use crate::validation::smooth::{SmoothCurve, smooth};
use std::collections::BTreeSet;

/// Points drawn on all residual panels together; above it every k-th impact is drawn (the smooth uses all).
const MOST_MARKS: usize = 100_000;
const CURVE_POINTS: usize = 41;
/// Panels shown at once, those with the clearest trend; the rest is behind a click.
const SHOWN: usize = 6;

/// A residual panel in data form.
pub(super) struct Trend {
    pub output: String,
    pub input: String,
    /// (input in its shown unit, standardised residual)
    pub points: Vec<(f64, f64)>,
    pub curve: Option<SmoothCurve>,
    /// Greatest distance of the smooth from the mean of all points, in half-widths of its band: an offset is no trend.
    pub strength: f64,
}

/// The names, each where it stands first.
fn each_once<'a>(names: impl Iterator<Item = &'a str>) -> Vec<&'a str> {
    let mut met = BTreeSet::new();
    names.filter(|name| met.insert(*name)).collect()
}

/// All pairs of output and varied input.
pub(super) fn trends(comparison: &Comparison) -> Vec<Trend> {
    let inputs = each_once(comparison.residual_curves.iter().map(|c| c.input.as_str()));
    let signs = NormalSigns::of(comparison.impacts.iter().map(|i| i.inputs.as_slice()));
    let mut all = Vec::new();
    for o in &comparison.outputs {
        let points = points_of(comparison, &o.name);
        for input in &inputs {
            let Some(j) = comparison.input_names.iter().position(|n| n == input) else { continue };
            let factor = column_words(input).factor;
            let at: Vec<(f64, f64)> =
                points.iter().filter_map(|(i, p)| i.inputs.get(j).map(|x| (factor * x, signs.of_output(&o.name, &i.inputs) * p.standardised()))).collect();
            let curve = smooth(&at, CURVE_POINTS);
            let strength = curve.as_ref().map_or(0.0, |c| strength(c, mean_of(&at)));
            all.push(Trend { output: o.name.clone(), input: (*input).to_owned(), points: at, curve, strength });
        }
    }
    all
}

/// Trends from the clearest down, at most so many of each output: one bad output must not hide the others.
pub(super) fn strongest(trends: &[Trend], of_each: usize) -> Vec<&Trend> {
    let mut order: Vec<&Trend> = trends.iter().collect();
    order.sort_by(|a, b| b.strength.total_cmp(&a.strength).then_with(|| (&a.output, &a.input).cmp(&(&b.output, &b.input))));
    let mut kept: Vec<&Trend> = Vec::new();
    for t in order {
        if kept.iter().filter(|k| k.output == t.output).count() < of_each {
            kept.push(t);
        }
    }
    kept
}

fn strength(curve: &SmoothCurve, mean: f64) -> f64 {
    let each = curve.mean.iter().zip(curve.low.iter().zip(&curve.high)).map(|(m, (l, h))| (m - mean).abs() / (0.5 * (h - l)).max(1e-9));
    each.fold(0.0, f64::max)
}

fn mean_of(points: &[(f64, f64)]) -> f64 {
    points.iter().map(|p| p.1).sum::<f64>() / points.len().max(1) as f64
}

/// The mean of all residuals of an output, in half-widths of its own 95 % interval.
fn offset(points: &[(f64, f64)]) -> f64 {
    let (n, mean) = (points.len() as f64, mean_of(points));
    let variance = points.iter().map(|p| (p.1 - mean).powi(2)).sum::<f64>() / (n - 1.0).max(1.0);
    (mean / (HOLD_95_PERCENT * (variance / n).sqrt()).max(1e-9)).abs()
}

/// Which parameters the figures of a comparison are drawn with, as a sentence.
pub(super) fn parameters_taken(comparison: &Comparison) -> &'static str {
    let best = (comparison.heldout_error - comparison.heldout_error_refitted).abs() < 0.01 * comparison.heldout_error;
    if best { "The free parameters of the model are at their best." } else { "The parameters are those stated in the model file." }
}

/// The overview matrix, the clearest trends, and all panels folded per output.
pub fn residuals(comparison: &Comparison) -> Option<Section> {
    let trends = trends(comparison);
    if trends.is_empty() {
        return None;
    }
    let marks: usize = trends.iter().map(|t| t.points.len()).sum();
    let every = marks.div_ceil(MOST_MARKS).max(1);
    let order = strongest(&trends, 2);
    let clearest: Vec<(String, String)> = order
        .iter()
        .take(SHOWN)
        .map(|t| {
            let title = format!("{} against {}", column_words(&t.output).words, column_words(&t.input).words);
            (panel(t, &title, every, (340.0, 230.0), reach(&t.points)), String::new())
        })
        .collect();
    let taken = parameters_taken(comparison);
    let mut section = Section::new("residuals", "Residuals against every input")
        .note(&format!("Measured less predicted, each in units of its own standard deviation. A sound model scatters about zero with unit spread whatever the input. Line and band: the local mean and its 95 % interval; rings on the border: points beyond it. {taken}"))
        .figures(Layout::Wide, &[(matrix(comparison, &trends), "Colour: how far the local mean of the residuals goes from the mean of all impacts, at most, in half-widths of its 95 % band; bottom row: how far the mean of all lies from zero, in half-widths of its own interval. Values up to about 2 are what chance gives over a curve, up to 1 in the bottom row.".to_owned())])
        .heading("The clearest trends")
        .figures(Layout::Normal, &clearest);
    if every > 1 {
        section = section.note(&format!("Every {every}th impact is drawn; the curves use all."));
    }
    for o in &comparison.outputs {
        let own: Vec<(String, String)> = trends
            .iter()
            .filter(|t| t.output == o.name)
            .map(|t| (panel(t, &format!("against {}", column_words(&t.input).words), every, (210.0, 160.0), reach(&t.points)), String::new()))
            .collect();
        section = section.folded(&format!("{}: all inputs", column_words(&o.name).words), |s| s.figures(Layout::Small, &own));
    }
    Some(section)
}

/// Half-height of a residual panel, own sd: a few outliers must not flatten the picture; they stand as rings on the edge.
pub(super) fn reach(points: &[(f64, f64)]) -> f64 {
    (1.3 * usual_size(points).unwrap_or(3.0)).max(3.2)
}

/// The size that 97 of 100 ordinates stay below.
pub(super) fn usual_size(points: &[(f64, f64)]) -> Option<f64> {
    let mut sizes: Vec<f64> = points.iter().map(|p| p.1.abs()).filter(|v| v.is_finite()).collect();
    sizes.sort_by(f64::total_cmp);
    sizes.get(sizes.len() * 97 / 100).copied()
}

/// A smooth with its band, ordinates times `scale`.
pub(super) fn curve_layers(c: &SmoothCurve, scale: f64) -> (Band, Line) {
    let ordinates = c.mean.iter().zip(c.low.iter().zip(&c.high));
    let band: Vec<(f64, f64, f64)> = c.x.iter().zip(ordinates).map(|(x, (_, (l, h)))| (*x, scale * l, scale * h)).collect();
    let line: Vec<(f64, f64)> = c.x.iter().zip(&c.mean).map(|(x, m)| (*x, scale * m)).collect();
    (Band::new(&band).colour(Colour::BLUE), Line::new(&line).colour(Colour::BLUE))
}

/// One residual panel; `title` and half-height `reach` as given, so that panels can be compared.
pub(super) fn panel(trend: &Trend, title: &str, every: usize, size: (f64, f64), reach: f64) -> String {
    let (output, input) = (column_words(&trend.output), column_words(&trend.input));
    let drawn: Vec<(f64, f64)> = trend.points.iter().step_by(every.max(1)).copied().collect();
    let mut chart = Chart::new(title)
        .size(size.0, size.1)
        .describe(&format!("Residual of {} in own standard deviations against {}.", output.words, input.words))
        .x(&input.words, input.unit)
        .y("residual", "own sd")
        .y_range(-reach, reach)
        .legend(Legend::Hidden)
        .add(Points::new(&drawn).colour(Colour::GREY).size(if drawn.len() > 200 { 2.0 } else { 3.2 }));
    if let Some(c) = &trend.curve {
        let (band, line) = curve_layers(c, 1.0);
        chart = chart.add(band).add(line);
    }
    chart.add(Rule::horizontal(0.0).solid()).to_svg()
}

fn matrix(comparison: &Comparison, trends: &[Trend]) -> String {
    let inputs = each_once(trends.iter().map(|t| t.input.as_str()));
    let place = |names: &[&str], name: &str| names.iter().position(|n| *n == name).unwrap_or(0) as f64;
    let outputs: Vec<&str> = comparison.outputs.iter().map(|o| o.name.as_str()).collect();
    let mut cells: Vec<(f64, f64, f64)> = trends.iter().map(|t| (place(&outputs, &t.output), 1.0 + place(&inputs, &t.input), t.strength)).collect();
    for (k, o) in outputs.iter().enumerate() {
        let Some(t) = trends.iter().find(|t| t.output == *o) else { continue };
        cells.push((k as f64, 0.0, offset(&t.points)));
    }
    let most = cells.iter().map(|c| c.2).fold(4.0, f64::max);
    let mut words = vec!["(mean of all)".to_owned()];
    words.extend(inputs.iter().map(|i| column_words(i).words));
    let strongest = trends.iter().max_by(|a, b| a.strength.total_cmp(&b.strength));
    let told = strongest.map_or_else(String::new, |t| {
        format!("Strongest: {} against {}, {} half-widths.", column_words(&t.output).words, column_words(&t.input).words, fixed(t.strength, 1))
    });
    Chart::new("Trend of each output against each input")
        .describe(&told)
        .size(520.0, 176.0 + 20.0 * inputs.len() as f64)
        .x("output", "")
        .y("input", "")
        .x_categories(&outputs.iter().map(|o| column_words(o).words).collect::<Vec<_>>())
        .y_categories(&words)
        .without_grid()
        .add(Cells::new(&cells, (1.0, 1.0), "half-widths").range(0.0, most))
        .to_svg()
}
