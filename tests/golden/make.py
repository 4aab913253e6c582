"""Makes the golden files of this folder: `python make.py [NAME...]`, all of them without names.

Numbers that are single evaluations come from mpmath at 50 digits, rounded once to the nearest
double; trajectories come from SciPy's DOP853 at a relative tolerance of 1e-12.
"""

import json
import pathlib
import random
import sys

import numpy
from mpmath import mp, mpf
from scipy.integrate import solve_ivp

import drhas

FOLDER = pathlib.Path(__file__).parent
RATE_HZ = 10000
PID_GAIN_A_PER_M = 90.0

# Two unequal actuators; every parameter differs, so that a mix-up of indices shows.
ASYMMETRIC = drhas.parameters(
    {
        "connection_stiffness_n_per_m": 1.2e8,
        "piston_mass_kg": 60.0,
        "damping_n_s_per_m": 1.1e4,
        "valve_gain_m_per_a": 2.9e-3,
        "flow_gain_m2ps_per_sqrt_pa": 7.2e-5,
        "supply_pressure_pa": 27e6,
        "return_pressure_pa": 2e5,
        "area1_m2": 1.5e-3,
        "area2_m2": 1.35e-3,
        "bulk_modulus_pa": 850e6,
        "volume1_m3": 0.75e-4,
        "volume2_m3": 0.7e-4,
        "internal_leakage_m3ps_per_pa": 2e-12,
        "disturbance_frequency_hz": 1.5,
    },
    {
        "connection_stiffness_n_per_m": 0.8e8,
        "piston_mass_kg": 50.0,
        "damping_n_s_per_m": 0.9e4,
        "valve_gain_m_per_a": 3.2e-3,
        "flow_gain_m2ps_per_sqrt_pa": 7.7e-5,
        "supply_pressure_pa": 29e6,
        "return_pressure_pa": 3e5,
        "area1_m2": 1.4e-3,
        "area2_m2": 1.6e-3,
        "bulk_modulus_pa": 760e6,
        "volume1_m3": 0.72e-4,
        "volume2_m3": 0.8e-4,
        "internal_leakage_m3ps_per_pa": 0.5e-12,
        "disturbance_amplitude_n": 50.0,
        "disturbance_start_s": 1.0,
    },
    {"radial_distance_m": 0.16, "inertia_kg_m2": 14.0, "damping_n_m_s_per_rad": 60.0, "load_stiffness_n_per_m": 8e5},
)
# Unequal stiffness and mass only.
UNEQUAL = drhas.parameters(
    {"connection_stiffness_n_per_m": 1.2e8, "piston_mass_kg": 60.0},
    {"connection_stiffness_n_per_m": 0.8e8, "piston_mass_kg": 50.0},
)
SEVERE = [
    {"coefficient_m3ps_per_sqrt_pa": 5e-7, "speed_per_s": 10.0},
    {"coefficient_m3ps_per_sqrt_pa": 1e-7, "speed_per_s": 0.5},
]


def with_leak(p, coefficients):
    """The same plant with these beta C_t."""
    return {
        **p,
        **{
            f"actuator{i + 1}": {
                **p[f"actuator{i + 1}"],
                "leakage_coefficient_m3ps_per_sqrt_pa": coefficients[i],
            }
            for i in (0, 1)
        },
    }


# --- single evaluations -------------------------------------------------------------------------


