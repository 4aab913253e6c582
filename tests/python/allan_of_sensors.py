"""Checks the errors of a sensor's stages against the closed forms of their Allan deviations, with allantools.

    python allan_of_sensors.py TABLE.csv

The table is that of a run of the scenario in `tests/tests/instruments/judges.rs`. Up to N / 5000 samples a deviation
must be that of its closed form (IEEE 952, annex C) within 3 %, beyond that within allantools' 99 % interval. Prints the
number of deviations, and ends with 0 when all hold.
"""

import sys

import allantools
import numpy as np
from allantools.ci import confidence_interval, edf_greenhall

RATE_HZ = 1000.0
DENSITY = 2e-4  # m/sqrt(Hz), one-sided
WALK = 3e-3  # m/sqrt(s)
SIGMA = 5e-3  # m
TAU_S = 0.5


def white(m):
    """White noise of the coefficient N = d / sqrt(2): N / sqrt(t)."""
    return DENSITY / np.sqrt(2) / np.sqrt(m / RATE_HZ)


def walk(m):
    """Random walk K, exact for m steps: K^2 dt (2 m^2 + 1) / (6 m), which becomes K^2 t / 3."""
    return WALK * np.sqrt((2 * m * m + 1) / (6 * m * RATE_HZ))


def markov(m):
    """Gauss-Markov process of standard deviation s and time T, over x = t / T."""
    x = m / RATE_HZ / TAU_S
    return SIGMA * np.sqrt(2 / x * (1 - (3 - 4 * np.exp(-x) + np.exp(-2 * x)) / (2 * x)))


def main(path):
    with open(path, encoding="utf-8") as file:
        names = file.readline().strip().split(",")
    columns = dict(zip(names, np.loadtxt(path, delimiter=",", skiprows=1).T))
    begin, middle, late, end = (
        columns[name]
        for name in ["sensor.position_m", "sensor.bias_walk_position_m", "sensor.noise_density_position_m", "sensed.position_m"]
    )
    count = len(begin)
    checked = 0
    # The exponent of the power law, which the number of degrees of freedom depends on.
    for what, errors, form, alpha in [
        ("white noise", end - late, white, lambda m: 0),
        ("random walk", late - middle, walk, lambda m: -2),
        ("Gauss-Markov", middle - begin, markov, lambda m: -2 if m < TAU_S * RATE_HZ else 0),
    ]:
        steps = np.array([10, 20, 40, 100, 300, 1000, 3000, 10000, 30000])
        taus, deviations, _, _ = allantools.oadev(errors, rate=RATE_HZ, data_type="freq", taus=steps / RATE_HZ)
        assert len(taus) == len(steps), f"{what}: {taus}"
        for m, deviation in zip(steps.tolist(), deviations):
            expected = form(m)
            if m <= count / 5000:
                low, high = 0.97 * deviation, 1.03 * deviation
            else:
                freedom = edf_greenhall(alpha(m), 2, m, count + 1, overlapping=True)
                low, high = confidence_interval(deviation, freedom, ci=0.99)
            assert low <= expected <= high, f"{what} over {m} steps: {expected} and not {low} to {high}"
            checked += 1
    print(f"{checked} deviations of {count} samples")


if __name__ == "__main__":
    main(*sys.argv[1:])
