//! How the tubes run at the throat markers: `racket.toml` tells their places, not their direction.
//!
//! The direction decides which side of the tube faces a camera (15 degrees move the visible tape by a sixth of a pixel, oppositely
//! in the two cameras), and it can be seen: white and black bands lie along it. Every direction tried turns the model of the
//! bands; the one that leaves least of the pictures of a few frames unexplained is taken.

use super::band::{self, BandPart, BandView};
use super::racket_figure::RacketFigure;
use super::racket_track::{RacketFrame, RacketScene};
use crate::calibration::CameraId;
use crate::footage::GreyView;
use rayon::prelude::*;

/// Directions tried, degrees either side of the tangent to the head, and their steps.
const REACH_DEG: f64 = 24.0;
const STEP_DEG: f64 = 4.0;
const TRIED: usize = 13;
/// How far a throat may run from the tangent, degrees (one deviation).
const TANGENT_SD_DEG: f64 = 15.0;
/// Neighbouring pixels miss together: as many count as one.
const TOGETHER: f64 = 4.0;
/// One band's picture says no more than this against a direction (another thing lies across it).
const MOST: f64 = 12.0;
/// A direction is believed when it is known better than this, degrees.
const LEAST_SD_DEG: f64 = 3.0;

/// What pictures say against each direction: half of chi squared.
#[derive(Debug, Default, Clone)]
pub struct ThroatEvidence {
    against: [f64; TRIED],
    bands: usize,
}

fn tried_rad(tangent_rad: f64, k: usize) -> f64 {
    tangent_rad + (k as f64 * STEP_DEG - REACH_DEG).to_radians()
}

impl ThroatEvidence {
    /// Adds the pictures of one frame.
    pub fn add(&mut self, scene: &RacketScene, images: &[Option<GreyView>; 2], frame: &RacketFrame) {
        let Some(tangent) = scene.figure.throat_angle() else { return };
        let figures: [RacketFigure; TRIED] = std::array::from_fn(|k| scene.figure.with_throat(tried_rad(tangent, k)));
        for camera in CameraId::BOTH {
            let Some(image) = &images[camera.index()] else { continue };
            for marker in scene.figure.in_throat().filter(|m| frame.points[camera.index()][*m].is_some()) {
                let misfit = |figure: &RacketFigure| {
                    let band = BandView::at(scene.view, figure, &frame.pose.global_from_racket, camera, marker)?;
                    Some(band::fit(image, &band, scene.shape, (0.0, 0.0), BandPart::Whole)?.misfit)
                };
                let misfits: Option<Vec<(f64, f64)>> = figures.par_iter().map(misfit).collect();
                let Some(misfits) = misfits else { continue };
                let least = misfits.iter().map(|m| m.0).fold(f64::INFINITY, f64::min).max(0.25);
                for (sum, (misfit, pixels)) in self.against.iter_mut().zip(&misfits) {
                    *sum += (0.5 * pixels / TOGETHER * (misfit.max(0.25) / least).ln()).min(MOST);
                }
                self.bands += 1;
            }
        }
    }

    /// The direction from the racket's axis with its deviation, rad, if the pictures tell it.
    pub fn angle(&self, figure: &RacketFigure) -> Option<(f64, f64)> {
        let tangent = figure.throat_angle()?;
        let cost = |k: usize| self.against[k] + 0.5 * ((k as f64 * STEP_DEG - REACH_DEG) / TANGENT_SD_DEG).powi(2);
        let best = (0..TRIED).min_by(|&a, &b| cost(a).total_cmp(&cost(b)))?;
        if best == 0 || best + 1 == TRIED || self.bands == 0 {
            return None;
        }
        let (a, b, c) = (cost(best - 1), cost(best), cost(best + 1));
        let bend = a - 2.0 * b + c;
        let sd_deg = STEP_DEG / bend.max(1e-9).sqrt();
        (sd_deg < LEAST_SD_DEG).then(|| (tried_rad(tangent, best) + (0.5 * STEP_DEG * (a - c) / bend).to_radians(), sd_deg.to_radians()))
    }
}
