//! A season of shots: the thesis's figures 5.6 to 5.24 for the user's own shots.

use super::quantity_words::quantity_words;
use super::regression::regression;
use crate::equipment::Racket;
use crate::kinematics::{Shot, effective_mass, season_statistics, shots_by_group};
use crate::report::chart::{Arrows, Band, Bars, Cells, Chart, Colour, Line, Points, Rule, Symbol, bin_edges, face, histogram};
use crate::report::markup::{fixed, significant, with_sd};
use crate::report::page::{Layout, Section, Table};
use crate::report::session_results::SessionResults;
use nalgebra::Vector2;
use std::collections::BTreeMap;

/// Fewest shots that make a histogram.
const FEWEST: usize = 4;
/// A grouping column with more values than this is not told apart by colour.
const MOST_GROUPS: usize = 4;

/// A figure with a name fit for a file, the thesis's figure it follows, and its caption.
#[derive(Debug, Clone, PartialEq)]
pub struct SeasonFigure {
    /// Letters, digits and hyphens; its own within the list.
    pub name: String,
    pub svg: String,
    pub caption: String,
    /// A histogram's counts; empty for other figures.
    pub bins: Vec<HistogramBin>,
}

impl SeasonFigure {
    fn counted(mut self, change: impl Fn(&mut HistogramBin)) -> Self {
        self.bins.iter_mut().for_each(change);
        self
    }
}

/// Shots of one group and series (a component, where the histogram shows several) between two values.
#[derive(Debug, Clone, PartialEq)]
pub struct HistogramBin {
    pub group: String,
    pub series: String,
    pub unit: String,
    pub from: f64,
    pub to: f64,
    pub shots: usize,
}

/// The histograms as a table: figure, group, series, unit, from, to, shots.
pub fn histograms_to_csv(figures: &[SeasonFigure]) -> String {
    let mut csv = csv::Writer::from_writer(Vec::new());
    let mut write = |fields: [&str; 7]| csv.write_record(fields).unwrap_or_else(|e| unreachable!("writing to memory: {e}"));
    write(["figure", "group", "series", "unit", "from", "to", "shots"]);
    for (figure, b) in figures.iter().flat_map(|f| f.bins.iter().map(move |b| (&f.name, b))) {
        // Edges are round numbers: 0.3, not 0.30000000000000004.
        let edge = |v: f64| ((v * 1e9).round() / 1e9).to_string();
        write([figure, &b.group, &b.series, &b.unit, &edge(b.from), &edge(b.to), &b.shots.to_string()]);
    }
    String::from_utf8(csv.into_inner().unwrap_or_default()).unwrap_or_default()
}

/// Shots of one group (all, or those with one value of the grouping column).
struct Group<'a> {
    column: &'a str,
    name: &'a str,
    shots: Vec<&'a Shot>,
}

impl Group<'_> {
    fn values(&self, quantity: &str) -> Vec<f64> {
        let factor = quantity_words(quantity).factor;
        self.shots.iter().filter_map(|s| s.quantities.get(quantity).map(|q| factor * q.value)).collect()
    }

    /// Name for a legend; a legend of one group says nothing.
    fn legend(&self, of: usize) -> &str {
        if of > 1 { self.name } else { "" }
    }
}

/// Whether any of these quantities stands out of its own measuring error: the velocity of a hung racket does not, and a
/// figure of noise misleads.
fn seen(groups: &[Group<'_>], quantities: &[&str]) -> bool {
    quantities.iter().any(|name| {
        let all: Vec<_> = groups.iter().flat_map(|g| &g.shots).filter_map(|s| s.quantities.get(name)).collect();
        let mean_square = |f: &dyn Fn(&crate::quantity::Quantity) -> f64| all.iter().map(|q| f(q).powi(2)).sum::<f64>();
        mean_square(&|q| q.value) > 9.0 * mean_square(&|q| q.sd)
    })
}

fn capital(words: &str) -> String {
    let mut letters = words.chars();
    letters.next().map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect())
}

