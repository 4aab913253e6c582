"""Plants and laws as classes: their tables, and the decorators that check and mark them.

A table is a dataclass whose fields are `signal` or `parameter`. `plant` and `law` check a class when it is defined and
leave it as it is, so that it can be created and tested like any other; they attach a `Side`, which the native part
reads.
"""

from __future__ import annotations

import dataclasses
import inspect
import json
import math
import re
from typing import Any, Callable, Dict, Mapping, NamedTuple, Optional, Sequence, Tuple, TypeVar, Union

from .errors import DeclarationError

#: Attribute of a marked class with its `Side`.
MARK = "__hil_side__"
_KEY = "hil"
_Class = TypeVar("_Class", bound=type)


class Column(NamedTuple):
    """Column of a table."""

    name: str
    unit: str
    doc: str
    default: Optional[float]
    min: float
    max: float
    faultable: bool
    tunable: bool


class Table(NamedTuple):
    """Columns of a dataclass; `is_open` if its instances take further attributes."""

    row: Optional[type]
    columns: Tuple[Column, ...]
    is_open: bool


class Side(NamedTuple):
    """Declaration of a plant or a law, as the native part reads it."""

    kind: str
    owner: type
    name: str
    summary: str
    version: str
    tables: Dict[str, Table]
    plants: Tuple[str, ...]
    tuning: str
    #: Optional methods that the class has.
    methods: Tuple[str, ...]
    #: Numbers of the state, or `None` if they have no names.
    state: Optional[Table]
    #: Faults under names of their own, as JSON.
    faults: str


class Fault(NamedTuple):
    """Fault of a plant under a name of its own, as `fault` declares it."""

    kind: str
    doc: str
    equation: str
    moves: Mapping[str, Tuple[str, Union[str, float]]]
    sizes: Mapping[str, Any]


class _Row(NamedTuple):
    is_parameter: bool
    unit: str
    doc: str
    default: Optional[float]
    min: float
    max: float
    faultable: bool
    tunable: bool


def signal(
    *, unit: str, doc: str, min: float = -math.inf, max: float = math.inf, start: Optional[float] = None
) -> Any:
    """Declares a column of signals.

    `doc` is its description in a sentence. The range of a true signal is its limit of validity: a run that leaves it
    ends as diverged. `start` is the value of a plant's command in a run in which no law commands it.
    """
    return dataclasses.field(metadata={_KEY: _Row(False, unit, doc, start, min, max, False, False)})


def parameter(
    default: Optional[float] = None,
    *,
    unit: str,
    doc: str,
    min: float = -math.inf,
    max: float = math.inf,
    faultable: bool = False,
    tunable: bool = False,
) -> Any:
    """Declares a column of parameters; a scenario must give one without a default.

    `faultable` opens it to faults (`parameter.mass_kg`), `tunable` to `hil set`.
    """
    row = _Row(True, unit, doc, default, min, max, faultable, tunable)
    if default is None:
        return dataclasses.field(metadata={_KEY: row})
    return dataclasses.field(default=default, metadata={_KEY: row})


def fault(
    kind: str,
    *,
    doc: str,
    equation: str,
    moves: Mapping[str, Tuple[str, Union[str, float]]],
    sizes: Optional[Mapping[str, Any]] = None,
) -> Fault:
    """Declares a fault of a plant under a name of its own: the faultable parameters that it moves.

    `moves` has for each parameter an operation, `add`, `scale` or `set`, and the size that it moves by: the name of one
    of `sizes`, which are declared by `signal`, or a number. `equation` tells users the effect in plain text.
    """
    return Fault(kind, doc, equation, moves, sizes or {})


