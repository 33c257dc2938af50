//! What the exact derivatives are checked against: central differences at three steps, extrapolated (Romberg).

use super::{Column, SensitivityModel};
use crate::impact::error::ModelError;
use crate::impact::input::ImpactInput;
use crate::impact_table::{INPUTS, OUTPUTS};

/// How finely differences are taken.
#[derive(Clone, Copy)]
pub struct Fineness {
    /// First step over typical size.
    pub step: f64,
    /// An extrapolated derivative is trusted when its last correction is below this share of the output's typical change.
    pub trust: f64,
}

/// For what is computed to rounding.
pub const FINE: Fineness = Fineness { step: 1e-3, trust: 1e-6 };
/// For visco-elastic contacts that stick and slip: they are stepped to 1e-7 and their kinks wander.
pub const COARSE: Fineness = Fineness { step: 1e-2, trust: 1e-3 };
/// How often a step that straddles an edge is cut to an eighth.
const CUTS: usize = 3;
/// Sizes of the outputs against which errors are judged: m/s, rad/s, s.
pub const OUTPUT_SCALE: Column = [10.0, 10.0, 10.0, 100.0, 100.0, 100.0, 10.0, 10.0, 10.0, 10.0, 10.0, 10.0, 1e-3];

/// All derivatives by differences, inputs then parameters; `None` where they do not settle.
pub fn all(model: &SensitivityModel, input: &ImpactInput, fineness: Fineness) -> Result<Vec<Option<Column>>, ModelError> {
    (0..INPUTS.len() + model.neighbours.len()).map(|n| one(model, input, n, fineness)).collect()
}

/// The largest difference of two rows as a share of a typical change.
pub fn apart(model: &SensitivityModel, n: usize, a: &Column, b: &Column) -> f64 {
    (0..OUTPUTS.len()).map(|k| (a[k] - b[k]).abs() * model.scale(n) / OUTPUT_SCALE[k]).fold(0.0, f64::max)
}

/// One derivative; the step is cut while an edge lies within it.
fn one(model: &SensitivityModel, input: &ImpactInput, n: usize, fineness: Fineness) -> Result<Option<Column>, ModelError> {
    let scale = model.scale(n);
    let mut step = fineness.step * scale;
    for _ in 0..=CUTS {
        let [a, b, c] = [model.mean_slope(input, n, step)?, model.mean_slope(input, n, 0.5 * step)?, model.mean_slope(input, n, 0.25 * step)?];
        let once = |a: f64, b: f64| b + (b - a) / 3.0;
        let rows: [(f64, f64); OUTPUTS.len()] = std::array::from_fn(|k| {
            let (ab, bc) = (once(a[k], b[k]), once(b[k], c[k]));
            (bc + (bc - ab) / 15.0, bc - ab)
        });
        let worst = rows.iter().zip(OUTPUT_SCALE).map(|((_, error), size)| (error * scale / size).abs()).fold(0.0, f64::max);
        if worst <= fineness.trust {
            return Ok(Some(rows.map(|r| r.0)));
        }
        step *= 0.125;
    }
    Ok(None)
}
