//! Impacts made ready for statistics: every input and output with a deviation, its racket and ball, session and side of
//! the held-out split.

use super::comparison::LeftOut;
use super::error::ValidationError;
use super::forward::{Asked, Inputs, Outputs};
use super::holdout::{hash_fraction, is_held_out};
use super::noise::ColumnNoise;
use super::unseen_spin::{SPIN_IN, is_open};
use crate::equipment::{Ball, Racket};
use crate::equipment_set::pick;
use crate::impact_table::{INPUTS, ImpactRow, ImpactTable, OUTPUTS, OwnColumns, SHARED, impossible, lacking, unit};
use crate::median::upper_median;
use crate::short_list::short_list;
use nalgebra::DVector;
use std::collections::BTreeMap;

/// A model with two base parameters and an offset per input needs more than this to say anything.
pub const FEWEST_IMPACTS: usize = 12;
/// Of these the fit must see so many.
const FEWEST_FITTED: usize = 8;
/// Sessions with fewer impacts than this share one set of offsets: their own could not be told from noise.
const FEWEST_PER_SESSION: usize = 12;
/// Fewest impacts that tell the mean of an input that none of them has.
const FEWEST_PER_MEAN: usize = 8;
/// Offsets are fitted for at most this many sessions.
const MOST_SESSIONS: usize = 12;

/// Rows left out that a note names; results list them all.
const MOST_NAMED: usize = 12;

/// One impact. Arrays in the order of [`INPUTS`] and [`OUTPUTS`].
#[derive(Debug, Clone)]
pub struct Observation {
    pub id: String,
    /// Index of its (racket, ball) pair in [`Observations::gear`].
    pub gear: usize,
    /// Place in time, 0 for the first.
    pub order: f64,
    /// Numbers in columns of the user's own.
    pub own: OwnColumns,
    /// Index into [`Observations::sessions`].
    pub session: usize,
    pub held_out: bool,
    /// Measured inputs; a missing spin or torque stands as 0.
    pub inputs: Inputs,
    /// Stated deviation (for a missing spin: that of spins in general, see [`MISSING_SPIN_SD`]).
    pub input_sd: Inputs,
    /// Inputs that nobody measured: spins known only within the range of play.
    pub missing: [bool; INPUTS.len()],
    /// Deviation of the spin in the face, where it is open ([`super::unseen_spin`]); else 0.
    pub open_spin_sd: [f64; 2],
    /// Indices of the measured outputs.
    pub measured: Vec<usize>,
    /// Values of the measured outputs, same order as `measured`.
    pub outputs: Vec<f64>,
    /// Deviations as written in the table, same order.
    pub output_sd: Vec<f64>,
    /// Deviations of the errors that its session shares, order of [`SHARED`]; 0 where none is stated.
    pub shared_sd: [f64; SHARED.len()],
    pub groups: BTreeMap<String, String>,
    /// What the split goes by: its group, else its id.
    pub held_by: String,
}

/// Spin of a ball whose markings could not be read: unknown within the range of play (men's forehands in the thesis: 1125 ± 1122 rpm), rad/s. Where other
/// spin components of the table were measured, their size is taken instead.
pub const MISSING_SPIN_SD: f64 = 120.0;

impl Observation {
    /// Estimated inputs without what only the outputs told: a feature made of those would meet its own noise in the
    /// residuals.
    pub fn without_unmeasured(&self, estimated: &Inputs) -> Inputs {
        std::array::from_fn(|j| if self.missing[j] { self.inputs[j] } else { estimated[j] })
    }

    /// Whether its spin in the face is open.
    pub fn has_open_spin(&self) -> bool {
        self.open_spin_sd.iter().any(|sd| *sd > 0.0)
    }

    /// Deviation of an input that nobody measured, whether the outputs tell it or it is open.
    pub fn unmeasured_sd(&self, input: usize) -> f64 {
        self.input_sd[input].max(self.open_sd(input))
    }

    /// Deviation of an input over which the prediction is a mean; 0 for any other.
    pub fn open_sd(&self, input: usize) -> f64 {
        input.checked_sub(SPIN_IN).and_then(|k| self.open_spin_sd.get(k)).copied().unwrap_or(0.0)
    }

    /// What a model is asked of it, were these its inputs.
    pub fn asked_at(&self, inputs: Inputs) -> Asked {
        Asked { gear: self.gear, order: self.order, own: self.own, inputs }
    }

