//! Three frames that tell a free flight: places of a ball's size in both pictures of each, evenly apart in space.
//!
//! In noisy light an outline stands out in two pictures of three, so that all six do so in one frame of five or ten. A faint one counts where
//! the others are clear, and what is told so must be seen by both cameras in a frame before or after as well.

use crate::calibration::CameraId;
use crate::footage::{FrameBuffer, FrameSource, GreyImage, GreyView};
use crate::tracking::ball::ball_fit::{self, BallFit};
use crate::tracking::ball::ball_search::BallCandidate;
use crate::tracking::ball::ball_track::{BallFrame, BallScene, FAINT_SHIFT_PX, FASTEST_M_S, ROUGH_PX, image_point};
use crate::tracking::ball::ball_way::StraightLine;
use crate::tracking::pictures::shot_frames::Shot;
use crate::tracking::shot_tracks::TrackingError;
use nalgebra::Point3;
use rayon::prelude::*;

/// Frames a second of those three, and most frames from one to the next: what lies between is found again.
const TOLD_HZ: f64 = 1000.0;
const MOST_APART: f64 = 4.0;
/// Slowest and fastest motion that is taken for a ball in play, m/s.
pub(super) const SPEEDS_M_S: (f64, f64) = (1.5, FASTEST_M_S);
/// A free ball's second difference of position, m per step²: rays good to 3 px in depth.
pub(super) const BEND_M: f64 = 0.02;
/// Share of the outline that a faint place must show, and most of the six that may be faint.
const FAINT_OUTLINE: f64 = 0.2;
pub(super) const MOST_FAINT: usize = 2;

/// A free flight, as three frames show it.
pub struct FreeFlight {
    pub balls: [BallFrame; 3],
    /// All six outlines are clear.
    pub clear: bool,
}

/// A place in space that may be the ball.
#[derive(Debug, Clone, Copy)]
pub(super) struct Place {
    pub ball: BallFrame,
    /// Outlines in either picture that are faint.
    pub faint: usize,
}

impl BallScene<'_> {
    /// Outlines that may be the ball's, and whether they are faint.
    fn outlines(&self, image: &GreyView, camera: CameraId, candidates: &[BallCandidate], radius_px: f64) -> Vec<(BallFit, bool)> {
        let fit = |c: &BallCandidate| {
            let fit = ball_fit::fit(image, c.uv, radius_px, &self.limb[camera.index()], ROUGH_PX, None)?;
            let faint = !Self::good(&fit);
            (!faint || Self::fair(&fit) && fit.outline >= FAINT_OUTLINE).then_some((fit, faint))
        };
        candidates.iter().filter_map(fit).collect()
    }

    /// Where the rays of one frame's candidates meet.
    fn places(&self, images: &[Option<GreyView>; 2], candidates: &[Vec<BallCandidate>; 2], depth_at: &Point3<f64>) -> Vec<Place> {
        let of = |camera: CameraId| match (&images[camera.index()], self.radius_px(camera, depth_at)) {
            (Some(image), Some(radius)) => self.outlines(image, camera, &candidates[camera.index()], radius),
            _ => Vec::new(),
        };
        let (left, right) = rayon::join(|| of(CameraId::Left), || of(CameraId::Right));
        let pairs = left.iter().flat_map(|l| right.iter().map(move |r| (l, r)));
        let place = |((l, l_faint), (r, r_faint)): (&(BallFit, bool), &(BallFit, bool))| {
            let ball = self.join([Some(image_point(l)), Some(image_point(r))], depth_at)?;
            Some(Place { ball, faint: usize::from(*l_faint) + usize::from(*r_faint) })
        };
        pairs.filter_map(place).collect()
    }

    /// The free flights through places in three frames, each so many after the one before; the clearest first.
    fn flights(&self, frames: &[Vec<Place>; 3], apart: usize) -> Vec<FreeFlight> {
        let (slow, fast) = (SPEEDS_M_S.0 * apart as f64 / self.frame_rate_hz, SPEEDS_M_S.1 * apart as f64 / self.frame_rate_hz);
        let mut out = Vec::new();
        for a in &frames[0] {
            for b in &frames[1] {
                for c in frames[2].iter().filter(|c| a.faint + b.faint + c.faint <= MOST_FAINT) {
                    let (p, q, r) = (a.ball.position, b.ball.position, c.ball.position);
                    let step = 0.5 * (r - p).norm();
                    if step > slow && step < fast && ((r - q) - (q - p)).norm() < BEND_M.min(0.5 * step + 0.006) {
                        out.push((a.faint + b.faint + c.faint, [a.ball, b.ball, c.ball]));
                    }
                }
            }
        }
        out.sort_by_key(|(faint, _)| *faint);
        out.into_iter().map(|(faint, balls)| FreeFlight { balls, clear: faint == 0 }).collect()
    }
}

