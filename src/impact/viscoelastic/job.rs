//! One impact to be stepped: its start, the impulse that ends a slip, its outcome.

use super::kernel::{ATTITUDE, LEDGER, MODE, PLAIN, POSITION, RATE, SPIN, STRINGS, TORSION, VELOCITY, WHOLE};
use super::laws::{Constants, Laws};
use super::number::{Number, Three, cross, dot, each, minus, plus, times};
use crate::impact::input::{ImpactInput, ImpactOutput};
use crate::impact::real::Real;
use crate::impact::rigid::Contact;
use nalgebra::Vector3;

/// One impact ready to be stepped.
#[derive(Clone)]
pub(super) struct Job<const S: usize, T = f64> {
    pub laws: Laws<T>,
    pub constants: Constants<T>,
    pub state: [T; S],
    pub side: f64,
    /// Total linear momentum at first touch, N s.
    pub momentum: Three<T>,
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

/// What a contact ends with, along the axes at first touch.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Ended<T = f64> {
    /// The racket's velocity is that of its true centre of mass.
    pub output: ImpactOutput<T>,
    /// The racket's own x axis, turned since first touch.
    pub handle: Vector3<T>,
}

impl<const S: usize> Job<S> {
    /// Start of the contact: the ball's centre one radius above the strings, strings at rest.
    pub fn new(at: &Contact, laws: &Laws, steps: f64) -> Self {
        let stiffness = 1.0 / (1.0 / laws.k_b0 + 1.0 / laws.k_s0);
        let period = std::f64::consts::PI / (stiffness * at.normal_compliance).sqrt();
        Job::starting(&columns(&at.input), *laws, at.side, period / steps)
    }

    /// Velocities and rates at the end, along the axes at first touch.
    pub fn output(&self, end: &End<S>) -> ImpactOutput {
        ImpactOutput::from_columns(&self.outcome(&end.state, end.time))
    }

    /// The same with the racket's attitude.
    pub fn ended(&self, end: &End<S>) -> Ended {
        Ended { output: self.output(end), handle: self.handle(&end.state).into() }
    }
}

/// The columns of [`crate::impact_table::INPUTS`] that a contact starts from: all but the mount's torque.
pub(super) fn columns<T: Real>(input: &ImpactInput<T>) -> [T; 14] {
    let all = input.as_columns();
    std::array::from_fn(|i| all[i])
}

impl<T: Number, const S: usize> Job<S, T> {
    /// From the input's columns.
    pub fn starting(input: &[T; 14], laws: Laws<T>, side: f64, step: f64) -> Self {
        let (zero, one) = (laws.mu.same(0.0), laws.mu.same(1.0));
        let mut state = [zero; S];
        state[POSITION] = input[12] - laws.com_x;
        state[POSITION + 1] = input[13];
        state[POSITION + 2] = laws.ball_radius * side;
        for j in 0..3 {
            state[VELOCITY + j] = input[j] - input[6 + j];
            state[SPIN + j] = input[3 + j] * laws.ball_inertia;
            state[RATE + j] = input[9 + j];
        }
        state[ATTITUDE] = one;
        let momentum = std::array::from_fn(|j| laws.ball_mass * input[j] + laws.racket_mass * input[6 + j]);
        Job { laws, constants: laws.constants(), state, side, momentum, step }
    }

