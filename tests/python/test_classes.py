"""Classes as plants and laws, in this process and in processes of their own: exceptions, checks, and what they leave.

    HIL_BIN=target/release/hil python -m unittest test_classes

Skipped without HIL_BIN.
"""

import contextlib
import gc
import io
import math
import os
import pathlib
import py_compile
import signal
import subprocess
import sys
import tempfile
import time
import unittest
import weakref
from dataclasses import dataclass
from unittest import mock

CLONE = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(CLONE / "tools" / "python"))
sys.path.insert(0, str(CLONE / "examples" / "python-plant"))

import hil
import spring_mass

PROGRAM = os.environ.get("HIL_BIN")
SPRING = CLONE / "scenarios" / "spring-mass.toml"
SOURCE = CLONE / "examples" / "python-plant" / "spring_mass.py"


def law(owner):
    """Makes a subclass of the example's law a law of the same name and tables."""
    tables = {"parameters": spring_mass.Gains, "measured": spring_mass.Position, "command": spring_mass.Command}
    return hil.law(**tables, reference=spring_mass.Position, plants=["spring-mass"], name="pid")(owner)


def plant(owner, state=spring_mass.Motion):
    """Makes a subclass of the example's plant a plant of the same name and tables."""
    tables = {name: getattr(spring_mass, name.capitalize()) for name in ("parameters", "truth", "command")}
    return hil.plant(**tables, measured=spring_mass.Motion, state=state, name="spring-mass")(owner)


class Failing(spring_mass.Pid):
    """A law that raises an exception."""

    error = None

    def step(self, sample):
        if sample.time_s >= 0.01:
            raise self.error
        return super().step(sample)


@contextlib.contextmanager
def file_descriptor_2():
    """Yields a file with what native code writes to standard error."""
    before = os.dup(2)
    with tempfile.TemporaryFile() as file:
        os.dup2(file.fileno(), 2)
        try:
            yield file
        finally:
            os.dup2(before, 2)
            os.close(before)


