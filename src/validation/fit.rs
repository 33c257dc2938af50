//! Gauss-Newton fit of the free parameters and of the session offsets, with errors in inputs and outputs.
//!
//! Every measured input may carry one offset shared by a whole session (a tilted face, a shifted origin): the largest
//! source of false alarms (docs/diagnosis.md, "In formulas", offsets). Offsets are nuisance with a normal prior of
//! [`FitOptions::offset_share`] of the single-impact deviation; measured outputs of a session of footage likewise, whose
//! calibration all shots share. Where the table states how well the face's own axes are
//! known, their shared error is nuisance too ([`super::session_shift`]).

mod likely_offsets;
mod plateau;

pub use likely_offsets::{LikelyFit, UnlikelyOffset, fit_with_likely_offsets};

use super::error::ValidationError;
use super::forward::{Forward, Inputs, Prior, Tails};
use super::linearise::{Linearised, Setting, Spread};
use super::linearise_all::{linearise_all, weigh_all_again};
use super::observation::{Observation, Observations};
use super::predicted::difference;
use super::project::add_cross;
use super::session_shift::{ACROSS_COLUMNS, SessionShift, relative_sd, shared_inputs, shared_outputs};
use crate::impact_table::{INPUTS, OUTPUTS};
use nalgebra::{DMatrix, DVector};
use std::sync::OnceLock;

/// An error in proportion that is smaller than this share of a column's deviation is not fitted: a racket at rest has none.
const SEEN: f64 = 0.05;
/// A step that promises to lower chi-square by more than this moves the parameters so far that outlier weights are not settled yet, and most
/// rounds in which they may settle.
const MOVING: f64 = 0.3;
const MOST_SETTLING: usize = 8;
const MOST_ROUNDS: usize = 12;
/// A step that promises less than this ends the fit: a hundredth of a unit of chi-square is a tenth of a deviation of one parameter, and far
/// below any decision.
const SETTLED: f64 = 1e-2;
/// Shares of a step that are tried, and by how much chi-square may rise over one, relative to what it promised.
const STEP_SHARES: [f64; 4] = [1.0, 0.5, 0.2, 0.05];
const NO_HIGHER: f64 = 1e-3;
/// Steps of a parameter's derivative, as shares of a typical change: before its deviation is known, and at least and at most afterwards.
const FIRST_SHARE: f64 = 0.1;
const SHARES: (f64, f64) = (0.02, 0.5);

#[derive(Debug, Clone)]
pub struct FitOptions {
    /// Prior deviation of a session's offset, as a share of the single-impact deviation.
    pub offset_share: f64,
    /// Whether the free parameters move at all (`compare` judges the model as it stands).
    pub move_parameters: bool,
    /// Where the free parameters start, or stay if they do not move; `None`: at the model's own values.
    pub start_values: Option<Vec<f64>>,
}

impl Default for FitOptions {
    fn default() -> Self {
        FitOptions { offset_share: 0.5, move_parameters: true, start_values: None }
    }
}

impl FitOptions {
    /// The values of the free parameters where a fit begins (where they do not move, also where it ends).
    fn begins_at(&self, forward: &dyn Forward) -> Vec<f64> {
        self.start_values.clone().unwrap_or_else(|| forward.parameters().iter().map(|p| p.value).collect())
    }
}

/// A column of the design: a free parameter, an offset, the mean of an input that nobody measured, an error in proportion, or one that a session shares
/// (order of `SHARED`).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Column {
    Parameter(usize),
    Offset { session: usize, input: usize },
    Unmeasured { session: usize, input: usize },
    OutputOffset { session: usize, output: usize },
    InputScale { session: usize, input: usize },
    OutputScale { session: usize, output: usize },
    Shared { session: usize, component: usize },
}

/// Where a free parameter stands among columns; `None` where it does not move.
fn column_of(columns: &[Column], parameter: usize) -> Option<usize> {
    columns.iter().position(|c| *c == Column::Parameter(parameter))
}

