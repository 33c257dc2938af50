//! One impact, linearised at the estimate of its true inputs: residual, covariance, whitening, outlying cells.
//!
//! With measured inputs x (deviations S_x), outputs y (S_y) and the model f, at the estimate x^ of the true inputs:
//! r = y − f(x^) − F (x − b − x^), S = S_y² + F S_x² F', F = df/dx, b the offsets shared by a session;
//! then x^ ← x − b + S_x² F' S⁻¹ r. (docs/diagnosis.md, "In formulas", fit; Britt and Luecke 1973.)
//!
//! F is a difference over ± one deviation of each input: the slope that the noise itself sees. Across the edge between
//! sticking and sliding that is the average of both sides, weighted by how far the noise reaches, where a derivative at a
//! point would be wrong for half of the noise. The model itself jumps at that edge where
//! nature does not: a prediction that may be off by j has j j' in S beside the noise (impact::sliding_edge).

use super::forward::{Inputs, Prediction};
use super::observation::{Observation, Observations};
use super::predicted::{predict_measured, predict_roughly, scatter_over_spins};
use super::session_shift::SessionShift;
use crate::impact_table::{INPUTS, OUTPUTS};
use crate::median::upper_median;
use nalgebra::{DMatrix, DVector};

/// Standardised residual beyond which a cell loses weight. Of 27 cells in 900 impacts a Gaussian puts eleven beyond it.
pub const OUTLIER_START: f64 = 3.5;
/// An output's residual counts this much more than an input's where one of them must be wrong.
const AS_WELL: f64 = 1.05;
/// A cell this far out is no chance of noise or model, but a wrong number.
const GROSS: f64 = 8.0;
/// A cell this far out is listed as an outlier.
pub const OUTLIER_LISTED: f64 = 4.2;
/// Widest step of a derivative by a spin nobody measured, rad/s: about what the outputs leave open of it.
const UNMEASURED_STEP: f64 = 15.0;
/// Share of an open spin's deviation by which the mean over such spins is moved for its slope.
const OPEN_STEP: f64 = 0.5;
/// Steps by which such a spin is first estimated.
const UNMEASURED_PASSES: usize = 4;
/// Cells of one impact that may be outliers at once; more, and the impact as a whole is odd and keeps its inflated rest.
const MOST_CELLS: usize = 6;

/// A measured number that does not belong: its column and standardised residual.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OutlyingCell {
    pub output: bool,
    /// Index into [`OUTPUTS`] or [`INPUTS`].
    pub column: usize,
    pub standardised: f64,
}

impl OutlyingCell {
    pub fn name(&self) -> &'static str {
        if self.output { OUTPUTS[self.column] } else { INPUTS[self.column] }
    }
}

/// Robust spread (median absolute deviation, 1 for a Gaussian with the stated noise) of the standardised residuals of
/// each column. It lets a model that misses everywhere keep its residuals: only what sticks out of its own column is odd.
#[derive(Debug, Clone)]
pub struct Spread {
    pub outputs: [f64; OUTPUTS.len()],
    pub inputs: [f64; INPUTS.len()],
}

impl Spread {
    /// No cell is odd.
    pub fn unlimited() -> Self {
        Spread { outputs: [f64::INFINITY; OUTPUTS.len()], inputs: [f64::INFINITY; INPUTS.len()] }
    }

    /// From the standardised residuals of a set of linearised impacts.
    pub fn of(impacts: &[Linearised]) -> Self {
        let spread = |pick: &dyn Fn(&Linearised) -> Option<f64>| {
            let t: Vec<f64> = impacts.iter().filter_map(pick).map(f64::abs).collect();
            // 0.6745: third quartile of the standard normal distribution.
            if t.len() < 8 { 1.0 } else { upper_median(t).map_or(1.0, |median| (median / 0.6745).max(0.5)) }
        };
        Spread {
            outputs: std::array::from_fn(|k| spread(&|l| l.measured.iter().position(|m| *m == k).map(|row| l.output_t[row]))),
            inputs: std::array::from_fn(|j| spread(&|l| Some(l.input_t[j]).filter(|t| *t != 0.0))),
        }
    }
}

