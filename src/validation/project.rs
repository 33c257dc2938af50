//! Scores and information of possible extra terms, with everything the fit can absorb projected out.
//!
//! For whitened signatures G_i of m extra terms, Gp = G − A (A'A + P)⁻¹ A'G; score U = Σ Gp_i' z_i (plus the prior's
//! share), information I = G'G − G'A (A'A + P)⁻¹ A'G (docs/diagnosis.md, "In formulas", nuisance and score). What is left of a signature is what
//! no base parameter and no offset of the session can imitate.

use super::error::ValidationError;
use super::fit::{Fit, invert};
use super::structure::effective;
use crate::impact_table::OUTPUTS;
use nalgebra::{DMatrix, DVector};

/// Impacts that must carry a score, in effect, for their own scatter to tell its variance.
const ENOUGH_FOR_SANDWICH: f64 = 12.0;

/// Share of a term's own information that must be left after projection for its strength to be told.
pub(super) const TOLD: f64 = 1e-4;
/// The least information that a share is taken of: a term that no impact carries is not told by what rounding leaves of it.
const LEAST_INFORMATION: f64 = 1e-12;

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
    /// Whitened residuals of each impact, and which outputs they are.
    residuals: Vec<(DVector<f64>, Vec<usize>)>,
}

/// Variance of a score at noise scale 1, and the degrees of freedom it is known from: infinite when it is the information.
#[derive(Debug, Clone, Copy)]
pub struct Spread {
    pub variance: f64,
    pub freedom: f64,
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
        let design: Vec<DMatrix<f64>> = fit.design.iter().zip(extra).map(|(a, e)| beside(a, e)).collect();
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
    let residuals = fit.impacts.iter().map(|l| (l.z.clone(), l.measured.clone())).collect();
    Projected { contributions, score, information, raw, per_impact, left: remaining, residuals }
}

/// Two blocks of columns in one.
pub(super) fn beside(a: &DMatrix<f64>, b: &DMatrix<f64>) -> DMatrix<f64> {
    let mut both = a.clone().resize_horizontally(a.ncols() + b.ncols(), 0.0);
    both.columns_mut(a.ncols(), b.ncols()).copy_from(b);
    both
}

/// `sum += a'b`. Transposed first: the blocked product of large matrices is many times faster than row by row.
pub fn add_cross(sum: &mut DMatrix<f64>, a: &DMatrix<f64>, b: &DMatrix<f64>) {
    sum.gemm(1.0, &a.transpose(), b, 1.0);
}

impl Projected {
    /// Whether more than a share of a term's own information is left after projection.
    pub fn keeps_more_than(&self, share: f64, term: usize) -> bool {
        self.information[(term, term)] > share * self.raw[term].max(LEAST_INFORMATION)
    }

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

    /// Spread of one score: the larger of I and its sandwich estimate, which stands wrong noise.
    ///
    /// The sandwich is taken about the fitted strengths of the terms `which`: a real effect carried by a few impacts must
    /// not count as their noise. The scatter of few impacts says little about itself; there that of all impacts stands in
    /// (balls that rebound differently scatter along the normal more than stated, wherever they hit), and its degrees of freedom count. (Those of
    /// the sandwich do not: with them a law of friction of twelve deviations was lost.)
    pub fn spread(&self, term: usize, which: &[usize], strengths: &DVector<f64>, c: f64) -> Spread {
        let known = Spread { variance: self.information[(term, term)], freedom: f64::INFINITY };
        if c <= 0.0 {
            return known;
        }
        let effective = effective(self.per_impact.column(term).iter().copied());
        let seen = if effective < ENOUGH_FOR_SANDWICH {
            Spread { variance: self.pooled_variance(term, which, strengths) / c, freedom: self.left.len() as f64 - 1.0 }
        } else {
            let about_fitted = |(i, left): (usize, &DMatrix<f64>)| {
                let own = left.column(term);
                let explained: f64 = which.iter().zip(strengths.iter()).map(|(&j, k)| k * own.dot(&left.column(j))).sum();
                (self.contributions[(i, term)] - explained).powi(2)
            };
            let sandwich: f64 = self.left.iter().enumerate().map(about_fitted).sum();
            Spread { variance: sandwich * effective / (effective - 1.0) / c, freedom: f64::INFINITY }
        };
        if seen.variance > known.variance { seen } else { known }
    }

    /// Variance of one score when the residuals of every impact scatter like those of all, about the fitted strengths.
    fn pooled_variance(&self, term: usize, which: &[usize], strengths: &DVector<f64>) -> f64 {
        let mut products = [[0.0; OUTPUTS.len()]; OUTPUTS.len()];
        let mut pairs = [[0.0; OUTPUTS.len()]; OUTPUTS.len()];
        for (left, (z, measured)) in self.left.iter().zip(&self.residuals) {
            let mut own = z.clone();
            for (&j, k) in which.iter().zip(strengths.iter()) {
                own.axpy(-k, &left.column(j), 1.0);
            }
            for (a, &k) in measured.iter().enumerate() {
                for (b, &l) in measured.iter().enumerate() {
                    products[k][l] += own[a] * own[b];
                    pairs[k][l] += 1.0;
                }
            }
        }
        self.left
            .iter()
            .zip(&self.residuals)
            .map(|(left, (_, measured))| {
                let own = left.column(term);
                let along = |(a, &k): (usize, &usize)| -> f64 {
                    let across = |(b, &l): (usize, &usize)| own[b] * products[k][l] / (pairs[k][l] - 1.0f64).max(1.0);
                    own[a] * measured.iter().enumerate().map(across).sum::<f64>()
                };
                measured.iter().enumerate().map(along).sum::<f64>()
            })
            .sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng, SeedableRng};

    /// 60 impacts of two outputs of which the first scatters three times as much as stated; four impacts carry a term along each.
    fn balls_that_rebound_differently() -> Projected {
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(7);
        let mut normal = || (0..12).map(|_| random.random::<f64>()).sum::<f64>() - 6.0;
        let carries = |i: usize| if i < 4 { 1.0 } else { 0.0 };
        let left: Vec<_> = (0..60).map(|i| DMatrix::from_diagonal_element(2, 2, carries(i))).collect();
        let residuals: Vec<_> = (0..60).map(|_| (DVector::from_vec(vec![3.0 * normal(), normal()]), vec![2, 8])).collect();
        let contributions = DMatrix::from_fn(60, 2, |i, j| carries(i) * residuals[i].0[j]);
        Projected {
            score: contributions.row_sum().transpose(),
            information: DMatrix::from_diagonal_element(2, 2, 4.0),
            raw: DVector::from_element(2, 4.0),
            per_impact: DMatrix::from_fn(60, 2, |i, _| carries(i)),
            contributions,
            left,
            residuals,
        }
    }

    #[test]
    fn truth_few_impacts_are_judged_by_the_scatter_of_all() {
        let projected = balls_that_rebound_differently();
        let none = DVector::zeros(1);
        let wide = projected.spread(0, &[0], &none, 1.0);
        assert!((wide.variance / 4.0 / 9.0 - 1.0).abs() < 0.5 && wide.freedom == 59.0, "{wide:?}");
        let stated = projected.spread(1, &[1], &none, 1.0);
        assert!((stated.variance / 4.0 - 1.0).abs() < 0.5, "{stated:?}");
        // What the term explains is no scatter.
        let mut effect = projected.clone();
        effect.residuals.iter_mut().take(4).for_each(|(z, _)| z[1] += 20.0);
        assert!((effect.spread(1, &[1], &DVector::from_element(1, 20.0), 1.0).variance / stated.variance - 1.0).abs() < 0.05);
    }
}
