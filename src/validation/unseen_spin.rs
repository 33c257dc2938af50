//! A spin that nobody measured, neither before nor after the impact.
//!
//! Where the ball's spin after the impact was measured it tells the one before ([`super::linearise`]). Where it was not,
//! what is left open of the spin decides whether the ball slides, and no slope tells that: the prediction is then the mean over
//! the spins of play, and what they scatter it by is noise that all its outputs share.

use super::forward::Outputs;
use super::observation::Observation;
use crate::impact_table::{INPUTS, OUTPUTS};
use nalgebra::{DMatrix, DVector};

/// Spins tried per impact, and for the slopes with its inputs.
pub const TRIED: usize = 16;
pub const TRIED_FOR_SLOPES: usize = 4;
/// First spin component among the inputs, and the first after the impact among the outputs.
pub(super) const SPIN_IN: usize = 3;
const SPIN_OUT: usize = 3;

/// Whether an impact's spin in the face is open: a component before the impact was not measured, nor any after it.
pub fn is_open(missing: &[bool; INPUTS.len()], measured: &[usize]) -> bool {
    debug_assert!(INPUTS[SPIN_IN] == "ball_in_wx" && OUTPUTS[SPIN_OUT] == "ball_out_wx");
    missing[SPIN_IN..SPIN_IN + 2].contains(&true) && !measured.iter().any(|k| (SPIN_OUT..SPIN_OUT + 2).contains(k))
}

/// `tried` spins of an impact, rad/s, in pairs that cancel: evenly through a normal distribution of the two components
/// in the face, turned from impact to impact, so that all impacts together are spread more evenly still. Components that
/// were measured stay at 0.
pub fn spins(o: &Observation, tried: usize) -> impl Iterator<Item = [f64; 2]> + '_ {
    /// Angle between points that fill a disc evenly, rad.
    const GOLDEN: f64 = 2.399_963_229_728_653;
    let pairs = tried / 2;
    (0..pairs).flat_map(move |k| {
        // Radius of equal shares of the plane's normal distribution (Rayleigh's quantiles).
        let radius = (-2.0 * (1.0 - (k as f64 + 0.5) / pairs as f64).ln()).sqrt();
        let angle = GOLDEN * (k as f64 + 1.0 + 0.37 * o.order);
        let of = |j: usize, v: f64| if o.missing[SPIN_IN + j] { radius * v * o.open_spin_sd[j] } else { 0.0 };
        let spin = [of(0, angle.cos()), of(1, angle.sin())];
        [spin, spin.map(|w| -w)]
    })
}

/// The inputs with a spin tried.
pub fn with_spin(mut inputs: [f64; INPUTS.len()], spin: [f64; 2]) -> [f64; INPUTS.len()] {
    inputs[SPIN_IN] += spin[0];
    inputs[SPIN_IN + 1] += spin[1];
    inputs
}

/// Mean of the measured outputs with all spins tried. `None` where the model has no answer for one of them.
pub fn mean(o: &Observation, predictions: &[Option<Outputs>]) -> Option<DVector<f64>> {
    let mut sum = (*predictions.first()?)?;
    for p in &predictions[1..] {
        sum.iter_mut().zip(p.as_ref()?).for_each(|(sum, v)| *sum += v);
    }
    o.measured_of(&sum.map(|sum| sum / predictions.len() as f64))
}

/// Their covariance.
pub fn covariance(o: &Observation, predictions: &[Option<Outputs>]) -> Option<DMatrix<f64>> {
    let mean = mean(o, predictions)?;
    let mut covariance = DMatrix::zeros(mean.len(), mean.len());
    for p in predictions.iter().flatten() {
        let off = o.measured_of(p)? - &mean;
        covariance.ger(1.0 / predictions.len() as f64, &off, &off, 1.0);
    }
    Some(covariance)
}
