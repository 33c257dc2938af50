//! From tracks to the motions of ball and racket on both sides of the contact, and the contact itself.
//!
//! The windows never reach across the contact: which frames belong to which side follows from the fits' own first and
//! last contact, until it no longer changes.

use super::balance_seen::BalanceSeen;
use super::ball_flight::{
    FlightEstimate, FlightLaw, FlightResult, FlightState, FlightView, average_flight, bending_p, fit_flight, flight_deviations, flight_persistence,
};
use super::contact::{PointMotion, body_at, crossing};
use super::frame_view::{FEWEST_STEREO, FrameView, frame_views};
use super::impact_frame::find_impact;
use super::least_squares::SolveError;
use super::motion_law::{AfterContact, Blow, MUSCLES_S, MotionLaw, Pace};
use super::motion_state::MotionState;
use super::racket_motion::{LawResult, MotionEstimate, MotionView, MovingRacket, average, fit_law, motion_persistence, sighting_deviations};
use super::sighting::{CommonError, FrameClock, Sighting, UsedSightings, frames_in, sightings};
use super::straight_line::straight_line;
use super::tape_session::TapeErrors;
use super::{FitError, KinematicsError};
use crate::calibration::{CameraId, StereoRig};
use crate::equipment::{Ball, Racket};
use crate::median::upper_median;
use crate::tracking::{HALF_COURT_CONTACT_S, RacketFigure, Target, Tracks, View, camera_shake, frames_of_contact, shake_words, turned_late};
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

/// Error of the ball that goes evenly over a stretch, in deviations of the stretch's mean and slope: its outline alone tells these, and
/// has 2.4 to 3.5 times the variance that is stated where its cover is known. (Slopes of 450 stretches of six frames with
/// known truth err by 1.4 to 2.8 times the variance that stated deviations would give, 2.2 on average.)
const BALL_UNTOLD: f64 = 1.25;

/// How the measurement is made. The defaults suit 500 to 2000 frames per second.
#[derive(Debug, Clone, PartialEq)]
pub struct MeasureSettings {
    pub frame_period_s: f64,
    pub exposure_s: f64,
    /// Longest window on either side of the contact, s. The thesis takes 0.010 s because it fits lines; laws of motion
    /// with an arc and angular acceleration hold longer. Where the ball's path bends more than its laws allow, its window
    /// is shortened.
    pub window_s: f64,
    /// Global V points up ([`StereoRig::axes_known`]). Otherwise gravity is taken along the left camera's downward axis.
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
            ball_error: CommonError { constant_px: 0.05, drift_px_s: 3.0, bend_px_s2: 0.0, untold: BALL_UNTOLD },
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
        CommonError { constant_px, drift_px_s: TAPE_CHANGE_PER_RAD * constant_px * turn, bend_px_s2: TAPE_BEND_PX_PER_RAD2 * turn * turn, untold: 0.0 }
    }

    pub fn gravity(&self) -> Vector3<f64> {
        // Without axes the global frame is the left camera's, whose y points down in a camera held upright.
        Vector3::new(0.0, if self.axes_known { -GRAVITY_M_S2 } else { GRAVITY_M_S2 }, 0.0)
    }
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
    /// Deviation of either camera's shake from picture to picture, px; 0 where none shows.
    pub shake_px: [f64; 2],
    /// What was limited, in words, for the person who reads shot.json.
    pub remarks: Vec<String>,
}

