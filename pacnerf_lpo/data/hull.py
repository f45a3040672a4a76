"""The box around what all mattes allow: the visual hull of frame 0 (Laurentini 1994), found on a regular lattice."""

from collections.abc import Sequence

import torch
from torch import Tensor

from pacnerf_lpo.data.cameras import project
from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.types import Box, Video

CELLS = 64
"""Lattice cells along the box's longest edge."""
MARGIN = 2
"""Cells left free around the hull."""


def hull_box(video: Video, box: Box, views: Sequence[int]) -> Box:
    """The part of ``box`` around the visual hull of the given views (indices) at frame 0, with a small margin. Raises
    UserInputError where the mattes have no common point in the box.
    """
    points, cell = _hull(video, box, views)
    low = torch.maximum(points.amin(0) - MARGIN * cell, torch.tensor(box.lower)).tolist()
    high = torch.minimum(points.amax(0) + MARGIN * cell, torch.tensor(box.upper)).tolist()
    return Box((low[0], low[1], low[2]), (high[0], high[1], high[2]))


def hull_volume(video: Video, box: Box, views: Sequence[int]) -> float:
    """Volume of the hull of the given views (indices) in ``box`` at frame 0 [m^3]; raises as :func:`hull_box`."""
    points, cell = _hull(video, box, views)
    return len(points) * cell**3


def _hull(video: Video, box: Box, views: Sequence[int]) -> tuple[Tensor, float]:
    """Points of a regular lattice that lie on the object in every view that sees them, and are seen by more than half
    of the views [m, (N, 3)], and its spacing [m].
    """
    lower, upper = torch.tensor(box.lower), torch.tensor(box.upper)
    cell = float((upper - lower).max()) / CELLS
    axes = [torch.arange(float(a) + cell / 2, float(b), cell) for a, b in zip(lower, upper, strict=True)]
    points = torch.cartesian_prod(*axes)
    seen = torch.zeros(len(points))
    for view in views:
        inside, covered = on_object(points, video, view)
        seen += inside
        points, seen = points[covered | ~inside], seen[covered | ~inside]
    points = points[seen > len(views) / 2]
    if len(points) == 0:
        raise UserInputError(
            f"{video.source}: the silhouettes of the training views at frame 0 have no common point in the box "
            f"{list(box.lower)} to {list(box.upper)} m; check the camera poses and data.box_lower, data.box_upper"
        )
    return points, cell


def on_object(points: Tensor, video: Video, view: int) -> tuple[Tensor, Tensor]:
    """Whether each point [m, (N, 3)] lies inside the image of a view at frame 0, and on the object there [(N,), bool]
    each; computed in the precision of the points.
    """
    pixels, depth = project(points, video.intrinsics[view].to(points), video.camera_to_world[view].to(points))
    matte = video.silhouettes[view, 0] > 0.5
    height, width = matte.shape
    column, row = pixels.floor().long().unbind(-1)
    inside = (depth > 0) & (column >= 0) & (column < width) & (row >= 0) & (row < height)
    return inside, inside & matte[row.clamp(0, height - 1), column.clamp(0, width - 1)]
