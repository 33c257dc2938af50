//! How the tubes run at the throat markers: `racket.toml` tells their places, not their direction.
//!
//! The direction decides which side of the tube faces a camera (15 degrees move the visible tape by a sixth of a pixel, oppositely
//! in the two cameras), and it can be seen: white and black bands lie along it. Every direction tried turns the model of the
//! bands; the one that leaves least of the pictures of a few frames unexplained is taken.

use crate::footage::GreyView;
use crate::tracking::racket::racket_figure::RacketFigure;
use crate::tracking::racket::racket_scene::{RacketFrame, RacketScene};
use crate::tracking::tape::band_trial;
use std::ops::Range;

/// Directions tried, degrees either side of the tangent to the head, and their steps.
const REACH_DEG: f64 = 24.0;
const STEP_DEG: f64 = 4.0;
const TRIED: usize = 13;
/// How far a throat may run from the tangent, degrees (one deviation).
const TANGENT_SD_DEG: f64 = 15.0;
/// A direction is believed when it is known better than this, degrees.
const LEAST_SD_DEG: f64 = 3.0;

/// Steps to either side of a direction that one frame has told already.
const NEAR: usize = 3;

/// What pictures say against each direction: half of chi squared.
#[derive(Debug, Clone)]
pub struct ThroatEvidence {
    against: [f64; TRIED],
    bands: usize,
    /// Which directions are tried.
    tried: Range<usize>,
}

fn tried_rad(tangent_rad: f64, k: usize) -> f64 {
    tangent_rad + (k as f64 * STEP_DEG - REACH_DEG).to_radians()
}

impl ThroatEvidence {
    /// Of directions as far from the figure's as a throat may run.
    pub fn wide() -> Self {
        ThroatEvidence { against: [0.0; TRIED], bands: 0, tried: 0..TRIED }
    }

    /// Of directions near the figure's, which has been looked for before.
    pub fn near() -> Self {
        ThroatEvidence { tried: TRIED / 2 - NEAR..TRIED / 2 + NEAR + 1, ..Self::wide() }
    }

    /// Adds the pictures of one frame.
    pub fn add(&mut self, scene: &RacketScene, images: &[Option<GreyView>; 2], frame: &RacketFrame) {
        let Some(tangent) = scene.figure.throat_angle() else { return };
        let figures: Vec<RacketFigure> = self.tried.clone().map(|k| scene.figure.with_throat(tried_rad(tangent, k))).collect();
        let asked = |marker: usize| scene.figure.throat_markers[marker];
        let looks = |camera, marker| band_trial::on_figures(scene, frame, &figures, camera, marker);
        for (_, against) in band_trial::against_in_frame(images, frame, asked, looks) {
            self.against[self.tried.clone()].iter_mut().zip(against).for_each(|(sum, a)| *sum += a);
            self.bands += 1;
        }
    }

    /// Adds what other pictures say.
    pub fn join(&mut self, other: &Self) {
        self.against.iter_mut().zip(other.against).for_each(|(sum, a)| *sum += a);
        self.bands += other.bands;
    }

    /// The direction from the racket's axis with its deviation, rad, if the pictures tell it.
    pub fn angle(&self, figure: &RacketFigure) -> Option<(f64, f64)> {
        let tangent = figure.throat_angle()?;
        let cost = |k: usize| self.against[k] + 0.5 * ((k as f64 * STEP_DEG - REACH_DEG) / TANGENT_SD_DEG).powi(2);
        let best = self.tried.clone().min_by(|&a, &b| cost(a).total_cmp(&cost(b)))?;
        if best == self.tried.start || best + 1 == self.tried.end || self.bands == 0 {
            return None;
        }
        let (a, b, c) = (cost(best - 1), cost(best), cost(best + 1));
        let bend = a - 2.0 * b + c;
        let sd_deg = STEP_DEG / bend.max(1e-9).sqrt();
        (sd_deg < LEAST_SD_DEG).then(|| (tried_rad(tangent, best) + (0.5 * STEP_DEG * (a - c) / bend).to_radians(), sd_deg.to_radians()))
    }
}
