"""Evaluation of a scenario at many points, and the optimisers of others that drive it.

    HIL_BIN=target/release/hil python -m unittest test_evaluate

Skipped without HIL_BIN; each optimiser is skipped by name where it is missing.
"""

import math
import os
import pathlib
import signal
import sys
import tempfile
import threading
import unittest

CLONE = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(CLONE / "tools" / "python"))

import hil
import numpy as np

PROGRAM = os.environ.get("HIL_BIN")
SPRING = CLONE / "scenarios" / "spring-mass.toml"
P, D = "controller.pid.proportional_n_per_m", "controller.pid.derivative_n_s_per_m"


@unittest.skipUnless(PROGRAM, "HIL_BIN is not set")
class Evaluate(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory(prefix="hil test ")
        self.addCleanup(folder.cleanup)
        self.addCleanup(os.chdir, os.getcwd())
        os.environ["HIL_BIN"] = os.path.abspath(PROGRAM)
        os.chdir(folder.name)

    def test_points_have_the_results_of_their_runs_in_their_order(self):
        points = [{P: 1000.0, D: 10.0}, {"controller.law": "hold"}, {P: 100, D: 5}]
        results = hil.evaluate(SPRING, points, workers=3)
        for point, result in zip(points, results):
            run = hil.run(SPRING, set=point, link="in-process", record=False)
            self.assertEqual((result.verdict, result.digest, result.reason), (run.verdict, run.digest, run.reason))
            self.assertEqual((dict(result.verdicts), result.metrics), (dict(run.verdicts), run.metrics))
        self.assertEqual([result.passed for result in results][:2], [True, False])
        self.assertEqual(results[0].robustness["settles"], results[0].verdicts["settles"].robustness)
        self.assertEqual(hil.evaluate(SPRING, []), [])

    def test_an_array_with_keys_is_the_same_as_mappings(self):
        array = np.array([[1000.0, 10.0], [100.0, 5.0]])
        mappings = [dict(zip((P, D), map(float, row))) for row in array]
        for rows in (array, array.astype(np.float32), array.tolist(), iter(array), np.asfortranarray(array)):
            results = hil.evaluate(SPRING, rows, (P, D), set={"run.seed": 3})
            self.assertEqual(results, hil.evaluate(SPRING, mappings, set={"run.seed": 3}))

    def test_invalid_points_are_refused_before_any_run(self):
        for points, keys, kind, text in [
            ([{P: 1e4}, {"controller.pid.proportinal": 1}], None, hil.UsageError, "proportinal"),
            ([{P: math.nan}], None, ValueError, "point 0: .* is NaN"),
            ([[1.0, math.nan]], (P, D), ValueError, "point 0: .* is NaN"),
            ([[1.0]], (P, D), ValueError, "point 0 has 1 values for 2 keys"),
            (np.zeros((2, 2, 2)), (P, D), TypeError, "use a row of 2 values"),
            (np.zeros(2), (P, D), TypeError, "use a row of 2 values"),
            ([[1.0, 2.0]], None, TypeError, "name the columns in `keys`"),
            ([{"run.clock": "paced", "run.pace": 1}], None, hil.UsageError, "ignores the clock"),
        ]:
            with self.assertRaisesRegex(kind, text):
                hil.evaluate(SPRING, points, keys)
        with self.assertRaisesRegex(ValueError, "workers is 0"):
            hil.evaluate(SPRING, [{P: 1e4}], workers=0)

    def test_a_refusal_names_its_point_unless_the_scenario_is_wrong_by_itself(self):
        plant = pathlib.Path(os.environ["HIL_BIN"]).with_name("plant-process")
        for common in ({}, {"plant.program": plant}):
            for points, text in [
                ([{P: 1e3}, {P: 1e4}, {"controller.pid.proportinal": 1}, {"x": 1}], "^point 2: .*proportinal"),
                ([{P: 1e3}, {P: -1e300}], "^point 1: .*-1e300"),
            ]:
                with self.assertRaisesRegex(hil.UsageError, f"(?s){text}") as refused:
                    hil.evaluate(SPRING, points, set=common)
                self.assertEqual(len(refused.exception.problems), 1)
        with self.assertRaisesRegex(hil.UsageError, "^error: the scenario cannot be read"):
            hil.evaluate("missing.toml", [{P: 1e3}])

    def test_the_scenario_of_no_points_is_checked(self):
        with self.assertRaisesRegex(hil.UsageError, "cannot be read"):
            hil.evaluate("missing.toml", [])
        with self.assertRaisesRegex(hil.UsageError, "proportinal"):
            hil.evaluate(SPRING, [], set={"controller.pid.proportinal": 1})

    def test_keys_that_repeat_are_refused(self):
        for points in ([[1.0, 2.0, 3.0]], []):
            with self.assertRaisesRegex(ValueError, f"`{P}` is twice in `keys`"):
                hil.evaluate(SPRING, points, (P, D, P))
        with self.assertRaisesRegex(TypeError, "`keys` is one text"):
            hil.evaluate(SPRING, [[1.0]], P)

    def test_a_data_frame_has_its_keys_as_columns(self):
        expected = hil.evaluate(SPRING, [{P: 1000.0, D: 10.0}, {P: 100.0, D: 5.0}])
        columns = {D: [10.0, 5.0], P: [1000.0, 100.0]}
        frames = 0
        for package in ("pandas", "polars"):
            try:
                frame = __import__(package).DataFrame(columns)
            except ImportError:
                continue
            frames += 1
            self.assertEqual(hil.evaluate(SPRING, frame), expected)
            self.assertEqual(hil.evaluate(SPRING, frame, (P, D)), expected)
            self.assertEqual(hil.evaluate(SPRING, frame, [P]), hil.evaluate(SPRING, [[1000.0], [100.0]], [P]))
            with self.assertRaisesRegex(ValueError, "no column `run.seed`"):
                hil.evaluate(SPRING, frame, (P, "run.seed"))
        if not frames:
            self.skipTest("pandas and polars are missing")

    def test_ctrl_c_ends_an_evaluation(self):
        long = {"run.duration_s": 1e5, "metrics": [], "requirements": [], "derived": []}
        threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGINT)).start()
        with self.assertRaises(KeyboardInterrupt):
            hil.evaluate(SPRING, [{P: 1e4 + place} for place in range(8)], set=long)
        self.assertEqual(hil.evaluate(SPRING, [{}])[0].verdict, "pass")

    def test_a_scenario_with_a_program_is_evaluated_in_processes(self):
        plant = pathlib.Path(os.environ["HIL_BIN"]).with_name("plant-process")
        (result,) = hil.evaluate(SPRING, [{D: 20.0}], set={"plant.program": plant})
        (expected,) = hil.evaluate(SPRING, [{D: 20.0}])
        self.assertEqual(result, expected)

    def test_programs_are_kept_from_point_to_point(self):
        plant = pathlib.Path(os.environ["HIL_BIN"]).with_name("plant-process")
        with tempfile.TemporaryDirectory() as folder:
            starts, counted = pathlib.Path(folder, "starts"), pathlib.Path(folder, "counted-plant")
            counted.write_text(f'#!/bin/sh\necho "$@" >> "{starts}"\nexec "{plant}" "$@"\n')
            counted.chmod(0o700)
            # Points that pass, fail and diverge.
            points = [{P: 10.0 ** (1 + place % 5), D: 5.0} for place in range(30)]
            expected = hil.evaluate(SPRING, points)
            self.assertEqual(hil.evaluate(SPRING, points, set={"plant.program": counted}), expected)
            self.assertGreater(len({result.verdict for result in expected}), 1)
            served = [line for line in starts.read_text().splitlines() if "--describe" not in line and "--check" not in line]
            # One serves all, and some points run again in new ones.
            self.assertLess(len(served), len(points) / 2, served)


