//! How wide the tubes in the throat are: `racket.toml` tells the radius of the head's tube only.
//!
//! The visible tape lies 0.785 radii before the tube's axis. A tube half a millimetre thinner than thought puts its marker 0.4 mm too
//! far from both cameras, and since nothing else tells their depth, the whole racket turns by it. Widths are tried as directions
//! are ([`crate::tracking::tape::throat`]): the one that leaves least of the bands unexplained. What the model of a band does not know (blur, light) makes
//! every band seem wider or narrower alike; so the head's bands, whose width is known, are asked as well and the ratio counts.

use crate::footage::GreyView;
use crate::tracking::racket::racket_scene::{RacketFrame, RacketScene};
use crate::tracking::tape::band::BandView;
use crate::tracking::tape::band_trial::{self, Trial};

/// Widths tried, relative to the figure's.
const TRIED: [f64; 7] = [0.80, 0.85, 0.90, 0.95, 1.0, 1.05, 1.10];
/// Deviation of the ratio that stays however many pictures are asked: on 38 rendered shots of known width it was found 0.01 too
/// small or too large.
const LEAST_SD: f64 = 0.012;
/// Before anything was seen: as wide as the head's, with this deviation.
const EXPECTED_SD: f64 = 0.1;

/// What pictures say against each width of the head's tube, and of the throat's.
#[derive(Debug, Clone)]
pub struct WidthEvidence([Trial<{ TRIED.len() }>; 2]);

impl WidthEvidence {
    pub fn none() -> Self {
        WidthEvidence([Trial::new(TRIED), Trial::new(TRIED)])
    }

    /// Adds the pictures of one frame.
    pub fn add(&mut self, scene: &RacketScene, images: &[Option<GreyView>; 2], frame: &RacketFrame) {
        let looks = |camera, marker| {
            let band = BandView::at(scene.view, scene.figure, &frame.pose.global_from_racket, camera, marker)?;
            Some(TRIED.map(|by| (band.widened(by), *scene.shape)))
        };
        for (marker, against) in band_trial::against_in_frame(images, frame, |_| true, looks) {
            self.0[usize::from(scene.figure.throat_markers[marker])].add(&against);
        }
    }

    /// Adds what other pictures say.
    pub fn join(&mut self, other: &Self) {
        self.0.iter_mut().zip(&other.0).for_each(|(all, some)| all.add(&some.against));
    }

    /// Width of the throat's tubes relative to the head's, when they were tried around `figure` times that; one where nothing was seen.
    pub fn throat_to_head(&self, figure: f64) -> f64 {
        let [Some((head, head_sd)), Some((throat, throat_sd))] = self.0.each_ref().map(Trial::least) else { return 1.0 };
        let precision = (head_sd.hypot(throat_sd).hypot(LEAST_SD)).powi(-2);
        let expected = EXPECTED_SD.powi(-2);
        (figure * throat / head * precision + expected) / (precision + expected)
    }

    /// The width, relative to the figure's, beyond which the throat's lies: those around it have to be tried.
    pub fn beyond(&self) -> Option<f64> {
        let [head, throat] = &self.0;
        throat.end().filter(|_| head.least().is_some())
    }
}
