//! Scores and information of possible extra terms, with everything the fit can absorb projected out.
//!
//! For whitened signatures G_i of m extra terms, Gp = G − A (A'A + P)⁻¹ A'G; score U = Σ Gp_i' z_i (plus the prior's
//! share), information I = G'G − G'A (A'A + P)⁻¹ A'G (missing-physics.md, section 4). What is left of a signature is what
//! no base parameter and no offset of the session can imitate.

use super::error::ValidationError;
use super::fit::{Fit, invert};
use nalgebra::{DMatrix, DVector};

/// Projected scores of m terms.
#[derive(Debug, Clone)]
pub struct Projected {
    /// Score contributions: one row per impact, then one per prior residual.
    pub contributions: DMatrix<f64>,
    /// U, the column sums of `contributions`.
    pub score: DVector<f64>,
    /// I.
    pub information: DMatrix<f64>,
    /// Information of each term before projection: how much of it the nuisance absorbs.
    pub raw: DVector<f64>,
    /// Information each impact carries on each term: one row per impact.
    pub per_impact: DMatrix<f64>,
    /// What is left of each impact's signatures after projection.
    left: Vec<DMatrix<f64>>,
}

/// What is projected out: the fit's own columns, and more if asked.
#[derive(Debug, Clone)]
pub struct Nuisance {
    design: Vec<DMatrix<f64>>,
    covariance: DMatrix<f64>,
    prior_precision: DVector<f64>,
    prior_residual: DVector<f64>,
}

impl Nuisance {
    /// The columns of the fit.
    pub fn of(fit: &Fit) -> Self {
        Nuisance {
            design: fit.design.clone(),
            covariance: fit.covariance.clone(),
            prior_precision: fit.prior_precision.clone(),
            prior_residual: fit.prior_residual(),
        }
    }

    /// The columns of the fit and further whitened ones, each with a normal prior of zero mean and the precision given for its column.
    pub fn with_columns(fit: &Fit, extra: &[DMatrix<f64>], precision: impl Fn(usize) -> f64) -> Result<Self, ValidationError> {
        let more = extra.first().map_or(0, DMatrix::ncols);
        let p = fit.columns.len() + more;
        let prior_precision = DVector::from_fn(p, |i, _| if i < fit.columns.len() { fit.prior_precision[i] } else { precision(i - fit.columns.len()) });
        let own = fit.prior_residual();
        let mut information = DMatrix::from_diagonal(&prior_precision);
        let design: Vec<DMatrix<f64>> = fit
            .design
            .iter()
            .zip(extra)
            .map(|(a, e)| {
                let mut both = DMatrix::zeros(a.nrows(), p);
                both.columns_mut(0, a.ncols()).copy_from(a);
                both.columns_mut(a.ncols(), more).copy_from(e);
                both
            })
            .collect();
        for a in &design {
            add_cross(&mut information, a, a);
        }
        Ok(Nuisance {
            design,
            covariance: invert(&information)?,
            prior_precision,
            prior_residual: DVector::from_fn(p, |i, _| if i < own.len() { own[i] } else { 0.0 }),
        })
    }
}

/// Projects the whitened signatures, one outputs × m block per impact of the fit.
pub fn project(fit: &Fit, signatures: &[DMatrix<f64>]) -> Projected {
    project_out(fit, &Nuisance::of(fit), signatures)
}

