//! Rates of change of one impact: the equations of the physics reference, section C, in the racket's own axes.

use super::laws::{Constants, Laws};
use super::number::{Number, Three, cross, dot, each, minus, plus, side_by_side, times};

/// Ball centre from the racket's centre of mass, its velocity relative to that centre, the ball's spin angular momentum,
/// the racket's rates (three each), the racket's attitude (quaternion, scalar first), the strings' deflection.
pub(super) const POSITION: usize = 0;
pub(super) const VELOCITY: usize = 3;
pub(super) const SPIN: usize = 6;
pub(super) const RATE: usize = 9;
pub(super) const ATTITUDE: usize = 12;
pub(super) const STRINGS: usize = 16;
/// Size of the plain state.
pub(super) const PLAIN: usize = 17;
/// Sideways displacement of the strings (2), bending mode (2), torsional mode (2), then the ledger.
pub(super) const SIDEWAYS: usize = 17;
pub(super) const MODE: usize = 19;
pub(super) const TORSION: usize = 21;
pub(super) const LEDGER: usize = 23;
/// Work against ball damping, momentum flux, string damping, friction; work by changing inertia and stiffness; work of mode
/// damping; work of the player and the mount.
pub(super) const LEDGER_ENTRIES: usize = 7;
/// Size of the state with effects, powers of 2.
pub(super) const FULL: usize = LEDGER;
/// Size of the state with any powers and the ledger.
pub(super) const WHOLE: usize = LEDGER + LEDGER_ENTRIES;

/// Share of the radius beyond which the ball's geometry no longer follows the compression.
pub(super) const DEEPEST: f64 = 0.98;
/// Compression up to which the constant damping grows in, m.
pub(super) const ONSET: f64 = 1e-3;
/// Contact area (diameter squared) at which the damping has its stated size, m².
const REFERENCE_AREA: f64 = 1.6e-3;
/// How fast a remaining slip of a stuck contact is taken away, 1/s.
const SLIP_RETURN: f64 = 1e4;
/// Slip that decides the direction of friction where the slip itself is nil, m/s.
const SOFT_SLIP: f64 = 1e-6;
/// Change of twist rate over which the mount's friction turns to full size, rad/s.
const SOFT_TWIST: f64 = 0.5;
/// Slip over which the normal force's offset grows to full size, m/s.
const SOFT_OFFSET: f64 = 0.5;
/// Keeps a direction of nil length from being 0/0.
const TINY: f64 = 1e-300;

side_by_side! {
    /// What a step needs besides the rates: where the kinks are.
    pub(super) struct Signs {
        /// Contact force, N.
        force,
        /// Compression minus the onset, m.
        onset,
        /// Positive while the ball is being compressed, N.
        compressing,
        /// Slip velocity, m/s.
        slip_x,
        slip_y,
        /// Friction limit minus what sticking needs, N.
        grip_left,
        /// Time in which strings and ball settle against each other, s.
        settling,
        /// How far the ball's centre has come since first touch, m.
        approach,
    }
}

impl Signs {
    pub fn slip(&self) -> f64 {
        (self.slip_x * self.slip_x + self.slip_y * self.slip_y).sqrt()
    }
}

/// Sliding, sticking, and just freed: the slip is too small to have a direction of its own, so friction points where sticking
/// would need it (exact while the slip follows its acceleration).
pub(super) const SLIDE: f64 = 0.0;
pub(super) const STICK: f64 = 1.0;
pub(super) const CREEP: f64 = 2.0;

side_by_side! {
    /// Contact mode of one impact, carried along by the stepper.
    pub(super) struct Mode {
        /// The side from which the ball comes, ±1.
        side,
        /// [`STICK`], [`SLIDE`] or [`CREEP`]; a number, so that lanes can choose without branches.
        stick,
        /// Sliding direction at the start of the step.
        direction_x,
        direction_y,
    }
}

#[inline(always)]
fn three<T: Number, const S: usize>(s: &[T; S], first: usize) -> Three<T> {
    [s[first], s[first + 1], s[first + 2]]
}

/// Rates of change of the state; `S` is [`PLAIN`], [`FULL`] or [`WHOLE`].
///
/// Without branches that depend on values, so that lanes stay together.
#[inline(always)]
pub(super) fn rates<T: Number, const S: usize>(s: &[T; S], k: &Laws<T>, c: &Constants<T>, mode: &Mode<T>) -> ([T; S], Signs<T>) {
    let mut d = [mode.side.same(0.0); S];
    let signs = rates_into(s, k, c, mode, &mut d);
    (d, signs)
}

