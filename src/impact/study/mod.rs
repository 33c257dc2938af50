//! What-if studies of the model: `sweetspot explore`.

pub mod campaign;
pub mod face_map;
pub mod older_models;
pub mod published;
mod rig;
pub mod shot;
pub mod weighting;
