//! The ball's spin in one tracked shot: crops of the ball in free flight, before and after the contact.

use crate::calibration::CameraId;
use crate::footage::{FrameBuffer, FrameSource, GreyPatch, Rows};
use crate::tracking::ball::ball_refine::{SHARED_VARIANCE, refine_ball};
use crate::tracking::ball::bounce::Flights;
use crate::tracking::ball::flight_sample::FlightSample;
use crate::tracking::ball::standing_before::{Pass, StandingBefore};
use crate::tracking::racket::racket_pose::View;
use crate::tracking::shot_tracks::{ShotSetup, ShotTracks, TrackingError};
use crate::tracking::spin::{BLUR_PX, BallSpin, BallView, FoundSpin, SpinEstimate, SpinRefusal, SpinSettings};
use crate::tracking::tape::tape_blur::out_of_focus;
use crate::tracking::track_file::{SpacePoint, Target};
use nalgebra::{Point3, Vector2, Vector3};
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Pixels kept around the ball, in radii.
const CROP_RADII: f64 = 1.6;
/// A ball of which more is covered by what stands before it tells no spin: its centre is half an outline's.
const MOST_COVERED: f64 = 0.25;

struct Crop {
    camera: CameraId,
    time_s: f64,
    picture: GreyPatch,
    centre_px: Vector2<f64>,
    radius_px: f64,
    /// Of this centre alone, and of what it has in common with its neighbours.
    centre_sd_px: f64,
    centre_shared_px: f64,
    position: Point3<f64>,
}

/// Measures the ball's spin before and after the contact and, with it, the ball's centres and space points. Without a known contact both are
/// refused: a flight of which nobody knows whether it comes or leaves has no side.
///
/// # Errors  a picture that cannot be read
pub fn measure_spin(source: &impl FrameSource, setup: &ShotSetup, shot: &mut ShotTracks) -> Result<BallSpin, TrackingError> {
    if shot.contact_frame.is_none() {
        let refused = SpinEstimate::Refused { reason: SpinRefusal::NoContact };
        return Ok(BallSpin { before: refused.clone(), after: refused });
    }
    let mut found = FoundSpins::find(source, setup, shot)?;
    let turning = found.turning(&found.rough());
    refine_ball(source, setup, shot, &turning, &found.sample, &found.standing)?;
    // Where a spin that could not be told from another one still cannot, its cover is learnt already.
    if !found.complete() && (found.find_again(source, setup, shot)? || turning.contains(&None)) {
        let measured = found.measure(source, setup, shot)?;
        refine_ball(source, setup, shot, &found.turning(&measured), &found.sample, &found.standing)?;
    }
    // The better centres tell the spin better: a drift of the outline looks like a turn.
    found.measure(source, setup, shot)
}

/// The spins before and after the contact as they are found.
#[derive(Debug, Clone)]
struct FoundSpins {
    /// Frames that tell the spins and teach the cover.
    sample: FlightSample,
    /// What hides the ball in them.
    standing: StandingBefore,
    /// By side, as the rest.
    settings: [SpinSettings; 2],
    found: [FoundSpin; 2],
}

