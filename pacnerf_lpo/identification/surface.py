"""The surface of a reconstruction, moved to where the outlines of frame 0 see it.

A density that renders well ends somewhere within a voxel, on some sides more than on others. That does not show in an
image, and it makes a body too thick or too thin, hence too stiff or too soft.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from scipy import ndimage
from scipy.sparse import csr_array, eye_array, vstack
from scipy.sparse.linalg import lsqr
from torch import Tensor
from torch.nn.functional import interpolate as resized

from pacnerf_lpo.data.video_data import VideoData
from pacnerf_lpo.identification.silhouette_moments import EDGE
from pacnerf_lpo.particles.sampling import interpolate
from pacnerf_lpo.particles.transfer import particles_to_grid
from pacnerf_lpo.scene.trilinear import corners, stencil
from pacnerf_lpo.types import FieldGrid, ParticleState

FINER = 4
"""Nodes of a signed distance per voxel of the run, along each axis."""
BAND = 2.0
"""Lines of sight are compared that pass the edge of a matte nearer than this [pixels]. None counts for more, so that
what is missing in a reconstruction does not pull at what is there."""
PLATEAU = 0.75
"""Part of the largest density; trained fields end at a third of it, fog at two thirds."""
SUPERSAMPLING, ROUNDS, CHUNK = 4, 6, 4_000_000
SMOOTH = 0.75
"""Width in voxels by which a reconstruction is smoothed: the sharp ridges where the cones of few views meet are not
there, and no voxel resolves them."""
SLACK = 0.5
"""Prior standard deviation of the surface in voxels, from node to node: a reconstruction does not resolve more."""


@dataclass(frozen=True)
class Lines:
    """Of sight that pass near the edges of mattes.

    origins, directions: [m and unit vectors, (R, 3)]
    inside: how far within the outline they are, negative outside [pixels, (R,)]
    focal: length of their camera [pixels, (R,)]
    """

    origins: Tensor
    directions: Tensor
    inside: Tensor
    focal: Tensor

    @staticmethod
    def of(data: VideoData, views: Sequence[int]) -> "Lines":
        """Those of frame 0 in some views; pixels that an occluder hides are left out."""
        found: list[tuple[Tensor, ...]] = [(torch.zeros(0, 3), torch.zeros(0, 3), torch.zeros(0), torch.zeros(0))]
        for view in views:
            inside = _inside(data.video.silhouettes[view, 0].numpy())
            chosen = (inside.abs() < BAND) & data.video.valid[view].flatten()
            rays, focal = data.first_rays(view), data.video.intrinsics[view, 0, 0].float()
            origins = rays.origins.expand_as(rays.directions)
            found.append((origins[chosen], rays.directions[chosen], inside[chosen], focal.expand(int(chosen.sum()))))
        return Lines(*(torch.cat(parts) for parts in zip(*found, strict=True)))

    def among(self, chosen: Tensor) -> "Lines":
        """Some of them [(R,), bool]."""
        return Lines(self.origins[chosen], self.directions[chosen], self.inside[chosen], self.focal[chosen])

    def highest(self, grid: FieldGrid) -> tuple[Tensor, Tensor, Tensor]:
        """The largest value of a field along each line [(R,)], where [m, (R, 3)], and how far away [m, (R,)]."""
        size = grid.dx * (torch.tensor(grid.density.shape) - 1)
        middle = ((grid.lower + size / 2 - self.origins) * self.directions).sum(1)
        away = torch.arange(-float(size.norm()) / 2, float(size.norm()) / 2, grid.dx)
        found = []
        for part in torch.arange(len(middle)).split(max(1, CHUNK // len(away))):
            along = middle[part, None] + away
            points = self.origins[part, None] + along[..., None] * self.directions[part, None]
            inside = points.reshape(-1, 3).clamp(grid.lower, grid.lower + size)
            value, best = interpolate(grid, inside)[0].view(along.shape).max(1)
            each = torch.arange(len(part))
            found.append((value, points[each, best], along[each, best]))
        values, places, far = (torch.cat(parts) for parts in zip(*found, strict=True))
        return values, places, far


def density_of(state: ParticleState) -> FieldGrid:
    """Raw density of a state on a fine lattice with a margin of two voxels."""
    coarse = particles_to_grid(
        state.positions, state.density, state.features.new_zeros(len(state.density), 0), state.spacing
    )
    dx, lower = state.spacing / FINER, state.positions.amin(0) - 2 * state.spacing
    voxels = ((state.positions.amax(0) - lower) / state.spacing).ceil().long() + 3
    axes = [torch.arange(int(count - 1) * FINER + 1) * dx + low for count, low in zip(voxels, lower, strict=True)]
    fine = torch.cat([interpolate(coarse, part)[0] for part in torch.cartesian_prod(*axes).split(CHUNK)])
    return scalar_field(fine.view(*map(len, axes)), lower, dx)


def density_at_edges(density: FieldGrid, lines: Lines) -> float:
    """The raw density that lines of sight through the edges of mattes reach, the median of them all.

    At most :data:`PLATEAU` of the largest one: a density that is the same up to beyond the edges says nothing of them.
    """
    reached = lines.highest(density)[0][lines.inside.abs() < 0.5].median()
    return float(reached.clamp_max(PLATEAU * density.density.max()))


def signed_distance(density: FieldGrid, level: float) -> FieldGrid | None:
    """Distance to where a raw density falls below a level, positive where it is above, smoothed unless nothing is left
    of a thin body [m]; None if it never is.
    """
    inside = density.density.numpy() > level
    if not inside.any():
        return None
    distance = edge_distance(inside) * density.dx
    smooth = ndimage.gaussian_filter(distance, SMOOTH * FINER)
    return scalar_field(torch.from_numpy(smooth if (smooth > 0).any() else distance), density.lower, density.dx)


def seen_by(lines: Lines, surface: FieldGrid) -> FieldGrid:
    """A signed distance moved so that lines of sight pass the body as they pass the mattes.

    The largest signed distance along a line is how deep it passes through the body, or how far past it. That is linear
    in a change of the signed distance by trilinear functions between nodes a voxel apart, but for where the line is
    deepest: least squares with a prior, a few times over.
    """
    x, y, z = ((count - 1) // FINER + 1 for count in surface.density.shape)
    shape = x, y, z
    change, found, prior = np.zeros(shape).ravel(), surface, SLACK * surface.dx * FINER
    for _ in range(ROUNDS if len(lines.inside) else 0):
        deep, places, away = lines.highest(found)
        pixel = (away / lines.focal).double().numpy()
        wrong = (deep.double().numpy() / pixel - lines.inside.double().numpy()).clip(-BAND, BAND)
        around = stencil(places, surface.lower, surface.dx * FINER, shape)
        weights = around.weights.double().numpy() / pixel[:, None] / EDGE
        ends = np.arange(len(pixel) + 1) * weights.shape[1]
        seen = csr_array((weights.ravel(), corners(around).numpy().ravel(), ends), shape=(len(pixel), len(change)))
        rows = vstack([seen, eye_array(len(change)) / prior], format="csr")
        change = change + lsqr(rows, np.concatenate((-wrong / EDGE, -change / prior)))[0]
        smooth = resized(
            torch.from_numpy(change).view(1, 1, *shape), surface.density.shape, mode="trilinear", align_corners=True
        )
        found = scalar_field(surface.density + smooth[0, 0], surface.lower, surface.dx)
    return found


def edge_distance(inside: np.ndarray) -> np.ndarray:
    """Distance of every element of a mask [bool, (...)] from its edge, half way to the nearest one of the other kind,
    negative outside [elements, (...)].
    """
    away = ndimage.distance_transform_edt
    return np.where(inside, away(inside) - 0.5, 0.5 - away(~inside))


def scalar_field(values: Tensor, lower: Tensor, dx: float) -> FieldGrid:
    """Of values at nodes [(X, Y, Z)] with a spacing [m] from a lower corner [m, (3,)], without features."""
    return FieldGrid(values.float(), values.new_zeros(*values.shape, 0).float(), lower, dx)


def _inside(matte: np.ndarray) -> Tensor:
    """Distance of every pixel of a matte [0..1, (H, W)] from its edge, positive inside [pixels, (H * W,)]."""
    fine = ndimage.zoom(matte, SUPERSAMPLING, order=1, mode="nearest", grid_mode=True) > 0.5
    if fine.all() or not fine.any():
        return torch.full((matte.size,), torch.inf)
    blocks = edge_distance(fine).reshape(len(matte), SUPERSAMPLING, -1, SUPERSAMPLING) / SUPERSAMPLING
    return torch.from_numpy(blocks.mean((1, 3))).float().flatten()
