//! Which of the things that were followed is the ball.
//!
//! Half a dozen things may be followed for a while: marks on the strings, the throat seen through the frame, clutter that strings and frame
//! pass before. The ball meets the racket, comes from farther away or leaves it, keeps no place in the racket's axes, and but for the few
//! frames on the strings it flies freely.

use nalgebra::Point3;
use std::ops::Range;

/// A ball in play comes this much nearer to the racket (or goes away by it) while it is seen, m: 10 m/s over six frames.
const LEAST_APPROACH_M: f64 = 0.06;
/// What is nearer to the stringbed's centre counts as being there, and more of an approach than this tells nothing more, m.
const AT_THE_STRINGS_M: f64 = 0.15;
const MOST_APPROACH_M: f64 = 0.5;
/// Weights of the approach and of a frame of free flight, m, and frames beyond which more tell nothing. On rendered sessions of 75 shots
/// each true flight then stands before all other things.
const APPROACH: f64 = 0.1;
const FREE_FRAME_M: f64 = 0.004;
const MOST_FREE: usize = 25;
/// Of a long clip these count as well, for what comes as much nearer as counts: nothing but a ball flies so far for so long.
const LONG_FREE: Range<usize> = 50..100;
/// In free flight a place lies this near to the line through its neighbours, m: outlines found without the light are good to half a pixel.
pub const ON_LINE_M: f64 = 0.0075;
/// Neighbours on a line are at most so many frames apart.
const LONGEST_LINE: f64 = 4.0;
/// A ball this near to the stringbed's centre may be turned round at any moment, m.
const AT_THE_RACKET_M: f64 = 0.4;
/// No other ball is looked for when this one came from afar to the strings and flew freely in most of its frames.
const CLEAR_M: f64 = 0.13;
const CLEAR_SHARE: f64 = 0.55;
/// What never comes this near, m, must fly freely in half of its frames, and in so many, and change its distance by this, m: a ball that misses
/// the racket flies past, and what is carried along near it stays. A wrong ball may turn the racket's face round; none does not.
const AWAY_M: f64 = 0.25;
const FEWEST_AWAY: usize = 10;
const LEAST_PASSAGE_M: f64 = 0.2;
/// Slowest a ball comes to the racket or leaves it, m/s, the distance at which it may have moved, by rays good to some pixels in depth, and at
/// which it surely has: what stays nearer to its place in the racket's axes is a part of the racket, or is seen through it.
const SLOWEST_M_S: f64 = 3.0;
const MAY_HAVE_MOVED_M: f64 = 0.025;
const SURELY_MOVED_M: f64 = 0.06;

/// A thing both cameras saw in one frame.
#[derive(Debug, Clone, Copy)]
pub struct Sighting {
    /// Of the frame in the clip.
    pub index: usize,
    /// Frame number.
    pub number: f64,
    pub place: Point3<f64>,
    /// In the racket's axes, where the racket was seen.
    pub in_racket: Option<Point3<f64>>,
}

impl Sighting {
    /// Whether a ball there may be turned round at any moment.
    pub fn at_the_racket(&self) -> bool {
        self.in_racket.is_some_and(|p| p.coords.norm() < AT_THE_RACKET_M)
    }
}

/// How much like the ball a thing is.
#[derive(Debug, Clone, Copy)]
pub struct Likeness {
    /// Less is more like it, m; infinite for what is no ball.
    pub score: f64,
    /// Nothing else need be looked for.
    pub clear: bool,
}

/// Judges a thing by where both cameras saw it; `frames` is in how many either of them did.
pub fn likeness(seen: &[Sighting], frames: usize, frame_rate_hz: f64) -> Likeness {
    let (near, far) = nearest_and_farthest(seen.iter());
    let in_flight: Vec<&Sighting> = seen.windows(3).filter(|three| on_line(three)).map(|three| &three[1]).collect();
    let free = in_flight.len();
    // Who went over from one thing to another has not flown past.
    let passage = || {
        let (near, far) = nearest_and_farthest(in_flight.iter().copied());
        far - near
    };
    let none = Likeness { score: f64::INFINITY, clear: false };
    if far - near < LEAST_APPROACH_M
        || !moves_in_racket(seen, frame_rate_hz)
        || near > AWAY_M && (2 * free < seen.len() || free < FEWEST_AWAY || passage() < LEAST_PASSAGE_M)
    {
        return none;
    }
    // The nearest counts, then who came from farther away, then the longer flight.
    let met = near.max(AT_THE_STRINGS_M) - APPROACH * (far - near).min(MOST_APPROACH_M);
    let long = if far - near < MOST_APPROACH_M { 0 } else { free.clamp(LONG_FREE.start, LONG_FREE.end) - LONG_FREE.start };
    Likeness { score: met - FREE_FRAME_M * (free.min(MOST_FREE) + long) as f64, clear: met < CLEAR_M && free as f64 >= CLEAR_SHARE * frames as f64 }
}

