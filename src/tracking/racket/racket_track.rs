//! The racket in one frame: windows around where it is expected, band fits, one pose from both cameras, honest occlusion.

use crate::calibration::CameraId;
use crate::footage::GreyView;
use crate::tracking::racket::band_near::find;
use crate::tracking::racket::racket_pose::{MarkerObservation, RacketPose, fit_pose};
use crate::tracking::racket::racket_scene::{RacketFrame, RacketScene};
use crate::tracking::tape::band::BandFit;
use crate::tracking::track_file::ImagePoint;
use nalgebra::{Isometry3, Vector2};

/// Least deviation of a marker's image point, px: what the model of the tape itself is good to.
const FLOOR_SD_PX: f64 = 0.03;
/// A point farther than this many deviations (with the tolerance below) from the common pose is another thing.
const OUTLIER: f64 = 4.0;
/// What a good point may miss the pose by, px, beyond its own deviation (tape put on by hand, tube of another shape).
const MODEL_TOLERANCE_PX: f64 = 0.25;
/// A pose this near to the predicted one, px at every marker, was predicted well: the bands looked as expected there.
pub(super) const CONFIRMED_PX: f64 = 1.0;
/// How far a pose from one camera may be from the predicted one: m (depth from the racket's size: 0.1 px of 80 is 15 mm at
/// 12 m) and rad.
const ONE_CAMERA: (f64, f64) = (0.10, 0.25);

/// A marker's band, found in one of the pictures.
#[derive(Debug, Clone, Copy)]
pub struct FoundBand {
    pub(super) camera: CameraId,
    pub(super) marker: usize,
    pub(super) fit: BandFit,
}

/// Measures every marker near a predicted pose. `reach_px` is how far the prediction may be off; `least_contrast` the
/// contrast a band must have, by camera. `None` when fewer than three markers or five image points agree on one pose; with
/// one camera alone, fewer than four, or a pose far from the predicted one (one camera hardly tells depth).
pub fn measure(
    scene: &RacketScene,
    images: &[Option<GreyView>; 2],
    predicted: &Isometry3<f64>,
    reach_px: i32,
    least_contrast: &[f64; 2],
) -> Option<RacketFrame> {
    // A prediction that all bands confirm needs no second look; bands that were not found get a second chance where the others
    // say they are.
    let possible = 5 * images.iter().flatten().count();
    let look = Look { scene, images, least_contrast };
    let first = look.from(predicted, 1, false, Vec::new());
    let close = first.filter(|a| a.dropped == 0 && scene.apart_px(&a.pose.global_from_racket, predicted) < CONFIRMED_PX);
    let Agreed { pose, fits, .. } = match close {
        Some(agreed) if agreed.fits.len() == possible => agreed,
        Some(agreed) => look.from(&agreed.pose.global_from_racket, 1, true, agreed.fits.clone()).unwrap_or(agreed),
        None => {
            let rough = look.from(predicted, reach_px, false, Vec::new())?;
            look.from(&rough.pose.global_from_racket, 1, true, Vec::new()).unwrap_or(rough)
        }
    };
    let one_camera = fits.iter().all(|f| f.camera == fits[0].camera);
    if one_camera {
        let (p, q) = (&pose.global_from_racket, predicted);
        if (p.translation.vector - q.translation.vector).norm() > ONE_CAMERA.0 || p.rotation.angle_to(&q.rotation) > ONE_CAMERA.1 {
            return None;
        }
    }
    Some(RacketFrame { pose, points: points_of(&fits), foretold: false })
}

/// Looks for the bands of one frame.
pub(super) struct Look<'a> {
    pub(super) scene: &'a RacketScene<'a>,
    pub(super) images: &'a [Option<GreyView<'a>>; 2],
    pub(super) least_contrast: &'a [f64; 2],
}

impl Look<'_> {
    /// The bands that agree on a pose, of those known and those found near `pose`; the others count as well where they are seen in part
    /// or as specks, if `weak`.
    pub(super) fn from(&self, pose: &Isometry3<f64>, reach_px: i32, weak: bool, mut fits: Vec<FoundBand>) -> Option<Agreed> {
        add_bands(self.scene, self.images, pose, (reach_px, weak), self.least_contrast, &mut fits);
        let seen = fits.len();
        let pose = agree(self.scene, &mut fits, pose)?;
        Some(Agreed { pose, dropped: seen - fits.len(), fits })
    }
}

/// Adds the bands not yet known that are found near a pose.
pub(in crate::tracking) fn add_bands(
    scene: &RacketScene,
    images: &[Option<GreyView>; 2],
    pose: &Isometry3<f64>,
    how: (i32, bool),
    least_contrast: &[f64; 2],
    fits: &mut Vec<FoundBand>,
) {
    let mut known = [[false; 5]; 2];
    fits.iter().for_each(|f| known[f.camera.index()][f.marker] = true);
    for camera in CameraId::BOTH {
        let Some(image) = &images[camera.index()] else { continue };
        for marker in (0..5).filter(|m| !known[camera.index()][*m]) {
            let found = find(scene, image, pose, camera, marker, how, least_contrast[camera.index()]);
            fits.extend(found.map(|fit| FoundBand { camera, marker, fit }));
        }
    }
    fits.sort_by_key(|f| (f.camera, f.marker));
    leave_out_hidden(scene, fits, pose);
}

