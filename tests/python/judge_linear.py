"""Judges the linear model of spring-mass by python-control.

    python judge_linear.py MODEL.json

The file is opened as docs/operating-points.md says. SciPy's hold of the continuous model has to give the discrete one,
and the poles and the gain at rest have to be those of the mass on its spring.
"""

import json
import sys

import control
import numpy


def main() -> None:
    model = json.load(open(sys.argv[1]))
    plant = control.ss(*(model["discrete"][name] for name in "ABCD"), model["period_s"])

    continuous = control.ss(*(model["continuous"][name] for name in "ABCD"))
    held = control.sample_system(continuous, model["period_s"], method="zoh")
    for one, other in zip((plant.A, plant.B), (held.A, held.B)):
        assert numpy.allclose(one, other, rtol=0, atol=1e-10), (one, other)
    # m = 1 kg, c = 2 N s/m, k = 100 N/m.
    poles = numpy.sort_complex(continuous.poles())
    assert numpy.allclose(poles, [-1 - 99**0.5 * 1j, -1 + 99**0.5 * 1j], atol=1e-6), poles
    assert numpy.allclose(plant.dcgain().flatten(), [0.01, 0], atol=1e-9), plant.dcgain()


main()
