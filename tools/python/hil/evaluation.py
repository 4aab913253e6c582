"""Evaluation of a scenario at many points, for optimisers and studies of other packages."""

from __future__ import annotations

import json
import math
import os
from types import MappingProxyType
from typing import Any, Dict, Iterable, List, Mapping, NamedTuple, Optional, Sequence, Tuple, Union

from .native import native
from .values import toml
from .verdict import Metric, Verdict

Location = Union[str, "os.PathLike[str]"]


class Evaluation(NamedTuple):
    """Results at a point: the verdict of the run, and those on each requirement with their margins."""

    verdict: str
    reason: Optional[str]
    verdicts: Mapping[str, Verdict]
    metrics: Tuple[Metric, ...]
    digest: Optional[str]

    @property
    def passed(self) -> bool:
        """`True` if all requirements passed."""
        return self.verdict == "pass"

    @property
    def robustness(self) -> Mapping[str, float]:
        """The margin of each requirement, negative for a failed one; NaN where it has none."""
        margins = {name: verdict.robustness for name, verdict in self.verdicts.items()}
        return MappingProxyType({name: math.nan if margin is None else margin for name, margin in margins.items()})


def evaluate(
    scenario: Location,
    points: Iterable[Any],
    keys: Optional[Sequence[str]] = None,
    *,
    set: Optional[Mapping[str, object]] = None,
    workers: Optional[int] = None,
) -> List[Evaluation]:
    """Runs a scenario once for each point and returns the results in their order.

    A point is a mapping of keys of the scenario to values, or, with `keys`, a row of values. `set` changes values for
    all points. Plants and laws that are built into `hil` run in this process, one point on each core; `workers` limits
    their number. Where the scenario names a program, `hil run` runs one point after another. Nothing is recorded.

    Raises `UsageError` before any run if a point is invalid. A run that diverges is a result, with the verdict
    `aborted`. Ctrl-C ends all runs and raises KeyboardInterrupt.
    """
    common, rows = dict(set or {}), [_values(place, point, keys) for place, point in enumerate(points)]
    flags = [[f"{key}={toml(value)}" for key, value in row.items()] for row in rows]
    first = [f"{key}={toml(value)}" for key, value in common.items()]
    cores = len(os.sched_getaffinity(0)) if workers is None else workers
    if cores < 1:
        raise ValueError(f"workers is {cores}; expected at least 1")
    results = native().evaluate_points(os.fspath(scenario), first, flags, cores) if rows else "[]"
    if results is not None:
        return [_evaluation(result) for result in json.loads(results)]
    return [_run(scenario, {**common, **row}) for row in rows]


def _values(place: int, point: Any, keys: Optional[Sequence[str]]) -> Dict[str, object]:
    """Returns the values of a point by their keys."""
    if keys is None:
        if not isinstance(point, Mapping):
            raise TypeError(f"point {place} is {point!r}; use a mapping of keys to values, or name the columns in `keys`")
        values = dict(point)
    else:
        tolist = getattr(point, "tolist", None)
        row = tolist() if callable(tolist) else list(point) if isinstance(point, Iterable) else point
        if not isinstance(row, list) or any(isinstance(value, list) for value in row):
            raise TypeError(f"point {place} is {row!r}; use a row of {len(keys)} values, in the order of `keys`")
        if len(row) != len(keys):
            raise ValueError(f"point {place} has {len(row)} values for {len(keys)} keys")
        values = dict(zip(keys, row))
    for key, value in values.items():
        if isinstance(value, float) and math.isnan(value):
            raise ValueError(f"point {place}: `{key}` is NaN")
    return values


def _evaluation(result: Mapping[str, Any]) -> Evaluation:
    verdicts = [Verdict(*(row.get(field) for field in Verdict._fields)) for row in result["requirements"]]
    return Evaluation(
        verdict=result["verdict"],
        reason=result["reason"],
        verdicts=MappingProxyType({verdict.name: verdict for verdict in verdicts}),
        metrics=tuple(Metric(row["name"], tuple(row["window_s"]), row["value"], row["unit"]) for row in result["metrics"]),
        digest=result["digest"],
    )


def _run(scenario: Location, values: Mapping[str, object]) -> Evaluation:
    """Evaluates a point with processes."""
    from tempfile import TemporaryDirectory

    from .launch import run

    with TemporaryDirectory(prefix="hil-evaluate-") as folder:
        point = run(scenario, set=values, record=False, out=os.path.join(folder, "run"))
        return Evaluation(point.verdict, point.reason, point.verdicts, point.metrics, point.digest)
