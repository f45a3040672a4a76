"""Field to particles: eight jittered positions in every occupied cell, and the field's values there."""

from __future__ import annotations

import torch
from torch import Tensor

from pacnerf_lpo.render.ray_march import occupied_cells
from pacnerf_lpo.scene.activation import alpha
from pacnerf_lpo.scene.trilinear import CORNERS, gather, stencil
from pacnerf_lpo.types import FieldGrid

RELATIVE_ALPHA = 1e-3


def sample_particles(grid: FieldGrid, generator: torch.Generator) -> Tensor:
    """One uniformly random position in each octant of each cell, kept where alpha >= 1e-3 of the largest: [m, (N, 3)].

    ``generator`` lives on the CPU, so that a seed gives the same particles on every device.
    """
    candidates = jittered_positions(grid, generator)
    opacity = alpha(_interpolate(grid.density[..., None], grid, candidates).squeeze(1), 1.0)
    return candidates[opacity.detach() >= particle_threshold(grid)]


def jittered_positions(grid: FieldGrid, generator: torch.Generator) -> Tensor:
    """Eight positions [m, (8 * cells, 3)] in each cell that can hold a particle."""
    with torch.no_grad():
        cells = occupied_cells(grid, 1.0, particle_threshold(grid))[:-1, :-1, :-1].nonzero()
        octants = torch.tensor(CORNERS, device=cells.device)
        jitter = torch.rand(len(cells), 8, 3, generator=generator, dtype=grid.density.dtype).to(cells.device)
        return ((cells[:, None] + (octants + jitter) / 2) * grid.dx + grid.lower).flatten(0, 1)


def particle_threshold(grid: FieldGrid) -> float:
    """Alpha below which a position is no particle."""
    return RELATIVE_ALPHA * float(alpha(grid.density.detach().max(), 1.0))


def interpolate(grid: FieldGrid, positions: Tensor) -> tuple[Tensor, Tensor]:
    """Raw density (N,) and features (N, 12) of the field at positions [m, (N, 3)]. Differentiable."""
    density = _interpolate(grid.density[..., None], grid, positions).squeeze(1)
    return density, _interpolate(grid.features, grid, positions)


def _interpolate(values: Tensor, grid: FieldGrid, positions: Tensor) -> Tensor:
    shape = (values.shape[0], values.shape[1], values.shape[2])
    return gather(values.flatten(0, 2), stencil(positions, grid.lower, grid.dx, shape))
