//! From what happened to what the table says: faults of the measurement, then noise, wrong deviations, outliers, gaps.

use super::motion::AIR_KG_M3;
use super::nature::MeasurementFaults;
use crate::impact_table::{INPUTS, ImpactRow, Measured, OUTPUTS};
use nalgebra::{Vector2, Vector3};
use rand::Rng;
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};

/// Everything the contract's table holds of one impact, without noise. Racket axes at first contact, SI.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrueImpact {
    pub ball_in: Vector3<f64>,
    pub ball_in_spin: Vector3<f64>,
    pub racket_in: Vector3<f64>,
    pub racket_in_rate: Vector3<f64>,
    pub place: Vector2<f64>,
    /// `None` where nobody measures it.
    pub grip_torque: Option<f64>,
    pub ball_out: Vector3<f64>,
    pub ball_out_spin: Vector3<f64>,
    pub racket_out: Vector3<f64>,
    pub racket_out_rate: Vector3<f64>,
    pub contact_time: f64,
}

impl TrueImpact {
    /// In the order of [`INPUTS`] and [`OUTPUTS`].
    pub fn columns(&self) -> ([Option<f64>; INPUTS.len()], [Option<f64>; OUTPUTS.len()]) {
        let (mut inputs, mut outputs) = ([None; INPUTS.len()], [None; OUTPUTS.len()]);
        for (k, v) in [self.ball_in, self.ball_in_spin, self.racket_in, self.racket_in_rate].iter().enumerate() {
            (0..3).for_each(|i| inputs[3 * k + i] = Some(v[i]));
        }
        inputs[12] = Some(self.place.x);
        inputs[13] = Some(self.place.y);
        inputs[14] = self.grip_torque;
        for (k, v) in [self.ball_out, self.ball_out_spin, self.racket_out, self.racket_out_rate].iter().enumerate() {
            (0..3).for_each(|i| outputs[3 * k + i] = Some(v[i]));
        }
        outputs[12] = Some(self.contact_time);
        (inputs, outputs)
    }

    /// What there is of these, by the columns' names.
    pub fn named(&self) -> impl Iterator<Item = (&'static str, f64)> {
        let (inputs, outputs) = self.columns();
        INPUTS.into_iter().zip(inputs).chain(OUTPUTS.into_iter().zip(outputs)).filter_map(|(name, v)| Some((name, v?)))
    }
}

/// What the faults need to know of the set-up.
#[derive(Debug, Clone, Copy)]
pub struct FaultSetting {
    /// Gravity along racket axes, m/s².
    pub gravity: Vector3<f64>,
    /// Racket's centre of mass from the point about which the hand swings it, racket axes, m.
    pub swing_arm: Vector3<f64>,
    pub ball_mass_kg: f64,
    pub ball_radius_m: f64,
}

/// What a faulty but noiseless measurement would write down.
pub fn with_faults(truth: &TrueImpact, faults: &MeasurementFaults, setting: &FaultSetting) -> TrueImpact {
    let mut seen = *truth;
    if faults.ball_flight_s != 0.0 {
        seen.ball_in = flown(truth.ball_in, -faults.ball_flight_s, setting);
        seen.ball_out = flown(truth.ball_out, faults.ball_flight_s, setting);
    }
    if faults.racket_early_s != 0.0 {
        // The hand leads the racket round: the centre of mass turns about it at the swing rate.
        let w = truth.racket_in_rate;
        let acceleration = w.cross(&w.cross(&setting.swing_arm));
        seen.racket_in = truth.racket_in - acceleration * faults.racket_early_s;
    }
    let relative = truth.ball_in - truth.racket_in;
    let side = -relative.z.signum();
    if faults.plane_offset_m != 0.0 && relative.z.abs() > 0.5 {
        // Contact is placed where the ball meets the marked plane.
        let early = faults.plane_offset_m * side / relative.z.abs();
        seen.place -= relative.xy() * early;
    }
    if faults.camera_delay_s != 0.0 {
        seen.place += relative.xy() * faults.camera_delay_s;
    }
    seen.place += faults.centre_bias_m;
    let (length, rate) = (1.0 + faults.length_scale, 1.0 + faults.time_scale);
    seen.place *= length;
    for v in [&mut seen.ball_in, &mut seen.racket_in, &mut seen.ball_out, &mut seen.racket_out] {
        *v *= length * rate;
    }
    for w in [&mut seen.ball_in_spin, &mut seen.racket_in_rate, &mut seen.ball_out_spin, &mut seen.racket_out_rate] {
        *w *= rate;
    }
    seen.contact_time /= rate;
    seen
}

/// Velocity after free flight of `time` (s, negative: before), with drag and gravity.
fn flown(velocity: Vector3<f64>, time: f64, setting: &FaultSetting) -> Vector3<f64> {
    let area = std::f64::consts::PI * setting.ball_radius_m.powi(2);
    let steps = 20;
    let dt = time / f64::from(steps);
    (0..steps).fold(velocity, |v, _| {
        let speed = v.norm();
        let drag = 0.5 * AIR_KG_M3 * area * (0.50 + 0.9 / (speed + 3.0)) / setting.ball_mass_kg;
        v + (setting.gravity - v * (drag * speed)) * dt
    })
}