def plant(
    *,
    parameters: Optional[type] = None,
    truth: type,
    measured: type,
    command: Optional[type] = None,
    state: Optional[type] = None,
    faults: Sequence[Fault] = (),
    name: Optional[str] = None,
    version: str = "0",
) -> Callable[[_Class], _Class]:
    """Marks a class as a plant with these tables.

    The class has `__init__(parameters)`, `measure()`, `truth(time_s, command)` and `advance(interval, command)`, and
    `retune(parameters)` if a parameter can change during a run; optionally `invalid()`, the names of readings that are
    invalid. Its name is that of the class (`TwoMass` is `two-mass`), and its summary the first sentence of the
    docstring.

    A run can be saved if the class has `state`, a table of numbers that are attributes of the same name, or `save()`
    and `restore(value)` of any plain value; with the former `hil trim` and `hil linearise` work too.
    """

    def mark(owner: _Class) -> _Class:
        tables = {
            "parameters": _table(owner, "parameters", parameters, are_parameters=True),
            "truth": _table(owner, "truth", truth),
            "measured": _table(owner, "measured", measured),
            "command": _table(owner, "command", command, with_start=True),
        }
        _method(owner, "__init__", ("parameters",))
        _method(owner, "measure", ())
        _method(owner, "truth", ("time_s", "command"))
        _method(owner, "advance", ("interval", "command"))
        changing = _changing(tables["parameters"], faults=True)
        optional = _optional(owner, {"invalid": ()}, state)
        if changing or hasattr(owner, "retune"):
            _method(owner, "retune", ("parameters",), f", which applies `{changing}`" if changing else "")
            optional.append("retune")
        described = [_fault(owner, one, tables["parameters"]) for one in faults]
        return _mark(owner, "plant", name, version, tables, (), "", optional, state, described)

    return mark


def law(
    *,
    parameters: Optional[type] = None,
    model: Optional[type] = None,
    measured: Optional[type] = None,
    reference: Optional[type] = None,
    command: type,
    internals: Optional[type] = None,
    state: Optional[type] = None,
    plants: Sequence[str] = (),
    name: Optional[str] = None,
    version: str = "0",
) -> Callable[[_Class], _Class]:
    """Marks a class as a control law with these tables; `plants` names those it is made for, any if empty.

    The class has `__init__(setup)` and `step(sample)`, which returns a command, or a command and internals; and
    `retune(setup, ramp)` if a parameter is tunable, whose docstring tells users what happens to the command;
    optionally `held()`, the names of commands that the last step did not refresh. Name, summary and state are as those
    of a `plant`.
    """

    def mark(owner: _Class) -> _Class:
        tables = {
            "parameters": _table(owner, "parameters", parameters, are_parameters=True),
            "model": _table(owner, "model", model, are_parameters=True),
            "measured": _table(owner, "measured", measured),
            "reference": _table(owner, "reference", reference),
            "command": _table(owner, "command", command),
            "internals": _table(owner, "internals", internals),
        }
        for column in (*tables["parameters"].columns, *tables["model"].columns):
            if column.faultable:
                raise DeclarationError(f"`{column.name}` of {_title(owner)} is faultable; faults act on plants only")
        _method(owner, "__init__", ("setup",))
        _method(owner, "step", ("sample",))
        optional, tuning = _optional(owner, {"held": ()}, state), ""
        changing = _changing(tables["parameters"], faults=False)
        if changing:
            _method(owner, "retune", ("setup", "ramp"), f", which applies `{changing}`")
            optional.append("retune")
            tuning = _sentence(getattr(owner, "retune"))
            if not tuning:
                raise DeclarationError(
                    f"`retune` of {_title(owner)} has no docstring; its first sentence tells users what the command "
                    "does when a parameter changes"
                )
        return _mark(owner, "law", name, version, tables, tuple(plants), tuning, optional, state)

    return mark


def side_of(owner: object) -> Side:
    """Returns the declaration of a marked class."""
    side = vars(owner).get(MARK) if isinstance(owner, type) else None
    if not isinstance(side, Side):
        what = _title(owner) if isinstance(owner, type) else repr(owner)
        raise DeclarationError(f"{what} is neither a plant nor a law; mark the class with @hil.plant or @hil.law")
    return side


