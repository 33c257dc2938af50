//! The ball of a shot: found where something flies that meets the racket, followed both ways, measured once more with its light.

use crate::calibration::CameraId;
use crate::footage::{FrameBuffer, FrameSource, GreyImage, GreyView, Rows};
use crate::tracking::ball::ball_choice::{self, Sighting};
use crate::tracking::ball::ball_follower::{BallFollower, Flight};
use crate::tracking::ball::ball_gaps::{STARTS, refuted, stands_at};
use crate::tracking::ball::ball_pieces::{self, straight_pieces};
use crate::tracking::ball::ball_presence;
use crate::tracking::ball::ball_shading::{BallShading, LimbProfile};
use crate::tracking::ball::ball_track::{BallFrame, BallScene};
use crate::tracking::ball::dim_picture::Stretch;
use crate::tracking::ball::free_flight::FreeFlight;
use crate::tracking::ball::leaping_ball::leaping;
use crate::tracking::pictures::shot_frames::{AT_ONCE, Shot, spread};
use crate::tracking::racket::racket_scene::RacketFrame;
use crate::tracking::shot_tracks::TrackingError;
use crate::tracking::tape::tape_blur::out_of_focus;
use nalgebra::{Point3, Vector2};
use rayon::prelude::*;
use std::collections::VecDeque;

/// Blur of the ball's outline in a picture in focus, px, one standard deviation (a ball is no sharp-edged tape).
const BALL_BLUR_PX: f64 = 0.55;
/// A ball is elsewhere when its centre is this many radii away.
const ELSEWHERE_RADII: f64 = 2.2;
/// Longest gap in the ball's track that is looked into again, frames.
const FILLED: f64 = 6.0;
/// Two flights, each in as many frames, that meet at the strings are the ball: no other is looked for.
const LONG_FLIGHT: usize = 30;
/// What the strings turned is the ball, however near others come to them, m.
const TURNED_M: f64 = 1.0;
/// A flight that was lost so near to the stringbed's centre met the strings there, m.
const MET_M: f64 = 0.5;
/// A thing that flew straight in as many frames at a stretch, and in half of those in which it was seen, may be the ball.
const FLIES: usize = 8;
/// What was seen in fewer frames is like nothing.
const FEWEST_LIKE: usize = 6;

/// A thing is followed for so long, s, before the racket is asked whether it is a part of it.
const TRIAL_S: f64 = 0.012;

/// What is known where the ball is looked for: how it looks, where the racket is, and what stands still.
#[derive(Clone, Copy)]
pub struct Stage<'a> {
    pub ball: &'a BallScene<'a>,
    pub racket: &'a [Option<RacketFrame>],
    pub still: &'a [Option<GreyImage>; 2],
}

/// What the frame in which the ball is looked for first holds.
pub struct FirstLook<'s> {
    pub first: usize,
    /// Free flights through it and the next two.
    pub flights: Vec<FreeFlight>,
    /// The first of them tried both ways.
    pub tried: Option<[Tried<'s>; 2]>,
}

/// How free flights are looked for.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Look {
    /// In three frames, against the clip's median picture.
    Still,
    /// In three frames, against pictures half a clip away.
    AgainstAnother,
    /// In any three of some frames.
    Scattered,
}

/// The flight most like the ball's so far.
struct Likeliest {
    /// Less is more like it, m.
    score: f64,
    flight: Flight,
    /// Nothing else need be looked for.
    clear: bool,
    /// The strings turned it.
    turned: bool,
    /// All that was followed and may be the ball, or a part of its way.
    claimed: Vec<Vec<Option<BallFrame>>>,
}

/// A free flight followed to its ends, or until it shows that it is none.
enum Followed {
    MayBeTheBall(Flight),
    NoBall(Vec<Option<BallFrame>>),
}

/// A flight tried one way.
pub struct Tried<'s> {
    /// In which frames of the trial the ball was seen, and where.
    pub seen: Vec<(usize, BallFrame)>,
    /// Who follows it through all frames, and may have gone on already.
    pub follower: BallFollower<'s>,
}

