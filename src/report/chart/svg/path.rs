//! The text of a path. A season's report holds tens of thousands of points: each is told by how far it is from the one before, in tenths of a pixel, which is what
//! its place is rounded to, so that no error adds up along the way.

use std::collections::BTreeSet;
use std::fmt::Write;

/// A coordinate to a tenth of a pixel, without a needless fraction.
pub fn px(v: f64) -> String {
    let tenths = (v * 10.0).round();
    if tenths == 0.0 {
        return "0".to_owned();
    }
    if tenths % 10.0 == 0.0 { format!("{}", tenths / 10.0) } else { format!("{:.1}", tenths / 10.0) }
}

/// A place, or a way, in tenths of a pixel.
type Tenths = (i64, i64);

fn tenths(v: f64) -> i64 {
    // Beyond any sheet; differences of such places must not overflow.
    (10.0 * v).round().clamp(-1e9, 1e9) as i64
}

/// A path under construction; it begins with a place on the sheet, so that paths may be joined.
#[derive(Debug, Default)]
pub struct Path {
    pub d: String,
    at: Tenths,
    /// Where the open piece began: a closed one leads back to it.
    began: Tenths,
    /// The last command: the same need not be written again.
    command: Option<char>,
}

impl Path {
    /// Lifts the pen and sets it down, px.
    pub fn move_to(&mut self, (x, y): (f64, f64)) {
        self.start_at((tenths(x), tenths(y)));
    }

    fn start_at(&mut self, to: Tenths) {
        if self.d.is_empty() {
            self.write('M', &[to.0, to.1]);
        } else {
            self.command = None;
            self.write('m', &[to.0 - self.at.0, to.1 - self.at.1]);
        }
        (self.at, self.began) = (to, to);
    }

    /// A straight line, px; none where the rounded place is the same.
    pub fn line_to(&mut self, (x, y): (f64, f64)) {
        let (dx, dy) = (tenths(x) - self.at.0, tenths(y) - self.at.1);
        match (dx, dy) {
            (0, 0) => {}
            (_, 0) => self.write('h', &[dx]),
            (0, _) => self.write('v', &[dy]),
            _ => self.write('l', &[dx, dy]),
        }
        self.at = (self.at.0 + dx, self.at.1 + dy);
    }

    /// Closes the piece.
    pub fn close(&mut self) {
        self.d.push('z');
        (self.at, self.command) = (self.began, None);
    }

    /// Draws one form at each of the places, px: from left to right, for the ways are short then, and once where places are one after rounding. What one path
    /// draws twice, or in another order, looks the same.
    pub fn stamp(&mut self, form: &Form, at: impl IntoIterator<Item = (f64, f64)>) {
        let starts: BTreeSet<Tenths> = at.into_iter().map(|(x, y)| (tenths(x) + form.from.0, tenths(y) + form.from.1)).collect();
        for start in starts {
            self.start_at(start);
            self.d.push_str(&form.d);
            (self.at, self.command) = ((start.0 + form.leads.0, start.1 + form.leads.1), None);
        }
    }

    fn write(&mut self, command: char, numbers: &[i64]) {
        if self.command != Some(command) {
            self.d.push(command);
            self.command = Some(command);
        }
        for n in numbers {
            number(&mut self.d, *n);
        }
    }
}

/// Writes a number of tenths as shortly as a path may hold it: `.5`, `-1`, with a space only where it would else run into the one before.
fn number(d: &mut String, tenths: i64) {
    if tenths >= 0 && d.ends_with(|c: char| c.is_ascii_digit()) {
        d.push(' ');
    }
    if tenths < 0 {
        d.push('-');
    }
    let (whole, part) = (tenths.unsigned_abs() / 10, tenths.unsigned_abs() % 10);
    let _ = match (whole, part) {
        (_, 0) => write!(d, "{whole}"),
        (0, _) => write!(d, ".{part}"),
        _ => write!(d, "{whole}.{part}"),
    };
}

/// What is drawn at many places alike.
#[derive(Debug)]
pub struct Form {
    d: String,
    /// From the place to where drawing begins, and from there to where it ends.
    from: Tenths,
    leads: Tenths,
}

