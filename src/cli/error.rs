//! Every way a command can end badly, as the exit status of the contract: 1 some shots failed, 2 bad usage or input.

use crate::calibration::CalibrationError;
use crate::equipment::EquipmentError;
use crate::footage::FootageError;
use crate::impact::ModelError;
use crate::impact_table::TableError;
use crate::kinematics::{BenchError, GridError, KinematicsError, TapeError};
use crate::session::SessionError;
use crate::tracking::TrackFileError;
use crate::tracking::spin::SpinFileError;
use crate::validation::ValidationError;
use std::path::Path;

/// What kind of failure it was; the kind decides the exit status.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// Some shots failed, the others are complete: exit 1.
    SomeFailed,
    /// Bad usage, or input that cannot be read: exit 2.
    Input,
    /// A result could not be written (full disk, no permission): exit 2.
    Output,
    /// Ctrl-C; what was finished is kept: exit 2.
    Interrupted,
}

/// A message that names what, where, the value seen and the value allowed, plus hints on what to try.
#[derive(Debug)]
pub struct CliError {
    pub kind: Kind,
    pub message: String,
    pub hints: Vec<String>,
    /// Of shots that failed: id and reason.
    pub shots: Vec<(String, String)>,
}

impl CliError {
    fn of(kind: Kind, message: impl std::fmt::Display) -> Self {
        CliError { kind, message: message.to_string(), hints: Vec::new(), shots: Vec::new() }
    }

    pub fn input(message: impl std::fmt::Display) -> Self {
        CliError::of(Kind::Input, message)
    }

    pub fn output(message: impl std::fmt::Display) -> Self {
        CliError::of(Kind::Output, message)
            .hint("check the free space and the permissions, or choose another place (-o or --output for what is named by it, else --out)")
    }

    pub fn some_failed(message: impl std::fmt::Display) -> Self {
        CliError::of(Kind::SomeFailed, message)
    }

    pub fn interrupted() -> Self {
        CliError::of(Kind::Interrupted, "interrupted; what was finished is kept, run the same command again to go on")
    }

    /// Of a session in which there is nothing to track or to measure.
    pub fn no_shots(session: &Path) -> Self {
        CliError::input(format!("{}: the session has no shots; put each in shots/<id>/left and right", session.display()))
    }

    /// Of a command that has nothing to keep.
    pub fn interrupted_at_once() -> Self {
        CliError::of(Kind::Interrupted, "interrupted")
    }

    #[must_use]
    pub fn of_shots(self, shots: Vec<(String, String)>) -> Self {
        CliError { shots, ..self }
    }

    #[must_use]
    pub fn hint(mut self, hint: impl Into<String>) -> Self {
        self.hints.push(hint.into());
        self
    }

    pub fn exit_code(&self) -> u8 {
        match self.kind {
            Kind::SomeFailed => 1,
            Kind::Input | Kind::Output | Kind::Interrupted => 2,
        }
    }
}

/// Of each that failed its id and the reason, with `between` standing between them.
pub fn with_reasons(failed: &[(String, String)], between: &str) -> String {
    failed.iter().map(|(id, why)| format!("{id}: {why}")).collect::<Vec<_>>().join(between)
}

/// A file that a command needs, named when it is not there.
pub fn existing<'a>(path: &'a Path, what: &str) -> Result<&'a Path, CliError> {
    if path.exists() {
        Ok(path)
    } else {
        Err(CliError::input(format!("{}: no such {what}", path.display())).hint("check the path; relative paths start at the current folder"))
    }
}

macro_rules! input_errors {
    ($($error:ty),* $(,)?) => {
        $(impl From<$error> for CliError {
            fn from(e: $error) -> Self {
                CliError::input(e)
            }
        })*
    };
}

// One line per room's error type.
input_errors!(SessionError, EquipmentError, TableError, TrackFileError, FootageError, ModelError, KinematicsError, BenchError, SpinFileError, CalibrationError);
input_errors!(ValidationError, GridError, TapeError);
