//! `sweetspot`: from high-speed stereo footage of ball impacts to the physics a model is missing.
//!
//! # The rooms, along the data's way
//!
//! ```text
//!  footage ─> calibration ─> tracking ─> reconstruction ─> kinematics ─┐
//!  frames      StereoRig      Tracks      points, poses     shot.json  │  impacts.csv
//!                                                                      ▼
//!  model file ─────────────> impact ──────────────────────────> validation ─> report ─> cli
//!                            ImpactOutput                        compare, diagnose, fit
//! ```
//!
//! Arrows point one way: a room uses only rooms to its left. [`impact`] knows nothing of footage; the model and the
//! measurement meet first in [`validation`]. [`synthetic`] renders worlds with known truth and shares no physics with
//! [`impact`]. The files everybody reads stand at the top level: [`session`], [`equipment`], [`impact_table`].
//!
//! SI units and radians everywhere; a name that is not SI says so (`_px`, `_mm`, `_deg`, `_lb`).

pub mod calibration;
pub mod cli;
pub mod equipment;
pub mod equipment_set;
pub mod footage;
pub mod impact;
pub mod impact_table;
pub mod kinematics;
pub mod limited_file;
mod median;
mod near_names;
pub mod provenance;
pub mod quantity;
pub mod reconstruction;
pub mod report;
pub mod session;
mod short_list;
pub mod synthetic;
pub mod tracking;
pub mod validation;
