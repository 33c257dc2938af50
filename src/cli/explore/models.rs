//! `sweetspot explore models`.

use super::Outcome;
use crate::cli::error::CliError;
use crate::impact::study::older_models::{CROSS_TANGENTIAL, HeadOn, LAWS, Oblique, Offset, oblique, offset, on_free_racket, on_strings, on_wall};
use crate::impact::viscoelastic::Moment;
use crate::quantity::RPM;
use crate::report::chart::{Chart, Line, Points, Rule, Symbol};
use crate::report::{Layout, Report, Section, Table};

/// Published restitution on a rigid wall: ITF's drop test (middle of the range), Miller and Messner 2003.
const PUBLISHED: [(f64, f64); 3] = [(7.06, 0.745), (20.0, 0.575), (45.0, 0.40)];
/// m/s.
const SPEED: f64 = 20.0;

pub fn models() -> Result<Outcome, CliError> {
    let (wall, strings) = (on_wall(SPEED)?, on_strings(SPEED)?);
    let speeds = [5.0, 7.06, 10.0, 15.0, 20.0, 25.0, 30.0, 35.0, 40.0, 45.0];
    let over_speed = speeds.iter().map(|v| on_wall(*v)).collect::<Result<Vec<_>, _>>()?;
    let incidences: Vec<f64> = (0..=16).map(|i| 5.0 * f64::from(i)).collect();
    let bounce = oblique(SPEED, &incidences)?;
    let offsets = [(20.0, 40.0), (30.0, 30.0), (40.0, 20.0), (50.0, 10.0)].iter().map(|(v, a)| offset(*v, *a)).collect::<Result<Vec<_>, _>>()?;
    let free = on_free_racket(SPEED)?;
    let page = Report::new("Older models beside the default one")
        .subtitle("Visco-elastic base with the laws of Leigh and Lui (1992), of Kelvin-Voigt (Dignall and Haake 2000, Pratt 2000), of Goodwill and Haake (2001, 2002); Haake's offset; Cross and Daish for oblique impacts")
        .section(wall_section(&wall, &over_speed)?)
        .section(strings_section(&strings, &free))
        .section(oblique_section(&bounce))
        .section(offset_section(&offsets))
        .finish();
    let json =
        serde_json::json!({ "wall": wall, "wall_over_speed": over_speed, "strings": strings, "free_racket": free, "oblique": bounce, "offset": offsets });
    Ok(("explore-models", json, page))
}

fn wall_section(wall: &[HeadOn], over_speed: &[Vec<HeadOn>]) -> Result<Section, CliError> {
    let kelvin_voigt = wall.iter().find(|h| h.last_force_n < -1.0).or(wall.first()).map(|h| h.course.clone()).unwrap_or_default();
    let figures = [
        (
            over_time("Force on the ball, 20 m/s", "force", "N", wall, &|m| m.force),
            "Kelvin-Voigt's force jumps at first touch and pulls the ball at the end (thesis, figures 2.31 and 2.32); no surface can pull.".into(),
        ),
        (
            course("Kelvin-Voigt: displacement, 20 m/s", "displacement", "mm", &kelvin_voigt, &|m| 1e3 * m.approach),
            "That model's contact ends when the displacement is nil: after the force has changed its sign.".into(),
        ),
        (restitution(over_speed), "Constant springs and dampers know no speed: each law meets the published values only where it was fitted.".into()),
    ];
    Ok(Section::new("wall", "Head-on against a rigid wall").figures(Layout::Normal, &figures).table(beside_published()?))
}

fn beside_published() -> Result<Table, CliError> {
    let mut table = Table::new("Head-on at three speeds on a rigid wall").column("Law").numbers("Speed, m/s").numbers("Restitution").numbers("published");
    table = table.numbers("Contact, ms").numbers("Peak force, N").numbers("Force at the end, N").numbers("Pulled for, ms");
    for (v, published) in PUBLISHED {
        let stand = on_wall(v)?;
        for (_, _, law) in LAWS.iter().filter(|(_, _, law)| stand.iter().all(|h| h.law != *law)) {
            table = table.row(&[law, &*format!("{v:.1}"), "squeezed flat", &*format!("{published:.3}"), "", "", "", ""]);
        }
        for h in stand {
            table = table.row(&[
                h.law.to_owned(),
                format!("{v:.1}"),
                format!("{:.3}", h.restitution),
                format!("{published:.3}"),
                format!("{:.2}", 1e3 * h.contact_time),
                format!("{:.0}", h.peak_force_n),
                format!("{:.0}", h.last_force_n.round() + 0.0),
                format!("{:.2}", 1e3 * h.pulled_s),
            ]);
        }
    }
    Ok(table)
}

/// `free`: law, apparent restitution, contact time (s).
fn strings_section(strings: &[HeadOn], free: &[(&str, f64, f64)]) -> Section {
    let mut table = Table::new("20 m/s on a free racket, 0.225 m from its centre of mass").column("Law").numbers("Apparent restitution").numbers("Contact, ms");
    for (law, apparent, time) in free {
        table = table.row(&[(*law).to_owned(), format!("{apparent:.3}"), format!("{:.2}", 1e3 * time)]);
    }
    let figures = [
        (
            over_time("Force on a head-clamped bed, 20 m/s", "force", "N", strings, &|m| m.force),
            "60 lb; the ball's law decides the shape less than on a wall.".into(),
        ),
        (
            over_time("Deflection of the strings, 20 m/s", "deflection", "mm", strings, &|m| 1e3 * m.deflection),
            "The ball leaves the strings before they are back in place.".into(),
        ),
    ];
    Section::new("strings", "Head-on against strings").figures(Layout::Normal, &figures).table(table)
}

