"""Resistance of the surrounding medium, at low speed."""

from types import SimpleNamespace
from typing import Any

from pacnerf_lpo.mpm.effects.base import BodyForce
from pacnerf_lpo.mpm.parameters import Identity, Parameter, named
from pacnerf_lpo.mpm.point import Point


class LinearDrag(BodyForce):
    """Acceleration -c v: Stokes drag per unit mass. The fall approaches a terminal velocity g / c.

    Args:
        drag: rate c [1/s].
    """

    parameters = named(Parameter("drag", "1/s", Identity(), (-100.0, 1000.0), "drag rate"))
    of_medium = True
    signature = "all views see the body arrive late, and slower than free fall"
    confused_with = ("QuadraticDrag", "GravityMagnitude")
    separating_experiment = "a second drop from twice the height: quadratic drag doubles its share, gravity keeps it"
    one_sided = True
    probes = ({"drag": 0.3}, {"drag": 1.5})

    @staticmethod
    def acceleration(point: Point, c: SimpleNamespace) -> list[Any]:
        return [-c.drag * v for v in point.v]
