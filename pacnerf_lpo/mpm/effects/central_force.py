"""A pull towards, or a push away from, one point."""

from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any

from pacnerf_lpo.mpm.effects.base import BodyForce
from pacnerf_lpo.mpm.parameters import Identity, Parameter, named
from pacnerf_lpo.mpm.point import Point


class CentralForce(BodyForce):
    """Acceleration -k (x - p) towards a point p: an isotropic spring per unit mass.

    It is written b - k (x - c) around a given reference point c, so that strength and place are identified together:
    the centre is p = c + b / k, which the null k = 0 says nothing of.

    Args:
        pull: k [1/s^2]; negative pushes away.
        central_x, central_y, central_z: b, acceleration at the reference point [m/s^2].
        centre: c [m], its height measured from the ground; with b = 0 the centre itself.
    """

    parameters = named(
        Parameter("pull", "1/s^2", Identity(), (-1e3, 1e4), "pull towards the centre", scale=0.5),
        Parameter("central_x", "m/s^2", Identity(), (-1e4, 1e4), "pull along x at the reference point"),
        Parameter("central_y", "m/s^2", Identity(), (-1e4, 1e4), "pull along y at the reference point"),
        Parameter("central_z", "m/s^2", Identity(), (-1e4, 1e4), "pull along z at the reference point"),
    )
    signature = "the acceleration changes with the place: the body is drawn towards a point, and squeezed a little"
    confused_with = ("UniformForce", "GravityMagnitude")
    separating_experiment = "a second start position, on the other side of the point"
    probes = (
        {"pull": -1.0, "central_x": 0.0, "central_y": 0.0, "central_z": 0.0},
        {"pull": 5.0, "central_x": 0.0, "central_y": 0.0, "central_z": 0.0},
        {"pull": 1.0, "central_x": 1.0, "central_y": 1.0, "central_z": 1.0},
    )

    def __init__(self, guess: Mapping[str, float], centre: tuple[float, float, float] = (0.0, 0.5, 0.0)):
        self.centre = tuple(centre)
        super().__init__(guess, {f"pull_centre_{axis}": x for axis, x in zip("xyz", centre, strict=True)})

    @staticmethod
    def acceleration(point: Point, c: SimpleNamespace) -> list[Any]:
        centre = (c.pull_centre_x, c.pull_centre_y, c.pull_centre_z)
        at_centre = (c.central_x, c.central_y, c.central_z)
        return [b - c.pull * (x - p) for b, x, p in zip(at_centre, point.x, centre, strict=True)]
