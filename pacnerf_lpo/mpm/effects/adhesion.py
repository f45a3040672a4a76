"""A ground that lets go of the body, and gives it a part of its velocity back."""

from types import SimpleNamespace
from typing import Any

from pacnerf_lpo.mpm.differentiation import where
from pacnerf_lpo.mpm.effects.base import GroundEffect
from pacnerf_lpo.mpm.parameters import Identity, Parameter, named

HELD = 1e3
"""Velocity of detachment that no node reaches [m/s]."""


class Adhesion(GroundEffect):
    """What sticks may let go. With u the velocity of a node of the ground: if u_y < 0 (approaching) it becomes
    (0, -e u_y, 0); if 0 <= u_y <= d (leaving too slowly), 0; if u_y > d it is free.

    d measures the adhesion, from 0 (none) to the sticky ground's infinity; e is the part of the approaching velocity
    that the ground returns, 0 for a body that rebounds by its own elasticity alone. The condition is on nodes of the
    grid, within a substep: both values hold for one grid spacing and time step, and are comparable between runs of the
    same only.

    Args:
        detachment_speed: d [m/s]; 1000 is never.
        restitution: e [1].
    """

    parameters = named(
        Parameter("detachment_speed", "m/s", Identity(), (-1e-6, 1e4), "detachment speed"),
        Parameter("restitution", "1", Identity(), (-1e-6, 1.0), "restitution", scale=0.05),
    )
    null = {"detachment_speed": HELD, "restitution": 0.0}  # noqa: RUF012
    signature = "from the first rebound on the body leaves the ground earlier and higher"
    confused_with = ("KelvinVoigt", "GroundFriction")
    separating_experiment = "the same body dropped on a ground of known grip, such as a greased plate"
    one_sided = True
    probes = (
        {"detachment_speed": 0.0, "restitution": 0.0},
        {"detachment_speed": 0.2, "restitution": 0.0},
        {"detachment_speed": 0.0, "restitution": 0.2},
    )

    @staticmethod
    def velocity(u: list[Any], c: SimpleNamespace) -> list[Any]:
        approaching, free = u[1] < 0.0, u[1] > c.detachment_speed
        returned = where(approaching, -c.restitution * u[1], 0.0)
        return [where(free, u[0], 0.0), where(free, u[1], returned), where(free, u[2], 0.0)]
