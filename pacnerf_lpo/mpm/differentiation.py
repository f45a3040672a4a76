"""Reverse-mode differentiation of a local law while its kernel is compiled.

A law is an ordinary Python function of numbers. Called with :class:`Scalar` operands (each a number, or the lanes of
several particles) it emits Taichi expressions and leaves a record; :meth:`Record.pull_back` then emits the adjoint of
those very operations into the same kernel. Nothing is stored between kernels and nothing is unrolled twice, so a law
costs no launch, no memory traffic and no adjoint written by its author. Called with floats the same function computes
floats, which is how a law is read and tested by itself; of a law in principal space that is its flow rule, as the
eigen-solver exists in kernels only.
"""

import math
import operator
from collections.abc import Callable, Sequence
from typing import Any

from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.mpm import lanes
from pacnerf_lpo.mpm.lanes import keep

FUNCTIONS = "where, maximum, minimum, sqrt, log and exp of pacnerf_lpo.mpm.differentiation"
Pullback = Callable[[list], Sequence]


class Record:
    """The operations of one evaluation, in order."""

    def __init__(self) -> None:
        self._steps: list[tuple[Sequence, Sequence, Pullback]] = []

    def variables(self, value: Any) -> Any:
        """An independent variable from a Taichi expression, or nested lists of them."""
        return [self.variables(one) for one in value] if isinstance(value, list) else Scalar(self, value)

    def step(self, values: Sequence, operands: Sequence, pullback: Pullback) -> list["Scalar"]:
        """Record an operation: its ``values``, and the adjoints of ``operands`` from those of the values (None: 0)."""
        results = [Scalar(self, value) for value in values]
        self._steps.append((results, operands, pullback))
        return results

    def pull_back(self, seeds: Sequence[tuple[Any, Any]]) -> Callable[[Any], Any]:
        """Emit the adjoint. What is returned gives the gradient of sum(seed * output) by a variable, as an expression
        (0.0 where none), or by nested lists of them.
        """
        adjoint: dict[Scalar, Any] = {}

        def add(operand: Any, value: Any) -> None:
            if isinstance(operand, Scalar) and value is not None:
                adjoint[operand] = keep(adjoint[operand] + value if operand in adjoint else value)

        for output, seed in seeds:
            add(output, seed)
        for results, operands, pullback in reversed(self._steps):
            if any(result in adjoint for result in results):
                for operand, value in zip(operands, pullback([adjoint.get(r) for r in results]), strict=True):
                    add(operand, value)

        def gradient(variable: Any) -> Any:
            return [gradient(one) for one in variable] if isinstance(variable, list) else adjoint.get(variable, 0.0)

        return gradient


def _comparison(holds: Callable[[Any, Any], Any]) -> Callable[[Any, Any], "Condition"]:
    return lambda one, other: Condition(holds(one.value, plain(other)))


