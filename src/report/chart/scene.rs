//! A room in a fixed oblique view: cameras, boards, trajectories. U to the right and back, V up, W to the front.

use super::draw::{arrow, marks, stroke};
use super::layer::Symbol;
use super::palette::Colour;
use super::svg::{Anchor, Svg, TEXT, polyline, px, shorten, text_width};
use nalgebra::{Point3, Vector3};

const AZIMUTH_RAD: f64 = 0.55;
const ELEVATION_RAD: f64 = 0.40;

#[derive(Debug, Clone)]
enum Item {
    Path { through: Vec<Point3<f64>>, closed: bool, width: f64, name: String, colour: Colour },
    Dots { at: Vec<Point3<f64>>, size: f64, name: String, colour: Colour },
    Text { at: Point3<f64>, text: String },
    Arrow { from: Point3<f64>, to: Point3<f64>, name: String, colour: Colour },
}

/// A 3-D figure. Points are given in global axes, m (U, V, W with V up).
#[derive(Debug, Clone)]
pub struct Scene {
    title: String,
    description: String,
    width: f64,
    height: f64,
    items: Vec<Item>,
    axes: [String; 3],
}

impl Scene {
    pub fn new(title: &str) -> Self {
        let axes = ["U", "V", "W"].map(str::to_owned);
        Scene { title: title.to_owned(), description: String::new(), width: 360.0, height: 300.0, items: Vec::new(), axes }
    }
    pub fn describe(mut self, description: &str) -> Self {
        self.description = description.to_owned();
        self
    }
    /// Width and height, px of the view box.
    pub fn size(mut self, width: f64, height: f64) -> Self {
        (self.width, self.height) = (width.clamp(80.0, 4000.0), height.clamp(60.0, 4000.0));
        self
    }
    /// Names of the axes; `U`, `V`, `W` by default.
    pub fn axis_names(mut self, names: [&str; 3]) -> Self {
        self.axes = names.map(str::to_owned);
        self
    }
    /// A line through points; `name` enters the legend unless it is empty.
    pub fn path(self, through: &[Point3<f64>], name: &str, colour: Colour) -> Self {
        self.push_path(through, false, 1.6, name, colour)
    }
    /// A closed outline, such as a checkerboard's.
    pub fn outline(self, corners: &[Point3<f64>], name: &str, colour: Colour) -> Self {
        self.push_path(corners, true, 1.0, name, colour)
    }
    pub fn dots(mut self, at: &[Point3<f64>], size: f64, name: &str, colour: Colour) -> Self {
        self.items.push(Item::Dots { at: at.to_vec(), size, name: name.to_owned(), colour });
        self
    }
    pub fn text(mut self, at: Point3<f64>, text: &str) -> Self {
        self.items.push(Item::Text { at, text: text.to_owned() });
        self
    }
    pub fn arrow(mut self, from: Point3<f64>, by: Vector3<f64>, name: &str, colour: Colour) -> Self {
        self.items.push(Item::Arrow { from, to: from + by, name: name.to_owned(), colour });
        self
    }
    /// A camera as a pyramid: its centre and the directions of its image's four corners (any length, in order around).
    pub fn camera(mut self, centre: Point3<f64>, corners: &[Vector3<f64>; 4], size_m: f64, name: &str) -> Self {
        let far = corners.map(|c| centre + c.normalize() * size_m);
        for (i, corner) in far.iter().enumerate() {
            self = self.push_path(&[centre, *corner, far[(i + 1) % 4]], false, 1.2, "", Colour::GREY);
        }
        self.dots(&[centre], 5.0, "", Colour::GREY).text(centre, name)
    }
    fn push_path(mut self, through: &[Point3<f64>], closed: bool, width: f64, name: &str, colour: Colour) -> Self {
        self.items.push(Item::Path { through: through.to_vec(), closed, width, name: name.to_owned(), colour });
        self
    }

    fn all_points(&self) -> Vec<Point3<f64>> {
        let each = self.items.iter().flat_map(|item| match item {
            Item::Path { through, .. } => through.clone(),
            Item::Dots { at, .. } => at.clone(),
            Item::Text { at, .. } => vec![*at],
            Item::Arrow { from, to, .. } => vec![*from, *to],
        });
        each.filter(finite).collect()
    }

