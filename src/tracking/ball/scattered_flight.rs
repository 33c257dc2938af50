//! A free flight told by frames that do not follow each other.
//!
//! A ball of little contrast stands out in both pictures of one frame in two or three, so that no three frames in a row show it, a missing
//! picture among them or not. Any three of some frames in which it does lie on one line, and both cameras show faint outlines along it in others.

use crate::footage::{FrameBuffer, FrameSource, GreyImage};
use crate::tracking::ball::ball_track::{BallFrame, BallScene};
use crate::tracking::ball::ball_way::StraightLine;
use crate::tracking::ball::free_flight::{BEND_M, FreeFlight, MOST_FAINT, Place, SPEEDS_M_S};
use crate::tracking::pictures::shot_frames::Shot;
use crate::tracking::shot_tracks::TrackingError;
use rayon::prelude::*;

/// Frames looked into together, and most from one that shows the ball to the next.
const TOGETHER: usize = 10;
const MOST_STEP: usize = 4;
/// Fewest other frames of these in which both cameras show it.
const FEWEST_BESIDE: usize = 2;
/// Flights of one look that are followed.
const MOST: usize = 6;

/// Three places, each with its frame (counted from the first looked into), on one line.
struct Three<'a> {
    at: [usize; 3],
    places: [&'a Place; 3],
}

impl Three<'_> {
    fn faint(&self) -> usize {
        self.places.iter().map(|p| p.faint).sum()
    }

    fn line(&self) -> StraightLine {
        StraightLine::through(self.at.iter().zip(&self.places).map(|(at, place)| (*at as f64, place.ball.position)))
    }
}

/// The threes that move as a free ball does, the clearest first; `step_m` are the shortest and the longest way from one frame to the next.
fn threes(frames: &[Vec<Place>], step_m: (f64, f64)) -> Vec<Three<'_>> {
    let mut out = Vec::new();
    let steps = || (1..=MOST_STEP).flat_map(|a| (1..=MOST_STEP).map(move |b| (a, b))).filter(|steps| *steps != (1, 1));
    for (i, (a, b)) in (0..frames.len()).flat_map(|i| steps().map(move |s| (i, s))) {
        let at = [i, i + a, i + a + b];
        let Some(last) = frames.get(at[2]) else { continue };
        for (first, middle) in frames[at[0]].iter().flat_map(|first| frames[at[1]].iter().map(move |middle| (first, middle))) {
            let way = (middle.ball.position - first.ball.position) / a as f64;
            if !(step_m.0..step_m.1).contains(&way.norm()) {
                continue;
            }
            let there = middle.ball.position + way * b as f64;
            let near = |third: &&Place| (third.ball.position - there).norm() < BEND_M && first.faint + middle.faint + third.faint <= MOST_FAINT;
            out.extend(last.iter().filter(near).map(|third| Three { at, places: [first, middle, third] }));
        }
    }
    out.sort_by_key(Three::faint);
    out
}

impl<S: FrameSource> Shot<'_, S> {
    /// The free flights through any three of the frames from `first` on, each with the frame from which on it is told.
    pub(in crate::tracking) fn scattered_flights_from(
        &self,
        first: usize,
        scene: &BallScene,
        still: &[Option<GreyImage>; 2],
    ) -> Result<Vec<(usize, FreeFlight)>, TrackingError> {
        let apart = self.apart();
        let indices: Vec<usize> = (0..TOGETHER).map(|k| first + k * apart).filter(|index| *index < self.source.len()).collect();
        let frames: Result<Vec<Vec<Place>>, TrackingError> = indices.par_iter().map(|index| self.places_in(*index, scene, still)).collect();
        let frames = frames?;
        let step_m = |speed: f64| speed * apart as f64 / self.setup.frame_rate_hz;
        let mut told: Vec<(usize, FreeFlight)> = Vec::new();
        for three in threes(&frames, (step_m(SPEEDS_M_S.0), step_m(SPEEDS_M_S.1))) {
            let line = three.line();
            let same = |(known, flight): &(usize, FreeFlight)| {
                let k = (known - first) / apart + 1;
                (flight.balls[1].position - line.at(k as f64)).norm() < BEND_M
            };
            if told.iter().any(same) {
                continue;
            }
            let beside =
                |buffers: &mut [FrameBuffer; 2], k: usize| Ok(!three.at.contains(&k) && self.both_see(scene, indices[k], &line.at(k as f64), buffers)?);
            let seen: Result<Vec<bool>, TrackingError> = (0..indices.len()).into_par_iter().map_init(Default::default, beside).collect();
            if seen?.into_iter().filter(|s| *s).count() < FEWEST_BESIDE {
                continue;
            }
            // Where it was not seen it is on its line.
            let ball = |k: usize| match three.at.iter().position(|at| *at == k) {
                Some(which) => three.places[which].ball,
                None => BallFrame { points: [None; 2], position: line.at(k as f64), stereo: false, flattening: None },
            };
            let from = three.at[0];
            told.push((indices[from], FreeFlight { balls: [ball(from), ball(from + 1), ball(from + 2)], clear: false }));
            if told.len() == MOST {
                break;
            }
        }
        Ok(told)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Point3, Vector3};

    fn place(position: Point3<f64>, faint: usize) -> Place {
        Place { ball: BallFrame { points: [None; 2], position, stereo: true, flattening: None }, faint }
    }

    /// Eight frames with four things each at places that change at random, and a ball in some of them.
    fn frames(shown: &[usize], faint: usize) -> Vec<Vec<Place>> {
        let random = |k: usize, j: usize| ((k * k * k * 331 + k * 7919 * (j + 3) + j * 104_729 + 13) % 1009) as f64 / 1009.0 - 0.5;
        let of = |k: usize| {
            let clutter = (0..4).map(|j| place(Point3::new(4.0 * random(k, 3 * j), 3.0 * random(k, 3 * j + 1), 10.0 + random(k, 3 * j + 2)), 0));
            let ball = shown.contains(&k).then(|| place(Point3::new(0.3 + 0.02 * k as f64, 1.0 - 0.004 * k as f64, 10.0 + 0.006 * random(k, 77)), faint));
            clutter.chain(ball).collect()
        };
        (0..8).map(of).collect()
    }

    #[test]
    fn truth_a_ball_is_told_by_frames_that_do_not_follow_each_other() {
        let frames = frames(&[0, 3, 4, 7], 0);
        let found = threes(&frames, (0.0015, 0.09));
        let on_the_way = |three: &Three| (three.line().step - Vector3::new(0.02, -0.004, 0.0)).norm() < 0.004;
        assert_eq!(found.iter().filter(|three| on_the_way(three)).map(|three| three.at).collect::<Vec<_>>(), [[0, 3, 4], [0, 3, 7], [0, 4, 7], [3, 4, 7]]);
        assert!((found[0].line().at(5.0) - Point3::new(0.4, 0.98, 10.0)).norm() < 0.02);
    }

    #[test]
    fn three_in_a_row_faint_places_and_standing_things_tell_nothing_here() {
        let step_m = (0.0015, 0.09);
        assert!(threes(&frames(&[2, 3, 4], 0), step_m).is_empty());
        assert!(threes(&frames(&[0, 3, 4, 7], 1), step_m).is_empty());
        assert!(threes(&[0; 8].map(|_| vec![place(Point3::new(0.0, 1.0, 10.0), 0)]), step_m).is_empty());
    }
}
