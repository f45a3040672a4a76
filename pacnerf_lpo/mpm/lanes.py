"""Numbers inside a kernel: one, or lanes, the same quantity of several particles in one vector register.

While a kernel is compiled an expression stands for a number (on CUDA, and at the nodes) or for :data:`LANES` of them
(particles on the CPU), on which arithmetic and comparisons act lane by lane. What Taichi has for numbers only is here.
Exponential and logarithm of single precision are computed from their series, to rounding: a library would be called for
one lane at a time.
"""

import functools
import math
from collections.abc import Callable
from typing import Any

from pacnerf_lpo.mpm import taichi_calls
from pacnerf_lpo.mpm.taichi_calls import Expr, compiling_double, ti
from pacnerf_lpo.mpm.tensors import Tensor3

LANES = 16
"""Particles in a register: as many floats as AVX-512 has. Machines with narrower registers take several for them."""
LN2_HIGH, LN2_LOW = 0.693145751953125, 1.4286068203094172e-06
"""ln 2 in two parts; an exponent times the first is exact in single precision."""
MANTISSA, HALF_ROOT = 0x007FFFFF, 0x3F3504F3
"""Which bits of a float are its mantissa; the bits of sqrt(1/2)."""

_spread: dict[Any, tuple[Any, Any]] = {}


class Lanes(Expr):
    """An expression of LANES numbers. Taichi writes a number that meets one LANES times into its program; here it is
    spread once per scope.
    """

    def __neg__(self) -> Any:
        return 0.0 - self

    def __and__(self, other: Any) -> Any:
        return select(self, select(other, 1.0, wide(0.0)), 0.0) > 0.5

    def __or__(self, other: Any) -> Any:
        return select(self, 1.0, select(other, 1.0, wide(0.0))) > 0.5


def _operator(name: str) -> Callable[[Lanes, Any], Lanes]:
    operator = getattr(Expr, name)
    return lambda self, other: Lanes(operator(self, wide(other, self)))


for _name in ("add", "radd", "sub", "rsub", "mul", "rmul", "truediv", "rtruediv", "gt", "lt", "ge", "le", "eq"):
    setattr(Lanes, f"__{_name}__", _operator(f"__{_name}__"))
Lanes.__hash__ = Expr.__hash__  # type: ignore[method-assign]


def new_scope() -> None:
    """Call it where a block of a kernel begins: what is spread in one block is unknown in another."""
    _spread.clear()


def keep(value: Any) -> Any:
    """Store an expression in a local variable, so that using it twice computes it once."""
    return _typed(taichi_calls.keep(value))


def kept(tensor: Tensor3) -> Tensor3:
    """A tensor whose entries are computed once."""
    return [[keep(x) for x in row] for row in tensor]


def entry(array: Any, *indices: Any) -> Any:
    """:func:`~pacnerf_lpo.mpm.taichi_calls.entry`, which may be lanes."""
    return _typed(taichi_calls.entry(array, *indices))


def _typed(value: Any) -> Any:
    return Lanes(value) if isinstance(value, Expr) and value.is_tensor() and value.get_shape() == (LANES,) else value


def wide(number: Any, like: Any = None) -> Any:
    """The same number in every lane; lanes as they are. ``like``: any lanes, which save writing 16 zeros."""
    if isinstance(number, Lanes):
        return number
    key = ("expression", id(number)) if isinstance(number, Expr) else float(number)
    if key not in _spread:  # the number is kept so that its id stays its own
        _spread[key] = number, keep(_in_every_lane(number, ti.Vector([0.0] * LANES) if like is None else like))
    return _spread[key][1]


@ti.func
def _in_every_lane(number, like):
    found = like
    for lane in range(LANES):
        found[lane] = number
    return found


def summed(number: Any) -> Any:
    """The sum over all lanes; one number is its own sum. Halves are added, so that rounding grows with log2(lanes)."""
    return keep(_summed(number)) if isinstance(number, Lanes) else number


