//! `track.json`: what became of a shot's pictures, and from what it was made.

use super::{Flattening, InStep, PointState, PressedFrame, RacketFigure, ShotSetup, Throat, contact_frames};
use crate::limited_file::{LARGEST_TEXT, read_text};
use crate::provenance::Provenance;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Its name among a shot's results.
pub const TRACK_FILE: &str = "track.json";

/// What `--json` prints for one shot, and what `track.json` keeps.
#[derive(Debug, Default, Serialize, Deserialize)]
pub struct ShotSummary {
    pub id: String,
    pub frames: usize,
    pub measured: usize,
    pub occluded: usize,
    pub contact_frame: Option<f64>,
    /// Frames in which the ball is nearer to the string plane than one radius.
    #[serde(default)]
    pub contact_frames: Vec<u64>,
    /// Frames in which the ball was measured as pressed by the strings, and how much they flatten it.
    #[serde(default)]
    pub flattening: Vec<PressedFrame>,
    /// Frame n pairs the left picture n with the right picture n + this.
    #[serde(default)]
    pub right_shift: i64,
    /// Whether the cameras were found out of step and left so.
    #[serde(default)]
    pub out_of_step: bool,
    /// Why the points should not be believed.
    #[serde(default)]
    pub doubt: Option<String>,
    /// As the pictures show it; `null` when they did not.
    #[serde(default)]
    pub throat: Option<Throat>,
    #[serde(default)]
    pub notes: Vec<String>,
    /// Pictures that cannot be read; they count as missing.
    #[serde(default)]
    pub unreadable: Vec<String>,
    pub error: Option<String>,
}

/// `track.json`: what became of a shot, and from what; a later run keeps tracks only when nothing of it has changed.
#[derive(Debug, Serialize, Deserialize)]
pub struct TrackRecord {
    pub summary: ShotSummary,
    pub provenance: Provenance,
}

impl ShotSummary {
    /// Of a shot just tracked; `gaps` says which pictures are missing.
    pub fn of(id: &str, setup: &ShotSetup, made: &InStep, gaps: Vec<String>) -> Self {
        let tracked = &made.tracked;
        let measured = tracked.tracks.points.iter().filter(|p| p.state == PointState::Measured).count();
        let as_written = RacketFigure::of(setup.racket).and_then(|f| f.throat());
        ShotSummary {
            id: id.to_owned(),
            frames: tracked.tracks.frames().len(),
            measured,
            occluded: tracked.tracks.points.len() - measured,
            contact_frame: tracked.contact_frame,
            contact_frames: contact_frames(&made.clip, setup, tracked),
            flattening: PressedFrame::of(&made.clip, &tracked.ball),
            right_shift: made.right_shift,
            out_of_step: made.out_of_step,
            doubt: made.doubt.clone(),
            throat: tracked.figure.throat().filter(|t| as_written != Some(*t)),
            notes: gaps.into_iter().chain(tracked.notes.iter().cloned()).collect(),
            unreadable: tracked.unreadable.clone(),
            error: None,
        }
    }
}

impl TrackRecord {
    /// What an earlier run wrote down in a shot's folder of results, if it did.
    pub fn read(folder: &Path) -> Option<Self> {
        serde_json::from_str(&read_text(&folder.join(TRACK_FILE), LARGEST_TEXT).ok()?).ok()
    }

    /// What tracking saw of the throat, where that can be.
    pub fn throat(&self) -> Option<Throat> {
        self.summary.throat.filter(Throat::is_possible)
    }

    /// The largest flattening of the ball that tracking saw.
    pub fn flattening(&self) -> Option<Flattening> {
        let all = self.summary.flattening.iter().map(|f| f.flattening).filter(Flattening::is_possible);
        all.max_by(|a, b| a.share.total_cmp(&b.share))
    }
}