impl<S: FrameSource> Shot<'_, S> {
    /// A ball of which nothing but its size is known.
    pub(in crate::tracking) fn unlit_ball(&self) -> BallScene<'_> {
        let limb = LimbProfile::new(&BallShading::default(), 8.0, BALL_BLUR_PX);
        let radius_m = self.setup.ball.radius_m();
        BallScene { view: self.view, radius_m, limb: [limb.clone(), limb], frame_rate_hz: self.setup.frame_rate_hz, faint: false, dim: [None; 2] }
    }

    /// Frames in which the ball is looked for, in order; two more after each count as well.
    fn looked_into(&self) -> Vec<usize> {
        let mut order = spread(self.source.len().saturating_sub(2 * self.apart()));
        order.truncate(24);
        order
    }

    /// Frames in which the other half of a flight may be found of which `shortest` frames and more up to the strings, or from there, were seen: those
    /// nearest first.
    fn beyond_the_strings(&self, seen: &[Sighting], shortest: usize) -> Vec<usize> {
        let pieces = straight_pieces(seen, self.setup.frame_rate_hz);
        let ends = pieces.iter().filter(|p| p.len() >= shortest).flat_map(|p| [(&p[0], false), (&p[p.len() - 1], true)]);
        let near = ends.filter_map(|(end, forth)| Some((end.in_racket.map(|p| p.coords.norm()).filter(|away| *away < MET_M)?, end.index, forth)));
        let Some((_, end, forth)) = near.min_by(|a, b| a.0.total_cmp(&b.0)) else { return Vec::new() };
        let frames = |start: usize| (start as f64 * self.setup.frame_rate_hz / 1000.0).round() as usize;
        let n = self.source.len();
        let index = |start: usize| if forth { Some(end + frames(start)) } else { end.checked_sub(frames(start) + 2 * self.apart()) };
        STARTS.iter().filter_map(|start| index(*start).filter(|first| first + 2 * self.apart() < n)).collect()
    }

    /// What the first look into the clip finds.
    pub(in crate::tracking) fn first_look<'s>(&self, scene: &BallScene, still: &[Option<GreyImage>; 2]) -> Result<FirstLook<'s>, TrackingError> {
        let first = self.looked_into().first().copied();
        let flights = first.map_or(Ok(Vec::new()), |first| self.flights_from(first, scene, still))?;
        Ok(FirstLook { first: first.unwrap_or_default(), flights, tried: None })
    }

    /// What of a flight is seen one way before the racket is asked whether that is a part of it: as often as the flight was seen, in frames as
    /// far apart, shows it.
    pub(in crate::tracking) fn tried_out<'s>(
        &self,
        scene: &'s BallScene,
        first: usize,
        flight: &[BallFrame; 3],
        forth: bool,
    ) -> Result<Tried<'s>, TrackingError> {
        let every = self.apart();
        let mut follower = self.follower(scene, first, flight, forth, every);
        self.follow_on(&mut follower, (TRIAL_S * self.setup.frame_rate_hz) as usize / every)?;
        let seen = follower.seen().collect();
        // What passed the trial in some frames is followed through all.
        Ok(Tried { seen, follower: if every > 1 { self.follower(scene, first, flight, forth, 1) } else { follower } })
    }

    /// Whether what was tried out moves as no ball does; the frames of the trial are counted as if there were no others.
    fn moves_as_no_ball(&self, tried: &[Option<BallFrame>], racket: &[Option<RacketFrame>]) -> bool {
        let every = self.apart() as f64;
        let looks: Vec<Sighting> = self.sightings(tried, racket).into_iter().map(|s| Sighting { number: s.number / every, ..s }).collect();
        ball_choice::likeness(&looks, tried.iter().flatten().count(), self.setup.frame_rate_hz / every).score.is_infinite()
    }

    /// Finds the ball that meets the racket and follows it both ways, beginning with what the first look found, if there was one. Where none
    /// is seen that the strings turned and the pictures use little of the grey scale it is looked for once more in pictures that are stretched; what
    /// is found so counts where the strings turn it and it flies straight as a ball does, in more frames than what was found before.
    pub(in crate::tracking) fn find_and_follow_ball(
        &self,
        scene: &BallScene,
        racket: &[Option<RacketFrame>],
        still: &[Option<GreyImage>; 2],
        ahead: Option<FirstLook>,
    ) -> Result<Vec<Option<BallFrame>>, TrackingError> {
        let found = self.find_ball(&Stage { ball: scene, racket, still }, ahead)?;
        let turned = |ball: &[Option<BallFrame>]| ball_pieces::turned(&self.sightings(ball, racket), self.setup.frame_rate_hz);
        if turned(&found) {
            return Ok(found);
        }
        let dim = self.stretches(still)?;
        if dim.iter().all(Option::is_none) {
            return Ok(found);
        }
        let again = self.find_ball(&Stage { ball: &BallScene { dim, ..scene.clone() }, racket, still }, None)?;
        let [before, now] = [&found, &again].map(|ball| self.frames_in_flight(ball, racket));
        let flies = self.longest_flight(&again, racket) >= FLIES && 2 * now >= again.iter().flatten().count();
        Ok(if flies && now > before && turned(&again) { again } else { found })
    }

    /// How either camera's pictures are stretched, as the middle of the clip shows them.
    fn stretches(&self, still: &[Option<GreyImage>; 2]) -> Result<[Option<Stretch>; 2], TrackingError> {
        let Some(index) = self.looked_into().first().copied() else { return Ok([None; 2]) };
        self.with_buffers(|buffers| {
            let images = self.read(index, buffers)?;
            Ok([0, 1].map(|c| Stretch::of(images[c].as_ref()?, still[c].as_ref()?)))
        })
    }

    /// The ball that meets the racket, measured with its light.
    fn find_ball(&self, stage: &Stage, ahead: Option<FirstLook>) -> Result<Vec<Option<BallFrame>>, TrackingError> {
        let racket = stage.racket;
        let Likeliest { mut flight, clear, claimed, .. } = self.likeliest_flight(stage, ahead)?;
        if clear {
            self.take_in_other_half(&mut flight, &claimed, racket);
            return self.remeasure_ball(stage, flight);
        }
        let seen = flight.frames.iter().flatten().count();
        let flies = self.stands_in(&claimed, racket, 0)
            || self.longest_flight(&flight.frames, racket) >= FLIES && 2 * self.frames_in_flight(&flight.frames, racket) >= seen;
        self.keep_free_flight(stage.ball, &mut flight, &claimed, racket)?;
        let mut followed = self.remeasure_ball(stage, flight)?;
        // What was gone over to may be the throat, seen through the frame from start to end of what is left.
        if self.is_part_of_the_racket(&followed, racket) {
            followed.fill(None);
        } else if flies {
            return Ok(followed);
        }
        let found = match self.flight_to_the_racket(stage, false)? {
            None => self.flight_to_the_racket(stage, true)?,
            found => found,
        };
        let Some(mut found) = found else { return Ok(followed) };
        self.mean_discs_again(stage.ball, &mut found)?;
        let found = self.remeasure_ball(stage, found)?;
        let frames = [&followed, &found].map(|ball| self.frames_in_flight(ball, racket));
        Ok(if frames[1] > frames[0] { found } else { followed })
    }

    /// Of the free flights in the frames looked into, followed both ways, the one most like the ball's.
    fn likeliest_flight(&self, stage: &Stage, ahead: Option<FirstLook>) -> Result<Likeliest, TrackingError> {
        let Stage { ball: scene, racket, still } = *stage;
        let n = self.source.len();
        let (mut flights_ahead, mut tried_ahead) = ahead.map_or((None, None), |ahead| (Some(ahead.flights), ahead.tried));
        let none = Flight { frames: vec![None; n], means: Default::default(), kept: vec![None; n] };
        let mut best = Likeliest { score: f64::INFINITY, flight: none, clear: false, turned: false, claimed: Vec::new() };
        // What is told to be no ball.
        let mut told: Vec<Vec<Option<BallFrame>>> = Vec::new();
        for how in [Look::Still, Look::AgainstAnother, Look::Scattered] {
            if best.clear || how != Look::Still && self.stands_in(&best.claimed, racket, 0) {
                break;
            }
            let mut order: VecDeque<usize> = self.looked_into().into();
            while let Some(first) = order.pop_front() {
                let told_from = |flights: Vec<FreeFlight>| flights.into_iter().map(|flight| (first, flight)).collect();
                let flights: Vec<(usize, FreeFlight)> = match (flights_ahead.take(), how) {
                    (Some(flights), _) => told_from(flights),
                    (None, Look::Still) => told_from(self.flights_from(first, scene, still)?),
                    (None, Look::AgainstAnother) => told_from(self.flights_against_another(first, scene)?),
                    (None, Look::Scattered) => self.scattered_flights_from(first, scene, still)?,
                };
                for (first, flight) in flights {
                    if best.claimed.iter().chain(&told).any(|t| stands_at(t, first + self.apart(), &flight.balls[1], self.apart())) {
                        continue;
                    }
                    let track = match self.follow_free_flight(stage, first, &flight, tried_ahead.take())? {
                        Followed::MayBeTheBall(track) => track,
                        Followed::NoBall(frames) => {
                            told.push(frames);
                            continue;
                        }
                    };
                    if let Some(seen) = self.take_if_likelier(&mut best, track, racket) {
                        // Its other half is nearest where it was lost; if it is not there, the rest of this frame is.
                        let beyond = if best.turned { Vec::new() } else { self.beyond_the_strings(&seen, if best.clear { FLIES } else { LONG_FLIGHT }) };
                        if !beyond.is_empty() {
                            order.push_front(first);
                            beyond.into_iter().rev().for_each(|index| order.push_front(index));
                            break;
                        }
                    }
                    if best.clear && best.turned {
                        break;
                    }
                }
                // In a long clip nothing else flies to the strings and away for so long.
                if best.clear && best.turned || self.stands_in(&best.claimed, racket, LONG_FLIGHT) {
                    break;
                }
            }
        }
        Ok(best)
    }

    /// Follows a free flight in three frames, the first of them `first`, both ways to its ends, beginning with what was tried out of it.
    fn follow_free_flight(&self, stage: &Stage, first: usize, flight: &FreeFlight, tried: Option<[Tried; 2]>) -> Result<Followed, TrackingError> {
        let FreeFlight { balls, clear: told_clearly } = flight;
        let ways = match tried {
            Some(ways) => ways,
            None => {
                let tried_out = |forth: bool| self.tried_out(stage.ball, first, balls, forth);
                let (back, forth) = rayon::join(|| tried_out(false), || tried_out(true));
                [back?, forth?]
            }
        };
        // What goes with the racket shows it soon. What faint outlines tell is another thing in seven cases of ten, and moves as no ball does.
        let tried = self.followed(first, balls, ways.iter().flat_map(|way| way.seen.iter().copied()));
        if self.is_part_of_the_racket(&tried, stage.racket) || !told_clearly && self.moves_as_no_ball(&tried, stage.racket) {
            return Ok(Followed::NoBall(tried));
        }
        let mut track = self.whole_flight(first, balls, self.both_to_the_end(ways.map(|way| way.follower))?);
        // Frames between those that tell it.
        track.frames.iter_mut().for_each(|ball| *ball = ball.filter(|b| b.points.iter().any(Option::is_some)));
        Ok(if self.is_part_of_the_racket(&track.frames, stage.racket) { Followed::NoBall(track.frames) } else { Followed::MayBeTheBall(track) })
    }

    /// Takes what was followed for the ball's flight if it is more like it than what was so far; then answers with where both cameras saw it.
    fn take_if_likelier(&self, best: &mut Likeliest, track: Flight, racket: &[Option<RacketFrame>]) -> Option<Vec<Sighting>> {
        best.claimed.push(track.frames.clone());
        let count = track.frames.iter().flatten().count();
        if count < FEWEST_LIKE {
            return None;
        }
        let seen = self.sightings(&track.frames, racket);
        let likeness = ball_choice::likeness(&seen, count, self.setup.frame_rate_hz);
        let turned = ball_pieces::turned(&seen, self.setup.frame_rate_hz);
        let score = likeness.score - if turned { TURNED_M } else { 0.0 };
        // Less clear than what it is the other half of, it does not stand in its stead.
        let halves = || self.stands_in(&[best.flight.frames.clone(), track.frames.clone()], racket, LONG_FLIGHT);
        if !(score < best.score) || best.clear && !likeness.clear && halves() {
            return None;
        }
        (best.score, best.flight, best.clear, best.turned) = (score, track, likeness.clear, turned);
        Some(seen)
    }

    /// Where both cameras saw a thing that was followed.
    pub(in crate::tracking) fn sightings(&self, frames: &[Option<BallFrame>], racket: &[Option<RacketFrame>]) -> Vec<Sighting> {
        let of = |(index, (ball, racket)): (usize, (&Option<BallFrame>, &Option<RacketFrame>))| {
            let place = ball.as_ref().filter(|b| b.stereo)?.position;
            Some(self.sighting(index, place, racket.as_ref()))
        };
        frames.iter().zip(racket).enumerate().filter_map(of).collect()
    }

    pub(in crate::tracking) fn sighting(&self, index: usize, place: Point3<f64>, racket: Option<&RacketFrame>) -> Sighting {
        let in_racket = racket.map(|r| r.pose.global_from_racket.inverse() * place);
        Sighting { index, number: self.source.number(index) as f64, place, in_racket }
    }

    /// Learns the light from the ball as first measured, then measures every frame again with it. Where the picture is as it is without
    /// a ball, there is none.
    fn remeasure_ball(&self, stage: &Stage, mut rough: Flight) -> Result<Vec<Option<BallFrame>>, TrackingError> {
        let racket = stage.racket;
        let mut scene = stage.ball.clone();
        for index in leaping(self.source, &rough.frames, self.setup.frame_rate_hz) {
            rough.set(index, None);
        }
        let Some(near) = rough.frames.iter().flatten().find(|b| b.stereo).map(|b| b.position) else { return Ok(rough.frames) };
        scene.set_light(&rough.means, &near, &self.blur_px.map(|tape| out_of_focus(BALL_BLUR_PX, tape)));
        let lit = &Stage { ball: &scene, ..*stage };
        let Some(mut ball) = self.fill_and_measure(lit, &mut rough)? else { return Ok(vec![None; rough.frames.len()]) };
        // A turn along one camera's line of sight shows to the other alone: if that saw nothing of it before the light was known, the ball was followed
        // through the strings at a depth of its own, where other outlines agree with it. With the light they do not, and the ball is looked for afresh.
        let refuted = refuted(&rough.frames, &ball);
        if !refuted.is_empty() {
            for index in refuted {
                rough.set(index, ball[index]);
            }
            let again = self.fill_and_measure(lit, &mut rough)?;
            ball = again.filter(|again| self.frames_in_flight(again, racket) > self.frames_in_flight(&ball, racket)).unwrap_or(ball);
        }
        scene.faint = true;
        self.forget_other_things(&Stage { ball: &scene, ..*stage }, &mut ball);
        for index in leaping(self.source, &ball, self.setup.frame_rate_hz) {
            ball[index] = None;
        }
        self.press_ball(&scene, racket, &mut ball)?;
        Ok(ball)
    }

    /// Fills the gaps of what was followed and measures every frame again; `None` where that was a part of the racket.
    fn fill_and_measure(&self, stage: &Stage, rough: &mut Flight) -> Result<Option<Vec<Option<BallFrame>>>, TrackingError> {
        let Stage { racket, still, .. } = *stage;
        self.fill_gaps(stage, rough)?;
        // A piece of something may fly as a ball does, and what it was a piece of may not.
        if self.is_part_of_the_racket(&rough.frames, racket) {
            return Ok(None);
        }
        let Flight { frames: rough, kept, .. } = &*rough;
        let scene = BallScene { faint: true, ..stage.ball.clone() };
        let numbers: Vec<f64> = (0..rough.len()).map(|i| self.source.number(i) as f64).collect();
        let scene = &scene;
        let again = |buffers: &mut [FrameBuffer; 2], index: usize| {
            let expected = match &rough[index] {
                Some(b) if b.stereo => Some((b.position, true)),
                // What one camera saw is looked for again with the depth that both knew before or after.
                Some(b) => Some((expected_ball(rough, &numbers, index).map_or(b.position, |(p, _)| p), true)),
                None => expected_ball(rough, &numbers, index),
            };
            let Some((p, within)) = expected else { return Ok((None, [None; 2])) };
            let close = match &kept[index] {
                Some(kept) => {
                    let images = kept.patches.each_ref().map(|p| Some(p.view()));
                    scene.measure_close(&images, &p, kept.levels.as_deref(), 1.0, true).map(|(found, _)| (found, images))
                }
                None => Err([None, None]),
            };
            let (found, images) = match close {
                Ok((found, images)) => (Some(found), images),
                Err(fits) => {
                    let images = self.read_rows(index, self.ball_rows(scene, &p, 1), buffers)?;
                    (scene.measure(&images, &p, [1, 1], 1.0, &fits), images)
                }
            };
            // Beyond the flight's ends nobody has seen a ball: there both cameras must agree.
            let found = found.filter(|b| within || b.stereo);
            let changes = CameraId::BOTH.map(|c| {
                let (image, still, radius) = (images[c.index()].as_ref()?, still[c.index()].as_ref()?, scene.radius_px(c, &p)?);
                ball_presence::change(image, &GreyView::of(still), &found?.points[c.index()]?.uv, radius)
            });
            Ok((found, changes))
        };
        let all: Result<Vec<_>, TrackingError> = (0..rough.len()).into_par_iter().with_max_len(AT_ONCE).map_init(Default::default, again).collect();
        let (mut ball, changes): (Vec<_>, Vec<_>) = all?.into_iter().unzip();
        for (index, camera, least) in ball_presence::absent(&changes) {
            let still_there = self.change_from_elsewhere(scene, &ball, index, camera)?.is_some_and(|c| c >= least);
            if !still_there {
                BallFrame::forget(&mut ball[index], camera);
            }
        }
        Ok(Some(ball))
    }

    /// How much the ball changes a picture from what other frames show there while the ball is seen elsewhere: a ball that hardly moves in a
    /// picture for half of the clip is in the median picture itself.
    fn change_from_elsewhere(&self, scene: &BallScene, ball: &[Option<BallFrame>], index: usize, camera: usize) -> Result<Option<f64>, TrackingError> {
        let places: Vec<Option<Vector2<f64>>> = ball.iter().map(|b| b.as_ref()?.points[camera].map(|p| p.uv)).collect();
        let Some(centre) = places[index] else { return Ok(None) };
        let Some(radius) = ball[index].as_ref().and_then(|b| scene.radius_px(CameraId::BOTH[camera], &b.position)) else { return Ok(None) };
        let Some(elsewhere) = ball_presence::elsewhere(&places, index, ELSEWHERE_RADII * radius) else { return Ok(None) };
        let rows = Rows::span((centre.y - radius).max(0.0) as usize, (2.0 * radius) as usize + 2);
        let (mut buffer, mut other) = (FrameBuffer::default(), FrameBuffer::default());
        let Some(image) = self.read_one(index, camera, rows, &mut buffer)? else { return Ok(None) };
        let mut changes = Vec::new();
        for at in elsewhere {
            let behind = self.read_one(at, camera, rows, &mut other)?;
            changes.extend(behind.and_then(|behind| ball_presence::change(&image, &behind, &centre, radius)));
        }
        changes.sort_by(f64::total_cmp);
        Ok(changes.get(changes.len().saturating_sub(1) / 2).copied())
    }

    /// The rows of each picture that measuring the ball near a place looks at: its outline may be found `reach_px` away, and
    /// the fit may move by most of a radius from there.
    pub(in crate::tracking) fn ball_rows(&self, scene: &BallScene, at: &Point3<f64>, reach_px: i32) -> [Rows; 2] {
        CameraId::BOTH.map(|camera| {
            let (Some(uv), Some(radius)) = (self.view.project(camera, at), scene.radius_px(camera, at)) else { return Rows::ALL };
            self.rows_between(uv.y, uv.y, 2.0 * radius + f64::from(reach_px) + 8.0)
        })
    }

    /// The rows between two places and `more` beyond them, px.
    pub(in crate::tracking) fn rows_between(&self, a: f64, b: f64, more: f64) -> Rows {
        Rows::of([self.view.rows(a.min(b) - more, a.max(b) + more)])
    }
}

/// Where a ball that was not seen by both cameras should be: on the straight line between its neighbours in time that
/// were, or beyond the last two (then `false`), over at most [`FILLED`] frames.
pub(in crate::tracking) fn expected_ball(seen: &[Option<BallFrame>], numbers: &[f64], index: usize) -> Option<(Point3<f64>, bool)> {
    let known = |i: &usize| seen[*i].is_some_and(|b| b.stereo) && (numbers[*i] - numbers[index]).abs() <= FILLED;
    let before: Vec<usize> = (0..index).rev().filter(known).take(2).collect();
    let after: Vec<usize> = (index + 1..seen.len()).filter(known).take(2).collect();
    let (a, b) = match (before.as_slice(), after.as_slice()) {
        ([a, ..], [b, ..]) => (*a, *b),
        ([a, b], []) | ([], [a, b]) => (*b, *a),
        _ => return None,
    };
    let (p, q) = (seen[a]?.position, seen[b]?.position);
    let within = !before.is_empty() && !after.is_empty();
    Some((p + (q - p) * ((numbers[index] - numbers[a]) / (numbers[b] - numbers[a])), within))
}
