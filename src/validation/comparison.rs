//! The model against the measurement, impact by impact: everything a reader or a report needs to see it.

use super::beside_the_tests::{beside_the_tests, mean_words};
use super::by_group::GROUP_LEVEL;
use super::error::ValidationError;
use super::fit::{Column, Fit, FitOptions, fit, fit_with_likely_offsets};
use super::forward::{Forward, FreeParameter};
use super::heldout::{CLEARLY, error_of, is_clearly_above_noise, linearise_held_out, taken_for_chance, taken_for_shared};
use super::linearise::{Linearised, OUTLIER_LISTED};
use super::lone_term::TERM_LEVEL;
use super::observation::{Observation, Observations};
use super::one_sided::one_sided;
use super::outliers_together::outliers_together;
use super::polynomial::{PolynomialFit, polynomial_fits};
use super::refits::LARGEST_NOISE_SCALE;
use super::smooth::{FaceCell, SmoothCurve, face_map, smooth};
use super::structure::{BesideSmooth, StructureTest, floor_text, is_least_floor, p_text, structure_test};
use super::tails::chi2_tail;
use super::terminal::short;
use crate::impact_table::{INPUTS, MEAN, OUTPUTS, RELATIVE, SHARED, unit};
use crate::median::upper_median;
use crate::provenance::Provenance;
use crate::short_list::short_list;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;

/// Level of the structure test alone, as `compare` uses it: that of `diagnose`, so that a model in which the latter finds
/// nothing more is not called inadequate here.
pub const COMPARE_LEVEL: f64 = super::structure::STRUCTURE_LEVEL;
/// Times the noise floor beyond which the error on groups held out whole says that the model fails, and the deviations it must be from chance.
const HELD_CLEARLY: f64 = 1.2;
const HELD_DEVIATIONS: f64 = 6.0;
/// Deviations of what a session may have beyond which an offset is no offset, but what a model lacks, and so what a number at its limit leaves: one in two million (`fit` leaves one out from four).
pub const NO_OFFSET: f64 = 5.0;
/// Groups held out that a note names.
const GROUPS_NAMED: usize = 6;
/// The file's own numbers are told to be worse than the best ones from this ratio of held-out errors on.
const STATED_WORSE: f64 = 1.05;
/// Edge of a face map's cell, m.
const FACE_CELL_M: f64 = 0.02;
/// Points of a smooth curve.
const CURVE_POINTS: usize = 41;

/// A parameter of the model with its deviation (0 when it was not fitted).
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct ParameterValue {
    pub name: String,
    pub value: f64,
    pub sd: f64,
    /// At the edge of its allowed range: the data want more.
    pub at_limit: bool,
    /// The impacts say nothing about it (friction where nothing slides): its deviation is that of its allowed range.
    #[serde(default)]
    pub undetermined: bool,
}

impl ParameterValue {
    /// Whether its range is one number: asked to be fitted, it has nowhere to go, whatever the impacts say.
    pub fn is_held(&self) -> bool {
        self.undetermined && self.sd == 0.0
    }

    /// What it means that it is at its limit. An effect's strength of nought is its absence: no wider limit would help.
    pub fn limit_words(&self) -> &'static str {
        if self.name.contains('.') && self.value == 0.0 { "at 0: the data show none of it" } else { "at its limit: the data want more than the file allows" }
    }
}

/// A row of the table that could not be used.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LeftOut {
    pub id: String,
    pub reason: String,
}

/// One output over all impacts, as contract section 9 lists it, plus its bias and unit.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct OutputSummary {
    pub name: String,
    pub unit: String,
    pub n: usize,
    pub rmse: f64,
    /// Mean of measured less predicted.
    pub bias: f64,
    /// Root-mean-square of the residual's deviation: noise of the output and of the inputs through the model.
    pub noise_sd: f64,
    pub chi2_reduced: f64,
    pub p_value: f64,
}

