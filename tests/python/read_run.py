"""Reads a recording with the public MCAP and ROS 2 libraries and compares it with its summary.

    pip install mcap mcap-ros2-support
    python read_run.py RUN.mcap SUMMARY.json [--require-metrics]

Proves that a recording is what it says, to a reader that shares nothing with the recorder. Checks:
encodings; steps from 0 to the last without a gap, in file order; log time = simulated time; no NaN but
in the last record, which has no command; the number of records; and, bit by bit, the metrics
`max_abs_tracking_error_rad` and `max_abs_force_fight_n` of the summary. `--require-metrics` fails when the summary
has none of them. Ends with 0 when all holds, else with 1 and the reason.
"""

import argparse
import json
import math
import struct
import sys
from fractions import Fraction
from types import SimpleNamespace

from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

TOPIC = "/record"
GROUPS = ("truth", "measured", "reference", "command", "applied", "internal")
EMPTY_AT_THE_END = ("command", "applied", "internal")
SIMULATED_TIME = ("sim_time_ns", "simulated_time_ns", "time_ns")
METRICS = {
    "max_abs_tracking_error_rad": lambda record: record.truth.surface_angle_rad - record.reference.surface_angle_rad,
    "max_abs_force_fight_n": lambda record: record.truth.force_fight_n,
}


class Wrong(Exception):
    """What does not hold."""


def require(condition, reason):
    if not condition:
        raise Wrong(reason)


def fields(message):
    """Names of a decoded message; the library keeps them as slots, invisible to `vars`."""
    return list(getattr(message, "__slots__", vars(message)))


def numbers(group):
    """Every float of a nested message, with its name."""
    for name in fields(group):
        value = getattr(group, name)
        if isinstance(value, SimpleNamespace):
            yield from ((f"{name}.{inner}", number) for inner, number in numbers(value))
        elif isinstance(value, float):
            yield name, value
        elif hasattr(value, "__iter__") and not isinstance(value, (str, bytes)):
            yield from ((f"{name}[{i}]", number) for i, number in enumerate(value) if isinstance(number, float))


def rate_of(summary):
    """Steps per simulated second, as an exact fraction."""
    hz = summary.get("rate_hz") or summary["steps"] / summary["sim_time_s"]
    return Fraction(round(hz)) if abs(hz - round(hz)) < 1e-6 * hz else Fraction(hz)


def check_time(step, record, log_time_ns, rate):
    exact = Fraction(step) * 10**9 / rate
    slack = Fraction(1, 2) if rate.denominator == 1 else 2  # a rate that is no integer may round twice
    require(abs(log_time_ns - exact) <= slack, f"step {step}: log time {log_time_ns} ns, simulated time {float(exact)} ns")
    for name in SIMULATED_TIME:
        if hasattr(record, name):
            require(getattr(record, name) == log_time_ns, f"step {step}: {name} {getattr(record, name)}, log time {log_time_ns}")


def check_numbers(step, record, is_last):
    for group in GROUPS:
        if is_last and group in EMPTY_AT_THE_END:
            continue
        for name, value in numbers(getattr(record, group, SimpleNamespace())):
            require(not math.isnan(value), f"step {step}: {group}.{name} is NaN")


class Maximum:
    """The largest absolute value of an error over a window with both ends."""

    def __init__(self, metric):
        self.name, self.stated = metric["name"], metric["value"]
        self.window_s = metric.get("window_s")
        self.error = METRICS[self.name]
        self.found = None

    def take(self, step, record, rate):
        time = step / rate
        if self.window_s and not self.window_s[0] <= time <= self.window_s[1]:
            return
        value = abs(self.error(record))
        if self.found is None or value > self.found:
            self.found = value

    def judge(self):
        text = f"{self.name} over {self.window_s or 'the whole run'}: recording {self.found!r}, summary {self.stated!r}"
        if self.found is None:
            require(self.stated is None, text)
        else:
            require(self.stated is not None and bits(self.found) == bits(self.stated), text)
        return text


def bits(value):
    return struct.pack("<d", value)


def read(recording, summary):
    """Goes through the records once; gives the lines to print."""
    rate = rate_of(summary)
    maxima = [Maximum(metric) for metric in summary.get("metrics", []) if metric["name"] in METRICS]
    expected, waiting, signals, schema_name = 0, None, {}, None
    with open(recording, "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for schema, channel, message, record in reader.iter_decoded_messages(topics=[TOPIC], log_time_order=False):
            require(schema.encoding == "ros2msg", f"schema encoding is {schema.encoding!r}, not 'ros2msg'")
            require(channel.message_encoding == "cdr", f"message encoding is {channel.message_encoding!r}, not 'cdr'")
            require(record.step == expected, f"step {record.step} stands where {expected} belongs")
            check_time(record.step, record, message.log_time, rate)
            if waiting is not None:
                check_numbers(waiting.step, waiting, is_last=False)
            for maximum in maxima:
                maximum.take(record.step, record, rate)
            if expected == 0:
                schema_name = schema.name
                missing = [group for group in ("truth", "measured", "command") if not hasattr(record, group)]
                require(not missing, f"the record has no {', '.join(missing)}; it has {', '.join(fields(record))}")
                signals = {group: len(list(numbers(getattr(record, group)))) for group in GROUPS if hasattr(record, group)}
                require(signals["truth"] > 0, "truth holds no numbers")
            waiting, expected = record, expected + 1
    require(waiting is not None, f"no message on {TOPIC}")
    check_numbers(waiting.step, waiting, is_last=True)

    recorded = summary.get("recording") or {}
    require(not recorded.get("lost"), f"the summary says {recorded.get('lost')} records were lost")
    require(
        recorded.get("records", expected) == expected,
        f"{expected} records in the file, {recorded.get('records')} in the summary",
    )
    # The record after the last exchanged step holds the final truth.
    require(summary["steps"] + 1 == expected, f"{expected} records, but the summary says {summary['steps']} steps")
    lines = [f"{expected} records of {schema_name}, steps 0..{expected - 1} at {float(rate)} Hz"]
    lines += [f"signals: {', '.join(f'{group} {count}' for group, count in signals.items())}"]
    lines += [maximum.judge() for maximum in maxima]
    return lines, len(maxima)


def main():
    parser = argparse.ArgumentParser(description="Checks a recording against its summary.")
    parser.add_argument("recording")
    parser.add_argument("summary")
    parser.add_argument("--require-metrics", action="store_true", help="fail when there is no metric to compare")
    options = parser.parse_args()
    try:
        with open(options.summary) as file:
            summary = json.load(file)
        lines, compared = read(options.recording, summary)
        print("\n".join(lines))
        require(compared or not options.require_metrics, f"the summary has none of {', '.join(METRICS)}")
        print(f"{compared} metrics equal, bit by bit" if compared else "no metric to compare")
    except Exception as error:  # whatever is wrong with a file is a failure with a reason
        print(f"{options.recording}: {type(error).__name__}: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
