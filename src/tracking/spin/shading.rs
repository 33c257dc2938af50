//! Light on the ball: a smooth pattern that stays with the camera while the markings turn under it.

use super::view::{Sample, ViewInfo};
use crate::tracking::lanes::{LANES, Lanes};
use nalgebra::{SMatrix, SVector, Vector3};

/// Harmonics up to order 3 of the normal, the constant left out (a view's gain takes it). A matt ball under any lights
/// is held by order 2 to about 1 % (Basri and Jacobs 2003; Ramamoorthi and Hanrahan 2001); order 3 takes glints.
const TERMS: usize = 15;

fn terms(n: &Vector3<f64>) -> [f64; TERMS] {
    let (x, y, z) = (n.x, n.y, n.z);
    let zz = z - 0.7; // the used part of the disc has z near 0.5 to 1: keeps the terms apart
    [
        x,
        y,
        zz,
        x * y,
        x * zz,
        y * zz,
        x * x - y * y,
        zz * zz,
        x * (x * x - 3.0 * y * y),
        y * (3.0 * x * x - y * y),
        x * y * zz,
        zz * (x * x - y * y),
        x * zz * zz,
        y * zz * zz,
        zz * zz * zz,
    ]
}

/// One pixel with gain and smooth shading divided out: `contrast` is −0.4 on a line that reflects 60 % of the felt's light.
#[derive(Debug, Clone, Copy)]
pub(super) struct Mark {
    pub view: usize,
    pub normal: Vector3<f64>,
    pub disc: Vector3<f64>,
    pub contrast: f64,
    /// Relative information: (gain × shading)², mean 1 over all pixels.
    pub weight: f64,
}

/// Contrasts beyond these are no pen marks but things in front of the ball; they are clipped so that they pull less.
const DARKEST: f64 = -0.8;
const BRIGHTEST: f64 = 0.5;

/// Fitted shading per camera: relative brightness over the disc.
#[derive(Debug, Clone)]
pub(super) struct Shading {
    /// Constant, then the harmonics; empty when too few pixels.
    coefficients: [Vec<f64>; 2],
}

impl Shading {
    /// Brightness relative to the view's gain at a place on the disc.
    pub fn at(&self, camera: crate::calibration::CameraId, disc: &Vector3<f64>) -> f64 {
        match self.coefficients[camera.index()].split_first() {
            Some((constant, rest)) => (constant + terms(disc).iter().zip(rest).map(|(t, c)| t * c).sum::<f64>()).max(0.05),
            None => 1.0,
        }
    }
}

/// Divides out one gain per view and one shading pattern per camera; robust against marks and things in front. Pixels at white have no mark
/// of their own, but the shading is at least as bright there: of an overexposed cap only the lines would be left, and taken for the felt.
///
/// `markings`: contrast of the markings at every pixel as a first registration found it, or nothing yet.
pub(super) fn divide_out(views: &[ViewInfo], samples: &[Sample], markings: Option<&[f32]>) -> (Shading, Vec<Mark>) {
    let mut per_view: Vec<Vec<usize>> = vec![Vec::new(); views.len()];
    for (i, s) in samples.iter().enumerate() {
        per_view[s.view].push(i);
    }
    // Grey of the felt as it would be without markings.
    let felt: Vec<f64> = match markings {
        Some(m) => samples.iter().zip(m).map(|(s, m)| s.grey / (1.0 + f64::from(*m)).max(0.2)).collect(),
        None => samples.iter().map(|s| s.grey).collect(),
    };
    // Gain: the median over the disc.
    let gains: Vec<f64> = per_view.iter().map(|own| f64::from(median(own.iter().map(|&i| felt[i] as f32).collect())).max(1.0)).collect();
    let mut shading = Shading { coefficients: [Vec::new(), Vec::new()] };
    for camera in crate::calibration::CameraId::BOTH {
        let mut own: Vec<usize> = (0..samples.len()).filter(|&i| views[samples[i].view].camera == camera).collect();
        if own.len() < 10 * UNKNOWNS {
            continue;
        }
        let step = (own.len() / ENOUGH).max(1);
        own = own.into_iter().step_by(step).collect();
        let harmonics = Harmonics::of(own.iter().map(|&i| factors(1.0, &samples[i].disc)));
        let values: Vec<f32> = own.iter().map(|&i| (felt[i] / gains[samples[i].view]) as f32).collect();
        let mut weights = vec![1.0f32; own.len()];
        let white: Vec<bool> = own.iter().map(|&i| samples[i].is_white()).collect();
        let rounds = if white.contains(&true) { 2 * ROUNDS } else { ROUNDS };
        for _ in 0..rounds {
            let Some(solution) = harmonics.least_squares(&values, &weights, 1e-6) else { break };
            let misses: Vec<f32> = values.iter().zip(&harmonics.sums(&solution)).map(|(v, sum)| v - sum).collect();
            let sizes: Vec<f32> = misses.iter().map(|m| m.abs()).collect();
            let scale = 1.5 * median_of_sizes(&sizes).max(1e-3);
            for ((weight, miss), white) in weights.iter_mut().zip(&misses).zip(&white) {
                let square = (miss / (2.0 * scale)) * (miss / (2.0 * scale));
                *weight = if *white && *miss < 0.0 { 0.0 } else { 1.0 / ((1.0 + square) * (1.0 + square)) };
            }
            shading.coefficients[camera.index()] = solution.map(f64::from).to_vec();
        }
    }
    let mut marks: Vec<Mark> = samples
        .iter()
        .filter(|s| !s.is_white())
        .map(|s| {
            let bright = gains[s.view] * shading.at(views[s.view].camera, &s.disc);
            Mark { view: s.view, normal: s.normal, disc: s.disc, contrast: (s.grey / bright - 1.0).clamp(DARKEST, BRIGHTEST), weight: bright * bright }
        })
        .collect();
    let mean = marks.iter().map(|m| m.weight).sum::<f64>() / marks.len().max(1) as f64;
    for m in &mut marks {
        m.weight /= mean.max(1e-12);
    }
    (shading, marks)
}