/// Histograms and trends of a session's shots; `None` with fewer than four.
pub fn season(results: &SessionResults) -> Option<Section> {
    let shots: Vec<&Shot> = results.shots.iter().filter_map(|s| s.record.as_ref().map(|r| &r.shot)).collect();
    let figures: Vec<(String, String)> = season_figures(&shots, results.shots.first().map(|s| &s.racket)).into_iter().map(|f| (f.svg, f.caption)).collect();
    if figures.is_empty() {
        return None;
    }
    Some(Section::new("season", "All shots together").figures(Layout::Normal, &figures).table(against_thesis(&shots)))
}

/// Means over the shots, and over each group's where there are groups, beside tables 5.27 and 5.28.
fn against_thesis(shots: &[&Shot]) -> Table {
    let mut table = Table::new("These shots beside the thesis's players (tables 5.27 and 5.28): mean ± standard deviation between shots")
        .column("quantity")
        .numbers("shots")
        .numbers("here")
        .numbers("measuring error in it (sd)");
    let mut own = groups(shots);
    own.retain(|g| g.shots.len() < shots.len());
    for group in &own {
        table = table.numbers(&format!("here, {}", group.name));
    }
    table = table.numbers("thesis, men").numbers("thesis, women").column("unit");
    let statistics = season_statistics(shots);
    for s in statistics.iter().filter(|s| s.column == "all") {
        let (Some(men), Some(women)) = (s.thesis_men, s.thesis_women) else { continue };
        let w = quantity_words(&s.quantity);
        // Two digits of the spread: the mean of some tens of shots is known to no more.
        let spread = |mean: f64, sd: Option<f64>| sd.map_or_else(|| significant(w.factor * mean, 3), |sd| with_sd(w.factor * mean, w.factor * sd));
        let mut cells = vec![w.words.clone(), s.n.to_string(), spread(s.mean, s.sd), significant(w.factor * s.measuring_sd, 2)];
        for own in &own {
            let group = statistics.iter().find(|g| (g.column.as_str(), g.value.as_str()) == (own.column, own.name) && g.quantity == s.quantity);
            cells.push(group.map_or_else(String::new, |g| spread(g.mean, g.sd)));
        }
        cells.extend([spread(men[0], Some(men[1])), spread(women[0], Some(women[1])), if w.unit.is_empty() { s.unit.clone() } else { w.unit.to_owned() }]);
        table = table.row(&cells);
    }
    table
}

