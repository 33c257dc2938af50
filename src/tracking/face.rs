//! Which side marker is m2 and which m3.
//!
//! A figure that is symmetric about its long axis equals itself turned by half a turn about x: no camera can tell the two
//! poses apart, and m2/m3 (m4/m5) are exchanged between them. The whole shot then takes one of them, by convention: z
//! points to the side the ball comes from (physics: z toward the hitting side).

use super::ball_track::BallFrame;
use super::racket_figure::RacketFigure;
use super::racket_track::RacketFrame;
use nalgebra::{Isometry3, UnitQuaternion, Vector3};

/// Partner of each marker under the half turn.
const TWIN: [usize; 5] = [0, 2, 1, 4, 3];
/// A figure counts as symmetric when the half turn moves no marker by more than this, m: less than tape can be placed to.
const SYMMETRY_M: f64 = 0.004;

/// Whether the figure equals itself after half a turn about its long axis.
pub fn symmetric(figure: &RacketFigure) -> bool {
    (0..5).all(|i| {
        let (p, q) = (figure.points[i], figure.points[TWIN[i]]);
        (Vector3::new(p.x - q.x, p.y + q.y, p.z + q.z)).norm() < SYMMETRY_M
    })
}

/// The same picture read the other way round.
pub fn twin(frame: &RacketFrame) -> RacketFrame {
    let mut out = frame.clone();
    out.pose.global_from_racket = turned(&frame.pose.global_from_racket);
    for camera in 0..2 {
        for marker in 0..5 {
            out.points[camera][marker] = frame.points[camera][TWIN[marker]];
        }
    }
    // The covariance is about the global axes and the origin lies on the axis of the half turn: it stays.
    out
}

fn turned(pose: &Isometry3<f64>) -> Isometry3<f64> {
    let half_turn = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
    Isometry3::from_parts(pose.translation, pose.rotation * half_turn)
}

/// Of a frame and its twin, the one whose attitude is nearer to `last`.
pub fn nearest_twin(frame: RacketFrame, last: &Isometry3<f64>) -> RacketFrame {
    let own = frame.pose.global_from_racket.rotation.angle_to(&last.rotation);
    let other = turned(&frame.pose.global_from_racket).rotation.angle_to(&last.rotation);
    if own <= other { frame } else { twin(&frame) }
}

/// Turns the whole shot, if need be, so that z points to the side the ball comes from. Without a ball: z toward +U.
pub fn settle(racket: &mut [Option<RacketFrame>], ball: &[Option<BallFrame>], figure: &RacketFigure) {
    if !symmetric(figure) {
        return;
    }
    // The side of the face on which the ball is while it comes nearer, over its first frames with a racket.
    let heights: Vec<f64> = racket
        .iter()
        .zip(ball)
        .filter_map(|(r, b)| {
            let pose = r.as_ref()?.pose.global_from_racket;
            Some((pose.inverse() * b.as_ref()?.position).z)
        })
        .collect();
    let mut first: Vec<f64> = heights.iter().take(7).copied().collect();
    first.sort_by(f64::total_cmp);
    let side = match first.get(first.len() / 2) {
        Some(h) => *h,
        None => racket.iter().flatten().map(|r| r.pose.normal().x).sum(),
    };
    if side < 0.0 {
        for r in racket.iter_mut().flatten() {
            *r = twin(r);
        }
    }
}
