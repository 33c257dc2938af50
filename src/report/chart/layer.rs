//! What can be drawn between two axes. Each layer holds data in axis units.

use super::palette::Colour;

/// Marks told apart by form as well as by colour.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Symbol {
    #[default]
    Circle,
    Square,
    Triangle,
    Diamond,
    Cross,
    Plus,
    /// A circle without filling.
    Ring,
}

impl Symbol {
    /// Of the `k`-th series.
    pub fn of_series(k: usize) -> Symbol {
        const SERIES: [Symbol; 6] = [Symbol::Circle, Symbol::Square, Symbol::Triangle, Symbol::Diamond, Symbol::Cross, Symbol::Plus];
        SERIES[k % SERIES.len()]
    }
}

macro_rules! layers {
    ($($name:ident),*) => {
        /// One drawn layer of a [`super::Chart`].
        #[derive(Debug, Clone)]
        pub enum Layer { $($name($name)),* }
        $(impl From<$name> for Layer {
            fn from(layer: $name) -> Self {
                Layer::$name(layer)
            }
        })*
    };
}

layers!(Points, Line, Band, Bars, Cells, Arrows, Shape, Rule, Picture);

macro_rules! styled {
    ($($type:ident),*) => {$(
        impl $type {
            /// Names the layer in the legend.
            pub fn name(mut self, name: &str) -> Self {
                self.name = name.to_owned();
                self
            }
            pub fn colour(mut self, colour: Colour) -> Self {
                self.colour = Some(colour);
                self
            }
        }
    )*};
}

styled!(Points, Line, Band, Bars, Arrows, Shape, Rule);

/// A scatter of points, with error bars (one standard deviation to each side) where given.
#[derive(Debug, Clone, Default)]
pub struct Points {
    pub(super) at: Vec<(f64, f64)>,
    pub(super) x_error: Vec<f64>,
    pub(super) y_error: Vec<f64>,
    pub(super) labels: Vec<String>,
    pub(super) symbol: Symbol,
    pub(super) size: f64,
    pub(super) name: String,
    pub(super) colour: Option<Colour>,
}

impl Points {
    pub fn new(at: &[(f64, f64)]) -> Self {
        // Small marks where there are many, so that a cloud shows its density.
        let size = match at.len() {
            401.. => 2.4,
            101..=400 => 3.2,
            _ => 4.6,
        };
        Points { at: at.to_vec(), size, ..Default::default() }
    }
    pub fn x_error(mut self, sd: &[f64]) -> Self {
        self.x_error = sd.to_vec();
        self
    }
    pub fn y_error(mut self, sd: &[f64]) -> Self {
        self.y_error = sd.to_vec();
        self
    }
    /// A text beside each point.
    pub fn labels(mut self, labels: &[String]) -> Self {
        self.labels = labels.to_vec();
        self
    }
    pub fn symbol(mut self, symbol: Symbol) -> Self {
        self.symbol = symbol;
        self
    }
    /// Diameter of the mark, px.
    pub fn size(mut self, size: f64) -> Self {
        self.size = size;
        self
    }
}

/// A line through points in order; a point that is not finite makes a gap.
#[derive(Debug, Clone)]
pub struct Line {
    pub(super) through: Vec<(f64, f64)>,
    pub(super) dashes: &'static str,
    pub(super) width: f64,
    pub(super) steps: bool,
    pub(super) name: String,
    pub(super) colour: Option<Colour>,
}

impl Line {
    pub fn new(through: &[(f64, f64)]) -> Self {
        Line { through: through.to_vec(), dashes: "", width: 1.6, steps: false, name: String::new(), colour: None }
    }
    pub fn dashed(mut self) -> Self {
        self.dashes = "5 3";
        self
    }
    pub fn dotted(mut self) -> Self {
        self.dashes = "1.5 2.5";
        self
    }
    /// Stroke width, px.
    pub fn width(mut self, width: f64) -> Self {
        self.width = width;
        self
    }
    /// Holds each value until the next point: a staircase.
    pub fn steps(mut self) -> Self {
        self.steps = true;
        self
    }
}