/// Whether a thing moves in the racket's axes as a ball does; without a racket nothing speaks against it.
pub fn moves_in_racket(seen: &[Sighting], frame_rate_hz: f64) -> bool {
    let local: Vec<(f64, Point3<f64>)> = seen.iter().filter_map(|s| Some((s.number, s.in_racket?))).collect();
    let ([first, ..], [.., last]) = (local.as_slice(), local.as_slice()) else { return true };
    let needed = (SLOWEST_M_S * (last.0 - first.0) / frame_rate_hz).clamp(MAY_HAVE_MOVED_M, SURELY_MOVED_M);
    local.iter().any(|(_, p)| (p - first.1).norm() > needed)
}

/// Distances from the stringbed's centre.
fn nearest_and_farthest<'a>(seen: impl Iterator<Item = &'a Sighting>) -> (f64, f64) {
    let distances = seen.filter_map(|s| Some(s.in_racket?.coords.norm()));
    distances.fold((f64::INFINITY, 0.0), |(near, far): (f64, f64), d| (near.min(d), far.max(d)))
}

/// Whether the middle one of three sightings lies on the line through the others.
pub fn on_line(three: &[Sighting]) -> bool {
    let [a, b, c] = three else { return false };
    let there = a.place + (c.place - a.place) * ((b.number - a.number) / (c.number - a.number));
    c.number - a.number <= LONGEST_LINE && (b.place - there).norm() < ON_LINE_M
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A racket that moves by 20 mm a frame along x.
    fn seen(of: impl Fn(f64) -> Point3<f64>) -> Vec<Sighting> {
        (0..40)
            .map(|k| {
                let (number, place) = (f64::from(k), of(f64::from(k)));
                Sighting { index: k as usize, number, place, in_racket: Some(place - nalgebra::Vector3::x() * 0.02 * number) }
            })
            .collect()
    }

    #[test]
    fn truth_a_ball_is_told_from_what_goes_with_the_racket_and_from_what_leaps_about() {
        // Comes at 30 mm a frame against the racket, turns, leaves at 50.
        let ball = seen(|t| Point3::new(0.4 + if t < 20.0 { -0.03 * (t - 20.0) } else { 0.05 * (t - 20.0) }, 0.05, 0.0));
        // Between markers 4 and 5, its depth known to 2 cm.
        let throat = seen(|t| Point3::new(-0.25 + 0.02 * t, 0.0, if t as i64 % 2 == 0 { 0.01 } else { -0.01 }));
        let leaping = seen(|t| Point3::new(0.02 * t, 0.0, 0.05 * f64::from((5 * t as i32 * t as i32) % 13)));
        let [ball_is, throat_is, leaping_is] = [&ball, &throat, &leaping].map(|s| likeness(s, 40, 1000.0));
        assert!(ball_is.clear && throat_is.score.is_infinite(), "{ball_is:?} {throat_is:?}");
        assert!(ball_is.score < leaping_is.score - 0.05 && !leaping_is.clear, "{ball_is:?} {leaping_is:?}");
        assert!(moves_in_racket(&ball, 1000.0) && !moves_in_racket(&throat, 1000.0));
        // A tenth of a second of free flight, lost 0.3 m before the strings, is more like it than some frames near them.
        let at = |number: f64, x: f64| Sighting { index: number as usize, number, place: Point3::new(x, 0.0, 0.0), in_racket: Some(Point3::new(x, 0.0, 0.0)) };
        let long: Vec<Sighting> = (0..100).map(|k| at(f64::from(k), 2.3 - 0.02 * f64::from(k))).collect();
        let brief: Vec<Sighting> = (0..30).map(|k| at(f64::from(k), 0.7 - 0.02 * f64::from(k))).collect();
        assert!(likeness(&long, 100, 1000.0).score < likeness(&brief, 100, 1000.0).score);
        // Six frames show that it leaves the strings.
        assert!(moves_in_racket(&ball[22..28], 1000.0) && !moves_in_racket(&throat[22..28], 1000.0));
    }

    #[test]
    fn truth_what_stays_away_from_the_strings_must_fly_freely() {
        let passing = seen(|t| Point3::new(0.02 * t, 0.4, 0.03 * (t - 20.0)));
        let leaping = seen(|t| Point3::new(0.02 * t, 0.4, 0.03 * f64::from((5 * t as i32 * t as i32) % 13)));
        // Turns about the racket at its own distance.
        let carried = seen(|t| Point3::new(0.02 * t + 0.45 * (0.02 * t).cos(), 0.45 * (0.02 * t).sin(), 0.0));
        // A cuff that goes with the racket, until another thing is followed in its stead.
        let lost = seen(|t| Point3::new(0.02 * t, 0.5 + 0.002 * t, if t < 30.0 { 0.0 } else { 0.5 + 0.05 * f64::from((5 * t as i32 * t as i32) % 13) }));
        assert!(likeness(&passing, 40, 1000.0).score.is_finite());
        assert!([&leaping, &carried, &lost].iter().all(|s| likeness(s, 40, 1000.0).score.is_infinite()));
    }
}
