"""Mathematics with the same last bit on every machine, and the integrator."""

from typing import Callable, Iterable, List, Tuple

from .arguments import Interval

pi: float
tau: float
e: float
inf: float
nan: float

def sin(x: float) -> float:
    """Returns the sine of an angle in radians."""

def cos(x: float) -> float:
    """Returns the cosine of an angle in radians."""

def tan(x: float) -> float:
    """Returns the tangent of an angle in radians."""

def asin(x: float) -> float:
    """Returns the inverse sine."""

def acos(x: float) -> float:
    """Returns the inverse cosine."""

def atan(x: float) -> float:
    """Returns the inverse tangent."""

def atan2(y: float, x: float) -> float:
    """Returns the angle of the point (x, y)."""

def sinh(x: float) -> float:
    """Returns the hyperbolic sine."""

def cosh(x: float) -> float:
    """Returns the hyperbolic cosine."""

def tanh(x: float) -> float:
    """Returns the hyperbolic tangent."""

def asinh(x: float) -> float:
    """Returns the inverse hyperbolic sine."""

def acosh(x: float) -> float:
    """Returns the inverse hyperbolic cosine."""

def atanh(x: float) -> float:
    """Returns the inverse hyperbolic tangent."""

def exp(x: float) -> float:
    """Returns e to the power x."""

def exp2(x: float) -> float:
    """Returns 2 to the power x."""

def expm1(x: float) -> float:
    """Returns `exp(x) - 1`, exact for small x."""

def log(x: float) -> float:
    """Returns the natural logarithm."""

def log1p(x: float) -> float:
    """Returns `log(1 + x)`, exact for small x."""

def log2(x: float) -> float:
    """Returns the logarithm to the base 2."""

def log10(x: float) -> float:
    """Returns the logarithm to the base 10."""

def pow(x: float, y: float) -> float:
    """Returns x to the power y."""

def sqrt(x: float) -> float:
    """Returns the square root."""

def cbrt(x: float) -> float:
    """Returns the cube root."""

def hypot(x: float, y: float) -> float:
    """Returns `sqrt(x * x + y * y)` without overflow."""

def fmod(x: float, y: float) -> float:
    """Returns the remainder of x / y with the sign of x."""

def erf(x: float) -> float:
    """Returns the error function."""

def integrate(
    state: Iterable[float], interval: Interval, rates: Callable[[float, Tuple[float, ...]], Iterable[float]]
) -> List[float]:
    """Returns the state after an interval, by the classical Runge-Kutta method of order 4 in its equal substeps.

    `rates(time_s, state)` returns the derivative of each number.
    """
