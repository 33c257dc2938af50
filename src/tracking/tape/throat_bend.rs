//! How the tubes in the throat are bent: from the shaft they spread toward the head along an arc, and no file tells which.
//!
//! A band on a bent tube fitted as a straight one lies off by what the bend carries its black ends across: 0.1 px (0.4 mm) on a tube of
//! 0.3 m radius, and more where the black stands out better than the white does. Bends are tried as directions are ([`crate::tracking::tape::throat`]).

use crate::footage::GreyView;
use crate::tracking::racket::racket_scene::{RacketFrame, RacketScene};
use crate::tracking::tape::band_trial::{self, Trial};

/// Bends tried, 1/m, outward.
const TRIED: [f64; 5] = [-2.0, 0.0, 2.0, 4.0, 6.0];
/// Before anything was seen: between a straight throat and one of 0.25 m radius.
const EXPECTED: (f64, f64) = (1.5, 2.0);

/// What pictures say against each bend.
#[derive(Debug, Clone)]
pub struct BendEvidence(Trial<{ TRIED.len() }>);

impl BendEvidence {
    pub fn none() -> Self {
        BendEvidence(Trial::new(TRIED))
    }

    /// Adds the pictures of one frame.
    pub fn add(&mut self, scene: &RacketScene, images: &[Option<GreyView>; 2], frame: &RacketFrame) {
        let figures = TRIED.map(|bend| scene.figure.with_throat_bend(bend));
        let asked = |marker: usize| scene.figure.throat_markers[marker];
        let looks = |camera, marker| band_trial::on_figures(scene, frame, &figures, camera, marker);
        for (_, against) in band_trial::against_in_frame(images, frame, asked, looks) {
            self.0.add(&against);
        }
    }

    /// Adds what other pictures say.
    pub fn join(&mut self, other: &Self) {
        self.0.add(&other.0.against);
    }

    /// 1/m, outward; zero where the pictures say nothing that makes sense.
    pub fn bend(&self) -> f64 {
        if self.0.against.iter().all(|a| *a == 0.0) {
            return 0.0;
        }
        self.0.clone().expecting(EXPECTED.0, EXPECTED.1).least().map_or(0.0, |(bend, _)| bend)
    }
}
