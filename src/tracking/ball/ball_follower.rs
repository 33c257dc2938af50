//! The ball followed one way, frame by frame, from two frames it was seen in.

use crate::calibration::CameraId;
use crate::footage::{FrameBuffer, FrameSource, GreyPatch};
use crate::tracking::ball::ball_fit::OutlineLevels;
use crate::tracking::ball::ball_track::{BallFrame, BallScene, MeanDisc};
use crate::tracking::ball::ball_way::BallWay;
use crate::tracking::pictures::shot_frames::{PATIENCE, Shot};
use crate::tracking::shot_tracks::TrackingError;
use std::ops::Range;

/// Frames of which the pixels around the ball are kept, each way: 2 kB each, so that memory does not grow with the clip.
const PATCHES: usize = 2000;
/// What both cameras see in fewer than one of three of the first so many frames is followed no farther.
const TRIED: usize = 24;
const LEAST_BY_BOTH: usize = 3;

/// A ball as first followed, and the mean pictures of its disc.
pub struct Flight {
    pub(in crate::tracking) frames: Vec<Option<BallFrame>>,
    pub(in crate::tracking) means: [MeanDisc; 2],
    /// By frame.
    pub(in crate::tracking) kept: Vec<Option<Kept>>,
}

/// What both cameras saw around the ball in a frame, and with which levels it was measured.
#[derive(Clone)]
pub struct Kept {
    pub(in crate::tracking) patches: [GreyPatch; 2],
    pub(in crate::tracking) levels: Option<Box<[OutlineLevels; 2]>>,
}

/// A ball followed one way.
#[derive(Default)]
pub struct HalfFlight {
    frames: Vec<(usize, BallFrame, Option<Kept>)>,
    means: [MeanDisc; 2],
}

impl HalfFlight {
    /// In which frames the ball was seen, and where.
    fn seen(&self) -> impl Iterator<Item = (usize, BallFrame)> {
        self.frames.iter().map(|(index, ball, _)| (*index, *ball))
    }
}

/// Who follows a ball one way, and how far it is.
pub struct BallFollower<'s> {
    scene: &'s BallScene<'s>,
    /// Frames not yet looked at, and whether the first or the last of them is nearest.
    ahead: Range<usize>,
    forth: bool,
    /// One of so many frames is looked at; times are counted in looks.
    every: usize,
    way: BallWay,
    half: HalfFlight,
    buffers: [FrameBuffer; 2],
    looked_at: usize,
    /// Looks since it was last seen.
    lost: usize,
    /// When both cameras and either one saw it last.
    seen_by_both: f64,
    seen_by: [f64; 2],
}

impl BallFollower<'_> {
    /// In which frames it has seen the ball so far, and where.
    pub fn seen(&self) -> impl Iterator<Item = (usize, BallFrame)> {
        self.half.seen()
    }

    /// Frames it has not looked at yet, if the ball is seen in them.
    pub fn left(&self) -> usize {
        self.ahead.len()
    }
}

/// Takes the nearest of the frames ahead: the first (`forth`) or the last.
pub fn nearest(ahead: &mut Range<usize>, forth: bool) -> Option<usize> {
    nth_nearest(ahead, forth, 1)
}

/// Takes so many of the frames ahead, the last of them being the one asked for.
fn nth_nearest(ahead: &mut Range<usize>, forth: bool, n: usize) -> Option<usize> {
    if forth { ahead.nth(n - 1) } else { ahead.nth_back(n - 1) }
}

