//! A flight that one camera sees clearly and the other hardly: over lettering, before a wall of its own grey.
//!
//! In the clear camera the ball is found by itself, picture by picture, as what flies straight from the strings (or to them). From a dozen metres
//! away that leaves its depth free, and how that changes: a line over time. Faint outlines of the other camera along the epipolar lines each mean
//! a depth, and those of one flight lie on one such line, which lettering and strings do not bring about.

use crate::calibration::CameraId;
use crate::footage::{FrameBuffer, FrameSource, GreyView};
use crate::tracking::ball::ball_choice::Sighting;
use crate::tracking::ball::ball_follower::Flight;
use crate::tracking::ball::ball_pieces::foretold;
use crate::tracking::ball::ball_presence;
use crate::tracking::ball::ball_track::{BallScene, FASTEST_M_S};
use crate::tracking::ball::part_of_racket::IN_THE_HEAD_M;
use crate::tracking::ball::ray_flight::{Origin, RayFlight, RayPoint};
use crate::tracking::ball::shot_ball::Stage;
use crate::tracking::pictures::background::background_of;
use crate::tracking::pictures::shot_frames::{AT_ONCE, Shot};
use crate::tracking::racket::racket_scene::RacketFrame;
use crate::tracking::shot_tracks::TrackingError;
use nalgebra::Point3;
use rayon::prelude::*;
use std::ops::{Range, RangeInclusive};

/// Frames from the known ball over which a flight is looked for, at 1000 frames a second, and how many of them are looked at.
const LOOKED_INTO: f64 = 40.0;
const MOST_FRAMES: usize = 48;
/// The ball was last known on the strings; what it did there moves the flight's origin by this, m (30 m/s for 2 ms).
const ORIGIN_SD_M: f64 = 0.05;
/// The ball is on the strings within so many frames of where it is known, at 1000 frames a second.
const LONGEST_TURN: f64 = 12.0;
/// Of a ball of which nothing is known, the racket is about so near, m.
const AROUND_M: f64 = 0.6;
/// A straight flight from there is believed when it comes within so many deviations of it.
const ORIGIN_LIMIT: f64 = 2.5;
/// Two sightings that may begin a flight are so many of the frames looked at apart; from there it grows by so many, then by all.
const APART: RangeInclusive<usize> = 2..=6;
const GROWING: [f64; 4] = [6.0, 12.0, f64::INFINITY, f64::INFINITY];
/// A point belongs to a flight when it is this near, px; outlines without the light are good to half a pixel.
const NEAR_PX: f64 = 1.5;
/// Fewest points of a flight in the clear camera, and the share of its frames.
const FEWEST: usize = 7;
const LEAST_SHARE: f64 = 0.6;
/// Fewest frames in which both cameras see it then, one after the other in a straight line, before its light is known.
const FEWEST_IN_BOTH: usize = 5;
/// Flights of one camera that the other one is asked about.
const MOST_CLEAR: usize = 3;
/// Fewest faint outlines in the other camera, their share of the clear one's points, and how much more than on any other line.
const FEWEST_FAINT: f64 = 5.0;
const LEAST_FAINT_SHARE: f64 = 0.4;
const MORE_THAN_ELSEWHERE: f64 = 1.5;
/// More are needed where the discs tell what the outlines alone do not.
const FEWEST_DISCS: f64 = 6.0;
const LEAST_DISC_SHARE: f64 = 0.5;
/// Where a picture changes by less than so many times what still surroundings do, or by less than so many more than close around, there is no ball.
const CHANGED: f64 = 2.0;
const STANDS_OUT: f64 = 1.0;
/// Outlines that mean one flight agree to this, px, along the epipolar line and across it; two that tell a flight are so many of the frames looked at apart.
const AGREED_PX: f64 = 1.0;
const LINE_APART: usize = 4;
/// Steps along the epipolar line, px, at most so many, and how fast the ball may come along the clear camera's line of sight.
const STEP_PX: f64 = 1.5;
const MOST_PLACES: f64 = 250.0;
const FASTEST_ALONG_M_S: f64 = 60.0;
/// Slowest and fastest ball, m/s.
const SPEEDS_M_S: (f64, f64) = (3.0, FASTEST_M_S);