/// A band between two curves over common abscissas, such as a 95 % interval.
#[derive(Debug, Clone)]
pub struct Band {
    /// (x, low, high)
    pub(super) over: Vec<(f64, f64, f64)>,
    pub(super) name: String,
    pub(super) colour: Option<Colour>,
}

impl Band {
    /// `over`: (x, low, high) with x ascending.
    pub fn new(over: &[(f64, f64, f64)]) -> Self {
        Band { over: over.to_vec(), name: String::new(), colour: None }
    }
}

/// Bars on intervals, as in a histogram.
#[derive(Debug, Clone)]
pub struct Bars {
    /// (from, to, height)
    pub(super) bars: Vec<(f64, f64, f64)>,
    pub(super) errors: Vec<f64>,
    pub(super) name: String,
    pub(super) colour: Option<Colour>,
}

impl Bars {
    /// `bars`: (from, to, height).
    pub fn new(bars: &[(f64, f64, f64)]) -> Self {
        Bars { bars: bars.to_vec(), errors: Vec::new(), name: String::new(), colour: None }
    }
    /// Half-length of a whisker at each bar's end.
    pub fn y_error(mut self, sd: &[f64]) -> Self {
        self.errors = sd.to_vec();
        self
    }
}

/// A heat map: coloured rectangles with a colour bar beside the chart.
#[derive(Debug, Clone)]
pub struct Cells {
    /// (x, y, value) at the cells' centres
    pub(super) at: Vec<(f64, f64, f64)>,
    pub(super) cell: (f64, f64),
    pub(super) range: Option<(f64, f64)>,
    pub(super) signed: bool,
    pub(super) numbered: bool,
    pub(super) label: String,
}

impl Cells {
    /// `at`: centre x, centre y, value; `cell`: width and height of one cell; `label`: the quantity with its unit.
    pub fn new(at: &[(f64, f64, f64)], cell: (f64, f64), label: &str) -> Self {
        Cells { at: at.to_vec(), cell, range: None, signed: false, numbered: false, label: label.to_owned() }
    }
    /// Colours from `low` to `high` instead of the data's own range.
    pub fn range(mut self, low: f64, high: f64) -> Self {
        self.range = Some((low, high));
        self
    }
    /// Sign matters: a diverging scale, pale at zero, symmetric.
    pub fn signed(mut self) -> Self {
        self.signed = true;
        self
    }
    /// Writes each whole value into its cell, for maps of few cells.
    pub fn numbered(mut self) -> Self {
        self.numbered = true;
        self
    }
    /// The value range the colours span.
    pub(super) fn limits(&self) -> (f64, f64) {
        let values = self.at.iter().map(|c| c.2).filter(|v| v.is_finite());
        let (low, high) = self.range.unwrap_or_else(|| values.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v))));
        if !(low.is_finite() && high.is_finite()) {
            return (0.0, 1.0);
        }
        if self.signed {
            let most = low.abs().max(high.abs()).max(f64::MIN_POSITIVE);
            return (-most, most);
        }
        if high > low { (low, high) } else { (low - 0.5, high + 0.5) }
    }
}

/// Arrows from a place by a vector, both in axis units times `scale` for the vector.
#[derive(Debug, Clone)]
pub struct Arrows {
    pub(super) from: Vec<(f64, f64)>,
    pub(super) by: Vec<(f64, f64)>,
    pub(super) scale: f64,
    pub(super) name: String,
    pub(super) colour: Option<Colour>,
}

impl Arrows {
    /// An arrow at `from[i]` along `by[i] * scale`.
    pub fn new(from: &[(f64, f64)], by: &[(f64, f64)], scale: f64) -> Self {
        Arrows { from: from.to_vec(), by: by.to_vec(), scale, name: String::new(), colour: None }
    }
}

/// A closed outline.
#[derive(Debug, Clone)]
pub struct Shape {
    pub(super) corners: Vec<(f64, f64)>,
    pub(super) hole: Vec<(f64, f64)>,
    pub(super) width: f64,
    pub(super) opacity: f64,
    pub(super) filled: bool,
    pub(super) name: String,
    pub(super) colour: Option<Colour>,
}