def plant_rhs():
    rng = random.Random(20180531)
    cases = []
    for index in range(40):
        p = ASYMMETRIC if index % 2 else drhas.parameters()
        leak = [0.0, 0.0] if index % 4 < 2 else [rng.uniform(1e-9, 6e-7), rng.uniform(1e-9, 6e-7)]
        p = with_leak(p, leak)
        state = [rng.uniform(-0.2, 0.2), rng.uniform(-1.5, 1.5)]
        for name in ("actuator1", "actuator2"):
            supply, back = p[name]["supply_pressure_pa"], p[name]["return_pressure_pa"]
            state += [p["surface"]["radial_distance_m"] * state[0] + rng.uniform(-2e-3, 2e-3), rng.uniform(-0.25, 0.25)]
            state += [rng.uniform(3e6, 25e6), rng.uniform(3e6, 25e6)]
            if index % 5 == 1:  # near supply and return, inside
                state[-2:] = [supply - rng.uniform(0, 2e3), back + rng.uniform(0, 2e3)]
            if index % 5 == 3:  # outside: a root is clamped
                state[-2:] = [supply + rng.uniform(1e3, 2e6), back - rng.uniform(1e3, 9e4)]
            if index % 10 in (6, 8):  # the other way round
                state[-2:] = [state[-1], state[-2]]
        u = [rng.choice((-1, 1)) * rng.uniform(1e-4, 3.0) for _ in (1, 2)]
        if index == 0:
            u = [0.0, 0.0]
        if index == 2:
            state[4] = state[5]  # no pressure difference: no leak
        t = [0.0, 1.25, 2.0][index] if index < 3 else rng.uniform(0, 20)
        value = drhas.plant(drhas.exact(p), drhas.exact(state), drhas.exact(u), mpf(t))
        cases.append({"t_s": t, "parameters": p, "state": state, "command_a": u, **drhas.rounded(value)})
    profiles = []
    for onset, speed in ((7.0, 10.0), (7.0, 0.5), (0.0, 5.0)):
        for t in (onset - 1, onset, onset + 1e-4, onset + 0.1, onset + 13):
            beta = drhas.profile(mpf(t), mpf(onset), mpf(speed))
            profiles.append({"t_s": t, "onset_s": onset, "speed_per_s": speed, "beta": float(beta)})
    return {"state": drhas.STATE, "cases": cases, "fault_profile": profiles}


def stimulus_paper():
    rng = random.Random(74)
    times = [0.0, 1e-4, 1e-3, 0.01, 0.1, 0.25, 0.5, 0.75, 1.0, 2.0, 7.0, 15.0, 20.0]
    times += sorted(round(rng.uniform(0, 20), 4) for _ in range(17))
    return {
        "unit_of_derivative_n": "rad/s^n",
        "points": [{"t_s": t, "derivatives": drhas.rounded(drhas.command(mpf(t)))} for t in times],
    }


# --- trajectories -------------------------------------------------------------------------------

ABSOLUTE = numpy.array([1e-15, 1e-13] + [1e-16, 1e-13, 1e-5, 1e-5] * 2)


def leak_now(leak, t):
    onset = leak["onset_s"]
    return [e["coefficient_m3ps_per_sqrt_pa"] * drhas.profile(t, onset, e["speed_per_s"]) for e in leak["effects"]]


def simulate(p, step_law, first_tick, ticks, state, leak=None, profile="continuous"):
    """The plant under a zero-order hold; gives the state at every tick and the command of each."""
    state, states, commands = list(state), [], []
    for tick in range(first_tick, first_tick + ticks):
        t = tick / RATE_HZ
        states.append(list(state))
        u = step_law(state, drhas.command(t))
        commands.append(u)
        held = with_leak(p, leak_now(leak, t)) if leak else p

        def derivative(time, y):
            now = with_leak(p, leak_now(leak, time)) if leak and profile == "continuous" else held
            return drhas.plant(now, y.tolist(), u, time)["derivative"]

        solution = solve_ivp(
            derivative,
            (t, (tick + 1) / RATE_HZ),
            state,
            method="DOP853",
            rtol=1e-12,
            atol=ABSOLUTE,
            first_step=1 / RATE_HZ * (1 - 1e-9),
        )
        assert solution.success, solution.message
        state = solution.y[:, -1].tolist()
    states.append(list(state))
    return states, commands


def laws(p, gains=None):
    """A fresh law as a function of state and reference."""
    if gains is None:
        return lambda state, reference: drhas.pid(p, PID_GAIN_A_PER_M, state, reference)
    law = drhas.Law(p, gains, RATE_HZ)
    return lambda state, reference: law.step(state, reference)["u"]


