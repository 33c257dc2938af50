//! `kinematics`: from image points of markers and ball to the characteristics of a shot, each with its uncertainty.
//!
//! Comes in: a stereo rig, tracks, racket, ball, the ball's spin where it was measured. Goes out: [`Shot`] (the motions on
//! both sides of the contact and every quantity of contract section 5) and the row of the impacts table. Global axes and
//! racket-local axes of contract section 1; SI. Definitions with equation numbers: docs/kinematics.md. Sources: thesis
//! chapters 4 and 5; docs/impact.md, closed forms.

mod air_seen;
mod balance_seen;
mod ball_flight;
mod calibration_share;
mod characteristics;
mod contact;
mod face_pose;
mod flights_meet;
mod frame_rate;
mod frame_view;
mod grid_photograph;
mod impact_frame;
mod least_squares;
mod marker_distance;
mod motion_law;
mod motion_state;
mod racket_bench;
mod racket_motion;
mod racket_outline;
mod season;
mod shot;
mod shot_file;
mod shot_motion;
mod shot_state;
mod sighting;
mod space_points;
mod straight_line;
mod sweet_spot;
mod tape_photograph;
mod tape_session;
mod thesis_path;

pub use air_seen::AirSeen;
pub use balance_seen::BalanceSeen;
pub use ball_flight::{FlightEstimate, FlightLaw};
pub use characteristics::point_name;
pub use contact::{BodyMotion, PointMotion};
pub use frame_rate::{FrameRateStudy, SlowerCamera, TipPath, frame_rate_study};
pub use frame_view::FrameView;
pub use grid_photograph::{GridError, GridPhotograph};
pub use marker_distance::{MarkerDistance, marker_distances, mismatch_remark};
pub use motion_law::{Fade, MotionLaw, Pace, Reach};
pub use motion_state::MotionState;
pub use racket_bench::{
    BenchError, Bifilar, Pendulum, Uncertain, balance_from_scales, from_rdc_kg_cm2, perpendicular_axis_mismatch, swingweight_from_pendulum,
    twistweight_from_bifilar,
};
pub use racket_motion::{MotionEstimate, MovingRacket};
pub use racket_outline::past_racket;
pub use season::{GroupStatistic, RiseInterval, rise_table, season_statistics, season_to_csv, shots_by_group};
pub use shot::{
    ImpactTiming, MeasuredShot, MomentumVerdict, Quantities, Shot, ShotInput, ShotSpin, SpinComponent, SwingTiming, WindowReport, Windows, measure_shot,
};
pub use shot_file::{SHOT_FILE, ShotFileError, ShotRecord};
pub use shot_motion::{FEWEST_FRAMES, GRAVITY_M_S2, MeasureSettings, ShotMotion, measure_motion};
pub use shot_state::SpinVector;
pub use sighting::{CommonError, FrameClock, UsedSightings};
pub use space_points::space_points;
pub use sweet_spot::effective_mass;
pub use tape_photograph::{TapeError, TapePlace, markers_of, tape_places};
pub use tape_session::{TapeErrors, evenly};
pub use thesis_path::ThesisShot;

/// Why a shot's characteristics cannot be given.
#[derive(Debug, thiserror::Error)]
pub enum KinematicsError {
    #[error("racket {racket:?} has no [markers]; give the five marker positions in racket.toml (`sweetspot racket` measures them from a photograph)")]
    NoMarkers { racket: String },
    #[error("the tracks hold no points; run `sweetspot track` again or look at the footage")]
    NoPoints,
    #[error("only {seen} frames show the ball in both cameras and the racket's pose; at least {need} are needed")]
    NoCommonFrames { seen: usize, need: usize },
    #[error(
        "`impact_frame` in shot.toml is {frame}; allowed: {first} to {last}, the frames that were tracked; correct it, or take it out and the impact is looked for"
    )]
    ImpactFrameOutside { frame: u64, first: u64, last: u64 },
    #[error("no impact: the ball's centre comes no nearer to the strings than {nearest_m:.3} m; if there is one, give `impact_frame` in shot.toml")]
    NoImpact { nearest_m: f64 },
    #[error(
        "no impact: the ball passes the head by {:.0} mm ({x_m:.3} m along and {y_m:.3} m across from the stringbed's centre); \
         if there is one, give `impact_frame` in shot.toml",
        1e3 * past_m
    )]
    PassesBy { past_m: f64, x_m: f64, y_m: f64 },
    #[error(
        "no impact: where the ball meets the string plane ({x_m:.3} m along and {y_m:.3} m across from the stringbed's centre) it flies on, its velocity \
         changes by {change_m_s:.2} m/s (sd {sd_m_s:.2}) of {speed_m_s:.1}; look at the tracks around it, or give `impact_frame` in shot.toml"
    )]
    FliesOn { x_m: f64, y_m: f64, change_m_s: f64, sd_m_s: f64, speed_m_s: f64 },
    #[error(
        "the ball touches the string plane {x_m:.3} m along and {y_m:.3} m across from the stringbed's centre, {:.0} mm beyond the racket: the pictures of \
         the two cameras may not belong together, racket.toml ([head], [markers]) may be another's, or this is no impact; look at the tracks around it, \
         or give `impact_frame` in shot.toml",
        1e3 * past_m
    )]
    OffTheFace { x_m: f64, y_m: f64, past_m: f64 },
    #[error(
        "something else than the strings turned the ball within milliseconds of them (court, net or frame), or the cameras are out of step: its ways before \
         and after the contact pass each other by {:.0} mm (sd {:.0}), and its velocity and spin at the contact are not those of the flights that were seen; \
         look at the overlay, leave the shot out",
        1e3 * apart_m,
        1e3 * sd_m
    )]
    TurnedElsewhere { apart_m: f64, sd_m: f64 },
    #[error(
        "the court turned the ball {:.1} ms before the strings, and {seen} frames show it between; at least {need} are needed for its velocity at the contact",
        1e3 * before_s
    )]
    HalfVolley { before_s: f64, seen: usize, need: usize },
    #[error("{seen} frames show the {body} {when} contact; at least {need} are needed")]
    TooFewFrames { body: &'static str, when: &'static str, seen: usize, need: usize },
    #[error(
        "the paths of ball and string plane {when} contact do not cross near the impact frame; check the tracks around it, or give `impact_frame` in shot.toml"
    )]
    NoCrossing { when: &'static str },
    #[error("the motion of the {body} {when} contact cannot be fitted: {source}")]
    Fit { body: &'static str, when: &'static str, source: FitError },
}

/// Why a fit ended without a result.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error(transparent)]
pub struct FitError(#[from] least_squares::SolveError);
