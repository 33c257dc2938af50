//! The impulse that satisfies the contact laws, and what it does to both bodies.

use super::contact::Contact;
use super::lasting::collide_lasting;
use super::laws::{Laws, Sliding};
use crate::impact::body::Body;
use crate::impact::input::ImpactOutput;
use crate::impact::real::{Real, rotation};
use nalgebra::{Matrix3, Vector3};

/// How the contact ended tangentially.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Regime {
    Stick,
    Slide,
}

/// Impulses on both bodies, racket-local axes. Angular ones about each body's own centre of mass.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Impulse<T = f64> {
    /// On the ball by the strings, N s.
    pub ball: Vector3<T>,
    /// On the ball, N m s.
    pub ball_angular: Vector3<T>,
    /// On the racket, N s.
    pub racket: Vector3<T>,
    /// On the racket, N m s.
    pub racket_angular: Vector3<T>,
    pub regime: Regime,
    /// What friction could give beyond the impulse that sticking needs, N s; negative where the ball slides.
    pub spare_friction: T,
}

impl<T: Real> Impulse<T> {
    /// The contact impulse `j` on the ball at its contact point and its reaction on the racket.
    fn at_contact(at: &Contact<T>, laws: &Laws<T>, j: Vector3<T>, (regime, spare_friction): (Regime, T)) -> Self {
        let arm = Vector3::new(T::zero(), T::zero(), laws.ball_arm * -at.side);
        Impulse { ball: j, ball_angular: arm.cross(&j), racket: -j, racket_angular: -at.lever.cross(&j), regime, spare_friction }
    }

    /// Replaces the contact impulse by one that differs by `delta`, acting at the same contact point.
    pub fn shift(&mut self, at: &Contact<T>, laws: &Laws<T>, delta: Vector3<T>) {
        let change = Impulse::at_contact(at, laws, delta, (self.regime, self.spare_friction));
        self.ball += change.ball;
        self.ball_angular += change.ball_angular;
        self.racket += change.racket;
        self.racket_angular += change.racket_angular;
    }

    /// Changes an outcome by what this impulse has beyond `before`, to which the outcome belongs.
    pub fn change_outcome(&self, before: &Impulse<T>, at: &Contact<T>, laws: &Laws<T>, output: &mut ImpactOutput<T>) {
        let b = at.body;
        output.ball_velocity += (self.ball - before.ball) / b.ball_mass;
        output.ball_spin += (self.ball_angular - before.ball_angular) / laws.ball_inertia;
        output.racket_velocity += (self.racket - before.racket) / b.racket_mass;
        output.racket_rate += (self.racket_angular - before.racket_angular).component_div(&b.racket_inertia);
    }

    /// Velocities and rates after the impulse; the racket's velocity at its true centre of mass.
    fn outcome(&self, at: &Contact<T>, laws: &Laws<T>) -> ImpactOutput<T> {
        let b = at.body;
        ImpactOutput {
            ball_velocity: at.input.ball_velocity + self.ball / b.ball_mass,
            ball_spin: at.input.ball_spin + self.ball_angular / laws.ball_inertia,
            racket_velocity: at.input.racket_velocity + self.racket / b.racket_mass,
            racket_rate: at.input.racket_rate + self.racket_angular.component_div(&b.racket_inertia),
            contact_time: None,
        }
    }
}

/// One collision: the impulse, changed by `change` (effects that act on impulses), and the outcome.
pub fn collide<T: Real>(at: &Contact<T>, laws: &Laws<T>, change: &dyn Fn(&Contact<T>, &Laws<T>, &mut Impulse<T>)) -> (Impulse<T>, ImpactOutput<T>) {
    let mut impulse = solve(at, laws);
    if !laws.face_time.is_zero() {
        impulse = collide_lasting(at, laws, &impulse);
    }
    change(at, laws, &mut impulse);
    (impulse, impulse.outcome(at, laws))
}

