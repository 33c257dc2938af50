//! From tracks to the motions of ball and racket on both sides of the contact, and the contact itself.
//!
//! The windows never reach across the contact: which frames belong to which side follows from the fits' own first and
//! last contact, until it no longer changes.

use super::balance_seen::BalanceSeen;
use super::ball_flight::{
    FlightEstimate, FlightLaw, FlightResult, FlightState, FlightView, average_flight, bending_p, fit_flight, flight_deviations, flight_persistence,
};
use super::contact::{PointMotion, body_at, crossing};
use super::least_squares::SolveError;
use super::motion_law::{MotionLaw, Pace};
use super::motion_state::MotionState;
use super::racket_motion::{LawResult, MotionEstimate, MotionView, MovingRacket, average, fit_law, motion_persistence, sighting_deviations};
use super::sighting::{CommonError, FrameClock, Sighting, sightings};
use super::tape_session::TapeErrors;
use super::{FitError, KinematicsError};
use crate::calibration::{CameraId, StereoRig};
use crate::equipment::{Ball, Racket};
use crate::reconstruction::{Triangulated, Triangulator};
use crate::tracking::{BALL_ERRORS_ALIKE, MarkerObservation, RacketFigure, Target, Tracks, View, fit_pose_in};
use nalgebra::{Isometry3, Point3, Vector3};
use std::collections::BTreeMap;

/// Standard acceleration of gravity, m/s².
pub const GRAVITY_M_S2: f64 = 9.80665;

/// Change of a band's image error while the racket turns by a radian, as a multiple of that error: other sides of the tape
/// come into view. (On tracked pictures with known truth 0.06 to 0.16 px per radian where the error is 0.06 px.)
const TAPE_CHANGE_PER_RAD: f64 = 2.0;
/// How much that change bends, px per squared radian: half a radian on, a band is seen quite anew. (On tracked pictures with
/// known truth 0.15 to 0.35, whatever the constant error.)
const TAPE_BEND_PX_PER_RAD2: f64 = 0.15;
/// A racket never turns slower than this for the purpose, rad/s: what is seen of a band also changes by itself.
const SLOWEST_TURN: f64 = 10.0;

/// How the measurement is made. The defaults suit 500 to 2000 frames per second.
#[derive(Debug, Clone, PartialEq)]
pub struct MeasureSettings {
    pub frame_period_s: f64,
    pub exposure_s: f64,
    /// Longest window on either side of the contact, s. The thesis takes 0.010 s because it fits lines; laws of motion
    /// with an arc and angular acceleration hold longer. Where the ball's path bends more than its laws allow, its window
    /// is shortened.
    pub window_s: f64,
    /// Global V points up. When the session has no axes pictures gravity is taken along the left camera's downward axis.
    pub axes_known: bool,
    /// Prior odds of air drag against none; the session's other shots may know better than 1.
    pub air_odds: f64,
    /// Image error of the ball that persists over a window.
    pub ball_error: CommonError,
    /// The session's tape.
    pub tape: TapeErrors,
    /// Where the session's free flights put the racket's centre of mass.
    pub balance: BalanceSeen,
    /// Only what tells `balance` and `air_odds` is asked for: few laws of the racket, none of them weighed before the contact.
    pub first_look: bool,
    /// Frame near the impact, from shot.toml.
    pub impact_frame: Option<u64>,
}

impl MeasureSettings {
    pub fn new(frame_rate_hz: f64, exposure_s: f64) -> Self {
        MeasureSettings {
            frame_period_s: 1.0 / frame_rate_hz,
            exposure_s,
            window_s: 0.030,
            axes_known: true,
            air_odds: 1.0,
            ball_error: CommonError { constant_px: 0.05, drift_px_s: 3.0, bend_px_s2: 0.0 },
            tape: TapeErrors::expected(),
            balance: BalanceSeen::expected(),
            first_look: false,
            impact_frame: None,
        }
    }

    /// Image error of a tape band that persists over a window.
    pub fn tape_error(&self, rate_rad_s: f64) -> CommonError {
        // What all shots share is an error of this shot too, whatever is stated beside it for those who look at many.
        let constant_px = self.tape.shot_px.hypot(self.tape.shared_px);
        let turn = rate_rad_s.max(SLOWEST_TURN);
        CommonError { constant_px, drift_px_s: TAPE_CHANGE_PER_RAD * constant_px * turn, bend_px_s2: TAPE_BEND_PX_PER_RAD2 * turn * turn }
    }

