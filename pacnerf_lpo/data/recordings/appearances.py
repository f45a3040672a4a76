"""What each image of a scene shows of the object: where it is, whether it is whole, how clear its matte is."""

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from pacnerf_lpo.data.matting import RIM
from pacnerf_lpo.data.recordings.sharpness import SIDES, edge_widths
from pacnerf_lpo.data.recordings.shots import LEAST_OBJECT
from pacnerf_lpo.data.recordings.tangents import DIRECTIONS, outline_points, outline_tangents
from pacnerf_lpo.data.recordings.written_scene import View, picture

REACH = 0.15
"""How far from an outline its edge is looked for, relative to the object: blur by more than that moves the outline."""
ROOM = 4
"""Pixels kept around the object, so that nothing at the outline is cut away."""


@dataclass(frozen=True)
class Appearance:
    """One image.

    tangents: how far the outline reaches (DIRECTIONS,), NaN where it is cut off, see :func:`outline_tangents`
    pixels: of the object
    size: its longer side [pixels]
    centre: of its pixels, x right, y down [pixels, (2,)]
    cut: it touches the border of what the camera shows
    hazy: part of it that is half transparent, the rim left out
    loose: part of it that does not belong to its largest piece
    widths: of its edge by side [pixels, (SIDES,)], see :func:`edge_widths`
    """

    tangents: np.ndarray
    pixels: int
    size: float
    centre: np.ndarray
    cut: bool
    hazy: float
    loose: float
    widths: np.ndarray

    @property
    def seen(self) -> bool:
        """Whether the object is in the image at all."""
        return self.pixels >= LEAST_OBJECT


NOTHING = Appearance(np.full(DIRECTIONS, np.nan), 0, 0.0, np.full(2, np.nan), False, 0.0, 0.0, np.full(SIDES, np.nan))


def appearance(pixels: np.ndarray, view: View) -> Appearance:
    """Look at one image, colour and opacity [0..1, (H, W, 4)]."""
    height, width = (int(np.flatnonzero(view.valid.any(axis=1 - axis))[-1]) + 1 for axis in (0, 1))
    solid = pixels[:height, :width, 3] > 0.5
    if np.count_nonzero(solid) < LEAST_OBJECT:
        return NOTHING
    rows, columns = (np.flatnonzero(solid.any(axis=1 - axis)) for axis in (0, 1))
    size = float(max(np.ptp(rows), np.ptp(columns)) + 1)
    room = ROOM + int(np.ceil(REACH * size))
    top, left = max(rows[0] - room, 0), max(columns[0] - room, 0)
    part = np.s_[top : min(rows[-1] + room + 1, height), left : min(columns[-1] + room + 1, width)]
    near, solid = pixels[part], solid[part]
    intrinsic = view.intrinsic - np.array([[0.0, 0.0, left], [0.0, 0.0, top], [0.0, 0.0, 0.0]])
    seen = picture(near, None if view.plate is None else view.plate[part])
    points, inside = outline_points(near[..., 3], intrinsic, view.valid[:height, :width][part])
    y, x = np.nonzero(solid)
    return Appearance(
        tangents=outline_tangents(points, inside),
        pixels=len(x),
        size=size,
        centre=np.array([x.mean() + left + 0.5, y.mean() + top + 0.5]),
        cut=not inside.all(),
        hazy=_hazy(near[..., 3], solid),
        loose=_loose(solid),
        widths=edge_widths(seen, near[..., 3], REACH * size),
    )


def _hazy(opacity: np.ndarray, solid: np.ndarray) -> float:
    """Part of the object that is neither clear nor solid, farther from the outline than a matte's own rim."""
    inside = ndimage.binary_erosion(solid, iterations=RIM)
    outside = ~ndimage.binary_dilation(solid, iterations=RIM)
    return float(((opacity < 0.9) & inside | (opacity > 0.1) & outside).sum() / solid.sum())


def _loose(solid: np.ndarray) -> float:
    labels, _ = ndimage.label(solid, structure=np.ones((3, 3)))
    areas = np.bincount(labels.ravel())[1:]
    return float(1.0 - areas.max() / areas.sum())
