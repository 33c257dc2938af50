//! The frame-rate study as a page: what a slower camera would have got wrong (thesis 4.5.1, figures 4.14 to 4.16).

use super::chart::{Chart, Colour, Line, Points, Symbol};
use super::markup::fixed;
use super::page::{Layout, Report, Section, Table};
use crate::kinematics::{FrameRateStudy, SlowerCamera};

/// Name of a figure's file and its SVG.
pub type NamedFigure = (String, String);

/// The page, and its figures for files of their own.
pub fn frame_rate_page(session: &str, studies: &[FrameRateStudy]) -> (String, Vec<NamedFigure>) {
    let mut figures = Vec::new();
    let mut page = Report::new(&format!("{session}: what a slower camera would have got wrong")).command("explore frame-rate").section(
        Section::new("errors", "Errors added by dropping frames")
            .paragraph(
                "Every second and every fourth frame of the tracks was kept, in every phase, and each shot measured again. A cell is the root mean square \
                 difference per component to all frames. Under \"lines\" stands the thesis's way: straight lines through ten frames, against the fits on all \
                 frames; at full rate that is what the way itself errs.",
            )
            .table(pooled(studies)),
    );
    for study in studies {
        let drawn: Vec<(f64, (String, String))> = study.cameras.iter().filter_map(|c| Some((c.frame_rate_hz, path_figure(study, c)?))).collect();
        figures.extend(drawn.iter().map(|(rate, f)| (format!("{}-tip-{rate:.0}-hz", safe(&study.id)), f.0.clone())));
        let own: Vec<(String, String)> = drawn.into_iter().map(|d| d.1).collect();
        page = page.section(
            Section::new(&format!("shot-{}", safe(&study.id)), &format!("Shot {}", study.id))
                .figures(Layout::Normal, &own)
                .table(table(study))
                .list(&failures(study)),
        );
    }
    (page.finish(), figures)
}

fn safe(id: &str) -> String {
    id.chars().map(|c| if c.is_ascii_alphanumeric() || c == '-' { c } else { '-' }).collect()
}

const QUANTITIES: [(&str, fn(&SlowerCamera) -> Option<f64>, f64, usize); 8] = [
    ("ball, m/s", |c| c.ball_velocity_m_s, 1.0, 3),
    ("racket, m/s", |c| c.racket_velocity_m_s, 1.0, 3),
    ("racket, rad/s", |c| c.racket_rate_rad_s, 1.0, 2),
    ("position, mm", |c| c.impact_position_m, 1e3, 2),
    ("instant, ms", |c| c.instant_s, 1e3, 3),
    ("lines: ball, m/s", |c| c.line_ball_velocity_m_s, 1.0, 3),
    ("lines: racket, m/s", |c| c.line_racket_velocity_m_s, 1.0, 3),
    ("lines: racket, rad/s", |c| c.line_racket_rate_rad_s, 1.0, 2),
];

fn rates(title: &str, study: &FrameRateStudy) -> Table {
    let table = Table::new(title).column("frames per second");
    study.cameras.iter().fold(table, |t, c| t.numbers(&fixed(c.frame_rate_hz, 0)))
}

fn cell(value: Option<f64>, decimals: usize) -> String {
    value.map_or_else(|| "–".to_owned(), |v| fixed(v, decimals))
}

/// Root mean squares over the shots, one row a quantity.
fn pooled(studies: &[FrameRateStudy]) -> Table {
    let Some(first) = studies.first() else { return Table::new("") };
    let mut table = rates(&format!("All {} shots", studies.len()), first);
    for (name, of, factor, decimals) in QUANTITIES {
        let rms = |k: usize| {
            let seen: Vec<f64> = studies.iter().filter_map(|s| of(s.cameras.get(k)?)).collect();
            (!seen.is_empty()).then(|| factor * (seen.iter().map(|v| v * v).sum::<f64>() / seen.len() as f64).sqrt())
        };
        let mut cells = vec![name.to_owned()];
        cells.extend((0..first.cameras.len()).map(|k| cell(rms(k), decimals)));
        table = table.row(&cells);
    }
    table
}