/// One output of one impact.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct OutputPoint {
    /// Index into [`Comparison::output_names`].
    pub output: usize,
    pub measured: f64,
    pub predicted: f64,
    /// Deviation of the residual: output noise and input noise through the model.
    pub sd: f64,
}

impl OutputPoint {
    pub fn residual(&self) -> f64 {
        self.measured - self.predicted
    }

    /// The residual in units of its own deviation.
    pub fn standardised(&self) -> f64 {
        self.residual() / self.sd
    }
}

/// One impact as measured and predicted.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct ImpactPoint {
    pub id: String,
    pub held_out: bool,
    /// In the order of [`Comparison::input_names`].
    pub inputs: Vec<f64>,
    pub outputs: Vec<OutputPoint>,
}

/// Residual of an output against an input: the smooth; the points are in [`Comparison::impacts`].
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct ResidualCurve {
    pub output: String,
    pub input: String,
    pub curve: SmoothCurve,
}

/// Mean residual of an output over the racket's face.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct FaceMap {
    pub output: String,
    pub cell_m: f64,
    pub cells: Vec<FaceCell>,
}

/// A measured number that does not belong to the rest.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Outlier {
    pub id: String,
    pub column: String,
    /// Residual given all else, in deviations.
    pub standardised: f64,
}

/// An offset that all impacts of a session share.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct SessionOffset {
    pub session: String,
    pub input: String,
    pub value: f64,
    pub sd: f64,
    pub prior_sd: f64,
    pub unit: String,
}

/// What `compare` says of a model.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Adequacy {
    Adequate,
    Inadequate,
}

impl std::fmt::Display for Adequacy {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Adequacy::Adequate => "adequate",
            Adequacy::Inadequate => "inadequate",
        })
    }
}

/// Model against measurement (compare.json).
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Comparison {
    /// By the structure test with the free parameters at their best, or because the error on held-out impacts lies far above
    /// the noise.
    pub verdict: Adequacy,
    /// How often a sound model is called inadequate.
    pub false_alarm_rate: f64,
    pub structure: StructureTest,
    pub model: String,
    pub n_impacts: usize,
    pub n_held_out: usize,
    pub outputs: Vec<OutputSummary>,
    /// Root-mean-square of residual over noise on impacts the fit never saw, and on those it saw, for the model as its
    /// file states it.
    pub heldout_error: f64,
    pub fit_error: f64,
    /// The same with the free parameters fitted.
    pub heldout_error_refitted: f64,
    /// Error of a model without fault, in units of the stated noise.
    pub noise_floor: f64,
    /// Free parameters as the file states them, and at their best.
    pub parameters_as_stated: Vec<ParameterValue>,
    pub parameters_refitted: Vec<ParameterValue>,
    pub input_names: Vec<String>,
    pub output_names: Vec<String>,
    pub impacts: Vec<ImpactPoint>,
    pub residual_curves: Vec<ResidualCurve>,
    pub face_maps: Vec<FaceMap>,
    pub polynomials: Vec<PolynomialFit>,
    pub outliers: Vec<Outlier>,
    pub session_offsets: Vec<SessionOffset>,
    #[serde(default)]
    pub left_out: Vec<LeftOut>,
    /// Of an adequate model: what its tests do not look at.
    #[serde(default)]
    pub doubts: Vec<String>,
    pub notes: Vec<String>,
    pub provenance: Option<Provenance>,
}

impl Comparison {
    /// Why the model is inadequate, in words.
    pub fn failing_words(&self) -> String {
        if self.shows_structure() {
            "the residuals hold structure that no free parameter can take up".to_owned()
        } else if self.noise_floor.powi(2) > LARGEST_NOISE_SCALE {
            format!(
                "what is left is {:.1} times the stated noise, and no smooth function of what was measured: the deviations are understated by far, or something is missing that nobody measured",
                self.noise_floor
            )
        } else if self.heldout_error_refitted > CLEARLY * self.noise_floor {
            "the error on held-out impacts is clearly above the noise, though no smooth structure shows".to_owned()
        } else {
            "what is left is not noise alone, as noted above".to_owned()
        }
    }

