//! Where the ball is turned off the strings: by the court before a half-volley, or after the stroke.
//!
//! A flight is smooth, and spin and cover stay, until something turns the ball. What neighbours say about a ball holds on their own side of a
//! bounce alone: asked across it, a dozen true places on either side would be strays, and a spin the mean of two. As at the strings, it is
//! told by two free flights that come together, part, and do not go on as one.

use crate::calibration::CameraId;
use crate::footage::FrameSource;
use crate::tracking::ball::ball_choice::Sighting;
use crate::tracking::ball::ball_pieces::{LONGEST_STEP, Piece, straight_pieces};
use crate::tracking::ball::ball_track::BallFrame;
use crate::tracking::ball::ball_way::{OF_LINE, StraightLine};
use crate::tracking::ball::contact_length::LONGEST_CONTACT_S;
use crate::tracking::ball::half_volley::{HALF_COURT_CONTACT_S, turned_late, turned_unseen};
use crate::tracking::racket::racket_pose::View;
use nalgebra::Point3;
use std::ops::Range;

/// Least change of velocity, m/s: what bends a dozen frames' line less is gravity, air or the errors of depth.
const LEAST_TURN_M_S: f64 = 3.0;
/// Both flights, drawn on, come this near to each other, m: the court turns along and across the ball's way in one push, and depths are good to
/// some millimetres.
const TOGETHER_M: f64 = 0.02;
/// The last and first sightings of a piece may be the other flight's already.
const ASTRAY: usize = 3;
/// Half of the time that ball and court may touch, s: meanwhile neither flight tells where it is.
const HALF_CONTACT_S: f64 = 0.5 * LONGEST_CONTACT_S;
/// Frames a second of which a turn is asked at most, as at the strings: the line through a dozen closer ones is too short to tell it.
const TURN_HZ: f64 = 1000.0;
/// More sightings than these are a flight wherever they are; fewer, which may be the edge of what hides the ball, only next to the strings.
const LONGEST_RUN: usize = 10;

/// The free flights of a ball: frames before or after first contact, which no place beyond them is compared with.
#[derive(Debug, Clone, PartialEq)]
pub struct Flights {
    /// By side of the contact, in time.
    sides: [Vec<Range<f64>>; 2],
}

impl Flights {
    /// Those of a ball that meets the strings at a (fractional) frame, from where both cameras saw it.
    pub fn of(source: &impl FrameSource, view: &View, ball: &[Option<BallFrame>], contact: f64, frame_rate_hz: f64) -> Self {
        let place = |(index, ball): (usize, &Option<BallFrame>)| {
            let place = ball.as_ref().filter(|b| b.stereo)?.position;
            Some(Sighting { index, number: source.number(index) as f64 - contact, place, in_racket: None })
        };
        Self::through(&ball.iter().enumerate().filter_map(place).collect::<Vec<_>>(), &CameraId::BOTH.map(|camera| *view.eye(camera)), frame_rate_hz)
    }

    /// The same from sightings whose numbers count from first contact, by cameras at the places `eyes`.
    fn through(seen: &[Sighting], eyes: &[Point3<f64>; 2], frame_rate_hz: f64) -> Self {
        let free = LONGEST_CONTACT_S * frame_rate_hz;
        let (half, court) = (HALF_CONTACT_S * frame_rate_hz, HALF_COURT_CONTACT_S * frame_rate_hz);
        let side = |ends: Range<f64>, beside: f64| {
            let own: Vec<Sighting> = seen.iter().filter(|s| ends.contains(&s.number)).copied().collect();
            let mut flights = Vec::new();
            let mut start = ends.start;
            let timed: Vec<(f64, Point3<f64>)> = own.iter().map(|s| (s.number / frame_rate_hz, s.place)).collect();
            let late = if ends.end <= 0.0 { turned_late(&timed, eyes).map(|t| t * frame_rate_hz) } else { None };
            // What is told both ways is better known by all of its frames.
            let told = bounces(&own, beside, frame_rate_hz).into_iter().filter(|told| late.is_none_or(|late| late - told > 2.0 * half));
            for (bounce, half) in told.map(|told| (told, half)).chain(late.map(|late| (late, court))) {
                flights.push(start..bounce - half);
                start = bounce + half;
            }
            flights.push(start..ends.end);
            flights
        };
        Flights { sides: [side(f64::NEG_INFINITY..0.0, 0.0), side(free..f64::INFINITY, free)] }
    }

