"""Arguments that a session refuses, each named with its value.

    HIL_BIN=target/release/hil python -m unittest test_session_arguments

Skipped without HIL_BIN.
"""

import math
import os
import pathlib
import sys
import unittest

CLONE = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(CLONE / "tools" / "python"))

import hil
import numpy as np

PROGRAM = os.environ.get("HIL_BIN")
SPRING = CLONE / "scenarios" / "spring-mass.toml"
KEY = "reference.position_m"


@unittest.skipUnless(PROGRAM, "HIL_BIN is not set")
class Arguments(unittest.TestCase):
    def setUp(self):
        os.environ["HIL_BIN"] = os.path.abspath(PROGRAM)

    def check(self, refusals):
        for call, kind, text in refusals:
            with self.subTest(text=text), self.assertRaisesRegex(kind, text):
                call()

    def test_numbers_of_changes_are_finite(self):
        with hil.Session(SPRING) as session:
            self.check(
                [
                    (lambda: session.set(KEY, math.nan), ValueError, f"nan cannot be the value of `{KEY}`"),
                    (lambda: session.set({KEY: -math.inf}), ValueError, f"-inf cannot be the value of `{KEY}`"),
                    (lambda: session.set(KEY, 10**400), ValueError, f"inf cannot be the value of `{KEY}`"),
                    (lambda: session.set(KEY, "1"), TypeError, f"'1' cannot be the value of `{KEY}`; use a number"),
                    (lambda: session.set(KEY, b"1"), TypeError, f"b'1' cannot be the value of `{KEY}`"),
                    (lambda: session.set(KEY, True), TypeError, f"True cannot be the value of `{KEY}`"),
                    (lambda: session.set(KEY, np.bool_(True)), TypeError, f"cannot be the value of `{KEY}`"),
                    (lambda: session.set(KEY, np.ones(2)), TypeError, f"cannot be the value of `{KEY}`"),
                    (lambda: session.set(KEY, 1, ramp=math.nan), ValueError, "nan cannot be the value of `ramp`"),
                    (lambda: session.set(KEY, 1, at=math.inf), ValueError, "inf cannot be the value of `at`"),
                    (lambda: session.set(KEY, 1, at="soon"), TypeError, "'soon' cannot be the value of `at`"),
                    (lambda: session.release(KEY, at=math.nan), ValueError, "nan cannot be the value of `at`"),
                    (lambda: session.release(3), TypeError, "3 cannot be released"),
                    (lambda: session.set({3: 4}), TypeError, "{3: 4} cannot be set"),
                    (lambda: session.set([1]), TypeError, r"\[1\] cannot be set"),
                ]
            )
            session.step_to()
            with hil.Session(SPRING) as other:
                other.step_to()
                self.assertEqual(session.digest, other.digest)

    def test_a_fault_to_clear_is_one_or_its_number(self):
        with hil.Session(SPRING) as session:
            refused = ("foo", -1, True, 1.0, 2**32)
            text = "is no fault to clear; use a fault that inject"
            self.check([(lambda one=one: session.clear(one), TypeError, f"^{one!r} {text}") for one in refused])
            (fault,) = session.inject("bias", "measured.position_m", 1e-3)
            self.assertEqual(session.clear(fault.id), (fault.id,))

    def test_other_kinds_of_arguments_are_refused_with_what_is_expected(self):
        with hil.Session(SPRING) as session:
            text = r"`set` is \['run.seed=1'\]; use a mapping"
            values = ["run.seed=1"]
            self.check(
                [
                    (lambda: session.restore(None), TypeError, r"None is no saved state; use what save\(\) returned"),
                    (lambda: hil.Session(SPRING, set=values), TypeError, text),
                    (lambda: hil.run(SPRING, set=values), TypeError, text),
                    (lambda: hil.evaluate(SPRING, [{}], set=values), TypeError, text),
                    (lambda: hil.evaluate(SPRING, 3, ["run.seed"]), TypeError, "`points` is 3; use points"),
                    (lambda: hil.evaluate(SPRING, [[1, 2]], ["run.seed"]), ValueError, "2 values for 1 key$"),
                    (lambda: session.step(-1), OverflowError, "-1 is no number of steps"),
                    (lambda: session.step(2**64), OverflowError, f"{2**64} is no number of steps"),
                    (lambda: session.reset(-1), OverflowError, "-1 is no seed"),
                    (lambda: session.observe([3]), TypeError, "3 is no name of a signal"),
                    (lambda: iter(session), TypeError, "'Session' object is not iterable"),
                ]
            )
            self.assertIn("truth.position_m", session)


if __name__ == "__main__":
    unittest.main()
