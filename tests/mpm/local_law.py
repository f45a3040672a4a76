"""One particle through a constitutive law, by the twin and by the engine, behind one signature."""

from typing import Protocol

import torch
from torch import Tensor

from pacnerf_lpo.mpm import materials
from pacnerf_lpo.mpm.one_particle import one_particle
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


def by_engine(
    law: str, parameters: dict[str, float], F: Tensor, C: Tensor, dt: float = 1e-4, stiffness: float = 1.0
) -> tuple[Tensor, Tensor]:
    """The engine's law, compiled into a kernel of its own as it is into the substep's."""
    material = getattr(materials, law)()
    material.guess = parameters  # which may lie on their bounds
    return one_particle(material)((EYE + dt * C) @ F, C, dt, stiffness)


EVALUATORS: dict[str, Evaluator] = {"twin": by_twin, "engine": by_engine}