@unittest.skipUnless(PROGRAM, "HIL_BIN is not set")
class Optimisers(unittest.TestCase):
    """Each of them finds gains that pass from ones that do not."""

    #: The start, scaled to 1, fails: the mass still swings at 4 s.
    SCALE = np.array([30.0, 3.0])

    def setUp(self):
        os.environ["HIL_BIN"] = os.path.abspath(PROGRAM)

    def losses(self, points):
        """Returns the smallest margin of each point with the other sign, which is below 0 for a pass."""
        results = hil.evaluate(SPRING, np.atleast_2d(points) * self.SCALE, (P, D))
        # The margins of an unstable loop span many decades.
        margins = [min(result.robustness.values()) if result.verdict != "aborted" else -1e30 for result in results]
        return [-math.asinh(1e6 * margin) for margin in margins]

    def test_the_start_fails(self):
        self.assertGreater(self.losses([1.0, 1.0])[0], 0)

    def test_cma_finds_gains_that_pass(self):
        try:
            import cma
        except ImportError as error:
            self.skipTest(str(error))
        options = {"seed": 1, "verbose": -9, "bounds": [0.1, 40], "maxiter": 30}
        search = cma.CMAEvolutionStrategy([1.0, 1.0], 2.0, options)
        while not search.stop() and search.best.f >= 0:
            points = search.ask()
            search.tell(points, self.losses(points))
        self.assertLess(search.best.f, 0)

    def test_optuna_finds_gains_that_pass(self):
        try:
            import optuna
        except ImportError as error:
            self.skipTest(str(error))
        optuna.logging.set_verbosity(optuna.logging.WARNING)
        study = optuna.create_study(sampler=optuna.samplers.TPESampler(seed=1))

        def objective(trial):
            return self.losses([trial.suggest_float("p", 0.1, 40), trial.suggest_float("d", 0.1, 40)])[0]

        study.enqueue_trial({"p": 1.0, "d": 1.0})
        study.optimize(objective, 60)
        self.assertLess(study.best_value, 0)

    def test_salib_ranks_the_gains(self):
        try:
            from SALib.analyze import morris
            from SALib.sample import morris as sample
        except ImportError as error:
            self.skipTest(str(error))
        problem = {"num_vars": 3, "names": ["p", "d", "seed"], "bounds": [[200, 400], [20, 40], [1, 1e6]]}
        points = sample.sample(problem, 6, seed=1)
        rows = [{P: p, D: d, "run.seed": int(seed)} for p, d, seed in points]
        results = hil.evaluate(SPRING, rows)
        values = [metric.value for result in results for metric in result.metrics if metric.name == "overshoot_m"]
        effects = dict(zip(problem["names"], morris.analyze(problem, points, np.array(values))["mu_star"]))
        # Nothing in this scenario is random.
        self.assertEqual(effects["seed"], 0)
        self.assertGreater(min(effects["p"], effects["d"]), 0)


if __name__ == "__main__":
    unittest.main()
