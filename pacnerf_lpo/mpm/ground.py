"""The ground: what the plane y = 0 does to the velocity of grid nodes on or below it."""

from abc import ABC, abstractmethod
from types import SimpleNamespace
from typing import Any

from pacnerf_lpo.mpm.differentiation import maximum, sqrt, where
from pacnerf_lpo.mpm.parameters import Identity, Parameter, named


class Ground(ABC):
    """A boundary condition. ``parameters`` and ``guess`` name what it depends on, in SI units."""

    parameters: dict[str, Parameter] = {}  # noqa: RUF012
    guess: dict[str, float] = {}  # noqa: RUF012

    @staticmethod
    @abstractmethod
    def velocity(u: list[Any], c: SimpleNamespace) -> list[Any]:
        """The velocity a node keeps [m/s, (3,)], given the one it would have without ground and the coefficients."""


class Sticky(Ground):
    """Nodes on the ground do not move."""

    @staticmethod
    def velocity(u: list[Any], c: SimpleNamespace) -> list[Any]:
        return [0.0, 0.0, 0.0]


class Slip(Ground):
    """Nodes on the ground move along it without resistance, and never leave it."""

    @staticmethod
    def velocity(u: list[Any], c: SimpleNamespace) -> list[Any]:
        return [u[0], 0.0, u[2]]


class Separate(Ground):
    """Nodes may leave the ground; approaching it they stop, and Coulomb friction resists the sliding.

    Where u_y < 0: u_y = 0 and the tangential velocity shrinks by friction * |u_y|, at most to 0.

    Args:
        friction: Coulomb coefficient [1], not negative.
    """

    parameters = named(Parameter("friction", "1", Identity(), (-1e-9, 10.0), "friction coefficient"))

    def __init__(self, friction: float = 0.0):
        self.guess = {"friction": self.parameters["friction"].check(friction, "Separate")}

    @staticmethod
    def velocity(u: list[Any], c: SimpleNamespace) -> list[Any]:
        speed = sqrt(u[0] * u[0] + u[2] * u[2])
        moving = where(speed > 0.0, speed, 1.0)
        kept = maximum(1.0 + c.friction * u[1] / moving, 0.0)
        approaching = u[1] < 0.0
        held = kept * u[0], 0.0, kept * u[2]
        return [where(approaching, after, before) for after, before in zip(held, u, strict=True)]
