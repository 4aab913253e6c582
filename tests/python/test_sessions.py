"""Sessions: runs that Python executes step by step.

    HIL_BIN=target/release/hil python -m unittest test_sessions

Skipped without HIL_BIN.
"""

import gc
import math
import os
import pathlib
import pickle
import signal
import subprocess
import sys
import tempfile
import threading
import time
import unittest

CLONE = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(CLONE / "tools" / "python"))

import hil
import numpy as np

PROGRAM = os.environ.get("HIL_BIN")
SPRING = CLONE / "scenarios" / "spring-mass.toml"
BREAKS = CLONE / "scenarios" / "spring-breaks.toml"
LEAKAGE = CLONE / "scenarios" / "severe-leakage.toml"
EXAMPLE = CLONE / "examples" / "python-plant"


@unittest.skipUnless(PROGRAM, "HIL_BIN is not set")
class Sessions(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory(prefix="hil test ")
        self.addCleanup(folder.cleanup)
        self.addCleanup(os.chdir, os.getcwd())
        os.environ["HIL_BIN"] = os.path.abspath(PROGRAM)
        os.chdir(folder.name)

    def repeated(self, session):
        """Runs the scenario of a session with the command line and returns the run."""
        path = pathlib.Path("repeats.toml")
        path.write_text(session.scenario())
        return hil.run(path, link="in-process")

    # Results.

    def test_a_session_has_the_results_of_a_run(self):
        for scenario in (SPRING, BREAKS):
            run = hil.run(scenario, link="in-process")
            with hil.Session(scenario) as session:
                session.step_to()
                self.assertEqual(session.digest, run.digest)
                result = session.result()
                self.assertEqual((result.verdict, result.passed, result.reason), ("pass", True, None))
                self.assertEqual(dict(result.verdicts), dict(run.verdicts))
                self.assertEqual(result.metrics, run.metrics)
                self.assertEqual((result.steps, result.time_s, session.is_over), (5000, 5.0, True))

    def test_values_of_the_newest_step_are_those_of_the_recording(self):
        run = hil.run(BREAKS, link="in-process")
        names = ["truth.position_m", "command.force_n", "tracking_error_m"]
        with hil.Session(BREAKS) as session:
            self.assertEqual((dict(session.signals), dict(session.derived)), (dict(run.signals), dict(run.derived)))
            with self.assertRaisesRegex(hil.SessionError, "no value before the first step"):
                session["truth.position_m"]
            observation = session.observe(names)
            self.assertTrue(np.isnan(observation.values).all())
            values = observation.values
            for step in (0, 1, 2, 1499, 1500, 3000):
                session.step(step + 1 - session.step_index)
                expected = [run[name][step] for name in names]
                self.assertEqual([session[name] for name in names], expected)
                self.assertIs(observation.read(), values)
                self.assertEqual(values.tolist(), expected)
            self.assertEqual((session.step_index, session.time_s, session.rate_hz, session.steps), (3001, 3.001, 1000, 5000))

    def test_values_of_the_scenario_are_set_as_by_the_command_line(self):
        values = {"controller.law": "hold", "run.seed": 9}
        with hil.Session(SPRING, set=values) as session:
            session.step_to(math.inf)
            run = hil.run(SPRING, set=values, link="in-process")
            self.assertEqual((session.digest, session.result().verdict), (run.digest, "fail"))

    def test_a_hydraulic_plant_has_the_digest_of_its_run(self):
        values = {"run.duration_s": 7.2, "metrics": [], "requirements": []}
        with hil.Session(LEAKAGE, set=values) as session:
            session.step(70_001)
            session.step_to()
            self.assertEqual(session.digest, hil.run(LEAKAGE, set=values, link="in-process").digest)

    def test_a_decided_requirement_has_the_bound_of_the_steps_so_far(self):
        scenario = SPRING.read_text()
        for name, formula in [
            ("stays", "always(abs(truth.position_m) < 1 mm)"),
            ("arrives", "eventually(truth.position_m > 5 mm)"),
            ("rests", "always[4s,5s](abs(truth.velocity_mps) < 1 m/s)"),
        ]:
            scenario += f'\n[[requirements]]\nname = "{name}"\nformula = "{formula}"\n'
        pathlib.Path("decided.toml").write_text(scenario)
        with hil.Session("decided.toml") as session:
            position = session.observe(["truth.position_m"])
            most_m = 0.0
            for _ in range(800):
                session.step()
                most_m = max(most_m, position.read()[0])
            verdicts = session.verdicts
            expected = {"stays": ("fail", 1e-3 - most_m), "arrives": ("pass", most_m - 5e-3), "rests": ("undecided", None)}
            for name, (verdict, robustness) in expected.items():
                self.assertEqual(verdicts[name].verdict, verdict)
                if robustness is None:
                    self.assertIsNone(verdicts[name].robustness)
                else:
                    self.assertAlmostEqual(verdicts[name].robustness, robustness, delta=1e-15)
            session.step_to()
            self.assertEqual(dict(session.verdicts), dict(hil.run("decided.toml", link="in-process").verdicts))

    # Interventions.

    def test_live_faults_and_changes_become_a_scenario_with_the_same_digest(self):
        with hil.Session(SPRING) as session:
            session.step(100)
            (bias,) = session.inject("bias", "measured.position_m", 1e-3)
            self.assertEqual((bias.id, bias.kind, bias.step), (1, "bias", 100))
            change = session.set("reference.position_m", 0.02, ramp=0.1)
            self.assertEqual((change.step, change.ramp_steps), (100, 100))
            session.step_to(0.5)
            self.assertEqual([fault["state"] for fault in session.faults], ["active"])
            self.assertEqual(session.clear(bias), (1,))
            session.inject("noise", "measured.position_m", 1e-4, at=0.75, duration="200ms")
            session.set({"plant.parameters.mass_kg": 1.25, "controller.pid.derivative_n_s_per_m": 25.0})
            session.step_to(2)
            session.release("reference.position_m")
            session.step_to()
            run = self.repeated(session)
            self.assertEqual(run.digest, session.digest)
            self.assertEqual(len(run.faults), 2)

    def test_refusals_have_the_text_of_the_command_line(self):
        with self.assertRaises(hil.UsageError) as of_run:
            hil.run(SPRING, set={"controller.lax": "pid", "plant.model": "sprin-mass"})
        with self.assertRaises(hil.UsageError) as of_session:
            hil.Session(SPRING, set={"controller.lax": "pid", "plant.model": "sprin-mass"})
        self.assertEqual(str(of_session.exception).strip(), str(of_run.exception).strip())
        self.assertEqual(of_session.exception.problems, of_run.exception.problems)
        with hil.Session(SPRING) as session:
            for refused, text in [
                (lambda: session.inject("bais", "measured.position_m", 1), "has no fault `bais`.*nearest: `bias`"),
                (lambda: session.inject("bias", "measured.positon_m", 1), "positon_m.*nearest: `measured.position_m`"),
                (lambda: session.inject("bias", "measured.position_m"), "bias"),
                (lambda: session.inject("bias", "measured.position_m", math.nan), "bias"),
                (lambda: session.inject("bias", "measured.position_m", 1, rampe=2), "no key `rampe`"),
                (lambda: session.set("reference.positon_m", 1), "positon_m.*nearest: `reference.position_m`"),
                (lambda: session.set("plant.parameters.mass_kg", -1), "mass_kg"),
                (lambda: session.clear(7), "no fault 7 to clear"),
            ]:
                with self.assertRaisesRegex(hil.UsageError, f"(?s){text}"):
                    refused()
            with self.assertRaisesRegex(TypeError, "cannot be the value"):
                session.set("reference.position_m", "far")
            with self.assertRaises(hil.UnknownSignal) as unknown:
                session["truth.positon_m"]
            self.assertEqual(unknown.exception.nearest[0], "truth.position_m")
            with self.assertRaisesRegex(KeyError, "session has|no signal `truth.x`"):
                session.observe(["truth.position_m", "truth.x"])
            session.step_to()
            # Nothing that was refused had an effect.
            self.assertEqual(session.digest, hil.run(SPRING, link="in-process").digest)

    # States.

    def test_a_restored_session_has_the_digest_of_the_straight_one(self):
        with hil.Session(BREAKS) as session, hil.Session(BREAKS) as other:
            session.step(1000)
            session.inject("noise", "measured.position_m", 1e-4)
            session.set("reference.position_m", 0.015, at=1.2, ramp=0.5)
            session.step(300)
            saved, digest = session.save(), session.digest
            self.assertEqual(saved.step_index, 1300)
            session.step_to()
            straight = session.result()
            for continued in (session, other):
                continued.restore(saved)
                self.assertEqual((continued.step_index, continued.digest), (1300, digest))
                self.assertEqual(continued.faults[-1]["state"], "active")
                continued.step_to()
                self.assertEqual(continued.result(), straight)
            self.assertEqual(self.repeated(other).digest, straight.digest)
            session.restore(saved)
            session.clear()
            session.step_to()
            self.assertNotEqual(session.digest, straight.digest)
            self.assertEqual(self.repeated(session).digest, session.digest)

    def test_a_reset_session_is_a_new_one(self):
        run, seeded = hil.run(BREAKS, link="in-process"), hil.run(BREAKS, set={"run.seed": 7}, link="in-process")
        with hil.Session(BREAKS) as session:
            before = session.save()
            tunable = dict(session.tunable)
            session.inject("bias", "measured.position_m", 1e-3)
            session.set("reference.position_m", 0.02)
            session.set({"plant.parameters.mass_kg": 1.25, "controller.pid.derivative_n_s_per_m": 25.0}, ramp=0.9)
            session.step(700)
            self.assertNotEqual(dict(session.tunable), tunable)
            session.reset()
            self.assertEqual((session.step_index, session.digest, len(session.faults)), (0, None, 2))
            self.assertEqual(dict(session.tunable), tunable)
            session.step_to()
            result = session.result()
            self.assertEqual((result.digest, result.metrics), (run.digest, run.metrics))
            self.assertEqual(dict(result.verdicts), dict(run.verdicts))
            session.reset(seed=7)
            session.step_to()
            self.assertEqual(session.digest, seeded.digest)
            with self.assertRaisesRegex(hil.UsageError, "another seed"):
                session.restore(before)
            with self.assertRaisesRegex(hil.UsageError, "run is over"):
                session.save()
            with self.assertRaises(OverflowError):
                session.reset(2**63)
            with self.assertRaises(TypeError):
                pickle.dumps(before)

    # Other sides.

    def test_classes_in_this_process_have_the_digest_of_the_plant_and_law_that_ship(self):
        sys.path.insert(0, str(EXAMPLE))
        self.addCleanup(sys.path.remove, str(EXAMPLE))
        import spring_mass

        path = EXAMPLE / "spring-mass.toml"
        with hil.Session(SPRING) as expected, hil.Session(path, plant=spring_mass.SpringMass, law=spring_mass.Pid) as session:
            for one in (expected, session):
                one.step(700)
                one.inject("bias", "measured.position_m", 1e-3)
                saved = one.save()
                one.step(100)
                one.restore(saved)
                one.step_to()
            self.assertEqual(session.digest, expected.digest)
            self.assertEqual(hil.run(SPRING, link="in-process").digest, hil.run(path, record=False).digest)
        with hil.Session(SPRING, law=spring_mass.Pid) as session:
            session.step_to()
            self.assertEqual(session.digest, hil.run(SPRING, link="in-process").digest)
        with self.assertRaisesRegex(hil.UsageError, "the law `pid` is given, but controller.law is `hold`"):
            hil.Session(SPRING, set={"controller.law": "hold"}, law=spring_mass.Pid)
        with self.assertRaisesRegex(hil.Error, "plant"):
            hil.Session(SPRING, law=spring_mass.SpringMass)
        with self.assertRaises(hil.Error):
            hil.Session(SPRING, law=dict)

    def test_a_reset_or_restore_that_fails_keeps_the_run(self):
        sys.path.insert(0, str(EXAMPLE))
        self.addCleanup(sys.path.remove, str(EXAMPLE))
        import spring_mass

        first = spring_mass.SpringMass.__init__
        self.addCleanup(setattr, spring_mass.SpringMass, "__init__", first)

        def failing(self, parameters):
            raise ValueError("no start")

        classes = {"plant": spring_mass.SpringMass, "law": spring_mass.Pid}
        with hil.Session(SPRING) as expected, hil.Session(EXAMPLE / "spring-mass.toml", **classes) as session:
            expected.step_to()
            session.step(500)
            saved = session.save()
            session.step(100)
            for replace in (session.reset, lambda: session.restore(saved)):
                spring_mass.SpringMass.__init__ = failing
                with self.assertRaisesRegex(hil.UsageError, "no start") as raised:
                    replace()
                self.assertIsInstance(raised.exception.__cause__, ValueError)
                spring_mass.SpringMass.__init__ = first
                self.assertEqual((session.step_index, session.is_over), (600, False))
            session.step_to()
            self.assertEqual(session.digest, expected.digest)

    def test_an_exception_of_a_class_is_the_cause_of_the_failure(self):
        sys.path.insert(0, str(EXAMPLE))
        self.addCleanup(sys.path.remove, str(EXAMPLE))
        import spring_mass

        tables = {name: getattr(spring_mass, name.capitalize()) for name in ("parameters", "truth", "command")}
        plant = hil.plant(**tables, measured=spring_mass.Motion, state=spring_mass.Motion, name="spring-mass")

        @plant
        class Broken(spring_mass.SpringMass):
            """A mass whose spring is missing."""

            def advance(self, interval, command):
                if interval.start_s >= 0.01:
                    raise error
                super().advance(interval, command)

        for error, raised in [(ValueError("no spring"), hil.InfrastructureError), (KeyboardInterrupt(), KeyboardInterrupt)]:
            with hil.Session(SPRING, plant=Broken) as session:
                with self.assertRaises(raised) as caught:
                    session.step_to()
                self.assertEqual((session.step_index, session.is_over), (10, True))
                if raised is hil.InfrastructureError:
                    self.assertIn("no spring", str(caught.exception))
                    self.assertIs(caught.exception.__cause__, error)

        @plant
        class Selfish(spring_mass.SpringMass):
            """A mass that steps its own session."""

            def advance(self, interval, command):
                own[0].step()

        own = [None]
        with hil.Session(SPRING, plant=Selfish) as own[0]:
            with self.assertRaisesRegex(hil.InfrastructureError, "in use"):
                own[0].step()

    def test_a_scenario_with_a_program_is_stepped_in_processes(self):
        plant = pathlib.Path(os.environ["HIL_BIN"]).with_name("plant-process")
        values = {"plant.program": plant}
        with hil.Session(SPRING) as expected, hil.Session(SPRING, set=values) as session:
            folder = session._native._folder
            for one in (expected, session):
                with self.assertRaisesRegex(hil.SessionError, "no value before the first step"):
                    one["truth.position_m"]
                one.step()
                one.step(99)
                one.inject("bias", "measured.position_m", 1e-3)
                one.set("reference.position_m", 0.02, ramp=0.1)
                one.step_to(1.2345)
                one.clear()
                self.assertEqual((one.step_index, one.is_over, one.rate_hz), (1235, False, 1000))
            names = ["truth.position_m", "command.force_n", "sensed.position_m", "reference.position_m"]
            self.assertEqual([session[name] for name in names], [expected[name] for name in names])
            self.assertEqual(session.observe(names).read().tolist(), expected.observe(names).read().tolist())
            self.assertEqual(dict(session.signals), dict(expected.signals))
            for refused in (session.save, session.reset, lambda: session.digest, session.scenario, session.result):
                with self.assertRaises(hil.SessionError):
                    refused()
            with self.assertRaisesRegex(hil.UsageError, "(?s)positon_m.*nearest"):
                session.set("reference.positon_m", 1)
            with self.assertRaises(hil.UnknownSignal):
                session["truth.positon_m"]
            for one in (expected, session):
                one.step_to()
                self.assertTrue(one.is_over)
            self.assertEqual(session.digest, expected.digest)
            self.assertEqual(session.result()._replace(time_s=5.0), expected.result())
            pathlib.Path("repeats.toml").write_text(session.scenario())
            self.assertEqual(hil.run("repeats.toml", record=False).digest, expected.digest)
        self.assertFalse(os.path.exists(folder))

    def test_ctrl_c_holds_a_session_in_processes(self):
        plant = pathlib.Path(os.environ["HIL_BIN"]).with_name("plant-process")
        values = {"run.duration_s": 1e5, "metrics": [], "requirements": [], "derived": [], "plant.program": plant}
        with hil.Session(SPRING, set=values) as session:
            for end_s in (9e4, math.inf):
                before = session.step_index
                threading.Timer(0.5, os.kill, (os.getpid(), signal.SIGINT)).start()
                with self.assertRaises(KeyboardInterrupt):
                    session.step_to(end_s)
                step = session.step_index
                self.assertGreater(step, before)
                session.step(5)
                self.assertEqual((session.step_index, session.is_over), (step + 5, False))

    def test_nothing_is_left_by_a_session_in_processes(self):
        plant = pathlib.Path(os.environ["HIL_BIN"]).with_name("plant-process")
        names = []
        with self.assertRaises(ZeroDivisionError), hil.Session(SPRING, set={"plant.program": plant}) as session:
            names.append(session._native._name)
            session.step(1 // 0)
        # Killed, so that nothing of Python runs any more.
        script = (
            "import hil, os, sys\n"
            f"session = hil.Session({str(SPRING)!r}, set={{'plant.program': {str(plant)!r}}})\n"
            "session.step(10)\n"
            "print(session._native._name, flush=True)\n"
            "os.kill(os.getpid(), 9)\n"
        )
        environment = {**os.environ, "PYTHONPATH": str(CLONE / "tools" / "python")}
        killed = subprocess.run([sys.executable, "-c", script], env=environment, capture_output=True, text=True)
        self.assertEqual(killed.returncode, -signal.SIGKILL, killed.stderr)
        names += killed.stdout.split()
        self.assertEqual(len(names), 2)
        program, deadline = os.environ["HIL_BIN"], time.monotonic() + 60
        while True:
            listing = subprocess.run([program, "sessions", "--json"], capture_output=True, text=True, check=True).stdout
            if not any(name in listing for name in names):
                break
            self.assertLess(time.monotonic(), deadline, listing)
            time.sleep(0.05)

    # Bad use.

    def test_a_session_that_is_over_or_closed_says_so(self):
        values = {"run.duration_s": 0.01, "stimuli[0].at_s": 0, "metrics": [], "requirements": []}
        with hil.Session(SPRING, set=values) as session:
            with self.assertRaisesRegex(hil.SessionError, "no simulated time"):
                session.step_to(math.nan)
            session.step(1000)
            self.assertEqual((session.step_index, session.is_over), (10, True))
            with self.assertRaisesRegex(hil.SessionError, "over since step 10"):
                session.step()
            with self.assertRaisesRegex(hil.SessionError, "is past"):
                session.step_to(0.005)
            session.reset()
            session.step(10)
        session.close()
        for use in (session.step, session.save, session.result, lambda: session["truth.position_m"]):
            with self.assertRaisesRegex(hil.SessionError, "closed"):
                use()
        self.assertIn("closed", repr(session))

    def test_a_run_that_diverges_is_a_result(self):
        values = {"controller.pid.proportional_n_per_m": -5e4}
        run = hil.run(SPRING, set=values, link="in-process")
        with hil.Session(SPRING, set=values) as session:
            session.step_to()
            self.assertEqual((session.result().verdict, session.result().reason), (run.verdict, run.reason))
            self.assertEqual((session.digest, session.result().verdict), (run.digest, "aborted"))

    def test_sessions_of_one_process_do_not_disturb_each_other(self):
        expected = hil.run(BREAKS, link="in-process").digest
        with hil.Session(BREAKS) as first, hil.Session(BREAKS) as second:
            second.step(10)
            second.inject("bias", "measured.position_m", 1e-3)
            while not first.is_over:
                first.step(250)
                if not second.is_over:
                    second.step(333)
            self.assertEqual(first.digest, expected)
            self.assertNotEqual(second.digest, expected)

    def test_each_thread_has_sessions_of_its_own(self):
        expected, digests, errors = hil.run(BREAKS, link="in-process").digest, [], []
        with hil.Session(BREAKS) as session:

            def work():
                with hil.Session(BREAKS) as own:
                    own.step_to()
                    digests.append(own.digest)
                for use in (session.step, session.close, lambda: session["truth.position_m"]):
                    try:
                        use()
                    except hil.SessionError as error:
                        errors.append(str(error))

            threads = [threading.Thread(target=work) for _ in range(3)]
            for thread in threads:
                thread.start()
            for thread in threads:
                thread.join()
            session.step_to()
            self.assertEqual(digests + [session.digest], 4 * [expected])
            self.assertEqual(len([error for error in errors if "another thread" in error]), 9, errors)

    def test_a_forked_child_cannot_use_the_session_and_the_parent_can(self):
        with hil.Session(BREAKS) as session:
            session.step(100)
            reader, writer = os.pipe()
            child = os.fork()
            if child == 0:
                text = "no exception"
                try:
                    session.step()
                except hil.SessionError as error:
                    text = str(error)
                finally:
                    os.write(writer, text.encode())
                    del session
                    gc.collect()
                    os._exit(0)
            os.close(writer)
            with os.fdopen(reader) as pipe:
                self.assertIn("before a fork", pipe.read())
            self.assertEqual(os.waitpid(child, 0)[1], 0)
            session.step_to()
            self.assertEqual(session.digest, hil.run(BREAKS, link="in-process").digest)

    def test_ctrl_c_in_a_step_is_that_of_python_and_the_session_goes_on(self):
        values = {"run.duration_s": 1e6, "metrics": [], "requirements": [], "derived": []}
        with hil.Session(SPRING, set=values) as session:
            before = signal.getsignal(signal.SIGINT)
            threading.Timer(0.2, os.kill, (os.getpid(), signal.SIGINT)).start()
            with self.assertRaises(KeyboardInterrupt):
                session.step_to()
            self.assertIs(signal.getsignal(signal.SIGINT), before)
            step = session.step_index
            self.assertGreater(step, 0)
            digest = session.digest
            session.step(5)
            self.assertEqual(session.step_index, step + 5)
            session.reset()
            session.step(step)
            self.assertEqual(session.digest, digest)

    def test_nothing_is_left_by_a_session_that_is_abandoned(self):
        def count():
            gc.collect()
            return len(os.listdir("/proc/self/fd")), threading.active_count(), len(os.listdir("/proc/self/task"))

        hil.Session(SPRING).close()
        before = count()
        for _ in range(5):
            session = hil.Session(SPRING)
            session.me = session  # a cycle
            session.step(3)
        with self.assertRaises(ZeroDivisionError), hil.Session(SPRING) as other:
            other.step(1 // 0)
        del session, other
        self.assertEqual(count(), before)

    def test_a_session_starts_no_process_and_loads_neither_numpy_nor_others(self):
        script = (
            "import sys, os, hil\n"
            f"with hil.Session({str(SPRING)!r}) as session: session.step(10)\n"
            "print('numpy' in sys.modules, os.listdir('/proc/self/task').__len__())\n"
        )
        environment = {**os.environ, "PYTHONPATH": str(CLONE / "tools" / "python"), "OMP_NUM_THREADS": "1"}
        python = [sys.executable, "-c", script]
        output = subprocess.run(python, env=environment, capture_output=True, text=True, check=True)
        self.assertEqual(output.stdout.split(), ["False", "1"])

    def test_a_missing_native_module_is_reported(self):
        script = "import hil\ntry:\n    hil.Session('x.toml')\nexcept hil.ProgramError as error:\n    print(error)\n"
        environment = {**os.environ, "PYTHONPATH": str(CLONE / "tools" / "python"), "HIL_BIN": sys.executable}
        python = [sys.executable, "-c", script]
        output = subprocess.run(python, env=environment, capture_output=True, text=True, check=True)
        self.assertIn("native part of this package is missing", output.stdout)
        pathlib.Path("libhil_python.so").write_bytes(b"no library")
        pathlib.Path("hil").write_text("#!/bin/sh\n")
        os.chmod("hil", 0o755)
        environment["HIL_BIN"] = os.path.abspath("hil")
        output = subprocess.run(python, env=environment, capture_output=True, text=True, check=True)
        self.assertIn("cannot be loaded", output.stdout)
        self.assertIn("CPython 3.9", output.stdout)


if __name__ == "__main__":
    unittest.main()