/// The model at its best, on the impacts it was fitted to.
#[derive(Debug, Clone)]
pub struct Fit {
    pub names: Vec<String>,
    /// Free parameters, as [`Forward::parameters`] orders them.
    pub values: Vec<f64>,
    /// What the impacts of each session share.
    pub shifts: Vec<SessionShift>,
    /// The impacts of the fit, in the table's order.
    pub impacts: Vec<Linearised>,
    /// Whitened derivatives A_i of the prediction, outputs × columns.
    pub design: Vec<DMatrix<f64>>,
    pub columns: Vec<Column>,
    /// Prior precision and mean of every column.
    pub prior_precision: DVector<f64>,
    pub prior_mean: DVector<f64>,
    /// Deviation of every column's prior.
    pub prior_sd: DVector<f64>,
    /// Current values of every column.
    pub column_values: DVector<f64>,
    /// A'A + P.
    pub information: DMatrix<f64>,
    /// Its inverse: covariance of the columns at noise scale 1.
    pub covariance: DMatrix<f64>,
    pub spread: Spread,
    /// Σ z'z.
    pub chi2: f64,
    /// Σ z'z + ln|S| + prior terms: minus twice the log posterior density at noise scale 1, up to a constant.
    pub objective: f64,
    /// Parameters that a limit keeps from going on.
    stopped: Vec<Stopped>,
    /// Parameters that hardly any impact told where the fit began.
    untold_at_start: Vec<usize>,
    /// Parameters that hardly any impact tells, whose deviation is larger than the slope at the best says: by this factor.
    widened: Vec<(usize, plateau::Widening)>,
}

impl Fit {
    /// Measured numbers in the fit.
    pub fn count(&self) -> usize {
        self.impacts.iter().map(|l| l.z.len()).sum()
    }

    /// Variance that the fit's own uncertainty adds to a prediction, relative to the noise: mean leverage of the impacts it saw.
    pub fn own_uncertainty(&self) -> f64 {
        let told: f64 = (0..self.columns.len()).map(|i| 1.0 - self.prior_precision[i] * self.covariance[(i, i)]).sum();
        told.max(0.0) / self.count().max(1) as f64
    }

    /// Free parameters with their values, as a model file takes them.
    pub fn named_values(&self) -> Vec<(String, f64)> {
        self.names.iter().cloned().zip(self.values.iter().copied()).collect()
    }

    /// Which column a free parameter is; `None` when it did not move.
    pub fn column_of(&self, parameter: usize) -> Option<usize> {
        column_of(&self.columns, parameter)
    }

    /// Deviation of a free parameter at noise scale `c` (variance ratio); 0 when it did not move, about its prior's where nothing informs it.
    pub fn sd(&self, parameter: usize, c: f64) -> f64 {
        self.column_of(parameter).map_or(0.0, |i| match self.stopped.iter().find(|s| s.column == i) {
            Some(stopped) => stopped.sd * c.max(0.0).sqrt(),
            None => self.widening(parameter) * (self.covariance[(i, i)] * c).max(0.0).sqrt(),
        })
    }

    fn widening(&self, parameter: usize) -> f64 {
        let widening = self.widened.iter().find(|w| w.0 == parameter).map(|w| w.1);
        if let Some(plateau::Widening::By(factor)) = widening { factor } else { 1.0 }
    }

    /// Covariance of the free parameters at noise scale `c`, row by row in their order; 0 where one did not move or is not determined.
    pub fn parameter_covariance(&self, c: f64) -> Vec<Vec<f64>> {
        let place = |p: usize| self.column_of(p).filter(|_| self.is_informed(p));
        let places: Vec<Option<usize>> = (0..self.names.len()).map(place).collect();
        let entry = |p: usize, q: usize| places[p].zip(places[q]).map_or(0.0, |(a, b)| self.widening(p) * self.widening(q) * self.covariance[(a, b)] * c);
        (0..places.len()).map(|p| (0..places.len()).map(|q| entry(p, q)).collect()).collect()
    }

