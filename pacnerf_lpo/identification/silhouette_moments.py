"""An outline in ten numbers, each in pixels: robust against appearance, and readable by a person."""

import numpy as np
import torch
from torch import Tensor

KINDS = ("x", "y", "size", "width", "height", "skew", "left", "right", "top", "bottom")
"""Centroid, square root of the area, standard deviations along x and y, their mixed moment, and where the outermost
twentieth of the area begins on each side; x to the right, y downwards."""
BRIGHTNESS = "brightness"
"""Logarithm of the object's mean brightness relative to what the reconstruction of frame 0 shows in that view, relative
to the median of all views; no outline depends on it."""
TAIL = 0.05
LEAST_AREA = 4.0
EDGE = 0.3
"""Error of the edge of a matte, from pixel to pixel [pixels]."""
LEAST_SHARE = 0.01
"""Variance of a combination of moments relative to what it would be without correlation: to more than a percent changes
of first order are not known, and outlines a few pixels wide have fewer edges than moments."""


def silhouette_moments(opacity: Tensor, margin: int = 0) -> np.ndarray:
    """Ten numbers for every outline, in pixels.

    Args:
        opacity: of the object [0..1, (..., H, W)]
        margin: how far the images go beyond those of the camera on each side [pixels]

    Returns:
        [(..., 10), float64], in the order of :data:`KINDS`; NaN where less than four pixels are covered or the
        outline touches the border of the image, so that a part of it may be missing.
    """
    height, width = opacity.shape[-2:]
    columns, rows = opacity.sum(-2).double(), opacity.sum(-1).double()
    area = rows.sum(-1)
    safe = area.clamp_min(1e-9)[..., None]
    across = torch.arange(width, dtype=torch.float64) + 0.5
    down = torch.arange(height, dtype=torch.float64) + 0.5
    x, y = (columns / safe) @ across, (rows / safe) @ down
    xx = ((columns / safe) @ across.square() - x.square()).clamp_min(0.0).sqrt()
    yy = ((rows / safe) @ down.square() - y.square()).clamp_min(0.0).sqrt()
    right_of, below = across - width / 2, down - height / 2  # about the middle, so that single precision is enough
    mixed = (opacity @ right_of.to(opacity)).double() @ below / safe[..., 0]
    xy = mixed - (x - width / 2) * (y - height / 2)
    left, right = _tail(columns), width - _tail(columns.flip(-1))
    top, bottom = _tail(rows), height - _tail(rows.flip(-1))
    skew = xy / (xx + yy).clamp_min(1e-9)
    numbers = torch.stack((x, y, area.sqrt(), xx, yy, skew, left, right, top, bottom), -1).numpy()
    numbers[..., [0, 1, 6, 7, 8, 9]] -= margin
    border = torch.stack((columns[..., 0], columns[..., -1], rows[..., 0], rows[..., -1])).amax(0)
    numbers[((area < LEAST_AREA) | (border > 1.0)).numpy()] = np.nan
    return numbers


def sensor_noise(opacity: Tensor) -> np.ndarray:
    """A root of the covariance of the moments of outlines [pixels, (..., 10, 10)], by their opacity [0..1, (..., H,
    W)], when the edge of a matte errs by :data:`EDGE` pixels, independently along the outline; NaN where
    :func:`silhouette_moments` is.

    An edge that errs by e along a length dl adds e dl of area there. So the covariance of two moments is EDGE^2 times
    the integral, along the outline, of the product of what a unit of area at the edge changes them by: (x - mean) / A
    for a centroid, 1 / m where the outermost twentieth of the area is, and the outline is m pixels wide where that
    begins: a wing's tip is less certain than the side of a ball. An edge on the left moves the centroid and the
    leftmost twentieth together.
    """
    images, moments = opacity.reshape(-1, *opacity.shape[-2:]).numpy(), silhouette_moments(opacity)
    found = [_by_area(image, own) for image, own in zip(images, moments.reshape(-1, len(KINDS)), strict=True)]
    return EDGE * np.stack(found).reshape(*moments.shape, len(KINDS))


def _by_area(image: np.ndarray, moments: np.ndarray) -> np.ndarray:
    """Root of the integral, along the outline of an image [0..1, (H, W)], of the products of the changes of its moments
    (10,) by a unit of area there (10, 10).
    """
    if not np.isfinite(moments).all():
        return np.full((len(KINDS),) * 2, np.nan)
    ends = [np.flatnonzero(image.any(axis=axis))[[0, -1]] for axis in (1, 0)]
    top, left = (max(first - 2, 0) for first, _ in ends)  # so far that nothing changes at the edges of what is cut out
    shown = image[top : ends[0][1] + 3, left : ends[1][1] + 3].astype(float)
    edge = np.hypot(*np.gradient(shown))
    rows, columns = np.nonzero(edge)
    x, y, size, across, down, skew, *tails = moments - [left, top, 0, 0, 0, 0, left, left, top, top]
    across, down = (max(spread, 12**-0.5) for spread in (across, down))  # a line is as wide as a pixel
    right_of, below, area = columns + 0.5 - x, rows + 0.5 - y, size**2
    wider, higher = ((d**2 - s**2) / (2 * s * area) for d, s in ((right_of, across), (below, down)))
    total = across + down
    tilted = (right_of * below / area - skew * total / area) / total - skew * (wider + higher) / total
    changes = [right_of / area, below / area, np.full(len(rows), 1 / (2 * size)), wider, higher, tilted]
    for number, end in enumerate(tails):
        axis, outwards, place = number // 2, 1 - 2 * (number % 2), (columns, rows)[number // 2]
        width = shown.sum(axis)[min(int(end), shown.shape[1 - axis] - 1)]
        beyond = np.clip(outwards * (end - place - 0.5) + 0.5, 0.0, 1.0)
        changes.append(outwards * (TAIL - beyond) / max(width, 1.0))
    found = np.array(changes) * np.sqrt(edge[rows, columns])
    sizes = np.sqrt(np.square(found).sum(1)).clip(1e-9)[:, None]
    shares, turn = np.linalg.eigh(found @ found.T / (sizes * sizes.T))
    return sizes * turn * np.sqrt(shares.clip(LEAST_SHARE))


def mean_brightness(image: Tensor, opacity: Tensor) -> Tensor:
    """Mean brightness of an object matted onto white [0..1, (..., H, W, 3)] with its opacity [(..., H, W)]: [(...)]."""
    own = image.mean(-1) - (1 - opacity)
    return own.sum((-1, -2)) / opacity.sum((-1, -2)).clamp_min(LEAST_AREA)


def _tail(marginal: Tensor) -> Tensor:
    """Where the cumulative sum of a marginal [(..., L)] passes :data:`TAIL` of its total, interpolated [pixels]."""
    share = marginal.cumsum(-1) / marginal.sum(-1, keepdim=True).clamp_min(1e-9)
    first = (share < TAIL).sum(-1, keepdim=True).clamp_max(marginal.shape[-1] - 1)
    after = share.gather(-1, first)
    before = torch.where(first > 0, share.gather(-1, (first - 1).clamp_min(0)), torch.zeros_like(after))
    return (first + (TAIL - before) / (after - before).clamp_min(1e-12)).squeeze(-1)
