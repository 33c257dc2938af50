//! The chart itself: lays out title, legend, axes and draws the layers.

use super::axis::{Axis, Scale};
use super::draw::{self, Plane, arrow, marks, stroke};
use super::layer::{Layer, extent};
use super::palette::Colour;
use super::svg::{Anchor, Svg, TEXT, px, shorten, text_width};
use std::fmt::Write;

/// Where the legend stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Legend {
    #[default]
    Above,
    Hidden,
}

/// Longest category name written aslant, px.
const SLANTED_WIDTH: f64 = 130.0;

/// A figure with two axes. The default size suits a phone's width and half a page.
#[derive(Debug, Clone)]
pub struct Chart {
    title: String,
    description: String,
    width: f64,
    height: f64,
    x: Axis,
    y: Axis,
    equal: bool,
    own_height: bool,
    identity: bool,
    grid: bool,
    legend: Legend,
    notes: Vec<String>,
    layers: Vec<Layer>,
}

impl Chart {
    pub fn new(title: &str) -> Self {
        Chart {
            title: title.to_owned(),
            description: String::new(),
            width: 360.0,
            height: 270.0,
            x: Axis::default(),
            y: Axis::default(),
            equal: false,
            own_height: false,
            identity: false,
            grid: true,
            legend: Legend::Above,
            notes: Vec::new(),
            layers: Vec::new(),
        }
    }
    /// What the figure shows, for those who cannot see it.
    pub fn describe(mut self, description: &str) -> Self {
        self.description = description.to_owned();
        self
    }
    /// Width and height, px of the view box.
    pub fn size(mut self, width: f64, height: f64) -> Self {
        (self.width, self.height) = (width.clamp(80.0, 4000.0), height.clamp(60.0, 8000.0));
        self
    }
    pub fn x(mut self, label: &str, unit: &str) -> Self {
        (self.x.label, self.x.unit) = (label.to_owned(), unit.to_owned());
        self
    }
    pub fn y(mut self, label: &str, unit: &str) -> Self {
        (self.y.label, self.y.unit) = (label.to_owned(), unit.to_owned());
        self
    }
    /// Fixes the range; points outside are drawn as rings on the border.
    pub fn x_range(mut self, low: f64, high: f64) -> Self {
        self.x.range = Some((low, high));
        self
    }
    pub fn y_range(mut self, low: f64, high: f64) -> Self {
        self.y.range = Some((low, high));
        self
    }
    /// Makes sure a value is inside, such as zero.
    pub fn x_include(mut self, value: f64) -> Self {
        self.x.include.push(value);
        self
    }
    pub fn y_include(mut self, value: f64) -> Self {
        self.y.include.push(value);
        self
    }
    /// Ordinate grows downward, as in an image.
    pub fn y_reversed(mut self) -> Self {
        self.y.reversed = true;
        self
    }
    /// Names at 0, 1, 2, ... instead of numbers.
    pub fn x_categories(mut self, names: &[String]) -> Self {
        self.x.categories = names.to_vec();
        self
    }
    pub fn y_categories(mut self, names: &[String]) -> Self {
        self.y.categories = names.to_vec();
        self
    }
    pub fn without_axes(mut self) -> Self {
        (self.x.hidden, self.y.hidden) = (true, true);
        self
    }
    pub fn without_grid(mut self) -> Self {
        self.grid = false;
        self
    }
    /// One unit is as long on both axes.
    pub fn equal_scales(mut self) -> Self {
        self.equal = true;
        self
    }
    /// One unit is as long on both axes, and the height follows from the width.
    pub fn height_from_width(mut self) -> Self {
        (self.equal, self.own_height) = (true, true);
        self
    }
    /// Draws y = x and gives both axes the same range.
    pub fn identity_line(mut self) -> Self {
        self.identity = true;
        self
    }
    pub fn legend(mut self, legend: Legend) -> Self {
        self.legend = legend;
        self
    }
    /// A short line of text above the chart, such as R².
    pub fn note(mut self, text: &str) -> Self {
        self.notes.push(text.to_owned());
        self
    }
    #[allow(clippy::should_implement_trait)] // a chart plus a layer is a chart
    pub fn add(mut self, layer: impl Into<Layer>) -> Self {
        self.layers.push(layer.into());
        self
    }

