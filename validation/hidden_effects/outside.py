"""Effects that the catalogue does not have. Nothing but the generator knows them."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, ClassVar

from pacnerf_lpo.mpm.differentiation import exp
from pacnerf_lpo.mpm.effects.base import BodyForce, Effect, GroundEffect, LawEffect
from pacnerf_lpo.mpm.parameters import Identity, Parameter
from pacnerf_lpo.mpm.point import Law, Point
from pacnerf_lpo.mpm.tensors import AXES, added

GUST_TIME, GUST_WIDTH = 0.15, 0.04  # s


class OutsideEffect(Effect):
    """One coefficient, which vanishes at 0.

    Args:
        strength: its value [its own unit].
    """

    name: ClassVar[str]

    def __init__(self, strength: float = 0.0):
        super().__init__({self.name: strength})


class Gust(OutsideEffect, BodyForce):
    """A short push along x: a = A exp(-((t - 0.15 s) / 0.04 s)^2)."""

    name = "gust"
    parameters = {"gust": Parameter("gust", "m/s^2", Identity(), (-1e4, 1e4), "gust")}  # noqa: RUF012
    null = {"gust": 0.0}  # noqa: RUF012
    probes = ({"gust": 10.0},)

    @staticmethod
    def acceleration(point: Point, c: SimpleNamespace) -> list[Any]:
        late = (point.t - GUST_TIME) * (1.0 / GUST_WIDTH)
        return [c.gust * exp(-1.0 * late * late), 0.0, 0.0]


class Vortex(OutsideEffect, BodyForce):
    """Matter is carried round the axis x = z = 0: a = w (z, 0, -x)."""

    name = "vortex"
    parameters = {"vortex": Parameter("vortex", "1/s^2", Identity(), (-1e4, 1e4), "vortex")}  # noqa: RUF012
    null = {"vortex": 0.0}  # noqa: RUF012
    probes = ({"vortex": 20.0},)

    @staticmethod
    def acceleration(point: Point, c: SimpleNamespace) -> list[Any]:
        return [c.vortex * point.x[2], 0.0, -1.0 * c.vortex * point.x[0]]


class Belt(OutsideEffect, GroundEffect):
    """A sticky ground that moves along x like a conveyor belt."""

    name = "belt"
    parameters = {"belt": Parameter("belt", "m/s", Identity(), (-1e2, 1e2), "speed of the belt")}  # noqa: RUF012
    null = {"belt": 0.0}  # noqa: RUF012
    probes = ({"belt": 0.5},)

    @staticmethod
    def velocity(u: list[Any], c: SimpleNamespace) -> list[Any]:
        return [c.belt + 0.0 * u[0], 0.0 * u[1], 0.0 * u[2]]


class Fibres(OutsideEffect, LawEffect):
    """Fibres along x of the undeformed body: tau += k (|f|^2 - 1) f f^T with f = F e_x."""

    name = "fibres"
    parameters = {"fibres": Parameter("fibres", "Pa", Identity(), (-1e7, 1e7), "fibre stiffness")}  # noqa: RUF012
    null = {"fibres": 0.0}  # noqa: RUF012
    probes = ({"fibres": 3e4},)

    @staticmethod
    def law(inner: Law, point: Point, c: SimpleNamespace) -> tuple:
        F, tau = inner(point, c)
        f = [F[i][0] for i in AXES]
        tension = c.fibres * point.stiffness * (f[0] * f[0] + f[1] * f[1] + f[2] * f[2] - 1.0)
        return F, added(tau, [[tension * f[i] * f[j] for j in AXES] for i in AXES])
