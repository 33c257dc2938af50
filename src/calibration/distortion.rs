//! Which distortion terms are estimated, and the names and places of the parameters both cameras share over all boards.

use serde::{Deserialize, Serialize};

/// Parameters shared by all boards: 9 of the left camera, 9 of the right, 3 of the rotation and 3 of the shift between.
pub const SHARED: usize = 24;
/// Place of the rotation `right_from_left` (three angles about the right camera's axes, rad).
pub const ROTATION: usize = 18;
/// Place of the shift `right_from_left`, m.
pub const SHIFT: usize = 21;

/// Names of one camera's nine parameters, in order.
pub const CAMERA_NAMES: [&str; 9] = ["fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3"];

/// Names of all shared parameters, in order: `left.fx` ... `right.k3`, `rotation_x` ... `t_z`.
pub fn shared_names() -> Vec<String> {
    let mut names = Vec::with_capacity(SHARED);
    for camera in ["left", "right"] {
        names.extend(CAMERA_NAMES.iter().map(|n| format!("{camera}.{n}")));
    }
    for kind in ["rotation", "t"] {
        names.extend(["x", "y", "z"].iter().map(|a| format!("{kind}_{a}")));
    }
    names
}

/// A set of distortion terms, from none to five. Each is nested in the next.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub enum DistortionModel {
    #[serde(rename = "none")]
    None,
    #[serde(rename = "k1")]
    K1,
    #[serde(rename = "k1 k2")]
    K1K2,
    #[serde(rename = "k1 k2 p1 p2")]
    K1K2P1P2,
    #[serde(rename = "k1 k2 p1 p2 k3")]
    K1K2P1P2K3,
}

impl DistortionModel {
    pub const ALL: [DistortionModel; 5] = [Self::None, Self::K1, Self::K1K2, Self::K1K2P1P2, Self::K1K2P1P2K3];

    /// Which of the shared parameters are free.
    pub fn active(self) -> [bool; SHARED] {
        let mut on = [true; SHARED];
        for camera in 0..2 {
            for (i, term) in on[9 * camera + 4..9 * camera + 9].iter_mut().enumerate() {
                *term = match i {
                    0 => self >= Self::K1,
                    1 => self >= Self::K1K2,
                    2 | 3 => self >= Self::K1K2P1P2,
                    _ => self >= Self::K1K2P1P2K3,
                };
            }
        }
        on
    }

    pub fn free_parameters(self) -> usize {
        self.active().iter().filter(|on| **on).count()
    }
}
