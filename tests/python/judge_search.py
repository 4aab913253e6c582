"""Searches a scenario with other programs and compares their findings with those of `hil search`.

    python judge_search.py cma|psy-taliro HIL SCENARIO SMALLEST.json WORST.json

The scenario has two biases from 0 to 20 mm and one requirement; the files are the answers of `hil search smallest` and
`hil search worst` with `--json`. Each evaluation is a run of `hil` with these biases.

- cma minimises the margin: its least margin must not be below that of `hil search worst`.
- psy-taliro falsifies the requirement: no failing case of its may be nearer to the nominal one, without a bias, than that
  of `hil search smallest`.

Prints both findings as JSON, and ends with 0 when they agree.
"""

import json
import math
import subprocess
import sys

LARGEST = 0.02
EVALUATIONS = 60
HIL, SCENARIO = sys.argv[2:4]
tried = []


def margin(first, second):
    """Least margin of the requirement in a run with these biases."""
    command = [HIL, "run", SCENARIO, "--link", "in-process", "--no-record", "--json"]
    for place, bias in enumerate((first, second)):
        command += ["--set", f"faults[{place}].effects[0].bias={float(bias)!r}"]
    run = subprocess.run(command, capture_output=True, text=True, check=False)
    value = json.loads(run.stdout)["requirements"][0]["robustness"]
    tried.append((first, second, value))
    return value


def by_cma():
    """Least margin that CMA-ES finds."""
    import cma

    options = {"bounds": [0, LARGEST], "maxfevals": EVALUATIONS, "verbose": -9, "seed": 5}
    strategy = cma.CMAEvolutionStrategy([LARGEST / 2] * 2, LARGEST / 4, options)
    strategy.optimize(lambda point: margin(*point))


def by_psy_taliro():
    """Failing cases that dual annealing finds."""
    import staliro
    from staliro import optimizers

    @staliro.costfunc
    def cost(sample):
        return margin(sample.static["first"], sample.static["second"])

    ranges = {"first": (0.0, LARGEST), "second": (0.0, LARGEST)}
    options = staliro.TestOptions(static_inputs=ranges, iterations=EVALUATIONS, seed=5)
    staliro.staliro(cost, optimizers.DualAnnealing(), options)


def main(judge, smallest, worst):
    with open(smallest, encoding="utf-8") as file:
        smallest = json.load(file)
    with open(worst, encoding="utf-8") as file:
        worst = json.load(file)
    {"cma": by_cma, "psy-taliro": by_psy_taliro}[judge]()
    least = min(value for _, _, value in tried)
    # Distances of `hil search` are in units of the ranges.
    failing = [math.hypot(first, second) / LARGEST for first, second, value in tried if value < 0]
    nearest = min(failing, default=math.inf)
    finding = {"evaluations": len(tried), "least_margin": least, "nearest_failure": nearest}
    print(json.dumps(finding))
    is_worst = worst["margin"] <= least + 1e-9
    is_smallest = bool(failing) and smallest["fails"] <= nearest + 0.02
    return 0 if is_worst and is_smallest else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1], *sys.argv[4:]))
