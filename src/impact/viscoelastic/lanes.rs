//! Stepping several impacts side by side, each at its own pace, to its own events.
//!
//! One classical Runge-Kutta step of order 4 for all lanes at once; then every lane decides for itself: accept, or shorten
//! its step to end at a kink (regula falsi, Illinois). Lanes never exchange numbers, so a result does not depend on its
//! neighbours, on the number of lanes or on the number of threads.

use super::kernel::{ATTITUDE, CREEP, FULL, LEDGER, Mode, PLAIN, POSITION, RATE, SLIDE, SPIN, STICK, STRINGS, Signs, VELOCITY, rates};
use super::laws::{Laws, LawsLanes};
use crate::impact::error::ModelError;
use crate::impact::input::ImpactOutput;
use crate::impact::rigid::Contact;
use nalgebra::{Quaternion, UnitQuaternion, Vector3};

/// Impacts side by side: two registers of four numbers where the processor has them.
const WIDTH: usize = 8;
/// Contact longer than this is an error of the model, s.
pub(super) const LONGEST_S: f64 = 20e-3;
/// Steps after which a contact is given up: only parameters at the edge of their range come near.
const MOST_STEPS: usize = 20_000;
/// Share of the time in which ball and strings settle that one step may take (explicit stability ends at 2.8).
const SETTLING_SHARE: f64 = 1.0;
/// Steps never get shorter than this share of the longest.
const SHORTEST_SHARE: f64 = 1.0 / 512.0;
/// How close to its kink a step must end: force (N), compression (m), force balance (N), slip (m/s), friction left (N).
const LANDING: [f64; 5] = [1e-6, 1e-10, 1e-6, 1e-7, 1e-6];
/// Slip below which a sliding contact that could stick does: the rest is taken away by one impulse, m/s. Friction would need
/// less than a microsecond for it; the error is of the order of its square.
const STICK_SLIP: f64 = 0.01;
/// Share of the slip that one sliding step may use up: its direction turns fast where it is small.
const SLIP_SHARE: f64 = 0.4;
/// The same while the slip grows and its direction follows: stability ends at 2.8.
const GROWING_SHARE: f64 = 1.5;

/// One impact ready to be stepped.
#[derive(Clone)]
pub(super) struct Job<const S: usize> {
    pub laws: Laws,
    pub state: [f64; S],
    pub side: f64,
    /// Total linear momentum at first touch, N s.
    pub momentum: Vector3<f64>,
    /// Longest step, s.
    pub step: f64,
}

/// How an impact ended.
#[derive(Clone, Copy)]
pub(super) struct End<const S: usize> {
    pub state: [f64; S],
    pub time: f64,
    pub steps: usize,
    pub peak_force: f64,
    pub peak_compression: f64,
    pub peak_deflection: f64,
}

/// Steps of about this many to a contact give better than 1e-6 of the velocities (ladder test).
pub(crate) const DEFAULT_STEPS: f64 = 80.0;

impl<const S: usize> Job<S> {
    /// Start of the contact: the ball's centre one radius above the strings, strings at rest.
    pub fn new(at: &Contact, laws: &Laws, steps: f64) -> Self {
        let i = &at.input;
        let relative = i.ball_velocity - i.racket_velocity;
        let spin = i.ball_spin * laws.ball_inertia;
        let mut state = [0.0; S];
        state[POSITION] = at.lever.x;
        state[POSITION + 1] = at.lever.y;
        state[POSITION + 2] = at.side * laws.ball_radius;
        for j in 0..3 {
            state[VELOCITY + j] = relative[j];
            state[SPIN + j] = spin[j];
            state[RATE + j] = i.racket_rate[j];
        }
        state[ATTITUDE] = 1.0;
        let stiffness = 1.0 / (1.0 / laws.k_b0 + 1.0 / laws.k_s0);
        let period = std::f64::consts::PI / (stiffness * at.normal_compliance).sqrt();
        let momentum = laws.ball_mass * i.ball_velocity + laws.racket_mass * i.racket_velocity;
        Job { laws: *laws, state, side: at.side, momentum, step: period / steps }
    }

    /// Slip velocity per unit of tangential impulse at first touch, 1/kg.
    fn slip_compliance(&self) -> f64 {
        let k = &self.laws;
        1.0 / k.ball_mass + 1.0 / k.racket_mass + k.ball_radius * k.ball_radius / k.ball_inertia
    }