impl FoundSpins {
    /// Looks for the spins; for slow ones in pictures of a longer time as well, as long as the flight was seen.
    fn find(source: &impl FrameSource, setup: &ShotSetup, shot: &ShotTracks) -> Result<Self, TrackingError> {
        let view = View::new(setup.rig);
        let beside = |contact| Flights::of(source, &view, &shot.ball, contact, setup.frame_rate_hz).beside_the_strings();
        let free_s = shot.contact_frame.map_or([f64::INFINITY; 2], beside).map(|frames| frames / setup.frame_rate_hz);
        let sample_of = |fastest: [Option<f64>; 2]| {
            let balls = shot.points.iter().filter(|p| p.target == Target::Ball).map(|p| (p.frame, p.t));
            FlightSample::of(balls, setup.frame_rate_hz, fastest, free_s)
        };
        let radius_m = setup.ball.radius_m();
        let blur_px = shot.blur_px.map(|tape| out_of_focus(BLUR_PX, tape));
        let usual = sample_of([None; 2]);
        let nothing = StandingBefore::default();
        let (before, after) = rayon::join(|| crops(source, setup, shot, &usual, 0, &nothing), || crops(source, setup, shot, &usual, 1, &nothing));
        let mut seen = [before?, after?];
        let standing = &StandingBefore::of(&seen.iter().flatten().map(Crop::pass).collect::<Vec<_>>(), &shot.still);
        seen.iter_mut().for_each(|crops| clear_of(standing, crops));
        let look = |side: usize| -> Result<(FlightSample, SpinSettings, FoundSpin), TrackingError> {
            let settings_of = |sample: &FlightSample| SpinSettings { blur_px, ..SpinSettings::new(sample.rates_hz()[side]) };
            let settings = settings_of(&usual);
            let found = FoundSpin::find(&views(&seen[side]), setup.rig, radius_m, &settings);
            let mut fastest = [None; 2];
            fastest[side] = found.fastest();
            let longer = sample_of(fastest);
            if longer.rates_hz()[side] < usual.rates_hz()[side] {
                let settings = settings_of(&longer);
                let again = found.look_longer(&views(&crops(source, setup, shot, &longer, side, standing)?), setup.rig, radius_m, &settings);
                if matches!(again.rough, SpinEstimate::Vector { .. }) {
                    return Ok((longer, settings, again));
                }
            }
            Ok((usual, settings, found))
        };
        let (before, after) = rayon::join(|| look(0), || look(1));
        let (mut sample, settings_before, before) = before?;
        let (sample_after, settings_after, after) = after?;
        sample.take_side(1, &sample_after);
        Ok(FoundSpins { sample, standing: standing.clone(), settings: [settings_before, settings_after], found: [before, after] })
    }

    /// Looks again where nothing was found, with the centres as they are now; whether a spin was found.
    fn find_again(&mut self, source: &impl FrameSource, setup: &ShotSetup, shot: &ShotTracks) -> Result<bool, TrackingError> {
        let FoundSpins { sample, standing, settings, found } = self;
        let again = |(side, found): (usize, &mut FoundSpin)| -> Result<bool, TrackingError> {
            if matches!(found.rough, SpinEstimate::Vector { .. }) {
                return Ok(false);
            }
            *found = FoundSpin::find(&views(&crops(source, setup, shot, sample, side, standing)?), setup.rig, setup.ball.radius_m(), &settings[side]);
            Ok(matches!(found.rough, SpinEstimate::Vector { .. }))
        };
        let new: Vec<bool> = found.par_iter_mut().enumerate().map(again).collect::<Result<_, _>>()?;
        Ok(new.contains(&true))
    }

    /// Whether both spins are known.
    fn complete(&self) -> bool {
        self.found.iter().all(|f| matches!(f.rough, SpinEstimate::Vector { .. }))
    }

    /// What is known so far: good enough to learn the ball's cover with.
    fn rough(&self) -> BallSpin {
        let [before, after] = self.found.each_ref().map(|f| f.rough.clone());
        BallSpin { before, after }
    }

    /// How the ball's lines turn before and after, by what was `told` of it.
    fn turning(&self, told: &BallSpin) -> [Option<Vector3<f64>>; 2] {
        [self.found[0].turning(&told.before), self.found[1].turning(&told.after)]
    }

    /// Measures the spins, with the centres as they are now.
    fn measure(&self, source: &impl FrameSource, setup: &ShotSetup, shot: &ShotTracks) -> Result<BallSpin, TrackingError> {
        let measure = |side: usize| -> Result<SpinEstimate, TrackingError> {
            let crops = crops(source, setup, shot, &self.sample, side, &self.standing)?;
            Ok(self.found[side].measure(&views(&crops), setup.rig, setup.ball.radius_m(), &self.settings[side]))
        };
        let (before, after) = rayon::join(|| measure(0), || measure(1));
        Ok(BallSpin { before: before?, after: after? })
    }
}

