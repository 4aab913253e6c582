"""A recorded run: verdicts, figures and signals."""

from __future__ import annotations

import json
from fnmatch import fnmatchcase
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Dict, Iterable, List, Mapping, Optional, Tuple, Union

import numpy as np
from numpy.typing import NDArray

from . import derived
from .array import Signal
from .errors import ProgramError, RecordingError, UnknownSignal
from .programs import parsed, succeed
from .recording import ChunkPlace, Recording
from .verdict import Metric, Verdict

if TYPE_CHECKING:
    import os

    import pandas
    import polars
    import pyarrow

RECORDING = "run.mcap"
SUMMARY = "summary.json"
LATEST = "latest"

Names = Union[str, Iterable[str], None]
Window = Optional[Tuple[float, float]]


def open(path: Union[str, "os.PathLike[str]"] = LATEST) -> Run:
    """Opens a run: its folder, its `run.mcap`, or `latest`, the newest run below the folder `runs`.

    Reads no record yet.
    """
    place = Path(path)
    if path == LATEST:
        runs: List[Dict[str, Any]] = (parsed(succeed(["runs", "--json", "--last", "1"])) or {}).get("runs", [])
        if not runs:
            raise RecordingError(f"there is no run below {Path('runs').absolute()}")
        place = Path(runs[0]["run"])
    if not place.is_dir():
        return Run(place.parent, Recording(place))
    if (place / RECORDING).exists():
        return Run(place, Recording(place / RECORDING))
    if (place / SUMMARY).exists():
        return Run(place)
    raise RecordingError(f"{path} has no recording and no summary.json: this is not the folder of a run")