@ti.func
def _summed(x):
    found = x
    for half in ti.static((8, 4, 2, 1)):
        for lane in range(half):
            found[lane] = found[lane] + found[lane + half]
    return found[0]


def select(condition: Any, yes: Any, no: Any) -> Any:
    """``yes`` where a condition holds, else ``no``."""
    if any(isinstance(x, Lanes) for x in (condition, yes, no)):
        like = next((x for x in (yes, no) if isinstance(x, Lanes)), None)
        yes, no = wide(yes, like), wide(no, like)
    return keep(ti.select(condition, yes, no))


def largest(a: Any, b: Any) -> Any:
    return keep(ti.max(*_alike(a, b)))


def smallest(a: Any, b: Any) -> Any:
    return keep(ti.min(*_alike(a, b)))


def _alike(a: Any, b: Any) -> tuple[Any, Any]:
    return (wide(a), wide(b)) if isinstance(a, Lanes) or isinstance(b, Lanes) else (a, b)


def sqrt(x: Any) -> Any:
    return keep(ti.sqrt(x))


def floor(x: Any) -> Any:
    """Largest whole number that is not larger."""
    return keep(ti.floor(x))


def absolute(x: Any) -> Any:
    return largest(x, -x)


def log(x: Any) -> Any:
    """Natural logarithm; of no positive number it is NaN.

    x = 2^e m with m in [1/sqrt 2, sqrt 2), and ln m = 2 artanh s with s = (m - 1) / (m + 1), |s| < 0.172: the series is
    cut off at 2e-9 of it.
    """
    if not isinstance(x, Lanes):
        return keep(ti.log(x))
    if compiling_double():
        return keep(_lane_by_lane(ti.log)(x))
    e = keep(_lane_by_lane(_exponent)(x))
    m = keep(_lane_by_lane(_mantissa)(x))
    s = keep((m - 1.0) / (m + 1.0))
    square = keep(s * s)
    series = keep(1.0 + square * (1.0 / 3 + square * (1.0 / 5 + square * (1.0 / 7 + square * (1.0 / 9)))))
    return select(x > 0.0, e * LN2_HIGH + (e * LN2_LOW + 2.0 * s * series), math.nan)


def exp(x: Any) -> Any:
    """Exponential; 0 and infinity where it is out of range.

    x = n ln 2 + r with |r| < 0.35, and the series of exp r is cut off at 1e-8 of it.
    """
    if not isinstance(x, Lanes):
        return keep(ti.exp(x))
    if compiling_double():
        return keep(_lane_by_lane(ti.exp)(x))
    n = floor(largest(smallest(x * (1.0 / math.log(2.0)), 128.0), -127.0) + 0.5)
    r = keep((x - n * LN2_HIGH) - n * LN2_LOW)
    series: Any = 1.0
    for k in range(7, 0, -1):
        series = keep(1.0 + r * series * (1.0 / k))
    return select(x < -88.0, 0.0, series * keep(_lane_by_lane(_power_of_two)(n)))


@functools.cache
def _lane_by_lane(function: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """A function of one number, for all lanes."""

    @ti.func
    def of_lanes(x):
        found = x
        for lane in range(LANES):
            found[lane] = function(x[lane])
        return found

    return of_lanes


def _exponent(x: Any) -> Any:
    """e of x = 2^e m with m in [1/sqrt 2, sqrt 2)."""
    return ti.cast((ti.bit_cast(x, ti.i32) - HALF_ROOT) >> 23, float)


def _mantissa(x: Any) -> Any:
    """m of x = 2^e m."""
    return ti.bit_cast(((ti.bit_cast(x, ti.i32) - HALF_ROOT) & MANTISSA) + HALF_ROOT, float)


def _power_of_two(n: Any) -> Any:
    """2^n for whole n from -127 (counts as 0) to 128 (infinity)."""
    return ti.bit_cast((ti.cast(n, ti.i32) + 127) << 23, float)
