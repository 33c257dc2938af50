//! Polynomial fits of the outputs (thesis 2.8, James 2004): the effect of one input while the others are held.

use super::agreement::points_of;
use crate::impact_table::column_words;
use crate::report::chart::{Band, Chart, Colour, Legend, Line};
use crate::report::markup::{fixed, significant};
use crate::report::page::{Layout, Section, Table};
use crate::validation::Comparison;

/// A table of fits and, folded, the held-others curves of each output.
pub fn polynomials(comparison: &Comparison) -> Option<Section> {
    if comparison.polynomials.is_empty() {
        return None;
    }
    let mut table = Table::new("Polynomials of second order in the inputs, fitted to the measurements alone; the model's error stands beside theirs.")
        .column("output")
        .column("unit")
        .numbers("terms")
        .numbers("R², held out")
        .numbers("rms error, held out")
        .numbers("model's, held out");
    for p in &comparison.polynomials {
        let w = column_words(&p.output);
        let model = held_out_rms(comparison, &p.output);
        let show = |v: f64| significant(w.factor * v, 3);
        table = table.row(&[w.words.clone(), w.unit.to_owned(), p.n_terms.to_string(), fixed(p.r2_heldout, 3), show(p.rmse_heldout), show(model)]);
    }
    let mut section = Section::new("polynomials", "What the measurements say by themselves")
        .note("No physics here: where a polynomial predicts better than the model, the measurements hold something that the model lacks.")
        .table(table);
    for p in &comparison.polynomials {
        let w = column_words(&p.output);
        let panels: Vec<(String, String)> = p
            .effects
            .iter()
            .map(|e| {
                let x = column_words(&e.input);
                let band: Vec<(f64, f64, f64)> =
                    e.x.iter().zip(e.low.iter().zip(&e.high)).map(|(a, (l, h))| (x.factor * a, w.factor * l, w.factor * h)).collect();
                let line: Vec<(f64, f64)> = e.x.iter().zip(&e.mean).map(|(a, m)| (x.factor * a, w.factor * m)).collect();
                let chart = Chart::new(&format!("against {}", x.words))
                    .describe(&format!("{} against {}, all other inputs at their means.", w.words, x.words))
                    .size(210.0, 160.0)
                    .legend(Legend::Hidden)
                    .x(&x.words, x.unit)
                    .y("mean output", w.unit)
                    .add(Band::new(&band).colour(Colour::GREEN))
                    .add(Line::new(&line).colour(Colour::GREEN));
                (chart.to_svg(), String::new())
            })
            .collect();
        section = section.folded(&format!("{}: each input, the others at their means", w.words), |s| {
            s.note("Line and band: the polynomial and its 95 % interval.").figures(Layout::Small, &panels)
        });
    }
    Some(section)
}

/// Of the model as its file states it, over the impacts held out; not a number when no output is among them.
fn held_out_rms(comparison: &Comparison, output: &str) -> f64 {
    let residuals: Vec<f64> = points_of(comparison, output).into_iter().filter(|(i, _)| i.held_out).map(|(_, p)| p.residual()).collect();
    (residuals.iter().map(|r| r * r).sum::<f64>() / residuals.len() as f64).sqrt()
}
