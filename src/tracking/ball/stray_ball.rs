//! Single balls that do not belong to the flight: another thing was taken for the ball where it left the picture, passed before
//! something like it, or was half hidden.
//!
//! A free ball's image moves smoothly: over a few frames a parabola in time holds it to some hundredths of a pixel. A point that its
//! neighbours, before and after or on one side alone, put elsewhere by more than five joint deviations is not the ball. Neighbours are
//! those of its own flight: none beyond the strings or a bounce ([`crate::tracking::ball::bounce`]).
//! Nothing is moved: a point stays as it was measured or goes.

use crate::calibration::CameraId;
use crate::footage::FrameSource;
use crate::median::upper_median;
use crate::tracking::ball::ball_track::BallFrame;
use crate::tracking::ball::bounce::Flights;
use crate::tracking::ball::contact_length::{LONGEST_CONTACT_S, SHORTEST_CONTACT_S};
use crate::tracking::pictures::shot_frames::AT_ONCE;
use crate::tracking::racket::racket_pose::View;
use crate::tracking::track_file::ImagePoint;
use nalgebra::{Matrix3, Matrix3x2, Vector2, Vector3};
use rayon::prelude::*;

/// Neighbours that a point is compared with, from how far away (frames), and fewest of them.
const NEIGHBOURS: usize = 10;
const FARTHEST: f64 = 12.0;
const FEWEST: usize = 6;
/// A stray is farther off than this, deviations.
const LIMIT: f64 = 5.0;
/// And farther than this, px: an outline that a line or a string pulls is measured again with the ball's model, which moves it by up
/// to 1.2 px; a centre that the model has found is final.
pub const OUTLINE_PX: f64 = 1.5;
pub const FINAL_PX: f64 = 0.6;
/// Frames within which another ball must be seen.
const LONELY: u64 = 4;
/// A camera that saw the ball this rarely in a stretch of flight saw no flight.
const SHORTEST: usize = 3;
/// Bend of a flight in a picture, px per frame² at 1000 frames a second, one deviation: gravity and drag of a fast ball make 0.01. Without it
/// a parabola through a few frames far away says nothing.
const BEND_PX: f64 = 0.015;
/// What a parabola is good to, px.
const PARABOLA_PX: f64 = 0.03;
/// Huber's limit, deviations.
const HUBER: f64 = 1.5;
/// Stretches of a flight over which one parabola holds it to a pixel, frames.
const STRETCH: usize = 30;
/// Most balls in a row that are compared with the rest of their stretch: more of them may be a flight of their own, after a bounce.
const LONGEST_RUN: usize = 10;
/// They are farther off than the first, px, and five of their deviations, where half of the stretch is nearer than the last to one parabola
const RUN_PX: f64 = 2.5;
/// that bends by no more than this, deviations of a flight's bend,
const MOST_BENT: f64 = 3.0;
/// px.
const HELD_PX: f64 = 1.2;

