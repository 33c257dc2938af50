//! Stretches over which the ball was lost, looked into again.
//!
//! The strings turn a ball round within a few frames, before frame, lettering and strings: who follows it through the contact may lose it
//! there, or keep it in one camera only. Beyond, it flies freely and can be found for itself, three frames at a time. It is the same
//! ball when, followed toward the known one, it comes to where that was seen.

use crate::calibration::CameraId;
use crate::footage::{FrameBuffer, FrameSource};
use crate::tracking::ball::ball_choice::{Sighting, moves_in_racket};
use crate::tracking::ball::ball_follower::{Flight, nearest};
use crate::tracking::ball::ball_pieces::{LONGEST_STEP, Piece, foretold, goes_on, goes_on_unturned, meet, met_at_strings, straight_pieces};
use crate::tracking::ball::ball_track::{BallFrame, BallScene};
use crate::tracking::ball::ball_way::BallWay;
use crate::tracking::ball::free_flight::FreeFlight;
use crate::tracking::ball::shot_ball::Stage;
use crate::tracking::pictures::shot_frames::{PATIENCE, Shot};
use crate::tracking::racket::racket_scene::RacketFrame;
use crate::tracking::shot_tracks::TrackingError;
use nalgebra::{Point3, Vector2};
use rayon::prelude::*;
use std::ops::Range;

/// Shortest stretch that is looked into, frames.
const SHORTEST: usize = 4;
/// Frames from the known ball at which a free flight is looked for, in order: contact lasts six frames, and soon after the ball is clear of
/// the racket's frame in both pictures.
pub(in crate::tracking) const STARTS: [usize; 7] = [2, 6, 10, 14, 18, 23, 28];
/// Two measurements of one ball differ by less, m: three deviations of depth by rays good to 1 px.
const SAME_BALL_M: f64 = 0.03;
/// Most frames over which a flight that one camera sees off goes on unseen, before lettering or a wall of the ball's own grey.
const LONGEST_UNSEEN: f64 = 16.0;
/// So near to the border some of a ball's surroundings are cut off, px.
const AT_THE_BORDER_PX: f64 = 6.0;
/// A ball on the strings changes its velocity by this per frame at 1000 frames a second, m: 50 m/s over 4 ms.
const TURN_M: f64 = 0.0125;

