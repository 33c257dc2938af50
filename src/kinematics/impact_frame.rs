//! The frame of the impact: where the ball is nearest to the face and turns, or where its two flights meet when no frame shows it.

use super::KinematicsError;
use super::frame_view::{FEWEST_STEREO, FrameView};
use super::racket_outline::{outside_strings, past_head};
use super::sighting::FrameClock;
use super::straight_line::{Line, straight_line};
use crate::equipment::{Ball, Racket};
use crate::median::upper_median;
use nalgebra::{Isometry3, Point3, center};
use std::collections::BTreeMap;

/// Frames before and after the contact in which the ball may be looked for when the nearest do not show it, and how far apart both flights may be
/// there, m: 50 m/s for 5 ms of contact.
const FAR: u64 = 24;
const TOGETHER_M: f64 = 0.25;
/// Longest gap in which both flights tell an impact, s, and the least change of velocity that is one, m/s.
const LONGEST_HIDDEN_S: f64 = 0.035;
const LEAST_JUMP_M_S: f64 = 3.0;
/// Half of a flight's places lie nearer to its line, m: 24 frames of free fall and depths that are good to some millimetres.
const STRAIGHT_M: f64 = 0.02;
/// The face's half extents around the stringbed centre within which an approach counts as an impact, m.
const FACE: (f64, f64) = (0.30, 0.20);

/// The frame at which the ball is nearest to the face, or that was `stated`, within the frames of the `span`; and the side it came from.
pub fn find_impact(
    frames: &BTreeMap<u64, FrameView>,
    racket: &Racket,
    ball: &Ball,
    clock: FrameClock,
    stated: Option<u64>,
    span: (u64, u64),
) -> Result<(u64, f64), KinematicsError> {
    let reach = 2.0 * ball.diameter_m;
    let local: Vec<(u64, Point3<f64>)> = frames.iter().filter_map(|(k, f)| Some((*k, f.pose?.inverse_transform_point(&f.ball?.position)))).collect();
    if local.len() < 2 * FEWEST_STEREO {
        return Err(KinematicsError::NoCommonFrames { seen: local.len(), need: 2 * FEWEST_STEREO });
    }
    let over_face = |p: &Point3<f64>| p.x.abs() < FACE.0 && p.y.abs() < FACE.1;
    let nearest = match stated {
        Some(frame) if (span.0..=span.1).contains(&frame) => frame,
        Some(frame) => return Err(KinematicsError::ImpactFrameOutside { frame, first: span.0, last: span.1 }),
        None => {
            let meetings = meetings(frames, clock, |p| over_face(p) && p.z.abs() < reach);
            // The string plane, carried by a turning racket, may sweep past the ball more than once: the impact is where the
            // ball's velocity jumps.
            let near: Vec<&(u64, Point3<f64>)> = local.iter().filter(|(_, p)| over_face(p) && p.z.abs() < reach).collect();
            let lowest = near.iter().enumerate().filter(|(i, n)| {
                let farther = |j: Option<usize>| j.and_then(|j| near.get(j)).is_none_or(|o| o.0.abs_diff(n.0) > 1 || o.1.z.abs() >= n.1.z.abs());
                farther(i.checked_sub(1)) && farther(Some(i + 1))
            });
            // At the end of a gap it is lower still within, where both flights lead.
            let seen = lowest.map(|(_, n)| n.0).filter(|n| meetings.iter().all(|m| m.gap.0 != *n && m.gap.1 != *n));
            let all = seen.map(|n| (velocity_jump(frames, n), n)).chain(meetings.iter().map(|m| (m.jump, m.frame)));
            let most = all.max_by(|a, b| a.0.total_cmp(&b.0));
            most.ok_or_else(|| why_none(&local, racket, ball))?.1
        }
    };
    let before: Vec<f64> = local.iter().filter(|(k, _)| *k < nearest).rev().take(12).map(|(_, p)| p.z).collect();
    if before.len() < FEWEST_STEREO {
        return Err(KinematicsError::TooFewFrames { body: "ball and racket", when: "before", seen: before.len(), need: FEWEST_STEREO });
    }
    Ok((nearest, before.iter().sum::<f64>().signum()))
}

