//! Columns that do not hold what their names say: a sign turned, two axes exchanged, miles an hour for metres a second.
//!
//! A table with such a column makes every model fail, and among physical effects there is nearly always one that does some of what the mistake does. So where a
//! model fails, each mistake that a table is likely to hold is undone on the impacts, and the model is fitted again with nothing added. A reading has no number
//! of its own that the impacts could set: one that takes most of the misfit away is no accident, unless what could be added takes as much.

use super::error::ValidationError;
use super::expression::WORTH_A_FORMULA;
use super::fit::{FitOptions, fit};
use super::forward::{Forward, Inputs, Prediction};
use super::heldout::held_out_error;
use super::observation::{Observation, Observations};
use super::predicted::{predict_measured, unpredicted};
use super::refits::{SHARE, share_removed};
use crate::equipment::Racket;
use crate::impact_table::{INPUTS, OUTPUTS, unit};
use nalgebra::{DVector, Vector3};
use rayon::prelude::*;
use std::ops::RangeInclusive;

/// Impacts on which all readings are compared; the best are fitted to all.
const LOOKED_AT: usize = 60;
/// Readings that are fitted.
const FITTED: usize = 4;
/// By how much a reading must lower the mean of ln(1 + z²) to be fitted.
const CLEARLY_NEARER: f64 = 0.1;
/// Share of the impacts for which a reading may leave the model without an answer.
const UNANSWERED: f64 = 0.1;

/// Places of columns: inputs, then outputs.
type Places = RangeInclusive<usize>;
const O: usize = INPUTS.len();
const BALL_IN_V: Places = 0..=2;
const BALL_IN_W: Places = 3..=5;
const RACKET_IN_V: Places = 6..=8;
const RACKET_IN_W: Places = 9..=11;
const IMPACT: Places = IMPACT_X..=IMPACT_X + 1;
const IMPACT_X: usize = 12;
const BALL_OUT_V: Places = O..=O + 2;
const BALL_OUT_W: Places = O + 3..=O + 5;
const RACKET_OUT_V: Places = O + 6..=O + 8;
const RACKET_OUT_W: Places = O + 9..=O + 11;
const CONTACT_TIME: usize = O + 12;

/// Vectors that one program is likely to have written alike, fewest first.
const TOGETHER: [&[Places]; 15] = [
    &[BALL_IN_V],
    &[BALL_OUT_V],
    &[BALL_IN_W],
    &[BALL_OUT_W],
    &[RACKET_IN_V],
    &[RACKET_IN_W],
    &[RACKET_OUT_V],
    &[RACKET_OUT_W],
    &[BALL_IN_V, BALL_OUT_V],
    &[BALL_IN_W, BALL_OUT_W],
    &[RACKET_IN_V, RACKET_OUT_V],
    &[RACKET_IN_W, RACKET_OUT_W],
    &[BALL_IN_V, RACKET_IN_V],
    &[BALL_IN_V, BALL_OUT_V, RACKET_IN_V, RACKET_OUT_V],
    &[BALL_IN_W, BALL_OUT_W, RACKET_IN_W, RACKET_OUT_W],
];

/// Factors to SI, and the unit's name.
const SPEEDS: [(f64, &str); 3] = [(1.0 / 3.6, "km/h"), (0.447_04, "miles an hour"), (0.3048, "feet a second")];
const RATES: [(f64, &str); 3] = [
    (std::f64::consts::TAU / 60.0, "revolutions a minute"),
    (std::f64::consts::PI / 180.0, "degrees a second"),
    (std::f64::consts::TAU, "revolutions a second"),
];

/// Another reading of some columns.
#[derive(Debug, Clone, PartialEq)]
enum Reading {
    /// In another unit: by what the values are multiplied, and the unit.
    Unit(Vec<usize>, f64, &'static str),
    Turned(Vec<usize>),
    Exchanged(Vec<(usize, usize)>),
    /// Velocities of another point of the racket than its mass centre.
    VelocityOf(Vec<Places>, Point),
    /// Impact places along the racket from another point than the stringbed centre.
    PlaceFrom(Point),
}

/// A point of the racket.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Point {
    StringbedCentre,
    Impact,
    MassCentre,
    Butt,
}

impl Point {
    /// From the stringbed centre, racket axes, m.
    fn place(self, racket: &Racket, o: &Observation) -> Vector3<f64> {
        match self {
            Point::StringbedCentre => Vector3::zeros(),
            Point::Impact => Vector3::new(o.inputs[IMPACT_X], o.inputs[IMPACT_X + 1], 0.0),
            Point::MassCentre => Vector3::new(racket.balance_m - racket.stringbed_centre_m, 0.0, 0.0),
            Point::Butt => Vector3::new(-racket.stringbed_centre_m, 0.0, 0.0),
        }
    }