impl<S: FrameSource> Shot<'_, S> {
    /// Looks for the ball where no frame of a stretch has it in both cameras.
    pub(in crate::tracking) fn fill_gaps(&self, stage: &Stage, flight: &mut Flight) -> Result<(), TrackingError> {
        let known: &Flight = flight;
        let ways: Vec<(Range<usize>, bool)> = gaps(&known.frames).into_iter().flat_map(|gap| [false, true].map(|forth| (gap.clone(), forth))).collect();
        let found: Result<Vec<_>, TrackingError> = ways.par_iter().map(|(gap, forth)| self.continued(stage, gap, known, *forth)).collect();
        for ((gap, _), found) in ways.iter().zip(found?) {
            if let Some(found) = found {
                flight.take_in(gap, found);
            }
        }
        for gap in gaps(&flight.frames) {
            if let Some(found) = self.flight_in(stage, &gap, flight)? {
                flight.take_in(&gap, found);
            }
        }
        for gap in gaps(&flight.frames) {
            if let Some(found) = self.flight_of_one_camera(stage, &gap, flight)? {
                flight.take_in(&gap, found);
            }
        }
        let faint = BallScene { faint: true, ..stage.ball.clone() };
        for gap in gaps(&flight.frames) {
            for forth in [false, true] {
                self.extend(&Stage { ball: &faint, ..*stage }, &gap, flight, forth)?;
            }
        }
        for gap in gaps(&flight.frames) {
            for forth in [false, true] {
                self.see_off(stage, &gap, flight, forth)?;
            }
        }
        Ok(())
    }

    /// Goes on from the ball's known end where it has left one camera's picture, as long as the other sees it clearly and straight ahead: to the border,
    /// which cuts off some of it at last.
    fn see_off(&self, stage: &Stage, gap: &Range<usize>, flight: &mut Flight, forth: bool) -> Result<(), TrackingError> {
        let scene = stage.ball;
        let (_, piece) = self.known_beside(&flight.frames, stage.racket, gap, forth);
        let next = if forth { gap.start } else { gap.end - 1 };
        let beside = |last: &&Sighting| (self.source.number(next) as f64 - last.number).abs() <= LONGEST_UNSEEN;
        let Some(last) = piece.last().filter(beside) else { return Ok(()) };
        let (mut last, mut way) = (last.number, BallWay::new(piece.iter().map(|s| (s.number, s.place))));
        let (mut ahead, mut buffers) = (gap.clone(), [FrameBuffer::default(), FrameBuffer::default()]);
        let cut = BallScene { faint: true, ..scene.clone() };
        while let Some(index) = nearest(&mut ahead, forth) {
            let number = self.source.number(index) as f64;
            let there = way.foretold(number);
            let radius_px = |camera: CameraId| scene.radius_px(camera, &there).unwrap_or(0.0);
            let shown = CameraId::BOTH.map(|camera| self.is_whole(scene, camera, &there));
            if (number - last).abs() > LONGEST_UNSEEN || !CameraId::BOTH.iter().any(|camera| self.is_inside(scene, *camera, &there, 0.0)) {
                break;
            }
            if shown == [true, true] {
                // What one of them has seen there is the ball.
                if let Some(ball) = flight.frames[index].filter(|ball| (ball.position - there).norm() < SAME_BALL_M) {
                    way.go_on(number, ball.position, true);
                    last = number;
                }
                continue;
            }
            let images = self.read_rows(index, self.ball_rows(scene, &there, 1), &mut buffers)?;
            let measured = |scene: &BallScene| scene.measure(&images, &there, [1, 1], 1.0, &[None, None]);
            let at_the_border = || !CameraId::BOTH.iter().any(|camera| self.is_inside(scene, *camera, &there, AT_THE_BORDER_PX + radius_px(*camera)));
            if let Some(ball) = measured(scene).or_else(|| if at_the_border() { measured(&cut) } else { None }) {
                way.go_on(number, ball.position, true);
                last = number;
                flight.set(index, Some(ball));
            }
        }
        Ok(())
    }

    /// Goes on from the ball's known end along its straight way: where the line through a dozen frames foretells it in both pictures, a faint
    /// outline is enough.
    fn extend(&self, stage: &Stage, gap: &Range<usize>, flight: &mut Flight, forth: bool) -> Result<(), TrackingError> {
        let faint = stage.ball;
        let (_, mut piece) = self.known_beside(&flight.frames, stage.racket, gap, forth);
        let (mut ahead, mut buffers) = (gap.clone(), [FrameBuffer::default(), FrameBuffer::default()]);
        while let Some(index) = nearest(&mut ahead, forth) {
            let number = self.source.number(index) as f64;
            if piece.last().is_none_or(|last| (number - last.number).abs() > LONGEST_STEP) {
                break;
            }
            let there = foretold(&piece, number);
            let images = self.read_rows(index, self.ball_rows(faint, &there, 1), &mut buffers)?;
            let Some(ball) = faint.measure(&images, &there, [1, 1], 1.0, &[None, None]).filter(|b| b.stereo) else { continue };
            let next = self.sighting(index, ball.position, stage.racket[index].as_ref());
            if goes_on(&piece, &next) {
                (flight.frames[index], flight.kept[index]) = (Some(ball), None);
                piece.push(next);
            }
        }
        Ok(())
    }

    /// What is known before a gap (`forth`) or after it, in order toward it, and the straight piece of that next to the gap.
    pub(in crate::tracking) fn known_beside(
        &self,
        frames: &[Option<BallFrame>],
        racket: &[Option<RacketFrame>],
        gap: &Range<usize>,
        forth: bool,
    ) -> (Vec<Sighting>, Piece) {
        let mut known = self.sightings(frames, racket);
        known.retain(|s| if forth { s.index < gap.start } else { s.index >= gap.end });
        let mut pieces = straight_pieces(&known, self.setup.frame_rate_hz);
        let mut piece = if forth { pieces.pop().unwrap_or_default() } else { pieces.into_iter().next().unwrap_or_default() };
        if !forth {
            known.reverse();
            piece.reverse();
        }
        (known, piece)
    }

    /// The straight pieces of the ways followed, and which way each is of.
    fn pieces_in(&self, ways: &[Vec<Option<BallFrame>>], racket: &[Option<RacketFrame>]) -> (Vec<usize>, Vec<Piece>) {
        let pieces_of = |frames: &[Option<BallFrame>]| straight_pieces(&self.sightings(frames, racket), self.setup.frame_rate_hz);
        ways.iter().enumerate().flat_map(|(way, frames)| pieces_of(frames).into_iter().map(move |p| (way, p))).unzip()
    }

    /// The ball before and after the strings, wherever in the ways followed it stands, each half with the pieces from which it was lost in flight: which
    /// way, and the piece of it.
    fn whole_way(&self, ways: &[Vec<Option<BallFrame>>], racket: &[Option<RacketFrame>]) -> Option<Vec<(usize, Piece)>> {
        let rate = self.setup.frame_rate_hz;
        let (way_of, pieces) = self.pieces_in(ways, racket);
        let [mut first, mut last] = met_at_strings(&pieces, rate)?;
        let mut parts = vec![first, last];
        let longest = |goes_on: &dyn Fn(&usize) -> bool| (0..pieces.len()).filter(|k| goes_on(k)).max_by_key(|k| pieces[*k].len());
        while let Some(earlier) = longest(&|k| goes_on_unturned(&pieces[*k], &pieces[first], rate)) {
            first = earlier;
            parts.push(first);
        }
        while let Some(later) = longest(&|k| goes_on_unturned(&pieces[last], &pieces[*k], rate)) {
            last = later;
            parts.push(last);
        }
        Some(parts.into_iter().map(|k| (way_of[k], pieces[k].clone())).collect())
    }

    /// Whether the ball before and after the strings stands in what was followed, both flights at least so many frames long.
    pub(in crate::tracking) fn stands_in(&self, ways: &[Vec<Option<BallFrame>>], racket: &[Option<RacketFrame>], shortest: usize) -> bool {
        let (_, pieces) = self.pieces_in(ways, racket);
        met_at_strings(&pieces, self.setup.frame_rate_hz).is_some_and(|halves| halves.iter().all(|k| pieces[*k].len() >= shortest))
    }

    /// Frames of the longest straight piece of what was followed that moves as a ball does.
    pub(in crate::tracking) fn longest_flight(&self, frames: &[Option<BallFrame>], racket: &[Option<RacketFrame>]) -> usize {
        self.flights_of(frames, racket).iter().map(Vec::len).max().unwrap_or(0)
    }

    /// Frames of all such pieces.
    pub(in crate::tracking) fn frames_in_flight(&self, frames: &[Option<BallFrame>], racket: &[Option<RacketFrame>]) -> usize {
        self.flights_of(frames, racket).iter().map(Vec::len).sum()
    }

    /// The straight pieces of what was followed that move as a ball does.
    pub(in crate::tracking) fn flights_of(&self, frames: &[Option<BallFrame>], racket: &[Option<RacketFrame>]) -> Vec<Piece> {
        let rate = self.setup.frame_rate_hz;
        straight_pieces(&self.sightings(frames, racket), rate).into_iter().filter(|p| moves_in_racket(p, rate)).collect()
    }

    /// Leaves of a flight what flies straight: the ball before and after the strings, wherever in the ways followed (`ways`) it stands, or the
    /// straight pieces of this one. What lies between two pieces close to each other stays as well.
    pub(in crate::tracking) fn keep_free_flight(
        &self,
        scene: &BallScene,
        flight: &mut Flight,
        ways: &[Vec<Option<BallFrame>>],
        racket: &[Option<RacketFrame>],
    ) -> Result<(), TrackingError> {
        let own = self.flights_of(&flight.frames, racket);
        // Two short pieces may meet by chance: a longer one speaks against them.
        let longest = own.iter().map(Vec::len).max().unwrap_or(0);
        let whole = self.whole_way(ways, racket).filter(|parts| parts.iter().map(|(_, piece)| piece.len()).sum::<usize>() > longest);
        let mut kept = vec![false; flight.frames.len()];
        match whole {
            Some(parts) => {
                for (way, piece) in parts {
                    for s in piece {
                        kept[s.index] = true;
                        flight.set(s.index, ways[way][s.index]);
                    }
                }
            }
            // Seen too briefly to tell.
            None if own.is_empty() => return Ok(()),
            None => own.iter().flatten().for_each(|s| kept[s.index] = true),
        }
        let known: Vec<usize> = (0..kept.len()).filter(|i| kept[*i]).collect();
        for pair in known.windows(2) {
            if self.source.number(pair[1]) - self.source.number(pair[0]) <= PATIENCE as u64 + 1 {
                kept[pair[0]..pair[1]].fill(true);
            }
        }
        for (index, kept) in kept.iter().enumerate() {
            if !kept {
                (flight.frames[index], flight.kept[index]) = (None, None);
            }
        }
        self.mean_discs_again(scene, flight)
    }

    /// Takes into a flight the ball before and after the strings, wherever in the ways followed it stands.
    pub(in crate::tracking) fn take_in_other_half(&self, flight: &mut Flight, ways: &[Vec<Option<BallFrame>>], racket: &[Option<RacketFrame>]) {
        for (way, piece) in self.whole_way(ways, racket).into_iter().flatten() {
            for s in piece {
                flight.set(s.index, ways[way][s.index]);
            }
        }
    }

    /// The mean pictures of the disc, from the frames that stayed.
    pub(in crate::tracking) fn mean_discs_again(&self, scene: &BallScene, flight: &mut Flight) -> Result<(), TrackingError> {
        flight.means = Default::default();
        self.with_buffers(|buffers| {
            for (index, ball) in flight.frames.iter().enumerate() {
                let Some(ball) = ball else { continue };
                let images = self.read_rows(index, self.ball_rows(scene, &ball.position, 1), buffers)?;
                for camera in CameraId::BOTH {
                    if let Some(image) = &images[camera.index()] {
                        scene.add_to_mean(&mut flight.means[camera.index()], image, camera, ball);
                    }
                }
            }
            Ok(())
        })
    }

    /// Follows the ball from its known end into a gap, as far as it goes straight on.
    fn continued(&self, stage: &Stage, gap: &Range<usize>, flight: &Flight, forth: bool) -> Result<Option<Flight>, TrackingError> {
        let Stage { ball: scene, racket, .. } = *stage;
        let (mut piece, _) = self.known_beside(&flight.frames, racket, gap, forth);
        let [.., b, a] = piece.as_slice() else { return Ok(None) };
        let (Some(last), Some(before)) = (flight.frames[a.index], flight.frames[b.index]) else { return Ok(None) };
        let (last, before) = ((a.index, last), (b.index, before));
        let follower = self.follower_along(scene, before, last, gap.clone(), forth, 1);
        let mut found = self.whole_flight(gap.start, &[], [self.follow_to_the_end(follower)?]);
        let seen = self.sightings(&found.frames, racket);
        // From the other end: turned round by the strings, it comes to where it is known beyond the gap.
        let toward: Vec<&Sighting> = if forth { seen.iter().rev().collect() } else { seen.iter().collect() };
        let (beyond, _) = self.known_beside(&flight.frames, racket, gap, !forth);
        if beyond.last().is_some_and(|beyond| meets(&toward, beyond, self.setup.frame_rate_hz) == Some(true)) {
            return Ok(Some(found));
        }
        let known = piece.len();
        for s in toward.into_iter().rev() {
            if !goes_on(&piece, s) {
                break;
            }
            piece.push(*s);
        }
        found.keep_only(&piece);
        Ok((piece.len() > known).then_some(found))
    }

    /// Looks for a free flight in a gap that is the ball's: followed to the gap's end it comes to where the ball is known, or both meet at the
    /// strings.
    fn flight_in(&self, stage: &Stage, gap: &Range<usize>, flight: &Flight) -> Result<Option<Flight>, TrackingError> {
        let Stage { ball: scene, racket, still } = *stage;
        let (earlier, later): (Vec<Sighting>, Vec<Sighting>) = self.sightings(&flight.frames, racket).into_iter().partition(|k| k.index < gap.start);
        let (before, after): (Vec<&Sighting>, Vec<&Sighting>) = (earlier.iter().rev().collect(), later.iter().collect());
        let rate = self.setup.frame_rate_hz;
        let (last_piece, next_piece) = (straight_pieces(&earlier, rate).pop(), straight_pieces(&later, rate).into_iter().next());
        let met = |piece: &Piece| {
            last_piece.as_ref().is_some_and(|known| meet(known, piece, rate)) || next_piece.as_ref().is_some_and(|known| meet(piece, known, rate))
        };
        let mut tried: Vec<Vec<Option<BallFrame>>> = Vec::new();
        let apart = self.apart();
        for start in STARTS {
            let from_before = gap.start.checked_add(start).filter(|first| first + 2 * apart < gap.end && self.may_be_seen(scene, &before, *first));
            let from_after = gap.end.checked_sub(start + 2 * apart + 1).filter(|first| *first >= gap.start && self.may_be_seen(scene, &after, *first));
            for first in [from_before, from_after].into_iter().flatten() {
                let flights = [self.flights_from(first, scene, still)?, self.flights_against_another(first, scene)?];
                for FreeFlight { balls: three, .. } in flights.into_iter().flatten() {
                    if tried.iter().any(|t| stands_at(t, first + apart, &three[1], 1)) {
                        continue;
                    }
                    let forth = self.follower_along(scene, (first + apart, three[1]), (first + 2 * apart, three[2]), first + 2 * apart + 1..gap.end, true, 1);
                    let back = self.follower_along(scene, (first + apart, three[1]), (first, three[0]), gap.start..first, false, 1);
                    let mut found = self.whole_flight(first, &three, self.both_to_the_end([back, forth])?);
                    let seen = self.sightings(&found.frames, racket);
                    let pieces = self.flights_of(&found.frames, racket);
                    let ends = [(before.first(), seen.iter().collect::<Vec<_>>()), (after.first(), seen.iter().rev().collect())];
                    let meets: Vec<bool> = ends.iter().filter_map(|(known, found)| meets(found, known.as_ref()?, rate)).collect();
                    if let Some(piece) = pieces.iter().find(|p| met(p)) {
                        found.keep_only(piece);
                        return Ok(Some(found));
                    }
                    let straight: usize = pieces.iter().map(Vec::len).sum();
                    if seen.len() >= SHORTEST && 2 * straight >= seen.len() && meets.contains(&true) && !meets.contains(&false) {
                        return Ok(Some(found));
                    }
                    tried.push(found.frames);
                }
            }
        }
        Ok(None)
    }

    /// Whether a ball known in these frames, nearest first, may show in both pictures of another one: at the racket it may be turned round
    /// and go anywhere, elsewhere it goes on as it went.
    fn may_be_seen(&self, scene: &BallScene, known: &[&Sighting], index: usize) -> bool {
        let [a, b, ..] = known else { return false };
        if a.at_the_racket() {
            return true;
        }
        let there = a.place + (a.place - b.place) * ((self.source.number(index) as f64 - a.number) / (a.number - b.number));
        CameraId::BOTH.into_iter().all(|camera| self.is_whole(scene, camera, &there))
    }

    /// Whether a picture holds all of a ball there: cut by the border it is not looked for.
    fn is_whole(&self, scene: &BallScene, camera: CameraId, there: &Point3<f64>) -> bool {
        scene.radius_px(camera, there).is_some_and(|radius| self.is_inside(scene, camera, there, radius))
    }

    /// Whether a picture holds a place, and so many px beside it.
    fn is_inside(&self, scene: &BallScene, camera: CameraId, there: &Point3<f64>, beside: f64) -> bool {
        let [width, height] = self.setup.rig.image_size.map(|n| n as f64);
        let inside = |uv: Vector2<f64>| uv.x > beside && uv.y > beside && uv.x < width - beside && uv.y < height - beside;
        scene.view.project(camera, there).is_some_and(inside)
    }
}