impl Shape {
    pub fn new(corners: &[(f64, f64)]) -> Self {
        Shape { corners: corners.to_vec(), hole: Vec::new(), width: 1.2, opacity: 1.0, filled: false, name: String::new(), colour: None }
    }
    pub fn width(mut self, width: f64) -> Self {
        self.width = width;
        self
    }
    pub fn opacity(mut self, opacity: f64) -> Self {
        self.opacity = opacity;
        self
    }
    /// Cuts a hole out of the filling.
    pub fn hole(mut self, corners: &[(f64, f64)]) -> Self {
        self.hole = corners.to_vec();
        self
    }
    pub fn filled(mut self) -> Self {
        self.filled = true;
        self
    }
}

/// A straight line across the whole chart.
#[derive(Debug, Clone)]
pub struct Rule {
    pub(super) horizontal: bool,
    pub(super) at: f64,
    pub(super) solid: bool,
    pub(super) name: String,
    pub(super) colour: Option<Colour>,
}

impl Rule {
    /// The line y = `at`.
    pub fn horizontal(at: f64) -> Self {
        Rule { horizontal: true, at, solid: false, name: String::new(), colour: None }
    }
    /// The line x = `at`.
    pub fn vertical(at: f64) -> Self {
        Rule { horizontal: false, at, solid: false, name: String::new(), colour: None }
    }
    pub fn solid(mut self) -> Self {
        self.solid = true;
        self
    }
}

/// A grey or colour picture (PNG) below the other layers, in the coordinates of its pixels.
#[derive(Debug, Clone)]
pub struct Picture {
    pub(super) png: Vec<u8>,
    pub(super) corner: (f64, f64),
    pub(super) size: (f64, f64),
}

impl Picture {
    /// `corner`: column and row of the first pixel; `size`: width and height, px. Pixel centres lie on whole numbers.
    pub fn new(png: &[u8], corner: (f64, f64), size: (f64, f64)) -> Self {
        Picture { png: png.to_vec(), corner, size }
    }
}

/// Least and greatest abscissa and ordinate of a layer's data; `None` when it should not stretch the axes.
pub(super) fn extent(layer: &Layer) -> Vec<(f64, f64)> {
    let error = |e: &[f64], i: usize| e.get(i).copied().filter(|s| s.is_finite()).unwrap_or(0.0);
    match layer {
        Layer::Points(p) => {
            p.at.iter()
                .enumerate()
                .flat_map(|(i, &(x, y))| {
                    let (ex, ey) = (error(&p.x_error, i), error(&p.y_error, i));
                    [(x - ex, y - ey), (x + ex, y + ey)]
                })
                .collect()
        }
        Layer::Line(l) => l.through.clone(),
        Layer::Band(b) => b.over.iter().flat_map(|&(x, low, high)| [(x, low), (x, high)]).collect(),
        Layer::Bars(b) => {
            b.bars.iter().enumerate().flat_map(|(i, &(from, to, h))| [(from, 0.0), (to, h + error(&b.errors, i)), (to, h - error(&b.errors, i))]).collect()
        }
        Layer::Cells(c) => c.at.iter().flat_map(|&(x, y, _)| [(x - 0.5 * c.cell.0, y - 0.5 * c.cell.1), (x + 0.5 * c.cell.0, y + 0.5 * c.cell.1)]).collect(),
        Layer::Arrows(a) => a.from.iter().zip(&a.by).flat_map(|(&(x, y), &(u, v))| [(x, y), (x + a.scale * u, y + a.scale * v)]).collect(),
        Layer::Shape(s) => s.corners.clone(),
        Layer::Rule(r) => vec![if r.horizontal { (f64::NAN, r.at) } else { (r.at, f64::NAN) }],
        Layer::Picture(p) => vec![(p.corner.0 - 0.5, p.corner.1 - 0.5), (p.corner.0 + p.size.0 - 0.5, p.corner.1 + p.size.1 - 0.5)],
    }
}
