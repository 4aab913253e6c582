"""Evaluation of a scenario at many points, for optimisers and studies of other packages."""

from __future__ import annotations

import json
import math
import os
from types import MappingProxyType
from typing import Any, Dict, Iterable, List, Mapping, NamedTuple, Optional, Sequence, Tuple, Union

from .errors import UsageError
from .native import native
from .values import settings
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

    A point is a mapping of keys of the scenario to values, or, with `keys`, a row of values. A frame of pandas or
    polars has its keys as columns, of which `keys` may choose some. `set` changes values for all points. Plants and
    laws that are built into `hil` run in this process, one point on each core; `workers` limits their number. Where
    the scenario names a program, one point after another runs in processes that are kept, and some of them again in new
    processes; a point that names a program itself has its own. Nothing is recorded.

    Raises `UsageError` with the number of the point if one is invalid, before any run; where the scenario names a
    program, values of its sides are checked before the run of their point. A run that diverges is a result, with the
    verdict `aborted`. Ctrl-C ends all runs and raises KeyboardInterrupt.
    """
    keys, points = _columns(points, keys)
    if not isinstance(points, Iterable):
        raise TypeError(f"`points` is {points!r}; use points, one after the other")
    first, common = settings(set), dict(set or {})
    rows = [_values(place, point, keys) for place, point in enumerate(points)]
    flags, path = [settings(row) for row in rows], os.fspath(scenario)
    cores = len(os.sched_getaffinity(0)) if workers is None else workers
    if cores < 1:
        raise ValueError(f"workers is {cores}; expected at least 1")
    if not rows:
        _check(path, first)
        return []
    try:
        results = native().evaluate_points(path, first, flags, cores)
    except UsageError as error:
        raise _of_point(error, path, first, flags) from None
    if results is not None:
        return [_evaluation(result) for result in json.loads(results)]
    if not any(key.split(".")[1:2] == ["program"] for row in rows for key in row):
        return _in_processes(path, first, flags)
    # Points with programs of their own share none.
    evaluations = []
    for place, row in enumerate(rows):
        try:
            evaluations.append(_run(scenario, {**common, **row}))
        except UsageError as error:
            raise _named(error, place) from None
    return evaluations


def _check(path: str, flags: Sequence[str]) -> None:
    """Raises `UsageError` if the scenario is invalid with these flags."""
    session = native().open_session(path, flags, None, None)
    if session is not None:
        session.close()


def _of_point(error: UsageError, path: str, first: Sequence[str], flags: Sequence[Sequence[str]]) -> UsageError:
    """Returns a refusal with the first point that is refused, unless the scenario is wrong without any."""
    for place, point in enumerate([[], *flags], -1):
        try:
            _check(path, [*first, *point])
        except UsageError as refusal:
            if place >= 0:
                return _named(refusal, place)
            if refusal.text == error.text:
                break
    return error


def _named(error: UsageError, place: int) -> UsageError:
    return UsageError(error.command, error.exit_code, f"point {place}: {error.text}", error.problems)


def _columns(points: Any, keys: Optional[Sequence[str]]) -> Tuple[Optional[List[str]], Iterable[Any]]:
    """Returns the keys, each of them once, and the rows of a frame or other points."""
    if isinstance(keys, str):
        raise TypeError(f"`keys` is one text; use [{keys!r}]")
    names = None if keys is None else list(keys)
    columns = getattr(points, "columns", None)
    if columns is not None:
        columns = list(columns)
        names = columns if names is None else names
    for place, name in enumerate(names or []):
        if name in names[:place]:  # type: ignore[index]
            raise ValueError(f"`{name}` is twice in `keys`")
        if columns is not None and name not in columns:
            raise ValueError(f"the frame has no column `{name}`; it has {', '.join(map(str, columns))}")
    if columns is not None:
        frame = points[names]
        points = frame.iter_rows() if hasattr(frame, "iter_rows") else frame.itertuples(index=False, name=None)
    return names, points


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
            keys_of = f"{len(keys)} keys" if len(keys) != 1 else "1 key"
            raise ValueError(f"point {place} has {len(row)} values for {keys_of}")
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


def _in_processes(path: str, first: Sequence[str], flags: Sequence[Sequence[str]]) -> List[Evaluation]:
    """Evaluates points one after another, in processes that are kept from point to point."""
    from .errors import of_exit_code
    from .programs import execute, parsed

    common = [f"--set={setting}" for setting in first]
    output = execute(["campaign", "points", *common, "--", path], json.dumps(flags))
    if output.exit_code != 0:
        facts = parsed(output.stdout)
        problems = facts.get("problems", []) if isinstance(facts, dict) else []
        raise of_exit_code(output.exit_code)(output.command, output.exit_code, output.stderr, problems)
    return [_evaluation(result) for result in json.loads(output.stdout)]


def _run(scenario: Location, values: Mapping[str, object]) -> Evaluation:
    """Evaluates a point with processes."""
    from tempfile import TemporaryDirectory

    from .launch import run

    with TemporaryDirectory(prefix="hil-evaluate-") as folder:
        point = run(scenario, set=values, record=False, out=os.path.join(folder, "run"))
        return Evaluation(point.verdict, point.reason, point.verdicts, point.metrics, point.digest)
