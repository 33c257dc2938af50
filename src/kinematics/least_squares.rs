//! Nonlinear least squares with priors: Levenberg-Marquardt on a manifold, covariance and evidence at the minimum.

use nalgebra::{DMatrix, DVector};

/// A problem whose residuals are already divided by their standard deviations (prior rows included).
pub(crate) trait Problem {
    type State: Clone;
    /// Length of a step; also the natural size of each of its parts, so that steps are of order one.
    fn scales(&self) -> Vec<f64>;
    /// The state after a step (in the units of the state, not scaled).
    fn moved(&self, state: &Self::State, step: &DVector<f64>) -> Self::State;
    /// Whitened residuals; `None` where the state cannot be seen (a point behind a camera).
    fn residuals(&self, state: &Self::State) -> Option<DVector<f64>>;
}

/// The minimum: state, covariance of a step from it, cost (sum of squares) and log-determinant of the information.
#[derive(Debug, Clone)]
pub(crate) struct Solution<S> {
    pub state: S,
    pub covariance: DMatrix<f64>,
    /// Sum of squared whitened residuals.
    pub cost: f64,
    pub ln_det_information: f64,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub(crate) enum SolveError {
    #[error("the starting values project outside both cameras")]
    Start,
    #[error("the points do not determine the motion (singular normal equations)")]
    Singular,
}

/// P(χ²₃ > x) = erfc(√(x/2)) + √(2x/π) e^(−x/2).
pub(crate) fn chi2_tail_3(x: f64) -> f64 {
    let x = x.max(0.0);
    statrs::function::erf::erfc((0.5 * x).sqrt()) + (2.0 * x / std::f64::consts::PI).sqrt() * (-0.5 * x).exp()
}

/// Probabilities of rival laws, the likeliest first, from the logarithms of their evidence.
pub(crate) fn probabilities(ln_evidence: impl Iterator<Item = f64> + Clone) -> Vec<f64> {
    let best = ln_evidence.clone().next().unwrap_or(0.0);
    let weights: Vec<f64> = ln_evidence.map(|ln| (ln - best).exp()).collect();
    let total: f64 = weights.iter().sum();
    weights.iter().map(|w| w / total).collect()
}

const MOST_STEPS: usize = 60;

/// Minimises; derivatives are central differences of 1e-4 of the natural size (the projection is smooth: the error of
/// a difference is 1e-8 of the residual's curvature).
pub(crate) fn solve<P: Problem>(problem: &P, start: P::State) -> Result<Solution<P::State>, SolveError> {
    let scales = problem.scales();
    let mut state = start;
    let mut residuals = problem.residuals(&state).ok_or(SolveError::Start)?;
    let mut cost = residuals.norm_squared();
    let mut damping = 1e-6;
    let mut jacobian = differences(problem, &state, &residuals, &scales);
    for _ in 0..MOST_STEPS {
        let information = jacobian.tr_mul(&jacobian);
        let gradient = jacobian.tr_mul(&residuals);
        let mut damped = information.clone();
        for i in 0..scales.len() {
            damped[(i, i)] += damping * (information[(i, i)] + 1e-9);
        }
        let Some(factor) = damped.cholesky() else {
            damping *= 100.0;
            if damping > 1e12 {
                return Err(SolveError::Singular);
            }
            continue;
        };
        let scaled = -factor.solve(&gradient);
        let step = scaled.component_mul(&DVector::from_column_slice(&scales));
        let next = problem.moved(&state, &step);
        match problem.residuals(&next) {
            Some(r) if r.norm_squared() <= cost => {
                let gain = cost - r.norm_squared();
                state = next;
                cost = r.norm_squared();
                residuals = r;
                damping = (damping * 0.1).max(1e-12);
                jacobian = differences(problem, &state, &residuals, &scales);
                // The last step's gain and length, in units of χ²: far below one standard deviation, and the next step of a
                // quadratically converging method is far shorter still.
                if gain < 1e-4 && scaled.dot(&(&information * &scaled)) < 1e-4 {
                    break;
                }
            }
            _ => {
                damping *= 10.0;
                if damping > 1e12 {
                    break; // no step goes down: the minimum, to rounding
                }
            }
        }
    }
    let information = jacobian.tr_mul(&jacobian);
    let factor = information.cholesky().ok_or(SolveError::Singular)?;
    let diagonal = factor.l_dirty().diagonal();
    if diagonal.min() < 1e-10 * diagonal.max() {
        return Err(SolveError::Singular);
    }
    let mut covariance = factor.inverse();
    let mut ln_det_information = 2.0 * diagonal.map(f64::ln).sum();
    for i in 0..scales.len() {
        ln_det_information -= 2.0 * scales[i].ln();
        for j in 0..scales.len() {
            covariance[(i, j)] *= scales[i] * scales[j];
        }
    }
    Ok(Solution { state, covariance, cost, ln_det_information })
}

fn differences<P: Problem>(problem: &P, state: &P::State, residuals: &DVector<f64>, scales: &[f64]) -> DMatrix<f64> {
    let mut jacobian = DMatrix::zeros(residuals.len(), scales.len());
    for (k, scale) in scales.iter().enumerate() {
        let h = 1e-4;
        let mut step = DVector::zeros(scales.len());
        step[k] = h * scale;
        let ahead = problem.residuals(&problem.moved(state, &step));
        step[k] = -h * scale;
        let behind = problem.residuals(&problem.moved(state, &step));
        let column = match (ahead, behind) {
            (Some(a), Some(b)) => (a - b) / (2.0 * h),
            (Some(a), None) => (a - residuals) / h,
            (None, Some(b)) => (residuals - b) / h,
            (None, None) => continue,
        };
        jacobian.set_column(k, &column);
    }
    jacobian
}
