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
    let at = Instant::of(s, k, c, mode);
    let press = at.press();
    let ball = at.ball(&press);
    let pocket = at.pocket(&press, &ball);
    let slip = at.slip(&ball, &pocket);
    let outside = at.outside();
    let normal = at.normal_force(&press, &ball, &pocket, &slip);
    let free = at.without_friction(&pocket, &normal, &outside);
    let yielding = at.slip_yields(&ball, &pocket, &slip, &free);
    let friction = at.friction(&press, &pocket, &slip, &yielding);
    let Moves { acceleration, spun, turned } = at.with_friction(&pocket, &free, &friction);
    // One by one: to copy a slice of registers is a call, before which all others would have to be put away.
    [d[POSITION], d[POSITION + 1], d[POSITION + 2]] = at.r;
    [d[VELOCITY], d[VELOCITY + 1], d[VELOCITY + 2]] = acceleration;
    [d[SPIN], d[SPIN + 1], d[SPIN + 2]] = spun;
    [d[RATE], d[RATE + 1], d[RATE + 2]] = turned;
    [d[ATTITUDE], d[ATTITUDE + 1], d[ATTITUDE + 2], d[ATTITUDE + 3]] = at.attitude_rate();
    d[STRINGS] = press.strings_rate;
    if S > PLAIN {
        [d[SIDEWAYS], d[SIDEWAYS + 1]] = friction.side_rate;
        [d[MODE], d[MODE + 1], d[TORSION], d[TORSION + 1]] = at.frame_rates(press.force);
    }
    if S == WHOLE {
        [d[LEDGER], d[LEDGER + 1], d[LEDGER + 2], d[LEDGER + 3], d[LEDGER + 4], d[LEDGER + 5], d[LEDGER + 6]] =
            at.powers(&press, &ball, &slip, &outside, &normal, &friction);
    }
    Signs {
        force: press.force,
        onset: press.compression - ONSET,
        compressing: press.balance,
        slip_x: slip.velocity[0],
        slip_y: slip.velocity[1],
        grip_left: friction.grip_left,
        settling: press.settling,
        approach: press.approach,
    }
}

/// The state, taken apart, and what its rates depend on besides.
struct Instant<'a, T, const S: usize> {
    s: &'a [T; S],
    k: &'a Laws<T>,
    c: &'a Constants<T>,
    mode: &'a Mode<T>,
    zero: T,
    one: T,
    per_inertia: Three<T>,
    /// Ball's centre from the racket's, its velocity relative to that centre, the ball's angular momentum, the racket's rates.
    p: Three<T>,
    v: Three<T>,
    l: Three<T>,
    o: Three<T>,
    /// Velocity of the ball's centre as seen from the racket.
    r: Three<T>,
}

/// Ball and strings against each other along the face's normal.
struct Press<T> {
    /// δ and its rate w.
    approach: T,
    approach_rate: T,
    /// δ − x_S, and as far as the ball's geometry follows it, x; 2 r x − x².
    compression: T,
    x: T,
    area: T,
    /// u and dx_S/dt.
    u: T,
    strings_rate: T,
    /// Damping of the ball, and g of its momentum flux.
    c_b: T,
    flux: T,
    force: T,
    /// C: positive while the ball is being compressed.
    balance: T,
    /// Time in which strings, ball and, while it slides, sideways strings settle, s.
    settling: T,
}

/// The ball's turning while it is compressed.
struct Ball<T> {
    arm: T,
    arm_rate: T,
    /// Inverse of its inertia.
    light: T,
    inertia_rate: T,
    spin: Three<T>,
}

/// Where the ball lies in the strings.
struct Pocket<T> {
    /// Unit z unless the pocket leans, and how fast it leans over.
    normal: Three<T>,
    lean: Three<T>,
    /// Contact point from the ball's centre, its rate, and the contact point from the racket's centre of mass.
    foot: Three<T>,
    foot_rate: Three<T>,
    place: Three<T>,
}

/// Velocity of the ball's surface against the strings: the whole, along the pocket's normal, and the slip in the pocket's plane.
struct Slip<T> {
    surface: Three<T>,
    along: T,
    velocity: [T; 2],
}

