"""How probable the colours of an image are, if a pixel shows the background, shaded or not, or if it shows the object.

Densities are per unit volume of the colour cube [0..1]^3, so that 1 is that of a colour about which nothing is known.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from pacnerf_lpo.data.matting import SHADE_RANGE, SMOOTHING

BINS = 16
"""Cells of a colour histogram along each axis: a matt surface that turns in light goes through several of them."""
BLURRED = 1.0
"""Standard deviation of a histogram's filter [cells]: a few hundred pixels do not fill 4096 cells."""
ANY = 0.1
"""Part of an object that may have any colour: it turns sides towards the camera that were not seen before."""
FINEST = 0.016
"""Least noise of a smoothed image [0..1]: compression and eight bits leave that much."""
NOISIEST = 2.0
"""Noise of a pixel relative to the median of all; more is motion."""
TINGE = 0.1
"""By how much a shadow changes colours beside scaling them, relative to what it takes away: light that is thrown back
by the surroundings has another hue than that of the lamp."""
RARE = 1.5
"""Log odds against a pixel of the background being in a shadow of the object: near it, one in five is."""


def smoothed(image: np.ndarray, width: float = SMOOTHING) -> np.ndarray:
    """Image [(H, W, ...)] after a Gaussian filter along rows and columns [pixels]."""
    return ndimage.gaussian_filter(image, (width, width) + (0,) * (image.ndim - 2))


def noise_of(frames: np.ndarray) -> np.ndarray:
    """Standard deviation of the noise of each pixel and channel, from frame to frame [0..1, (H, W)], of smoothed frames
    [0..1, (F, H, W, 3)].

    The median of the changes is that of a pixel which shows one thing for more than half of the time.
    """
    change = np.median(np.linalg.norm(np.diff(frames, axis=0), axis=-1), axis=0)
    usual = float(np.median(change))
    window = max(3, frames.shape[2] // 16)
    even = ndimage.median_filter(np.minimum(change, NOISIEST * usual), window)
    # the median length of a Gaussian vector of three components is 1.54; a change is of two frames
    return np.maximum(smoothed(even, window / 3) / (1.54 * np.sqrt(2.0)), FINEST)


def log_of_background(
    image: np.ndarray, plate: np.ndarray, noise: np.ndarray, brightest: float = SHADE_RANGE[1]
) -> np.ndarray:
    """Log density of colours where the background is seen, lit as on the plate or in a shadow of the object [(H, W)].

    Every shade from black to the brightest, relative to the plate, is as probable as any other: next to what touches
    it, a ground is black. Image and plate are smoothed [0..1, (H, W, 3)], noise is the standard deviation of both
    together (H, W); ``brightest`` is more where the plate may show a shadow.
    """
    variance, square = noise**2, _dot(plate, plate)
    length = np.sqrt(square) + FINEST
    shade = np.clip(_dot(image, plate) / length**2, 0.0, brightest)
    tinged = variance + (TINGE * (1.0 - shade)) ** 2 * (square / 3.0)
    off, beside = image - plate, image - plate * shade[..., None]
    lit = _dot(off, off) / (2.0 * variance) + 1.5 * np.log(2.0 * np.pi * variance)
    shaded = _dot(beside, beside) / (2.0 * tinged) + np.log(2.0 * np.pi * tinged)
    return np.asarray(np.logaddexp(-lit, -shaded - np.log(brightest * length) - RARE))


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Product of the colours of each pixel [(..., 3)]; twice as fast as a sum along so short an axis."""
    return np.einsum("...c,...c->...", a, b)


@dataclass(frozen=True)
class Colours:
    """Density of the colours of an object [(BINS, BINS, BINS)]."""

    density: np.ndarray

    @staticmethod
    def unknown() -> "Colours":
        """Any colour is as probable as any other."""
        return Colours(np.ones((BINS,) * 3))

    @staticmethod
    def of(pixels: np.ndarray) -> "Colours":
        """The colours of an object's pixels [0..1, (N, 3)]; unknown where there are none."""
        if not len(pixels):
            return Colours.unknown()
        counts = np.histogramdd(pixels, bins=BINS, range=[(0.0, 1.0)] * 3)[0]
        share = ndimage.gaussian_filter(counts / len(pixels), BLURRED)
        return Colours((1.0 - ANY) * BINS**3 * share + ANY)

    def shared_with(self, others: "Sequence[Colours]") -> "Colours":
        """Those colours that one of the other views holds for the object's, too: what only one view does may be a
        piece of its background, and a side of the object that nobody else sees is found as nothing of the background.
        """
        return Colours(np.minimum(self.density, np.max([other.density for other in others], axis=0)))

    def log_of(self, image: np.ndarray) -> np.ndarray:
        """Log density of the colours of an image [0..1, (..., 3)]."""
        cells = np.clip((image * BINS).astype(int), 0, BINS - 1)
        return np.log(self.density)[tuple(np.moveaxis(cells, -1, 0))]
