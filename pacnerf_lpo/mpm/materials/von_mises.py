"""Plasticine: solids that yield, at any rate the same."""

import math
from collections.abc import Mapping, Sequence
from types import SimpleNamespace
from typing import Any

from torch import Tensor

from pacnerf_lpo.mpm.differentiation import maximum
from pacnerf_lpo.mpm.materials.base import Material, lame
from pacnerf_lpo.mpm.materials.common import POISSON, YIELD, YOUNG, kept_share
from pacnerf_lpo.mpm.parameters import named
from pacnerf_lpo.mpm.point import Point
from pacnerf_lpo.mpm.principal import return_mapped
from pacnerf_lpo.mpm.tensors import Tensor3


class VonMises(Material):
    """Hencky elasticity with von Mises yield ||dev tau|| <= sqrt(2/3) tau_y, radial return (PAC-NeRF).

    Args:
        E: Young's modulus [Pa].
        nu: Poisson's ratio.
        tau_y: yield stress [Pa].
        known: names of parameters that are not identified.
    """

    family = "plastic"
    parameters = named(YOUNG, POISSON, YIELD)

    def __init__(self, E: float = 1e5, nu: float = 0.3, tau_y: float = 1e3, known: Sequence[str] = ()):
        super().__init__({"E": E, "nu": nu, "tau_y": tau_y}, known)

    @staticmethod
    def coefficients(p: Mapping[str, Tensor]) -> dict[str, Tensor]:
        return {**lame(p["E"], p["nu"]), "tau_y": p["tau_y"]}

    @staticmethod
    def law(point: Point, c: SimpleNamespace) -> tuple[Tensor3, Tensor3]:
        mu, lam = point.stiffness * c.mu, point.stiffness * c.lam
        largest = math.sqrt(2 / 3) * c.tau_y / (2.0 * mu)

        def flow(e: list[Any], mean: Any, norm: Any) -> tuple[Any, Any]:
            return kept_share(norm, maximum(norm - largest, 0.0)), mean

        return return_mapped(point.F, mu, lam, flow)
