//! The racket followed one way, frame by frame, from the frame it was found in; once lost it is looked for.

use crate::calibration::CameraId;
use crate::footage::{FrameBuffer, FrameSource, GreyView, Rows};
use crate::tracking::pictures::recording::Fingerprint;
use crate::tracking::pictures::shot_frames::{PATIENCE, Shot};
use crate::tracking::racket::foretold_pose::Foretold;
use crate::tracking::racket::known_bands::{self, KnownBands};
use crate::tracking::racket::lost_racket::LostRacket;
use crate::tracking::racket::racket_foretold::Expected;
use crate::tracking::racket::racket_motion::RacketMotion;
use crate::tracking::racket::racket_scene::RacketFrame;
use crate::tracking::racket::shot_racket::RacketStart;
use crate::tracking::shot_tracks::TrackingError;
use crate::tracking::tape::band_search::BandCandidate;

/// Frames without the racket before it is looked for where it can have got to,
const FIRST_LOOK: usize = 2;
/// and most frames between two such looks: it crosses the volume in sixty.
const FARTHEST_LOOKS: usize = 20;

/// So many frames it is looked for near where it is foretold, in one of so many.
const LONGEST_NEAR: usize = 40;
const EVERY_NEAR: usize = 2;

/// Frames that a camera has not shown it, after which its depth has gone astray, and from one time to the next that it is looked for there.
const STRAYED: usize = 3;
/// Most frames in a row whose pose is told by few bands and what was foretold.
const LONGEST_FORETOLD: usize = 200;
/// How far from its expected place a racket just found is looked for, px: nobody knows how it moves,
const FIRST_REACH_PX: i32 = 5;
/// one that has been followed, with so much more for each frame without it,
const REACH_PX: i32 = 3;
const REACH_LOST_PX: i32 = 2;
/// and at most: with a camera that did not see it, its depth is not known well.
const MOST_REACH_PX: i32 = 7;

/// The racket in the frames of one direction, and every picture's fingerprint.
pub type OneWay = (Vec<(usize, RacketFrame)>, Vec<(usize, [Option<Fingerprint>; 2])>);

/// What is known of a racket on the way.
struct RacketFollower<'s> {
    start: &'s RacketStart,
    /// Whether it is looked for once it is lost.
    look_for: bool,
    motion: RacketMotion,
    /// It has been seen to move.
    goes_on: bool,
    /// The bands seen in the frame before, as long as they are seen where they are expected.
    known: Option<KnownBands>,
    /// Frames without it up to here, and how many of them there are before it is next looked for anywhere.
    lost: usize,
    look_next: usize,
    /// Frames since its bands alone told its pose: those without it, the last so many, and those in which it was foretold.
    between: Vec<usize>,
    /// What looked like tape in the first frame without it, once that has been asked.
    still: Option<[Vec<BandCandidate>; 2]>,
    /// Frames since its bands alone told its pose, and since either camera showed it.
    foretold_for: usize,
    unseen: [usize; 2],
    frames: Vec<(usize, RacketFrame)>,
    prints: Vec<(usize, [Option<Fingerprint>; 2])>,
}

/// Where a racket was found.
#[derive(Clone, Copy, PartialEq)]
enum Place {
    /// Where it was expected from one frame to the next.
    Expected,
    /// Near where it was foretold, after some frames without it.
    Near,
    /// Somewhere it can have got to meanwhile.
    Anywhere,
}

impl RacketFollower<'_> {
    /// What the pictures of a frame are known by.
    fn keep_prints(&mut self, index: usize, images: &[Option<GreyView>; 2]) {
        self.prints.push((index, images.map(|v| v.map(|v| Fingerprint::of(&v)))));
    }

    /// Takes in what was seen of it in a frame before, where that is more than was known.
    fn take_in(&mut self, index: usize, frame: RacketFrame) {
        match self.frames.iter_mut().rev().find(|(there, _)| *there == index) {
            Some((_, before)) if before.count() >= frame.count() => {}
            Some((_, before)) => *before = frame,
            None => self.frames.push((index, frame)),
        }
    }
}

