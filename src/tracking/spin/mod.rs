//! Spin of the ball from its drawn lines or logo, at 15 to 20 px diameter.
//!
//! Comes in: [`BallView`]s of the free flight before first contact and after last contact (both cameras, grey pixels,
//! centre, position), the rig, the ball's radius. Goes out: [`BallSpin`], one [`SpinEstimate`] before and one after:
//! the spin vector in global axes with its covariance, or the one component that can be measured, or a refusal with
//! its reason. Method and measured comparison: docs/spin.md.

mod contest;
mod covered_views;
mod estimate;
mod map_equations;
mod pixels;
mod registration;
mod search;
mod shading;
mod sphere_map;
mod spin_file;
mod view;

pub use estimate::{BLUR_PX, BallSpin, FoundSpin, SpinEstimate, SpinQuality, SpinRefusal, SpinSettings, estimate_spin};
pub use spin_file::{SPIN_FILE, SpinFileError, read_spin, spin_to_json};
pub use view::BallView;
