//! Places that no ball comes to from where it was a frame before: another thing was taken for it there.
//!
//! Nothing need be known of strings or contact for that. What was followed falls into runs within which a ball may go from place to place; of the
//! chains of runs that it may go along, the one of most sightings is the ball, and a short run beside it is another thing.

use crate::footage::FrameSource;
use crate::tracking::ball::ball_track::BallFrame;
use nalgebra::Point3;

/// No ball is faster, m/s (the fastest service is below 75),
const FASTEST_M_S: f64 = 100.0;
/// nor are two places by both cameras farther off, m.
const OFF_M: f64 = 0.03;
/// More sightings in a row may be a flight of their own.
const LONGEST_RUN: usize = 10;

/// The frames of a shot, by index, in which both cameras saw a ball that leaps.
pub fn leaping(source: &impl FrameSource, ball: &[Option<BallFrame>], frame_rate_hz: f64) -> Vec<usize> {
    let place = |(index, ball): (usize, &Option<BallFrame>)| {
        let place = ball.as_ref().filter(|b| b.stereo)?.position;
        Some((index, (source.number(index), place)))
    };
    let (indices, places): (Vec<usize>, Vec<(u64, Point3<f64>)>) = ball.iter().enumerate().filter_map(place).unzip();
    off_the_chain(&places, FASTEST_M_S / frame_rate_hz).into_iter().map(|k| indices[k]).collect()
}

/// Which of the places, by the numbers of their frames, are of short runs off the chain of most places; a ball goes `farthest_m` a frame at most.
fn off_the_chain(places: &[(u64, Point3<f64>)], farthest_m: f64) -> Vec<usize> {
    let frames = |a: usize, b: usize| places[b].0 - places[a].0;
    let may_follow = |a: usize, b: usize| (places[b].1 - places[a].1).norm() < OFF_M + farthest_m * frames(a, b) as f64;
    let all: Vec<usize> = (0..places.len()).collect();
    // Over frames without it a ball goes farther: who is taken for it there need not be in reach of what comes next.
    let runs: Vec<&[usize]> = all.chunk_by(|a, b| frames(*a, *b) == 1 && may_follow(*a, *b)).collect();
    // The most places of a chain that ends with a run, and the run before it.
    let mut chains: Vec<(usize, Option<usize>)> = Vec::with_capacity(runs.len());
    for (k, run) in runs.iter().enumerate() {
        let earlier = (0..k).filter(|j| may_follow(runs[*j][runs[*j].len() - 1], run[0])).max_by_key(|j| chains[*j].0);
        chains.push((run.len() + earlier.map_or(0, |j| chains[j].0), earlier));
    }
    let longest = (0..runs.len()).max_by_key(|k| chains[*k].0);
    let chain: Vec<usize> = std::iter::successors(longest, |k| chains[*k].1).collect();
    let off = |k: &usize| runs[*k].len() <= LONGEST_RUN && !chain.contains(k);
    (0..runs.len()).filter(off).flat_map(|k| runs[k].iter().copied()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;

    /// A ball in and out again at 1000 frames a second, turned at frame 20.
    fn turned() -> Vec<(u64, Point3<f64>)> {
        let way = |k: usize| if k < 20 { -0.04 * k as f64 } else { -0.8 + 0.06 * (k - 20) as f64 };
        (0..45).map(|k| (k as u64, Point3::new(way(k), 1.0, 0.1))).collect()
    }

    fn off(places: &[(u64, Point3<f64>)]) -> Vec<u64> {
        off_the_chain(places, 0.1).into_iter().map(|k| places[k].0).collect()
    }

    #[test]
    fn truth_what_leaps_away_and_back_goes_and_the_turned_ball_stays() {
        assert!(off(&turned()).is_empty());
        let leap = |strays: &[u64], lost: std::ops::Range<u64>| {
            let mut places = turned();
            strays.iter().for_each(|k| places[*k as usize].1 += Vector3::new(0.1, 0.2, -0.3));
            places.retain(|p| !lost.contains(&p.0));
            off(&places)
        };
        for strays in [vec![0], vec![12], vec![21, 22, 23, 30, 31, 41], vec![44]] {
            assert_eq!(leap(&strays, 0..0), strays);
        }
        // In reach of where it was last seen, not of where it is seen next.
        assert_eq!(leap(&[21, 22, 24], 16..21), [21, 22, 24]);
        // As many as this are a flight of their own, which other rules judge.
        assert!(leap(&(5..16).collect::<Vec<_>>(), 0..0).is_empty());
    }

    #[test]
    fn law_a_ball_that_was_lost_may_be_found_far_away() {
        let places: Vec<_> = turned().into_iter().filter(|p| !(25..40).contains(&p.0)).collect();
        assert!(off(&places).is_empty());
        assert!(off(&[]).is_empty() && off(&places[..1]).is_empty());
    }
}