/// One impact at the current parameters.
#[derive(Debug, Clone)]
pub struct Linearised {
    /// Indices of the measured outputs; rows of everything below.
    pub measured: Vec<usize>,
    /// Estimate x^ of the true inputs.
    pub true_inputs: Inputs,
    /// Prediction there.
    pub at_true_inputs: DVector<f64>,
    /// Prediction at the measured inputs less what the session shares, by the linear model: `y − residual`.
    pub predicted: DVector<f64>,
    pub residual: DVector<f64>,
    /// F, outputs × inputs.
    pub jacobian: DMatrix<f64>,
    /// How far off the prediction may be because the model jumps nearby.
    pub jump: DVector<f64>,
    /// Covariance over the spins that are open; empty where none is.
    pub open: DMatrix<f64>,
    /// S with the inflation of outlying cells.
    pub covariance: DMatrix<f64>,
    /// L⁻¹ where S = L L'.
    pub whitener: DMatrix<f64>,
    /// z = L⁻¹ r.
    pub z: DVector<f64>,
    /// ln |S|.
    pub log_det: f64,
    /// Each cell's residual given all other cells, in deviations.
    pub output_t: Vec<f64>,
    pub input_t: [f64; INPUTS.len()],
    pub outliers: Vec<OutlyingCell>,
}

/// What is needed besides the impact and the model.
pub struct Setting<'a> {
    pub observations: &'a Observations,
    /// What each session's impacts share.
    pub shifts: &'a [SessionShift],
    pub spread: &'a Spread,
}

/// F at each point: central differences over ± one deviation (at most `widest` for an input nobody measured), one-sided
/// where the model has no answer on a side.
fn input_jacobians(p: &dyn Prediction, points: &[&Point], widest: f64) -> Vec<DMatrix<f64>> {
    let step = |point: &Point, j: usize| {
        let sd = point.o.input_sd[j];
        match point.o.missing[j] {
            true if sd > 0.0 => sd.min(widest),
            // Where the prediction is a mean over all spins: how it goes with their mean.
            true => OPEN_STEP * point.o.open_sd(j),
            false => sd,
        }
    };
    let mut places = Vec::new();
    let mut asked = Vec::new();
    for (i, point) in points.iter().enumerate() {
        for j in (0..INPUTS.len()).filter(|&j| step(point, j) > 0.0) {
            places.push((i, j));
            for by in [step(point, j), -step(point, j)] {
                let mut at = point.x;
                at[j] += by;
                asked.push((point.o, at));
            }
        }
    }
    let mut jacobians: Vec<DMatrix<f64>> = points.iter().map(|point| DMatrix::zeros(point.o.measured.len(), INPUTS.len())).collect();
    for ((i, j), sides) in places.into_iter().zip(predict_roughly(p, &asked).chunks_exact(2)) {
        let h = step(points[i], j);
        let (above, below, apart) = match (&sides[0], &sides[1]) {
            (Some(up), Some(down)) => (up, down, 2.0 * h),
            // The middle is a mean over more spins than the sides are.
            _ if points[i].o.has_open_spin() => continue,
            (Some(up), None) => (up, &points[i].at_x, h),
            (None, Some(down)) => (&points[i].at_x, down, h),
            (None, None) => continue,
        };
        let between = above.iter().zip(below).map(|(a, b)| (a - b) / apart);
        jacobians[i].column_mut(j).iter_mut().zip(between).for_each(|(slope, found)| *slope = found);
    }
    jacobians
}

