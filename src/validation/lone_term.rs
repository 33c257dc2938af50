//! Does one simple term explain what all smooth corrections together do not show?
//!
//! The structure test looks at a hundred directions at once, those that a mechanism of the game could have; what goes with something
//! else, say the sign of the spin, is none of them, and passes for noise however clear it is. So where that test finds nothing, every channel is tried with
//! every feature that a formula can be made of ([`super::expression_terms`]), one at a time: score U over the root of its impacts' own
//! squares, or of its information where that is larger. Over the root of its own squares a sum of independent symmetric numbers has no heavier
//! tails than a normal one, however unlike they are (Efron 1969), so that neither outliers nor wrongly stated noise raise an alarm. Corrected for the
//! number tried. A term that stands out joins the smooth corrections.

use super::expression_terms::{FEATURES, FeatureInputs, feature_inputs};
use super::fit::Fit;
use super::observation::{Observation, Observations};
use super::structure::{channels, effective, friction_slope};
use super::tails::normal_tail;
use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

/// Level of the test, corrected for the number of terms: what passes all other tests and is worth naming lies far beyond.
pub const TERM_LEVEL: f64 = 1e-4;
/// Least share of a term that the fit's own parameters and offsets must leave.
const LEAST_LEFT: f64 = 0.01;
/// Impacts that must carry a term, in effect.
const FEWEST: f64 = 12.0;

/// Channels: columns of [`channels`], some times the slip (or a component of it) relative to the approach, as a tangential restitution has it, or
/// times the place across the face, as an inertia has it; behind them the friction of the balls that slide.
const CHANNELS: [(Option<usize>, Option<Times>, &str); 20] = [
    (Some(0), None, "the impulse along the normal"),
    (Some(1), None, "the impulse along the slip"),
    (Some(2), None, "the impulse across the slip"),
    (Some(3), None, "the impulse along the racket"),
    (Some(4), None, "the impulse across the face"),
    (Some(1), Some(Times::Slip), "the tangential restitution"),
    (Some(3), Some(Times::SlipAlong), "the tangential restitution along the racket"),
    (Some(4), Some(Times::SlipAcross), "the tangential restitution across the face"),
    (Some(5), None, "the torque on the ball about the normal"),
    (Some(6), None, "the torque on the ball by the slip"),
    (Some(7), None, "the torque on the ball about the racket's long axis"),
    (Some(8), None, "the torque on the ball about the axis across the face"),
    (Some(9), None, "the push on the racket"),
    (Some(10), None, "the impulse on the racket along its axis"),
    (Some(11), None, "the impulse on the racket across the face"),
    (Some(12), None, "the torque on the racket about its long axis"),
    (Some(12), Some(Times::Across), "the racket's twist inertia"),
    (Some(13), None, "the torque on the racket about the axis across the face"),
    (Some(14), None, "the torque on the racket about the normal"),
    (None, None, "the friction"),
];

#[derive(Clone, Copy)]
enum Times {
    Slip,
    SlipAlong,
    SlipAcross,
    Across,
}

/// A term that stands out.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
#[serde(into = "TermInWords", try_from = "TermInWords")]
pub struct LoneTerm {
    channel: usize,
    feature: usize,
    /// Corrected for the number of terms tried.
    pub p_value: f64,
}

/// A term as files have it: numbers of rows of this build's tables would tell their readers nothing.
#[derive(Serialize, Deserialize)]
struct TermInWords {
    channel: String,
    /// As a formula has it.
    feature: String,
    words: String,
    p_value: f64,
}

impl From<LoneTerm> for TermInWords {
    fn from(term: LoneTerm) -> Self {
        let (channel, feature) = (CHANNELS[term.channel].2, FEATURES[term.feature].text);
        TermInWords { channel: channel.to_owned(), feature: feature.to_owned(), words: term.words(), p_value: term.p_value }
    }
}

impl TryFrom<TermInWords> for LoneTerm {
    type Error = String;

    fn try_from(term: TermInWords) -> Result<Self, String> {
        let channel = CHANNELS.iter().position(|c| c.2 == term.channel).ok_or_else(|| format!("no channel is named {:?}", term.channel))?;
        let feature = FEATURES.iter().position(|f| f.text == term.feature).ok_or_else(|| format!("no feature is written {:?}", term.feature))?;
        Ok(LoneTerm { channel, feature, p_value: term.p_value })
    }
}

impl LoneTerm {
    /// "the impulse along the normal changes with the spin about the racket's long axis".
    pub fn words(&self) -> String {
        format!("{} changes {}", CHANNELS[self.channel].2, FEATURES[self.feature].words)
    }

    /// Its whitened signature.
    pub fn signature(&self, fit: &Fit, observations: &Observations, impacts: &[&Observation]) -> Vec<DMatrix<f64>> {
        let features = features(fit, observations, impacts);
        let of = |(i, response): (usize, Vec<DVector<f64>>)| DMatrix::from_columns(&[&response[self.channel] * features[(i, self.feature)]]);
        responses(fit, observations, impacts).into_iter().enumerate().map(of).collect()
    }
}

/// Features of all impacts, one row each, standardised; one that does not vary, or is hardly more than noise, is all zero.
fn features(fit: &Fit, observations: &Observations, impacts: &[&Observation]) -> DMatrix<f64> {
    let n = impacts.len();
    let inputs = feature_inputs(fit, observations, impacts);
    let mut values = DMatrix::from_fn(n, FEATURES.len(), |i, f| (FEATURES[f].value)(&inputs[i]));
    for mut column in values.column_iter_mut() {
        let (mean, sd) = (column.mean(), column.variance().sqrt());
        let varies = sd > 1e-6 * (1e-3 + mean.abs());
        column.iter_mut().for_each(|v| *v = if varies && v.is_finite() { (*v - mean) / sd } else { 0.0 });
    }
    values
}

