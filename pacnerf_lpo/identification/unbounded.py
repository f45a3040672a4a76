"""Where a reconstruction may be wrong because no outline passes there: the roof that the cones of few cameras leave on
a flat face, the underside that cameras above a body do not see.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import torch
from scipy import ndimage
from scipy.spatial.distance import cdist
from torch import Tensor
from torch.nn.functional import interpolate as resized

from pacnerf_lpo.identification.shape_modes import spread
from pacnerf_lpo.identification.silhouette_moments import EDGE
from pacnerf_lpo.identification.surface import FINER, SLACK, Lines, scalar_field
from pacnerf_lpo.particles.sampling import interpolate
from pacnerf_lpo.types import FieldGrid

REACH = 2.0
"""Over how many voxels errors of a surface are alike: finer shapes than that are not in a trilinear field."""
DEPTH = 1.0
"""How far inside its reconstruction a body may lie where no outline is near [voxels], the scale of a half-normal
distribution: two or three voxels from the nearest outline, between cones that meet it at up to 30 degrees. At most half
of its half thickness."""
WITHIN = 3.0
"""Voxels from a place in which its half thickness is looked for: there a body is thick that reaches deeper than twice
:data:`DEPTH`, smoothed as it is."""
MEAN, DEVIATION = math.sqrt(2 / math.pi), math.sqrt(1 - 2 / math.pi)
"""Of a half-normal distribution of scale 1."""
PLACES = 400
"""On the surface, where its error is estimated."""
MOST = 16
"""Errors that are tried, beside one of the whole. Further ones are as small as those that outlines at frame 0 let
expect everywhere, or smaller in extent than what a motion shows."""
LONGEST = 12.0
"""A line that lies on the surface for so many times :data:`REACH` says nothing any more."""
ROUGH = 1e-6
"""Of the variance, for a covariance that can be inverted."""


@dataclass(frozen=True)
class Unbounded:
    """What the outlines of frame 0 leave open of a surface.

    surface: signed distance to where it is most likely, positive inside [m]
    errors: how far it may be further inside, one standard deviation each: as a whole, then locally, the largest ones;
        on a lattice of voxels [m]
    volume: that the first of them takes away, relative to that of the body.
    """

    surface: FieldGrid
    errors: tuple[FieldGrid, ...]
    volume: float

    @staticmethod
    def of(surface: FieldGrid, lines: Lines) -> Unbounded:
        """From the signed distance to the surface of a reconstruction, positive inside [m], that is as large as the
        lines of sight past the edges of mattes allow.

        A body is not larger than what its outlines allow, but may be smaller. So before any is seen, its surface lies
        inside by a Gaussian process with a mean that is not known, either: half-normal of scale :data:`DEPTH`. From
        place to place it varies by :data:`~.surface.SLACK` voxels, over :data:`REACH`. A line of sight past the edge
        of a matte measures it where the line touches the body, to the error of that edge. What is left is a Gaussian
        process again (Rasmussen and Williams 2006, equations 2.23, 2.24 and 2.38), of which the errors are the
        principal components.
        """
        lines = lines.among(lines.inside.abs() < 1)
        if not len(lines.inside):
            return Unbounded(surface, (), 0.0)
        voxel = surface.dx * FINER
        share, *local = _left_open(surface, lines)
        near = 2 * int(WITHIN * FINER) + 1
        half = torch.from_numpy(ndimage.maximum_filter(surface.density.numpy(), near))
        depth = (half / 2).clamp(0, DEPTH * voxel)
        whole = depth * resized(share[None, None], depth.shape, mode="trilinear", align_corners=True)[0, 0]
        moved = surface.density - MEAN * whole
        taken = 1 - _volume(moved - DEVIATION * whole, surface.dx) / _volume(moved, surface.dx)
        errors = (DEVIATION * whole[::FINER, ::FINER, ::FINER], *local)
        found = tuple(scalar_field(error, surface.lower, voxel) for error in errors)
        return Unbounded(replace(surface, density=moved), found, taken)

    def beyond(self, least: float) -> list[FieldGrid]:
        """The errors that are somewhere larger than that [m]."""
        return [error for error in self.errors if float(error.density.abs().max()) > least]


def _left_open(surface: FieldGrid, lines: Lines) -> Tensor:
    """At every voxel [(1 + L, X, Y, Z)]: the share of a common displacement that lines of sight do not contradict, 0 to
    1, then the L principal components of what is left of displacements from place to place [m].
    """
    voxel = surface.dx * FINER
    touched, error = _touching(surface, lines, SLACK * voxel, REACH * voxel)
    near = surface.lower + surface.dx * torch.nonzero(surface.density.abs() < surface.dx)
    places = spread(near, min(PLACES, len(near)))[0].double().numpy()

    def covariance(first: np.ndarray, second: np.ndarray) -> np.ndarray:
        return (SLACK * voxel) ** 2 * np.exp(-0.5 * cdist(first, second, "sqeuclidean") / (REACH * voxel) ** 2)

    before = covariance(places, places) + ROUGH * (SLACK * voxel) ** 2 * np.eye(len(places))
    seen = np.linalg.solve(before, covariance(places, touched)) / error
    left = np.linalg.inv(np.linalg.inv(before) + seen @ seen.T)
    share = 1 - left @ seen @ seen.sum(0)
    variances, components = np.linalg.eigh(left)
    local = (np.sqrt(variances.clip(0)) * components)[:, : -MOST - 1 : -1]

    ends = zip(surface.lower.tolist(), surface.density.shape, strict=True)
    axes = [low + surface.dx * np.arange(0, count, FINER) for low, count in ends]
    lattice = np.stack(np.meshgrid(*axes, indexing="ij"), -1)
    weights = np.linalg.solve(before, np.column_stack((share, local)))
    fields = covariance(lattice.reshape(-1, 3), places) @ weights
    return torch.from_numpy(fields).T.reshape(-1, *lattice.shape[:3]).to(surface.density)


def _touching(surface: FieldGrid, lines: Lines, slack: float, reach: float) -> tuple[np.ndarray, np.ndarray]:
    """Where lines touch a surface [m, (R, 3)], and the error with which each measures it there [m, (R,)].

    A line that lies on the surface for n times ``reach``, to the error of its edge, measures a place with probability
    1/n: with (n - 1) times the variance before in addition, the variance after is what it is on average.
    """
    _, touched, away = lines.highest(surface)
    edge = EDGE * away / lines.focal
    steps = torch.arange(-int(LONGEST / 2 * reach / surface.dx), int(LONGEST / 2 * reach / surface.dx) + 1) * surface.dx
    points = touched[:, None] + steps[:, None] * lines.directions[:, None]
    last = surface.lower + surface.dx * (torch.tensor(surface.density.shape) - 1)
    depths = value_at(surface, points.reshape(-1, 3).clamp(surface.lower, last)).view(len(touched), -1)
    stretch = (depths > depths.amax(1, keepdim=True) - edge[:, None]).sum(1) * surface.dx
    error = (edge.square() + slack**2 * (stretch / reach - 1).clamp_min(0)).sqrt()
    return touched.double().numpy(), error.double().numpy()


def value_at(field: FieldGrid, points: Tensor) -> Tensor:
    """Of a field at some places [m, (N, 3)], (N,)."""
    return interpolate(field, points)[0]


def _volume(distance: Tensor, dx: float) -> float:
    """Where a signed distance is positive [voxels]."""
    return float((distance / dx + 0.5).clamp(0, 1).sum())
