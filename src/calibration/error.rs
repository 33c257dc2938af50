//! Every reason why a calibration cannot be given.

use super::bundle::BundleError;
use std::path::PathBuf;

#[derive(Debug, thiserror::Error)]
pub enum CalibrationError {
    #[error("{path}: no picture of camera `{camera}`; put the checkerboard pictures there", path = .path.display())]
    NoPictures { path: PathBuf, camera: &'static str },
    #[error("only {used} of {given} checkerboard pairs can be used; at least {needed} are needed, 20 or more are recommended. {fates}")]
    TooFewPairs { used: usize, given: usize, needed: usize, fates: String },
    #[error(
        "picture {name} is {width}x{height} px, the first one {expected_width}x{expected_height}; both cameras must give pictures of one size (crop the larger ones alike, and the footage with them)"
    )]
    PictureSize { name: String, width: usize, height: usize, expected_width: usize, expected_height: usize },
    #[error("no camera fits the boards of camera `{camera}`: tilt them by 20 to 50 degrees in different directions")]
    NoFirstCamera { camera: &'static str },
    #[error("the pairs do not agree on where the cameras stand: {agreeing} of {pairs} agree; check that the pictures of a pair were taken at the same instant")]
    NoCommonPose { agreeing: usize, pairs: usize },
    #[error(
        "both cameras stand in one place ({baseline_mm:.1} mm apart, sd {sd_mm:.1} mm), so that nothing has a depth; check that left and right hold the pictures of two cameras"
    )]
    NoBaseline { baseline_mm: f64, sd_mm: f64 },
    #[error("the joint adjustment failed: {0}")]
    Adjustment(#[from] BundleError),
    #[error("axes pictures: {what}")]
    Axes { what: String },
    #[error("{path}: cannot be read ({source}); run `sweetspot calibrate` first", path = .path.display())]
    Unreadable { path: PathBuf, source: std::io::Error },
    #[error("{path}: not a calibration ({what})", path = .path.display())]
    Format { path: PathBuf, what: String },
    #[error("{path}: `{key}` is {seen}; allowed: {allowed}", path = .path.display())]
    Value { path: PathBuf, key: String, seen: String, allowed: &'static str },
    #[error("OpenCV could not look for corners: {0}")]
    Detector(String),
}