/// Linearises some impacts, starting from `start` for their true inputs; `reuse` holds Jacobians to keep, `open` what open
/// spins scatter the predictions by where that is to stay. `None` where the model has no answer.
pub fn linearise(
    p: &dyn Prediction,
    impacts: &[&Observation],
    setting: &Setting,
    start: &[Inputs],
    reuse: Option<&[Linearised]>,
    open: Option<&[DMatrix<f64>]>,
    passes: usize,
) -> Vec<Option<Linearised>> {
    let mut points = begin(p, impacts, setting, start);
    match open {
        Some(known) => points.iter_mut().for_each(|point| point.open.clone_from(&known[point.place])),
        None => scatter_by_spin(p, &mut points),
    }
    match reuse {
        Some(kept) => points.iter_mut().for_each(|point| {
            point.jacobian.clone_from(&kept[point.place].jacobian);
            point.jump.clone_from(&kept[point.place].jump);
        }),
        None => differentiate(p, &mut points, f64::INFINITY),
    }
    whiten_all(&mut points, setting);
    // An input nobody measured is told by the outputs, far more narrowly than by its range: the slope that counts is that
    // near the value they tell. Where the spin is open they tell none.
    if reuse.is_none() {
        let is_told = |o: &Observation| !o.has_open_spin() && (0..INPUTS.len()).any(|j| o.missing[j] && o.input_sd[j] > 0.0);
        let (mut with_gaps, whole): (Vec<Point>, Vec<Point>) = points.into_iter().partition(|point| is_told(point.o));
        for _ in 0..UNMEASURED_PASSES {
            advance(p, setting, &mut with_gaps);
            differentiate(p, &mut with_gaps, UNMEASURED_STEP);
            whiten_all(&mut with_gaps, setting);
        }
        // Where the model has no answer further on, an impact rests where it stands.
        with_gaps.iter_mut().for_each(|point| point.moves = true);
        points = whole.into_iter().chain(with_gaps).collect();
    }
    for _ in 0..passes {
        advance(p, setting, &mut points);
        whiten_all(&mut points, setting);
    }
    let mut results = vec![None; impacts.len()];
    for point in points {
        let place = point.place;
        results[place] = point.linearised();
    }
    results
}

/// A linearised impact with the weights that another spread gives its cells: `setting` differs in nothing else, so that nothing is predicted anew.
pub fn weigh_again(o: &Observation, setting: &Setting, known: Linearised) -> Option<Linearised> {
    let Linearised { true_inputs: x, at_true_inputs: at_x, jacobian, jump, open, .. } = known;
    let mut point = Point { place: 0, o, measured: Corrected::of(o, setting), x, at_x, jacobian, jump, open, result: None, moves: true };
    point.result = whiten(&point, setting);
    point.linearised()
}

/// An impact on its way to the estimate of its true inputs.
struct Point<'a> {
    /// Its index among the impacts.
    place: usize,
    o: &'a Observation,
    measured: Corrected,
    x: Inputs,
    at_x: DVector<f64>,
    jacobian: DMatrix<f64>,
    jump: DVector<f64>,
    open: DMatrix<f64>,
    result: Option<Whitened>,
    /// Cleared when the model has no answer at the next estimate.
    moves: bool,
}

/// What follows at a point from the prediction and its slopes; as in [`Linearised`].
struct Whitened {
    predicted: DVector<f64>,
    residual: DVector<f64>,
    covariance: DMatrix<f64>,
    whitener: DMatrix<f64>,
    z: DVector<f64>,
    log_det: f64,
    output_t: Vec<f64>,
    input_t: [f64; INPUTS.len()],
    outliers: Vec<OutlyingCell>,
}

impl Point<'_> {
    /// The impact at the point where it has come to.
    fn linearised(self) -> Option<Linearised> {
        let Point { o, x, at_x, jacobian, jump, open, .. } = self;
        let Whitened { predicted, residual, covariance, whitener, z, log_det, output_t, input_t, outliers } = self.result?;
        Some(Linearised {
            measured: o.measured.clone(),
            true_inputs: x,
            at_true_inputs: at_x,
            predicted,
            residual,
            jacobian,
            jump,
            open,
            covariance,
            whitener,
            z,
            log_det,
            output_t,
            input_t,
            outliers,
        })
    }
}

/// The measured numbers of an impact with what its session shares taken out.
struct Corrected {
    inputs: Inputs,
    outputs: DVector<f64>,
}

impl Corrected {
    fn of(o: &Observation, setting: &Setting) -> Self {
        let (shift, gear) = (&setting.shifts[o.session], &setting.observations.gear[o.gear]);
        Corrected { inputs: shift.inputs_of(o, gear), outputs: shift.outputs_of(o, gear) }
    }
}

