"""The program `hil` and its start.

Looked for in this order: the environment variable `HIL_BIN`, the folder `bin` of this package, which a wheel fills,
and PATH. `hil` finds its other programs beside itself.
"""

from __future__ import annotations

import os
import sys
from typing import Any, Dict, List, NamedTuple, Optional, Sequence

from .errors import ProgramError, of_exit_code

NAME = "hil"
#: Environment variable with the path of the program.
VARIABLE = "HIL_BIN"
#: Environment variable with the interpreter of plants and laws in Python.
PYTHON = "HIL_PYTHON"
#: Written in the script that pip makes for the command `hil` of this package.
ENTRY_POINT = b"hil.__main__"


class Output(NamedTuple):
    """Result of a finished command."""

    command: List[str]
    exit_code: int
    stdout: str
    stderr: str


def find() -> str:
    """Returns the path of the program `hil`."""
    chosen = os.environ.get(VARIABLE)
    if chosen:
        if not _is_program(chosen):
            raise ProgramError(f"{VARIABLE} is {chosen}, which is no executable file; name the program `hil` itself")
        return os.path.abspath(chosen)
    packaged = os.path.join(os.path.dirname(os.path.abspath(__file__)), "bin", NAME)
    if _is_program(packaged):
        return packaged
    if os.path.exists(packaged):
        raise ProgramError(f"{packaged} is not executable; install the wheel again")
    for folder in os.get_exec_path():
        path = os.path.join(folder, NAME)
        # The command of this package would call itself.
        if _is_program(path) and not _is_entry_point(path):
            return os.path.abspath(path)
    raise ProgramError(
        f"the program `hil` is not in this package, {VARIABLE} is not set, and PATH has none; "
        f"install the wheel that tools/python/build makes, or set {VARIABLE} to target/release/hil of a clone"
    )


def _is_program(path: str) -> bool:
    return os.path.isfile(path) and os.access(path, os.X_OK)


def _is_entry_point(path: str) -> bool:
    try:
        with open(path, "rb") as file:
            begin = file.read(4096)
    except OSError:
        return False
    return begin.startswith(b"#!") and ENTRY_POINT in begin


def cannot_start(program: str, error: OSError) -> ProgramError:
    """Describes a program that the system refuses to start."""
    reason = error.strerror
    if isinstance(error, FileNotFoundError) and os.path.exists(program):
        reason = "its loader is missing"  # as on a system with musl
    return ProgramError(
        f"cannot start {program}: {reason}; the wheel needs Linux with glibc, of the processor and version in its name"
    )


def environment() -> Dict[str, str]:
    """Returns the environment of `hil`, whose plants and laws in Python use this interpreter unless another is named."""
    own = {PYTHON: sys.executable} if sys.executable else {}
    return {**own, **os.environ}


def execute(arguments: Sequence[str], words: Optional[str] = None) -> Output:
    """Runs `hil` to its end and returns its output; Ctrl-C ends `hil` first, which then cleans up.

    `words` are its standard input.
    """
    # Not above: the command `hil` of this package needs neither.
    import subprocess
    from signal import SIGINT

    command = [find(), *arguments]
    try:
        child = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL if words is None else subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            env=environment(),
        )
    except OSError as error:
        raise cannot_start(command[0], error) from error
    with child:
        try:
            stdout, stderr = child.communicate(None if words is None else words.encode())
        except BaseException:
            # At a terminal `hil` got the signal too; two have the effect of one. It ends after bounded waits.
            child.send_signal(SIGINT)
            try:
                child.communicate()
            except BaseException:
                child.kill()
                raise
            raise
    return Output(command, child.returncode, stdout.decode(errors="replace"), stderr.decode(errors="replace"))


def succeed(arguments: Sequence[str]) -> str:
    """Runs `hil` and returns its standard output.

    Raises the `CommandError` of the exit code if it is not 0.
    """
    output = execute(arguments)
    if output.exit_code != 0:
        raise of_exit_code(output.exit_code)(output.command, output.exit_code, output.stderr)
    return output.stdout


def parsed(text: str) -> Any:
    """Returns the JSON of a command, or `None` if it printed none."""
    import json

    try:
        return json.loads(text)
    except ValueError:
        return None
