"""Resistance of the surrounding medium, at high speed."""

from types import SimpleNamespace
from typing import Any

from pacnerf_lpo.mpm.differentiation import sqrt
from pacnerf_lpo.mpm.effects.base import BodyForce
from pacnerf_lpo.mpm.parameters import Identity, Parameter, named
from pacnerf_lpo.mpm.point import Point


class QuadraticDrag(BodyForce):
    """Acceleration -k |v| v: form drag per unit mass, k = C_d A rho_air / (2 m).

    Args:
        drag_per_length: k [1/m].
    """

    parameters = named(Parameter("drag_per_length", "1/m", Identity(), (-10.0, 100.0), "drag per length"))
    of_medium = True
    signature = "all views see the body arrive late, the more so the faster it falls"
    confused_with = ("LinearDrag", "GravityMagnitude")
    separating_experiment = "a second drop from twice the height: quadratic drag doubles its share, linear does not"
    one_sided = True
    probes = ({"drag_per_length": 0.15}, {"drag_per_length": 0.8})

    @staticmethod
    def acceleration(point: Point, c: SimpleNamespace) -> list[Any]:
        speed = sqrt(point.v[0] * point.v[0] + point.v[1] * point.v[1] + point.v[2] * point.v[2])
        return [-c.drag_per_length * speed * v for v in point.v]
