//! `sweetspot explore findings`: the thesis's what-ifs in one report.

use super::{Arguments, Outcome};
use crate::cli::error::CliError;
use crate::equipment::{Ball, Racket};
use crate::impact::study::face_map::{Scatter, over_face, scatter};
use crate::impact::study::shot::{Launch, Shot, TYPICAL};
use crate::impact::study::weighting::{Place, Weighted, study};
use crate::impact::{Base, Model, PreparedModel};
use crate::quantity::RPM;
use crate::report::chart::{Cells, Chart, Line, Points, face};
use crate::report::{Layout, Report, Section, Table, Tone};
use nalgebra::Vector2;

/// Cells of the maps across the face.
const ACROSS: usize = 28;
/// Added masses, kg.
const ADDED: [f64; 5] = [0.0, 0.005, 0.010, 0.015, 0.020];

/// A ball of the rules' mass and size, where no file names another.
fn itf_ball() -> Ball {
    Ball { name: "ITF ball, 57.7 g".into(), mass_kg: 0.0577, diameter_m: 0.066, inertia_factor: 0.55 }
}

/// Every what-if of the report, computed.
struct Studies {
    racket: Racket,
    shot: Shot,
    shots: usize,
    weights: Vec<Weighted>,
    /// Launch by the speed of the face across itself, m/s; by swing rate, rad/s; by string tension, lb; by torque about the handle, N m.
    chop: Vec<(f64, Launch)>,
    swing: Vec<(f64, Launch)>,
    tensions: Vec<(f64, Launch)>,
    grips: Vec<(f64, Launch)>,
    /// Places of the face as the maps draw them (across, along; mm), the side of a cell, and the launch from each.
    cells: Vec<(f64, f64)>,
    side: f64,
    over: Vec<Launch>,
    accuracy: Vec<Scatter>,
}

impl Studies {
    fn new(model: &Model, racket: Racket, ball: &Ball, arguments: &Arguments) -> Result<Self, CliError> {
        let (prepared, shot) = (model.prepare(&racket, ball)?, TYPICAL);
        let (cells, side) = face::cells(&racket, ACROSS);
        let map: Vec<Vector2<f64>> = cells.iter().map(|(y, x)| 1e-3 * Vector2::new(*x, *y)).collect();
        let deviations = [0.0, 0.005, 0.010, 0.015, 0.020, 0.025, 0.030];
        let strung = |lb: f64| -> Result<(f64, Launch), CliError> {
            let mut strung = racket.clone();
            strung.strings.tension_lb = lb;
            Ok((lb, shot.launch(&model.prepare(&strung, ball)?)?))
        };
        let held = if model.has_effect("grip-torque") { model.clone() } else { model.with_effect("grip-torque")? };
        let held = held.prepare(&racket, ball)?;
        Ok(Studies {
            weights: study(model, &racket, ball, &shot, &ADDED)?,
            chop: sweep(&prepared, &[0.0, 2.0, 4.0, 6.0, 8.0, 10.0], |v| Shot { brush_speed: v, ..shot })?,
            swing: sweep(&prepared, &[10.0, 15.0, 20.0, 25.0, 30.0, 35.0, 40.0], |w| Shot { swing_rate: w, ..shot })?,
            over: over_face(&prepared, &shot, &map)?,
            accuracy: deviations.iter().map(|sd| scatter(&prepared, &shot, (*sd, *sd), arguments.shots, arguments.seed)).collect::<Result<_, _>>()?,
            tensions: [40.0, 50.0, 60.0, 70.0].map(strung).into_iter().collect::<Result<_, _>>()?,
            grips: sweep(&held, &[0.0, 2.0, 5.0, 10.0, 20.0], |torque| Shot { grip_torque: torque, position: Vector2::new(0.0, 0.05), ..shot })?,
            shots: arguments.shots,
            racket,
            shot,
            cells,
            side,
        })
    }

    fn json(&self) -> serde_json::Value {
        let place = |((across, along), launch): (&(f64, f64), &Launch)| serde_json::json!({ "x": 1e-3 * along, "y": 1e-3 * across, "launch": launch });
        serde_json::json!({
            "weighting": self.weights, "chop": self.chop, "swing": self.swing, "accuracy": self.accuracy, "tension_lb": self.tensions,
            "grip_torque_nm": self.grips, "face": self.cells.iter().zip(&self.over).map(place).collect::<Vec<_>>(),
        })
    }

