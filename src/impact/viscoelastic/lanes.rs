//! Stepping several impacts side by side, each at its own pace, to its own events.
//!
//! One Runge-Kutta step for all lanes at once (classical, order 4; order 8 where the ledger is kept); then every lane decides
//! for itself: accept, or shorten its step to end at a kink (regula falsi, Illinois). Lanes never exchange numbers, so a result does not depend on its
//! neighbours, on the number of lanes or on the number of threads.

use super::job::{End, Job};
use super::kernel::{CREEP, FULL, Mode, PLAIN, POSITION, RATE, SPIN, STICK, STRINGS, Signs, WHOLE, rates};
use super::lane::{CLOSE, EXACT, IDLE, LONGEST_S, Lane, MOST_STEPS, Verdict};
use super::laws::{Laws, LawsLanes};
use super::tableau::{A, B, STAGES};
use crate::impact::error::ModelError;
use crate::impact::input::ImpactOutput;
use crate::impact::rigid::Contact;

/// Impacts side by side: two registers of four numbers where the processor has them.
const WIDTH: usize = 8;
/// Steps of about this many to a contact give better than 1e-6 of the velocities (ladder test).
pub(crate) const DEFAULT_STEPS: f64 = 72.0;

/// Steps all jobs to their ends, `W` side by side; `HIGH`: with order 8, showing every step taken to `observe`.
#[inline(always)]
pub(super) fn step_all<const S: usize, const W: usize, const HIGH: bool>(
    jobs: &[Job<S>],
    observe: &mut dyn FnMut(f64, &[f64; S], &Signs),
) -> Vec<Result<End<S>, ModelError>> {
    let mut ends: Vec<Result<End<S>, ModelError>> = vec![Err(ModelError::NotFinite); jobs.len()];
    let Some(first) = jobs.first() else { return ends };
    let mut next = 0;
    let mut lanes = [IDLE; W];
    let mut laws = LawsLanes::<W>::new(&first.laws);
    // Idle lanes step a copy of the first job, and nobody looks.
    let mut state: [[f64; W]; S] = std::array::from_fn(|j| [first.state[j]; W]);
    let mut d1 = [[0.0; W]; S];
    let mut signs: SignLanes<W> = [[0.0; W]; 10];
    let (mut d2, mut d3, mut d4, mut d5) = ([[0.0; W]; S], [[0.0; W]; S], [[0.0; W]; S], [[0.0; W]; S]);
    let (mut trial, mut end) = (state, state);
    let mut stages = if HIGH { vec![d1; STAGES] } else { Vec::new() };
    loop {
        for (i, lane) in lanes.iter_mut().enumerate() {
            if lane.job.is_none() && next < jobs.len() {
                let job = &jobs[next];
                *lane = Lane {
                    job: Some(next),
                    longest: job.step,
                    most_steps: MOST_STEPS + (LONGEST_S / job.step) as usize,
                    radius: job.laws.ball_radius,
                    slip_compliance: job.slip_compliance(),
                    mu: job.laws.mu,
                    springs: S > PLAIN && job.laws.k_tx > 0.0,
                    by_displacement: job.laws.by_displacement > 0.0,
                    landing: if HIGH { &EXACT } else { &CLOSE },
                    mode: Mode { side: job.side, ..IDLE.mode },
                    ..IDLE
                };
                next += 1;
                laws.put(i, &job.laws);
                let (mut d, mut s) = rates(&job.state, &job.laws, lane.mode);
                let slip = s.slip[0].hypot(s.slip[1]);
                if slip > 0.0 {
                    lane.mode.direction = [s.slip[0] / slip, s.slip[1] / slip];
                } else {
                    lane.mode.stick = if s.grip_left >= 0.0 { STICK } else { CREEP };
                    (d, s) = rates(&job.state, &job.laws, lane.mode);
                }
                if HIGH {
                    observe(0.0, &job.state, &s);
                }
                lane.slip_before = slip;
                lane.start = s;
                lane.pace();
                for j in 0..S {
                    state[j][i] = job.state[j];
                    d1[j][i] = d[j];
                }
            }
        }
        if lanes.iter().all(|l| l.job.is_none()) {
            return ends;
        }
        let step: [f64; W] = std::array::from_fn(|i| lanes[i].step);
        let modes: ModeLanes<W> = [
            std::array::from_fn(|i| lanes[i].mode.side),
            std::array::from_fn(|i| lanes[i].mode.stick),
            std::array::from_fn(|i| lanes[i].mode.direction[0]),
            std::array::from_fn(|i| lanes[i].mode.direction[1]),
        ];
        if HIGH {
            high_step(&state, &d1, &step, &laws, &modes, &mut stages, &mut end);
        } else {
            advance(&state, &d1, &step, 0.5, &mut trial);
            rates_lanes(&trial, &laws, &modes, &mut d2, &mut signs);
            advance(&state, &d2, &step, 0.5, &mut trial);
            rates_lanes(&trial, &laws, &modes, &mut d3, &mut signs);
            advance(&state, &d3, &step, 1.0, &mut trial);
            rates_lanes(&trial, &laws, &modes, &mut d4, &mut signs);
            for j in 0..S {
                for i in 0..W {
                    end[j][i] = state[j][i] + step[i] / 6.0 * (d1[j][i] + 2.0 * (d2[j][i] + d3[j][i]) + d4[j][i]);
                }
            }
        }
        rates_lanes(&end, &laws, &modes, &mut d5, &mut signs);
        for (i, lane) in lanes.iter_mut().enumerate() {
            let Some(job) = lane.job else { continue };
            let peak = lane.peak[2].max(end[STRINGS][i]);
            let seen = sign_of(&signs, i);
            let finite = seen.force.is_finite() && end[POSITION][i].is_finite() && end[SPIN][i].is_finite() && end[RATE][i].is_finite();
            match lane.judge(&seen, finite) {
                Verdict::Again => continue,
                Verdict::Accept(changed) => {
                    lane.peak[2] = peak;
                    if HIGH {
                        observe(lane.time, &std::array::from_fn(|j| end[j][i]), &seen);
                    }
                    for j in 0..S {
                        state[j][i] = end[j][i];
                        d1[j][i] = d5[j][i];
                    }
                    if changed {
                        let mut now: [f64; S] = std::array::from_fn(|j| end[j][i]);
                        if lane.mode.stick == STICK {
                            jobs[job].stop_slip(&mut now, seen.slip);
                            for j in 0..S {
                                state[j][i] = now[j];
                            }
                        }
                        let (d, s) = rates::<S>(&now, &jobs[job].laws, lane.mode);
                        lane.start = s;
                        for j in 0..S {
                            d1[j][i] = d[j];
                        }
                    }
                }
                Verdict::Done(result) => {
                    if HIGH {
                        observe(lane.time, &std::array::from_fn(|j| end[j][i]), &seen);
                    }
                    ends[job] = result.map(|()| End {
                        state: std::array::from_fn(|j| end[j][i]),
                        time: lane.time,
                        steps: lane.steps,
                        peak_force: lane.peak[0],
                        peak_compression: lane.peak[1],
                        peak_deflection: peak,
                    });
                    lane.job = None;
                }
            }
        }
    }
}

