//! The page: sections one after the other, with a table of contents, in one file that needs nothing else.

use super::chart;
use super::markup::{escape, prose};
use std::fmt::Write;

const STYLE: &str = include_str!("page.css");

/// How a verdict is to be taken; shown by a coloured edge beside the words.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Tone {
    Good,
    Doubt,
    Bad,
    Plain,
}

/// How figures share the page's width.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Layout {
    /// As many beside each other as fit at reading size.
    Normal,
    /// Small multiples.
    Small,
    /// One below the other, wide.
    Wide,
}

/// One part of the page. Everything given as text is escaped; only [`Section::html`], [`Section::figure`] and
/// [`Section::figures`] take markup.
#[derive(Debug, Clone)]
pub struct Section {
    id: String,
    heading: String,
    body: String,
}

impl Section {
    /// `id`: the anchor; letters, digits and hyphens are kept.
    pub fn new(id: &str, heading: &str) -> Self {
        let id = id.chars().filter(|c| c.is_ascii_alphanumeric() || *c == '-').collect();
        Section { id, heading: heading.to_owned(), body: String::new() }
    }

    /// Markup as it stands.
    pub fn html(mut self, markup: &str) -> Self {
        self.body.push_str(markup);
        self
    }

    pub fn heading(self, text: &str) -> Self {
        self.element("h3", "", text)
    }

    pub fn paragraph(self, text: &str) -> Self {
        self.element("p", "", text)
    }

    /// A paragraph of explanation, set back.
    pub fn note(self, text: &str) -> Self {
        self.element("p", " class=\"soft\"", text)
    }

    fn element(mut self, tag: &str, attributes: &str, text: &str) -> Self {
        let _ = write!(self.body, "<{tag}{attributes}>{}</{tag}>", if tag == "pre" { escape(text) } else { prose(text) });
        self
    }

    /// A framed statement; the first line is the verdict, the others its reasons.
    pub fn verdict(mut self, tone: Tone, lines: &[String]) -> Self {
        let class = match tone {
            Tone::Good => " good",
            Tone::Doubt => " doubt",
            Tone::Bad => " bad",
            Tone::Plain => "",
        };
        let _ = write!(self.body, "<div class=\"verdict{class}\">");
        for line in lines {
            let _ = write!(self.body, "<p>{}</p>", prose(line));
        }
        self.body.push_str("</div>");
        self
    }

    /// Figures that matter, large: (value with unit, what it is).
    pub fn cards(mut self, cards: &[(String, String)]) -> Self {
        if cards.is_empty() {
            return self;
        }
        self.body.push_str("<div class=\"cards\">");
        for (value, what) in cards {
            let _ = write!(self.body, "<div class=\"card\"><b>{}</b><span>{}</span></div>", escape(value), prose(what));
        }
        self.body.push_str("</div>");
        self
    }

    pub fn list(mut self, items: &[String]) -> Self {
        if !items.is_empty() {
            let items: String = items.iter().map(|i| format!("<li>{}</li>", prose(i))).collect();
            let _ = write!(self.body, "<ul>{items}</ul>");
        }
        self
    }

    /// Text kept as it is typed, to be copied.
    pub fn code(self, text: &str) -> Self {
        self.element("pre", "", text)
    }

    /// One SVG figure with its caption.
    pub fn figure(self, svg: &str, caption: &str) -> Self {
        self.figures(Layout::Normal, &[(svg.to_owned(), caption.to_owned())])
    }

    /// SVG figures with their captions, laid out together; nothing when there are none.
    pub fn figures(mut self, layout: Layout, figures: &[(String, String)]) -> Self {
        if figures.is_empty() {
            return self;
        }
        let class = match layout {
            Layout::Normal => "",
            Layout::Small => " small",
            Layout::Wide => " wide",
        };
        let _ = write!(self.body, "<div class=\"figures{class}\">");
        for (svg, caption) in figures {
            let caption = if caption.is_empty() { String::new() } else { format!("<figcaption>{}</figcaption>", prose(caption)) };
            let _ = write!(self.body, "<figure>{}{caption}</figure>", svg.replacen(chart::OWN_STYLE, "", 1));
        }
        self.body.push_str("</div>");
        self
    }

    pub fn table(mut self, table: Table) -> Self {
        self.body.push_str(&table.markup());
        self
    }

    /// Folds what `inside` adds behind a line to click; it is printed only if the reader opened it.
    pub fn folded(mut self, summary: &str, inside: impl FnOnce(Section) -> Section) -> Self {
        let inner = inside(Section::new("", ""));
        if !inner.body.is_empty() {
            let _ = write!(self.body, "<details><summary>{}</summary>{}</details>", escape(summary), inner.body);
        }
        self
    }

    pub fn is_empty(&self) -> bool {
        self.body.is_empty()
    }
}

/// How a cell with a share bar begins.
const BAR: &str = "<span class=\"bar\">";
/// A column of words holds long texts from this many characters on.
const LONG_TEXT: usize = 36;
/// Tables of more columns are set small, so that a page holds them without scrolling.
const MANY_COLUMNS: usize = 9;

/// A table; cells are text. Columns marked as numbers are set to the right.
#[derive(Debug, Clone, Default)]
pub struct Table {
    caption: String,
    head: Vec<(String, bool)>,
    rows: Vec<Vec<String>>,
}

impl Table {
    pub fn new(caption: &str) -> Self {
        Table { caption: caption.to_owned(), ..Default::default() }
    }

    /// A column of words.
    pub fn column(mut self, head: &str) -> Self {
        self.head.push((head.to_owned(), false));
        self
    }

