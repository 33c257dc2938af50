//! Stepping several impacts side by side, each at its own pace, to its own events.
//!
//! One Runge-Kutta step for all lanes at once (classical, order 4; order 8 where the ledger is kept). Most lanes accept it, all
//! at once; the others decide for themselves: shorten the step to end at a kink (regula falsi, Illinois), change between slip
//! and stick, end. Lanes never exchange numbers, so a result does not depend on its neighbours, on the number of lanes or on
//! the number of threads.

use super::job::{End, Ended, Job};
use super::kernel::{CREEP, FULL, Mode, PLAIN, POSITION, RATE, SPIN, STICK, STRINGS, Signs, WHOLE, rates, rates_into};
use super::lane::{CLOSE, EXACT, Hunt, LONGEST_S, Lane, MOST_STEPS, Pace, Verdict};
use super::laws::{Constants, Laws};
use super::number::{Number, Wide};
use super::tableau::{A, B, STAGES};
use crate::impact::error::ModelError;
use crate::impact::rigid::Contact;

/// Steps of about this many to a contact give better than 1e-6 of the velocities (ladder test).
pub(crate) const DEFAULT_STEPS: f64 = 72.0;

/// Which job a lane is at, and the kink it is looking for.
#[derive(Clone, Default)]
struct Task {
    job: Option<usize>,
    hunt: Option<Hunt>,
}

/// A step that a single lane has taken.
pub(super) struct Taken<'a, const S: usize> {
    /// At its end.
    pub time: f64,
    pub state: &'a [f64; S],
    pub signs: &'a Signs,
    pub step: f64,
    /// During it.
    pub mode: Mode,
    /// At its end the rest of the slip is taken away.
    pub stops: bool,
    /// Which kind of kink it has ended at.
    pub kink: Option<usize>,
}

/// Who watches a single lane.
type Watch<'a, const S: usize> = Option<&'a mut dyn FnMut(&Taken<S>)>;

