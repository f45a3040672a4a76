"""A slow ray march written independently of the fast one: every sample of every ray, no skipping."""

import torch
from torch.nn.functional import grid_sample

from pacnerf_lpo.scene.activation import DENSITY_SHIFT
from pacnerf_lpo.scene.colour import ColourNetwork
from pacnerf_lpo.types import FieldGrid, Rays


def read(values: torch.Tensor, grid: FieldGrid, point: torch.Tensor) -> torch.Tensor:
    """Trilinear interpolation by ``grid_sample``; values (X, Y, Z, C), one point (3,)."""
    extent = grid.dx * (torch.tensor(values.shape[:3]) - 1)
    unit = (2 * (point - grid.lower) / extent - 1).flip(0)
    return grid_sample(values.permute(3, 0, 1, 2)[None], unit.view(1, 1, 1, 1, 3), align_corners=True).flatten()


def render(grid: FieldGrid, colour: ColourNetwork, rays: Rays, base_dx: float) -> tuple[torch.Tensor, torch.Tensor]:
    """Colour (R, 3) on white and transmittance (R,)."""
    delta, step = 0.05 * grid.dx / base_dx, grid.dx / 2
    lower, upper = grid.lower, grid.lower + grid.dx * (torch.tensor(grid.density.shape) - 1)
    colours, transmittances = [], []
    for origin, direction in zip(rays.origins, rays.directions, strict=True):
        faces = torch.stack(((lower - origin) / direction, (upper - origin) / direction))
        enter, leave = max(0.1, float(faces.amin(0).max())), float(faces.amax(0).min())
        through, seen, distance = torch.ones((), dtype=origin.dtype), torch.zeros(3, dtype=origin.dtype), enter
        while distance <= leave:
            point = origin + distance * direction
            sigma = read(grid.density[..., None], grid, point)[0]
            alpha = 1 - (1 + (sigma + DENSITY_SHIFT).exp()) ** -delta
            shade = colour(read(grid.features, grid, point)[None], direction[None])[0]
            seen, through = seen + through * alpha * shade, through * (1 - alpha)
            distance += step
        colours.append(seen + through)
        transmittances.append(through)
    return torch.stack(colours), torch.stack(transmittances)