    pub fn to_svg(&self) -> String {
        let mut svg = Svg::new(self.width, self.height, &self.title, &self.description);
        let top = svg.heading(&self.title, self.width);
        let top = self.draw_legend(&mut svg, top) + 14.0;
        let points = self.all_points();
        let Some(ground) = Ground::below(&points) else {
            return svg.finish();
        };
        let flat: Vec<(f64, f64)> = points.iter().chain(&ground.corners()).chain(&[ground.mast()]).map(project).collect();
        let bound = |pick: fn(&(f64, f64)) -> f64| flat.iter().map(pick).fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
        let ((x0, x1), (y0, y1)) = (bound(|p| p.0), bound(|p| p.1));
        let (left, right, bottom) = (30.0, self.width - 42.0, self.height - 26.0);
        let unit = ((right - left) / (x1 - x0).max(1e-9)).min((bottom - top - 8.0) / (y1 - y0).max(1e-9));
        let shift = (left + 0.5 * (right - left - unit * (x1 - x0)), bottom - 0.5 * (bottom - top - 8.0 - unit * (y1 - y0)));
        let at = |p: &Point3<f64>| {
            let (x, y) = project(p);
            (shift.0 + unit * (x - x0), shift.1 - unit * (y - y0))
        };
        let names: Vec<Label> = self.items.iter().filter_map(|item| Label::of(item, &at, self.width)).collect();
        ground.draw(&mut svg, &at, &self.axes, self.width, &names);
        // Each path's shadow on the floor: without it an oblique view says little about depth.
        for item in &self.items {
            if let Item::Path { through, closed: false, name, .. } = item
                && !name.is_empty()
            {
                let shadow = through.iter().map(|p| finite(p).then(|| at(&Point3::new(p.x, ground.low.y, p.z))));
                svg.path(&polyline(shadow), "fill=\"none\" stroke=\"currentColor\" stroke-opacity=\"0.35\" stroke-dasharray=\"1.5 2.5\"");
            }
        }
        for item in &self.items {
            draw(&mut svg, item, &at);
        }
        for name in &names {
            svg.text(name.x, name.y, Anchor::Start, name.text, "");
        }
        svg.finish()
    }

    fn draw_legend(&self, svg: &mut Svg, top: f64) -> f64 {
        let (mut x, mut y, mut any) = (4.0, top, false);
        for item in &self.items {
            let (name, colour, dot) = match item {
                Item::Path { name, colour, .. } | Item::Arrow { name, colour, .. } => (name, colour, false),
                Item::Dots { name, colour, .. } => (name, colour, true),
                Item::Text { .. } => continue,
            };
            if name.is_empty() {
                continue;
            }
            let text = shorten(name, TEXT, self.width - 30.0);
            let width = 32.0 + text_width(&text, TEXT);
            if !any || x + width > self.width {
                (x, y, any) = (4.0, y + TEXT + 4.0, true);
            }
            if dot {
                svg.raw(&marks(&[(x + 8.0, y - 4.0)], Symbol::Circle, 5.0, *colour));
            } else {
                svg.line((x, y - 4.0), (x + 16.0, y - 4.0), &stroke(*colour, 1.6, ""));
            }
            svg.text(x + 20.0, y, Anchor::Start, &text, "");
            x += width;
        }
        y
    }
}

/// Paper coordinates (right, up) of a point, m.
fn project(p: &Point3<f64>) -> (f64, f64) {
    let (sin_a, cos_a) = AZIMUTH_RAD.sin_cos();
    let (sin_e, cos_e) = ELEVATION_RAD.sin_cos();
    // The viewer stands toward (-sin a, 0, cos a), raised by the elevation; U runs right, W toward the viewer.
    let right = p.x * cos_a + p.z * sin_a;
    let toward = -p.x * sin_a + p.z * cos_a;
    (right, p.y * cos_e - toward * sin_e)
}

fn finite(p: &Point3<f64>) -> bool {
    p.coords.iter().all(|c| c.is_finite() && c.abs() < 1e6)
}

/// A text of the scene at its place on paper.
struct Label<'a> {
    x: f64,
    y: f64,
    text: &'a str,
}

impl<'a> Label<'a> {
    fn of(item: &'a Item, at: &impl Fn(&Point3<f64>) -> (f64, f64), width: f64) -> Option<Self> {
        let Item::Text { at: place, text } = item else { return None };
        let (x, y) = finite(place).then(|| at(place))?;
        Some(Label { x: (x + 5.0).min(width - text_width(text, TEXT) - 2.0).max(2.0), y: y - 5.0, text })
    }

    /// Whether a text that begins at `x` on the line `y` would run into this one.
    fn meets(&self, x: f64, y: f64, text: &str) -> bool {
        (y - self.y).abs() < TEXT && x < self.x + text_width(self.text, TEXT) && self.x < x + text_width(text, TEXT)
    }
}

fn draw(svg: &mut Svg, item: &Item, at: &impl Fn(&Point3<f64>) -> (f64, f64)) {
    match item {
        Item::Path { through, closed, width, colour, .. } => {
            let d = polyline(through.iter().map(|p| finite(p).then(|| at(p))));
            let d = if *closed && !d.is_empty() { format!("{d}z") } else { d };
            svg.path(&d, &stroke(*colour, *width, ""));
        }
        Item::Dots { at: dots, size, colour, .. } => {
            let dots: Vec<(f64, f64)> = dots.iter().filter(|p| finite(p)).map(at).collect();
            svg.raw(&marks(&dots, Symbol::Circle, *size, *colour));
        }
        Item::Arrow { from, to, colour, .. } if finite(from) && finite(to) => svg.path(&arrow(at(from), at(to)), &stroke(*colour, 1.4, "")),
        Item::Text { .. } | Item::Arrow { .. } => {}
    }
}

/// The floor grid below everything, with metre labels.
struct Ground {
    low: Point3<f64>,
    high: Point3<f64>,
    step: f64,
}

