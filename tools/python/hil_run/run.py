"""A recorded run, as its reader sees it."""

from __future__ import annotations

import json
from difflib import get_close_matches
from fnmatch import fnmatchcase
from functools import cached_property
from os import PathLike
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Dict, Iterable, List, Mapping, Optional, Tuple, Union

import numpy as np
from numpy.typing import NDArray

from .recording import ChunkPlace, Column, Recording, RecordingError

if TYPE_CHECKING:
    import pandas

RECORDING = "run.mcap"
SUMMARY = "summary.json"

Array = Union[NDArray[np.float64], NDArray[np.uint64]]


def load(path: Union[str, "PathLike[str]"]) -> Run:
    """Opens a run: its folder, or its `run.mcap`. Reads no record yet."""
    place = Path(path)
    if place.is_dir():
        place = place / RECORDING
        if not place.exists():
            raise RecordingError(f"{path} has no recording; the run used --no-record, or this is not the folder of a run")
    return Run(Recording(place))


class Run:
    """A recorded run. Records are read from the file whenever they are asked for."""

    def __init__(self, recording: Recording) -> None:
        self._recording = recording

    def __repr__(self) -> str:
        cut = "" if self.is_whole else ", cut off"
        return f"<Run {self.path}: {len(self.signals)} signals at {self.rate_hz} Hz{cut}>"

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
        """Whether the recording was finished; one whose writer was killed is read as far as it goes."""
        return self._recording.is_whole

    @cached_property
    def signals(self) -> Mapping[str, str]:
        """The unit of each signal, by its full name, in the order of a record."""
        columns = self._recording.columns
        return MappingProxyType({column.name: column.unit for column in columns if column.is_signal})

    @property
    def metadata(self) -> Mapping[str, Mapping[str, str]]:
        """What is written about the run: `hil.run` before it, `hil.result` after it."""
        return self._recording.metadata

    @property
    def digest(self) -> Optional[str]:
        """The digest that was recorded with the run; `None` if it has none."""
        return self.metadata.get("hil.result", {}).get("digest") or None

    @property
    def scenario(self) -> str:
        """The effective scenario, as TOML."""
        return self._recording.attachments.get("scenario.toml", "")

    @cached_property
    def summary(self) -> Optional[Dict[str, Any]]:
        """`summary.json`, if it lies beside the recording."""
        path = self.path.with_name(SUMMARY)
        if not path.exists():
            return None
        summary: Dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        return summary

    @cached_property
    def events(self) -> List[Dict[str, Any]]:
        """What happened: faults that were accepted, took effect and ended, and the end of the run."""
        return list(self._recording.events())

    @property
    def faults(self) -> List[Dict[str, Any]]:
        """The faults that took effect, each with kind, target and the step from which it acted."""
        return [event for event in self.events if event["event"] == "fault"]

    def to_numpy(
        self,
        names: Union[str, Iterable[str], None] = None,
        window_s: Optional[Tuple[float, float]] = None,
        every: int = 1,
    ) -> Dict[str, Array]:
        """Signals as arrays, one value for each step, beside `step` and `time_s`.

        `names` are full names or patterns with `*` and `?`, all signals without; words of measured time
        such as `round_trip_ns` are there by name, as integers, 0 where a step has none. Both ends of `window_s` belong to it. `every` picks its
        first step and then each n-th; it filters nothing. A value that does not exist is NaN.
        """
        if every < 1:
            raise ValueError(f"every is {every}, but has to be at least 1")
        places = self._places(names)
        columns = self._recording.columns
        words = self._words([0, *places], window_s, every)
        arrays: Dict[str, Array] = {"step": words[0], "time_s": words[0] / self.rate_hz}
        for row, place in zip(words[1:], places):
            column = columns[place]
            arrays[column.name] = row.view(np.float64) if column.is_signal else row
        return arrays

    def to_pandas(
        self,
        names: Union[str, Iterable[str], None] = None,
        window_s: Optional[Tuple[float, float]] = None,
        every: int = 1,
    ) -> pandas.DataFrame:
        """Like `to_numpy`, as a frame over `time_s`; `frame.attrs["units"]` has the units."""
        import pandas

        arrays = self.to_numpy(names, window_s, every)
        time_s = pandas.Index(arrays.pop("time_s"), name="time_s")
        frame = pandas.DataFrame(arrays, index=time_s, copy=False)
        frame.attrs["units"] = {name: self.signals[name] for name in arrays if name in self.signals}
        return frame

    def _places(self, names: Union[str, Iterable[str], None]) -> List[int]:
        """Where the wanted words stand in a record, in the order in which they are wanted."""
        columns = self._recording.columns
        if names is None:
            return [place for place, column in enumerate(columns) if column.is_signal]
        places: Dict[int, None] = {}
        for name in [names] if isinstance(names, str) else names:
            found = [place for place, column in enumerate(columns) if place and matches(column, name)]
            if not found:
                near = get_close_matches(name, [column.name for column in columns])
                hint = f"; nearest: {', '.join(near)}" if near else ""
                raise LookupError(f"{self.path} has no signal `{name}`{hint}")
            places.update(dict.fromkeys(found))
        return list(places)

    def _words(self, places: List[int], window_s: Optional[Tuple[float, float]], every: int) -> NDArray[np.uint64]:
        """Those words of the steps in the window: a row for each word, the first being the step."""
        rate_hz = self.rate_hz
        from_s, until_s = window_s or (-np.inf, np.inf)
        # A nanosecond more: the times of chunks are rounded.
        first_ns, last_ns = from_s * 1e9 - 1, until_s * 1e9 + 1

        def wanted(chunk: ChunkPlace) -> bool:
            return chunk.end_ns >= first_ns and chunk.start_ns <= last_ns

        blocks: List[NDArray[np.uint64]] = []
        first: Optional[np.uint64] = None
        for block in self._recording.blocks(wanted):
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


def matches(column: Column, name: str) -> bool:
    """Whether a name or pattern means a column."""
    return column.name == name or fnmatchcase(column.name, name)