    /// Takes the slip away by an impulse at the contact point, on the ball and in reverse on the racket.
    fn stop_slip(&self, s: &mut [f64; S], slip: [f64; 2]) {
        let k = &self.laws;
        let x = (k.ball_radius - self.side * s[POSITION + 2] + mode_push(s, k, self.side) - s[STRINGS]).max(0.0);
        let arm = k.ball_radius - k.lambda_r * x;
        let inertia = k.ball_inertia * (1.0 - k.kappa_i * x);
        // The pocket's normal leans where an effect tilts it; friction lies in its plane.
        let lean = Vector3::new(-k.tilt_x * s[STRINGS] * (s[POSITION] + k.com_x), -k.tilt_y * s[STRINGS] * s[POSITION + 1], 1.0).normalize();
        let c = -arm * self.side * lean;
        let p = Vector3::new(s[POSITION], s[POSITION + 1], s[POSITION + 2]) + c;
        let per_mass = 1.0 / k.ball_mass + 1.0 / k.racket_mass;
        let ball_part = per_mass + arm * arm / inertia;
        let (xx, yy) = (ball_part + p.y * p.y / k.inertia_z + p.z * p.z / k.inertia_y, ball_part + p.x * p.x / k.inertia_z + p.z * p.z / k.inertia_x);
        let xy = -p.x * p.y / k.inertia_z;
        let det = xx * yy - xy * xy;
        let (jx, jy) = ((-yy * slip[0] + xy * slip[1]) / det, (-xx * slip[1] + xy * slip[0]) / det);
        let j = Vector3::new(jx, jy, -(jx * lean.x + jy * lean.y) / lean.z);
        let (spin, turn) = (c.cross(&j), -p.cross(&j).component_div(&Vector3::new(k.inertia_x, k.inertia_y, k.inertia_z)));
        let v = |s: &[f64; S], i: usize| Vector3::new(s[i], s[i + 1], s[i + 2]);
        let surface = |s: &[f64; S]| v(s, VELOCITY) - v(s, RATE).cross(&p) + (v(s, SPIN) / inertia).cross(&c);
        let before = surface(s);
        for i in 0..3 {
            s[VELOCITY + i] += j[i] * per_mass;
            s[SPIN + i] += spin[i];
            s[RATE + i] += turn[i];
        }
        if S > PLAIN {
            s[LEDGER + 3] -= 0.5 * j.dot(&(before + surface(s)));
        }
    }

    /// Velocities and rates at the end, along the axes at first touch.
    pub fn output(&self, end: &End<S>) -> ImpactOutput {
        let s = &end.state;
        let v = |i: usize| Vector3::new(s[i], s[i + 1], s[i + 2]);
        let turn = UnitQuaternion::from_quaternion(Quaternion::new(s[ATTITUDE], s[ATTITUDE + 1], s[ATTITUDE + 2], s[ATTITUDE + 3]));
        let (m, mass) = (self.laws.ball_mass, self.laws.racket_mass);
        let relative = turn * v(VELOCITY);
        let momentum = self.momentum + Vector3::new(0.0, 0.0, self.side * self.laws.drive_force * end.time);
        let racket_velocity = (momentum - m * relative) / (m + mass);
        ImpactOutput {
            ball_velocity: racket_velocity + relative,
            // The ball regains its shape after it has left, with the angular momentum it then has.
            ball_spin: turn * v(SPIN) / self.laws.ball_inertia,
            racket_velocity,
            racket_rate: turn * v(RATE),
            contact_time: Some(end.time),
        }
    }
}

/// What the frame's modes add to the approach of ball and strings, m.
pub(super) fn mode_push<const S: usize>(s: &[f64; S], k: &Laws, side: f64) -> f64 {
    use super::kernel::{MODE, TORSION};
    if S > PLAIN { side * (k.mode_shape * s[MODE] + k.torsion_shape * s[TORSION]) } else { 0.0 }
}

/// One lane's bookkeeping.
#[derive(Clone, Copy)]
struct Lane {
    /// Which job; `None`: idle.
    job: Option<usize>,
    time: f64,
    steps: usize,
    longest: f64,
    most_steps: usize,
    /// Of the ball, m: no ball is squeezed further.
    radius: f64,
    step: f64,
    start: Signs,
    mode: Mode,
    hunt: Option<Hunt>,
    /// Slip at the last step, m/s, and whether it has fallen since the one before.
    slip_before: f64,
    falling: bool,
    /// Slip velocity per unit of tangential impulse, 1/kg; coefficient of friction.
    slip_compliance: f64,
    mu: f64,
    peak: [f64; 3],
}

/// A step being shortened until it ends at a kink.
#[derive(Clone, Copy)]
struct Hunt {
    kind: usize,
    low: (f64, f64),
    high: (f64, f64),
    tries: usize,
}