    pub fn gravity(&self) -> Vector3<f64> {
        // Without axes the global frame is the left camera's, whose y points down in a camera held upright.
        Vector3::new(0.0, if self.axes_known { -GRAVITY_M_S2 } else { GRAVITY_M_S2 }, 0.0)
    }
}

/// One frame seen alone: the ball's place and the racket's rough pose.
#[derive(Debug, Clone)]
pub struct FrameView {
    pub t: f64,
    pub ball: Option<Triangulated>,
    pub pose: Option<Isometry3<f64>>,
}

/// Motions on both sides of the contact. Times on the clock's origin; `*_out` are `None` when too little was seen after.
#[derive(Debug, Clone)]
pub struct ShotMotion {
    pub clock: FrameClock,
    /// +1 when the ball comes from the racket's +z side.
    pub side: f64,
    pub moving: MovingRacket,
    pub frames: BTreeMap<u64, FrameView>,
    pub first_contact_t: f64,
    pub ball_in: FlightEstimate,
    pub racket_in: MotionEstimate,
    pub last_contact_t: Option<f64>,
    pub ball_out: Option<FlightEstimate>,
    pub racket_out: Option<MotionEstimate>,
    /// What was limited, in words, for the person who reads shot.json.
    pub remarks: Vec<String>,
}

/// A place and a velocity.
type Line = (Point3<f64>, Vector3<f64>);
/// Frames before and after the contact in which the ball may be looked for when the nearest do not show it, and how far apart both flights may be
/// there, m: 50 m/s for 5 ms of contact.
const FAR: u64 = 24;
const TOGETHER_M: f64 = 0.25;
/// Longest gap in which both flights tell an impact, s, and the least change of velocity that is one, m/s.
const LONGEST_HIDDEN_S: f64 = 0.035;
const LEAST_JUMP_M_S: f64 = 3.0;
/// Fewest frames of a body on one side: below that its velocity is a guess.
pub const FEWEST_FRAMES: usize = 4;
/// Fewest of these in which both cameras show it.
const FEWEST_STEREO: usize = 2;
/// The face's half extents around the stringbed centre within which an approach counts as an impact, m.
const FACE: (f64, f64) = (0.30, 0.20);
/// Most rounds in which windows and contact settle on each other.
const ROUNDS: usize = 6;
/// Contact lasts 3 to 7 ms (physics.md E.2); frames this long after first contact are surely free again.
const SURELY_FREE_S: f64 = 0.0075;
/// Usual length of a contact, s, for when its end is not seen.
const USUAL_CONTACT_S: f64 = 0.005;
/// Deviations (in scaled standard deviations over both axes) beyond which a point is an outlier. Among 500 good points
/// one is beyond 4.2 in every ten shots (Rayleigh).
const OUTLIER: f64 = 4.2;
/// A window of the ball is shortened while a path that obeys its laws would bend as much in fewer than one shot of a thousand
/// (half a window knows the velocity three times worse: shortening must be worth it),
pub(crate) const BENDS_P: f64 = 0.001;
/// by a tenth at a time,
const SHORTENED: f64 = 0.9;
/// but not below the thesis's ten frames: fewer tell no bend from noise.
const FEWEST_UNBENT: usize = 10;

struct Bench<'a> {
    rig: &'a StereoRig,
    tracks: &'a Tracks,
    ball: &'a Ball,
    moving: MovingRacket,
    settings: &'a MeasureSettings,
    clock: FrameClock,
}

/// Measures one shot's motions.
pub fn measure_motion(rig: &StereoRig, tracks: &Tracks, racket: &Racket, ball: &Ball, settings: &MeasureSettings) -> Result<ShotMotion, KinematicsError> {
    let figure = RacketFigure::of(racket).ok_or_else(|| KinematicsError::NoMarkers { racket: racket.name.clone() })?;
    let figure = settings.tape.throat.map_or_else(|| figure.clone(), |throat| figure.with(&throat));
    let BalanceSeen { shift_m, sd_m, .. } = settings.balance;
    let moving = MovingRacket {
        figure,
        com_local: racket.com_local(),
        inertia: racket.inertia_kg_m2(),
        gravity: settings.gravity(),
        balance: shift_m,
        balance_sd: sd_m,
    };
    let all = tracks.frames();
    let (Some(&first), Some(&last)) = (all.first(), all.last()) else {
        return Err(KinematicsError::NoPoints);
    };
    let mut clock = FrameClock { origin: first, period_s: settings.frame_period_s };
    let frames = frame_views(rig, tracks, &moving, clock);
    let (impact_frame, side) = find_impact(&frames, ball, settings, (first, last))?;
    // Count time from the impact: no cancellation in powers of t.
    let shift = clock.time_s(impact_frame);
    clock.origin = impact_frame;
    let frames = frames.into_iter().map(|(k, f)| (k, FrameView { t: f.t - shift, ..f })).collect();
    let bench = Bench { rig, tracks, ball, moving, settings, clock };
    bench.measure(frames, side)
}