impl<S: FrameSource> Shot<'_, S> {
    /// Follows the racket from the frame where it was found to the clip's end or to its beginning.
    pub(in crate::tracking) fn follow_racket(&self, start: &RacketStart, forth: bool) -> Result<OneWay, TrackingError> {
        let told = |_: &usize| (self.progress)(1);
        if forth {
            self.follow_racket_one_way(start, (start.index + 1..self.source.len()).inspect(told))
        } else {
            self.follow_racket_one_way(start, (0..start.index).rev().inspect(told))
        }
    }

    /// Follows it through these frames, and looks for it where it is lost.
    pub(in crate::tracking) fn follow_racket_one_way(&self, start: &RacketStart, indices: impl Iterator<Item = usize>) -> Result<OneWay, TrackingError> {
        self.follow_racket_through(start, None, indices, true)
    }

    /// Once lost it is looked for near where it is foretold and where it can have got to, in frames ever farther apart. From where it is found, and from where its
    /// bands alone tell its pose again, it is followed back into the frames without it and those in which it was foretold: what more of it is seen so
    /// counts. Without `look_for` it is given up after [`PATIENCE`] frames.
    pub(in crate::tracking) fn follow_racket_through(
        &self,
        start: &RacketStart,
        moves: Option<RacketMotion>,
        indices: impl Iterator<Item = usize>,
        look_for: bool,
    ) -> Result<OneWay, TrackingError> {
        let mut follower = RacketFollower {
            start,
            look_for,
            goes_on: moves.is_some(),
            motion: moves.unwrap_or_else(|| self.found_at(start.index, &start.frame)),
            known: None,
            lost: 0,
            look_next: FIRST_LOOK,
            between: Vec::new(),
            still: None,
            foretold_for: 0,
            unseen: [0; 2],
            frames: Vec::new(),
            prints: Vec::new(),
        };
        let mut buffers = [FrameBuffer::default(), FrameBuffer::default()];
        for index in indices {
            if !look_for && follower.lost > PATIENCE {
                break;
            }
            let foretold = follower.motion.foretold(self.source.number(index) as f64);
            let Some(expected) = self.see_expected(&mut follower, index, foretold, &mut buffers)? else { continue };
            let found = match expected {
                Some(frame) => Some((frame, Place::Expected)),
                None if look_for && follower.lost >= FIRST_LOOK => self.see_lost(&mut follower, index, foretold, &mut buffers)?,
                None => None,
            };
            match found {
                Some((frame, place)) => self.go_on_from(&mut follower, index, frame, place)?,
                None => {
                    follower.lost += 1;
                    follower.between.push(index);
                }
            }
        }
        Ok((follower.frames, follower.prints))
    }

    /// The motion of a racket of which only a frame is known.
    pub(in crate::tracking) fn found_at(&self, index: usize, frame: &RacketFrame) -> RacketMotion {
        RacketMotion::start(self.source.number(index) as f64, &frame.pose, self.setup.frame_rate_hz)
    }

    /// The racket in the next frame, if it is seen where it is expected; `None` where there are no pictures.
    fn see_expected(
        &self,
        follower: &mut RacketFollower,
        index: usize,
        foretold: Foretold,
        buffers: &mut [FrameBuffer; 2],
    ) -> Result<Option<Option<RacketFrame>>, TrackingError> {
        let (scene, predicted, least_contrast) = (self.scene(), foretold.pose, &follower.start.least_contrast);
        let expected = follower.lost <= PATIENCE;
        if expected
            && let Some(known) = &mut follower.known
            && let Some(bands) = scene.expected(&predicted)
        {
            let images = self.read_rows(index, bands.rows(&scene, known), buffers)?;
            let found = known_bands::confirm(&scene, &images, &predicted, &bands, least_contrast, known);
            if found.is_some() {
                follower.keep_prints(index, &images);
                return Ok(Some(found));
            }
        }
        follower.known = None;
        let saw_it = follower.unseen.map(|frames| frames == 0);
        let reach_px = match follower.goes_on {
            false => FIRST_REACH_PX,
            true if saw_it.contains(&false) => MOST_REACH_PX,
            true => (REACH_PX + REACH_LOST_PX * follower.lost as i32).min(MOST_REACH_PX),
        };
        let rows = if expected { CameraId::BOTH.map(|c| scene.rows(c, &predicted, reach_px)) } else { [Rows::ALL; 2] };
        let images = self.read_rows(index, rows, buffers)?;
        if images.iter().all(Option::is_none) {
            return Ok(None);
        }
        follower.keep_prints(index, &images);
        if !expected {
            return Ok(Some(None));
        }
        let look = Expected {
            foretold,
            goes_on: follower.goes_on,
            by_few: follower.foretold_for < LONGEST_FORETOLD,
            reach_px,
            saw_it,
            astray: follower.unseen.iter().any(|frames| *frames > 0 && frames.is_multiple_of(STRAYED)),
        };
        let (found, known) = look.find(&scene, images, least_contrast);
        follower.known = known;
        Ok(Some(found))
    }

    /// A racket that was lost, looked for in some of the frames without it.
    fn see_lost(
        &self,
        follower: &mut RacketFollower,
        index: usize,
        foretold: Foretold,
        buffers: &mut [FrameBuffer; 2],
    ) -> Result<Option<(RacketFrame, Place)>, TrackingError> {
        let (lost, least_contrast) = (follower.lost, &follower.start.least_contrast);
        let since = follower.between.len().checked_sub(lost).and_then(|first| follower.between.get(first)).copied().unwrap_or(index);
        let last_seen = (follower.motion.number(), *follower.motion.pose());
        let mut racket = LostRacket { since, frames: lost, last_seen, foretold, still: follower.still.take() };
        let mut found = None;
        if lost <= LONGEST_NEAR && lost.is_multiple_of(EVERY_NEAR) {
            found = self.look_near(index, &mut racket, least_contrast, buffers)?.map(|frame| (frame, Place::Near));
        }
        if found.is_none() && lost >= follower.look_next {
            found = self.look_for_racket(index, &mut racket, least_contrast, buffers)?.map(|frame| (frame, Place::Anywhere));
            follower.look_next = lost + 1 + (lost / 2).min(FARTHEST_LOOKS);
        }
        follower.still = racket.still;
        Ok(found)
    }

    /// Goes on from a frame in which it was found, and back from there into those in which its bands alone did not tell its pose.
    fn go_on_from(&self, follower: &mut RacketFollower, index: usize, frame: RacketFrame, place: Place) -> Result<(), TrackingError> {
        for (unseen, points) in follower.unseen.iter_mut().zip(&frame.points) {
            *unseen = if points.iter().any(Option::is_some) { 0 } else { *unseen + 1 };
        }
        follower.goes_on = place == Place::Near || follower.lost <= PATIENCE;
        if follower.goes_on {
            follower.motion.go_on(self.source.number(index) as f64, &frame);
        } else {
            follower.motion = self.found_at(index, &frame);
        }
        let told_again = place != Place::Expected || !frame.foretold;
        if told_again {
            let between = std::mem::take(&mut follower.between);
            if follower.look_for && !between.is_empty() {
                let found = RacketStart { index, frame: frame.clone(), ..*follower.start };
                let back = follower.goes_on.then(|| follower.motion.turned_back());
                for (index, frame) in self.follow_racket_through(&found, back, between.into_iter().rev(), false)?.0 {
                    follower.take_in(index, frame);
                }
            }
        } else {
            follower.between.push(index);
        }
        follower.foretold_for = if frame.foretold { follower.foretold_for + 1 } else { 0 };
        (follower.lost, follower.look_next, follower.still) = (0, FIRST_LOOK, None);
        follower.frames.push((index, frame));
        Ok(())
    }
}
