//! One shot from beginning to end: find the racket and the ball, follow both ways in time, name what was seen.

use super::background::background;
use super::ball_search;
use super::ball_shading::{BallShading, LimbProfile};
use super::ball_track::{BallFrame, BallScene, MeanDisc};
use super::band::{BandShape, BandView};
use super::band_search::{self, BandCandidate};
use super::face;
use super::racket_figure::RacketFigure;
use super::racket_pose::View;
use super::racket_search;
use super::racket_track::{self, RacketFrame, RacketScene};
use super::recording::{self, Fingerprint, Fingerprints};
use super::space_points;
use super::tape_light::TapeLight;
use super::throat::ThroatEvidence;
use super::track_file::{PointState, SpacePoint, Target, TrackPoint, Tracks};
use super::tube_width::WidthEvidence;
use crate::calibration::{CameraId, StereoRig};
use crate::equipment::{Ball, Racket};
use crate::footage::{FootageError, FrameBuffer, FrameSource, GreyImage, GreyView};
use nalgebra::{Isometry3, Point3};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};

/// Why a shot cannot be tracked.
#[derive(Debug, thiserror::Error)]
pub enum TrackingError {
    #[error("no frames in left/ and right/; put the recording there, numbered file names, both cameras")]
    NoFrames,
    #[error("the racket file has no [markers]; add m1 to m5 (middle of each tape band, m, from the stringbed centre)")]
    NoMarkers,
    #[error(
        "no racket found in {searched} frame pairs; most tape-like places in one picture: left {left}, right {right}; check that five white bands between black ones are on the frame, that racket.toml matches and that the calibration belongs to this recording"
    )]
    NoRacket { searched: usize, left: usize, right: usize },
    #[error(
        "frame {frame}: the picture is {width}x{height} px, the calibration is for {calibrated_width}x{calibrated_height} px; calibrate with pictures of the same size"
    )]
    Size { frame: u64, width: usize, height: usize, calibrated_width: usize, calibrated_height: usize },
    #[error("the cameras' viewing directions do not meet in front of them; check calibration.json")]
    NoVolume,
    #[error("{found}; run `sweetspot track --sync auto` to pair them anew")]
    OutOfStep { found: String },
    #[error("interrupted")]
    Cancelled,
    #[error(transparent)]
    Footage(#[from] FootageError),
}

/// Everything tracking knows about a shot.
#[derive(Debug, Clone)]
pub struct ShotTracks {
    /// The racket's figure, with the tubes' direction in the throat as seen.
    pub figure: RacketFigure,
    pub tracks: Tracks,
    /// By frame index of the clip.
    pub racket: Vec<Option<RacketFrame>>,
    pub ball: Vec<Option<BallFrame>>,
    pub points: Vec<SpacePoint>,
    /// First contact, in frames (fractional frame number): ball's centre one radius from the string plane.
    pub contact_frame: Option<f64>,
    /// Things the user should know, in order.
    pub notes: Vec<String>,
    /// Pictures that are there and cannot be read, with the reason; they count as missing.
    pub unreadable: Vec<String>,
    /// What either camera sees when nothing moves.
    pub(super) still: [Option<GreyImage>; 2],
}

/// What a shot is tracked with.
pub struct ShotSetup<'a> {
    pub rig: &'a StereoRig,
    pub racket: &'a Racket,
    pub ball: &'a Ball,
    pub frame_rate_hz: f64,
}

/// Blur of the ball's outline, px, one standard deviation.
const BALL_BLUR_PX: f64 = 0.55;
/// Frames over which a lost racket or ball is still expected where it was going.
const PATIENCE: usize = 6;
/// A ball in play comes this much nearer to the racket (or goes away by it) while it is seen, m: 10 m/s over six frames.
const LEAST_APPROACH_M: f64 = 0.06;
/// A score (below) at which no other ball is looked for: at the racket and 0.2 m farther away before, or much farther.
const CLEAR_SCORE: f64 = 0.13;
/// Frames whose pictures are asked for the direction of the throat.
const THROAT_FRAMES: usize = 8;
/// The same for its width: the first frame found and those after it.
const WIDTH_FRAMES: usize = 4;
/// Rounds in which the light on the tape is found.
const LIGHT_ROUNDS: usize = 2;
/// Longest gap in the ball's track that is looked into again, frames.
const FILLED: f64 = 6.0;
/// Least share of the usual contrast that still counts as tape.
const LEAST_CONTRAST: f64 = 0.45;

