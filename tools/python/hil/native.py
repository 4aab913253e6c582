"""The native part of this package, loaded at its first use.

A wheel carries it as `hil/_native.abi3.so`. In a clone it lies beside the program `hil`, as `libhil_python.so`.
"""

from __future__ import annotations

import os
import sys
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Optional

from .errors import NativeError, ProgramError
from .programs import find

if TYPE_CHECKING:
    from types import ModuleType

NAME = "hil._native"
PACKAGED = "_native.abi3.so"
BUILT = "libhil_python.so"


@lru_cache(maxsize=None)
def load() -> Any:
    """Returns the module; raises `NativeError` where it is missing or cannot be loaded."""
    path = locate()
    if path is None:
        raise NativeError(
            f"this package has no {PACKAGED}, and there is no {BUILT} beside the program `hil`; "
            "install the wheel that tools/python/build makes, or run `cargo build --release` in the clone"
        )
    from importlib.machinery import ExtensionFileLoader
    from importlib.util import module_from_spec, spec_from_loader

    spec = spec_from_loader(NAME, ExtensionFileLoader(NAME, path), origin=path)
    assert spec is not None and spec.loader is not None
    try:
        module: ModuleType = module_from_spec(spec)
        spec.loader.exec_module(module)
    except ImportError as error:
        raise NativeError(_reason(path, error)) from error
    sys.modules[NAME] = module
    return module


def locate() -> Optional[str]:
    """Returns the path of the module; `None` if there is none."""
    packaged = os.path.join(os.path.dirname(os.path.abspath(__file__)), PACKAGED)
    if os.path.exists(packaged):
        return packaged
    try:
        folder = os.path.dirname(os.path.realpath(find()))
    except ProgramError:
        return None
    built = os.path.join(folder, BUILT)
    return built if os.path.exists(built) else None


def _reason(path: str, error: ImportError) -> str:
    """Describes a module that this Python cannot load."""
    version = ".".join(map(str, sys.version_info[:3]))
    python = f"{sys.implementation.name} {version}"
    needs = "it needs CPython 3.9 or newer with the global interpreter lock, on Linux with glibc"
    return f"{path} cannot be loaded by this Python ({python}): {error}; {needs}"
