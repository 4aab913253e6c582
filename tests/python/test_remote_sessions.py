"""Sessions in two processes: their ends, and what they leave behind.

    HIL_BIN=target/release/hil python -m unittest test_remote_sessions

Skipped without HIL_BIN.
"""

import os
import pathlib
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

PROGRAM = os.environ.get("HIL_BIN")
EXAMPLE = CLONE / "examples" / "python-plant"
#: Step at which the plant breaks.
BREAK = 200


@unittest.skipUnless(PROGRAM, "HIL_BIN is not set")
class RemoteSessions(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory(prefix="hil test ")
        self.addCleanup(folder.cleanup)
        self.addCleanup(os.chdir, os.getcwd())
        os.environ["HIL_BIN"] = os.path.abspath(PROGRAM)
        os.chdir(folder.name)

    def broken(self, statement):
        """Returns a scenario whose plant executes a statement at step 200."""
        head, body = (EXAMPLE / "spring_mass.py").read_text().split("    def advance(", 1)
        line, rest = body.split("\n", 1)
        text = f"{head}    def advance({line}\n        if interval.start_s >= {BREAK / 1000}:\n            {statement}\n{rest}"
        pathlib.Path("broken.py").write_text(text.replace("import math\n", "import math, os, pathlib, time\n", 1))
        scenario = (EXAMPLE / "spring-mass.toml").read_text().replace("spring_mass.py", "broken.py")
        pathlib.Path("broken.toml").write_text(scenario)
        return "broken.toml"

    def check_aborted(self, session):
        """Checks that a session is over, with its results."""
        self.assertEqual((session.step_index, session.is_over, session.steps), (BREAK, True, 5000))
        result = session.result()
        self.assertEqual((result.verdict, result.passed, result.steps), ("aborted", False, BREAK))
        self.assertEqual((dict(session.verdicts), session.digest), (dict(result.verdicts), result.digest))
        self.assertEqual(session.verdicts["settles"].verdict, "undecided")
        self.assertIn("spring-mass", session.scenario())
        with self.assertRaisesRegex(hil.SessionError, f"over since step {BREAK}"):
            session.step()

    def test_a_session_whose_plant_fails_is_over_with_its_results(self):
        for statement in ("raise ValueError('no spring')", "os.kill(os.getpid(), 9)"):
            for end_s in (1.0, float("inf")):
                with hil.Session(self.broken(statement)) as session:
                    with self.assertRaises(hil.InfrastructureError) as caught:
                        session.step_to(end_s)
                    folder = session._native._folder
                    self.check_aborted(session)
                self.assertFalse(os.path.exists(folder))
                text = str(caught.exception)
                self.assertIn("no spring" if "spring" in statement else "plant was killed by SIGKILL", text)
                # The end of the log is in the text, and the folder is gone.
                self.assertNotIn(folder, text)
                self.assertNotIn("hil resume", text)
                if "spring" in statement:
                    self.assertIn("plant.log:\nTraceback", text)

    def test_ctrl_c_ends_a_session_whose_plant_hangs(self):
        scenario = self.broken("pathlib.Path('hangs').touch(); time.sleep(1e6)")

        def interrupt():
            while not os.path.exists("hangs"):
                time.sleep(0.01)
            os.kill(os.getpid(), signal.SIGINT)

        for end_s in (1.0, float("inf")):
            with hil.Session(scenario) as session:
                threading.Thread(target=interrupt).start()
                with self.assertRaises(KeyboardInterrupt):
                    session.step_to(end_s)
                self.check_aborted(session)
            os.remove("hangs")

    def test_the_folder_of_a_killed_python_is_removed_by_a_later_session(self):
        plant = pathlib.Path(os.environ["HIL_BIN"]).with_name("plant-process")
        scenario, values = CLONE / "scenarios" / "spring-mass.toml", {"plant.program": plant}
        environment = {**os.environ, "PYTHONPATH": str(CLONE / "tools" / "python")}
        for number in (signal.SIGTERM, signal.SIGKILL):
            script = (
                "import hil, os\n"
                f"session = hil.Session({str(scenario)!r}, set={{'plant.program': {str(plant)!r}}})\n"
                "session.step(10)\n"
                "print(session._native._folder, flush=True)\n"
                f"os.kill(os.getpid(), {int(number)})\n"
            )
            with hil.Session(scenario, set=values) as other:
                output = subprocess.run([sys.executable, "-c", script], env=environment, capture_output=True, text=True)
                self.assertEqual(output.returncode, -number, output.stderr)
                (folder,) = output.stdout.splitlines()
                # That of a session that is open stays.
                self.assertTrue(os.path.exists(other._native._folder))
                # Once the processes of the run have ended as well.
                deadline = time.monotonic() + 60
                while os.path.exists(folder):
                    self.assertLess(time.monotonic(), deadline)
                    hil.Session(scenario, set=values).close()
                self.assertTrue(os.path.exists(other._native._folder))
                other.step_to()
                self.assertTrue(other.result().passed)


if __name__ == "__main__":
    unittest.main()