    /// By how many deviations a free parameter would go on if a limit did not stop it; `None` where none does.
    pub fn stopped_by(&self, parameter: usize) -> Option<f64> {
        let column = self.column_of(parameter)?;
        self.stopped.iter().find(|s| s.column == column).map(|s| s.asked / s.sd.max(f64::MIN_POSITIVE))
    }

    /// Whether the impacts say anything about a free parameter.
    pub fn is_informed(&self, parameter: usize) -> bool {
        !self.widened.contains(&(parameter, plateau::Widening::Unbounded))
            && self.column_of(parameter).is_some_and(|i| self.information[(i, i)] > 1.01 * self.prior_precision[i])
    }

    /// P^½ (mean − value): the residuals of the prior, which act like one more measurement each.
    pub fn prior_residual(&self) -> DVector<f64> {
        let root = self.prior_precision.map(f64::sqrt);
        root.component_mul(&(&self.prior_mean - &self.column_values))
    }
}

/// A column of a parameter at a limit: the deviation it would have without one, and how much farther the next step would go.
#[derive(Debug, Clone, Copy)]
struct Stopped {
    column: usize,
    sd: f64,
    asked: f64,
}

/// The state a fit starts from: the result of an earlier, similar fit saves rounds.
#[derive(Clone, Copy)]
pub struct Start<'a> {
    pub fit: &'a Fit,
    /// Keep its input Jacobians instead of computing new ones.
    pub keep_jacobians: bool,
}

struct Work<'a> {
    forward: &'a dyn Forward,
    observations: &'a Observations,
    impacts: &'a [&'a Observation],
    columns: Vec<Column>,
    priors: Vec<Prior>,
    /// The parameters where the fit begins; those that do not move stay there.
    begins_at: Vec<f64>,
    /// What open spins scatter each prediction by where the fit began. It changes with the friction, and chi-square alone would
    /// make the model slide for being sure of its outputs; held as it is, every state is judged alike.
    open: OnceLock<Vec<DMatrix<f64>>>,
}

struct State {
    column_values: DVector<f64>,
    shifts: Vec<SessionShift>,
    values: Vec<f64>,
    impacts: Vec<Linearised>,
    objective: f64,
    chi2: f64,
    from_prior: f64,
}

/// Fits the free parameters of `forward` to `impacts`.
///
/// Where spins are open, a parameter that hardly any impact tells where it starts (the friction, while all balls stick) stays there
/// unless chi-square falls clearly: on its way it would find a place where the scatter of the spins seems to tell it.
pub fn fit(
    forward: &dyn Forward,
    observations: &Observations,
    impacts: &[&Observation],
    options: &FitOptions,
    start: Option<Start>,
) -> Result<Fit, ValidationError> {
    let free = fit_holding(forward, observations, impacts, options, start, &[])?;
    if start.is_some() || !impacts.iter().any(|o| o.has_open_spin()) {
        return Ok(free);
    }
    let from = options.begins_at(forward);
    let untold: Vec<usize> = free.untold_at_start.iter().copied().filter(|p| free.values[*p] != from[*p]).collect();
    if untold.is_empty() {
        return Ok(free);
    }
    let held = fit_holding(forward, observations, impacts, options, None, &untold)?;
    Ok(if held.objective - free.objective > plateau::GAIN { free } else { held })
}