/// Whether what was followed in one of `every` frames or more stands in a frame where another thing is.
pub(in crate::tracking) fn stands_at(frames: &[Option<BallFrame>], index: usize, thing: &BallFrame, every: usize) -> bool {
    let seen = |at: Option<usize>| Some((at?, frames.get(at?)?.as_ref()?.position));
    let beside = || {
        let (before, here) = (1..every).find_map(|k| seen(index.checked_sub(k)))?;
        let (after, there) = (1..every).find_map(|k| seen(Some(index + k)))?;
        (after - before <= every).then(|| here + (there - here) * ((index - before) as f64 / (after - before) as f64))
    };
    seen(Some(index)).map(|(_, at)| at).or_else(beside).is_some_and(|at| (at - thing.position).norm() < SAME_BALL_M)
}

/// Whether a flight, its nearest frames first, comes to where the ball is known; `None` where its end is too far away to tell.
fn meets(found: &[&Sighting], known: &Sighting, frame_rate_hz: f64) -> Option<bool> {
    let [a, b, ..] = found else { return None };
    let away = (known.number - a.number).abs();
    if away > PATIENCE as f64 {
        return None;
    }
    let there = a.place + (a.place - b.place) * ((known.number - a.number) / (a.number - b.number));
    let frames = away * 1000.0 / frame_rate_hz;
    Some((there - known.place).norm() < SAME_BALL_M + 0.5 * TURN_M * frames * frames)
}