fn solve<T: Real>(at: &Contact<T>, laws: &Laws<T>) -> Impulse<T> {
    if laws.is_plain() { solve_plain(at, laws) } else { solve_held(at, laws) }
}

/// Closed form: normal and tangential parts do not couple (K_xz = K_yz = 0).
fn solve_plain<T: Real>(at: &Contact<T>, laws: &Laws<T>) -> Impulse<T> {
    let b = at.body;
    let arm = laws.ball_arm;
    let mut u = at.relative_velocity;
    if !(arm - b.ball_radius).is_zero() {
        u = relative_velocity(at, &Vector3::new(T::zero(), T::zero(), arm * -at.side));
    }
    let normal = at.normal_impulse(laws.effective_restitution());
    let free = b.ball_mass.recip() + arm * arm / laws.ball_inertia + b.racket_mass.recip();
    let (x, y, iz) = (at.lever.x, at.lever.y, b.racket_inertia.z);
    let k = [free + y * y / iz, -x * y / iz, free + x * x / iz];
    // Tangential impulse that brings the slip to what a stuck contact leaves of it.
    let after = laws.rebound([u.x, u.y]);
    let wish = [after[0] - u.x, after[1] - u.y];
    let det = k[0] * k[2] - k[1] * k[1];
    let stick = [(k[2] * wish[0] - k[1] * wish[1]) / det, (k[0] * wish[1] - k[1] * wish[0]) / det];
    let limit = laws.friction * normal;
    let needed = stick[0].hypot(stick[1]);
    // Of a slip that friction can stop the size does not matter.
    let size = if needed.value() <= limit.value() { T::zero() } else { u.x.hypot(u.y) };
    let (tx, ty, regime) = if size.value() == 0.0 {
        (stick[0], stick[1], Regime::Stick)
    } else {
        match laws.sliding {
            Sliding::FirstTouch => (-limit * u.x / size, -limit * u.y / size, Regime::Slide),
            Sliding::Exact => {
                let (p, regime) = slide_exactly([u.x, u.y], k, laws.friction, normal);
                (p[0], p[1], regime)
            }
        }
    };
    Impulse::at_contact(at, laws, Vector3::new(tx, ty, normal * at.side), (regime, limit - needed))
}

fn relative_velocity<T: Real>(at: &Contact<T>, arm: &Vector3<T>) -> Vector3<T> {
    let i = &at.input;
    i.ball_velocity + i.ball_spin.cross(arm) - i.racket_velocity - i.racket_rate.cross(&at.lever)
}

/// Tangential impulse of a sliding contact whose direction turns: du/dp = −μ K_tt û, p from 0 to the normal impulse.
///
/// Keller's equations with K_tz = 0; once the slip is used up the ball sticks (sticking persists because K_tz = 0).
/// Derivatives go through the steps.
fn slide_exactly<T: Real>(u: [T; 2], k: [T; 3], friction: T, normal: T) -> ([T; 2], Regime) {
    // Along the path s = |u| falls at least at the rate μ λ_min, so the number of steps is bounded.
    let rate = |u: [T; 2]| {
        let s = u[0].hypot(u[1]).max(T::constant(f64::MIN_POSITIVE));
        let t = [u[0] / s, u[1] / s];
        ([-friction * t[0], -friction * t[1]], [-friction * (k[0] * t[0] + k[1] * t[1]), -friction * (k[1] * t[0] + k[2] * t[1])])
    };
    let start = u[0].hypot(u[1]).value();
    let (mut u, mut done, mut j) = (u, T::zero(), [T::zero(); 2]);
    while done.value() < normal.value() {
        let s = u[0].hypot(u[1]);
        if s.value() <= 1e-9 * start {
            return (j, Regime::Stick);
        }
        // A step takes at most a fiftieth of the slip that is left: the direction hardly turns within it.
        let step = (normal - done).min(s * 0.02 / (friction * k[0].max(k[2])));
        if step.value() <= 1e-15 * normal.value() {
            break;
        }
        let at = |u: [T; 2], d: [T; 2], h: T| [u[0] + h * d[0], u[1] + h * d[1]];
        let (j1, d1) = rate(u);
        let (j2, d2) = rate(at(u, d1, step * 0.5));
        let (j3, d3) = rate(at(u, d2, step * 0.5));
        let (j4, d4) = rate(at(u, d3, step));
        for i in 0..2 {
            u[i] += step / 6.0 * (d1[i] + d2[i] * 2.0 + d3[i] * 2.0 + d4[i]);
            j[i] += step / 6.0 * (j1[i] + j2[i] * 2.0 + j3[i] * 2.0 + j4[i]);
        }
        done += step;
    }
    (j, Regime::Slide)
}

