//! One impact to be stepped: its start, the impulse that ends a slip, its outcome.

use super::kernel::{ATTITUDE, LEDGER, PLAIN, POSITION, RATE, SPIN, STRINGS, VELOCITY, WHOLE};
use super::laws::{Constants, Laws};
use crate::impact::input::ImpactOutput;
use crate::impact::rigid::Contact;
use nalgebra::{Quaternion, UnitQuaternion, Vector3};

/// One impact ready to be stepped.
#[derive(Clone)]
pub(super) struct Job<const S: usize> {
    pub laws: Laws,
    pub constants: Constants,
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
        Job { laws: *laws, constants: laws.constants(), state, side: at.side, momentum, step: period / steps }
    }

    /// Slip velocity per unit of tangential impulse at first touch, 1/kg.
    pub fn slip_compliance(&self) -> f64 {
        let k = &self.laws;
        1.0 / k.ball_mass + 1.0 / k.racket_mass + k.ball_radius * k.ball_radius / k.ball_inertia
    }

    /// Takes the slip away by an impulse at the contact point, on the ball and in reverse on the racket.
    pub fn stop_slip(&self, s: &mut [f64; S], slip: [f64; 2]) {
        let k = &self.laws;
        let x = (k.ball_radius - self.side * s[POSITION + 2] + mode_push(s, k, self.side) - s[STRINGS]).max(0.0);
        let arm = k.ball_radius - k.lambda_r * x;
        let inertia = k.ball_inertia * (1.0 - k.kappa_i * x);
        // The pocket's normal leans where an effect tilts it; friction lies in its plane, and slip is what lies in it.
        let normal = Vector3::new(-k.tilt_x * s[STRINGS] * (s[POSITION] + k.com_x), -k.tilt_y * s[STRINGS] * s[POSITION + 1], 1.0).normalize();
        let c = -arm * self.side * normal;
        let p = Vector3::new(s[POSITION], s[POSITION + 1], s[POSITION + 2]) + c;
        let per_mass = 1.0 / k.ball_mass + 1.0 / k.racket_mass;
        let racket_inertia = Vector3::new(k.inertia_x, k.inertia_y, k.inertia_z);
        let in_plane = |x: f64, y: f64| Vector3::new(x, y, -(x * normal.x + y * normal.y) / normal.z);
        let response = |j: &Vector3<f64>| {
            let du = per_mass * j + (c.cross(j) / inertia).cross(&c) + p.cross(j).component_div(&racket_inertia).cross(&p);
            du - du.dot(&normal) * normal
        };
        let (a, b) = (response(&in_plane(1.0, 0.0)), response(&in_plane(0.0, 1.0)));
        let det = a.x * b.y - b.x * a.y;
        let j = in_plane((-b.y * slip[0] + b.x * slip[1]) / det, (-a.x * slip[1] + a.y * slip[0]) / det);
        let (spin, turn) = (c.cross(&j), -p.cross(&j).component_div(&racket_inertia));
        let v = |s: &[f64; S], i: usize| Vector3::new(s[i], s[i + 1], s[i + 2]);
        let surface = |s: &[f64; S]| v(s, VELOCITY) - v(s, RATE).cross(&p) + (v(s, SPIN) / inertia).cross(&c);
        let before = surface(s);
        for i in 0..3 {
            s[VELOCITY + i] += j[i] * per_mass;
            s[SPIN + i] += spin[i];
            s[RATE + i] += turn[i];
        }
        if S == WHOLE {
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
