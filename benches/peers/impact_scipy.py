"""The visco-elastic impact in scipy: the peer of `cargo bench --bench impact`.

Same equations, same impacts, solve_ivp with RK45 at rtol 1e-6 and an event at last contact; friction regularised over
0.05 m/s where ours lands on stick and slip. Prints impacts per second of processor time on one core and the first result.
"""

import time

import numpy as np
from scipy.integrate import solve_ivp

M_BALL, R0, BETA = 0.0577, 0.033, 0.55
M_RACKET, INERTIA = 0.33, np.array([0.0015, 0.0158, 0.0173])
K_B0, A_K, A_C, C_B0, D2_REF = 24e3, 6.3e7, 1393.0, 4.6, 1.6e-3
K_S0, K_S2, C_S = 39e3, 25e6, 2.0
MU, LAMBDA, KAPPA, EPS = 0.5, 0.5, 5.0, 0.05
I_BALL = BETA * M_BALL * R0**2


def cross(a, b):
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def normal(xc, xs, w):
    x = min(max(xc, 0.0), 0.98 * R0)
    area = 2 * R0 * x - x * x
    ratio = M_BALL / (M_BALL - M_BALL * area / (4 * R0**2))
    g = ratio * M_BALL * (R0 - x) / (2 * R0**2)
    d2 = 4 * area
    c_b = ratio * A_C * d2 * (d2 / D2_REF) ** 2 + C_B0 * min(1.0, x / 1e-3)
    k_b = K_B0 + A_K * x * x
    k_s = K_S0 + K_S2 * xs * xs
    b = c_b + C_S
    c = k_s * xs + C_S * w - k_b * xc
    u = 2 * c / (b + np.sqrt(b * b + 4 * g * c)) if c > 0 else c / b
    return C_S * (w - u) + k_s * xs, u, x


def rates(_t, s):
    rho, v, spin, rate, q, xs = s[0:3], s[3:6], s[6:9], s[9:12], s[12:16], s[16]
    seen = v - cross(rate, rho)
    w = -seen[2]
    force, u, x = normal(R0 - rho[2] - xs, xs, w)
    arm, inertia = R0 - LAMBDA * x, I_BALL * (1 - KAPPA * x)
    c = np.array([0.0, 0.0, -arm])
    slip = v - cross(rate, rho + c) + cross(spin / inertia, c)
    slip[2] = 0.0
    f = -MU * max(force, 0.0) * slip / np.sqrt(slip[0] ** 2 + slip[1] ** 2 + EPS**2)
    f[2] = force
    out = np.empty(17)
    out[0:3] = seen
    out[3:6] = f * (1 / M_BALL + 1 / M_RACKET) - cross(rate, v)
    out[6:9] = cross(c, f) - cross(rate, spin)
    out[9:12] = (-cross(rho + c, f) - cross(rate, INERTIA * rate)) / INERTIA
    out[12] = -0.5 * (q[1:] @ rate)
    out[13:16] = 0.5 * (q[0] * rate + cross(q[1:], rate))
    out[16] = w - u
    return out


def release(_t, s):
    w = -(s[3:6] - cross(s[9:12], s[0:3]))[2]
    return normal(R0 - s[2] - s[16], s[16], w)[0]


release.terminal, release.direction = True, -1


def impact(vy, rtol=1e-6):
    start = np.zeros(17)
    start[0:3] = [-0.2, 0.03, R0]
    start[3:6] = np.array([1.0, vy, -28.0]) - np.array([-1.0, 2.0, 4.0])
    start[6:9] = I_BALL * np.array([100.0, -50.0, 20.0])
    start[9:12] = [2.0, 25.0, -5.0]
    start[12] = 1.0
    return solve_ivp(rates, (0, 0.02), start, method="RK45", rtol=rtol, atol=1e-9, events=release, first_step=1e-6)


if __name__ == "__main__":
    n = 40
    begin = time.process_time()
    results = [impact(0.5 * (i % 40)) for i in range(n)]
    took = time.process_time() - begin
    evaluations = sum(r.nfev for r in results) / n
    print(f"scipy RK45 rtol 1e-6: {n / took:.1f} impacts/s of processor time, {evaluations:.0f} evaluations each")
    last = impact(9.0)
    print("vy 9:", last.t_events[0], last.y_events[0][0][3:6])
