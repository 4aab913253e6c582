"""Reference implementation of the dual redundant hydraulic actuation system and its laws.

Written straight from the paper (Mathematical Problems in Engineering, 2018, article 6570104;
numbers in brackets are its equations), for the golden files of this folder. It shares nothing with
the Rust code. Every function works on plain floats and on mpmath numbers alike: give it mpmath
numbers (see `exact`) and it answers at the working precision of mpmath.

State, 10 numbers: theta_d, its rate, then per actuator x_h, v_h, P_1, P_2. SI units throughout.
"""

import math

from mpmath import mp, mpf

STATE = [
    "surface_angle_rad",
    "surface_rate_radps",
    *(
        f"actuator{n}_{name}"
        for n in (1, 2)
        for name in ("position_m", "velocity_mps", "pressure1_pa", "pressure2_pa")
    ),
]

# Table 1 and eq. (74).
ACTUATOR = {
    "valve_gain_m_per_a": 3.04e-3,
    "flow_gain_m2ps_per_sqrt_pa": 7.5e-5,
    "supply_pressure_pa": 28e6,
    "return_pressure_pa": 0.0,
    "piston_mass_kg": 55.0,
    "damping_n_s_per_m": 1e4,
    "area1_m2": 1.47e-3,
    "area2_m2": 1.47e-3,
    "bulk_modulus_pa": 800e6,
    "volume1_m3": 0.735e-4,
    "volume2_m3": 0.735e-4,
    "internal_leakage_m3ps_per_pa": 1e-12,
    "leakage_coefficient_m3ps_per_sqrt_pa": 0.0,
    "connection_stiffness_n_per_m": 1e8,
    "disturbance_constant_n": 0.0,
    "disturbance_amplitude_n": 0.0,
    "disturbance_frequency_hz": 1.0,
    "disturbance_start_s": 2.0,
}
SURFACE = {
    "radial_distance_m": 0.15,
    "inertia_kg_m2": 13.5,
    "damping_n_m_s_per_rad": 51.75,
    "load_stiffness_n_per_m": 9.14e5,
}

# Table 2; `Gamma` 0 makes the NRSC of the FTSC.
GAINS = {
    "k_1": 300.0,
    "k_2": 300.0,
    "k_11": 1000.0,
    "k_12": 1000.0,
    "k_2s11": 1000.0,
    "k_2s12": 1000.0,
    "k_3s11": 1000.0,
    "k_3s12": 1000.0,
    "h_21": 3.4e18,
    "h_22": 3.4e18,
    "epsilon_1": 1e14,
    "epsilon_2": 1e14,
    "h_31": 2.5e23,
    "h_32": 2.5e23,
    "xi_1": 1e21,
    "xi_2": 1e21,
    "theta_min_1": 0.0,
    "theta_min_2": 0.0,
    "theta_max_1": 5e-6,
    "theta_max_2": 5e-6,
    "Gamma_1": 1e-37,
    "Gamma_2": 1e-37,
}
NRSC = {"Gamma_1": 0.0, "Gamma_2": 0.0}
F1_FLOOR = 1e-9


def parameters(actuator1=None, actuator2=None, surface=None):
    """Table 1 with eq. (74), and what differs from it."""
    return {
        "actuator1": {
            **ACTUATOR,
            "disturbance_constant_n": 100.0,
            "disturbance_amplitude_n": 400.0,
            **(actuator1 or {}),
        },
        "actuator2": {**ACTUATOR, "disturbance_constant_n": 400.0, **(actuator2 or {})},
        "surface": {**SURFACE, **(surface or {})},
    }


