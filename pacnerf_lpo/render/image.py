"""Whole images, rendered in chunks without gradients."""

import torch
from torch import Tensor

from pacnerf_lpo.render.ray_march import render_rays
from pacnerf_lpo.scene.colour import ColourNetwork
from pacnerf_lpo.types import FieldGrid, Rays

CHUNK = 16384


@torch.no_grad()
def render_view(
    grid: FieldGrid, colour: ColourNetwork, rays: Rays, size: tuple[int, int], base_dx: float
) -> tuple[Tensor, Tensor]:
    """Image [0..1, (H, W, 3)] on white and opacity, the soft silhouette [0..1, (H, W)], of a view of this size, (H, W).

    Args:
        rays: H*W rays, row-major [m].
        base_dx: coarsest spacing dx0 [m].
    """
    parts = zip(rays.origins.split(CHUNK), rays.directions.split(CHUNK), strict=True)
    chunks = [render_rays(grid, colour, Rays(*part), base_dx) for part in parts]
    colours = torch.cat([chunk.colour for chunk in chunks])
    transmittance = torch.cat([chunk.transmittance for chunk in chunks])
    return colours.view(*size, 3), 1 - transmittance.view(size)
