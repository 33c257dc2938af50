//! `reconstruction`: from pixels of both cameras to points in space.
//!
//! Comes in: a [`StereoRig`](crate::calibration::StereoRig) and image points with their deviations. Goes out: points in
//! global axes (m) with covariance. Source: Hartley and Zisserman (2003), chapter 12; the estimate is the maximum
//! likelihood one for Gaussian pixel noise.

mod triangulate;

pub use triangulate::{Triangulated, TriangulationError, Triangulator, triangulate};
