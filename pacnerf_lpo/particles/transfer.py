"""Particles to grid: the normalised trilinear average of raw density and features."""

import torch
from torch import Tensor

from pacnerf_lpo.scene.activation import EMPTY_DENSITY
from pacnerf_lpo.scene.trilinear import scatter, stencil
from pacnerf_lpo.types import FieldGrid

EMPTY_WEIGHT = 1e-10


def particles_to_grid(positions: Tensor, density: Tensor, features: Tensor, dx: float) -> FieldGrid:
    """f_i = sum_p w_ip f_p / sum_p w_ip on every node i; a node with sum_p w_ip <= 1e-10 is empty (PAC-NeRF, eq. 7).
    Differentiable in all but ``dx``. Raises FloatingPointError where a position is NaN or infinite.

    The grid's nodes are whole multiples of ``dx``; one layer of empty nodes surrounds the particles.

    Args:
        positions: [m, (N, 3)]
        density: raw density [(N,)]
        features: [(N, 12)]
        dx: node spacing [m]
    """
    if not torch.isfinite(positions).all():
        raise FloatingPointError("particle to grid transfer: field `positions` contains NaN or infinite values")
    first, last = ((end / dx).floor().long() for end in torch.aminmax(positions.detach(), dim=0))
    x, y, z = (last - first + 4).tolist()  # two nodes for a cell, and one layer on either side
    lower, shape = (first - 1).to(positions) * dx, (x, y, z)
    points = stencil(positions, lower, dx, shape)
    sums = scatter(torch.cat((density[:, None], features, torch.ones_like(density)[:, None]), dim=1), points)
    weight = sums[:, -1:]
    empty = weight.detach() <= EMPTY_WEIGHT
    mean = sums[:, :-1] / torch.where(empty, torch.ones_like(weight), weight)
    raw = torch.where(empty.squeeze(1), EMPTY_DENSITY, mean[:, 0]).view(shape)
    return FieldGrid(raw, torch.where(empty, 0.0, mean[:, 1:]).view(*shape, -1), lower, dx)
