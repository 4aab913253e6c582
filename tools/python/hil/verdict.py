"""Verdicts and metrics of a run."""

from __future__ import annotations

from typing import NamedTuple, Optional, Tuple


class Verdict(NamedTuple):
    """Verdict on a requirement; the numbers are `None` where it was not decided."""

    name: str
    formula: str
    verdict: str
    robustness: Optional[float]
    unit: str
    at_s: Optional[float]
    decided_at_s: Optional[float]


class Metric(NamedTuple):
    """Value of a metric in a window of simulated time; `None` where it has no value."""

    name: str
    window_s: Tuple[float, float]
    value: Optional[float]
    unit: str
