//! `footage`: pictures and numbered folders of pictures, as 8-bit grey.
//!
//! Comes in: paths. Goes out: [`GreyImage`], a [`Clip`] of paired frames and [`GreyView`]s of them. Everything read here is
//! untrusted: sizes are checked before memory is taken, and a file that ends early is an error, never a half-grey picture.

mod bitmap;
mod clip;
mod cut_off;
mod decoded_pictures;
mod frame_source;
mod grey_patch;
mod grey_view;
mod image_file;
mod open_files;
mod rows;

pub use clip::{Clip, FramePair};
pub use cut_off::{WHITE, is_cut_off};
pub use frame_source::{FrameBuffer, FrameSource};
pub use grey_patch::GreyPatch;
pub use grey_view::GreyView;
#[cfg(feature = "vision")]
pub(crate) use image_file::last_digits;
pub use image_file::{FootageError, GreyImage, LARGEST_FRAME_NUMBER, MAX_PIXELS, numbered_images, read_grey};
pub use open_files::let_files_stay_open;
pub use rows::Rows;