    fn findings(&self) -> Section {
        let found = three_findings(&self.weights, &self.chop);
        let tone = if found.iter().all(|(_, holds)| *holds) { Tone::Good } else { Tone::Doubt };
        Section::new("findings", "Three findings").verdict(tone, &found.into_iter().map(|(words, _)| words).collect::<Vec<_>>())
    }

    fn weight(&self) -> Section {
        let weights = &self.weights;
        Section::new("weight", "Added weight").figures(
            Layout::Normal,
            &[
                (
                    by_place("Impact 80 mm toward the tip", "ball speed", "m/s", weights, &|w| w.tip.speed),
                    "Same swing, weight added. Impact on the long axis.".into(),
                ),
                (
                    by_place("Impact at the centre", "ball speed", "m/s", weights, &|w| w.centre.speed),
                    "Weight helps where it makes the point that is hit heavier.".into(),
                ),
                (
                    by_place("Lost 50 mm off the axis", "speed lost off the axis", "m/s", weights, &|w| w.centre.speed - w.edge.speed),
                    "Ball speed at the centre less that 50 mm across from it.".into(),
                ),
            ],
        )
    }

    fn swing(&self) -> Section {
        let (chop, swing) = (line(&self.chop, |l| rpm(l.spin_rad_s)), line(&self.swing, |l| l.speed));
        Section::new("swing", "Swing and chop").figures(
            Layout::Normal,
            &[
                (curve("Chop", "speed of the face across itself", "m/s", "spin", "rpm", &chop), "Spin against the face's speed across the ball's path.".into()),
                (curve("Swing", "swing rate", "rad/s", "ball speed", "m/s", &swing), "Ball speed against swing rate, speed of the centre of mass kept.".into()),
            ],
        )
    }

    fn place(&self) -> Section {
        let heat = |title: &str, unit: &str, get: &dyn Fn(&Launch) -> f64| -> String {
            let coloured: Vec<(f64, f64, f64)> = self.cells.iter().zip(&self.over).map(|((y, x), l)| (*y, *x, get(l))).collect();
            let chart = face::bare(title, &self.racket).size(300.0, 400.0).add(Cells::new(&coloured, (self.side, self.side), unit));
            face::outline(chart, &self.racket).to_svg()
        };
        Section::new("place", "Impact position")
            .figures(
                Layout::Normal,
                &[
                    (heat("Ball speed", "m/s", &|l| l.speed), "Same swing, every place of the face.".into()),
                    (heat("Spin", "rpm", &|l| rpm(l.spin_rad_s)), "About the long axis.".into()),
                    (heat("Launch angle", "°", &|l| l.launch_angle_rad.to_degrees()), "Upward (along y) from the face's normal before impact.".into()),
                    (heat("Side angle", "°", &|l| l.side_angle_rad.to_degrees()), "Toward the handle (along x) from the normal.".into()),
                ],
            )
            .note(
                "Seen from the side the ball comes from, tip at the top. Angles are those of the ball's velocity against the face as it stood at first touch.",
            )
    }

    fn accuracy(&self) -> Section {
        let mut table = Table::new("Scatter of the impact position into scatter of the launch").numbers("Position sd, mm").numbers("Speed, m/s");
        table = table.numbers("sd, m/s").numbers("Launch angle sd, deg").numbers("Side angle sd, deg").numbers("Spin sd, rpm").numbers("Shots on the strings");
        for a in &self.accuracy {
            table = table.row(&[
                format!("{:.0}", 1e3 * a.position_sd_m.0),
                format!("{:.2}", a.mean_speed),
                format!("{:.2}", a.sd_speed),
                format!("{:.2}", a.sd_launch_angle_rad.to_degrees()),
                format!("{:.2}", a.sd_side_angle_rad.to_degrees()),
                format!("{:.0}", rpm(a.sd_spin_rad_s)),
                a.n.to_string(),
            ]);
        }
        let angles = |get: fn(&Scatter) -> f64| -> Vec<(f64, f64)> { self.accuracy.iter().map(|a| (1e3 * a.position_sd_m.0, get(a).to_degrees())).collect() };
        let (up, sideways) = (angles(|a| a.sd_launch_angle_rad), angles(|a| a.sd_side_angle_rad));
        let chart = Chart::new("Scatter of the launch against scatter of the impact")
            .x("scatter of the impact position (sd)", "mm")
            .y("scatter of the direction (sd)", "°")
            .add(Line::new(&up).name("launch angle"))
            .add(Line::new(&sideways).name("side angle"));
        let caption = format!("Normal scatter along and across the face, {} shots each.", self.shots);
        Section::new("accuracy", "Accuracy").figure(&chart.to_svg(), &caption).table(table)
    }