/// [`fit`] with some parameters held where they start.
fn fit_holding(
    forward: &dyn Forward,
    observations: &Observations,
    impacts: &[&Observation],
    options: &FitOptions,
    start: Option<Start>,
    held: &[usize],
) -> Result<Fit, ValidationError> {
    let work = Work::new(forward, observations, impacts, options);
    let of_same_impacts = start.filter(|s| s.fit.impacts.len() == impacts.len());
    if let Some(s) = of_same_impacts {
        work.open.get_or_init(|| s.fit.impacts.iter().map(|l| l.open.clone()).collect());
    }
    let columns_at = work.starting_columns(start);
    let keep = of_same_impacts.filter(|s| s.keep_jacobians).map(|s| s.fit.impacts.as_slice());
    let begin: Vec<Inputs> = match of_same_impacts {
        Some(s) => s.fit.impacts.iter().map(|l| l.true_inputs).collect(),
        None => impacts.iter().map(|o| o.inputs).collect(),
    };
    let mut spread = start.map_or_else(Spread::unlimited, |s| s.fit.spread.clone());
    let passes = if start.is_some() { 1 } else { 2 };
    let mut state = work.evaluate(&columns_at, &begin, keep, &spread, passes)?;
    let mut untold_at_start = Vec::new();
    if start.is_none() && options.move_parameters {
        untold_at_start = plateau::untold(&work, &state)?;
        state = plateau::leave(&work, state, untold_at_start.iter().copied().filter(|p| !held.contains(p)), &spread)?;
    }
    let mut information: Option<DMatrix<f64>> = None;
    // Outlier weights settle with the parameters; fixed from then on, so that what the steps lower is one function.
    let mut settle = if start.is_some() { 2 } else { 3 };
    for rounds in 1..=MOST_ROUNDS {
        if !observations.keeps_outliers && rounds <= settle {
            spread = Spread::of(&state.impacts);
            // Where input Jacobians are kept from step to step, nothing but the weights changes.
            state = if keep.is_some() || forward.costly() {
                work.weigh_again(state, &spread)?
            } else {
                work.evaluate(&state.column_values, &begin_of(&state), None, &spread, 0)?
            };
        }
        let design = work.design(&state, information.as_ref())?;
        let (mut step, info) = work.step(&state, &design)?;
        for (i, column) in work.columns.iter().enumerate() {
            if matches!(column, Column::Parameter(p) if held.contains(p)) {
                step[i] = 0.0;
            }
        }
        let promised = step.dot(&(&info * &step));
        information = Some(info);
        if promised > MOVING {
            settle = (rounds + 1).clamp(settle, MOST_SETTLING);
        }
        let lend = keep.or((rounds > if forward.costly() { 1 } else { 3 }).then_some(state.impacts.as_slice()));
        let next = work.along(&state, &step, promised, lend, &spread);
        let moved = next.is_some();
        if let Some(next) = next {
            state = next;
        }
        if rounds > settle && (!moved || promised < SETTLED) {
            break;
        }
    }
    let mut design = work.design(&state, information.as_ref())?;
    let (step, mut information) = work.step(&state, &design)?;
    let mut stopped: Vec<Stopped> = work.stopped(&state, &step).into_iter().map(|column| Stopped { column, sd: 0.0, asked: step[column].abs() }).collect();
    if !stopped.is_empty() {
        let free = invert(&information)?;
        stopped.iter_mut().for_each(|s| s.sd = free[(s.column, s.column)].max(0.0).sqrt());
        // It can take up nothing more, and what it leaves is the model's misfit.
        design.iter_mut().for_each(|a| stopped.iter().for_each(|s| a.column_mut(s.column).fill(0.0)));
        information = work.step(&state, &design)?.1;
    }
    let covariance = invert(&information)?;
    let widened = if start.is_none() && options.move_parameters { plateau::widened(&work, &state, &covariance, &spread)? } else { Vec::new() };
    Ok(Fit {
        names: forward.parameters().iter().map(|p| p.name.clone()).collect(),
        values: state.values,
        shifts: state.shifts,
        impacts: state.impacts,
        design,
        prior_precision: work.prior_precision(&state.column_values),
        prior_mean: work.prior_mean(),
        prior_sd: DVector::from_iterator(work.priors.len(), work.priors.iter().map(|p| p.sd)),
        columns: work.columns,
        column_values: state.column_values,
        information,
        covariance,
        spread,
        chi2: state.chi2,
        objective: state.objective,
        stopped,
        untold_at_start,
        widened,
    })
}

impl State {
    /// Chi-square of a state, prior included, in the covariances of this one: what a step means to lower. That the covariances (noise that
    /// grows, weights of outlying cells) then change with it is the next round's.
    fn cost_of(&self, other: &State) -> f64 {
        self.impacts.iter().zip(&other.impacts).map(|(here, there)| (&here.whitener * &there.residual).norm_squared()).sum::<f64>() + other.from_prior
    }
}

