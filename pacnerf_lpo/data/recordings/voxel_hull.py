"""The visual hull of a frame as points of a regular lattice (Laurentini 1994), and its outline in a camera."""

from collections.abc import Sequence

import numpy as np
import torch
from scipy import ndimage

from pacnerf_lpo.data.cameras import project
from pacnerf_lpo.data.recordings.written_scene import View

CELLS = 56
"""Lattice cells along the longest edge of the box around the body."""
RASTER = 1.5
"""Pixels of a hull's picture for each cell, so that neighbours touch after closing."""


def projected(points: np.ndarray, view: View) -> tuple[np.ndarray, np.ndarray]:
    """Pixel coordinates [(N, 2)] and depth [m, (N,)] of points [m, (N, 3)]; see :func:`project`."""
    pixels, depth = project(*(torch.from_numpy(part) for part in (points, view.intrinsic, view.pose)))
    return pixels.numpy(), depth.numpy()


def visual_hull(
    views: Sequence[View], mattes: Sequence[np.ndarray], lower: np.ndarray, upper: np.ndarray
) -> tuple[np.ndarray, float]:
    """Lattice points in a box with corners [m, (3,)] that lie on the object, by its mattes [(H, W), bool], in every
    view that sees them, and are seen by more than half of all [m, (N, 3)], and the edge of a cell [m].
    """
    cell = float((upper - lower).max()) / CELLS
    axes = [np.arange(low - cell / 2, high + cell, cell) for low, high in zip(lower, upper, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    seen = np.zeros(len(points), int)
    for view, matte in zip(views, mattes, strict=True):
        pixels, depth = projected(points, view)
        height, width = matte.shape
        inside = (depth > 0) & np.all((pixels >= 0) & (pixels < (width, height)), axis=1)
        column, row = np.where(inside[:, None], pixels, 0.0).astype(int).T
        inside &= view.valid[row, column]
        kept = ~inside | matte[row, column]
        seen, points = (seen + inside)[kept], points[kept]
    return points[seen > len(views) / 2], cell


def hull_picture(points: np.ndarray, cell: float, view: View) -> tuple[np.ndarray, np.ndarray, float]:
    """The hull as a camera sees it: a mask [(h, w), bool], padded by empty pixels, of size 0 where nothing of the hull
    is in front of the camera; its corner in the image [pixels, (2,)]; and how many of its pixels are one of the image.
    """
    pixels, depth = projected(points, view)
    pixels, depth = pixels[depth > 0], depth[depth > 0]
    if not len(pixels):
        return np.zeros((0, 0), bool), np.zeros(2), 1.0
    scale = RASTER * float(np.median(depth)) / (cell * float(view.intrinsic[0, 0]))
    pad = 4
    corner = pixels.min(axis=0) - pad / scale
    x, y = ((pixels - corner) * scale).astype(int).T
    mask = np.zeros((y.max() + pad + 1, x.max() + pad + 1), bool)
    mask[y, x] = True
    disc = ndimage.generate_binary_structure(2, 1)
    closed = ndimage.binary_closing(mask, disc, iterations=2)
    return ndimage.binary_dilation(closed, disc), corner, scale


def outside_share(matte: np.ndarray, points: np.ndarray, cell: float, view: View) -> float:
    """Part of a matte (H, W) that the hull does not cover, within a cell; NaN where the matte is empty."""
    y, x = np.nonzero(matte)
    mask, corner, scale = hull_picture(points, cell, view)
    if not len(x):
        return float("nan")
    if not mask.size:
        return 1.0
    mask = ndimage.binary_dilation(mask, iterations=1)
    place = np.floor((np.stack((x, y), axis=-1) + 0.5 - corner) * scale).astype(int)
    inside = np.all((place >= 0) & (place < mask.shape[::-1]), axis=1)
    column, row = np.where(inside[:, None], place, 0).T
    return float(1.0 - (inside & mask[row, column]).mean())
