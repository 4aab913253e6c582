"""A session: a run that stands still until Python asks for its next steps.

Plant and law that are built into `hil`, or classes, run in this process. Where the scenario names a program, `remote` runs both
sides in processes of their own; the interface is the same.
"""

from __future__ import annotations

import json
import math
import os
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Dict, List, Mapping, NamedTuple, Optional, Sequence, Tuple, Type, Union

from .errors import SessionError, UnknownSignal, UsageError
from .native import native
from .values import settings
from .verdict import Metric, Verdict

if TYPE_CHECKING:
    from types import TracebackType

    import numpy as np
    from numpy.typing import NDArray

Location = Union[str, "os.PathLike[str]"]


class Fault(NamedTuple):
    """An accepted fault; the step is `None` while it waits for something else."""

    id: int
    kind: str
    step: Optional[int]
    waits_for: Optional[str]


class Change(NamedTuple):
    """An accepted change of values."""

    id: int
    step: int
    ramp_steps: int
    values: Mapping[str, float]


class SessionResult(NamedTuple):
    """Results of a session so far; `verdict` is `None` before its end."""

    verdict: Optional[str]
    reason: Optional[str]
    verdicts: Mapping[str, Verdict]
    metrics: Tuple[Metric, ...]
    digest: Optional[str]
    steps: int
    time_s: float

    @property
    def passed(self) -> bool:
        """`True` if the run is over and all requirements passed."""
        return self.verdict == "pass"


class Saved:
    """State of a session before a step, for `restore`; it is memory of this process and cannot be pickled."""

    def __init__(self, native: Any) -> None:
        self._native = native

    @property
    def step_index(self) -> int:
        """Step before which the session was saved."""
        return int(self._native.step_index)

    def __repr__(self) -> str:
        return f"<hil.Saved before step {self.step_index}>"


class Observation:
    """Values of several signals at the newest step, in one array that stays the same object.

    `read()` copies the newest values into `values` and returns it. They are NaN before the first step.
    """

    def __init__(self, session: Session, names: Sequence[str], native: Any) -> None:
        import numpy as np

        #: Full names, in the order of the array.
        self.names = tuple(names)
        #: The array.
        self.values: NDArray[np.float64] = np.frombuffer(native.memory, np.float64)
        self._copy = session._native.copy
        self._native = native

    def read(self) -> NDArray[np.float64]:
        """Returns the array with the values of the newest step."""
        self._copy(self._native)
        return self.values


