//! `tracking`: from frames to image points of five tape markers and the ball, in both cameras, without a click.
//!
//! Comes in: frames, a stereo rig, the racket's marker figure. Goes out: [`Tracks`] with an uncertainty per point.

mod track_file;

pub use track_file::{ImagePoint, PointState, SpacePoint, Target, TrackFileError, TrackPoint, Tracks, points_to_csv};
