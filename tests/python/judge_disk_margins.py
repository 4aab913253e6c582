"""Compares margins of two commands that `hil margins` measured with those of python-control and slycot.

    python judge_disk_margins.py MARGINS.json FIRST SECOND COUPLING

The file is the output for `tests/tests/margins/crossed.c` with `--json`: two channels (1 - T s) / (1 + tau s)^2, each fed
by both commands, behind a zero-order hold, and a law of two gains. The margins of one command with the other loop closed
are those of `control.stability_margins`; that of both together is the disk margin of the sensitivity, whose structured
singular value slycot computes. Prints each figure, and ends with 0 when all agree within 0.1 %.
"""

import json
import sys

import control
import numpy as np
import slycot  # noqa: F401 (without it python-control has no margin of several loops)

PERIOD_S = 1e-3
ZERO_S = 0.05
LAG_S = 0.1


def main(path, *numbers):
    first, second, coupling = map(float, numbers)
    with open(path, encoding="utf-8") as file:
        report = json.load(file)
    channel = control.tf([-ZERO_S, 1], [LAG_S**2, 2 * LAG_S, 1])
    channel = control.ss(control.c2d(channel, PERIOD_S, "zoh"))
    mixed = np.array([[1.0, coupling], [coupling, 1.0]])
    gains = np.diag([first, second])
    loop = gains * control.append(channel, channel) * mixed
    is_right = True

    def compare(name, measured, expected):
        nonlocal is_right
        error = abs(measured / expected - 1)
        print(f"{name}: {measured:.8g}, python-control {expected:.8g}, {error:.1e} apart")
        is_right = is_right and error < 1e-3

    # With the other loop closed, by its response: L_11 - L_12 L_21 / (1 + L_22).
    angles = np.geomspace(0.2, 50, 8_000) * 2 * np.pi
    response = loop(np.exp(1j * angles * PERIOD_S))
    for place in range(2):
        own, other = response[place, place], response[1 - place, 1 - place]
        crossed = response[place, 1 - place] * response[1 - place, place]
        alone = control.frd(own - crossed / (1 + other), angles)
        gain_margin, phase_deg, _, _, crossing, _ = control.stability_margins(alone)
        figures = report["inputs"][place]
        compare("gain margin in dB", figures["gain_margin_db"], 20 * np.log10(gain_margin))
        compare("phase margin in degrees", figures["phase_margin_deg"], phase_deg)
        compare("crossover in Hz", figures["crossover_hz"], crossing / (2 * np.pi))
    # Around the measured minimum: each frequency costs a structured singular value.
    (together,) = report["together"]
    hertz = np.geomspace(0.5 * together["frequency_hz"], 2 * together["frequency_hz"], 401)
    margin, _, _ = control.disk_margins(loop, hertz * 2 * np.pi, skew=1.0)
    compare("margin of both together", together["margin"], margin)
    return 0 if is_right else 1


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