    /// The measured ones of a prediction's outputs. `None` where one is not finite.
    pub fn measured_of(&self, all: &Outputs) -> Option<DVector<f64>> {
        let picked = DVector::from_iterator(self.measured.len(), self.measured.iter().map(|&k| all[k]));
        picked.iter().all(|v| v.is_finite()).then_some(picked)
    }

    /// Deviation of input `j` when its true value is `at`; 0 for an input known exactly.
    pub fn input_sd_at(&self, j: usize, noise: &ColumnNoise, at: f64) -> f64 {
        if self.missing[j] || self.input_sd[j] <= 0.0 { self.input_sd[j] } else { noise.sd(Some(self.input_sd[j]), at) }
    }
}

/// A racket with a ball, as the table's rows name them.
#[derive(Debug, Clone)]
pub struct Gear {
    pub racket: Racket,
    pub ball: Ball,
}

/// The table, ready.
#[derive(Debug, Clone)]
pub struct Observations {
    pub impacts: Vec<Observation>,
    pub gear: Vec<Gear>,
    /// Names of the sessions that share offsets.
    pub sessions: Vec<String>,
    pub input_noise: Vec<ColumnNoise>,
    pub output_noise: Vec<ColumnNoise>,
    /// Rows that could not be used: id and reason.
    pub unusable: Vec<(String, String)>,
    /// Of these the ones that another model could use: they lack a column that this one asks for, or it has no answer for them.
    pub lost_to_model: Vec<String>,
    /// The column by whose groups the impacts are held out, if by any.
    pub group: Option<String>,
    /// Whether outlying numbers keep their full weight.
    pub keeps_outliers: bool,
    /// What had to be assumed, in words.
    pub notes: Vec<String>,
}

/// How the table is to be read.
#[derive(Debug, Clone, Default)]
pub struct TableOptions {
    /// Keeps the impacts of a group on one side of the held-out split.
    pub group: Option<String>,
    /// Columns of the user's own that the model's expressions ask for.
    pub own_columns: Vec<String>,
}

impl Observations {
    /// Makes a table ready. Rows with a fault, without ball and racket velocities and an impact position, with a value that no impact has, or with a racket or ball that
    /// is not among the given ones, are left out and named.
    pub fn new(table: &ImpactTable, rackets: &[Racket], balls: &[Ball], options: &TableOptions) -> Result<Self, ValidationError> {
        Self::without(&BTreeMap::new(), table, rackets, balls, options)
    }

