"""A run as HTML, for notebooks: verdict, requirements, metrics and small plots.

One piece of HTML without scripts; every text is escaped.
"""

from __future__ import annotations

import re
from html import escape
from typing import TYPE_CHECKING, Iterable, List, Optional, Sequence, Tuple

import numpy as np
from numpy.typing import NDArray

from .errors import Error

if TYPE_CHECKING:
    from .result import Run

WIDTH, HEIGHT = 320, 110
#: Points of a curve: each is the least and the greatest value of a part of the run.
PARTS = WIDTH // 2
MOST_PLOTS = 4
COLOURS = ("#1f6fb4", "#d9822b")
VERDICT_COLOURS = {"pass": "#1a7f37", "fail": "#cf222e", "aborted": "#cf222e"}

Values = NDArray[np.float64]


def page(run: Run) -> str:
    """Returns the HTML of a run."""
    parts = [f"<p>{heading(run)}</p>"]
    if run.summary is not None:
        parts.append(
            table(
                ("requirement", "verdict", "robustness", "at [s]"),
                [
                    (v.name, v.verdict, with_unit(v.robustness, v.unit), with_unit(v.at_s, ""))
                    for v in run.verdicts.values()
                ],
            )
        )
        parts.append(
            table(
                ("metric", "window [s]", "value"),
                [
                    (m.name, f"{m.window_s[0]:g} to {m.window_s[1]:g}", with_unit(m.value, m.unit))
                    for m in run.metrics
                ],
            )
        )
    if run.is_recorded:
        try:
            parts += plots(run)
        except Error as error:  # a damaged recording has verdicts all the same
            parts.append(f"<p>{escape(str(error))}</p>")
    return f"<div>{''.join(parts)}</div>"


def heading(run: Run) -> str:
    """Returns folder, verdict and digest."""
    words = [f"<b>{escape(str(run.folder))}</b>"]
    if run.summary is not None:
        colour = VERDICT_COLOURS.get(run.verdict, "inherit")
        words.append(f'<b style="color:{colour}">{escape(run.verdict)}</b>')
        if run.reason:
            words.append(escape(run.reason))
    if run.digest:
        words.append(f"digest <code>{escape(run.digest[:16])}</code>")
    return " ".join(words)


def with_unit(value: Optional[float], unit: str) -> str:
    """Returns a figure as people read it."""
    return "" if value is None else f"{value:.5g} {unit}".strip()


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Returns a table, or nothing if it would be empty."""

    def line(cells: Iterable[str], tag: str) -> str:
        return "<tr>" + "".join(f"<{tag}>{escape(cell)}</{tag}>" for cell in cells) + "</tr>"

    body = "".join(line(row, "td") for row in rows)
    return f"<table>{line(head, 'th')}{body}</table>" if body else ""


def plots(run: Run) -> List[str]:
    """Returns a plot of each of the first signals that have a reference, then of those that requirements name."""
    signals = run.signals
    truth = [name for name in signals if name.startswith("truth.")]
    chosen = [[name, f"reference.{name[6:]}"] for name in truth if f"reference.{name[6:]}" in signals]
    drawn = {name for pair in chosen for name in pair}
    formulas = " ".join(verdict.formula for verdict in run.verdicts.values()) if run.summary else ""
    judged = dict.fromkeys(name for name in re.findall(r"\w+\.\w+", formulas) if name in signals and name not in drawn)
    chosen += [[name] for name in judged]
    chosen = (chosen or [[name] for name in truth])[:MOST_PLOTS]
    if not chosen:
        return []
    arrays = run.to_numpy([name for names in chosen for name in names])
    time_s = np.asarray(arrays["time_s"])
    return [plot(time_s, [(name, signals[name], np.asarray(arrays[name])) for name in names]) for names in chosen]


def plot(time_s: Values, curves: Sequence[Tuple[str, str, Values]]) -> str:
    """Returns curves over time as SVG."""
    finite = [values[np.isfinite(values)] for _, _, values in curves]
    all_values = np.concatenate(finite)
    if len(all_values) == 0:
        return ""
    low, high = float(all_values.min()), float(all_values.max())
    span = high - low or 1.0
    lines = [
        f'<path d="{outline(values, low, span)}" fill="none" stroke="{COLOURS[number % len(COLOURS)]}"/>'
        for number, (_, _, values) in enumerate(curves)
    ]
    keys = "; ".join(
        f'<span style="color:{COLOURS[number % len(COLOURS)]}">{escape(name)}</span>'
        for number, (name, _, _) in enumerate(curves)
    )
    unit = escape(curves[0][1])
    title = f"{keys} [{unit}], {low:.4g} to {high:.4g}, {float(time_s[0]):g} s to {float(time_s[-1]):g} s"
    return (
        f'<figure style="display:inline-block;margin:4px"><figcaption>{title}</figcaption>'
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{WIDTH}" height="{HEIGHT}" '
        f'viewBox="0 0 {WIDTH} {HEIGHT}">{"".join(lines)}</svg></figure>'
    )


def outline(values: Values, low: float, span: float) -> str:
    """Returns a path through the least and greatest value of each part, with gaps where there is no value."""
    commands: List[str] = []
    pen = "M"
    for number, part in enumerate(np.array_split(values, min(PARTS, len(values)))):
        part = part[np.isfinite(part)]
        if len(part) == 0:
            pen = "M"
            continue
        x = (number + 0.5) * WIDTH / min(PARTS, len(values))
        ends = (part.min(), part.max()) if part[0] <= part[-1] else (part.max(), part.min())
        for value in ends:
            y = HEIGHT - 4 - (float(value) - low) / span * (HEIGHT - 8)
            commands.append(f"{pen}{x:.1f} {y:.1f}")
            pen = "L"
    return "".join(commands)
