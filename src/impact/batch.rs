//! A whole impacts table through the model.

use super::error::ModelError;
use super::input::{ImpactInput, ImpactOutput};
use super::model::Model;
use super::sensitivity::{Column, Sensitivities, SensitivityModel};
use crate::equipment::{Ball, Racket};
use crate::equipment_set::{EquipmentSet, PickError};
use crate::impact_table::{INPUTS, ImpactRow, ImpactTable, OwnColumns, impossible, lacking};
use crate::near_names::near_names;
use nalgebra::Vector3;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::collections::btree_map::Entry;

/// Why one impact of a table has no prediction.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum RowError {
    #[error("impact {id}: {what}")]
    Unreadable { id: String, what: String },
    #[error("impact {id}: `{column}` was not measured, and the model needs it; give 0 where it is known to be nothing")]
    Missing { id: String, column: &'static str },
    #[error("impact {id}: {what}")]
    Impossible { id: String, what: String },
    #[error("impact {id}: {what}")]
    OwnColumn { id: String, what: String },
    #[error("impact {id}: {source}")]
    Pick { id: String, source: PickError },
    #[error("impact {id}: {source}")]
    Model { id: String, source: ModelError },
}

/// Inputs that are often not measured (a ball without readable lines, no instrumented handle) and then count as 0.
fn counts_as_zero(column: &str) -> bool {
    column == "grip_torque" || column.starts_with("ball_in_w")
}

/// Impacts whose incoming spin, or part of it, was not measured and counts as 0: a prediction for a ball without spin.
pub fn without_spin(table: &ImpactTable) -> Vec<&str> {
    let lacks = |row: &ImpactRow| INPUTS.iter().zip(&row.inputs).any(|(c, m)| c.starts_with("ball_in_w") && m.is_none());
    table.rows.iter().filter(|r| r.fault.is_none() && lacks(r)).map(|r| r.id.as_str()).collect()
}

/// The model input of one row. Incoming spin ([`without_spin`] names the rows) and `grip_torque` count as 0 when they
/// were not measured; `order` is the row's sequence minus `first_sequence` (the table's smallest). `own` are the columns of the user's own that
/// the model asks for.
///
/// # Errors
/// [`RowError::Unreadable`]; [`RowError::Missing`] for any other input that was not measured, [`RowError::Impossible`] for one that no impact has, [`RowError::OwnColumn`].
fn input_of_row(row: &ImpactRow, first_sequence: f64, own: &[&str]) -> Result<ImpactInput, RowError> {
    if let Some(what) = &row.fault {
        return Err(RowError::Unreadable { id: row.id.clone(), what: what.to_string() });
    }
    if let Some(what) = impossible(INPUTS.iter().zip(&row.inputs)) {
        return Err(RowError::Impossible { id: row.id.clone(), what });
    }
    let mut columns = [0.0; INPUTS.len()];
    for (i, column) in INPUTS.into_iter().enumerate() {
        columns[i] = match row.inputs[i] {
            Some(m) => m.value,
            None if counts_as_zero(column) => 0.0,
            None => return Err(RowError::Missing { id: row.id.clone(), column }),
        };
    }
    if let Some(what) = lacking(&row.groups, own) {
        return Err(RowError::OwnColumn { id: row.id.clone(), what });
    }
    Ok(ImpactInput { own: OwnColumns::of(&row.groups, own), ..ImpactInput::from_columns(&columns, row.sequence - first_sequence) })
}

/// Something made ready for every pair of racket and ball that occurs in a table, and what each row needs to use it.
struct Prepared<'a, P> {
    set: &'a EquipmentSet,
    pairs: BTreeMap<(usize, usize), P>,
    first_sequence: f64,
    own_columns: Vec<&'a str>,
}

impl<'a, P> Prepared<'a, P> {
    fn new(
        model: &'a Model,
        set: &'a EquipmentSet,
        table: &ImpactTable,
        prepare: impl Fn(&Racket, &Ball) -> Result<P, ModelError>,
    ) -> Result<Self, ModelError> {
        let mut pairs = BTreeMap::new();
        for (r, b) in table.rows.iter().filter_map(|row| set.pick(row).ok()) {
            if let Entry::Vacant(slot) = pairs.entry((r, b)) {
                slot.insert(prepare(&set.rackets[r], &set.balls[b])?);
            }
        }
        Ok(Prepared { set, pairs, first_sequence: table.first_sequence(), own_columns: model.own_columns() })
    }

    /// A row's input, and what is ready for its racket and ball.
    fn of_row(&self, row: &ImpactRow) -> Result<(ImpactInput, &P), RowError> {
        let input = input_of_row(row, self.first_sequence, &self.own_columns)?;
        let pair = self.set.pick(row).map_err(|source| RowError::Pick { id: row.id.clone(), source })?;
        let ready = self.pairs.get(&pair).ok_or_else(|| failed(row, ModelError::NotFinite))?;
        Ok((input, ready))
    }
}

fn failed(row: &ImpactRow, source: ModelError) -> RowError {
    RowError::Model { id: row.id.clone(), source }
}

