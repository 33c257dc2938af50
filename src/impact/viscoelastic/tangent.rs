//! One visco-elastic impact with its exact derivatives: the steps of the plain run once more, in dual numbers.
//!
//! A step that ends at a kink ends later or earlier in a neighbouring impact: with g what vanishes there,
//! dt = -dg / (dg/dt), and the state moves along its rates for dt. Slip to stick is an impulse that takes the rest of the slip
//! away, and is differentiated as such.

use super::job::{Ended, Job, columns};
use super::kernel::{Mode, Signs, WHOLE, rates};
use super::lane::vanishing;
use super::lanes::{Ready, step_all};
use super::laws::Laws;
use crate::impact::dual::{Dual, TOGETHER, Tangent};
use crate::impact::error::ModelError;
use crate::impact::input::{ImpactInput, ImpactOutput};

/// Steps of about this many to a contact give derivatives good to 1e-4 of their typical size, mostly far better: a kink's place
/// errs by more than the outcome does.
pub(crate) const DERIVATIVE_STEPS: f64 = 600.0;

/// The outcome, and the same with derivatives for each of `variations`: start at the true centre of mass and laws in dual numbers.
///
/// # Errors
/// As [`super::run`].
pub(crate) fn differentiate(
    ready: &Ready,
    steps: f64,
    variations: &[(ImpactInput<Tangent>, Laws<Tangent>)],
) -> Result<(Ended, Vec<Ended<Tangent>>), ModelError> {
    let job = Job::<WHOLE>::new(&ready.at, &ready.laws, steps);
    let mut course: Vec<Step> = Vec::new();
    let mut observe = |taken: &super::lanes::Taken<WHOLE>| course.push(Step { length: taken.step, mode: taken.mode, stops: taken.stops, kink: taken.kink });
    let end = step_all::<f64, WHOLE, false>(0.0, std::slice::from_ref(&job), Some(&mut observe)).pop().unwrap_or(Err(ModelError::NotFinite))?;
    let vary = |(input, laws): &(ImpactInput<Tangent>, Laws<Tangent>)| {
        let dual = Job::<WHOLE, Tangent>::starting(&columns(input), *laws, job.side, job.step);
        let (outcome, handle) = pulp::Arch::new().dispatch(Replay { job: &dual, course: &course, time: end.time });
        Ended { output: ImpactOutput::from_columns(&outcome), handle: handle.into() }
    };
    Ok((job.ended(&end), variations.iter().map(vary).collect()))
}

/// One step of the plain run.
struct Step {
    length: f64,
    mode: Mode,
    stops: bool,
    kink: Option<usize>,
}

/// The steps once more; with the widest registers at hand for the slopes.
struct Replay<'a> {
    job: &'a Job<WHOLE, Tangent>,
    course: &'a [Step],
    time: f64,
}

impl pulp::NullaryFnOnce for Replay<'_> {
    type Output = ([Tangent; 13], [Tangent; 3]);

    #[inline(always)]
    fn call(self) -> Self::Output {
        let Replay { job, course, time } = self;
        let mut s = job.state;
        let mut ends = Dual::constant(time);
        for step in course {
            let mode = Mode::<f64>::in_dual(&step.mode);
            // Classical Runge-Kutta: weight of each stage, and how far along its rates the next one stands.
            let (mut sum, mut at) = ([Dual::constant(0.0); WHOLE], s);
            for (weight, next) in [(1.0, 0.5), (2.0, 0.5), (2.0, 1.0), (1.0, 0.0)] {
                let rate = rates(&at, &job.laws, &job.constants, &mode).0;
                for j in 0..WHOLE {
                    sum[j] += rate[j] * weight;
                    at[j] = s[j] + rate[j] * (next * step.length);
                }
            }
            for j in 0..WHOLE {
                s[j] += sum[j] * (step.length / 6.0);
            }
            if let Some(kind) = step.kink {
                let later = shift(job, kind, step, &mode, &mut s);
                for k in 0..TOGETHER {
                    ends.slope[k] += later[k];
                }
            }
            if step.stops {
                let signs = rates(&s, &job.laws, &job.constants, &mode).1;
                job.stop_slip(&mut s, [signs.slip_x, signs.slip_y]);
            }
        }
        (job.outcome(&s, ends), job.handle(&s))
    }
}

/// Moves a state to where its kink is, and says how much later that comes, per unit of each direction.
#[inline(never)]
fn shift(job: &Job<WHOLE, Tangent>, kind: usize, step: &Step, mode: &Mode<Tangent>, s: &mut [Tangent; WHOLE]) -> [f64; TOGETHER] {
    let (rate, signs) = rates(s, &job.laws, &job.constants, mode);
    let later = delay(job, kind, step, s, &rate, &signs);
    for j in 0..WHOLE {
        for k in 0..TOGETHER {
            s[j].slope[k] += rate[j].value * later[k];
        }
    }
    later
}

/// How much later a kink comes, per unit of each direction.
fn delay(job: &Job<WHOLE, Tangent>, kind: usize, step: &Step, s: &[Tangent; WHOLE], rate: &[Tangent; WHOLE], signs: &Signs<Tangent>) -> [f64; TOGETHER] {
    let by_displacement = job.laws.by_displacement.value > 0.0;
    let watched = vanishing(kind, by_displacement, &step.mode, signs);
    // How fast it passes: its slope along the rates.
    let along: [Dual<1>; WHOLE] = std::array::from_fn(|j| Dual { value: s[j].value, slope: [rate[j].value] });
    let laws = Laws::<f64>::in_dual::<1>(&job.laws.lane(0));
    let passing = rates(&along, &laws, &laws.constants(), &Mode::<f64>::in_dual(&step.mode)).1;
    let speed = vanishing(kind, by_displacement, &step.mode, &passing).slope[0];
    if speed == 0.0 { [0.0; TOGETHER] } else { watched.slope.map(|g| -g / speed) }
}
