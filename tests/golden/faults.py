"""Makes `plant_faults.json`: the hydraulic system with what the paper does not have.

`python faults.py`. The paper's equations come from `drhas.py`; what is added here is written from the
model's page on faults (docs/faults-drhas.md) and shares nothing with the Rust code: the droop of the
supply is found with a root finder, not with a closed form, and the spool is a state that is integrated
with the others, not an exact solution. Single evaluations have 50 digits, trajectories are SciPy's
DOP853 at a relative tolerance of 1e-12.
"""

import random

import numpy
from mpmath import mp, mpf
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import drhas
from make import ABSOLUTE, ASYMMETRIC, FOLDER, PID_GAIN_A_PER_M, RATE_HZ, compact

# Neutral values, where the parameter is not given.
NEUTRAL = {
    "valve_null_bias_m": 0.0,
    "valve_lag_s": 0.0,
    "valve_stuck": 0.0,
    "supply_droop_pa_s_per_m3": 0.0,
    "external_leakage1_m3ps_per_sqrt_pa": 0.0,
    "external_leakage2_m3ps_per_sqrt_pa": 0.0,
    "coulomb_friction_n": 0.0,
    "friction_velocity_mps": 1e-2,
    "motion_blocked": 0.0,
}
SEIZURE_TIME_S = mpf("5e-5")
NAMES = ("actuator1", "actuator2")


def with_faults(p, actuator1=None, actuator2=None, surface=None):
    """The plant with every parameter, and what differs from neutral."""
    return {
        "actuator1": {**p["actuator1"], **NEUTRAL, **(actuator1 or {})},
        "actuator2": {**p["actuator2"], **NEUTRAL, **(actuator2 or {})},
        "surface": {**p["surface"], "load_torque_nm": 0.0, **(surface or {})},
    }


def supplied_flow(a, spool, pressure):
    """q >= 0 with q = k sqrt(P_s - R q - P), k = k_q |x_v|."""
    k, r = a["flow_gain_m2ps_per_sqrt_pa"] * abs(spool), a["supply_droop_pa_s_per_m3"]
    drop = a["supply_pressure_pa"] - pressure
    stiff = k * drhas.root(drop)
    if stiff == 0 or r == 0:
        return stiff

    def excess(q):
        return q - k * drhas.root(drop - r * q)

    if isinstance(stiff, mpf):
        return mp.findroot(excess, (0, min(stiff, drop / r)), solver="anderson", tol=1e-60)
    return brentq(excess, 0.0, min(stiff, drop / r), xtol=1e-300, rtol=1e-15)


def external_leak(a, n, pressure):
    return a[f"external_leakage{n}_m3ps_per_sqrt_pa"] * drhas.root(pressure - a["return_pressure_pa"])


def tanh(x):
    return (mp if isinstance(x, mpf) else numpy).tanh(x)


def actuator(a, xd, state, spool, t):
    """Rates of one actuator, the spool being where it is."""
    x, v, p1, p2 = state
    opening = a["flow_gain_m2ps_per_sqrt_pa"] * spool
    back = a["return_pressure_pa"]
    if spool >= 0:
        flow1, flow2 = supplied_flow(a, spool, p1), opening * drhas.root(p2 - back)
    else:
        flow1, flow2 = opening * drhas.root(p1 - back), -supplied_flow(a, spool, p2)
    leak = a["internal_leakage_m3ps_per_pa"] * (p1 - p2)
    leak += a["leakage_coefficient_m3ps_per_sqrt_pa"] * drhas.signed_root(p1 - p2)
    volume1, volume2 = drhas.volumes(a, x)
    rod = a["connection_stiffness_n_per_m"] * (x - xd)
    force = a["area1_m2"] * p1 - a["area2_m2"] * p2 - a["damping_n_s_per_m"] * v
    force -= rod + drhas.disturbance(a, t)
    force -= a["coulomb_friction_n"] * tanh(v / a["friction_velocity_mps"])
    blocked, tau = a["motion_blocked"], SEIZURE_TIME_S if isinstance(v, mpf) else float(SEIZURE_TIME_S)
    acceleration = (1 - blocked) * force / a["piston_mass_kg"] - blocked * v / tau
    into1 = flow1 - a["area1_m2"] * v - leak - external_leak(a, 1, p1)
    into2 = a["area2_m2"] * v + leak - flow2 - external_leak(a, 2, p2)
    beta = a["bulk_modulus_pa"]
    return rod, [v, acceleration, beta * into1 / volume1, beta * into2 / volume2]


def plant(p, state, spools, t):
    s = p["surface"]
    theta, rate = state[:2]
    xd = s["radial_distance_m"] * theta
    rod1, rates1 = actuator(p["actuator1"], xd, state[2:6], spools[0], t)
    rod2, rates2 = actuator(p["actuator2"], xd, state[6:10], spools[1], t)
    torque = s["radial_distance_m"] * (rod1 + rod2 - s["load_stiffness_n_per_m"] * xd) - s["load_torque_nm"]
    angular = (torque - s["damping_n_m_s_per_rad"] * rate) / s["inertia_kg_m2"]
    return [rate, angular, *rates1, *rates2]


# --- single evaluations -------------------------------------------------------------------------


