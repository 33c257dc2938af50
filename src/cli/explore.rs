//! `sweetspot explore`.

use super::Shell;
use super::error::CliError;
use crate::equipment::{Ball, Racket};
use crate::impact::study::face_map::{over_face, scatter};
use crate::impact::study::published::{mean_shots, table};
use crate::impact::study::shot::{Launch, Shot, TYPICAL};
use crate::impact::study::weighting::{Place, study};
use crate::impact::{Base, Model, PreparedModel};
use crate::report::chart::{Chart, Line, Points};
use crate::report::{Layout, Report, Section, Table};
use nalgebra::Vector2;
use std::f64::consts::TAU;
use std::path::PathBuf;

/// What-if studies of the model: added weight, swing, impact position, accuracy, strings, grip; published numbers
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// Which study
    #[arg(value_enum, default_value = "findings")]
    pub study: Study,
    /// Racket file (not for `published`)
    #[arg(long, value_name = "F")]
    pub racket: Option<PathBuf>,
    /// Ball file (not for `published`)
    #[arg(long, value_name = "F")]
    pub ball: Option<PathBuf>,
    /// Model file; without it the visco-elastic base at its defaults
    #[arg(long, value_name = "F")]
    pub model: Option<PathBuf>,
    /// Number of shots in the accuracy study
    #[arg(long, default_value_t = 2000)]
    pub shots: usize,
    /// Seed of the accuracy study
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Study {
    /// The published numbers against the visco-elastic model
    Published,
    /// All what-ifs in one report
    Findings,
}

pub fn run(arguments: Arguments, shell: &Shell) -> Result<(), CliError> {
    let folder = shell.args.out.clone().unwrap_or_default();
    let (name, json, page) = match arguments.study {
        Study::Published => published()?,
        Study::Findings => findings(&arguments)?,
    };
    let text = serde_json::to_string_pretty(&json).map_err(CliError::output)?;
    shell.write(&folder.join(format!("{name}.json")), text.as_bytes())?;
    let path = folder.join(format!("{name}.html"));
    shell.write(&path, page.as_bytes())?;
    shell.say(format_args!("written: {}", path.display()));
    shell.print_json(&json)
}

