//! A half-volley: the court turns the ball so shortly before the strings that its last flight has a handful of frames.
//!
//! Too few for a piece of their own ([`crate::tracking::ball::bounce`]), they look like strays of the flight before. But a ball that is turned goes on
//! from where it was turned, straight, and both cameras see it leave its old way; a thing that is taken for it by one camera moves along the other's
//! line of sight.

use crate::tracking::ball::ball_way::StraightLine;
use nalgebra::{Point3, Vector3};

/// Half of the time that ball and court touch, s, 4.5 ms at most for a ball that is not at rest on it: meanwhile neither flight tells where it is.
pub const HALF_COURT_CONTACT_S: f64 = 0.00225;
/// The court turns it no longer before the strings than this, s: longer flights tell themselves. Times tried, s.
const EARLIEST_S: f64 = 0.014;
const STEP_S: f64 = 0.00025;
/// The flight before, as far as a straight line holds it to millimetres, s; fewest places of either flight.
const BEFORE_S: f64 = 0.012;
const FEWEST: [usize; 2] = [6, 3];
/// Least change of velocity, m/s, and in deviations of what the places' scatter about both lines makes of it.
const LEAST_TURN_M_S: f64 = 3.0;
const LEAST_SDS: f64 = 8.0;
/// Places are never better than this, m, whatever a few of them say.
const LEAST_SCATTER_M: f64 = 0.0005;
/// and none of the flight after is farther from its line than this, m.
const STRAIGHT_M: f64 = 0.006;
/// Both flights, drawn on, come this near to each other, m.
const TOGETHER_M: f64 = 0.02;
/// Least share of the way off the old flight that goes across a camera's line of sight.
const SEEN_BY_BOTH: f64 = 0.35;

/// The ways of a ball that the strings alone turn meet in the middle of the contact, or pass each other by what their push goes from side to side: at most 8 mm
/// in 82 rendered shots. By more than this, m, and so many deviations, it was turned elsewhere: 10 m/s are a centimetre for every millisecond.
pub const MOST_APART_M: f64 = 0.02;
pub const MOST_APART_SDS: f64 = 5.0;
/// Fewest places that tell a way, and the longest time between both, s.
const FEWEST_MEETING: usize = 5;
const LONGEST_UNSEEN_S: f64 = 0.025;

/// When the court turned the ball, s, if it did so shortly before the strings. `seen` are its places (time from first contact, s, below 0; m) in
/// order, `eyes` the cameras' places.
pub fn turned_late(seen: &[(f64, Point3<f64>)], eyes: &[Point3<f64>; 2]) -> Option<f64> {
    let steps = ((EARLIEST_S - HALF_COURT_CONTACT_S) / STEP_S) as usize;
    let tried = (0..=steps).filter_map(|k| Turn::at(seen, -HALF_COURT_CONTACT_S - STEP_S * k as f64, eyes));
    tried.min_by(|a, b| a.scatter_m.total_cmp(&b.scatter_m)).map(|turn| turn.t)
}

/// What is to be said of a ball that something else than the strings turned beside them, unseen. `before` and `after` are its places in free flight next
/// to the strings, in order, as above; `None` where its ways meet, as those of a ball do that the strings alone turned, or do not tell.
pub fn turned_unseen(before: &[(f64, Point3<f64>)], after: &[(f64, Point3<f64>)]) -> Option<String> {
    let last_t = before.last()?.0;
    let first_t = after.first()?.0;
    let before: Vec<_> = before.iter().copied().filter(|s| s.0 >= last_t - BEFORE_S).collect();
    let after: Vec<_> = after.iter().copied().filter(|s| s.0 <= first_t + BEFORE_S).collect();
    if before.len().min(after.len()) < FEWEST_MEETING || first_t - last_t > LONGEST_UNSEEN_S {
        return None;
    }
    let ways = TwoWays::through(&before, &after);
    let (t, apart_m) = (ways.t, ways.apart_m());
    let shares = [&before, &after].map(|flight| {
        let mean = mean_time(flight);
        (flight.len() as f64).recip() + (t - mean).powi(2) / spread(flight)
    });
    let sd_m = ways.scatter_m * (shares[0] + shares[1]).sqrt();
    (ways.turned().norm() > LEAST_TURN_M_S && apart_m > MOST_APART_M.max(MOST_APART_SDS * sd_m)).then(|| {
        format!(
            "the ball's ways before and after the strings pass each other by {:.0} mm: something else seems to have turned it beside them, unseen (the court, of a \
             half-volley); then velocity and spin at the strings are not those of the flights that were seen",
            1e3 * apart_m
        )
    })
}