/// Whitened responses of each impact to a unit of each channel.
fn responses(fit: &Fit, observations: &Observations, impacts: &[&Observation]) -> Vec<Vec<DVector<f64>>> {
    let friction = friction_slope(fit);
    let of = |(i, (o, l)): (usize, (&&Observation, &super::linearise::Linearised))| {
        let gear = &observations.gear[o.gear];
        let all = channels(&o.without_unmeasured(&l.true_inputs), gear);
        let inputs = FeatureInputs::of(o, &l.true_inputs, gear);
        let (slip, [_, across]) = (inputs.slip(), inputs.place());
        let factor = |times: Option<Times>| match times {
            None => 1.0,
            Some(Times::Slip) => slip[0].hypot(slip[1]),
            Some(Times::SlipAlong) => slip[0],
            Some(Times::SlipAcross) => slip[1],
            Some(Times::Across) => across,
        };
        let of_column = |column: usize, times| DVector::from_iterator(l.measured.len(), l.measured.iter().map(|&k| all[(k, column)] * factor(times)));
        let response = |(column, times, _): (Option<usize>, Option<Times>, &str)| match (column, &friction) {
            (Some(column), _) => &l.whitener * of_column(column, times),
            (None, Some(slope)) => slope[i].clone(),
            (None, None) => DVector::zeros(l.z.len()),
        };
        CHANNELS.map(response).to_vec()
    };
    impacts.iter().zip(&fit.impacts).enumerate().map(of).collect()
}

/// The term that stands out most, if one does; `c` is the noise scale of all residuals.
pub fn lone_term(fit: &Fit, observations: &Observations, impacts: &[&Observation], c: f64) -> Option<LoneTerm> {
    let features = features(fit, observations, impacts);
    let responses = responses(fit, observations, impacts);
    let roots = fit.prior_precision.map(f64::sqrt);
    let prior = fit.prior_residual();
    // A'z of each impact: what a parameter's share of a term takes from its score.
    let told: Vec<DVector<f64>> = fit.design.iter().zip(&fit.impacts).map(|(a, l)| a.tr_mul(&l.z)).collect();
    let mut tried = 0usize;
    let mut most: Option<(f64, usize, usize)> = None;
    for channel in 0..CHANNELS.len() {
        let mut cross = DMatrix::zeros(fit.columns.len(), FEATURES.len());
        let sizes: Vec<f64> = responses.iter().map(|r| r[channel].norm_squared()).collect();
        let scores: Vec<f64> = responses.iter().zip(&fit.impacts).map(|(r, l)| r[channel].dot(&l.z)).collect();
        for (i, (r, a)) in responses.iter().zip(&fit.design).enumerate() {
            cross += a.tr_mul(&r[channel]) * features.row(i);
        }
        let absorbed = &fit.covariance * &cross;
        for feature in 0..FEATURES.len() {
            let value = features.column(feature);
            let raw: f64 = value.iter().zip(&sizes).map(|(f, s)| f * f * s).sum();
            let left = raw - cross.column(feature).dot(&absorbed.column(feature));
            let carried = effective(value.iter().zip(&sizes).map(|(f, s)| f * f * s));
            if !(raw > 0.0) || left < LEAST_LEFT * raw || carried < FEWEST {
                continue;
            }
            tried += 1;
            let taken = absorbed.column(feature);
            let of_impacts = (0..impacts.len()).map(|i| value[i] * scores[i] - taken.dot(&told[i]));
            let of_prior = (0..roots.len()).map(|j| -taken[j] * roots[j] * prior[j]);
            let (sum, squares) = of_impacts.chain(of_prior).fold((0.0, 0.0), |(s, q), u| (s + u, q + u * u));
            if !(squares > 0.0) {
                continue;
            }
            let z = sum.abs() / squares.max(c * left).sqrt();
            if most.is_none_or(|m| z > m.0) {
                most = Some((z, channel, feature));
            }
        }
    }
    let (z, channel, feature) = most?;
    let p_value = (2.0 * normal_tail(z) * tried as f64).min(1.0);
    (p_value < TERM_LEVEL).then_some(LoneTerm { channel, feature, p_value })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_term_is_read_back_from_its_words() {
        let term = LoneTerm { channel: 6, feature: 3, p_value: 1e-9 };
        let json = serde_json::to_string(&term).expect("JSON");
        assert!(json.contains("the tangential restitution along the racket") && json.contains("with the inverse of the approach speed"), "{json}");
        let back: LoneTerm = serde_json::from_str(&json).expect("a term");
        assert_eq!((back.channel, back.feature), (6, 3));
        let why = serde_json::from_str::<LoneTerm>(&json.replace("along the racket", "up")).expect_err("no term").to_string();
        assert!(why.contains("no channel is named"), "{why}");
    }

    /// Two terms of one name could not be told apart in a file.
    #[test]
    fn every_channel_and_feature_has_a_name_of_its_own() {
        let mut names: Vec<&str> = CHANNELS.iter().map(|c| c.2).chain(FEATURES.iter().map(|f| f.text)).collect();
        let all = names.len();
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), all);
    }
}
