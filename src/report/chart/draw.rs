//! Drawing of each layer in pixels, and the plane between the axes.

use super::axis::Scale;
use super::layer::{Arrows, Band, Bars, Cells, Line, Picture, Points, Rule, Shape, Symbol};
use super::palette::{Colour, diverging, sequential};
use super::svg::{Anchor, Form, Path, Svg, TEXT, polyline, px, text_width};
use std::fmt::Write;

/// The area between the axes and the way from values to pixels.
pub(super) struct Plane {
    pub left: f64,
    pub top: f64,
    pub right: f64,
    pub bottom: f64,
    pub x: Scale,
    pub y: Scale,
    pub y_reversed: bool,
}

impl Plane {
    pub fn at(&self, (x, y): (f64, f64)) -> (f64, f64) {
        let sx = (x - self.x.low) / (self.x.high - self.x.low);
        let sy = (y - self.y.low) / (self.y.high - self.y.low);
        let sy = if self.y_reversed { 1.0 - sy } else { sy };
        (self.left + sx * (self.right - self.left), self.bottom - sy * (self.bottom - self.top))
    }

    fn clamp(&self, (x, y): (f64, f64)) -> (f64, f64) {
        (x.clamp(self.left, self.right), y.clamp(self.top, self.bottom))
    }

    fn holds(&self, (x, y): (f64, f64)) -> bool {
        x >= self.left - 0.05 && x <= self.right + 0.05 && y >= self.top - 0.05 && y <= self.bottom + 0.05
    }

    /// The part of a segment (px) inside the plane (Liang and Barsky's clipping).
    pub fn clip(&self, a: (f64, f64), b: (f64, f64)) -> Option<((f64, f64), (f64, f64))> {
        let (dx, dy) = (b.0 - a.0, b.1 - a.1);
        let (mut enter, mut leave) = (0.0f64, 1.0f64);
        for (p, q) in [(-dx, a.0 - self.left), (dx, self.right - a.0), (-dy, a.1 - self.top), (dy, self.bottom - a.1)] {
            if p == 0.0 {
                if q < 0.0 {
                    return None;
                }
            } else if p < 0.0 {
                enter = enter.max(q / p);
            } else {
                leave = leave.min(q / p);
            }
        }
        (enter <= leave).then_some(((a.0 + enter * dx, a.1 + enter * dy), (a.0 + leave * dx, a.1 + leave * dy)))
    }
}

pub(super) fn stroke(colour: Colour, width: f64, dashes: &str) -> String {
    let dashes = if dashes.is_empty() { String::new() } else { format!(" stroke-dasharray=\"{dashes}\"") };
    format!("fill=\"none\" stroke=\"{colour}\" stroke-width=\"{}\" stroke-linejoin=\"round\"{dashes}", px(width))
}

/// All marks of a series as one element: a page with thousands of points stays small.
pub(super) fn marks(at: &[(f64, f64)], symbol: Symbol, size: f64, colour: Colour) -> String {
    let r = 0.5 * size;
    // A square is a stroke as wide as it is long; a diamond is one on its corner.
    let (square, diamond) = (1.8 * r, 1.25 * r);
    let form = match symbol {
        Symbol::Circle => Form::new((0.0, 0.0), &[('h', &[0.0])]),
        Symbol::Ring => {
            let half = |way: f64| [r, r, 0.0, 1.0, 0.0, way * size, 0.0];
            Form::new((-r, 0.0), &[('a', &half(1.0)), ('a', &half(-1.0))])
        }
        Symbol::Square => Form::new((-0.5 * square, 0.0), &[('h', &[square])]),
        Symbol::Triangle => Form::new((0.0, -1.15 * r), &[('l', &[1.1 * r, 2.0 * r]), ('h', &[-2.2 * r]), ('z', &[])]),
        Symbol::Diamond => Form::new((-0.5 * diamond, -0.5 * diamond), &[('l', &[diamond, diamond])]),
        Symbol::Cross => Form::new((-r, -r), &[('l', &[size, size]), ('m', &[0.0, -size]), ('l', &[-size, size])]),
        Symbol::Plus => Form::new((-1.2 * r, 0.0), &[('h', &[2.4 * r]), ('m', &[-1.2 * r, -1.2 * r]), ('v', &[2.4 * r])]),
    };
    let mut path = Path::default();
    path.stamp(&form, at.iter().copied());
    let d = path.d;
    if d.is_empty() {
        return d;
    }
    let stroked = |width: f64| format!("fill=\"none\" stroke=\"{colour}\" stroke-width=\"{}\"", px(width));
    let style = match symbol {
        Symbol::Circle => format!("{} stroke-linecap=\"round\"", stroked(size)),
        Symbol::Square => stroked(square),
        Symbol::Diamond => stroked(std::f64::consts::SQRT_2 * diamond),
        Symbol::Cross | Symbol::Plus | Symbol::Ring => stroked(1.3),
        Symbol::Triangle => format!("fill=\"{colour}\""),
    };
    format!("<path d=\"{d}\" {style} opacity=\"{}\"/>", if at.len() > 100 { 0.6 } else { 0.9 })
}