/// Takes away single sightings, and the points of balls in free flight that the flight itself rules out by more than `least_px`. Without a
/// contact nothing is known to fly freely.
pub fn drop_strays(source: &impl FrameSource, view: &View, ball: &mut [Option<BallFrame>], contact_frame: Option<f64>, frame_rate_hz: f64, least_px: f64) {
    drop_lonely(source, ball);
    let Some(contact) = contact_frame else { return };
    let bend_px = BEND_PX * (1000.0 / frame_rate_hz).powi(2);
    for free in Flights::of(source, view, ball, contact, frame_rate_hz).all() {
        // What the two cameras never see at once is no flight through both pictures.
        let flying: Vec<usize> = (0..ball.len()).filter(|i| ball[*i].is_some() && free.contains(&(source.number(*i) as f64 - contact))).collect();
        if flying.iter().all(|i| ball[*i].is_some_and(|b| !b.stereo)) {
            flying.iter().for_each(|i| ball[*i] = None);
        }
        for camera in CameraId::BOTH {
            let mut flight: Vec<(usize, f64, ImagePoint)> = ball
                .iter()
                .enumerate()
                .filter_map(|(i, b)| Some((i, source.number(i) as f64 - contact, b.as_ref()?.points[camera.index()]?)))
                .filter(|(_, frames, _)| free.contains(frames))
                .collect();
            if free.start == LONGEST_CONTACT_S * frame_rate_hz {
                let may_fly = SHORTEST_CONTACT_S * frame_rate_hz..free.start;
                let early = (0..ball.len()).filter_map(|i| {
                    let (b, frames) = (ball[i].filter(|b| b.flattening.is_none())?, source.number(i) as f64 - contact);
                    Some((i, frames, b.points[camera.index()]?)).filter(|_| may_fly.contains(&frames))
                });
                let early = already_flying(early.collect(), &flight, least_px, bend_px);
                flight.splice(0..0, early);
            }
            let runs = strayed_together(&flight.iter().map(|f| (f.1, f.2)).collect::<Vec<_>>(), bend_px);
            for k in runs.into_iter().rev() {
                BallFrame::forget(&mut ball[flight.remove(k).0], camera.index());
            }
            // Worst first: a stray spoils what its neighbours are compared with.
            for _ in 0..flight.len() / 4 {
                let points: Vec<(f64, ImagePoint)> = flight.iter().map(|f| (f.1, f.2)).collect();
                let strays: Vec<(usize, f64)> =
                    (0..points.len()).into_par_iter().with_max_len(AT_ONCE).filter_map(|k| Some((k, strayed(&points, k, least_px, bend_px)?))).collect();
                let Some((worst, _)) = strays.into_iter().max_by(|a, b| a.1.total_cmp(&b.1)).filter(|s| s.1 > LIMIT) else { break };
                let (index, ..) = flight.remove(worst);
                BallFrame::forget(&mut ball[index], camera.index());
            }
            let both: Vec<bool> = flight.iter().map(|f| ball[f.0].is_some_and(|b| b.stereo)).collect();
            for k in of_another_ball(&flight.iter().map(|f| (f.1, f.2)).collect::<Vec<_>>(), &both, bend_px).into_iter().rev() {
                BallFrame::forget(&mut ball[flight.remove(k).0], camera.index());
            }
            if flight.len() < SHORTEST {
                flight.iter().for_each(|f| BallFrame::forget(&mut ball[f.0], camera.index()));
            }
        }
    }
}

/// Of a ball that may still touch the strings, from where it already is on the way of its flight from them: the push that is left then is small.
fn already_flying(early: Vec<(usize, f64, ImagePoint)>, flight: &[(usize, f64, ImagePoint)], least_px: f64, bend_px: f64) -> Vec<(usize, f64, ImagePoint)> {
    let first: Vec<(f64, ImagePoint)> = flight.iter().take(NEIGHBOURS).map(|f| (f.1, f.2)).collect();
    let near: Vec<&(f64, ImagePoint)> = first.iter().collect();
    let flies = |(_, time, point): &(usize, f64, ImagePoint)| {
        let (expected, sd) = foretold(&near, *time, bend_px)?;
        Some((point.uv - expected).norm() < least_px.min(LIMIT * deviation(point).hypot(sd)))
    };
    let from = if near.len() < FEWEST { None } else { early.iter().position(|e| flies(e) == Some(true)) };
    early.into_iter().skip(from.unwrap_or(usize::MAX)).collect()
}

/// Takes away what a camera saw in one frame with nothing like it before or after: no ball shows so briefly.
fn drop_lonely(source: &impl FrameSource, ball: &mut [Option<BallFrame>]) {
    for camera in 0..2 {
        let shows = |i: &usize| ball[*i].as_ref().is_some_and(|b| b.points[camera].is_some());
        let seen: Vec<(usize, u64)> = (0..ball.len()).filter(shows).map(|i| (i, source.number(i))).collect();
        for (k, (index, number)) in seen.iter().enumerate() {
            let near = |other: Option<&(usize, u64)>| other.is_some_and(|o| o.1.abs_diff(*number) <= LONELY);
            if !near(k.checked_sub(1).and_then(|b| seen.get(b))) && !near(seen.get(k + 1)) {
                BallFrame::forget(&mut ball[*index], camera);
            }
        }
    }
}