    fn words(self) -> &'static str {
        match self {
            Point::StringbedCentre => "the stringbed centre",
            Point::Impact => "the place of impact",
            Point::MassCentre => "the mass centre",
            Point::Butt => "the butt",
        }
    }
}

fn name(place: usize) -> &'static str {
    INPUTS.iter().chain(&OUTPUTS).nth(place).copied().unwrap_or_default()
}

impl Reading {
    /// Every reading that is tried; of two that say the same of a table the first is believed.
    fn all() -> Vec<Reading> {
        let axis = |vectors: &[Places], k: usize| vectors.iter().map(|v| v.start() + k).collect::<Vec<_>>();
        let whole = |vectors: &[Places]| vectors.iter().cloned().flatten().collect::<Vec<_>>();
        let exchanged = |vectors: &[Places], (a, b): (usize, usize)| vectors.iter().map(|v| (v.start() + a, v.start() + b)).collect::<Vec<_>>();
        let mut all = Vec::new();
        for vectors in TOGETHER {
            all.extend((0..3).map(|k| Reading::Turned(axis(vectors, k))));
        }
        all.extend(IMPACT.map(|place| Reading::Turned(vec![place])));
        all.extend(TOGETHER.iter().map(|vectors| Reading::Turned(whole(vectors))));
        all.push(Reading::Turned(IMPACT.collect()));
        for pair in [(0, 1), (0, 2), (1, 2)] {
            all.extend(TOGETHER.iter().map(|vectors| Reading::Exchanged(exchanged(vectors, pair))));
        }
        all.push(Reading::Exchanged(exchanged(&[IMPACT], (0, 1))));
        let frame = [BALL_IN_V, BALL_IN_W, RACKET_IN_V, RACKET_IN_W, IMPACT, BALL_OUT_V, BALL_OUT_W, RACKET_OUT_V, RACKET_OUT_W];
        all.push(Reading::Exchanged(exchanged(&frame, (0, 1))));
        for vectors in TOGETHER {
            let units = if unit(name(*vectors[0].start())) == "m/s" { SPEEDS } else { RATES };
            all.extend(units.map(|(factor, of)| Reading::Unit(whole(vectors), factor, of)));
        }
        all.push(Reading::Unit(vec![CONTACT_TIME], 1e-3, "milliseconds"));
        for point in [Point::StringbedCentre, Point::Impact, Point::Butt] {
            let velocities = [vec![RACKET_IN_V], vec![RACKET_OUT_V], vec![RACKET_IN_V, RACKET_OUT_V]];
            all.extend(velocities.map(|vectors| Reading::VelocityOf(vectors, point)));
        }
        all.extend([Point::MassCentre, Point::Butt].map(Reading::PlaceFrom));
        all
    }

    /// Where a column's values come from, and by what they are multiplied.
    fn source(&self, place: usize) -> (usize, f64) {
        match self {
            Reading::Unit(places, factor, _) if places.contains(&place) => (place, *factor),
            Reading::Turned(places) if places.contains(&place) => (place, -1.0),
            Reading::Exchanged(pairs) => {
                let other = pairs.iter().find_map(|&(a, b)| (a == place).then_some(b).or((b == place).then_some(a)));
                (other.unwrap_or(place), 1.0)
            }
            _ => (place, 1.0),
        }
    }