/// An arrow's path; a bare dot when it is too short to have a head.
pub(super) fn arrow(a: (f64, f64), b: (f64, f64)) -> String {
    let (dx, dy) = (b.0 - a.0, b.1 - a.1);
    let length = dx.hypot(dy);
    if length.is_nan() || length < 0.5 {
        return String::new();
    }
    let (ux, uy) = (dx / length, dy / length);
    let head = (0.4 * length).min(4.5);
    let wing = |side: f64| (b.0 - head * ux - side * 0.5 * head * uy, b.1 - head * uy + side * 0.5 * head * ux);
    let (l, r) = (wing(1.0), wing(-1.0));
    format!("M{} {}L{} {}M{} {}L{} {}L{} {}", px(a.0), px(a.1), px(b.0), px(b.1), px(l.0), px(l.1), px(b.0), px(b.1), px(r.0), px(r.1))
}

fn finite(p: (f64, f64)) -> bool {
    p.0.is_finite() && p.1.is_finite()
}

pub(super) fn points(svg: &mut Svg, plane: &Plane, layer: &Points, colour: Colour) {
    let mut bars = Path::default();
    let (mut inside, mut outside) = (Vec::new(), Vec::new());
    for (i, &value) in layer.at.iter().enumerate().filter(|(_, v)| finite(**v)) {
        let at = plane.at(value);
        if !plane.holds(at) {
            outside.push(plane.clamp(at));
            continue;
        }
        inside.push(at);
        let sd = |errors: &[f64]| errors.get(i).copied().filter(|s| s.is_finite() && *s > 0.0);
        for (a, b) in sd(&layer.x_error)
            .map(|s| ((value.0 - s, value.1), (value.0 + s, value.1)))
            .into_iter()
            .chain(sd(&layer.y_error).map(|s| ((value.0, value.1 - s), (value.0, value.1 + s))))
        {
            // A whisker inside its mark would only cost bytes.
            if let Some((a, b)) = plane.clip(plane.at(a), plane.at(b)).filter(|(a, b)| (a.0 - b.0).hypot(a.1 - b.1) > layer.size) {
                bars.move_to(a);
                bars.line_to(b);
            }
        }
    }
    svg.path(&bars.d, &format!("{} stroke-opacity=\"{}\"", stroke(colour, 1.0, ""), if layer.at.len() > 100 { 0.35 } else { 0.7 }));
    svg.raw(&marks(&inside, layer.symbol, layer.size, colour));
    svg.raw(&marks(&outside, Symbol::Ring, layer.size.max(4.0), colour));
    for (label, &value) in layer.labels.iter().zip(&layer.at).filter(|(l, v)| !l.is_empty() && finite(**v)) {
        let (x, y) = plane.at(value);
        if plane.holds((x, y)) {
            let before = x + text_width(label, TEXT) + 6.0 > plane.right;
            let (x, anchor) = if before { (x - layer.size, Anchor::End) } else { (x + layer.size, Anchor::Start) };
            svg.text(x, y - 3.0, anchor, label, &format!("font-size=\"{}\"", px(TEXT - 1.0)));
        }
    }
}

pub(super) fn line(svg: &mut Svg, plane: &Plane, layer: &Line, colour: Colour) {
    let mut path: Vec<(f64, f64)> = Vec::with_capacity(layer.through.len());
    for &value in &layer.through {
        if layer.steps
            && let Some(&last) = path.last().filter(|l| finite(**l))
        {
            path.push((value.0, last.1));
        }
        path.push(value);
    }
    let mut pieces: Vec<Option<(f64, f64)>> = Vec::new();
    for pair in path.windows(2) {
        let clipped = (finite(pair[0]) && finite(pair[1])).then(|| plane.clip(plane.at(pair[0]), plane.at(pair[1]))).flatten();
        match clipped {
            Some((a, b)) => {
                if pieces.last().copied().flatten() != Some(a) {
                    pieces.push(None);
                    pieces.push(Some(a));
                }
                pieces.push(Some(b));
            }
            None => pieces.push(None),
        }
    }
    svg.path(&polyline(pieces), &stroke(colour, layer.width, layer.dashes));
}