/// Stretches in which no frame has the ball in both cameras.
fn gaps(frames: &[Option<BallFrame>]) -> Vec<Range<usize>> {
    let mut out = Vec::new();
    let mut start = 0;
    for end in 0..=frames.len() {
        if end == frames.len() || frames[end].is_some_and(|b| b.stereo) {
            if end >= start + SHORTEST && end - start < frames.len() {
                out.push(start..end);
            }
            start = end + 1;
        }
    }
    out
}

/// Frames in which the ball was `followed` in both cameras that do not see it when it is `measured` with its light: those of stretches that hold
/// [`SHORTEST`] of them or more and none that stood the test. There one camera kept the ball and the other followed another thing, which put it at a
/// wrong depth; what both see at a depth between two such frames has not stood it either.
pub(in crate::tracking) fn refuted(followed: &[Option<BallFrame>], measured: &[Option<BallFrame>]) -> Vec<usize> {
    let by_both = |frame: &Option<BallFrame>| frame.is_some_and(|b| b.stereo);
    let stands: Vec<Option<BallFrame>> = followed.iter().zip(measured).map(|(f, m)| m.filter(|_| by_both(f) && by_both(m))).collect();
    let of_gap = |gap: Range<usize>| gap.filter(|i| by_both(&followed[*i])).collect::<Vec<_>>();
    gaps(&stands).into_iter().map(of_gap).filter(|refuted| refuted.len() >= SHORTEST).flatten().collect()
}

