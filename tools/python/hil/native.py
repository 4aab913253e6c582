"""The native part of the package, `hil._native`.

A wheel carries it in this package; in a clone it is the library beside the program `hil`.
"""

from __future__ import annotations

import os
import sys
from typing import Any

from .errors import ProgramError

NAME = "hil._native"
#: File that a build of the clone leaves beside the programs.
LIBRARY = "libhil_python.so"


def native() -> Any:
    """Returns the native module.

    Raises `ProgramError` if it is missing, or was built for another system.
    """
    from importlib import import_module

    if NAME in sys.modules:
        return sys.modules[NAME]
    try:
        return import_module(NAME)
    except ModuleNotFoundError as error:
        if error.name != NAME:
            raise
    except ImportError as error:
        raise _unusable(str(error)) from error
    return _beside_programs()


def _beside_programs() -> Any:
    from importlib.machinery import ExtensionFileLoader
    from importlib.util import module_from_spec, spec_from_file_location

    from .programs import find

    path = os.path.join(os.path.dirname(os.path.realpath(find())), LIBRARY)
    if not os.path.isfile(path):
        raise ProgramError(
            f"the native part of this package is missing, and {path} does not exist; install the wheel that "
            "tools/python/build makes, or build the clone with `cargo build --release`"
        )
    loader = ExtensionFileLoader(NAME, path)
    spec = spec_from_file_location(NAME, path, loader=loader)
    if spec is None:
        raise ProgramError(f"{path} is no extension module")
    try:
        module = module_from_spec(spec)
        loader.exec_module(module)
    except ImportError as error:
        raise _unusable(str(error)) from error
    sys.modules[NAME] = module
    return module


def _unusable(reason: str) -> ProgramError:
    return ProgramError(
        f"the native part of this package cannot be loaded: {reason}; the wheel needs Linux with glibc and CPython 3.9 "
        "or later"
    )