pub(super) fn band(svg: &mut Svg, plane: &Plane, layer: &Band, colour: Colour) {
    let over: Vec<&(f64, f64, f64)> = layer.over.iter().filter(|b| b.0.is_finite() && b.1.is_finite() && b.2.is_finite()).collect();
    let low = over.iter().map(|b| Some(plane.clamp(plane.at((b.0, b.1)))));
    let high = over.iter().rev().map(|b| Some(plane.clamp(plane.at((b.0, b.2)))));
    let d = polyline(low.chain(high));
    if !d.is_empty() {
        svg.path(&format!("{d}z"), &format!("fill=\"{colour}\" fill-opacity=\"0.25\""));
    }
}

pub(super) fn bars(svg: &mut Svg, plane: &Plane, layer: &Bars, colour: Colour) {
    let (mut d, mut whiskers) = (Path::default(), Path::default());
    for (i, &(from, to, height)) in layer.bars.iter().enumerate().filter(|(_, b)| b.0.is_finite() && b.1.is_finite() && b.2.is_finite()) {
        let (a, b) = (plane.clamp(plane.at((from, height))), plane.clamp(plane.at((to, 0.0))));
        if (a.1 - b.1).abs() > 0.05 {
            d.move_to((a.0, b.1));
            [a, (b.0, a.1), b].into_iter().for_each(|p| d.line_to(p));
            d.close();
        }
        if let Some(sd) = layer.errors.get(i).filter(|s| s.is_finite() && **s > 0.0) {
            let middle = 0.5 * (from + to);
            let (a, b) = (plane.clamp(plane.at((middle, height - sd))), plane.clamp(plane.at((middle, height + sd))));
            for (from, to) in [(a, b), ((b.0 - 3.0, b.1), (b.0 + 3.0, b.1)), ((a.0 - 3.0, a.1), (a.0 + 3.0, a.1))] {
                whiskers.move_to(from);
                whiskers.line_to(to);
            }
        }
    }
    svg.path(&d.d, &format!("fill=\"{colour}\" fill-opacity=\"0.45\" stroke=\"{colour}\" stroke-width=\"1\""));
    svg.path(&whiskers.d, "fill=\"none\" stroke=\"currentColor\"");
}

pub(super) fn cells(svg: &mut Svg, plane: &Plane, layer: &Cells) {
    let (low, high) = layer.limits();
    let colour = |v: f64| {
        let share = (v - low) / (high - low);
        if layer.signed { diverging(2.0 * share - 1.0) } else { sequential(share) }
    };
    // One path per colour step keeps the file small; 40 steps are finer than the eye.
    const STEPS: usize = 40;
    let mut by_step: Vec<Path> = (0..=STEPS).map(|_| Path::default()).collect();
    let mut numbers = Vec::new();
    for &(x, y, value) in layer.at.iter().filter(|c| c.0.is_finite() && c.1.is_finite() && c.2.is_finite()) {
        let a = plane.clamp(plane.at((x - 0.5 * layer.cell.0, y - 0.5 * layer.cell.1)));
        let b = plane.clamp(plane.at((x + 0.5 * layer.cell.0, y + 0.5 * layer.cell.1)));
        let step = (((value - low) / (high - low)).clamp(0.0, 1.0) * STEPS as f64).round() as usize;
        by_step[step].move_to(a);
        [(b.0, a.1), b, (a.0, b.1)].into_iter().for_each(|p| by_step[step].line_to(p));
        by_step[step].close();
        numbers.push((0.5 * (a.0 + b.0), 0.5 * (a.1 + b.1), value));
    }
    for (step, path) in by_step.iter().enumerate() {
        let paint = colour(low + (high - low) * step as f64 / STEPS as f64);
        // The stroke closes the hair lines between neighbours.
        svg.path(&path.d, &format!("fill=\"{paint}\" stroke=\"{paint}\" stroke-width=\"0.8\""));
    }
    // Edges tell a dark cell from a blank one on dark paper, and a pale one on white; many cells tell it by their number.
    const MOST_EDGED: usize = 400;
    if numbers.len() <= MOST_EDGED {
        svg.path(
            &by_step.iter().map(|path| path.d.as_str()).collect::<String>(),
            "fill=\"none\" stroke=\"currentColor\" stroke-width=\"0.6\" stroke-opacity=\"0.45\"",
        );
    }
    if layer.numbered {
        for (x, y, value) in numbers {
            let ink = if colour(value).is_dark() { "#ffffff" } else { "#000000" };
            svg.text(x, y + 0.35 * TEXT, Anchor::Middle, &crate::report::markup::fixed(value, 0), &format!("fill=\"{ink}\""));
        }
    }
    let (x, height) = (plane.right + 8.0, (plane.bottom - plane.top).min(180.0));
    let top = plane.top + TEXT + 6.0;
    let height = (height - TEXT - 6.0).max(20.0);
    for step in 0..STEPS {
        let value = high - (high - low) * (step as f64 + 0.5) / STEPS as f64;
        let slice = height / STEPS as f64;
        svg.rect(x, top + step as f64 * slice, 10.0, slice + 0.4, &format!("fill=\"{}\"", colour(value)));
    }
    svg.rect(x, top, 10.0, height, "fill=\"none\" stroke=\"currentColor\" stroke-width=\"0.6\" stroke-opacity=\"0.6\"");
    let scale = Scale::over(low, high, 4);
    for (value, label) in &scale.ticks {
        let y = top + height * (high - value) / (high - low);
        svg.text(x + 13.0, y + 0.35 * TEXT, Anchor::Start, label, &format!("font-size=\"{}\"", px(TEXT - 1.0)));
    }
    let unit = if scale.power == 0 { String::new() } else { format!("10{} ", crate::report::markup::superscript(scale.power)) };
    svg.text(x + 52.0, plane.top + TEXT - 3.0, Anchor::End, &format!("{unit}{}", layer.label), &format!("font-size=\"{}\"", px(TEXT - 1.0)));
}

