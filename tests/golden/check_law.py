"""Checks the reference implementation by routes that do not use its own derivatives.

1. `command` against mpmath's numerical differentiation of theta_r.
2. The chain rule of the law along a made-up smooth motion theta_d(t), x_h1(t), x_h2(t) that
   satisfies the surface's equation (24): x_r, alpha_1 and alpha_2 are written as functions of time
   alone and differentiated numerically.
3. The same derivatives as directional derivatives along the flow of the whole plant, and the error
   equations that the design promises without disturbance and with the leak known:
   z_1' = z_2 - k_1 z_1, z_2' = -z_1 - K_2 z_2 + z_3, z_3' = -z_2 - K_3 z_3.

Prints the largest relative difference of each and fails when one is not tiny.
"""

import random

from mpmath import mp, mpf

import drhas

TINY = mpf("1e-25")


def worst(pairs):
    """Largest |a - b| relative to the largest |b| of the group."""
    pairs = list(pairs)
    scale = max(abs(b) for _, b in pairs)
    return max(abs(a - b) for a, b in pairs) / scale


def report(name, value):
    print(f"{name:64s} {mp.nstr(value, 3)}")
    assert value < TINY, name


def check_command():
    def theta_r(t):
        return mp.atan(mpf("0.2") * mp.sin(2 * mp.pi * t)) * (1 - mp.exp(-mpf("0.1") * t**3))

    for text in ("0.3", "1.7", "6.2", "19.9"):
        t = mpf(text)
        numeric = [mp.diff(theta_r, t, n) for n in range(6)]
        exact = drhas.command(t)
        report(f"theta_r and derivatives at {text} s", max(worst([p]) for p in zip(exact, numeric)))


def asymmetric():
    return drhas.exact(
        drhas.parameters(
            {"connection_stiffness_n_per_m": 1.2e8, "piston_mass_kg": 60.0, "damping_n_s_per_m": 1.1e4},
            {
                "connection_stiffness_n_per_m": 0.8e8,
                "piston_mass_kg": 50.0,
                "damping_n_s_per_m": 0.9e4,
                "area1_m2": 1.6e-3,
                "area2_m2": 1.3e-3,
                "volume1_m3": 0.8e-4,
                "volume2_m3": 0.7e-4,
                "bulk_modulus_pa": 7e8,
                "supply_pressure_pa": 26e6,
                "return_pressure_pa": 1e5,
                "internal_leakage_m3ps_per_pa": 2e-12,
                "leakage_coefficient_m3ps_per_sqrt_pa": 3e-8,
            },
        )
    )


def gains():
    """Different gains per component, so that a mix-up shows."""
    g = dict(drhas.GAINS, k_1=310.0, k_2=290.0, k_11=1010.0, k_12=990.0, k_2s11=1020.0, k_2s12=980.0)
    g.update(k_3s11=1030.0, k_3s12=970.0, h_21=3.5e18, h_31=2.6e23, epsilon_1=1.1e14, xi_1=1.1e21)
    return drhas.exact(g)


def check_along_a_motion():
    p, g = asymmetric(), gains()
    s = p["surface"]
    r, inertia, damping = s["radial_distance_m"], s["inertia_kg_m2"], s["damping_n_m_s_per_rad"]
    load = s["load_stiffness_n_per_m"] * r * r
    ks = [p[f"actuator{i}"]["connection_stiffness_n_per_m"] for i in (1, 2)]
    d = mp.diff

    def theta(t):
        return mpf("0.1") * mp.sin(3 * t) + mpf("0.02") * mp.cos(7 * t + 1)

    def x2(t):
        return mpf("0.015") * mp.sin(3 * t + mpf("0.1")) + mpf("0.001") * mp.cos(11 * t)

    def x1(t):  # what (24) asks for
        torque = inertia * d(theta, t, 2) + damping * d(theta, t) + (r * r * sum(ks) + load) * theta(t)
        return (torque / r - ks[1] * x2(t)) / ks[0]

    def reference(t):
        return drhas.command(t)[0]

    def xr1(t):  # (25), (26), (28) with numerical derivatives
        def alpha(s):
            return -g["k_1"] * (theta(s) - reference(s)) + d(reference, s)

        z1, z2 = theta(t) - reference(t), d(theta, t) - alpha(t)
        bracket = d(alpha, t) - g["k_2"] * z2 - z1 + damping / inertia * d(theta, t)
        bracket += (r * r * sum(ks) + load) / inertia * theta(t)
        return inertia / r * bracket

    def xr2(t):
        return (ks[0] - ks[1]) * r * reference(t)

    m = drhas.Matrices(p)
    f = [lambda t: ks[0] * x1(t) + ks[1] * x2(t), lambda t: ks[0] * x1(t) - ks[1] * x2(t)]
    xr = [xr1, xr2]
    k1 = [g["k_11"], g["k_12"]]
    k2 = [g[f"k_2s1{i}"] + g[f"h_2{i}"] / (4 * g[f"epsilon_{i}"]) for i in (1, 2)]

    # Each function is replaced by its Taylor polynomial at t0; derivatives of polynomials are exact.
    t0, order = mpf("1.3"), 8
    mp.dps = 120
    series = lambda fn: mp.taylor(fn, t0, order)
    derive = lambda c: [k * c[k] for k in range(1, len(c))]
    fs, xs, th = [series(fn) for fn in f], [series(fn) for fn in xr], series(theta)
    mp.dps = 50

    def combine(*terms):
        n = min(len(c) for _, c in terms)
        return [sum(w * c[k] for w, c in terms) for k in range(n)]

    z1 = [combine((1, fs[i]), (-1, xs[i])) for i in (0, 1)]
    alpha1 = [combine((-k1[i], z1[i]), (1, derive(xs[i]))) for i in (0, 1)]
    fv = [derive(fs[i]) for i in (0, 1)]
    z2 = [combine((1, fv[i]), (-1, alpha1[i])) for i in (0, 1)]
    alpha2 = [
        combine(
            (-1, z1[i]),
            (m.M1[i][0], fs[0]),
            (m.M1[i][1], fs[1]),
            (m.M2[i][0], fv[0]),
            (m.M2[i][1], fv[1]),
            (-(m.M4[i][0] + m.M4[i][1]), th),
            (1, derive(alpha1[i])),
            (-k2[i], z2[i]),
        )
        for i in (0, 1)
    ]
    state = [theta(t0), d(theta, t0), x1(t0), d(x1, t0), mpf(14e6), mpf(13e6), x2(t0), d(x2, t0), mpf(12e6), mpf(13e6)]
    b = drhas.backstepping(p, g, state, [d(x1, t0, 2), d(x2, t0, 2)], drhas.command(t0))
    for i in (0, 1):
        at = f"component {i + 1} along a motion"
        for n in range(4):
            numeric = xs[i][n] * mp.factorial(n)
            report(f"x_r derivative {n}, {at}", worst([(b["xr"][n][i], numeric)]))
        report(f"alpha_1, {at}", worst([(b["alpha1"][i], alpha1[i][0])]))
        report(f"alpha_1', {at}", worst([(b["alpha1_rate"][i], alpha1[i][1])]))
        report(f"alpha_1'', {at}", worst([(b["alpha1_rate2"][i], 2 * alpha1[i][2])]))
        report(f"alpha_2, {at}", worst([(b["alpha2"][i], alpha2[i][0])]))
        report(f"alpha_2', {at}", worst([(b["alpha2_rate"][i], alpha2[i][1])]))