/// Leaves out bands that were found on the tape of another one nearer to the camera: of a racket seen edge-on one tube hides the other, and the
/// hidden band's fit goes to the tape that is seen. Two tubes' middles less than a radius apart leave less than half of the farther one.
pub(super) fn leave_out_hidden(scene: &RacketScene, fits: &mut Vec<FoundBand>, pose: &Isometry3<f64>) {
    let depth = |camera: CameraId, marker: usize| (pose * scene.figure.points[marker] - scene.view.eye(camera)).norm();
    let hidden = |k: usize| {
        let FoundBand { camera, marker, fit } = &fits[k];
        fits.iter()
            .filter(|other| other.camera == *camera && other.marker != *marker)
            .any(|other| (other.fit.uv - fit.uv).norm() < fit.radius_px && depth(*camera, other.marker) < depth(*camera, *marker))
    };
    let hidden: Vec<bool> = (0..fits.len()).map(hidden).collect();
    if hidden.contains(&true) {
        let mut hidden = hidden.into_iter();
        fits.retain(|_| !hidden.next().unwrap_or(false));
    }
}

/// [`measure`] where the frames before say how the racket moves. A doubled picture shows it where it was: a band or two of that camera may
/// still agree with the other's on a pose, one whose depth has jumped. Such a frame is measured from the other camera alone.
pub(in crate::tracking) fn measure_following(
    scene: &RacketScene,
    images: &[Option<GreyView>; 2],
    predicted: &Isometry3<f64>,
    reach_px: i32,
    least_contrast: &[f64; 2],
) -> Option<RacketFrame> {
    let frame = measure(scene, images, predicted, reach_px, least_contrast)?;
    let jumped = scene.apart_px(&frame.pose.global_from_racket, predicted) > JUMP_PX;
    let mut images = *images;
    for (image, points) in images.iter_mut().zip(&frame.points) {
        if (1..FEW_BANDS).contains(&points.iter().flatten().count()) {
            *image = None;
        }
    }
    let few = images.iter().flatten().count() == 1;
    let alone = if jumped && few { measure(scene, &images, predicted, reach_px, least_contrast) } else { None };
    Some(alone.unwrap_or(frame))
}

/// Fewer bands than this in one camera's picture tell little beside the other's.
pub(super) const FEW_BANDS: usize = 3;
/// A pose farther than this from the predicted one, px at any marker, is a jump.
const JUMP_PX: f64 = 1.5;

/// The bands that share a pose, and how many did not.
pub(super) struct Agreed {
    pub(super) pose: RacketPose,
    pub(super) fits: Vec<FoundBand>,
    dropped: usize,
}

pub(in crate::tracking) fn points_of(fits: &[FoundBand]) -> [[Option<ImagePoint>; 5]; 2] {
    let mut points = [[None; 5]; 2];
    for FoundBand { camera, marker, fit } in fits {
        points[camera.index()][*marker] = Some(image_point(fit));
    }
    points
}

pub(in crate::tracking) fn observations_of(fits: &[FoundBand]) -> Vec<MarkerObservation> {
    fits.iter().map(|f| MarkerObservation { camera: f.camera, marker: f.marker, point: image_point(&f.fit) }).collect()
}

pub(super) fn image_point(f: &BandFit) -> ImagePoint {
    let sd = |v: f64| (v + FLOOR_SD_PX * FLOOR_SD_PX).sqrt();
    ImagePoint { uv: f.uv, sd: Vector2::new(sd(f.covariance[(0, 0)]), sd(f.covariance[(1, 1)])) }
}

/// The pose most bands agree on; bands that do not are removed, worst first.
pub(super) fn agree(scene: &RacketScene, fits: &mut Vec<FoundBand>, start: &Isometry3<f64>) -> Option<RacketPose> {
    loop {
        let mut markers = [false; 5];
        fits.iter().for_each(|f| markers[f.marker] = true);
        let seen = markers.iter().filter(|m| **m).count();
        if seen < 3 || fits.len() < 5 && seen < 4 {
            return None;
        }
        let observations = observations_of(fits);
        let pose = fit_pose(scene.view, scene.figure, &observations, Some(start)).ok()?;
        match worst_miss(scene, &observations, &pose)? {
            (i, z) if z > OUTLIER => {
                fits.remove(i);
            }
            _ => return Some(pose),
        }
    }
}

/// The observation that misses a pose most, and by how many deviations (with what a good one may miss it by).
pub(in crate::tracking) fn worst_miss(scene: &RacketScene, observations: &[MarkerObservation], pose: &RacketPose) -> Option<(usize, f64)> {
    let mut worst = (0, 0.0);
    for (i, o) in observations.iter().enumerate() {
        let r = o.point.uv - scene.view.patch(o.camera, scene.figure, o.marker, &pose.global_from_racket)?;
        let squared = |k: usize| r[k] * r[k] / (o.point.sd[k] * o.point.sd[k] + MODEL_TOLERANCE_PX * MODEL_TOLERANCE_PX);
        let z = (squared(0) + squared(1)).sqrt();
        if z > worst.1 {
            worst = (i, z);
        }
    }
    Some(worst)
}
