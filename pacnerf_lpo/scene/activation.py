"""From raw density to opacity: alpha(delta) = 1 - (1 + exp(sigma + b))^(-delta) = 1 - exp(-delta softplus(sigma + b)).

Shifted softplus of direct voxel grid optimisation (Sun et al., CVPR 2022), as PAC-NeRF uses it (Li et al., ICLR 2023).
"""

import math

from torch import Tensor
from torch.nn.functional import pad, softplus

from pacnerf_lpo.types import FieldGrid

DENSITY_SHIFT = math.log(1 / (1 - 1e-4) - 1)
"""b: raw density 0 has alpha 1e-4 over unit length."""

EMPTY_DENSITY = -100.0
"""Raw density of a node that no particle touches."""


def optical_depth(density: Tensor, delta: float) -> Tensor:
    """delta * softplus(sigma + b) of raw densities, any shape; transmittance is exp(-optical depth)."""
    return delta * softplus(density + DENSITY_SHIFT)


def alpha(density: Tensor, delta: float) -> Tensor:
    """Opacity in 0..1 of raw densities, any shape, over the dimensionless length ``delta`` (1 for a particle)."""
    return -(-optical_depth(density, delta)).expm1()


def solid_fraction(density: Tensor, dx: float, base_dx: float) -> Tensor:
    """How much of a particle counts as full where the *visible* body ends, in 0..1, any shape; spacings [m].

    A particle's alpha (over unit length) saturates about a voxel outside the visible surface, because a rendered sample
    is much shorter than unit length. This fraction is one half where 2.5 voxels of the material stop half the light:
    delta * 5 * softplus(sigma + b) = ln 2 with the delta of :func:`sample_length`.
    """
    return (density - surface_density(dx, base_dx)).sigmoid()


def surface_density(dx: float, base_dx: float) -> float:
    """Raw density where the visible body ends, see :func:`solid_fraction`."""
    return math.log(2) / (5 * sample_length(dx, base_dx)) - DENSITY_SHIFT


def sample_length(dx: float, base_dx: float) -> float:
    """delta of one ray sample (step dx/2) in a grid of spacing ``dx`` [m] refined from ``base_dx`` [m]."""
    return 0.05 * dx / base_dx


def occupied_cells(grid: FieldGrid, delta: float, min_alpha: float) -> Tensor:
    """True where alpha reaches ``min_alpha`` at one of the cell's corners [(X, Y, Z), bool], cells by lowest node.

    Alpha increases with density and trilinear interpolation never exceeds the corners, so nothing visible is lost.
    """
    occupied = alpha(grid.density.detach(), delta) >= min_alpha
    corners = pad(occupied, (0, 1) * 3)
    for axis, cells in enumerate(occupied.shape):
        corners = corners.narrow(axis, 0, cells) | corners.narrow(axis, 1, cells)
    return corners