    /// [`Self::new`] without these rows (by id, with the reason) either.
    pub fn without(
        unpredicted: &BTreeMap<String, String>,
        table: &ImpactTable,
        rackets: &[Racket],
        balls: &[Ball],
        options: &TableOptions,
    ) -> Result<Self, ValidationError> {
        if let Some(column) = &options.group
            && !table.rows.iter().any(|r| group_of(r, column).is_some())
        {
            let own = table.rows.first().into_iter().flat_map(|r| r.groups.keys().map(String::as_str));
            let seen: Vec<&str> = own.chain(["racket", "ball"]).filter(|c| table.rows.iter().any(|r| group_of(r, c).is_some())).collect();
            return Err(ValidationError::NoGroup { column: column.clone(), seen: seen.join(", ") });
        }
        let (all_rows, first_sequence) = (table.rows.len(), table.first_sequence());
        let racket_names: Vec<&str> = rackets.iter().map(|r| r.name.as_str()).collect();
        let ball_names: Vec<&str> = balls.iter().map(|b| b.name.as_str()).collect();
        let gear_of = |row: &ImpactRow| -> Result<(usize, usize), String> {
            if let Some(why) = &row.fault {
                return Err(why.to_string());
            }
            if let Some(why) = unpredicted.get(&row.id) {
                return Err(why.clone());
            }
            if let Some(why) = impossible(INPUTS.iter().zip(&row.inputs).chain(OUTPUTS.iter().zip(&row.outputs))) {
                return Err(why);
            }
            let racket = pick("racket", row.racket.as_deref(), &racket_names);
            let ball = pick("ball", row.ball.as_deref(), &ball_names);
            racket.and_then(|racket| Ok((racket, ball?))).map_err(|e| e.to_string())
        };
        let (mut unusable, mut sound, mut picked) = (Vec::new(), Vec::new(), Vec::new());
        for row in &table.rows {
            match gear_of(row) {
                Ok(gear) => {
                    sound.push(row);
                    picked.push(gear);
                }
                Err(why) => unusable.push((row.id.clone(), why)),
            }
        }
        // What such rows state must not tell the noise of the others either.
        let kept;
        let table = if unusable.is_empty() {
            table
        } else {
            kept = ImpactTable { rows: sound.into_iter().cloned().collect(), ..ImpactTable::default() };
            &kept
        };
        let column = |output: bool, i: usize| -> Vec<_> { table.rows.iter().map(|r| if output { r.outputs[i] } else { r.inputs[i] }).collect() };
        let input_noise: Vec<_> = INPUTS.iter().enumerate().map(|(i, c)| ColumnNoise::of(c, &column(false, i))).collect();
        let output_noise: Vec<_> = OUTPUTS.iter().enumerate().map(|(i, c)| ColumnNoise::of(c, &column(true, i))).collect();
        let mut all = Observations {
            impacts: Vec::new(),
            gear: Vec::new(),
            sessions: vec!["all".to_owned()],
            input_noise,
            output_noise,
            unusable,
            lost_to_model: Vec::new(),
            group: options.group.clone(),
            keeps_outliers: false,
            notes: Vec::new(),
        };
        let mut pairs: BTreeMap<(usize, usize), usize> = BTreeMap::new();
        let spin_sd = spin_in_general(table);
        for (row, (r, b)) in table.rows.iter().zip(picked) {
            let gear = *pairs.entry((r, b)).or_insert_with(|| {
                all.gear.push(Gear { racket: rackets[r].clone(), ball: balls[b].clone() });
                all.gear.len() - 1
            });
            match all.observation(row, gear, options, &spin_sd) {
                Ok(o) => all.impacts.push(o),
                Err(reason) => all.unusable.push((row.id.clone(), reason)),
            }
        }
        let wanted: Vec<&str> = options.own_columns.iter().map(String::as_str).collect();
        let lacks_column = table.rows.iter().filter(|row| lacking(&row.groups, &wanted).is_some()).map(|row| &row.id);
        all.lost_to_model = unpredicted.keys().chain(lacks_column).cloned().collect();
        all.balance_groups(options);
        all.check(all_rows)?;
        // From 0, whatever number the table's sequence starts with, and as `predict` counts: also where the first rows cannot be used.
        all.impacts.iter_mut().for_each(|o| o.order -= first_sequence);
        all.share_sessions(table);
        all.note_assumptions(table);
        Ok(all)
    }

    fn observation(&self, row: &ImpactRow, gear: usize, options: &TableOptions, spin_sd: &Inputs) -> Result<Observation, String> {
        let wanted: Vec<&str> = options.own_columns.iter().map(String::as_str).collect();
        if let Some(why) = lacking(&row.groups, &wanted) {
            return Err(why);
        }
        let mut missing = [false; INPUTS.len()];
        let mut inputs = [0.0; INPUTS.len()];
        let mut input_sd = [0.0; INPUTS.len()];
        for (i, name) in INPUTS.iter().enumerate() {
            match row.inputs[i] {
                Some(m) => {
                    inputs[i] = m.value;
                    input_sd[i] = self.input_noise[i].sd(m.sd, m.value);
                }
                None if name.starts_with("ball_in_w") => {
                    input_sd[i] = spin_sd[i];
                    missing[i] = true;
                }
                None if *name == "grip_torque" => {}
                None => return Err(format!("`{name}` is empty; give 0 where it is known to be nothing")),
            }
        }
        let held_by = options.group.as_ref().and_then(|g| group_of(row, g)).unwrap_or(&row.id);
        let mut o = Observation {
            id: row.id.clone(),
            gear,
            order: row.sequence,
            own: OwnColumns::of(&row.groups, &wanted),
            session: 0,
            held_out: is_held_out(held_by),
            inputs,
            input_sd,
            missing,
            open_spin_sd: [0.0; 2],
            measured: Vec::new(),
            outputs: Vec::new(),
            output_sd: Vec::new(),
            shared_sd: row.shared_sd.map(|sd| sd.unwrap_or(0.0)),
            groups: row.groups.clone(),
            held_by: held_by.to_owned(),
        };
        for (k, name) in OUTPUTS.iter().enumerate() {
            if let Some(m) = row.outputs[k] {
                o.measured.push(k);
                o.outputs.push(m.value);
                let sd = self.output_noise[k].sd(m.sd, m.value);
                // A deviation of zero would give one number infinite weight.
                o.output_sd.push(match &self.output_noise[k] {
                    _ if sd > 0.0 => sd,
                    ColumnNoise::Stated(typical) => *typical,
                    _ => super::noise::assumed_sd(name),
                });
            }
        }
        if o.measured.is_empty() {
            return Err("no output was measured".into());
        }
        if is_open(&o.missing, &o.measured) {
            // The prediction is over all spins then, and none is estimated.
            for j in (0..INPUTS.len()).filter(|&j| o.missing[j]) {
                if let Some(k) = ["ball_in_wx", "ball_in_wy"].iter().position(|c| *c == INPUTS[j]) {
                    o.open_spin_sd[k] = o.input_sd[j];
                    o.input_sd[j] = 0.0;
                }
            }
        }
        Ok(o)
    }