def check_along_the_plant():
    p, g = asymmetric(), gains()
    for i in (1, 2):
        p[f"actuator{i}"].update(disturbance_constant_n=mpf(0), disturbance_amplitude_n=mpf(0))
    rng = random.Random(7)
    h = mpf("1e-20")
    for trial in range(4):
        t = mpf(rng.uniform(0.5, 10))
        state = drhas.state_on_reference(p, t)
        state = [c * (1 + mpf(rng.uniform(-0.05, 0.05))) for c in state]

        def law(at, when):
            a = drhas.plant(p, at, [mpf(0), mpf(0)], when)["derivative"]
            return drhas.backstepping(p, g, at, [a[3], a[7]], drhas.command(when))

        b = law(state, t)
        k3 = [g[f"k_3s1{i}"] + g[f"h_3{i}"] / (4 * g[f"xi_{i}"]) for i in (1, 2)]
        k2 = [g[f"k_2s1{i}"] + g[f"h_2{i}"] / (4 * g[f"epsilon_{i}"]) for i in (1, 2)]
        k1 = [g["k_11"], g["k_12"]]
        # The law itself with the true acceleration and the true fault as its estimate.
        sampled = drhas.Law(p, g)
        a = drhas.plant(p, state, [mpf(0), mpf(0)], t)["derivative"]
        sampled.rate_hz = 1
        sampled.last_velocity = (state[3] - a[3], state[7] - a[7])
        sampled.theta_hat = [p[f"actuator{i}"]["leakage_coefficient_m3ps_per_sqrt_pa"] for i in (1, 2)]
        u = sampled.step(state, drhas.command(t))["u"]
        flow = drhas.plant(p, state, u, t)["derivative"]
        ahead = law([c + h * v for c, v in zip(state, flow)], t + h)
        behind = law([c - h * v for c, v in zip(state, flow)], t - h)
        rate = lambda key, i: (ahead[key][i] - behind[key][i]) / (2 * h)
        for i in (0, 1):
            at = f"component {i + 1} along the plant, {trial}"
            report(f"alpha_1', {at}", worst([(b["alpha1_rate"][i], rate("alpha1", i))]))
            report(f"alpha_2', {at}", worst([(b["alpha2_rate"][i], rate("alpha2", i))]))
            expected = b["z2"][i] - k1[i] * b["z1"][i]
            report(f"z_1' = z_2 - k_1 z_1, {at}", worst([(rate("z1", i), expected)]))
            expected = -b["z1"][i] - k2[i] * b["z2"][i] + b["z3"][i]
            report(f"z_2' = -z_1 - K_2 z_2 + z_3, {at}", worst([(rate("z2", i), expected)]))
            expected = -b["z2"][i] - k3[i] * b["z3"][i]
            report(f"z_3' = -z_2 - K_3 z_3, {at}", worst([(rate("z3", i), expected)]))


if __name__ == "__main__":
    mp.dps = 70
    check_command()
    mp.dps = 50
    check_along_a_motion()
    mp.dps = 70
    check_along_the_plant()
    print("all agree")
