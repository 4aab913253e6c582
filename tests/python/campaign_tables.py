"""Rows, passes and worst margins of a campaign's tables, by three readers, as JSON."""

import glob
import json
import sys

import duckdb
import pandas
import polars

folder = sys.argv[1]
results = f"{folder}/results.parquet"
cases = f"{folder}/cases.parquet"
margin = next(name for name in pandas.read_parquet(results).columns if name.startswith("robustness."))


def answer(rows, passes, worst):
    return {"rows": rows, "pass": passes, "worst": worst}


told = {}

# The parts alone, without `hil campaign collect`, must say the same.
parts = sorted(glob.glob(f"{folder}/shards/*/part.parquet"))
counted = duckdb.sql(
    f"select variant, count(*) filter (class = 'pass') as passes, min(\"{margin}\") as worst from read_parquet({parts}) group by variant"
).fetchall()
rows = duckdb.sql(f"select count(*) from '{results}' r join '{cases}' c using (\"case\", draw, variant, mass_kg)").fetchall()[0][0]
told["duckdb"] = answer(rows, {name: passes for name, passes, _ in counted}, {name: worst for name, _, worst in counted})

table = polars.read_parquet(results)
groups = table.group_by("variant").agg((polars.col("class") == "pass").sum().alias("passes"), polars.col(margin).min().alias("worst"))
told["polars"] = answer(
    table.height,
    {row["variant"]: row["passes"] for row in groups.iter_rows(named=True)},
    {row["variant"]: row["worst"] for row in groups.iter_rows(named=True)},
)

table = pandas.read_parquet(results)
passes = (table["class"] == "pass").groupby(table["variant"]).sum()
worst = table.groupby("variant")[margin].min()
told["pandas"] = answer(
    len(table),
    {name: int(count) for name, count in passes.items()},
    {name: float(value) for name, value in worst.items()},
)

print(json.dumps(told))
