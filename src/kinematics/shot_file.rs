//! `shots/<id>/shot.json`: a shot's characteristics with what made them.

use super::shot::Shot;
use crate::limited_file::{LARGEST_TEXT, read_text};
use crate::provenance::Provenance;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Name of the file in a shot's results folder.
pub const SHOT_FILE: &str = "shot.json";

#[derive(Debug, thiserror::Error)]
pub enum ShotFileError {
    #[error("{path}: cannot be read ({source}); run `sweetspot shots` first", path = .path.display())]
    Unreadable { path: PathBuf, source: std::io::Error },
    #[error("{path}: not a shot file ({source}); run `sweetspot shots --force` to write it again", path = .path.display())]
    Format { path: PathBuf, source: serde_json::Error },
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ShotRecord {
    #[serde(flatten)]
    pub shot: Shot,
    /// Why tracking found that its points should not be believed.
    #[serde(default)]
    pub doubt: Option<String>,
    /// The note of its `shot.toml`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub note: Option<String>,
    /// SHA-256 of the `points.csv` written with it: tracking writes a table of that name too.
    #[serde(default)]
    pub points: String,
    pub provenance: Provenance,
}

impl ShotRecord {
    pub fn read(path: &Path) -> Result<Self, ShotFileError> {
        let text = read_text(path, LARGEST_TEXT).map_err(|source| ShotFileError::Unreadable { path: path.into(), source })?;
        serde_json::from_str(&text).map_err(|source| ShotFileError::Format { path: path.into(), source })
    }

    /// The file's text.
    pub fn to_json(&self) -> String {
        // Plain numbers and strings: serialising cannot fail.
        serde_json::to_string_pretty(self).unwrap_or_default() + "\n"
    }
}
