//! The straight pieces of what was followed, and which two of them are the ball before and after it met the strings.
//!
//! Who follows the ball past strings and frame may go over to another thing, and the ball's other half may stand in what was followed from
//! another frame. But off the strings the ball flies straight on, and where it meets them both its flights come together.

use crate::tracking::ball::ball_choice::{ON_LINE_M, Sighting, moves_in_racket, on_line};
use crate::tracking::ball::ball_way::{OF_LINE, StraightLine};
use nalgebra::Point3;

/// Fewest sightings of a piece at 1000 frames a second, and of any.
const FEWEST: (f64, usize) = (5.0, 3);
/// Most frames between neighbours in a piece.
pub const LONGEST_STEP: f64 = 4.0;
/// The next sighting lies this near to the line through those before, m: foretold from a dozen, twice the error of each.
const NEXT_M: f64 = 2.0 * ON_LINE_M;
/// Two flights of one ball come this near to each other while it is on the strings, m, and as near to the stringbed's centre: half the head and
/// what the racket moves meanwhile.
const MEET_M: f64 = 0.06;
const AT_THE_BED_M: f64 = 0.25;
/// Strings that a ball meets turn it: by less than this, m/s, it went straight on, and a frame of it was missed.
const LEAST_TURN_M_S: f64 = 3.0;
/// Frames a second of which a turn is asked at most.
const TURN_HZ: f64 = 1000.0;
/// Longest time between the two flights, s, contact included.
const LONGEST_BETWEEN_S: f64 = 0.025;

/// Longest time over which a ball may be lost in flight, s, and how near its two pieces come to each other half-way between them, m: what gravity and
/// drag bend is alike from both sides. Time over which a piece tells its direction, s, and its fewest sightings.
const LONGEST_LOST_S: f64 = 0.08;
const ONE_WAY_M: f64 = 0.03;
const LINE_S: f64 = 0.03;
const FEWEST_OF_WAY: usize = OF_LINE;

/// A straight piece of a flight, sightings in time.
pub type Piece = Vec<Sighting>;

/// The straight pieces of one thing's way.
pub fn straight_pieces(seen: &[Sighting], frame_rate_hz: f64) -> Vec<Piece> {
    let fewest = ((FEWEST.0 * frame_rate_hz / 1000.0) as usize).clamp(FEWEST.1, FEWEST.0 as usize);
    let mut out = Vec::new();
    let mut start = 0;
    while start + fewest <= seen.len() {
        let mut end = start;
        if on_line(&seen[start..start + 3]) {
            end = start + 3;
            while end < seen.len() && goes_on(&seen[start..end], &seen[end]) {
                end += 1;
            }
        }
        if end >= start + fewest {
            out.push(seen[start..end].to_vec());
            start = end;
        } else {
            start += 1;
        }
    }
    out
}

/// Whether a sighting continues a piece, whose sightings come in order toward it.
pub fn goes_on(piece: &[Sighting], next: &Sighting) -> bool {
    let Some(last) = piece.last() else { return false };
    (next.number - last.number).abs() <= LONGEST_STEP && (next.place - foretold(piece, next.number)).norm() < NEXT_M
}

/// Where a piece, whose sightings come in order toward it, puts the ball in a frame.
pub fn foretold(piece: &[Sighting], number: f64) -> Point3<f64> {
    line(&piece[piece.len().saturating_sub(OF_LINE)..]).at(number)
}

/// The straight line through sightings.
fn line(seen: &[Sighting]) -> StraightLine {
    StraightLine::through(seen.iter().map(|s| (s.number, s.place)))
}

/// Whether the strings turned what was followed. Frames closer in time than [`TURN_HZ`] are thinned: a line through a dozen of them is so short
/// that it goes on through the contact as if nothing turned there.
pub fn turned(seen: &[Sighting], frame_rate_hz: f64) -> bool {
    let every = (frame_rate_hz / TURN_HZ).round().max(1.0);
    let thinned = seen.iter().filter(|s| s.number % every == 0.0).map(|s| Sighting { number: s.number / every, ..*s });
    let rate_hz = frame_rate_hz / every;
    met_at_strings(&straight_pieces(&thinned.collect::<Vec<_>>(), rate_hz), rate_hz).is_some()
}