/// Fewest frames of a body on one side: below that its velocity is a guess.
pub const FEWEST_FRAMES: usize = 4;
/// Most rounds in which windows and contact settle on each other.
const ROUNDS: usize = 6;
/// They have when the same frames are in them and the contact moves by less than this, s.
const SETTLED_S: f64 = 2e-4;
/// Contact lasts 3 to 7 ms (docs/impact.md, base visco-elastic); frames this long after first contact are surely free again.
pub(crate) const SURELY_FREE_S: f64 = 0.0075;
/// Usual length of a contact, s, for when its end is not seen.
pub(crate) const USUAL_CONTACT_S: f64 = 0.005;
/// Deviations (in scaled standard deviations over both axes) beyond which a point is an outlier. Among 500 good points
/// one is beyond 4.2 in every ten shots (Rayleigh).
const OUTLIER: f64 = 4.2;
/// Most rounds in which outliers are dropped.
const OUTLIER_ROUNDS: usize = 5;
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
    /// Deviation of either camera's shake, px.
    shake_px: [f64; 2],
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
    let (impact_frame, side) = find_impact(&frames, racket, ball, clock, settings.impact_frame, (first, last))?;
    // Count time from the impact: no cancellation in powers of t.
    let shift = clock.time_s(impact_frame);
    clock.origin = impact_frame;
    let frames = frames.into_iter().map(|(k, f)| (k, FrameView { t: f.t - shift, ..f })).collect();
    let shake_px = camera_shake(tracks, &frames_of_contact(Some(impact_frame as f64), 1.0 / settings.frame_period_s));
    let bench = Bench { rig, tracks, ball, moving, settings, clock, shake_px };
    bench.measure(frames, side)
}

#[derive(Clone, Copy)]
enum When {
    Before,
    After {
        /// Probability that a slow hand carried the racket before.
        slow_hand: f64,
        /// Velocity of its centre of mass and its angular velocity before, global axes.
        before: (Vector3<f64>, Vector3<f64>),
    },
}

impl When {
    fn word(self) -> &'static str {
        match self {
            When::Before => "before",
            When::After { .. } => "after",
        }
    }

    /// The direction of time away from the contact.
    fn outward(self) -> f64 {
        match self {
            When::Before => -1.0,
            When::After { .. } => 1.0,
        }
    }

    /// What the laws after the contact are told, once it is known how the racket moves there.
    fn after(self, moves: Option<&MotionState>) -> Option<AfterContact> {
        let When::After { slow_hand, before: (velocity, rate) } = self else { return None };
        let blow = moves.map(|state| {
            let to_body = state.global_from_racket.inverse();
            Blow { velocity: to_body * (state.velocity - velocity), rate: state.rate_body - to_body * rate }
        });
        Some(AfterContact { slow_hand, blow: blow.unwrap_or_default() })
    }

    /// The soft hand after the blow lets go in 10 ms.
    fn memory_s(self) -> f64 {
        match self {
            When::Before => MUSCLES_S,
            When::After { .. } => 0.010,
        }
    }
}

/// One side of the contact, before its window and the contact have settled on each other.
struct Window {
    when: When,
    /// Where the window ends toward the contact.
    edge: f64,
    contact: f64,
    /// How far the window keeps from the contact.
    guard: f64,
    /// The contact lies nowhere else.
    within: (f64, f64),
    /// When the court turned the ball, shortly before the contact.
    turned: Option<f64>,
    /// The laws of the racket that are weighed.
    laws: Vec<MotionLaw>,
}

struct Settled {
    ball: FlightEstimate,
    racket: MotionEstimate,
    contact: f64,
}

