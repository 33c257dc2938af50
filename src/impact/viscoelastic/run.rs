//! One impact with its ledger: where momentum and energy went.

use super::job::Job;
use super::kernel::{LEDGER, MODE, POSITION, RATE, SIDEWAYS, SPIN, STRINGS, TORSION, WHOLE};
use super::lanes::{Ready, Taken, step_all};
use crate::impact::error::ModelError;
use crate::impact::input::ImpactOutput;
use nalgebra::Vector3;

/// Energies in J, momenta in N s and N m s (about the origin of the local axes at first touch).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ledger {
    /// Kinetic energy of ball and racket before and after.
    pub kinetic_before: f64,
    pub kinetic_after: f64,
    /// Left in ball, strings and frame when the ball leaves.
    pub stored_after: f64,
    pub lost_in_ball_damping: f64,
    pub lost_in_momentum_flux: f64,
    pub lost_in_string_damping: f64,
    pub lost_in_friction: f64,
    pub lost_in_frame_damping: f64,
    /// Given by changing inertia and stiffness.
    pub given_by_deformation: f64,
    /// Given by the player and the mount.
    pub given_from_outside: f64,
    pub linear_momentum_before: Vector3<f64>,
    pub linear_momentum_after: Vector3<f64>,
    pub angular_momentum_before: Vector3<f64>,
    pub angular_momentum_after: Vector3<f64>,
}

impl Ledger {
    /// Energy that the entries do not explain, J.
    pub fn residual_j(&self) -> f64 {
        let out = self.kinetic_after
            + self.stored_after
            + self.lost_in_ball_damping
            + self.lost_in_momentum_flux
            + self.lost_in_string_damping
            + self.lost_in_friction
            + self.lost_in_frame_damping;
        out - self.kinetic_before - self.given_by_deformation - self.given_from_outside
    }
}

/// One impact in full.
#[derive(Debug, Clone, PartialEq)]
pub struct Run {
    pub output: ImpactOutput,
    /// Racket rates after impact along the racket's own axes as they then stand, rad/s.
    pub racket_rate_own_axes: Vector3<f64>,
    pub ledger: Ledger,
    /// N.
    pub peak_force: f64,
    /// Of the ball, m.
    pub peak_compression: f64,
    /// Of the strings, m.
    pub peak_deflection: f64,
    pub steps: usize,
    /// The contact from its first step to its end.
    pub course: Vec<Moment>,
}

/// The contact at one instant.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Moment {
    /// Since first touch, s.
    pub time: f64,
    /// Of the strings on the ball, along the normal, N; negative where a model's ball is pulled.
    pub force: f64,
    /// Approach of the ball's centre since first touch: compression and deflection together, m.
    pub approach: f64,
    /// Of the strings, m.
    pub deflection: f64,
    /// Of the ball's surface against the strings along x and y, m/s.
    pub slip: [f64; 2],
    /// Along x and y, rad/s, in the racket's own axes.
    pub spin: [f64; 2],
}

/// Steps of about this many to a contact, of order 8, close the ledger to 1e-9 J.
pub(crate) const RUN_STEPS: f64 = 160.0;

