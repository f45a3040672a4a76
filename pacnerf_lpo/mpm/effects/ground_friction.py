"""A ground on which the body slides against friction, and which it may leave."""

from types import SimpleNamespace
from typing import Any

from pacnerf_lpo.mpm.differentiation import where
from pacnerf_lpo.mpm.effects.base import GroundEffect
from pacnerf_lpo.mpm.ground import Separate
from pacnerf_lpo.mpm.parameters import Identity, Parameter, named

STICKING = 1e3
"""Friction coefficient from which on the ground counts as sticky."""


class GroundFriction(GroundEffect):
    """Coulomb friction with separation, as the ground :class:`~pacnerf_lpo.mpm.ground.Separate`, with a coefficient
    that is identified. From 1000 on the ground is sticky: nothing slides and nothing leaves. The step from one to the
    other is discrete: this is an alternative to refit from one of the probes, not a small change of sticking.

    Args:
        ground_friction: Coulomb coefficient [1].
    """

    parameters = named(Parameter("ground_friction", "1", Identity(), (-1e-6, 1e4), "friction coefficient"))
    null = {"ground_friction": STICKING}  # noqa: RUF012
    signature = "from the contact on the body slides, and lifts off as a whole"
    confused_with = ("Adhesion", "InitialSpin", "UniformForce")
    separating_experiment = "a throw with twice the horizontal velocity: the sliding path grows with its square"
    one_sided = True
    probes = ({"ground_friction": 0.1}, {"ground_friction": 0.5}, {"ground_friction": 2.0})

    @staticmethod
    def velocity(u: list[Any], c: SimpleNamespace) -> list[Any]:
        sticks = c.ground_friction >= STICKING
        return [where(sticks, 0.0, x) for x in Separate.velocity(u, SimpleNamespace(friction=c.ground_friction))]