/// With a mount that resists twisting: its angular impulse takes the size that keeps the twist, or its limit.
///
/// The size is found by secant steps; they go on until the twist's derivatives have vanished too, so its own are those of the
/// implicit function.
fn solve_held<T: Real>(at: &Contact<T>, laws: &Laws<T>) -> Impulse<T> {
    if laws.twist_hold.is_zero() {
        return solve_general(at, laws);
    }
    let with = |h: T| {
        let mut l = *laws;
        l.twist_hold = T::zero();
        l.drive_twist.x += h;
        solve_general(at, &l)
    };
    let free = with(T::zero());
    let twist = free.racket_angular.x;
    if twist.is_zero() {
        return free;
    }
    // The twist depends on the mount's impulse almost linearly (exactly, unless stick changes to slide): secant steps.
    let limit = laws.twist_hold.value().abs();
    let (mut h0, mut r0) = (T::zero(), twist);
    let mut h1 = -twist;
    for _ in 0..8 {
        if h1.value().abs() >= limit {
            return with(laws.twist_hold * -twist.value().signum());
        }
        let r1 = with(h1).racket_angular.x;
        if r1.size() <= 1e-15 || r1.value() == r0.value() {
            break;
        }
        let next = h1 - r1 * (h1 - h0) / (r1 - r0);
        (h0, r0, h1) = (h1, r1, next);
    }
    with(h1)
}

/// Contact axes, x and y along the strings and z normal to the pocket, in face axes; and the way from the ball's centre to the contact point.
pub(super) fn pocket<T: Real>(at: &Contact<T>, laws: &Laws<T>) -> (Matrix3<T>, Vector3<T>) {
    let frame = rotation(&Vector3::new(-laws.tilt[1], laws.tilt[0], T::zero()));
    (frame, frame.column(2) * (laws.ball_arm * -at.side))
}

/// Axes in which slip counts, in contact axes: those of the pocket as it stands at first touch and at release. A pocket is flat when the
/// ball comes and flat again when it leaves, so that the ball slides along the face and holds the face, while the force between
/// leans. `None` where both are the same.
pub(super) fn slip_axes<T: Real>(laws: &Laws<T>, frame: &Matrix3<T>) -> Option<Matrix3<T>> {
    // A dual of value 1 whose derivatives are wanted is not "one" to them: only a plain 1 skips this.
    if laws.tilt_at_ends == T::one() || laws.tilt.iter().all(T::is_zero) {
        return None;
    }
    let at_ends = rotation(&Vector3::new(-laws.tilt[1] * laws.tilt_at_ends, laws.tilt[0] * laws.tilt_at_ends, T::zero()));
    Some(frame.tr_mul(&at_ends))
}

/// K in contact axes `frame`: change of the slip per unit of impulse along each of them, the normal one displaced by `offset`.
pub(super) fn response<T: Real>(b: &Body<T>, laws: &Laws<T>, frame: &Matrix3<T>, arm: &Vector3<T>, lever: &Vector3<T>, offset: &Vector3<T>) -> Matrix3<T> {
    let by = |column: usize| -> Vector3<T> {
        let d: Vector3<T> = frame.column(column).into();
        let shift = if column == 2 { *offset } else { Vector3::zeros() };
        let ball_turn = (arm + shift).cross(&d) / laws.ball_inertia;
        let racket_turn = -(lever + shift).cross(&d).component_div(&b.racket_inertia);
        let du = d * (b.ball_mass.recip() + b.racket_mass.recip()) + ball_turn.cross(arm) - racket_turn.cross(lever);
        frame.tr_mul(&du)
    };
    Matrix3::from_columns(&[by(0), by(1), by(2)])
}

