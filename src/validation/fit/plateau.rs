//! Parameters that hardly any impact tells where a fit begins: with a friction at which all balls stick no slope says that at a lower
//! one many would slide, as they did.

use super::{Column, Spread, State, ValidationError, Work, begin_of, column_of};
use nalgebra::DMatrix;

/// A parameter that fewer than this share of the impacts tell is looked for elsewhere.
const TOLD: f64 = 0.1;
/// How far, in typical changes either way, and at how many places.
const REACH: f64 = 10.0;
const LOOKS: usize = 40;
/// What chi-square must fall by there.
pub(super) const GAIN: f64 = 20.0;

/// The parameters that hardly any impact tells at this state.
pub(super) fn untold(work: &Work, state: &State) -> Result<Vec<usize>, ValidationError> {
    let design = work.design(state, None)?;
    let is_untold = |column: usize| {
        let told: Vec<f64> = design.iter().map(|a| a.column(column).norm_squared()).collect();
        let (sum, squares) = told.iter().fold((0.0, 0.0), |(s, q), t| (s + t, q + t * t));
        // How many impacts tell it, each counted by its share.
        sum * sum <= TOLD * work.impacts.len() as f64 * squares || squares == 0.0
    };
    let parameter = |(column, kind): (usize, &Column)| if let Column::Parameter(p) = *kind { is_untold(column).then_some(p) } else { None };
    Ok(work.columns.iter().enumerate().filter_map(parameter).collect())
}

/// The state with these parameters, one after the other, moved to where they fit best, if that is clearly elsewhere.
pub(super) fn leave(work: &Work, mut state: State, parameters: impl Iterator<Item = usize>, spread: &Spread) -> Result<State, ValidationError> {
    for p in parameters {
        let Some(column) = column_of(&work.columns, p) else { continue };
        let (limits, from) = (&work.forward.parameters()[p], state.column_values[column]);
        let reach = REACH * limits.typical.abs().max(1e-12);
        let (low, high) = (limits.min.max(from - reach), limits.max.min(from + reach));
        let (begin, here) = (begin_of(&state), state.cost_of(&state));
        let mut best: Option<(f64, State)> = None;
        for k in 0..LOOKS {
            let mut columns = state.column_values.clone();
            columns[column] = low + (high - low) * (k as f64 + 0.5) / LOOKS as f64;
            let Ok(tried) = work.evaluate(&columns, &begin, Some(&state.impacts), spread, 1) else { continue };
            let gain = here - state.cost_of(&tried);
            if gain > GAIN && best.as_ref().is_none_or(|(most, _)| gain > *most) {
                best = Some((gain, tried));
            }
        }
        if let Some((_, tried)) = best {
            state = work.evaluate(&tried.column_values, &begin, None, spread, 1)?;
        }
    }
    Ok(state)
}

/// Two deviations either way must cost so much in chi-square: a quarter more of them than a parabola would need shows a kink.
const SIDES: f64 = 2.0;
const KINKED: f64 = 1.25;

/// What becomes of a deviation that the slope alone makes too small.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Widening {
    /// It is so many times larger.
    By(f64),
    /// The impacts do not bound the parameter within its range, on one side at least.
    Unbounded,
}

/// Of the parameters that hardly any impact tells at a state, those of which chi-square does not bear out on both sides what the slope there
/// says: just where the first ball slides the slope is steep, and beyond it nothing tells the friction any more.
pub(super) fn widened(work: &Work, state: &State, covariance: &DMatrix<f64>, spread: &Spread) -> Result<Vec<(usize, Widening)>, ValidationError> {
    let mut widened = Vec::new();
    for p in untold(work, state)? {
        let Some(column) = column_of(&work.columns, p) else { continue };
        let (limits, sd) = (&work.forward.parameters()[p], covariance[(column, column)].max(0.0).sqrt());
        if !(sd > 0.0) || limits.prior.is_some() {
            continue;
        }
        let begin = begin_of(state);
        let cost_at = |value: f64| {
            let mut columns = state.column_values.clone();
            columns[column] = value;
            work.evaluate(&columns, &begin, Some(&state.impacts), spread, 1).map(|there| state.cost_of(&there))
        };
        let value = state.column_values[column];
        let here = cost_at(value)?;
        let (mut reach, mut bounded) = (0.0_f64, true);
        for (side, limit) in [(-1.0, limits.min), (1.0, limits.max)] {
            let room = (limit - value).abs();
            // What cannot be predicted there is no better.
            let costs = |distance: f64| cost_at(value + side * distance).map_or(true, |c| c - here >= SIDES * SIDES);
            let mut distance = SIDES * sd;
            while distance < room && !costs(distance) {
                distance *= KINKED;
            }
            bounded &= distance < room || room < SIDES * sd || costs(room);
            reach = reach.max(distance.min(room));
        }
        let factor = reach / (SIDES * sd);
        if !bounded {
            widened.push((p, Widening::Unbounded));
        } else if factor > KINKED {
            widened.push((p, Widening::By(factor)));
        }
    }
    Ok(widened)
}