/// The watched quantity of kind `kind` over a step: at its start, at its end, and whether it has a kink in between.
fn watch(kind: usize, lane: &Lane, end: &Signs) -> (f64, f64, bool) {
    let start = &lane.start;
    let changes = |a: f64, b: f64| a.abs() > LANDING[kind] && a * b < 0.0;
    match kind {
        0 => (start.force, end.force, end.force <= 0.0),
        1 => (start.onset, end.onset, changes(start.onset, end.onset)),
        2 => (start.compressing, end.compressing, changes(start.compressing, end.compressing)),
        3 if lane.mode.stick == SLIDE => {
            let size = start.slip[0].hypot(start.slip[1]);
            let d = lane.mode.direction;
            let after = end.slip[0] * d[0] + end.slip[1] * d[1];
            (size, after, size > LANDING[3] && after <= 0.0)
        }
        4 if lane.mode.stick == STICK => (start.grip_left, end.grip_left, start.grip_left > 0.0 && end.grip_left < 0.0),
        _ => (1.0, 1.0, false),
    }
}

/// What a lane does after a step.
enum Verdict {
    /// Take the step; `true`: the mode has changed, the rates at its end must be computed anew.
    Accept(bool),
    /// Do it again with the lane's new step.
    Again,
    /// Last contact, or an error.
    Done(Result<(), ModelError>),
}

impl Lane {
    fn judge(&mut self, end: &Signs, finite: bool) -> Verdict {
        self.steps += 1;
        if !finite {
            return Verdict::Done(Err(ModelError::NotFinite));
        }
        // A ball squeezed beyond its radius is outside the equations; its contact counts as one that does not end.
        if self.steps > self.most_steps || self.time > LONGEST_S || end.onset + super::kernel::ONSET > self.radius {
            return Verdict::Done(Err(ModelError::NoRelease { elapsed_s: self.time, force_n: end.force }));
        }
        if let Some(hunt) = self.hunt {
            let (_, value, _) = watch(hunt.kind, self, end);
            if value.abs() <= LANDING[hunt.kind] || hunt.tries >= 60 || hunt.high.0 - hunt.low.0 < 1e-15 {
                return self.land(hunt.kind, end);
            }
            let mut next = Hunt { tries: hunt.tries + 1, ..hunt };
            match self.first_kink(end) {
                // A kink of another kind hides in the shorter step; it comes first.
                Some((kind, before, after)) if kind != hunt.kind => next = Hunt { kind, low: (0.0, before), high: (self.step, after), tries: next.tries },
                // The watched value's sign tells on which side of the kink this try has landed. Illinois: the end that stays
                // counts half, so that both ends move.
                _ if value * hunt.high.1 > 0.0 => {
                    next.high = (self.step, value);
                    next.low.1 *= 0.5;
                }
                _ => {
                    next.low = (self.step, value);
                    next.high.1 *= 0.5;
                }
            }
            self.hunt = Some(next);
            return self.aim();
        }
        if let Some((kind, before, after)) = self.first_kink(end) {
            if after.abs() <= LANDING[kind] {
                return self.land(kind, end);
            }
            self.hunt = Some(Hunt { kind, low: (0.0, before), high: (self.step, after), tries: 0 });
            return self.aim();
        }
        let before = self.mode.stick;
        self.accept(end);
        Verdict::Accept(self.mode.stick != before)
    }

    fn first_kink(&self, end: &Signs) -> Option<(usize, f64, f64)> {
        let mut first: Option<(usize, f64, f64, f64)> = None;
        for kind in 0..5 {
            let (before, after, kink) = watch(kind, self, end);
            if kink {
                let share = before / (before - after);
                if first.is_none_or(|f| share < f.3) {
                    first = Some((kind, before, after, share));
                }
            }
        }
        first.map(|(kind, before, after, _)| (kind, before, after))
    }

    /// Sets the step to where the watched quantity should vanish.
    fn aim(&mut self) -> Verdict {
        if let Some(h) = &self.hunt {
            let ((a, ga), (b, gb)) = (h.low, h.high);
            let share = if ga == gb { 0.5 } else { (ga / (ga - gb)).clamp(0.01, 0.99) };
            // After many tries halve: an odd function must not hold the stepper.
            self.step = if h.tries > 20 { 0.5 * (a + b) } else { a + share * (b - a) };
        }
        Verdict::Again
    }

    /// Ends the step at a kink.
    fn land(&mut self, kind: usize, end: &Signs) -> Verdict {
        self.hunt = None;
        if kind == 0 {
            self.time += self.step;
            return Verdict::Done(Ok(()));
        }
        let before = self.mode.stick;
        self.accept(end);
        // Slip that is used up without a hold, and a hold that gives way: both creep first.
        if (kind == 3 && self.mode.stick == SLIDE) || kind == 4 {
            self.mode.stick = CREEP;
            self.slip_before = 0.0;
        }
        self.pace();
        Verdict::Accept(self.mode.stick != before)
    }