/// Every frame by itself.
fn frame_views(rig: &StereoRig, tracks: &Tracks, moving: &MovingRacket, clock: FrameClock) -> BTreeMap<u64, FrameView> {
    let (view, space) = (View::new(rig), Triangulator::new(rig));
    let mut views = BTreeMap::new();
    let mut last: Option<Isometry3<f64>> = None;
    for frame in tracks.frames() {
        let point = |target| {
            let (l, r) = (tracks.get(frame, CameraId::Left, target)?, tracks.get(frame, CameraId::Right, target)?);
            space.triangulate_alike(&l, &r, BALL_ERRORS_ALIKE).ok()
        };
        let observations: Vec<MarkerObservation> = CameraId::BOTH
            .iter()
            .flat_map(|&camera| Target::MARKERS.map(|t| (camera, t)))
            .filter_map(|(camera, t)| Some(MarkerObservation { camera, marker: t.index(), point: tracks.get(frame, camera, t)? }))
            .collect();
        let pose = fit_pose_in(&view, &moving.figure, &observations, last.as_ref()).ok().map(|p| p.global_from_racket);
        last = pose.or(last);
        views.insert(frame, FrameView { t: clock.time_s(frame), ball: point(Target::Ball), pose });
    }
    views
}

/// The frame at which the ball is nearest to the face, and the side it came from.
fn find_impact(frames: &BTreeMap<u64, FrameView>, ball: &Ball, settings: &MeasureSettings, span: (u64, u64)) -> Result<(u64, f64), KinematicsError> {
    let reach = 2.0 * ball.diameter_m;
    let local: Vec<(u64, Point3<f64>)> = frames.iter().filter_map(|(k, f)| Some((*k, f.pose?.inverse_transform_point(&f.ball?.position)))).collect();
    if local.len() < 2 * FEWEST_STEREO {
        return Err(KinematicsError::NoCommonFrames { seen: local.len(), need: 2 * FEWEST_STEREO });
    }
    let over_face = |p: &Point3<f64>| p.x.abs() < FACE.0 && p.y.abs() < FACE.1;
    let nearest = match settings.impact_frame {
        Some(frame) if (span.0..=span.1).contains(&frame) => Some(frame),
        Some(frame) => return Err(KinematicsError::ImpactFrameOutside { frame, first: span.0, last: span.1 }),
        None => {
            // The string plane, carried by a turning racket, may sweep past the ball more than once: the impact is where the
            // ball's velocity jumps.
            let near: Vec<&(u64, Point3<f64>)> = local.iter().filter(|(_, p)| over_face(p) && p.z.abs() < reach).collect();
            let lowest = near.iter().enumerate().filter(|(i, n)| {
                let farther = |j: Option<usize>| j.and_then(|j| near.get(j)).is_none_or(|o| o.0.abs_diff(n.0) > 1 || o.1.z.abs() >= n.1.z.abs());
                farther(i.checked_sub(1)) && farther(Some(i + 1))
            });
            lowest.max_by(|a, b| velocity_jump(frames, a.1.0).total_cmp(&velocity_jump(frames, b.1.0))).map(|(_, n)| n.0)
        }
    };
    // The ball may be hidden around the contact: then its two flights tell where it met the strings.
    let nearest = match nearest {
        Some(frame) => frame,
        None => hidden_impact(frames, settings.frame_period_s, |p| over_face(p) && p.z.abs() < reach)
            .or_else(|| approach_end(&local, settings.frame_period_s))
            .ok_or_else(|| KinematicsError::NoImpact { nearest_m: local.iter().map(|(_, p)| p.z.abs()).fold(f64::INFINITY, f64::min), reach_m: reach })?,
    };
    let before: Vec<f64> = local.iter().filter(|(k, _)| *k < nearest).rev().take(12).map(|(_, p)| p.z).collect();
    if before.len() < FEWEST_STEREO {
        return Err(KinematicsError::TooFewFrames { body: "ball and racket", when: "before", seen: before.len(), need: FEWEST_STEREO });
    }
    Ok((nearest, before.iter().sum::<f64>().signum()))
}