#[inline(always)]
fn advance<const S: usize, const W: usize>(state: &[[f64; W]; S], rate: &[[f64; W]; S], step: &[f64; W], share: f64, out: &mut [[f64; W]; S]) {
    for j in 0..S {
        for i in 0..W {
            out[j][i] = state[j][i] + share * step[i] * rate[j][i];
        }
    }
}

/// One step of order 8 (Dormand and Prince). Kinks end steps, so between them the order holds.
fn high_step<const S: usize, const W: usize>(
    state: &[[f64; W]; S],
    first: &[[f64; W]; S],
    step: &[f64; W],
    laws: &LawsLanes<W>,
    modes: &ModeLanes<W>,
    stages: &mut [[[f64; W]; S]],
    end: &mut [[f64; W]; S],
) {
    let mut ignored: SignLanes<W> = [[0.0; W]; 10];
    let sum = |stages: &[[[f64; W]; S]], weights: &[f64], out: &mut [[f64; W]; S]| {
        for j in 0..S {
            for i in 0..W {
                let rate: f64 = weights.iter().zip(stages).map(|(w, k)| w * k[j][i]).sum();
                out[j][i] = state[j][i] + step[i] * rate;
            }
        }
    };
    stages[0] = *first;
    for (n, weights) in A.iter().enumerate() {
        sum(stages, weights, end);
        rates_lanes(end, laws, modes, &mut stages[n + 1], &mut ignored);
    }
    sum(stages, &B, end);
}

