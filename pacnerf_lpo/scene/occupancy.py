"""Cells of a field in which something may be visible."""

import torch
from torch import Tensor

from pacnerf_lpo.scene.activation import alpha
from pacnerf_lpo.types import FieldGrid


def occupied_cells(grid: FieldGrid, delta: float, min_alpha: float) -> Tensor:
    """True where alpha reaches ``min_alpha`` at one of the cell's corners [(X, Y, Z), bool], cells by lowest node.

    Alpha increases with density and trilinear interpolation never exceeds the corners, so nothing visible is lost.
    """
    occupied = alpha(grid.density.detach(), delta) >= min_alpha
    for axis in range(3):
        shifted = torch.zeros_like(occupied)
        count = occupied.shape[axis] - 1
        shifted.narrow(axis, 0, count).copy_(occupied.narrow(axis, 1, count))
        occupied = occupied | shifted
    return occupied