def rest(p):
    half = [[0.0, 0.0] + [p[n]["supply_pressure_pa"] / 2] * 2 for n in ("actuator1", "actuator2")]
    return [0.0, 0.0, *half[0], *half[1]]


def window(name, law, p, first_tick, ticks, state, gains=None, leak=None, profile="continuous", every=100):
    states, commands = simulate(p, laws(p, gains), first_tick, ticks, state, leak, profile)
    return {
        "name": name,
        "law": law,
        "parameters": p,
        "gains": {"gain_a_per_m": PID_GAIN_A_PER_M} if gains is None else gains,
        "leak": leak and {**leak, "profile": profile},
        "rate_hz": RATE_HZ,
        "first_step": first_tick,
        "initial_state": list(state),
        "command_a": commands if gains else None,  # the PID's follows from the state
        "samples": [
            {"step": first_tick + k, "t_s": (first_tick + k) / RATE_HZ, "state": states[k]}
            for k in range(0, ticks + 1, every)
        ],
    }


def plant_windows():
    nominal = drhas.parameters()
    moving = drhas.state_on_reference(nominal, 6.8)
    leak = {"onset_s": 7.0, "effects": SEVERE}
    ftsc = drhas.GAINS
    return {
        "state": drhas.STATE,
        "windows": [
            window("pid from rest", "pid", nominal, 0, 5000, rest(nominal)),
            window("pid, leak evaluated continuously", "pid", nominal, 68000, 4000, moving, None, leak),
            window("pid, leak evaluated once per tick", "pid", nominal, 68000, 4000, moving, None, leak, "tick"),
            window(
                "pid, severe leak, pressure differences pass through zero",
                "pid",
                nominal,
                82500,
                3000,
                drhas.state_on_reference(nominal, 8.25),
                None,
                leak,
                "tick",
            ),
            window("ftsc, unequal actuators", "ftsc", UNEQUAL, 0, 5000, rest(UNEQUAL), ftsc),
            window(
                "ftsc, unequal actuators, moving",
                "ftsc",
                UNEQUAL,
                21000,
                2000,
                drhas.state_on_reference(UNEQUAL, 2.1),
                ftsc,
            ),
        ],
    }


# --- laws ---------------------------------------------------------------------------------------


def sequence(name, law, p, first_tick, ticks, state, changes=None, leak=(0.0, 0.0), parameters=None):
    """Measured values of a closed loop in doubles; the law's answers to them at 50 digits."""
    gains = {**drhas.GAINS, **(drhas.NRSC if law == "nrsc" else {}), **(changes or {})}
    states, _ = simulate(with_leak(p, list(leak)), laws(p, gains), first_tick, ticks - 1, state)
    truth = drhas.Law(drhas.exact(p), drhas.exact(gains), RATE_HZ)
    double = drhas.Law(p, gains, RATE_HZ)
    samples, error, size, near = [], {}, {}, mpf("inf")
    for k, measured in enumerate(states):
        reference = drhas.rounded(drhas.command(mpf(first_tick + k) / RATE_HZ))
        answer = truth.step(drhas.exact(measured), drhas.exact(reference))
        if k:
            near = min(near, abs(answer["v3"] / answer["vr"] - 1))
        for key, value in double.step(measured, reference).items():
            values, exact = (value, answer[key]) if isinstance(value, list) else ([value], [answer[key]])
            error.setdefault(key, [])
            error[key] += [abs(a - b) for a, b in zip(values, exact)]
            size.setdefault(key, [])
            size[key] += [abs(b) for b in exact]
        samples.append({"measured": measured, "reference": reference, **drhas.rounded(answer)})
    worst = ", ".join(f"{k} {float(max(error[k])):.1e} of {float(max(size[k])):.1e}" for k in error)
    print(f"  {law}, {name}: plain doubles differ by {worst}; nearest |V_3 / V_r - 1| {float(near):.1e}")
    model = {
        key: {k: v for k, v in group.items() if "disturbance" not in k and k != "leakage_coefficient_m3ps_per_sqrt_pa"}
        for key, group in p.items()
    }
    return {
        "name": name,
        "law": law,
        "model": model,
        "gains": gains,
        "rate_hz": RATE_HZ,
        "first_step": first_tick,
        "samples": samples,
    }