    /// A column of numbers.
    pub fn numbers(mut self, head: &str) -> Self {
        self.head.push((head.to_owned(), true));
        self
    }

    pub fn row<T: AsRef<str>>(mut self, cells: &[T]) -> Self {
        self.rows.push(cells.iter().map(|c| escape(c.as_ref())).collect());
        self
    }

    /// A row whose cells may hold a share bar: text and, where wanted, a share from 0 to 1 drawn before it.
    pub fn row_with_bars(mut self, cells: &[(String, Option<f64>)]) -> Self {
        let cell = |(text, share): &(String, Option<f64>)| match share {
            Some(s) if s.is_finite() => format!("{BAR}<i style=\"width:{:.0}%\"></i></span>{}", 100.0 * s.clamp(0.0, 1.0), escape(text)),
            _ => escape(text),
        };
        self.rows.push(cells.iter().map(cell).collect());
        self
    }

    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    fn markup(&self) -> String {
        if self.rows.is_empty() {
            return String::new();
        }
        let number = |i: usize| self.head.get(i).is_some_and(|h| h.1);
        // Words are broken only in columns that hold a long text; share bars are short.
        let long = |i: usize| {
            let lengths = self.rows.iter().filter_map(|r| r.get(i)).filter(|c| !c.starts_with(BAR)).map(|c| c.chars().count());
            !number(i) && lengths.max().unwrap_or(0) > LONG_TEXT
        };
        let columns = self.rows.iter().map(Vec::len).max().unwrap_or(0).max(self.head.len());
        let kind = |i: usize| match (number(i), long(i)) {
            (true, _) => " class=\"n\"",
            (false, true) => " class=\"long\"",
            (false, false) => "",
        };
        let classes: Vec<&str> = (0..columns).map(kind).collect();
        let class = |i: usize| classes.get(i).copied().unwrap_or("");
        let many = if self.head.len() > MANY_COLUMNS { " class=\"many\"" } else { "" };
        let mut out = format!("<div class=\"scroll\" tabindex=\"0\"><table{many}>");
        if !self.caption.is_empty() {
            let _ = write!(out, "<caption><span>{}</span></caption>", prose(&self.caption));
        }
        out.push_str("<thead><tr>");
        for (i, (head, _)) in self.head.iter().enumerate() {
            let _ = write!(out, "<th scope=\"col\"{}>{}</th>", class(i), prose(head).replace("± ", "±\u{a0}"));
        }
        out.push_str("</tr></thead><tbody>");
        for row in &self.rows {
            out.push_str("<tr>");
            for (i, cell) in row.iter().enumerate() {
                // On paper a number may break before its deviation, but not after the sign.
                let _ = write!(out, "<td{}>{}</td>", class(i), if number(i) { cell.replace(" ± ", " ±\u{a0}") } else { cell.clone() });
            }
            out.push_str("</tr>");
        }
        out.push_str("</tbody></table></div>");
        out
    }
}

/// A report under construction.
#[derive(Debug, Clone)]
pub struct Report {
    title: String,
    subtitle: String,
    window: String,
    sections: Vec<Section>,
}

impl Report {
    pub fn new(title: &str) -> Self {
        Report { title: title.to_owned(), subtitle: String::new(), window: format!("{title} – sweetspot"), sections: Vec::new() }
    }

    pub fn subtitle(mut self, text: &str) -> Self {
        self.subtitle = text.to_owned();
        self
    }

    /// The command or the kind of report the page is of, for the title in the browser's tab and in a printed page's head: among many open reports
    /// a tab must tell its own.
    pub fn command(mut self, command: &str) -> Self {
        self.window = format!("{} – sweetspot {command}", self.title);
        self
    }

    /// Adds a section; `None` and sections without content are left out.
    pub fn section(mut self, section: impl Into<Option<Section>>) -> Self {
        if let Some(section) = section.into().filter(|s| !s.is_empty()) {
            self.sections.push(section);
        }
        self
    }

    /// The page. Well-formed as XML too, so that other programs can read it.
    pub fn finish(&self) -> String {
        let (title, window) = (escape(&self.title), escape(&self.window));
        let mut out = format!(
            "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"/><meta name=\"viewport\" content=\"width=device-width, initial-scale=1\"/>\
             <meta name=\"generator\" content=\"sweetspot {}\"/><title>{window}</title><style>\n{STYLE}{}</style></head>\n<body><header><h1>{title}</h1>",
            crate::provenance::VERSION,
            chart::dark_style()
        );
        if !self.subtitle.is_empty() {
            let _ = write!(out, "<p class=\"sub\">{}</p>", escape(&self.subtitle));
        }
        if self.sections.len() > 2 {
            out.push_str("<nav aria-label=\"Contents\">");
            for (i, s) in self.sections.iter().enumerate() {
                let _ = write!(out, "<a href=\"#{}\">{}</a> ", anchor(s, i), escape(&s.heading));
            }
            out.push_str("</nav>");
        }
        out.push_str("</header>\n<main>");
        for (i, s) in self.sections.iter().enumerate() {
            let _ = writeln!(out, "<section id=\"{}\"><h2>{}</h2>{}</section>", anchor(s, i), escape(&s.heading), s.body);
        }
        let _ = writeln!(out, "</main>\n<footer><p>Written by sweetspot {}.</p></footer></body></html>", crate::provenance::VERSION);
        out
    }
}

/// Anchors are made unique by the section's place.
fn anchor(section: &Section, place: usize) -> String {
    format!("{}-{}", if section.id.is_empty() { "part" } else { &section.id }, place + 1)
}