/// Steps all jobs to their ends, as many side by side as `like` has lanes; `HIGH`: with order 8. A single lane shows every step
/// it takes, and its start, to `watch`.
#[inline(always)]
pub(super) fn step_all<T: Number, const S: usize, const HIGH: bool>(like: T, jobs: &[Job<S>], mut watch: Watch<S>) -> Vec<Result<End<S>, ModelError>> {
    let mut ends: Vec<Result<End<S>, ModelError>> = vec![Err(ModelError::NotFinite); jobs.len()];
    let Some(first) = jobs.first() else { return ends };
    let landing = if HIGH { &EXACT } else { &CLOSE };
    let (half, one, two) = (like.same(0.5), like.same(1.0), like.same(2.0));
    let mut next = 0;
    let mut tasks = vec![Task::default(); T::LANES];
    // Idle lanes step a copy of the first job, and nobody looks.
    let (start, rate, begun) = begin(first);
    let mut lanes = Lane::same(like, &begun);
    let mut laws = Laws::same(like, &first.laws);
    let mut constants = Constants::same(like, &first.constants);
    let mut state: [T; S] = start.map(|x| like.same(x));
    let mut d1: [T; S] = rate.map(|x| like.same(x));
    let mut stages = if HIGH { vec![d1; STAGES] } else { Vec::new() };
    // Rates along a step, the place where they are taken, and the step's end: kept from step to step, or moving them about costs as much as
    // computing them.
    let (mut d2, mut d3, mut d4, mut d5, mut at, mut end) = (d1, d1, d1, d1, state, state);
    loop {
        for (i, task) in tasks.iter_mut().enumerate() {
            if task.job.is_some() || next >= jobs.len() {
                continue;
            }
            let job = &jobs[next];
            *task = Task { job: Some(next), hunt: None };
            next += 1;
            let (start, rate, begun) = begin(job);
            if let Some(watch) = &mut watch {
                watch(&Taken { time: 0.0, state: &start, signs: &begun.start, step: 0.0, mode: begun.mode, stops: false, kink: None });
            }
            lanes.set_lane(i, &begun);
            laws.set_lane(i, &job.laws);
            constants.set_lane(i, &job.constants);
            for j in 0..S {
                state[j].set_lane(i, start[j]);
                d1[j].set_lane(i, rate[j]);
            }
        }
        if tasks.iter().all(|t| t.job.is_none()) {
            return ends;
        }
        let step = lanes.pace.step;
        if HIGH {
            end = high_step(&state, &d1, step, &laws, &constants, &lanes.mode, &mut stages);
        } else {
            advance_into(&state, &d1, step * half, &mut at);
            rates_into(&at, &laws, &constants, &lanes.mode, &mut d2);
            advance_into(&state, &d2, step * half, &mut at);
            rates_into(&at, &laws, &constants, &lanes.mode, &mut d3);
            advance_into(&state, &d3, step, &mut at);
            rates_into(&at, &laws, &constants, &lanes.mode, &mut d4);
            let sixth = step * (1.0 / 6.0);
            for j in 0..S {
                end[j] = state[j] + sixth * (d1[j] + two * (d2[j] + d3[j]) + d4[j]);
            }
        }
        let seen = rates_into(&end, &laws, &constants, &lanes.mode, &mut d5);
        lanes.pace.steps = lanes.pace.steps + one;
        let sum = end[POSITION] + end[SPIN] + end[RATE] + seen.force;
        let finite = sum.size().less(like.same(f64::MAX));
        let mut looks = lanes.busy(&seen, finite, landing);
        for (i, task) in tasks.iter().enumerate() {
            if task.hunt.is_some() {
                looks.set_lane(i, 1.0);
            }
        }
        let ordinary = looks.less(half);
        if let Some(watch) = &mut watch
            && looks.lane(0) < 0.5
        {
            let (time, step) = (lanes.pace.time.lane(0), step.lane(0));
            let (state, signs) = (end.map(|x| x.lane(0)), seen.lane(0));
            watch(&Taken { time: time + step, state: &state, signs: &signs, step, mode: lanes.mode.lane(0), stops: false, kink: None });
        }
        lanes.accept_where(ordinary, &seen, end[STRINGS]);
        for j in 0..S {
            state[j] = T::choose(ordinary, end[j], state[j]);
            d1[j] = T::choose(ordinary, d5[j], d1[j]);
        }
        for (i, task) in tasks.iter_mut().enumerate() {
            let Some(job) = task.job else { continue };
            if looks.lane(i) < 0.5 {
                continue;
            }
            let (mut lane, signs) = (lanes.lane(i), seen.lane(i));
            let mode = lane.mode;
            let verdict = lane.judge(&mut task.hunt, &signs, end[STRINGS].lane(i), sum.lane(i).is_finite(), landing);
            lanes.set_lane(i, &lane);
            let (changed, kink) = match verdict {
                Verdict::Again => continue,
                Verdict::Accept(changed, kink) => (changed, kink),
                Verdict::Done(_) => (false, Some(0)),
            };
            let mut now: [f64; S] = std::array::from_fn(|j| end[j].lane(i));
            if let Some(watch) = &mut watch {
                let stops = changed && lane.mode.stick == STICK;
                watch(&Taken { time: lane.pace.time, state: &now, signs: &signs, step: step.lane(i), mode, stops, kink });
            }
            if let Verdict::Done(result) = verdict {
                ends[job] = result.map(|()| End {
                    state: now,
                    time: lane.pace.time,
                    steps: lane.pace.steps as usize,
                    peak_force: lane.pace.peak_force,
                    peak_compression: lane.pace.peak_compression,
                    peak_deflection: lane.pace.peak_deflection,
                });
                task.job = None;
                continue;
            }
            let mut rate: [f64; S] = std::array::from_fn(|j| d5[j].lane(i));
            if changed {
                if lane.mode.stick == STICK {
                    jobs[job].stop_slip(&mut now, [signs.slip_x, signs.slip_y]);
                }
                (rate, lane.start) = alone(&now, &jobs[job], &lane.mode);
                lanes.set_lane(i, &lane);
            }
            for j in 0..S {
                state[j].set_lane(i, now[j]);
                d1[j].set_lane(i, rate[j]);
            }
        }
    }
}

/// The rates of one impact.
#[inline(never)]
fn alone<const S: usize>(state: &[f64; S], job: &Job<S>, mode: &Mode) -> ([f64; S], Signs) {
    rates(state, &job.laws, &job.constants, mode)
}