class Session:
    """A run in this process that is held before its next step.

        with hil.Session("scenarios/spring-mass.toml") as session:
            session.step(100)
            session.inject("bias", "measured.position_m", 1e-3)
            session.set("reference.position_m", 0.02)
            session.step_to(2.5)
            session["truth.position_m"], session.result().verdicts

    `set` changes values of the scenario, as for `run`; `plant` and `law` are classes marked with `hil.plant` and
    `hil.law` in place of built-in ones, and of programs that the scenario names. Faults, changes, checks and the digest are those of the command
    line, and `scenario()` is the file that repeats the session there. Nothing is recorded. A session belongs to the
    thread that opened it.
    """

    def __init__(
        self,
        scenario: Location,
        *,
        set: Optional[Mapping[str, object]] = None,
        plant: Optional[type] = None,
        law: Optional[type] = None,
    ) -> None:
        flags = settings(set)
        path = os.fsdecode(scenario)
        session = native().open_session(path, flags, plant, law)
        if session is None:
            if plant is not None or law is not None:
                raise SessionError(f"{path} names a program for the other side; give a class for both sides, or for none")
            from .remote import RemoteSession

            session = RemoteSession(path, flags)
        self._native: Any = session
        self._path = path
        # Bound once: they are called at every step.
        self._step = session.step
        self._value = session.value
        self._possible: Optional[str] = None

    def __enter__(self) -> Session:
        return self

    def __exit__(
        self,
        kind: Optional[Type[BaseException]],
        error: Optional[BaseException],
        trace: Optional[TracebackType],
    ) -> None:
        self.close()

    def close(self) -> None:
        """Ends the session; it leaves nothing behind. A second call has no effect."""
        self._native.close()

    def __repr__(self) -> str:
        try:
            where = f"over after {self.step_index} steps" if self.is_over else f"before step {self.step_index}"
        except SessionError:
            where = "closed, or of another thread"
        return f"<hil.Session {self._path}: {where}>"

    # Time.

    def step(self, n: int = 1) -> None:
        """Executes n steps; fewer if the run ends earlier.

        Ctrl-C raises KeyboardInterrupt between two steps, and the session goes on from there; raised inside of a class
        or while a program hangs, it ends the run, and `is_over` is `True`. Raises `InfrastructureError` if plant or law
        fail, and `SessionError` after the end of the run.
        """
        try:
            self._step(n)
        except OverflowError:
            raise OverflowError(f"{n} is no number of steps; it is 0 or more, and has at most 64 bits") from None

    def step_to(self, time_s: float = float("inf")) -> None:
        """Executes all steps before the first one at or after this simulated time; without it, the whole run."""
        self._native.step_to(time_s)

    @property
    def step_index(self) -> int:
        """The next step; after the end, the number of executed steps."""
        return int(self._native.step_index)

    @property
    def time_s(self) -> float:
        """Simulated time of the next step."""
        return float(self._native.time_s)

    @property
    def steps(self) -> int:
        """Number of steps of the whole run."""
        return int(self._native.length[0])

    @property
    def rate_hz(self) -> float:
        """Steps per simulated second."""
        return float(self._native.length[1])

    @property
    def is_over(self) -> bool:
        """`True` after the end of the run."""
        return bool(self._native.is_over)

    # Values.

    @property
    def signals(self) -> Mapping[str, str]:
        """The unit of each signal of a step, by its full name."""
        return MappingProxyType(dict(self._native.signals()[0]))

    @property
    def derived(self) -> Mapping[str, str]:
        """The unit of each derived signal of the scenario, by its name."""
        return MappingProxyType(dict(self._native.signals()[1]))

    def __getitem__(self, name: str) -> float:
        """Returns the value of a signal, recorded or derived, at the newest step; NaN where it has none."""
        value: Optional[float] = self._value(name)
        if value is None:
            if name not in self:
                raise self._unknown(name)
            raise SessionError(f"`{name}` has no value before the first step; step() executes it")
        return value

    #: Not iterable: names are in `signals` and `derived`.
    __iter__ = None

    def __contains__(self, name: object) -> bool:
        return name in self.signals or name in self.derived

    def _ipython_key_completions_(self) -> List[str]:
        return [*self.signals, *self.derived]

    def _unknown(self, name: str) -> UnknownSignal:
        return UnknownSignal(name, self._path, [*self.signals, *self.derived], owner="session")

    def observe(self, names: Sequence[str]) -> Observation:
        """Returns an observation of several signals, for loops that read them at every step."""
        names = [names] if isinstance(names, str) else list(names)
        for name in names:
            if not isinstance(name, str):
                raise TypeError(f"{name!r} is no name of a signal; use texts such as 'truth.position_m'")
        native = self._native.observe(names)
        if isinstance(native, str):
            raise self._unknown(native)
        return Observation(self, names, native)

    # Interventions.

    def inject(self, kind: str, *words: object, **keys: object) -> Tuple[Fault, ...]:
        """Injects a fault, as `hil inject KIND TARGET VALUE.. --KEY VALUE..`; returns the accepted faults.

        It takes effect at the next step, or at `at`, `at_step`, `when`, `after`. Words of `hil inject` with a dash
        have an underscore here; times are seconds, or texts such as "500ms". Raises `UsageError` with its text.
        """
        line = [kind, *map(_word, words)]
        for key, value in keys.items():
            name = "for" if key == "for_" else key.replace("_", "-") if key in _OPTIONS else key
            line.append(f"--{name}={_word(value)}")
        if self._possible is None:
            self._possible = json.dumps(self._ask({"request": "possible"}))
        answer = self._ask(json.loads(native().fault_request(line, self._possible)))
        return tuple(
            Fault(fault["id"], fault["kind"], fault["effective_step"], fault["waits_for"]) for fault in answer["faults"]
        )

    def clear(self, fault: Union[int, Fault, None] = None) -> Tuple[int, ...]:
        """Ends a fault, or all faults, from the next step on; returns their numbers."""
        number = fault.id if isinstance(fault, Fault) else fault
        if number is not None and not (_is_whole(number) and 0 <= number <= MOST_FAULTS):
            raise TypeError(f"{fault!r} is no fault to clear; use a fault that inject() returned, or its number")
        return tuple(self._ask({"request": "clear", "id": number})["ids"])

    @property
    def faults(self) -> List[Dict[str, Any]]:
        """All faults of the run, each with its state and its effects so far."""
        return list(self._ask({"request": "active"})["faults"])

    def set(
        self,
        key: Union[str, Mapping[str, float]],
        value: Optional[float] = None,
        *,
        at: Optional[float] = None,
        ramp: Optional[float] = None,
    ) -> Change:
        """Changes values from the next step on, or from simulated time `at` on, over `ramp` seconds.

        `set("reference.x", 0.02)`, or several at one step: `set({"reference.x": 0.02, "plant.parameters.mass_kg": 2})`.
        """
        values = {key: value} if isinstance(key, str) else key
        if not isinstance(values, Mapping) or not all(isinstance(name, str) for name in values):
            raise TypeError(f"{key!r} cannot be set; use a key with its value, or a mapping of keys to values")
        pairs = [{"key": name, "value": _number(name, number)} for name, number in values.items()]
        return self._change({"set": pairs, "clear": []}, at, ramp)

    def release(self, *keys: str, at: Optional[float] = None) -> Change:
        """Lets reference signals follow their stimulus again."""
        for key in keys:
            if not isinstance(key, str):
                raise TypeError(f"{key!r} cannot be released; use keys of reference signals")
        return self._change({"set": [], "clear": list(keys)}, at, None)

    def _change(self, change: Dict[str, Any], at: Optional[float], ramp: Optional[float]) -> Change:
        times = {name: None if time is None else _number(name, time) for name, time in (("at", at), ("ramp", ramp))}
        answer = self._ask({"request": "set", **change, "at_s": times["at"], "ramp_s": times["ramp"]})
        values = {one["key"]: float(one["value"]) for one in answer["set"]}
        return Change(answer["id"], answer["step"], answer["ramp_steps"], MappingProxyType(values))

    @property
    def tunable(self) -> Mapping[str, Dict[str, Any]]:
        """Everything that `set` can change, with unit, range and present value, by its key."""
        values = self._ask({"request": "tunable"})["values"]
        return MappingProxyType({one["key"]: one for one in values})

    def _ask(self, request: Dict[str, Any]) -> Dict[str, Any]:
        answer: Dict[str, Any] = json.loads(self._native.request(json.dumps(request)))
        if answer["response"] != "refused":
            return answer
        problems = answer["problems"]
        raise UsageError(["hil.Session"], 2, _refused(problems), problems)

    # States.

    def save(self) -> Saved:
        """Returns the state before the next step, with all results so far."""
        return Saved(self._native.save())

    def restore(self, saved: Saved) -> None:
        """Continues from a saved state, of this session or of another one of the same scenario and seed."""
        if not isinstance(saved, Saved):
            raise TypeError(f"{saved!r} is no saved state; use what save() returned")
        self._native.restore(saved._native)

    def reset(self, seed: Optional[int] = None) -> None:
        """Begins again at step 0, without live faults and changes; `seed` is the value of `run.seed` from then on."""
        try:
            self._native.reset(seed)
        except OverflowError:
            raise OverflowError(f"{seed} is no seed; it is 0 to 2**63 - 1") from None

    # Results.

    @property
    def digest(self) -> Optional[str]:
        """Digest of the steps so far, after the end that of the run; `None` before the first step."""
        digest: Optional[str] = self._native.digest
        return digest

    @property
    def verdicts(self) -> Mapping[str, Verdict]:
        """The verdict on each requirement so far, by its name."""
        return self.result().verdicts

    @property
    def metrics(self) -> Tuple[Metric, ...]:
        """Each metric in each of its windows, so far."""
        return self.result().metrics

    def result(self) -> SessionResult:
        """Returns the results so far; after the end, those of the run."""
        results = json.loads(self._native.results())
        end = results["end"] or {}
        verdicts = [Verdict(*(row.get(field) for field in Verdict._fields)) for row in results["requirements"]]
        return SessionResult(
            verdict=end.get("verdict"),
            reason=end.get("reason"),
            verdicts=MappingProxyType({verdict.name: verdict for verdict in verdicts}),
            metrics=tuple(
                Metric(row["name"], tuple(row["window_s"]), row["value"], row["unit"]) for row in results["metrics"]
            ),
            digest=self.digest,
            steps=self.step_index,
            time_s=self.time_s,
        )

    def scenario(self) -> str:
        """Returns the TOML file that repeats this session so far with `hil run`; live faults and changes are in it."""
        return str(self._native.scenario())