/// Steps one contact with about `steps` steps and keeps the ledger.
pub(crate) fn run(ready: &Ready, steps: f64) -> Result<Run, ModelError> {
    let job = Job::<WHOLE>::new(&ready.at, &ready.laws, steps);
    let mut course = Vec::new();
    let (radius, inertia, kappa) = (ready.laws.ball_radius, ready.laws.ball_inertia, ready.laws.kappa_i);
    let mut observe = |taken: &Taken<WHOLE>| {
        let (time, s, signs) = (taken.time, taken.state, taken.signs);
        let now = inertia * (1.0 - kappa * (signs.approach - s[STRINGS]).clamp(0.0, radius));
        let spin = [s[SPIN] / now, s[SPIN + 1] / now];
        course.push(Moment { time, force: signs.force, approach: signs.approach, deflection: s[STRINGS], slip: [signs.slip_x, signs.slip_y], spin });
    };
    let end = step_all::<f64, WHOLE, true>(0.0, std::slice::from_ref(&job), Some(&mut observe)).pop().unwrap_or(Err(ModelError::NotFinite))?;
    let output = job.output(&end);
    let (k, s, side) = (&job.laws, &end.state, job.side);
    let inertia = Vector3::new(k.inertia_x, k.inertia_y, k.inertia_z);
    let v = |s: &[f64; WHOLE], i: usize| Vector3::new(s[i], s[i + 1], s[i + 2]);
    let input = &ready.at.input;
    let (m, mass) = (k.ball_mass, k.racket_mass);
    let kinetic = |vb: &Vector3<f64>, l: &Vector3<f64>, ib: f64, vr: &Vector3<f64>, rate: &Vector3<f64>| {
        0.5 * (m * vb.norm_squared() + l.norm_squared() / ib + mass * vr.norm_squared() + rate.component_mul(&inertia).dot(rate))
    };
    let approach = k.ball_radius - side * s[POSITION + 2] + job.mode_push(s);
    let x = approach - s[STRINGS];
    let ball_inertia = k.ball_inertia * (1.0 - k.kappa_i * x.max(0.0));
    let xs = s[STRINGS];
    let local = Vector3::new(s[POSITION] + k.com_x, s[POSITION + 1], 0.0);
    let edge = 1.0 + k.edge_x * local.x * local.x + k.edge_y * local.y * local.y;
    let mode = 0.5 * k.mode_mass * (s[MODE + 1].powi(2) + (k.mode_rate * s[MODE]).powi(2));
    let torsion = 0.5 * k.torsion_inertia * (s[TORSION + 1].powi(2) + (k.torsion_rate * s[TORSION]).powi(2));
    let stored_after = 0.5 * k.k_b0 * x * x
        + k.a_k * x.max(0.0).powf(k.alpha + 2.0) / (k.alpha + 2.0)
        + (0.5 * k.k_s0 * xs * xs + 0.25 * k.k_s2 * xs.powi(4)) * edge
        + 0.5 * (k.k_tx * s[SIDEWAYS].powi(2) + k.k_ty * s[SIDEWAYS + 1].powi(2))
        + mode
        + torsion;
    // Where the bodies are at the end: the common centre of mass moves uniformly but for the player's push.
    let total = m + mass;
    let push = Vector3::new(0.0, 0.0, side * k.drive_force);
    let turn = turn_of(s);
    let com_start = Vector3::new(k.com_x, 0.0, 0.0);
    let centre_start = com_start + m / total * v(&job.state, POSITION);
    let centre = centre_start + Vector3::from(job.momentum) / total * end.time + 0.5 * push / total * end.time * end.time;
    let racket_end = centre - m / total * (turn * v(s, POSITION));
    let ball_end = racket_end + turn * v(s, POSITION);
    let ball_start = com_start + v(&job.state, POSITION);
    let spin_start = v(&job.state, SPIN);
    let ledger = Ledger {
        kinetic_before: kinetic(&input.ball_velocity, &spin_start, k.ball_inertia, &input.racket_velocity, &input.racket_rate),
        kinetic_after: kinetic(&output.ball_velocity, &v(s, SPIN), ball_inertia, &output.racket_velocity, &v(s, RATE)),
        stored_after,
        lost_in_ball_damping: s[LEDGER],
        lost_in_momentum_flux: s[LEDGER + 1],
        lost_in_string_damping: s[LEDGER + 2],
        lost_in_friction: s[LEDGER + 3],
        given_by_deformation: s[LEDGER + 4],
        lost_in_frame_damping: s[LEDGER + 5],
        given_from_outside: s[LEDGER + 6] + push.dot(&(racket_end - com_start)),
        linear_momentum_before: m * input.ball_velocity + mass * input.racket_velocity,
        linear_momentum_after: m * output.ball_velocity + mass * output.racket_velocity,
        angular_momentum_before: m * ball_start.cross(&input.ball_velocity)
            + spin_start
            + mass * com_start.cross(&input.racket_velocity)
            + input.racket_rate.component_mul(&inertia),
        angular_momentum_after: m * ball_end.cross(&output.ball_velocity)
            + turn * v(s, SPIN)
            + mass * racket_end.cross(&output.racket_velocity)
            + turn * v(s, RATE).component_mul(&inertia),
    };
    Ok(Run {
        output,
        racket_rate_own_axes: v(s, RATE),
        ledger,
        peak_force: end.peak_force,
        peak_compression: end.peak_compression,
        peak_deflection: end.peak_deflection,
        steps: end.steps,
        course,
    })
}

fn turn_of(s: &[f64; WHOLE]) -> nalgebra::UnitQuaternion<f64> {
    use super::kernel::ATTITUDE;
    nalgebra::UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(s[ATTITUDE], s[ATTITUDE + 1], s[ATTITUDE + 2], s[ATTITUDE + 3]))
}
