"""What a local law sees of one particle, and the evaluation of all local laws there with their adjoint."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from types import SimpleNamespace
from typing import Any

from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.mpm.differentiation import Record, plain
from pacnerf_lpo.mpm.taichi_calls import Emitted
from pacnerf_lpo.mpm.tensors import Tensor3


@dataclass(frozen=True)
class Point:
    """One particle during one substep; every number may enter a law and is differentiated through.

    F: trial deformation gradient (I + dt C) F of this substep [(3, 3)]
    C: velocity gradient [1/s, (3, 3)]
    x: position [m, (3,)];  X: position at time 0 [m, (3,)];  v: velocity [m/s, (3,)]
    t: time since frame 0 [s];  dt: substep [s]
    mass: [kg];  volume: of the undeformed particle [m^3];  stiffness: factor on the moduli [1]
    history: what an effect on the law has kept from the substep before, if it keeps anything
    """

    F: Tensor3
    C: Tensor3
    x: list[Any]
    X: list[Any]
    v: list[Any]
    t: Any
    dt: Any
    mass: Any
    volume: Any
    stiffness: Any
    history: list[Any] = field(default_factory=list)


Law = Callable[[Point, SimpleNamespace], tuple[Tensor3, Tensor3]]
Wrapper = Callable[[Law, Point, SimpleNamespace], tuple]
Acceleration = Callable[[Point, SimpleNamespace], list[Any]]
Factor = Callable[[Point, SimpleNamespace], Any]
VECTOR = "three numbers, (x, x, x)"
STRESSES = "the tuple of new deformation gradient and Kirchhoff stress, each three rows of three"


def mistake_of(function: Any, said: str) -> UserInputError:
    """The error that a function of somebody's class makes, with its name and place."""
    code = function.__code__
    return UserInputError(f"{code.co_filename}, line {code.co_firstlineno}: {function.__qualname__} {said}")


def returned(function: Any, value: Any, form: str, *lengths: int) -> Any:
    """What a function returned; raises UserInputError where it has not the ``form``, in words, and the ``lengths``: of
    the value, of each of its entries, and so on down to the numbers.
    """

    def shape(part: Any) -> str:
        return f"({', '.join(map(shape, part))})" if hasattr(part, "__len__") else "x"

    expected = "x"
    for length in reversed(lengths):
        expected = f"({', '.join([expected] * length)})"
    if shape(value) != expected:
        raise mistake_of(function, f"has to return {form}; it returns {shape(value)}, where x is a number")
    return value


@dataclass(frozen=True)
class LocalLaws:
    """The local laws of one simulator: what its kernels are compiled from (hashable: kernels are shared between
    equals).

    law: (point, coefficients) -> (new deformation gradient, Kirchhoff stress [Pa])
    accelerations: (point, coefficients) -> body acceleration [m/s^2], one per effect
    ground: (velocity of a node at or below y = 0, coefficients) -> the velocity the ground lets it have [m/s]
    names: of the coefficients of law, ground and effects, in order.
    wrappers: (law inside, point, coefficients) -> what the law gives, and the new history where one is kept; each with
        how many numbers it keeps. The first is the outermost.
    factors: (point, coefficients) -> factor on the stiffness, one per effect
    """

    law: Law
    accelerations: tuple[Acceleration, ...]
    ground: Callable[[list[Any], SimpleNamespace], list[Any]]
    names: tuple[str, ...]
    wrappers: tuple[tuple[Wrapper, int], ...] = ()
    factors: tuple[Factor, ...] = ()

    @property
    def history(self) -> int:
        """How many numbers a particle carries from substep to substep beside its deformation."""
        return sum(kept for _, kept in self.wrappers)

    def stress(self, point: Point, c: SimpleNamespace) -> tuple[Tensor3, Tensor3, list[Any]]:
        """New deformation gradient, Kirchhoff stress [Pa] and history of one particle."""
        for factor in self.factors:
            point = replace(point, stiffness=point.stiffness * returned(factor, factor(point, c), "one number"))
        given, new = point.history, list(point.history)

        def nested(level: int, offset: int) -> Law:
            if level == len(self.wrappers):
                return lambda point, c: returned(self.law, self.law(point, c), STRESSES, 2, 3, 3)
            wrapper, kept = self.wrappers[level]
            inner, mine = nested(level + 1, offset + kept), slice(offset, offset + kept)

            def law(point: Point, c: SimpleNamespace) -> tuple[Tensor3, Tensor3]:
                out = wrapper(inner, replace(point, history=given[mine]), c)
                if not isinstance(out, tuple) or [len(x) for x in out] != [3, 3] + [kept] * bool(kept):
                    more = f", and a list of {kept}" if kept else ""
                    raise mistake_of(wrapper, f"has to return {STRESSES}{more}")
                new[mine] = out[2] if kept else []
                return out[0], out[1]

            return law

        F, tau = nested(0, 0)(point, c)
        return F, tau, new

    def velocity(self, point: Point, c: SimpleNamespace) -> list[Any]:
        """Velocity of one particle after the substep under the body accelerations alone [m/s, (3,)]."""
        velocity = list(point.v)
        for law in self.accelerations:
            a = returned(law, law(point, c), VECTOR, 3)
            velocity = [u + point.dt * x for u, x in zip(velocity, a, strict=True)]
        return velocity

    def on_ground(self, u: list[Any], c: SimpleNamespace) -> list[Any]:
        """The velocity that the ground lets a node have [m/s, (3,)]."""
        return returned(self.ground, self.ground(u, c), VECTOR, 3)

    def try_out(self, values: Sequence[float]) -> None:
        """Raise UserInputError where a law returns another form than it should, as far as floats show it (of some laws
        only their kernel does), given the values of the coefficients in order.
        """
        c, some = SimpleNamespace(**dict(zip(self.names, values, strict=True))), [0.1, 0.2, 0.3]
        F, C = [[1.0, 0.1, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 0.9]], [[0.1, 0.2, 0.3], [0.2, 0.1, 0.0], some]
        point = Point(F, C, some, some, some, 0.1, 1e-3, 1.0, 1e-3, 1.0, [0.1] * self.history)
        parts: list[tuple[Callable, Any]] = [(self.stress, point), (self.velocity, point), (self.on_ground, some)]
        for part, seen in parts:
            try:
                part(seen, c)
            except UserInputError:
                raise
            except Exception:
                continue  # the kernel says what is wrong, if it is


