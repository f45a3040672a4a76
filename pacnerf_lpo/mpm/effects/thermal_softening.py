"""Bodies that soften, or set, while they are filmed."""

from types import SimpleNamespace
from typing import Any

from pacnerf_lpo.mpm.differentiation import exp
from pacnerf_lpo.mpm.effects.base import Softening
from pacnerf_lpo.mpm.parameters import Identity, Parameter, named
from pacnerf_lpo.mpm.point import Point


class ThermalSoftening(Softening):
    """All moduli (and a fluid's viscosity) times exp(-s t), t since frame 0.

    Args:
        softening: rate s [1/s]; negative for a body that hardens.
    """

    parameters = named(Parameter("softening", "1/s", Identity(), (-20.0, 20.0), "softening rate", scale=0.2))
    signature = "late frames look softer than early ones: every next contact is deeper and slower"
    confused_with = ("KelvinVoigt", "YieldStress")
    separating_experiment = "the same drop filmed later, or repeated with the same body"
    probes = ({"softening": -0.5}, {"softening": 0.5}, {"softening": 3.0})

    @staticmethod
    def factor(point: Point, c: SimpleNamespace) -> Any:
        return exp(-c.softening * point.t)
