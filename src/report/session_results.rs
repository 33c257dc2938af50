//! Everything a session's report shows, as plain values.

use crate::calibration::{CameraId, StereoRig};
use crate::equipment::Racket;
use crate::impact_table::ImpactRow;
use crate::kinematics::ShotRecord;
use crate::tracking::{SpacePoint, Tracks};
use crate::validation::{Comparison, Diagnosis, LedgerEntry};

/// A piece of a frame; the report draws the tracks over it.
#[derive(Debug, Clone, PartialEq)]
pub struct FramePicture {
    pub frame: u64,
    pub camera: CameraId,
    pub png: Vec<u8>,
    /// Column and row of the piece's first pixel, and its width and height, px.
    pub corner: [u32; 2],
    pub size: [u32; 2],
    /// What there is to see, such as why the frame is in doubt.
    pub words: String,
    /// How doubtful: pictures are shown from the greatest down; 0 is the impact, shown for reference.
    pub doubt: f64,
}

/// One shot; what an earlier step did not give is `None` or empty.
#[derive(Debug, Clone)]
pub struct ShotResults {
    pub id: String,
    pub racket: Racket,
    pub record: Option<ShotRecord>,
    pub tracks: Option<Tracks>,
    pub points: Vec<SpacePoint>,
    pub pictures: Vec<FramePicture>,
    /// Faults of the recording and what else tracking said of the shot.
    pub recording: Vec<String>,
}

/// A measured shot and what the model says of it (rows of `predictions.csv` and `predictions_sd.csv`).
#[derive(Debug, Clone)]
pub struct PredictedShot {
    pub measured: ImpactRow,
    pub predicted: ImpactRow,
    /// What the inputs' deviations carry into the prediction.
    pub predicted_sd: Option<ImpactRow>,
}

/// A session with everything that was made of it.
#[derive(Debug, Clone, Default)]
pub struct SessionResults {
    pub name: String,
    pub frame_rate_hz: f64,
    pub rig: Option<StereoRig>,
    /// True when the global axes come from the three-sphere frame; false: they are the left camera's.
    pub axes_known: bool,
    pub shots: Vec<ShotResults>,
    /// Shots that failed, by id, with the reason.
    pub failed: Vec<(String, String)>,
    /// Steps of the session as a whole that failed, and files of its results that cannot be read, with the reason.
    pub steps_failed: Vec<(String, String)>,
    /// Shots with their prediction, for a session with too few of them for a comparison.
    pub predicted: Vec<PredictedShot>,
    /// File of the model that these predictions are of.
    pub model: Option<String>,
    pub comparison: Option<Comparison>,
    /// The same with the model's free parameters at their best, of which the diagnosis and its pictures speak.
    pub at_its_best: Option<Comparison>,
    pub diagnosis: Option<Diagnosis>,
    /// The comparison of the model with the recommended effects added.
    pub after: Option<Comparison>,
    /// Versions of the model, first to present.
    pub ledger: Vec<LedgerEntry>,
}
