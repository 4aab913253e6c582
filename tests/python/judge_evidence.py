"""Reads the evidence of runs with other programs: junitparser and sphinx-needs.

Arguments: folder of the evidence, folder to build a document in.
Prints JSON: for each JUnit case its result and properties, and for each need its status and links.
"""

import json
import subprocess
import sys
from pathlib import Path

from junitparser import JUnitXml, Properties

evidence, site = Path(sys.argv[1]), Path(sys.argv[2])
cases = [
    {
        "name": case.name,
        "result": [type(result).__name__ for result in case.result],
        "properties": [[each.name, each.value] for each in case.child(Properties) or []],
    }
    for suite in JUnitXml.fromfile(str(evidence / "junit.xml"))
    for case in suite
]

source = site / "source"
source.mkdir(parents=True)
(source / "needs.json").write_bytes((evidence / "needs.json").read_bytes())
(source / "conf.py").write_text('extensions = ["sphinx_needs"]\n')
(source / "index.rst").write_text(
    "Evidence\n========\n\n"
    ".. req:: Settles\n   :id: SYS_1\n\n"
    ".. req:: Answers\n   :id: SYS_2\n\n"
    ".. req:: Is never tested\n   :id: SYS_3\n\n"
    ".. req:: Stands in no list\n   :id: SYS_9\n\n"
    ".. needimport:: needs.json\n"
)
built = subprocess.run(
    [sys.executable, "-m", "sphinx", "-b", "needs", "-W", str(source), str(site / "built")],
    capture_output=True,
    text=True,
)
if built.returncode != 0:
    sys.exit(built.stdout + built.stderr)
document = json.loads((site / "built" / "needs.json").read_text())
needs = document["versions"][document["current_version"]]["needs"]
print(
    json.dumps(
        {
            "cases": cases,
            "needs": {
                id: {
                    "type": need["type"],
                    "status": need.get("status"),
                    "links": need.get("links", []),
                    "links_back": need.get("links_back", []),
                }
                for id, need in needs.items()
            },
        }
    )
)
