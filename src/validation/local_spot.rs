//! One place on the face whose rebound is its own: a dead spot, a broken string, a lively patch.
//!
//! Smooth corrections cannot show it, and a handful of impacts carries it. So a bump of the normal restitution is scored
//! at every place of a grid over the face and at three widths, nuisance projected out; the best one's p-value is multiplied
//! by the number of places looked at (Bonferroni: neighbours overlap, so that this is on the safe side).

use super::observation::Gear;
use super::project::{Nuisance, TOLD, project_out};
use super::rank::Reference;
use super::tails::ratio_tail;
use nalgebra::{DMatrix, DVector, RowDVector};
use rayon::prelude::*;

/// Corrected level of the test for one place on the face.
pub const SPOT_LEVEL: f64 = 0.002;

/// Half widths looked for, m.
const HALF_WIDTHS_M: [f64; 3] = [0.02, 0.03, 0.045];
/// Distance between places of the grid, m, and the share of the face's half axes that it covers.
const STEP_M: f64 = 0.015;
const COVERED: f64 = 0.9;
/// A place must hold this many impacts, each counted by its share of the bump.
const FEWEST: f64 = 3.0;
/// A place that one impact carries by more than this share is that impact's, not the face's.
const ONE_IMPACT: f64 = 0.6;
/// Bumps projected at a time.
const PIECE: usize = 40;

/// The place that stands out most: `restitution * (1 + strength * exp(-(distance / half_width)^2))`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LocalSpot {
    /// From the stringbed centre along racket x and y, m.
    pub along_m: f64,
    pub across_m: f64,
    pub half_width_m: f64,
    pub strength: f64,
    /// Fall in chi-square at the noise scale.
    pub gain: f64,
    /// For all places and widths looked at.
    pub p_value: f64,
}

fn grid(gear: &Gear) -> Vec<(f64, f64, f64)> {
    let head = &gear.racket.head;
    let (lx, ly) = (0.5 * COVERED * head.inner_length_m, 0.5 * COVERED * head.inner_width_m);
    let mut places = Vec::new();
    for width in HALF_WIDTHS_M {
        for i in 0..=(2.0 * lx / STEP_M) as usize {
            for j in 0..=(2.0 * ly / STEP_M) as usize {
                places.push((-lx + i as f64 * STEP_M, -ly + j as f64 * STEP_M, width));
            }
        }
    }
    places
}

/// The strongest bump over the face. `signature`: whitened derivative of each impact's prediction by a relative change of
/// the restitution. `None` when no place holds enough impacts.
pub fn strongest_spot(reference: &Reference, nuisance: &Nuisance, signature: &[DVector<f64>]) -> Option<LocalSpot> {
    let fitted = &reference.base.impacts;
    let share = |l: &super::linearise::Linearised, (x, y, width): (f64, f64, f64)| {
        (-((l.true_inputs[12] - x).powi(2) + (l.true_inputs[13] - y).powi(2)) / (width * width)).exp()
    };
    let mut places = grid(reference.observations.gear.first()?);
    places.retain(|p| fitted.iter().map(|l| share(l, *p)).sum::<f64>() >= FEWEST);
    let scored: Vec<LocalSpot> = places
        .par_chunks(PIECE)
        .flat_map_iter(|piece| {
            let blocks: Vec<DMatrix<f64>> =
                signature.iter().zip(fitted).map(|(g, l)| g * RowDVector::from_iterator(piece.len(), piece.iter().map(|p| share(l, *p)))).collect();
            let projected = project_out(reference.base, nuisance, &blocks);
            let one = |(j, &(along_m, across_m, half_width_m)): (usize, &(f64, f64, f64))| {
                if !projected.keeps_more_than(TOLD, j) {
                    return None;
                }
                let score = projected.score[j];
                let largest = projected.contributions.column(j).iter().map(|u| u * score.signum()).fold(0.0, f64::max);
                if largest > ONE_IMPACT * score.abs() {
                    return None;
                }
                let strength = score / projected.information[(j, j)];
                let spread = projected.spread(j, &[j], &DVector::from_element(1, strength), reference.c);
                let p_value = (ratio_tail(score * score / spread.variance / reference.c, 1.0, spread.freedom) * places.len() as f64).min(1.0);
                Some(LocalSpot { along_m, across_m, half_width_m, strength, gain: score * strength / reference.c, p_value })
            };
            piece.iter().enumerate().filter_map(one).collect::<Vec<_>>()
        })
        .collect();
    scored.into_iter().reduce(|best, s| if s.gain > best.gain { s } else { best })
}