/// # Errors
/// A column that the model's expressions ask for and no row has.
fn has_columns(model: &Model, table: &ImpactTable) -> Result<(), ModelError> {
    let absent = |name: &&str| !table.rows.iter().any(|row| row.groups.contains_key(*name));
    match (model.own_columns().into_iter().find(absent), table.rows.first()) {
        (Some(name), Some(row)) => {
            let seen: Vec<&str> = row.groups.keys().map(String::as_str).collect();
            Err(ModelError::NoColumn { name: name.to_owned(), near: near_names(name, seen.iter().copied()), seen: seen.join(", ") })
        }
        _ => Ok(()),
    }
}

/// Predicts every row; rows that cannot be predicted say why, the others are complete.
///
/// # Errors
/// A racket, ball or model that cannot be prepared at all.
pub fn predict_table(model: &Model, set: &EquipmentSet, table: &ImpactTable) -> Result<Vec<Result<ImpactOutput, RowError>>, ModelError> {
    let prepared = Prepared::new(model, set, table, |racket, ball| model.prepare(racket, ball))?;
    has_columns(model, table)?;
    let one = |row: &ImpactRow| -> Result<ImpactOutput, RowError> {
        let (input, model) = prepared.of_row(row)?;
        model.predict(&input).map_err(|source| failed(row, source))
    };
    Ok(table.rows.par_iter().with_min_len(32).map(one).collect())
}

/// Impacts whose laws the prediction limits, with what the model made of them.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct LimitedLaws<'a> {
    /// Beyond 0 to 1: 0 or 1 is taken.
    pub restitution: Vec<(&'a str, f64)>,
    /// Below 0: 0 is taken.
    pub friction: Vec<(&'a str, f64)>,
}

/// Impacts for which model and effects give a restitution or a friction that no contact has.
///
/// # Errors
/// As [`predict_table`].
pub fn limited_laws<'a>(model: &Model, set: &EquipmentSet, table: &'a ImpactTable) -> Result<LimitedLaws<'a>, ModelError> {
    let prepared = Prepared::new(model, set, table, |racket, ball| model.prepare(racket, ball))?;
    let of = |row: &ImpactRow| prepared.of_row(row).ok().and_then(|(input, model)| model.unlimited_laws(&input));
    let mut limited = LimitedLaws::default();
    for (id, (restitution, friction)) in table.rows.iter().filter_map(|row| Some((row.id.as_str(), of(row)?))) {
        // What is not finite has no prediction.
        if restitution.is_finite() && !(0.0..=1.0).contains(&restitution) {
            limited.restitution.push((id, restitution));
        }
        if friction.is_finite() && friction < 0.0 {
            limited.friction.push((id, friction));
        }
    }
    Ok(limited)
}

/// Share of an impact's energy before it by which the energy after may be larger without a word: a hand that drives the racket does work.
const GAIN_OF_A_HAND: f64 = 0.1;

/// Impacts that leave ball and racket with more energy (of motion and spin) than they had, beyond what a hand gives, with the gain, J. No contact does that:
/// an effect's equation or parameters are at fault.
pub fn gained_energies<'a>(set: &EquipmentSet, table: &'a ImpactTable, outcomes: &[Result<ImpactOutput, RowError>]) -> Vec<(&'a str, f64)> {
    let first = table.first_sequence();
    let gain = |row: &ImpactRow, after: &ImpactOutput| {
        let (before, (r, b)) = (input_of_row(row, first, &[]).ok()?, set.pick(row).ok()?);
        let (racket, ball) = (&set.rackets[r], &set.balls[b]);
        let energy = |v: &Vector3<f64>, w: &Vector3<f64>, racket_v: &Vector3<f64>, rate: &Vector3<f64>| {
            let of_ball = ball.mass_kg * v.norm_squared() + ball.inertia_kg_m2() * w.norm_squared();
            0.5 * (of_ball + racket.mass_kg * racket_v.norm_squared() + racket.inertia_kg_m2().component_mul(rate).dot(rate))
        };
        let had = energy(&before.ball_velocity, &before.ball_spin, &before.racket_velocity, &before.racket_rate);
        let gained = energy(&after.ball_velocity, &after.ball_spin, &after.racket_velocity, &after.racket_rate) - had;
        (gained > GAIN_OF_A_HAND * had).then_some(gained)
    };
    table.rows.iter().zip(outcomes).filter_map(|(row, after)| Some((row.id.as_str(), gain(row, after.as_ref().ok()?)?))).collect()
}

/// Derivatives at one impact of a table, and the standard deviations that its inputs' carry into the prediction.
#[derive(Debug, Clone)]
pub struct RowSensitivity {
    pub sensitivities: Sensitivities,
    pub output_sd: Column,
}

/// Derivatives at every row; an input whose deviation the table does not state counts as exact.
///
/// # Errors
/// As [`predict_table`].
pub fn differentiate_table(model: &Model, set: &EquipmentSet, table: &ImpactTable) -> Result<Vec<Result<RowSensitivity, RowError>>, ModelError> {
    let prepared = Prepared::new(model, set, table, |racket, ball| SensitivityModel::new(model, racket, ball))?;
    let one = |row: &ImpactRow| -> Result<RowSensitivity, RowError> {
        let (input, model) = prepared.of_row(row)?;
        let sensitivities = model.at(&input).map_err(|source| failed(row, source))?;
        let sd: [f64; INPUTS.len()] = std::array::from_fn(|j| row.inputs[j].and_then(|m| m.sd).unwrap_or(0.0));
        Ok(RowSensitivity { output_sd: sensitivities.output_sd(&sd), sensitivities })
    };
    Ok(table.rows.par_iter().map(one).collect())
}