/// Rounds in which what is no felt loses its weight.
const ROUNDS: usize = 4;
/// So many pixels tell a camera's shading; fewer make spins of seven frames worse.
const ENOUGH: usize = 4000;
const UNKNOWNS: usize = TERMS + 1;

/// A constant and the harmonics at one place of the disc.
pub(super) type Factors = [f32; UNKNOWNS];

pub(super) fn factors(constant: f32, disc: &Vector3<f64>) -> Factors {
    let t = terms(disc);
    std::array::from_fn(|k| if k == 0 { constant } else { t[k - 1] as f32 })
}

/// Equations whose products are summed in single precision.
const SINGLY: usize = 16 * LANES;

/// Values of so many pixels, [`LANES`] side by side.
type Column = [[f32; LANES]; SINGLY / LANES];

/// The harmonics at many places, each harmonic's values side by side; nothing beyond the last place.
#[derive(Default)]
pub(super) struct Harmonics {
    places: usize,
    columns: Vec<[Column; UNKNOWNS]>,
}

impl Harmonics {
    pub fn of(factors: impl Iterator<Item = Factors>) -> Self {
        let mut all = Harmonics::default();
        for factors in factors {
            let at = all.places % SINGLY;
            if at == 0 {
                all.columns.push([[[0.0; LANES]; SINGLY / LANES]; UNKNOWNS]);
            }
            if let Some(columns) = all.columns.last_mut() {
                columns.iter_mut().zip(factors).for_each(|(column, factor)| column[at / LANES][at % LANES] = factor);
            }
            all.places += 1;
        }
        all
    }

    /// Coefficients that explain weighted values best; `prior` is the precision of each about 0.
    pub fn least_squares(&self, values: &[f32], weights: &[f32], prior: f64) -> Option<Factors> {
        let mut normal = SMatrix::<f64, UNKNOWNS, UNKNOWNS>::identity() * prior;
        let mut right = SVector::<f64, UNKNOWNS>::zeros();
        for ((columns, values), weights) in self.columns.iter().zip(values.chunks(SINGLY)).zip(weights.chunks(SINGLY)) {
            let (sums, products) = pulp::Arch::new().dispatch(Products { columns, values, weights });
            for i in 0..UNKNOWNS {
                for j in 0..UNKNOWNS {
                    normal[(i, j)] += f64::from(sums[i][j]);
                }
                right[i] += f64::from(products[i]);
            }
        }
        let solution: [f64; UNKNOWNS] = normal.cholesky()?.solve(&right).into();
        Some(solution.map(|x| x as f32))
    }

    /// What coefficients make of every place.
    pub fn sums(&self, coefficients: &Factors) -> Vec<f32> {
        let mut out: Vec<f32> = Vec::with_capacity(self.columns.len() * SINGLY);
        for columns in &self.columns {
            pulp::Arch::new().dispatch(Weighted { columns, coefficients }).iter().for_each(|lanes| out.extend_from_slice(&lanes.0));
        }
        out.truncate(self.places);
        out
    }
}

struct Weighted<'a> {
    columns: &'a [Column; UNKNOWNS],
    coefficients: &'a Factors,
}

