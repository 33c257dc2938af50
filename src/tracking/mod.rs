//! `tracking`: from frames to image points of five tape markers and the ball, in both cameras, without a click.
//!
//! Comes in: frames, a stereo rig, the racket's marker figure. Goes out: [`Tracks`] with an uncertainty per point.

mod ball;
mod cholesky;
mod exports;
mod lanes;
mod pictures;
mod racket;
mod shot_spin;
mod shot_tracker;
mod shot_tracks;
mod side_by_side;
mod space_points;
pub mod spin;
mod tape;
mod track_file;
mod track_record;

pub use ball::ball_pressed::{Flattening, PressedFrame};
pub use ball::ball_track::BallFrame;
pub use ball::contact_length::frames_of_contact;
pub use ball::half_volley::{HALF_COURT_CONTACT_S, MOST_APART_M, MOST_APART_SDS, turned_late};
pub use exports::c3d::c3d_bytes;
pub use exports::dltdv::dltdv_tables;
pub use exports::export::{ExportError, TrackExport};
pub use exports::overlay::Overlay;
pub use pictures::camera_shake::{camera_shake, shake_words};
pub use pictures::in_step::{InStep, Offset, SyncMode, offset, track_in_step};
pub use racket::racket_figure::{RacketFigure, Throat, VISIBLE_DEPTH};
pub use racket::racket_pose::{MarkerObservation, PoseError, RacketPose, View, fit_pose};
pub use racket::racket_scene::RacketFrame;
pub use shot_spin::measure_spin;
pub use shot_tracker::track_shot;
pub use shot_tracks::{ShotSetup, ShotTracks, TrackingError};
pub use space_points::{BALL_ERRORS_ALIKE, contact_frames, widen_by_shake, with_errors_alike};
pub use track_file::{ImagePoint, PointState, SpacePoint, Target, TrackFileError, TrackPoint, Tracks, points_to_csv, read_points};
pub use track_record::{ShotSummary, TRACK_FILE, TrackRecord};