/// A job at first touch: its state, its rates, its lane.
fn begin<const S: usize>(job: &Job<S>) -> ([f64; S], [f64; S], Lane) {
    let mut mode = Mode { side: job.side, stick: 0.0, direction_x: 1.0, direction_y: 0.0 };
    let (_, untold) = alone(&job.state, job, &mode);
    let slip = untold.slip();
    if slip > 0.0 {
        (mode.direction_x, mode.direction_y) = (untold.slip_x / slip, untold.slip_y / slip);
    } else {
        mode.stick = if untold.grip_left >= 0.0 { STICK } else { CREEP };
    }
    // With another direction than the slip's own the first friction would push it.
    let (rate, start) = alone(&job.state, job, &mode);
    let flag = |holds: bool| if holds { 1.0 } else { 0.0 };
    let pace = Pace {
        time: 0.0,
        steps: 0.0,
        most_steps: MOST_STEPS + (LONGEST_S / job.step).floor(),
        longest: job.step,
        step: 0.0,
        radius: job.laws.ball_radius,
        slip_before: slip,
        falling: 1.0,
        rise: 0.0,
        slip_compliance: job.laws.slip_compliance(),
        mu: job.laws.mu,
        springs: flag(S > PLAIN && job.laws.k_tx > 0.0),
        by_displacement: flag(job.laws.by_displacement > 0.0),
        peak_force: 0.0,
        peak_compression: 0.0,
        peak_deflection: 0.0,
    };
    let mut lane = Lane { pace, start, mode };
    lane.set_step();
    (job.state, rate, lane)
}

#[inline(always)]
fn advance_into<T: Number, const S: usize>(state: &[T; S], rate: &[T; S], step: T, out: &mut [T; S]) {
    for j in 0..S {
        out[j] = state[j] + step * rate[j];
    }
}

/// One step of order 8 (Dormand and Prince). Kinks end steps, so between them the order holds.
#[inline(always)]
fn high_step<T: Number, const S: usize>(
    state: &[T; S],
    first: &[T; S],
    step: T,
    laws: &Laws<T>,
    constants: &Constants<T>,
    mode: &Mode<T>,
    stages: &mut [[T; S]],
) -> [T; S] {
    stages[0] = *first;
    for (n, weights) in A.iter().enumerate() {
        let at = weighted(state, step, stages, weights);
        stages[n + 1] = rates(&at, laws, constants, mode).0;
    }
    weighted(state, step, stages, &B)
}

#[inline(always)]
fn weighted<T: Number, const S: usize>(state: &[T; S], step: T, stages: &[[T; S]], weights: &[f64]) -> [T; S] {
    let mut out = *state;
    for j in 0..S {
        let mut rate = step.same(0.0);
        for (weight, stage) in weights.iter().zip(stages) {
            rate = rate + stage[j] * *weight;
        }
        out[j] = state[j] + step * rate;
    }
    out
}

/// A contact with its laws, ready to be stepped.
pub(crate) struct Ready<'a> {
    pub at: Contact<'a>,
    pub laws: Laws,
}

/// Outcomes of many contacts with about `steps` steps each; side by side where the processor can.
pub(crate) fn collide_all(contacts: &[Ready], steps: f64) -> Vec<Result<Ended, ModelError>> {
    let mut out = vec![Err(ModelError::NotFinite); contacts.len()];
    let (square, other): (Vec<usize>, Vec<usize>) = (0..contacts.len()).partition(|&i| contacts[i].laws.has_square_powers());
    let (plain, full): (Vec<usize>, Vec<usize>) = square.into_iter().partition(|&i| contacts[i].laws.is_plain());
    collide_some::<PLAIN>(contacts, &plain, steps, &mut out);
    collide_some::<FULL>(contacts, &full, steps, &mut out);
    collide_some::<WHOLE>(contacts, &other, steps, &mut out);
    out
}

fn collide_some<const S: usize>(contacts: &[Ready], which: &[usize], steps: f64, out: &mut [Result<Ended, ModelError>]) {
    let jobs: Vec<Job<S>> = which.iter().map(|&i| Job::new(&contacts[i].at, &contacts[i].laws, steps)).collect();
    // A single impact is not worth seven idle lanes.
    let ends = if jobs.len() == 1 { step_all::<f64, S, false>(0.0, &jobs, None) } else { pulp::Arch::new().dispatch(SideBySide(&jobs)) };
    for ((&i, job), end) in which.iter().zip(&jobs).zip(ends) {
        out[i] = end.map(|e| job.ended(&e));
    }
}

/// [`step_all`] with the widest registers this processor has. Without fused or reordered arithmetic, so the numbers are the
/// same on all of them.
struct SideBySide<'a, const S: usize>(&'a [Job<S>]);

impl<const S: usize> pulp::WithSimd for SideBySide<'_, S> {
    type Output = Vec<Result<End<S>, ModelError>>;
    #[inline(always)]
    fn with_simd<R: pulp::Simd>(self, simd: R) -> Self::Output {
        step_all::<Wide<R>, S, false>(Wide::zero(simd), self.0, None)
    }
}
