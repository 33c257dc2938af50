//! Rates of change of one impact: the equations of the physics reference, section C, in the racket's own axes.

use super::laws::Laws;

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
const DEEPEST: f64 = 0.98;
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

/// What a step needs besides the rates: where the kinks are.
#[derive(Clone, Copy, Default)]
pub(super) struct Signs {
    /// Contact force, N.
    pub force: f64,
    /// Compression minus the onset, m.
    pub onset: f64,
    /// Positive while the ball is being compressed, N.
    pub compressing: f64,
    /// Slip velocity, m/s.
    pub slip: [f64; 2],
    /// Friction limit minus what sticking needs, N.
    pub grip_left: f64,
    /// Direction of the friction that sticking needs.
    pub stick: [f64; 2],
    /// Time in which strings and ball settle against each other, s.
    pub settling: f64,
    /// How far the ball's centre has come since first touch, m.
    pub approach: f64,
}

/// Sliding, sticking, and just freed: the slip is too small to have a direction of its own, so friction points where sticking
/// would need it (exact while the slip follows its acceleration).
pub(super) const SLIDE: f64 = 0.0;
pub(super) const STICK: f64 = 1.0;
pub(super) const CREEP: f64 = 2.0;

/// Contact mode of one impact, carried along by the stepper.
#[derive(Clone, Copy)]
pub(super) struct Mode {
    /// The side from which the ball comes, ±1.
    pub side: f64,
    /// [`STICK`], [`SLIDE`] or [`CREEP`]; a number, so that lanes can choose without branches.
    pub stick: f64,
    /// Sliding direction at the start of the step.
    pub direction: [f64; 2],
}

