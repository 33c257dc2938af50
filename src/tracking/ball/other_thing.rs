//! One camera keeps the ball, the other goes over to another thing: a letter behind the strings, the edge of a panel.
//!
//! What the other sees may stand on the ball's epipolar line, and then two rays meet as they should; over a few frames it may even fly straight. But
//! in its own pictures a free ball moves along a line before the strings and along another one after them, and the second begins where the first
//! ended. Where one camera's point lies on its line the other's must do so too.

use crate::calibration::CameraId;
use crate::footage::FrameSource;
use crate::tracking::ball::ball_pieces::{foretold, met_at_strings, straight_pieces};
use crate::tracking::ball::ball_track::BallFrame;
use crate::tracking::ball::contact_length::{LONGEST_CONTACT_S, SHORTEST_CONTACT_S};
use crate::tracking::ball::shot_ball::Stage;
use crate::tracking::pictures::shot_frames::Shot;
use nalgebra::Vector2;

/// Frames before and after the contact over which a flight is a line in a picture, at 1000 frames a second: gravity and drag bend it by half a pixel
/// over so many.
const STRAIGHT: f64 = 24.0;
/// A point lies on a line that is this near, px: outlines before the light is known are good to half a pixel.
const ON_LINE_PX: f64 = 1.0;
/// Fewest points on a line, and how far apart two that tell one must be, frames.
const FEWEST: usize = 6;
const APART: f64 = 4.0;
/// The line after the contact begins this near to where the strings let the ball go, px.
const CONTINUES_PX: f64 = 4.0;
/// The contact may have begun so much earlier or later than the ball's places in space tell, s.
const BEGINS_S: [f64; 5] = [-3e-3, -2e-3, -1e-3, 0.0, 1e-3];
/// A camera keeps the ball when it has it this near to its line, px, and another thing is farther than that off it.
const KEEPS_PX: f64 = 1.5;
const OTHER_PX: f64 = 2.5;
/// The strings' greatest force is 1.6 times the mean one (half a sine).
const GREATEST_TO_MEAN: f64 = 1.6;

/// Where a point is in a camera's pictures while it moves evenly; times in frames.
#[derive(Debug, Clone, Copy)]
struct Line {
    at: f64,
    uv: Vector2<f64>,
    step: Vector2<f64>,
}

impl Line {
    fn place(&self, time: f64) -> Vector2<f64> {
        self.uv + self.step * (time - self.at)
    }
}

/// The ball's way through one camera's pictures, with time in frames from the contact.
#[derive(Debug, Clone, Copy)]
struct Way {
    before: Line,
    after: Line,
    frame_rate_hz: f64,
}

impl Way {
    /// The two lines on which most of a camera's points lie, of those that meet at the strings.
    fn of(points: &[(f64, Vector2<f64>)], frame_rate_hz: f64) -> Option<Self> {
        let (before, after): (Vec<_>, Vec<_>) = points.iter().partition(|p| p.0 < 0.0);
        let (before, after) = (lines(&before), lines(&after));
        let mut best: Option<(f64, Way)> = None;
        for (on_one, one) in &before {
            for (on_other, other) in &after {
                let way = Way { before: *one, after: *other, frame_rate_hz };
                if best.is_none_or(|b| on_one + on_other > b.0) && way.meets() {
                    best = Some((on_one + on_other, way));
                }
            }
        }
        best.map(|b| b.1)
    }

    /// Whether the ball leaves where the strings have taken it: an even force moves it with the mean of its velocities.
    fn meets(&self) -> bool {
        let off = |begins: f64, held: f64| self.before.place(begins) + (self.before.step + self.after.step) * (held / 2.0) - self.after.place(begins + held);
        let holds = [SHORTEST_CONTACT_S, LONGEST_CONTACT_S].map(|s| s * self.frame_rate_hz);
        let near = |begins: f64| holds.into_iter().any(|held| off(begins, held).norm() < CONTINUES_PX);
        BEGINS_S.into_iter().any(|begins| near(begins * self.frame_rate_hz))
    }