    /// A few groups may all hash to one side: then the one whose hash is nearest to the other side changes over, for ever.
    fn balance_groups(&mut self, options: &TableOptions) {
        let Some(column) = &options.group else { return };
        let held = self.impacts.iter().filter(|o| o.held_out).count();
        let wanted = match held {
            0 => true,
            n if n == self.impacts.len() => false,
            _ => return,
        };
        let of = |o: &Observation| o.held_by.clone();
        let mut keys: Vec<String> = self.impacts.iter().map(of).collect();
        keys.sort_by(|a, b| hash_fraction(a).total_cmp(&hash_fraction(b)));
        let Some(chosen) = (if wanted { keys.first() } else { keys.last() }).cloned() else { return };
        if keys.iter().all(|k| *k == chosen) {
            return;
        }
        for o in self.impacts.iter_mut().filter(|o| of(o) == chosen) {
            o.held_out = wanted;
        }
        self.notes.push(format!(
            "all groups of `{column}` hash to one side of the held-out split; `{chosen}`, the nearest to the other, is {}",
            if wanted { "held out" } else { "fitted" }
        ));
    }

    fn check(&mut self, rows: usize) -> Result<(), ValidationError> {
        let reason = self.unusable.first().map_or_else(|| "the table is short".to_owned(), |(id, why)| format!("{id}: {why}"));
        if self.impacts.len() < FEWEST_IMPACTS {
            return Err(ValidationError::TooFew { usable: self.impacts.len(), rows, needed: FEWEST_IMPACTS, reason });
        }
        let held = self.impacts.iter().filter(|o| o.held_out).count();
        if held == 0 || held == self.impacts.len() {
            return Err(match (&self.group, self.impacts.first()) {
                (Some(column), Some(first)) => ValidationError::OneGroup { column: column.clone(), name: first.held_by.clone() },
                _ => ValidationError::NothingHeldOut,
            });
        }
        if self.impacts.len() - held < FEWEST_FITTED {
            return Err(ValidationError::TooFew { usable: self.impacts.len() - held, rows, needed: FEWEST_FITTED, reason: "the others are held out".into() });
        }
        Ok(())
    }

    /// Sessions named by a column `session` get offsets of their own when they are long enough.
    fn share_sessions(&mut self, table: &ImpactTable) {
        if !table.rows.iter().any(|r| r.groups.contains_key("session")) {
            return;
        }
        let mut count: BTreeMap<String, usize> = BTreeMap::new();
        for o in &self.impacts {
            *count.entry(o.groups.get("session").cloned().unwrap_or_default()).or_default() += 1;
        }
        let long: Vec<String> = count.iter().filter(|(_, n)| **n >= FEWEST_PER_SESSION).map(|(s, _)| s.clone()).collect();
        if long.len() < 2 || long.len() > MOST_SESSIONS || long.len() < count.len() {
            if count.len() > 1 {
                self.notes.push(format!("{} sessions are too short or too many for offsets of their own; they share one set", count.len()));
            }
            return;
        }
        for o in &mut self.impacts {
            let name = o.groups.get("session").cloned().unwrap_or_default();
            o.session = long.iter().position(|s| *s == name).unwrap_or(0);
        }
        self.sessions = long;
    }

