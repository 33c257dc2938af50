//! A racket that was followed and lost, looked for where it can have got to: in both pictures, or in one of them alone.

use crate::calibration::CameraId;
use crate::footage::{FrameBuffer, FrameSource, GreyView, Rows};
use crate::tracking::pictures::shot_frames::Shot;
use crate::tracking::racket::face;
use crate::tracking::racket::foretold_pose::Foretold;
use crate::tracking::racket::racket_near;
use crate::tracking::racket::racket_one_view;
use crate::tracking::racket::racket_pose::fit_pose_near;
use crate::tracking::racket::racket_scene::RacketFrame;
use crate::tracking::racket::racket_search::{self, Reach};
use crate::tracking::racket::racket_track;
use crate::tracking::racket::shot_racket::{MOST_BEFORE_SOME_GO, RacketStart, START_REACH_PX, STILL_PX};
use crate::tracking::shot_tracks::TrackingError;
use crate::tracking::tape::band_search::{self, BandCandidate, MOST};
use nalgebra::Isometry3;
use std::ops::Range;

/// What looks like tape must have this share of the contrast that a band needs: an even background has fainter specks in any number.
const FAINTEST: f64 = 0.25;
/// Most frames after which one camera alone may find it again, as long as it moves no faster than this share of the fastest, and how badly its bands may
/// agree there, px.
const LONGEST_ALONE: usize = 40;
const SLOW_SHARE: f64 = 0.15;
const ALONE_MISS_PX: f64 = 0.35;

/// Strongest candidates that are asked in either picture near where it was foretold.
const STRONGEST_NEAR: usize = 24;
/// What was found there must be seen in so many more frames, but one.
const GOES_ON: usize = 6;

/// A racket that was followed and lost.
pub(in crate::tracking) struct LostRacket {
    /// The first frame without it, and how many there have been.
    pub since: usize,
    pub frames: usize,
    /// Number of the frame before that, and its pose there.
    pub last_seen: (f64, Isometry3<f64>),
    /// Where it would be now had it gone on as it went.
    pub foretold: Foretold,
    /// What looked like tape in the first frame without it, once that has been asked.
    pub still: Option<[Vec<BandCandidate>; 2]>,
}

/// Pixels so near to a place along one axis.
fn around(at: f64, by: f64) -> Range<usize> {
    (at - by).max(0.0) as usize..(at + by + 1.0).max(0.0) as usize
}

