//! `tracking`: from frames to image points of five tape markers and the ball, in both cameras, without a click.
//!
//! Comes in: frames, a stereo rig, the racket's marker figure. Goes out: [`Tracks`] with an uncertainty per point.

mod racket_figure;
mod racket_pose;
pub mod spin;
mod track_file;

pub use racket_figure::RacketFigure;
pub use racket_pose::{MarkerObservation, PoseError, RacketPose, View, fit_pose, fit_pose_in, rigid_from_points};
pub use track_file::{ImagePoint, PointState, SpacePoint, Target, TrackFileError, TrackPoint, Tracks, points_to_csv};
