//! The ball's way through the contact, foretold from its free flights before and after it.
//!
//! While the strings push it as half a sine over time (Brody 2000, thesis equation 2.21), the ball goes from one straight line over to the
//! other, and the two lines, drawn on, meet in the middle of the contact. That is good to some millimetres: what is followed farther
//! from there is another thing, and where the pressed ball was lost it may be looked for.

use crate::calibration::CameraId;
use crate::footage::FrameSource;
use crate::tracking::ball::ball_pieces::foretold;
use crate::tracking::ball::ball_track::{BallFrame, BallScene};
use crate::tracking::ball::contact_length::{LONGEST_CONTACT_S, SHORTEST_CONTACT_S};
use crate::tracking::pictures::shot_frames::Shot;
use crate::tracking::racket::racket_scene::RacketFrame;
use nalgebra::{Point3, Vector3};
use std::f64::consts::PI;

/// The flights must be known this near to the contact, s.
const KNOWN_NEAR_S: f64 = 0.012;
/// Flights that miss each other by more are not those of one ball, m, nor those that meet sooner or later than so many shortest or longest
/// contacts after first contact.
const MEET_M: f64 = 0.01;
const MEET_BETWEEN: (f64, f64) = (0.3, 0.7);
/// What is farther from its way than this is no ball, px: half for the way, the rest for a circle that is fitted to a pressed ball.
const OFF_PX: f64 = 2.5;

/// Numbers are those of frames.
#[derive(Debug, Clone, Copy)]
pub struct ThroughContact {
    first: f64,
    length: f64,
    /// Place at first contact, way per frame before, and how that changes.
    place: Point3<f64>,
    step: Vector3<f64>,
    turn: Vector3<f64>,
    /// What the second line is off where contact ends, m.
    off: Vector3<f64>,
}

impl ThroughContact {
    /// From two lines, place and way per frame at the number of first contact, and the shortest and the longest contact in frames.
    fn between(first: f64, before: (Point3<f64>, Vector3<f64>), after: (Point3<f64>, Vector3<f64>), lengths: [f64; 2]) -> Option<Self> {
        let (apart, turn) = (after.0 - before.0, after.1 - before.1);
        let middle = -apart.dot(&turn) / turn.norm_squared();
        let meet = (MEET_BETWEEN.0 * lengths[0]..MEET_BETWEEN.1 * lengths[1]).contains(&middle);
        if !(meet && (apart + turn * middle).norm() < MEET_M) {
            return None;
        }
        let length = (2.0 * middle).clamp(lengths[0], lengths[1]);
        let off = apart + turn * (0.5 * length);
        Some(ThroughContact { first, length, place: before.0, step: before.1, turn, off })
    }

    /// Where the ball is in a frame, from first contact on.
    pub fn at(&self, number: f64) -> Point3<f64> {
        let n = number - self.first;
        let t = (n / self.length).clamp(0.0, 1.0);
        let turned = if n < self.length { 0.5 * n - self.length / (2.0 * PI) * (PI * t).sin() } else { n - 0.5 * self.length };
        self.place + self.step * n + self.turn * turned + self.off * (t * t * (3.0 - 2.0 * t))
    }
}

impl<S: FrameSource> Shot<'_, S> {
    /// The way from first contact (a frame's number) on; `None` where the flights do not tell it.
    pub(in crate::tracking) fn through_contact(&self, racket: &[Option<RacketFrame>], ball: &[Option<BallFrame>], first: f64) -> Option<ThroughContact> {
        let rate = self.setup.frame_rate_hz;
        let number = |index: usize| self.source.number(index) as f64;
        let start = (0..ball.len()).find(|i| number(*i) >= first)?;
        let end = (start..ball.len()).find(|i| number(*i) >= first + LONGEST_CONTACT_S * rate)?;
        let line = |forth: bool| {
            let (_, piece) = self.known_beside(ball, racket, &(start..end), forth);
            let near = piece.last().is_some_and(|s| (s.number - first).abs() < KNOWN_NEAR_S * rate);
            near.then(|| (foretold(&piece, first), foretold(&piece, first + 1.0) - foretold(&piece, first)))
        };
        ThroughContact::between(first, line(true)?, line(false)?, [SHORTEST_CONTACT_S, LONGEST_CONTACT_S].map(|s| s * rate))
    }

    /// Takes away what cannot be the ball where the strings have it.
    pub(in crate::tracking) fn keep_to_the_way(&self, scene: &BallScene, way: &ThroughContact, ball: &mut [Option<BallFrame>], during: &[usize]) {
        for index in during {
            let there = way.at(self.source.number(*index) as f64);
            for camera in CameraId::BOTH {
                let seen = ball[*index].as_ref().and_then(|b| b.points[camera.index()]);
                let expected = scene.view.project(camera, &there);
                if seen.zip(expected).is_some_and(|(seen, expected)| (seen.uv - expected).norm() > OFF_PX) {
                    BallFrame::forget(&mut ball[*index], camera.index());
                    if let Some(left) = &mut ball[*index] {
                        left.position = there;
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn truth_a_ball_pushed_as_half_a_sine_goes_the_way_foretold() {
        // Stepped: 5 frames of contact from frame 20.3, in at -25 mm a frame, out at 30 mm and with some way across.
        let (first, length) = (20.3, 5.0);
        let (step, turn) = (Vector3::new(0.0, 0.002, -0.025), Vector3::new(0.004, 0.0, 0.055));
        let place = Point3::new(0.1, 1.0, 0.033);
        let steps = 20_000;
        let dt = length / f64::from(steps);
        let (mut at, mut velocity) = (place, step);
        let mut middle = place;
        for k in 0..steps {
            let t = dt * (f64::from(k) + 0.5);
            velocity += turn * (0.5 * PI / length * (PI * t / length).sin() * dt);
            at += velocity * dt;
            if k == steps * 2 / 5 {
                middle = at;
            }
        }
        let way = ThroughContact::between(first, (place, step), (at - velocity * length, velocity), [4.0, 6.5]).expect("they meet");
        assert!((way.at(first + 2.0) - middle).norm() < 1e-4 && (way.at(first + length) - at).norm() < 1e-4, "{way:?}");
        assert!((way.at(first + 6.0) - (at + velocity)).norm() < 1e-4);
        // Lines that pass each other are of two balls.
        let aside = at - velocity * length + Vector3::new(0.06, 0.0, 0.0);
        assert!(ThroughContact::between(first, (place, step), (aside, Vector3::new(0.0, 0.0, 0.03)), [4.0, 6.5]).is_none());
    }
}