/// A faint outline of one camera on the other one's ray, and what it means.
#[derive(Debug, Clone, Copy)]
struct Meant {
    /// Along the other camera's axis of view, m: of a straight flight it changes evenly.
    depth: f64,
    /// Of the outline that is seen.
    share: f64,
    /// Of the picture where it lies and around that, grey levels.
    change: f64,
    around: f64,
    point: RayPoint,
}

impl Meant {
    /// How much more the disc has changed than what is around it.
    fn stands_out(&self) -> f64 {
        self.change - self.around
    }
}

/// Depths that change evenly.
#[derive(Debug, Clone, Copy)]
struct DepthLine {
    number: f64,
    depth: f64,
    /// m per frame.
    step: f64,
    near_m: f64,
}

impl DepthLine {
    fn at(&self, number: f64) -> f64 {
        self.depth + self.step * (number - self.number)
    }

    /// How far a point is off the line, in what counts as near.
    fn misses(&self, m: &Meant) -> f64 {
        (m.depth - self.at(m.point.number)).abs() / self.near_m
    }

    /// Of every frame the nearest point, if it is near; the points of a frame come in order of depth.
    fn agreed<'m>(&self, meant: &'m [Vec<Meant>]) -> impl Iterator<Item = &'m Meant> {
        let nearest = move |frame: &'m Vec<Meant>| {
            let there = self.at(frame.first()?.point.number);
            let next = frame.partition_point(|m| m.depth < there);
            let around = &frame[next.saturating_sub(1)..(next + 1).min(frame.len())];
            around.iter().min_by(|a, b| self.misses(a).total_cmp(&self.misses(b))).filter(|m| self.misses(m) < 1.0)
        };
        meant.iter().filter_map(nearest)
    }

    /// What is seen along it.
    fn shown(&self, meant: &[Vec<Meant>], of: fn(&Meant) -> f64) -> f64 {
        self.agreed(meant).map(of).sum()
    }
}

/// Of the lines that may be the ball's, the one along which most is seen `of` what is asked for; by frames, the points in order of depth.
fn straight_line(meant: &[Vec<Meant>], may_be: &dyn Fn(&DepthLine) -> bool, near_m: f64, of: fn(&Meant) -> f64) -> Option<DepthLine> {
    let mut best: Option<(f64, DepthLine)> = None;
    for (k, first) in meant.iter().enumerate() {
        let later = meant.iter().skip(k + LINE_APART.max(meant.len() / 3));
        for (a, b) in later.flat_map(|second| first.iter().flat_map(move |a| second.iter().map(move |b| (a, b)))) {
            let step = (b.depth - a.depth) / (b.point.number - a.point.number);
            let line = DepthLine { number: a.point.number, depth: a.depth, step, near_m };
            let shown = line.shown(meant, of);
            if best.is_none_or(|best| shown > best.0) && may_be(&line) {
                best = Some((shown, line));
            }
        }
    }
    best.map(|b| b.1)
}

/// The points of the line along which most is seen, where no other line, whose points lie at least `apart_m` from it, shows nearly as much.
fn clearest_line(
    mut meant: Vec<Vec<Meant>>,
    may_be: &dyn Fn(&DepthLine) -> bool,
    [near_m, apart_m]: [f64; 2],
    of: fn(&Meant) -> f64,
    fewest: f64,
) -> Option<Vec<Meant>> {
    let line = straight_line(&meant, may_be, near_m, of)?;
    let (shown, points) = (line.shown(&meant, of), line.agreed(&meant).copied().collect::<Vec<_>>());
    meant.iter_mut().for_each(|frame| frame.retain(|m| line.misses(m) * near_m > apart_m));
    let elsewhere = straight_line(&meant, may_be, near_m, of).map_or(0.0, |other| other.shown(&meant, of));
    (points.len() as f64 >= fewest && shown >= MORE_THAN_ELSEWHERE * elsewhere).then_some(points)
}

