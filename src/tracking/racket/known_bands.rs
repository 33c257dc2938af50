//! A frame whose bands are seen where and as the frame before says: one fit each.

use crate::calibration::CameraId;
use crate::footage::{GreyView, Rows};
use crate::tracking::racket::band_near::least_of;
use crate::tracking::racket::racket_scene::{ALL_BANDS, RacketFrame, RacketScene};
use crate::tracking::racket::racket_track::{CONFIRMED_PX, FEW_BANDS, FoundBand, Look, agree, image_point, leave_out_hidden};
use crate::tracking::tape::band::{self, BandPart, BandView, Settled};
use nalgebra::Isometry3;

/// The bands seen whole in the frame before, by camera and marker.
#[derive(Debug, Default, Clone)]
pub struct KnownBands([[Known; 5]; 2]);

#[derive(Debug, Default, Clone, Copy)]
struct Known {
    seen: bool,
    /// What it looked like, once it has been fitted where it was expected.
    like: Option<Settled>,
}

impl KnownBands {
    /// Of a frame just measured; `None` where they are too few.
    pub fn of(scene: &RacketScene, images: &[Option<GreyView>; 2], frame: &RacketFrame, least_contrast: &[f64; 2]) -> Option<Self> {
        let bands = scene.expected(&frame.pose.global_from_racket)?;
        let mut known = KnownBands::default();
        for camera in CameraId::BOTH {
            let (c, image) = (camera.index(), images[camera.index()].as_ref()?);
            for (marker, band) in bands.0[c].iter().enumerate() {
                known.0[c][marker].seen = frame.points[c][marker].is_some() && stands_out(scene, image, band, least_contrast[c]);
            }
        }
        known.tell().then_some(known)
    }

    /// Whether they are enough to tell that the racket goes on as it went.
    fn tell(&self) -> bool {
        self.0.iter().all(|c| c.iter().filter(|k| k.seen).count() >= FEW_BANDS)
    }

    fn count(&self) -> usize {
        self.0.iter().flatten().filter(|k| k.seen).count()
    }
}

/// Whether a band has the contrast of tape right where it is expected.
fn stands_out(scene: &RacketScene, image: &GreyView, band: &BandView, least_contrast: f64) -> bool {
    band.contrast(image, scene.shape, 0.0, 0.0).is_some_and(|c| c >= least_of(scene, band, least_contrast))
}

/// The bands of all markers as they should look at a pose, by camera and marker.
pub struct ExpectedBands([[BandView; 5]; 2]);

impl RacketScene<'_> {
    /// `None` where a marker is behind a camera or its tube points at one.
    pub fn expected(&self, pose: &Isometry3<f64>) -> Option<ExpectedBands> {
        let band = |camera: CameraId, marker: usize| BandView::at(self.view, self.figure, pose, camera, marker);
        let of = |camera| -> Option<[BandView; 5]> { Some([band(camera, 0)?, band(camera, 1)?, band(camera, 2)?, band(camera, 3)?, band(camera, 4)?]) };
        Some(ExpectedBands([of(CameraId::Left)?, of(CameraId::Right)?]))
    }
}

impl ExpectedBands {
    /// The rows of both pictures that [`confirm`] looks at.
    pub fn rows(&self, scene: &RacketScene, known: &KnownBands) -> [Rows; 2] {
        let rows = |(band, known): (&BandView, &Known)| {
            // A band not seen before is searched around where the others say it is.
            let half = band.half_height(scene.shape) + CONFIRMED_PX + if known.seen { 0.5 } else { 2.5 };
            scene.view.rows(band.centre.y - half, band.centre.y + half + 1.0)
        };
        [0, 1].map(|c| Rows::of(self.0[c].iter().zip(&known.0[c]).map(rows)))
    }
}

/// Measures a frame in which the bands that the frame before showed, all but one at most, are seen where and as expected: one fit each,
/// beginning with what the band looked like before; the others are looked for where these say they are. `None` where that does not hold;
/// [`measure`](super::racket_track::measure) then looks farther.
pub fn confirm(
    scene: &RacketScene,
    images: &[Option<GreyView>; 2],
    predicted: &Isometry3<f64>,
    expected: &ExpectedBands,
    least_contrast: &[f64; 2],
    known: &mut KnownBands,
) -> Option<RacketFrame> {
    let mut fits = Vec::with_capacity(ALL_BANDS);
    if !known.tell() {
        return None;
    }
    let enough = known.count() - 1;
    // A glance at all of them before any is measured.
    let mut at_hand: Vec<(CameraId, usize, &GreyView, &BandView)> = Vec::with_capacity(ALL_BANDS);
    for camera in CameraId::BOTH {
        let (c, image) = (camera.index(), images[camera.index()].as_ref()?);
        let bands = expected.0[c].iter().enumerate().filter(|(marker, band)| known.0[c][*marker].seen && stands_out(scene, image, band, least_contrast[c]));
        at_hand.extend(bands.map(|(marker, band)| (camera, marker, image, band)));
    }
    if at_hand.len() < enough {
        return None;
    }
    for (camera, marker, image, band) in at_hand {
        let c = camera.index();
        let fit = band::fit(image, band, scene.shape, (0.0, 0.0), BandPart::Whole, known.0[c][marker].like.as_ref());
        fits.extend(fit.filter(|fit| fit.white - fit.black > least_of(scene, band, least_contrast[c])).map(|fit| FoundBand { camera, marker, fit }));
    }
    leave_out_hidden(scene, &mut fits, predicted);
    let mut pose = agree(scene, &mut fits, predicted)?;
    if fits.len() < enough || !(scene.apart_px(&pose.global_from_racket, predicted) < CONFIRMED_PX) {
        return None;
    }
    if fits.len() < ALL_BANDS {
        let look = Look { scene, images, least_contrast };
        if let Some(more) = look.from(&pose.global_from_racket, 1, true, fits.clone()) {
            (pose, fits) = (more.pose, more.fits);
        }
    }
    let mut points = [[None; 5]; 2];
    let before = std::mem::take(known);
    for FoundBand { camera, marker, fit } in &fits {
        let c = camera.index();
        points[c][*marker] = Some(image_point(fit));
        // One seen in part is looked for in part again.
        let whole = before.0[c][*marker].seen || images[c].as_ref().is_some_and(|image| stands_out(scene, image, &expected.0[c][*marker], least_contrast[c]));
        known.0[c][*marker] = Known { seen: whole, like: whole.then_some(fit.settled) };
    }
    Some(RacketFrame { pose, points, foretold: false })
}