type Outcome = (&'static str, serde_json::Value, String);

fn published() -> Result<Outcome, CliError> {
    let (lines, shots) = (table()?, mean_shots()?);
    let mut numbers = Table::new("Published numbers, the reference's prototype, and this program").column("Quantity").column("Published");
    numbers = numbers.numbers("Prototype").numbers("Model").column("Unit");
    for l in &lines {
        numbers = numbers.row(&[l.quantity, l.published, &format!("{:.3}", l.reference), &format!("{:.3}", l.model), l.unit]);
    }
    let mut means = Table::new("Mean shots of tables 5.27 and 5.28").column("Players").column("Sign of the chop rate").numbers("Strings sideways, kN/m");
    means = means.numbers("Forward speed, m/s").numbers("published").numbers("Topspin, rpm").numbers("published").numbers("Face open, deg");
    for s in &shots {
        means = means.row(&[
            s.who,
            if s.chop_as_printed { "as printed" } else { "reversed" },
            &if s.strings_n_m > 0.0 { format!("{:.0}", s.strings_n_m / 1e3) } else { "rigid".into() },
            &format!("{:.2}", s.forward_m_s),
            &format!("{:.2}", s.published_forward_m_s),
            &format!("{:.0}", s.topspin_rpm),
            &format!("{:.0}", s.published_topspin_rpm),
            &format!("{:.1}", s.open_deg),
        ]);
    }
    let page = Report::new("Published numbers against the model")
        .subtitle("Visco-elastic base at its documented defaults")
        .section(Section::new("published", "Single quantities").table(numbers))
        .section(
            Section::new("campaign", "The Wimbledon campaign")
                .paragraph(
                    "The face's attitude is not in the tables: its two angles are solved from the ball's upward and sideways speed. \
                     Forward speed and topspin are predictions. The sign of the chop rate in the tables is not known; both are shown.",
                )
                .table(means),
        )
        .finish();
    Ok(("explore-published", serde_json::json!({ "table": lines, "mean_shots": shots }), page))
}

fn findings(arguments: &Arguments) -> Result<Outcome, CliError> {
    let need = |path: &Option<PathBuf>, what: &str| path.clone().ok_or_else(|| CliError::input(format!("`explore findings` needs --{what} FILE")));
    let racket = Racket::read(&need(&arguments.racket, "racket")?)?;
    let ball = Ball::read(&need(&arguments.ball, "ball")?)?;
    let model = match &arguments.model {
        Some(path) => Model::read(path)?,
        None => Model::new(Base::Viscoelastic),
    };
    if arguments.shots == 0 || arguments.shots > 1_000_000 {
        return Err(CliError::input(format!("--shots is {}; allowed: 1 to 1000000", arguments.shots)));
    }
    let prepared = model.prepare(&racket, &ball)?;
    let shot = TYPICAL;
    let added = [0.0, 0.005, 0.010, 0.015, 0.020];
    let weights = study(&model, &racket, &ball, &shot, &added)?;
    let chop = sweep(&prepared, &[0.0, 2.0, 4.0, 6.0, 8.0, 10.0], |v| Shot { brush_speed: v, ..shot })?;
    let swing = sweep(&prepared, &[10.0, 15.0, 20.0, 25.0, 30.0, 35.0, 40.0], |w| Shot { swing_rate: w, ..shot })?;
    let map: Vec<Vector2<f64>> = (-12..=12)
        .flat_map(|i| (-10..=10).map(move |j| (i, j)))
        .map(|(i, j)| Vector2::new(f64::from(i) / 12.0 * 0.5 * racket.head.inner_length_m, f64::from(j) / 10.0 * 0.5 * racket.head.inner_width_m))
        .filter(|p| (2.0 * p.x / racket.head.inner_length_m).powi(2) + (2.0 * p.y / racket.head.inner_width_m).powi(2) <= 0.9)
        .collect();
    let over = over_face(&prepared, &shot, &map)?;
    let accuracy = [0.0, 0.01, 0.02, 0.03].iter().map(|sd| scatter(&prepared, &shot, (*sd, *sd), arguments.shots, arguments.seed)).collect::<Result<Vec<_>, _>>()?;
    let mut tensions = Vec::new();
    for lb in [40.0, 50.0, 60.0, 70.0] {
        let mut strung = racket.clone();
        strung.strings.tension_lb = lb;
        tensions.push((lb, shot.launch(&model.prepare(&strung, &ball)?)?));
    }
    let held = if model.has_effect("grip-torque") { model.clone() } else { model.with_effect("grip-torque")? };
    let held = held.prepare(&racket, &ball)?;
    let mut grips = Vec::new();
    for torque in [0.0, 2.0, 5.0, 10.0, 20.0] {
        grips.push((torque, Shot { grip_torque: torque, position: Vector2::new(0.0, 0.05), ..shot }.launch(&held)?));
    }
    let json = serde_json::json!({
        "weighting": weights, "chop": chop, "swing": swing, "accuracy": accuracy, "tension_lb": tensions, "grip_torque_nm": grips,
        "face": map.iter().zip(&over).map(|(p, l)| serde_json::json!({ "x": p.x, "y": p.y, "launch": l })).collect::<Vec<_>>(),
    });
    let weight_line = |place: Place, get: &dyn Fn(&crate::impact::study::weighting::Weighted) -> f64| -> Vec<(f64, f64)> {
        weights.iter().filter(|w| w.place == place).map(|w| (1e3 * w.added_kg, get(w))).collect()
    };
    let by_place = |title: &str, label: &str, unit: &str, get: &dyn Fn(&crate::impact::study::weighting::Weighted) -> f64| {
        let mut chart = Chart::new(title).x("added mass", "g").y(label, unit);
        for (place, name) in [(Place::Tip, "tip"), (Place::Sides, "3 and 9 o'clock"), (Place::Handle, "handle")] {
            chart = chart.add(Line::new(&weight_line(place, get)).name(name));
        }
        chart.to_svg()
    };
    let rpm = |w: f64| w.abs() * 60.0 / TAU;
    let chop_line: Vec<(f64, f64)> = chop.iter().map(|(v, l)| (*v, rpm(l.spin_rad_s))).collect();
    let swing_line: Vec<(f64, f64)> = swing.iter().map(|(v, l)| (*v, l.speed)).collect();
    let along: Vec<(f64, f64)> = map.iter().zip(&over).filter(|(p, _)| p.y.abs() < 1e-9).map(|(p, l)| (1e3 * p.x, l.speed)).collect();
    let across: Vec<(f64, f64)> = map.iter().zip(&over).filter(|(p, _)| p.x.abs() < 1e-9).map(|(p, l)| (1e3 * p.y, l.speed)).collect();
    let mut scatter_table = Table::new("Scatter of the impact position into scatter of the launch").numbers("Position sd, mm").numbers("Speed, m/s");
    scatter_table = scatter_table.numbers("sd, m/s").numbers("Launch angle sd, deg").numbers("Side angle sd, deg").numbers("Spin sd, rpm").numbers("On the strings");
    for a in &accuracy {
        scatter_table = scatter_table.row(&[
            format!("{:.0}", 1e3 * a.position_sd_m.0),
            format!("{:.2}", a.mean_speed),
            format!("{:.2}", a.sd_speed),
            format!("{:.2}", a.sd_launch_angle_rad.to_degrees()),
            format!("{:.2}", a.sd_side_angle_rad.to_degrees()),
            format!("{:.0}", rpm(a.sd_spin_rad_s)),
            a.n.to_string(),
        ]);
    }
    let simple = |title: &str, head: &str, rows: &[(f64, Launch)]| {
        let mut t = Table::new(title).numbers(head).numbers("Ball speed, m/s").numbers("Apparent restitution").numbers("Spin, rpm");
        for (v, l) in rows {
            t = t.row(&[format!("{v:.0}"), format!("{:.2}", l.speed), format!("{:.3}", l.apparent_restitution), format!("{:.0}", rpm(l.spin_rad_s))]);
        }
        t
    };
    let page = Report::new("What if: weight, swing, place, strings, grip")
        .subtitle(&format!("{}, base \"{}\", mean forehand of the thesis's table 5.27", racket.name, model.base().name()))
        .section(Section::new("weight", "Added weight").figures(
            Layout::Normal,
            &[
                (by_place("Impact 80 mm toward the tip", "ball speed", "m/s", &|w| w.tip.speed), "Weighting raises the ball's speed off the tip.".into()),
                (
                    by_place("Lost 50 mm off the axis", "speed lost off the axis", "m/s", &|w| w.centre.speed - w.edge.speed),
                    "Weight at the edges reduces the penalty of hitting off the axis.".into(),
                ),
            ],
        ))
        .section(Section::new("swing", "Swing and chop").figures(
            Layout::Normal,
            &[
                (
                    Chart::new("Chopping makes spin").x("speed of the face across itself", "m/s").y("spin", "rpm").add(Line::new(&chop_line)).add(Points::new(&chop_line)).to_svg(),
                    "Spin grows with the face's speed across the ball's path.".into(),
                ),
                (
                    Chart::new("Swing").x("swing rate", "rad/s").y("ball speed", "m/s").add(Line::new(&swing_line)).add(Points::new(&swing_line)).to_svg(),
                    "Ball speed against swing rate, centre-of-mass speed kept.".into(),
                ),
            ],
        ))
        .section(Section::new("place", "Impact position").figures(
            Layout::Normal,
            &[
                (Chart::new("Along the axis").x("toward the handle", "mm").y("ball speed", "m/s").add(Line::new(&along)).to_svg(), "Ball speed along the long axis.".into()),
                (Chart::new("Across the face").x("across", "mm").y("ball speed", "m/s").add(Line::new(&across)).to_svg(), "Ball speed across the face at its centre.".into()),
            ],
        ))
        .section(Section::new("accuracy", "Accuracy").table(scatter_table))
        .section(
            Section::new("strings-grip", "Strings and grip")
                .table(simple("String tension, centre of the axis", "Tension, lb", &tensions))
                .table(simple("Grip torque, 50 mm off the axis", "Torque, N m", &grips)),
        )
        .finish();
    Ok(("explore-findings", json, page))
}

fn sweep(model: &PreparedModel, values: &[f64], shot: impl Fn(f64) -> Shot) -> Result<Vec<(f64, Launch)>, CliError> {
    values.iter().map(|v| Ok((*v, shot(*v).launch(model)?))).collect()
}