/// The other camera's points of one flight, and how much of an outline they show in all; `None` where no line stands out. `radius_m` is the ball's
/// in depth, `clear` how many points the clear camera has.
fn of_one_flight(mut meant: Vec<Vec<Meant>>, may_be: &dyn Fn(&DepthLine) -> bool, [near_m, radius_m]: [f64; 2], clear: usize) -> Option<(f64, Vec<RayPoint>)> {
    // Most outlines are the surroundings', which do not change.
    let mut changes: Vec<f64> = meant.iter().flatten().map(|m| m.change).collect();
    changes.sort_by(f64::total_cmp);
    let still = *changes.get(changes.len() / 4)?;
    for frame in &mut meant {
        frame.retain(|m| m.change > CHANGED * still);
        frame.sort_by(|a, b| a.depth.total_cmp(&b.depth));
    }
    // Where strings and frame move there are outlines everywhere, but hardly one whose disc alone has changed; what lies within the ball is its own.
    let disc = |frame: &Vec<Meant>| frame.iter().filter(|m| m.stands_out() > STANDS_OUT * still).copied().collect::<Vec<_>>();
    let discs: Vec<Vec<Meant>> = meant.iter().map(disc).collect();
    let fewest = f64::max(FEWEST_FAINT, LEAST_FAINT_SHARE * clear as f64);
    let fewest_discs = f64::max(FEWEST_DISCS, LEAST_DISC_SHARE * clear as f64);
    let points = clearest_line(meant, may_be, [near_m, 2.0 * near_m], |m| m.share, fewest)
        .or_else(|| clearest_line(discs, may_be, [near_m, radius_m], |m| m.share * m.stands_out(), fewest_discs))?;
    Some((points.iter().map(|m| m.share).sum(), points.iter().map(|m| m.point).collect()))
}