/// The figures of thesis chapter 5 for these shots, told apart by a grouping column with two to four values if there is
/// one (`sex` before `player` before others). Empty with fewer than four shots.
pub fn season_figures(shots: &[&Shot], racket: Option<&Racket>) -> Vec<SeasonFigure> {
    if shots.len() < FEWEST {
        return Vec::new();
    }
    let groups = groups(shots);
    let mut figures = Vec::new();
    let axes = |stem: &str| -> [String; 3] { ["x", "y", "z"].map(|a| format!("{stem}{a}")) };
    for (name, title, stem, resultant, unit, labels, thesis) in [
        ("racket-velocity", "Racket velocity before (centre of mass)", "racket_in_global_v", "racket_in_speed", "m/s", ["U", "V", "W"], "5.6, 5.7"),
        ("ball-velocity-before", "Ball velocity before", "ball_in_global_v", "ball_in_speed", "m/s", ["U", "V", "W"], "5.8, 5.9"),
        ("ball-velocity-after", "Ball velocity after", "ball_out_global_v", "ball_out_speed", "m/s", ["U", "V", "W"], "5.10, 5.11"),
        ("racket-angular-velocity", "Racket angular velocity before", "racket_in_w", "racket_in_rate", "rad/s", ["x", "y", "z"], "5.12, 5.13"),
    ] {
        if !seen(&groups, &axes(stem).each_ref().map(String::as_str)) {
            continue;
        }
        for (k, group) in groups.iter().enumerate() {
            // Groups' names come from users' files: a number is safe in a file name and never repeats.
            let name = if groups.len() > 1 { format!("{name}-group-{}", k + 1) } else { name.to_owned() };
            let names = axes(stem);
            let series: Vec<(String, Vec<f64>)> = labels.iter().zip(&names).map(|(l, n)| ((*l).to_owned(), group.values(n))).collect();
            let title = if groups.len() > 1 { format!("{title}: {}", group.name) } else { title.to_owned() };
            let all = group.values(resultant);
            let resultant = if all.is_empty() { String::new() } else { format!("; resultant {}", mean_sd(&all)) };
            let figure = frequency(&name, &title, "", unit, &series, &format!("{resultant} {unit} (as thesis figures {thesis})"));
            figures.extend(figure.map(|f| f.counted(|b| b.group = group.name.to_owned())));
        }
    }
    for (name, quantity, thesis) in [
        ("spin", "ball_out_topspin_rpm", "5.14"),
        ("playing-angle", "playing_angle_deg", "5.15"),
        ("impact-along", "impact_from_butt", "5.16"),
        ("impact-across", "impact_y", "5.17"),
    ] {
        let w = quantity_words(quantity);
        let series: Vec<(String, Vec<f64>)> = groups.iter().map(|g| (g.legend(groups.len()).to_owned(), g.values(quantity))).collect();
        let figure = frequency(name, &capital(&w.words), &w.words, w.unit, &series, &format!(" {} (as thesis figure {thesis})", w.unit));
        // Here each group is a series.
        figures.extend(figure.map(|f| f.counted(|b| (b.group, b.series) = (std::mem::take(&mut b.series), String::new()))));
    }
    if let Some(racket) = racket {
        figures.push(effective_mass_map(racket));
        figures.extend(impact_positions(racket, &groups));
    }
    figures.extend(trend("spin-playing-angle", &groups, "playing_angle_deg", "ball_out_topspin_rpm", "5.21"));
    figures.extend(trend("spin-planar-velocity", &groups, "planar_racket_velocity", "ball_out_topspin_rpm", "5.22"));
    figures.extend(trend("spin-relative-velocity", &groups, "planar_relative_velocity_up", "ball_out_topspin_rpm", "5.22, with the ball's own velocity"));
    figures.extend(movement(&groups));
    figures.extend(success(&groups));
    figures
}

fn groups<'a>(shots: &[&'a Shot]) -> Vec<Group<'a>> {
    let rank = |column: &str| ["sex", "player"].iter().position(|c| *c == column).unwrap_or(2);
    // No shot is left out of the figures: a column tells groups apart where every shot has it.
    let of_all = |groups: &BTreeMap<&str, Vec<&Shot>>| groups.values().map(Vec::len).sum::<usize>() == shots.len();
    let columns = shots_by_group(shots).into_iter().filter(|(_, groups)| (2..=MOST_GROUPS).contains(&groups.len()) && of_all(groups));
    match columns.min_by_key(|(column, _)| (rank(column), *column)) {
        Some((column, groups)) => groups.into_iter().map(|(name, shots)| Group { column, name, shots }).collect(),
        None => vec![Group { column: "all", name: "all shots", shots: shots.to_vec() }],
    }
}

fn mean_sd(values: &[f64]) -> String {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let sd = (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0)).sqrt();
    let decimals = usize::from(mean.abs() < 1000.0 && !(sd >= 100.0));
    if values.len() < 2 { fixed(mean, decimals) } else { format!("{} ± {}", fixed(mean, decimals), fixed(sd, decimals)) }
}

fn frequency(name: &str, title: &str, label: &str, unit: &str, series: &[(String, Vec<f64>)], tail: &str) -> Option<SeasonFigure> {
    let edges = bin_edges(series.iter().flat_map(|(_, v)| v));
    if edges.is_empty() {
        return None;
    }
    let label = if label.is_empty() { if unit == "m/s" { "velocity" } else { "angular velocity" } } else { label };
    let mut chart = Chart::new(title).x(label, unit).y("number of shots", "");
    let (mut told, mut bins) = (Vec::new(), Vec::new());
    // Series stand side by side within a bin: bars drawn over each other cannot be read.
    let n = series.len() as f64;
    for (k, (group, values)) in series.iter().enumerate().filter(|(_, (_, v))| !v.is_empty()) {
        let own = |(from, to, count): (f64, f64, f64)| {
            let share = |s: f64| from + (to - from) * s / n;
            (share(k as f64), share(k as f64 + 1.0), count)
        };
        let counts = histogram(values, &edges);
        let bin = |&(from, to, count): &(f64, f64, f64)| HistogramBin {
            group: String::new(),
            series: group.clone(),
            unit: unit.to_owned(),
            from,
            to,
            shots: count as usize,
        };
        bins.extend(counts.iter().map(bin));
        let bars: Vec<(f64, f64, f64)> = counts.into_iter().map(own).collect();
        chart = chart.add(Bars::new(&bars).name(group).colour(Colour::of_series(k)));
        told.push(format!("{group} {}", mean_sd(values)).trim_start().to_owned());
    }
    let caption = format!("Mean ± sd over the shots: {}{tail}.", told.join(", "));
    Some(SeasonFigure { name: name.to_owned(), svg: chart.describe(&caption).to_svg(), caption, bins })
}

