"""A signal of a run as a numpy array that knows its unit."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Optional, Tuple

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    # At run time numpy's class takes no parameters before Python 3.9 and numpy 1.22.
    _Base = np.ndarray[Any, np.dtype[Any]]
else:
    _Base = np.ndarray


class Signal(_Base):
    """Values of a signal, one for each step, with its `name` and `unit`.

    Parts and copies keep both. The result of a computation is an ordinary array, because its unit may be another.
    """

    name: str
    unit: str

    def __new__(cls, values: NDArray[Any], name: str, unit: str) -> Signal:
        signal = np.asarray(values).view(cls)
        signal.name, signal.unit = name, unit
        return signal

    def __array_finalize__(self, source: Optional[NDArray[Any]]) -> None:
        self.name = getattr(source, "name", "")
        self.unit = getattr(source, "unit", "")

    def __array_wrap__(self, array: Any, context: Any = None, return_scalar: bool = False) -> Any:
        values = np.asarray(array)
        return values[()] if return_scalar or values.ndim == 0 else values

    def __reduce__(self) -> Tuple[Any, ...]:
        return (Signal, (np.asarray(self), self.name, self.unit))