fn table(study: &FrameRateStudy) -> Table {
    let mut table = rates("", study);
    let mut row = |name: &str, of: &dyn Fn(&SlowerCamera) -> String| {
        let mut cells = vec![name.to_owned()];
        cells.extend(study.cameras.iter().map(of));
        table = std::mem::replace(&mut table, Table::new("")).row(&cells);
    };
    for (name, of, factor, decimals) in QUANTITIES {
        row(name, &|c| cell(of(c).map(|v| factor * v), decimals));
    }
    row("R² of the tip's path before contact", &|c| cell(c.tip_r2, 5));
    row("its bow, mm", &|c| cell(c.tip_bow_m.map(|b| 1e3 * b), 2));
    row("phases measured", &|c| format!("{} of {}", c.phases, c.keep_every));
    table
}

/// Why some phases could not be measured, without repeats.
fn failures(study: &FrameRateStudy) -> Vec<String> {
    study.cameras.iter().flat_map(|c| c.failed.iter().map(|why| format!("{:.0} frames per second: {why}", c.frame_rate_hz))).collect()
}

/// One of figures 4.14 to 4.16; `None` when the tip hardly moves on both sides.
fn path_figure(study: &FrameRateStudy, camera: &SlowerCamera) -> Option<(String, String)> {
    let mm = |path: &[[f64; 3]]| -> Vec<(f64, f64)> { path.iter().map(|p| (1e3 * p[1], 1e3 * p[2])).collect() };
    let sides = [("before contact", mm(&camera.tip_path.before)), ("after contact", mm(&camera.tip_path.after))];
    let mut chart = Chart::new(&format!("{:.0} frames per second", camera.frame_rate_hz)).x("along the path", "mm").y("aside", "mm");
    // All rates on the scale of the slowest, whose path is the longest.
    for p in study.cameras.iter().flat_map(|c| c.tip_path.before.iter().chain(&c.tip_path.after)) {
        chart = chart.x_include(1e3 * p[1]).y_include(1e3 * p[2]);
    }
    let mut told = Vec::new();
    for (k, (name, path)) in sides.iter().enumerate() {
        let Some((ends, r2)) = straight(path) else { continue };
        chart = chart
            .add(Line::new(&ends).colour(Colour::of_series(k)))
            .add(Points::new(path).name(name).symbol(Symbol::of_series(k)).colour(Colour::of_series(k)));
        told.push(format!("{name} {} frames, R² = {}", path.len(), fixed(r2, 5)));
    }
    if told.is_empty() {
        return None;
    }
    let caption = format!("The tip's path with straight lines: {} (as thesis figures 4.14 to 4.16).", told.join("; "));
    Some((chart.describe(&caption).to_svg(), caption))
}

/// The line of least squared distances through a path: its ends, and R² over both coordinates. `None` below three places
/// or when the path is shorter than a millimetre.
fn straight(path: &[(f64, f64)]) -> Option<(Vec<(f64, f64)>, f64)> {
    let n = path.len() as f64;
    if path.len() < 3 {
        return None;
    }
    let (mx, my) = (path.iter().map(|p| p.0).sum::<f64>() / n, path.iter().map(|p| p.1).sum::<f64>() / n);
    let moment = |f: fn(f64, f64) -> f64| path.iter().map(|p| f(p.0 - mx, p.1 - my)).sum::<f64>();
    let (xx, yy, xy) = (moment(|x, _| x * x), moment(|_, y| y * y), moment(|x, y| x * y));
    if xx + yy < 1.0 {
        return None;
    }
    let (sin, cos) = (0.5 * (2.0 * xy).atan2(xx - yy)).sin_cos();
    let along: Vec<f64> = path.iter().map(|p| (p.0 - mx) * cos + (p.1 - my) * sin).collect();
    let left: f64 = path.iter().map(|p| ((p.1 - my) * cos - (p.0 - mx) * sin).powi(2)).sum();
    let (low, high) = along.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(*v), b.max(*v)));
    Some(([low, high].map(|s| (mx + s * cos, my + s * sin)).to_vec(), 1.0 - left / (xx + yy)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn truth_a_bowed_path_has_the_r2_of_its_hand_calculation() {
        // (0,0), (1,0), (2,0) raised by 0.3 in the middle: mean height 0.1, left over 0.06 of 2.06.
        let (ends, r2) = straight(&[(0.0, 0.0), (1.0, 0.3), (2.0, 0.0)]).expect("a path");
        assert!((r2 - (1.0 - 0.06 / 2.06)).abs() < 1e-12 && (ends[0].1 - 0.1).abs() < 1e-12, "{ends:?} {r2}");
        assert!(straight(&[(0.0, 0.0), (1.0, 0.0)]).is_none());
    }
}