/// Thesis figure 5.18: effective mass of every point of the face.
fn effective_mass_map(racket: &Racket) -> SeasonFigure {
    let (at, side) = face::cells(racket, 30);
    let com = 1000.0 * racket.com_local().x;
    let inertia = racket.inertia_kg_m2();
    let grams = |y: f64, x: f64| 1000.0 * effective_mass(racket.mass_kg, &inertia, &Vector2::new(0.001 * (x - com), 0.001 * y));
    let cells: Vec<(f64, f64, f64)> = at.iter().map(|&(y, x)| (y, x, grams(y, x))).collect();
    let chart = face::bare("Effective mass over the face", racket).add(Cells::new(&cells, (side, side), "mass (g)"));
    SeasonFigure {
        name: "effective-mass".to_owned(),
        svg: face::outline(chart, racket).to_svg(),
        caption: format!("Effective mass of each point of {} (as thesis figure 5.18).", racket.name),
        bins: Vec::new(),
    }
}

/// Thesis figure 5.20: where the ball met the face, and the mean sweet spots of these shots as far as they lie on the head.
fn impact_positions(racket: &Racket, groups: &[Group<'_>]) -> Option<SeasonFigure> {
    let shots: Vec<&Shot> = groups.iter().flat_map(|g| g.shots.iter().copied()).filter(|s| s.racket == racket.name).collect();
    let mut chart = face::face("Impact positions", racket);
    let mut any = false;
    for (k, g) in groups.iter().enumerate() {
        let of_racket = Group { shots: g.shots.iter().copied().filter(|s| s.racket == racket.name).collect(), ..*g };
        let at = pairs(&of_racket, "impact_y", "impact_x");
        any |= !at.is_empty();
        chart = chart.add(Points::new(&at).name(if groups.len() > 1 { g.name } else { "impacts" }).symbol(Symbol::of_series(k)).colour(Colour::of_series(k)));
    }
    let chart = face::spots(chart, &sweet_spots(racket, &shots));
    let caption = format!("Impacts on {} and the mean sweet spots of these shots, as far as they lie on the head (as thesis figure 5.20).", racket.name);
    any.then(|| SeasonFigure { name: "impact-positions".to_owned(), svg: chart.describe(&caption).to_svg(), caption, bins: Vec::new() })
}

/// Mean sweet spots of shots with one racket; a dead spot beyond the tip exists on paper only.
pub(super) fn sweet_spots(racket: &Racket, shots: &[&Shot]) -> Vec<face::Spot> {
    let on_head = |from_butt: f64| (racket.stringbed_centre_m - from_butt).abs() < 0.5 * racket.head.inner_length_m + 0.04;
    let spots = [
        ("ideal point", "ideal_point_from_butt"),
        ("centre of percussion", "centre_of_percussion_from_butt"),
        ("node point", "node_point_from_butt"),
        ("dead spot", "dead_spot_from_butt"),
    ];
    let mean_of = |name: &str| {
        let all: Vec<f64> = shots.iter().filter_map(|s| s.quantities.get(name).map(|q| q.value)).collect();
        (!all.is_empty()).then(|| all.iter().sum::<f64>() / all.len() as f64)
    };
    let place = |(words, name): (&str, &str)| {
        let mean = mean_of(name).filter(|m| on_head(*m))?;
        Some(face::Spot { name: words.to_owned(), x_m: racket.stringbed_centre_m - mean, y_m: 0.0 })
    };
    spots.into_iter().filter_map(place).collect()
}

fn pairs(group: &Group<'_>, x: &str, y: &str) -> Vec<(f64, f64)> {
    let (fx, fy) = (quantity_words(x).factor, quantity_words(y).factor);
    group.shots.iter().filter_map(|s| Some((fx * s.quantities.get(x)?.value, fy * s.quantities.get(y)?.value))).collect()
}

fn trend(name: &str, groups: &[Group<'_>], x: &str, y: &str, thesis: &str) -> Option<SeasonFigure> {
    let (wx, wy) = (quantity_words(x), quantity_words(y));
    let all: Vec<(f64, f64)> = groups.iter().flat_map(|g| pairs(g, x, y)).collect();
    if all.len() < FEWEST || !seen(groups, &[x]) {
        return None;
    }
    let mut chart = Chart::new(&format!("{} against {}", capital(&wy.words), wx.words)).x(&wx.words, wx.unit).y(&wy.words, wy.unit);
    let mut caption = format!("As thesis figure {thesis}.");
    if let Some(r) = regression(&all) {
        chart = chart.add(Band::new(&r.band).colour(Colour::SKY)).add(Line::new(&r.line).colour(Colour::SKY)).note(&format!("R² = {}", fixed(r.r2, 2)));
        caption = format!(
            "Straight line with its 95 % band: slope {} {} per {}, R² = {} (as thesis figure {thesis}).",
            with_sd(r.slope, r.slope_sd),
            wy.unit,
            wx.unit,
            fixed(r.r2, 2)
        );
    }
    for (k, g) in groups.iter().enumerate() {
        chart = chart.add(Points::new(&pairs(g, x, y)).name(g.legend(groups.len())).symbol(Symbol::of_series(k)).colour(Colour::of_series(k)));
    }
    Some(SeasonFigure { name: name.to_owned(), svg: chart.describe(&caption).to_svg(), caption, bins: Vec::new() })
}

/// Thesis figure 5.23: how the impact point moved in the plane of the face.
fn movement(groups: &[Group<'_>]) -> Option<SeasonFigure> {
    let mut chart = Chart::new("Movement of the impact point in the face's plane")
        .size(340.0, 340.0)
        .x("across the face, y", "m/s")
        .y("toward the handle, x", "m/s")
        .y_reversed()
        .equal_scales();
    let mut any = false;
    if !seen(groups, &["impact_point_in_vy", "impact_point_in_vx"]) {
        return None;
    }
    for (k, g) in groups.iter().enumerate() {
        let by = pairs(g, "impact_point_in_vy", "impact_point_in_vx");
        any |= !by.is_empty();
        chart = chart.add(Arrows::new(&vec![(0.0, 0.0); by.len()], &by, 1.0).name(g.legend(groups.len())).colour(Colour::of_series(k)));
    }
    let caption = "Each arrow is the velocity of one shot's impact point before the impact, from the origin (as thesis figure 5.23).".to_owned();
    any.then(|| SeasonFigure { name: "local-movement".to_owned(), svg: chart.describe(&caption).to_svg(), caption, bins: Vec::new() })
}

/// Thesis figure 5.24.
fn success(groups: &[Group<'_>]) -> Option<SeasonFigure> {
    let mut chart = Chart::new("Efficiency against impact success ratio").x("impact success ratio", "").y("efficiency", "").x_include(1.0);
    let mut any = false;
    for (k, g) in groups.iter().enumerate() {
        let at = pairs(g, "impact_success_ratio", "efficiency");
        any |= !at.is_empty();
        chart = chart.add(Points::new(&at).name(g.legend(groups.len())).symbol(Symbol::of_series(k)).colour(Colour::of_series(k)));
    }
    let caption = "1: the ball met the ideal point (as thesis figure 5.24).".to_owned();
    any.then(|| SeasonFigure {
        name: "success-efficiency".to_owned(),
        svg: chart.add(Rule::vertical(1.0).name("ideal point")).describe(&caption).to_svg(),
        caption,
        bins: Vec::new(),
    })
}
