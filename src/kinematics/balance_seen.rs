//! Where a session's free flights put the racket's centre of mass.
//!
//! A balance point is read on a ruler, on the handle's axis, before tape, damper and a new grip; and the axes are those of
//! tape on the frame. A racket thrown off by the ball turns about its true centre of mass, so that a point 3 mm away goes
//! round at 15 rad/s with 0.7 m/s², and at 100 rad/s about the handle a tenth of a millimetre does as much. Every shot with the
//! racket shows the same three numbers.

use super::racket_motion::MotionEstimate;
use nalgebra::{Matrix3, Vector3};
use serde::Serialize;

/// How far off a balance point is expected to be, m per axis.
const EXPECTED_M: f64 = 0.002;
/// A flight counts when the racket was free in it rather than held.
const FREE: f64 = 0.5;

/// The centre of mass from the stated balance point, body axes, m.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct BalanceSeen {
    pub shift_m: Vector3<f64>,
    /// One deviation per axis.
    pub sd_m: Vector3<f64>,
    /// Free flights it was seen in.
    pub flights: usize,
}

impl BalanceSeen {
    /// Before anything was seen.
    pub fn expected() -> Self {
        BalanceSeen { shift_m: Vector3::zeros(), sd_m: Vector3::repeat(EXPECTED_M), flights: 0 }
    }

    /// From motions after contact that were fitted with [`BalanceSeen::expected`].
    pub fn of<'a>(motions: impl IntoIterator<Item = &'a MotionEstimate>) -> Self {
        let prior = Matrix3::from_diagonal_element(EXPECTED_M.powi(-2));
        let flights: Vec<(Vector3<f64>, Matrix3<f64>)> = motions
            .into_iter()
            .filter_map(|m| m.lever.as_ref())
            .filter(|l| l.probability > FREE)
            .filter_map(|l| {
                let posterior = l.covariance.try_inverse()?;
                // What the flight alone says: its own information, without the prior that every one of them was given.
                Some((posterior * l.lever, posterior - prior))
            })
            .collect();
        let mean = |weights: &[f64]| {
            let mut information = prior;
            let mut pull = Vector3::zeros();
            for ((p, i), w) in flights.iter().zip(weights) {
                information += i * *w;
                pull += p * *w;
            }
            Some((information.cholesky()?.solve(&pull), information))
        };
        // Flights that disagree with the others by more than they state (a hand brushed the racket) lose weight.
        let mut weights = vec![1.0; flights.len()];
        let mut found = None;
        for _ in 0..ROUNDS {
            found = mean(&weights);
            let Some((shift, _)) = found else { break };
            for ((p, i), w) in flights.iter().zip(&mut weights) {
                let off = p - i * shift;
                let squared = i.try_inverse().map_or(0.0, |c| off.dot(&(c * off))).max(0.0);
                *w = WEIGHT_OF / (WEIGHT_OF + squared);
            }
        }
        let Some((shift, information)) = found else { return Self::expected() };
        let Some(covariance) = information.try_inverse() else { return Self::expected() };
        BalanceSeen { shift_m: shift, sd_m: covariance.diagonal().map(f64::sqrt), flights: flights.len() }
    }
}

/// Rounds of weighing flights by their distance from the mean, and the squared distance (of three numbers) that halves a weight.
const ROUNDS: usize = 4;
const WEIGHT_OF: f64 = 9.0;
