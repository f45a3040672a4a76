"""Lines drawn over a camera's image as SVG: ground grid, box, axes, and the outlines of matte and hull."""

import math
from collections.abc import Iterator, Sequence
from itertools import product

import numpy as np
import torch

from pacnerf_lpo.data.cameras import box_interval
from pacnerf_lpo.data.images import contours
from pacnerf_lpo.data.recordings.voxel_hull import projected
from pacnerf_lpo.data.recordings.written_scene import View
from pacnerf_lpo.types import Rays

NEAR = 1e-3
"""Nearest depth that is drawn, relative to the length of the line or its distance."""
MOST_POINTS = 500
"""Points of an outline; more cannot be seen."""
LINES = 10
"""Lines of the ground grid in each direction, about."""
LEAST_PICTURE = 3
"""Pixels below which a mask has no outline."""
LAYERS = {
    "matte": "outline of the matte",
    "hull": "outline of the visual hull",
    "box": "box of scene.yaml (frame 0)",
    "grid": "ground",
    "axes": "axes on the ground",
}
"""What can be drawn, and its name in the legend."""
Segment = tuple[np.ndarray, np.ndarray]


def box_edges(lower: np.ndarray, upper: np.ndarray) -> list[Segment]:
    """The twelve edges of a box between two corners [m, (3,)]."""
    corners = [np.where(side, upper, lower) for side in product((False, True), repeat=3)]
    return [(corners[a], corners[b]) for a in range(8) for b in range(a + 1, 8) if (a ^ b).bit_count() == 1]


def ground_grid(lower: np.ndarray, upper: np.ndarray, height: float) -> tuple[list[Segment], float]:
    """Lines at whole multiples of a step that cover the shadow of a box between two corners [m, (3,)] on the ground at
    a height [m], and the step: 1, 2 or 5 in its digit.
    """
    raw = float(max(upper[0] - lower[0], upper[2] - lower[2])) / LINES
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(factor * power for factor in (1, 2, 5, 10) if factor * power >= raw * 0.999)
    low, high = np.floor(lower / step).astype(int), np.ceil(upper / step).astype(int)
    point = lambda x, z: np.array([x * step, height, z * step])  # noqa: E731
    along = [(point(x, low[2]), point(x, high[2])) for x in range(low[0], high[0] + 1)]
    return along + [(point(low[0], z), point(high[0], z)) for z in range(low[2], high[2] + 1)], step


def clipped(segment: Segment, view: View) -> np.ndarray | None:
    """The part of a line [m] that a camera sees, as two places in its image [pixels, (2, 2)]; None for nothing.

    What is behind the camera is cut off in space, what is outside the image in the image.
    """
    start, end = segment
    depths = [-float(view.pose[:, 2] @ (point - view.pose[:, 3])) for point in segment]
    near = NEAR * max(float(np.linalg.norm(end - start)), abs(depths[0]), abs(depths[1]))
    if max(depths) < near:
        return None
    if min(depths) < near:
        share = (near - depths[0]) / (depths[1] - depths[0])
        middle = start + share * (end - start)
        start, end = (middle, end) if depths[0] < near else (start, middle)
    a, b = projected(np.stack((start, end)), view)[0]
    height, width = view.valid.shape
    line = Rays(torch.from_numpy(a[None]), torch.from_numpy((b - a)[None]))
    enter, leave = box_interval(line, torch.zeros(2), torch.tensor((width, height)), 0.0)
    first, last = enter.item(), min(leave.item(), 1.0)
    return np.stack((a + first * (b - a), a + last * (b - a))) if first < last else None


def lines(segments: Sequence[Segment], view: View) -> str:
    """The visible parts of lines as the data of an SVG path."""
    seen = (clipped(segment, view) for segment in segments)
    visible = (ends for ends in seen if ends is not None)
    return "".join(f"M{a[0]:.1f} {a[1]:.1f}L{b[0]:.1f} {b[1]:.1f}" for a, b in visible)


def axes(origin: np.ndarray, length: float, view: View) -> Iterator[tuple[str, str, np.ndarray]]:
    """Name, path and place of the label [pixels, (2,)] of those of the axes x, y, z that are seen."""
    for name, direction in zip("xyz", np.eye(3), strict=True):
        segment = origin, origin + length * direction
        ends = clipped(segment, view)
        if ends is not None:
            yield name, lines([segment], view), ends[1]


def outline(mask: np.ndarray, corner: np.ndarray, scale: float) -> str:
    """The border of a mask (h, w) as the data of an SVG path, from its ``corner`` in the image [pixels, (2,)] and its
    ``scale``, pixels of the mask for one of the image.
    """
    if min(mask.shape) < LEAST_PICTURE:
        return ""
    shown = (line[:: 1 + len(line) // MOST_POINTS] / scale + corner for line in contours(mask.astype(float)))
    return "".join("M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in points) + "Z" for points in shown)