fn oblique_section(bounce: &[Oblique]) -> Section {
    let speed = |o: &Oblique| [o.stepper_m_s, o.soft_strings_m_s, o.cross_m_s, o.daish_m_s];
    let figures = [
        (
            bounces("Spin after the bounce, 20 m/s", "topspin", "rpm", bounce, &|o| [o.stepper, o.soft_strings, o.cross, o.daish].map(|w| w * RPM)),
            String::new(),
        ),
        (bounces("Tangential speed after the bounce, 20 m/s", "tangential speed", "m/s", bounce, &speed), String::new()),
    ];
    Section::new("oblique", "Oblique impacts on a clamped bed").figures(Layout::Normal, &figures).note(&format!(
        "Cross (2005) states two coefficients, here the stepper's own normal one and {CROSS_TANGENTIAL} along the strings, whatever the \
         incidence; Daish's ball slides or rolls; the stepper slides, grips and lets go, with rigid strings or with strings of 60 kN/m sideways."
    ))
}

fn offset_section(offsets: &[Offset]) -> Section {
    let mut table = Table::new("Haake's offset on a rigid surface").numbers("Speed, m/s").numbers("Angle to it, deg").numbers("Mean offset, mm");
    table = table.numbers("Greatest, mm").numbers("Spin, rad/s").numbers("with a central force");
    let mut chart = Chart::new("Offset in front of the centre (Haake 2005)").x("time", "ms").y("offset", "mm");
    for o in offsets {
        table = table.row(&[
            format!("{:.0}", o.speed),
            format!("{:.0}", o.angle_deg),
            format!("{:.2}", 1e3 * o.mean_m),
            format!("{:.2}", 1e3 * o.greatest_m),
            format!("{:.0}", o.spin),
            format!("{:.0}", o.central_spin),
        ]);
        let line: Vec<(f64, f64)> = o.course.iter().map(|(t, d)| (1e3 * t, 1e3 * d)).collect();
        chart = chart.add(Line::new(&line).name(&format!("{:.0} m/s, {:.0} deg", o.speed, o.angle_deg)));
    }
    let words = "The front of a spinning ball's contact lands faster than its rear. Half a millimetre on average, as published; nil once the ball expands.";
    Section::new("offset", "Where the normal force acts").figures(Layout::Normal, &[(chart.to_svg(), words.into())]).table(table)
}

fn line(course: &[Moment], get: &dyn Fn(&Moment) -> f64) -> Vec<(f64, f64)> {
    course.iter().map(|m| (1e3 * m.time, get(m))).collect()
}

fn over_time(title: &str, label: &str, unit: &str, laws: &[HeadOn], get: &dyn Fn(&Moment) -> f64) -> String {
    let chart = Chart::new(title).x("time", "ms").y(label, unit).add(Rule::horizontal(0.0).solid());
    laws.iter().fold(chart, |c, h| c.add(Line::new(&line(&h.course, get)).name(h.law))).to_svg()
}

fn course(title: &str, label: &str, unit: &str, moments: &[Moment], get: &dyn Fn(&Moment) -> f64) -> String {
    let chart = Chart::new(title).x("time", "ms").y(label, unit).y_include(0.0);
    // Where the force has changed its sign.
    let pulled: Vec<Moment> = moments.iter().filter(|m| m.force < 0.0).copied().collect();
    chart.add(Line::new(&line(moments, get)).name("pushed")).add(Line::new(&line(&pulled, get)).width(4.0).name("pulled")).to_svg()
}

fn restitution(over_speed: &[Vec<HeadOn>]) -> String {
    let mut chart = Chart::new("Restitution on a rigid wall").x("speed", "m/s").y("restitution", "").x_include(0.0).y_include(0.3);
    for law in over_speed.first().into_iter().flatten().map(|h| h.law) {
        let points: Vec<(f64, f64)> = over_speed.iter().flatten().filter(|h| h.law == law).map(|h| (h.speed, h.restitution)).collect();
        chart = chart.add(Line::new(&points).name(law));
    }
    chart.add(Points::new(&PUBLISHED).symbol(Symbol::Plus).size(10.0).name("published")).to_svg()
}

fn bounces(title: &str, label: &str, unit: &str, all: &[Oblique], get: &dyn Fn(&Oblique) -> [f64; 4]) -> String {
    let chart = Chart::new(title).x("incidence from the normal", "deg").y(label, unit);
    let names = ["stepper, rigid strings", "stepper, strings of 60 kN/m", "Cross", "Daish"];
    names
        .iter()
        .enumerate()
        .fold(chart, |c, (k, name)| c.add(Line::new(&all.iter().map(|o| (o.incidence_deg, get(o)[k])).collect::<Vec<_>>()).name(name)))
        .to_svg()
}