impl Flight {
    /// Puts into a frame what another way has there.
    pub(in crate::tracking) fn set(&mut self, index: usize, ball: Option<BallFrame>) {
        if ball.map(|b| b.position) != self.frames[index].map(|b| b.position) {
            (self.frames[index], self.kept[index]) = (ball, None);
        }
    }

    /// Leaves the frames of these sightings.
    pub(in crate::tracking) fn keep_only(&mut self, piece: &[Sighting]) {
        for index in 0..self.frames.len() {
            if piece.iter().all(|s| s.index != index) {
                (self.frames[index], self.kept[index]) = (None, None);
            }
        }
    }

    /// Takes in what was found in a gap.
    fn take_in(&mut self, gap: &Range<usize>, found: Flight) {
        for (index, (frame, kept)) in found.frames.into_iter().zip(found.kept).enumerate() {
            if gap.contains(&index) && frame.is_some() {
                (self.frames[index], self.kept[index]) = (frame, kept);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    fn ball(stereo: bool) -> Option<BallFrame> {
        Some(BallFrame { points: [None, None], position: Point3::origin(), stereo, flattening: None })
    }

    #[test]
    fn truth_a_gap_has_no_frame_in_which_both_cameras_see_the_ball() {
        let mut frames = vec![ball(true); 20];
        frames[5..9].fill(ball(false));
        frames[12..14].fill(None);
        frames[16..].fill(None);
        assert_eq!(gaps(&frames), [5..9, 16..20]);
        assert!(gaps(&vec![None; 20]).is_empty());
    }

    #[test]
    fn truth_what_the_light_does_not_confirm_is_told_where_it_lasts() {
        let mut followed = vec![ball(true); 30];
        // One camera follows another thing up to frame 12, where it is now and then seen as well.
        [1, 3, 6, 10].into_iter().for_each(|k| followed[k] = ball(false));
        let mut measured = followed.clone();
        measured[..13].fill(ball(false));
        // Found at a depth between two wrong ones.
        measured[10] = ball(true);
        // Hidden for a moment.
        (measured[20], measured[21], measured[22]) = (ball(false), None, ball(false));
        assert_eq!(refuted(&followed, &measured), [0, 2, 4, 5, 7, 8, 9, 11, 12]);
        assert!(refuted(&followed, &followed).is_empty());
    }

    #[test]
    fn truth_a_flight_meets_the_ball_it_comes_to_and_no_other() {
        let at = |number: f64, x: f64| Sighting { index: 0, number, place: Point3::new(x, 0.0, 0.0), in_racket: None };
        // Comes back along x at 30 mm a frame.
        let found = [at(10.0, 0.30), at(11.0, 0.33)];
        let toward: Vec<&Sighting> = found.iter().collect();
        assert_eq!(meets(&toward, &at(8.0, 0.25), 1000.0), Some(true));
        assert_eq!(meets(&toward, &at(8.0, 0.45), 1000.0), Some(false));
        // Seven frames away the strings may have turned it anywhere.
        assert_eq!(meets(&toward, &at(3.0, 0.45), 1000.0), None);
    }
}
