//! Tracks in other programs' formats. A format = one file here (`dltdv`, `c3d`) that turns a [`TrackExport`] into files.

use crate::calibration::{CameraId, StereoRig};
use crate::tracking::track_file::{SpacePoint, Target, Tracks};
use nalgebra::Point3;
use std::ops::RangeInclusive;

/// What a shot offers to other programs.
pub struct TrackExport<'a> {
    pub tracks: &'a Tracks,
    pub points: &'a [SpacePoint],
    pub rig: &'a StereoRig,
    pub frame_rate_hz: f64,
    /// First and last frame of the clip; frames without points keep their place in time.
    pub frames: RangeInclusive<u64>,
}

/// Why a shot cannot be written in a format.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ExportError {
    #[error("frames {first} to {last}; {format} holds up to {most} frames: split the clip, or look for a wild number in a file name")]
    TooLong { format: &'static str, first: u64, last: u64, most: u64 },
    #[error("frame {last}; {format} numbers frames up to {most}: look for a wild number in a file name, or number the pictures anew")]
    TooHigh { format: &'static str, last: u64, most: u64 },
}

impl TrackExport<'_> {
    /// Number of frames from the first to the last, or why the format cannot hold them.
    pub(in crate::tracking) fn length(&self, format: &'static str, most: u64) -> Result<u64, ExportError> {
        let (first, last) = (*self.frames.start(), *self.frames.end());
        match last.checked_sub(first).and_then(|n| n.checked_add(1)) {
            Some(n) if n <= most => Ok(n),
            _ => Err(ExportError::TooLong { format, first, last, most }),
        }
    }

    /// A target's space point in a frame.
    pub(in crate::tracking) fn point(&self, frame: u64, target: Target) -> Option<&SpacePoint> {
        // Sorted by frame; a handful of targets each.
        let from = self.points.partition_point(|p| p.frame < frame);
        self.points[from..].iter().take_while(|p| p.frame == frame).find(|p| p.target == target)
    }

    /// Mean size of a metre in both pictures at a place, px.
    pub(in crate::tracking) fn px_per_m(&self, at: &Point3<f64>) -> f64 {
        let scale = |c: CameraId| self.rig.camera(c).fx / (self.rig.camera_from_global(c) * at).z.abs().max(1e-6);
        0.5 * (scale(CameraId::Left) + scale(CameraId::Right))
    }
}
