//! Shot characteristics: the figures that matter as a table over all shots, everything else folded per shot, and where the
//! ball met the face.

use super::quantity_words::{QUANTITIES, quantity_words};
use super::season::sweet_spots;
use crate::kinematics::{ImpactTiming, Shot, SwingTiming};
use crate::report::chart::{Points, face};
use crate::report::markup::{fixed, with_sd};
use crate::report::page::{Layout, Section, Table};
use crate::report::session_results::{SessionResults, ShotResults};
use crate::validation::structure::p_text;

/// Columns of the table over all shots.
const COLUMNS: [&str; 10] = [
    "ball_in_speed",
    "ball_out_speed",
    "ball_out_spin_rpm",
    "racket_in_speed",
    "impact_x",
    "impact_y",
    "apparent_restitution",
    "restitution",
    "playing_angle_deg",
    "contact_time",
];

/// A shot by its folder's name, which often says already what it is.
pub(super) fn shot_heading(id: &str) -> String {
    if id.get(..4).is_some_and(|s| s.eq_ignore_ascii_case("shot")) { id.to_owned() } else { format!("Shot {id}") }
}

pub fn shots(results: &SessionResults) -> Option<Section> {
    let measured: Vec<(&ShotResults, &Shot)> = results.shots.iter().filter_map(|s| Some((s, &s.record.as_ref()?.shot))).collect();
    let named = |list: &[(String, String)]| list.iter().map(|(id, why)| format!("{id}: {why}")).collect::<Vec<String>>();
    let (failed, steps) = (named(&results.failed), named(&results.steps_failed));
    if measured.is_empty() && failed.is_empty() && steps.is_empty() {
        return None;
    }
    let mut section = Section::new("shots", "Shot characteristics");
    // A step that failed is why shots could not be measured.
    if !steps.is_empty() {
        section = section.heading("Steps that failed").list(&steps);
    }
    if !failed.is_empty() {
        section = section.heading("Shots that could not be measured").list(&failed);
    }
    if !measured.is_empty() {
        section = section.figures(Layout::Normal, &faces(&measured)).table(overview(&measured));
    }
    for (results, shot) in &measured {
        let note = results.record.as_ref().and_then(|r| r.note.as_deref());
        section = section.folded(&format!("{}: all characteristics", shot_heading(&shot.id)), |s| details(s, shot, note));
    }
    Some(section)
}

fn cell(shot: &Shot, name: &str) -> String {
    let w = quantity_words(name);
    shot.quantities.get(name).map_or_else(|| "–".to_owned(), |q| with_sd(w.factor * q.value, w.factor * q.sd))
}

fn overview(measured: &[(&ShotResults, &Shot)]) -> Table {
    let shown: Vec<&str> = COLUMNS.into_iter().filter(|c| measured.iter().any(|(_, s)| s.quantities.get(c).is_some())).collect();
    let mut table = Table::new("± one standard deviation; –: not measured").column("shot");
    for c in &shown {
        let w = quantity_words(c);
        table = table.numbers(&if w.unit.is_empty() { w.words } else { format!("{} ({})", w.words, w.unit) });
    }
    for (_, shot) in measured {
        let mut cells = vec![shot.id.clone()];
        cells.extend(shown.iter().map(|c| cell(shot, c)));
        table = table.row(&cells);
    }
    table
}

fn details(mut section: Section, shot: &Shot, note: Option<&str>) -> Section {
    let groups: Vec<String> = shot.groups.iter().map(|(k, v)| format!("{k} {v}")).collect();
    let groups = if groups.is_empty() { String::new() } else { format!("; {}", groups.join(", ")) };
    let timing = match shot.impact_timing {
        Some(ImpactTiming::Rising) => " The ball was rising.",
        Some(ImpactTiming::Apex) => " The ball was at the top of its path.",
        Some(ImpactTiming::Falling) => " The ball was falling.",
        None => "",
    };
    let swing = match shot.swing_timing {
        Some(SwingTiming::BeforeApex) => " It was met before the apex of the swing.",
        Some(SwingTiming::Apex) => " It was met at the apex of the swing.",
        Some(SwingTiming::AfterApex) => " It was met after the apex of the swing.",
        None => "",
    };
    section = section.paragraph(&format!("{}, {}{groups}; the ball came to the {} face.{timing}{swing}", shot.racket, shot.ball, shot.ball_side_of_face));
    if let Some(m) = &shot.momentum {
        let hand = if m.hand_interferes { "something besides ball and racket took part (the hand)" } else { "ball and racket alone explain it" };
        section = section.paragraph(&format!("Momentum balance: {hand}; χ² = {} with 3 degrees of freedom, {}.", fixed(m.chi2, 1), p_text(m.p_value)));
    }
    if let Some(note) = note {
        section = section.paragraph(&format!("Note: {note}"));
    }
    section = section.list(&shot.remarks);
    let mut table = Table::new("").column("quantity").numbers("value ± sd").column("unit").column("name in shot.json");
    // Those with words first, in their order, then the others as shot.json has them.
    let known = QUANTITIES.iter().filter_map(|k| shot.quantities.0.iter().find(|(n, _)| n == k.0));
    let others = shot.quantities.0.iter().filter(|(n, _)| QUANTITIES.iter().all(|k| k.0 != n));
    for (name, q) in known.chain(others) {
        let w = quantity_words(name);
        let unit = if w.unit.is_empty() { q.unit.clone() } else { w.unit.to_owned() };
        table = table.row(&[w.words, with_sd(w.factor * q.value, w.factor * q.sd), unit, name.clone()]);
    }
    section.table(table).table(marker_distances(shot)).table(thesis(shot))
}