class Evaluation(Emitted):
    """All local laws at one particle, emitted into the kernel that is being compiled.

    Args:
        laws: the laws.
        point: what they see, as expressions.
        coefficients: of the laws, in the order of their names, as expressions.

    F_new, tau: new deformation gradient and Kirchhoff stress [Pa], nested lists of expressions
    velocity: velocity after dt of body acceleration [m/s]
    history: new history
    """

    def __init__(self, laws: LocalLaws, point: Point, coefficients: Sequence):
        self._record = Record()
        row = self._record.variables
        t, dt, mass, volume, stiffness = row([point.t, point.dt, point.mass, point.volume, point.stiffness])
        F, C = [row(r) for r in point.F], [row(r) for r in point.C]
        x, X, v = row(point.x), row(point.X), row(point.v)
        self._point = Point(F, C, x, X, v, t, dt, mass, volume, stiffness, row(point.history))
        self._coefficients = row(coefficients)
        named = SimpleNamespace(**dict(zip(laws.names, self._coefficients, strict=True)))
        self._F_new, self._tau, self._history = laws.stress(self._point, named)
        self._velocity = laws.velocity(self._point, named)
        self.F_new, self.tau = _values(self._F_new), _values(self._tau)
        self.velocity, self.history = [plain(u) for u in self._velocity], [plain(h) for h in self._history]

    def pull_back(self, gF, gtau, gv, gh) -> "Adjoint":
        """Emit the adjoint, given the adjoints of F_new, tau, velocity and history as nested lists of expressions."""
        p = self._point
        seeds = [
            *(
                (a, g)
                for row, grow in zip(self._F_new + self._tau, gF + gtau, strict=True)
                for a, g in zip(row, grow, strict=True)
            ),
            *zip(self._velocity, gv, strict=True),
            *zip(self._history, gh, strict=True),
        ]
        inputs = [*(a for row in p.F + p.C for a in row), *p.x, *p.X, *p.v, p.mass, p.stiffness]
        return Adjoint(self._record.pull_back(seeds, [*inputs, *p.history, *self._coefficients]), len(p.history))


class Adjoint(Emitted):
    """Adjoints of what a law saw, as nested lists of expressions."""

    def __init__(self, g: list, history: int):
        self.F, self.C = [g[0:3], g[3:6], g[6:9]], [g[9:12], g[12:15], g[15:18]]
        self.x, self.X, self.v = g[18:21], g[21:24], g[24:27]
        self.mass, self.stiffness = g[27], g[28]
        self.history, self.coefficients = g[29 : 29 + history], g[29 + history :]


class GroundEvaluation(Emitted):
    """The ground law at one node, emitted into the kernel that is being compiled."""

    def __init__(self, laws: LocalLaws, velocity: list, coefficients: Sequence):
        self._record = Record()
        self._u, self._coefficients = self._record.variables(velocity), self._record.variables(coefficients)
        named = SimpleNamespace(**dict(zip(laws.names, self._coefficients, strict=True)))
        self._out = laws.on_ground(self._u, named)
        self.velocity = [plain(u) for u in self._out]

    def pull_back(self, g: list) -> list:
        """Adjoints of the velocity (3) and of every coefficient."""
        return self._record.pull_back(list(zip(self._out, g, strict=True)), self._u + self._coefficients)


def _values(tensor: Tensor3) -> list[list[Any]]:
    return [[plain(a) for a in row] for row in tensor]