    /// An impact read so. What was not measured stays so; two columns of which one was not measured are not exchanged.
    fn of(&self, o: &Observation, racket: &Racket) -> Observation {
        let output_at = |place: usize| place.checked_sub(O).and_then(|k| o.measured.iter().position(|m| *m == k));
        let mut read = o.clone();
        for j in 0..O {
            let (from, factor) = self.source(j);
            if !o.missing[j] && !o.missing[from] {
                (read.inputs[j], read.input_sd[j]) = (factor * o.inputs[from], factor.abs() * o.input_sd[from]);
            }
        }
        for (i, k) in o.measured.iter().enumerate() {
            let (from, factor) = self.source(O + k);
            if let Some(from) = output_at(from) {
                (read.outputs[i], read.output_sd[i]) = (factor * o.outputs[from], factor.abs() * o.output_sd[from]);
            }
        }
        match self {
            Reading::PlaceFrom(point) => read.inputs[IMPACT_X] += point.place(racket, o).x,
            Reading::VelocityOf(vectors, point) => {
                let arm = point.place(racket, o) - Point::MassCentre.place(racket, o);
                for vector in vectors {
                    // The rates stand three columns behind the velocities; where one was not measured nothing is known of another point.
                    let value = |place: usize| if place < O { Some(o.inputs[place]) } else { output_at(place).map(|i| o.outputs[i]) };
                    let rates: Option<Vec<f64>> = (3..6).map(|k| value(vector.start() + k)).collect();
                    let Some(turn) = rates.map(|w| Vector3::from_row_slice(&w).cross(&arm)) else { continue };
                    for (place, by) in vector.clone().zip(turn.iter()) {
                        if place < O {
                            read.inputs[place] -= by;
                        } else if let Some(i) = output_at(place) {
                            read.outputs[i] -= by;
                        }
                    }
                }
            }
            _ => {}
        }
        read
    }

    /// A table read so.
    fn of_all(&self, observations: &Observations) -> Observations {
        let noise = |place: usize| {
            let (from, factor) = self.source(place);
            observations.input_noise.iter().chain(&observations.output_noise).nth(from).map(|noise| noise.times(factor.abs()))
        };
        Observations {
            impacts: observations.impacts.iter().map(|o| self.of(o, &observations.gear[o.gear].racket)).collect(),
            input_noise: (0..O).filter_map(noise).collect(),
            output_noise: (O..O + OUTPUTS.len()).filter_map(noise).collect(),
            ..observations.clone()
        }
    }

    /// How many columns it reads otherwise.
    fn count(&self) -> usize {
        match self {
            Reading::Unit(places, ..) | Reading::Turned(places) => places.len(),
            Reading::Exchanged(pairs) => 2 * pairs.len(),
            Reading::VelocityOf(vectors, _) => 3 * vectors.len(),
            Reading::PlaceFrom(_) => 1,
        }
    }

    /// What is wrong with the table, if this is.
    fn words(&self) -> String {
        let listed = |places: &[usize]| places.iter().map(|p| format!("`{}`", name(*p))).collect::<Vec<_>>().join(", ");
        match self {
            Reading::Unit(places, factor, of) => format!("{} in {of} (times {factor:.4})", listed(places)),
            Reading::Turned(places) => format!("{} with {} turned", listed(places), if places.len() == 1 { "its sign" } else { "their signs" }),
            Reading::Exchanged(pairs) => {
                let pairs: Vec<String> = pairs.iter().map(|(a, b)| format!("`{}` and `{}`", name(*a), name(*b))).collect();
                format!("{} exchanged", pairs.join(", "))
            }
            Reading::VelocityOf(vectors, point) => {
                format!("{} of {}, not of the mass centre", listed(&vectors.iter().cloned().flatten().collect::<Vec<_>>()), point.words())
            }
            Reading::PlaceFrom(point) => format!("`impact_x` from {}, not from the stringbed centre", point.words()),
        }
    }
}

/// A table read otherwise.
pub struct Misread {
    /// The columns, and what they seem to hold, in words.
    pub words: String,
    pub observations: Observations,
    /// The model's error on held-out impacts, read so.
    pub heldout_error: f64,
}

/// By how much the chi-square of `numbers` held-out numbers falls with their error, in units of the noise that is left.
pub fn fall(numbers: usize, from: f64, to: f64) -> f64 {
    numbers as f64 * (from.powi(2) - to.powi(2)) / to.powi(2)
}

/// Share that is gone of what an error exceeds stated noise by.
pub fn share_gone(from: f64, to: f64) -> f64 {
    share_removed((from.powi(2) - 1.0).max(0.0), (to.powi(2) - 1.0).max(0.0))
}

