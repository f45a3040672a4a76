"""Sand."""

import math
from collections.abc import Mapping, Sequence
from types import SimpleNamespace
from typing import Any

import torch
from torch import Tensor

from pacnerf_lpo.mpm.differentiation import maximum, where
from pacnerf_lpo.mpm.materials.base import Material, lame
from pacnerf_lpo.mpm.materials.common import POISSON, YOUNG, kept_share
from pacnerf_lpo.mpm.parameters import Identity, Parameter, named
from pacnerf_lpo.mpm.point import Point
from pacnerf_lpo.mpm.principal import return_mapped
from pacnerf_lpo.mpm.tensors import Tensor3


class DruckerPrager(Material):
    """Hencky elasticity in the cone ||dev e|| <= -alpha (3 lambda + 2 mu) / (2 mu) tr(e), and no stress under
    expansion, with alpha = sqrt(2/3) 2 sin(theta) / (3 - sin(theta)) (Klár et al., "Drucker-Prager elastoplasticity
    for sand animation", 2016).

    Args:
        theta: friction angle [deg]; below 65, more than sand, gravel and broken rock have: a wider cone carries
            unconfined sand and stands in for cohesion.
        E: Young's modulus [Pa].
        nu: Poisson's ratio.
        known: names of parameters that are not identified.
    """

    family = "granular"
    parameters = named(
        Parameter("theta", "deg", Identity(), (0.0, 65.0), "friction angle", scale=2.0, rate=1.0), YOUNG, POISSON
    )

    def __init__(self, theta: float = 30.0, E: float = 1e6, nu: float = 0.3, known: Sequence[str] = ()):
        super().__init__({"theta": theta, "E": E, "nu": nu}, known)

    @staticmethod
    def coefficients(p: Mapping[str, Tensor]) -> dict[str, Tensor]:
        sine = torch.sin(torch.deg2rad(p["theta"]))
        return {**lame(p["E"], p["nu"]), "alpha": math.sqrt(2 / 3) * 2 * sine / (3 - sine)}

    @staticmethod
    def law(point: Point, c: SimpleNamespace) -> tuple[Tensor3, Tensor3]:
        mu, lam = point.stiffness * c.mu, point.stiffness * c.lam
        slope = 3.0 * c.alpha * (1.5 * (c.lam / c.mu) + 1.0)

        def flow(e: list[Any], mean: Any, norm: Any) -> tuple[Any, Any]:
            compressed = mean < 0.0
            kept = kept_share(norm, maximum(norm + slope * mean, 0.0))
            return where(compressed, kept, 0.0), where(compressed, mean, 0.0)

        return return_mapped(point.F, mu, lam, flow)