    /// The figure as a complete SVG element.
    pub fn to_svg(&self) -> String {
        if self.own_height {
            let top = self.draw_head(&mut Svg::new(self.width, self.height, "", ""));
            let plane = Chart { equal: false, ..self.clone() }.plane(top);
            let unit = (plane.right - plane.left) / (plane.x.high - plane.x.low);
            let height = self.height - (plane.bottom - plane.top) + unit * (plane.y.high - plane.y.low);
            return Chart { own_height: false, ..self.clone() }.size(self.width, height).to_svg();
        }
        let mut svg = Svg::new(self.width, self.height, &self.title, &self.description);
        let top = self.draw_head(&mut svg);
        let plane = self.plane(top);
        self.draw_axes(&mut svg, &plane);
        for (layer, colour) in self.layers.iter().zip(self.colours()) {
            self.draw(&mut svg, &plane, layer, colour);
        }
        svg.finish()
    }

    /// Title and legend; returns where the plane begins.
    fn draw_head(&self, svg: &mut Svg) -> f64 {
        let top = svg.heading(&self.title, self.width);
        let mut top = self.draw_legend(svg, top);
        for note in &self.notes {
            top += TEXT + 3.0;
            svg.text(4.0, top, Anchor::Start, &shorten(note, TEXT, self.width - 8.0), "fill-opacity=\"0.85\"");
        }
        top + 8.0
    }

    fn data_range(&self, pick: impl Fn(&(f64, f64)) -> f64) -> Option<(f64, f64)> {
        let values = self.layers.iter().flat_map(extent).map(|p| pick(&p)).filter(|v| v.is_finite());
        values.fold(None, |r, v| Some(r.map_or((v, v), |(a, b): (f64, f64)| (a.min(v), b.max(v)))))
    }

    fn plane(&self, top: f64) -> Plane {
        let (mut dx, mut dy) = (self.data_range(|p| p.0), self.data_range(|p| p.1));
        if self.identity {
            let both = dx.into_iter().chain(dy).fold(None, |r, (a, b)| Some(r.map_or((a, b), |(c, d): (f64, f64)| (a.min(c), b.max(d)))));
            (dx, dy) = (both, both);
        }
        let bars_on_floor = self.layers.iter().any(|l| matches!(l, Layer::Bars(b) if b.bars.iter().all(|x| x.2 >= 0.0))) && self.y.range.is_none();
        let y_label = if self.y.hidden || self.y.label.is_empty() { 0.0 } else { TEXT + 5.0 };
        let bottom = self.height - self.slant_drop() - if self.x.hidden { 4.0 } else { TEXT + 8.0 + if self.x.label.is_empty() { 0.0 } else { TEXT + 5.0 } };
        let rows = ((bottom - top) / 38.0).clamp(2.0, 9.0) as usize;
        let mut y = self.y.scale(dy, rows);
        if bars_on_floor && y.high > 0.0 {
            y = Scale::over(0.0, y.high, rows);
        }
        let widest = y.ticks.iter().map(|t| text_width(&t.1, TEXT)).fold(0.0, f64::max).min(0.4 * self.width);
        let left = if self.y.hidden { 4.0 } else { y_label + widest + 8.0 };
        let bar = self.layers.iter().any(|l| matches!(l, Layer::Cells(_)));
        let right = (self.width - if bar { 62.0 } else { 10.0 }).max(left + 20.0);
        let columns = ((right - left) / 58.0).clamp(2.0, 9.0) as usize;
        let x = self.x.scale(dx, columns);
        let mut plane = Plane { left, top, right, bottom: bottom.max(top + 20.0), x, y, y_reversed: self.y.reversed };
        if self.equal {
            // Widen the range that has room, about its middle.
            let (w, h) = (plane.right - plane.left, plane.bottom - plane.top);
            let unit = ((plane.x.high - plane.x.low) / w).max((plane.y.high - plane.y.low) / h);
            let stretch = |s: &Scale, length: f64, n: usize| {
                let middle = 0.5 * (s.low + s.high);
                Scale::over(middle - 0.5 * unit * length, middle + 0.5 * unit * length, n)
            };
            let (wide, high) = (stretch(&plane.x, w, columns), stretch(&plane.y, h, rows));
            (plane.x, plane.y) = (wide, high);
        }
        plane
    }

