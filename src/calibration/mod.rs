//! `calibration`: from pairs of checkerboard pictures to a stereo rig with its uncertainty.
//!
//! Comes in: images of one board from both cameras, the board's size, the three-sphere frame. Goes out: [`StereoRig`].
//! Camera frames are OpenCV's (x right, y down, z forward); metres and pixels. Sources: thesis chapter 3, Zhang (2000),
//! Triggs et al. (2000).

mod axes;
mod board;
mod board_report;
mod board_shape;
mod bundle;
mod calibrator;
mod camera_model;
#[cfg(feature = "vision")]
mod corner_grid;
#[cfg(feature = "vision")]
mod corners_opencv;
mod distortion;
mod error;
mod homography;
mod methods;
mod model_choice;
mod point_spread;
mod rays;
mod rig;
mod rig_file;
#[cfg(feature = "vision")]
mod saddle;
#[cfg(feature = "vision")]
mod saddle_points;
mod sphere;
mod stereo_start;
mod verdict;
mod view;
mod volume;
mod zhang;

pub use axes::{AxesFrame, AxesReport, global_axes};
pub use board::Checkerboard;
pub use board_report::{BOARDS_KEY, BoardReport};
pub use board_shape::BoardShape;
pub use bundle::{Bundle, BundleError, BundleFit, BundleOptions, BundleView, CornerPixel, ViewResiduals};
pub use calibrator::{Calibration, CalibrationOptions, PairViews, calibrate_views};
pub use camera_model::Camera;
#[cfg(feature = "vision")]
pub use corners_opencv::{PairImages, calibrate_images, find_corners};
pub(crate) use distortion::CAMERA_NAMES;
pub use distortion::DistortionModel;
pub use error::CalibrationError;
pub use homography::homography;
pub use methods::{MethodError, dltdv_csv};
pub use point_spread::CalibrationSpread;
pub use rays::{CalibrationError3d, nearest_approach};
pub use rig::{CameraId, PairFate, RigidTransform, SquareSize, StereoRig};
pub use verdict::Verdict;
pub use view::{BoardView, ViewFault};
pub use volume::{Coverage, Slice, SlicePoint, Volume};