fn views(crops: &[Crop]) -> Vec<BallView<'_>> {
    crops.iter().map(Crop::view).collect()
}

/// The ball in free flight before (0) or after (1) the contact, where nothing `standing` hides much of it.
fn crops(
    source: &impl FrameSource,
    setup: &ShotSetup,
    shot: &ShotTracks,
    sample: &FlightSample,
    side: usize,
    standing: &StandingBefore,
) -> Result<Vec<Crop>, TrackingError> {
    let radius = setup.ball.radius_m();
    let mut crops: Vec<Crop> = Vec::new();
    let mut buffer = FrameBuffer::default();
    let balls: BTreeMap<u64, &SpacePoint> = shot.points.iter().filter(|p| p.target == Target::Ball).map(|p| (p.frame, p)).collect();
    for index in 0..source.len() {
        let number = source.number(index);
        let Some(point) = balls.get(&number).filter(|point| sample.side(number, point.t) == Some(side)) else { continue };
        for camera in CameraId::BOTH {
            let Some(seen) = shot.tracks.get(number, camera, Target::Ball) else { continue };
            let in_camera = setup.rig.camera_from_global(camera) * point.position;
            if in_camera.z <= radius {
                continue;
            }
            let radius_px = setup.rig.camera(camera).fx * radius / in_camera.z;
            let half = (CROP_RADII * radius_px).clamp(4.0, 400.0);
            let rows = |height: usize| {
                let first = (seen.uv.y - half).clamp(0.0, height as f64) as usize;
                Rows::span(first, ((seen.uv.y + half + 2.0).clamp(0.0, height as f64) as usize).saturating_sub(first))
            };
            if !source.read(index, camera.index(), rows(setup.rig.image_size[1]), &mut buffer)? {
                continue;
            }
            let corner = [seen.uv.x - half, seen.uv.y - half].map(|x| x.floor() as i64);
            let reach = (2.0 * half).ceil() as i64;
            let box_of = |view| GreyPatch::of(&view, (corner[0], corner[1]), (corner[0] + reach, corner[1] + reach));
            let Some(picture) = buffer.view().and_then(box_of) else { continue };
            crops.push(Crop {
                camera,
                time_s: point.t,
                picture,
                centre_px: seen.uv,
                radius_px,
                centre_sd_px: seen.sd.max() * (1.0 - SHARED_VARIANCE).sqrt(),
                centre_shared_px: seen.sd.max() * SHARED_VARIANCE.sqrt(),
                position: point.position,
            });
        }
    }
    clear_of(standing, &mut crops);
    Ok(crops)
}

/// Takes out of the pictures what stands before the ball, and the pictures in which it hides much.
fn clear_of(standing: &StandingBefore, crops: &mut Vec<Crop>) {
    crops.retain_mut(|crop| {
        if standing.is_clear(crop.camera) {
            return true;
        }
        crop.picture.whiten(|x, y| standing.covers(crop.camera, x, y));
        standing.share(crop.camera, &crop.centre_px, crop.radius_px) < MOST_COVERED
    });
}

impl Crop {
    fn pass(&self) -> Pass<'_> {
        Pass { camera: self.camera, picture: self.picture.view(), centre: self.centre_px, radius_px: self.radius_px }
    }

    fn view(&self) -> BallView<'_> {
        BallView {
            camera: self.camera,
            time_s: self.time_s,
            picture: self.picture.view(),
            centre_px: self.centre_px,
            centre_sd_px: self.centre_sd_px,
            centre_shared_px: self.centre_shared_px,
            position: self.position,
        }
    }
}
