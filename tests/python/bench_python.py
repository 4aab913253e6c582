"""Times of the Python package: what its page promises of each, and what this machine needs.

    HIL_BIN=target/release/hil python bench_python.py

Prints a table and a line of JSON. Each number is the median of rounds; HIL_BENCH_QUICK=1 makes a few short ones. Meant
for programs of `cargo build --release` and a machine that does nothing else. Enforces no limit.
"""

import importlib.util
import json
import os
import pathlib
import statistics
import subprocess
import sys
import tempfile
import time

CLONE = pathlib.Path(__file__).resolve().parents[2]
PACKAGE = str(CLONE / "tools" / "python")
sys.path.insert(0, PACKAGE)

import hil

os.environ["HIL_BIN"] = os.path.abspath(os.environ["HIL_BIN"])
SPRING = CLONE / "scenarios" / "spring-mass.toml"
DRHAS = CLONE / "scenarios" / "severe-leakage.toml"
LAW = CLONE / "examples" / "python-plant" / "spring_mass.py"
IS_QUICK = os.environ.get("HIL_BENCH_QUICK") == "1"
ROUNDS = 3 if IS_QUICK else 15
CALLS = 50 if IS_QUICK else 1000
#: Long enough for every round.
ENDLESS = {"run.duration_s": 1e5, "derived": [], "metrics": [], "requirements": [], "plots": []}


def call_us(work, calls=CALLS):
    """Returns the time of a call in us."""
    rounds = []
    for _ in range(ROUNDS):
        since = time.perf_counter_ns()
        for _ in range(calls):
            work()
        rounds.append((time.perf_counter_ns() - since) / calls / 1e3)
    return statistics.median(rounds)


def import_ms():
    """Returns the time that the import takes over an interpreter that imports nothing."""
    environment = {**os.environ, "PYTHONPATH": PACKAGE}

    def start_ns(program):
        since = time.perf_counter_ns()
        subprocess.run([sys.executable, "-c", program], env=environment, check=True)
        return time.perf_counter_ns() - since

    pairs = [start_ns("import hil") - start_ns("pass") for _ in range(ROUNDS)]
    return statistics.median(pairs) / 1e6


def sessions():
    """Yields the rows of sessions."""
    with hil.Session(SPRING, set=ENDLESS) as session:
        yield "Session.step()", call_us(session.step), "us", 5
        observation = session.observe(["truth.position_m", "truth.velocity_mps"])
        yield "Observation.read()", call_us(observation.read), "us", None
    with hil.Session(SPRING) as session:
        session.step(1000)
        yield "Session.reset()", call_us(session.reset), "us", 150
        session.step(1000)
        saved = session.save()
        yield "Session.restore()", call_us(lambda: session.restore(saved)), "us", 150
        yield "Session.save()", call_us(session.save), "us", None


def environments():
    """Yields the rows of environments of Gymnasium."""
    import hil.gym

    act, observe = {"command.force_n": (-5.0, 5.0)}, ["truth.position_m", "truth.velocity_mps"]
    env = hil.gym.Env(SPRING, observe=observe, act=act, reward="truth.position_m", set=ENDLESS)
    env.reset(seed=1)
    action = env.action_space.sample()
    yield "Env.step()", call_us(lambda: env.step(action)), "us", 15
    env.close()
    env = hil.gym.Env(SPRING, observe=observe, act=act, reward="settles")
    yield "Env.reset()", call_us(lambda: env.reset(seed=1)), "us", None
    env.close()


def reading():
    """Yields the rows of reading a whole run, as ratios to unpacking its chunks with as many threads and nothing else."""
    import lz4.frame

    from hil import chunks

    values = {"run.duration_s": 2 if IS_QUICK else 200, "derived": [], "metrics": [], "requirements": [], "plots": []}
    run = hil.run(DRHAS, set={**values, "faults": []}, link="in-process", out="long")
    with open(run.path, "rb") as file:
        frames = [frame_of(file, place) for place in run._recording._chunks]

    def alone():
        for _ in chunks.in_parallel(lz4.frame.decompress, frames):
            pass

    names = list(run.signals)
    size = len(run.time_s) * 8 / 1e9
    for count in (1, 7, len(names)):
        chosen = names[:: len(names) // count][:count]
        pairs = []
        for _ in range(ROUNDS):
            pairs.append(duration_s(lambda: run.to_numpy(chosen)) / duration_s(alone))
        yield f"{count} signals, {count * size:.2f} GB, over lz4", statistics.median(pairs), "", 1.5


def frame_of(file, place):
    """Returns the LZ4 frame of a chunk."""
    from hil import chunks

    file.seek(place.offset)
    body = file.read(place.length)
    *_, codec_length = chunks.CHUNK.unpack_from(body)
    return body[chunks.CHUNK.size + codec_length + chunks.LENGTH.size :]


def duration_s(work):
    since = time.perf_counter_ns()
    work()
    return (time.perf_counter_ns() - since) / 1e9


def law_steps_per_s():
    """Returns the speed of a run whose law is Python in a process of its own."""
    speeds = []
    values = {**ENDLESS, "run.duration_s": 2.0 if IS_QUICK else 50.0, "controller.program": str(LAW)}
    for number in range(3):
        run = hil.run(SPRING, set=values, record=False, out=f"run-{number}")
        speeds.append(run.summary["steps"] / run.summary["wall_time_s"])
    return statistics.median(speeds)


def show(name, value, unit, aim):
    limit = "" if aim is None else f"<= {aim}"
    print(f"{name:34}{value:>10.2f}{limit:>10} {unit}", flush=True)


def main():
    rows = [("import hil, over the interpreter", import_ms(), "ms", 15), *sessions()]
    if importlib.util.find_spec("gymnasium"):
        rows += environments()
    else:
        print("skipped: gymnasium is missing")
    print(f"{'':34}{'median':>10}{'aim':>10}")
    for row in rows:
        show(*row)
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        for row in reading():
            rows.append(row)
            show(*row)
        speed = law_steps_per_s()
        os.chdir(CLONE)
    print(f"{'law in a process of its own':34}{speed:>10.0f}{'>= 20000':>10} steps/s")
    table = [{"row": name, "value": value, "unit": unit, "aim": aim} for name, value, unit, aim in rows]
    table.append({"row": "law in a process of its own", "value": speed, "unit": "steps/s", "aim": 20_000})
    print(json.dumps({"bench": "python", "rows": table}))


if __name__ == "__main__":
    main()