#: Numbers of faults have 32 bits.
MOST_FAULTS = 2**32 - 1
#: Options of `hil inject` with a dash.
_OPTIONS = ("at_step", "until_for")


def _word(value: object) -> str:
    """Returns a value as a word of the command line; several are separated by commas."""
    tolist = getattr(value, "tolist", None)
    if callable(tolist):  # of numpy
        value = tolist()
    if isinstance(value, (list, tuple)):
        return ",".join(map(_word, value))
    if isinstance(value, bool):
        return "true" if value else "false"
    return repr(value) if isinstance(value, float) else str(value)


def _is_whole(value: object) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)


def _number(key: str, value: object) -> float:
    """Returns a value as a finite number; `key` is its place in an exception."""
    # A truth value, also of numpy, or a text would be taken as a number.
    is_truth = isinstance(value, bool) or getattr(getattr(value, "dtype", None), "kind", None) == "b"
    try:
        if is_truth or isinstance(value, (str, bytes, bytearray)):
            raise TypeError
        number = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        raise TypeError(f"{value!r} cannot be the value of `{key}`; use a number") from None
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise ValueError(f"{number} cannot be the value of `{key}`; use a finite number")
    return number


def _refused(problems: Sequence[Mapping[str, Any]]) -> str:
    """Returns the text of the command line for a refused request."""
    lines: List[str] = []
    for problem in problems:
        lines.append(f"error: {problem['message']}")
        if problem.get("expected"):
            lines.append(f"  = expected: {problem['expected']}")
        if problem.get("nearest"):
            lines.append("  = nearest: " + ", ".join(f"`{name}`" for name in problem["nearest"]))
    return "\n".join(lines)
