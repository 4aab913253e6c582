"""Values of a scenario, as TOML."""

from __future__ import annotations

import json
import os
import re
from typing import Iterable, List, Mapping, Optional


def settings(values: Optional[Mapping[str, object]]) -> List[str]:
    """Returns the values of `set=` as `KEY=VALUE`, as `--set` takes them."""
    if values is not None and not isinstance(values, Mapping):
        raise TypeError(f"`set` is {values!r}; use a mapping of keys of the scenario to values")
    return [f"{key}={toml(value)}" for key, value in (values or {}).items()]


def toml(value: object) -> str:
    """Returns a value as TOML, as `--set` takes it."""
    if isinstance(value, os.PathLike):
        value = os.fspath(value)
    tolist = getattr(value, "tolist", None)
    if callable(tolist):  # of numpy
        value = tolist()
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (int, float)):
        return repr(value)
    if isinstance(value, str):
        is_bare = re.fullmatch("[A-Za-z_][A-Za-z0-9_-]*", value) and value not in ("true", "false", "inf", "nan")
        return value if is_bare else json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, Mapping):
        pairs = (f"{json.dumps(str(key))} = {_inner(item)}" for key, item in value.items())
        return "{" + ", ".join(pairs) + "}"
    if isinstance(value, Iterable):
        return "[" + ", ".join(map(_inner, value)) + "]"
    raise TypeError(f"{value!r} cannot be a value of a scenario; use numbers, texts, booleans, lists or mappings")


def _inner(value: object) -> str:
    """Returns a value inside another, where texts need their quotes."""
    return json.dumps(value, ensure_ascii=False) if isinstance(value, str) else toml(value)
