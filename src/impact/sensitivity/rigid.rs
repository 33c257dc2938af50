//! The rigid base (contract, section 7) once more, in dual numbers: outcome with its exact derivatives.

use crate::impact::body::Body;
use crate::impact::dual::{Dual, Vector, cross, minus, plus};
use crate::impact::error::ModelError;
use crate::impact::input::ImpactInput;
use crate::impact::rigid::Contact;

/// Directions: the 14 columns of velocities, rates and position, restitution, friction, then the bodies' six numbers.
pub const DIRECTIONS: usize = 22;
/// Where restitution and friction stand.
pub const RESTITUTION: usize = 14;
pub const FRICTION: usize = 15;
/// Racket mass, its inertias about x, y, z, local x of its centre of mass, ball mass (the ball's inertia in proportion).
pub const BODIES: usize = 16;

type D = Dual<DIRECTIONS>;

/// Twelve outputs (all but the contact time) with their derivatives.
///
/// # Errors
/// [`ModelError::NoApproach`].
pub fn collide(body: &Body, input: &ImpactInput, restitution: f64, friction: f64) -> Result<[D; 12], ModelError> {
    let side = Contact::new(body, input)?.side;
    let columns = input.as_columns();
    let v = |first: usize| -> Vector<DIRECTIONS> { std::array::from_fn(|i| D::variable(columns[first + i], first + i)) };
    let (vb, wb, vr, wr) = (v(0), v(3), v(6), v(9));
    let (e, mu) = (D::variable(restitution, RESTITUTION), D::variable(friction, FRICTION));
    let mass = D::variable(body.racket_mass, BODIES);
    let inertia: Vector<DIRECTIONS> = std::array::from_fn(|i| D::variable(body.racket_inertia[i], BODIES + 1 + i));
    let com = D::variable(body.com_x, BODIES + 4);
    let m = D::variable(body.ball_mass, BODIES + 5);
    let ball_inertia = m * (body.ball_inertia / body.ball_mass);
    let zero = D::constant(0.0);
    let lever = [D::variable(columns[12], 12) - com, D::variable(columns[13], 13), zero];
    let arm = [zero, zero, D::constant(-side * body.ball_radius)];
    let u = minus(&plus(&vb, &cross(&wb, &arm)), &plus(&vr, &cross(&wr, &lever)));
    let per_mass = m.recip() + mass.recip();
    let (x, y) = (lever[0], lever[1]);
    let normal = (e + 1.0) * u[2] * -side / (per_mass + x * x / inertia[1] + y * y / inertia[0]);
    let free = per_mass + arm[2] * arm[2] / ball_inertia;
    let (kxx, kyy, kxy) = (free + y * y / inertia[2], free + x * x / inertia[2], -(x * y / inertia[2]));
    let det = kxx * kyy - kxy * kxy;
    let stick = [(kxy * u[1] - kyy * u[0]) / det, (kxy * u[0] - kxx * u[1]) / det];
    let limit = mu * normal;
    let slip = u[0].value.hypot(u[1].value);
    let tangential = if slip == 0.0 || stick[0].value.hypot(stick[1].value) <= limit.value {
        stick
    } else {
        let size = (u[0] * u[0] + u[1] * u[1]).sqrt();
        [-(limit * u[0] / size), -(limit * u[1] / size)]
    };
    let j = [tangential[0], tangential[1], normal * side];
    let (ball_turn, racket_turn) = (cross(&arm, &j), cross(&lever, &j));
    let out = |k: usize, i: usize| match k {
        0 => vb[i] + j[i] / m,
        1 => wb[i] + ball_turn[i] / ball_inertia,
        2 => vr[i] - j[i] / mass,
        _ => wr[i] - racket_turn[i] / inertia[i],
    };
    Ok(std::array::from_fn(|n| out(n / 3, n % 3)))
}