def exact(value):
    """The same numbers as mpmath numbers, without rounding."""
    if isinstance(value, dict):
        return {key: exact(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [exact(item) for item in value]
    return mpf(value)


def rounded(value):
    """The same numbers, each the nearest double."""
    if isinstance(value, dict):
        return {key: rounded(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [rounded(item) for item in value]
    return float(value) if isinstance(value, (int, mpf)) else value


def _library(x):
    return mp if isinstance(x, mpf) else math


def sqrt(x):
    return _library(x).sqrt(x)


def exp(x):
    return _library(x).exp(x)


def root(x):
    """Square root of a pressure difference; of a negative one, 0."""
    return sqrt(x) if x > 0 else 0 * x


def signed_root(x):
    """sqrt(|x|) sgn(x) of eq. (5)."""
    return sqrt(x) if x > 0 else -sqrt(-x)


def step_s(x):
    """s(x) of eq. (9)."""
    return 1 if x >= 0 else 0


# --- plant, eqs. (1)-(24) ---------------------------------------------------------------------


def profile(t, onset_s, speed_per_s):
    """beta(t - t_f), eq. (6)."""
    return 1 - exp(-speed_per_s * (t - onset_s)) if t >= onset_s else 0 * t


def disturbance(a, t):
    """d_i of eq. (74), general form."""
    if t < a["disturbance_start_s"]:
        return a["disturbance_constant_n"]
    m = _library(t)
    phase = 2 * m.pi * a["disturbance_frequency_hz"] * t
    return a["disturbance_constant_n"] + a["disturbance_amplitude_n"] * m.sin(phase)


def valve_roots(a, u, p1, p2):
    """R_1 and R_2, eqs. (10), (11)."""
    supply, back = a["supply_pressure_pa"], a["return_pressure_pa"]
    r1 = step_s(u) * root(supply - p1) + step_s(-u) * root(p1 - back)
    r2 = step_s(u) * root(p2 - back) + step_s(-u) * root(supply - p2)
    return r1, r2


def volumes(a, x):
    """V_1 = V_10 + A_1 x_h and V_2 = V_20 - A_2 x_h."""
    return a["volume1_m3"] + a["area1_m2"] * x, a["volume2_m3"] - a["area2_m2"] * x


def actuator(a, xd, state, u, t):
    """Everything of one actuator at one instant, by equation; `xd` is x_d of eq. (16)."""
    x, v, p1, p2 = state
    spool = a["valve_gain_m_per_a"] * u  # (1)
    r1, r2 = valve_roots(a, u, p1, p2)
    flow1 = a["flow_gain_m2ps_per_sqrt_pa"] * spool * r1  # (7), (12)
    flow2 = a["flow_gain_m2ps_per_sqrt_pa"] * spool * r2  # (8), (13)
    normal = a["internal_leakage_m3ps_per_pa"] * (p1 - p2)  # (5), first term
    fault = a["leakage_coefficient_m3ps_per_sqrt_pa"] * signed_root(p1 - p2)  # (5), second term
    leakage = normal + fault
    volume1, volume2 = volumes(a, x)
    rod = a["connection_stiffness_n_per_m"] * (x - xd)  # (14), (15)
    d = disturbance(a, t)
    pressure_force = a["area1_m2"] * p1 - a["area2_m2"] * p2  # x_i3 of (18)
    acceleration = (pressure_force - a["damping_n_s_per_m"] * v - rod - d) / a["piston_mass_kg"]  # (2)
    p1_rate = a["bulk_modulus_pa"] / volume1 * (-a["area1_m2"] * v - leakage + flow1)  # (3)
    p2_rate = a["bulk_modulus_pa"] / volume2 * (a["area2_m2"] * v + leakage - flow2)  # (4)
    return {
        "valve_root1_sqrt_pa": r1,
        "valve_root2_sqrt_pa": r2,
        "flow1_m3ps": flow1,
        "flow2_m3ps": flow2,
        "normal_leakage_m3ps": normal,
        "fault_leakage_m3ps": fault,
        "leakage_m3ps": leakage,
        "volume1_m3": volume1,
        "volume2_m3": volume2,
        "pressure_force_n": pressure_force,
        "rod_force_n": rod,
        "disturbance_n": d,
        "derivative": [v, acceleration, p1_rate, p2_rate],
    }


def plant(p, state, u, t):
    """Derivative of the state and the value of every equation on the way."""
    theta, rate = state[0], state[1]
    s = p["surface"]
    xd = s["radial_distance_m"] * theta  # (16)
    one = actuator(p["actuator1"], xd, state[2:6], u[0], t)
    two = actuator(p["actuator2"], xd, state[6:10], u[1], t)
    load_torque = s["load_stiffness_n_per_m"] * s["radial_distance_m"] * xd  # T_L = r_d K_d x_d
    drive_torque = s["radial_distance_m"] * (one["rod_force_n"] + two["rod_force_n"])
    angular = (drive_torque - s["damping_n_m_s_per_rad"] * rate - load_torque) / s["inertia_kg_m2"]  # (17)
    return {
        "derivative": [rate, angular, *one.pop("derivative"), *two.pop("derivative")],
        "actuator1": one,
        "actuator2": two,
        "load_torque_n_m": load_torque,
        "force_fight_n": one["rod_force_n"] - two["rod_force_n"],  # (33)
    }


# --- command ------------------------------------------------------------------------------------


def command(t):
    """theta_r(t) = atan(0.2 sin 2 pi t) (1 - exp(-0.1 t^3)) and its derivatives 1 to 5.

    Truncated Taylor series: each list holds the coefficients of h^0..h^5 of the function at t + h.
    """
    m = _library(t)
    number = mpf if m is mp else float
    two, tenth = number("0.2"), number("0.1")
    omega = 2 * m.pi
    n = 6
    sine, cosine = m.sin(omega * t), m.cos(omega * t)
    circle = [sine, cosine, -sine, -cosine]
    s = [two * omega**k * circle[k % 4] / math.factorial(k) for k in range(n)]
    # g = atan s: (1 + s^2) g' = s'.
    w = [(1 if k == 0 else 0) + sum(s[j] * s[k - j] for j in range(k + 1)) for k in range(n)]
    g = [m.atan(s[0])]
    for k in range(1, n):
        g.append((k * s[k] - sum(j * g[j] * w[k - j] for j in range(1, k))) / (k * w[0]))
    # e = exp q, q = -0.1 t^3: e' = q' e.
    q = [-tenth * t**3, -3 * tenth * t**2, -3 * tenth * t, -tenth, 0, 0]
    e = [m.exp(q[0])]
    for k in range(1, n):
        e.append(sum(j * q[j] * e[k - j] for j in range(1, k + 1)) / k)
    fade = [-m.expm1(q[0])] + [-c for c in e[1:]]
    series = [sum(g[j] * fade[k - j] for j in range(k + 1)) for k in range(n)]
    return [series[k] * math.factorial(k) for k in range(n)]


def state_on_reference(p, t):
    """A state that follows the command at time t with equal rod forces and P_1 + P_2 = P_s."""
    theta = command(t)
    s = p["surface"]
    r = s["radial_distance_m"]
    # Rod force of each actuator, half of (17), and its first two derivatives.
    force = [
        (
            s["inertia_kg_m2"] * theta[k + 2]
            + s["damping_n_m_s_per_rad"] * theta[k + 1]
            + s["load_stiffness_n_per_m"] * r * r * theta[k]
        )
        / (2 * r)
        for k in range(3)
    ]
    state = [theta[0], theta[1]]
    for a in (p["actuator1"], p["actuator2"]):
        x, v, acceleration = (r * theta[k] + force[k] / a["connection_stiffness_n_per_m"] for k in range(3))
        pressure_force = (
            a["piston_mass_kg"] * acceleration + a["damping_n_s_per_m"] * v + force[0] + disturbance(a, t)
        )
        area1, area2, supply = a["area1_m2"], a["area2_m2"], a["supply_pressure_pa"]
        p1 = (pressure_force + area2 * supply) / (area1 + area2)
        state += [x, v, p1, supply - p1]
    return state


# --- laws ---------------------------------------------------------------------------------------


def pid(p, gain, state, reference):
    """The paper's PID: u_i = k_p (r_d theta_r - x_hi)."""
    target = p["surface"]["radial_distance_m"] * reference[0]
    return [gain * (target - state[2]), gain * (target - state[6])]


def mat(m, v):
    """2 x 2 matrix times vector."""
    return [m[0][0] * v[0] + m[0][1] * v[1], m[1][0] * v[0] + m[1][1] * v[1]]


def matmat(a, b):
    return [[sum(a[i][k] * b[k][j] for k in (0, 1)) for j in (0, 1)] for i in (0, 1)]


def inverse(m):
    det = m[0][0] * m[1][1] - m[0][1] * m[1][0]
    return [[m[1][1] / det, -m[0][1] / det], [-m[1][0] / det, m[0][0] / det]]


def transposed(m):
    return [[m[0][0], m[1][0]], [m[0][1], m[1][1]]]


def diagonal(a, b):
    return [[a, 0], [0, b]]


def pair(f):
    """A vector of two, component by component."""
    return [f(0), f(1)]


class Matrices:
    """H_1..H_4 of (23), T and M_1..M_4 of (34)."""

    def __init__(self, p):
        a, b, r = p["actuator1"], p["actuator2"], p["surface"]["radial_distance_m"]
        k1, k2 = a["connection_stiffness_n_per_m"], b["connection_stiffness_n_per_m"]
        m1, m2 = a["piston_mass_kg"], b["piston_mass_kg"]
        self.T = [[k1, k2], [k1, -k2]]
        h1 = diagonal(k1 / m1, k2 / m2)
        h2 = diagonal(a["damping_n_s_per_m"] / m1, b["damping_n_s_per_m"] / m2)
        h3 = diagonal(1 / m1, 1 / m2)
        h4 = diagonal(k1 * r / m1, k2 * r / m2)
        inv = inverse(self.T)
        self.M1 = matmat(matmat(self.T, h1), inv)
        self.M2 = matmat(matmat(self.T, h2), inv)
        self.M3 = matmat(self.T, h3)
        self.M4 = matmat(self.T, h4)


def trajectories(p, gains, state, acceleration, reference):
    """x_r of (25) and after (33), and its first three derivatives, each [x_r1, x_r2].

    The derivatives of y_1 = theta_d beyond the rate come from (24) and its time derivatives.
    """
    s = p["surface"]
    r, inertia = s["radial_distance_m"], s["inertia_kg_m2"]
    k1 = p["actuator1"]["connection_stiffness_n_per_m"]
    k2 = p["actuator2"]["connection_stiffness_n_per_m"]
    load = s["load_stiffness_n_per_m"] * r * r  # T_L = load * y_1
    pistons = [(state[2], state[6]), (state[3], state[7]), acceleration]
    y = [state[0], state[1]]
    for x1, x2 in pistons:
        y.append(
            (
                r * (k1 * x1 + k2 * x2)
                - (r * r * (k1 + k2) + load) * y[-2]
                - s["damping_n_m_s_per_rad"] * y[-1]
            )
            / inertia
        )
    c1, c2 = gains["k_1"], gains["k_2"]
    result = []
    for n in range(4):  # the n-th derivative of (25)
        z1 = y[n] - reference[n]  # (26)
        z1_rate = y[n + 1] - reference[n + 1]
        alpha = -c1 * z1 + reference[n + 1]  # (28)
        alpha_rate = -c1 * z1_rate + reference[n + 2]
        z2 = y[n + 1] - alpha  # (26)
        xr1 = (
            inertia
            / r
            * (
                r * r / inertia * (k1 + k2) * y[n]
                + s["damping_n_m_s_per_rad"] / inertia * y[n + 1]
                + load * y[n] / inertia
                + alpha_rate
                - c2 * z2
                - z1
            )
        )
        result.append([xr1, (k1 - k2) * r * reference[n]])
    return result


def backstepping(p, gains, state, acceleration, reference):
    """(39)-(47): z_1, z_2, z_3, alpha_1, alpha_2 and their derivatives."""
    m = Matrices(p)
    xr = trajectories(p, gains, state, acceleration, reference)
    f_x = mat(m.T, (state[2], state[6]))
    f_v = mat(m.T, (state[3], state[7]))
    f_a = mat(m.T, acceleration)
    k1 = (gains["k_11"], gains["k_12"])
    # Both feedbacks on z_2: k_2s1 of (45) and h_2 / (4 epsilon) of (47).
    k2 = (
        gains["k_2s11"] + gains["h_21"] / (4 * gains["epsilon_1"]),
        gains["k_2s12"] + gains["h_22"] / (4 * gains["epsilon_2"]),
    )
    z1 = pair(lambda i: f_x[i] - xr[0][i])  # (39)
    z1_rate = pair(lambda i: f_v[i] - xr[1][i])
    z1_rate2 = pair(lambda i: f_a[i] - xr[2][i])
    alpha1 = pair(lambda i: -k1[i] * z1[i] + xr[1][i])  # before (42)
    alpha1_rate = pair(lambda i: -k1[i] * z1_rate[i] + xr[2][i])
    alpha1_rate2 = pair(lambda i: -k1[i] * z1_rate2[i] + xr[3][i])
    z2 = pair(lambda i: f_v[i] - alpha1[i])  # (40)
    z2_rate = pair(lambda i: f_a[i] - alpha1_rate[i])
    stiffness, stiffness_rate = mat(m.M1, f_x), mat(m.M1, f_v)
    damping, damping_rate = mat(m.M2, f_v), mat(m.M2, f_a)
    coupling = mat(m.M4, (state[0], state[0]))
    coupling_rate = mat(m.M4, (state[1], state[1]))
    alpha2 = pair(  # (45), (47)
        lambda i: -z1[i] + stiffness[i] + damping[i] - coupling[i] + alpha1_rate[i] - k2[i] * z2[i]
    )
    alpha2_rate = pair(
        lambda i: -z1_rate[i]
        + stiffness_rate[i]
        + damping_rate[i]
        - coupling_rate[i]
        + alpha1_rate2[i]
        - k2[i] * z2_rate[i]
    )
    x3 = pair(lambda i: pressure_force(p[f"actuator{i + 1}"], state[4 + 4 * i], state[5 + 4 * i]))
    x3_bar = mat(m.M3, x3)
    z3 = pair(lambda i: x3_bar[i] - alpha2[i])  # (43)
    return {
        "xr": xr,
        "z1": z1,
        "z2": z2,
        "z3": z3,
        "alpha1": alpha1,
        "alpha1_rate": alpha1_rate,
        "alpha1_rate2": alpha1_rate2,
        "alpha2": alpha2,
        "alpha2_rate": alpha2_rate,
        "M3": m.M3,
    }


def pressure_force(a, p1, p2):
    """x_i3 of (18)."""
    return a["area1_m2"] * p1 - a["area2_m2"] * p2


def f1(a, x, p1, p2, sign):
    """f_h11 of (20); `sign` selects the roots of (10), (11)."""
    volume1, volume2 = volumes(a, x)
    r1, r2 = valve_roots(a, sign, p1, p2)
    gain = a["bulk_modulus_pa"] * a["flow_gain_m2ps_per_sqrt_pa"] * a["valve_gain_m_per_a"]
    return gain * (a["area1_m2"] / volume1 * r1 + a["area2_m2"] / volume2 * r2)


def f2(a, x, v, p1, p2):
    """f_h12 of (21)."""
    volume1, volume2 = volumes(a, x)
    leak = a["internal_leakage_m3ps_per_pa"] * (p1 - p2)
    area1, area2 = a["area1_m2"], a["area2_m2"]
    return a["bulk_modulus_pa"] * (area1 / volume1 * (area1 * v + leak) + area2 / volume2 * (area2 * v + leak))


def f3(a, x, p1, p2):
    """f_h13 of (22) without beta and C_t, which (23) multiplies."""
    volume1, volume2 = volumes(a, x)
    return a["bulk_modulus_pa"] * (a["area1_m2"] / volume1 + a["area2_m2"] / volume2) * signed_root(p1 - p2)


class Law:
    """NRSC (Gamma = 0) and FTSC, sampled: (52)-(68). Call `step` once per control tick."""

    def __init__(self, p, gains, rate_hz=10000):
        self.p, self.gains, self.rate_hz = p, gains, rate_hz
        self.theta_hat = [gains["theta_min_1"] * 0, gains["theta_min_2"] * 0]
        self.samples = 0
        self.last_velocity = None
        self.v3_first = None

    def step(self, state, reference):
        p, gains = self.p, self.gains
        velocity = (state[3], state[7])
        if self.last_velocity is None:
            acceleration = pair(lambda i: 0 * velocity[i])
        else:
            acceleration = pair(lambda i: (velocity[i] - self.last_velocity[i]) * self.rate_hz)
        self.last_velocity = velocity

        b = backstepping(p, gains, state, acceleration, reference)
        z1, z2, z3, m3 = b["z1"], b["z2"], b["z3"], b["M3"]
        k3 = (
            gains["k_3s11"] + gains["h_31"] / (4 * gains["xi_1"]),
            gains["k_3s12"] + gains["h_32"] / (4 * gains["xi_2"]),
        )
        # M_3^-1 (alpha_2' - z_2 + u_s1 + u_s2) of (52), (55).
        wanted = mat(inverse(m3), pair(lambda i: b["alpha2_rate"][i] - z2[i] - k3[i] * z3[i]))
        u, f3_now = [], []
        for i in (0, 1):
            a = p[f"actuator{i + 1}"]
            x, v, p1, p2 = state[2 + 4 * i : 6 + 4 * i]
            f3_now.append(f3(a, x, p1, p2))
            bracket = f2(a, x, v, p1, p2) + f3_now[i] * self.theta_hat[i] + wanted[i]
            effect = f1(a, x, p1, p2, bracket)
            u.append(bracket / (effect if effect > F1_FLOOR else F1_FLOOR))

        v3 = sum(c * c for c in z1 + z2 + z3) / 2
        if self.v3_first is None:
            self.v3_first = v3
        slowest = min(gains[k] for k in ("k_11", "k_12", "k_2s11", "k_2s12", "k_3s11", "k_3s12"))
        rate = 2 * slowest  # lambda of (60), sign of (61)
        mu = gains["epsilon_1"] + gains["epsilon_2"] + gains["xi_1"] + gains["xi_2"]
        decay = exp(-rate * (self.samples + 0 * v3) / self.rate_hz)
        bound = decay * self.v3_first + mu / rate * (1 - decay)

        answer = {
            "u": u,
            "v3": v3,
            "vr": bound,
            "z1": z1,
            "z2": z2,
            "z3": z3,
            "theta_hat": list(self.theta_hat),
            "acceleration": acceleration,
        }
        if v3 > bound:  # (67), (68), one explicit Euler step
            regressor = mat(matmat(diagonal(*f3_now), transposed(m3)), z3)
            for i in (0, 1):
                sigma = -gains[f"Gamma_{i + 1}"] * regressor[i]
                low, high = gains[f"theta_min_{i + 1}"], gains[f"theta_max_{i + 1}"]
                self.theta_hat[i] = min(max(self.theta_hat[i] + sigma / self.rate_hz, low), high)
        self.samples += 1
        return answer
