//! `calibration`: from pairs of checkerboard pictures to a stereo rig with its uncertainty.
//!
//! Comes in: images of one board from both cameras, the board's size, the three-sphere frame. Goes out: [`StereoRig`].
//! Camera frames are OpenCV's (x right, y down, z forward); metres and pixels. Sources: thesis chapter 3, Zhang (2000).

mod camera_model;
mod rig;

pub use camera_model::Camera;
pub use rig::{CameraId, PairFate, RigidTransform, SquareSize, StereoRig};
