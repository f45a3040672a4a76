"""A steady sideways push: wind on a body of even exposure, or a world that is not level."""

from types import SimpleNamespace
from typing import Any

from pacnerf_lpo.mpm.effects.base import BodyForce
from pacnerf_lpo.mpm.parameters import by_axis
from pacnerf_lpo.mpm.point import Point


class UniformForce(BodyForce):
    """Acceleration (a_x, 0, a_z), the same everywhere. Its vertical part is :class:`GravityMagnitude`.

    Motion alone does not separate a wind a from a tilt of the world by atan(a / g).

    Args:
        push_x: a_x [m/s^2].
        push_z: a_z [m/s^2].
    """

    parameters = by_axis("push", "m/s^2", (-100.0, 100.0), "push along", axes="xz")
    of_medium = True
    signature = "the body drifts sideways along a parabola from frame 0 on, in all views"
    confused_with = ("CentralForce", "CameraRotation")
    separating_experiment = (
        "a plumb line in the picture separates tilt from wind; a second start position, a central force"
    )
    probes = ({"push_x": 0.5, "push_z": 0.0}, {"push_x": 0.0, "push_z": 0.5}, {"push_x": 1.0, "push_z": 1.0})

    @staticmethod
    def acceleration(point: Point, c: SimpleNamespace) -> list[Any]:
        return [c.push_x, 0.0, c.push_z]