/// Tracks a whole shot. `progress` is called with the number of frames done, from any thread.
pub fn track_shot(source: &impl FrameSource, setup: &ShotSetup, cancel: &AtomicBool, progress: &(dyn Fn(usize) + Sync)) -> Result<ShotTracks, TrackingError> {
    if source.is_empty() {
        return Err(TrackingError::NoFrames);
    }
    let figure = RacketFigure::of(setup.racket).ok_or(TrackingError::NoMarkers)?;
    let view = View::new(setup.rig);
    let focus = view.focus().ok_or(TrackingError::NoVolume)?;
    let shape = BandShape::default();
    let mut shot = Shot { source, setup, view: &view, figure, shape, focus, cancel, progress, stale: Vec::new(), broken: Mutex::default() };
    let (start, (left, right)) = rayon::join(|| shot.start(), || rayon::join(|| background(source, 0), || background(source, 1)));
    let (start, still) = (start?, [left?, right?]);
    let (mut racket, prints) = shot.follow_racket(&start)?;
    shot.stale = recording::repeated(&prints);
    for (stale, still) in shot.stale.iter_mut().zip(racket_track::stood_still(&racket)) {
        *stale = [stale[0] || still[0], stale[1] || still[1]];
    }
    let mut notes = recording::notes(source, &shot.stale);
    let means = recording::mean_greys(&prints, |index, camera| shot.mean_grey(index, camera));
    for (index, stale) in shot.stale.iter_mut().enumerate() {
        let washed_out = recording::washed_out(&means, index);
        *stale = [stale[0] || washed_out[0], stale[1] || washed_out[1]];
    }
    shot.remeasure_stale(&start, &mut racket)?;
    let seen: Vec<(usize, &RacketFrame)> = racket.iter().enumerate().filter_map(|(i, r)| Some((i, r.as_ref().filter(|r| r.stereo())?))).collect();
    if let Some(figure) = shot.throat_of(&seen)? {
        shot.figure = figure;
    }
    let figure = shot.figure.clone();
    racket_track::settle_deviations(&view, &figure, &mut racket);
    notes.extend(recording::dark_or_bright(source, &means));
    let ball = shot.find_and_follow_ball(&racket, &still)?;
    face::settle(&mut racket, &ball, &figure);
    let contact_frame = space_points::first_contact(source, &racket, &ball, setup.ball.radius_m());
    let points = space_points::space_points(source, setup, &view, &figure, &racket, &ball, contact_frame);
    let tracks = named(source, &racket, &ball);
    let unreadable = shot.broken.into_inner().unwrap_or_default().into_values().collect();
    Ok(ShotTracks { figure, tracks, racket, ball, points, contact_frame, notes, unreadable, still })
}

struct Shot<'a, S: FrameSource> {
    source: &'a S,
    setup: &'a ShotSetup<'a>,
    view: &'a View<'a>,
    figure: RacketFigure,
    shape: BandShape,
    focus: Point3<f64>,
    cancel: &'a AtomicBool,
    progress: &'a (dyn Fn(usize) + Sync),
    /// Pictures that repeat the one before or are washed out, by index and camera; they are read as missing.
    stale: Vec<[bool; 2]>,
    /// Why a picture could not be read, by index and camera.
    broken: Mutex<BTreeMap<(usize, usize), String>>,
}

/// A ball as first followed, and the mean pictures of its disc.
#[derive(Clone)]
struct Flight {
    frames: Vec<Option<BallFrame>>,
    means: [MeanDisc; 2],
}

