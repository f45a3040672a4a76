"""Images at the resolution at which it is decided what is object and what is background."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

COARSE = 160
"""Pixels along an image at which objects are looked for: their outlines are found to one of them, and then refined."""


def factor_of(shape: tuple[int, ...]) -> int:
    """How many pixels along each axis of an image (H, W, ...) become one."""
    return -(-max(shape[:2]) // COARSE)


def reduced(image: np.ndarray) -> np.ndarray:
    """The image [(H, W, ...)] averaged over squares of pixels, so that its longer edge has at most COARSE of them."""
    factor = factor_of(image.shape)
    if factor == 1:
        return image
    room = [(0, -size % factor) for size in image.shape[:2]]
    padded = np.pad(image, room + [(0, 0)] * (image.ndim - 2), mode="edge")
    rows, columns = (size // factor for size in padded.shape[:2])
    return np.asarray(padded.reshape(rows, factor, columns, factor, *image.shape[2:]).mean(axis=(1, 3)))


def enlarged(image: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """A reduced image [(h, w)] at the pixels of the one that it is of [(H, W)], by linear interpolation."""
    factor = factor_of(shape)
    if factor == 1:
        return image
    fine = ndimage.zoom(image.astype(np.float32), factor, order=1, mode="nearest", grid_mode=True)
    return np.asarray(fine[: shape[0], : shape[1]])