impl Bench<'_> {
    fn measure(&self, frames: BTreeMap<u64, FrameView>, side: f64) -> Result<ShotMotion, KinematicsError> {
        // Before: start well clear of the face, then take every frame up to the contact.
        // Where the ball is hidden long before, the racket is still seen.
        let edge = self.last_clear(&frames, side).max(-USUAL_CONTACT_S);
        let contact = edge + 0.5 * self.settings.frame_period_s;
        let turned = self.turned_late(&frames, contact);
        let before = Window {
            when: When::Before,
            edge,
            contact,
            guard: 0.5 * self.settings.exposure_s,
            within: (f64::NEG_INFINITY, f64::INFINITY),
            turned,
            laws: if self.settings.first_look { vec![MotionLaw::Hold(Pace::Brisk)] } else { MotionLaw::before_contact() },
        };
        let settled = self.settle(&frames, side, before)?;
        let contact = settled.contact;
        let mut shot = ShotMotion {
            clock: self.clock,
            side,
            moving: self.moving.clone(),
            frames,
            first_contact_t: contact,
            ball_in: settled.ball,
            racket_in: settled.racket,
            last_contact_t: None,
            ball_out: None,
            racket_out: None,
            shake_px: self.shake_px,
            remarks: shake_words(self.shake_px).into_iter().collect(),
        };
        if let Some(t) = turned {
            shot.ball_in.shortened = true;
            let (before_ms, frames) = (1e3 * (contact - t), shot.ball_in.used.frames);
            shot.remarks
                .push(format!("a half-volley: the court turned the ball {before_ms:.1} ms before the strings; its velocity there is told by {frames} frames"));
        }
        let after = Window {
            when: When::After { slow_hand: self.slow_hand(&shot), before: shot.racket_in.velocities() },
            edge: contact + SURELY_FREE_S,
            contact: contact + USUAL_CONTACT_S,
            // A frame stays out until the ball has surely left: its shape still swings and the crossing has its own error.
            guard: 0.5 * self.settings.exposure_s + 0.0002,
            within: (contact + 0.001, contact + SURELY_FREE_S),
            turned: None,
            laws: if self.settings.first_look { MotionLaw::TOLD_FREE.to_vec() } else { MotionLaw::after_contact() },
        };
        match self.settle(&shot.frames, side, after) {
            Ok(settled) => {
                shot.last_contact_t = Some(settled.contact);
                (shot.ball_out, shot.racket_out) = (Some(settled.ball), Some(settled.racket));
            }
            Err(e) => self.measure_each_after(&mut shot, &e),
        }
        Ok(shot)
    }

    /// Window and contact settle on each other with one law of the racket; the last round weighs all.
    fn settle(&self, frames: &BTreeMap<u64, FrameView>, side: f64, window: Window) -> Result<Settled, KinematicsError> {
        let Window { when, mut edge, mut contact, guard, within: (earliest, latest), turned, laws } = window;
        let outward = when.outward();
        let mut settled = false;
        let mut round = 0;
        loop {
            let far = contact + outward * self.settings.window_s;
            let (from, to) = if outward < 0.0 { (far, edge) } else { (edge, far) };
            let ball_from = turned.map_or(from, |t| from.max(t + HALF_COURT_CONTACT_S));
            let ball = self.flight(frames, when, ball_from, to, contact).map_err(|why| half_volley(why, turned.map(|t| contact - t)))?;
            let racket = self.motion(frames, when, from, to, contact, if settled { &laws } else { &[MotionLaw::Hold(Pace::Brisk)] })?;
            let dt = crossing(&PointMotion::from(&ball), &body_at(&self.moving, &racket, contact), &self.moving.com_local, side, self.ball.radius_m())
                .ok_or(KinematicsError::NoCrossing { when: when.word() })?;
            let next = (contact + dt).clamp(earliest, latest);
            if settled {
                return Ok(Settled { ball, racket, contact: next });
            }
            let next_edge = next + outward * guard;
            round += 1;
            settled = round == ROUNDS - 1 || self.same_frames(edge, next_edge) && (next - contact).abs() < SETTLED_S;
            (contact, edge) = (next, next_edge);
        }
    }

    /// When the last contact cannot be found, because one of the two is not seen after it: what can be measured of either, for
    /// a contact of usual length.
    fn measure_each_after(&self, shot: &mut ShotMotion, why: &KinematicsError) {
        let (start, contact) = (shot.first_contact_t + SURELY_FREE_S, shot.first_contact_t + USUAL_CONTACT_S);
        let after = When::After { slow_hand: self.slow_hand(shot), before: shot.racket_in.velocities() };
        let to = contact + self.settings.window_s;
        shot.ball_out = self.flight(&shot.frames, after, start, to, contact).ok();
        shot.racket_out = self.motion(&shot.frames, after, start, to, contact, &MotionLaw::after_contact()).ok();
        let given = match (&shot.ball_out, &shot.racket_out) {
            (None, None) => return shot.remarks.push(format!("nothing after contact: {why}")),
            (Some(_), None) => "the ball's",
            (None, Some(_)) => "the racket's",
            (Some(_), Some(_)) => "both",
        };
        shot.remarks
            .push(format!("the last contact was not found ({why}); motions after it ({given}) are those {:.0} ms after first contact", 1e3 * USUAL_CONTACT_S));
    }

    /// Probability that a slow hand carried the racket before the contact. The first look weighs no laws there: it does not know.
    fn slow_hand(&self, shot: &ShotMotion) -> f64 {
        if self.settings.first_look {
            return 0.5;
        }
        shot.racket_in.laws.iter().filter(|(law, _)| law.in_slow_hand()).map(|(_, p)| p).sum()
    }

    /// When the court turned the ball, if it did so shortly before the contact.
    fn turned_late(&self, frames: &BTreeMap<u64, FrameView>, contact: f64) -> Option<f64> {
        let seen: Vec<(f64, Point3<f64>)> = frames.values().filter(|f| f.t < contact).filter_map(|f| Some((f.t - contact, f.ball?.position))).collect();
        let view = View::new(self.rig);
        turned_late(&seen, &CameraId::BOTH.map(|camera| *view.eye(camera))).map(|t| contact + t)
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
        while estimate.bending_p.is_some_and(|p| p < BENDS_P) && estimate.used.frames > FEWEST_UNBENT {
            let length = SHORTENED * estimate.used.length_s;
            let (from, to) = match when {
                When::Before => (reference_t - length, to),
                When::After { .. } => (from, reference_t + length),
            };
            match self.flight_within(frames, when, from, to, reference_t) {
                Ok(shorter) if shorter.used.frames >= FEWEST_UNBENT && shorter.used.length_s < estimate.used.length_s => {
                    estimate = FlightEstimate { shortened: true, ..shorter }
                }
                _ => break,
            }
        }
        Ok(estimate)
    }

    fn flight_within(&self, frames: &BTreeMap<u64, FrameView>, when: When, from: f64, to: f64, reference_t: f64) -> Result<FlightEstimate, KinematicsError> {
        let mut seen = sightings(self.tracks, self.clock, &[Target::Ball], from, to);
        for s in &mut seen {
            // The ball is alone in its picture: shake is an error of its own in each.
            s.sd = s.sd.map(|sd| sd.hypot(self.shake_px[s.camera.index()]));
        }
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
        for _ in 0..OUTLIER_ROUNDS {
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
        let used = UsedSightings::of(&seen, total, reference_t, scale);
        average_flight(&view, results, self.settings.air_odds, used, bending_p(&plain, &start, asked(11))).ok_or(KinematicsError::NoPoints)
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
        for _ in 0..OUTLIER_ROUNDS {
            let deviations = sighting_deviations(&self.motion_view(&seen, when, rate, reference_t, 1.0), &richest);
            if !drop_outliers(&mut seen, &deviations) {
                break;
            }
            richest = most_flexible(&self.motion_view(&seen, when, rate, reference_t, 1.0), &richest.state).map_err(failed)?;
        }
        let scale = noise_scale(richest.chi2, 2 * seen.len(), 24) * motion_persistence(&self.motion_view(&seen, when, rate, reference_t, 1.0), &richest);
        let view = MotionView { after: when.after(Some(&richest.state)), ..self.motion_view(&seen, when, rate, reference_t, scale) };
        let results: Vec<_> = laws.iter().filter_map(|law| fit_law(&view, *law, &richest.state).ok()).collect();
        average(&self.moving, results, reference_t, UsedSightings::of(&seen, total, reference_t, scale)).ok_or(KinematicsError::NoPoints)
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
            shake_px: self.shake_px,
            after: when.after(None),
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
        let rate = Vector3::from_fn(|k, _| upper_median(rates.iter().map(|r| r[k])).unwrap_or(0.0));
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

/// Why the ball before the contact was not measured, where the court turned it so many seconds before.
fn half_volley(why: KinematicsError, before_s: Option<f64>) -> KinematicsError {
    match (why, before_s) {
        (KinematicsError::TooFewFrames { seen, need, .. }, Some(before_s)) => KinematicsError::HalfVolley { before_s, seen, need },
        (why, _) => why,
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

/// Drops points whose deviation stands out from the others (scaled by their median); `false` when none does.
fn drop_outliers(seen: &mut Vec<Sighting>, deviations: &[f64]) -> bool {
    // The median length of a two-dimensional Gaussian deviation is √(2 ln 2) = 1.177.
    let scale = (upper_median(deviations.iter().copied()).unwrap_or(0.0) / 1.177).max(0.3);
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
