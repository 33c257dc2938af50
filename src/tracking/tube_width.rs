//! How wide the tubes in the throat are: `racket.toml` tells the radius of the head's tube only.
//!
//! The visible tape lies 0.785 radii before the tube's axis. A tube half a millimetre thinner than thought puts its marker 0.4 mm too
//! far from both cameras, and since nothing else tells their depth, the whole racket turns by it. Widths are tried as directions
//! are ([`super::throat`]): the one that leaves least of the bands unexplained. What the model of a band does not know (blur, light) makes
//! every band seem wider or narrower alike; so the head's bands, whose width is known, are asked as well and the ratio counts.

use super::band::{self, BandPart, BandView};
use super::racket_track::{RacketFrame, RacketScene};
use crate::calibration::CameraId;
use crate::footage::GreyView;
use rayon::prelude::*;

/// Widths tried, relative to the file's.
const TRIED: [f64; 7] = [0.80, 0.85, 0.90, 0.95, 1.0, 1.05, 1.10];
/// Neighbouring pixels miss together: as many count as one.
const TOGETHER: f64 = 4.0;
/// One band's picture says no more than this against a width (another thing lies across it).
const MOST: f64 = 12.0;
/// Deviation of the ratio that stays however many pictures are asked: on rendered rackets of known width it was found 0.02 to 0.03
/// too small or too large.
const LEAST_SD: f64 = 0.025;
/// Before anything was seen: as wide as the head's, with this deviation.
const EXPECTED_SD: f64 = 0.05;

/// What pictures say against each width of the head's tube, and of the throat's: half of chi squared.
#[derive(Debug, Default, Clone)]
pub struct WidthEvidence {
    against: [[f64; TRIED.len()]; 2],
}

impl WidthEvidence {
    /// Adds the pictures of one frame.
    pub fn add(&mut self, scene: &RacketScene, images: &[Option<GreyView>; 2], frame: &RacketFrame) {
        let seen: Vec<(CameraId, usize)> =
            CameraId::BOTH.iter().flat_map(|c| (0..5).map(move |m| (*c, m))).filter(|(c, m)| frame.points[c.index()][*m].is_some()).collect();
        let of_band = |&(camera, marker): &(CameraId, usize)| -> Option<[f64; TRIED.len()]> {
            let image = images[camera.index()].as_ref()?;
            let band = BandView::at(scene.view, scene.figure, &frame.pose.global_from_racket, camera, marker)?;
            let mut misfits = [(0.0, 0.0); TRIED.len()];
            let mut like = None;
            for (misfit, by) in misfits.iter_mut().zip(TRIED) {
                let fit = band::fit(image, &band.widened(by), scene.shape, (0.0, 0.0), BandPart::Whole, like.as_ref())?;
                *misfit = fit.misfit;
                like = Some(fit.settled);
            }
            let least = misfits.iter().map(|m| m.0).fold(f64::INFINITY, f64::min).max(0.25);
            Some(misfits.map(|(misfit, pixels)| (0.5 * pixels / TOGETHER * (misfit.max(0.25) / least).ln()).min(MOST)))
        };
        let evidence: Vec<Option<[f64; TRIED.len()]>> = seen.par_iter().map(of_band).collect();
        for ((_, marker), against) in seen.iter().zip(evidence) {
            let group = usize::from(scene.figure.in_throat().any(|m| m == *marker));
            let Some(against) = against else { continue };
            self.against[group].iter_mut().zip(against).for_each(|(sum, a)| *sum += a);
        }
    }

    /// Adds what other pictures say.
    pub fn join(&mut self, other: &Self) {
        for (all, some) in self.against.iter_mut().zip(&other.against) {
            all.iter_mut().zip(some).for_each(|(sum, a)| *sum += a);
        }
    }

    /// Width of the throat's tubes relative to the head's; one where nothing was seen.
    pub fn throat_to_head(&self) -> f64 {
        let [Some((head, head_sd)), Some((throat, throat_sd))] = self.against.each_ref().map(least) else { return 1.0 };
        let precision = (head_sd.hypot(throat_sd).hypot(LEAST_SD)).powi(-2);
        let expected = EXPECTED_SD.powi(-2);
        (throat / head * precision + expected) / (precision + expected)
    }
}

/// The width that least is said against, with its deviation.
fn least(against: &[f64; TRIED.len()]) -> Option<(f64, f64)> {
    let best = (1..TRIED.len() - 1).min_by(|&a, &b| against[a].total_cmp(&against[b]))?;
    let (a, b, c) = (against[best - 1], against[best], against[best + 1]);
    let (step, bend) = (TRIED[best + 1] - TRIED[best], a - 2.0 * b + c);
    (b <= a && b <= c && bend > 1e-9).then(|| (TRIED[best] + 0.5 * step * (a - c) / bend, step / bend.sqrt()))
}
