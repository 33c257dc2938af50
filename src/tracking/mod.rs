//! `tracking`: from frames to image points of five tape markers and the ball, in both cameras, without a click.
//!
//! Comes in: frames, a stereo rig, the racket's marker figure. Goes out: [`Tracks`] with an uncertainty per point.

mod background;
mod ball_disc;
mod ball_fit;
mod ball_learn;
mod ball_light;
mod ball_model;
mod ball_refine;
mod ball_ring;
mod ball_search;
mod ball_shading;
mod ball_surroundings;
mod ball_texture;
mod ball_track;
mod band;
mod band_search;
mod band_sums;
mod c3d;
mod dltdv;
mod export;
mod face;
mod in_step;
mod octet;
mod overlay;
mod racket_figure;
mod racket_pose;
mod racket_search;
mod racket_track;
mod recording;
mod shot_ball;
mod shot_frames;
mod shot_racket;
mod shot_spin;
mod shot_tracker;
mod space_points;
pub mod spin;
mod stray_ball;
mod tape_light;
mod throat;
mod track_file;
mod tube_width;

pub use ball_refine::refine_ball;
pub use ball_track::BallFrame;
pub use c3d::c3d_bytes;
pub use dltdv::dltdv_tables;
pub use export::{ExportError, TrackExport};
pub use in_step::{InStep, Offset, SyncMode, offset, track_in_step};
pub use overlay::Overlay;
pub use racket_figure::{RacketFigure, VISIBLE_DEPTH};
pub use racket_pose::{MarkerObservation, PoseError, RacketPose, View, fit_pose, fit_pose_in, rigid_from_points};
pub use racket_track::RacketFrame;
pub use shot_spin::FoundSpins;
pub use shot_tracker::{ShotSetup, ShotTracks, TrackingError, track_shot};
pub use space_points::{BALL_ERRORS_ALIKE, contact_frames};
pub use track_file::{ImagePoint, PointState, SpacePoint, Target, TrackFileError, TrackPoint, Tracks, points_to_csv, read_points};
