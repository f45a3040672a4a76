"""How wide the edge of an object is in an image, by the side of the object: motion blurs those it moves across.

The profile of a side, from 0 outside to 1 inside, is the mean over its outline, in which texture cancels; its width is
one over its steepest slope. A motion by b pixels during the exposure widens the two edges across it, the leading and
the trailing one, and leaves those along it as they are: b^2 = w_across^2 - w_along^2. A soft shadow, shading or a wrong
focus widens only one side, or all of them.
"""

import contourpy
import numpy as np
from scipy import ndimage

SIDES = 8
"""Directions of the outline's normal that are distinguished."""
LEAST_CONTRAST = 0.1
"""Differences of colour [0..1] below which noise decides where an edge is steepest."""
FEWEST = 5
"""Places on a side that its profile needs at least."""
STEP = 0.5
"""Distance of the samples across an edge [pixels]."""
ENDS = 0.25
"""Part of the samples at each end of a profile that say what is inside and outside."""
SMOOTHING = 1.5
"""Standard deviation of the filter after which an outline of pixels has normals [pixels]."""


def edge_widths(picture: np.ndarray, opacity: np.ndarray, reach: float) -> np.ndarray:
    """Width of the edge on each side [pixels, (SIDES,)], NaN where it cannot be measured, in a picture with background
    [0..1, (h, w, 3)], by the opacity of the object [0..1, (h, w)]; ``reach`` is how far from the outline is looked
    [pixels].

    Side k has an outward normal at the angle 2 pi k / SIDES from x (right) towards y (down).
    """
    smooth = ndimage.gaussian_filter(np.pad(opacity, 1), SMOOTHING)
    lines = contourpy.contour_generator(z=smooth, line_type="Separate").lines(0.5)
    if not lines:
        return np.full(SIDES, np.nan)
    points = np.concatenate([np.asarray(line) for line in lines]) - 1.0
    slope = np.stack([_at(part, points + 1.0) for part in np.gradient(smooth)[::-1]], axis=-1)
    normals = -slope / np.maximum(np.linalg.norm(slope, axis=1, keepdims=True), 1e-9)
    offsets = np.arange(-reach, reach + STEP / 2, STEP)
    places = points[:, None] + offsets[None, :, None] * normals[:, None]
    colours = np.stack([_at(picture[..., band], places) for band in range(3)], axis=-1)
    end = max(1, int(ENDS * len(offsets)))
    inside, outside = colours[:, :end].mean(axis=1), colours[:, -end:].mean(axis=1)
    step = inside - outside
    contrast = np.linalg.norm(step, axis=-1)
    profiles = np.einsum("ptc,pc->pt", colours - outside[:, None], step / np.maximum(contrast, 1e-6)[:, None] ** 2)
    height, width = opacity.shape
    whole = np.all((places > 0) & (places < (width - 1, height - 1)), axis=(1, 2)) & (contrast > LEAST_CONTRAST)
    angle = np.arctan2(normals[:, 1], normals[:, 0])
    side = np.round(angle / (2.0 * np.pi / SIDES)).astype(int) % SIDES
    sides = [profiles[whole & (side == number)] for number in range(SIDES)]
    widths = [STEP / np.abs(np.diff(own.mean(axis=0))).max() if len(own) >= FEWEST else np.nan for own in sides]
    return np.array(widths, float)


def blur(widths: np.ndarray, motion: np.ndarray) -> float:
    """Length [pixels] of the blur along a motion in the image, x right, y down [pixels, (2,)], from the widths of
    :func:`edge_widths` [pixels, (SIDES,)]; NaN where it is not seen.
    """
    turn = np.arctan2(motion[1], motion[0]) / (2.0 * np.pi / SIDES)
    ahead = round(float(turn)) % SIDES
    across = min(widths[ahead], widths[(ahead + SIDES // 2) % SIDES])
    along = np.mean([widths[(ahead + quarter) % SIDES] for quarter in (SIDES // 4, -SIDES // 4)])
    return float(np.sqrt(max(across**2 - along**2, 0.0))) if np.isfinite(across + along) else float("nan")


def _at(values: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Values (h, w) at places (..., 2), x and y counted from the centre of the first pixel."""
    found = ndimage.map_coordinates(values, places.reshape(-1, 2)[:, ::-1].T, order=1, mode="nearest")
    return found.reshape(places.shape[:-1])
