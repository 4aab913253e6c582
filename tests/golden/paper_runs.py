"""The paper's runs, 20 s at 10 kHz: `python paper_runs.py [SUBSTEPS] [--json FILE]`.

Three laws, two scenarios; prints the windows of Tables 3 and 4. Plain RK4 with SUBSTEPS steps per
control tick (10 unless told), the leak inside the right-hand side, its time profile held over a
tick. The equations are those of drhas.py once more, in a form that numba compiles; `check`
compares the two before anything runs.
"""

import argparse
import functools
import json

import numba
import numpy

import drhas

RATE_HZ = 10000
TICKS = 20 * RATE_HZ
WINDOWS_S = [(0, 7), (7, 8), (15, 20)]
SCENARIOS = {"S1": (5e-7, 10.0, 1e-7, 0.5), "S2": (1e-9, 5.0, 0.5e-9, 10.0)}
LAWS = ("pid", "nrsc", "ftsc")
F1_FLOOR = drhas.F1_FLOOR

A = list(drhas.ACTUATOR)
K_I, K_Q, P_S, P_R, M_H, B_H, A_1, A_2, BETA_E, V_10, V_20, C_I, C_T, K_H, D_0, D_A, D_F, D_T = range(len(A))
G = list(drhas.GAINS)
K1, K2, K11, K12, K21, K22, K31, K32, H21, H22, E1, E2, H31, H32, X1, X2, MIN1, MIN2, MAX1, MAX2, GA1, GA2 = range(len(G))


def arrays(p):
    """Parameters as arrays: both actuators, the surface."""
    acts = numpy.array([[p[n][k] for k in A] for n in ("actuator1", "actuator2")])
    return acts, numpy.array([p["surface"][k] for k in drhas.SURFACE])


@numba.njit
def root(x):
    return numpy.sqrt(x) if x > 0 else 0.0


@numba.njit
def signed_root(x):
    return numpy.sqrt(x) if x > 0 else -numpy.sqrt(-x)


@numba.njit
def right_hand_side(acts, surface, y, u, t, out):
    r, inertia, damping, load = surface
    torque = 0.0
    for i in range(2):
        a = acts[i]
        x, v, p1, p2 = y[2 + 4 * i], y[3 + 4 * i], y[4 + 4 * i], y[5 + 4 * i]
        rod = a[K_H] * (x - r * y[0])
        torque += r * rod
        d = a[D_0]
        if t >= a[D_T]:
            d += a[D_A] * numpy.sin(2 * numpy.pi * a[D_F] * t)
        gain = a[K_Q] * a[K_I] * u[i]
        if u[i] >= 0:
            flow1, flow2 = gain * root(a[P_S] - p1), gain * root(p2 - a[P_R])
        else:
            flow1, flow2 = gain * root(p1 - a[P_R]), gain * root(a[P_S] - p2)
        leak = a[C_I] * (p1 - p2) + a[C_T] * signed_root(p1 - p2)
        out[2 + 4 * i] = v
        out[3 + 4 * i] = (a[A_1] * p1 - a[A_2] * p2 - a[B_H] * v - rod - d) / a[M_H]
        out[4 + 4 * i] = a[BETA_E] / (a[V_10] + a[A_1] * x) * (-a[A_1] * v - leak + flow1)
        out[5 + 4 * i] = a[BETA_E] / (a[V_20] - a[A_2] * x) * (a[A_2] * v + leak - flow2)
    out[0] = y[1]
    out[1] = (torque - damping * y[1] - load * r * r * y[0]) / inertia