/// The impacts at their start, or at their measured inputs where the model has no answer there; without those that have
/// none at either.
fn begin<'a>(p: &dyn Prediction, impacts: &[&'a Observation], setting: &Setting, start: &[Inputs]) -> Vec<Point<'a>> {
    let measured: Vec<Corrected> = impacts.iter().map(|o| Corrected::of(o, setting)).collect();
    let asked: Vec<(&Observation, Inputs)> = impacts.iter().copied().zip(start.iter().copied()).collect();
    let mut at: Vec<(Inputs, Option<DVector<f64>>)> = start.iter().copied().zip(predict_measured(p, &asked)).collect();
    let lost: Vec<usize> = (0..at.len()).filter(|&i| at[i].1.is_none()).collect();
    let again: Vec<(&Observation, Inputs)> = lost.iter().map(|&i| (impacts[i], measured[i].inputs)).collect();
    for (i, value) in lost.into_iter().zip(predict_measured(p, &again)) {
        at[i] = (measured[i].inputs, value);
    }
    let point = |(place, ((o, measured), (x, value))): (usize, ((&&'a Observation, Corrected), (Inputs, Option<DVector<f64>>)))| {
        Some(Point {
            place,
            o,
            measured,
            x,
            at_x: value?,
            jacobian: DMatrix::zeros(0, 0),
            jump: DVector::zeros(0),
            open: DMatrix::zeros(0, 0),
            result: None,
            moves: true,
        })
    };
    impacts.iter().zip(measured).zip(at).enumerate().filter_map(point).collect()
}

fn differentiate(p: &dyn Prediction, points: &mut [Point], widest: f64) {
    let moving: Vec<&Point> = points.iter().filter(|point| point.moves).collect();
    let jacobians = input_jacobians(p, &moving, widest);
    for (point, jacobian) in points.iter_mut().filter(|point| point.moves).zip(jacobians) {
        point.jacobian = jacobian;
        point.jump = jump(p, point);
    }
}

/// What the spins that are open scatter the predictions by.
fn scatter_by_spin(p: &dyn Prediction, points: &mut [Point]) {
    let mut open: Vec<&mut Point> = points.iter_mut().filter(|point| point.o.has_open_spin()).collect();
    let asked: Vec<(&Observation, Inputs)> = open.iter().map(|point| (point.o, point.x)).collect();
    for (point, over) in open.iter_mut().zip(scatter_over_spins(p, &asked)) {
        point.open = over.unwrap_or_else(|| DMatrix::zeros(0, 0));
    }
}

fn jump(p: &dyn Prediction, point: &Point) -> DVector<f64> {
    let found = p.jump(&point.o.asked_at(point.x));
    DVector::from_iterator(point.o.measured.len(), point.o.measured.iter().map(|&k| found.map_or(0.0, |j| j[k])))
}

fn whiten_all(points: &mut [Point], setting: &Setting) {
    for point in points.iter_mut().filter(|point| point.moves) {
        point.result = whiten(point, setting);
        point.moves = point.result.is_some();
    }
}

/// The estimates of the true inputs one step on, and the predictions there.
fn advance(p: &dyn Prediction, setting: &Setting, points: &mut [Point]) {
    let next: Vec<(usize, Inputs)> = points
        .iter()
        .enumerate()
        .filter(|(_, point)| point.moves)
        .filter_map(|(i, point)| {
            let result = point.result.as_ref()?;
            let pull = point.jacobian.tr_mul(&result.whitener.tr_mul(&result.z));
            let estimate = |j: usize| {
                let sd = point.o.input_sd_at(j, &setting.observations.input_noise[j], point.x[j]);
                point.measured.inputs[j] + sd * sd * pull[j]
            };
            Some((i, std::array::from_fn(estimate)))
        })
        .collect();
    let asked: Vec<(&Observation, Inputs)> = next.iter().map(|(i, x)| (points[*i].o, *x)).collect();
    for ((i, x), value) in next.into_iter().zip(predict_measured(p, &asked)) {
        match value {
            Some(value) => (points[i].x, points[i].at_x) = (x, value),
            None => points[i].moves = false,
        }
    }
}

/// L⁻¹ of a lower triangle with a positive diagonal.
fn inverse_of_lower(lower: &DMatrix<f64>) -> DMatrix<f64> {
    let k = lower.nrows();
    let mut inverse = DMatrix::identity(k, k);
    for c in 0..k {
        let mut own = inverse.column_mut(c);
        let own = own.as_mut_slice();
        for j in c..k {
            let column = lower.column(j);
            let (above, below) = own.split_at_mut(j + 1);
            above[j] /= column[j];
            below.iter_mut().zip(&column.as_slice()[j + 1..]).for_each(|(x, l)| *x -= above[j] * l);
        }
    }
    inverse
}

/// W'W of a lower triangle W: sums over what both columns have.
fn square_of_lower(lower: &DMatrix<f64>) -> DMatrix<f64> {
    let k = lower.nrows();
    let mut square = DMatrix::zeros(k, k);
    for b in 0..k {
        for a in 0..=b {
            let (of_a, of_b) = (lower.column(a), lower.column(b));
            let sum = of_a.as_slice()[b..].iter().zip(&of_b.as_slice()[b..]).map(|(x, y)| x * y).sum::<f64>();
            (square[(a, b)], square[(b, a)]) = (sum, sum);
        }
    }
    square
}

fn whiten(point: &Point, setting: &Setting) -> Option<Whitened> {
    let Point { o, measured, x, at_x, jacobian, .. } = point;
    let gap = DVector::from_iterator(INPUTS.len(), (0..INPUTS.len()).map(|j| if o.input_sd[j] > 0.0 { measured.inputs[j] - x[j] } else { 0.0 }));
    let residual = &measured.outputs - (at_x + jacobian * gap);
    let predicted = DVector::from_column_slice(&o.outputs) - &residual;
    let mut covariance = stated_covariance(point, setting);
    let mut lower = covariance.clone().cholesky()?.unpack();
    let mut whitener = inverse_of_lower(&lower);
    let precision = square_of_lower(&whitener);
    let t = Standardised::of(point, &residual, &precision);
    let outliers = widen_odd_cells(point, setting.spread, &residual, t.clone(), precision, &mut covariance);
    if !outliers.is_empty() {
        lower = covariance.clone().cholesky()?.unpack();
        whitener = inverse_of_lower(&lower);
    }
    let z = &whitener * &residual;
    let log_det = 2.0 * lower.diagonal().iter().map(|d| d.ln()).sum::<f64>();
    Some(Whitened { predicted, residual, covariance, whitener, z, log_det, output_t: t.outputs, input_t: t.inputs, outliers })
}

/// S of what is stated: S_y² + F S_x² F', the jump, and what open spins scatter by.
fn stated_covariance(point: &Point, setting: &Setting) -> DMatrix<f64> {
    let Point { o, x, at_x, jacobian, jump, open, .. } = point;
    let k = o.measured.len();
    let mut covariance = DMatrix::zeros(k, k);
    for (row, &column) in o.measured.iter().enumerate() {
        let sd = setting.observations.output_noise[column].sd(Some(o.output_sd[row]), at_x[row]);
        covariance[(row, row)] = sd * sd;
    }
    for j in 0..INPUTS.len() {
        if o.input_sd[j] > 0.0 {
            let sd = o.input_sd_at(j, &setting.observations.input_noise[j], x[j]);
            let column = jacobian.column(j);
            covariance.ger(sd * sd, &column, &column, 1.0);
        }
    }
    covariance.ger(1.0, jump, jump, 1.0);
    if open.nrows() == k {
        covariance += open;
    }
    covariance
}

/// Each cell's residual given all other cells, in deviations; the outputs by row.
#[derive(Clone)]
struct Standardised {
    outputs: Vec<f64>,
    inputs: [f64; INPUTS.len()],
}

impl Standardised {
    fn of(point: &Point, residual: &DVector<f64>, precision: &DMatrix<f64>) -> Self {
        let Point { o, jacobian, .. } = point;
        let pulled = precision * residual;
        let mut told = DVector::zeros(pulled.len());
        let outputs = (0..pulled.len()).map(|i| pulled[i] / precision[(i, i)].max(1e-300).sqrt()).collect();
        let inputs = std::array::from_fn(|j| {
            if o.input_sd[j] <= 0.0 || o.missing[j] {
                return 0.0;
            }
            let f = jacobian.column(j);
            told.gemv(1.0, precision, &f, 0.0);
            let information = told.dot(&f);
            // An input that hardly moves any output cannot be told to be odd.
            if information * o.input_sd[j].powi(2) < 1e-3 { 0.0 } else { f.dot(&pulled) / information.sqrt() }
        });
        Standardised { outputs, inputs }
    }

    /// The cell that is farthest out of its column's spread, if any is odd. Of gross errors it is the one that alone explains most of the
    /// residuals, the largest in deviations (for one wrong cell by Cauchy and Schwarz its own).
    fn oddest(&self, o: &Observation, spread: &Spread) -> Option<OddCell> {
        let of_output = self.outputs.iter().enumerate().map(|(row, t)| (true, row, *t, spread.outputs[o.measured[row]]));
        let of_input = self.inputs.iter().enumerate().map(|(j, t)| (false, j, *t, spread.inputs[j]));
        let cells = of_output.chain(of_input).map(|(output, index, standardised, spread)| OddCell { output, index, standardised, spread });
        let odd: Vec<OddCell> = cells.filter(|c| c.times_its_spread() > OUTLIER_START).collect();
        let gross = odd.iter().filter(|c| c.times_its_spread() > GROSS).max_by(|a, b| a.size().total_cmp(&b.size()));
        gross.or_else(|| odd.iter().max_by(|a, b| (a.size() / a.spread).total_cmp(&(b.size() / b.spread)))).copied()
    }
}

#[derive(Clone, Copy)]
struct OddCell {
    output: bool,
    /// Row of an output, column of an input.
    index: usize,
    standardised: f64,
    /// Of its column.
    spread: f64,
}

impl OddCell {
    fn times_its_spread(&self) -> f64 {
        self.standardised.abs() / self.spread
    }

    /// What an input alone moves may be the output's error as well (a spin about the normal): of two that do as well it is the output.
    fn size(&self) -> f64 {
        if self.output { AS_WELL * self.standardised.abs() } else { self.standardised.abs() }
    }
}

/// Gives the odd cells of an impact the variance with which they lose their weight, the worst first: its neighbours often look odd only
/// because of it. `t` and `precision` are those of `covariance` as it is stated.
fn widen_odd_cells(
    point: &Point,
    spread: &Spread,
    residual: &DVector<f64>,
    mut t: Standardised,
    mut precision: DMatrix<f64>,
    covariance: &mut DMatrix<f64>,
) -> Vec<OutlyingCell> {
    let Point { o, jacobian, .. } = point;
    let mut outliers: Vec<OutlyingCell> = Vec::new();
    while let Some(odd) = t.oddest(o, spread) {
        let OddCell { output, index, standardised, .. } = odd;
        let column = if output { o.measured[index] } else { index };
        if outliers.iter().any(|c| c.output == output && c.column == column) {
            break;
        }
        // Variance of this cell's residual given the others, times how far it is out, squared: weight (start / t)².
        let direction = if output { DVector::from_fn(precision.nrows(), |i, _| f64::from(u8::from(i == index))) } else { jacobian.column(index).into_owned() };
        let pulled = &precision * &direction;
        let information = pulled.dot(&direction);
        let extra = ((odd.times_its_spread() / OUTLIER_START).powi(2) - 1.0) / information.max(1e-300);
        covariance.ger(extra, &direction, &direction, 1.0);
        precision.ger(-extra / (1.0 + extra * information), &pulled, &pulled, 1.0);
        outliers.push(OutlyingCell { output, column, standardised });
        if outliers.len() == MOST_CELLS {
            break;
        }
        t = Standardised::of(point, residual, &precision);
    }
    outliers
}