/// Change of the ball's velocity from the frames before to the frames after one frame, m/s; 0 when too few are seen. Where none of the next frames
/// show the ball, farther ones tell, if what they show comes together at the frame: a ball cannot be turned round anywhere else.
fn velocity_jump(frames: &BTreeMap<u64, FrameView>, at: u64) -> f64 {
    let Some(t) = frames.get(&at).map(|f| f.t) else { return 0.0 };
    let line = |range: std::ops::RangeInclusive<u64>| {
        let points: Vec<(f64, Point3<f64>)> = frames.range(range).filter_map(|(_, f)| Some((f.t, f.ball?.position))).collect();
        (points.len() >= 3).then(|| straight_line(&points, t))
    };
    let near = (line(at.saturating_sub(9)..=at.saturating_sub(2)), line(at + 5..=at + 12));
    if let (Some(before), Some(after)) = near {
        return (after.1 - before.1).norm();
    }
    let far = (near.0.or_else(|| line(at.saturating_sub(FAR)..=at.saturating_sub(2))), near.1.or_else(|| line(at + 5..=at + FAR)));
    let together = |(before, after): &(Line, Line)| (after.0 - before.0).norm() < TOGETHER_M;
    far.0.zip(far.1).filter(together).map_or(0.0, |(before, after)| (after.1 - before.1).norm())
}

/// The frame of a gap in which the flights before and after it come together at the face and turn the ball most.
fn hidden_impact(frames: &BTreeMap<u64, FrameView>, period_s: f64, at_face: impl Fn(&Point3<f64>) -> bool) -> Option<u64> {
    let seen: Vec<(u64, f64, Point3<f64>)> = frames.iter().filter_map(|(k, f)| Some((*k, f.t, f.ball?.position))).collect();
    let mut best: Option<(f64, u64)> = None;
    for (after, pair) in seen.windows(2).enumerate().map(|(i, pair)| (i + 1, pair)) {
        let (start, end) = (pair[0].0, pair[1].0);
        if end - start < 2 || (end - start) as f64 * period_s > LONGEST_HIDDEN_S {
            continue;
        }
        let near = |places: &[(u64, f64, Point3<f64>)], end: u64| -> Vec<(f64, Point3<f64>)> {
            places.iter().filter(|(k, ..)| k.abs_diff(end) < FAR).map(|(_, t, p)| (*t, *p)).collect()
        };
        let (before, after) = (near(&seen[..after], start), near(&seen[after..], end));
        if before.len() < 3 || after.len() < 3 {
            continue;
        }
        let meeting = |k: u64| {
            let racket = frames.get(&k)?;
            let (a, b) = (straight_line(&before, racket.t), straight_line(&after, racket.t));
            let apart = (b.0 - a.0).norm();
            (apart < TOGETHER_M && at_face(&racket.pose?.inverse_transform_point(&nalgebra::center(&a.0, &b.0)))).then(|| (apart, (b.1 - a.1).norm(), k))
        };
        let together = (start + 1..end).filter_map(meeting).min_by(|a, b| a.0.total_cmp(&b.0));
        if let Some((_, jump, k)) = together.filter(|(_, jump, _)| *jump > LEAST_JUMP_M_S && best.is_none_or(|best| *jump > best.0)) {
            best = Some((jump, k));
        }
    }
    best.map(|(_, k)| k)
}

/// Where the straight approach of the distance to the face reaches zero, when no frame shows the ball near the face.
fn approach_end(local: &[(u64, Point3<f64>)], period_s: f64) -> Option<u64> {
    local.windows(2).find_map(|w| {
        let ((k0, p0), (k1, p1)) = (w[0], w[1]);
        let dt = (k1 - k0) as f64 * period_s;
        let toward = (p1.z.abs() - p0.z.abs()) / dt;
        // A gap of at most 10 ms in which the ball came from one side and left again.
        (k1 - k0 > 1 && dt < 0.015 && toward.abs() < 40.0 && p0.z.abs() < 0.15 && p1.z.abs() < 0.25).then_some((k0 + k1) / 2)
    })
}