/// Of player and mount: torque on the racket, and the acceleration of the racket by the force.
struct Outside<T> {
    torque: Three<T>,
    push: T,
}

struct NormalForce<T> {
    pressed: Three<T>,
    /// Its moment on the ball, where it does not act at the centre; the racket has the reverse.
    moment: Three<T>,
    /// That of the shell landing at the contact's rim, per spin relative to the face.
    rim: T,
}

/// What the bodies do: acceleration of the ball's centre relative to the racket's, rates of the ball's angular momentum and of the
/// racket's rates.
struct Moves<T> {
    acceleration: Three<T>,
    spun: Three<T>,
    turned: Three<T>,
}

/// How the slip changes: without friction, and for a unit of friction along x (`kxx`, `kyx`) and y.
struct Yielding<T> {
    without: [T; 2],
    kxx: T,
    kxy: T,
    kyx: T,
    kyy: T,
}

struct Friction<T> {
    force: Three<T>,
    grip_left: T,
    /// Rate of the strings' sideways displacement.
    side_rate: [T; 2],
}

impl<'a, T: Number, const S: usize> Instant<'a, T, S> {
    /// The state has what effects need; what the ledger needs.
    const FULL: bool = S > PLAIN;
    const WHOLE: bool = S == WHOLE;

    #[inline(always)]
    fn of(s: &'a [T; S], k: &'a Laws<T>, c: &'a Constants<T>, mode: &'a Mode<T>) -> Self {
        let (p, v, l, o) = (three(s, POSITION), three(s, VELOCITY), three(s, SPIN), three(s, RATE));
        let (zero, one) = (mode.side.same(0.0), mode.side.same(1.0));
        Instant { s, k, c, mode, zero, one, per_inertia: [c.per_inertia_x, c.per_inertia_y, c.per_inertia_z], p, v, l, o, r: minus(v, cross(o, p)) }
    }

