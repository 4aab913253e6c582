"""Texts of exceptions of plants and laws."""

import pathlib
import sys
import unittest

CLONE = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(CLONE / "tools" / "python"))

from hil import tracebacks


class Tracebacks(unittest.TestCase):
    def test_no_control_character_of_an_exception_reaches_the_terminal(self):
        for character, escaped in [
            ("\x1b", r"\x1b"),
            ("\x07", r"\x07"),
            ("\x00", r"\x00"),
            ("\x9b", r"\x9b"),
            ("\u202e", r"\u202e"),
            ("\udcff", r"\udcff"),
        ]:
            try:
                exec(compile("raise KeyError(Text())", "plant\x1b.py", "exec"), {"Text": lambda: Text(character)})
            except KeyError as error:
                line, text = tracebacks.describe(error)
            for described in (line, text):
                self.assertNotIn(character, described)
                self.assertIn(f"a {escaped}[31m é", described)
                self.assertIn(r"plant\x1b.py", described)
            self.assertIn("a \\r b\n\tc", tracebacks.text(ValueError("a \r b\n\tc")))


class Text(str):
    """A text whose quotation has the character itself."""

    def __repr__(self):
        return f"a {self}[31m é"


if __name__ == "__main__":
    unittest.main()