class Run:
    """A recorded run. Records are read from the file whenever they are asked for.

    `run["truth.position_m"]` is a signal over the whole run; `to_numpy`, `to_pandas`, `to_polars` and `to_arrow` take
    several at once, of a window of simulated time.
    """

    def __init__(self, folder: Path, recording: Optional[Recording] = None, messages: str = "") -> None:
        #: Folder of the run.
        self.folder = folder
        #: What `hil run` wrote to standard error, such as warnings; empty for a run that was opened.
        self.messages = messages
        if recording is not None:
            self._recording = recording

    @cached_property
    def _recording(self) -> Recording:
        path = self.folder / RECORDING
        if not path.exists():
            raise RecordingError(f"{self.folder} has no recording, because the run was not to be recorded")
        return Recording(path)

    def __reduce__(self) -> Any:
        # Without what was read: another process reads the files itself.
        return (_restore, (self.folder, self.path if self.is_recorded else None, self.messages))

    def __repr__(self) -> str:
        verdict = self.summary["verdict"] if self.summary else "no verdict"
        return f"<Run {self.folder}: {verdict}>"

    def _repr_html_(self) -> str:
        from .page import page

        return page(self)

    @property
    def path(self) -> Path:
        """The recording."""
        return self._recording.path

    @property
    def rate_hz(self) -> float:
        """Steps per simulated second."""
        return self._recording.rate_hz

    @property
    def is_whole(self) -> bool:
        """`True` if the recording was finished; one whose writer was killed is read as far as it goes."""
        return self._recording.is_whole

    @property
    def is_recorded(self) -> bool:
        """`True` if the run has a recording."""
        return "_recording" in self.__dict__ or (self.folder / RECORDING).exists()

    @cached_property
    def signals(self) -> Mapping[str, str]:
        """The unit of each recorded signal, by its full name, in the order of a record."""
        columns = self._recording.columns
        return MappingProxyType({column.name: column.unit for column in columns if column.is_signal})

    @cached_property
    def derived(self) -> Mapping[str, str]:
        """The unit of each derived signal of the scenario, by its name; `hil export` computes them."""
        return MappingProxyType(derived.units(self.path))

    @property
    def metadata(self) -> Mapping[str, Mapping[str, str]]:
        """Entries in the recording about the run: `hil.run` from its begin, `hil.result` from its end."""
        return self._recording.metadata

    @property
    def scenario(self) -> str:
        """The effective scenario, as TOML."""
        if self.is_recorded:
            return self._recording.attachments.get("scenario.toml", "")
        return (self.folder / "scenario.toml").read_text(encoding="utf-8")

    @cached_property
    def summary(self) -> Optional[Dict[str, Any]]:
        """Content of `summary.json`; `None` if it does not lie beside the recording."""
        path = self.folder / SUMMARY
        if not path.exists():
            return None
        summary: Dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        return summary

    def _fact(self, name: str) -> Any:
        if self.summary is None:
            raise RecordingError(f"{self.folder} has no summary.json, and so no {name}")
        return self.summary.get(name)

    @property
    def digest(self) -> Optional[str]:
        """The digest of the run; `None` if a record was lost or the run did not end."""
        recorded = self.metadata.get("hil.result", {}).get("digest") if self.is_recorded else None
        return recorded or (self.summary or {}).get("digest")

    @property
    def verdict(self) -> str:
        """`pass`, `fail` or `aborted`."""
        return str(self._fact("verdict"))

    @property
    def passed(self) -> bool:
        """`True` if all requirements passed."""
        return self.verdict == "pass"

    @property
    def reason(self) -> Optional[str]:
        """The reason of an early end."""
        reason: Optional[str] = self._fact("reason")
        return reason

    @cached_property
    def verdicts(self) -> Mapping[str, Verdict]:
        """The verdict on each requirement, by its name."""
        rows = self._fact("requirements") or []
        verdicts = [Verdict(*(row.get(field) for field in Verdict._fields)) for row in rows]
        return MappingProxyType({verdict.name: verdict for verdict in verdicts})

    @cached_property
    def metrics(self) -> Tuple[Metric, ...]:
        """Each metric in each of its windows."""
        rows = self._fact("metrics") or []
        return tuple(Metric(row["name"], tuple(row["window_s"]), row["value"], row["unit"]) for row in rows)

    @cached_property
    def events(self) -> List[Dict[str, Any]]:
        """What happened: faults that were accepted, took effect and ended, and the end of the run."""
        return list(self._recording.events())

    @property
    def faults(self) -> List[Dict[str, Any]]:
        """The faults that took effect, each with kind, target and the step from which it acted."""
        return [event for event in self.events if event["event"] == "fault"]

    @cached_property
    def time_s(self) -> Signal:
        """Simulated time of each record."""
        return self.to_numpy([])["time_s"]

    def __getitem__(self, name: str) -> Signal:
        """Returns a signal, recorded or derived, over the whole run."""
        return self.signal(name)

    def __contains__(self, name: object) -> bool:
        return name in self.signals or (isinstance(name, str) and "." not in name and name in self.derived)

    def _ipython_key_completions_(self) -> List[str]:
        return list(self.signals)

    def signal(self, name: str, window_s: Window = None, every: int = 1) -> Signal:
        """Returns a signal, recorded or derived; `window_s` and `every` are those of `to_numpy`."""
        is_column = any(column.name == name for column in self._recording.columns)
        if not is_column and name not in self:
            raise self._unknown(name)
        return self.to_numpy(name, window_s, every)[name]

    def to_numpy(self, names: Names = None, window_s: Window = None, every: int = 1) -> Dict[str, Signal]:
        """Returns signals as arrays, one value for each step, after `step` and `time_s`.

        `names` are full names, or patterns with `*` and `?`; without them, all recorded signals. Derived signals have
        names without a dot. Words of measured time such as `round_trip_ns` are there by name, as integers, 0 where a
        step has none. Both ends of `window_s` belong to it. `every` picks its first step and then each n-th; it
        filters nothing. A value that does not exist is NaN.
        """
        if every < 1:
            raise ValueError(f"every is {every}; expected at least 1")
        columns = self._recording.columns
        chosen = self._choice(names)
        words = self._words([0, *(place for place in chosen.values() if place is not None)], window_s, every)
        steps = words[0]
        arrays = {"step": Signal(steps, "step", ""), "time_s": Signal(steps / self.rate_hz, "time_s", "s")}
        computed_names = [name for name, place in chosen.items() if place is None]
        computed = derived.read(self.path, computed_names, steps, self.rate_hz, every)
        rows = iter(words[1:])
        for name, place in chosen.items():
            if place is None:
                arrays[name] = Signal(computed[name], name, self.derived[name])
            else:
                row, column = next(rows), columns[place]
                arrays[name] = Signal(row.view(np.float64) if column.is_signal else row, name, column.unit)
        return arrays

    def to_pandas(self, names: Names = None, window_s: Window = None, every: int = 1) -> pandas.DataFrame:
        """Returns the arrays of `to_numpy` as a frame over `time_s`; `frame.attrs["units"]` has the units."""
        import pandas

        arrays = self.to_numpy(names, window_s, every)
        time_s = pandas.Index(np.asarray(arrays.pop("time_s")), name="time_s")
        frame = pandas.DataFrame({name: np.asarray(array) for name, array in arrays.items()}, index=time_s, copy=False)
        frame.attrs["units"] = {name: array.unit for name, array in arrays.items() if name != "step"}
        return frame

    def to_arrow(self, names: Names = None, window_s: Window = None, every: int = 1) -> pyarrow.Table:
        """Returns the arrays of `to_numpy` as an Arrow table, without a copy; its metadata has `units` as JSON."""
        import pyarrow

        arrays = self.to_numpy(names, window_s, every)
        units = {name: array.unit for name, array in arrays.items() if name != "step"}
        columns = {name: pyarrow.array(np.asarray(array)) for name, array in arrays.items()}
        return pyarrow.table(columns, metadata={"units": json.dumps(units, ensure_ascii=False)})

    def to_polars(self, names: Names = None, window_s: Window = None, every: int = 1) -> polars.DataFrame:
        """Returns the arrays of `to_numpy` as a frame of polars, by Arrow."""
        import polars

        frame = polars.from_arrow(self.to_arrow(names, window_s, every))
        assert isinstance(frame, polars.DataFrame)  # a table, not a column
        return frame

    def _choice(self, names: Names) -> Dict[str, Optional[int]]:
        """Returns the chosen names in order, each with its place in a record; `None` for a derived signal."""
        columns = self._recording.columns
        if names is None:
            return {column.name: place for place, column in enumerate(columns) if column.is_signal}
        choice: Dict[str, Optional[int]] = {}
        for name in [names] if isinstance(names, str) else names:
            matching: Dict[str, Optional[int]] = {
                column.name: place for place, column in enumerate(columns) if place and matches(column.name, name)
            }
            if "." not in name and name not in matching:
                matching.update(dict.fromkeys(key for key in self._derived_if_possible() if matches(key, name)))
            if not matching:
                raise self._unknown(name)
            choice.update(matching)
        return choice

    def _derived_if_possible(self) -> Mapping[str, str]:
        try:
            return self.derived
        except ProgramError:
            return {}

    def _unknown(self, name: str) -> UnknownSignal:
        note = ""
        names = [column.name for column in self._recording.columns]
        try:
            names += self.derived
        except ProgramError as error:
            note = f" (derived signals are unknown: {error})"
        return UnknownSignal(name, str(self.path), names, note)

    def _words(self, places: List[int], window_s: Window, every: int) -> NDArray[np.uint64]:
        """Returns those words of the steps in the window: a row for each word, the first being the step."""
        if window_s is None and every == 1:
            words = self._recording.columns_of_all(places)
            if words is not None:
                return words
        rate_hz = self.rate_hz
        from_s, until_s = window_s or (-np.inf, np.inf)
        # A nanosecond more: the times of chunks are rounded.
        first_ns, last_ns = from_s * 1e9 - 1, until_s * 1e9 + 1

        def overlaps(chunk: ChunkPlace) -> bool:
            return chunk.end_ns >= first_ns and chunk.start_ns <= last_ns

        blocks: List[NDArray[np.uint64]] = []
        first: Optional[np.uint64] = None
        for block in self._recording.blocks(overlaps):
            steps = block[:, 0]
            time_s = steps / rate_hz
            picked = (time_s >= from_s) & (time_s <= until_s)
            if first is None and picked.any():
                first = steps[picked.argmax()]
            if first is not None and every > 1:
                # By steps, not rows: where records were lost, the others keep their distance.
                picked &= (steps - first) % np.uint64(every) == 0
            rows = slice(None) if picked.all() else picked.nonzero()[0][:, np.newaxis]
            blocks.append(block[rows, places])
        words = np.empty((len(places), sum(map(len, blocks))), np.uint64)
        if blocks:
            np.concatenate([block.T for block in blocks], axis=1, out=words)
        return words


def _restore(folder: Path, path: Optional[Path], messages: str) -> Run:
    return Run(folder, Recording(path) if path else None, messages)


def matches(name: str, pattern: str) -> bool:
    """Returns `True` if a name or pattern means a column."""
    return name == pattern or fnmatchcase(name, pattern)
