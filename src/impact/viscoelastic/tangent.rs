//! One visco-elastic impact with its exact derivatives: the steps of the plain run once more, in dual numbers.
//!
//! A step that ends at a kink ends later or earlier in a neighbouring impact: with g what vanishes there,
//! dt = -dg / (dg/dt), and the state moves along its rates for dt. Slip to stick is an impulse that takes the rest of the slip
//! away, and is differentiated as such.

use super::job::{Job, columns};
use super::kernel::{Mode, Signs, WHOLE, rates};
use super::lane::vanishing;
use super::lanes::{Ready, step_all};
use super::laws::Laws;
use crate::impact::dual::Dual;
use crate::impact::error::ModelError;
use crate::impact::input::{ImpactInput, ImpactOutput};

/// Directions of one pass: what fits two registers.
const TOGETHER: usize = 8;

/// Steps of about this many to a contact give derivatives good to 1e-4 of their typical size, mostly far better: a kink's place
/// errs by more than the outcome does.
pub(crate) const DERIVATIVE_STEPS: f64 = 600.0;

/// How a contact's start and laws change in one direction.
pub(crate) struct Slope {
    /// Of the input at the true centre of mass; the mount's torque acts through the laws.
    pub input: ImpactInput,
    pub laws: Laws,
}

/// The outcome and its derivative in each direction.
///
/// # Errors
/// As [`super::run`].
pub(crate) fn differentiate(ready: &Ready, steps: f64, slopes: &[Slope]) -> Result<(ImpactOutput, Vec<[f64; 13]>), ModelError> {
    let job = Job::<WHOLE>::new(&ready.at, &ready.laws, steps);
    let mut course: Vec<Step> = Vec::new();
    let mut observe = |taken: &super::lanes::Taken<WHOLE>| course.push(Step { length: taken.step, mode: taken.mode, stops: taken.stops, kink: taken.kink });
    let end = step_all::<f64, WHOLE, false>(0.0, std::slice::from_ref(&job), Some(&mut observe)).pop().unwrap_or(Err(ModelError::NotFinite))?;
    let mut rows = Vec::with_capacity(slopes.len());
    for some in slopes.chunks(TOGETHER) {
        let laws: Vec<Laws> = some.iter().map(|s| s.laws).collect();
        let inputs: Vec<[f64; 14]> = some.iter().map(|s| columns(&s.input)).collect();
        let at = columns(&ready.at.input);
        let start = std::array::from_fn(|i| Dual { value: at[i], slope: std::array::from_fn(|k| inputs.get(k).map_or(0.0, |c| c[i])) });
        let dual = Job::<WHOLE, Dual<TOGETHER>>::starting(&start, Laws::<f64>::with_slopes(&ready.laws, &laws), job.side, job.step);
        let outcome = replay(&dual, &course, end.time);
        rows.extend((0..some.len()).map(|k| outcome.map(|o| o.slope[k])));
    }
    Ok((job.output(&end), rows))
}

/// One step of the plain run.
struct Step {
    length: f64,
    mode: Mode,
    stops: bool,
    kink: Option<usize>,
}

type D = Dual<TOGETHER>;

fn replay(job: &Job<WHOLE, D>, course: &[Step], time: f64) -> [D; 13] {
    let mut s = job.state;
    let mut ends = Dual::constant(time);
    for step in course {
        let mode = Mode::<f64>::with_slopes(&step.mode, &[]);
        let at = |s: &[D; WHOLE]| rates(s, &job.laws, &job.constants, &mode);
        let moved = |d: &[D; WHOLE], by: f64| -> [D; WHOLE] { std::array::from_fn(|j| s[j] + d[j] * by) };
        let d1 = at(&s).0;
        let d2 = at(&moved(&d1, 0.5 * step.length)).0;
        let d3 = at(&moved(&d2, 0.5 * step.length)).0;
        let d4 = at(&moved(&d3, step.length)).0;
        s = std::array::from_fn(|j| s[j] + (d1[j] + (d2[j] + d3[j]) * 2.0 + d4[j]) * (step.length / 6.0));
        let (rate, signs) = at(&s);
        if let Some(kind) = step.kink {
            let later = delay(job, kind, step, &s, &rate, &signs);
            for k in 0..TOGETHER {
                ends.slope[k] += later[k];
                for j in 0..WHOLE {
                    s[j].slope[k] += rate[j].value * later[k];
                }
            }
        }
        if step.stops {
            let signs = at(&s).1;
            job.stop_slip(&mut s, [signs.slip_x, signs.slip_y]);
        }
    }
    job.outcome(&s, ends)
}

/// How much later a kink comes, per unit of each direction.
fn delay(job: &Job<WHOLE, D>, kind: usize, step: &Step, s: &[D; WHOLE], rate: &[D; WHOLE], signs: &Signs<D>) -> [f64; TOGETHER] {
    let by_displacement = job.laws.by_displacement.value > 0.0;
    let watched = vanishing(kind, by_displacement, &step.mode, signs);
    // How fast it passes: its slope along the rates.
    let along: [Dual<1>; WHOLE] = std::array::from_fn(|j| Dual { value: s[j].value, slope: [rate[j].value] });
    let laws = Laws::<f64>::with_slopes::<1>(&job.laws.lane(0), &[]);
    let passing = rates(&along, &laws, &laws.constants(), &Mode::<f64>::with_slopes(&step.mode, &[])).1;
    let speed = vanishing(kind, by_displacement, &step.mode, &passing).slope[0];
    if speed == 0.0 { [0.0; TOGETHER] } else { watched.slope.map(|g| -g / speed) }
}
