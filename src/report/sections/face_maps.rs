//! Mean residual of each output over the racket's face.

use crate::equipment::Racket;
use crate::report::chart::{Cells, Legend, face};
use crate::report::column::column_words;
use crate::report::page::{Layout, Section};
use crate::validation::Comparison;

/// One face per output; `None` when no impact position varies or no racket is known.
pub fn face_maps(comparison: &Comparison, racket: Option<&Racket>) -> Option<Section> {
    let racket = racket?;
    let maps: Vec<(String, String)> = comparison.face_maps.iter().filter(|m| m.cells.len() >= 4).map(|m| (map(comparison, racket, m), String::new())).collect();
    if maps.is_empty() {
        return None;
    }
    Some(
        Section::new("face", "Residuals over the face")
            .note("Mean of measured less predicted in cells of the face, seen from +z, tip at the top. Blue: the prediction is too high; orange: too low; pale: right. The colours reach at least one noise standard deviation, so that a sound model stays pale.")
            .figures(Layout::Small, &maps),
    )
}

fn map(comparison: &Comparison, racket: &Racket, map: &crate::validation::comparison::FaceMap) -> String {
    let w = column_words(&map.output);
    let noise = comparison.outputs.iter().find(|o| o.name == map.output).map_or(0.0, |o| w.factor * o.noise_sd);
    let cells: Vec<(f64, f64, f64)> = map.cells.iter().map(|c| (1000.0 * c.y, 1000.0 * c.x, w.factor * c.mean)).collect();
    let mut sizes: Vec<f64> = cells.iter().map(|c| c.2.abs()).filter(|v| v.is_finite()).collect();
    sizes.sort_by(f64::total_cmp);
    let usual = sizes.get(sizes.len() * 95 / 100).copied().unwrap_or(0.0);
    let reach = usual.max(noise).max(f64::MIN_POSITIVE);
    let side = 1000.0 * map.cell_m;
    let chart = face::bare(&w.words, racket)
        .size(210.0, 300.0)
        .legend(Legend::Hidden)
        .describe(&format!("Mean residual of {} over the racket's face.", w.words))
        .add(Cells::new(&cells, (side, side), w.unit).signed().range(-reach, reach));
    face::outline(chart, racket).to_svg()
}
