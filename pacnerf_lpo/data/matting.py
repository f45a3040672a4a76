"""Matting of a raw image by its difference from the background plate of the same camera."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from pacnerf_lpo.data.images import fill_small_holes


def difference_matte(image: np.ndarray, background: np.ndarray) -> np.ndarray:
    """Opacity of the object [0..1, (H, W)] from an image and its background plate [0..1, (H, W, 3)]."""
    ratio = (image * background).sum(-1, keepdims=True) / np.maximum((background**2).sum(-1, keepdims=True), 1e-6)
    residual = np.linalg.norm(image - background * np.clip(ratio, 0.3, 1.0), axis=-1)
    solid = ndimage.gaussian_filter(residual, 0.7) > 0.08
    labels, count = ndimage.label(solid)
    if count:
        solid = labels == 1 + np.argmax(np.bincount(labels.ravel())[1:])
    return fill_small_holes(solid, int(0.005 * solid.sum())).astype(np.float32)


def unmix_onto_white(image: np.ndarray, background: np.ndarray, alpha: np.ndarray) -> np.ndarray:
    """The object's own colour composed onto white (H, W, 3): C = I - (1 - alpha) B + (1 - alpha)."""
    behind = 1.0 - alpha[..., None]
    return np.clip(image - behind * background + behind, 0.0, 1.0)