/// The racket in the frames of one direction, and every picture's fingerprint.
type OneWay = (Vec<(usize, RacketFrame)>, Vec<(usize, [Option<Fingerprint>; 2])>);

struct RacketStart {
    index: usize,
    frame: RacketFrame,
    least_contrast: [f64; 2],
}

impl<S: FrameSource> Shot<'_, S> {
    fn scene(&self) -> RacketScene<'_> {
        RacketScene { view: self.view, figure: &self.figure, shape: &self.shape }
    }

    fn check_cancelled(&self) -> Result<(), TrackingError> {
        if self.cancel.load(Ordering::Relaxed) { Err(TrackingError::Cancelled) } else { Ok(()) }
    }

    /// Reads both pictures of a frame; a picture that is missing or broken is `None`.
    fn read<'b>(&self, index: usize, buffers: &'b mut [FrameBuffer; 2]) -> Result<[Option<GreyView<'b>>; 2], TrackingError> {
        self.read_rows(index, [None; 2], buffers)
    }

    /// [`Self::read`], of each picture only the rows needed (first, count).
    fn read_rows<'b>(
        &self,
        index: usize,
        rows: [Option<(usize, usize)>; 2],
        buffers: &'b mut [FrameBuffer; 2],
    ) -> Result<[Option<GreyView<'b>>; 2], TrackingError> {
        let [l, r] = buffers;
        Ok([self.read_one(index, 0, rows[0], l)?, self.read_one(index, 1, rows[1], r)?])
    }

    fn read_one<'b>(
        &self,
        index: usize,
        camera: usize,
        rows: Option<(usize, usize)>,
        buffer: &'b mut FrameBuffer,
    ) -> Result<Option<GreyView<'b>>, TrackingError> {
        self.check_cancelled()?;
        if self.stale.get(index).is_some_and(|s| s[camera]) {
            return Ok(None);
        }
        let there = self.source.read(index, camera, rows, buffer).unwrap_or_else(|e| {
            if let Ok(mut broken) = self.broken.lock() {
                broken.insert((index, camera), e.to_string());
            }
            false
        });
        let view = if there { buffer.view() } else { None };
        let [calibrated_width, calibrated_height] = self.setup.rig.image_size;
        if let Some(GreyView { width, height, .. }) = view
            && (width, height) != (calibrated_width, calibrated_height)
        {
            return Err(TrackingError::Size { frame: self.source.number(index), width, height, calibrated_width, calibrated_height });
        }
        Ok(view)
    }

    /// Mean grey of a whole picture; `None` where it is missing.
    fn mean_grey(&self, index: usize, camera: usize) -> Option<f64> {
        Some(Fingerprint::of(&self.read_one(index, camera, None, &mut FrameBuffer::default()).ok()??).mean())
    }

    /// The rows of each picture that measuring the ball near a place looks at: its outline may be found `reach_px` away, and
    /// the fit may move by most of a radius from there.
    fn ball_rows(&self, scene: &BallScene, at: &Point3<f64>, reach_px: i32) -> [Option<(usize, usize)>; 2] {
        CameraId::BOTH.map(|camera| {
            let (uv, radius) = (self.view.project(camera, at)?, scene.radius_px(camera, at)?);
            let half = 2.0 * radius + f64::from(reach_px) + 8.0;
            let row = |v: f64| v.clamp(0.0, self.setup.rig.image_size[1] as f64) as usize;
            let first = row((uv.y - half).floor());
            Some((first, row((uv.y + half).ceil()) - first))
        })
    }

    /// Pixels per metre at the middle of the volume.
    fn px_per_m(&self, camera: CameraId) -> f64 {
        self.setup.rig.camera(camera).fx / (self.view.eye(camera) - self.focus).norm()
    }

    /// The racket in some frame, with its light and figure.
    fn start(&mut self) -> Result<RacketStart, TrackingError> {
        let start = self.acquire_racket()?;
        let start = self.light_tape(start)?;
        // One frame tells the throat's direction to a degree or two, and the bands are followed with it; several tell it better.
        let start = self.turn_throat(start)?;
        self.widen_throat(start)
    }

    /// Finds the racket in some frame: the middle first, then halves, quarters, ...
    fn acquire_racket(&self) -> Result<RacketStart, TrackingError> {
        let mut buffers = [FrameBuffer::default(), FrameBuffer::default()];
        let (mut searched, mut most) = (0, [0, 0]);
        for index in spread(self.source.len()) {
            let images = self.read(index, &mut buffers)?;
            let [Some(l), Some(r)] = &images else { continue };
            searched += 1;
            let candidates = self.band_candidates(l, r);
            for c in 0..2 {
                most[c] = most[c].max(candidates[c].len());
            }
            let Some(found) = racket_search::search(self.view, &self.figure, &candidates) else { continue };
            if let Some(start) = self.confirm(index, &images, &found.global_from_racket) {
                return Ok(start);
            }
        }
        Err(TrackingError::NoRacket { searched, left: most[0], right: most[1] })
    }

    /// What may be tape in either picture.
    fn band_candidates(&self, left: &GreyView, right: &GreyView) -> [Vec<BandCandidate>; 2] {
        let of = |view: &GreyView, camera: CameraId| band_search::candidates(view, self.px_per_m(camera), self.shape.white_half_m);
        let (left, right) = rayon::join(|| of(left, CameraId::Left), || of(right, CameraId::Right));
        [left, right]
    }

    /// A racket is believed when the bands themselves, not only candidate places, agree on one pose.
    fn confirm(&self, index: usize, images: &[Option<GreyView>; 2], pose: &Isometry3<f64>) -> Option<RacketStart> {
        let scene = self.scene();
        let frame = racket_track::measure(&scene, images, pose, 2, &[4.0, 4.0])?;
        if frame.count() < 6 || frame.pose.chi2 > 40.0 * frame.pose.dof as f64 {
            return None;
        }
        let mut least_contrast = [0.0; 2];
        for camera in CameraId::BOTH {
            let image = images[camera.index()].as_ref()?;
            let mut contrasts: Vec<f64> = (0..5)
                .filter(|m| frame.points[camera.index()][*m].is_some())
                .filter_map(|m| BandView::at(self.view, &self.figure, &frame.pose.global_from_racket, camera, m)?.contrast(image, &self.shape, 0.0, 0.0))
                .collect();
            contrasts.sort_by(f64::total_cmp);
            least_contrast[camera.index()] = LEAST_CONTRAST * contrasts.get(contrasts.len() / 2)?;
        }
        Some(RacketStart { index, frame, least_contrast })
    }

    /// Follows the racket from the frame where it was found to both ends of the clip.
    fn follow_racket(&self, start: &RacketStart) -> Result<(Vec<Option<RacketFrame>>, Fingerprints), TrackingError> {
        let n = self.source.len();
        let (back, forth) = rayon::join(|| self.follow_racket_one_way(start, (0..start.index).rev()), || self.follow_racket_one_way(start, start.index + 1..n));
        let mut all = vec![None; n];
        all[start.index] = Some(start.frame.clone());
        let mut prints = vec![[None, None]; n];
        let mut buffers = [FrameBuffer::default(), FrameBuffer::default()];
        prints[start.index] = self.read(start.index, &mut buffers)?.map(|v| v.map(|v| Fingerprint::of(&v)));
        for (frames, seen) in [back?, forth?] {
            for (index, frame) in frames {
                all[index] = Some(frame);
            }
            for (index, print) in seen {
                prints[index] = print;
            }
        }
        Ok((all, prints))
    }

    /// The start with the light as its bands show it.
    fn light_tape(&mut self, mut start: RacketStart) -> Result<RacketStart, TrackingError> {
        let mut buffers = [FrameBuffer::default(), FrameBuffer::default()];
        let images = self.read(start.index, &mut buffers)?;
        // The first time every band tells its own brightness, then what the light leaves over.
        for _ in 0..LIGHT_ROUNDS {
            let Some(light) = TapeLight::of(&self.scene(), &images, &start.frame) else { return Ok(start) };
            let before = self.shape.light.replace(light);
            let Some(again) = self.confirm(start.index, &images, &start.frame.pose.global_from_racket) else {
                self.shape.light = before;
                return Ok(start);
            };
            start = again;
        }
        Ok(start)
    }

    /// The start with the throat's direction as its pictures show it.
    fn turn_throat(&mut self, start: RacketStart) -> Result<RacketStart, TrackingError> {
        let Some(figure) = self.throat_of(&[(start.index, &start.frame)])? else { return Ok(start) };
        self.confirm_with(start, figure)
    }

    /// The figure with the throat's direction as the pictures of a few of these frames show it.
    fn throat_of(&self, frames: &[(usize, &RacketFrame)]) -> Result<Option<RacketFigure>, TrackingError> {
        let mut buffers = [FrameBuffer::default(), FrameBuffer::default()];
        let mut evidence = ThroatEvidence::default();
        let looked_at = frames.len().min(THROAT_FRAMES);
        for k in 0..looked_at {
            let (index, frame) = frames[k * frames.len() / looked_at];
            let rows = CameraId::BOTH.map(|c| self.scene().rows(c, &frame.pose.global_from_racket, 1));
            let images = self.read_rows(index, rows, &mut buffers)?;
            evidence.add(&self.scene(), &images, frame);
        }
        Ok(evidence.angle(&self.figure).map(|(angle, _)| self.figure.with_throat(angle)))
    }

    /// The start with the throat's width as its pictures and the next ones show it.
    fn widen_throat(&mut self, start: RacketStart) -> Result<RacketStart, TrackingError> {
        let next = self.follow_racket_one_way(&start, (start.index + 1..self.source.len()).take(WIDTH_FRAMES - 1))?.0;
        let mut buffers = [FrameBuffer::default(), FrameBuffer::default()];
        let mut evidence = WidthEvidence::default();
        for (index, frame) in std::iter::once((start.index, &start.frame)).chain(next.iter().map(|(i, f)| (*i, f))) {
            let rows = CameraId::BOTH.map(|c| self.scene().rows(c, &frame.pose.global_from_racket, 1));
            let images = self.read_rows(index, rows, &mut buffers)?;
            evidence.add(&self.scene(), &images, frame);
        }
        let wider = self.figure.with_throat_width(evidence.throat_to_head());
        self.confirm_with(start, wider)
    }

    /// The start measured once more with another figure, which stays if the bands agree.
    fn confirm_with(&mut self, start: RacketStart, figure: RacketFigure) -> Result<RacketStart, TrackingError> {
        let before = std::mem::replace(&mut self.figure, figure);
        let mut buffers = [FrameBuffer::default(), FrameBuffer::default()];
        let images = self.read(start.index, &mut buffers)?;
        Ok(match self.confirm(start.index, &images, &start.frame.pose.global_from_racket) {
            Some(again) => again,
            None => {
                self.figure = before;
                start
            }
        })
    }

    /// Measures the frames with a stale picture again, from the other camera alone.
    fn remeasure_stale(&self, start: &RacketStart, racket: &mut [Option<RacketFrame>]) -> Result<(), TrackingError> {
        let mut buffers = [FrameBuffer::default(), FrameBuffer::default()];
        for index in (0..racket.len()).filter(|i| self.stale.get(*i).is_some_and(|s| s.contains(&true))) {
            let images = self.read(index, &mut buffers)?;
            let pose = |i: Option<usize>| racket.get(i?)?.as_ref().map(|r| r.pose.global_from_racket);
            let expected = match (pose(index.checked_sub(1)), pose(Some(index + 1))) {
                (Some(a), Some(b)) => Some(a.lerp_slerp(&b, 0.5)),
                (one, other) => one.or(other),
            };
            racket[index] = expected.and_then(|p| racket_track::measure(&self.scene(), &images, &p, 2, &start.least_contrast));
        }
        Ok(())
    }

    fn follow_racket_one_way(&self, start: &RacketStart, indices: impl Iterator<Item = usize>) -> Result<OneWay, TrackingError> {
        let scene = self.scene();
        let mut buffers = [FrameBuffer::default(), FrameBuffer::default()];
        let mut out: Vec<(usize, RacketFrame)> = Vec::new();
        let mut last = (self.source.number(start.index) as f64, start.frame.pose.global_from_racket);
        let mut previous: Option<(f64, Isometry3<f64>)> = None;
        let mut prints = Vec::new();
        let mut lost = 0;
        for index in indices {
            (self.progress)(1);
            let now = self.source.number(index) as f64;
            let mut found = None;
            let predicted = racket_track::predict(previous.as_ref().map(|p| &p.1), &last.1, previous.map_or(1.0, |p| last.0 - p.0), now - last.0);
            let reach = if previous.is_none() { 5 } else { (3 + 2 * lost as i32).min(7) };
            let expected = lost <= PATIENCE;
            let rows = if expected { CameraId::BOTH.map(|c| scene.rows(c, &predicted, reach)) } else { [None; 2] };
            let images = self.read_rows(index, rows, &mut buffers)?;
            if images.iter().all(Option::is_none) {
                continue;
            }
            prints.push((index, images.map(|v| v.map(|v| Fingerprint::of(&v)))));
            if expected {
                found = racket_track::measure(&scene, &images, &predicted, reach, &start.least_contrast);
            }
            if found.is_none()
                && lost >= 2
                && let images = self.read(index, &mut buffers)?
                && let [Some(l), Some(r)] = &images
            {
                // Lost: search the whole pictures again.
                let candidates = self.band_candidates(l, r);
                found = racket_search::search(self.view, &self.figure, &candidates)
                    .and_then(|p| racket_track::measure(&scene, &images, &p.global_from_racket, 2, &start.least_contrast))
                    .filter(|f| f.count() >= 6)
                    .map(|f| face::nearest_twin(f, &last.1));
            }
            match found {
                Some(frame) => {
                    let pose = frame.pose.global_from_racket;
                    if !frame.stereo() {
                        // Its depth is poor: recorded, but the motion goes on from the frames before.
                        out.push((index, frame));
                        continue;
                    }
                    previous = if lost <= PATIENCE { Some(last) } else { None };
                    last = (now, pose);
                    lost = 0;
                    out.push((index, frame));
                }
                None => lost += 1,
            }
        }
        Ok((out, prints))
    }

    /// Finds the ball that meets the racket and follows it both ways.
    fn find_and_follow_ball(&self, racket: &[Option<RacketFrame>], still: &[Option<GreyImage>; 2]) -> Result<Vec<Option<BallFrame>>, TrackingError> {
        let n = self.source.len();
        let mut scene = BallScene {
            view: self.view,
            radius_m: self.setup.ball.radius_m(),
            limb: [LimbProfile::new(&BallShading::default(), 8.0, BALL_BLUR_PX), LimbProfile::new(&BallShading::default(), 8.0, BALL_BLUR_PX)],
            frame_rate_hz: self.setup.frame_rate_hz,
            faint: false,
        };
        let mut buffers = [FrameBuffer::default(), FrameBuffer::default()];
        let mut best = (f64::INFINITY, Flight { frames: vec![None; n], means: Default::default() });
        let mut claimed: Vec<Vec<Option<BallFrame>>> = Vec::new();
        for first in spread(n.saturating_sub(2)).into_iter().take(24) {
            let mut frames: [Vec<BallFrame>; 3] = Default::default();
            for (k, found) in frames.iter_mut().enumerate() {
                let images = self.read(first + k, &mut buffers)?;
                let of = |c: CameraId| match (&images[c.index()], &still[c.index()], scene.radius_px(c, &self.focus)) {
                    (Some(v), Some(b), Some(r)) => ball_search::candidates(v, b, r),
                    _ => Vec::new(),
                };
                let (left, right) = rayon::join(|| of(CameraId::Left), || of(CameraId::Right));
                let candidates = [left, right];
                *found = scene.space_candidates(&images, &candidates, &self.focus);
                if found.is_empty() {
                    break;
                }
            }
            for flight in scene.flights(&frames) {
                let known = |t: &Vec<Option<BallFrame>>| t[first + 1].is_some_and(|b| (b.position - flight[1].position).norm() < 0.03);
                if claimed.iter().any(known) {
                    continue;
                }
                let track = self.follow_ball(&scene, first, &flight)?;
                let count = track.frames.iter().flatten().count();
                if count >= 6 {
                    // Distances from the stringbed's centre, m. What stays at its own is fastened to the racket or the arm.
                    let distances = track
                        .frames
                        .iter()
                        .zip(racket)
                        .filter_map(|(b, r)| Some((b.as_ref()?.position.coords - r.as_ref()?.pose.global_from_racket.translation.vector).norm()));
                    let (near, far) = distances.fold((f64::INFINITY, 0.0f64), |(near, far), d| (near.min(d), far.max(d)));
                    // The nearest counts, then who came from farther away, then the longer track.
                    let (near_m, approach_m) = (near.max(0.15), (far - near).min(0.5));
                    let score = if far - near < LEAST_APPROACH_M { f64::INFINITY } else { near_m - 0.1 * approach_m - 1e-4 * count as f64 };
                    if score < best.0 {
                        best = (score, track.clone());
                    }
                }
                claimed.push(track.frames);
            }
            if best.0 < CLEAR_SCORE {
                break;
            }
        }
        self.remeasure_ball(&mut scene, best.1)
    }

    /// Learns the light from the ball as first measured, then measures every frame again with it.
    fn remeasure_ball(&self, scene: &mut BallScene, rough: Flight) -> Result<Vec<Option<BallFrame>>, TrackingError> {
        let Flight { frames: rough, means } = rough;
        let Some(near) = rough.iter().flatten().find(|b| b.stereo).map(|b| b.position) else { return Ok(rough) };
        scene.set_light(&means, &near, BALL_BLUR_PX);
        scene.faint = true;
        let numbers: Vec<f64> = (0..rough.len()).map(|i| self.source.number(i) as f64).collect();
        let scene: &BallScene = scene;
        let again = |buffers: &mut [FrameBuffer; 2], index: usize| {
            let expected = match &rough[index] {
                Some(b) if b.stereo => Some((b.position, true)),
                ball => expected_ball(&rough, &numbers, index).or(ball.map(|b| (b.position, true))),
            };
            let Some((p, within)) = expected else { return Ok(None) };
            let found = scene.measure(&self.read_rows(index, self.ball_rows(scene, &p, 1), buffers)?, &p, 1);
            // Beyond the flight's ends nobody has seen a ball: there both cameras must agree.
            Ok(found.filter(|b| within || b.stereo))
        };
        (0..rough.len()).into_par_iter().map_init(Default::default, again).collect()
    }

    fn follow_ball(&self, scene: &BallScene, first: usize, flight: &[BallFrame; 3]) -> Result<Flight, TrackingError> {
        let n = self.source.len();
        let mut frames = vec![None; n];
        let mut means: [MeanDisc; 2] = Default::default();
        for (k, b) in flight.iter().enumerate() {
            frames[first + k] = Some(*b);
        }
        let (back, forth) = rayon::join(
            || self.follow_ball_one_way(scene, (first + 1, flight[1]), (first, flight[0]), (0..first).rev()),
            || self.follow_ball_one_way(scene, (first + 1, flight[1]), (first + 2, flight[2]), first + 3..n),
        );
        for (some, mean) in [back?, forth?] {
            for (index, b) in some {
                frames[index] = Some(b);
            }
            means.iter_mut().zip(&mean).for_each(|(all, some)| all.add(some));
        }
        Ok(Flight { frames, means })
    }

    fn follow_ball_one_way(
        &self,
        scene: &BallScene,
        before: (usize, BallFrame),
        last: (usize, BallFrame),
        indices: impl Iterator<Item = usize>,
    ) -> Result<(Vec<(usize, BallFrame)>, [MeanDisc; 2]), TrackingError> {
        let mut means: [MeanDisc; 2] = Default::default();
        let mut buffers = [FrameBuffer::default(), FrameBuffer::default()];
        let at = |i: usize| self.source.number(i) as f64;
        let (mut previous, mut last) = ((at(before.0), before.1.position), (at(last.0), last.1.position));
        let mut out = Vec::new();
        let mut lost = 0;
        for index in indices {
            let now = at(index);
            let predicted = last.1 + (last.1 - previous.1) * ((now - last.0) / (last.0 - previous.0));
            let reach_px = (4 + 2 * lost as i32).min(12);
            let images = self.read_rows(index, self.ball_rows(scene, &predicted, reach_px), &mut buffers)?;
            if images.iter().all(Option::is_none) {
                continue;
            }
            match scene.measure(&images, &predicted, reach_px) {
                Some(b) => {
                    previous = last;
                    last = (now, b.position);
                    lost = 0;
                    for camera in CameraId::BOTH {
                        if let Some(image) = &images[camera.index()] {
                            scene.add_to_mean(&mut means[camera.index()], image, camera, &b);
                        }
                    }
                    out.push((index, b));
                }
                None => {
                    lost += 1;
                    if lost > PATIENCE {
                        break;
                    }
                }
            }
        }
        Ok((out, means))
    }
}