impl Ground {
    fn below(points: &[Point3<f64>]) -> Option<Ground> {
        let first = points.first()?;
        let (mut low, mut high) = (*first, *first);
        for p in points {
            low = low.inf(p);
            high = high.sup(p);
        }
        let span = (high - low).max().max(1e-3);
        let step = super::axis::step(span, 5);
        let down = |v: f64| (v / step - 1e-6).floor() * step;
        let up = |v: f64| (v / step + 1e-6).ceil() * step;
        let at_least = |a: f64, b: f64| if b - a < 0.5 * step { a + step } else { b };
        let low_corner = Point3::new(down(low.x), down(low.y), down(low.z));
        let high_corner = Point3::new(at_least(low_corner.x, up(high.x)), up(high.y), at_least(low_corner.z, up(high.z)));
        Some(Ground { low: low_corner, high: high_corner, step })
    }

    fn corners(&self) -> [Point3<f64>; 4] {
        let (l, h) = (self.low, self.high);
        [Point3::new(l.x, l.y, l.z), Point3::new(h.x, l.y, l.z), Point3::new(h.x, l.y, h.z), Point3::new(l.x, l.y, h.z)]
    }

    /// Top of the height scale at the back corner.
    fn mast(&self) -> Point3<f64> {
        Point3::new(self.low.x, self.high.y.max(self.low.y + self.step), self.low.z)
    }

    fn draw(&self, svg: &mut Svg, at: &impl Fn(&Point3<f64>) -> (f64, f64), names: &[String; 3], width: f64, labels: &[Label]) {
        let (l, h) = (self.low, self.high);
        let count = |a: f64, b: f64| ((b - a) / self.step).round().clamp(1.0, 60.0) as usize;
        let mut lines = Vec::new();
        let mut numbers: Vec<(f64, f64, String)> = Vec::new();
        // A number that would run into a name or another number is left out: its neighbours tell the scale.
        let mut label = |svg: &mut Svg, p: Point3<f64>, value: f64, (dx, dy): (f64, f64), anchor: Anchor| {
            let (x, y) = at(&p);
            let text = crate::report::markup::fixed(value, if self.step < 0.1 { 2 } else { usize::from(self.step < 1.0) });
            let (x, y) = ((x + dx).min(width - 2.0), y + dy);
            let begins = x - text_width(&text, TEXT - 1.0) * anchor.share_before();
            let taken =
                labels.iter().any(|l| l.meets(begins, y, &text)) || numbers.iter().any(|(x, y0, n)| Label { x: *x, y: *y0, text: n }.meets(begins, y, &text));
            if !taken {
                svg.text(x, y, anchor, &text, &format!("font-size=\"{}\" fill-opacity=\"0.75\"", px(TEXT - 1.0)));
                numbers.push((begins, y, text));
            }
        };
        for k in 0..=count(l.x, h.x) {
            let x = l.x + k as f64 * self.step;
            lines.extend([Some(at(&Point3::new(x, l.y, l.z))), Some(at(&Point3::new(x, l.y, h.z))), None]);
            label(svg, Point3::new(x, l.y, h.z), x, (0.0, TEXT + 2.0), Anchor::Middle);
        }
        for k in 0..=count(l.z, h.z) {
            let z = l.z + k as f64 * self.step;
            lines.extend([Some(at(&Point3::new(l.x, l.y, z))), Some(at(&Point3::new(h.x, l.y, z))), None]);
            if k < count(l.z, h.z) {
                label(svg, Point3::new(h.x, l.y, z), z, (7.0, 3.0), Anchor::Start);
            }
        }
        svg.path(&polyline(lines), "fill=\"none\" stroke=\"currentColor\" stroke-opacity=\"0.16\"");
        // Height scale at the back corner, and the axes' names.
        let (foot, top) = (l, self.mast());
        svg.line(at(&foot), at(&top), "fill=\"none\" stroke=\"currentColor\" stroke-opacity=\"0.4\"");
        for k in 1..=count(l.y, top.y) {
            let v = l.y + k as f64 * self.step;
            label(svg, Point3::new(l.x, v, l.z), v, (-4.0, 4.0), Anchor::End);
        }
        let name = |svg: &mut Svg, p: Point3<f64>, dx: f64, dy: f64, text: &str| {
            let (x, y) = at(&p);
            let (x, y) = ((x + dx).min(width - text_width(text, TEXT) - 2.0).max(2.0), y + dy);
            // A line lower or higher where a camera's name stands there.
            let free = |y: &f64| !labels.iter().any(|l| l.meets(x, *y, text));
            let y = [y, y + TEXT + 2.0, y - TEXT - 2.0].into_iter().find(free).unwrap_or(y);
            svg.text(x, y, Anchor::Start, text, "font-style=\"italic\"");
        };
        name(svg, Point3::new(0.5 * (l.x + h.x), l.y, h.z), -6.0, 2.5 * TEXT, &format!("{} (m)", names[0]));
        name(svg, Point3::new(h.x, l.y, 0.5 * (l.z + h.z)), 38.0, -2.0, &format!("{} (m)", names[2]));
        name(svg, top, -10.0, -6.0, &format!("{} (m)", names[1]));
    }
}