    fn accept(&mut self, end: &Signs) {
        self.time += self.step;
        self.start = *end;
        let slip = end.slip[0].hypot(end.slip[1]);
        if self.mode.stick == SLIDE {
            if slip > 1e-6 {
                self.mode.direction = [end.slip[0] / slip, end.slip[1] / slip];
            }
            if slip < self.slip_before && slip <= STICK_SLIP && end.grip_left >= 0.0 {
                self.mode.stick = STICK;
            }
        } else if self.mode.stick == CREEP {
            if end.grip_left >= 0.0 {
                self.mode.stick = STICK;
            } else if slip > STICK_SLIP {
                self.mode.stick = SLIDE;
                self.mode.direction = [end.slip[0] / slip, end.slip[1] / slip];
            }
        }
        self.falling = slip < self.slip_before;
        self.slip_before = slip;
        self.pace();
        self.peak[0] = self.peak[0].max(end.force);
        self.peak[1] = self.peak[1].max(end.onset + super::kernel::ONSET);
    }

    fn pace(&mut self) {
        self.step = self.longest.min((SETTLING_SHARE * self.start.settling).max(SHORTEST_SHARE * self.longest));
        let slip = self.start.slip[0].hypot(self.start.slip[1]);
        let used = self.slip_compliance * self.mu * self.start.force * self.step;
        let share = if self.falling { SLIP_SHARE } else { GROWING_SHARE };
        if self.mode.stick == SLIDE && used > share * slip {
            self.step *= (share * slip / used).max(1.0 / 64.0);
        }
    }
}

const IDLE: Lane = Lane {
    job: None,
    time: 0.0,
    steps: 0,
    longest: 0.0,
    most_steps: MOST_STEPS,
    radius: 0.0,
    step: 0.0,
    start: Signs { force: 0.0, onset: 0.0, compressing: 0.0, slip: [0.0; 2], grip_left: 0.0, stick: [0.0; 2], settling: 0.0 },
    mode: Mode { side: 1.0, stick: SLIDE, direction: [1.0, 0.0] },
    hunt: None,
    slip_before: 0.0,
    falling: true,
    slip_compliance: 0.0,
    mu: 0.0,
    peak: [0.0; 3],
};

/// Steps all jobs to their ends, `W` side by side.
#[inline(always)]
pub(super) fn step_all<const S: usize, const W: usize>(jobs: &[Job<S>]) -> Vec<Result<End<S>, ModelError>> {
    let mut ends: Vec<Result<End<S>, ModelError>> = vec![Err(ModelError::NotFinite); jobs.len()];
    let Some(first) = jobs.first() else { return ends };
    let mut next = 0;
    let mut lanes = [IDLE; W];
    let mut laws = LawsLanes::<W>::new(&first.laws);
    // Idle lanes step a copy of the first job, and nobody looks.
    let mut state: [[f64; W]; S] = std::array::from_fn(|j| [first.state[j]; W]);
    let mut d1 = [[0.0; W]; S];
    let mut signs: SignLanes<W> = [[0.0; W]; 9];
    let (mut d2, mut d3, mut d4, mut d5) = ([[0.0; W]; S], [[0.0; W]; S], [[0.0; W]; S], [[0.0; W]; S]);
    let (mut trial, mut end) = (state, state);
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

/// Lanes' modes and signs, field by field: a record per lane would keep the compiler from using wide registers.
type ModeLanes<const W: usize> = [[f64; W]; 4];
type SignLanes<const W: usize> = [[f64; W]; 9];

fn sign_of<const W: usize>(signs: &SignLanes<W>, i: usize) -> Signs {
    Signs {
        force: signs[0][i],
        onset: signs[1][i],
        compressing: signs[2][i],
        slip: [signs[3][i], signs[4][i]],
        grip_left: signs[5][i],
        stick: [signs[6][i], signs[7][i]],
        settling: signs[8][i],
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
    let (plain, full): (Vec<usize>, Vec<usize>) = (0..contacts.len()).partition(|&i| contacts[i].laws.is_plain());
    collide_some::<PLAIN>(contacts, &plain, steps, &mut out);
    collide_some::<FULL>(contacts, &full, steps, &mut out);
    out
}

fn collide_some<const S: usize>(contacts: &[Ready], which: &[usize], steps: f64, out: &mut [Result<ImpactOutput, ModelError>]) {
    let jobs: Vec<Job<S>> = which.iter().map(|&i| Job::new(&contacts[i].at, &contacts[i].laws, steps)).collect();
    // A single impact is not worth seven idle lanes.
    let ends = if jobs.len() == 1 { step_all::<S, 1>(&jobs) } else { step_wide(&jobs) };
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
            step_all::<S, WIDTH>(self.0)
        }
    }
    pulp::Arch::new().dispatch(Wide(jobs))
}
