"""The process of a plant or a law in Python.

`hil` starts it for a scenario that names a Python file, as `main([side, file, ..])` with the arguments of every plant
or controller program; a file may also be such a program by itself, with `hil.main`.

Standard output belongs to the answers of the program: what the file prints goes to standard error, which is the log of
the run.
"""

from __future__ import annotations

import os
import sys
from types import CodeType, ModuleType
from typing import Any, Dict, List, NoReturn, Optional, Sequence, Tuple

from .declare import MARK, Side, side_of
from .errors import DeclarationError, Error

#: Name of the module that a file becomes.
MODULE = "__hil_main__"
#: Kind of classes of a side.
KINDS = {"plant": "plant", "controller": "law"}
#: Exit code of a file that cannot be used.
UNUSABLE = 2


def main(arguments: Sequence[str], checks_owners: bool = False) -> NoReturn:
    """Runs a file as a side; the first two arguments are `plant` or `controller`, and the file.

    With `checks_owners` it imports no module that others could have written.
    """
    role, path, *rest = arguments
    with _Output() as output:
        try:
            if checks_owners:
                sys.meta_path.insert(0, _Owners())
            module = load(path)
            classes = classes_of(module, KINDS[role], os.path.basename(path))
        except SystemExit as end:
            _refuse(path, f"the file ended its process with exit code {end.code}")
        except Error as error:
            _refuse(path, f"{error}{_place(error, path)}")
        except BaseException as error:
            _refuse(path, _reason(error))
        _serve(role, [path, *rest], classes, output)


def run(*classes: type) -> NoReturn:
    """Makes a file a program of its own, which `hil` can start and which answers `--help`.

        if __name__ == "__main__":
            hil.main(Motor)

    The classes are all plants or all laws.
    """
    kinds = {side_of(one).kind for one in classes}
    if len(kinds) != 1:
        raise DeclarationError("hil.main takes one or more plants, or one or more laws")
    role = next(role for role, kind in KINDS.items() if kind in kinds)
    with _Output() as output:
        _serve(role, sys.argv, list(classes), output)


def load(path: str) -> ModuleType:
    """Executes a file as a module, from its text and never from cached bytecode."""
    with open(path, "rb") as file:
        source = file.read()
    real = os.path.realpath(path)
    module = ModuleType(MODULE)
    module.__file__ = real
    # Modules beside the file are found, as when Python runs it.
    sys.path.insert(0, os.path.dirname(real))
    sys.modules[MODULE] = module
    code: CodeType = compile(source, real, "exec", dont_inherit=True)
    exec(code, module.__dict__)
    return module


class _Owners:
    """Finds modules as Python does, and refuses those that others than this user and root could have written.

    The interpreter, with what is installed in it, is trusted, and so is this package.
    """

    def __init__(self) -> None:
        folders = {sys.prefix, sys.exec_prefix, sys.base_prefix, sys.base_exec_prefix, os.path.dirname(__file__)}
        self._own = tuple(os.path.join(os.path.realpath(folder), "") for folder in folders)

    def find_spec(self, name: str, path: Optional[Sequence[str]], target: Optional[ModuleType] = None) -> Any:
        finders = (finder for finder in sys.meta_path if finder is not self)
        specs = (finder.find_spec(name, path, target) for finder in finders)
        spec = next((spec for spec in specs if spec is not None), None)
        if spec is not None and spec.has_location:
            for file in (getattr(spec.loader, "archive", spec.origin), spec.cached):
                self._check(name, file)
        return spec

    def _check(self, name: str, file: Optional[str]) -> None:
        if file is None or not os.path.exists(file) or os.path.realpath(file).startswith(self._own):
            return
        from .native import native

        reason = native().distrust(file)
        if reason is not None:
            raise DeclarationError(f"the module `{name}` is not imported: {reason}")