    /// All of them, in frames from first contact.
    pub fn all(&self) -> impl Iterator<Item = &Range<f64>> {
        self.sides.iter().flatten()
    }

    /// For how many frames the ball flies freely up to first contact, and from there on.
    pub fn beside_the_strings(&self) -> [f64; 2] {
        let [before, after] = &self.sides;
        [before.last().map_or(f64::INFINITY, |flight| -flight.start), after.first().map_or(f64::INFINITY, |flight| flight.end)]
    }
}

/// What is to be said of a ball that something else than the strings turned beside them, unseen ([`turned_unseen`]).
pub fn turned_unseen_words(source: &impl FrameSource, view: &View, ball: &[Option<BallFrame>], contact: f64, frame_rate_hz: f64) -> Option<String> {
    let beside = Flights::of(source, view, ball, contact, frame_rate_hz).beside_the_strings();
    let places = |from: f64, to: f64| -> Vec<(f64, Point3<f64>)> {
        let place = |(index, ball): (usize, &Option<BallFrame>)| {
            let frames = source.number(index) as f64 - contact;
            let place = ball.as_ref().filter(|b| b.stereo && (from..to).contains(&frames))?.position;
            Some((frames / frame_rate_hz, place))
        };
        ball.iter().enumerate().filter_map(place).collect()
    };
    turned_unseen(&places(-beside[0], 0.0), &places(LONGEST_CONTACT_S * frame_rate_hz, beside[1]))
}

/// The frames in which sightings of one side of the contact show a bounce; `beside` is that side's end at the strings.
fn bounces(seen: &[Sighting], beside: f64, frame_rate_hz: f64) -> Vec<f64> {
    let every = (frame_rate_hz / TURN_HZ).round().max(1.0);
    let mut taken = f64::NEG_INFINITY;
    let thinned = seen.iter().filter(|s| {
        let next = s.number >= taken + every - 0.5;
        taken = if next { s.number } else { taken };
        next
    });
    let thinned: Vec<Sighting> = thinned.map(|s| Sighting { number: s.number / every, ..*s }).collect();
    let (rate_hz, beside) = (frame_rate_hz / every, beside / every);
    let mut out = Vec::new();
    let mut flight = Piece::new();
    let is_flight = |flight: &[Sighting]| {
        let at_strings = |s: Option<&Sighting>| s.is_some_and(|s| (s.number - beside).abs() <= LONGEST_STEP + ASTRAY as f64);
        flight.len() > LONGEST_RUN || at_strings(flight.first()) || at_strings(flight.last())
    };
    for piece in straight_pieces(&thinned, rate_hz) {
        match turn(&flight, &piece, rate_hz) {
            // It goes straight on, or nobody knows what was between.
            Turn::None => flight.extend(piece),
            Turn::Elsewhere => flight = piece,
            Turn::At(number) => {
                if is_flight(&flight) && is_flight(&piece) {
                    out.push(every * number);
                }
                flight = piece;
            }
        }
    }
    out
}

#[derive(Debug, PartialEq)]
enum Turn {
    None,
    /// The two do not come together.
    Elsewhere,
    At(f64),
}

