"""A pull towards, or a push away from, one point."""

from types import SimpleNamespace
from typing import Any

from pacnerf_lpo.mpm.effects.base import BodyForce
from pacnerf_lpo.mpm.parameters import Identity, Parameter
from pacnerf_lpo.mpm.point import Point


class CentralForce(BodyForce):
    """Acceleration -k (x - p) towards a given point p: an isotropic spring per unit mass.

    Args:
        pull: k [1/s^2]; negative pushes away.
        centre: p [m], its height measured from the ground.
    """

    parameters = {"pull": Parameter("pull", "1/s^2", Identity(), (-1e3, 1e4), "pull towards the centre", scale=0.5)}  # noqa: RUF012
    null = {"pull": 0.0}  # noqa: RUF012
    signature = "the acceleration changes with the place: the body is drawn towards a point, and squeezed a little"
    confused_with = ("UniformForce", "GravityMagnitude")
    separating_experiment = "a second start position, on the other side of the point"
    probes = ({"pull": -1.0}, {"pull": 1.0}, {"pull": 5.0})

    def __init__(self, pull: float = 0.0, centre: tuple[float, float, float] = (0.0, 0.5, 0.0)):
        self.centre = tuple(centre)
        names = ("pull_centre_x", "pull_centre_y", "pull_centre_z")
        super().__init__({"pull": pull}, dict(zip(names, centre, strict=True)))

    @staticmethod
    def acceleration(point: Point, c: SimpleNamespace) -> list[Any]:
        centre = (c.pull_centre_x, c.pull_centre_y, c.pull_centre_z)
        return [-c.pull * (x - p) for x, p in zip(point.x, centre, strict=True)]