/// Points of a flight that follow another thing for some frames, such as the edge of what hides the ball: neighbours that agree among themselves, and not
/// with the parabola through most of the stretch. In order.
fn strayed_together(points: &[(f64, ImagePoint)], bend_px: f64) -> Vec<usize> {
    let mut strays = Vec::new();
    for first in (0..points.len()).step_by(STRETCH) {
        // The last stretch reaches back, so that none is short.
        let first = first.min(points.len().saturating_sub(STRETCH));
        let stretch = &points[first..points.len().min(first + STRETCH)];
        let off = |k: &usize, curve: &Matrix3x2<f64>| {
            let (time, point) = &stretch[*k];
            (point.uv - curve.tr_mul(&powers(time - stretch[0].0))).norm()
        };
        let through = |chosen: &[usize]| {
            let (mut h, mut g) = (Matrix3::zeros(), Matrix3x2::zeros());
            for (time, point) in chosen.iter().map(|k| &stretch[*k]) {
                let row = powers(time - stretch[0].0);
                h += row * row.transpose();
                g += row * point.uv.transpose();
            }
            let curve = h.try_inverse()? * g;
            (curve.row(2).norm() < MOST_BENT * bend_px).then_some(curve)
        };
        let all: Vec<usize> = (0..stretch.len()).collect();
        if stretch.len() < FEWEST || through(&all).is_some_and(|curve| all.iter().all(|k| off(k, &curve) < HELD_PX)) {
            continue;
        }
        // Of the parabolas through three points far apart, the one that is nearest to most: a bent one may just hold some of either.
        let apart = (stretch.len() / 4).max(2);
        let triples = all.iter().flat_map(|i| (i + apart..stretch.len()).flat_map(move |j| (j + apart..stretch.len()).map(move |k| [*i, j, k])));
        let missed = |curve: &Matrix3x2<f64>| (0..stretch.len()).map(|k| off(&k, curve).min(HELD_PX)).sum::<f64>();
        let found = triples.filter_map(|three| through(&three)).map(|curve| (missed(&curve), curve));
        let Some((_, best)) = found.min_by(|a, b| a.0.total_cmp(&b.0)) else { continue };
        let near: Vec<usize> = all.iter().copied().filter(|k| off(k, &best) < HELD_PX).collect();
        let Some(curve) = through(&near).filter(|_| near.len() >= FEWEST && 2 * near.len() >= stretch.len()) else { continue };
        let far = |k: &usize| off(k, &curve) > RUN_PX.max(LIMIT * stretch[*k].1.sd.max());
        for run in all.chunk_by(|a, b| far(a) == far(b)).filter(|run| far(&run[0]) && run.len() <= LONGEST_RUN) {
            // Between what is far off and what is right, it has left the flight already.
            let leaving = |k: &usize| off(k, &curve) > HELD_PX;
            let (start, end) = (run[0], run[run.len() - 1] + 1);
            let before = (0..start).rev().take_while(leaving).last().unwrap_or(start);
            let after = (end..stretch.len()).take_while(leaving).last().map_or(end, |k| k + 1);
            strays.extend((before..after).map(|k| first + k));
        }
    }
    strays.sort_unstable();
    strays.dedup();
    strays
}

/// Points of one camera, long after the flight was lost or long before it was found, that are not where it puts the ball: another one flies there. In
/// order; `both` are those that both cameras saw.
fn of_another_ball(points: &[(f64, ImagePoint)], both: &[bool], bend_px: f64) -> Vec<usize> {
    let all: Vec<usize> = (0..points.len()).collect();
    let stretches: Vec<&[usize]> = all.chunk_by(|a, b| points[*b].0 - points[*a].0 <= FARTHEST).collect();
    let seen_by_both = |stretch: &&[usize]| stretch.iter().filter(|k| both[**k]).count();
    let Some(flight) = stretches.iter().copied().max_by_key(seen_by_both).filter(|flight| seen_by_both(flight) >= FEWEST) else { return Vec::new() };
    let elsewhere = |stretch: &&[usize]| {
        let (Some(first), Some(last)) = (stretch.first(), stretch.last()) else { return false };
        let later = *first > flight[0];
        let (time, point) = &points[if later { *first } else { *last }];
        let beside = if later { &flight[flight.len().saturating_sub(STRETCH)..] } else { &flight[..flight.len().min(STRETCH)] };
        let near: Vec<_> = beside.iter().map(|k| &points[*k]).collect();
        foretold(&near, *time, bend_px).is_some_and(|(expected, sd)| (point.uv - expected).norm() > RUN_PX.max(LIMIT * deviation(point).hypot(sd)))
    };
    stretches.into_iter().filter(|stretch| seen_by_both(stretch) == 0 && elsewhere(stretch)).flatten().copied().collect()
}

