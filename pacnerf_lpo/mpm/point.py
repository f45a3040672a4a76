"""What a local law sees of one particle, and the evaluation of all local laws there with their adjoint."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from types import SimpleNamespace
from typing import Any

from pacnerf_lpo.mpm.differentiation import Record, plain
from pacnerf_lpo.mpm.taichi_calls import Emitted
from pacnerf_lpo.mpm.tensors import Tensor3, flat


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
    accelerations: tuple[Callable[[Point, SimpleNamespace], list[Any]], ...]
    ground: Callable[[list[Any], SimpleNamespace], list[Any]]
    names: tuple[str, ...]
    wrappers: tuple[tuple[Callable[[Law, Point, SimpleNamespace], tuple], int], ...] = ()
    factors: tuple[Callable[[Point, SimpleNamespace], Any], ...] = ()

    @property
    def history(self) -> int:
        """How many numbers a particle carries from substep to substep beside its deformation."""
        return sum(kept for _, kept in self.wrappers)

    def stress(self, point: Point, c: SimpleNamespace) -> tuple[Tensor3, Tensor3, list[Any]]:
        """New deformation gradient, Kirchhoff stress [Pa] and history of one particle."""
        for factor in self.factors:
            point = replace(point, stiffness=point.stiffness * factor(point, c))
        given, new = point.history, list(point.history)

        def nested(level: int, offset: int) -> Law:
            if level == len(self.wrappers):
                return self.law
            wrapper, kept = self.wrappers[level]
            inner, mine = nested(level + 1, offset + kept), slice(offset, offset + kept)

            def law(point: Point, c: SimpleNamespace) -> tuple[Tensor3, Tensor3]:
                F, tau, *history = wrapper(inner, replace(point, history=given[mine]), c)
                new[mine] = history[0] if kept else []
                return F, tau

            return law

        F, tau = nested(0, 0)(point, c)
        return F, tau, new


class Evaluation(Emitted):
    """All local laws at one particle, emitted into the kernel that is being compiled.

    Args:
        point: what they see, as expressions.
        coefficients: of the laws, in the order of their names, as expressions.

    F_new, tau: new deformation gradient and Kirchhoff stress [Pa], nested lists of expressions
    velocity: velocity after dt of body acceleration [m/s]
    history: new history
    """

    def __init__(self, laws: LocalLaws, point: Point, coefficients: list[Any]):
        self._record = Record()
        self._point = Point(**{name: self._record.variables(value) for name, value in vars(point).items()})
        self._coefficients = self._record.variables(coefficients)
        named = SimpleNamespace(**dict(zip(laws.names, self._coefficients, strict=True)))
        self._F_new, self._tau, self._history = laws.stress(self._point, named)
        self._velocity = list(self._point.v)
        for acceleration in laws.accelerations:
            a = acceleration(self._point, named)
            self._velocity = [u + self._point.dt * c for u, c in zip(self._velocity, a, strict=True)]
        self.F_new, self.tau = plain(self._F_new), plain(self._tau)
        self.velocity, self.history = plain(self._velocity), plain(self._history)

    def pull_back(self, gF, gtau, gv, gh) -> "Adjoint":
        """Emit the adjoint, given the adjoints of F_new, tau, velocity and history as nested lists of expressions."""
        seeds = [
            *zip(flat(self._F_new + self._tau), flat(gF + gtau), strict=True),
            *zip(self._velocity, gv, strict=True),
            *zip(self._history, gh, strict=True),
        ]
        gradient = self._record.pull_back(seeds)
        seen = {name: gradient(value) for name, value in vars(self._point).items()}
        return Adjoint(**seen, coefficients=gradient(self._coefficients))


@dataclass(frozen=True)
class Adjoint(Point, Emitted):
    """Adjoints of what the laws saw, and of their coefficients, as nested lists of expressions."""

    coefficients: list[Any] = field(default_factory=list)


class GroundEvaluation(Emitted):
    """The ground law at one node, emitted into the kernel that is being compiled."""

    def __init__(self, laws: LocalLaws, velocity: list[Any], coefficients: list[Any]):
        self._record = Record()
        self._u, self._coefficients = self._record.variables(velocity), self._record.variables(coefficients)
        named = SimpleNamespace(**dict(zip(laws.names, self._coefficients, strict=True)))
        self._out = laws.ground(self._u, named)
        self.velocity = plain(self._out)

    def pull_back(self, g: list) -> list:
        """Adjoints of the velocity (3) and of every coefficient."""
        gradient = self._record.pull_back(list(zip(self._out, g, strict=True)))
        return gradient(self._u + self._coefficients)