@numba.njit
def law_step(acts, surface, g, y, last, first, k, v3_first, hat, ref, u):
    """One sample of NRSC or FTSC; gives V_3 and V_r, writes u and the next theta_hat."""
    r, inertia, damping, stiff = surface
    load = stiff * r * r
    ka, kb = acts[0, K_H], acts[1, K_H]
    acc = numpy.zeros(2)
    if not first:
        acc[0], acc[1] = (y[3] - last[0]) * RATE_HZ, (y[7] - last[1]) * RATE_HZ
    pistons = ((y[2], y[6]), (y[3], y[7]), (acc[0], acc[1]))
    angle = numpy.empty(5)
    angle[0], angle[1] = y[0], y[1]
    for n in range(3):
        angle[n + 2] = (
            r * (ka * pistons[n][0] + kb * pistons[n][1])
            - (r * r * (ka + kb) + load) * angle[n]
            - damping * angle[n + 1]
        ) / inertia
    xr = numpy.empty((4, 2))
    for n in range(4):
        z1, z1_rate = angle[n] - ref[n], angle[n + 1] - ref[n + 1]
        z2 = angle[n + 1] + g[K1] * z1 - ref[n + 1]
        alpha_rate = -g[K1] * z1_rate + ref[n + 2]
        xr[n, 0] = r * (ka + kb) * angle[n] + (
            damping * angle[n + 1] + load * angle[n] + inertia * (alpha_rate - g[K2] * z2 - z1)
        ) / r
        xr[n, 1] = (ka - kb) * r * ref[n]
    f = numpy.empty((3, 2))
    for n in range(3):
        f[n, 0] = ka * pistons[n][0] + kb * pistons[n][1]
        f[n, 1] = ka * pistons[n][0] - kb * pistons[n][1]
    # T diag(a, b) T^-1 = [[s, d], [d, s]], s = (a + b) / 2, d = (a - b) / 2.
    ha, hb = ka / acts[0, M_H], kb / acts[1, M_H]
    ba, bb = acts[0, B_H] / acts[0, M_H], acts[1, B_H] / acts[1, M_H]
    z = numpy.empty((3, 2))
    wanted = numpy.empty(2)
    x3a = acts[0, A_1] * y[4] - acts[0, A_2] * y[5]
    x3b = acts[1, A_1] * y[8] - acts[1, A_2] * y[9]
    for i in range(2):
        sign = 1.0 if i == 0 else -1.0
        j = 1 - i
        z[0, i] = f[0, i] - xr[0, i]
        rate1, rate2 = f[1, i] - xr[1, i], f[2, i] - xr[2, i]
        alpha1 = -g[K11 + i] * z[0, i] + xr[1, i]
        alpha1_rate = -g[K11 + i] * rate1 + xr[2, i]
        alpha1_rate2 = -g[K11 + i] * rate2 + xr[3, i]
        z[1, i] = f[1, i] - alpha1
        k2 = g[K21 + i] + g[H21 + i] / (4 * g[E1 + i])
        model = numpy.empty(2)
        for n in range(2):
            model[n] = (
                ((ha + hb) * f[n, i] + (ha - hb) * f[n, j]) / 2
                + ((ba + bb) * f[n + 1, i] + (ba - bb) * f[n + 1, j]) / 2
                - (ka * ha + sign * kb * hb) * r * y[n]
            )
        alpha2 = -z[0, i] + model[0] + alpha1_rate - k2 * z[1, i]
        alpha2_rate = -rate1 + model[1] + alpha1_rate2 - k2 * (f[2, i] - alpha1_rate)
        z[2, i] = ha * x3a + sign * hb * x3b - alpha2
        k3 = g[K31 + i] + g[H31 + i] / (4 * g[X1 + i])
        wanted[i] = alpha2_rate - z[1, i] - k3 * z[2, i]
    v3 = 0.5 * numpy.sum(z * z)
    if first:
        v3_first = v3
    slowest = min(min(min(g[K11], g[K12]), min(g[K21], g[K22])), min(g[K31], g[K32]))
    decay = numpy.exp(-2 * slowest * k / RATE_HZ)
    bound = decay * v3_first + (g[E1] + g[E2] + g[X1] + g[X2]) / (2 * slowest) * (1 - decay)
    for i in range(2):
        a = acts[i]
        x, v, p1, p2 = y[2 + 4 * i], y[3 + 4 * i], y[4 + 4 * i], y[5 + 4 * i]
        sign, h = (1.0, ha) if i == 0 else (-1.0, hb)
        w1, w2 = a[A_1] / (a[V_10] + a[A_1] * x), a[A_2] / (a[V_20] - a[A_2] * x)
        f3 = a[BETA_E] * (w1 + w2) * signed_root(p1 - p2)
        leak = a[C_I] * (p1 - p2)
        bracket = a[BETA_E] * (w1 * (a[A_1] * v + leak) + w2 * (a[A_2] * v + leak))
        bracket += f3 * hat[i] + (wanted[0] + sign * wanted[1]) / (2 * h)
        if bracket >= 0:
            roots = w1 * root(a[P_S] - p1) + w2 * root(p2 - a[P_R])
        else:
            roots = w1 * root(p1 - a[P_R]) + w2 * root(a[P_S] - p2)
        f1 = a[BETA_E] * a[K_Q] * a[K_I] * roots
        u[i] = bracket / (f1 if f1 > F1_FLOOR else F1_FLOOR)
        if v3 > bound:
            sigma = -g[GA1 + i] * f3 * h * (z[2, 0] + sign * z[2, 1])
            hat[i] = min(max(hat[i] + sigma / RATE_HZ, g[MIN1 + i]), g[MAX1 + i])
    return v3, bound, v3_first


