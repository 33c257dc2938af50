//! What a shot is tracked with, what tracking knows of it in the end, and why it may know nothing.

use crate::calibration::{CameraId, StereoRig};
use crate::equipment::{Ball, Racket};
use crate::footage::{FootageError, GreyImage};
use crate::tracking::ball::ball_track::BallFrame;
use crate::tracking::racket::racket_figure::RacketFigure;
use crate::tracking::racket::racket_scene::RacketFrame;
use crate::tracking::track_file::{SpacePoint, Tracks};
use std::path::PathBuf;

/// Why a shot cannot be tracked.
#[derive(Debug, thiserror::Error)]
pub enum TrackingError {
    #[error("no frames in left/ and right/; put the recording there, numbered file names, both cameras")]
    NoFrames,
    #[error("{pictures}; without them: {without}")]
    Unreadable { pictures: String, without: String },
    #[error("{pictures}; a shot needs pictures of both cameras: copy the folder again, or leave the shot out")]
    NoCamera { pictures: String },
    #[error(
        "racket {racket:?} has no [markers]; add m1 to m5 to its file (middle of each tape band, m, from the stringbed centre; `sweetspot racket` measures them from a photograph)"
    )]
    NoMarkers { racket: String },
    #[error(
        "no racket found in {searched} frame pairs; most tape-like places in one picture: left {left}, right {right}; check that five white bands between black ones are on the frame, that racket.toml matches and that the calibration belongs to this recording"
    )]
    NoRacket { searched: usize, left: usize, right: usize },
    #[error(
        "no racket found: what looks most like it is another thing ({found}); check that five white bands between black ones are on the frame and well lit, that racket.toml matches and that the calibration belongs to this recording"
    )]
    NotARacket { found: String },
    #[error(
        "frame {frame} of the {} camera: the picture is {width}x{height} px, the calibration is for {calibrated_width}x{calibrated_height} px; calibrate with pictures of the same size",
        .camera.name()
    )]
    Size { frame: u64, camera: CameraId, width: usize, height: usize, calibrated_width: usize, calibrated_height: usize },
    #[error("the cameras' viewing directions do not meet in front of them; check calibration.json")]
    NoVolume,
    #[error("{found}; run `sweetspot track --sync auto` to pair them anew")]
    OutOfStep { found: String },
    #[error(
        "the two cameras contradict each other ({found}): left/, right/ and calibration.json do not belong together, or a camera was moved; were the pictures turned or cut? Otherwise run `sweetspot calibrate` on boards of this session"
    )]
    Contradiction { found: String },
    #[error(
        "left/ and right/ are exchanged: {found}; exchange the two folders (or, if those of the boards are the ones exchanged, these, and run `sweetspot calibrate --force`)"
    )]
    Exchanged { found: String },
    #[error("{path}: is no folder, and the shot's results belong into one of this name; move it away", path = .path.display())]
    NoPlace { path: PathBuf },
    #[error("{path}: is no file, and one of the shot's results belongs there; move it away", path = .path.display())]
    NoFile { path: PathBuf },
    #[error("{path}: cannot be read ({source}), and may hold points corrected by hand; make it readable, or move it away", path = .path.display())]
    Earlier { path: PathBuf, source: std::io::Error },
    #[error("interrupted")]
    Cancelled,
    #[error(transparent)]
    Footage(#[from] FootageError),
}

/// Everything tracking knows about a shot.
#[derive(Debug, Clone)]
pub struct ShotTracks {
    /// The racket's figure, with the tubes' direction in the throat as seen.
    pub figure: RacketFigure,
    pub tracks: Tracks,
    /// By frame index of the clip.
    pub racket: Vec<Option<RacketFrame>>,
    pub ball: Vec<Option<BallFrame>>,
    pub points: Vec<SpacePoint>,
    /// First contact, in frames (fractional frame number): ball's centre one radius from the string plane.
    pub contact_frame: Option<f64>,
    /// Things the user should know, in order.
    pub notes: Vec<String>,
    /// Pictures that are there and cannot be read, with the reason; they count as missing.
    pub unreadable: Vec<String>,
    /// What either camera sees when nothing moves.
    pub(super) still: [Option<GreyImage>; 2],
    /// Blur of either camera's pictures as the tape shows it, px.
    pub(super) blur_px: [f64; 2],
    /// Whether the racket was told clearly from everything else where it was found first.
    pub(super) clear_racket: bool,
}

/// What a shot is tracked with.
pub struct ShotSetup<'a> {
    pub rig: &'a StereoRig,
    pub racket: &'a Racket,
    pub ball: &'a Ball,
    pub frame_rate_hz: f64,
}