class Scalar:
    """A number inside a law: a Taichi expression that remembers how it was computed."""

    def __init__(self, record: Record, value: Any):
        self.record, self.value = record, keep(value)

    def _unary(self, value: Any, derivative: Callable[[], Any]) -> "Scalar":
        return self.record.step([value], [self], lambda g: [g[0] * derivative()])[0]

    def _binary(self, value: Any, other: Any, pullback: Callable[[Any], Sequence]) -> "Scalar":
        return self.record.step([value], [self, other], lambda g: pullback(g[0]))[0]

    def __add__(self, other: Any) -> "Scalar":
        return self._binary(self.value + plain(other), other, lambda g: (g, g))

    def __sub__(self, other: Any) -> "Scalar":
        return self._binary(self.value - plain(other), other, lambda g: (g, -g))

    def __rsub__(self, other: Any) -> "Scalar":
        return self._unary(other - self.value, lambda: -1.0)

    def __neg__(self) -> "Scalar":
        return self._unary(-self.value, lambda: -1.0)

    def __mul__(self, other: Any) -> "Scalar":
        return self._binary(self.value * plain(other), other, lambda g: (g * plain(other), g * self.value))

    def __truediv__(self, other: Any) -> "Scalar":
        if not isinstance(other, Scalar):
            return self * (1.0 / other)
        ratio = keep(self.value / other.value)
        return self._binary(ratio, other, lambda g: (g / other.value, -g * ratio / other.value))

    def __rtruediv__(self, other: Any) -> "Scalar":
        ratio = keep(other / self.value)
        return self._unary(ratio, lambda: -ratio / self.value)

    def __pow__(self, power: Any) -> "Scalar":
        if not isinstance(power, int) or power == 0:  # of a positive number only, as in every language
            return exp(power * log(self))
        result = self
        for _ in range(abs(power) - 1):
            result = result * self
        return result if power > 0 else 1.0 / result

    def __rpow__(self, base: float) -> "Scalar":
        return exp(self * math.log(base))

    def __abs__(self) -> "Scalar":
        return maximum(self, -self)

    def __float__(self) -> float:
        raise UserInputError(f"a law computes with numbers of a kernel, which {FUNCTIONS} take, and math's do not")

    __radd__, __rmul__ = __add__, __mul__

    __gt__, __lt__ = _comparison(operator.gt), _comparison(operator.lt)
    __ge__, __le__ = _comparison(operator.ge), _comparison(operator.le)


class Condition:
    """Whether something holds for a particle, for :func:`where`. It is known only when the kernel runs, so that
    Python's ``if``, ``and``, ``max`` and ``min``, which ask while it is compiled, are refused.
    """

    def __init__(self, value: Any):
        self.value = keep(value)

    def __and__(self, other: "Condition") -> "Condition":
        return Condition(self.value & other.value)

    def __or__(self, other: "Condition") -> "Condition":
        return Condition(self.value | other.value)

    def __bool__(self) -> bool:
        raise UserInputError(
            "a law is compiled once for all particles, so Python's if, and, or, not, max and min cannot depend on "
            f"them; use {FUNCTIONS}, and & or | between conditions"
        )


def plain(value: Any) -> Any:
    """The expression of a Scalar or a Condition, or nested lists of them; anything else unchanged."""
    if isinstance(value, (list, tuple)):
        return [plain(one) for one in value]
    return value.value if isinstance(value, (Scalar, Condition)) else value


def sqrt(x: Any) -> Any:
    """Square root; its derivative at 0 counts as 0, so that a norm has the gradient 0 at the origin."""
    if not isinstance(x, Scalar):
        return math.sqrt(x)
    root = lanes.sqrt(x.value)
    return x._unary(root, lambda: lanes.select(root > 0.0, 0.5 / root, 0.0))


def log(x: Any) -> Any:
    return x._unary(lanes.log(x.value), lambda: 1.0 / x.value) if isinstance(x, Scalar) else math.log(x)


def exp(x: Any) -> Any:
    if not isinstance(x, Scalar):
        return math.exp(x)
    value = lanes.exp(x.value)
    return x._unary(value, lambda: value)


def where(condition: Any, yes: Any, no: Any) -> Any:
    """``yes`` where the condition holds, else ``no``; both are evaluated, so both must be finite."""
    record = next((x.record for x in (yes, no) if isinstance(x, Scalar)), None)
    if isinstance(condition, bool):
        return yes if condition else no
    condition = plain(condition)
    value = lanes.select(condition, plain(yes), plain(no))
    if record is None:
        return keep(value)
    return record.step(
        [value], [yes, no], lambda g: (lanes.select(condition, g[0], 0.0), lanes.select(condition, 0.0, g[0]))
    )[0]


def maximum(x: Any, y: Any) -> Any:
    """The larger; the gradient goes to ``x`` where they are equal."""
    return where(x >= y, x, y)


def minimum(x: Any, y: Any) -> Any:
    """The smaller; the gradient goes to ``x`` where they are equal."""
    return where(x <= y, x, y)