    /// Whether the free parameters at their best do clearly better than the file's own numbers.
    pub fn stated_is_worse(&self) -> bool {
        self.heldout_error > STATED_WORSE * self.heldout_error_refitted
    }

    /// Whether the structure test rejects the model.
    pub fn shows_structure(&self) -> bool {
        self.structure.p_value < COMPARE_LEVEL
    }

    /// Whether the model is called adequate although the structure test rejects it, because what it finds is no more than the shots
    /// of a calibration share.
    pub fn keeps_structure(&self) -> bool {
        self.verdict == Adequacy::Adequate && self.shows_structure()
    }
}

/// Compares a model, as it stands and with its free parameters at their best, with the measurement.
pub fn compare(forward: &dyn Forward, observations: &Observations, model: &str, seed: u64) -> Result<Comparison, ValidationError> {
    let seen = observations.side(false);
    let held = observations.side(true);
    let stated = fit_with_likely_offsets(forward, observations, &seen, &FitOptions { move_parameters: false, ..FitOptions::default() })?;
    let (as_stated, held_stated) = (&stated.fit, linearise_held_out(forward, &stated.fit, observations, &held)?);
    // Errors of several models are compared: all with offsets, as the fitted ones are.
    let heldout_error = match &stated.unlikely {
        Some((_, with)) => error_of(&linearise_held_out(forward, with, observations, &held)?),
        None => error_of(&held_stated),
    };
    let refitted = fit(forward, observations, &seen, &FitOptions::default(), None)?;
    let held_refitted = linearise_held_out(forward, &refitted, observations, &held)?;
    let structure = structure_test(&refitted, observations, &seen, BesideSmooth::All, seed);
    let impacts = impact_points(observations, as_stated, &held_stated);
    let signs = NormalSigns::of(impacts.iter().map(|i| i.inputs.as_slice()));
    let floor = structure.noise_scale.sqrt();
    // What `diagnose` does not believe is not believed here.
    let structured = structure.p_value < COMPARE_LEVEL;
    let disbelieved = taken_for_chance(&structure, &refitted, &held_refitted, floor)
        .or_else(|| taken_for_shared(observations, &structure, &refitted, &held_refitted))
        .filter(|_| structured);
    let too_noisy = is_more_than_noise(observations, &structure);
    let group = missed_groups(observations, &held, &held_refitted, &refitted.impacts, floor);
    let outliers = outliers(&seen, &refitted.impacts, &held, &held_refitted);
    let odd = one_sided(&outliers, observations).or_else(|| outliers_together(&outliers, observations));
    // What the model lacks may hide in an offset that it asks for in its place; of footage the table states what all shots share.
    let asked = refitted.unlikely_offset().filter(|o| o.deviations > NO_OFFSET && !observations.is_footage());
    let fails = structured && disbelieved.is_none()
        || too_noisy
        || group.is_some()
        || odd.is_some()
        || asked.is_some()
        || !stopped_words(forward, &refitted, NO_OFFSET).is_empty()
        || is_clearly_above_noise(observations, &held_refitted, &refitted, &structure);
    let present: Vec<usize> = (0..OUTPUTS.len()).filter(|k| impacts.iter().any(|i| i.outputs.iter().any(|p| p.output == *k))).collect();
    let mut notes = observations.notes.clone();
    notes.extend(stopped_words(forward, &refitted, 0.0));
    note_noise(floor, !fails, &mut notes);
    note_group_noise(&structure, &mut notes);
    note_groups(&structure, &mut notes);
    let offsets = session_offsets(observations, &refitted, structure.noise_scale);
    notes.extend(mean_words(&offsets));
    notes.extend(group);
    notes.extend(odd);
    notes.extend(asked.map(|offset| format!("even with its free parameters at their best the model asks for {offset}: it does not hold without")));
    notes.extend(stated.unlikely.as_ref().map(|(offset, _)| format!("as stated, the model asks for {offset}: residuals are shown without any offset")));
    notes.extend(disbelieved.filter(|_| !fails));
    Ok(Comparison {
        verdict: if fails { Adequacy::Inadequate } else { Adequacy::Adequate },
        false_alarm_rate: COMPARE_LEVEL + TERM_LEVEL + if structure.columns_of_groups > 0 { GROUP_LEVEL } else { 0.0 },
        model: model.to_owned(),
        n_impacts: observations.impacts.len(),
        n_held_out: held.len(),
        outputs: summarise(&as_stated.impacts, &held_stated),
        heldout_error,
        fit_error: error_of(&stated.with_offsets().impacts),
        heldout_error_refitted: error_of(&held_refitted),
        noise_floor: floor,
        parameters_as_stated: forward
            .parameters()
            .iter()
            .map(|p| ParameterValue { name: p.name.clone(), value: p.value, sd: 0.0, at_limit: p.value <= p.min || p.value >= p.max, undetermined: false })
            .collect(),
        parameters_refitted: parameter_values(forward, &refitted, structure.noise_scale),
        input_names: (0..=INPUTS.len()).map(|j| coordinate_name(j).to_owned()).collect(),
        output_names: OUTPUTS.iter().map(|s| (*s).to_owned()).collect(),
        residual_curves: residual_curves(&impacts, &signs, &present, &varied_coordinates(observations)),
        face_maps: face_maps(&impacts, &signs, &present),
        polynomials: polynomial_fits(&impacts, &varied_inputs(observations)),
        outliers,
        session_offsets: offsets,
        impacts,
        structure,
        left_out: observations.left_out(),
        doubts: if fails { Vec::new() } else { beside_the_tests(&seen, &refitted.impacts, &held, &held_refitted) },
        notes,
        provenance: None,
    })
}

