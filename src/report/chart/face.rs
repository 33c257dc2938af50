//! The racket's face, seen from +z: tip at the top (local x points down to the handle), marker 2 to marker 3 left to right.
//! Millimetres from the stringbed centre.

use super::layer::{Points, Shape, Symbol};
use super::palette::Colour;
use super::plot::Chart;
use crate::equipment::Racket;
use std::f64::consts::TAU;

/// Grey of the tube, seen on light and dark paper.
const FRAME: Colour = Colour(0x9a, 0xa2, 0xab);

/// A special point on the face: its name, local x and y in m.
#[derive(Debug, Clone, PartialEq)]
pub struct Spot {
    pub name: String,
    pub x_m: f64,
    pub y_m: f64,
}

/// A chart with the racket's face drawn in: frame, strings, throat, centre of mass. Layers added afterwards use (y, x) in
/// mm: abscissa across the face, ordinate along it, positive toward the handle.
pub fn face(title: &str, racket: &Racket) -> Chart {
    outline(bare(title, racket), racket)
}

/// The same axes without the racket: add a heat map first, then [`outline`] over it.
pub fn bare(title: &str, racket: &Racket) -> Chart {
    let (half_length, half_width) = half_sizes_mm(racket);
    let com = 1000.0 * racket.com_local().x;
    Chart::new(title)
        .size(340.0, 400.0)
        .height_from_width()
        .x("across the face", "mm")
        .y("from stringbed centre to handle", "mm")
        .x_include(-half_width - 30.0)
        .x_include(half_width + 30.0)
        .y_include(-half_length - 25.0)
        .y_include(com.max(half_length) + 40.0)
        .y_reversed()
        .equal_scales()
        .without_grid()
}

/// Draws frame, strings, throat and centre of mass over what is there.
pub fn outline(mut chart: Chart, racket: &Racket) -> Chart {
    let (a, b) = half_sizes_mm(racket);
    let tube = 1000.0 * racket.head.tube_radius_m;
    for k in -9..=9i32 {
        // 18 mains and 19 crosses, evenly spread: a drawing, not a measurement.
        let (y, x) = (f64::from(k) * b / 9.5, f64::from(k) * a / 9.5);
        let (reach_x, reach_y) = (a * (1.0 - (y / b).powi(2)).sqrt(), b * (1.0 - (x / a).powi(2)).sqrt());
        chart = chart.add(Shape::new(&[(y, -reach_x), (y, reach_x)]).width(0.5).opacity(0.22));
        chart = chart.add(Shape::new(&[(-reach_y, x), (reach_y, x)]).width(0.5).opacity(0.22));
    }
    // The throat's two arms run from the head's flanks to the handle.
    let com = 1000.0 * racket.com_local().x;
    for side in [-1.0, 1.0] {
        let start = (side * 0.62 * (b + tube), 0.785 * (a + tube));
        chart = chart.add(Shape::new(&[start, (side * 14.0, com.max(a) + 40.0)]).width(3.0).colour(FRAME));
    }
    chart = chart.add(Shape::new(&ellipse(a + 2.0 * tube, b + 2.0 * tube)).hole(&ellipse(a, b)).filled().width(0.6).colour(FRAME));
    chart.add(Points::new(&[(0.0, com)]).symbol(Symbol::Plus).size(9.0).colour(Colour::GREY).name("centre of mass"))
}

/// The strung area, to be filled below a heat map.
pub fn strung_area(racket: &Racket) -> Shape {
    let (a, b) = half_sizes_mm(racket);
    Shape::new(&ellipse(a, b))
}

/// Marks special points (sweet spots) with their names.
pub fn spots(mut chart: Chart, spots: &[Spot]) -> Chart {
    for (i, spot) in spots.iter().filter(|s| s.x_m.is_finite() && s.y_m.is_finite()).enumerate() {
        let at = [(1000.0 * spot.y_m, 1000.0 * spot.x_m)];
        let symbol = Symbol::of_series(i + 1);
        chart = chart.add(Points::new(&at).symbol(symbol).size(8.0).colour(Colour::of_series(i + 1)).name(&spot.name));
    }
    chart
}

/// Centres (y, x in mm) of square cells that cover the strung area, for a heat map of a quantity over the face.
pub fn cells(racket: &Racket, across: usize) -> (Vec<(f64, f64)>, f64) {
    let (a, b) = half_sizes_mm(racket);
    let side = 2.0 * b / across.clamp(4, 200) as f64;
    let (rows, columns) = ((a / side).ceil() as i32, (b / side).ceil() as i32);
    let mut at = Vec::new();
    for i in -rows..=rows {
        for j in -columns..=columns {
            let (x, y) = (f64::from(i) * side, f64::from(j) * side);
            if (x / (a + 0.6 * side)).powi(2) + (y / (b + 0.6 * side)).powi(2) <= 1.0 {
                at.push((y, x));
            }
        }
    }
    (at, side)
}

/// Half length and half width of the strung area, mm.
pub fn half_sizes_mm(racket: &Racket) -> (f64, f64) {
    (500.0 * racket.head.inner_length_m, 500.0 * racket.head.inner_width_m)
}

fn ellipse(a: f64, b: f64) -> Vec<(f64, f64)> {
    (0..72).map(|k| TAU * f64::from(k) / 72.0).map(|t| (b * t.sin(), a * t.cos())).collect()
}