def law_steps():
    nominal = drhas.parameters()
    on = drhas.state_on_reference
    far = on(nominal, 9.1)
    far[2] += 2e-6
    far[6] -= 1e-6
    uneven = dict(
        k_1=310.0, k_2=290.0, k_11=1010.0, k_12=990.0, k_2s11=1020.0, k_2s12=980.0, k_3s11=1030.0, k_3s12=970.0,
        h_21=3.5e18, h_31=2.6e23, epsilon_1=1.1e14, xi_1=1.1e21,
    )  # fmt: skip
    severe = (5e-7, 1e-7)
    beyond = on(nominal, 3.1)
    beyond[4:6] = [28.1e6, -1e5]
    beyond[2] -= 1e-3
    beyond[6] -= 1e-3
    sequences = [
        sequence("from rest", "nrsc", nominal, 0, 50, rest(nominal)),
        sequence("moving", "nrsc", nominal, 31000, 50, on(nominal, 3.1)),
        sequence("moving, asymmetric, every gain different", "nrsc", ASYMMETRIC, 44200, 50, on(ASYMMETRIC, 4.42), uneven),
        sequence("from rest", "ftsc", nominal, 0, 50, rest(nominal)),
        sequence("from rest, unequal stiffness and mass", "ftsc", UNEQUAL, 0, 50, rest(UNEQUAL)),
        sequence("moving, asymmetric", "ftsc", ASYMMETRIC, 58700, 50, on(ASYMMETRIC, 5.87)),
        sequence("severe leak, adaptation runs", "ftsc", nominal, 91000, 60, far, None, severe),
        sequence(
            "severe leak, asymmetric, every gain different",
            "ftsc",
            ASYMMETRIC,
            91000,
            60,
            on(ASYMMETRIC, 9.1),
            {**uneven, "Gamma_1": 1e-37, "Gamma_2": 3e-37},
            severe,
        ),
        sequence(
            "severe leak, estimates reach their bounds",
            "ftsc",
            nominal,
            91000,
            60,
            far,
            {"theta_max_1": 2e-9, "theta_max_2": 1e-9},
            severe,
        ),
        # The pistons must advance while P_1 > P_s and P_2 < P_r: no flow can do it.
        sequence("first actuator beyond its pressures, F_1 at its floor", "ftsc", nominal, 31000, 1, beyond),
        # A leak backwards asks for a negative estimate: the lower bound holds.
        sequence("leak of the wrong sign, the second estimate stays at 0", "ftsc", nominal, 91000, 40, far, None, (5e-7, -1e-7)),
    ]
    return {"measured": drhas.STATE, "sequences": sequences}


MAKERS = {
    "stimulus_paper": stimulus_paper,
    "plant_rhs": plant_rhs,
    "law_steps": law_steps,
    "plant_windows": plant_windows,
}


def compact(value, indent=1, depth=0):
    """JSON with one line per innermost list or object."""
    inner = (dict, list)
    if isinstance(value, inner) and any(isinstance(v, inner) for v in (value.values() if isinstance(value, dict) else value)):
        pad, end = " " * indent * (depth + 1), " " * indent * depth
        if isinstance(value, dict):
            items = [f"{pad}{json.dumps(k)}: {compact(v, indent, depth + 1)}" for k, v in value.items()]
            return "{\n" + ",\n".join(items) + f"\n{end}}}"
        return "[\n" + ",\n".join(pad + compact(v, indent, depth + 1) for v in value) + f"\n{end}]"
    return json.dumps(value, allow_nan=False)


def main():
    mp.dps = 50
    for name in sys.argv[1:] or MAKERS:
        print(name)
        (FOLDER / f"{name}.json").write_text(compact(MAKERS[name]()) + "\n")


if __name__ == "__main__":
    main()
