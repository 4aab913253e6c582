"""Compares margins that `hil margins` measured with those that python-control computes from the difference equations.

    python judge_margins.py MARGINS.json

The file is the output for `scenarios/spring-mass.toml` with `--json`. The plant is sampled behind a zero-order hold, the
law is a PID with an integral by trapezoids and a backward difference. Prints each figure, and ends with 0 when all agree
within 0.01 %.
"""

import json
import sys

import control
import numpy as np

PERIOD_S = 1e-3


def loop():
    """Open loop in z."""
    plant = control.c2d(control.tf([1], [1, 2, 100]), PERIOD_S, "zoh")
    integral = control.tf([PERIOD_S / 2, PERIOD_S / 2], [1, -1], PERIOD_S)
    derivative = control.tf([1, -1], [PERIOD_S, 0], PERIOD_S)
    return plant * (300 + 2000 * integral + 30 * derivative)


def main(path):
    with open(path, encoding="utf-8") as file:
        (measured,) = json.load(file)["inputs"]
    open_loop = loop()
    gain, phase, _, _, crossover, _ = control.stability_margins(open_loop)
    angles = np.geomspace(0.5, 450, 400_000) * 2 * np.pi
    distances = abs(1 + open_loop(np.exp(1j * angles * PERIOD_S)))
    expected = {
        "gain_margin_db": 20 * np.log10(gain),
        "phase_margin_deg": phase,
        "crossover_hz": crossover / (2 * np.pi),
        "delay_margin_s": np.radians(phase) / crossover,
        "disc_margin": distances.min(),
    }
    is_right = True
    for name, value in expected.items():
        error = abs(measured[name] / value - 1)
        print(f"{name}: {measured[name]:.8g}, python-control {value:.8g}, {error:.1e} apart")
        is_right = is_right and error < 1e-4
    return 0 if is_right else 1


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
