"""Which pixels are the object, where the odds of each are noisy: outlines are short."""

from __future__ import annotations

import numpy as np

STEPS = 30
"""Of the dual; then no sign changes any more, even where the odds of a pixel are half noise."""


def denoised(values: np.ndarray, weight: float) -> np.ndarray:
    """The u that minimises |u - values|^2 / 2 + weight * total variation of u [(H, W)].

    By accelerated gradient projection of the dual (Beck and Teboulle 2009). Where u is positive, the sum of ``values``
    inside less ``weight`` times the length of the outline is largest (Chan, Esedoglu, Nikolova 2006).

    Args:
        values: log odds (H, W). weight: log odds for each pixel of outline.
    """
    values = values.astype(np.float32)
    dual = before = np.zeros((2, *values.shape), np.float32)
    momentum = 1.0
    for _ in range(STEPS):
        moved = dual + _slopes(values + weight * _divergence(dual)) / np.float32(8.0 * weight)
        moved /= np.maximum(1.0, np.hypot(moved[0], moved[1]))
        following = 0.5 + np.sqrt(0.25 + momentum**2)
        dual = moved + np.float32((momentum - 1.0) / following) * (moved - before)
        before, momentum = moved, following
    return np.asarray(values + weight * _divergence(before))


def _slopes(values: np.ndarray) -> np.ndarray:
    """Differences to the next pixel along rows and columns, none beyond the border [(2, H, W)]."""
    found = np.zeros((2, *values.shape), np.float32)
    found[0, :-1], found[1, :, :-1] = np.diff(values, axis=0), np.diff(values, axis=1)
    return found


def _divergence(dual: np.ndarray) -> np.ndarray:
    """The negative adjoint of :func:`_slopes` [(H, W)]."""
    found = dual[0] + dual[1]
    found[1:] -= dual[0, :-1]
    found[:, 1:] -= dual[1, :, :-1]
    return np.asarray(found)