@numba.njit
def run(acts, surface, law, gains, kp, leak, onset, refs, y, first_tick, ticks, substeps, rows):
    """Fills rows: state, u1, u2, V_3, V_r, theta_hat of every tick; the last row has no command."""
    r = surface[0]
    u, hat, last = numpy.zeros(2), numpy.zeros(2), numpy.zeros(2)
    k1, k2, k3, k4 = numpy.empty(10), numpy.empty(10), numpy.empty(10), numpy.empty(10)
    v3_first = 0.0
    h = 1.0 / RATE_HZ / substeps
    acts = acts.copy()
    for k in range(ticks):
        t = (first_tick + k) / RATE_HZ
        rows[k, 14:16] = hat
        v3 = bound = 0.0
        if law == 0:
            u[0], u[1] = kp * (r * refs[k, 0] - y[2]), kp * (r * refs[k, 0] - y[6])
        else:
            v3, bound, v3_first = law_step(acts, surface, gains, y, last, k == 0, k, v3_first, hat, refs[k], u)
            last[0], last[1] = y[3], y[7]
        rows[k, :10] = y
        rows[k, 10:12] = u
        rows[k, 12], rows[k, 13] = v3, bound
        for i in range(2):
            acts[i, C_T] = leak[2 * i] * (1 - numpy.exp(-leak[2 * i + 1] * (t - onset))) if t >= onset else 0.0
        for n in range(substeps):
            s = t + n * h
            right_hand_side(acts, surface, y, u, s, k1)
            right_hand_side(acts, surface, y + h / 2 * k1, u, s + h / 2, k2)
            right_hand_side(acts, surface, y + h / 2 * k2, u, s + h / 2, k3)
            right_hand_side(acts, surface, y + h * k3, u, s + h, k4)
            y = y + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    rows[ticks, :10] = y
    rows[ticks, 14:16] = hat


@functools.cache
def commands(first_tick, ticks):
    return numpy.array([drhas.command((first_tick + k) / RATE_HZ) for k in range(ticks)])


def closed_loop(law, p, leak, onset, state, first_tick, ticks, substeps, gains=None):
    acts, surface = arrays(p)
    g = {**drhas.GAINS, **(drhas.NRSC if law == "nrsc" else {}), **(gains or {})}
    refs = commands(first_tick, ticks)
    rows = numpy.zeros((ticks + 1, 16))
    run(
        acts,
        surface,
        LAWS.index(law),
        numpy.array([g[k] for k in G]),
        90.0,
        numpy.array(leak, dtype=float),
        float(onset),
        refs,
        numpy.array(state, dtype=float),
        first_tick,
        ticks,
        substeps,
        rows,
    )
    return rows


