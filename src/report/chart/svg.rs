//! The few SVG marks that charts need, written compactly.

mod path;

use crate::report::markup::escape;
pub(super) use path::{Form, Path, px};
use std::fmt::Write;

/// Text size of labels, px of the view box; [`OWN_STYLE`] states it.
pub(super) const TEXT: f64 = 11.0;

/// Width of a text, px; an estimate good to some 10 % for sans-serif fonts.
pub(super) fn text_width(text: &str, size: f64) -> f64 {
    let em: f64 = text
        .chars()
        .map(|c| match c {
            'i' | 'l' | 'j' | '.' | ',' | '\'' | '|' | ' ' | ':' | ';' => 0.29,
            'f' | 't' | 'r' | '(' | ')' | '-' => 0.36,
            'm' | 'w' | 'M' | 'W' | '@' | '%' => 0.86,
            c if c.is_ascii_uppercase() => 0.67,
            c if c.is_ascii() => 0.56,
            '²' | '³' | '¹' | '⁻' | '·' => 0.36,
            c if (c as u32) > 0x2e80 => 1.0,
            _ => 0.6,
        })
        .sum();
    1.08 * em * size
}

/// Breaks text into lines no wider than `width`, cutting words that are wider; at most `most` lines.
pub(super) fn wrap(text: &str, size: f64, width: f64, most: usize) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        let word = shorten(word, size, width);
        let full = lines.len() >= most;
        match lines.last_mut() {
            Some(line) if text_width(&format!("{line} {word}"), size) <= width => {
                line.push(' ');
                line.push_str(&word);
            }
            Some(line) if full => {
                line.push('…');
                break;
            }
            _ => lines.push(word),
        }
    }
    lines
}

/// Cuts a text with an ellipsis when it is wider than `width`.
pub(super) fn shorten(text: &str, size: f64, width: f64) -> String {
    if text_width(text, size) <= width {
        return text.to_owned();
    }
    let mut kept = String::new();
    for c in text.chars() {
        if text_width(&kept, size) + size > width {
            break;
        }
        kept.push(c);
    }
    kept.push('…');
    kept
}

#[derive(Debug, Clone, Copy)]
pub(super) enum Anchor {
    Start,
    Middle,
    End,
}

impl Anchor {
    /// Share of a text that stands before its place.
    pub fn share_before(self) -> f64 {
        match self {
            Anchor::Start => 0.0,
            Anchor::Middle => 0.5,
            Anchor::End => 1.0,
        }
    }
}

/// How a figure's text and lines look where it stands alone; in a page the style says it once for all.
pub(in crate::report) const OWN_STYLE: &str =
    " font-family=\"system-ui,-apple-system,'Segoe UI',Roboto,'Helvetica Neue',Arial,sans-serif\" font-size=\"11\" fill=\"currentColor\"";

/// An SVG document under construction.
pub(super) struct Svg {
    out: String,
}

impl Svg {
    /// Opens a figure; title and description are read aloud by screen readers.
    pub fn new(width: f64, height: f64, title: &str, description: &str) -> Self {
        let mut out = String::new();
        let (w, h) = (px(width), px(height));
        let label = escape(title);
        let _ = write!(
            out,
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {w} {h}\" width=\"{w}\" height=\"{h}\" role=\"img\" aria-label=\"{label}\"{OWN_STYLE}><title>{label}</title>"
        );
        if !description.is_empty() {
            let _ = write!(out, "<desc>{}</desc>", escape(description));
        }
        Svg { out }
    }

    pub fn finish(mut self) -> String {
        self.out.push_str("</svg>");
        self.out
    }

    /// The title in bold at the top; returns its lower edge.
    pub fn heading(&mut self, title: &str, width: f64) -> f64 {
        let mut top = 4.0;
        for line in wrap(title, 1.06 * (TEXT + 1.0), width - 8.0, 2) {
            top += TEXT + 3.0;
            self.text(4.0, top - 2.0, Anchor::Start, &line, &format!("font-weight=\"600\" font-size=\"{}\"", px(TEXT + 1.0)));
        }
        top
    }

    /// A path with the given presentation attributes; nothing when `d` is empty.
    pub fn path(&mut self, d: &str, attributes: &str) {
        if !d.is_empty() {
            let _ = write!(self.out, "<path d=\"{d}\" {attributes}/>");
        }
    }

    pub fn rect(&mut self, x: f64, y: f64, width: f64, height: f64, attributes: &str) {
        let _ = write!(self.out, "<rect x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\" {attributes}/>", px(x), px(y), px(width), px(height));
    }

    pub fn line(&mut self, a: (f64, f64), b: (f64, f64), attributes: &str) {
        self.path(&format!("M{} {}L{} {}", px(a.0), px(a.1), px(b.0), px(b.1)), attributes);
    }

    /// Escaped text at a place; `attributes` may be empty.
    pub fn text(&mut self, x: f64, y: f64, anchor: Anchor, text: &str, attributes: &str) {
        let anchor = match anchor {
            Anchor::Start => "",
            Anchor::Middle => " text-anchor=\"middle\"",
            Anchor::End => " text-anchor=\"end\"",
        };
        let space = if attributes.is_empty() { "" } else { " " };
        let _ = write!(self.out, "<text x=\"{}\" y=\"{}\"{anchor}{space}{attributes}>{}</text>", px(x), px(y), escape(text));
    }

    pub fn raw(&mut self, markup: &str) {
        self.out.push_str(markup);
    }
}

/// The piece of a path through points, a new one at every gap (`None`).
pub(super) fn polyline(points: impl IntoIterator<Item = Option<(f64, f64)>>) -> String {
    let mut path = Path::default();
    let mut pen_down = false;
    for p in points {
        match p {
            Some(p) if pen_down => path.line_to(p),
            Some(p) => {
                path.move_to(p);
                pen_down = true;
            }
            None => pen_down = false,
        }
    }
    path.d
}