impl pulp::NullaryFnOnce for Weighted<'_> {
    type Output = [Lanes; SINGLY / LANES];

    #[inline(always)]
    fn call(self) -> Self::Output {
        std::array::from_fn(|at| {
            let mut sum = Lanes::ZERO;
            for (column, coefficient) in self.columns.iter().zip(self.coefficients) {
                sum = sum.plus_times(&column[at], *coefficient);
            }
            sum
        })
    }
}

/// Columns whose sums are taken side by side, so that none waits for the last one's.
const TOGETHER: usize = 4;

#[inline(always)]
fn dots(weighted: &Column, columns: [&Column; TOGETHER]) -> [f32; TOGETHER] {
    let [mut a, mut b, mut c, mut d] = [Lanes::ZERO; TOGETHER];
    for at in 0..SINGLY / LANES {
        let weighted = &weighted[at];
        a = a.plus_products(weighted, &columns[0][at]);
        b = b.plus_products(weighted, &columns[1][at]);
        c = c.plus_products(weighted, &columns[2][at]);
        d = d.plus_products(weighted, &columns[3][at]);
    }
    [a, b, c, d].map(Lanes::total)
}

struct Products<'a> {
    columns: &'a [Column; UNKNOWNS],
    values: &'a [f32],
    weights: &'a [f32],
}

impl pulp::NullaryFnOnce for Products<'_> {
    type Output = ([Factors; UNKNOWNS], Factors);

    /// Up to [`SINGLY`] equations, [`LANES`] side by side.
    #[inline(always)]
    fn call(self) -> Self::Output {
        let side_by_side = |from: &[f32]| {
            let mut to: Column = [[0.0; LANES]; SINGLY / LANES];
            to.as_flattened_mut().iter_mut().zip(from).for_each(|(to, from)| *to = *from);
            to
        };
        let (values, weights) = (side_by_side(self.values), side_by_side(self.weights));
        let (mut sums, mut products) = ([[0.0f32; UNKNOWNS]; UNKNOWNS], [0.0f32; UNKNOWNS]);
        let mut weighted: Column = [[0.0; LANES]; SINGLY / LANES];
        for i in 0..UNKNOWNS {
            let both = self.columns[i].as_flattened().iter().zip(weights.as_flattened());
            weighted.as_flattened_mut().iter_mut().zip(both).for_each(|(weighted, (column, weight))| *weighted = column * weight);
            for first in (i / TOGETHER * TOGETHER..UNKNOWNS).step_by(TOGETHER) {
                let some = dots(&weighted, std::array::from_fn(|k| &self.columns[first + k]));
                for (k, sum) in some.into_iter().enumerate() {
                    (sums[i][first + k], sums[first + k][i]) = (sum, sum);
                }
            }
            [products[i], ..] = dots(&weighted, [&values; TOGETHER]);
        }
        (sums, products)
    }
}

/// Median; 0 of nothing.
fn median(mut x: Vec<f32>) -> f32 {
    if x.is_empty() {
        return 0.0;
    }
    let mid = x.len() / 2;
    *x.select_nth_unstable_by(mid, f32::total_cmp).1
}

/// Leading bits by which values are sorted: exponent and four bits more, a sixteenth of an octave.
const LEADING: u32 = 12;

/// Median of values that are not negative; 0 of nothing. Such numbers rank as their bits do.
pub(super) fn median_of_sizes(x: &[f32]) -> f32 {
    let leading = |v: &f32| (v.to_bits() << 1 >> (32 - LEADING)) as usize;
    let mut counts = [0usize; 1 << LEADING];
    x.iter().for_each(|v| counts[leading(v)] += 1);
    let (mid, mut below) = (x.len() / 2, 0);
    for (k, count) in counts.iter().enumerate() {
        if below + count > mid {
            let mut alike: Vec<f32> = x.iter().copied().filter(|v| leading(v) == k).collect();
            return *alike.select_nth_unstable_by(mid - below, f32::total_cmp).1;
        }
        below += count;
    }
    0.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn agrees_with_the_median_of_sorted_values() {
        for n in [0usize, 1, 2, 3, 10, 1001] {
            let x: Vec<f32> = (0..n).map(|i| ((i * i) as f32 * 0.37).sin().powi(3).abs() * 10f32.powi(i as i32 % 5 - 2)).collect();
            assert_eq!(median_of_sizes(&x), median(x), "{n}");
        }
        assert_eq!(median_of_sizes(&[0.0, 0.0, 3.0]), 0.0);
        assert_eq!(median_of_sizes(&[f32::MAX, f32::MIN_POSITIVE, f32::INFINITY]), f32::MAX);
    }
}