/// Where one flight goes over into the next.
fn turn(before: &[Sighting], after: &[Sighting], frame_rate_hz: f64) -> Turn {
    let [Some(last), Some(first)] = [before.last(), after.first()] else { return Turn::None };
    let line = |seen: &[Sighting]| StraightLine::through(seen.iter().map(|s| (s.number, s.place)));
    let astray = |flight: &[Sighting]| ASTRAY.min(flight.len().saturating_sub(ASTRAY));
    let (own, next) = (&before[..before.len() - astray(before)], &after[astray(after)..]);
    let (a, b) = (line(&own[own.len().saturating_sub(OF_LINE)..]), line(&next[..next.len().min(OF_LINE)]));
    let turned = b.step - a.step;
    if turned.norm() * frame_rate_hz < LEAST_TURN_M_S {
        return Turn::None;
    }
    let number = first.number - turned.dot(&(b.at(first.number) - a.at(first.number))) / turned.norm_squared();
    let unseen = first.number - last.number;
    let between = last.number - 2.0 * ASTRAY as f64..first.number + ASTRAY as f64;
    let meets = (a.at(number) - b.at(number)).norm() < TOGETHER_M && between.contains(&number);
    if meets && unseen <= LONGEST_STEP + LONGEST_CONTACT_S * frame_rate_hz { Turn::At(number) } else { Turn::Elsewhere }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;

    const EYES: [Point3<f64>; 2] = [Point3::new(12.0, 1.3, 3.5), Point3::new(12.0, 1.3, -3.5)];

    /// A ball that comes at 14 m/s, is turned by the court `at` so many ms before the strings within `lasting` ms, and leaves at 25.
    fn ball(at: f64, lasting: f64, rate_hz: f64) -> Vec<Sighting> {
        let velocity = |ms: f64| {
            let turned = ((ms + at) / lasting + 0.5).clamp(0.0, 1.0);
            let risen = Vector3::new(-0.014, -0.006, 0.001).lerp(&Vector3::new(-0.011, 0.004, 0.001), turned);
            if ms < 0.0 { risen } else { Vector3::new(0.025, 0.003, 0.0) }
        };
        let fine = 0.01;
        let mut place = Point3::new(0.9, 0.4, 0.1);
        let (mut out, mut ms) = (Vec::new(), -75.0);
        for k in 0..11_000 {
            let frame = k as f64 * fine * rate_hz / 1000.0;
            if (frame - frame.round()).abs() < 1e-6 && !(0.0..6.0).contains(&ms) {
                let noise = Vector3::new(0.0, 0.0, 0.003 * ((k / 50 * 7919 % 13) as f64 / 6.0 - 1.0));
                out.push(Sighting { index: out.len(), number: ms * rate_hz / 1000.0, place: place + noise, in_racket: None });
            }
            place += velocity(ms + 0.5 * fine) * fine;
            ms += fine;
        }
        out
    }

    #[test]
    fn truth_a_bounce_is_told_at_any_frame_rate_and_no_other_turn_is() {
        for rate_hz in [500.0, 1000.0, 4000.0] {
            // Three frames after the court must show it.
            for at in [6.0, 8.0, 10.0, 16.0, 24.0, 50.0].into_iter().filter(|at| (at - 1000.0 * HALF_COURT_CONTACT_S) * rate_hz > 3000.0) {
                for lasting in [0.1, 4.5] {
                    let free = Flights::through(&ball(at, lasting, rate_hz), &EYES, rate_hz).beside_the_strings();
                    let expected = (at - 1000.0 * HALF_CONTACT_S) * rate_hz / 1000.0;
                    assert!((free[0] - expected).abs() < 2.0 * rate_hz / 1000.0, "{rate_hz} {at} {lasting}: {} {expected}", free[0]);
                    assert!(free[1].is_infinite());
                }
            }
            // Before the clip began.
            assert!(Flights::through(&ball(200.0, 4.5, rate_hz), &EYES, rate_hz).all().count() == 2, "{rate_hz}");
        }
    }

    #[test]
    fn truth_a_run_that_follows_another_thing_is_no_bounce() {
        let mut seen = ball(200.0, 4.5, 1000.0);
        for (k, s) in seen.iter_mut().enumerate().skip(30).take(9) {
            s.place += Vector3::new(0.0, 0.008, 0.0) * (k - 29) as f64;
        }
        assert!(Flights::through(&seen, &EYES, 1000.0).all().count() == 2);
    }
}
