"""Hardware-in-the-loop runs from Python.

    import hil

    run = hil.run("scenarios/severe-leakage.toml", set={"controller.law": "pid"})
    run.verdict, run.digest
    run["truth.surface_angle_rad"].max()

`run` starts the program `hil`; `open` reads a run that was recorded earlier; `Session` executes a run step by step in
this process. Nothing is imported before it is used, so that `import hil` costs a script nothing.
"""

# Type checkers know this name, and `typing` would take longer to import than this package.
TYPE_CHECKING = False

if TYPE_CHECKING:
    from .array import Signal as Signal
    from .errors import CommandError as CommandError
    from .errors import Error as Error
    from .errors import InfrastructureError as InfrastructureError
    from .errors import Interrupted as Interrupted
    from .errors import NativeError as NativeError
    from .errors import ProgramError as ProgramError
    from .errors import RecordingError as RecordingError
    from .errors import SessionError as SessionError
    from .errors import UnknownSignal as UnknownSignal
    from .errors import UsageError as UsageError
    from .launch import run as run
    from .result import Run as Run
    from .result import open as open
    from .session import Observation as Observation
    from .session import Saved as Saved
    from .session import Session as Session
    from .session import SessionResult as SessionResult
    from .verdict import Metric as Metric
    from .verdict import Verdict as Verdict

_MODULES = {
    "Signal": "array",
    "CommandError": "errors",
    "Error": "errors",
    "InfrastructureError": "errors",
    "Interrupted": "errors",
    "NativeError": "errors",
    "ProgramError": "errors",
    "RecordingError": "errors",
    "SessionError": "errors",
    "UnknownSignal": "errors",
    "UsageError": "errors",
    "run": "launch",
    "Run": "result",
    "open": "result",
    "Observation": "session",
    "Saved": "session",
    "Session": "session",
    "SessionResult": "session",
    "Metric": "verdict",
    "Verdict": "verdict",
}

__all__ = [
    "CommandError",
    "Error",
    "InfrastructureError",
    "Interrupted",
    "Metric",
    "NativeError",
    "Observation",
    "ProgramError",
    "RecordingError",
    "Run",
    "Saved",
    "Session",
    "SessionError",
    "SessionResult",
    "Signal",
    "UnknownSignal",
    "UsageError",
    "Verdict",
    "open",
    "run",
]


def __getattr__(name: str) -> object:
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    value: object = getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> "list[str]":
    return sorted({*globals(), *__all__})