pub(super) fn arrows(svg: &mut Svg, plane: &Plane, layer: &Arrows, colour: Colour) {
    let pieces = layer.from.iter().zip(&layer.by).filter(|(a, b)| finite(**a) && finite(**b));
    let ends = pieces.map(|(&(x, y), &(u, v))| (plane.at((x, y)), plane.at((x + layer.scale * u, y + layer.scale * v))));
    let d: String = ends.filter(|(a, _)| plane.holds(*a)).map(|(a, b)| arrow(a, plane.clip(a, b).map_or(b, |c| c.1))).collect();
    svg.path(&d, &format!("{} stroke-opacity=\"0.85\"", stroke(colour, 1.1, "")));
}

pub(super) fn shape(svg: &mut Svg, plane: &Plane, layer: &Shape) {
    let outline = |corners: &[(f64, f64)]| polyline(corners.iter().filter(|c| finite(**c)).map(|c| Some(plane.clamp(plane.at(*c)))));
    let (mut d, hole) = (outline(&layer.corners), outline(&layer.hole));
    if d.is_empty() {
        return;
    }
    if !hole.is_empty() {
        let _ = write!(d, "z{hole}");
    }
    let ink = layer.colour.map_or("currentColor".to_owned(), |c| c.to_string());
    let fill = if layer.filled { ink.as_str() } else { "none" };
    svg.path(
        &format!("{d}z"),
        &format!("fill=\"{fill}\" fill-rule=\"evenodd\" stroke=\"{ink}\" stroke-width=\"{}\" opacity=\"{}\"", px(layer.width), layer.opacity),
    );
}

pub(super) fn rule(svg: &mut Svg, plane: &Plane, layer: &Rule) {
    let (a, b) = if layer.horizontal {
        (plane.at((plane.x.low, layer.at)), plane.at((plane.x.high, layer.at)))
    } else {
        (plane.at((layer.at, plane.y.low)), plane.at((layer.at, plane.y.high)))
    };
    if finite(a) && plane.holds(a) {
        svg.line(a, b, &format!("fill=\"none\" {}", rule_stroke(layer)));
    }
}

/// How a rule is drawn, in the plane and in the legend.
pub(super) fn rule_stroke(layer: &Rule) -> String {
    let ink = layer.colour.map_or("currentColor".to_owned(), |c| c.to_string());
    let dashes = if layer.solid { "" } else { " stroke-dasharray=\"4 3\"" };
    format!("stroke=\"{ink}\" stroke-opacity=\"0.75\"{dashes}")
}

pub(super) fn picture(svg: &mut Svg, plane: &Plane, layer: &Picture) {
    let a = plane.at((layer.corner.0 - 0.5, layer.corner.1 - 0.5));
    let b = plane.at((layer.corner.0 + layer.size.0 - 0.5, layer.corner.1 + layer.size.1 - 0.5));
    if finite(a) && finite(b) {
        svg.raw(&format!(
            "<image x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\" preserveAspectRatio=\"none\" style=\"image-rendering:pixelated\" href=\"data:image/png;base64,{}\"/>",
            px(a.0.min(b.0)),
            px(a.1.min(b.1)),
            px((b.0 - a.0).abs()),
            px((b.1 - a.1).abs()),
            crate::report::markup::base64(&layer.png)
        ));
    }
}
