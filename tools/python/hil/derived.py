"""Derived signals of a run, which are not recorded: `hil export` computes them from the records.

The code that judged the run computes them, so the values are the same to the bit.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Dict, List, Sequence

import numpy as np
from numpy.typing import NDArray

from .errors import RecordingError
from .programs import parsed, succeed


def units(recording: Path) -> Dict[str, str]:
    """Returns the unit of each derived signal, by its name."""
    listing: Dict[str, Any] = parsed(succeed(["export", "--list", "--json", "--", str(recording.absolute())])) or {}
    return {row["name"]: row["unit"] for row in listing.get("signals", []) if row["kind"] == "number" and "." not in row["name"]}


def read(
    recording: Path, names: Sequence[str], steps: NDArray[np.uint64], rate_hz: float, every: int
) -> Dict[str, NDArray[np.float64]]:
    """Returns these derived signals of those steps, of which `every` is the distance."""
    if not names or len(steps) == 0:
        return {name: np.empty(0) for name in names}
    arguments: List[str] = ["export", "--format", "csv", f"--every={every}"]
    # Half a step on each side, so that no rounding of a time matters.
    first_s, last_s = (int(steps[0]) - 0.5) / rate_hz, (int(steps[-1]) + 0.5) / rate_hz
    arguments += [f"--from={max(first_s, 0.0):.12f}", f"--until={last_s:.12f}"]
    arguments += [f"--signal={name}" for name in names]
    # Numbers are in the shortest form that reads back as the same bits; NaN and inf are as Python spells them.
    _, *lines = succeed([*arguments, "--", str(recording.absolute())]).splitlines()
    if len(lines) != len(steps):
        raise RecordingError(f"{recording} has {len(steps)} steps, of which `hil export` found {len(lines)}")
    table = np.array([line.split(",")[2:] for line in lines]).reshape(len(lines), len(names))
    return {name: table[:, column].astype(np.float64) for column, name in enumerate(names)}