    fn off(&self, time: f64, uv: &Vector2<f64>) -> f64 {
        (uv - self.place(time)).norm()
    }

    /// How much the strings change the ball's step, px per frame.
    fn change(&self) -> f64 {
        (self.after.step - self.before.step).norm()
    }

    /// How far the strings may hold the ball off its way, px.
    fn held_off(&self, time: f64) -> f64 {
        let held = if time < BEGINS_S[0] * self.frame_rate_hz { 0.0 } else { (LONGEST_CONTACT_S * self.frame_rate_hz - time.max(0.0)).max(0.0) };
        GREATEST_TO_MEAN * self.change() / (SHORTEST_CONTACT_S * self.frame_rate_hz) * held * held / 2.0
    }

    /// Whether a point is another thing while `keeps`, the other camera, has the ball `off` px from its way there: the strings hold it off in
    /// both pictures in proportion to what they change.
    fn goes_over(&self, time: f64, uv: &Vector2<f64>, keeps: &Way, off: f64) -> bool {
        let as_in_the_other = (off + ON_LINE_PX) * self.change() / keeps.change().max(1e-9);
        off < KEEPS_PX && self.off(time, uv) > OTHER_PX + self.held_off(time).min(as_in_the_other)
    }

    fn place(&self, time: f64) -> Vector2<f64> {
        if time < 0.0 { self.before.place(time) } else { self.after.place(time) }
    }
}

/// Lines through pairs of points on which enough of them lie, with how many do; one at the line's edge counts little.
fn lines(points: &[(f64, Vector2<f64>)]) -> Vec<(f64, Line)> {
    let pairs = points.iter().flat_map(|a| points.iter().filter(|b| b.0 - a.0 >= APART).map(move |b| (a, b)));
    let line = |(a, b): (&(f64, Vector2<f64>), &(f64, Vector2<f64>))| {
        let line = Line { at: a.0, uv: a.1, step: (b.1 - a.1) / (b.0 - a.0) };
        let near = |(time, uv): &(f64, Vector2<f64>)| 1.0 - ((uv - line.place(*time)) / ON_LINE_PX).norm_squared();
        let (on, count) = points.iter().map(near).filter(|near| *near > 0.0).fold((0.0, 0), |(on, count), near| (on + near, count + 1));
        (count >= FEWEST).then_some((on, line))
    };
    pairs.filter_map(line).collect()
}

