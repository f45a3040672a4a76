"""Small set-ups shared by the tests of the engine: one per constitutive law, with a contact within the first frames."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from tests.mpm.twin import LAWS, State, Twin

DX = 0.1
DT = 1 / 2400
SUBSTEPS = 12
FRAMES = 5


@dataclass(frozen=True)
class Case:
    """A law, parameters in SI units that make it yield, flow or ring within a millisecond, and its Material's
    arguments.
    """

    law: str
    parameters: dict[str, float]

    def tensors(self, requires_grad: bool = False) -> dict[str, Tensor]:
        """Parameters as float64 scalars."""
        return {
            k: torch.tensor(v, dtype=torch.float64, requires_grad=requires_grad) for k, v in self.parameters.items()
        }


CASES = [
    Case("NeoHookean", {"E": 2e5, "nu": 0.3}),
    Case("Newtonian", {"mu": 500.0, "kappa": 1e5}),
    Case("VonMises", {"E": 2e5, "nu": 0.25, "tau_y": 2e3}),
    Case("ViscoplasticVonMises", {"mu": 6e4, "kappa": 1.5e5, "tau_y": 1e3, "eta": 40.0}),
    Case("DruckerPrager", {"theta": 30.0, "E": 2e5, "nu": 0.3}),
]
STIFF = {
    "stiff sand": Case("DruckerPrager", {"theta": 40.0, "E": 1e6, "nu": 0.3}),
    "stiff plasticine": Case("VonMises", {"E": 1e6, "nu": 0.3, "tau_y": 1e3}),
}
"""Cases that yield at strains of 1e-3, where most particles of a gentle contact stay elastic and their stretches
nearly equal.
"""
BY_NAME = {**{case.law: case for case in CASES}, **STIFF}


@dataclass
class Particles:
    """positions [m, (N,3)], velocity [m/s, (N,3)], mass [kg, (N,)], stiffness [(N,)], all float64."""

    positions: Tensor
    velocity: Tensor
    mass: Tensor
    stiffness: Tensor

    def leaves(self) -> dict[str, Tensor]:
        """The four tensors as fresh leaves that require gradients."""
        return {k: v.detach().clone().requires_grad_() for k, v in self.__dict__.items()}


def block(
    cells: tuple[int, int, int] = (2, 3, 2),
    bottom: float = 0.04,
    dx: float = DX,
    seed: int = 0,
    jitter: float = 0.3,
    density: float = 1000.0,
    speed: float = 1.0,
) -> Particles:
    """A jittered block with 8 particles per cell, thrown down at 2 m/s with an uneven velocity field that shears and
    squeezes it.

    ``speed`` multiplies all velocities.
    """
    generator = torch.Generator().manual_seed(seed)

    def noise(*shape: int) -> Tensor:
        return 2 * torch.rand(*shape, generator=generator, dtype=torch.float64) - 1

    axes = [torch.arange(2 * c, dtype=torch.float64) + 0.5 for c in cells]
    lattice = torch.cartesian_prod(*axes)
    positions = (lattice + jitter * noise(len(lattice), 3)) * dx / 2
    positions = positions - torch.tensor([cells[0] * dx / 2, -bottom, cells[2] * dx / 2], dtype=torch.float64)
    n = len(positions)
    centred = positions - positions.mean(0)
    gradient = torch.tensor([[-3.0, 2.0, 1.0], [0.0, -4.0, 2.0], [1.0, -1.0, 2.0]], dtype=torch.float64)
    velocity = torch.tensor([0.6, -2.0, -0.3], dtype=torch.float64) + centred @ gradient.T + 0.2 * noise(n, 3)
    mass = density * (dx / 2) ** 3 * (1 + 0.3 * noise(n))
    return Particles(positions, speed * velocity, mass, 1 + 0.4 * noise(n))


def twin_of(
    case: Case,
    ground: str = "sticky",
    gravity: tuple[float, float, float] = (0.0, -9.8, 0.0),
    dx: float = DX,
    dt: float = DT,
    spin: tuple[float, float, float] | None = None,
) -> Twin:
    """The reference simulator of a case."""
    return Twin(LAWS[case.law], dx=dx, dt=dt, ground=ground, gravity=gravity, spin=spin)  # type: ignore[arg-type]


def run_twin(
    twin: Twin,
    leaves: dict[str, Tensor],
    parameters: dict[str, Tensor],
    frames: int = FRAMES,
    substeps: int = SUBSTEPS,
    **coefficients: Tensor,
) -> tuple[Tensor, State]:
    """Roll the twin out from the leaves of :class:`Particles`, with coefficients of effects and ground by name."""
    state = twin.start(leaves["positions"], leaves["velocity"])
    return twin.rollout(state, leaves["mass"], leaves["stiffness"], parameters, frames, substeps, **coefficients)


def probe(trajectory: Tensor, seed: int = 7) -> Tensor:
    """A scalar that depends on every coordinate of every frame: a fixed random linear form plus a curved term."""
    weights = torch.randn(trajectory.shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)
    moved = trajectory.double() - trajectory[:1].double()
    return (weights * moved).sum() + 5 * (moved**2).sum()
