"""First and total Sobol' indices of a campaign's first margin, by SALib, as JSON."""

import json
import sys

import numpy
import polars
from SALib.analyze import sobol

folder, *names = sys.argv[1:]
table = polars.read_parquet(f"{folder}/results.parquet").sort("case")
margin = next(name for name in table.columns if name.startswith("robustness."))
width = len(names) + 2
rows = numpy.reshape(table[margin].to_numpy(), (-1, width))
# hil has A, B and then A with each value from B; SALib has B last.
rows = numpy.hstack([rows[:, :1], rows[:, 2:], rows[:, 1:2]])
problem = {"num_vars": len(names), "names": names, "bounds": [[0, 1]] * len(names)}
answer = sobol.analyze(problem, rows.ravel(), calc_second_order=False, seed=1)
print(json.dumps({key: [float(one) for one in answer[key]] for key in ["S1", "ST", "S1_conf", "ST_conf"]}))