    fn strings_and_grip(&self) -> Section {
        let (tension, grip) = (line(&self.tensions, |l| l.speed), line(&self.grips, |l| l.speed));
        let direction = line(&self.grips, |l| l.launch_angle_rad.to_degrees());
        Section::new("strings-grip", "Strings and grip")
            .figures(
                Layout::Normal,
                &[
                    (
                        curve("String tension", "tension", "lb", "ball speed", "m/s", &tension),
                        format!("{} Impact 50 mm toward the tip on the axis.", course("Ball speed", "m/s", "lb", &tension)),
                    ),
                    (
                        curve("Grip: speed", "torque about the handle", "N m", "ball speed", "m/s", &grip),
                        format!("{} Impact 50 mm off the axis.", course("Ball speed", "m/s", "N m", &grip)),
                    ),
                    (
                        curve("Grip: direction", "torque about the handle", "N m", "launch angle", "°", &direction),
                        course("The launch angle", "degrees", "N m", &direction),
                    ),
                ],
            )
            .table(simple("String tension, 50 mm toward the tip on the axis", "Tension, lb", &self.tensions))
            .table(simple("Grip torque, impact 50 mm off the axis", "Torque, N m", &self.grips))
    }
}

pub fn findings(arguments: &Arguments) -> Result<Outcome, CliError> {
    let path = arguments.racket.as_ref().ok_or_else(|| CliError::input("`explore findings` needs --racket FILE".to_owned()))?;
    let racket = Racket::read(path)?;
    let ball = arguments.ball.as_deref().map_or_else(|| Ok(itf_ball()), Ball::read)?;
    let model = match &arguments.model {
        Some(path) => Model::read(path)?,
        None => Model::new(Base::Viscoelastic),
    };
    if arguments.shots == 0 || arguments.shots > 1_000_000 {
        return Err(CliError::input(format!("--shots is {}; allowed: 1 to 1000000", arguments.shots)));
    }
    let effects: Vec<&str> = model.effects().iter().map(|e| e.name.as_str()).collect();
    let studies = Studies::new(&model, racket, &ball, arguments).map_err(|e| match &arguments.model {
        Some(path) => CliError { message: format!("{}: {}", path.display(), e.message), ..e },
        None => e,
    })?;
    let shot = &studies.shot;
    let subtitle = format!(
        "{}, {}, {}base \"{}\"{}; the mean forehand of the thesis's table 5.27: ball at {} m/s, centre of mass at {} m/s, swing {} rad/s, {} m/s across the face, {:.0} mm toward the tip",
        studies.racket.name,
        ball.name,
        arguments.model.as_ref().and_then(|p| p.file_name()).map_or_else(String::new, |n| format!("{}: ", n.to_string_lossy())),
        model.base().name(),
        if effects.is_empty() { String::new() } else { format!(" with {}", effects.join(", ")) },
        shot.ball_speed,
        shot.racket_speed,
        shot.swing_rate,
        shot.brush_speed,
        -1e3 * shot.position.x
    );
    let sections = [studies.findings(), studies.weight(), studies.swing(), studies.place(), studies.accuracy(), studies.strings_and_grip()];
    let report = Report::new("What if: weight, swing, place, strings, grip").subtitle(&subtitle);
    let page = sections.into_iter().fold(report, Report::section).finish();
    Ok(("explore-findings", studies.json(), page))
}

fn line(rows: &[(f64, Launch)], get: fn(&Launch) -> f64) -> Vec<(f64, f64)> {
    rows.iter().map(|(v, l)| (*v, get(l))).collect()
}

