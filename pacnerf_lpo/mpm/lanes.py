"""Functions of one number or of lanes, the same quantity of several particles in one vector register.

While a kernel is compiled an expression stands for a number (on CUDA, and at the nodes) or for :data:`LANES` of them
(particles on the CPU). Arithmetic and comparisons of Taichi take either, but for the minus sign before one
(``-1.0 * x``); what it has for numbers only is here. Without
the help of a library, the exponential and the logarithm of single precision are computed from their series, to rounding.
"""

import math
from typing import Any

from pacnerf_lpo.mpm.taichi_calls import compiling_double, entry, is_wide, keep, ti

LANES = 16
"""Particles in a register: as many floats as AVX-512 has. Machines with narrower registers take several for them."""
LN2_HIGH, LN2_LOW = 0.693145751953125, 1.4286068203094172e-06
"""ln 2 in two parts; an exponent times the first is exact in single precision."""
MANTISSA, HALF_ROOT = 0x007FFFFF, 0x3F3504F3
"""Which bits of a float are its mantissa; the bits of sqrt(1/2)."""


def wide(number: Any) -> Any:
    """The same number in every lane; lanes as they are."""
    return number if is_wide(number) else keep(ti.Vector([number] * LANES))


def lanes(vector: Any) -> list[Any]:
    """The numbers of a vector, one by one."""
    return [entry(vector, lane) for lane in range(vector.n)]


def summed(number: Any) -> Any:
    """The sum over all lanes; one number is its own sum. Halves are added, so that rounding grows with log2(lanes)."""
    while is_wide(number):
        one, half = lanes(number), number.n // 2
        number = keep(ti.Vector([one[i] + one[i + half] for i in range(half)]) if half > 1 else one[0] + one[1])
    return number


def sqrt(x: Any) -> Any:
    """Square root."""
    return keep(ti.sqrt(x))


def absolute(x: Any) -> Any:
    """Absolute value."""
    return keep(ti.max(x, -1.0 * x))


def both(a: Any, b: Any) -> Any:
    """Where two conditions hold."""
    if not (is_wide(a) or is_wide(b)):
        return keep(a & b)
    return keep(ti.select(a, ti.select(b, 1.0, 0.0), 0.0) > 0.5)


def either(a: Any, b: Any) -> Any:
    """Where one of two conditions holds, or both."""
    if not (is_wide(a) or is_wide(b)):
        return keep(a | b)
    return keep(ti.select(a, 1.0, ti.select(b, 1.0, 0.0)) > 0.5)


def log(x: Any) -> Any:
    """Natural logarithm; of no positive number it is NaN.

    x = 2^e m with m in [1/sqrt 2, sqrt 2), and ln m = 2 artanh s with s = (m - 1) / (m + 1), |s| < 0.172: the series is
    cut off at 2e-9 of it.
    """
    if not is_wide(x):
        return keep(ti.log(x))
    if compiling_double():
        return keep(ti.Vector([ti.log(one) for one in lanes(x)]))
    bits = [keep(ti.bit_cast(one, ti.i32) - HALF_ROOT) for one in lanes(x)]
    e = keep(ti.Vector([ti.cast(b >> 23, float) for b in bits]))
    m = keep(ti.Vector([ti.bit_cast((b & MANTISSA) + HALF_ROOT, float) for b in bits]))
    s = keep((m - 1.0) / (m + 1.0))
    square = keep(s * s)
    series = keep(1.0 + square * (1.0 / 3 + square * (1.0 / 5 + square * (1.0 / 7 + square * (1.0 / 9)))))
    return keep(ti.select(x > 0.0, e * LN2_HIGH + (e * LN2_LOW + 2.0 * s * series), math.nan))


def exp(x: Any) -> Any:
    """Exponential; 0 and infinity where it is out of range.

    x = n ln 2 + r with |r| < 0.35, and the series of exp r is cut off at 1e-8 of it.
    """
    if not is_wide(x):
        return keep(ti.exp(x))
    if compiling_double():
        return keep(ti.Vector([ti.exp(one) for one in lanes(x)]))
    n = keep(ti.floor(ti.max(ti.min(x * (1.0 / math.log(2.0)), 128.0), -127.0) + 0.5))
    r = keep((x - n * LN2_HIGH) - n * LN2_LOW)
    series: Any = 1.0
    for k in range(7, 0, -1):
        series = keep(1.0 + r * series * (1.0 / k))
    power = keep(ti.Vector([ti.bit_cast((ti.cast(one, ti.i32) + 127) << 23, float) for one in lanes(n)]))
    return keep(ti.select(x < -88.0, 0.0, series * power))