def cases():
    rng = random.Random(1967)
    ranges = {
        "supply_droop_pa_s_per_m3": (1e9, 1e11),
        "external_leakage1_m3ps_per_sqrt_pa": (1e-9, 1e-6),
        "external_leakage2_m3ps_per_sqrt_pa": (1e-9, 1e-6),
        "coulomb_friction_n": (1e2, 4e4),
        "motion_blocked": (0.0, 1.0),
    }
    made = []
    for index in range(24):
        # One at a time, then all together.
        names = [list(ranges)[index % 6]] if index % 6 < 5 else list(ranges)
        change = [{n: rng.uniform(*ranges[n]) for n in names} for _ in NAMES]
        for c in change:
            if "coulomb_friction_n" in c:
                c["friction_velocity_mps"] = rng.uniform(1e-2, 1e-1)
        p = with_faults(ASYMMETRIC, *change, {"load_torque_nm": rng.uniform(-2e3, 2e3)})
        state = [rng.uniform(-0.2, 0.2), rng.uniform(-1.5, 1.5)]
        for _ in NAMES:
            state += [0.16 * state[0] + rng.uniform(-2e-3, 2e-3), rng.uniform(-0.25, 0.25)]
            state += [rng.uniform(3e6, 25e6), rng.uniform(3e6, 25e6)]
        if index == 1:  # nothing leaks in
            state[4] = 1.9e5
        spools = [rng.choice((-1, 1)) * rng.uniform(1e-6, 9e-3) for _ in NAMES]
        t = rng.uniform(0, 20)
        value = plant(drhas.exact(p), drhas.exact(state), drhas.exact(spools), mpf(t))
        made.append({"t_s": t, "parameters": p, "state": state, "spools_m": spools, "derivative": drhas.rounded(value)})
    return made


# --- trajectories -------------------------------------------------------------------------------


def wanted(a, current, stuck_at):
    free = a["valve_gain_m_per_a"] * current + a["valve_null_bias_m"]
    return (1 - a["valve_stuck"]) * free + a["valve_stuck"] * stuck_at


def simulate(p, first_tick, ticks, state, stuck_at):
    """Under the proportional law with a zero-order hold; the states at every tick."""
    full, states = [*state, *stuck_at], []
    tolerance = numpy.array([*ABSOLUTE, 1e-16, 1e-16])
    for tick in range(first_tick, first_tick + ticks):
        t = tick / RATE_HZ
        states.append(full[:10])
        u = drhas.pid(p, PID_GAIN_A_PER_M, full[:10], drhas.command(t))
        aims = [wanted(p[name], u[i], stuck_at[i]) for i, name in enumerate(NAMES)]
        lags = [p[name]["valve_lag_s"] for name in NAMES]

        def derivative(time, y):
            spools = [y[10 + i] if lags[i] else aims[i] for i in (0, 1)]
            moves = [(aims[i] - y[10 + i]) / lags[i] if lags[i] else 0.0 for i in (0, 1)]
            return [*plant(p, y[:10].tolist(), spools, time), *moves]

        solution = solve_ivp(
            derivative,
            (t, (tick + 1) / RATE_HZ),
            full,
            method="DOP853",
            rtol=1e-12,
            atol=tolerance,
            first_step=1 / RATE_HZ * (1 - 1e-9),
        )
        assert solution.success, solution.message
        full = solution.y[:, -1].tolist()
    states.append(full[:10])
    return states


def window(name, p, stuck_at=(0.0, 0.0), first_tick=68000, ticks=1000, every=50):
    state = drhas.state_on_reference(p, first_tick / RATE_HZ)
    states = simulate(p, first_tick, ticks, state, stuck_at)
    pressures = [s[i] for s in states for i in (4, 5, 8, 9)]
    print(f"  {name}: pressures from {min(pressures):.3g} to {max(pressures):.3g} Pa")
    assert 1e6 < min(pressures) and max(pressures) < 27e6, "no boiling, no empty root"
    return {
        "name": name,
        "law": "pid",
        "parameters": p,
        "leak": None,
        "rate_hz": RATE_HZ,
        "first_step": first_tick,
        "initial_state": list(state),
        "initial_spools_m": list(stuck_at),
        "command_a": None,
        "samples": [
            {"step": first_tick + k, "t_s": (first_tick + k) / RATE_HZ, "state": states[k]}
            for k in range(0, ticks + 1, every)
        ],
    }


def windows():
    p = drhas.parameters()
    return [
        window(
            "external leaks and a supply that gives way",
            with_faults(
                p,
                {"external_leakage1_m3ps_per_sqrt_pa": 2e-9, "external_leakage2_m3ps_per_sqrt_pa": 5e-9},
                {"supply_droop_pa_s_per_m3": 5e9},
            ),
        ),
        window(
            "lagging spools, one of them with a null bias",
            with_faults(p, {"valve_lag_s": 1e-3}, {"valve_lag_s": 5e-4, "valve_null_bias_m": 1e-4}),
            (1e-4, 2e-4),
        ),
        window(
            "one spool stuck, the other by half",
            with_faults(p, {"valve_stuck": 1.0}, {"valve_stuck": 0.5}),
            (3e-4, 3e-4),
        ),
        window(
            "dry friction and a load",
            with_faults(
                p,
                {"coulomb_friction_n": 3e3},
                {"coulomb_friction_n": 1e3, "friction_velocity_mps": 0.05},
                {"load_torque_nm": 500.0},
            ),
        ),
        window("one piston seized, the other by a fiftieth", with_faults(p, {"motion_blocked": 1.0}, {"motion_blocked": 0.02}), (0.0, 0.0), 68000, 100, 5),
    ]


def main():
    mp.dps = 50
    file = {"state": drhas.STATE, "cases": cases(), "windows": windows()}
    (FOLDER / "plant_faults.json").write_text(compact(file) + "\n")


if __name__ == "__main__":
    main()
