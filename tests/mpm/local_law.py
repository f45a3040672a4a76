"""One particle through a constitutive law, by the twin and by the engine, behind one signature."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Protocol

import torch
from torch import Tensor

from pacnerf_lpo.mpm import materials
from pacnerf_lpo.mpm.point import Point
from tests.mpm.twin import EYE, LAWS


class Evaluator(Protocol):
    """(law, parameters [SI], F (3,3), C [1/s, (3,3)], dt [s], stiffness) -> (new F (3,3), tau [Pa, (3,3)])."""

    def __call__(self, law: str, parameters: dict[str, float], F: Tensor, C: Tensor, dt: float = 1e-4,
                 stiffness: float = 1.0) -> tuple[Tensor, Tensor]: ...  # fmt: skip


def _scalars(parameters: dict[str, float]) -> dict[str, Tensor]:
    return {name: torch.tensor(value, dtype=torch.float64) for name, value in parameters.items()}


def by_twin(law: str, parameters: dict[str, float], F: Tensor, C: Tensor, dt: float = 1e-4,
            stiffness: float = 1.0) -> tuple[Tensor, Tensor]:  # fmt: skip
    """The twin's law."""
    new, tau = LAWS[law](F[None], C[None], dt, _scalars(parameters), torch.full((1, 1, 1), stiffness, dtype=torch.float64))
    return new[0], tau[0]


def by_engine(law: str, parameters: dict[str, float], F: Tensor, C: Tensor, dt: float = 1e-4,
              stiffness: float = 1.0) -> tuple[Tensor, Tensor]:  # fmt: skip
    """The engine's law, called with plain numbers: the very function that its kernels are compiled from."""
    material = getattr(materials, law)
    coefficients = {k: float(v) for k, v in material.coefficients(_scalars(parameters)).items()}
    here, still = [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]
    point = Point(((EYE + dt * C) @ F).tolist(), C.tolist(), here, here, still, 0.0, dt, 1.0, 1.0, stiffness)
    new, tau = material.law(point, SimpleNamespace(**coefficients))
    return torch.tensor(new, dtype=torch.float64), torch.tensor(tau, dtype=torch.float64)


EVALUATORS: dict[str, Evaluator] = {"twin": by_twin, "engine": by_engine}