/// As [`project`], with a nuisance of one's own.
pub fn project_out(fit: &Fit, nuisance: &Nuisance, signatures: &[DMatrix<f64>]) -> Projected {
    let m = signatures.first().map_or(0, DMatrix::ncols);
    let p = nuisance.prior_precision.len();
    let mut cross = DMatrix::zeros(p, m);
    let mut information = DMatrix::zeros(m, m);
    for (g, a) in signatures.iter().zip(&nuisance.design) {
        add_cross(&mut cross, a, g);
        add_cross(&mut information, g, g);
    }
    let raw = information.diagonal();
    let absorbed = &nuisance.covariance * &cross;
    information -= cross.tr_mul(&absorbed);
    let n = signatures.len();
    let mut contributions = DMatrix::zeros(n + p, m);
    let mut per_impact = DMatrix::zeros(n, m);
    let mut remaining = Vec::with_capacity(n);
    for (i, (g, a)) in signatures.iter().zip(&nuisance.design).enumerate() {
        let left = g - a * &absorbed;
        contributions.set_row(i, &left.tr_mul(&fit.impacts[i].z).transpose());
        for j in 0..m {
            per_impact[(i, j)] = left.column(j).norm_squared();
        }
        remaining.push(left);
    }
    for j in 0..p {
        let root = nuisance.prior_precision[j].sqrt();
        if root > 0.0 {
            contributions.set_row(n + j, &(absorbed.row(j) * (-root * nuisance.prior_residual[j])));
        }
    }
    let score = contributions.row_sum().transpose();
    Projected { contributions, score, information, raw, per_impact, left: remaining }
}

/// `sum += a'b`. Transposed first: the blocked product of large matrices is many times faster than row by row.
pub fn add_cross(sum: &mut DMatrix<f64>, a: &DMatrix<f64>, b: &DMatrix<f64>) {
    sum.gemm(1.0, &a.transpose(), b, 1.0);
}

impl Projected {
    /// What is left of an impact's signatures, outputs × terms.
    pub fn left(&self, impact: usize) -> &DMatrix<f64> {
        &self.left[impact]
    }

    /// The quadratic form of the terms `which`: their best joint gain in chi-square and the strengths that reach it.
    /// `None` when they cannot be told apart here (condition number above 1e6).
    pub fn joint(&self, which: &[usize]) -> Option<(f64, DVector<f64>)> {
        let d = which.len();
        let block = DMatrix::from_fn(d, d, |i, j| self.information[(which[i], which[j])]);
        let score = DVector::from_fn(d, |i, _| self.score[which[i]]);
        let root: Vec<f64> = (0..d).map(|i| block[(i, i)].max(1e-300).sqrt()).collect();
        let scaled = DMatrix::from_fn(d, d, |i, j| block[(i, j)] / (root[i] * root[j]));
        let eigen = scaled.clone().symmetric_eigen();
        let (low, high) = (eigen.eigenvalues.min(), eigen.eigenvalues.max());
        if !(low > 1e-6 * high) {
            return None;
        }
        let solution = scaled.cholesky()?.solve(&DVector::from_fn(d, |i, _| score[i] / root[i]));
        let strengths = DVector::from_fn(d, |i, _| solution[i] / root[i]);
        Some((strengths.dot(&score), strengths))
    }

    /// Cosine between two projected signatures: 1 means that nothing on these impacts tells them apart.
    pub fn cosine(&self, a: usize, b: usize) -> f64 {
        self.information[(a, b)] / (self.information[(a, a)] * self.information[(b, b)]).max(1e-300).sqrt()
    }

    /// Variance of one score at noise scale 1: the larger of I and its sandwich estimate, which stands wrong noise.
    ///
    /// The sandwich is taken about the fitted strengths of the terms `which`: a real effect carried by a few impacts must
    /// not count as their noise.
    pub fn variance(&self, term: usize, which: &[usize], strengths: &DVector<f64>, c: f64) -> f64 {
        let information = self.information[(term, term)];
        let (sum, squares) = self.per_impact.column(term).iter().fold((0.0, 0.0), |(s, q), v| (s + v, q + v * v));
        let effective = if squares > 0.0 { sum * sum / squares } else { 0.0 };
        if effective < 12.0 || c <= 0.0 {
            return information;
        }
        let sandwich: f64 = self
            .left
            .iter()
            .enumerate()
            .map(|(i, left)| {
                let own = left.column(term);
                let explained: f64 = which.iter().zip(strengths.iter()).map(|(&j, k)| k * own.dot(&left.column(j))).sum();
                (self.contributions[(i, term)] - explained).powi(2)
            })
            .sum::<f64>()
            * effective
            / (effective - 1.0);
        information.max(sandwich / c)
    }
}