impl Form {
    /// From `from`, relative to the place, along `strokes`: a letter of a relative command with its numbers, px. `z` leads back to the last `m`.
    pub fn new(from: (f64, f64), strokes: &[(char, &[f64])]) -> Self {
        let from = (tenths(from.0), tenths(from.1));
        let (mut d, mut leads, mut began) = (String::new(), (0, 0), (0, 0));
        for (command, numbers) in strokes {
            d.push(*command);
            numbers.iter().for_each(|n| number(&mut d, tenths(*n)));
            let step = |k: usize| numbers.get(k).map_or(0, |n| tenths(*n));
            leads = match command {
                'h' => (leads.0 + step(0), leads.1),
                'v' => (leads.0, leads.1 + step(0)),
                'a' => (leads.0 + step(5), leads.1 + step(6)),
                'z' => began,
                _ => (leads.0 + step(0), leads.1 + step(1)),
            };
            if *command == 'm' {
                began = leads;
            }
        }
        Form { d, from, leads }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The ends of a path's strokes, tenths of a pixel, read as a browser does.
    fn ends(d: &str) -> Vec<(char, Tenths)> {
        let mut out = Vec::new();
        let (mut at, mut began) = ((0, 0), (0, 0));
        let mut rest = d;
        while let Some(command) = rest.chars().next() {
            let text: &str = &rest[1..rest[1..].find(|c: char| c.is_ascii_alphabetic()).map_or(rest.len(), |k| k + 1)];
            rest = &rest[1 + text.len()..];
            let spaced = text.replace('-', " -");
            let numbers: Vec<i64> = spaced.split_whitespace().map(|n| tenths(n.parse().expect("a number"))).collect();
            let each = match command {
                'h' | 'v' => 1,
                'a' => 7,
                _ => 2,
            };
            if command == 'z' {
                at = began;
                out.push(('z', at));
            }
            for n in numbers.chunks(each) {
                at = match command {
                    'M' => (n[0], n[1]),
                    'h' => (at.0 + n[0], at.1),
                    'v' => (at.0, at.1 + n[0]),
                    'a' => (at.0 + n[5], at.1 + n[6]),
                    _ => (at.0 + n[0], at.1 + n[1]),
                };
                if "mM".contains(command) {
                    began = at;
                }
                out.push((command, at));
            }
        }
        out
    }

    #[test]
    fn law_every_place_is_where_it_would_be_told_from_the_sheets_corner() {
        let places: Vec<(f64, f64)> = (0..400).map(|k| (150.0 + 140.0 * (0.37 * f64::from(k)).sin(), 80.0 + 0.03 * f64::from(k * k % 711))).collect();
        let mut path = Path::default();
        path.move_to(places[0]);
        places[1..].iter().for_each(|p| path.line_to(*p));
        let read: Vec<Tenths> = ends(&path.d).into_iter().map(|(_, at)| at).collect();
        let mut told: Vec<Tenths> = places.iter().map(|p| (tenths(p.0), tenths(p.1))).collect();
        told.dedup();
        assert_eq!(read, told);
    }

    #[test]
    fn numbers_run_together_only_where_they_stay_apart() {
        let mut path = Path::default();
        for (k, p) in [(12.04, 3.0), (12.5, 3.0), (12.5, 2.0), (13.0, 2.5), (13.0, 2.5), (12.9, 1.0), (13.0, 11.0)].into_iter().enumerate() {
            if k == 0 { path.move_to(p) } else { path.line_to(p) }
        }
        path.close();
        path.move_to((13.0, 4.0));
        assert_eq!(path.d, "M12 3h.5v-1l.5 .5-.1-1.5 .1 10zm1 1");
    }

    #[test]
    fn forms_lead_to_where_the_next_one_is_told_from() {
        let form = Form::new((-1.0, -2.0), &[('l', &[2.0, 4.0]), ('m', &[0.0, -4.0]), ('a', &[1.0, 1.0, 0.0, 1.0, 0.0, 0.5, 0.0]), ('h', &[-3.0]), ('z', &[])]);
        let mut path = Path::default();
        path.stamp(&form, [(17.0, 21.5), (10.0, 20.0), (10.02, 20.0)]);
        let starts: Vec<Tenths> = ends(&path.d).into_iter().filter(|(c, _)| "mM".contains(*c)).map(|(_, at)| at).collect();
        // Of two places that are one only the first is drawn; every form begins, and lifts the pen once.
        assert_eq!(starts, [(90, 180), (110, 180), (160, 195), (180, 195)]);
    }
}
