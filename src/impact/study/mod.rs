//! What-if studies of the model: `sweetspot explore`.

pub mod face_map;
pub mod published;
pub mod shot;
pub mod weighting;