    /// Takes the slip away by an impulse at the contact point, on the ball and in reverse on the racket.
    pub fn stop_slip(&self, s: &mut [T; S], slip: [T; 2]) {
        let (k, c) = (&self.laws, &self.constants);
        let one = k.mu.same(1.0);
        let x = (k.ball_radius - s[POSITION + 2] * self.side + self.mode_push(s) - s[STRINGS]).positive_part();
        let arm = k.ball_radius - k.lambda_r * x;
        let light = one / (k.ball_inertia - c.inertia_fall * x);
        // The pocket's normal leans where an effect tilts it; friction lies in its plane, and slip is what lies in it.
        let lean = [-(k.tilt_x * s[STRINGS] * (s[POSITION] + k.com_x)), -(k.tilt_y * s[STRINGS] * s[POSITION + 1]), one];
        let normal = times(lean, one / dot(lean, lean).sqrt());
        let foot = times(normal, -(arm * self.side));
        let place = plus([s[POSITION], s[POSITION + 1], s[POSITION + 2]], foot);
        let per_inertia = [c.per_inertia_x, c.per_inertia_y, c.per_inertia_z];
        let in_plane = |x: T, y: T| [x, y, -((x * normal[0] + y * normal[1]) / normal[2])];
        let response = |j: Three<T>| {
            let du = plus(plus(times(j, c.per_mass), cross(times(cross(foot, j), light), foot)), cross(each(cross(place, j), per_inertia), place));
            minus(du, times(normal, dot(du, normal)))
        };
        let zero = one.same(0.0);
        let (a, b) = (response(in_plane(one, zero)), response(in_plane(zero, one)));
        let det = a[0] * b[1] - b[0] * a[1];
        let j = in_plane((b[0] * slip[1] - b[1] * slip[0]) / det, (a[1] * slip[0] - a[0] * slip[1]) / det);
        let (spin, turn) = (cross(foot, j), each(cross(place, j), per_inertia));
        let surface = |s: &[T; S]| {
            let three = |i: usize| [s[i], s[i + 1], s[i + 2]];
            plus(minus(three(VELOCITY), cross(three(RATE), place)), cross(times(three(SPIN), light), foot))
        };
        let before = surface(s);
        for i in 0..3 {
            s[VELOCITY + i] = s[VELOCITY + i] + j[i] * c.per_mass;
            s[SPIN + i] = s[SPIN + i] + spin[i];
            s[RATE + i] = s[RATE + i] - turn[i];
        }
        if S == WHOLE {
            s[LEDGER + 3] = s[LEDGER + 3] - dot(j, plus(before, surface(s))) * 0.5;
        }
    }

    /// What the frame's modes add to the approach of ball and strings, m.
    pub fn mode_push(&self, s: &[T; S]) -> T {
        let k = &self.laws;
        if S > PLAIN { (k.mode_shape * s[MODE] + k.torsion_shape * s[TORSION]) * self.side } else { k.mu.same(0.0) }
    }

    /// The outputs in the order of [`crate::impact_table::OUTPUTS`], along the axes at first touch.
    pub fn outcome(&self, s: &[T; S], time: T) -> [T; 13] {
        let three = |i: usize| [s[i], s[i + 1], s[i + 2]];
        let turn = |v: Three<T>| turned(s, v);
        let (m, mass) = (self.laws.ball_mass, self.laws.racket_mass);
        let relative = turn(three(VELOCITY));
        let pushed = self.laws.drive_force * self.side * time;
        let momentum = [self.momentum[0], self.momentum[1], self.momentum[2] + pushed];
        let racket = times(minus(momentum, times(relative, m)), m.same(1.0) / (m + mass));
        let ball = plus(racket, relative);
        // The ball regains its shape after it has left, with the angular momentum it then has.
        let spin = times(turn(three(SPIN)), m.same(1.0) / self.laws.ball_inertia);
        let rate = turn(three(RATE));
        [ball[0], ball[1], ball[2], spin[0], spin[1], spin[2], racket[0], racket[1], racket[2], rate[0], rate[1], rate[2], time]
    }

    /// The racket's own x axis, along the axes at first touch.
    pub fn handle(&self, s: &[T; S]) -> Three<T> {
        let zero = s[ATTITUDE].same(0.0);
        turned(s, [zero.same(1.0), zero, zero])
    }
}

/// From the racket's own axes to those at first touch.
fn turned<T: Number, const S: usize>(s: &[T; S], v: Three<T>) -> Three<T> {
    let (w, q) = (s[ATTITUDE], [s[ATTITUDE + 1], s[ATTITUDE + 2], s[ATTITUDE + 3]]);
    // Twice the inverse of the quaternion's square: it stays of unit length only as well as the steps are fine.
    let twice = w.same(2.0) / (w * w + dot(q, q));
    plus(v, times(cross(q, plus(cross(q, v), times(v, w))), twice))
}