fn begin_of(state: &State) -> Vec<Inputs> {
    state.impacts.iter().map(|l| l.true_inputs).collect()
}

impl<'a> Work<'a> {
    fn new(forward: &'a dyn Forward, observations: &'a Observations, impacts: &'a [&'a Observation], options: &FitOptions) -> Self {
        let mut columns = Vec::new();
        let mut priors = Vec::new();
        let about_zero = |sd: f64| Prior { mean: 0.0, sd, tails: Tails::Normal };
        if options.move_parameters {
            for (i, p) in forward.parameters().iter().enumerate() {
                columns.push(Column::Parameter(i));
                // Without a prior: as wide as the allowed range, so that what the impacts do not tell stays where it is.
                let width = (p.max - p.min).abs().clamp(1e-12, 1e12);
                priors.push(p.prior.unwrap_or(Prior { mean: p.value, sd: width, tails: Tails::Normal }));
            }
        }
        for session in 0..observations.sessions.len() {
            let sd = observations.typical_input_sd(session);
            for (input, sd) in sd.iter().enumerate() {
                if options.offset_share > 0.0 && *sd > 0.0 {
                    columns.push(Column::Offset { session, input });
                    priors.push(about_zero(options.offset_share * sd));
                }
            }
            // Balls that nobody saw turn may all turn one way: no error of a camera, and there without offsets too.
            for (input, sd) in observations.unmeasured_sd(session).iter().enumerate().filter(|(_, sd)| **sd > 0.0) {
                columns.push(Column::Unmeasured { session, input });
                priors.push(about_zero(*sd));
            }
            for (output, sd) in observations.shared_output_sd(session).iter().enumerate() {
                if options.offset_share > 0.0 && *sd > 0.0 {
                    columns.push(Column::OutputOffset { session, output });
                    priors.push(about_zero(options.offset_share * sd));
                }
            }
            let shared = observations.shared_sd(session);
            let (inputs, outputs) = observations.typical_sizes(session);
            let scale = |column: &str, size: f64, own: f64| Some(relative_sd(column, &shared)).filter(|sd| *sd > 0.0 && sd * size > SEEN * own);
            for (input, own) in sd.iter().enumerate() {
                if let Some(sd) = scale(INPUTS[input], inputs[input], *own) {
                    columns.push(Column::InputScale { session, input });
                    priors.push(about_zero(sd));
                }
            }
            for (output, own) in observations.shared_output_sd(session).iter().enumerate() {
                if let Some(sd) = scale(OUTPUTS[output], outputs[output], *own) {
                    columns.push(Column::OutputScale { session, output });
                    priors.push(about_zero(sd));
                }
            }
            for (component, sd) in shared[..ACROSS_COLUMNS].iter().enumerate().filter(|(_, sd)| **sd > 0.0) {
                columns.push(Column::Shared { session, component });
                priors.push(about_zero(*sd));
            }
        }
        Work { forward, observations, impacts, columns, priors, begins_at: options.begins_at(forward), open: OnceLock::new() }
    }

    /// The columns where the fit begins: parameters at their start, what sessions share as an earlier fit found it.
    fn starting_columns(&self, start: Option<Start>) -> DVector<f64> {
        let found = |of: &dyn Fn(&[SessionShift]) -> f64| start.map_or(0.0, |s| of(&s.fit.shifts));
        let at = self.columns.iter().map(|column| match *column {
            Column::Parameter(p) => self.begins_at[p],
            Column::Offset { session, input } => found(&|shifts| shifts[session].offsets[input]),
            Column::Unmeasured { session, input } => found(&|shifts| shifts[session].unmeasured[input]),
            Column::OutputOffset { session, output } => found(&|shifts| shifts[session].output_offsets[output]),
            Column::InputScale { session, input } => found(&|shifts| shifts[session].input_scales[input]),
            Column::OutputScale { session, output } => found(&|shifts| shifts[session].output_scales[output]),
            Column::Shared { session, component } => found(&|shifts| shifts[session].shared[component]),
        });
        DVector::from_iterator(self.columns.len(), at)
    }

    fn prior_precision(&self, columns: &DVector<f64>) -> DVector<f64> {
        DVector::from_iterator(columns.len(), self.priors.iter().zip(columns.iter()).map(|(prior, value)| prior.precision(*value)))
    }

    fn prior_mean(&self) -> DVector<f64> {
        DVector::from_iterator(self.priors.len(), self.priors.iter().map(|p| p.mean))
    }

    fn unpack(&self, columns: &DVector<f64>) -> (Vec<f64>, Vec<SessionShift>) {
        let mut values = self.begins_at.clone();
        let mut shifts = vec![SessionShift::default(); self.observations.sessions.len()];
        for (column, value) in self.columns.iter().zip(columns.iter()) {
            match *column {
                Column::Parameter(p) => values[p] = *value,
                Column::Offset { session, input } => shifts[session].offsets[input] = *value,
                Column::Unmeasured { session, input } => shifts[session].unmeasured[input] = *value,
                Column::OutputOffset { session, output } => shifts[session].output_offsets[output] = *value,
                Column::InputScale { session, input } => shifts[session].input_scales[input] = *value,
                Column::OutputScale { session, output } => shifts[session].output_scales[output] = *value,
                Column::Shared { session, component } => shifts[session].shared[component] = *value,
            }
        }
        (values, shifts)
    }

    /// The columns with the parameters held within their limits.
    fn clamp(&self, mut columns: DVector<f64>) -> DVector<f64> {
        for (column, value) in self.columns.iter().zip(columns.iter_mut()) {
            if let Column::Parameter(p) = *column {
                let limits = &self.forward.parameters()[p];
                *value = value.clamp(limits.min, limits.max);
            }
        }
        columns
    }

    /// Columns of the model's own parameters that a limit keeps from going farther along a step (strengths of effects that are only tried keep their prior).
    fn stopped(&self, state: &State, step: &DVector<f64>) -> Vec<usize> {
        let is_stopped = |i: &usize| {
            let Column::Parameter(p) = self.columns[*i] else { return false };
            let limits = &self.forward.parameters()[p];
            let own = limits.prior.is_none_or(|prior| prior.tails == Tails::Wide);
            own && limits.min < limits.max && limits.limit_at(state.column_values[*i]).is_some_and(|side| side * step[*i] > 0.0)
        };
        (0..self.columns.len()).filter(is_stopped).collect()
    }

    /// The farthest state along a step at which chi-square is no higher to speak of; `None` where it is higher wherever one looks.
    fn along(&self, state: &State, step: &DVector<f64>, promised: f64, lend: Option<&[Linearised]>, spread: &Spread) -> Option<State> {
        let at = |columns: &DVector<f64>| self.evaluate(columns, &begin_of(state), lend, spread, 1);
        let mut cost = state.cost_of(state);
        for share in STEP_SHARES {
            let Ok(tried) = at(&self.clamp(&state.column_values + step * share)) else { continue };
            let there = state.cost_of(&tried);
            if there > cost && share == 1.0 {
                // The true inputs move along, some of them over the edge of sliding: what that costs without a step is not the step's.
                cost = at(&state.column_values).map_or(cost, |still| state.cost_of(&still).max(cost));
            }
            if there <= cost + NO_HIGHER * (1.0 + promised) {
                return Some(tried);
            }
        }
        None
    }

    fn evaluate(
        &self,
        columns: &DVector<f64>,
        begin: &[Inputs],
        reuse: Option<&[Linearised]>,
        spread: &Spread,
        passes: usize,
    ) -> Result<State, ValidationError> {
        let (values, shifts) = self.unpack(columns);
        let prediction = self.forward.prepare(&values)?;
        let impacts =
            linearise_all(prediction.as_ref(), self.observations, self.impacts, &shifts, spread, begin, reuse, self.open.get().map(Vec::as_slice), passes)?;
        self.open.get_or_init(|| impacts.iter().map(|l| l.open.clone()).collect());
        Ok(self.state_of(columns, shifts, values, impacts))
    }

    /// A state with the weights that another spread gives its cells.
    fn weigh_again(&self, state: State, spread: &Spread) -> Result<State, ValidationError> {
        let State { column_values, shifts, values, impacts, .. } = state;
        let setting = Setting { observations: self.observations, shifts: &shifts, spread };
        let impacts = weigh_all_again(self.impacts, &setting, impacts)?;
        Ok(self.state_of(&column_values, shifts, values, impacts))
    }

    fn state_of(&self, columns: &DVector<f64>, shifts: Vec<SessionShift>, values: Vec<f64>, impacts: Vec<Linearised>) -> State {
        let chi2: f64 = impacts.iter().map(|l| l.z.norm_squared()).sum();
        let log_det: f64 = impacts.iter().map(|l| l.log_det).sum();
        let from_prior: f64 = self.priors.iter().zip(columns.iter()).map(|(prior, value)| prior.cost(*value)).sum();
        State { column_values: columns.clone(), shifts, values, impacts, objective: chi2 + log_det + from_prior, chi2, from_prior }
    }

    /// Whitened derivatives of the prediction with respect to every column, at the state's true inputs.
    fn design(&self, state: &State, information: Option<&DMatrix<f64>>) -> Result<Vec<DMatrix<f64>>, ValidationError> {
        let free: Vec<usize> = self.columns.iter().filter_map(|c| if let Column::Parameter(p) = c { Some(*p) } else { None }).collect();
        // What a parameter alone could be off by, once that is known.
        let sd_of = |place: usize| information.map(|m| m[(place, place)]).filter(|i| *i > 0.0).map(|i| 1.0 / i.sqrt());
        let sds: Vec<Option<f64>> = (0..free.len()).map(sd_of).collect();
        let derivatives = parameter_derivatives(self.forward, &state.values, &free, &sds, self.impacts, &state.impacts)?;
        Ok(state
            .impacts
            .iter()
            .zip(self.impacts)
            .enumerate()
            .map(|(i, (l, o))| {
                let mut a = DMatrix::zeros(l.z.len(), self.columns.len());
                let mut parameter = 0;
                let any_shared = self.columns.iter().any(|c| matches!(c, Column::Shared { session, .. } if *session == o.session));
                let gear = &self.observations.gear[o.gear];
                let shared = any_shared.then(|| (shared_inputs(o, gear), shared_outputs(o, gear)));
                for (c, column) in self.columns.iter().enumerate() {
                    match *column {
                        Column::Parameter(_) => {
                            a.set_column(c, &derivatives[parameter][i]);
                            parameter += 1;
                        }
                        Column::Offset { session, input } if session == o.session && o.input_sd[input] > 0.0 => {
                            a.set_column(c, &(-l.jacobian.column(input)));
                        }
                        Column::Unmeasured { session, input } if session == o.session && o.missing[input] => {
                            a.set_column(c, &l.jacobian.column(input));
                        }
                        Column::InputScale { session, input } if session == o.session => {
                            a.set_column(c, &(l.jacobian.column(input) * -o.inputs[input]));
                        }
                        Column::OutputOffset { session, output } if session == o.session => {
                            if let Some(row) = o.measured.iter().position(|k| *k == output) {
                                a[(row, c)] = 1.0;
                            }
                        }
                        Column::OutputScale { session, output } if session == o.session => {
                            if let Some(row) = o.measured.iter().position(|k| *k == output) {
                                a[(row, c)] = o.outputs[row];
                            }
                        }
                        Column::Shared { session, component } if session == o.session => {
                            if let Some((inputs, outputs)) = &shared {
                                a.set_column(c, &(&outputs[component] - &l.jacobian * DVector::from_column_slice(&inputs[component])));
                            }
                        }
                        _ => {}
                    }
                }
                &l.whitener * a
            })
            .collect())
    }

    fn step(&self, state: &State, design: &[DMatrix<f64>]) -> Result<(DVector<f64>, DMatrix<f64>), ValidationError> {
        let p = self.columns.len();
        let precision = self.prior_precision(&state.column_values);
        let mut information = DMatrix::from_diagonal(&precision);
        let mut gradient = precision.component_mul(&(self.prior_mean() - &state.column_values));
        for (a, l) in design.iter().zip(&state.impacts) {
            add_cross(&mut information, a, a);
            gradient.gemv_tr(1.0, a, &l.z, 1.0);
        }
        // A column without any information (nothing slides, so friction does nothing) stays where it is.
        let scale = (0..p).map(|i| information[(i, i)]).fold(0.0, f64::max).max(1e-300);
        let mut damped = information.clone();
        for i in 0..p {
            damped[(i, i)] = damped[(i, i)] * (1.0 + 1e-9) + scale * 1e-18;
        }
        if p == 0 {
            return Ok((gradient, information));
        }
        let step = damped.cholesky().ok_or_else(|| ValidationError::NoFit { reason: "the information matrix is singular".into() })?.solve(&gradient);
        Ok((step, information))
    }
}