def _mark(
    owner: _Class,
    kind: str,
    name: Optional[str],
    version: str,
    tables: Dict[str, Table],
    plants: Tuple[str, ...],
    tuning: str,
    methods: Sequence[str],
    state: Optional[type],
    faults: Sequence[Dict[str, Any]] = (),
) -> _Class:
    summary = _sentence(owner)
    # A dataclass gets a docstring without being asked.
    if not summary or summary.startswith(f"{owner.__name__}("):
        raise DeclarationError(f"{_title(owner)} has no docstring; its first sentence is the summary of the {kind}")
    side = Side(
        kind=kind,
        owner=owner,
        name=name or _kebab(owner.__name__),
        summary=summary,
        version=version,
        tables=tables,
        plants=plants,
        tuning=tuning,
        methods=tuple(methods),
        state=None if state is None else _table(owner, "state", state),
        faults=json.dumps(faults),
    )
    setattr(owner, MARK, side)
    return owner


def _title(owner: type) -> str:
    return f"`{owner.__qualname__}`"


def _kebab(name: str) -> str:
    return re.sub("(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "-", name).replace("_", "-").lower()


def _sentence(described: object) -> str:
    """Returns the first paragraph of a docstring as one line."""
    text = inspect.cleandoc(getattr(described, "__doc__", None) or "")
    return " ".join(text.split("\n\n")[0].split())


def _number(value: object, what: str) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise DeclarationError(f"{what} is {value!r}; it must be a number")
    return float(value)


def _table(
    owner: type, role: str, row: Optional[type], are_parameters: bool = False, with_start: bool = False
) -> Table:
    if row is None:
        return Table(None, (), False)
    where = f"`{role}` of {_title(owner)}"
    if not isinstance(row, type):
        raise DeclarationError(f"{where} is {row!r}; it must be a dataclass")
    if not dataclasses.is_dataclass(row) or "__dataclass_fields__" not in vars(row):
        raise DeclarationError(f"{where} is {_title(row)}, which is no dataclass; write @dataclass above it")
    parameters: Any = getattr(row, "__dataclass_params__")
    if not parameters.init:
        raise DeclarationError(f"{where}: {_title(row)} has no `__init__` of @dataclass; leave out `init=False`")
    fields = dataclasses.fields(row)
    columns = tuple(_column(f"`{field.name}` of {_title(row)}", field, are_parameters, with_start) for field in fields)
    return Table(row, columns, getattr(row, "__dictoffset__") != 0)


def _column(where: str, field: "dataclasses.Field[Any]", are_parameters: bool, with_start: bool) -> Column:
    row = field.metadata.get(_KEY)
    kind = "parameter" if are_parameters else "signal"
    if not isinstance(row, _Row):
        raise DeclarationError(
            f"{where} has no unit and no description; write `{field.name}: float = hil.{kind}(unit=.., doc=..)`"
        )
    if row.is_parameter != are_parameters:
        raise DeclarationError(f"{where} is declared with hil.{'signal' if are_parameters else 'parameter'}; "
                               f"use hil.{kind} in this table")
    if field.type not in (float, "float"):
        shown = getattr(field.type, "__name__", field.type)
        raise DeclarationError(f"{where} is annotated with {shown}; every column is a float")
    if not field.init or getattr(field, "kw_only", False) is True:
        raise DeclarationError(f"{where} must be a positional argument of `__init__`")
    for name, text in (("unit", row.unit), ("doc", row.doc)):
        if not isinstance(text, str):
            raise DeclarationError(f"the {name} of {where} is {text!r}; it must be a text")
    if row.default is not None and not are_parameters and not with_start:
        raise DeclarationError(f"{where} has `start`, which only commands of a plant have")
    return Column(
        name=field.name,
        unit=row.unit,
        doc=row.doc,
        default=None if row.default is None else _number(row.default, f"the default of {where}"),
        min=_number(row.min, f"`min` of {where}"),
        max=_number(row.max, f"`max` of {where}"),
        faultable=bool(row.faultable),
        tunable=bool(row.tunable),
    )


def _fault(owner: type, one: Fault, parameters: Table) -> Dict[str, Any]:
    """Checks a fault and returns its description."""
    where = f"the fault `{one.kind}` of {_title(owner)}"
    faultable = [column.name for column in parameters.columns if column.faultable]
    sizes = []
    for name, size in one.sizes.items():
        if not isinstance(size, dataclasses.Field):
            raise DeclarationError(f"the size `{name}` of {where} is {size!r}; declare it with hil.signal")
        size.name, size.type = name, float
        column = _column(f"the size `{name}` of {where}", size, are_parameters=False, with_start=False)
        ends = {"min": column.min, "max": column.max}
        limits = {end: value for end, value in ends.items() if math.isfinite(value)}
        sizes.append({"name": name, "unit": column.unit, "description": column.doc, **limits})
    moves = []
    for parameter, (operation, by) in one.moves.items():
        _known(f"{where} moves", parameter, faultable, "parameters that are faultable")
        _known(f"{where} moves `{parameter}` by the operation", operation, ("add", "scale", "set"), "operations")
        if isinstance(by, str):
            _known(f"{where} moves `{parameter}` by", by, list(one.sizes), "sizes")
        move = {"size": by} if isinstance(by, str) else {"constant": _number(by, f"a move of {where}")}
        moves.append({"parameter": parameter, "operation": operation, "by": move})
    return {
        "kind": one.kind,
        "summary": one.doc,
        "equation": one.equation,
        "sizes": sizes,
        "moves": moves,
        "profile": {"kind": "step"},
    }


def _known(where: str, name: str, names: Sequence[str], what: str) -> None:
    if name not in names:
        raise DeclarationError(f"{where} `{name}`; the {what} are: {', '.join(names) or 'none'}")


def _changing(table: Table, faults: bool) -> str:
    """Returns the name of the first parameter that can change during a run, or an empty text."""
    names = (column.name for column in table.columns if column.tunable or (faults and column.faultable))
    return next(names, "")


def _optional(owner: type, methods: Mapping[str, Tuple[str, ...]], state: Optional[type]) -> "list[str]":
    names = [name for name in methods if hasattr(owner, name)]
    for name in names:
        _method(owner, name, methods[name])
    saving = [name for name in ("save", "restore") if hasattr(owner, name)]
    if len(saving) == 1:
        other = "restore" if saving == ["save"] else "save"
        raise DeclarationError(f"{_title(owner)} has `{saving[0]}` but not `{other}`; a checkpoint needs both")
    if saving:
        _method(owner, "save", ())
        _method(owner, "restore", ("value",))
    return [*names, *saving]


def _method(owner: type, name: str, arguments: Tuple[str, ...], reason: str = "") -> None:
    """Checks that a class has a method that can be called with these arguments."""
    shown = f"`{name}({', '.join(('self', *arguments))})`"
    method = getattr(owner, name, None)
    if not callable(method) or (name == "__init__" and method is object.__init__):
        from difflib import get_close_matches

        own = [other for other in vars(owner) if callable(getattr(owner, other)) and not other.startswith("__")]
        nearest = get_close_matches(name, own)
        hint = f"; nearest: {', '.join(nearest)}" if nearest else ""
        raise DeclarationError(f"{_title(owner)} lacks {shown}{reason}{hint}")
    for is_kind, what in (
        (inspect.iscoroutinefunction, "async"),
        (inspect.isgeneratorfunction, "a generator, because it contains `yield`"),
        (inspect.isasyncgenfunction, "an async generator"),
    ):
        if is_kind(method):
            raise DeclarationError(f"`{name}` of {_title(owner)} is {what}; it must be an ordinary method")
    try:
        inspect.signature(method).bind(None, *arguments)
    except TypeError as error:
        raise DeclarationError(f"`{name}` of {_title(owner)} must be {shown}: {error}") from None
    except ValueError:
        return  # a method of an extension without a signature