impl<S: FrameSource> Shot<'_, S> {
    /// Follows a flight found in three frames, the first of them `first`, toward the clip's end or its beginning, looking at one of `every` frames.
    pub(in crate::tracking) fn follower<'s>(&self, scene: &'s BallScene, first: usize, flight: &[BallFrame; 3], forth: bool, every: usize) -> BallFollower<'s> {
        let apart = self.apart();
        let middle = (first + apart, flight[1]);
        let (last, ahead) = if forth { (2, first + 2 * apart + 1..self.source.len()) } else { (0, 0..first) };
        self.follower_along(scene, middle, (first + last * apart, flight[last]), ahead, forth, every)
    }

    /// Follows what was seen in two frames, the nearer one last, through one of `every` frames of those `ahead`, up (`forth`) or down.
    pub(in crate::tracking) fn follower_along<'s>(
        &self,
        scene: &'s BallScene,
        before: (usize, BallFrame),
        last: (usize, BallFrame),
        ahead: Range<usize>,
        forth: bool,
        every: usize,
    ) -> BallFollower<'s> {
        let at = |i: usize| self.source.number(i) as f64 / every as f64;
        BallFollower {
            scene,
            ahead,
            forth,
            every,
            way: BallWay::new([before, last].map(|(index, ball)| (at(index), ball.position))),
            half: HalfFlight::default(),
            buffers: Default::default(),
            looked_at: 0,
            lost: 0,
            seen_by_both: at(last.0),
            seen_by: [at(last.0); 2],
        }
    }

    /// Both ways of a flight beside each other, to their ends.
    pub(in crate::tracking) fn both_to_the_end(&self, [back, forth]: [BallFollower; 2]) -> Result<[HalfFlight; 2], TrackingError> {
        let (back, forth) = rayon::join(|| self.follow_to_the_end(back), || self.follow_to_the_end(forth));
        Ok([back?, forth?])
    }

    /// The ball through all frames ahead, until it is lost.
    pub(in crate::tracking) fn follow_to_the_end(&self, mut follower: BallFollower) -> Result<HalfFlight, TrackingError> {
        self.follow_on(&mut follower, usize::MAX)?;
        Ok(follower.half)
    }

    /// The ball so many looks farther, or until it is lost; then `false`.
    pub(in crate::tracking) fn follow_on(&self, follower: &mut BallFollower, looks: usize) -> Result<bool, TrackingError> {
        for _ in 0..looks {
            if !self.look_ahead(follower)? {
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// Looks for the ball in the next frame; `false` when it is followed no farther.
    fn look_ahead(&self, follower: &mut BallFollower) -> Result<bool, TrackingError> {
        let BallFollower { scene, ahead, forth, every, way, half, buffers, looked_at, lost, seen_by_both, seen_by } = follower;
        // A ball is no ball for one camera alone from the beginning.
        if *lost > PATIENCE || *looked_at == TRIED && LEAST_BY_BOTH * half.frames.iter().filter(|(_, b, _)| b.stereo).count() < TRIED {
            return Ok(false);
        }
        let Some(index) = nth_nearest(ahead, *forth, *every) else { return Ok(false) };
        let now = self.source.number(index) as f64 / *every as f64;
        let unseen = (now - *seen_by_both).abs();
        let unseen_frames = unseen * *every as f64;
        let predicted = way.foretold(now);
        // What one camera alone saw go straight on has not turned: the other will find it where it is foretold. Otherwise the strings may have it.
        let goes_on = way.is_straight() && seen_by.iter().any(|seen| (now - seen).abs() < 1.5);
        let reach_px = seen_by.map(|seen| {
            let unseen = if way.is_straight() { (now - seen).abs() } else { unseen };
            if goes_on { 3.0 + 0.25 * unseen } else { 2.0 + 2.0 * unseen }.min(12.0) as i32
        });
        let close = self.read_rows(index, scene.close_rows(&predicted), buffers)?;
        let (found, levels, images) = match scene.measure_close(&close, &predicted, None, unseen_frames, way.is_straight()) {
            Err(fits) => {
                let images = self.read_rows(index, self.ball_rows(scene, &predicted, reach_px[0].max(reach_px[1])), buffers)?;
                (scene.measure(&images, &predicted, reach_px, unseen_frames, &fits), None, images)
            }
            Ok((found, levels)) => (Some(found), Some(levels), close),
        };
        if images.iter().all(Option::is_none) {
            return Ok(true);
        }
        *looked_at += 1;
        let Some(ball) = found else {
            *lost += 1;
            return Ok(true);
        };
        let saw_it = seen_by.map(|seen| (now - seen).abs() < 1.5);
        way.go_on(now, ball.position, scene.as_foretold(&ball, &predicted, saw_it));
        *lost = 0;
        if ball.stereo {
            *seen_by_both = now;
        }
        for camera in CameraId::BOTH {
            if ball.points[camera.index()].is_some() {
                seen_by[camera.index()] = now;
            }
            if let Some(image) = &images[camera.index()] {
                scene.add_to_mean(&mut half.means[camera.index()], image, camera, &ball);
            }
        }
        let patches = if half.frames.len() < PATCHES { scene.patches(&images, &ball) } else { None };
        half.frames.push((index, ball, patches.map(|patches| Kept { patches, levels: levels.map(Box::new) })));
        Ok(true)
    }

    /// By frame, what was seen of a flight in the frames it was found in, `first` and those [`Self::apart`] after it, and along the ways it was followed
    /// from there.
    pub(in crate::tracking) fn followed(
        &self,
        first: usize,
        flight: &[BallFrame],
        seen: impl IntoIterator<Item = (usize, BallFrame)>,
    ) -> Vec<Option<BallFrame>> {
        let mut frames = vec![None; self.source.len()];
        for (k, ball) in flight.iter().enumerate() {
            frames[first + k * self.apart()] = Some(*ball);
        }
        for (index, ball) in seen {
            frames[index] = Some(ball);
        }
        frames
    }

    /// A flight of which the ways it was followed have come to their ends.
    pub(in crate::tracking) fn whole_flight<const WAYS: usize>(&self, first: usize, flight: &[BallFrame], halves: [HalfFlight; WAYS]) -> Flight {
        let frames = self.followed(first, flight, halves.iter().flat_map(HalfFlight::seen));
        let mut kept = vec![None; frames.len()];
        let mut means: [MeanDisc; 2] = Default::default();
        for half in halves {
            means.iter_mut().zip(&half.means).for_each(|(all, some)| all.add(some));
            half.frames.into_iter().for_each(|(index, _, what)| kept[index] = what);
        }
        Flight { frames, means, kept }
    }
}
