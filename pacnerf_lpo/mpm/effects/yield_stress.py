"""Elastic solids that yield after all, and harden as they do."""

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

from pacnerf_lpo.mpm.differentiation import maximum, where
from pacnerf_lpo.mpm.effects.base import LawEffect
from pacnerf_lpo.mpm.materials.common import kept_share
from pacnerf_lpo.mpm.materials.neo_hookean import NeoHookean
from pacnerf_lpo.mpm.parameters import Identity, Log10, Parameter, named
from pacnerf_lpo.mpm.point import Law, Point
from pacnerf_lpo.mpm.principal import return_mapped
from pacnerf_lpo.mpm.tensors import AXES

NEVER = 1e9
"""A yield stress that nothing in a video reaches [Pa]."""


class YieldStress(LawEffect):
    """Von Mises yield of an elastic solid, ||2 mu dev e|| <= sqrt(2/3) (tau_y + H a), with the logarithmic strain e and
    linear isotropic hardening over the accumulated plastic strain a, which each particle keeps. Radial return (Simo and
    Hughes, "Computational Inelasticity", 1998, box 3.1) to the elastic deformation that the material's law then sees.

    The yield stress is not multiplied by the particle's stiffness factor, as in :class:`VonMises`.

    Args:
        yield_stress: tau_y [Pa]; 1e9 is never.
        hardening: H [Pa].
    """

    history = 1
    parameters = named(
        Parameter("yield_stress", "Pa", Log10(), (0.0, 1e12), "yield stress"),
        Parameter("hardening", "Pa", Identity(), (-1e-3, 1e9), "hardening modulus", scale=500.0),
    )
    null = {"yield_stress": NEVER, "hardening": 0.0}  # noqa: RUF012
    signature = "the shape stays changed after the impact, and the rebound is lower"
    confused_with = ("KelvinVoigt", "GroundFriction", "ThermalSoftening")
    separating_experiment = "the shape of the body long after it has come to rest"
    materials = (NeoHookean,)
    unsuited = "yields or flows already; the effect is for NeoHookean"
    one_sided = True
    probes = (
        {"yield_stress": 3e2, "hardening": 0.0},
        {"yield_stress": 3e3, "hardening": 0.0},
        {"yield_stress": 3e3, "hardening": 3e4},
    )

    @staticmethod
    def law(inner: Law, point: Point, c: SimpleNamespace) -> tuple:
        mu, (strain,) = point.stiffness * c.mu, point.history
        largest = math.sqrt(2 / 3) * (c.yield_stress + c.hardening * strain) / (2.0 * mu)
        plastic: list[Any] = []

        def flow(e: list[Any], mean: Any, norm: Any) -> tuple[Any, Any]:
            plastic.append(maximum(norm - largest, 0.0) / (1.0 + c.hardening / (3.0 * mu)))
            return kept_share(norm, plastic[0]), mean

        returned, _ = return_mapped(point.F, 0.0, 0.0, flow)
        elastic = [[where(plastic[0] > 0.0, returned[i][j], point.F[i][j]) for j in AXES] for i in AXES]
        F, tau = inner(replace(point, F=elastic), c)
        return F, tau, [strain + math.sqrt(2 / 3) * plastic[0]]