/// Parameters that the limits of the model keep by `deviations` and more from what the impacts say, in words.
pub fn stopped_words(forward: &dyn Forward, fit: &Fit, deviations: f64) -> Vec<String> {
    let words = |(i, p): (usize, &FreeParameter)| {
        fit.stopped_by(i).filter(|by| *by >= deviations)?;
        let (limit, word, key) = if p.limit_at(fit.values[i])? > 0.0 { (p.max, "most", "max") } else { (p.min, "least", "min") };
        Some(format!(
            "{} is at {}, the {word} that the model allows, and the impacts want it farther: what it cannot take up counts as misfit, and what is named may stand for it; give it more room (`{key}`) where physics does.",
            p.name,
            short(limit)
        ))
    };
    forward.parameters().iter().enumerate().filter_map(words).collect()
}

/// Whether residuals without any structure are so much larger than the noise the table states that they are not believed to be
/// noise.
pub fn is_more_than_noise(observations: &Observations, structure: &StructureTest) -> bool {
    observations.states_noise() && structure.noise_scale > LARGEST_NOISE_SCALE
}

/// Says that the model does not carry over to the groups held out: their error is far above that of the impacts it was fitted to (and above
/// the noise `floor`: of a table without noise both errors are rounding), beyond what offsets of their own (half a deviation of every input) and chance can do.
pub fn missed_groups(observations: &Observations, held: &[&Observation], linearised: &[Linearised], fitted: &[Linearised], floor: f64) -> Option<String> {
    let column = observations.group.as_ref()?;
    let numbers: usize = linearised.iter().map(|l| l.z.len()).sum();
    let (error, others) = (error_of(linearised), error_of(fitted).max(floor));
    let chance = 1.0 + HELD_DEVIATIONS * (2.0 / numbers.max(1) as f64).sqrt();
    if error < HELD_CLEARLY * others || (error / others).powi(2) < chance {
        return None;
    }
    let names: BTreeSet<&str> = held.iter().map(|o| o.held_by.as_str()).collect();
    let quoted: Vec<String> = names.into_iter().map(|n| format!("`{n}`")).collect();
    let shown = short_list(&quoted, GROUPS_NAMED, ", ");
    Some(format!(
        "the model does not carry over to the groups of `{column}` that were held out ({shown}): their error is {error:.2} where that of the others is {others:.2}"
    ))
}

