"""Starts `hil run` for one scenario and returns the run."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, Iterable, List, Mapping, Optional, Sequence, Union

from .errors import of_exit_code
from .programs import Output, execute, parsed
from .result import Run
from .values import settings

RUNS = "runs"
SUMMARY = "summary.json"

Location = Union[str, "os.PathLike[str]"]


def run(
    scenario: Location,
    *,
    set: Optional[Mapping[str, object]] = None,
    clock: Optional[str] = None,
    pace: Optional[float] = None,
    link: Optional[str] = None,
    out: Optional[Location] = None,
    session: Optional[str] = None,
    record: Union[bool, str, Iterable[str]] = True,
    plant_bin: Optional[Location] = None,
    controller_bin: Optional[Location] = None,
    wait_limit_s: Optional[float] = None,
    options: Sequence[str] = (),
) -> Run:
    """Runs a scenario with the program `hil` and returns the run, whatever its verdict.

    `set` changes values of the scenario; lists and mappings become arrays and tables. `record` is `False` for a run
    without a recording, or the signals to record, as names and patterns. `clock`, `pace`, `link`, `out`, `session`,
    `plant_bin`, `controller_bin` and `wait_limit_s` are the options of `hil run` of these names, and `options` has
    further ones as on the command line.

    Raises `UsageError` if nothing could be started, `InfrastructureError` if a process died or a wait timed out, and
    `ProgramError` without a program `hil`. Ctrl-C ends the run and raises KeyboardInterrupt.
    """
    arguments: List[str] = ["run", "--json"]
    for setting in settings(set):
        arguments += ["--set", setting]
    named = {
        "--clock": clock,
        "--pace": pace,
        "--link": link,
        "--out": out,
        "--session": session,
        "--plant-bin": plant_bin,
        "--controller-bin": controller_bin,
        "--wait-limit": wait_limit_s,
    }
    for name, argument in named.items():
        if argument is not None:
            # In one word: a value may begin with a dash.
            arguments.append(f"{name}={os.fspath(argument) if isinstance(argument, os.PathLike) else argument}")
    if record is False:
        arguments.append("--no-record")
    elif record is not True:
        arguments += [f"--record={pattern}" for pattern in ([record] if isinstance(record, str) else record)]
    return _run_of(execute([*arguments, *options, "--", os.fspath(scenario)]), out)


def _run_of(output: Output, out: Optional[Location]) -> Run:
    result = parsed(output.stdout)
    facts = result if isinstance(result, dict) else {}
    folder = _folder(facts, out)
    run = Run(folder, messages=output.stderr) if folder else None
    # A failed requirement and a plant that diverged have a summary as well.
    if output.exit_code in (0, 1) and run is not None:
        return run
    text = output.stderr
    if output.exit_code == 0:
        text = "`hil run` printed no summary of a single run; start suites and audits on the command line"
    problems = facts.get("problems", [])
    raise of_exit_code(output.exit_code)(output.command, output.exit_code, text, problems, run)


def _folder(facts: Mapping[str, Any], out: Optional[Location]) -> Optional[Path]:
    """Returns the folder of a run, from its summary; `None` if there is no summary."""
    session = facts.get("session")
    if session is None:
        return None
    if out is not None:
        return Path(out)
    folders = [path.parent for path in Path(RUNS).glob(f"*-{session}/{SUMMARY}")]
    # A session of the same name may have run earlier; names begin with the scenario, then the time.
    return max(folders, key=lambda folder: folder.stat().st_mtime_ns, default=None)