#[derive(Clone, Copy)]
enum When {
    Before,
    After,
}

impl When {
    fn word(self) -> &'static str {
        match self {
            When::Before => "before",
            When::After => "after",
        }
    }

    /// Muscles change a force by its own size in some 30 ms; the soft hand after the blow lets go in 10 ms.
    fn memory_s(self) -> f64 {
        match self {
            When::Before => 0.030,
            When::After => 0.010,
        }
    }
}

impl Bench<'_> {
    fn measure(&self, frames: BTreeMap<u64, FrameView>, side: f64) -> Result<ShotMotion, KinematicsError> {
        let radius = self.ball.radius_m();
        let guard = 0.5 * self.settings.exposure_s;
        let half = 0.5 * self.settings.frame_period_s;
        // Before: start well clear of the face, then take every frame up to the contact.
        let mut end = self.last_clear(&frames, side);
        let mut contact = end + half;
        let (mut fits, mut settled) = (None, false);
        for round in 0..ROUNDS {
            let from = contact - self.settings.window_s;
            // The windows settle with one law; the last round weighs them all.
            let laws: &[MotionLaw] = if settled && !self.settings.first_look { &MotionLaw::EVERYWHERE } else { &[MotionLaw::Hold(Pace::Brisk)] };
            let ball_in = self.flight(&frames, When::Before, from, end, contact)?;
            let racket_in = self.motion(&frames, When::Before, from, end, contact, laws)?;
            let dt = crossing(&PointMotion::from(&ball_in), &body_at(&self.moving, &racket_in, contact), &self.moving.com_local, side, radius)
                .ok_or(KinematicsError::NoCrossing { when: "before" })?;
            fits = Some((ball_in, racket_in, contact + dt));
            if settled {
                break;
            }
            contact += dt;
            settled = round == ROUNDS - 2 || self.same_frames(end, contact - guard) && dt.abs() < 2e-4;
            end = contact - guard;
        }
        let (ball_in, racket_in, contact) = fits.ok_or(KinematicsError::NoCrossing { when: "before" })?;
        let mut shot = ShotMotion {
            clock: self.clock,
            side,
            moving: self.moving.clone(),
            frames,
            first_contact_t: contact,
            ball_in,
            racket_in,
            last_contact_t: None,
            ball_out: None,
            racket_out: None,
            remarks: Vec::new(),
        };
        if let Err(e) = self.measure_after(&mut shot) {
            self.measure_each_after(&mut shot, &e);
        }
        Ok(shot)
    }

    fn measure_after(&self, shot: &mut ShotMotion) -> Result<(), KinematicsError> {
        let radius = self.ball.radius_m();
        // A frame stays out until the ball has surely left: its shape still swings and the crossing has its own error.
        let guard = 0.5 * self.settings.exposure_s + 0.0002;
        let mut start = shot.first_contact_t + SURELY_FREE_S;
        let mut contact = shot.first_contact_t + 0.005;
        let mut settled = false;
        let all = if self.settings.first_look { MotionLaw::TOLD_FREE.to_vec() } else { MotionLaw::after_contact() };
        for round in 0..ROUNDS {
            let laws: &[MotionLaw] = if settled { &all } else { &[MotionLaw::Hold(Pace::Brisk)] };
            let to = contact + self.settings.window_s;
            let ball_out = self.flight(&shot.frames, When::After, start, to, contact)?;
            let racket_out = self.motion(&shot.frames, When::After, start, to, contact, laws)?;
            let dt = crossing(&PointMotion::from(&ball_out), &body_at(&self.moving, &racket_out, contact), &self.moving.com_local, shot.side, radius)
                .ok_or(KinematicsError::NoCrossing { when: "after" })?;
            let next = (contact + dt).clamp(shot.first_contact_t + 0.001, shot.first_contact_t + SURELY_FREE_S);
            if settled {
                shot.last_contact_t = Some(next);
                (shot.ball_out, shot.racket_out) = (Some(ball_out), Some(racket_out));
                break;
            }
            settled = round == ROUNDS - 2 || self.same_frames(start, next + guard) && (next - contact).abs() < 2e-4;
            contact = next;
            start = contact + guard;
        }
        Ok(())
    }

    /// When the last contact cannot be found, because one of the two is not seen after it: what can be measured of either, for
    /// a contact of usual length.
    fn measure_each_after(&self, shot: &mut ShotMotion, why: &KinematicsError) {
        let (start, contact) = (shot.first_contact_t + SURELY_FREE_S, shot.first_contact_t + USUAL_CONTACT_S);
        let to = contact + self.settings.window_s;
        shot.ball_out = self.flight(&shot.frames, When::After, start, to, contact).ok();
        shot.racket_out = self.motion(&shot.frames, When::After, start, to, contact, &MotionLaw::after_contact()).ok();
        let given = match (&shot.ball_out, &shot.racket_out) {
            (None, None) => return shot.remarks.push(format!("nothing after contact: {why}")),
            (Some(_), None) => "the ball's",
            (None, Some(_)) => "the racket's",
            (Some(_), Some(_)) => "both",
        };
        shot.remarks
            .push(format!("the last contact was not found ({why}); motions after it ({given}) are those {:.0} ms after first contact", 1e3 * USUAL_CONTACT_S));
    }

    /// Time of the last frame in which the ball is surely clear of the face, before the impact frame.
    fn last_clear(&self, frames: &BTreeMap<u64, FrameView>, side: f64) -> f64 {
        let clear = self.ball.radius_m() + 0.01;
        frames
            .iter()
            .rev()
            .filter(|(k, _)| **k <= self.clock.origin)
            .find(|(_, f)| {
                let z = f.pose.zip(f.ball).map(|(p, b)| side * p.inverse_transform_point(&b.position).z);
                z.is_some_and(|z| z > clear)
            })
            .map_or(-2.0 * self.settings.frame_period_s, |(_, f)| f.t)
    }

    fn same_frames(&self, a: f64, b: f64) -> bool {
        (a / self.clock.period_s).floor() == (b / self.clock.period_s).floor()
    }

    /// The ball over the longest window in which its laws hold, from the contact outward.
    fn flight(&self, frames: &BTreeMap<u64, FrameView>, when: When, from: f64, to: f64, reference_t: f64) -> Result<FlightEstimate, KinematicsError> {
        let mut estimate = self.flight_within(frames, when, from, to, reference_t)?;
        while estimate.bending_p.is_some_and(|p| p < BENDS_P) && estimate.frames > FEWEST_UNBENT {
            let length = SHORTENED * estimate.length_s;
            let (from, to) = match when {
                When::Before => (reference_t - length, to),
                When::After => (from, reference_t + length),
            };
            match self.flight_within(frames, when, from, to, reference_t) {
                Ok(shorter) if shorter.frames >= FEWEST_UNBENT && shorter.length_s < estimate.length_s => {
                    estimate = FlightEstimate { shortened: true, ..shorter }
                }
                _ => break,
            }
        }
        Ok(estimate)
    }

    fn flight_within(&self, frames: &BTreeMap<u64, FrameView>, when: When, from: f64, to: f64, reference_t: f64) -> Result<FlightEstimate, KinematicsError> {
        let mut seen = sightings(self.tracks, self.clock, &[Target::Ball], from, to);
        let known: Vec<(f64, Point3<f64>)> = frames.values().filter(|f| (from..=to).contains(&f.t)).filter_map(|f| Some((f.t, f.ball?.position))).collect();
        // A frame that one camera alone shows still counts in the fit, once the others have fixed where the ball is.
        if known.len() < FEWEST_STEREO || frames_in(&seen) < FEWEST_FRAMES {
            return Err(KinematicsError::TooFewFrames { body: "ball", when: when.word(), seen: known.len(), need: FEWEST_FRAMES });
        }
        let (position, velocity) = straight_line(&known, reference_t);
        let start = FlightState::new(position, velocity);
        let total = seen.len();
        let failed = |source| KinematicsError::Fit { body: "ball", when: when.word(), source: FitError::from(source) };
        let fit = |seen: &[Sighting], scale: f64| -> Result<Vec<FlightResult>, KinematicsError> {
            let view = self.flight_view(seen, reference_t, scale);
            FlightLaw::ALL.iter().map(|law| fit_flight(&view, *law, &start).map_err(failed)).collect()
        };
        for _ in 0..5 {
            let results = fit(&seen, 1.0)?;
            let Some(richest) = results.last() else { break };
            let deviations = flight_deviations(&self.flight_view(&seen, reference_t, 1.0), richest);
            if !drop_outliers(&mut seen, &deviations) {
                break;
            }
        }
        let asked = |parameters: usize| {
            let n = 2 * seen.len();
            move |view: &FlightView<'_>, r: &FlightResult| noise_scale(r.chi2, n, parameters) * flight_persistence(view, r)
        };
        let plain = self.flight_view(&seen, reference_t, 1.0);
        let scale = fit(&seen, 1.0)?.last().map_or(1.0, |r| asked(8)(&plain, r));
        let results = fit(&seen, scale)?;
        let view = self.flight_view(&seen, reference_t, scale);
        let mut estimate = average_flight(&view, results, self.settings.air_odds).ok_or(KinematicsError::NoPoints)?;
        (estimate.noise_scale, estimate.frames, estimate.rejected) = (scale, frames_in(&seen), total - seen.len());
        (estimate.length_s, estimate.bending_p) = (reach(&seen, reference_t), bending_p(&plain, &start, asked(11)));
        Ok(estimate)
    }

    fn flight_view<'b>(&'b self, sightings: &'b [Sighting], reference_t: f64, noise_scale: f64) -> FlightView<'b> {
        FlightView { rig: self.rig, ball: self.ball, sightings, reference_t, gravity: self.moving.gravity, common: self.settings.ball_error, noise_scale }
    }

    fn motion(
        &self,
        frames: &BTreeMap<u64, FrameView>,
        when: When,
        from: f64,
        to: f64,
        reference_t: f64,
        laws: &[MotionLaw],
    ) -> Result<MotionEstimate, KinematicsError> {
        let mut seen = sightings(self.tracks, self.clock, &Target::MARKERS, from, to);
        let poses: Vec<(f64, Isometry3<f64>)> = frames.values().filter(|f| (from..=to).contains(&f.t)).filter_map(|f| Some((f.t, f.pose?))).collect();
        if poses.len() < FEWEST_FRAMES {
            return Err(KinematicsError::TooFewFrames { body: "racket", when: when.word(), seen: poses.len(), need: FEWEST_FRAMES });
        }
        let start = self.starting_motion(&poses, reference_t);
        let rate = start.rate_body.norm();
        let total = seen.len();
        let failed = |source| KinematicsError::Fit { body: "racket", when: when.word(), source: FitError::from(source) };
        let mut richest = most_flexible(&self.motion_view(&seen, when, rate, reference_t, 1.0), &start).map_err(failed)?;
        for _ in 0..5 {
            let deviations = sighting_deviations(&self.motion_view(&seen, when, rate, reference_t, 1.0), &richest);
            if !drop_outliers(&mut seen, &deviations) {
                break;
            }
            richest = most_flexible(&self.motion_view(&seen, when, rate, reference_t, 1.0), &richest.state).map_err(failed)?;
        }
        let scale = noise_scale(richest.chi2, 2 * seen.len(), 24) * motion_persistence(&self.motion_view(&seen, when, rate, reference_t, 1.0), &richest);
        let view = self.motion_view(&seen, when, rate, reference_t, scale);
        let results: Vec<_> = laws.iter().filter_map(|law| fit_law(&view, *law, &richest.state).ok()).collect();
        let mut estimate = average(&self.moving, results, reference_t).ok_or(KinematicsError::NoPoints)?;
        (estimate.noise_scale, estimate.frames, estimate.rejected) = (scale, frames_in(&seen), total - seen.len());
        estimate.length_s = reach(&seen, reference_t);
        Ok(estimate)
    }

    fn motion_view<'b>(&'b self, sightings: &'b [Sighting], when: When, rate_rad_s: f64, reference_t: f64, noise_scale: f64) -> MotionView<'b> {
        MotionView {
            rig: self.rig,
            racket: &self.moving,
            sightings,
            reference_t,
            common: self.settings.tape_error(rate_rad_s),
            memory_s: when.memory_s(),
            noise_scale,
        }
    }

    /// Pose nearest to the reference time, carried there at the median rate of the per-frame poses.
    fn starting_motion(&self, poses: &[(f64, Isometry3<f64>)], reference_t: f64) -> MotionState {
        let com = |p: &Isometry3<f64>| p * self.moving.com_local;
        let places: Vec<(f64, Point3<f64>)> = poses.iter().map(|(t, p)| (*t, com(p))).collect();
        let (_, velocity) = straight_line(&places, reference_t);
        let span = poses.len() / 2;
        let mut rates: Vec<Vector3<f64>> = Vec::new();
        for i in 0..poses.len() - span {
            let ((t0, a), (t1, b)) = (&poses[i], &poses[i + span]);
            if t1 > t0 {
                rates.push((a.rotation.inverse() * b.rotation).scaled_axis() / (t1 - t0));
            }
        }
        let median = |k: usize| {
            let mut v: Vec<f64> = rates.iter().map(|r| r[k]).collect();
            v.sort_by(f64::total_cmp);
            v.get(v.len() / 2).copied().unwrap_or(0.0)
        };
        let rate = Vector3::new(median(0), median(1), median(2));
        let nearest = poses.iter().min_by(|a, b| (a.0 - reference_t).abs().total_cmp(&(b.0 - reference_t).abs()));
        let (t, pose) = nearest.copied().unwrap_or((reference_t, Isometry3::identity()));
        let dt = reference_t - t;
        let mut state = MotionState::at_rest(&pose, &self.moving.com_local);
        state.com += velocity * dt;
        state.global_from_racket *= nalgebra::UnitQuaternion::from_scaled_axis(rate * dt);
        (state.velocity, state.rate_body) = (velocity, rate);
        state
    }
}

