"""Converts recordings with rerun and compares every column with what the package `hil` reads, bit by bit.

    python compare_rerun.py FOLDER RUN...

`rerun mcap convert` writes into FOLDER, where it also keeps its settings, so that it sends nothing
anywhere. Checks that the fields of the converted records have the names of the signals, that each
holds the recorded bits at its simulated time, and that the events are there. Ends with 0 when all holds.
"""

import os
import pathlib
import subprocess
import sys

import numpy as np
import pyarrow

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "tools" / "python"))

import hil


def rerun_command(folder, *arguments):
    environment = {**os.environ, "HOME": str(folder), "XDG_CONFIG_HOME": str(folder)}
    command = [sys.executable, "-m", "rerun", *map(str, arguments)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def leaves(name, array):
    """Name and values of every field of a message, arrays of numbers as rows."""
    if pyarrow.types.is_struct(array.type):
        for index in range(array.type.num_fields):
            field = array.type.field(index).name
            yield from leaves(f"{name}.{field}" if name else field, array.field(index))
    elif pyarrow.types.is_list(array.type):
        yield name, array.flatten().to_numpy(zero_copy_only=False).reshape(len(array), -1)
    else:
        yield name, array.to_numpy(zero_copy_only=False)


def read(converted):
    """Every field of the records, and the times, in the order of steps; the number of events."""
    import rerun.chunk

    columns, events = {}, 0
    for chunk in rerun.chunk.RrdReader(converted).stream():
        table = chunk.to_record_batch()
        if "message_log_time" not in table.schema.names:
            continue
        if chunk.entity_path == "/events":
            events += chunk.num_rows
        if chunk.entity_path == "/record":
            messages = table.column("hil_msgs.msg.Record:message").flatten()
            for name, values in leaves("", messages):
                columns.setdefault(name, []).append(values)
            times_ns = table.column("message_log_time").cast("int64").to_numpy()
            columns.setdefault("log_time_ns", []).append(times_ns)
    columns = {name: np.concatenate(parts) for name, parts in columns.items()}
    order = np.argsort(columns["step"])
    return {name: values[order] for name, values in columns.items()}, events


def same(name, found, expected):
    found, expected = found.view(np.uint64), expected.view(np.uint64)
    assert found.shape == expected.shape, f"{name}: {found.shape} and {expected.shape}"
    assert (found == expected).all(), f"{name} differs first at row {(found != expected).argmax()}"


def compare(run_path, folder):
    run = hil.open(run_path)
    recording, converted = pathlib.Path(run_path), folder / "run.rrd"
    recording = recording / "run.mcap" if recording.is_dir() else recording
    rerun_command(folder, "mcap", "convert", recording, "-o", converted)
    columns, events = read(converted)
    signals = [name for name in columns if columns[name].dtype == np.float64]
    assert signals == list(run.signals), set(signals) ^ set(run.signals)
    data = run.to_numpy(["*"])
    for name in [*signals, "step", "time_ns", "round_trip_ns"]:
        same(name, columns[name], data[name])
    same("the time of messages", columns["log_time_ns"], data["time_ns"])
    # A word in parts is that word.
    published = columns["published_ns.high"].astype(np.uint64) << np.uint64(32) | columns["published_ns.low"]
    same("published_ns", published, data["published_ns"])
    assert events == len(run.events), f"{events} events, {len(run.events)} recorded"
    print(f"{len(data['step'])} steps of {len(signals)} signals and {events} events, the same bits in rerun")


def main(folder, *runs):
    folder = pathlib.Path(folder)
    rerun_command(folder, "analytics", "disable")
    for run in runs:
        compare(run, folder)


if __name__ == "__main__":
    main(*sys.argv[1:])
