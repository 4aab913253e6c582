from typing import Generic, List, TypeVar, overload

_Measured = TypeVar("_Measured")
_Reference = TypeVar("_Reference")
_Parameters = TypeVar("_Parameters")
_Model = TypeVar("_Model")
_Own = TypeVar("_Own")

class Interval:
    """Interval over which a plant is integrated."""

    def __init__(self, start_s: float, length_s: float, substeps: int = 1) -> None: ...
    @property
    def start_s(self) -> float:
        """Simulated time at its beginning, in s."""
    @property
    def length_s(self) -> float:
        """Length, in s."""
    @property
    def substeps(self) -> int:
        """Number of equal integration steps."""
    @property
    def substep_s(self) -> float:
        """Length of one integration step, in s."""

class Setup(Generic[_Parameters, _Model]):
    """Configuration of a law: `Setup[Parameters, None]` for a law without a model of the plant."""

    @overload
    def __init__(self: Setup[_Own, None], parameters: _Own, period_s: float) -> None: ...
    @overload
    def __init__(self, parameters: _Parameters, period_s: float, model: _Model) -> None: ...
    @property
    def parameters(self) -> _Parameters:
        """Parameters of the law."""
    @property
    def model(self) -> _Model:
        """The law's model of the plant."""
    @property
    def period_s(self) -> float:
        """Time between two samples, in s."""

class Sample(Generic[_Measured, _Reference]):
    """Sample that a law answers: `Sample[Measured, None]` for a law without reference signals."""

    @overload
    def __init__(
        self: Sample[_Own, None],
        time_s: float,
        measured: _Own,
        *,
        valid: bool = True,
        held_steps: int = 0,
    ) -> None: ...
    @overload
    def __init__(
        self,
        time_s: float,
        measured: _Measured,
        reference: _Reference,
        valid: bool = True,
        held_steps: int = 0,
    ) -> None: ...
    @property
    def time_s(self) -> float:
        """Simulated time, in s."""
    @property
    def measured(self) -> _Measured:
        """Measured signals."""
    @property
    def reference(self) -> _Reference:
        """Reference signals."""
    @property
    def valid(self) -> bool:
        """True if all of these signals are valid."""
    @property
    def held_steps(self) -> int:
        """Number of steps for which the plant has held a command that was late."""
    @property
    def invalid(self) -> List[str]:
        """Names of the invalid signals, as `measured.x` and `reference.x`."""
    def is_valid(self, name: str) -> bool:
        """Returns True if a signal is valid: `measured.x`, `reference.x`, or `x` for a measured one."""
    def age_steps(self, name: str) -> int:
        """Returns the age of a measured signal in steps."""
