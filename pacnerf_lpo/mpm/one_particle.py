# mypy: disable-error-code="valid-type,index"
"""One particle through a constitutive law, compiled as in the engine, and what its small strains say of the law."""

import functools
from collections.abc import Callable

import torch
from torch import Tensor

from pacnerf_lpo.mpm.ground import Sticky
from pacnerf_lpo.mpm.materials.base import Material
from pacnerf_lpo.mpm.point import Evaluation, LocalLaws, Point
from pacnerf_lpo.mpm.runtime import start
from pacnerf_lpo.mpm.taichi_calls import Launcher, ti

SQUEEZE, SHEAR = 1e-6, 1e-8
"""Strains, both far below any yield. The shear is so much smaller because sand carries it under pressure only."""
DT = 1e-6
"""Substep [s]: too short for a relaxation."""
EYE = torch.eye(3, dtype=torch.float64)
ALL_WAYS = torch.tensor([[2.0, 1.0, -2.0], [1.0, -3.0, 1.5], [-2.0, 1.5, 1.0]], dtype=torch.float64)
"""A shear in every direction: symmetric, without trace."""
MODULI: dict[tuple, Callable[[float, float], tuple[float, float]]] = {
    (("E", "Pa"), ("nu", "1")): lambda E, nu: (E / (2 * (1 + nu)), E / (3 * (1 - 2 * nu))),
    (("mu", "Pa"), ("kappa", "Pa")): lambda mu, kappa: (mu, kappa),
}
"""Shear and bulk modulus [Pa] that two parameters of these names and units mean."""


class OneParticle:
    """The law of a material at one particle, in 64 bits.

    Args:
        material: whose law it is; its parameters have the values of its guess.
    Raises:
        UserInputError: the law cannot be compiled.
    """

    def __init__(self, material: Material):
        given = {name: torch.tensor(value, dtype=torch.float64) for name, value in material.guess.items()}
        coefficients = material.coefficients(given)
        self._values = [float(value) for value in coefficients.values()]
        start()
        self._launcher = _launcher(LocalLaws(material.law, (), Sticky.velocity, tuple(coefficients)))

    def __call__(self, F: Tensor, C: Tensor, dt: float = DT, stiffness: float = 1.0) -> tuple[Tensor, Tensor]:
        """New deformation gradient [(3, 3)] and Kirchhoff stress [Pa, (3, 3)], from the trial deformation gradient
        [(3, 3)], the velocity gradient [1/s, (3, 3)], the substep [s] and the factor on the moduli.
        """
        numbers = torch.tensor([dt, stiffness, *self._values], dtype=torch.float64)
        trial, gradient, out = F.reshape(9).contiguous(), C.reshape(9).contiguous(), torch.zeros(18).double()
        self._launcher.bind(trial=trial, C=gradient, numbers=numbers, out=out)
        self._launcher()
        return out[:9].reshape(3, 3), out[9:].reshape(3, 3)

    def resistance(self, strain: Tensor, before: float = 0.0, stiffness: float = 1.0) -> tuple[float, Tensor]:
        """Work of the stress that a small strain [(3, 3)] adds, over the square of the strain [Pa], and that stress
        [Pa, (3, 3)]; ``before`` is an isotropic strain that is already there.
        """
        at = (1.0 + before) * EYE
        (_, changed), (_, stress) = (self(F, 0 * EYE, stiffness=stiffness) for F in (at + strain, at))
        return float(((changed - stress) * strain).sum() / (strain * strain).sum()), changed - stress

    def viscosity(self, rate: Tensor) -> float:
        """The same of a velocity gradient without a strain [1/s, (3, 3)] [Pa s]."""
        stress = self(EYE, rate)[1] - self(EYE, 0 * EYE)[1]
        return float((stress * rate).sum() / (rate * rate).sum())


def meant_moduli(material: Material) -> tuple[float, float] | None:
    """Shear and bulk modulus [Pa] that the parameters of a material mean; None where their names and units say none."""
    for declared, moduli in MODULI.items():
        if all(name in material.parameters and material.parameters[name].unit == unit for name, unit in declared):
            return moduli(*(material.guess[name] for name, _ in declared))
    return None


@functools.cache
def _launcher(laws: LocalLaws) -> Launcher:
    """A float64 kernel that evaluates one law once; numbers are dt, stiffness, then the coefficients; out is new F,
    then tau.
    """
    Reals = ti.types.ndarray(dtype=ti.f64, ndim=1)

    @ti.kernel
    def once(trial: Reals, C: Reals, numbers: Reals, out: Reals):
        for _ in range(1):
            here = [0.0, 0.0, 0.0]
            coefficients = [numbers[2 + c] for c in ti.static(range(len(laws.names)))]
            rows = [[trial[3 * i + j] for j in ti.static(range(3))] for i in ti.static(range(3))]
            gradient = [[C[3 * i + j] for j in ti.static(range(3))] for i in ti.static(range(3))]
            e = Evaluation(
                laws, Point(rows, gradient, here, here, here, 0.0, numbers[0], 1.0, 1.0, numbers[1]), coefficients
            )
            for i, j in ti.static(ti.ndrange(3, 3)):
                out[3 * i + j] = e.F_new[i][j]
                out[9 + 3 * i + j] = e.tau[i][j]

    return Launcher(once, "f64")