impl<S: FrameSource> Shot<'_, S> {
    /// Looks in a gap for the ball's flight from (or to) where it is known beside it.
    pub(in crate::tracking) fn flight_of_one_camera(&self, stage: &Stage, gap: &Range<usize>, flight: &Flight) -> Result<Option<Flight>, TrackingError> {
        for forth in [true, false] {
            let Some(origin) = self.at_the_strings(gap, flight, stage.racket, forth) else { continue };
            let near = |i: &usize| (self.source.number(*i) as f64 - origin.number).abs() <= LOOKED_INTO * self.setup.frame_rate_hz / 1000.0;
            let indices: Vec<usize> = gap.clone().filter(near).collect();
            if indices.len() < FEWEST {
                continue;
            }
            let found = match self.clear_in_one(stage, &indices, &origin, SPEEDS_M_S)? {
                None => self.hovering_in_one(stage, gap, &indices, &origin)?,
                found => found,
            };
            if found.is_some() {
                return Ok(found);
            }
        }
        Ok(None)
    }

    /// Looks for a ball that meets the racket where no three frames show one to both cameras; one that `hovers` in one of them, if so asked.
    pub(in crate::tracking) fn flight_to_the_racket(&self, stage: &Stage, hovers: bool) -> Result<Option<Flight>, TrackingError> {
        let n = self.source.len();
        let most = (LOOKED_INTO * self.setup.frame_rate_hz / 1000.0) as usize;
        // Beside a window in which it hovers there must be frames without it.
        let window = if hovers { most.min(n / 2) } else { most }.clamp(FEWEST, n.max(FEWEST));
        let mut best: Option<(usize, Flight)> = None;
        for first in (0..n).step_by(window.div_ceil(2)) {
            let frames = first..(first + window).min(n);
            let Some(pose) = stage.racket[frames.clone()].iter().flatten().map(|r| r.pose.global_from_racket).next() else { continue };
            let number = self.source.number((frames.start + frames.end) / 2) as f64;
            let origin = Origin { number, place: pose.translation.vector.into(), sd_m: AROUND_M, frame_rate_hz: self.setup.frame_rate_hz };
            let indices: Vec<usize> = frames.clone().collect();
            let found =
                if hovers { self.hovering_in_one(stage, &frames, &indices, &origin)? } else { self.clear_in_one(stage, &indices, &origin, SPEEDS_M_S)? };
            let Some(mut found) = found else { continue };
            let Some(longest) = self.flights_of(&found.frames, stage.racket).into_iter().max_by_key(Vec::len) else { continue };
            if longest.len() >= FEWEST_IN_BOTH && best.as_ref().is_none_or(|b| longest.len() > b.0) {
                found.keep_only(&longest);
                best = Some((longest.len(), found));
            }
        }
        Ok(best.map(|b| b.1))
    }

    /// [`Self::clear_in_one`] of a ball that hardly moves in a camera's pictures, along its line of sight: the median of all frames holds the ball
    /// itself, that of those `beside` which it is looked for does not.
    fn hovering_in_one(&self, stage: &Stage, beside: &Range<usize>, indices: &[usize], origin: &Origin) -> Result<Option<Flight>, TrackingError> {
        let others: Vec<usize> = (0..self.source.len()).filter(|i| !beside.contains(i)).collect();
        let (left, right) = rayon::join(|| background_of(self.source, 0, &others), || background_of(self.source, 1, &others));
        self.clear_in_one(&Stage { still: &[left?, right?], ..*stage }, indices, origin, (0.0, SPEEDS_M_S.1))
    }

    /// What is measured of the flight near an origin that one camera sees clearly in these frames. `across` is how fast it may be in that camera
    /// alone, m/s.
    fn clear_in_one(&self, stage: &Stage, indices: &[usize], origin: &Origin, across: (f64, f64)) -> Result<Option<Flight>, TrackingError> {
        let every = indices.len().div_ceil(MOST_FRAMES).max(1);
        let looked_at: Vec<usize> = indices.iter().copied().step_by(every).collect();
        let outlines = self.outlines(stage, &looked_at, &origin.place)?;
        let faint = &BallScene { faint: true, ..stage.ball.clone() };
        let mut best: Option<(f64, RayFlight, Vec<RayPoint>)> = None;
        for camera in CameraId::BOTH {
            for clear in self.clear_flights(&outlines[camera.index()], origin, every, stage.racket, across) {
                if let Some((shown, whole)) = self.with_other_camera(&Stage { ball: faint, ..*stage }, &clear, origin)?
                    && best.as_ref().is_none_or(|b| shown > b.0)
                {
                    best = Some((shown, whole, clear));
                }
            }
        }
        let Some((_, whole, clear)) = best else { return Ok(None) };
        // Nearer to the origin than it was seen the strings have it.
        let [first, last] = [clear.first(), clear.last()].map(|p| p.map_or(origin.number, |p| p.number));
        let free = |number: f64| (number >= first || last < origin.number) && (number <= last || first > origin.number);
        let along: Vec<usize> = indices.iter().copied().filter(|i| free(self.source.number(*i) as f64)).collect();
        self.along(stage.ball, &whole, &along).map(Some)
    }

    /// Where the ball known before a gap (`forth`) or after it was nearest to the string plane, seen there or flying straight on.
    fn at_the_strings(&self, gap: &Range<usize>, flight: &Flight, racket: &[Option<RacketFrame>], forth: bool) -> Option<Origin> {
        let (known, piece) = self.known_beside(&flight.frames, racket, gap, forth);
        let last = known.last()?;
        let from_last = |index: &usize| (self.source.number(*index) as f64 - last.number).abs() <= LONGEST_TURN * self.setup.frame_rate_hz / 1000.0;
        let went_on = |index: usize| self.sighting(index, foretold(&piece, self.source.number(index) as f64), racket[index].as_ref());
        let beyond: Vec<Sighting> = if piece.is_empty() { Vec::new() } else { gap.clone().filter(from_last).map(went_on).collect() };
        let seen = known.iter().rev().take_while(|s| from_last(&s.index));
        let off_plane = |s: &&Sighting| s.in_racket.filter(|p| p.xy().coords.norm() < IN_THE_HEAD_M).map(|p| p.z.abs());
        let (off, nearest) = seen.chain(&beyond).filter_map(|s| Some((off_plane(&s)?, s))).min_by(|a, b| a.0.total_cmp(&b.0))?;
        (off < ORIGIN_SD_M).then_some(Origin { number: nearest.number, place: nearest.place, sd_m: ORIGIN_SD_M, frame_rate_hz: self.setup.frame_rate_hz })
    }

    /// Outlines of the ball's size in both cameras' pictures of these frames, whatever they belong to.
    fn outlines(&self, stage: &Stage, indices: &[usize], near: &Point3<f64>) -> Result<[Vec<RayPoint>; 2], TrackingError> {
        let of_frame = |buffers: &mut [FrameBuffer; 2], index: &usize| {
            let images = self.read(*index, buffers)?;
            Ok(CameraId::BOTH.map(|camera| {
                let c = camera.index();
                let (Some(image), Some(behind), Some(radius)) = (&images[c], &stage.still[c], stage.ball.radius_px(camera, near)) else { return Vec::new() };
                let number = self.source.number(*index) as f64;
                stage
                    .ball
                    .candidates(image, camera, behind, radius)
                    .iter()
                    .filter_map(|place| stage.ball.outline_near(image, camera, place.uv, radius))
                    .map(|outline| RayPoint { index: *index, number, camera, uv: outline.uv })
                    .collect()
            }))
        };
        let all: Result<Vec<[Vec<RayPoint>; 2]>, TrackingError> = indices.par_iter().with_max_len(1).map_init(Default::default, of_frame).collect();
        let mut out = [Vec::new(), Vec::new()];
        for frame in all? {
            out.iter_mut().zip(frame).for_each(|(out, points)| out.extend(points));
        }
        Ok(out)
    }

    /// The straight flights near the origin on which most outlines of one camera lie, the longest first; one frame in `every` was looked at.
    fn clear_flights(&self, outlines: &[RayPoint], origin: &Origin, every: usize, racket: &[Option<RacketFrame>], across: (f64, f64)) -> Vec<Vec<RayPoint>> {
        let begins = |a: &RayPoint, b: &RayPoint| b.index.checked_sub(a.index).is_some_and(|apart| APART.contains(&(apart / every)));
        let pairs: Vec<[RayPoint; 2]> = outlines.iter().flat_map(|a| outlines.iter().filter(|b| begins(a, b)).map(|b| [*a, *b])).collect();
        let within = |middle: f64, reach: f64| outlines.iter().filter(move |p| (p.number - middle).abs() <= reach * every as f64);
        let grown = |[a, b]: &[RayPoint; 2]| -> Option<Vec<RayPoint>> {
            let middle = 0.5 * (a.number + b.number);
            let straight_on = |p: &&RayPoint| (p.uv - a.uv - (b.uv - a.uv) * ((p.number - a.number) / (b.number - a.number))).norm() < 2.0 * NEAR_PX;
            if within(middle, GROWING[0]).filter(straight_on).count() < FEWEST / 2 {
                return None;
            }
            let mut members = vec![*a, *b];
            // From the pair outward: two points foretell their neighbours, many the whole flight.
            for reach in GROWING {
                let flight = RayFlight::fit(self.view, &members, origin).filter(|f| self.may_be_a_ball(f, origin, across))?;
                members = self.on_flight(&flight, within(middle, reach));
                if members.len() < FEWEST / 2 {
                    return None;
                }
            }
            let frames = (members.last()?.index - members.first()?.index) / every + 1;
            let long = members.len() >= FEWEST && members.len() as f64 >= LEAST_SHARE * frames as f64;
            (long && !self.keeps_its_place(&members, racket)).then_some(members)
        };
        let mut all: Vec<Vec<RayPoint>> = pairs.par_iter().with_max_len(AT_ONCE).filter_map(grown).collect();
        let mut out: Vec<Vec<RayPoint>> = Vec::new();
        all.sort_by_key(|members| std::cmp::Reverse(members.len()));
        for members in all {
            let same = |other: &Vec<RayPoint>| 2 * members.iter().filter(|p| other.iter().any(|q| q.index == p.index && q.uv == p.uv)).count() > members.len();
            if out.len() < MOST_CLEAR && !out.iter().any(same) {
                out.push(members);
            }
        }
        out
    }

    /// Whether a flight comes from the origin with one of these speeds, m/s.
    fn may_be_a_ball(&self, flight: &RayFlight, origin: &Origin, speeds: (f64, f64)) -> bool {
        let speed = flight.step_m() * self.setup.frame_rate_hz;
        (speeds.0..speeds.1).contains(&speed) && (flight.at(origin.number) - origin.place).norm() < ORIGIN_LIMIT * origin.sd_m
    }

    /// The points near to where a flight passes, one in each frame.
    fn on_flight<'a>(&self, flight: &RayFlight, points: impl Iterator<Item = &'a RayPoint>) -> Vec<RayPoint> {
        let mut out: Vec<(f64, RayPoint)> = Vec::new();
        for p in points {
            let Some(off) = self.view.project(p.camera, &flight.at(p.number)).map(|uv| (p.uv - uv).norm()).filter(|off| *off < NEAR_PX) else { continue };
            match out.last_mut() {
                Some(last) if last.1.index == p.index => {
                    if off < last.0 {
                        *last = (off, *p);
                    }
                }
                _ => out.push((off, *p)),
            }
        }
        out.into_iter().map(|p| p.1).collect()
    }

    /// The flight along the clear camera's rays that most of the other camera's outlines agree with, and how much of an outline they show in all.
    fn with_other_camera(&self, stage: &Stage, clear: &[RayPoint], origin: &Origin) -> Result<Option<(f64, RayFlight)>, TrackingError> {
        let faint = stage.ball;
        let Some(middle) = clear.get(clear.len() / 2) else { return Ok(None) };
        let other = if middle.camera == CameraId::Left { CameraId::Right } else { CameraId::Left };
        let (eye, Some(axis), Some(behind)) = (self.view.eye(middle.camera), self.view.ray(middle.camera, middle.uv), &stage.still[other.index()]) else {
            return Ok(None);
        };
        let behind = GreyView::of(behind);
        let origin_depth = (origin.place - eye).dot(&axis);
        let on_ray = |p: &RayPoint| -> Result<Vec<Meant>, TrackingError> {
            let reach_m = ORIGIN_LIMIT * origin.sd_m + FASTEST_ALONG_M_S / self.setup.frame_rate_hz * (p.number - origin.number).abs();
            let Some(ray) = self.view.ray(p.camera, p.uv) else { return Ok(Vec::new()) };
            let seen = |depth: f64| self.view.project(other, &(eye + ray * (depth / ray.dot(&axis))));
            let (Some(a), Some(b), Some(radius)) = (seen(origin_depth - reach_m), seen(origin_depth + reach_m), faint.radius_px(other, &origin.place)) else {
                return Ok(Vec::new());
            };
            let rows = self.rows_between(a.y, b.y, 2.0 * radius + 8.0);
            self.with_buffers(|buffers| {
                let mut out: Vec<Meant> = Vec::new();
                let Some(image) = self.read_one(p.index, other.index(), rows, &mut buffers[other.index()])? else { return Ok(out) };
                let steps = ((b - a).norm() / STEP_PX).ceil().clamp(1.0, MOST_PLACES);
                for k in 0..=steps as usize {
                    let Some(outline) = faint.outline_near(&image, other, a + (b - a) * (k as f64 / steps), radius) else { continue };
                    let point = RayPoint { camera: other, uv: outline.uv, ..*p };
                    let [left, right] = if p.camera == CameraId::Left { [p.uv, point.uv] } else { [point.uv, p.uv] };
                    if let Some((place, miss)) = self.view.triangulate(left, right)
                        && miss * radius / faint.radius_m < AGREED_PX
                        && out.iter().all(|known| (known.point.uv - point.uv).norm() > 0.5)
                        && let Some(change) = ball_presence::change(&image, &behind, &point.uv, radius)
                        && let Some(around) = ball_presence::change_around(&image, &behind, &point.uv, radius)
                    {
                        out.push(Meant { depth: (place - eye).dot(&axis), share: outline.outline, change, around, point });
                    }
                }
                Ok(out)
            })
        };
        let meant: Result<Vec<Vec<Meant>>, TrackingError> = clear.par_iter().with_max_len(1).map(on_ray).collect();
        let Some(radius_px) = faint.radius_px(other, &origin.place) else { return Ok(None) };
        let px_per_m = radius_px / faint.radius_m * self.parallax(&origin.place);
        if !(px_per_m > 0.0) {
            return Ok(None);
        }
        // Where a line puts the ball in a frame.
        let Some(rays) = RayFlight::fit(self.view, clear, origin) else { return Ok(None) };
        let place = |line: &DepthLine, number: f64| {
            let from_eye = rays.at(number) - eye;
            eye + from_eye * (line.at(number) / from_eye.dot(&axis))
        };
        let from_origin = |line: &DepthLine| (line.at(origin.number) - origin_depth).abs() < ORIGIN_LIMIT * origin.sd_m;
        let may_be = |line: &DepthLine| from_origin(line) && self.crosses_the_head(stage.racket, |number| place(line, number));
        let Some((shown, points)) = of_one_flight(meant?, &may_be, [AGREED_PX, radius_px].map(|px| px / px_per_m), clear.len()) else { return Ok(None) };
        let all: Vec<RayPoint> = clear.iter().copied().chain(points).collect();
        Ok(RayFlight::fit(self.view, &all, origin).filter(|whole| self.may_be_a_ball(whole, origin, SPEEDS_M_S)).map(|whole| (shown, whole)))
    }

    /// Sine of the angle between the two cameras' rays.
    fn parallax(&self, at: &Point3<f64>) -> f64 {
        let [a, b] = CameraId::BOTH.map(|c| (at - self.view.eye(c)).normalize());
        a.cross(&b).norm()
    }

    /// What is measured where a flight passes.
    fn along(&self, scene: &BallScene, flight: &RayFlight, indices: &[usize]) -> Result<Flight, TrackingError> {
        let n = self.source.len();
        let mut found = Flight { frames: vec![None; n], means: Default::default(), kept: vec![None; n] };
        let faint = &BallScene { faint: true, ..scene.clone() };
        self.with_buffers(|buffers| {
            for index in indices {
                let there = flight.at(self.source.number(*index) as f64);
                let images = self.read_rows(*index, self.ball_rows(faint, &there, 1), buffers)?;
                found.frames[*index] = faint.measure(&images, &there, [1, 1], 1.0, &[None, None]);
            }
            Ok(found)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector2;

    #[test]
    fn truth_the_depth_of_a_straight_flight_stands_out_of_other_outlines() {
        let near_m = 0.007;
        // Twelve depths in every picture, most of them of nothing; the flight's in four of five.
        let meant = |flight: Option<f64>, around: f64| -> Vec<Vec<Meant>> {
            let of = |k: usize| {
                let at = |depth: f64, share: f64| {
                    let point = RayPoint { index: k, number: k as f64, camera: CameraId::Left, uv: Vector2::new(depth, 0.0) };
                    Meant { depth, share, change: 20.0, around: 5.0, point }
                };
                let depth = |j: usize| 9.2 + 1.6 * ((k * 7919 + j * 104_729) % 1009) as f64 / 1009.0;
                let clutter = (0..12).map(|j| Meant { around, ..at(depth(j), 0.2) });
                let flown = flight.filter(|_| k % 5 != 2).map(|share| at(10.02 + 0.021 * k as f64 + 0.002 * (k % 3) as f64, share));
                let still = Meant { change: 2.0, around: 2.0, ..at(10.0, 0.9) };
                let mut all: Vec<Meant> = clutter.chain(flown).chain([still; 8]).collect();
                all.sort_by(|a, b| a.depth.total_cmp(&b.depth));
                all
            };
            (3..23).map(of).collect()
        };
        let found =
            |flight: Option<f64>, around: f64| of_one_flight(meant(flight, around), &|line| (line.at(0.0) - 10.0).abs() < 0.125, [near_m, 5.0 * near_m], 20);
        assert!(found(None, 5.0).is_none());
        let (shown, points) = found(Some(0.3), 5.0).expect("a flight");
        assert!(points.len() >= 16 && shown > 4.5, "{} {shown}", points.len());
        let off = points.iter().map(|p| (p.uv.x - 10.02 - 0.021 * p.number).abs()).fold(0.0, f64::max);
        assert!(off < near_m, "{off}");
        // An outline that is hardly seen, but whose disc alone has changed.
        assert!(found(Some(0.06), 5.0).is_none());
        assert!(found(Some(0.06), 20.0).is_some_and(|(_, points)| points.len() >= 16));
    }
}