/// Straight lines through two flights.
struct TwoWays {
    before: StraightLine,
    after: StraightLine,
    /// When they come nearest to each other, s.
    t: f64,
    /// Of the places about their lines, m.
    scatter_m: f64,
}

impl TwoWays {
    fn through(before: &[(f64, Point3<f64>)], after: &[(f64, Point3<f64>)]) -> Self {
        let [a, b] = [before, after].map(|flight| StraightLine::through(flight.iter().copied()));
        let turned = b.step - a.step;
        let t = -turned.dot(&(b.at(0.0) - a.at(0.0))) / turned.norm_squared().max(f64::MIN_POSITIVE);
        // Three coordinates a place, six numbers a line.
        let freedom = 3 * (before.len() + after.len()) - 12;
        let scatter_m = ((squares(before, &a) + squares(after, &b)) / freedom as f64).sqrt().max(LEAST_SCATTER_M);
        TwoWays { before: a, after: b, t, scatter_m }
    }

    /// Change of velocity, m/s.
    fn turned(&self) -> Vector3<f64> {
        self.after.step - self.before.step
    }

    fn apart_m(&self) -> f64 {
        (self.after.at(self.t) - self.before.at(self.t)).norm()
    }
}

struct Turn {
    t: f64,
    scatter_m: f64,
}

impl Turn {
    /// The turn at about a time, if it is one.
    fn at(seen: &[(f64, Point3<f64>)], about: f64, eyes: &[Point3<f64>; 2]) -> Option<Turn> {
        let within = |from: f64, to: f64| seen.iter().copied().filter(move |s| (from..=to).contains(&s.0));
        let before: Vec<_> = within(about - HALF_COURT_CONTACT_S - BEFORE_S, about - HALF_COURT_CONTACT_S).collect();
        let after: Vec<_> = within(about + HALF_COURT_CONTACT_S, 0.0).collect();
        if before.len() < FEWEST[0] || after.len() < FEWEST[1] {
            return None;
        }
        let ways = TwoWays::through(&before, &after);
        // The flights are those on both sides of where they meet.
        if (ways.t - about).abs() > STEP_S || ways.apart_m() > TOGETHER_M {
            return None;
        }
        let (t, scatter_m) = (ways.t, ways.scatter_m);
        let sd = scatter_m * (spread(&before).recip() + spread(&after).recip()).sqrt();
        let straight = after.iter().all(|s| (s.1 - ways.after.at(s.0)).norm() < STRAIGHT_M);
        let told = ways.turned().norm() > LEAST_TURN_M_S.max(LEAST_SDS * sd);
        let last = after.last()?;
        let off: Vector3<f64> = last.1 - ways.before.at(last.0);
        let seen_by_both = eyes.iter().all(|eye| off.cross(&(last.1 - eye).normalize()).norm() > SEEN_BY_BOTH * off.norm());
        (straight && told && seen_by_both).then_some(Turn { t, scatter_m })
    }
}

/// Sum of squared distances from a line, m².
fn squares(flight: &[(f64, Point3<f64>)], line: &StraightLine) -> f64 {
    flight.iter().map(|s| (s.1 - line.at(s.0)).norm_squared()).sum()
}

fn mean_time(flight: &[(f64, Point3<f64>)]) -> f64 {
    flight.iter().map(|s| s.0).sum::<f64>() / flight.len() as f64
}

