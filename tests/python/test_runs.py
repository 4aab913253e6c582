"""The package `hil` with the programs: runs, their results and their exceptions.

    HIL_BIN=target/release/hil python -m unittest test_runs

Skipped without HIL_BIN.
"""

import concurrent.futures
import json
import math
import os
import pathlib
import pickle
import signal
import subprocess
import sys
import tempfile
import textwrap
import time
import unittest
import xml.etree.ElementTree

CLONE = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(CLONE / "tools" / "python"))

import hil
import numpy as np

PROGRAM = os.environ.get("HIL_BIN")
SPRING = CLONE / "scenarios" / "spring-mass.toml"
BREAKS = CLONE / "scenarios" / "spring-breaks.toml"


def descendants(pid):
    """Yields the processes that a process started, and theirs."""
    for children in pathlib.Path(f"/proc/{pid}/task").glob("*/children"):
        for child in map(int, children.read_text().split()):
            yield child
            yield from descendants(child)


def name_of(pid):
    return os.path.basename(os.readlink(f"/proc/{pid}/exe"))


@unittest.skipUnless(PROGRAM, "HIL_BIN is not set")
class Runs(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory(prefix="hil test ")
        self.addCleanup(folder.cleanup)
        self.addCleanup(os.chdir, os.getcwd())
        os.environ["HIL_BIN"] = os.path.abspath(PROGRAM)
        os.chdir(folder.name)

    def test_a_run_has_the_results_of_its_summary(self):
        run = hil.run(BREAKS, link="in-process", out="a run")
        summary = json.loads(pathlib.Path("a run/summary.json").read_text())
        self.assertEqual((run.verdict, run.passed, run.reason), ("pass", True, None))
        self.assertEqual((run.digest, run.summary), (summary["digest"], summary))
        names = [requirement["name"] for requirement in summary["requirements"]]
        self.assertEqual(list(run.verdicts), names)
        holds, first = run.verdicts["holds"], summary["requirements"][0]
        self.assertEqual((holds.verdict, holds.robustness, holds.unit), ("pass", first["robustness"], "m"))
        self.assertEqual([metric.value for metric in run.metrics], [row["value"] for row in summary["metrics"]])
        self.assertEqual(run.metrics[0].window_s, (1.5, 2.0))
        run["truth.position_m"]
        again = pickle.loads(pickle.dumps(run))
        self.assertEqual((again.digest, again["tracking_error_m"].unit), (run.digest, "m"))

    def test_two_processes_and_one_have_the_same_digest_in_the_usual_folder(self):
        two, one = hil.run(SPRING), hil.run(SPRING, link="in-process", session="named")
        self.assertEqual(two.digest, one.digest)
        self.assertEqual(two.folder.parent, pathlib.Path("runs"))
        self.assertTrue(one.folder.name.endswith("-named"), one.folder)
        self.assertEqual(hil.open("latest").folder, one.folder)
        self.assertEqual(hil.open().digest, one.digest)

    def test_a_failed_requirement_is_a_result(self):
        run = hil.run(SPRING, set={"controller.law": "hold"}, link="in-process")
        self.assertEqual((run.verdict, run.passed), ("fail", False))
        self.assertEqual(run.verdicts["settles"].verdict, "fail")

    def test_values_of_python_become_values_of_the_scenario(self):
        values = {
            "run.duration_s": np.float64(0.25),
            "run.seed": np.int64(7),
            "controller": {"law": "hold", "hold": {"value": -1e-05}},
            "stimuli[0]": {"target": "position_m", "kind": "table", "time_s": (0, 0.1), "values": np.float32([0.0, 0.5])},
            "requirements": [{"name": "moves", "formula": "always(truth.position_m < 1)"}],
            "metrics": [],
            "derived": [],
        }
        run = hil.run(SPRING, set=values, link="in-process")
        self.assertEqual((run.summary["seed"], run.summary["sim_time_s"]), (7, 0.25))
        self.assertEqual(set(run["command.force_n"][:-1]), {-1e-05})
        self.assertEqual(run["reference.position_m"][200], 0.5)
        self.assertEqual(list(run.verdicts), ["moves"])
        with self.assertRaisesRegex(TypeError, "None cannot be a value of a scenario"):
            hil.run(SPRING, set={"run.seed": None})

    def test_signals_are_arrays_with_units(self):
        run = hil.run(BREAKS, link="in-process")
        position_m, reference_m = run["truth.position_m"], run["reference.position_m"]
        self.assertEqual((position_m.unit, position_m.name, len(position_m)), ("m", "truth.position_m", 5001))
        self.assertEqual((position_m[10:20].unit, position_m.copy().unit), ("m", "m"))
        for computed in (position_m * 2, position_m * position_m, np.sqrt(abs(position_m))):
            self.assertIs(type(computed), np.ndarray)
        self.assertIsInstance(position_m.max(), float)
        again = pickle.loads(pickle.dumps(position_m))
        self.assertEqual((again.unit, again.tolist()), ("m", position_m.tolist()))
        self.assertEqual(run.time_s.tolist(), [step / 1000 for step in range(5001)])
        error_m = run["tracking_error_m"]
        self.assertEqual(error_m.unit, "m")
        self.assertEqual(error_m.tolist(), (position_m - reference_m).tolist())

    def test_a_window_and_every_are_those_of_recorded_and_derived_signals(self):
        run = hil.run(BREAKS, link="in-process")
        part = run.to_numpy(["truth.position_m", "tracking_error_m"], window_s=(2.0, 2.01), every=4)
        self.assertEqual(part["step"].tolist(), [2000, 2004, 2008])
        for name in ("truth.position_m", "tracking_error_m"):
            self.assertEqual(part[name].tolist(), run[name][2000:2011:4].tolist())
            self.assertEqual(run.signal(name, (2.0, 2.01), 4).tolist(), part[name].tolist())
        self.assertEqual(len(run.signal("tracking_error_m", (70, 80))), 0)
        self.assertIn("tracking_error_m", run.to_numpy("*"))

    def test_unknown_names_are_key_errors_with_the_nearest(self):
        run = hil.run(SPRING, link="in-process")
        for wrong, right in [("truth.positon_m", "truth.position_m"), ("traking_error_m", "tracking_error_m")]:
            with self.assertRaises(KeyError) as caught:
                run[wrong]
            self.assertIsInstance(caught.exception, hil.UnknownSignal)
            self.assertEqual(caught.exception.nearest[0], right)
            self.assertIn(f"has no signal `{wrong}`; nearest: {right}", str(caught.exception))
            self.assertEqual(str(pickle.loads(pickle.dumps(caught.exception))), str(caught.exception))
        self.assertIn("tracking_error_m", run)
        self.assertNotIn("truth.*", run)

    def test_a_run_that_was_not_recorded_has_its_results(self):
        run = hil.run(SPRING, record=False, link="in-process")
        self.assertEqual((run.verdict, run.is_recorded), ("pass", False))
        self.assertIn("spring-mass", run.scenario)
        self.assertIn("pass", run._repr_html_())
        with self.assertRaisesRegex(hil.RecordingError, "was not to be recorded"):
            run["truth.position_m"]
        self.assertEqual(list(hil.run(SPRING, record="truth.position_m").signals), ["truth.position_m"])

    def test_wrong_usage_is_an_exception_with_the_text_of_the_command_line(self):
        with self.assertRaises(hil.UsageError) as caught:
            hil.run(SPRING, set={"controller.lax": "pid"})
        error = caught.exception
        self.assertEqual((error.exit_code, error.run), (2, None))
        self.assertEqual(error.problems[0]["key"], "controller.lax")
        command = [PROGRAM, "run", str(SPRING), "--set", "controller.lax=pid"]
        os.chdir(CLONE)
        self.assertEqual(error.text, subprocess.run(command, capture_output=True, text=True).stderr)
        self.assertEqual(str(error), error.text.strip())
        with self.assertRaisesRegex(hil.UsageError, "cannot be read"):
            hil.run("missing.toml")

    def test_a_plant_that_dies_is_an_infrastructure_error_with_the_run_so_far(self):
        with concurrent.futures.ThreadPoolExecutor() as pool:
            result = pool.submit(hil.run, SPRING, pace=0.01, out="killed")
            while not pathlib.Path("killed/run.mcap").exists() and not result.done():
                time.sleep(0.01)
            plants = [pid for pid in descendants(os.getpid()) if name_of(pid) == "plant-process"]
            self.assertEqual(len(plants), 1)
            os.kill(plants[0], signal.SIGKILL)
            with self.assertRaises(hil.InfrastructureError) as caught:
                result.result()
        error = caught.exception
        self.assertEqual((error.exit_code, error.run.verdict), (3, "aborted"))
        self.assertIn("SIGKILL", str(error))
        again = pickle.loads(pickle.dumps(error))
        self.assertEqual((str(again), again.run.folder), (str(error), pathlib.Path("killed")))

    def test_ctrl_c_ends_the_run_and_leaves_its_records(self):
        script = textwrap.dedent(
            f"""\
            import sys
            sys.path.insert(0, {str(CLONE / "tools" / "python")!r})
            import hil
            hil.run({str(SPRING)!r}, pace=0.01, out="held")
            """
        )
        python = subprocess.Popen([sys.executable, "-c", script], stderr=subprocess.PIPE, text=True)
        recording = pathlib.Path("held/run.mcap")
        while not recording.exists() and python.poll() is None:
            time.sleep(0.01)
        python.send_signal(signal.SIGINT)
        _, stderr = python.communicate()
        self.assertIn("KeyboardInterrupt", stderr)
        # `hil` has ended before Python: the result is complete.
        run = hil.open("held")
        self.assertEqual((run.verdict, run.is_whole), ("aborted", True))
        self.assertIn("interrupted", run.reason)

    def test_a_missing_program_is_named_with_the_remedy(self):
        os.environ["HIL_BIN"] = "/nowhere/hil"
        with self.assertRaisesRegex(hil.ProgramError, "HIL_BIN is /nowhere/hil"):
            hil.run(SPRING)
        script = pathlib.Path("hil")
        script.write_text("#!/nowhere/interpreter\n")
        script.chmod(0o755)
        os.environ["HIL_BIN"] = str(script)
        with self.assertRaisesRegex(hil.ProgramError, "cannot start .*its loader is missing"):
            hil.run(SPRING)

    def test_the_page_of_a_run_is_well_formed_and_escapes_texts(self):
        run = hil.run(SPRING, out="<i>&", link="in-process")
        summary = pathlib.Path("<i>&/summary.json")
        # No name of a scenario can be such; a file can.
        summary.write_text(summary.read_text().replace('"settles"', '"<b>&"'))
        text = run._repr_html_()
        page = xml.etree.ElementTree.fromstring(text)
        cells = ["".join(cell.itertext()) for cell in page.iter("td")]
        self.assertIn("<b>&", cells)
        self.assertIn("<i>&", page.find("p/b").text)
        curves = list(page.iter("{http://www.w3.org/2000/svg}path"))
        self.assertEqual(len(curves), 2)
        for curve in curves:
            self.assertNotIn("nan", curve.get("d"))

    def test_frames_have_the_same_numbers(self):
        try:
            import pandas  # noqa: F401
            import polars  # noqa: F401
            import pyarrow  # noqa: F401
        except ImportError as error:
            self.skipTest(str(error))
        run = hil.run(BREAKS, link="in-process")
        data = run.to_numpy(["truth.*", "tracking_error_m"])
        frames = run.to_polars(["truth.*", "tracking_error_m"]), run.to_pandas(["truth.*", "tracking_error_m"])
        self.assertEqual(frames[0].columns, list(data))
        for name, values in data.items():
            self.assertEqual(frames[0][name].to_list(), values.tolist())
            if name != "time_s":
                self.assertEqual(frames[1][name].tolist(), values.tolist())
        table = run.to_arrow("truth.*")
        self.assertEqual(json.loads(table.schema.metadata[b"units"])["truth.position_m"], "m")


class Package(unittest.TestCase):
    def test_the_import_brings_neither_numpy_nor_other_libraries(self):
        script = "import sys; before = set(sys.modules); import hil; print(*sorted(set(sys.modules) - before))"
        python = [sys.executable, "-c", script]
        environment = {**os.environ, "PYTHONPATH": str(CLONE / "tools" / "python")}
        output = subprocess.run(python, env=environment, capture_output=True, text=True, check=True)
        self.assertEqual(output.stdout.split(), ["hil"])

    def test_every_public_name_exists_and_no_other(self):
        for name in hil.__all__:
            self.assertIsNotNone(getattr(hil, name))
            self.assertIn(name, dir(hil))
        with self.assertRaisesRegex(AttributeError, "no attribute 'Sessions'"):
            hil.Sessions

    def test_values_are_written_as_toml(self):
        from hil.values import toml

        for value, text in [
            (True, "true"),
            (np.bool_(False), "false"),
            (3, "3"),
            (0.1, "0.1"),
            (math.inf, "inf"),
            ("pid", "pid"),
            ("true", '"true"'),
            ("0.1 deg", '"0.1 deg"'),
            ('a "b"\n', '"a \\"b\\"\\n"'),
            (pathlib.Path("x.fmu"), '"x.fmu"'),
            ([1, "a"], '[1, "a"]'),
            (np.array([[1.0, 2.0]]), "[[1.0, 2.0]]"),
            ({"a b": {"c": [True]}}, '{"a b" = {"c" = [true]}}'),
        ]:
            self.assertEqual(toml(value), text)


if __name__ == "__main__":
    unittest.main()
