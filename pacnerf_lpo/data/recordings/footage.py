"""The frames of a camera that stands still, at the resolution at which it is decided what is object and background."""

from collections.abc import Callable, Iterator
from itertools import pairwise

import numpy as np
from scipy import ndimage

from pacnerf_lpo.data.recordings.colours import FINEST, smoothed

KEYFRAMES = 16
"""Frames from which the background is found, spaced by how much moves between them: a rest is few, a fall is many."""
STILL = 4.0
"""Changes of a frame count as motion from so many times their median on: most of the image stands still."""
RESTING = 0.01
"""What a frame without motion counts, relative to that with the most."""
COARSE = 160
"""Pixels along an image at which objects are looked for: their outlines are found to one of them, and then refined."""


class Footage:
    """All frames reduced, and those of them at full size that decide about the background.

    coarse: reduced frames [bytes, (F, h, w, 3)]. chosen: numbers of those that decide.
    """

    def __init__(self, pictures: Callable[[], Iterator[np.ndarray]]):
        """pictures: all frames, undistorted, each time it is called [0..1, (H, W, 3)]."""
        self._pictures = pictures
        self.coarse = np.stack([_bytes(reduced(pixels)) for pixels in pictures()])
        self.chosen = _keyframes(self.coarse)

    def __iter__(self) -> Iterator[np.ndarray]:
        """The reduced frames, one after the other [0..1, (h, w, 3)]."""
        return (frame / np.float32(255.0) for frame in self.coarse)

    def decisive(self) -> np.ndarray:
        """The chosen frames, reduced [0..1, (K, h, w, 3)]."""
        return np.asarray(self.coarse[self.chosen] / np.float32(255.0))

    def full_size(self) -> np.ndarray:
        """The chosen frames at full size [bytes, (K, H, W, 3)]."""
        return np.stack([_bytes(pixels) for number, pixels in enumerate(self._pictures()) if number in self.chosen])


def _bytes(pixels: np.ndarray) -> np.ndarray:
    return np.round(255.0 * pixels).astype(np.uint8)


def _keyframes(frames: np.ndarray) -> list[int]:
    """Numbers of frames of which each shows about as much motion since the one before; all where there are few."""
    if len(frames) <= KEYFRAMES:
        return list(range(len(frames)))
    smooth = (smoothed(frame / np.float32(255.0)) for frame in frames)
    changes = (np.linalg.norm(now - before, axis=-1) for before, now in pairwise(smooth))
    moved = [0.0, *(float((one > max(STILL * float(np.median(one)), FINEST)).mean()) for one in changes)]
    course = np.cumsum(np.array(moved) + RESTING * max(moved))
    wanted = np.linspace(course[0], course[-1], KEYFRAMES)
    return sorted(set(np.abs(course[:, None] - wanted).argmin(axis=0).tolist()))


def factor_of(shape: tuple[int, ...]) -> int:
    """How many pixels along each axis of an image (H, W, ...) become one."""
    return -(-max(shape[:2]) // COARSE)


def reduced(image: np.ndarray) -> np.ndarray:
    """The image [(H, W, ...)] averaged over squares of pixels, so that its longer edge has at most COARSE of them."""
    factor = factor_of(image.shape)
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
