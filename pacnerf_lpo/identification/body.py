"""The body of a run, resampled for a diagnosis: other spacing, other particles, the same surface."""

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from pacnerf_lpo.identification.discs import Discs
from pacnerf_lpo.particles.sampling import interpolate
from pacnerf_lpo.types import FieldGrid

SUBSAMPLES = 3
LEAST_FRACTION = 0.02
CHUNK = 200_000


@dataclass(frozen=True)
class Body:
    """Particles at frame 0.

    positions: [m, (N, 3)]
    fraction: how much of a full particle (spacing/2)^3 is occupied [0..1, (N,)]
    spacing: node spacing of the grid they move on [m]
    discs: what it is drawn as.
    """

    positions: Tensor
    fraction: Tensor
    spacing: float
    discs: Discs

    @staticmethod
    def full(positions: Tensor, spacing: float) -> "Body":
        """Full particles [m, (N, 3)] of a body whose surface is not known."""
        return Body(positions, torch.ones_like(positions[:, 0]), spacing, Discs.unknown(positions, spacing / 2))

    @property
    def volume(self) -> float:
        """Occupied volume [m^3]."""
        return float(self.fraction.sum()) * (self.spacing / 2) ** 3


class Sampling:
    """The cells of a lattice of spacing/2 near the surface of a body and inside.

    Args:
        surface: distance to it, positive inside [m].
        spacing: node spacing to move on [m].
        seed: shifts the lattice, so that two seeds give two samplings of the same body.
    """

    @torch.no_grad()
    def __init__(self, surface: FieldGrid, spacing: float, seed: int = 0):
        self.surface, self.spacing, half = surface, spacing, spacing / 2
        shift = torch.rand(3, generator=torch.Generator().manual_seed(seed)) * half
        counts = (surface.dx * torch.tensor(surface.density.shape) / half).ceil().long() + 1
        cells = torch.cartesian_prod(*(torch.arange(int(count)) for count in counts)) * half + surface.lower - shift
        near = torch.cat([interpolate(surface, part + half / 2)[0] for part in cells.split(CHUNK)]) > -spacing
        inner = (torch.arange(SUBSAMPLES) + 0.5) / SUBSAMPLES * half
        self._points = cells[near][:, None] + torch.cartesian_prod(inner, inner, inner)
        flat = self._points.reshape(-1, 3)
        self._distance = torch.cat([interpolate(surface, part)[0] for part in flat.split(CHUNK)])

    @torch.no_grad()
    def body(self, depth: Callable[[Tensor], Tensor | float] = lambda _: 0.0) -> Body:
        """One particle in each cell that is occupied, at the centre of what is, after the surface has moved inwards by
        a ``depth`` [m] at some places [m, (M, 3)], (M,).
        """
        distance = self._distance - depth(self._points.reshape(-1, 3))
        solid = (distance / (self.spacing / 2 / SUBSAMPLES) + 0.5).clamp(0, 1).reshape(len(self._points), -1)
        kept = solid.mean(1) > LEAST_FRACTION
        solid, points = solid[kept], self._points[kept]
        centre = (points * solid[..., None]).sum(1) / solid.sum(1, keepdim=True)
        discs = Discs.within(lambda p: interpolate(self.surface, p)[0] - depth(p), centre, self.spacing / 2)
        return Body(centre, solid.mean(1), self.spacing, discs)
