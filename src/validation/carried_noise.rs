//! How much more of the inputs' noise a prediction carries in one fit than in another.
//!
//! Residuals are weighed with the noise that they hold, that of the inputs through the model among it. A formula steep enough in an input that hardly
//! varies beyond its noise lets its own noise stand for what the model misses: residuals weighed so fall, while predictions get worse.

use super::fit::Fit;
use super::observation::Observation;
use crate::impact_table::OUTPUTS;

/// The largest factor, over all outputs, by which the variance of a prediction and its measurement together grows from `before` to `after`. What nobody
/// measured does not count.
pub fn noise_grows_by(before: &Fit, after: &Fit, impacts: &[&Observation]) -> f64 {
    let of = |fit: &Fit| {
        let mut variances = [0.0; OUTPUTS.len()];
        for (o, l) in impacts.iter().zip(&fit.impacts) {
            for (row, &output) in l.measured.iter().enumerate() {
                let known = (0..o.inputs.len()).filter(|j| !o.missing[*j]);
                let carried: f64 = known.map(|j| (l.jacobian[(row, j)] * o.input_sd[j]).powi(2)).sum();
                variances[output] += o.output_sd[row].powi(2) + carried;
            }
        }
        variances
    };
    of(before).iter().zip(of(after)).filter(|(b, _)| **b > 0.0).map(|(b, a)| a / b).fold(0.0, f64::max)
}