    /// Truncated sphere (thesis 2.7.3) against massless strings, whose force is the ball's.
    #[inline(always)]
    fn press(&self) -> Press<T> {
        let Instant { s, k, c, zero, one, p, r, .. } = *self;
        let n = self.mode.side;
        let xs = s[STRINGS];
        let r0 = k.ball_radius;
        let mut delta = r0 - n * p[2];
        let mut w = -(n * r[2]);
        if Self::FULL {
            delta = delta + n * (k.mode_shape * s[MODE] + k.torsion_shape * s[TORSION]);
            w = w + n * (k.mode_shape * s[MODE + 1] + k.torsion_shape * s[TORSION + 1]);
        }
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
        if Self::WHOLE {
            (growth, stiffening) = (relative.power(k.beta_c), x.power(k.alpha));
        }
        let mut onset = (x * (1.0 / ONSET)).smaller(one);
        if Self::FULL {
            onset = T::choose(k.onset.less(n.same(0.5)), one, onset);
        }
        let c_b = ratio * k.a_c * contact * growth + k.c_b0 * onset;
        let k_b = k.k_b0 + k.a_k * stiffening;
        let mut k_s = k.k_s0 + k.k_s2 * xs * xs;
        if Self::FULL {
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
        let mut settling = (b + g * u.positive_part() * 2.0) / (k_b + k_s);
        if Self::FULL {
            // While the ball slides, the sideways strings settle in c/k.
            settling = T::choose(zero.less(k.k_tx), settling.smaller(k.c_t * 1.5 / k.k_tx.larger(k.k_ty)), settling);
        }
        Press { approach: delta, approach_rate: w, compression: xc, x, area, u, strings_rate: w_s, c_b, flux: g, force, balance, settling }
    }

    /// Arm and inertia shrink with compression.
    #[inline(always)]
    fn ball(&self, press: &Press<T>) -> Ball<T> {
        let Instant { k, c, zero, one, l, .. } = *self;
        let arm = k.ball_radius - k.lambda_r * press.x;
        let inertia = k.ball_inertia - c.inertia_fall * press.x;
        let light = one / inertia;
        let moving = T::choose(press.compression.less(zero), zero, press.u);
        Ball { arm, arm_rate: -(k.lambda_r * moving), light, inertia_rate: -(c.inertia_fall * moving), spin: times(l, light) }
    }

    #[inline(always)]
    fn pocket(&self, press: &Press<T>, ball: &Ball<T>) -> Pocket<T> {
        let Instant { s, k, zero, one, p, r, .. } = *self;
        let (n, xs, w_s) = (self.mode.side, s[STRINGS], press.strings_rate);
        let &Ball { arm, arm_rate, .. } = ball;
        let (mut normal, mut lean) = ([zero, zero, one], [zero; 3]);
        let (mut foot, mut foot_rate) = ([zero, zero, -(arm * n)], [zero, zero, -(n * arm_rate)]);
        if Self::FULL {
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
        Pocket { normal, lean, foot, foot_rate, place: plus(p, foot) }
    }

    #[inline(always)]
    fn slip(&self, ball: &Ball<T>, pocket: &Pocket<T>) -> Slip<T> {
        let Instant { zero, v, o, .. } = *self;
        let &Pocket { normal, foot, place, .. } = pocket;
        let spin = ball.spin;
        if Self::FULL {
            let surface = plus(minus(v, cross(o, place)), cross(spin, foot));
            let along = dot(surface, normal);
            Slip { surface, along, velocity: [surface[0] - along * normal[0], surface[1] - along * normal[1]] }
        } else {
            let x = v[0] - (o[1] * place[2] - o[2] * place[1]) + spin[1] * foot[2];
            let y = v[1] - (o[2] * place[0] - o[0] * place[2]) - spin[0] * foot[2];
            Slip { surface: [x, y, zero], along: zero, velocity: [x, y] }
        }
    }

    #[inline(always)]
    fn outside(&self) -> Outside<T> {
        let Instant { k, c, zero, o, .. } = *self;
        let n = self.mode.side;
        if !Self::FULL {
            return Outside { torque: [zero; 3], push: zero };
        }
        let twist = (o[0] - k.twist_start) * (1.0 / SOFT_TWIST);
        Outside { torque: [-(k.grip * twist / (twist * twist + 1.0).sqrt()), n * k.drive_torque, zero], push: n * k.drive_force * c.per_racket_mass }
    }

    #[inline(always)]
    fn normal_force(&self, press: &Press<T>, ball: &Ball<T>, pocket: &Pocket<T>, slip: &Slip<T>) -> NormalForce<T> {
        let Instant { k, c, zero, o, .. } = *self;
        let (slip, spin) = (slip.velocity, ball.spin);
        let pressed = times(pocket.normal, press.force * self.mode.side);
        if !Self::FULL {
            return NormalForce { pressed, moment: [zero; 3], rim: zero };
        }
        // The normal force acts behind the centre, against the slip: moment o x N n on the ball, its reverse on the racket.
        let back = k.normal_offset / (slip[0] * slip[0] + slip[1] * slip[1] + SOFT_OFFSET * SOFT_OFFSET).sqrt();
        let (qx, qy) = (-(back * slip[0]), -(back * slip[1]));
        // Haake: shell lands at the contact's rim with u + g.p (p: place on the rim, g: gradient by the spin relative to the
        // face) at the rate rho (u (r - x) + r g.p); its moment, to first order in g, is pi rho a^2 u (2 r - x) g.
        let rim = k.flux_offset * press.area * press.u.positive_part() * (k.ball_radius * 2.0 - press.x) * c.resting_per_area;
        let moment = [qy * pressed[2] - rim * (spin[0] - o[0]), -(qx * pressed[2]) - rim * (spin[1] - o[1]), qx * pressed[1] - qy * pressed[0]];
        NormalForce { pressed, moment, rim }
    }

    /// Newton and Euler with the normal force and what acts from outside. Body axes turn: Ω × L goes off.
    #[inline(always)]
    fn without_friction(&self, pocket: &Pocket<T>, normal: &NormalForce<T>, outside: &Outside<T>) -> Moves<T> {
        let Instant { s, c, one, v, l, o, .. } = *self;
        let &NormalForce { pressed, moment, .. } = normal;
        let (place, foot) = (pocket.place, pocket.foot);
        let gyro = [o[1] * o[2] * c.gyro_x, o[2] * o[0] * c.gyro_y, o[0] * o[1] * c.gyro_z];
        let turning = if Self::FULL {
            minus(minus(outside.torque, moment), plus(cross(place, pressed), gyro))
        } else {
            [-(place[1] * pressed[2]) - gyro[0], place[0] * pressed[2] - gyro[1], -gyro[2]]
        };
        let turned = each(turning, self.per_inertia);
        let carried = cross(o, l);
        let spun = if Self::FULL { plus(cross(foot, pressed), minus(moment, carried)) } else { [-carried[0], -carried[1], -carried[2]] };
        let turning_axes = cross(o, v);
        let acceleration = if Self::FULL {
            // The player's force points along the world's z at first touch; the face hardly turns, but the axes do.
            let (q0, q1, q2, q3) = (s[ATTITUDE], s[ATTITUDE + 1], s[ATTITUDE + 2], s[ATTITUDE + 3]);
            let up = [(q1 * q3 - q0 * q2) * 2.0, (q2 * q3 + q0 * q1) * 2.0, one - (q1 * q1 + q2 * q2) * 2.0];
            minus(minus(times(pressed, c.per_mass), turning_axes), times(up, outside.push))
        } else {
            [-turning_axes[0], -turning_axes[1], pressed[2] * c.per_mass - turning_axes[2]]
        };
        Moves { acceleration, spun, turned }
    }

    #[inline(always)]
    fn slip_yields(&self, ball: &Ball<T>, pocket: &Pocket<T>, slip: &Slip<T>, free: &Moves<T>) -> Yielding<T> {
        let Instant { c, zero, one, per_inertia, o, r, .. } = *self;
        let &Ball { arm, light, inertia_rate, spin, .. } = ball;
        let &Pocket { normal, lean, foot, foot_rate, place } = pocket;
        let &Moves { acceleration, spun, turned } = free;
        let shrink = inertia_rate * light;
        let whirl = [spun[0] * light - spin[0] * shrink, spun[1] * light - spin[1] * shrink, spun[2] * light - spin[2] * shrink];
        let drift = plus(r, foot_rate);
        let ball_part = c.per_mass + arm * arm * light;
        if Self::FULL {
            let a = plus(minus(minus(acceleration, cross(turned, place)), cross(o, drift)), plus(cross(whirl, foot), cross(spin, foot_rate)));
            // Against a leaning normal: the slip is what is left of the surface's velocity in the pocket's plane, and that plane turns.
            let change = dot(a, normal) + dot(slip.surface, lean);
            let without = [a[0] - change * normal[0] - slip.along * lean[0], a[1] - change * normal[1] - slip.along * lean[1]];
            let per_normal = one / normal[2];
            let [kxx, kyx] = column([one, zero, -(normal[0] * per_normal)], place, per_inertia, ball_part, normal);
            let [kxy, kyy] = column([zero, one, -(normal[1] * per_normal)], place, per_inertia, ball_part, normal);
            Yielding { without, kxx, kxy, kyx, kyy }
        } else {
            let [ix, iy, iz] = per_inertia;
            let without = [
                acceleration[0] - (turned[1] * place[2] - turned[2] * place[1]) - (o[1] * drift[2] - o[2] * drift[1])
                    + whirl[1] * foot[2]
                    + spin[1] * foot_rate[2],
                acceleration[1]
                    - (turned[2] * place[0] - turned[0] * place[2])
                    - (o[2] * drift[0] - o[0] * drift[2])
                    - whirl[0] * foot[2]
                    - spin[0] * foot_rate[2],
            ];
            let kxy = -(place[0] * place[1] * iz);
            Yielding {
                without,
                kxx: ball_part + place[1] * place[1] * iz + place[2] * place[2] * iy,
                kxy,
                kyx: kxy,
                kyy: ball_part + place[0] * place[0] * iz + place[2] * place[2] * ix,
            }
        }
    }

    /// Coulomb's, against the slip or as sticking needs it; with sideways strings in series with them.
    #[inline(always)]
    fn friction(&self, press: &Press<T>, pocket: &Pocket<T>, slip: &Slip<T>, yielding: &Yielding<T>) -> Friction<T> {
        let Instant { s, k, c, mode, zero, one, .. } = *self;
        let &Yielding { without, kxx, kxy, kyx, kyy } = yielding;
        let slip = slip.velocity;
        let limit = k.mu * press.force.positive_part();
        let sticking = mode.stick.less(zero.same(1.5)) & zero.same(0.5).less(mode.stick);
        let sliding = mode.stick.less(zero.same(0.5));
        let whole_k = one / (kxx * kyy - kxy * kyx);
        let back = T::choose(sticking, zero.same(SLIP_RETURN), zero);
        let (bx, by) = (-(without[0] + back * slip[0]), -(without[1] + back * slip[1]));
        let hold = [(kyy * bx - kxy * by) * whole_k, (kxx * by - kyx * bx) * whole_k];
        // Past nil slip the law is continued as it was before, so that a step that ends there sees a smooth force.
        let forward = T::choose((slip[0] * mode.direction_x + slip[1] * mode.direction_y).less(zero), -one, one);
        let mut against = [-(forward * slip[0]) - mode.direction_x * SOFT_SLIP, -(forward * slip[1]) - mode.direction_y * SOFT_SLIP];
        if Self::FULL {
            let (px, py) = ((kyy * against[0] - kxy * against[1]) * whole_k, (kxx * against[1] - kyx * against[0]) * whole_k);
            let projected = zero.less(k.projected);
            against = [T::choose(projected, px, against[0]), T::choose(projected, py, against[1])];
        }
        let toward = [T::choose(sliding, against[0], hold[0]), T::choose(sliding, against[1], hold[1])];
        let scale = T::choose(sticking, one, limit / ((toward[0] * toward[0] + toward[1] * toward[1]).sqrt() + TINY));
        let mut force = [toward[0] * scale, toward[1] * scale, zero];
        let mut grip_left = limit - (hold[0] * hold[0] + hold[1] * hold[1]).sqrt();
        let mut side_rate = [zero; 2];
        if Self::FULL {
            let springs = zero.less(k.k_tx);
            let pull = [k.k_tx * s[SIDEWAYS], k.k_ty * s[SIDEWAYS + 1]];
            let held = [-(pull[0] + k.c_t * slip[0]), -(pull[1] + k.c_t * slip[1])];
            let h = (held[0] * held[0] + held[1] * held[1]).sqrt();
            let keep = T::choose(limit.less(h), limit / (h + TINY), one);
            for i in 0..2 {
                force[i] = T::choose(springs, held[i] * keep, force[i]);
                side_rate[i] = T::choose(springs, -((force[i] + pull[i]) * c.per_side_damping), zero);
            }
            grip_left = T::choose(springs, limit - h, grip_left);
            // Friction lies in the pocket's plane.
            force[2] = -((force[0] * pocket.normal[0] + force[1] * pocket.normal[1]) / pocket.normal[2]);
        }
        Friction { force, grip_left, side_rate }
    }

    #[inline(always)]
    fn with_friction(&self, pocket: &Pocket<T>, free: &Moves<T>, friction: &Friction<T>) -> Moves<T> {
        let Instant { c, per_inertia, .. } = *self;
        let &Moves { acceleration, spun, turned } = free;
        let (place, foot, force) = (pocket.place, pocket.foot, friction.force);
        if Self::FULL {
            Moves {
                acceleration: plus(acceleration, times(force, c.per_mass)),
                spun: plus(spun, cross(foot, force)),
                turned: minus(turned, each(cross(place, force), per_inertia)),
            }
        } else {
            let ([fx, fy, _], [x, y, z], [ix, iy, iz]) = (force, place, per_inertia);
            Moves {
                acceleration: [acceleration[0] + fx * c.per_mass, acceleration[1] + fy * c.per_mass, acceleration[2]],
                spun: [spun[0] - foot[2] * fy, spun[1] + foot[2] * fx, spun[2]],
                turned: [turned[0] + z * fy * ix, turned[1] - z * fx * iy, turned[2] - (x * fy - y * fx) * iz],
            }
        }
    }

    #[inline(always)]
    fn attitude_rate(&self) -> [T; 4] {
        let s = self.s;
        let (q0, q1, q2, q3) = (s[ATTITUDE], s[ATTITUDE + 1], s[ATTITUDE + 2], s[ATTITUDE + 3]);
        let half = times(self.o, self.zero.same(0.5));
        [
            -(q1 * half[0]) - q2 * half[1] - q3 * half[2],
            q0 * half[0] + q2 * half[2] - q3 * half[1],
            q0 * half[1] + q3 * half[0] - q1 * half[2],
            q0 * half[2] + q1 * half[1] - q2 * half[0],
        ]
    }

    /// Of the bending and the torsional mode.
    #[inline(always)]
    fn frame_rates(&self, force: T) -> [T; 4] {
        let Instant { s, k, c, .. } = *self;
        let n = self.mode.side;
        let (e, ed, f, fd) = (s[MODE], s[MODE + 1], s[TORSION], s[TORSION + 1]);
        [
            ed,
            -(n * force * k.mode_shape * c.per_mode_mass) - k.mode_damping * k.mode_rate * ed * 2.0 - k.mode_rate * k.mode_rate * e,
            fd,
            -(n * force * k.torsion_shape * c.per_torsion_inertia) - k.mode_damping * k.torsion_rate * fd * 2.0 - k.torsion_rate * k.torsion_rate * f,
        ]
    }

    /// The ledger: every power by its cause; what the contact gives to the bodies must be what ball, strings and friction take.
    #[inline(always)]
    fn powers(
        &self,
        press: &Press<T>,
        ball: &Ball<T>,
        slip: &Slip<T>,
        outside: &Outside<T>,
        normal: &NormalForce<T>,
        friction: &Friction<T>,
    ) -> [T; LEDGER_ENTRIES] {
        let Instant { s, k, zero, p, o, r, .. } = *self;
        let &Press { u, strings_rate: w_s, force, .. } = press;
        let (spin, xs, side_rate) = (ball.spin, s[STRINGS], friction.side_rate);
        let (ed, fd) = (s[MODE + 1], s[TORSION + 1]);
        let rolling = minus(spin, o);
        let given = dot(plus(normal.pressed, friction.force), slip.surface) + dot(normal.moment, rolling);
        let taken = force * press.approach_rate;
        let modes = -(force * self.mode.side * (k.mode_shape * ed + k.torsion_shape * fd));
        let springs = k.k_tx * s[SIDEWAYS] * side_rate[0] + k.k_ty * s[SIDEWAYS + 1] * side_rate[1];
        let rolled_in = normal.rim * (rolling[0] * rolling[0] + rolling[1] * rolling[1]);
        // Stiffness that changes as the ball moves over the face.
        let edge_rate = k.edge_x * (p[0] + k.com_x) * r[0] * 2.0 + k.edge_y * p[1] * r[1] * 2.0;
        let stored = k.k_s0 * xs * xs * 0.5 + k.k_s2 * xs * xs * xs * xs * 0.25;
        [
            press.c_b * u * u,
            rolled_in + T::choose(zero.less(press.balance), press.flux * u * u * u, zero),
            k.c_s * w_s * w_s,
            -given - taken - modes - springs - rolled_in,
            edge_rate * stored - dot(spin, spin) * ball.inertia_rate * 0.5,
            k.mode_damping * (k.mode_rate * k.mode_mass * ed * ed + k.torsion_rate * k.torsion_inertia * fd * fd) * 2.0,
            outside.torque[0] * o[0] + outside.torque[1] * o[1],
        ]
    }
}

/// The slip's rate of change for the friction `f`, in the pocket's plane.
#[inline(always)]
fn column<T: Number>(f: Three<T>, place: Three<T>, per_inertia: Three<T>, ball_part: T, normal: Three<T>) -> [T; 2] {
    let du = plus(times(f, ball_part), cross(each(cross(place, f), per_inertia), place));
    let out = dot(du, normal);
    [du[0] - out * normal[0], du[1] - out * normal[1]]
}