def classes_of(module: ModuleType, kind: str, name: str) -> List[type]:
    """Returns the classes of a module that are marked as of a kind: its own, or else those that it imports."""
    sides: Dict[int, Side] = {}
    for value in vars(module).values():
        side = vars(value).get(MARK) if isinstance(value, type) else None
        if isinstance(side, Side):
            sides[id(value)] = side
    marked = [side for side in sides.values() if side.kind == kind]
    own = [side for side in marked if side.owner.__module__ == module.__name__]
    if not marked:
        others = ", ".join(f"the {side.kind} `{side.name}`" for side in sides.values())
        has = f"; it has {others}" if others else ""
        raise DeclarationError(f"{name} has no class that is marked with @hil.{kind}{has}")
    return [side.owner for side in own or marked]


class _Output:
    """Standard output while a side runs: prints go to standard error, and `restore` gives the descriptor back."""

    def __enter__(self) -> _Output:
        self._stdout = os.dup(1)
        os.dup2(2, 1)  # of libraries in C as well
        sys.stdout = sys.stderr
        # Standard input has the words of `hil`.
        sys.stdin = open(os.devnull)
        return self

    def __exit__(self, *_: object) -> None:
        self.restore()

    def restore(self) -> None:
        if self._stdout >= 0:
            os.dup2(self._stdout, 1)
            os.close(self._stdout)
            self._stdout = -1


def _serve(role: str, arguments: List[str], classes: List[type], output: _Output) -> NoReturn:
    import gc
    import signal

    from .native import native

    module = native()
    # Ctrl-C is for `hil`, which ends its sides.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    os.register_at_fork(after_in_child=module.note_fork)
    sides = [side_of(one) for one in classes]
    implementation = sys.implementation.name
    interpreter = f"Python {'.'.join(map(str, sys.version_info[:3]))} ({implementation})"
    names = (sides[0].name, sides[0].version, interpreter)
    modules = imported() if "--describe" in arguments else []
    output.restore()
    # What exists by now stays; the collector need not look at it at each step.
    gc.collect()
    gc.freeze()
    try:
        code = module.serve(role, arguments, classes, names, modules)
    except Error as error:
        _refuse(arguments[0], str(error))
    _leave(code)


def _refuse(path: str, reason: str) -> NoReturn:
    print(f"error: {os.path.basename(path)}: {reason}", file=sys.stderr)
    _leave(UNUSABLE)


def _reason(error: BaseException) -> str:
    from .tracebacks import describe

    line, text = describe(error)
    return f"{line}\n{text}" if text else line


def _place(error: BaseException, path: str) -> str:
    """Returns the line of the file in which an error was raised."""
    real, line, trace = os.path.realpath(path), 0, error.__traceback__
    while trace is not None:
        if trace.tb_frame.f_code.co_filename == real:
            line = trace.tb_lineno
        trace = trace.tb_next
    return f" (line {line})" if line else ""


def _leave(code: int) -> NoReturn:
    """Ends the process, without waiting for threads that the file has left running."""
    import atexit
    import threading

    others = [one.name for one in threading.enumerate() if one is not threading.main_thread() and not one.daemon]
    if not others:
        raise SystemExit(code)
    print(f"note: threads are still running at the end: {', '.join(others)}", file=sys.stderr)
    atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        stream.flush()
    os._exit(code)


def imported() -> List[Tuple[str, str, str]]:
    """Returns name, version and hash of each module that is imported and not part of Python."""
    from .native import native

    packages: Dict[str, List[Tuple[str, str]]] = {}
    for name, module in sorted(sys.modules.items()):
        path = getattr(module, "__file__", None)
        if name != MODULE and isinstance(path, str) and os.path.isfile(path) and not _is_of_python(path):
            packages.setdefault(name.partition(".")[0], []).append((name, path))
    found = []
    for package, files in sorted(packages.items()):
        found.append((package, _version(package), native().hash_all(files)))
    return found


def _is_of_python(path: str) -> bool:
    import sysconfig

    parts = os.path.realpath(path).split(os.sep)
    if "site-packages" in parts or "dist-packages" in parts:
        return False
    for key in ("stdlib", "platstdlib"):
        folder = os.path.realpath(sysconfig.get_path(key)).split(os.sep)
        if parts[: len(folder)] == folder:
            return True
    return False


def _version(package: str) -> str:
    if package == __package__:
        from .native import native

        return str(native().__version__)
    version = getattr(sys.modules.get(package), "__version__", None)
    if isinstance(version, str):
        return version
    from importlib import metadata

    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return ""