/// The reading of the table that takes most of the misfit away of the model as it is, whose error on held-out impacts is `error`; `None` where none takes three
/// quarters of it. `fitted`: the model's free parameters at their best on the table as written.
///
/// # Errors
/// [`ValidationError`] of a model that cannot be prepared.
pub fn misread(forward: &dyn Forward, observations: &Observations, fitted: &[f64], error: f64) -> Result<Option<Misread>, ValidationError> {
    let stated: Vec<f64> = forward.parameters().iter().map(|p| p.value).collect();
    let models = [forward.prepare(&stated)?, forward.prepare(fitted)?];
    let step = observations.impacts.len().div_ceil(LOOKED_AT).max(1);
    let some: Vec<&Observation> = observations.impacts.iter().step_by(step).collect();
    let distances = Distances::new(models[0].as_ref(), &some);
    let distance = |read: Vec<Observation>| models.iter().map(|m| distances.of(m.as_ref(), &read)).fold(f64::INFINITY, f64::min);
    let as_written = distance(some.iter().map(|o| (*o).clone()).collect());
    let read = |reading: &Reading| some.iter().map(|o| reading.of(o, &observations.gear[o.gear].racket)).collect();
    let mut near: Vec<(f64, Reading)> = Reading::all().into_par_iter().map(|reading| (distance(read(&reading)), reading)).collect();
    near.retain(|(d, _)| *d < as_written - CLEARLY_NEARER);
    // Stable: of those that say the same the first stays first.
    near.sort_by(|a, b| a.0.total_cmp(&b.0));
    near.dedup_by(|b, a| (b.0 - a.0).abs() <= 1e-9 * a.0.abs());
    near.truncate(FITTED);
    let numbers = observations.side(true).iter().map(|o| o.measured.len()).sum();
    let mut found: Vec<(usize, Misread)> = Vec::new();
    for (_, reading) in near {
        let mut read = reading.of_all(observations);
        let lost = unpredicted(forward, &read)?;
        if lost.len() as f64 > UNANSWERED * read.impacts.len() as f64 {
            continue;
        }
        read.impacts.retain(|o| !lost.contains_key(&o.id));
        // A reading under which the fit finds no answer is none.
        let Ok(refit) = fit(forward, &read, &read.side(false), &FitOptions::default(), None) else { continue };
        let Ok(after) = held_out_error(forward, &refit, &read) else { continue };
        if fall(numbers, error, after) > WORTH_A_FORMULA && share_gone(error, after) >= SHARE {
            found.push((reading.count(), Misread { words: reading.words(), observations: read, heldout_error: after }));
        }
    }
    let Some(least) = found.iter().map(|(_, m)| m.heldout_error).min_by(f64::total_cmp) else { return Ok(None) };
    // Of those that do about as well the one that needs the fewest columns: of a racket at rest nothing tells that its axes are named otherwise.
    found.retain(|(_, m)| fall(numbers, m.heldout_error, least) < WORTH_A_FORMULA);
    found.sort_by_key(|(columns, _)| *columns);
    Ok(found.into_iter().next().map(|(_, m)| m))
}

/// How far a model is from impacts, in deviations that no reading changes: those of the outputs, and of the inputs through the model.
struct Distances {
    sd: Vec<DVector<f64>>,
}

impl Distances {
    fn new(model: &dyn Prediction, impacts: &[&Observation]) -> Self {
        let one = |o: &&Observation| {
            let shifted = |j: usize| {
                let mut inputs: Inputs = o.inputs;
                inputs[j] += o.input_sd[j];
                (*o, inputs)
            };
            let asked: Vec<(&Observation, Inputs)> = std::iter::once((*o, o.inputs)).chain((0..O).filter(|&j| o.input_sd[j] > 0.0).map(shifted)).collect();
            let answers = predict_measured(model, &asked);
            let own = DVector::from_fn(o.measured.len(), |i, _| o.output_sd[i].powi(2));
            let Some(Some(here)) = answers.first() else { return own.map(f64::sqrt) };
            answers.iter().skip(1).flatten().fold(own, |sum, there| sum + (there - here).map(|d| d * d)).map(f64::sqrt)
        };
        Distances { sd: impacts.par_iter().map(one).collect() }
    }

    /// Mean of ln(1 + z²): no number counts without end, and none is too far to come nearer. Impacts without an answer are as far as infinity.
    fn of(&self, model: &dyn Prediction, read: &[Observation]) -> f64 {
        let asked: Vec<(&Observation, Inputs)> = read.iter().map(|o| (o, o.inputs)).collect();
        let answers = predict_measured(model, &asked);
        let (mut sum, mut count, mut unanswered) = (0.0, 0usize, 0usize);
        for ((o, answer), sd) in read.iter().zip(answers).zip(&self.sd) {
            let Some(answer) = answer else {
                unanswered += 1;
                continue;
            };
            sum += o.outputs.iter().zip(answer.iter().zip(sd.iter())).map(|(y, (f, sd))| ((y - f) / sd).powi(2).ln_1p()).sum::<f64>();
            count += answer.len();
        }
        if count == 0 || unanswered as f64 > UNANSWERED * read.len() as f64 { f64::INFINITY } else { sum / count as f64 }
    }
}
