"""Field to particles: eight jittered positions in every occupied cell, and the field's values there."""

import torch
from torch import Tensor

from pacnerf_lpo.scene.activation import alpha, occupied_cells
from pacnerf_lpo.scene.trilinear import CORNERS, gather, stencil
from pacnerf_lpo.types import FieldGrid

RELATIVE_ALPHA = 1e-3


def sample_particles(grid: FieldGrid, generator: torch.Generator, relative_alpha: float = RELATIVE_ALPHA) -> Tensor:
    """One uniformly random position in each octant of each cell, kept where alpha is high enough: [m, (N, 3)].

    ``generator`` lives on the CPU, so that a seed gives the same particles on every device. ``relative_alpha`` is the
    least alpha that is kept, as a fraction of the largest (1e-3 in PAC-NeRF).
    """
    return particle_alpha(grid, generator, relative_alpha)[0]


def particle_alpha(
    grid: FieldGrid, generator: torch.Generator, relative_alpha: float = RELATIVE_ALPHA
) -> tuple[Tensor, Tensor]:
    """Freshly sampled particles [m, (N, 3)] and their alpha (N,), the latter differentiable in the density."""
    threshold = relative_alpha * float(alpha(grid.density.detach().max(), 1.0))
    with torch.no_grad():
        cells = occupied_cells(grid, 1.0, threshold)[:-1, :-1, :-1].nonzero()
        octants = torch.tensor(CORNERS, device=cells.device)
        jitter = torch.rand(len(cells), 8, 3, generator=generator, dtype=grid.density.dtype).to(cells.device)
        candidates = ((cells[:, None] + (octants + jitter) / 2) * grid.dx + grid.lower).flatten(0, 1)
    points = stencil(candidates, grid.lower, grid.dx, grid.shape)
    opacity = alpha(gather(grid.density.reshape(-1, 1), points).squeeze(1), 1.0)
    kept = (opacity.detach() >= threshold).nonzero().squeeze(1)
    return candidates.index_select(0, kept), opacity.index_select(0, kept)


def interpolate(grid: FieldGrid, positions: Tensor) -> tuple[Tensor, Tensor]:
    """Raw density (N,) and features (N, 12) of the field at positions [m, (N, 3)]. Differentiable."""
    points = stencil(positions, grid.lower, grid.dx, grid.shape)
    return gather(grid.density.reshape(-1, 1), points).squeeze(1), gather(grid.features.flatten(0, 2), points)