/// [`rates`] written where they are wanted: states side by side are too large to be handed around.
#[inline(always)]
pub(super) fn rates_into<T: Number, const S: usize>(s: &[T; S], k: &Laws<T>, c: &Constants<T>, mode: &Mode<T>, d: &mut [T; S]) -> Signs<T> {
    let (full, whole) = (S > PLAIN, S == WHOLE);
    let n = mode.side;
    let (zero, one) = (n.same(0.0), n.same(1.0));
    let (per_inertia, gyro) = ([c.per_inertia_x, c.per_inertia_y, c.per_inertia_z], [c.gyro_x, c.gyro_y, c.gyro_z]);
    let (p, v, l, o) = (three(s, POSITION), three(s, VELOCITY), three(s, SPIN), three(s, RATE));
    let xs = s[STRINGS];
    // Velocity of the ball's centre as seen from the racket.
    let r = minus(v, cross(o, p));
    let r0 = k.ball_radius;
    let mut delta = r0 - n * p[2];
    let mut w = -(n * r[2]);
    if full {
        delta = delta + n * (k.mode_shape * s[MODE] + k.torsion_shape * s[TORSION]);
        w = w + n * (k.mode_shape * s[MODE + 1] + k.torsion_shape * s[TORSION + 1]);
    }
    // Ball: truncated sphere (thesis 2.7.3).
    let xc = delta - xs;
    let x = xc.positive_part().smaller(c.deepest);
    let area = r0 * x * 2.0 - x * x;
    let m = k.ball_mass;
    let ratio = m / (m - area * c.resting_per_area);
    let g = k.flux * ratio * (r0 - x) * c.resting_per_area * 2.0;
    // The contact's diameter squared is 4 (2 r x - x^2).
    let contact = area * 4.0;
    let relative = contact * (1.0 / REFERENCE_AREA);
    let (mut growth, mut stiffening) = (relative * relative, x * x);
    if whole {
        (growth, stiffening) = (relative.power(k.beta_c), x.power(k.alpha));
    }
    let mut onset = (x * (1.0 / ONSET)).smaller(one);
    if full {
        onset = T::choose(k.onset.less(n.same(0.5)), one, onset);
    }
    let c_b = ratio * k.a_c * contact * growth + k.c_b0 * onset;
    let k_b = k.k_b0 + k.a_k * stiffening;
    // Massless stringbed: the ball's force equals the strings' (C.4).
    let mut k_s = k.k_s0 + k.k_s2 * xs * xs;
    if full {
        let local = p[0] + k.com_x;
        k_s = k_s * (k.edge_x * local * local + k.edge_y * p[1] * p[1] + 1.0);
    }
    let b = c_b + k.c_s;
    let balance = k_s * xs + k.c_s * w - k_b * xc;
    let compressing = zero.less(balance);
    let root = (b * b + g * balance.positive_part() * 4.0).sqrt();
    let u = T::choose(compressing, balance * 2.0, balance) / T::choose(compressing, b + root, b);
    let w_s = w - u;
    let force = k.c_s * w_s + k_s * xs;
    // Arm and inertia shrink with compression (C.5).
    let arm = r0 - k.lambda_r * x;
    let inertia = k.ball_inertia - c.inertia_fall * x;
    let light = one / inertia;
    let moving = T::choose(xc.less(zero), zero, u);
    let (arm_rate, inertia_rate) = (-(k.lambda_r * moving), -(c.inertia_fall * moving));
    let spin = times(l, light);
    // The pocket's normal (unit z unless it leans), how fast it leans over, and the contact point below the ball.
    let (mut normal, mut lean) = ([zero, zero, one], [zero; 3]);
    let (mut foot, mut foot_rate) = ([zero, zero, -(arm * n)], [zero, zero, -(n * arm_rate)]);
    if full {
        let local = p[0] + k.com_x;
        let (tx, ty) = (-(k.tilt_x * xs * local), -(k.tilt_y * xs * p[1]));
        let short = one / (tx * tx + ty * ty + 1.0).sqrt();
        normal = [tx * short, ty * short, short];
        let (gx, gy) = (-(k.tilt_x * (w_s * local + xs * r[0]) * short), -(k.tilt_y * (w_s * p[1] + xs * r[1]) * short));
        let along = normal[0] * gx + normal[1] * gy;
        lean = [gx - along * normal[0], gy - along * normal[1], -(along * normal[2])];
        foot = times(normal, -(arm * n));
        foot_rate = times(plus(times(normal, arm_rate), times(lean, arm)), -n);
    }
    let place = plus(p, foot);
    // Velocity of the ball's surface against the strings.
    let (surface, along, slip) = if full {
        let surface = plus(minus(v, cross(o, place)), cross(spin, foot));
        let along = dot(surface, normal);
        (surface, along, [surface[0] - along * normal[0], surface[1] - along * normal[1]])
    } else {
        let x = v[0] - (o[1] * place[2] - o[2] * place[1]) + spin[1] * foot[2];
        let y = v[1] - (o[2] * place[0] - o[0] * place[2]) - spin[0] * foot[2];
        ([x, y, zero], zero, [x, y])
    };
    let limit = k.mu * force.positive_part();
    // Outside torque and force on the racket.
    let (mut torque, mut push) = ([zero; 3], zero);
    if full {
        let twist = (o[0] - k.twist_start) * (1.0 / SOFT_TWIST);
        torque = [-(k.grip * twist / (twist * twist + 1.0).sqrt()), n * k.drive_torque, zero];
        push = n * k.drive_force * c.per_racket_mass;
    }
    let pressed = times(normal, force * n);
    // The normal force acts behind the centre, against the slip: moment o x N n on the ball, its reverse on the racket.
    let (mut moment, mut rim) = ([zero; 3], zero);
    if full {
        let back = k.normal_offset / (slip[0] * slip[0] + slip[1] * slip[1] + SOFT_OFFSET * SOFT_OFFSET).sqrt();
        let (qx, qy) = (-(back * slip[0]), -(back * slip[1]));
        // Haake: shell lands at the contact's rim with u + g.p (p: place on the rim, g: gradient by the spin relative to the
        // face) at the rate rho (u (r - x) + r g.p); its moment, to first order in g, is pi rho a^2 u (2 r - x) g.
        rim = k.flux_offset * area * u.positive_part() * (r0 * 2.0 - x) * c.resting_per_area;
        moment = [qy * pressed[2] - rim * (spin[0] - o[0]), -(qx * pressed[2]) - rim * (spin[1] - o[1]), qx * pressed[1] - qy * pressed[0]];
    }
    // Racket and ball turned by the normal force alone; body axes turn: subtract Omega x L.
    let gyro = [o[1] * o[2] * gyro[0], o[2] * o[0] * gyro[1], o[0] * o[1] * gyro[2]];
    let turning = if full {
        minus(minus(torque, moment), plus(cross(place, pressed), gyro))
    } else {
        [-(place[1] * pressed[2]) - gyro[0], place[0] * pressed[2] - gyro[1], -gyro[2]]
    };
    let turned = each(turning, per_inertia);
    let carried = cross(o, l);
    let spun = if full { plus(cross(foot, pressed), minus(moment, carried)) } else { [-carried[0], -carried[1], -carried[2]] };
    // The slip's rate of change without friction.
    let shrink = inertia_rate * light;
    let whirl = [spun[0] * light - spin[0] * shrink, spun[1] * light - spin[1] * shrink, spun[2] * light - spin[2] * shrink];
    let drift = plus(r, foot_rate);
    let (q0, q1, q2, q3) = (s[ATTITUDE], s[ATTITUDE + 1], s[ATTITUDE + 2], s[ATTITUDE + 3]);
    let turning_axes = cross(o, v);
    let mut free = if full {
        // The player's force points along the world's z at first touch; the face hardly turns, but the axes do.
        let up = [(q1 * q3 - q0 * q2) * 2.0, (q2 * q3 + q0 * q1) * 2.0, one - (q1 * q1 + q2 * q2) * 2.0];
        minus(minus(times(pressed, c.per_mass), turning_axes), times(up, push))
    } else {
        [-turning_axes[0], -turning_axes[1], pressed[2] * c.per_mass - turning_axes[2]]
    };
    let ball_part = c.per_mass + arm * arm * light;
    let [ix, iy, iz] = per_inertia;
    let (accelerating, kxx, kyy, kxy, kyx);
    if full {
        let a = plus(minus(minus(free, cross(turned, place)), cross(o, drift)), plus(cross(whirl, foot), cross(spin, foot_rate)));
        // Against a leaning normal: the slip is what is left of the surface's velocity in the pocket's plane, and that plane turns.
        let change = dot(a, normal) + dot(surface, lean);
        accelerating = [a[0] - change * normal[0] - along * lean[0], a[1] - change * normal[1] - along * lean[1]];
        // Columns: slip's rate of change for a unit of friction along x and y, in the pocket's plane.
        let per_normal = one / normal[2];
        let first = column([one, zero, -(normal[0] * per_normal)], place, per_inertia, ball_part, normal);
        let second = column([zero, one, -(normal[1] * per_normal)], place, per_inertia, ball_part, normal);
        (kxx, kyx, kxy, kyy) = (first[0], first[1], second[0], second[1]);
    } else {
        accelerating = [
            free[0] - (turned[1] * place[2] - turned[2] * place[1]) - (o[1] * drift[2] - o[2] * drift[1]) + whirl[1] * foot[2] + spin[1] * foot_rate[2],
            free[1] - (turned[2] * place[0] - turned[0] * place[2]) - (o[2] * drift[0] - o[0] * drift[2]) - whirl[0] * foot[2] - spin[0] * foot_rate[2],
        ];
        kxx = ball_part + place[1] * place[1] * iz + place[2] * place[2] * iy;
        kyy = ball_part + place[0] * place[0] * iz + place[2] * place[2] * ix;
        kxy = -(place[0] * place[1] * iz);
        kyx = kxy;
    }
    let sticking = mode.stick.less(n.same(1.5)) & n.same(0.5).less(mode.stick);
    let sliding = mode.stick.less(n.same(0.5));
    let whole_k = one / (kxx * kyy - kxy * kyx);
    let back = T::choose(sticking, n.same(SLIP_RETURN), zero);
    let (bx, by) = (-(accelerating[0] + back * slip[0]), -(accelerating[1] + back * slip[1]));
    let hold = [(kyy * bx - kxy * by) * whole_k, (kxx * by - kyx * bx) * whole_k];
    // Past nil slip the law is continued as it was before, so that a step that ends there sees a smooth force.
    let forward = T::choose((slip[0] * mode.direction_x + slip[1] * mode.direction_y).less(zero), -one, one);
    let mut against = [-(forward * slip[0]) - mode.direction_x * SOFT_SLIP, -(forward * slip[1]) - mode.direction_y * SOFT_SLIP];
    if full {
        let (px, py) = ((kyy * against[0] - kxy * against[1]) * whole_k, (kxx * against[1] - kyx * against[0]) * whole_k);
        let projected = zero.less(k.projected);
        against = [T::choose(projected, px, against[0]), T::choose(projected, py, against[1])];
    }
    let toward = [T::choose(sliding, against[0], hold[0]), T::choose(sliding, against[1], hold[1])];
    let scale = T::choose(sticking, one, limit / ((toward[0] * toward[0] + toward[1] * toward[1]).sqrt() + TINY));
    let mut friction = [toward[0] * scale, toward[1] * scale, zero];
    let mut grip_left = limit - (hold[0] * hold[0] + hold[1] * hold[1]).sqrt();
    let mut side_rate = [zero; 2];
    if full {
        // Sideways springs in series with friction (C.5 c).
        let springs = zero.less(k.k_tx);
        let pull = [k.k_tx * s[SIDEWAYS], k.k_ty * s[SIDEWAYS + 1]];
        let held = [-(pull[0] + k.c_t * slip[0]), -(pull[1] + k.c_t * slip[1])];
        let h = (held[0] * held[0] + held[1] * held[1]).sqrt();
        let keep = T::choose(limit.less(h), limit / (h + TINY), one);
        for i in 0..2 {
            friction[i] = T::choose(springs, held[i] * keep, friction[i]);
            side_rate[i] = T::choose(springs, -((friction[i] + pull[i]) * c.per_side_damping), zero);
        }
        grip_left = T::choose(springs, limit - h, grip_left);
        // Friction lies in the pocket's plane.
        friction[2] = -((friction[0] * normal[0] + friction[1] * normal[1]) / normal[2]);
    }
    let (racket_turned, ball_spun) = if full {
        (minus(turned, each(cross(place, friction), per_inertia)), plus(spun, cross(foot, friction)))
    } else {
        let [fx, fy, _] = friction;
        let [x, y, z] = place;
        ([turned[0] + z * fy * ix, turned[1] - z * fx * iy, turned[2] - (x * fy - y * fx) * iz], [spun[0] - foot[2] * fy, spun[1] + foot[2] * fx, spun[2]])
    };
    free = [free[0] + friction[0] * c.per_mass, free[1] + friction[1] * c.per_mass, if full { free[2] + friction[2] * c.per_mass } else { free[2] }];
    // One by one: to copy a slice of registers is a call, before which all others would have to be put away.
    [d[POSITION], d[POSITION + 1], d[POSITION + 2]] = r;
    [d[VELOCITY], d[VELOCITY + 1], d[VELOCITY + 2]] = free;
    [d[SPIN], d[SPIN + 1], d[SPIN + 2]] = ball_spun;
    [d[RATE], d[RATE + 1], d[RATE + 2]] = racket_turned;
    let half = times(o, n.same(0.5));
    d[ATTITUDE] = -(q1 * half[0]) - q2 * half[1] - q3 * half[2];
    d[ATTITUDE + 1] = q0 * half[0] + q2 * half[2] - q3 * half[1];
    d[ATTITUDE + 2] = q0 * half[1] + q3 * half[0] - q1 * half[2];
    d[ATTITUDE + 3] = q0 * half[2] + q1 * half[1] - q2 * half[0];
    d[STRINGS] = w_s;
    if full {
        (d[SIDEWAYS], d[SIDEWAYS + 1]) = (side_rate[0], side_rate[1]);
        let (e, ed, f, fd) = (s[MODE], s[MODE + 1], s[TORSION], s[TORSION + 1]);
        d[MODE] = ed;
        d[MODE + 1] = -(n * force * k.mode_shape * c.per_mode_mass) - k.mode_damping * k.mode_rate * ed * 2.0 - k.mode_rate * k.mode_rate * e;
        d[TORSION] = fd;
        d[TORSION + 1] =
            -(n * force * k.torsion_shape * c.per_torsion_inertia) - k.mode_damping * k.torsion_rate * fd * 2.0 - k.torsion_rate * k.torsion_rate * f;
    }
    if whole {
        // Ledger: every power by its cause; what the contact gives to the bodies must be what ball, strings and friction take.
        let (ed, fd) = (s[MODE + 1], s[TORSION + 1]);
        let rolling = minus(spin, o);
        let given = dot(plus(pressed, friction), surface) + dot(moment, rolling);
        let taken = force * w;
        let modes = -(force * n * (k.mode_shape * ed + k.torsion_shape * fd));
        let springs = k.k_tx * s[SIDEWAYS] * side_rate[0] + k.k_ty * s[SIDEWAYS + 1] * side_rate[1];
        d[LEDGER] = c_b * u * u;
        let rolled_in = rim * (rolling[0] * rolling[0] + rolling[1] * rolling[1]);
        d[LEDGER + 1] = rolled_in + T::choose(compressing, g * u * u * u, zero);
        d[LEDGER + 2] = k.c_s * w_s * w_s;
        d[LEDGER + 3] = -given - taken - modes - springs - rolled_in;
        // Stiffness that changes as the ball moves over the face.
        let edge_rate = k.edge_x * (p[0] + k.com_x) * r[0] * 2.0 + k.edge_y * p[1] * r[1] * 2.0;
        let stored = k.k_s0 * xs * xs * 0.5 + k.k_s2 * xs * xs * xs * xs * 0.25;
        d[LEDGER + 4] = edge_rate * stored - dot(spin, spin) * inertia_rate * 0.5;
        d[LEDGER + 5] = k.mode_damping * (k.mode_rate * k.mode_mass * ed * ed + k.torsion_rate * k.torsion_inertia * fd * fd) * 2.0;
        d[LEDGER + 6] = torque[0] * o[0] + torque[1] * o[1];
    }
    let mut settling = (b + g * u.positive_part() * 2.0) / (k_b + k_s);
    if full {
        // While the ball slides, the sideways strings settle in c/k.
        settling = T::choose(zero.less(k.k_tx), settling.smaller(k.c_t * 1.5 / k.k_tx.larger(k.k_ty)), settling);
    }
    Signs { force, onset: xc - ONSET, compressing: balance, slip_x: slip[0], slip_y: slip[1], grip_left, settling, approach: delta }
}

/// The slip's rate of change for the friction `f`, in the pocket's plane.
#[inline(always)]
fn column<T: Number>(f: Three<T>, place: Three<T>, per_inertia: Three<T>, ball_part: T, normal: Three<T>) -> [T; 2] {
    let du = plus(times(f, ball_part), cross(each(cross(place, f), per_inertia), place));
    let out = dot(du, normal);
    [du[0] - out * normal[0], du[1] - out * normal[1]]
}