    fn note_assumptions(&mut self, table: &ImpactTable) {
        let (mut lacking, mut assumed, mut laws) = (Vec::new(), Vec::new(), Vec::new());
        for (names, noise, output) in [(&INPUTS[..], &self.input_noise, false), (&OUTPUTS[..], &self.output_noise, true)] {
            for (i, name) in names.iter().enumerate() {
                let measured = table.rows.iter().any(|r| if output { r.outputs[i] } else { r.inputs[i] }.is_some());
                match &noise[i] {
                    ColumnNoise::Assumed(sd) if measured && *sd > 0.0 => {
                        assumed.push(format!("`{name}` {sd} {}", unit(name)));
                    }
                    ColumnNoise::Law(law) => {
                        laws.push(format!("`{name}` {:.4} + {:.4} |value|", law.constant, law.slope));
                    }
                    ColumnNoise::Stated(typical) => {
                        let cells = table.rows.iter().filter_map(|r| if output { r.outputs[i] } else { r.inputs[i] });
                        let without = cells.filter(|m| m.sd.is_none_or(|sd| output && sd <= 0.0)).count();
                        if without > 0 {
                            lacking.push(format!("`{name}` ({without} rows: {typical} {})", unit(name)));
                        }
                    }
                    _ => {}
                }
                let missing = table.rows.iter().filter(|r| r.inputs.get(i).copied().flatten().is_none()).count();
                if !output && name.starts_with("ball_in_w") && missing > 0 {
                    let sd = self.impacts.iter().find(|o| o.missing[i]).map_or(MISSING_SPIN_SD, |o| o.unmeasured_sd(i));
                    self.notes.push(format!("`{name}` is empty in {missing} rows; taken as 0 ± {sd:.0} rad/s there"));
                }
            }
        }
        if !assumed.is_empty() {
            self.notes.push(format!("no deviation is stated in these columns, and this is assumed: {}", assumed.join(", ")));
        }
        if !laws.is_empty() {
            self.notes.push(format!("deviations that follow a law are taken at the fitted value: {}", laws.join(", ")));
        }
        if !lacking.is_empty() {
            self.notes.push(format!("no deviation is stated in some rows, or 0; the usual one of the column is taken there: {}", lacking.join(", ")));
        }
        if !self.unusable.is_empty() {
            let named: Vec<String> = self.unusable.iter().map(|(id, why)| format!("{id} ({why})")).collect();
            self.notes.push(format!("left out, because they cannot be used: {}", short_list(&named, MOST_NAMED, "; ")));
        }
    }

    /// Whether the noise of most measured outputs is stated, not assumed.
    pub fn states_noise(&self) -> bool {
        let measured: Vec<usize> = (0..OUTPUTS.len()).filter(|k| self.impacts.iter().any(|o| o.measured.contains(k))).collect();
        let stated = measured.iter().filter(|k| !matches!(self.output_noise[**k], ColumnNoise::Assumed(_))).count();
        2 * stated > measured.len()
    }

    /// The rows left out, as results list them.
    pub fn left_out(&self) -> Vec<LeftOut> {
        self.unusable.iter().map(|(id, reason)| LeftOut { id: id.clone(), reason: reason.clone() }).collect()
    }

    /// Whether the table states what its shots share: they come from one calibration.
    pub fn is_footage(&self) -> bool {
        self.impacts.iter().any(|o| o.shared_sd.iter().any(|sd| *sd > 0.0))
    }

    /// The impacts of one side of the split.
    pub fn side(&self, held_out: bool) -> Vec<&Observation> {
        self.impacts.iter().filter(|o| o.held_out == held_out).collect()
    }

    /// Median stated deviation of every input over all sessions.
    pub fn usual_input_sd(&self) -> Inputs {
        std::array::from_fn(|j| median(self.impacts.iter().filter(|o| !o.missing[j]).map(|o| o.input_sd[j])))
    }

    /// Median stated deviation of every input in a session; sets the size of its shared offset.
    pub fn typical_input_sd(&self, session: usize) -> Inputs {
        std::array::from_fn(|j| self.median(session, |o| Some(o.input_sd[j]).filter(|_| !o.missing[j])))
    }

    /// Deviation of the mean of every input that some impacts of a session lack, where they are enough to tell it: that of one.
    pub fn unmeasured_sd(&self, session: usize) -> Inputs {
        std::array::from_fn(|j| {
            let without = || self.impacts.iter().filter(|o| o.session == session && o.missing[j]);
            if without().count() < FEWEST_PER_MEAN { 0.0 } else { without().map(|o| o.unmeasured_sd(j)).fold(0.0, f64::max) }
        })
    }

