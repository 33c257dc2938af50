//! Ball and racket in space around the impact.

use super::room::Room;
use super::shots::shot_heading;
use crate::report::chart::{Chart, Colour, Line, Points, Rule, Scene, Symbol};
use crate::report::page::{Layout, Section};
use crate::report::session_results::{SessionResults, ShotResults};
use crate::tracking::{SpacePoint, Target};
use nalgebra::Point3;

/// Shown for this long on either side of the impact, s.
const AROUND_S: f64 = 0.030;

pub fn trajectories(results: &SessionResults) -> Option<Section> {
    let shots: Vec<&ShotResults> = results.shots.iter().filter(|s| !s.points.is_empty()).collect();
    if shots.is_empty() {
        return None;
    }
    let room = Room { axes_known: results.axes_known };
    let mut section = Section::new("trajectories", "Trajectories in space");
    if !results.axes_known {
        section = section.note("No picture of the three-sphere frame: the axes are the left camera's own.");
    }
    for (k, shot) in shots.iter().enumerate() {
        let figures = [
            (
                scene(shot, room),
                "Ball and markers around the impact; the racket's outline through its markers in every fifth frame, pink at the impact; dotted: their shadows on the floor.".to_owned(),
            ),
            (components(shot, room), "The ball's centre against time, with error bars of two standard deviations where they are visible.".to_owned()),
        ];
        if k < 2 {
            section = section.heading(&shot_heading(&shot.id)).figures(Layout::Normal, &figures);
        } else {
            section = section.folded(&shot_heading(&shot.id), |s| s.figures(Layout::Normal, &figures));
        }
    }
    Some(section)
}

fn near(shot: &ShotResults) -> impl Iterator<Item = &SpacePoint> {
    shot.points.iter().filter(|p| p.t.abs() <= AROUND_S && p.position.coords.iter().all(|c| c.is_finite()))
}

fn scene(shot: &ShotResults, room: Room) -> String {
    let ball = |after: bool| -> Vec<Point3<f64>> {
        near(shot).filter(|p| p.target == Target::Ball && (p.t >= 0.0) == after).map(|p| room.point(&p.position)).collect()
    };
    let (before, after) = (ball(false), ball(true));
    let mut scene = Scene::new(&shot_heading(&shot.id))
        .describe("Paths of the ball before and after the impact and of the racket's markers.")
        .size(340.0, 300.0)
        .axis_names(room.axis_names())
        .path(&before, "ball before", Colour::BLUE)
        .dots(&before, 3.6, "", Colour::BLUE)
        .path(&after, "ball after", Colour::ORANGE)
        .dots(&after, 3.6, "", Colour::ORANGE);
    let tip: Vec<Point3<f64>> = near(shot).filter(|p| p.target == Target::M1).map(|p| room.point(&p.position)).collect();
    scene = scene.path(&tip, "racket tip", Colour::GREEN);
    let mut frames: Vec<(u64, f64)> = near(shot).map(|p| (p.frame, p.t)).collect();
    frames.sort_by_key(|f| f.0);
    frames.dedup_by_key(|f| f.0);
    let impact = frames.iter().min_by(|a, b| a.1.abs().total_cmp(&b.1.abs())).map(|f| f.0);
    for (frame, _) in frames.iter().filter(|f| impact.is_some_and(|i| f.0.abs_diff(i).is_multiple_of(5))) {
        // Around the head from the tip, then to the throat: 1, 2, 4, 5, 3.
        let order = [Target::M1, Target::M2, Target::M4, Target::M5, Target::M3];
        let corners: Vec<Point3<f64>> =
            order.iter().filter_map(|t| near(shot).find(|p| p.frame == *frame && p.target == *t).map(|p| room.point(&p.position))).collect();
        if corners.len() >= 4 {
            let bold = Some(*frame) == impact;
            scene = scene.outline(&corners, if bold { "racket at impact" } else { "" }, if bold { Colour::PINK } else { Colour::GREY });
        }
    }
    scene.to_svg()
}

fn components(shot: &ShotResults, room: Room) -> String {
    let names = room.axis_names();
    let mut chart =
        Chart::new("Ball centre").describe("The three coordinates of the ball's centre against time.").x("time from impact", "ms").y("position", "m");
    for (k, name) in names.iter().enumerate() {
        let ball: Vec<&SpacePoint> = near(shot).filter(|p| p.target == Target::Ball).collect();
        let at: Vec<(f64, f64)> = ball.iter().map(|p| (1000.0 * p.t, room.point(&p.position)[k])).collect();
        let sd: Vec<f64> = ball.iter().map(|p| 2.0 * room.vector(&p.sd)[k].abs()).collect();
        let symbol = Symbol::of_series(k);
        let colour = Colour::of_series(k);
        chart = chart.add(Line::new(&at).width(0.7).colour(colour)).add(Points::new(&at).y_error(&sd).symbol(symbol).size(3.2).colour(colour).name(name));
    }
    chart.add(Rule::vertical(0.0)).to_svg()
}
