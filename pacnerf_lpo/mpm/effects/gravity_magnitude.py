"""Gravity of another strength than believed, which is also a scale of another size."""

from types import SimpleNamespace
from typing import Any

from pacnerf_lpo.mpm.effects.base import BodyForce
from pacnerf_lpo.mpm.parameters import Identity, Parameter, named
from pacnerf_lpo.mpm.point import Point


class GravityMagnitude(BodyForce):
    """Acceleration (0, -d, 0) in addition to gravity.

    Motion alone does not separate it from a length scale that is wrong by g / (g + d).

    Args:
        extra_gravity: d [m/s^2]; negative where the body falls slower (buoyancy).
    """

    parameters = named(Parameter("extra_gravity", "m/s^2", Identity(), (-20.0, 100.0), "extra gravity"))
    signature = "the body falls along another vertical parabola, the same in all views"
    confused_with = ("LinearDrag", "QuadraticDrag")
    separating_experiment = "a scale bar in the picture; and a second drop from twice the height, against drag"
    probes = ({"extra_gravity": -0.5}, {"extra_gravity": 0.5}, {"extra_gravity": 2.0})

    @staticmethod
    def acceleration(point: Point, c: SimpleNamespace) -> list[Any]:
        return [0.0, -c.extra_gravity, 0.0]
