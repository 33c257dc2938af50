//! Mean residual of each output over the racket's face.

use super::agreement::points_of;
use crate::equipment::Racket;
use crate::impact_table::column_words;
use crate::report::chart::{Cells, Chart, Colour, Legend, Points, face};
use crate::report::page::{Layout, Section};
use crate::validation::Comparison;
use crate::validation::comparison::NormalSigns;

/// Standard deviation of the kernel that averages over the face, mm, with a hundred impacts or more: a third of the half width of a
/// head. Fewer are averaged more widely.
const KERNEL_MM: f64 = 18.0;
/// A place of the face is coloured when so many impacts count there.
const FEWEST_IMPACTS: f64 = 3.0;
/// The colours reach at least so many deviations of a local mean: of the fifty or so places of a face some are two off by chance.
const PALE: f64 = 5.0;
/// A local mean within so many of its deviations is drawn as nothing.
const WITHIN: f64 = 2.0;
/// A face of which less is covered is not drawn.
const LEAST_COVERED: f64 = 0.1;
/// Where too few impacts are near: grey, so that it is neither the page nor a mean near zero, on light and dark paper.
const UNKNOWN: Colour = Colour(0xc3, 0xc9, 0xcf);
/// Cells across the face.
const ACROSS: usize = 26;

/// One face per output; `None` when no impact position is known or no racket is.
pub fn face_maps(comparison: &Comparison, racket: Option<&Racket>) -> Option<Section> {
    let racket = racket?;
    let maps: Vec<(String, String)> = comparison.outputs.iter().filter_map(|o| Some((map(comparison, racket, &o.name)?, String::new()))).collect();
    if maps.is_empty() {
        return None;
    }
    Some(
        Section::new("face", "Residuals over the face")
            .note(&format!("Local mean of measured less predicted (kernel of {:.0} mm), seen from +z, tip at the top, impacts as dots. Blue: the prediction is too high; orange: too low; white: the mean is within two of its standard deviations. The colours reach at least five of them, so that what chance leaves stays pale; grey: fewer than three impacts near. The strung area is {:.0} mm long and {:.0} mm wide. Where both faces were hit, velocities and rates that a blow on the back reverses are counted along the normal of the face that was hit.", kernel_mm(comparison.impacts.len()), 1000.0 * racket.head.inner_length_m, 1000.0 * racket.head.inner_width_m))
            .figures(Layout::Small, &maps),
    )
}

/// By how much the face is smoothed for so many impacts, mm.
fn kernel_mm(impacts: usize) -> f64 {
    KERNEL_MM * (100.0 / impacts.max(1) as f64).max(1.0).powf(1.0 / 6.0)
}

fn map(comparison: &Comparison, racket: &Racket, output: &str) -> Option<String> {
    let w = column_words(output);
    let place = |name: &str| comparison.input_names.iter().position(|n| n == name);
    let (ix, iy) = (place("impact_x")?, place("impact_y")?);
    let signs = NormalSigns::of(comparison.impacts.iter().map(|i| i.inputs.as_slice()));
    // Where it was hit (across, along, mm), the residual, and its weight.
    let hits: Vec<(f64, f64, f64, f64)> = points_of(comparison, output)
        .iter()
        .filter_map(|(i, p)| {
            Some((
                1000.0 * i.inputs.get(iy)?,
                1000.0 * i.inputs.get(ix)?,
                w.factor * signs.of_output(output, &i.inputs) * p.residual(),
                (w.factor * p.sd).powi(-2),
            ))
        })
        .filter(|h| h.0.is_finite() && h.1.is_finite() && h.2.is_finite() && h.3.is_finite())
        .collect();
    let spread =
        |pick: fn(&(f64, f64, f64, f64)) -> f64| hits.iter().map(pick).fold(f64::NEG_INFINITY, f64::max) - hits.iter().map(pick).fold(f64::INFINITY, f64::min);
    if hits.len() < 8 || spread(|h| h.0).max(spread(|h| h.1)) < KERNEL_MM {
        return None;
    }
    let (cells, side) = face::cells(racket, ACROSS);
    let kernel = kernel_mm(comparison.impacts.len());
    let known: Vec<(f64, f64, (f64, f64))> = cells.iter().filter_map(|&(y, x)| Some((y, x, local_mean(&hits, y, x, kernel)?))).collect();
    if (known.len() as f64) < LEAST_COVERED * cells.len() as f64 {
        return None;
    }
    let mut sds: Vec<f64> = known.iter().map(|c| c.2.1).collect();
    sds.sort_by(f64::total_cmp);
    let usual = sds.get(sds.len() / 2).copied().unwrap_or(0.0);
    let scale = comparison.noise_floor.max(1.0);
    let shown = |mean: f64, sd: f64| if mean.abs() < WITHIN * scale * sd { 0.0 } else { mean };
    let coloured: Vec<(f64, f64, f64)> = known.into_iter().map(|(y, x, (mean, sd))| (y, x, shown(mean, sd))).collect();
    let most = coloured.iter().map(|c| c.2.abs()).fold(PALE * scale * usual, f64::max).max(f64::MIN_POSITIVE);
    let dots: Vec<(f64, f64)> = hits.iter().map(|h| (h.0, h.1)).collect();
    let chart: Chart = face::bare(&w.words, racket)
        .size(210.0, 300.0)
        .legend(Legend::Hidden)
        .without_axes()
        .describe(&format!("Mean residual of {} over the racket's face.", w.words))
        .add(face::strung_area(racket).filled().colour(UNKNOWN))
        .add(Cells::new(&coloured, (side, side), w.unit).signed().range(-most, most));
    Some(face::outline(chart, racket).add(Points::new(&dots).size(1.4).colour(Colour(0x33, 0x33, 0x33))).to_svg())
}

/// Weighted mean with a Gaussian kernel, and its deviation; `None` where too few impacts count.
fn local_mean(hits: &[(f64, f64, f64, f64)], y: f64, x: f64, kernel: f64) -> Option<(f64, f64)> {
    let (mut sum, mut weights, mut squares, mut count) = (0.0, 0.0, 0.0, 0.0);
    for (hy, hx, residual, weight) in hits {
        let near = (-0.5 * ((hy - y).powi(2) + (hx - x).powi(2)) / (kernel * kernel)).exp();
        sum += near * weight * residual;
        weights += near * weight;
        squares += near * near * weight;
        count += near;
    }
    (count >= FEWEST_IMPACTS && weights > 0.0).then(|| (sum / weights, squares.sqrt() / weights))
}
