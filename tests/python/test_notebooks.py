"""The notebooks of the book, executed by nbconvert.

    HIL_BIN=target/release/hil python -m unittest test_notebooks

Skipped without HIL_BIN.
"""

import json
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile
import unittest

CLONE = pathlib.Path(__file__).resolve().parents[2]
PROGRAM = os.environ.get("HIL_BIN")
README = (CLONE / "README.md").read_text()


@unittest.skipUnless(PROGRAM, "HIL_BIN is not set")
class Notebooks(unittest.TestCase):
    def test_every_notebook_of_the_book_runs_to_its_end(self):
        notebooks = sorted((CLONE / "docs/notebooks").glob("*.ipynb"))
        self.assertTrue(notebooks)
        for notebook in notebooks:
            with self.subTest(notebook.name), tempfile.TemporaryDirectory(prefix="hil test ") as folder:
                source = json.loads(notebook.read_text())
                code = [cell for cell in source["cells"] if cell["cell_type"] == "code"]
                self.assertTrue(all(not cell["outputs"] for cell in code), "outputs are not committed")
                executed = self.execute(notebook, folder)
                results = [cell["outputs"] for cell in executed["cells"] if cell["cell_type"] == "code"]
                self.assertEqual(len(results), len(code))
                data = [output.get("data", {}) for outputs in results for output in outputs]
                self.assertTrue(any("image/png" in one for one in data), "no plot")
                self.assertTrue(any("<svg" in "".join(one.get("text/html", "")) for one in data), "no run")
                if notebook.stem == "severe-leakage":
                    digest = next(line.split()[1] for line in README.splitlines() if line.strip().startswith("digest "))
                    texts = ["".join(one.get("text/plain", "")) for one in data]
                    self.assertEqual(texts[-1], repr(digest))

    def execute(self, notebook, folder):
        """Executes a notebook in a folder of its own, and returns it with its outputs."""
        shutil.copy(notebook, folder)
        command = [sys.executable, "-m", "nbconvert", "--execute", "--to", "notebook", "--output", "executed"]
        environment = {
            **os.environ,
            "HIL_BIN": os.path.abspath(PROGRAM),
            "HIL_CLONE": str(CLONE),
            "PYTHONPATH": str(CLONE / "tools/python"),
            "HOME": folder,
            "JUPYTER_PREFER_ENV_PATH": "1",
        }
        finished = subprocess.run(
            [*command, notebook.name], cwd=folder, env=environment, capture_output=True, text=True
        )
        self.assertEqual(finished.returncode, 0, finished.stderr)
        return json.loads(pathlib.Path(folder, "executed.ipynb").read_text())


if __name__ == "__main__":
    unittest.main()