/// How the table is spoilt.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct NoiseOptions {
    /// All noise relative to a good laboratory's.
    pub scale: f64,
    /// Real noise divided by what the `_sd` columns say.
    pub understated: f64,
    /// Share of impacts with one grossly wrong output, and its size in sd.
    pub outliers: f64,
    pub outlier_sd: f64,
    /// Offset shared by a whole session in every measured input, in single-impact sd.
    pub session_offset_sd: f64,
    pub sessions: usize,
    /// Share of output cells left empty at random.
    pub missing: f64,
    /// Leave out the racket's motion after impact; `None`: as the kind of session has it (court: left out).
    pub no_racket_out: Option<bool>,
    /// Only the ball spin component about the racket's x is known, before and after.
    pub one_axis_spin: bool,
    /// Leave the `_sd` columns out.
    pub no_sd: bool,
}

impl Default for NoiseOptions {
    fn default() -> Self {
        NoiseOptions {
            scale: 1.0,
            understated: 1.0,
            outliers: 0.0,
            outlier_sd: 8.0,
            session_offset_sd: 0.0,
            sessions: 1,
            missing: 0.0,
            no_racket_out: None,
            one_axis_spin: false,
            no_sd: false,
        }
    }
}

/// Single-impact standard deviations, in the order of [`INPUTS`] and [`OUTPUTS`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Deviations {
    pub inputs: [f64; INPUTS.len()],
    pub outputs: [f64; OUTPUTS.len()],
}

impl Deviations {
    /// Good footage: ball 0.1 m/s and 8 rad/s, place 1.2 mm; a hung racket is known to 0.01 m/s, a swung one to 0.06.
    pub fn of(hung: bool, scale: f64) -> Self {
        let (v, w) = if hung { (0.01, 0.05) } else { (0.06, 0.5) };
        let mut inputs = [0.1, 0.1, 0.1, 8.0, 8.0, 8.0, v, v, v, w, w, w, 1.2e-3, 1.2e-3, 0.0];
        let mut outputs = [0.1, 0.1, 0.1, 8.0, 8.0, 8.0, 0.06, 0.06, 0.06, 0.5, 0.5, 0.5, 1.5e-4];
        inputs.iter_mut().chain(&mut outputs).for_each(|s| *s *= scale);
        Deviations { inputs, outputs }
    }
}

/// One table row: `seen` with noise, `session` offsets (in sd, one per input) and gaps.
pub fn record(seen: &TrueImpact, id: &str, sd: &Deviations, session: &[f64; INPUTS.len()], hung: bool, noise: &NoiseOptions, rng: &mut impl Rng) -> ImpactRow {
    let mut row = ImpactRow::new(id);
    let (inputs, outputs) = seen.columns();
    let mut normal = || -> f64 { StandardNormal.sample(rng) };
    let stated = |sd: f64| (!noise.no_sd && sd > 0.0).then_some(sd / noise.understated);
    for i in 0..INPUTS.len() {
        let error = (normal() + session[i]) * sd.inputs[i];
        row.inputs[i] = inputs[i].map(|v| Measured { value: v + error, sd: stated(sd.inputs[i]) });
    }
    for i in 0..OUTPUTS.len() {
        let error = normal() * sd.outputs[i];
        row.outputs[i] = outputs[i].map(|v| Measured { value: v + error, sd: stated(sd.outputs[i]) });
    }
    row.outputs[12] = None; // a thousand frames a second cannot see it
    if noise.no_racket_out.unwrap_or(!hung) {
        row.outputs[6..12].fill(None);
    }
    if noise.one_axis_spin {
        row.outputs[4..6].fill(None);
        row.inputs[4..6].fill(None);
    }
    if noise.missing > 0.0 {
        for cell in row.outputs.iter_mut() {
            if rng.random::<f64>() < noise.missing {
                *cell = None;
            }
        }
    }
    if rng.random::<f64>() < noise.outliers {
        let present: Vec<usize> = (0..OUTPUTS.len()).filter(|&i| row.outputs[i].is_some()).collect();
        if !present.is_empty() {
            let i = present[rng.random_range(0..present.len())];
            let sign = if rng.random::<bool>() { 1.0 } else { -1.0 };
            if let Some(m) = &mut row.outputs[i] {
                m.value += sign * noise.outlier_sd * sd.outputs[i];
                row.groups.insert(OUTLIER_MARK.to_owned(), OUTPUTS[i].to_owned());
            }
        }
    }
    row
}

/// Group key under which [`record`] notes the spoilt column; the generator moves it into the truth.
pub(super) const OUTLIER_MARK: &str = "__outlier";
