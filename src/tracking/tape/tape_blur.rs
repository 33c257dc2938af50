//! How sharp either camera's pictures of the racket are: a lens is out of focus somewhere in a volume of two metres, and on another day
//! everywhere. White against black on tape tells it.

use crate::calibration::CameraId;
use crate::footage::GreyView;
use crate::tracking::racket::racket_scene::{RacketFrame, RacketScene};
use crate::tracking::tape::band::{BandShape, BandView};
use crate::tracking::tape::band_trial::{self, Trial};

/// Blurs tried when nothing is known, px, one standard deviation.
const WIDE: [f64; 11] = [0.45, 0.55, 0.65, 0.75, 0.85, 0.95, 1.05, 1.15, 1.25, 1.35, 1.45];
/// Blurs tried when it is known roughly, of the one known.
const NEAR: [f64; 5] = [0.8, 0.9, 1.0, 1.1, 1.2];

/// Up to this blur of the tape pictures are in focus, px.
const IN_FOCUS_PX: f64 = 0.75;

/// Blur where tape has this one, of what has another in pictures in focus: what a lens out of focus adds, it adds to both.
pub fn out_of_focus(in_focus_px: f64, tape_px: f64) -> f64 {
    (in_focus_px.powi(2) + (tape_px.powi(2) - IN_FOCUS_PX.powi(2)).max(0.0)).sqrt()
}

/// What the bands of some frames say against each of several blurs, by camera.
#[derive(Debug, Clone)]
pub struct BlurEvidence<const N: usize>([Trial<N>; 2]);

impl BlurEvidence<{ WIDE.len() }> {
    pub fn wide() -> Self {
        BlurEvidence([Trial::new(WIDE), Trial::new(WIDE)])
    }
}

impl BlurEvidence<{ NEAR.len() }> {
    pub fn near(known_px: [f64; 2]) -> Self {
        BlurEvidence(known_px.map(|known| Trial::new(NEAR.map(|by| by * known))))
    }
}

impl<const N: usize> BlurEvidence<N> {
    /// Adds the pictures of one frame.
    pub fn add(&mut self, scene: &RacketScene, images: &[Option<GreyView>; 2], frame: &RacketFrame) {
        for camera in CameraId::BOTH {
            let trial = &mut self.0[camera.index()];
            let tried = trial.values;
            let looks = |camera, marker| {
                let band = BandView::at(scene.view, scene.figure, &frame.pose.global_from_racket, camera, marker)?;
                Some(tried.map(|blur| (band, BandShape { blur_px: [blur; 2], ..*scene.shape })))
            };
            let of_one = [0, 1].map(|c| images[c].filter(|_| c == camera.index()));
            for (_, against) in band_trial::against_in_frame(&of_one, frame, |_| true, looks) {
                trial.add(&against);
            }
        }
    }

    /// Adds what other pictures say.
    pub fn join(&mut self, other: &Self) {
        self.0.iter_mut().zip(&other.0).for_each(|(all, some)| all.add(&some.against));
    }

    /// The blurs that leave least of the bands unexplained, px; `known_px` where that lies at an end of those tried.
    pub fn blur_px(&self, known_px: [f64; 2]) -> [f64; 2] {
        [0, 1].map(|c| self.0[c].least().map_or(known_px[c], |(blur, _)| blur))
    }
}