/// Says when the noise seems wrongly stated: `factor` is what the best model leaves, in units of the stated noise, `sound`
/// whether that model leaves no structure (else the rest need not be noise).
pub fn note_noise(factor: f64, sound: bool, notes: &mut Vec<String>) {
    if (0.9..=1.1).contains(&factor) {
        return;
    }
    let size = factor.max(1.0 / factor);
    notes.push(if factor < 1.0 {
        let (floor, more) = (floor_text(factor), if is_least_floor(factor) { " or more" } else { "" });
        format!(
            "the noise is overstated by a factor {size:.2}{more}: with all structure taken out, residuals are {floor} times the stated noise; all tests and deviations here use the noise corrected by {size:.2}"
        )
    } else if sound {
        format!(
            "the noise is understated by a factor {size:.2}, or something is missing that is no smooth function of what was measured: with all structure taken out, residuals are {factor:.2} times the stated noise; all tests and deviations here use the larger noise"
        )
    } else {
        format!(
            "what no smooth correction takes out is {factor:.2} times the stated noise: the noise is understated, or what is missing is not smooth; a model without fault will tell"
        )
    });
}

/// Says which group of outputs has its noise stated wrongly beside the others, when that is beyond chance (three deviations).
pub fn note_group_noise(structure: &StructureTest, notes: &mut Vec<String>) {
    for group in &structure.noise_by_group {
        let factor = (group.scale / structure.noise_scale).sqrt();
        if group.freedom <= 0.0 || factor.ln().abs() / (0.5 / group.freedom).sqrt() < 3.0 || (0.8..=1.25).contains(&factor) {
            continue;
        }
        let columns = if group.outputs == "contact_time" { "`contact_time`".to_owned() } else { format!("`{}x`, `y`, `z`", group.outputs) };
        notes.push(format!("the noise of {columns} is {factor:.2} times that of the other outputs, each in its stated deviations"));
    }
}

/// Says where the model fails otherwise than elsewhere, and by what single term.
pub fn note_groups(structure: &StructureTest, notes: &mut Vec<String>) {
    notes.extend(structure.lone_term.map(|term| format!("one simple term stands out ({}): {}", p_text(term.p_value), term.words())));
    for g in &structure.by_group {
        notes.push(format!(
            "the model does not fail alike in all groups of `{}` ({}): {}; what differs between them (a racket's mass, its stringing, a camera, units) is where to look, and one table for each will tell; where the column \
             holds numbers, an expression can use it (`column.{}`)",
            g.column,
            p_text(g.p_value),
            g.words(),
            g.column
        ));
    }
}

/// Inputs that vary by more than three times their noise (those a residual can be read against).
pub fn varied_inputs(observations: &Observations) -> Vec<usize> {
    let noise = observations.usual_input_sd();
    (0..INPUTS.len())
        .filter(|&j| {
            let n = observations.impacts.len() as f64;
            let mean = observations.impacts.iter().map(|o| o.inputs[j]).sum::<f64>() / n;
            let sd = (observations.impacts.iter().map(|o| (o.inputs[j] - mean).powi(2)).sum::<f64>() / n).sqrt();
            sd > 3.0 * noise[j] && sd > 1e-9
        })
        .collect()
}

/// What a residual is read against: the inputs that vary, and the order of the impacts (number [`INPUTS`]`.len()`).
pub fn varied_coordinates(observations: &Observations) -> Vec<usize> {
    let mut varied = varied_inputs(observations);
    varied.extend(observations.impacts.windows(2).any(|two| two[0].order != two[1].order).then_some(INPUTS.len()));
    varied
}

/// Its column's name.
pub fn coordinate_name(coordinate: usize) -> &'static str {
    INPUTS.get(coordinate).copied().unwrap_or("order")
}

