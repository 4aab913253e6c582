"""Steps an FMU by FMPy's low-level interface and prints the time of a step in ns.

    python loop_fmu.py MODEL.fmu RATE_HZ STEPS

A step is `doStep` and one call that reads all outputs, which are numbers of 64 bits. Called by the bench `fmu`.
"""

import sys
import time

from compare_fmu import TWO, Calls


def main(path, rate_hz, steps):
    rate_hz, steps = float(rate_hz), int(steps)
    calls = Calls(path, {})
    calls.start()
    step_of = calls.fmu.doStep
    read = calls.fmu.getReal if calls.kinds is TWO else calls.fmu.getFloat64
    outputs = [one.valueReference for one in calls.outputs]
    since = time.perf_counter_ns()
    for step in range(steps):
        step_of(step / rate_hz, 1 / rate_hz)
        read(outputs)
    taken = time.perf_counter_ns() - since
    calls.end()
    print(taken / steps)


if __name__ == "__main__":
    main(*sys.argv[1:])