/// The flexible law that follows the points more closely.
fn most_flexible(view: &MotionView<'_>, start: &MotionState) -> Result<LawResult, SolveError> {
    let [a, b] = MotionLaw::FLEXIBLE.map(|law| fit_law(view, law, start));
    match (a, b) {
        (Ok(a), Ok(b)) => Ok(if b.chi2 < a.chi2 { b } else { a }),
        (Ok(one), Err(_)) | (Err(_), Ok(one)) => Ok(one),
        (Err(e), Err(_)) => Err(e),
    }
}

/// Line through points by least absolute deviation in its slope (Theil-Sen), evaluated at `t`: position and velocity.
fn straight_line(points: &[(f64, Point3<f64>)], t: f64) -> Line {
    let span = (points.len() / 2).max(1);
    let mut out = (Point3::origin(), Vector3::zeros());
    for k in 0..3 {
        let mut slopes: Vec<f64> =
            (0..points.len() - span).map(|i| (points[i + span].1[k] - points[i].1[k]) / (points[i + span].0 - points[i].0)).filter(|s| s.is_finite()).collect();
        slopes.sort_by(f64::total_cmp);
        let slope = slopes.get(slopes.len() / 2).copied().unwrap_or(0.0);
        let mut offsets: Vec<f64> = points.iter().map(|(at, p)| p[k] + slope * (t - at)).collect();
        offsets.sort_by(f64::total_cmp);
        out.0[k] = offsets.get(offsets.len() / 2).copied().unwrap_or(0.0);
        out.1[k] = slope;
    }
    out
}

