"""Compares three ways to the numbers of a run, bit by bit: the package `hil`, and what `hil export` wrote.

    python compare_export.py RUN TABLE.csv TABLE.parquet

pandas reads the CSV file, pyarrow the Parquet file. Also checks units and origin in the Parquet file, the
validity of signals, and the derived signal against its definition. Ends with 0 when all holds.
"""

import json
import pathlib
import sys

import numpy as np
import pandas
import pyarrow.parquet

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "tools" / "python"))

import hil


def same(name, a, b):
    a, b = np.asarray(a), np.asarray(b)
    assert a.dtype == b.dtype and a.shape == b.shape, f"{name}: {a.dtype}{a.shape} and {b.dtype}{b.shape}"
    a, b = a.view(np.uint64), b.view(np.uint64)
    assert (a == b).all(), f"{name} differs first at row {(a != b).argmax()}"


def main(run_path, csv_path, parquet_path):
    run = hil.open(run_path)
    data = run.to_numpy()
    csv = pandas.read_csv(csv_path, dtype={"step": np.uint64})
    parquet = pyarrow.parquet.read_table(parquet_path)
    assert list(csv.columns) == parquet.column_names
    for name, values in data.items():
        same(f"{name} of CSV", csv[name], values)
        same(f"{name} of Parquet", parquet[name].to_numpy(), values)
    error = data["truth.surface_angle_rad"] - data["reference.surface_angle_rad"]
    same("the tracking error", csv["tracking_error_rad"], error)
    same("the tracking error", parquet["tracking_error_rad"].to_numpy(), error)

    sent = [name for name in run.signals if name.split(".")[0] in ("measured", "reference", "command", "internal")]
    flags = [name for name in parquet.column_names if name.endswith(".valid")]
    assert flags == [f"{name}.valid" for name in sent], flags
    for name in flags:
        # All but the command that the record after the last step does not have.
        expected = np.ones(len(csv), bool)
        expected[-1] = name.split(".")[0] in ("measured", "reference")
        assert (csv[name].to_numpy() == expected).all(), name
        assert (parquet[name].to_numpy() == expected).all(), name

    metadata = {key.decode(): value.decode() for key, value in parquet.schema.metadata.items()}
    units = {name: unit for name, unit in run.signals.items() if unit}
    assert json.loads(metadata["units"]) == {**units, "time_s": "s", "tracking_error_rad": "rad"}
    facts = run.metadata["hil.run"]
    assert metadata["hil.digest"] == run.digest == run.summary["digest"]
    for name in ("scenario", "seed", "rate_hz", "session"):
        assert metadata[f"hil.{name}"] == facts[name], name
    assert metadata["hil.commit"] == facts["hil_commit"]
    print(f"{len(csv)} steps of {len(run.signals)} signals, the same bits in all three")


if __name__ == "__main__":
    main(*sys.argv[1:])