/// What the thesis's abstract concludes, with this racket's numbers: each in words, and whether it holds here.
fn three_findings(weights: &[Weighted], chop: &[(f64, Launch)]) -> Vec<(String, bool)> {
    let at = |place: Place, kg: f64| weights.iter().find(|w| w.place == place && w.added_kg == kg);
    let most = ADDED[ADDED.len() - 1];
    let mut lines = Vec::new();
    if let (Some(plain), Some(tip), Some(sides), Some(handle)) = (at(Place::Tip, 0.0), at(Place::Tip, most), at(Place::Sides, most), at(Place::Handle, most)) {
        let gains = [tip, sides, handle].map(|w| w.tip.speed - plain.tip.speed);
        let holds = gains[0] > 0.0 && gains[1] > 0.0;
        lines.push((
            format!(
                "Weighting {} the ball's speed where it is hit 80 mm toward the tip: {:.0} g at the tip give {:+.2} m/s, at 3 and 9 o'clock {:+.2}, at the handle {:+.2} (same swing, {:.2} m/s without).",
                if holds { "raises" } else { "does not raise" },
                1e3 * most,
                gains[0],
                gains[1],
                gains[2],
                plain.tip.speed
            ),
            holds,
        ));
        let lost = |w: &Weighted| w.centre.speed - w.edge.speed;
        let holds = lost(sides) < lost(plain);
        lines.push((
            format!(
                "Weight at 3 and 9 o'clock {} the penalty of hitting off the axis: {:.2} m/s lost 50 mm off it become {:.2}; with the weight at the tip {:.2}, at the handle {:.2}.",
                if holds { "reduces" } else { "does not reduce" },
                lost(plain),
                lost(sides),
                lost(tip),
                lost(handle)
            ),
            holds,
        ));
    }
    let spins: Vec<String> = chop.iter().map(|(v, l)| format!("{:.0} rpm at {v:.0} m/s", rpm(l.spin_rad_s))).collect();
    let holds = chop.first().zip(chop.last()).is_some_and(|((_, none), (_, most))| most.spin_rad_s.abs() > none.spin_rad_s.abs());
    lines.push((
        format!("Chopping makes {} spin, by the speed of the face across itself: {}.", if holds { "more" } else { "no more" }, spins.join(", ")),
        holds,
    ));
    lines
}

/// What becomes of a quantity from the first to the last of a line, in words; a change below half a unit of its second decimal is none.
fn course(what: &str, unit: &str, along: &str, line: &[(f64, f64)]) -> String {
    let (Some(first), Some(last)) = (line.first(), line.last()) else { return String::new() };
    let change = last.1 - first.1;
    let word = if change > 0.0 { "rises" } else { "falls" };
    let becomes = if change.abs() < 0.005 { format!("stays at {:.2} {unit}", first.1) } else { format!("{word} by {:.2} {unit}", change.abs()) };
    format!("{what} {becomes} from {:.0} to {:.0} {along}.", first.0, last.0)
}

fn rpm(rad_s: f64) -> f64 {
    RPM * rad_s.abs()
}

fn by_place(title: &str, label: &str, unit: &str, weights: &[Weighted], get: &dyn Fn(&Weighted) -> f64) -> String {
    let mut chart = Chart::new(title).x("added mass", "g").y(label, unit);
    for (place, name) in [(Place::Tip, "tip"), (Place::Sides, "3 and 9 o'clock"), (Place::Handle, "handle")] {
        let line: Vec<(f64, f64)> = weights.iter().filter(|w| w.place == place).map(|w| (1e3 * w.added_kg, get(w))).collect();
        chart = chart.add(Line::new(&line).name(name));
    }
    chart.to_svg()
}

fn curve(title: &str, x: &str, x_unit: &str, y: &str, y_unit: &str, line: &[(f64, f64)]) -> String {
    Chart::new(title).x(x, x_unit).y(y, y_unit).add(Line::new(line)).add(Points::new(line)).to_svg()
}

fn simple(title: &str, head: &str, rows: &[(f64, Launch)]) -> Table {
    let mut t = Table::new(title).numbers(head).numbers("Ball speed, m/s").numbers("Apparent restitution").numbers("Spin, rpm").numbers("Launch angle, deg");
    for (v, l) in rows {
        t = t.row(&[
            format!("{v:.0}"),
            format!("{:.2}", l.speed),
            format!("{:.3}", l.apparent_restitution),
            format!("{:.0}", rpm(l.spin_rad_s)),
            format!("{:.2}", l.launch_angle_rad.to_degrees()),
        ]);
    }
    t
}

fn sweep(model: &PreparedModel, values: &[f64], shot: impl Fn(f64) -> Shot) -> Result<Vec<(f64, Launch)>, CliError> {
    values.iter().map(|v| Ok((*v, shot(*v).launch(model)?))).collect()
}
