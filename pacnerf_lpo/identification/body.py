"""The body of a run, resampled for a diagnosis: other spacing, other particles, the same occupied volume."""

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from pacnerf_lpo.particles.sampling import interpolate
from pacnerf_lpo.particles.transfer import particles_to_grid
from pacnerf_lpo.scene.activation import solid_fraction
from pacnerf_lpo.types import ParticleState

SUBSAMPLES = 3
LEAST_FRACTION = 0.02
CHUNK = 200_000


@dataclass(frozen=True)
class Body:
    """Particles at frame 0.

    positions: [m, (N, 3)]
    fraction: how much of a full particle (spacing/2)^3 is occupied [0..1, (N,)]
    spacing: node spacing of the grid they move on [m]
    """

    positions: Tensor
    fraction: Tensor
    spacing: float

    @property
    def volume(self) -> float:
        """Occupied volume [m^3]."""
        return float(self.fraction.sum()) * (self.spacing / 2) ** 3


class Sampling:
    """The density of a state in the cells of a lattice of spacing/2.

    Args:
        state: particles of a run.
        spacing: node spacing to move on [m].
        seed: shifts the lattice, so that two seeds give two samplings of the same body.
    """

    @torch.no_grad()
    def __init__(self, state: ParticleState, spacing: float, seed: int = 0):
        self.state, self.spacing = state, spacing
        grid = particles_to_grid(
            state.positions, state.density, state.features.new_zeros(len(state.density), 0), state.spacing
        )
        half = spacing / 2
        shift = torch.rand(3, generator=torch.Generator().manual_seed(seed)) * half
        low, high = state.positions.amin(0) - half, state.positions.amax(0) + half
        counts = ((high - low) / half).ceil().long() + 1
        corners = torch.cartesian_prod(*(torch.arange(int(count)) for count in counts)) * half + low - shift
        inner = (torch.arange(SUBSAMPLES) + 0.5) / SUBSAMPLES * half
        self._points = corners[:, None] + torch.cartesian_prod(inner, inner, inner)
        flat = self._points.reshape(-1, 3)
        self._density = torch.cat([interpolate(grid, part)[0] for part in flat.split(CHUNK)])

    @torch.no_grad()
    def body(self, surface_offset: float | Callable[[Tensor], Tensor] = 0.0) -> Body:
        """One particle in each cell that is occupied, at the centre of what is.

        Args:
            surface_offset: raw density above that of the visible surface at which the body begins; thins it. A number,
                or a function of places [m, (M, 3)], (M,).
        """
        thinning = surface_offset(self._points.reshape(-1, 3)) if callable(surface_offset) else surface_offset
        density = self._density - thinning
        solid = solid_fraction(density, self.state.spacing, self.state.base_spacing).reshape(len(self._points), -1)
        kept = solid.mean(1) > LEAST_FRACTION
        solid, points = solid[kept], self._points[kept]
        centre = (points * solid[..., None]).sum(1) / solid.sum(1, keepdim=True)
        return Body(centre, solid.mean(1), self.spacing)


def surface(body: Body) -> float:
    """Area of the surface [m^2], by the faces at which the occupancy of neighbouring cells differs: those across one
    axis show the projection along it, which is half of the area on average over all orientations.
    """
    half = body.spacing / 2
    cells = ((body.positions - body.positions.amin(0)) / half + 1e-6).long() + 1
    occupancy = torch.zeros(*(cells.amax(0) + 2).tolist(), dtype=body.fraction.dtype)
    occupancy.index_put_(tuple(cells.T), body.fraction, accumulate=True)
    occupancy = occupancy.clamp_max(1.0)
    faces = sum(float(occupancy.diff(dim=axis).abs().sum()) for axis in range(3))
    return faces / 1.5 * half**2
