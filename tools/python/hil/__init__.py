"""Hardware-in-the-loop runs from Python.

    import hil

    run = hil.run("scenarios/severe-leakage.toml", set={"controller.law": "pid"})
    run.verdict, run.digest
    run["truth.surface_angle_rad"].max()

`run` starts the program `hil`; `open` reads a run that was recorded earlier; `Session` executes a run step by step, and
`evaluate` runs a scenario at many points. `plant` and `law` make plants and laws of classes. Nothing is imported
before it is used, so that `import hil` costs a script nothing.
"""

# Type checkers know this name, and `typing` would take longer to import than this package.
TYPE_CHECKING = False

if TYPE_CHECKING:
    from .array import Signal as Signal
    from . import math as math
    from .arguments import Interval as Interval
    from .arguments import Sample as Sample
    from .arguments import Setup as Setup
    from .declare import fault as fault
    from .declare import law as law
    from .declare import parameter as parameter
    from .declare import plant as plant
    from .declare import signal as signal
    from .errors import CommandError as CommandError
    from .errors import DeclarationError as DeclarationError
    from .errors import Diverged as Diverged
    from .errors import Error as Error
    from .errors import InfrastructureError as InfrastructureError
    from .errors import Interrupted as Interrupted
    from .errors import ProgramError as ProgramError
    from .errors import RecordingError as RecordingError
    from .errors import SessionError as SessionError
    from .errors import UnknownSignal as UnknownSignal
    from .errors import UsageError as UsageError
    from .evaluation import Evaluation as Evaluation
    from .evaluation import evaluate as evaluate
    from .launch import run as run
    from .result import Run as Run
    from .result import open as open
    from .session import Observation as Observation
    from .session import Saved as Saved
    from .session import Session as Session
    from .session import SessionResult as SessionResult
    from .verdict import Metric as Metric
    from .verdict import Verdict as Verdict
    from .side import run as main

_MODULES = {
    "Signal": "array",
    "CommandError": "errors",
    "DeclarationError": "errors",
    "Diverged": "errors",
    "Error": "errors",
    "InfrastructureError": "errors",
    "Interrupted": "errors",
    "ProgramError": "errors",
    "RecordingError": "errors",
    "SessionError": "errors",
    "UnknownSignal": "errors",
    "UsageError": "errors",
    "Evaluation": "evaluation",
    "evaluate": "evaluation",
    "run": "launch",
    "Interval": "arguments",
    "Sample": "arguments",
    "Setup": "arguments",
    "fault": "declare",
    "law": "declare",
    "parameter": "declare",
    "plant": "declare",
    "signal": "declare",
    "Run": "result",
    "open": "result",
    "Observation": "session",
    "Saved": "session",
    "Session": "session",
    "SessionResult": "session",
    "Metric": "verdict",
    "Verdict": "verdict",
}

#: Functions that have another name in their module.
_RENAMED = {"main": ("side", "run")}
_SUBMODULES = ("gym", "math")

__all__ = [
    "CommandError",
    "DeclarationError",
    "Diverged",
    "Error",
    "Evaluation",
    "InfrastructureError",
    "Interrupted",
    "Interval",
    "Metric",
    "Observation",
    "ProgramError",
    "RecordingError",
    "Run",
    "Sample",
    "Saved",
    "Session",
    "SessionError",
    "SessionResult",
    "Setup",
    "Signal",
    "UnknownSignal",
    "UsageError",
    "Verdict",
    "evaluate",
    "fault",
    "law",
    "main",
    "math",
    "open",
    "parameter",
    "plant",
    "run",
    "signal",
]


def __getattr__(name: str) -> object:
    from importlib import import_module

    if name in _SUBMODULES:
        return import_module(f"{__name__}.{name}")
    if name not in _MODULES and name not in _RENAMED:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module, attribute = _RENAMED.get(name) or (_MODULES[name], name)
    value: object = getattr(import_module(f"{__name__}.{module}"), attribute)
    globals()[name] = value
    return value


def __dir__() -> "list[str]":
    return sorted({*globals(), *__all__})
