"""The comparison of benches with their baselines finds a ratio outside its band, and says so.

    python -m unittest test_ratios
"""

import contextlib
import importlib.machinery
import importlib.util
import io
import json
import pathlib
import tempfile
import unittest

ROOT = pathlib.Path(__file__).resolve().parent.parent.parent


def program():
    loader = importlib.machinery.SourceFileLoader("ratios", str(ROOT / ".ci/ratios"))
    module = importlib.util.module_from_spec(importlib.util.spec_from_loader("ratios", loader))
    loader.exec_module(module)
    return module


RATIO = {"bench": "exchange", "place": "cores", "row": "link", "ratio": "to_raw", "baseline": 2.0, "band": 1.25}


def line(place, value):
    rows = [{"exchange": "raw", "to_raw": 1.0}, {"exchange": "link", "to_raw": value}]
    return json.dumps({"bench": "exchange", "place": place, "rounds": 5, "exchanges": rows})


class Ratios(unittest.TestCase):
    def compare(self, text, *arguments):
        with tempfile.TemporaryDirectory() as folder:
            folder = pathlib.Path(folder)
            file = folder / "ratios.json"
            file.write_text(json.dumps([RATIO]))
            (folder / "exchange.txt").write_text(text)
            output = io.StringIO()
            with contextlib.redirect_stdout(output):
                code = program().main([*arguments, str(folder)], file)
            return code, output.getvalue(), json.loads(file.read_text())

    def test_a_ratio_within_its_band_passes_and_one_on_either_side_fails(self):
        for value, expected in [(1.59, 1), (1.61, 0), (2.0, 0), (2.49, 0), (2.51, 1)]:
            text = "a table\n" + line("both on core 0", 9.0) + "\n" + line("cores 0 and 1", value) + "\n"
            code, output, _ = self.compare(text)
            self.assertEqual(code, expected, output)
            self.assertIn(f"exchange, cores, link, to_raw: {value:.2f}", output)

    def test_a_ratio_that_was_not_measured_fails_unless_its_bench_says_why(self):
        self.assertEqual(self.compare("")[0], 1)
        self.assertEqual(self.compare(line("both on core 0", 2.0))[0], 1)
        code, output, _ = self.compare("only one core: no numbers for two\n")
        self.assertEqual((code, output.split()[0]), (0, "skipped"))

    def test_what_was_measured_becomes_the_baseline_on_request_alone(self):
        text = line("cores 0 and 1", 3.456)
        self.assertEqual(self.compare(text)[2][0]["baseline"], 2.0)
        self.assertEqual(self.compare(text, "--keep")[2][0]["baseline"], 3.46)

    def test_every_kept_ratio_is_one_that_its_bench_prints(self):
        for ratio in json.loads((ROOT / "tests/benches/ratios.json").read_text()):
            folder = {"c_twin": "c"}.get(ratio["bench"], ratio["bench"])
            source = (ROOT / "tests/benches" / folder / "main.rs").read_text()
            self.assertIn(f'"{ratio["ratio"]}":', source)
            self.assertGreater(ratio["band"], 1.0)


if __name__ == "__main__":
    unittest.main()
