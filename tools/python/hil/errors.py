"""Exceptions of this package, all below `Error`.

    Error
    +-- CommandError             a command of `hil` failed; `text` is what it printed
    |   +-- UsageError           exit code 2: wrong usage or configuration, nothing was started
    |   +-- InfrastructureError  exit code 3: a process died, a wait timed out, a disk is full
    |   +-- Interrupted          exit code 130: another process interrupted `hil`
    +-- ProgramError             the program `hil`, or the native part of this package, is missing or cannot be started
    +-- SessionError             a session cannot be used like this: closed, over, in another thread, after a fork
    +-- RecordingError           a file is not a recording of a run, or a damaged one
    +-- UnknownSignal            a run or session has no signal of that name; also a KeyError
    +-- DeclarationError         a class is no sound plant or law; also a TypeError
    +-- Diverged                 raised by a plant whose equations have left their range

A failed requirement is a result and no exception.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Dict, Iterable, List, Optional, Sequence

if TYPE_CHECKING:
    from .result import Run


class Error(Exception):
    """Base of all exceptions of this package."""


class CommandError(Error):
    """A command of `hil` failed.

    `command` has its words, `exit_code` its exit code (negative: the number of a signal that killed it) and `text`
    what it wrote to standard error. `run` is the run as far as it went, if it left a summary.
    """

    def __init__(
        self,
        command: Sequence[str],
        exit_code: int,
        text: str,
        problems: Sequence[Dict[str, Any]] = (),
        run: Optional[Run] = None,
    ) -> None:
        self.command: List[str] = list(command)
        self.exit_code = exit_code
        self.text = text
        self.problems: List[Dict[str, Any]] = list(problems)
        self.run = run
        reason = run.reason if run is not None else None
        words = [part for part in (reason, text.strip()) if part]
        super().__init__("\n".join(words) or f"`{' '.join(command[:2])}` {end_in_words(exit_code)}")

    def __reduce__(self) -> Any:
        return (type(self), (self.command, self.exit_code, self.text, self.problems, self.run))


class UsageError(CommandError):
    """Wrong usage or configuration; nothing was started. `problems` has each problem of a scenario."""


class InfrastructureError(CommandError):
    """A process died, a wait timed out, a disk is full, or shared memory is missing."""


class Interrupted(CommandError):
    """Another process interrupted `hil`; Ctrl-C raises KeyboardInterrupt as everywhere in Python."""


class ProgramError(Error):
    """The program `hil`, or the native part of this package, is missing or cannot be started."""


class SessionError(Error):
    """A session cannot be used like this: it is closed or over, or belongs to another thread or process."""


class RecordingError(Error):
    """A file is not a recording of a run, or a damaged one."""


class UnknownSignal(Error, KeyError):
    """A run or session has no signal of that name; `nearest` has similar names."""

    def __init__(self, name: str, place: str, names: Iterable[str], note: str = "", owner: str = "run") -> None:
        from difflib import get_close_matches

        self.name = name
        self.nearest: List[str] = get_close_matches(name, list(names))
        hint = f"nearest: {', '.join(self.nearest)}" if self.nearest else f"`{owner}.signals` has all names"
        self._text = f"{place} has no signal `{name}`; {hint}{note}"
        super().__init__(self._text)

    def __str__(self) -> str:
        return self._text  # KeyError would quote it

    def __reduce__(self) -> Any:
        return (_restore, (type(self), self.name, self.nearest, self._text))


class DeclarationError(Error, TypeError):
    """A class is no sound plant or law."""


class Diverged(Error):
    """Raised by a plant: the run ends as diverged, with this reason. Raised by a law, it is an exception like any other."""


def _restore(kind: type[UnknownSignal], name: str, nearest: List[str], text: str) -> UnknownSignal:
    error = kind.__new__(kind, text)
    error.name, error.nearest, error._text = name, nearest, text
    return error


def of_exit_code(exit_code: int) -> type[CommandError]:
    """Returns the class of an exit code."""
    if exit_code < 0:
        return InfrastructureError
    return {2: UsageError, 3: InfrastructureError, 130: Interrupted}.get(exit_code, CommandError)


def end_in_words(exit_code: int) -> str:
    """Describes the end of a process that printed nothing."""
    if exit_code >= 0:
        return f"ended with exit code {exit_code}"
    from signal import Signals

    try:
        return f"was killed by {Signals(-exit_code).name}"
    except ValueError:
        return f"was killed by signal {-exit_code}"
