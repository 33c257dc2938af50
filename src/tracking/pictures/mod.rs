//! What is known of the pictures beside racket and ball: what stands still, and the faults of a recording.

pub(in crate::tracking) mod agreement;
pub(in crate::tracking) mod background;
pub(in crate::tracking) mod camera_shake;
pub(in crate::tracking) mod gamma_encoded;
pub(in crate::tracking) mod in_step;
pub(in crate::tracking) mod lost_picture;
pub(in crate::tracking) mod recording;
pub(in crate::tracking) mod shot_frames;
pub(in crate::tracking) mod stood_still;
