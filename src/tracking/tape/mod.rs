//! The bands of tape: what a band around a tube looks like, where it is in a picture, and what all bands share (light, focus, the throat).

pub(in crate::tracking) mod band;
pub(in crate::tracking) mod band_beside;
pub(in crate::tracking) mod band_search;
pub(in crate::tracking) mod band_sums;
pub(in crate::tracking) mod band_trial;
pub(in crate::tracking) mod tape_blur;
pub(in crate::tracking) mod tape_length;
pub(in crate::tracking) mod tape_light;
pub(in crate::tracking) mod throat;
pub(in crate::tracking) mod throat_bend;
pub(in crate::tracking) mod tube_width;
pub(in crate::tracking) mod visible_patches;