/// d(prediction)/d(parameter) of each impact at its true inputs, for the named free parameters, as far as known with the deviation of each:
/// `[parameter][impact]`.
///
/// As with the inputs, a difference over ± one deviation: of an impact that begins to slide within it a point's derivative is next to nothing
/// or next to infinite, and one such impact would seem to tell the parameter better than all others.
fn parameter_derivatives(
    forward: &dyn Forward,
    values: &[f64],
    free: &[usize],
    sds: &[Option<f64>],
    impacts: &[&Observation],
    at: &[Linearised],
) -> Result<Vec<Vec<DVector<f64>>>, ValidationError> {
    free.iter()
        .zip(sds)
        .map(|(&p, sd)| {
            let limits = &forward.parameters()[p];
            let typical = limits.typical.abs().max(1e-12);
            let h = sd.map_or(FIRST_SHARE * typical, |sd| sd.clamp(SHARES.0 * typical, SHARES.1 * typical));
            let (mut up, mut down) = (values.to_vec(), values.to_vec());
            up[p] = (values[p] + h).min(limits.max);
            down[p] = (values[p] - h).max(limits.min);
            let width = up[p] - down[p];
            if width <= 0.0 {
                return Ok(at.iter().map(|l| DVector::zeros(l.z.len())).collect());
            }
            let (above, below) = (forward.prepare(&up)?, forward.prepare(&down)?);
            Ok(difference(above.as_ref(), below.as_ref(), impacts, at).into_iter().map(|d| d / width).collect())
        })
        .collect()
}