/// Where the ball goes when it comes to no impact: past the head, where it crosses the string plane between one frame and one of the next, or nowhere near.
fn why_none(local: &[(u64, Point3<f64>)], racket: &Racket, ball: &Ball) -> KinematicsError {
    let crossings = local.windows(2).filter(|pair| pair[1].0 - pair[0].0 <= 3 && pair[0].1.z * pair[1].1.z < 0.0).map(|pair| {
        let (p, q) = (pair[0].1, pair[1].1);
        let place = (p + (q - p) * (p.z / (p.z - q.z))).xy();
        (past_head(racket, ball, &place.coords), place)
    });
    match crossings.min_by(|a, b| a.0.total_cmp(&b.0)).filter(|(past_m, _)| *past_m > 0.0) {
        Some((past_m, place)) => KinematicsError::PassesBy { past_m, x_m: place.x, y_m: place.y },
        None => {
            let from_strings = |p: &Point3<f64>| outside_strings(&racket.head, &p.xy().coords).max(0.0).hypot(p.z);
            KinematicsError::NoImpact { nearest_m: local.iter().map(|(_, p)| from_strings(p)).fold(f64::INFINITY, f64::min) }
        }
    }
}

/// Change of the ball's velocity from the frames before to the frames after one frame, m/s; 0 when too few are seen. Where none of the next frames
/// show the ball, farther ones tell, if what they show comes together at the frame: a ball cannot be turned round anywhere else.
fn velocity_jump(frames: &BTreeMap<u64, FrameView>, at: u64) -> f64 {
    let Some(t) = frames.get(&at).map(|f| f.t) else { return 0.0 };
    let line = |range: std::ops::RangeInclusive<u64>| {
        let points: Vec<(f64, Point3<f64>)> = frames.range(range).filter_map(|(_, f)| Some((f.t, f.ball?.position))).collect();
        (points.len() >= 3).then(|| straight_line(&points, t))
    };
    let near = (line(at.saturating_sub(9)..=at.saturating_sub(2)), line(at + 5..=at + 12));
    if let (Some(before), Some(after)) = near {
        return (after.1 - before.1).norm();
    }
    let far = (near.0.or_else(|| line(at.saturating_sub(FAR)..=at.saturating_sub(2))), near.1.or_else(|| line(at + 5..=at + FAR)));
    let together = |(before, after): &(Line, Line)| (after.0 - before.0).norm() < TOGETHER_M;
    far.0.zip(far.1).filter(together).map_or(0.0, |(before, after)| (after.1 - before.1).norm())
}

/// Whether half of the places lie near their line: those on both sides of an impact do not.
fn is_straight(flight: &[(f64, Point3<f64>)]) -> bool {
    upper_median(flight.iter().map(|(t, p)| (p - straight_line(flight, *t).0).norm())).is_some_and(|miss| miss < STRAIGHT_M)
}

/// Where two flights meet in a gap.
struct Meeting {
    /// The last frame before it and the first after it.
    gap: (u64, u64),
    frame: u64,
    /// Change of the ball's velocity, m/s.
    jump: f64,
}

/// The gaps in which the flights before and after come together at the face, as the racket stands in the nearest frame that shows it, and turn the ball.
fn meetings(frames: &BTreeMap<u64, FrameView>, clock: FrameClock, at_face: impl Fn(&Point3<f64>) -> bool) -> Vec<Meeting> {
    let seen: Vec<(u64, (f64, Point3<f64>))> = frames.iter().filter_map(|(k, f)| Some((*k, (f.t, f.ball?.position)))).collect();
    let poses: Vec<(u64, Isometry3<f64>)> = frames.iter().filter_map(|(k, f)| Some((*k, f.pose?))).collect();
    let in_gap = |split: usize| {
        let gap @ (start, end) = (seen[split - 1].0, seen[split].0);
        if end - start < 2 || clock.time_s(end) - clock.time_s(start) > LONGEST_HIDDEN_S {
            return None;
        }
        let near = |end: u64, flight: &[(u64, (f64, Point3<f64>))]| flight.iter().filter(|(k, _)| k.abs_diff(end) < FAR).map(|(_, p)| *p).collect::<Vec<_>>();
        let flights = [near(start, &seen[..split]), near(end, &seen[split..])];
        if flights.iter().any(|flight| flight.len() < FEWEST_STEREO || !is_straight(flight)) {
            return None;
        }
        let meeting = |frame: u64| {
            let [before, after] = flights.each_ref().map(|flight| straight_line(flight, clock.time_s(frame)));
            let (_, racket) = poses.iter().min_by_key(|(seen, _)| seen.abs_diff(frame))?;
            let apart = (after.0 - before.0).norm();
            let at_face = at_face(&racket.inverse_transform_point(&center(&before.0, &after.0)));
            (apart < TOGETHER_M && at_face).then(|| (apart, Meeting { gap, frame, jump: (after.1 - before.1).norm() }))
        };
        let together = (start + 1..end).filter_map(meeting).min_by(|a, b| a.0.total_cmp(&b.0))?.1;
        Some(together).filter(|together| together.jump > LEAST_JUMP_M_S)
    };
    (1..seen.len()).filter_map(in_gap).collect()
}
