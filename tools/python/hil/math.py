"""Mathematics with the same last bit on every machine, and the integrator.

The functions are those that plants and laws in Rust use, so that a run has the same digest everywhere. They take and
return single floats. As in IEEE 754, and unlike in Python's own `math`, nothing is raised: `sqrt(-1.0)` is not a number,
and `log(0.0)` is minus infinity.
"""

from .native import native as _native

pi = 3.141592653589793
tau = 6.283185307179586
e = 2.718281828459045
inf = float("inf")
nan = float("nan")

_math = _native().math

sin = _math.sin
cos = _math.cos
tan = _math.tan
asin = _math.asin
acos = _math.acos
atan = _math.atan
atan2 = _math.atan2
sinh = _math.sinh
cosh = _math.cosh
tanh = _math.tanh
asinh = _math.asinh
acosh = _math.acosh
atanh = _math.atanh
exp = _math.exp
exp2 = _math.exp2
expm1 = _math.expm1
log = _math.log
log1p = _math.log1p
log2 = _math.log2
log10 = _math.log10
pow = _math.pow
sqrt = _math.sqrt
cbrt = _math.cbrt
hypot = _math.hypot
fmod = _math.fmod
erf = _math.erf
integrate = _math.integrate
