"""Times duckdb at the work of `hil campaign collect` and `hil campaign show` on the parts of a campaign, as JSON."""

import glob
import json
import resource
import sys
import tempfile
import time

import duckdb

verb, folder = sys.argv[1:]
parts = sorted(glob.glob(f"{folder}/shards/*/part.parquet"))
read = f"read_parquet({parts})"
names = [name for name, *_ in duckdb.sql(f"describe select * from {read}").fetchall()]
# Wall time, host, attempt and tries stand in a table of their own.
results, circumstances = names[:-4], names[-4:]
margins = [name for name in names if name.startswith("robustness.")]
varied = results[4 : results.index("class")]
quoted = lambda names: ", ".join(f'"{name}"' for name in names)


def collect(out):
    for name, columns in [("results", results), ("circumstances", ["case", *circumstances])]:
        duckdb.sql(
            f'copy (select {quoted(columns)} from {read} order by "case") to \'{out}/{name}.parquet\' (format parquet, compression zstd)'
        )
    return {}


def show():
    classes = duckdb.sql(f"select variant, class, count(*) from {read} group by all").fetchall()
    told = {"pass": sum(count for _, name, count in classes if name == "pass")}
    for margin in margins:
        told["quantiles"] = duckdb.sql(
            f'select variant, quantile_cont("{margin}", [0.01, 0.05, 0.5]) from {read} group by variant'
        ).fetchall()
        told["worst"] = duckdb.sql(f'select "case" from {read} order by "{margin}", "case" limit 5').fetchall()[0][0]
        ranks = ", ".join(f'rank() over (order by "{name}") as "{name}"' for name in [margin, *varied])
        correlations = ", ".join(f'corr("{margin}", "{name}")' for name in varied)
        told["correlations"] = duckdb.sql(f"with ranks as (select {ranks} from {read}) select {correlations} from ranks").fetchall()[0]
    return told


with tempfile.TemporaryDirectory() as out:
    began = time.perf_counter()
    told = collect(out) if verb == "collect" else show()
    seconds = time.perf_counter() - began
memory_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1000
print(json.dumps({"s": seconds, "memory_mb": memory_mb, **told}))