/// Any tilt, offset or outside impulse: the 3 × 3 system in the contact's own axes.
fn solve_general<T: Real>(at: &Contact<T>, laws: &Laws<T>) -> Impulse<T> {
    let b = at.body;
    let zero = T::zero();
    let (frame, arm) = pocket(at, laws);
    let u_world = relative_velocity(at, &arm);
    let u = frame.tr_mul(&u_world);
    let axes = slip_axes(laws, &frame);
    let first = axes.map_or(u, |axes| axes.tr_mul(&u));
    let slip = first.x.hypot(first.y);
    let slides = slip.value() > 0.0;
    // The normal force acts behind the centre, against the slip, and where an expression has moved it.
    let mut offset = frame.column(0) * laws.arm_offset[0] + frame.column(1) * laws.arm_offset[1];
    if slides && !laws.normal_offset.is_zero() {
        offset -= (frame.column(0) * first.x + frame.column(1) * first.y) * (laws.normal_offset / slip);
    }
    let k = response(b, laws, &frame, &arm, &at.lever, &offset);
    // Relative velocity that the outside impulses take away.
    let outside_world = -(laws.drive / b.racket_mass) - laws.drive_twist.component_div(&b.racket_inertia).cross(&at.lever);
    let outside = frame.tr_mul(&outside_world);
    let e = laws.effective_restitution();
    let after = laws.rebound([first.x, first.y]);
    let target = Vector3::new(after[0], after[1], -e * u.z) - u - outside;
    let stick = match axes {
        None => T::solve(&k, &target),
        // The ball holds the strings as they are when it leaves; the normal law is that of the leaning force.
        Some(axes) => {
            let (mut held, now) = (axes.tr_mul(&k), axes.tr_mul(&(u + outside)));
            held.set_row(2, &k.row(2));
            T::solve(&held, &Vector3::new(after[0] - now.x, after[1] - now.y, target.z))
        }
    };
    let slide = || {
        let t = if slides { [first.x / slip, first.y / slip] } else { [zero; 2] };
        // J = p (side ẑ − μ û); the normal row gives p.
        let row = k[(2, 2)] * at.side - laws.friction * (k[(2, 0)] * t[0] + k[(2, 1)] * t[1]);
        let p = target.z / row;
        let p = if p.value() < 0.0 { zero } else { p };
        let limit = laws.friction * p;
        if laws.sliding == Sliding::Exact {
            let (j, regime) = slide_exactly([first.x, first.y], [k[(0, 0)], (k[(0, 1)] + k[(1, 0)]) * 0.5, k[(1, 1)]], laws.friction, p);
            return (Vector3::new(j[0], j[1], p * at.side), regime);
        }
        (Vector3::new(-limit * t[0], -limit * t[1], p * at.side), Regime::Slide)
    };
    let (limit, needed) = stick.map_or((zero, zero), |j| (laws.friction * at.side * j.z, j.x.hypot(j.y)));
    let (j, regime) = match stick {
        Some(j) if at.side * j.z.value() >= 0.0 && needed.value() <= limit.value() => (j, Regime::Stick),
        _ => slide(),
    };
    let push = frame.column(2) * j.z;
    let j_world = frame * j;
    Impulse {
        ball: j_world,
        ball_angular: arm.cross(&j_world) + offset.cross(&push),
        racket: -j_world + laws.drive,
        racket_angular: -at.lever.cross(&j_world) - offset.cross(&push) + laws.drive_twist,
        regime,
        spare_friction: limit - needed,
    }
}
