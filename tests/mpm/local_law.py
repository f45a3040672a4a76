"""One particle through a constitutive law, by the twin and by the engine, behind one signature."""

from __future__ import annotations

from typing import Protocol

import torch
from torch import Tensor

from tests.mpm.twin import LAWS


class Evaluator(Protocol):
    """(law, parameters [SI], F (3,3), C [1/s, (3,3)], dt [s], stiffness) -> (new F (3,3), tau [Pa, (3,3)])."""

    def __call__(self, law: str, parameters: dict[str, float], F: Tensor, C: Tensor, dt: float = 1e-4,
                 stiffness: float = 1.0) -> tuple[Tensor, Tensor]: ...  # fmt: skip


def by_twin(law: str, parameters: dict[str, float], F: Tensor, C: Tensor, dt: float = 1e-4,
            stiffness: float = 1.0) -> tuple[Tensor, Tensor]:  # fmt: skip
    """The twin's law."""
    values = {name: torch.tensor(value, dtype=torch.float64) for name, value in parameters.items()}
    new, tau = LAWS[law](F[None], C[None], dt, values, torch.full((1, 1, 1), stiffness, dtype=torch.float64))
    return new[0], tau[0]


EVALUATORS: dict[str, Evaluator] = {"twin": by_twin}