impl<S: FrameSource> Shot<'_, S> {
    /// Forgets what one camera saw elsewhere while the other kept the ball.
    pub(in crate::tracking) fn forget_other_things(&self, stage: &Stage, frames: &mut [Option<BallFrame>]) {
        let Some(first_contact) = self.comes_to_the_strings(stage, frames) else { return };
        let rate = self.setup.frame_rate_hz;
        let time = |index: usize| self.source.number(index) as f64 - first_contact;
        let near: Vec<usize> = (0..frames.len()).filter(|i| time(*i).abs() < STRAIGHT * rate / 1000.0).collect();
        let point = |index: usize, camera: CameraId| Some((time(index), frames[index].as_ref()?.points[camera.index()]?.uv));
        // As many points as at 1000 frames a second.
        let every = (rate / 1000.0).ceil().max(1.0) as usize;
        let ways = CameraId::BOTH.map(|camera| Way::of(&near.iter().step_by(every).filter_map(|i| point(*i, camera)).collect::<Vec<_>>(), rate));
        let [Some(left_way), Some(right_way)] = ways else { return };
        let gone = |index: &usize| {
            let (left, right) = (point(*index, CameraId::Left)?, point(*index, CameraId::Right)?);
            let off = [left_way.off(left.0, &left.1), right_way.off(right.0, &right.1)];
            if right_way.goes_over(right.0, &right.1, &left_way, off[0]) {
                Some((*index, CameraId::Right))
            } else {
                left_way.goes_over(left.0, &left.1, &right_way, off[1]).then_some((*index, CameraId::Left))
            }
        };
        let gone: Vec<(usize, CameraId)> = near.iter().filter_map(gone).collect();
        for (index, camera) in gone {
            BallFrame::forget(&mut frames[index], camera.index());
            if let Some(ball) = &mut frames[index]
                && let Some((place, _)) = self.view.triangulate(left_way.place(time(index)), right_way.place(time(index)))
            {
                ball.position = place;
            }
        }
    }

    /// Frame number at which the ball comes to the string plane; `None` where no flight before and after it is known.
    fn comes_to_the_strings(&self, stage: &Stage, frames: &[Option<BallFrame>]) -> Option<f64> {
        let pieces = straight_pieces(&self.sightings(frames, stage.racket), self.setup.frame_rate_hz);
        let [before, after] = met_at_strings(&pieces, self.setup.frame_rate_hz)?.map(|k| &pieces[k]);
        let (last, first) = (before.last()?, after.first()?);
        let side = last.in_racket?.z.signum();
        let there = |index: &usize| {
            let place = foretold(before, self.source.number(*index) as f64);
            self.sighting(*index, place, stage.racket[*index].as_ref()).in_racket.is_some_and(|p| side * p.z < stage.ball.radius_m)
        };
        Some((last.index..=first.index).find(there).map_or(last.number, |index| self.source.number(index) as f64))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Comes with 0.9 px a frame, is turned round by an even force over five frames, leaves with 1.1.
    fn ball(time: f64) -> Vector2<f64> {
        let held = time.clamp(0.0, 5.0);
        let along = -0.9 * time.min(0.0) - 0.9 * held + 2.0 * held * held / 10.0 + 1.1 * (time - 5.0).max(0.0);
        Vector2::new(267.0 + if time < 0.0 { -0.9 * time } else { along }, 194.0 - 0.3 * time.max(0.0))
    }

    #[test]
    fn truth_the_ball_is_told_from_letters_that_were_followed_for_as_long() {
        let seen = |k: i32| {
            let time = f64::from(k);
            let noise = 0.3 * (f64::from(k * 7919 % 13) / 6.0 - 1.0);
            // Two letters, one after the other.
            let uv = match k {
                2..=8 => Vector2::new(276.0, 193.0),
                9..=14 => Vector2::new(279.0, 190.4),
                _ => ball(time),
            };
            (time, uv + Vector2::new(noise, -noise))
        };
        let way = Way::of(&(-20..24).map(seen).collect::<Vec<_>>(), 1000.0).expect("a way");
        // The other camera sees the same ball before a plain wall.
        let keeps = Way::of(&(-20..24).map(|k| (f64::from(k), ball(f64::from(k)))).collect::<Vec<_>>(), 1000.0).expect("a way");
        let gone = |time: f64, uv: &Vector2<f64>| way.goes_over(time, uv, &keeps, keeps.off(time, &ball(time)));
        assert!((-20..24).map(f64::from).all(|time| !gone(time, &ball(time))));
        // Before that the strings hold the ball off the line in both.
        for (time, uv) in (3..12).map(seen) {
            assert!(gone(time, &uv), "{time}: {} px", (uv - ball(time)).norm());
        }
    }

    #[test]
    fn fails_quietly_where_no_two_lines_meet() {
        // Each for itself a line, but the ball cannot have gone from one to the other.
        let apart = |k: i32| (f64::from(k), Vector2::new(if k < 0 { 267.0 - 0.9 * f64::from(k) } else { 290.0 + 1.1 * f64::from(k) }, 194.0));
        assert!(Way::of(&(-20..24).map(apart).collect::<Vec<_>>(), 1000.0).is_none());
        assert!(Way::of(&[], 1000.0).is_none());
    }
}