/// Thesis 5.3.4: distances between markers in the footage against racket.toml.
fn marker_distances(shot: &Shot) -> Table {
    let mut table = Table::new("Distances between markers: in the footage, and as racket.toml states them")
        .column("markers")
        .numbers("stated (mm)")
        .numbers("seen (mm)")
        .numbers("difference (mm)");
    for d in &shot.marker_distances {
        let (a, b) = d.pair;
        table =
            table.row(&[format!("{} to {}", a.name(), b.name()), fixed(d.stated_mm, 1), with_sd(d.seen_mm, d.seen_sd_mm), fixed(d.seen_mm - d.stated_mm, 2)]);
    }
    table
}

/// The thesis's own construction beside ours.
fn thesis(shot: &Shot) -> Table {
    let mut table = Table::new("A check by the thesis's own construction (chapter 4: three markers, straight lines through ten frames)")
        .column("quantity")
        .numbers("thesis's way")
        .numbers("here")
        .column("unit");
    let Some(t) = &shot.thesis else { return table };
    for (stem, values) in [("ball_in_v", t.ball_in_v), ("racket_in_v", t.racket_in_v), ("racket_in_w", t.racket_in_w)] {
        for (axis, value) in ["x", "y", "z"].iter().zip(values) {
            let name = format!("{stem}{axis}");
            let w = quantity_words(&name);
            table = table.row(&[w.words, fixed(w.factor * value, 2), cell(shot, &name), w.unit.to_owned()]);
        }
    }
    table
}

/// One face per racket, with every impact and the mean sweet spots of its shots.
fn faces(measured: &[(&ShotResults, &Shot)]) -> Vec<(String, String)> {
    let mut rackets: Vec<&str> = measured.iter().map(|(_, s)| s.racket.as_str()).collect();
    rackets.sort_unstable();
    rackets.dedup();
    rackets
        .iter()
        .filter_map(|name| {
            let own: Vec<&(&ShotResults, &Shot)> = measured.iter().filter(|(_, s)| s.racket == *name).collect();
            let racket = &own.first()?.0.racket;
            let at: Vec<(f64, f64, f64, f64)> = own
                .iter()
                .filter_map(|(_, s)| {
                    let (x, y) = (s.quantities.get("impact_x")?, s.quantities.get("impact_y")?);
                    Some((1000.0 * y.value, 1000.0 * x.value, 1000.0 * y.sd, 1000.0 * x.sd))
                })
                .collect();
            let points: Vec<(f64, f64)> = at.iter().map(|a| (a.0, a.1)).collect();
            let (across, along): (Vec<f64>, Vec<f64>) = at.iter().map(|a| (a.2, a.3)).unzip();
            let spots = sweet_spots(racket, &own.iter().map(|(_, s)| *s).collect::<Vec<_>>());
            let chart = face::face(&format!("Impacts on {name}"), racket).add(Points::new(&points).x_error(&across).y_error(&along).name("impacts"));
            Some((
                face::spots(chart, &spots).to_svg(),
                "Where the ball met the face (± one sd), seen from +z, tip at the top, with the mean sweet spots of these shots as far as they lie on the head (thesis figure 5.20)."
                    .to_owned(),
            ))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn truth_a_shot_is_not_called_so_twice() {
        assert_eq!(
            (shot_heading("shot-01"), shot_heading("Shot 7"), shot_heading("12"), shot_heading("é")),
            ("shot-01".into(), "Shot 7".into(), "Shot 12".into(), "Shot é".into())
        );
    }
}
