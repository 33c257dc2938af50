//! A racket that is followed, in the next frame: where its bands tell its pose, measured from them alone; where too few are seen, with the pose that
//! the frames before foretell.

use crate::calibration::CameraId;
use crate::footage::GreyView;
use crate::tracking::racket::foretold_pose::Foretold;
use crate::tracking::racket::known_bands::KnownBands;
use crate::tracking::racket::racket_other_view::in_other_view;
use crate::tracking::racket::racket_pose::{RacketPose, fit_pose_near};
use crate::tracking::racket::racket_scene::{ALL_BANDS, RacketFrame, RacketScene};
use crate::tracking::racket::racket_track::{FoundBand, add_bands, measure, measure_following, observations_of, points_of, worst_miss};
use nalgebra::{SMatrix, Vector2};

/// Markers whose bands tell with what was foretold where the racket is, and most bands that may disagree.
const FEWEST_FORETOLD: usize = 2;
const MOST_DISAGREE: usize = 1;
/// A single marker's bands do where they were foretold to this, px (one deviation).
const WELL_FORETOLD_PX: f64 = 1.0;
/// What a band may be off that so few or fewer in all cannot check, px: something covers some of it, or it is the edge of another thing.
const UNCHECKED_PX: f64 = 0.5;
const MOST_UNCHECKED: usize = 7;
/// One farther from the pose than so many of these deviations does not agree.
const OUTLIER_OF_FEW: f64 = 2.5;
/// Bands that are few for a pose, and how far off, in the same deviations, such a pose is not believed.
const FEW_BANDS: usize = 6;
const FAR_OFF: f64 = 8.0;

/// A racket that is followed: where it is expected in a frame.
pub struct Expected {
    pub foretold: Foretold,
    /// The frames before say how it moves.
    pub goes_on: bool,
    /// Few bands may tell where it is.
    pub by_few: bool,
    /// How far from its expected place it is looked for.
    pub reach_px: i32,
    /// The cameras that showed it in the frame before.
    pub saw_it: [bool; 2],
    /// One of them has not shown it for some frames: it is looked for there along the other's line of sight.
    pub astray: bool,
}

impl Expected {
    /// The racket in one frame, and the bands by which it is known in the next.
    pub fn find(&self, scene: &RacketScene, pictures: [Option<GreyView>; 2], least_contrast: &[f64; 2]) -> (Option<RacketFrame>, Option<KnownBands>) {
        let mut images = pictures;
        let look = if self.goes_on { measure_following } else { measure };
        loop {
            let mut found = look(scene, &images, &self.foretold.pose, self.reach_px, least_contrast);
            let known = found.as_ref().and_then(|frame| KnownBands::of(scene, &images, frame, least_contrast));
            // Depth and attitude are poorly told by one camera: there, as where few bands are seen, they go on as they went.
            if self.goes_on && self.by_few && !found.as_ref().is_some_and(RacketFrame::stereo) {
                found = measure_foretold(scene, &images, &self.foretold, self.reach_px, least_contrast).or(found);
            }
            // A few bands on other things agree on some pose as well.
            if self.goes_on && found.as_ref().is_some_and(|frame| self.is_far_off(frame)) {
                found = measure_foretold(scene, &images, &self.foretold, self.reach_px, least_contrast);
            }
            match found.as_ref().and_then(|frame| self.lone_in(scene, frame)) {
                Some(camera) => images[camera] = None,
                None => break self.in_both(scene, &pictures, found, known, least_contrast),
            }
        }
    }

    /// What one camera alone shows, with what the other one shows along the first one's line of sight.
    fn in_both(
        &self,
        scene: &RacketScene,
        pictures: &[Option<GreyView>; 2],
        found: Option<RacketFrame>,
        known: Option<KnownBands>,
        least_contrast: &[f64; 2],
    ) -> (Option<RacketFrame>, Option<KnownBands>) {
        let alone = found.as_ref().filter(|frame| self.astray && !frame.stereo());
        match alone.and_then(|frame| in_other_view(scene, pictures, frame, least_contrast)) {
            Some(frame) => {
                let known = KnownBands::of(scene, pictures, &frame, least_contrast);
                (Some(frame), known)
            }
            None => (found, known),
        }
    }

