# mypy: disable-error-code="valid-type,index"
"""One particle through the constitutive law of a material, in 64 bits, compiled as in the engine."""

import functools
from collections.abc import Callable

import torch
from torch import Tensor

from pacnerf_lpo.mpm.ground import Sticky
from pacnerf_lpo.mpm.materials.base import Material
from pacnerf_lpo.mpm.point import Evaluation, LocalLaws, Point
from pacnerf_lpo.mpm.runtime import start
from pacnerf_lpo.mpm.simulator import local_laws
from pacnerf_lpo.mpm.taichi_calls import Launcher, ti


def one_particle(material: Material) -> Callable[..., tuple[Tensor, Tensor]]:
    """The law of a material with the values of its guess: (trial deformation gradient F [(3, 3)], velocity gradient C
    [1/s, (3, 3)], substep dt [s], stiffness: factor on the moduli) -> new deformation gradient [(3, 3)] and Kirchhoff
    stress [Pa, (3, 3)]. Raises UserInputError where it cannot be compiled.
    """
    start()
    launcher = _launcher(local_laws(material, Sticky(), ())[0])
    given = {name: torch.tensor(value, dtype=torch.float64) for name, value in material.guess.items()}
    coefficients = torch.tensor([float(v) for v in material.coefficients(given).values()], dtype=torch.float64)

    def law(F: Tensor, C: Tensor, dt: float = 1e-6, stiffness: float = 1.0) -> tuple[Tensor, Tensor]:
        numbers = torch.cat([F.reshape(9), C.reshape(9), coefficients.new_tensor([dt, stiffness]), coefficients])
        out = torch.zeros(18, dtype=torch.float64)
        launcher.bind(given=numbers, out=out)
        launcher()
        return out[:9].reshape(3, 3), out[9:].reshape(3, 3)

    return law


@functools.cache
def _launcher(laws: LocalLaws) -> Launcher:
    Reals = ti.types.ndarray(dtype=ti.f64, ndim=1)

    @ti.kernel
    def once(given: Reals, out: Reals):
        for _ in range(1):
            here = [0.0, 0.0, 0.0]
            F = [[given[3 * i + j] for j in ti.static(range(3))] for i in ti.static(range(3))]
            C = [[given[9 + 3 * i + j] for j in ti.static(range(3))] for i in ti.static(range(3))]
            coefficients = [given[20 + c] for c in ti.static(range(len(laws.names)))]
            e = Evaluation(laws, Point(F, C, here, here, here, 0.0, given[18], 1.0, 1.0, given[19]), coefficients)
            for i, j in ti.static(ti.ndrange(3, 3)):
                out[3 * i + j], out[9 + 3 * i + j] = e.F_new[i][j], e.tau[i][j]

    return Launcher(once, "f64")