    /// Median stated deviation of every output in a session whose shots share a calibration (its table states what else they
    /// share), 0 in any other; sets the size of the output's shared offset.
    pub fn shared_output_sd(&self, session: usize) -> Outputs {
        if self.shared_sd(session).iter().all(|sd| *sd <= 0.0) {
            return [0.0; OUTPUTS.len()];
        }
        std::array::from_fn(|k| self.median(session, |o| o.measured.iter().position(|m| *m == k).map(|row| o.output_sd[row])))
    }

    /// Median stated deviation of what a session shares, order of [`SHARED`].
    pub fn shared_sd(&self, session: usize) -> [f64; SHARED.len()] {
        std::array::from_fn(|k| self.median(session, |o| Some(o.shared_sd[k])))
    }

    /// Root-mean-square value of every measured input and output in a session.
    pub fn typical_sizes(&self, session: usize) -> (Inputs, Outputs) {
        let rms = |of: &dyn Fn(&Observation) -> Option<f64>| {
            let values: Vec<f64> = self.impacts.iter().filter(|o| o.session == session).filter_map(of).collect();
            (values.iter().map(|v| v * v).sum::<f64>() / values.len().max(1) as f64).sqrt()
        };
        let input = |j: usize| rms(&|o| Some(o.inputs[j]).filter(|_| !o.missing[j]));
        let output = |k: usize| rms(&|o| o.measured.iter().position(|m| *m == k).map(|row| o.outputs[row]));
        (std::array::from_fn(input), std::array::from_fn(output))
    }

    fn median(&self, session: usize, of: impl Fn(&Observation) -> Option<f64>) -> f64 {
        median(self.impacts.iter().filter(|o| o.session == session).filter_map(of))
    }
}

/// The upper median; 0 of nothing.
fn median(values: impl Iterator<Item = f64>) -> f64 {
    upper_median(values).unwrap_or(0.0)
}

/// Size of the ball's incoming spin, per column, where it was not measured: that of its own column in other rows, else
/// (about the two axes in the face) that of the other one, else [`MISSING_SPIN_SD`].
fn spin_in_general(table: &ImpactTable) -> Inputs {
    const FEWEST: usize = 8;
    let size = |i: usize| {
        let seen: Vec<f64> = table.rows.iter().filter_map(|r| r.inputs[i].map(|m| m.value)).filter(|v| v.is_finite()).collect();
        (seen.len() >= FEWEST).then(|| (seen.iter().map(|v| v * v).sum::<f64>() / seen.len() as f64).sqrt().max(10.0))
    };
    let own: [Option<f64>; INPUTS.len()] = std::array::from_fn(|i| if INPUTS[i].starts_with("ball_in_w") { size(i) } else { None });
    std::array::from_fn(|i| match INPUTS[i] {
        "ball_in_wx" => own[i].or(own[i + 1]).unwrap_or(MISSING_SPIN_SD),
        "ball_in_wy" => own[i].or(own[i - 1]).unwrap_or(MISSING_SPIN_SD),
        name if name.starts_with("ball_in_w") => own[i].unwrap_or(MISSING_SPIN_SD),
        _ => 0.0,
    })
}