/// Lanes' modes and signs, field by field: a record per lane would keep the compiler from using wide registers.
type ModeLanes<const W: usize> = [[f64; W]; 4];
type SignLanes<const W: usize> = [[f64; W]; 10];

fn sign_of<const W: usize>(signs: &SignLanes<W>, i: usize) -> Signs {
    Signs {
        force: signs[0][i],
        onset: signs[1][i],
        compressing: signs[2][i],
        slip: [signs[3][i], signs[4][i]],
        grip_left: signs[5][i],
        stick: [signs[6][i], signs[7][i]],
        settling: signs[8][i],
        approach: signs[9][i],
    }
}

#[inline(always)]
fn rates_lanes<const S: usize, const W: usize>(
    state: &[[f64; W]; S],
    laws: &LawsLanes<W>,
    modes: &ModeLanes<W>,
    out: &mut [[f64; W]; S],
    signs: &mut SignLanes<W>,
) {
    for i in 0..W {
        let mode = Mode { side: modes[0][i], stick: modes[1][i], direction: [modes[2][i], modes[3][i]] };
        let (d, s) = rates::<S>(&std::array::from_fn(|j| state[j][i]), &laws.get(i), mode);
        for j in 0..S {
            out[j][i] = d[j];
        }
        signs[0][i] = s.force;
        signs[1][i] = s.onset;
        signs[2][i] = s.compressing;
        signs[3][i] = s.slip[0];
        signs[4][i] = s.slip[1];
        signs[5][i] = s.grip_left;
        signs[6][i] = s.stick[0];
        signs[7][i] = s.stick[1];
        signs[8][i] = s.settling;
        signs[9][i] = s.approach;
    }
}

/// A contact with its laws, ready to be stepped.
pub(crate) struct Ready<'a> {
    pub at: Contact<'a>,
    pub laws: Laws,
}

/// Outcomes of many contacts with about `steps` steps each; side by side where the processor can.
pub(crate) fn collide_all(contacts: &[Ready], steps: f64) -> Vec<Result<ImpactOutput, ModelError>> {
    let mut out = vec![Err(ModelError::NotFinite); contacts.len()];
    let (square, other): (Vec<usize>, Vec<usize>) = (0..contacts.len()).partition(|&i| contacts[i].laws.has_square_powers());
    let (plain, full): (Vec<usize>, Vec<usize>) = square.into_iter().partition(|&i| contacts[i].laws.is_plain());
    collide_some::<PLAIN>(contacts, &plain, steps, &mut out);
    collide_some::<FULL>(contacts, &full, steps, &mut out);
    collide_some::<WHOLE>(contacts, &other, steps, &mut out);
    out
}

fn collide_some<const S: usize>(contacts: &[Ready], which: &[usize], steps: f64, out: &mut [Result<ImpactOutput, ModelError>]) {
    let jobs: Vec<Job<S>> = which.iter().map(|&i| Job::new(&contacts[i].at, &contacts[i].laws, steps)).collect();
    // A single impact is not worth seven idle lanes.
    let ends = if jobs.len() == 1 { step_all::<S, 1, false>(&jobs, &mut |_, _, _| {}) } else { step_wide(&jobs) };
    for ((&i, job), end) in which.iter().zip(&jobs).zip(ends) {
        out[i] = end.map(|e| job.output(&e));
    }
}

/// [`step_all`] compiled for the widest registers this processor has. Without fused or reordered arithmetic, so the numbers
/// are the same on all of them.
fn step_wide<const S: usize>(jobs: &[Job<S>]) -> Vec<Result<End<S>, ModelError>> {
    struct Wide<'a, const S: usize>(&'a [Job<S>]);
    impl<const S: usize> pulp::NullaryFnOnce for Wide<'_, S> {
        type Output = Vec<Result<End<S>, ModelError>>;
        #[inline(always)]
        fn call(self) -> Self::Output {
            step_all::<S, WIDTH, false>(self.0, &mut |_, _, _| {})
        }
    }
    pulp::Arch::new().dispatch(Wide(jobs))
}
