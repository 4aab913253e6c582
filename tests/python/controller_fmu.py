"""Simulates an FMU with FMPy's `simulate_fmu` on given samples and prints its output as JSON.

    python controller_fmu.py MODEL.fmu PERIOD_S INPUT OUTPUT < ARGUMENTS.json

The arguments are `{"samples": [..], "parameters": {..}}`; sample k counts at k times the period. Printed is the output
at the start and at the end of each step, one number more than samples.
"""

import json
import sys

import fmpy
import numpy as np


def main(path, period_s, input_name, output_name):
    period_s = float(period_s)
    arguments = json.load(sys.stdin)
    samples = arguments["samples"]
    rows = [(step * period_s, sample) for step, sample in enumerate(samples)]
    result = fmpy.simulate_fmu(
        path,
        validate=False,
        start_time=0.0,
        stop_time=len(samples) * period_s,
        output_interval=period_s,
        start_values=arguments["parameters"],
        input=np.array(rows, dtype=[("time", np.float64), (input_name, np.float64)]),
        output=[output_name],
    )
    print(json.dumps([float(value) for value in result[output_name]]))


if __name__ == "__main__":
    main(*sys.argv[1:])