/// Inverse of a positive semi-definite matrix. A column without any information (friction where nothing slides) is left
/// out: its row and column of the inverse are zero.
pub fn invert(matrix: &DMatrix<f64>) -> Result<DMatrix<f64>, ValidationError> {
    let n = matrix.nrows();
    let mut inverse = DMatrix::zeros(n, n);
    let informed: Vec<usize> = (0..n).filter(|&i| matrix[(i, i)] > 0.0).collect();
    if informed.is_empty() {
        return Ok(inverse);
    }
    // Scaled to a unit diagonal first: parameters differ by ten orders of magnitude.
    let root: Vec<f64> = informed.iter().map(|&i| matrix[(i, i)].sqrt()).collect();
    let k = informed.len();
    let scaled = DMatrix::from_fn(k, k, |i, j| matrix[(informed[i], informed[j])] / (root[i] * root[j]));
    let eigen = scaled.symmetric_eigen();
    let largest = eigen.eigenvalues.max();
    if !(largest > 0.0 && largest.is_finite()) {
        return Err(ValidationError::NoFit { reason: "the information matrix is not finite".into() });
    }
    let reciprocal = DVector::from_iterator(k, eigen.eigenvalues.iter().map(|l| 1.0 / l.max(1e-12 * largest)));
    let unscaled = &eigen.eigenvectors * DMatrix::from_diagonal(&reciprocal) * eigen.eigenvectors.transpose();
    for i in 0..k {
        for j in 0..k {
            inverse[(informed[i], informed[j])] = unscaled[(i, j)] / (root[i] * root[j]);
        }
    }
    Ok(inverse)
}
