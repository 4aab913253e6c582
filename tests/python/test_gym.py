"""Environments of Gymnasium, judged by its checker, by closed forms and by runs of the command line.

    HIL_BIN=target/release/hil python -m unittest test_gym

Skipped without HIL_BIN or without gymnasium.
"""

import importlib.util
import math
import os
import pathlib
import signal
import subprocess
import sys
import tempfile
import time
import unittest
import warnings

CLONE = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(CLONE / "tools" / "python"))

import hil
import numpy as np

PROGRAM = os.environ.get("HIL_BIN")
SPRING = CLONE / "scenarios" / "spring-mass.toml"
POSITION = ["truth.position_m", "truth.velocity_mps"]
IS_POSSIBLE = PROGRAM and importlib.util.find_spec("gymnasium")
if not IS_POSSIBLE:
    print("skipped: test_gym needs HIL_BIN and gymnasium")


@unittest.skipUnless(IS_POSSIBLE, "HIL_BIN is not set, or gymnasium is missing")
class Environments(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory(prefix="hil test ")
        self.addCleanup(folder.cleanup)
        self.addCleanup(os.chdir, os.getcwd())
        os.environ["HIL_BIN"] = os.path.abspath(PROGRAM)
        os.chdir(folder.name)

    def env(self, **arguments):
        import hil.gym

        defaults = {"observe": POSITION, "act": {"command.force_n": (-5.0, 5.0)}, "reward": "settles"}
        env = hil.gym.Env(arguments.pop("scenario", SPRING), **{**defaults, **arguments})
        self.addCleanup(env.close)
        return env

    def episode(self, env, action, seed=1):
        """Runs an episode with one action; returns its rewards, its last observation, and the results of the end."""
        env.reset(seed=seed)
        rewards = []
        while True:
            observation, reward, terminated, truncated, info = env.step(action)
            rewards.append(reward)
            if terminated or truncated:
                return rewards, observation, terminated, truncated, info

    def test_the_checker_of_gymnasium_has_no_objection(self):
        from gymnasium.utils.env_checker import check_env

        for arguments in (
            {},
            {"act": {"reference.position_m": (0.0, 0.02)}, "steps_per_action": 50},
            {"act": {"controller.pid.proportional_n_per_m": (100.0, 900.0)}, "reward": "tracking_error_m"},
        ):
            with self.subTest(**arguments), warnings.catch_warnings():
                warnings.simplefilter("error")
                # It recommends limits of observations, which signals do not have, and actions from -1 to 1.
                warnings.filterwarnings("ignore", message=".*(infinity|render|Box observation|symmetric and normalized).*")
                check_env(self.env(**arguments), skip_render_check=True)

    def test_a_constant_force_moves_the_mass_as_the_closed_form_does(self):
        mass_kg, damping, stiffness, force_n = 1.0, 2.0, 100.0, 3.0
        decay = damping / (2 * mass_kg)
        frequency = math.sqrt(stiffness / mass_kg - decay**2)
        env = self.env()
        env.reset(seed=1)
        for step in range(1, 2001):
            observation, *_ = env.step([force_n])
            # The force of an action acts from its step on; step 0 had none.
            time_s = (step - 1) * 1e-3
            cosine, sine = math.cos(frequency * time_s), math.sin(frequency * time_s)
            fading = math.exp(-decay * time_s)
            position_m = force_n / stiffness * (1 - fading * (cosine + decay / frequency * sine))
            speed_m_s = force_n / stiffness * fading * (decay**2 / frequency + frequency) * sine
            self.assertAlmostEqual(observation[0], position_m, delta=1e-9)
            self.assertAlmostEqual(observation[1], speed_m_s, delta=1e-8)

    def test_the_return_of_an_episode_is_the_robustness_that_the_command_line_judges(self):
        gain = "controller.pid.integral_n_per_m_s"
        run = hil.run(SPRING, link="in-process", set={gain: 150.0})
        env = self.env(set={gain: 150.0}, act={gain: (0.0, 1000.0)})
        rewards, _, terminated, truncated, info = self.episode(env, [150.0])
        self.assertAlmostEqual(sum(rewards), run.verdicts["settles"].robustness, delta=1e-12)
        self.assertEqual((terminated, truncated, info["verdict"]), (True, False, "fail"))
        breaker = self.env(set={gain: 150.0}, act={gain: (0.0, 1000.0)}, reward="-settles")
        opposite = self.episode(breaker, [150.0])[0]
        self.assertEqual(opposite, [-reward for reward in rewards])

    def test_an_episode_is_truncated_at_the_end_and_repeated_by_the_command_line(self):
        target = "reference.position_m"
        env = self.env(act={target: (0.0, 0.02)}, reward=lambda session: -abs(session["tracking_error_m"]))
        rewards, _, terminated, truncated, info = self.episode(env, [0.01])
        self.assertEqual((len(rewards), terminated, truncated), (4999, False, True))
        pathlib.Path("repeats.toml").write_text(env.session.scenario())
        run = hil.run("repeats.toml", link="in-process")
        self.assertEqual((run.digest, run.verdict), (info["digest"], info["verdict"]))
        self.assertEqual(rewards, (-np.abs(run["tracking_error_m"][1:5000])).tolist())

    def test_a_run_that_diverges_terminates_the_episode(self):
        env = self.env(act={"command.force_n": (-1e9, 1e9)})
        *_, terminated, truncated, info = self.episode(env, [1e9])
        self.assertEqual((terminated, truncated, info["verdict"]), (True, False, "aborted"))
        self.assertIn("velocity_mps", info["reason"])

    def test_a_seed_repeats_the_noise_of_an_episode(self):
        pathlib.Path("noisy.toml").write_text(
            SPRING.read_text()
            + '\n[[faults]]\nkind = "noise"\nat_s = 0.0\n'
            + '[[faults.effects]]\ntarget = "measured.position_m"\nstandard_deviation = 1e-4\n'
        )
        env = self.env(scenario="noisy.toml", observe=["measured.position_m"])

        def beginning(seed):
            env.reset(seed=seed)
            return [env.step([1.0])[0].tolist() for _ in range(20)]

        first = beginning(5)
        self.assertNotEqual(first, beginning(6))
        self.assertEqual(first, beginning(5))
        self.assertNotEqual(beginning(None), beginning(None))

    def test_wrong_arguments_name_what_is_meant(self):
        for arguments, text in (
            ({"observe": ["truth.positon_m"]}, "truth.position_m"),
            ({"act": ["command.force"]}, "command.force_n"),
            ({"act": {"command.force_n": (5, -5)}}, "limits of `command.force_n`"),
            ({"act": ["reference.position_m"]}, "has no range"),
            ({"reward": "setles"}, "settles"),
            ({"steps_per_action": 0}, "one step or several"),
            ({"steps_per_action": 2.5}, "one step or several"),
            ({"reward": None}, "reward is None"),
            ({"act": "command.force"}, "command.force_n"),
            ({"act": {"command.force_n": 5}}, "limits of `command.force_n` are 5; use two numbers"),
            ({"act": {"command.force_n": (0, math.nan)}}, "limits of `command.force_n`"),
            ({"law": object}, "takes the place of the law"),
        ):
            with self.subTest(**arguments), self.assertRaisesRegex(hil.Error, text):
                self.env(**arguments)
        env = self.env()
        with self.assertRaisesRegex(hil.SessionError, "reset"):
            env.step([0.0])
        env.reset()
        for action, text in (([0.0, 1.0], "shape"), ([math.nan], "no number"), (0.0, "shape")):
            with self.subTest(action), self.assertRaisesRegex(ValueError, text):
                env.step(action)
        with self.assertRaisesRegex(hil.SessionError, "no options"):
            env.reset(options={"mass": 2})
        self.assertTrue(np.isfinite(env.step(np.float32([7.0]))[0]).all())

    def test_a_reward_that_is_no_number_is_refused_by_name(self):
        def score(session):
            return rewards.pop()

        for reward in (math.nan, None, "1.0", [1.0], np.array([1.0])):
            rewards, env = [reward], self.env(reward=score)
            env.reset(seed=1)
            with self.subTest(reward), self.assertRaisesRegex(hil.SessionError, r"function `.*score` is .* at step 1"):
                env.step([0.0])
        rewards = [np.float32(0.5), 2, np.float64(1.5)]
        env = self.env(reward=score)
        env.reset(seed=1)
        self.assertEqual([env.step([0.0])[1] for _ in range(3)], [1.5, 2.0, 0.5])
        # A derived signal without a value: the quotient of two zeros.
        pathlib.Path("none.toml").write_text(
            SPRING.read_text() + '\n[[derived]]\nname = "none"\nexpression = "(truth.position_m - truth.position_m) / (truth.position_m - truth.position_m)"\n'
        )
        env = self.env(scenario="none.toml", reward="-none")
        env.reset(seed=1)
        with self.assertRaisesRegex(hil.SessionError, "the reward by the signal `none` is nan at step 1"):
            env.step([0.0])

    def test_more_changes_than_a_run_takes_are_foreseen(self):
        values = {"run.duration_s": 20.001, "derived": [], "metrics": [], "requirements": [], "plots": []}
        arguments = {"set": values, "act": {"reference.position_m": (0.0, 0.02)}, "reward": "truth.position_m"}
        with self.assertRaisesRegex(hil.SessionError, "20001 steps.*10000 changes.*steps_per_action=3 or more"):
            self.env(**arguments, steps_per_action=2)
        # Each action is another one.
        env, actions, is_over = self.env(**arguments, steps_per_action=3), 0, False
        env.reset(seed=1)
        while not is_over:
            actions += 1
            *_, is_over, _ = env.step([1e-6 * actions])
        self.assertEqual(actions, 6667)

    def test_environments_of_which_one_is_killed_all_end_with_its_name(self):
        import hil.gym

        act = {"command.force_n": (-5.0, 5.0)}
        for use in ("step", "reset", "call"):
            several = hil.gym.make_vector(3, SPRING, observe=POSITION, act=act, reward="settles")
            several.reset(seed=1)
            processes = list(several.processes)
            os.kill(processes[1].pid, signal.SIGKILL)
            calls = {"step": lambda: several.step(np.zeros((3, 1))), "reset": several.reset, "call": lambda: several.call("close")}
            with self.subTest(use), self.assertRaisesRegex(hil.SessionError, "^environment 1 was killed by SIGKILL; all"):
                calls[use]()
            self.assertEqual([process.is_alive() for process in processes], [False] * 3)
            several.close()
            with self.assertRaisesRegex(Exception, "close"):
                several.step(np.zeros((3, 1)))

    def test_environments_end_with_a_parent_that_is_killed(self):
        script = (
            "import os, hil.gym\n"
            "if __name__ == '__main__':\n"
            f"    several = hil.gym.make_vector(2, {str(SPRING)!r}, observe={POSITION!r}, act={{'command.force_n': (-5, 5)}}, reward='settles')\n"
            "    several.reset(seed=1)\n"
            "    print(*(process.pid for process in several.processes), flush=True)\n"
            "    os.kill(os.getpid(), 9)\n"
        )
        pathlib.Path("killed.py").write_text(script)
        environment = {**os.environ, "PYTHONPATH": str(CLONE / "tools" / "python")}
        killed = subprocess.run([sys.executable, "killed.py"], env=environment, capture_output=True, text=True, check=False)
        pids = [int(word) for word in killed.stdout.split()]
        self.assertEqual((killed.returncode, len(pids)), (-signal.SIGKILL, 2))
        deadline = time.monotonic() + 60
        while any(pathlib.Path(f"/proc/{pid}").exists() for pid in pids):
            self.assertLess(time.monotonic(), deadline)
            time.sleep(0.05)
        # Python itself says that semaphores were left, which it then removes.
        self.assertNotIn("Traceback", killed.stderr)

    def test_environments_that_are_closed_or_left_open_say_nothing(self):
        script = (
            "import sys, numpy, hil.gym\n"
            "if __name__ == '__main__':\n"
            f"    several = hil.gym.make_vector(2, {str(SPRING)!r}, observe={POSITION!r}, act={{'command.force_n': (-5, 5)}}, reward='settles')\n"
            "    several.reset(seed=1)\n"
            "    several.step(numpy.zeros((2, 1)))\n"
            "    if sys.argv[1] == 'close':\n"
            "        several.close()\n"
        )
        pathlib.Path("ends.py").write_text(script)
        environment = {**os.environ, "PYTHONPATH": str(CLONE / "tools" / "python")}
        for end in ("close", "leave"):
            with self.subTest(end):
                ended = subprocess.run([sys.executable, "ends.py", end], env=environment, capture_output=True, text=True, check=False)
                self.assertEqual((ended.returncode, ended.stdout, ended.stderr), (0, "", ""))

    def test_environments_in_processes_give_what_one_gives(self):
        import hil.gym

        env = self.env()
        expected, _ = env.reset(seed=3)
        several = hil.gym.make_vector(
            2, SPRING, observe=POSITION, act={"command.force_n": (-5.0, 5.0)}, reward="settles"
        )
        try:
            observations, _ = several.reset(seed=[3, 3])
            self.assertEqual(observations.tolist(), [expected.tolist()] * 2)
            for _ in range(3):
                expected, *_ = env.step([2.0])
                observations, *_ = several.step(np.array([[2.0], [2.0]]))
            self.assertEqual(observations.tolist(), [expected.tolist()] * 2)
        finally:
            several.close()


if __name__ == "__main__":
    unittest.main()
