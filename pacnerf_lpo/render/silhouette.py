"""Soft silhouettes: opacity alone, at a fraction of the cost of an image."""

import torch
from torch import Tensor

from pacnerf_lpo.particles.transfer import particles_to_grid
from pacnerf_lpo.render.ray_march import ray_opacity
from pacnerf_lpo.types import Rays


def silhouettes(positions: Tensor, density: Tensor, spacing: float, base_spacing: float, views: list[Rays]) -> Tensor:
    """Opacity of a particle set along the rays of several views. Differentiable in positions and density.

    Args:
        positions: [m, (N, 3)]
        density: raw density [(N,)]
        spacing: node spacing of the grid the particles are written to [m]
        base_spacing: coarsest spacing dx0 [m]
        views: R rays for each of V views [m]

    Returns:
        1 - transmittance [0..1, (V, R)]
    """
    grid = particles_to_grid(positions, density, density.new_zeros(len(density), 0), spacing)
    return torch.stack([ray_opacity(grid, rays, base_spacing) for rays in views])