/// 1, t, t².
fn powers(t: f64) -> Vector3<f64> {
    Vector3::new(1.0, t, t * t)
}

/// Of a point about a parabola, px.
fn deviation(point: &ImagePoint) -> f64 {
    point.sd.max().hypot(PARABOLA_PX)
}

/// Where the parabola through points of a flight puts the ball at a time, and how well that is known, px.
fn foretold(near: &[&(f64, ImagePoint)], time: f64, bend_px: f64) -> Option<(Vector2<f64>, f64)> {
    let row = |t: f64| powers(t - time);
    let mut weights = vec![1.0; near.len()];
    let mut found: Option<(Vector2<f64>, f64)> = None;
    for _ in 0..4 {
        let (mut h, mut g) = (Matrix3::zeros(), Matrix3x2::zeros());
        for ((t, p), w) in near.iter().zip(&weights) {
            let (b, w) = (row(*t), w / deviation(p).powi(2));
            h += b * b.transpose() * w;
            g += b * p.uv.transpose() * w;
        }
        h[(2, 2)] += bend_px.powi(-2);
        let inverse = h.try_inverse()?;
        let curve = inverse * g;
        let misses: Vec<f64> = near.iter().map(|(t, p)| (p.uv - curve.tr_mul(&row(*t))).norm() / deviation(p)).collect();
        weights = misses.iter().map(|z| (HUBER / z.max(1e-9)).min(1.0)).collect();
        // The median length of two normal numbers is 1.18 deviations.
        let scale = (upper_median(misses)? / 1.18).max(1.0);
        found = Some((curve.row(0).transpose(), inverse[(0, 0)].sqrt() * scale));
    }
    found
}