/// Sum of squares of the times about their mean, s².
fn spread(flight: &[(f64, Point3<f64>)]) -> f64 {
    let mean = mean_time(flight);
    flight.iter().map(|s| (s.0 - mean).powi(2)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    const EYES: [Point3<f64>; 2] = [Point3::new(12.0, 1.3, 3.5), Point3::new(12.0, 1.3, -3.5)];

    /// A ball at 14 m/s that the court turns `at` so many ms before the strings within `lasting` ms, seen at `rate_hz`.
    fn ball(at: f64, lasting: f64, rate_hz: f64) -> Vec<(f64, Point3<f64>)> {
        let fine = 1e-5;
        let mut place = Point3::new(0.4, 0.2, 0.1);
        let (mut out, mut next) = (Vec::new(), 0.0);
        // From the strings backwards.
        for k in 0..2800 {
            let t = -fine * f64::from(k);
            if -t >= next {
                let noise = 0.001 * (f64::from(out.len() as i32 * 7919 % 13) / 6.0 - 1.0);
                out.push((t - 2e-4, place + Vector3::new(noise, 0.3 * noise, -0.5 * noise)));
                next += 1.0 / rate_hz;
            }
            let turned = ((t * 1e3 + at) / lasting + 0.5).clamp(0.0, 1.0);
            let velocity = Vector3::new(-14.0, -6.0, 1.0).lerp(&Vector3::new(-11.0, 4.0, 1.0), turned);
            place -= (velocity + Vector3::new(0.0, -9.8 * t, 0.0)) * fine;
        }
        out.reverse();
        out
    }

    #[test]
    fn truth_a_ball_that_the_court_turns_shortly_before_the_strings_is_told() {
        for rate_hz in [1000.0, 2000.0, 4000.0] {
            for at in [5.5, 6.0, 7.0, 8.0, 10.0] {
                for lasting in [0.1, 4.0] {
                    let told = turned_late(&ball(at, lasting, rate_hz), &EYES);
                    assert!(told.is_some_and(|t| (t + 1e-3 * at).abs() < 1e-3), "{rate_hz} {at} {lasting}: {told:?}");
                }
            }
            // Long before.
            assert_eq!(turned_late(&ball(90.0, 4.0, rate_hz), &EYES), None);
        }
    }

    #[test]
    fn truth_a_ball_that_was_turned_unseen_is_told_and_one_that_the_strings_turned_is_not() {
        // Leaves after 5 ms, from where it has come to meanwhile.
        let leaves = |seen: &[(f64, Point3<f64>)]| -> Vec<(f64, Point3<f64>)> {
            let (out, [.., b, a]) = (Vector3::new(25.0, 5.0, 2.0), seen) else { panic!("places") };
            let step = (a.1 - b.1) / (a.0 - b.0);
            let there = a.1 - step * a.0 + (step + out) * 0.0025;
            (6..18).map(|k| 1e-3 * f64::from(k)).map(|t| (t, there + out * (t - 0.005))).collect()
        };
        let straight = ball(90.0, 4.0, 1000.0);
        assert_eq!(turned_unseen(&straight, &leaves(&straight)), None);
        for at in [1.5, 3.0, 5.0] {
            let seen = ball(at, 3.0, 1000.0);
            let before: Vec<_> = seen.iter().copied().filter(|s| s.0 < -1e-3 * at - 1.5e-3).collect();
            assert!(turned_unseen(&before, &leaves(&ball(at, 0.1, 4000.0))).is_some(), "{at}");
        }
    }

    #[test]
    fn truth_what_one_camera_takes_for_the_ball_is_no_bounce() {
        for (eye, other) in [(0, 1), (1, 0)] {
            let mut seen = ball(90.0, 4.0, 1000.0);
            let n = seen.len();
            for (k, (_, place)) in seen.iter_mut().skip(n - 5).enumerate() {
                // Where it meets the line of sight of the camera that is right.
                *place += (EYES[other] - *place).normalize() * (0.008 * k as f64);
            }
            assert_eq!(turned_late(&seen, &EYES), None, "{eye}");
        }
    }
}