def check():
    """Both forms of the equations agree on the golden windows' parameters and on unequal ones."""
    import make

    for p in (drhas.parameters(), make.UNEQUAL, make.ASYMMETRIC):
        acts, surface = arrays(p)
        g = numpy.array([drhas.GAINS[k] for k in G])
        law, last, first, hat = drhas.Law(p, drhas.GAINS, RATE_HZ), numpy.zeros(2), 0.0, numpy.zeros(2)
        y = numpy.array(drhas.state_on_reference(p, 3.3))
        for k in range(30):
            ref = numpy.array(drhas.command(3.3 + k / RATE_HZ))
            u, out = numpy.zeros(2), numpy.empty(10)
            v3, bound, first = law_step(acts, surface, g, y, last, k == 0, k, first, hat, ref, u)
            last[:] = y[3], y[7]
            answer = law.step(y.tolist(), ref.tolist())
            assert numpy.allclose(u, answer["u"], rtol=1e-9, atol=1e-11)
            assert numpy.allclose([v3, bound], [answer["v3"], answer["vr"]], rtol=1e-6)
            assert numpy.allclose(hat, law.theta_hat, rtol=1e-9, atol=0)
            right_hand_side(acts, surface, y, u, 3.3, out)
            want = drhas.plant(p, y.tolist(), u.tolist(), 3.3)["derivative"]
            assert numpy.allclose(out, want, rtol=1e-10, atol=1e-9)
            y = y + numpy.array(want) / RATE_HZ
            y[4] -= 1e4 * k  # so that V_3 leaves V_r and the estimate moves
        assert law.theta_hat[0] > 0 or law.theta_hat[1] > 0


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("substeps", type=int, nargs="?", default=10)
    parser.add_argument("--json")
    options = parser.parse_args()
    check()
    p = drhas.parameters()
    k_h, r = p["actuator1"]["connection_stiffness_n_per_m"], p["surface"]["radial_distance_m"]
    angle = numpy.array([drhas.command(k / RATE_HZ)[0] for k in range(TICKS + 1)])
    rest = [0.0, 0.0] + 2 * [0.0, 0.0, 14e6, 14e6]
    results = []
    for scenario, leak in SCENARIOS.items():
        for law in LAWS:
            rows = closed_loop(law, p, leak, 7.0, rest, 0, TICKS, options.substeps)
            error, fight = numpy.abs(rows[:, 0] - angle), numpy.abs(k_h * (rows[:, 2] - rows[:, 6]))
            inside = [slice(a * RATE_HZ, b * RATE_HZ + 1) for a, b in WINDOWS_S]
            result = {
                "law": law,
                "scenario": scenario,
                "windows_s": WINDOWS_S,
                "max_abs_tracking_error_rad": [float(error[s].max()) for s in inside],
                "max_abs_force_fight_n": [float(fight[s].max()) for s in inside],
                "pressure_range_pa": [float(rows[:, [4, 5, 8, 9]].min()), float(rows[:, [4, 5, 8, 9]].max())],
                "max_abs_command_a": float(numpy.abs(rows[:-1, 10:12]).max()),
                "final_leakage_estimate_m3ps_per_sqrt_pa": [float(v) for v in rows[-1, 14:16]],
                "ticks_v3_above_vr": int((rows[:-1, 12] > rows[:-1, 13]).sum()),
            }
            results.append(result)
            numbers = " / ".join(f"{v:.5e}" for v in result["max_abs_tracking_error_rad"])
            fights = " / ".join(f"{v:.2f}" for v in result["max_abs_force_fight_n"])
            print(f"{law:4s} {scenario}  tracking {numbers} rad  fight {fights} N")
            print(f"         {dict(list(result.items())[5:])}")
    if options.json:
        with open(options.json, "w") as file:
            file.write(json.dumps({"substeps": options.substeps, "results": results}, indent=1) + "\n")


if __name__ == "__main__":
    main()