/// How many deviations a point is from where its neighbours put it; `None` where they are too few, or it is near enough in px.
fn strayed(points: &[(f64, ImagePoint)], at: usize, least_px: f64, bend_px: f64) -> Option<f64> {
    let (time, point) = &points[at];
    let mut near: Vec<&(f64, ImagePoint)> = points.iter().enumerate().filter(|(k, p)| *k != at && (p.0 - time).abs() <= FARTHEST).map(|(_, p)| p).collect();
    near.sort_by(|a, b| (a.0 - time).abs().total_cmp(&(b.0 - time).abs()));
    near.truncate(NEIGHBOURS);
    if near.len() < FEWEST {
        return None;
    }
    let (expected, expected_sd) = foretold(&near, *time, bend_px)?;
    let miss = (point.uv - expected).norm();
    (miss > least_px).then(|| miss / deviation(point).hypot(expected_sd))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn flight(n: usize) -> Vec<(f64, ImagePoint)> {
        let noise = |k: usize| 0.03 * ((k * 7919 % 13) as f64 / 6.0 - 1.0);
        (0..n)
            .map(|k| {
                let t = k as f64 - n as f64;
                let uv = Vector2::new(200.0 + 6.0 * t + 0.01 * t * t + noise(k), 150.0 - 2.0 * t + 0.004 * t * t + noise(k + 5));
                (t, ImagePoint { uv, sd: Vector2::repeat(0.04) })
            })
            .collect()
    }

    #[test]
    fn truth_a_stray_at_the_end_or_amid_the_flight_is_told_and_no_true_ball_is() {
        for stray in [0, 9, 19] {
            let mut points = flight(20);
            assert!((0..20).all(|k| strayed(&points, k, FINAL_PX, BEND_PX).is_none()));
            points[stray].1.uv += Vector2::new(0.9, -0.8);
            let worst = (0..20).filter_map(|k| Some((k, strayed(&points, k, FINAL_PX, BEND_PX)?))).max_by(|a, b| a.1.total_cmp(&b.1)).expect("a stray");
            assert!(worst.0 == stray && worst.1 > LIMIT, "{stray}: {worst:?}");
        }
        // A point that knows how badly it is known stays.
        let mut points = flight(20);
        points[19].1 = ImagePoint { uv: points[19].1.uv + Vector2::new(0.6, 0.0), sd: Vector2::repeat(0.4) };
        assert!(strayed(&points, 19, FINAL_PX, BEND_PX).is_none_or(|z| z < LIMIT));
    }

    #[test]
    fn truth_a_run_that_follows_another_thing_goes_and_a_flight_of_its_own_stays() {
        for n in [16, 24, 75] {
            assert!(strayed_together(&flight(n), BEND_PX).is_empty());
            // The edge of what hides the ball, at its beginning, amid the flight, at its end.
            for first in [0, 5, n - 7] {
                let mut points = flight(n);
                for k in 0..7 {
                    points[first + k].1.uv += Vector2::new(1.0, -0.7) * (3.0 + (k as f64 - 3.0).abs());
                }
                assert_eq!(strayed_together(&points, BEND_PX), (first..first + 7).collect::<Vec<_>>(), "{n} {first}");
            }
        }
        // A bounce: from frame 12 on it rises.
        let mut points = flight(26);
        for (k, p) in points.iter_mut().enumerate().skip(12) {
            p.1.uv.y -= 4.0 * (k - 12) as f64;
        }
        assert!(strayed_together(&points, BEND_PX).is_empty(), "{:?}", strayed_together(&points, BEND_PX));
    }

    #[test]
    fn truth_a_ball_off_the_strings_sooner_than_the_longest_contact_is_of_the_flight_from_there_on() {
        let all: Vec<(usize, f64, ImagePoint)> = flight(24).into_iter().enumerate().map(|(k, (t, p))| (k, t, p)).collect();
        // Two frames in which the strings still push it, then four of its flight, one of them another thing's.
        let mut early = all[..6].to_vec();
        early[0].2.uv.x += 6.0;
        early[1].2.uv.x += 3.0;
        early[4].2.uv.y -= 2.5;
        let flying = already_flying(early.clone(), &all[6..], OUTLINE_PX, BEND_PX);
        assert_eq!(flying.iter().map(|f| f.0).collect::<Vec<_>>(), [2, 3, 4, 5]);
        assert!(already_flying(early, &all[6..9], OUTLINE_PX, BEND_PX).is_empty());
    }

    #[test]
    fn truth_another_ball_that_one_camera_sees_later_goes_and_the_same_one_stays() {
        let n = 60;
        let points = flight(n);
        let seen = |from: usize, of: &dyn Fn(usize) -> (f64, ImagePoint)| -> Vec<(f64, ImagePoint)> {
            points[..from].iter().copied().chain((40..n).map(of)).collect()
        };
        let other = |k: usize| {
            let uv = Vector2::new(180.0 - 2.0 * (k as f64 - 40.0), 140.0 - 1.5 * (k as f64 - 40.0));
            (points[k].0, ImagePoint { uv, ..points[k].1 })
        };
        for from in [12, 25] {
            let both: Vec<bool> = (0..from + 20).map(|k| k < from).collect();
            assert!(of_another_ball(&seen(from, &|k| points[k]), &both, BEND_PX).is_empty());
            assert_eq!(of_another_ball(&seen(from, &other), &both, BEND_PX), (from..from + 20).collect::<Vec<_>>());
            // What both cameras saw is no matter of one camera's flight.
            assert!(of_another_ball(&seen(from, &other), &vec![true; from + 20], BEND_PX).is_empty());
        }
    }

    #[test]
    fn fails_quietly_where_too_few_frames_show_the_flight() {
        let mut points = flight(6);
        points[5].1.uv.x += 5.0;
        assert!((0..6).all(|k| strayed(&points, k, FINAL_PX, BEND_PX).is_none()));
    }
}