/// Which two pieces most likely are the ball before and after the strings: they meet there, and together they are the longest.
pub fn met_at_strings(pieces: &[Piece], frame_rate_hz: f64) -> Option<[usize; 2]> {
    let moving: Vec<usize> = (0..pieces.len()).filter(|k| moves_in_racket(&pieces[*k], frame_rate_hz)).collect();
    let mut best: Option<(usize, [usize; 2])> = None;
    for a in &moving {
        for b in &moving {
            let length = pieces[*a].len() + pieces[*b].len();
            if best.is_none_or(|best| length > best.0) && meet(&pieces[*a], &pieces[*b], frame_rate_hz) {
                best = Some((length, [*a, *b]));
            }
        }
    }
    best.map(|b| b.1)
}

/// Whether two flights come together at the stringbed in between, and part.
pub fn meet(before: &[Sighting], after: &[Sighting], frame_rate_hz: f64) -> bool {
    let (Some(last), Some(first)) = (before.last(), after.first()) else { return false };
    let between = first.number - last.number;
    if between <= 0.0 || between > LONGEST_BETWEEN_S * frame_rate_hz {
        return false;
    }
    let (a, b) = (line(&before[before.len().saturating_sub(OF_LINE)..]), line(&after[..after.len().min(OF_LINE)]));
    if (b.step - a.step).norm() * frame_rate_hz < LEAST_TURN_M_S {
        return false;
    }
    let together = (0..=20).map(|k| last.number + between * f64::from(k) / 20.0).map(|t| (a.at(t), b.at(t)));
    let Some((p, q)) = together.min_by(|x, y| (x.0 - x.1).norm().total_cmp(&(y.0 - y.1).norm())) else { return false };
    // The racket stands where the sightings nearest to the meeting have it.
    let from_bed = |s: &Sighting, there: &Point3<f64>| s.in_racket.map(|local| local.coords.norm() - (there - s.place).norm());
    let at_bed = |s: &Sighting, there: &Point3<f64>| from_bed(s, there).is_some_and(|d| d < AT_THE_BED_M);
    (p - q).norm() < MEET_M && at_bed(last, &p) && at_bed(first, &q)
}

