# mypy: disable-error-code="valid-type,index"
"""One particle through a constitutive law, by the twin and by the engine, behind one signature."""

import functools
from typing import Protocol

import torch
from torch import Tensor

from pacnerf_lpo.mpm import materials
from pacnerf_lpo.mpm.ground import Sticky
from pacnerf_lpo.mpm.point import Evaluation, LocalLaws, Point
from pacnerf_lpo.mpm.runtime import start
from pacnerf_lpo.mpm.taichi_calls import Launcher, ti
from tests.mpm.scenes import BY_NAME
from tests.mpm.twin import EYE, LAWS


class Evaluator(Protocol):
    """(law, parameters [SI], F (3,3), C [1/s, (3,3)], dt [s], stiffness) -> (new F (3,3), tau [Pa, (3,3)])."""

    def __call__(
        self, law: str, parameters: dict[str, float], F: Tensor, C: Tensor, dt: float = 1e-4, stiffness: float = 1.0
    ) -> tuple[Tensor, Tensor]: ...


def _scalars(parameters: dict[str, float]) -> dict[str, Tensor]:
    return {name: torch.tensor(value, dtype=torch.float64) for name, value in parameters.items()}


def by_twin(
    law: str, parameters: dict[str, float], F: Tensor, C: Tensor, dt: float = 1e-4, stiffness: float = 1.0
) -> tuple[Tensor, Tensor]:
    """The twin's law."""
    new, tau = LAWS[law](
        F[None], C[None], dt, _scalars(parameters), torch.full((1, 1, 1), stiffness, dtype=torch.float64)
    )
    return new[0], tau[0]


@functools.cache
def _launcher(law: str) -> Launcher:
    """A float64 kernel that evaluates one law once; numbers are dt, stiffness, then the coefficients; out is new F,
    then tau.
    """
    material = getattr(materials, law)
    names = tuple(material.coefficients(_scalars(BY_NAME[law].parameters)))
    laws = LocalLaws(material.law, (), Sticky.velocity, names)
    Reals = ti.types.ndarray(dtype=ti.f64, ndim=1)
    start()

    @ti.kernel
    def once(trial: Reals, C: Reals, numbers: Reals, out: Reals):
        for _ in range(1):
            here = [0.0, 0.0, 0.0]
            coefficients = [numbers[2 + c] for c in ti.static(range(len(names)))]
            rows = [[trial[3 * i + j] for j in ti.static(range(3))] for i in ti.static(range(3))]
            gradient = [[C[3 * i + j] for j in ti.static(range(3))] for i in ti.static(range(3))]
            e = Evaluation(
                laws, Point(rows, gradient, here, here, here, 0.0, numbers[0], 1.0, 1.0, numbers[1]), coefficients
            )
            for i, j in ti.static(ti.ndrange(3, 3)):
                out[3 * i + j] = e.F_new[i][j]
                out[9 + 3 * i + j] = e.tau[i][j]

    return Launcher(once, "f64")


def by_engine(
    law: str, parameters: dict[str, float], F: Tensor, C: Tensor, dt: float = 1e-4, stiffness: float = 1.0
) -> tuple[Tensor, Tensor]:
    """The engine's law, compiled into a kernel of its own as it is into the substep's."""
    coefficients = [float(v) for v in getattr(materials, law).coefficients(_scalars(parameters)).values()]
    numbers = torch.tensor([dt, stiffness, *coefficients], dtype=torch.float64)
    trial, C, out = ((EYE + dt * C) @ F).reshape(9), C.reshape(9).contiguous(), torch.zeros(18, dtype=torch.float64)
    launcher = _launcher(law)
    launcher.bind(trial=trial, C=C, numbers=numbers, out=out)
    launcher()
    return out[:9].reshape(3, 3), out[9:].reshape(3, 3)


EVALUATORS: dict[str, Evaluator] = {"twin": by_twin, "engine": by_engine}
