//! Tracks for other programs and for the eye.

pub(in crate::tracking) mod c3d;
pub(in crate::tracking) mod dltdv;
pub(in crate::tracking) mod export;
pub(in crate::tracking) mod overlay;
