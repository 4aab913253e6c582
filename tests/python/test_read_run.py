"""The reader accepts a good recording and names what is wrong with each bad one.

    python -m unittest test_read_run
"""

import contextlib
import io
import json
import math
import pathlib
import tempfile
import unittest
from unittest import mock

from mcap_ros2.writer import Writer

import read_run

DEFINITION = """uint64 step
uint64 sim_time_ns
hil_msgs/Truth truth
hil_msgs/Measured measured
hil_msgs/Reference reference
hil_msgs/Command command
hil_msgs/Command applied
hil_msgs/Internal internal
================================================================================
MSG: hil_msgs/Truth
float64 surface_angle_rad
float64 force_fight_n
================================================================================
MSG: hil_msgs/Measured
float64 surface_angle_rad
================================================================================
MSG: hil_msgs/Reference
float64 surface_angle_rad
================================================================================
MSG: hil_msgs/Command
float64 actuator1_valve_current_a
================================================================================
MSG: hil_msgs/Internal
float64 lyapunov_v3
"""
STEPS = 30


def record(step):
    nan_at_the_end = math.nan if step == STEPS else 0.25
    angle = math.sin(0.3 * step)
    return {
        "step": step,
        "sim_time_ns": step * 10**8,
        "truth": {"surface_angle_rad": angle, "force_fight_n": -100.0 * step},
        "measured": {"surface_angle_rad": angle},
        "reference": {"surface_angle_rad": 0.1},
        "command": {"actuator1_valve_current_a": nan_at_the_end},
        "applied": {"actuator1_valve_current_a": nan_at_the_end},
        "internal": {"lyapunov_v3": nan_at_the_end},
    }


def summary():
    def error(first, last):
        return max(abs(math.sin(0.3 * k) - 0.1) for k in range(first, last + 1))

    return {
        "steps": STEPS,
        "sim_time_s": 3.0,
        "metrics": [
            {"name": "max_abs_tracking_error_rad", "window_s": [0.0, 1.0], "value": error(0, 10), "unit": "rad"},
            {"name": "max_abs_tracking_error_rad", "window_s": [1.0, 2.0], "value": error(10, 20), "unit": "rad"},
            {"name": "max_abs_force_fight_n", "window_s": [0.0, 1.0], "value": 1000.0, "unit": "N"},
            {"name": "max_abs_force_fight_n", "value": 3000.0, "unit": "N"},
            {"name": "another", "value": 1.0, "unit": "1"},
        ],
        "recording": {"file": "run.mcap", "records": STEPS + 1, "lost": 0},
    }


class ReadRun(unittest.TestCase):
    def run_reader(self, records=None, text=None, log_time_offset_ns=0, arguments=("--require-metrics",)):
        records = [record(step) for step in range(STEPS + 1)] if records is None else records
        with tempfile.TemporaryDirectory() as folder:
            recording, summary_file = pathlib.Path(folder, "run.mcap"), pathlib.Path(folder, "summary.json")
            with open(recording, "wb") as file:
                writer = Writer(file)
                schema = writer.register_msgdef("hil_msgs/Record", DEFINITION)
                for one in records:
                    time = one["sim_time_ns"] + log_time_offset_ns
                    writer.write_message("/record", schema, one, log_time=time, publish_time=1)
                writer.finish()
            summary_file.write_text(json.dumps(text or summary()))
            out, err = io.StringIO(), io.StringIO()
            argv = ["read_run.py", str(recording), str(summary_file), *arguments]
            with mock.patch("sys.argv", argv), contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
                code = read_run.main()
        return code, out.getvalue() + err.getvalue()

    def refuses(self, reason, **changes):
        code, text = self.run_reader(**changes)
        self.assertEqual(code, 1, text)
        self.assertIn(reason, text)

    def records_with(self, step, group, name, value):
        records = [record(k) for k in range(STEPS + 1)]
        records[step][group][name] = value
        return records

    def test_a_good_recording_passes(self):
        code, text = self.run_reader()
        self.assertEqual(code, 0, text)
        self.assertIn("31 records of hil_msgs/Record, steps 0..30 at 10.0 Hz", text)
        self.assertIn("4 metrics equal", text)

    def test_a_missing_step_is_named(self):
        records = [record(k) for k in range(STEPS + 1) if k != 7]
        self.refuses("step 8 stands where 7 belongs", records=records)

    def test_steps_out_of_order_are_named(self):
        order = [0, 2, 1, *range(3, STEPS + 1)]
        self.refuses("step 2 stands where 1 belongs", records=[record(k) for k in order])

    def test_a_cut_recording_is_refused(self):
        records = [record(k) for k in range(STEPS - 2)]
        self.refuses("28 records in the file, 31 in the summary", records=records)

    def test_a_log_time_off_by_one_nanosecond_is_refused(self):
        self.refuses("log time", log_time_offset_ns=1)

    def test_nan_before_the_end_is_refused(self):
        records = self.records_with(5, "command", "actuator1_valve_current_a", math.nan)
        self.refuses("step 5: command.actuator1_valve_current_a is NaN", records=records)

    def test_nan_truth_is_refused_at_the_end_too(self):
        records = self.records_with(STEPS, "truth", "force_fight_n", math.nan)
        self.refuses("step 30: truth.force_fight_n is NaN", records=records)

    def test_a_metric_off_by_one_bit_is_refused(self):
        text = summary()
        text["metrics"][0]["value"] = math.nextafter(text["metrics"][0]["value"], 1.0)
        self.refuses("max_abs_tracking_error_rad over [0.0, 1.0]", text=text)

    def test_a_window_includes_both_ends(self):
        text = summary()
        text["metrics"][2]["window_s"] = [0.0, 1.1]
        self.refuses("recording 1100.0, summary 1000.0", text=text)

    def test_no_metric_is_a_failure_only_when_asked(self):
        text = {**summary(), "metrics": []}
        self.refuses("has none of", text=text)
        code, output = self.run_reader(text=text, arguments=())
        self.assertEqual(code, 0, output)
        self.assertIn("no metric to compare", output)

    def test_lost_records_are_refused(self):
        text = summary()
        text["recording"]["lost"] = 3
        self.refuses("3 records were lost", text=text)

    def test_an_empty_recording_is_refused(self):
        self.refuses("no message on /record", records=[])


if __name__ == "__main__":
    unittest.main()
