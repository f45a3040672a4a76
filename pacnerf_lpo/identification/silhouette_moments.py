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


def sensor_noise(moments: np.ndarray) -> np.ndarray:
    """Standard deviation of moments [pixels, (..., 10)] when the edge of a matte errs by :data:`EDGE` pixels,
    independently along the outline, of about 1.5 times the length of a circle's.

    The numbers are those of a disc of radius R with an error e along its edge, such as the integral of x e over A for
    its centroid, where x is R / sqrt(2) on average along the edge and R / 2 over the area.
    """
    size, across, down = moments[..., 2], moments[..., 3], moments[..., 4]
    edge = EDGE * np.sqrt(1.5)  # for each pixel along a circle's outline
    total = edge * np.sqrt(2 * np.sqrt(np.pi) * size)  # of the area, in square pixels
    found = np.empty_like(moments)
    for first, length in enumerate((across, down)):
        found[..., first] = np.sqrt(2) * total * length / size**2
        found[..., 3 + first] = np.sqrt(3 / 4) * total * length / size**2
    found[..., 2] = total / (2 * size)
    found[..., 5] = np.sqrt(1 / 2) * total * np.maximum(across, down) / size**2
    # Where the tail ends moves by the error of its area, from 1.27 R of the edge, over the chord there, 1.19 R.
    found[..., 6:] = 1.27 * edge / np.sqrt(size)[..., None]  # sqrt(1.27 R) / (1.19 R), R = size / sqrt(pi)
    return found


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
