//! Where the model fails: ranges of an input over which an output is off, in words, a table and pictures.

use super::residuals::{Trend, curve_layers, trends, usual_size};
use crate::impact_table::column_words;
use crate::report::chart::{Chart, Colour, Legend, Line, Points, Rule, Shape};
use crate::report::markup::{odds, plain, rounded, significant, true_minus};
use crate::report::page::{Layout, Section, Table};
use crate::validation::Comparison;
use crate::validation::diagnosis::{Diagnosis, Place};

/// Pictures drawn; the table lists all.
const DRAWN: usize = 6;

/// `comparison` gives the points behind the pictures; without it words and table stand alone.
pub fn places(d: &Diagnosis, comparison: Option<&Comparison>) -> Option<Section> {
    if d.places.is_empty() {
        return None;
    }
    let trends = comparison.map(trends).unwrap_or_default();
    let drawn = d.places.iter().take(DRAWN).filter_map(|p| {
        let trend = trends.iter().find(|t| t.output == p.output && t.input == p.input)?;
        Some((picture(p, trend, comparison?), true_minus(&p.words)))
    });
    let drawn: Vec<(String, String)> = drawn.collect();
    let mut table = Table::new("Measured less predicted, mean weighted by the noise, inside the range and elsewhere; signs are the component's own, while the words speak of its size; p counts all ranges looked at.")
        .column("output")
        .column("where")
        .numbers("mean there")
        .column("95 % interval")
        .numbers("elsewhere")
        .column("unit")
        .numbers("impacts")
        .numbers("p");
    for p in &d.places {
        let (o, i) = (column_words(&p.output), column_words(&p.input));
        // The 95 % interval is 3.92 deviations wide.
        let sd = o.factor * (p.ci_high - p.ci_low) / 3.92;
        let show = |v: f64| rounded(o.factor * v, sd);
        // What has no unit is a count, such as the order of the impacts.
        let end = |v: f64| if i.unit.is_empty() { plain(v) } else { significant(i.factor * v, 3) };
        let range = format!("{} {} to {} {}", i.words, end(p.from), end(p.to), i.unit);
        let interval = format!("{} to {}", show(p.ci_low), show(p.ci_high));
        // Exactly nought: the range is the whole, and there is no elsewhere.
        let elsewhere = if p.mean_elsewhere == 0.0 { "–".to_owned() } else { show(p.mean_elsewhere) };
        let odds = odds(p.p_value);
        table = table.row(&[o.words.clone(), range, show(p.mean_residual), interval, elsewhere, o.unit.to_owned(), p.n.to_string(), odds]);
    }
    let mut section = Section::new("where", "Where it fails");
    if drawn.is_empty() {
        section = section.list(&d.places.iter().map(|p| true_minus(&p.words)).collect::<Vec<_>>());
    }
    if !drawn.is_empty() {
        section = section.note(
            "Dots: impacts, the model with its free parameters at their best. Line and band: their local mean and its 95 % interval. Tinted: the range where the model is off; orange: the mean there of the impacts that were not held out. Rings on the border: points beyond it.",
        );
    }
    Some(section.figures(Layout::Normal, &drawn).table(table))
}

fn picture(p: &Place, trend: &Trend, comparison: &Comparison) -> String {
    let (o, i) = (column_words(&p.output), column_words(&p.input));
    // Back from own deviations to the output's unit: the typical deviation scales the smooth, the points have their own.
    let scale = comparison.outputs.iter().find(|s| s.name == p.output).map_or(1.0, |s| o.factor * s.noise_sd);
    let at: Vec<(f64, f64)> = trend.points.iter().map(|(x, z)| (*x, z * scale)).collect();
    let reach = (1.4 * usual_size(&at).unwrap_or(1.0)).max(1.3 * (o.factor * p.ci_low).abs().max((o.factor * p.ci_high).abs())).max(1e-12);
    let (from, to) = (i.factor * p.from, i.factor * p.to);
    let low = trend.points.iter().map(|a| a.0).filter(|v| v.is_finite()).fold(f64::INFINITY, f64::min);
    let high = trend.points.iter().map(|a| a.0).filter(|v| v.is_finite()).fold(f64::NEG_INFINITY, f64::max);
    let (from, to) = (from.max(low), to.min(high));
    let mut chart = Chart::new(&format!("{} against {}", o.words, i.words))
        .describe(&p.words)
        .size(340.0, 240.0)
        .x(&i.words, i.unit)
        .y("measured − predicted", o.unit)
        .y_range(-reach, reach)
        .legend(Legend::Hidden)
        .add(Shape::new(&[(from, -reach), (to, -reach), (to, reach), (from, reach)]).filled().opacity(0.14).colour(Colour::AMBER))
        .add(Points::new(&at).colour(Colour::GREY));
    if let Some(c) = &trend.curve {
        let (band, line) = curve_layers(c, scale);
        chart = chart.add(band).add(line);
    }
    let level = o.factor * p.mean_residual;
    chart.add(Rule::horizontal(0.0).solid()).add(Line::new(&[(from, level), (to, level)]).colour(Colour::ORANGE).width(3.0)).to_svg()
}
