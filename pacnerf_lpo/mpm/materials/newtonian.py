"""Viscous fluids."""

from collections.abc import Sequence
from types import SimpleNamespace

from pacnerf_lpo.mpm.differentiation import maximum
from pacnerf_lpo.mpm.materials.base import Material
from pacnerf_lpo.mpm.materials.common import BULK
from pacnerf_lpo.mpm.parameters import Log10, Parameter, named
from pacnerf_lpo.mpm.point import Point
from pacnerf_lpo.mpm.tensors import Tensor3, add_isotropic, determinant, diagonal, scaled, symmetric

SMALLEST_J = 0.05


class Newtonian(Material):
    """Weakly compressible Newtonian fluid: tau = kappa (J - J^-6) I + mu J sym(grad v) (PAC-NeRF).

    Of the deformation only the volume ratio J is kept, as F = diag(J, 1, 1), and J >= 0.05.

    Args:
        mu: viscosity [Pa s].
        kappa: bulk modulus [Pa].
        known: names of parameters that are not identified.
    """

    family = "viscous"
    parameters = named(Parameter("mu", "Pa s", Log10(), (0.0, 1e12), "viscosity", impact=0.1), BULK)

    def __init__(self, mu: float = 10.0, kappa: float = 1e4, known: Sequence[str] = ()):
        super().__init__({"mu": mu, "kappa": kappa}, known)

    @staticmethod
    def law(point: Point, c: SimpleNamespace) -> tuple[Tensor3, Tensor3]:
        J = maximum(determinant(point.F), SMALLEST_J)
        pressure = point.stiffness * c.kappa * (J - J**-6)
        return diagonal(J, 1.0, 1.0), add_isotropic(scaled(symmetric(point.C), point.stiffness * c.mu * J), pressure)