/// A row's group in a column: its racket, its ball, or a column the table does not know.
fn group_of<'a>(row: &'a ImpactRow, column: &str) -> Option<&'a String> {
    match column {
        "racket" => row.racket.as_ref(),
        "ball" => row.ball.as_ref(),
        other => row.groups.get(other),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    /// Impacts all alike, one for each of these names in a column of the table's own.
    fn observed(column: &str, names: &[&str], options: &TableOptions) -> Observations {
        observe(column, names, options).expect("usable")
    }

    fn observe(column: &str, names: &[&str], options: &TableOptions) -> Result<Observations, ValidationError> {
        let racket = toml::from_str(
            "name = \"r\"\nmass_kg = 0.33\nlength_m = 0.685\nbalance_m = 0.33\nstringbed_centre_m = 0.4975\nswingweight_kgm2 = 0.0325\n\
             twistweight_kgm2 = 0.0015\n[head]\ninner_length_m = 0.335\ninner_width_m = 0.255\n[strings]\ntension_lb = 60.0\n",
        )
        .expect("racket");
        let ball = toml::from_str("name = \"b\"\nmass_kg = 0.0577\ndiameter_m = 0.066\ninertia_factor = 0.6\n").expect("ball");
        let racket_columns = "racket_in_vx,racket_in_vy,racket_in_vz,racket_in_wx,racket_in_wy,racket_in_wz";
        let mut text = format!("id,ball_in_vx,ball_in_vy,ball_in_vz,{racket_columns},impact_x,impact_y,ball_out_vz,{column}\n");
        for (i, name) in names.iter().enumerate() {
            text += &format!("i{i},1,2,-25,0,0,3,0,0,0,0.01,0.02,8,{name}\n");
        }
        let table = ImpactTable::from_reader(text.as_bytes(), Path::new("t.csv")).expect("a table");
        Observations::new(&table, &[racket], &[ball], options)
    }

    fn times<'a>(n: usize, names: &[&'a str]) -> Vec<&'a str> {
        names.iter().flat_map(|name| std::iter::repeat_n(*name, n)).collect()
    }

    #[test]
    fn law_a_group_stays_whole_and_the_nearest_changes_over_where_all_hash_to_one_side() {
        let options = TableOptions { group: Some("player".to_owned()), own_columns: Vec::new() };
        // Fractions of the hashes: A 0.33, B 0.87, C 0.42, all to be fitted; Ann 0.09, Ben 0.01, Cas 0.17, all held out; D 0.25.
        for (players, held_out, told) in [
            (["A", "B", "C"], &["A"][..], Some("`A`, the nearest to the other, is held out")),
            (["Ann", "Ben", "Cas"], &["Ann", "Ben"], Some("`Cas`, the nearest to the other, is fitted")),
            (["A", "B", "D"], &["D"], None),
        ] {
            let seen = observed("player", &times(12, &players), &options);
            assert!(seen.impacts.iter().all(|o| o.held_out == held_out.contains(&o.groups["player"].as_str())), "{players:?}");
            let notes: Vec<&String> = seen.notes.iter().filter(|n| n.contains("hash to one side")).collect();
            assert!(notes.len() == usize::from(told.is_some()) && told.is_none_or(|told| notes[0].contains(told)), "{notes:?}");
        }
    }

    #[test]
    fn law_order_counts_from_the_tables_first_impact_also_where_that_cannot_be_used() {
        // Of the first four nothing tells the column that the model asks for.
        let names: Vec<String> = (0..24).map(|i| if i < 4 { String::new() } else { i.to_string() }).collect();
        let options = TableOptions { group: None, own_columns: vec!["age".to_owned()] };
        let seen = observed("age", &names.iter().map(String::as_str).collect::<Vec<_>>(), &options);
        assert_eq!((seen.impacts.len(), seen.impacts[0].order, seen.impacts[19].order), (20, 4.0, 23.0));
    }

    #[test]
    fn fails_a_grouping_column_that_is_none_is_told_with_those_there_are() {
        for (column, told) in [("player", "it has: player;"), ("ball", "it has: ball;"), ("", "it has: none;")] {
            let refused = observe(column, &["b"; 12], &TableOptions { group: Some("ball_in_vz".to_owned()), own_columns: Vec::new() });
            let words = refused.err().map(|e| e.to_string()).unwrap_or_default();
            assert!(words.contains("no grouping column `ball_in_vz`") && words.contains(told), "{words}");
        }
    }

    #[test]
    fn law_sessions_that_are_long_enough_have_offsets_of_their_own() {
        let options = TableOptions::default();
        let two = observed("session", &times(12, &["friday", "monday"]), &options);
        assert_eq!(two.sessions, ["friday", "monday"]);
        assert!(two.impacts.iter().all(|o| two.sessions[o.session] == o.groups["session"]));
        let mut names = times(12, &["friday", "monday"]);
        names.extend(["sunday"; 3]);
        let short = observed("session", &names, &options);
        assert!(short.sessions == ["all"] && short.impacts.iter().all(|o| o.session == 0));
        assert!(short.notes.iter().any(|n| n.contains("3 sessions are too short or too many")), "{:?}", short.notes);
        assert_eq!(observed("session", &times(24, &["friday"]), &options).sessions, ["all"]);
    }
}