    /// Extra height for category names that must be written aslant because they are wider than their column; else 0.
    fn slant_drop(&self) -> f64 {
        let widest = self.x.categories.iter().map(|c| text_width(c, TEXT)).fold(0.0, f64::max);
        let room = (self.width - 70.0) / self.x.categories.len().max(1) as f64;
        if self.x.hidden || widest <= room { 0.0 } else { 0.62 * widest.min(SLANTED_WIDTH) }
    }

    fn draw_axes(&self, svg: &mut Svg, p: &Plane) {
        let mut grid = String::new();
        let line = "stroke=\"currentColor\" fill=\"none\"";
        if !self.x.hidden {
            let room = (p.right - p.left) / p.x.ticks.len().max(1) as f64;
            for (v, label) in &p.x.ticks {
                let (x, _) = p.at((*v, p.y.low));
                let _ = write!(grid, "M{} {}V{}", px(x), px(p.top), px(p.bottom + 3.0));
                if self.slant_drop() != 0.0 {
                    let (x, y) = (x + 4.0, p.bottom + TEXT + 2.0);
                    let turn = format!("transform=\"rotate(-38 {} {})\"", px(x), px(y));
                    svg.text(x, y, Anchor::End, &shorten(label, TEXT, SLANTED_WIDTH), &turn);
                    continue;
                }
                let label = if self.x.categories.is_empty() { label.clone() } else { shorten(label, TEXT, room.max(24.0)) };
                svg.text(x.min(self.width - 0.5 * text_width(&label, TEXT)), p.bottom + TEXT + 5.0, Anchor::Middle, &label, "");
            }
            let title = self.x.title(p.x.power);
            let place = (0.5 * (p.left + p.right)).min(self.width - 0.5 * text_width(&title, TEXT) - 2.0).max(0.5 * text_width(&title, TEXT));
            svg.text(place, self.height - 4.0, Anchor::Middle, &shorten(&title, TEXT, self.width), "");
        }
        if !self.y.hidden {
            for (v, label) in &p.y.ticks {
                let (_, y) = p.at((p.x.low, *v));
                let _ = write!(grid, "M{} {}H{}", px(p.left - 3.0), px(y), px(p.right));
                svg.text(p.left - 6.0, y + 0.35 * TEXT, Anchor::End, &shorten(label, TEXT, 0.4 * self.width), "");
            }
            let title = shorten(&self.y.title(p.y.power), TEXT, self.height);
            let reach = 0.5 * text_width(&title, TEXT) + 2.0;
            let y = (0.5 * (p.top + p.bottom)).min(self.height - reach).max(reach);
            // Without a label nobody left room for a title.
            if !self.y.label.is_empty() {
                svg.text(TEXT, y, Anchor::Middle, &title, &format!("transform=\"rotate(-90 {} {})\"", px(TEXT), px(y)));
            }
        }
        if self.grid {
            svg.path(&grid, &format!("{line} stroke-opacity=\"0.13\""));
        }
        if !self.x.hidden && !self.y.hidden {
            svg.path(&format!("M{} {}V{}H{}", px(p.left), px(p.top), px(p.bottom), px(p.right)), &format!("{line} stroke-opacity=\"0.7\""));
        }
        if self.identity
            && let Some((a, b)) = p.clip(p.at((p.x.low, p.x.low)), p.at((p.x.high, p.x.high)))
        {
            svg.line(a, b, &format!("{line} stroke-opacity=\"0.6\" stroke-dasharray=\"6 3\""));
        }
    }

