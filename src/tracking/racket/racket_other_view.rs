//! A racket that one camera follows alone, in the other camera's picture: anywhere along the first one's line of sight, for that camera hardly tells how
//! far away it is, and after some frames its place in the other picture is off by more than bands are looked for.

use crate::calibration::CameraId;
use crate::footage::GreyView;
use crate::tracking::racket::band_near::least_of;
use crate::tracking::racket::racket_scene::{RacketFrame, RacketScene};
use crate::tracking::racket::racket_track::measure;
use crate::tracking::tape::band::BandView;
use nalgebra::{Isometry3, Translation3};

/// How far along the line of sight it is looked for, m, and in steps of which the other picture shows so many px.
const REACH_M: f64 = 0.25;
const STEP_PX: f64 = 3.0;
/// Bands are looked for so far around their places, px.
const AROUND_PX: i32 = 2;
/// Fewest bands that either picture must show.
const FEWEST: usize = 3;
/// Places at which bands stand out that are looked at more closely.
const LOOKED_AT: usize = 3;

/// The racket in both pictures, of a frame in which one camera alone has shown it.
pub fn in_other_view(scene: &RacketScene, images: &[Option<GreyView>; 2], alone: &RacketFrame, least_contrast: &[f64; 2]) -> Option<RacketFrame> {
    let seen = |frame: &RacketFrame, camera: CameraId| frame.points[camera.index()].iter().flatten().count();
    let [own, other] = if seen(alone, CameraId::Left) > 0 { CameraId::BOTH } else { [CameraId::Right, CameraId::Left] };
    if seen(alone, own) < FEWEST {
        return None;
    }
    let (image, view) = (images[other.index()].as_ref()?, scene.view);
    let pose = alone.pose.global_from_racket;
    let sight = (pose * scene.figure.points[0] - view.eye(own)).normalize();
    let shifted = |by: f64| Isometry3::from_parts(Translation3::from(pose.translation.vector + sight * by), pose.rotation);
    let place = |by: f64| view.project(other, &(shifted(by) * scene.figure.points[0]));
    let steps = (0.5 * (place(REACH_M)? - place(-REACH_M)?).norm() / STEP_PX).ceil().clamp(1.0, 100.0);
    let stands_out = |pose: &Isometry3<f64>| -> (usize, f64) {
        let bands = (0..5).filter_map(|marker| {
            let band = BandView::at(view, scene.figure, pose, other, marker)?;
            let contrast = band.search(image, scene.shape, AROUND_PX)?.2;
            (contrast >= least_of(scene, &band, least_contrast[other.index()])).then_some(contrast)
        });
        bands.fold((0, 0.0), |(n, sum), contrast| (n + 1, sum + contrast))
    };
    let along = (0..=2 * steps as usize).map(|k| shifted((k as f64 / steps - 1.0) * REACH_M));
    let mut places: Vec<((usize, f64), Isometry3<f64>)> = along.map(|pose| (stands_out(&pose), pose)).filter(|((bands, _), _)| *bands >= FEWEST).collect();
    places.sort_by(|a, b| b.0.0.cmp(&a.0.0).then(b.0.1.total_cmp(&a.0.1)));
    let measured = places.iter().take(LOOKED_AT).filter_map(|(_, pose)| measure(scene, images, pose, AROUND_PX, least_contrast));
    measured.filter(|frame| seen(frame, other) >= FEWEST && seen(frame, own) + 1 >= seen(alone, own)).max_by_key(RacketFrame::count)
}
