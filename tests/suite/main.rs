//! One binary for all tests that run the library from outside or the program as a whole; one module per room.
//! Prefixes: truth_ (closed form), law_ (property), ladder_ (refinement), switch_ (effect on/off), agrees_ (independent
//! path), fails_ (that error), golden_ (unchanged), real_ (data nobody here made), cli_ (whole program), issue_.

#![allow(clippy::unwrap_used)]

mod calibration;
mod calibration_coverage;
#[cfg(feature = "vision")]
mod calibration_pictures;
mod cli;
#[cfg(feature = "vision")]
mod cli_footage;
#[cfg(feature = "vision")]
mod hidden_effect;
mod impact;
mod impact_expression;
mod impact_scene;
mod impact_studies;
mod impact_viscoelastic;
mod kinematics;
mod kinematics_photograph;
mod kinematics_world;
mod layout;
mod report;
mod report_gallery;
mod report_mock;
mod report_session;
mod shared;
mod spin;
mod spin_ball;
mod synthetic;
mod tracking;
mod tracking_ball;
mod tracking_errors;
mod tracking_export;
mod tracking_faults;
mod tracking_identity;
mod validation;
mod validation_groups;