/// Where both faces of a racket are hit, what a blow on its back reverses is averaged along the normal of the face that is hit:
/// two halves of one fault must not cancel. Of one face everything stands as it is.
pub struct NormalSigns {
    both: bool,
}

impl NormalSigns {
    /// From the inputs of all impacts, order of [`INPUTS`].
    pub fn of<'a>(inputs: impl Iterator<Item = &'a [f64]>) -> Self {
        let (mut front, mut back) = (false, false);
        for x in inputs {
            if comes_from_above(x) {
                front = true;
            } else {
                back = true;
            }
        }
        NormalSigns { both: front && back }
    }

    /// By what the residual of an output is to be multiplied.
    pub fn of_output(&self, output: &str, inputs: &[f64]) -> f64 {
        let reversed = matches!(output, "ball_out_vz" | "racket_out_vz" | "racket_out_wx" | "racket_out_wy");
        if self.both && reversed && !comes_from_above(inputs) { -1.0 } else { 1.0 }
    }
}

/// Whether the ball comes to the face on the side of +z.
fn comes_from_above(inputs: &[f64]) -> bool {
    inputs[2] - inputs[8] < 0.0
}

/// Impacts in the table's order, both sides of the split.
fn impact_points(observations: &Observations, fitted: &Fit, held: &[Linearised]) -> Vec<ImpactPoint> {
    let (mut seen, mut unseen) = (fitted.impacts.iter(), held.iter());
    observations
        .impacts
        .iter()
        .filter_map(|o| {
            let l = if o.held_out { unseen.next() } else { seen.next() }?;
            Some(ImpactPoint {
                id: o.id.clone(),
                held_out: o.held_out,
                inputs: o.inputs.iter().copied().chain([o.order]).collect(),
                outputs: l
                    .measured
                    .iter()
                    .enumerate()
                    .map(|(row, &k)| OutputPoint { output: k, measured: o.outputs[row], predicted: l.predicted[row], sd: l.covariance[(row, row)].sqrt() })
                    .collect(),
            })
        })
        .collect()
}

/// Per-output figures over all impacts.
pub fn summarise(seen: &[Linearised], held: &[Linearised]) -> Vec<OutputSummary> {
    (0..OUTPUTS.len())
        .filter_map(|k| {
            let cells: Vec<(f64, f64)> = seen
                .iter()
                .chain(held)
                .filter_map(|l| l.measured.iter().position(|m| *m == k).map(|row| (l.residual[row], l.covariance[(row, row)])))
                .collect();
            // The usual one: a few impacts that are hardly known must not make it theirs.
            let noise = upper_median(cells.iter().map(|c| c.1))?;
            let n = cells.len() as f64;
            let chi2: f64 = cells.iter().map(|(r, v)| r * r / v).sum();
            Some(OutputSummary {
                name: OUTPUTS[k].to_owned(),
                unit: unit(OUTPUTS[k]).to_owned(),
                n: cells.len(),
                rmse: (cells.iter().map(|(r, _)| r * r).sum::<f64>() / n).sqrt(),
                bias: cells.iter().map(|(r, _)| r).sum::<f64>() / n,
                noise_sd: noise.sqrt(),
                chi2_reduced: chi2 / n,
                p_value: chi2_tail(chi2, n),
            })
        })
        .collect()
}

fn residual_curves(impacts: &[ImpactPoint], signs: &NormalSigns, present: &[usize], varied: &[usize]) -> Vec<ResidualCurve> {
    let mut curves = Vec::new();
    for &k in present {
        for &j in varied {
            let points: Vec<(f64, f64)> = impacts
                .iter()
                .flat_map(|i| {
                    i.outputs.iter().filter(move |p| p.output == k).map(move |p| (i.inputs[j], signs.of_output(OUTPUTS[k], &i.inputs) * p.residual()))
                })
                .collect();
            if let Some(curve) = smooth(&points, CURVE_POINTS) {
                curves.push(ResidualCurve { output: OUTPUTS[k].to_owned(), input: coordinate_name(j).to_owned(), curve });
            }
        }
    }
    curves
}