    /// Whether few bands put it where it can hardly have got to.
    fn is_far_off(&self, frame: &RacketFrame) -> bool {
        frame.stereo() && !frame.foretold && frame.count() <= FEW_BANDS && self.foretold.off(&frame.pose.global_from_racket) > FAR_OFF
    }

    /// The camera that shows a single band, not where it was foretold to a pixel, and did not show the racket before: that may be another thing, and
    /// would tell the depth.
    fn lone_in(&self, scene: &RacketScene, frame: &RacketFrame) -> Option<usize> {
        let lone = |camera: &CameraId| {
            let mut seen = (0..5).filter(|marker| frame.points[camera.index()][*marker].is_some());
            let only = seen.next().filter(|_| seen.next().is_none());
            only.is_some_and(|marker| !is_well_foretold(scene, &self.foretold, *camera, marker))
        };
        CameraId::BOTH.into_iter().filter(|camera| !self.saw_it[camera.index()]).find(lone).map(CameraId::index)
    }
}

/// The racket where too few bands are seen to tell its pose: those near their foretold places, and the pose that they and what was foretold agree
/// on. `None` where those of fewer than [`FEWEST_FORETOLD`] markers agree, but for one that was well foretold.
fn measure_foretold(scene: &RacketScene, images: &[Option<GreyView>; 2], foretold: &Foretold, reach_px: i32, least_contrast: &[f64; 2]) -> Option<RacketFrame> {
    let mut fits = Vec::with_capacity(ALL_BANDS);
    add_bands(scene, images, &foretold.pose, (reach_px, false), least_contrast, &mut fits);
    if fits.is_empty() {
        // The border may cut what is seen: it is looked for where it was well foretold.
        add_bands(scene, images, &foretold.pose, (1, true), least_contrast, &mut fits);
        fits.retain(|f| is_well_foretold(scene, foretold, f.camera, f.marker));
    } else {
        // Once more from where the first ones say that the others are.
        let pose = agree_foretold(scene, &mut fits, foretold)?.global_from_racket;
        add_bands(scene, images, &pose, (1, true), least_contrast, &mut fits);
    }
    let pose = agree_foretold(scene, &mut fits, foretold)?;
    Some(RacketFrame { pose, points: points_of(&fits), foretold: true })
}

/// The pose that bands and what was foretold agree on; one that does not is removed.
fn agree_foretold(scene: &RacketScene, fits: &mut Vec<FoundBand>, foretold: &Foretold) -> Option<RacketPose> {
    let unchecked_px = if fits.len() <= MOST_UNCHECKED { UNCHECKED_PX } else { 0.0 };
    for _ in 0..=MOST_DISAGREE {
        let mut markers = [false; 5];
        fits.iter().for_each(|f| markers[f.marker] = true);
        let well_foretold = || !fits.is_empty() && fits.iter().all(|f| is_well_foretold(scene, foretold, f.camera, f.marker));
        if markers.iter().filter(|m| **m).count() < FEWEST_FORETOLD && !well_foretold() {
            return None;
        }
        let mut observations = observations_of(fits);
        observations.iter_mut().for_each(|o| o.point.sd = o.point.sd.map(|sd| sd.hypot(unchecked_px)));
        let pose = fit_pose_near(scene.view, scene.figure, &observations, foretold).ok()?;
        match worst_miss(scene, &observations, &pose)? {
            (i, z) if z > OUTLIER_OF_FEW => fits.remove(i),
            _ => return foretold.allows(&pose.global_from_racket).then_some(pose),
        };
    }
    None
}

/// Whether a band's place in a picture was foretold to [`WELL_FORETOLD_PX`].
fn is_well_foretold(scene: &RacketScene, foretold: &Foretold, camera: CameraId, marker: usize) -> bool {
    let spread = |(_, by_pose): (Vector2<f64>, SMatrix<f64, 2, 6>)| (by_pose * foretold.covariance() * by_pose.transpose()).trace().sqrt();
    scene.view.patch_with_jacobian(camera, scene.figure, marker, &foretold.pose).map(spread).is_some_and(|px| px < WELL_FORETOLD_PX)
}