/// Where a ball that was not seen by both cameras should be: on the straight line between its neighbours in time that
/// were, or beyond the last two (then `false`), over at most [`FILLED`] frames.
fn expected_ball(seen: &[Option<BallFrame>], numbers: &[f64], index: usize) -> Option<(Point3<f64>, bool)> {
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

/// Frame indices by halving the clip: 1/2, 1/4, 3/4, 1/8, ... of its length, each once.
fn spread(n: usize) -> Vec<usize> {
    let (mut out, mut taken) = (Vec::with_capacity(n), vec![false; n]);
    let parts = n.next_power_of_two();
    let mut step = parts;
    while step > 1 {
        for k in (step / 2..parts).step_by(step) {
            let index = k * n / parts;
            if !std::mem::replace(&mut taken[index], true) {
                out.push(index);
            }
        }
        step /= 2;
    }
    out.extend((0..n).filter(|&i| !taken[i]));
    out
}

/// All points of a shot: every target in every picture that exists, measured or occluded.
fn named(source: &impl FrameSource, racket: &[Option<RacketFrame>], ball: &[Option<BallFrame>]) -> Tracks {
    let mut points = Vec::new();
    for index in 0..source.len() {
        if racket[index].is_none() && ball[index].is_none() {
            continue;
        }
        for camera in CameraId::BOTH {
            for target in Target::ALL {
                let point = if target == Target::Ball {
                    ball[index].as_ref().and_then(|b| b.points[camera.index()])
                } else {
                    racket[index].as_ref().and_then(|r| r.points[camera.index()][target.index()])
                };
                let state = if point.is_some() { PointState::Measured } else { PointState::Occluded };
                points.push(TrackPoint { frame: source.number(index), camera, target, point, state });
            }
        }
    }
    Tracks { points }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn law_spread_visits_every_frame_once_middle_first() {
        for n in [0, 1, 2, 3, 7, 44, 300] {
            let mut order = spread(n);
            if n > 2 {
                assert!(order[0] > n / 4 && order[0] < 3 * n / 4 + 1, "{n} {}", order[0]);
            }
            order.sort_unstable();
            assert_eq!(order, (0..n).collect::<Vec<_>>());
        }
    }
}