/// Drops points whose deviation stands out from the others (scaled by their median); `false` when none does.
fn drop_outliers(seen: &mut Vec<Sighting>, deviations: &[f64]) -> bool {
    let mut sorted = deviations.to_vec();
    sorted.sort_by(f64::total_cmp);
    // The median length of a two-dimensional Gaussian deviation is √(2 ln 2) = 1.177.
    let scale = (sorted.get(sorted.len() / 2).copied().unwrap_or(0.0) / 1.177).max(0.3);
    let keep: Vec<bool> = deviations.iter().map(|d| *d <= OUTLIER * scale).collect();
    let before = seen.len();
    let mut i = 0;
    seen.retain(|_| {
        i += 1;
        keep[i - 1]
    });
    seen.len() < before
}

/// Factor on the stated deviations that makes χ² per degree of freedom one, drawn toward 1 by ten degrees of freedom.
fn noise_scale(chi2: f64, residuals: usize, parameters: usize) -> f64 {
    const OWN_WORD: f64 = 10.0;
    let freedom = residuals.saturating_sub(parameters) as f64;
    ((chi2 + OWN_WORD) / (freedom + OWN_WORD)).sqrt().max(0.05)
}

/// Longest time between a sighting and the reference time, s.
fn reach(seen: &[Sighting], reference_t: f64) -> f64 {
    seen.iter().map(|s| (s.t - reference_t).abs()).fold(0.0, f64::max)
}

fn frames_in(seen: &[Sighting]) -> usize {
    let mut frames: Vec<u64> = seen.iter().map(|s| s.frame).collect();
    frames.sort_unstable();
    frames.dedup();
    frames.len()
}
