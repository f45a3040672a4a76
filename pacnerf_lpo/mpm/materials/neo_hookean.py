"""Elastic solids."""

from collections.abc import Mapping, Sequence
from types import SimpleNamespace

from torch import Tensor

from pacnerf_lpo.mpm.differentiation import log
from pacnerf_lpo.mpm.materials.base import Material, lame
from pacnerf_lpo.mpm.materials.common import POISSON, YOUNG
from pacnerf_lpo.mpm.parameters import named
from pacnerf_lpo.mpm.point import Point
from pacnerf_lpo.mpm.tensors import Tensor3, add_isotropic, determinant, left_cauchy_green, scaled


class NeoHookean(Material):
    """Compressible neo-Hookean solid: tau = mu (F Fᵀ - I) + lambda ln J I (Bonet and Wood; PAC-NeRF).

    Args:
        E: Young's modulus [Pa].
        nu: Poisson's ratio.
        known: names of parameters that are not identified.
    """

    family = "elastic"
    parameters = named(YOUNG, POISSON)

    def __init__(self, E: float = 1e5, nu: float = 0.3, known: Sequence[str] = ()):
        super().__init__({"E": E, "nu": nu}, known)

    @staticmethod
    def coefficients(p: Mapping[str, Tensor]) -> dict[str, Tensor]:
        return lame(p["E"], p["nu"])

    @staticmethod
    def law(point: Point, c: SimpleNamespace) -> tuple[Tensor3, Tensor3]:
        mu, lam = point.stiffness * c.mu, point.stiffness * c.lam
        pressure = lam * log(determinant(point.F)) - mu
        return point.F, add_isotropic(scaled(left_cauchy_green(point.F), mu), pressure)
