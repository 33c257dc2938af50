//! The racket: the markers' rigid figure, its pose from the bands of both pictures, and how it is found, followed, lost and found again.

pub(in crate::tracking) mod band_near;
pub(in crate::tracking) mod face;
pub(in crate::tracking) mod foretold_pose;
pub(in crate::tracking) mod known_bands;
pub(in crate::tracking) mod lost_racket;
pub(in crate::tracking) mod marker_deviations;
pub(in crate::tracking) mod racket_figure;
pub(in crate::tracking) mod racket_follower;
pub(in crate::tracking) mod racket_foretold;
pub(in crate::tracking) mod racket_motion;
pub(in crate::tracking) mod racket_near;
pub(in crate::tracking) mod racket_one_view;
pub(in crate::tracking) mod racket_other_view;
pub(in crate::tracking) mod racket_pose;
pub(in crate::tracking) mod racket_scene;
pub(in crate::tracking) mod racket_search;
pub(in crate::tracking) mod racket_track;
pub(in crate::tracking) mod rigid_points;
pub(in crate::tracking) mod shot_racket;
pub(in crate::tracking) mod stray_racket;
