//! Several rackets and balls, picked by the names in an impacts table.

use crate::equipment::{Ball, EquipmentError, Racket, read_all};
use crate::impact_table::ImpactRow;
use std::path::PathBuf;

/// Why a row's racket or ball is not known.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PickError {
    #[error("no {kind} file has the name {name:?}; given: {given}; add its file with --{kind}")]
    NoSuchName { kind: &'static str, name: String, given: String },
    #[error("its `{kind}` column is empty and several {kind} files are given ({given}); name one")]
    Ambiguous { kind: &'static str, given: String },
}

/// The rackets and balls given to a command.
#[derive(Debug, Clone)]
pub struct EquipmentSet {
    pub rackets: Vec<Racket>,
    pub balls: Vec<Ball>,
}

impl EquipmentSet {
    /// Reads and checks all files.
    ///
    /// # Errors
    /// See [`read_all`].
    pub fn read(rackets: &[PathBuf], balls: &[PathBuf]) -> Result<Self, EquipmentError> {
        Ok(EquipmentSet { rackets: read_all(rackets, Racket::read)?, balls: read_all(balls, Ball::read)? })
    }

    /// Places of a row's racket and ball in the two lists.
    ///
    /// With one file of a kind a row need not name it, but a name that contradicts it is refused.
    ///
    /// # Errors
    /// A name no file has; no name although several files are given.
    pub fn pick(&self, row: &ImpactRow) -> Result<(usize, usize), PickError> {
        let rackets: Vec<&str> = self.rackets.iter().map(|r| r.name.as_str()).collect();
        let balls: Vec<&str> = self.balls.iter().map(|b| b.name.as_str()).collect();
        Ok((pick("racket", row.racket.as_deref(), &rackets)?, pick("ball", row.ball.as_deref(), &balls)?))
    }
}

/// The place of a name among those given; of the only one where none is named.
pub(crate) fn pick(kind: &'static str, wanted: Option<&str>, names: &[&str]) -> Result<usize, PickError> {
    let given = || names.join(", ");
    match wanted {
        Some(name) => names.iter().position(|n| *n == name).ok_or_else(|| PickError::NoSuchName { kind, name: name.to_owned(), given: given() }),
        None if names.len() == 1 => Ok(0),
        None => Err(PickError::Ambiguous { kind, given: given() }),
    }
}