    /// The colour of each layer: its own, or that of the next series.
    fn colours(&self) -> Vec<Colour> {
        let mut next = 0;
        let colour = |layer: &Layer| {
            let own = match layer {
                Layer::Points(l) => l.colour,
                Layer::Line(l) => l.colour,
                Layer::Band(l) => l.colour,
                Layer::Bars(l) => l.colour,
                Layer::Arrows(l) => l.colour,
                Layer::Shape(l) => Some(l.colour.unwrap_or(Colour::GREY)),
                Layer::Rule(_) | Layer::Cells(_) | Layer::Picture(_) => Some(Colour::GREY),
            };
            own.unwrap_or_else(|| {
                next += 1;
                Colour::of_series(next - 1)
            })
        };
        self.layers.iter().map(colour).collect()
    }

    fn draw(&self, svg: &mut Svg, p: &Plane, layer: &Layer, colour: Colour) {
        match layer {
            Layer::Points(l) => draw::points(svg, p, l, colour),
            Layer::Line(l) => draw::line(svg, p, l, colour),
            Layer::Band(l) => draw::band(svg, p, l, colour),
            Layer::Bars(l) => draw::bars(svg, p, l, colour),
            Layer::Cells(l) => draw::cells(svg, p, l),
            Layer::Arrows(l) => draw::arrows(svg, p, l, colour),
            Layer::Shape(l) => draw::shape(svg, p, l),
            Layer::Rule(l) => draw::rule(svg, p, l),
            Layer::Picture(l) => draw::picture(svg, p, l),
        }
    }

    /// Legend rows below the title; returns the new top.
    fn draw_legend(&self, svg: &mut Svg, top: f64) -> f64 {
        if self.legend == Legend::Hidden {
            return top;
        }
        let (mut x, mut y, mut any) = (4.0, top, false);
        for (layer, colour) in self.layers.iter().zip(self.colours()) {
            let name = match layer {
                Layer::Points(l) => &l.name,
                Layer::Line(l) => &l.name,
                Layer::Band(l) => &l.name,
                Layer::Bars(l) => &l.name,
                Layer::Arrows(l) => &l.name,
                Layer::Shape(l) => &l.name,
                Layer::Rule(l) => &l.name,
                Layer::Cells(_) | Layer::Picture(_) => continue,
            };
            if name.is_empty() {
                continue;
            }
            let text = shorten(name, TEXT, self.width - 30.0);
            let width = 20.0 + text_width(&text, TEXT) + 12.0;
            if !any || x + width > self.width {
                (x, y) = (4.0, y + TEXT + 4.0);
                any = true;
            }
            let middle = y - 4.0;
            match layer {
                Layer::Points(l) => svg.raw(&marks(&[(x + 8.0, middle)], l.symbol, l.size.clamp(4.6, 8.0), colour)),
                Layer::Line(l) => svg.line((x, middle), (x + 16.0, middle), &stroke(colour, l.width.max(1.4), l.dashes)),
                Layer::Rule(l) => svg.line((x, middle), (x + 16.0, middle), &draw::rule_stroke(l)),
                Layer::Arrows(_) => svg.path(&arrow((x, middle), (x + 16.0, middle)), &stroke(colour, 1.2, "")),
                Layer::Shape(_) => svg.rect(x, middle - 4.0, 16.0, 8.0, &format!("fill=\"none\" stroke=\"{colour}\"")),
                _ => svg.rect(
                    x,
                    middle - 4.0,
                    16.0,
                    8.0,
                    &format!("fill=\"{colour}\" fill-opacity=\"{}\"", if matches!(layer, Layer::Band(_)) { 0.28 } else { 0.6 }),
                ),
            }
            svg.text(x + 20.0, y, Anchor::Start, &text, "");
            x += width;
        }
        y
    }
}