@unittest.skipUnless(PROGRAM, "HIL_BIN is not set")
class Classes(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory(prefix="hil test ")
        self.addCleanup(folder.cleanup)
        self.addCleanup(os.chdir, os.getcwd())
        os.environ["HIL_BIN"] = os.path.abspath(PROGRAM)
        os.chdir(folder.name)

    def hil(self, *words, code=0):
        """Runs the command line and returns what it printed."""
        output = subprocess.run([os.environ["HIL_BIN"], *map(str, words)], capture_output=True, text=True)
        self.assertEqual(output.returncode, code, output.stdout + output.stderr)
        return output.stdout + output.stderr

    # Exceptions in this process.

    def test_an_exception_of_a_law_is_the_reason_of_its_session(self):
        class Steps(Failing):
            """A law that fails."""

        for error, text in [
            (ZeroDivisionError("no gain"), r"the law failed at step 10: ZeroDivisionError: no gain \(test_classes.py line"),
            (hil.Diverged("the gain is gone"), r"the law failed at step 10: Diverged: the gain is gone \(test_classes"),
        ]:
            Steps.error = error
            with hil.Session(SPRING, law=law(Steps)) as session:
                with self.assertRaisesRegex(hil.InfrastructureError, text) as caught:
                    session.step_to()
                self.assertIs(caught.exception.__cause__, error)
                self.assertNotIn("log", str(caught.exception))
                self.assertRegex(session.result().reason, text)
                self.assertEqual((session.is_over, session.result().verdict), (True, "aborted"))

    def test_a_law_that_is_lost_is_reported_where_the_run_goes_on(self):
        class Steps(Failing):
            """A law that fails."""

        values = {"run.on_controller_loss": "hold"}
        Steps.error = ZeroDivisionError("no gain")
        # pytest sets a hook of its own.
        python_hook = mock.patch.object(sys, "unraisablehook", sys.__unraisablehook__)
        with hil.Session(SPRING, law=law(Steps), set=values) as session, python_hook:
            with contextlib.redirect_stderr(io.StringIO()) as errors, file_descriptor_2() as native:
                session.step_to()
                native.seek(0)
                self.assertEqual(native.read(), b"")
            self.assertIn("ZeroDivisionError: no gain", errors.getvalue())
            self.assertEqual(session.step_index, 5000)
        Steps.error = KeyboardInterrupt()
        with hil.Session(SPRING, law=law(Steps), set=values) as session:
            with self.assertRaises(KeyboardInterrupt):
                session.step_to()
            session.step_to()
            self.assertEqual(session.step_index, 5000)

    def test_an_exception_of_this_package_has_the_place_of_the_class(self):
        class Closes(spring_mass.Pid):
            """A law that closes its session."""

            def step(self, sample):
                own[0].close()

        own = [None]
        with hil.Session(SPRING, law=law(Closes)) as own[0]:
            with self.assertRaisesRegex(hil.InfrastructureError, r"cannot close it \(test_classes.py line \d+, in step\)"):
                own[0].step()

    def test_a_plant_that_diverges_is_a_result_with_its_text(self):
        class Leaves(spring_mass.SpringMass):
            """A mass that leaves its range."""

            def advance(self, interval, command):
                raise hil.Diverged("the rod broke")

        with hil.Session(SPRING, plant=plant(Leaves)) as session:
            session.step_to()
            result = session.result()
            self.assertEqual((result.verdict, result.reason), ("aborted", "plant diverged at step 0 (0 s): the rod broke"))

    def test_every_error_of_a_class_names_its_method(self):
        Mass, Pid = spring_mass.SpringMass, spring_mass.Pid

        @dataclass
        class Bare:
            """A row without values."""

        def odd(method, result, base=Mass, **more):
            body = {"__doc__": "A side with a mistake.", method: lambda self, *_: result, **more}
            return type(base.__name__, (base,), body)

        for side, text in [
            (plant(odd("measure", None)), "`measure` returned None"),
            (plant(odd("measure", spring_mass.Motion("far", 0.0))), "`measure`: `position_m` of `Motion`"),
            (plant(odd("truth", 3)), "`truth` returned int"),
            (plant(odd("advance", 3)), "`advance` returned int"),
            (plant(odd("invalid", None)), "`invalid` returned NoneType; it must return names"),
            (plant(odd("invalid", "position_m")), "`invalid` returned str; it must return names"),
            (plant(odd("invalid", [1])), "`invalid` returned list; it must return names"),
            (plant(odd("invalid", ["positon_m"])), "`invalid`: `Motion` has no `positon_m`; nearest: position_m"),
            (law(odd("step", None, Pid)), "`step` returned None"),
            (law(odd("held", 7, Pid)), "`held` returned int; it must return names"),
        ]:
            sides = {"plant" if side.__base__ is Mass else "law": side}
            with self.subTest(text), hil.Session(SPRING, **sides) as session:
                with self.assertRaisesRegex(hil.InfrastructureError, text):
                    session.step(2)
        for side, text in [
            (law(odd("save", 2**70, Pid, restore=lambda self, value: None)), "`save`.*too large"),
            (law(odd("save", object(), Pid, restore=lambda self, value: None)), "`save` returned a object"),
            (plant(odd("measure", spring_mass.Motion(0.0, 0.0), position_m=property(lambda self: self.gone, lambda *_: None))), "gone"),
            (plant(odd("invalid", ()), state=spring_mass.State), "`save`: .*error_integral_m_s"),
        ]:
            sides = {"plant" if side.__base__ is Mass else "law": side}
            with self.subTest(text), hil.Session(SPRING, **sides) as session:
                with self.assertRaisesRegex(hil.UsageError, text):
                    session.save()

    # Memory.

    def test_a_class_ends_with_the_last_session_and_state_that_have_it(self):
        def used(kind):
            class Own(getattr(spring_mass, kind)):
                """A side of a cell of a notebook."""

            own = plant(Own) if kind == "SpringMass" else law(Own)
            with hil.Session(SPRING, **{"plant" if kind == "SpringMass" else "law": own}) as session:
                session.step(3)
                saved = session.save()
            with hil.Session(SPRING, **{"plant" if kind == "SpringMass" else "law": own}) as other:
                other.restore(saved)
                self.assertEqual(other.step_index, 3)
            return weakref.ref(own), saved

        for kind in ("SpringMass", "Pid"):
            own, saved = used(kind)
            gc.collect()
            self.assertIsNotNone(own())
            del saved
            gc.collect()
            self.assertIsNone(own(), kind)

    def test_sessions_of_classes_leave_no_objects(self):
        def session():
            class Own(spring_mass.Pid):
                """A law of a cell of a notebook."""

            with hil.Session(SPRING, law=law(Own)) as session:
                session.step()

        def count():
            gc.collect()
            return len(gc.get_objects())

        session()
        before = count()
        for _ in range(100):
            session()
        self.assertLess(count() - before, 100)

    # Checks, faults, tuning, checkpoints, connections and instruments are those of Rust.

    def scenario(self):
        """Writes a scenario that uses all of them, with a law that is connected to other names and units."""
        text = SPRING.read_text().partition("\n[[stimuli]]")[0]
        pathlib.Path("whole.toml").write_text(text + CONNECTED)
        return "whole.toml"

    def test_all_that_a_scenario_has_acts_on_classes_as_on_rust(self):
        path = self.scenario()
        both = {"plant": spring_mass.SpringMass, "law": spring_mass.Pid}
        digests = []
        for sides in ({}, {"plant": spring_mass.SpringMass}, {"law": spring_mass.Pid}, both):
            with hil.Session(path, **sides) as session:
                session.step(700)
                session.inject("bias", "measured.position_m", 1e-3)
                session.inject("push", force_n=0.1, at=0.9)
                session.set("plant.parameters.mass_kg", 1.1, ramp=0.1)
                saved = session.save()
                session.step(300)
                session.restore(saved)
                with self.assertRaisesRegex(hil.UsageError, "(?s)mass_kg"):
                    session.set("plant.parameters.mass_kg", -1.0)
                with self.assertRaisesRegex(hil.UsageError, "(?s)positon_m.*nearest"):
                    session.inject("bias", "measured.positon_m", 1)
                session.step(1000)
                if sides == both:
                    self.assertEqual(session.digest, digests[0])
                    # The example's law has other rules for new gains than the one in Rust.
                    session.set("controller.pid.proportional_n_per_m", 250.0, ramp=0.1)
                    session.step_to()
                    pathlib.Path("repeats.toml").write_text(session.scenario())
                digests.append(session.digest)
        self.assertEqual(len(set(digests[:3])), 1, digests)
        programs = {"plant.program": SOURCE, "controller.program": SOURCE}
        run = hil.run("repeats.toml", set=programs, options=["--checkpoint-at", "2.25"])
        self.assertEqual(run.digest, digests[3])
        self.assertIn(digests[3], self.hil("run", "--from", run.folder / "checkpoint-2250", code=1))
        described = self.hil("describe", SOURCE)
        for name in ("spring-mass", "stiffness_n_per_m", "stiffness-loss", "position_m"):
            self.assertIn(name, described)

    # Processes of their own.

    def side(self, before="", after=""):
        """Writes the example with lines before it and behind it, and a scenario that names it for both sides."""
        pathlib.Path("side.py").write_text(f"{before}{SOURCE.read_text().replace('from __future__ import annotations', '')}{after}")
        text = SPRING.read_text()
        for table in ("[plant]\n", "[controller]\n"):
            text = text.replace(table, f'{table}program = "side.py"\n')
        pathlib.Path("side.toml").write_text(text)

    def test_modules_that_others_could_have_written_are_not_imported(self):
        pathlib.Path("gravity.py").write_text("G = 9.81\n")
        pathlib.Path("package").mkdir()
        pathlib.Path("package/__init__.py").write_text("")
        pathlib.Path("package/inner.py").write_text("")
        self.side("import gravity\nimport package.inner\nimport json\n")
        self.assertTrue(hil.run("side.toml", out="first").passed)
        text = "the module `{}` is not imported: {} can be written by others (mode {})"
        for name, path, mode in [
            ("gravity", "gravity.py", 0o666),
            ("package", "package", 0o777),
            ("package.inner", "package/inner.py", 0o662),
        ]:
            before = os.stat(path).st_mode & 0o7777
            os.chmod(path, mode)
            with self.subTest(path):
                with self.assertRaises(hil.UsageError) as refused:
                    hil.run("side.toml")
                self.assertIn(text.format(name, os.path.abspath(path), f"{mode:04o}"), str(refused.exception))
                # Whoever names the file says that it is trusted.
                run = hil.run(SPRING, plant_bin="side.py", controller_bin="side.py", record=False)
                self.assertTrue(run.passed)
            os.chmod(path, before)
        # What Python has compiled, which it takes in place of the text.
        compiled = py_compile.compile("gravity.py")
        os.chmod(compiled, 0o666)
        with self.assertRaisesRegex(hil.UsageError, "the module `gravity` is not imported.*pyc can be written"):
            hil.run("side.toml")
        os.chmod(compiled, 0o644)
        # During the run.
        self.side(after="\n\ndef begin(self, setup):\n    import late\n\n\nPid.__init__ = begin\n")
        pathlib.Path("late.py").write_text("")
        os.chmod("late.py", 0o666)
        with self.assertRaisesRegex(hil.CommandError, "the module `late` is not imported"):
            hil.run("side.toml")

    def test_a_beginning_without_an_end_is_bounded(self):
        # At the check, and only in the run.
        for condition, text in [
            ("True", "side.py --check: no answer within 10 s"),
            ("'--session' in __import__('sys').argv", "controller did not say hello within 1 s"),
        ]:
            self.side(after=f"\n\ndef loop(self, setup):\n    while {condition}:\n        pass\n\n\nPid.__init__ = loop\n")
            with self.subTest(condition), self.assertRaisesRegex(hil.InfrastructureError, text):
                hil.run("side.toml", wait_limit_s=1)

    def test_a_killed_interpreter_leaves_neither_processes_nor_memory(self):
        self.side()
        script = (
            "import hil, os\n"
            "session = hil.Session('side.toml')\n"
            "session.step(10)\n"
            "print(session._native._name, session._native._process.pid, flush=True)\n"
            "os.kill(os.getpid(), 9)\n"
        )
        environment = {**os.environ, "PYTHONPATH": str(CLONE / "tools" / "python")}
        killed = subprocess.run([sys.executable, "-c", script], env=environment, stdout=subprocess.PIPE, text=True)
        self.assertEqual(killed.returncode, -signal.SIGKILL)
        name, pid = killed.stdout.split()
        own = os.fsencode(os.path.abspath("side.py"))

        def left():
            processes = []
            for place in pathlib.Path("/proc").glob("[0-9]*/cmdline"):
                with contextlib.suppress(OSError):
                    words = place.read_bytes()
                    if own in words or name.encode() in words:
                        processes.append(words)
            folders = [folder for folder in pathlib.Path("/dev/shm").glob("hil*/**/*") if name in str(folder)]
            return processes + folders

        deadline = time.monotonic() + 60
        while left():
            self.assertLess(time.monotonic(), deadline, left())
            time.sleep(0.05)


CONNECTED = """
[[stimuli]]
target = "goal_mm"
unit = "mm"
kind = "step"
at_s = 0.5
after = 10.0

[[requirements]]
name = "settles"
formula = "always[4s,5s](abs(truth.position_m - 0.01) < 2e-4)"

[[connect]]
law = "reference.position_m"
plant = "reference.goal_mm"

[[sensors]]
signal = "position_m"
noise_sigma = 1e-5
bits = 12
range = [-0.05, 0.05]

[[actuators]]
signal = "force_n"
dead_time_s = "3 ms"
rate_limit_per_s = "2 N/ms"

[[changes]]
at_s = 0.4
ramp_s = 0.3
set.plant.parameters.mass_kg = 1.5

[[faults]]
kind = "scale"
at_s = 0.6
effects = [{ target = "parameter.stiffness_n_per_m", factor = 0.5 }]

[[faults]]
kind = "message-loss"
at_s = 1.2
duration_s = 0.1
effects = [{ target = "link.sample", probability = 0.5 }]
"""


if __name__ == "__main__":
    unittest.main()