/// Whether a ball that was lost in flight goes on as it went.
pub fn goes_on_unturned(before: &[Sighting], after: &[Sighting], frame_rate_hz: f64) -> bool {
    let (Some(last), Some(first)) = (before.last(), after.first()) else { return false };
    let between = first.number - last.number;
    if between <= 0.0 || between > LONGEST_LOST_S * frame_rate_hz || before.len().min(after.len()) < FEWEST_OF_WAY {
        return false;
    }
    // As long a time at any frame rate: a line through a dozen frames of a fast camera hardly tells its direction.
    let of_line = (LINE_S * frame_rate_hz) as usize;
    let (a, b) = (line(&before[before.len().saturating_sub(of_line)..]), line(&after[..after.len().min(of_line)]));
    let half_way = last.number + 0.5 * between;
    (b.step - a.step).norm() * frame_rate_hz < LEAST_TURN_M_S && (b.at(half_way) - a.at(half_way)).norm() < ONE_WAY_M
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;

    fn seen(numbers: std::ops::Range<i32>, of: impl Fn(f64) -> Point3<f64>) -> Vec<Sighting> {
        let sighting = |k: i32| {
            let place = of(f64::from(k));
            Sighting { index: k as usize, number: f64::from(k), place, in_racket: Some(place) }
        };
        numbers.map(sighting).collect()
    }

    #[test]
    fn truth_the_two_halves_of_a_flight_are_found_in_two_ways_followed() {
        let before = |t: f64| Point3::new(0.05, 0.02, 0.03 * (20.0 - t));
        let after = |t: f64| Point3::new(0.05 + 0.01 * (t - 20.0), 0.02, 0.04 * (t - 20.0));
        let leap = |t: f64| 0.04 * f64::from((3 * t as i32 * t as i32) % 7);
        // One way lost the ball after it met the strings, the other begins there.
        let lost = seen(0..40, |t| if t < 19.0 { before(t) } else { Point3::new(0.05, leap(t), 0.1 + leap(t + 3.0)) });
        let late = seen(10..40, |t| if t > 23.0 { after(t) } else { Point3::new(leap(t), 0.3, leap(t + 1.0)) });
        // Fastened to the racket, and longer than any.
        let throat = seen(0..40, |_| Point3::new(-0.25, 0.0, 0.0));
        let pieces: Vec<Piece> = [&lost, &late, &throat].into_iter().flat_map(|w| straight_pieces(w, 1000.0)).collect();
        let [a, b] = met_at_strings(&pieces, 1000.0).expect("a pair").map(|k| &pieces[k]);
        assert!(a.len() >= 18 && b.len() >= 15, "{} {}", a.len(), b.len());
        assert!(a.iter().all(|s| s.number < 20.5) && b.iter().all(|s| s.number > 22.5));
        // A flight that passes somewhere else is another ball's.
        let elsewhere = seen(24..40, |t| after(t) + Vector3::new(0.0, 0.3, 0.0));
        let pieces: Vec<Piece> = [&lost, &elsewhere].into_iter().flat_map(|w| straight_pieces(w, 1000.0)).collect();
        assert!(met_at_strings(&pieces, 1000.0).is_none());
        // One that goes straight on past the strings, six of its frames missed there, was not turned.
        let mut past = seen(0..40, before);
        past.drain(19..25);
        assert!(straight_pieces(&past, 1000.0).len() == 2 && !turned(&past, 1000.0));
        let mut back = seen(0..40, |t| if t < 20.0 { before(t) } else { after(t) });
        back.drain(19..22);
        assert!(turned(&back, 1000.0));
    }

    #[test]
    fn truth_a_ball_lost_in_flight_goes_on_as_it_went_and_nothing_else_does() {
        // 8 m/s, falling; the noise of outlines without light.
        let flight = |t: f64| {
            let noise = 0.004 * (f64::from(t as i32 * 7919 % 13) / 6.0 - 1.0);
            Point3::new(1.4 - 0.008 * t, 1.1 + noise, 0.2 - 4.9e-6 * t * t - noise)
        };
        let (before, after) = (seen(0..40, flight), seen(70..100, flight));
        assert!(goes_on_unturned(&before, &after, 1000.0) && !goes_on_unturned(&after, &before, 1000.0));
        let others = [
            seen(70..100, |t| flight(t) + Vector3::new(0.0, 0.08, 0.0)),
            seen(70..100, |t| flight(t) + Vector3::new(0.0, 0.006 * (t - 55.0), 0.0)),
            seen(125..155, flight),
            seen(70..76, flight),
        ];
        assert!(others.iter().all(|other| !goes_on_unturned(&before, other, 1000.0)));
    }

    #[test]
    fn truth_a_ball_is_turned_at_any_frame_rate() {
        // Comes at 30 m/s, lies on the strings for 5 ms, leaves at 40.
        let way = |ms: f64| match ms {
            ms if ms < 20.0 => 0.03 * (20.0 - ms),
            ms if ms < 25.0 => -0.03 * (ms - 20.0) + 0.007 * (ms - 20.0).powi(2),
            ms => 0.025 + 0.04 * (ms - 25.0),
        };
        for per_ms in [1, 2, 4, 10] {
            let whole = seen(0..45 * per_ms, |t| Point3::new(0.05, 0.02, way(t / f64::from(per_ms))));
            assert!(turned(&whole, 1000.0 * f64::from(per_ms)), "{per_ms}");
        }
        let straight = seen(0..180, |t| Point3::new(0.05, 0.02, 0.6 - 0.0075 * t));
        assert!(!turned(&straight, 4000.0));
    }

    #[test]
    fn truth_a_piece_foretells_where_the_ball_goes_on_and_nothing_else_does() {
        let flight = |t: f64| Point3::new(0.03 * t, 0.02, -5e-6 * t * t);
        let piece = seen(0..20, flight);
        let [next, aside, late] = [(22.0, 0.0), (22.0, 0.02), (25.0, 0.0)].map(|(number, off)| {
            let place = flight(number) + Vector3::new(0.0, off, 0.0);
            Sighting { index: 0, number, place, in_racket: None }
        });
        assert!((foretold(&piece, 22.0) - next.place).norm() < 1e-3);
        assert!(goes_on(&piece, &next) && !goes_on(&piece, &aside) && !goes_on(&piece, &late));
    }
}