fn face_maps(impacts: &[ImpactPoint], signs: &NormalSigns, present: &[usize]) -> Vec<FaceMap> {
    let map_of = |&k: &usize| {
        let of_impact = |i: &ImpactPoint| {
            let (x, y, sign) = (i.inputs[12], i.inputs[13], signs.of_output(OUTPUTS[k], &i.inputs));
            i.outputs.iter().filter(|p| p.output == k).map(|p| (x, y, sign * p.residual())).collect::<Vec<_>>()
        };
        let points: Vec<(f64, f64, f64)> = impacts.iter().flat_map(of_impact).collect();
        FaceMap { output: OUTPUTS[k].to_owned(), cell_m: FACE_CELL_M, cells: face_map(&points, FACE_CELL_M) }
    };
    present.iter().map(map_of).collect()
}

/// Free parameters at their best with their deviations at noise scale `c`.
pub fn parameter_values(forward: &dyn Forward, fit: &Fit, c: f64) -> Vec<ParameterValue> {
    forward
        .parameters()
        .iter()
        .enumerate()
        .map(|(i, p)| {
            let value = fit.values[i];
            let at_limit = p.limit_at(value).is_some();
            let undetermined = p.min >= p.max || !(fit.stopped_by(i).is_some() || fit.is_informed(i));
            // Uniform over the range: its deviation.
            let sd = if undetermined { (p.max - p.min).abs() / 12f64.sqrt() } else { fit.sd(i, c) };
            ParameterValue { name: p.name.clone(), value, sd, at_limit, undetermined }
        })
        .collect()
}

/// Cells that stick out, by id, worst first.
pub fn outliers(seen: &[&Observation], fitted: &[Linearised], held: &[&Observation], held_fitted: &[Linearised]) -> Vec<Outlier> {
    let mut found: Vec<Outlier> = seen
        .iter()
        .zip(fitted)
        .chain(held.iter().zip(held_fitted))
        .flat_map(|(o, l)| {
            l.outliers.iter().filter(|c| c.standardised.abs() > OUTLIER_LISTED).map(|c| Outlier {
                id: o.id.clone(),
                column: c.name().to_owned(),
                standardised: c.standardised,
            })
        })
        .collect();
    found.sort_by(|a, b| b.standardised.abs().total_cmp(&a.standardised.abs()).then_with(|| a.id.cmp(&b.id)));
    found
}

/// The fitted offsets and face poses.
pub fn session_offsets(observations: &Observations, fit: &Fit, c: f64) -> Vec<SessionOffset> {
    fit.columns
        .iter()
        .enumerate()
        .filter_map(|(i, column)| {
            let (session, name, unit) = match *column {
                Column::Offset { session, input } => (session, INPUTS[input].to_owned(), unit(INPUTS[input])),
                Column::Unmeasured { session, input } => (session, format!("{}{MEAN}", INPUTS[input]), unit(INPUTS[input])),
                Column::OutputOffset { session, output } => (session, OUTPUTS[output].to_owned(), unit(OUTPUTS[output])),
                Column::InputScale { session, input } => (session, in_proportion(INPUTS[input]), ""),
                Column::OutputScale { session, output } => (session, in_proportion(OUTPUTS[output]), ""),
                Column::Shared { session, component } => (session, SHARED[component].to_owned(), unit(SHARED[component])),
                Column::Parameter(_) => return None,
            };
            Some(SessionOffset {
                session: observations.sessions[session].clone(),
                input: name,
                value: fit.column_values[i],
                sd: (c * fit.covariance[(i, i)]).max(0.0).sqrt(),
                prior_sd: fit.prior_precision[i].powf(-0.5),
                unit: unit.to_owned(),
            })
        })
        .collect()
}

/// Name of a column's error in proportion.
fn in_proportion(column: &str) -> String {
    format!("{column}{RELATIVE}")
}