/// Rates of change of the state; `S` is [`PLAIN`], [`FULL`] or [`WHOLE`].
///
/// Written without branches that depend on values, so that the compiler can run several impacts in one instruction.
#[inline(always)]
pub(super) fn rates<const S: usize>(s: &[f64; S], k: &Laws, mode: Mode) -> ([f64; S], Signs) {
    let (full, whole) = (S > PLAIN, S == WHOLE);
    let n = mode.side;
    let (px, py, pz) = (s[POSITION], s[POSITION + 1], s[POSITION + 2]);
    let (vx, vy, vz) = (s[VELOCITY], s[VELOCITY + 1], s[VELOCITY + 2]);
    let (lx, ly, lz) = (s[SPIN], s[SPIN + 1], s[SPIN + 2]);
    let (ox, oy, oz) = (s[RATE], s[RATE + 1], s[RATE + 2]);
    let xs = s[STRINGS];
    // Velocity of the ball's centre as seen from the racket.
    let (rx, ry, rz) = (vx - (oy * pz - oz * py), vy - (oz * px - ox * pz), vz - (ox * py - oy * px));
    let mut delta = k.ball_radius - n * pz;
    let mut w = -n * rz;
    let (mut phi, mut psi) = (0.0, 0.0);
    if full {
        (phi, psi) = (k.mode_shape, k.torsion_shape);
        delta += n * (phi * s[MODE] + psi * s[TORSION]);
        w += n * (phi * s[MODE + 1] + psi * s[TORSION + 1]);
    }
    // Ball: truncated sphere (thesis 2.7.3).
    let xc = delta - xs;
    let r0 = k.ball_radius;
    let x = if xc < 0.0 {
        0.0
    } else if xc > DEEPEST * r0 {
        DEEPEST * r0
    } else {
        xc
    };
    let area = 2.0 * r0 * x - x * x;
    let m = k.ball_mass;
    let resting = m * area / (4.0 * r0 * r0);
    let ratio = m / (m - resting);
    let g = k.flux * ratio * m * (r0 - x) / (2.0 * r0 * r0);
    // The contact's diameter squared is 4 (2 r x - x^2).
    let contact = 4.0 * area;
    let relative = contact / REFERENCE_AREA;
    let growth = if whole { if k.beta_c == 2.0 { relative * relative } else { relative.powf(k.beta_c) } } else { relative * relative };
    let mut onset = if x < ONSET { x / ONSET } else { 1.0 };
    if full && k.onset == 0.0 {
        onset = 1.0;
    }
    let c_b = ratio * k.a_c * contact * growth + k.c_b0 * onset;
    let stiffening = if whole { if k.alpha == 2.0 { x * x } else { x.powf(k.alpha) } } else { x * x };
    let k_b = k.k_b0 + k.a_k * stiffening;
    // Massless stringbed: the ball's force equals the strings' (C.4).
    let edge = if full { 1.0 + k.edge_x * (px + k.com_x) * (px + k.com_x) + k.edge_y * py * py } else { 1.0 };
    let k_s = (k.k_s0 + k.k_s2 * xs * xs) * edge;
    let b = c_b + k.c_s;
    let c = k_s * xs + k.c_s * w - k_b * xc;
    let root = (b * b + 4.0 * g * (if c > 0.0 { c } else { 0.0 })).sqrt();
    let u = if c > 0.0 { 2.0 * c / (b + root) } else { c / b };
    let w_s = w - u;
    let force = k.c_s * w_s + k_s * xs;
    // Arm and inertia shrink with compression (C.5).
    let arm = r0 - k.lambda_r * x;
    let inertia = k.ball_inertia * (1.0 - k.kappa_i * x);
    let arm_rate = if xc >= 0.0 { -k.lambda_r * u } else { 0.0 };
    let inertia_rate = if xc >= 0.0 { -k.ball_inertia * k.kappa_i * u } else { 0.0 };
    let (wx, wy, wz) = (lx / inertia, ly / inertia, lz / inertia);
    // The pocket's normal (unit z unless it leans) and the contact point c below the ball.
    let (mut nx, mut ny, mut nz) = (0.0, 0.0, 1.0);
    // How fast it leans over.
    let mut lean = [0.0; 3];
    if full {
        nx = -k.tilt_x * xs * (px + k.com_x);
        ny = -k.tilt_y * xs * py;
        let length = (1.0 + nx * nx + ny * ny).sqrt();
        let (gx, gy) = (-k.tilt_x * (w_s * (px + k.com_x) + xs * rx) / length, -k.tilt_y * (w_s * py + xs * ry) / length);
        (nx, ny, nz) = (nx / length, ny / length, 1.0 / length);
        let along = nx * gx + ny * gy;
        lean = [gx - along * nx, gy - along * ny, -along * nz];
    }
    let (cx, cy, cz) = (-arm * n * nx, -arm * n * ny, -arm * n * nz);
    let (sx, sy, sz) = (px + cx, py + cy, pz + cz);
    // Velocity of the ball's surface against the strings.
    let ux = vx - (oy * sz - oz * sy) + (wy * cz - wz * cy);
    let uy = vy - (oz * sx - ox * sz) + (wz * cx - wx * cz);
    let uz = vz - (ox * sy - oy * sx) + (wx * cy - wy * cx);
    let along = ux * nx + uy * ny + uz * nz;
    let (tx, ty) = (ux - along * nx, uy - along * ny);
    let load = if force > 0.0 { force } else { 0.0 };
    let limit = k.mu * load;
    let per_mass = 1.0 / m + 1.0 / k.racket_mass;
    // Outside torque and force on the racket.
    let mut torque = [0.0; 3];
    let mut outside = 0.0;
    if full {
        let twist = (ox - k.twist_start) / SOFT_TWIST;
        torque = [-k.grip * twist / (1.0 + twist * twist).sqrt(), n * k.drive_torque, 0.0];
        outside = n * k.drive_force;
    }
    // Friction that keeps the slip at nil: a0 is the slip's rate of change without friction (normal force only).
    let (fnx, fny, fnz) = (force * n * nx, force * n * ny, force * n * nz);
    let gyro = [oy * oz * (k.inertia_z - k.inertia_y), oz * ox * (k.inertia_x - k.inertia_z), ox * oy * (k.inertia_y - k.inertia_x)];
    let turn = |fx: f64, fy: f64, fz: f64, extra: [f64; 3]| {
        (
            (-(sy * fz - sz * fy) + torque[0] + extra[0] - gyro[0]) / k.inertia_x,
            (-(sz * fx - sx * fz) + torque[1] + extra[1] - gyro[1]) / k.inertia_y,
            (-(sx * fy - sy * fx) + torque[2] + extra[2] - gyro[2]) / k.inertia_z,
        )
    };
    // The normal force acts behind the centre, against the slip: moment o x N n on the ball, its reverse on the racket.
    let (mut moment, mut rim) = ([0.0; 3], 0.0);
    if full {
        let soft = (tx * tx + ty * ty + 0.25).sqrt();
        let (qx, qy) = (-k.normal_offset * tx / soft, -k.normal_offset * ty / soft);
        moment = [qy * fnz, -qx * fnz, qx * fny - qy * fnx];
        // Haake: shell lands at the contact's rim with u + g.p (p: place on the rim, g: gradient by the spin relative to the
        // face) at the rate rho (u (r - x) + r g.p); its moment, to first order in g, is pi rho a^2 u (2 r - x) g.
        rim = if u > 0.0 { k.flux_offset * m * area * u * (2.0 * r0 - x) / (4.0 * r0 * r0) } else { 0.0 };
        moment[0] -= rim * (wx - ox);
        moment[1] -= rim * (wy - oy);
    }
    let reverse = [-moment[0], -moment[1], -moment[2]];
    let (ax, ay, az) = turn(fnx, fny, fnz, reverse);
    let (c_rate_x, c_rate_y, c_rate_z) = (-n * (arm_rate * nx + arm * lean[0]), -n * (arm_rate * ny + arm * lean[1]), -n * (arm_rate * nz + arm * lean[2]));
    let (dx, dy, dz) = (rx + c_rate_x, ry + c_rate_y, rz + c_rate_z);
    // The player's force points along the world's z at first touch; the face hardly turns, but the axes do.
    let (q0, q1, q2, q3) = (s[ATTITUDE], s[ATTITUDE + 1], s[ATTITUDE + 2], s[ATTITUDE + 3]);
    let push = outside / k.racket_mass;
    let up = [2.0 * (q1 * q3 - q0 * q2), 2.0 * (q2 * q3 + q0 * q1), 1.0 - 2.0 * (q1 * q1 + q2 * q2)];
    // Body axes turn: subtract Omega x L.
    let spin_rate = |fx: f64, fy: f64, fz: f64| {
        (
            cy * fz - cz * fy + moment[0] - (oy * lz - oz * ly),
            cz * fx - cx * fz + moment[1] - (oz * lx - ox * lz),
            cx * fy - cy * fx + moment[2] - (ox * ly - oy * lx),
        )
    };
    let (l0x, l0y, l0z) = spin_rate(fnx, fny, fnz);
    let shrink = inertia_rate / inertia;
    let (w0x, w0y, w0z) = (l0x / inertia - wx * shrink, l0y / inertia - wy * shrink, l0z / inertia - wz * shrink);
    let mut a0x = fnx * per_mass - (oy * vz - oz * vy) - (ay * sz - az * sy) - (oy * dz - oz * dy) + (w0y * cz - w0z * cy) + (wy * c_rate_z - wz * c_rate_y);
    let mut a0y = fny * per_mass - (oz * vx - ox * vz) - (az * sx - ax * sz) - (oz * dx - ox * dz) + (w0z * cx - w0x * cz) + (wz * c_rate_x - wx * c_rate_z);
    let ball_part = per_mass + arm * arm / inertia;
    let mut kxx = ball_part + sy * sy / k.inertia_z + sz * sz / k.inertia_y;
    let mut kyy = ball_part + sx * sx / k.inertia_z + sz * sz / k.inertia_x;
    let mut kxy = -sx * sy / k.inertia_z;
    let mut kyx = kxy;
    if full {
        (a0x, a0y) = (a0x - push * up[0], a0y - push * up[1]);
        // Against a leaning normal: the slip is what is left of u in the pocket's plane, and that plane turns.
        let a0z = fnz * per_mass - (ox * vy - oy * vx) - (ax * sy - ay * sx) - (ox * dy - oy * dx) + (w0x * cy - w0y * cx) + (wx * c_rate_y - wy * c_rate_x)
            - push * up[2];
        let change = a0x * nx + a0y * ny + a0z * nz + ux * lean[0] + uy * lean[1] + uz * lean[2];
        (a0x, a0y) = (a0x - change * nx - along * lean[0], a0y - change * ny - along * lean[1]);
        // Columns: slip's rate of change for a unit of friction along x and y, in the pocket's plane.
        let column = |fx: f64, fy: f64| {
            let fz = -(fx * nx + fy * ny) / nz;
            let (tx, ty, tz) = ((sy * fz - sz * fy) / k.inertia_x, (sz * fx - sx * fz) / k.inertia_y, (sx * fy - sy * fx) / k.inertia_z);
            let (x, y, z) = (ball_part * fx + ty * sz - tz * sy, ball_part * fy + tz * sx - tx * sz, ball_part * fz + tx * sy - ty * sx);
            let out = x * nx + y * ny + z * nz;
            (x - out * nx, y - out * ny)
        };
        ((kxx, kyx), (kxy, kyy)) = (column(1.0, 0.0), column(0.0, 1.0));
    }
    let det = kxx * kyy - kxy * kyx;
    let back = if mode.stick == STICK { SLIP_RETURN } else { 0.0 };
    let (bx, by) = (-(a0x + back * tx), -(a0y + back * ty));
    let (stick_x, stick_y) = ((kyy * bx - kxy * by) / det, (kxx * by - kyx * bx) / det);
    let stick_size = (stick_x * stick_x + stick_y * stick_y).sqrt();
    // Past nil slip the law is continued as it was before, so that a step that ends there sees a smooth force.
    let forward = if tx * mode.direction[0] + ty * mode.direction[1] < 0.0 { -1.0 } else { 1.0 };
    let (mut qx, mut qy) = (forward * tx + SOFT_SLIP * mode.direction[0], forward * ty + SOFT_SLIP * mode.direction[1]);
    if full && k.projected > 0.0 {
        (qx, qy) = ((kyy * qx - kxy * qy) / det, (kxx * qy - kyx * qx) / det);
    }
    let q = (qx * qx + qy * qy).sqrt() + 1e-300;
    let (slide_x, slide_y) = (-limit * qx / q, -limit * qy / q);
    let creep = limit / (stick_size + 1e-300);
    let mut fx = if mode.stick == STICK {
        stick_x
    } else if mode.stick == CREEP {
        creep * stick_x
    } else {
        slide_x
    };
    let mut fy = if mode.stick == STICK {
        stick_y
    } else if mode.stick == CREEP {
        creep * stick_y
    } else {
        slide_y
    };
    let mut side_rate = [0.0; 2];
    let mut grip_left = limit - stick_size;
    if full && k.k_tx > 0.0 {
        // Sideways springs in series with friction (C.5 c).
        let (ex, ey) = (s[SIDEWAYS], s[SIDEWAYS + 1]);
        let (hx, hy) = (-(k.k_tx * ex + k.c_t * tx), -(k.k_ty * ey + k.c_t * ty));
        let h = (hx * hx + hy * hy).sqrt();
        let keep = if h > limit { limit / h } else { 1.0 };
        grip_left = limit - h;
        (fx, fy) = (hx * keep, hy * keep);
        side_rate = [-(fx + k.k_tx * ex) / k.c_t, -(fy + k.k_ty * ey) / k.c_t];
    }
    // Friction lies in the pocket's plane.
    let fz = if full { -(fx * nx + fy * ny) / nz } else { 0.0 };
    let (gx, gy, gz) = (fnx + fx, fny + fy, fnz + fz);
    let (rax, ray, raz) = turn(gx, gy, gz, reverse);
    let (rlx, rly, rlz) = spin_rate(gx, gy, gz);
    let mut d = [0.0; S];
    d[POSITION] = rx;
    d[POSITION + 1] = ry;
    d[POSITION + 2] = rz;
    d[VELOCITY] = gx * per_mass - (oy * vz - oz * vy) - push * up[0];
    d[VELOCITY + 1] = gy * per_mass - (oz * vx - ox * vz) - push * up[1];
    d[VELOCITY + 2] = gz * per_mass - (ox * vy - oy * vx) - push * up[2];
    d[SPIN] = rlx;
    d[SPIN + 1] = rly;
    d[SPIN + 2] = rlz;
    d[RATE] = rax;
    d[RATE + 1] = ray;
    d[RATE + 2] = raz;
    d[ATTITUDE] = 0.5 * (-q1 * ox - q2 * oy - q3 * oz);
    d[ATTITUDE + 1] = 0.5 * (q0 * ox + q2 * oz - q3 * oy);
    d[ATTITUDE + 2] = 0.5 * (q0 * oy + q3 * ox - q1 * oz);
    d[ATTITUDE + 3] = 0.5 * (q0 * oz + q1 * oy - q2 * ox);
    d[STRINGS] = w_s;
    if full {
        d[SIDEWAYS] = side_rate[0];
        d[SIDEWAYS + 1] = side_rate[1];
        let (e, ed) = (s[MODE], s[MODE + 1]);
        d[MODE] = ed;
        d[MODE + 1] =
            if k.mode_mass > 0.0 { -n * force * phi / k.mode_mass - 2.0 * k.mode_damping * k.mode_rate * ed - k.mode_rate * k.mode_rate * e } else { 0.0 };
        let (f, fd) = (s[TORSION], s[TORSION + 1]);
        d[TORSION] = fd;
        d[TORSION + 1] = if k.torsion_inertia > 0.0 {
            -n * force * psi / k.torsion_inertia - 2.0 * k.mode_damping * k.torsion_rate * fd - k.torsion_rate * k.torsion_rate * f
        } else {
            0.0
        };
    }
    if whole {
        // Ledger: every power by its cause; what the contact gives to the bodies must be what ball, strings and friction take.
        let given = gx * ux + gy * uy + gz * uz + moment[0] * (wx - ox) + moment[1] * (wy - oy) + moment[2] * (wz - oz);
        let taken = force * w;
        let (ed, fd) = (s[MODE + 1], s[TORSION + 1]);
        let modes = -force * n * (phi * ed + psi * fd);
        let springs = k.k_tx * s[SIDEWAYS] * side_rate[0] + k.k_ty * s[SIDEWAYS + 1] * side_rate[1];
        d[LEDGER] = c_b * u * u;
        let rolled_in = rim * ((wx - ox) * (wx - ox) + (wy - oy) * (wy - oy));
        d[LEDGER + 1] = rolled_in + if c > 0.0 { g * u * u * u } else { 0.0 };
        d[LEDGER + 2] = k.c_s * w_s * w_s;
        d[LEDGER + 3] = -given - taken - modes - springs - rolled_in;
        let spin2 = wx * wx + wy * wy + wz * wz;
        // Stiffness that changes as the ball moves over the face.
        let edge_rate = 2.0 * k.edge_x * (px + k.com_x) * rx + 2.0 * k.edge_y * py * ry;
        let stored = 0.5 * k.k_s0 * xs * xs + 0.25 * k.k_s2 * xs * xs * xs * xs;
        d[LEDGER + 4] = -0.5 * spin2 * inertia_rate + edge_rate * stored;
        d[LEDGER + 5] = 2.0 * k.mode_damping * (k.mode_rate * k.mode_mass * ed * ed + k.torsion_rate * k.torsion_inertia * fd * fd);
        d[LEDGER + 6] = torque[0] * ox + torque[1] * oy;
    }
    let mut settling = (b + 2.0 * g * (if u > 0.0 { u } else { 0.0 })) / (k_b + k_s);
    if full && k.k_tx > 0.0 {
        // While the ball slides, the sideways strings settle in c/k.
        settling = settling.min(1.5 * k.c_t / k.k_tx.max(k.k_ty));
    }
    let signs = Signs { force, onset: xc - ONSET, compressing: c, slip: [tx, ty], grip_left, stick: [stick_x, stick_y], settling, approach: delta };
    (d, signs)
}
