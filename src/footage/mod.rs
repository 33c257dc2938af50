//! `footage`: pictures and numbered folders of pictures, as 8-bit grey.
//!
//! Comes in: paths. Goes out: [`GreyImage`] and the sorted list of a folder's pictures. Everything read here is untrusted:
//! sizes are checked before memory is taken, and a file that ends early is an error, never a half-grey picture.

mod image_file;

pub use image_file::{FootageError, GreyImage, numbered_images, read_grey};