impl<S: FrameSource> Shot<'_, S> {
    /// Frames from one to the next of the three that tell a free flight: closer in time it hardly moves beside what its depth is good to. What lies
    /// between is looked at when the flight is measured.
    pub(in crate::tracking) fn apart(&self) -> usize {
        (self.setup.frame_rate_hz / TOLD_HZ).round().clamp(1.0, MOST_APART) as usize
    }

    /// The free flights through a frame and the next two, [`Self::apart`].
    pub(in crate::tracking) fn flights_from(&self, first: usize, scene: &BallScene, still: &[Option<GreyImage>; 2]) -> Result<Vec<FreeFlight>, TrackingError> {
        let places = |index: usize| self.places_in(index, scene, still);
        let now = places(first)?;
        if now.is_empty() {
            return Ok(Vec::new());
        }
        let apart = self.apart();
        let (next, last) = rayon::join(|| places(first + apart), || places(first + 2 * apart));
        let flights = scene.flights(&[now, next?, last?], apart);
        let seen = |buffers: &mut [FrameBuffer; 2], flight: FreeFlight| Ok(self.is_seen_beside(scene, first, &flight.balls, buffers)?.then_some(flight));
        let seen: Result<Vec<_>, TrackingError> = flights.into_par_iter().map_init(Default::default, seen).collect();
        Ok(seen?.into_iter().flatten().collect())
    }

    /// The places in a frame that may be the ball.
    pub(super) fn places_in(&self, index: usize, scene: &BallScene, still: &[Option<GreyImage>; 2]) -> Result<Vec<Place>, TrackingError> {
        self.with_buffers(|buffers| {
            let images = self.read(index, buffers)?;
            let of = |c: CameraId| match (&images[c.index()], &still[c.index()], scene.radius_px(c, &self.focus)) {
                (Some(v), Some(b), Some(r)) => scene.candidates(v, c, b, r),
                _ => Vec::new(),
            };
            let (left, right) = rayon::join(|| of(CameraId::Left), || of(CameraId::Right));
            Ok(scene.places(&images, &[left, right], &self.focus))
        })
    }

    /// [`Self::flights_from`] of what stands out from the pictures half a clip away: a ball that comes along a camera's line of sight hardly
    /// moves in its pictures, and then the median picture holds the ball itself.
    pub(in crate::tracking) fn flights_against_another(&self, first: usize, scene: &BallScene) -> Result<Vec<FreeFlight>, TrackingError> {
        let n = self.source.len();
        let image = |v: GreyView| GreyImage { width: v.width, height: v.height, pixels: (0..v.height).filter_map(|y| v.row(y)).flatten().copied().collect() };
        let away = self.with_buffers(|buffers| Ok::<_, TrackingError>(self.read((first + n / 2) % n, buffers)?.map(|view| view.map(image))))?;
        if away.iter().all(Option::is_some) { self.flights_from(first, scene, &away) } else { Ok(Vec::new()) }
    }

    /// Whether both cameras see a flight where it was before, or will be after, the three frames that tell it.
    fn is_seen_beside(&self, scene: &BallScene, first: usize, flight: &[BallFrame; 3], buffers: &mut [FrameBuffer; 2]) -> Result<bool, TrackingError> {
        let apart = self.apart();
        let number = |index: usize| self.source.number(index) as f64;
        let line = StraightLine::through(flight.iter().enumerate().map(|(k, ball)| (number(first + k * apart), ball.position)));
        for index in [first.checked_sub(apart), Some(first + 3 * apart)].into_iter().flatten().filter(|index| *index < self.source.len()) {
            if self.both_see(scene, index, &line.at(number(index)), buffers)? {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// Whether both cameras show an outline at a place, though a faint one.
    pub(super) fn both_see(&self, scene: &BallScene, index: usize, there: &Point3<f64>, buffers: &mut [FrameBuffer; 2]) -> Result<bool, TrackingError> {
        let images = self.read_rows(index, scene.close_rows(there), buffers)?;
        let sees = |camera: CameraId| {
            let (image, uv, radius) = (images[camera.index()].as_ref()?, scene.view.project(camera, there)?, scene.radius_px(camera, there)?);
            let fit = ball_fit::fit(image, uv, radius, &scene.limb[camera.index()], ROUGH_PX, None)?;
            Some(BallScene::fair(&fit) && (fit.uv - uv).norm() < FAINT_SHIFT_PX)
        };
        Ok(CameraId::BOTH.into_iter().all(|camera| sees(camera) == Some(true)))
    }
}
