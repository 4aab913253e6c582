"""Random scenarios with faults: a session has the digest of the command line.

    HIL_BIN=target/release/hil python -m unittest test_random_sessions

Skipped without HIL_BIN.
"""

import json
import os
import pathlib
import random
import sys
import tempfile
import unittest

CLONE = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(CLONE / "tools" / "python"))

import hil
from random_faults import event, fault

PROGRAM = os.environ.get("HIL_BIN")
COUNT = 20
#: Scenario, its duration, and the size of the values of its signals.
SCENARIOS = [("spring-mass", 2.0, 1e-3), ("spring-breaks", 2.0, 1e-3), ("severe-leakage", 0.2, 1e-3)]


@unittest.skipUnless(PROGRAM, "HIL_BIN is not set")
class RandomSessions(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory(prefix="hil test ")
        self.addCleanup(folder.cleanup)
        self.addCleanup(os.chdir, os.getcwd())
        os.environ["HIL_BIN"] = os.path.abspath(PROGRAM)
        os.chdir(folder.name)

    def drawn(self, seed):
        """Draws a scenario whose faults are accepted: its file, its values and its generator."""
        generator = random.Random(seed)
        name, duration_s, size = SCENARIOS[seed % len(SCENARIOS)]
        path = CLONE / "scenarios" / f"{name}.toml"
        values = {"run.duration_s": duration_s, "run.seed": seed, "metrics": [], "requirements": []}
        with hil.Session(path, set={**values, "faults": []}) as session:
            possible = json.loads(session._native.request('{"request": "possible"}'))
        while True:
            faults = [event(generator, possible, size, duration_s) for _ in range(generator.randint(1, 4))]
            try:
                hil.Session(path, set={**values, "faults": faults}).close()
            except hil.UsageError:
                continue  # such as a target on which the kind does not act
            return path, {**values, "faults": faults}, possible, size, generator

    def test_random_scenarios_with_faults_have_the_digest_of_the_command_line(self):
        digests = set()
        for seed in range(COUNT):
            path, values, *_ = self.drawn(seed)
            link = "iceoryx2" if seed % 5 == 0 else "in-process"
            run = hil.run(path, set=values, link=link, record=False)
            with hil.Session(path, set=values) as session, self.subTest(seed=seed, faults=values["faults"]):
                session.step_to()
                result = session.result()
                self.assertEqual((result.digest, result.reason), (run.digest, run.reason))
                digests.add(result.digest)
        self.assertEqual(len(digests), COUNT)

    def test_random_live_faults_saves_and_restores_are_repeated_by_the_command_line(self):
        accepted = 0
        for seed in range(100, 100 + COUNT):
            path, values, possible, size, generator = self.drawn(seed)
            with hil.Session(path, set=values) as session, self.subTest(seed=seed):
                for _ in range(3):
                    session.step(generator.randint(1, session.steps // 5))
                    if session.is_over:
                        break
                    kind, target, parameters = fault(generator, possible, size)
                    words = [target["target"]] if "target" in target else []
                    keys = {**parameters, **{key: number for key, number in target.items() if key != "target"}}
                    try:
                        session.inject(kind, *words, **keys)
                        accepted += 1
                    except hil.UsageError:
                        pass
                    saved, digest = session.save(), session.digest
                    session.step(generator.randint(1, 50))
                    session.restore(saved)
                    self.assertEqual(session.digest, digest)
                session.step_to()
                pathlib.Path("repeats.toml").write_text(session.scenario())
                run = hil.run("repeats.toml", link="in-process", record=False)
                self.assertEqual((session.digest, session.result().reason), (run.digest, run.reason))
                session.reset()
                session.step_to()
                run = hil.run(path, set=values, link="in-process", record=False)
                self.assertEqual((session.digest, session.result().reason), (run.digest, run.reason))
        self.assertGreater(accepted, COUNT)


if __name__ == "__main__":
    unittest.main()