impl<S: FrameSource> Shot<'_, S> {
    /// The racket anywhere it may have got to since it was last seen, in pictures that are read for it; in one of them alone where both do not show it,
    /// as long as it has not been lost for long.
    pub(in crate::tracking) fn look_for_racket(
        &self,
        index: usize,
        lost: &mut LostRacket,
        least_contrast: &[f64; 2],
        buffers: &mut [FrameBuffer; 2],
    ) -> Result<Option<RacketFrame>, TrackingError> {
        let seconds = (self.source.number(index) as f64 - lost.last_seen.0) / self.setup.frame_rate_hz;
        let reach = Reach::of(&self.figure, &lost.last_seen.1, seconds);
        let images = self.read_rows(index, self.rows_in_reach(&reach), buffers)?;
        if images.iter().any(Option::is_none) {
            return Ok(None);
        }
        let candidates = self.candidates_in_reach(&images, &reach, least_contrast);
        let likely = candidates.each_ref().map(|c| c.iter().take(MOST).copied().collect::<Vec<_>>());
        let poses = racket_search::search(self.view, &self.figure, &likely, Some(&reach));
        let measured = poses.iter().filter_map(|p| racket_track::measure(&self.scene(), &images, &p.global_from_racket, START_REACH_PX, least_contrast));
        let best = measured.filter(|f| f.count() >= 6).min_by(|a, b| a.miss_px().total_cmp(&b.miss_px()));
        let found = best.and_then(|f| face::nearest_twin(self.view, &self.figure, f, &lost.foretold.pose));
        if found.is_some() || lost.frames > LONGEST_ALONE {
            return Ok(found);
        }
        let near = Reach::of(&self.figure, &lost.last_seen.1, SLOW_SHARE * seconds);
        self.look_in_one_view(&images, candidates, &near, lost, least_contrast)
    }

    /// The racket near where it was foretold, by four bands at least, after it has not been seen for some frames. What was at the same
    /// place in the first of them is another thing, and so is what cannot be followed for some frames.
    pub(in crate::tracking) fn look_near(
        &self,
        index: usize,
        lost: &mut LostRacket,
        least_contrast: &[f64; 2],
        buffers: &mut [FrameBuffer; 2],
    ) -> Result<Option<RacketFrame>, TrackingError> {
        let foretold = lost.foretold;
        let (turn, shift) = foretold.reach();
        let reach = Reach::around(&self.figure, &foretold.pose, shift, turn);
        let images = self.read_rows(index, self.rows_in_reach(&reach), buffers)?;
        let mut candidates = self.candidates_in_reach(&images, &reach, least_contrast);
        if candidates.iter().map(Vec::len).sum::<usize>() < racket_near::FEWEST {
            return Ok(None);
        }
        let still = self.still(lost, least_contrast)?;
        for (candidates, still) in candidates.iter_mut().zip(still) {
            candidates.retain(|band| !still.iter().any(|other| (other.uv - band.uv).norm() < STILL_PX));
            candidates.truncate(STRONGEST_NEAR);
        }
        let poses = racket_near::search(self.view, &self.figure, &candidates, &foretold);
        let measured = poses.iter().filter_map(|pose| racket_track::measure(&self.scene(), &images, pose, START_REACH_PX, least_contrast));
        let known = measured.filter_map(|mut frame| {
            let enough = if frame.stereo() { frame.count() >= 6 } else { frame.count() >= racket_near::FEWEST && frame.miss_px() < ALONE_MISS_PX };
            let pose = fit_pose_near(self.view, &self.figure, &frame.observations(), &foretold).ok()?;
            (enough && foretold.allows(&pose.global_from_racket)).then(|| {
                if !frame.stereo() {
                    (frame.pose, frame.foretold) = (pose, true);
                }
                frame
            })
        });
        let Some(frame) = known.max_by_key(RacketFrame::count) else { return Ok(None) };
        let forth = self.source.number(index) as f64 > lost.last_seen.0;
        let next: Vec<usize> =
            (1..=GOES_ON).map_while(|k| if forth { Some(index + k).filter(|i| *i < self.source.len()) } else { index.checked_sub(k) }).collect();
        let start = RacketStart { index, frame, least_contrast: *least_contrast, clear: false };
        let seen = self.follow_racket_through(&start, None, next.iter().copied(), false)?.0.len();
        Ok((seen + 1 >= next.len()).then_some(start.frame))
    }

    /// What looked like tape in the first frame without it.
    fn still<'a>(&self, lost: &'a mut LostRacket, least_contrast: &[f64; 2]) -> Result<&'a [Vec<BandCandidate>; 2], TrackingError> {
        Ok(match &mut lost.still {
            Some(still) => still,
            none => none.insert(self.with_buffers(|buffers| {
                let whole = Reach::of(&self.figure, &lost.last_seen.1, f64::INFINITY);
                Ok::<_, TrackingError>(self.candidates_in_reach(&self.read(lost.since, buffers)?, &whole, least_contrast))
            })?),
        })
    }

    /// The rows of both pictures in which the racket may be.
    fn rows_in_reach(&self, reach: &Reach) -> [Rows; 2] {
        CameraId::BOTH.map(|c| {
            reach.circle(self.view, c).map_or(Rows::ALL, |(at, radius)| {
                let rows = around(at.y, radius + band_search::reach_px(self.px_per_m(c), self.shape.white_half_m));
                Rows::span(rows.start, rows.len())
            })
        })
    }

    /// What looks like tape in either picture where the racket may be, strongest first.
    fn candidates_in_reach(&self, images: &[Option<GreyView>; 2], reach: &Reach, least_contrast: &[f64; 2]) -> [Vec<BandCandidate>; 2] {
        let of = |camera: CameraId| {
            let Some(image) = &images[camera.index()] else { return Vec::new() };
            let circle = reach.circle(self.view, camera);
            // What lies next to the border of what is looked through is no peak.
            let columns = circle.map_or(0..usize::MAX, |(at, radius)| around(at.x, radius + band_search::AROUND as f64));
            let least = FAINTEST * least_contrast[camera.index()];
            let mut candidates = band_search::candidates(image, columns, self.px_per_m(camera), self.shape.white_half_m, least, MOST_BEFORE_SOME_GO);
            candidates.retain(|c| circle.is_none_or(|(at, radius)| (c.uv - at).norm() < radius));
            candidates
        };
        let (left, right) = rayon::join(|| of(CameraId::Left), || of(CameraId::Right));
        [left, right]
    }

    /// The racket in one camera's picture, all five bands of it, where the other camera does not show it. What was at the same place in the frame in
    /// which it was lost is another thing.
    fn look_in_one_view(
        &self,
        images: &[Option<GreyView>; 2],
        mut candidates: [Vec<BandCandidate>; 2],
        reach: &Reach,
        lost: &mut LostRacket,
        least_contrast: &[f64; 2],
    ) -> Result<Option<RacketFrame>, TrackingError> {
        for (candidates, camera) in candidates.iter_mut().zip(CameraId::BOTH) {
            let circle = reach.circle(self.view, camera);
            candidates.retain(|c| circle.is_some_and(|(at, radius)| (c.uv - at).norm() < radius));
        }
        if candidates.iter().all(|c| c.len() < racket_one_view::FEWEST) {
            return Ok(None);
        }
        let predicted = lost.foretold.pose;
        let still = self.still(lost, least_contrast)?;
        let mut best: Option<RacketFrame> = None;
        for camera in CameraId::BOTH {
            let c = camera.index();
            candidates[c].retain(|band| !still[c].iter().any(|other| (other.uv - band.uv).norm() < STILL_PX));
            let mut alone = [None, None];
            alone[c] = images[c];
            let poses = racket_one_view::search(self.view, &self.figure, camera, &candidates[c], reach);
            let measured = poses.iter().filter_map(|pose| racket_track::measure(&self.scene(), &alone, pose, START_REACH_PX, least_contrast));
            let whole = measured.filter(|frame| frame.count() == 5 && frame.miss_px() < ALONE_MISS_PX);
            let known = whole.filter_map(|frame| face::nearest_twin(self.view, &self.figure, frame, &predicted));
            let off = |frame: &RacketFrame| frame.pose.global_from_racket.rotation.angle_to(&predicted.rotation);
            best = best.into_iter().chain(known).min_by(|a, b| off(a).total_cmp(&off(b)));
        }
        Ok(best)
    }
}
