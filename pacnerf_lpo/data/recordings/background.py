"""The background of a camera that stands still, from its own video."""

import numpy as np
from scipy import ndimage

from pacnerf_lpo.data.recordings.media import read_frames
from pacnerf_lpo.data.recordings.recording import Camera
from pacnerf_lpo.errors import UserInputError

CHANGED = 0.06
"""Difference of colours from which on a pixel has changed [0..1]."""
RESTING = 1e-3
"""What a frame without motion counts, relative to all motion of the video."""
TOGETHER = 0.02
"""Standard deviation of the window in which pixels decide together, relative to the image's width."""


def still_background(camera: Camera) -> np.ndarray:
    """What lies behind an object that moves from one place to another [0..1, (H, W, 3)].

    A pixel shows the background in the first frame or in the last one, unless the two outlines overlap. Where these
    frames differ, the one counts that the pixel keeps for longer: a moving object changes a pixel all the time,
    and the background does not. Duration is measured by how much of the image moves, so that an object that lies
    still at the end for half of the video does not become background.

    Raises:
        UserInputError: nothing moves.
    """
    amount, first, last = _motion(camera)
    weight = amount / amount.sum() + RESTING
    unchanged, from_start, to_end = np.ones(first.shape[:2], bool), np.zeros(first.shape[:2]), np.zeros(first.shape[:2])
    for pixels, share in zip(read_frames(camera.frames), weight, strict=True):
        unchanged &= ~_differ(pixels, first)
        from_start += share * unchanged
        to_end = np.where(_differ(pixels, last), 0.0, to_end + share)
    score = np.where(_differ(first, last), to_end - from_start, 0.0)
    late = ndimage.gaussian_filter(score, TOGETHER * first.shape[1]) > 0.0
    return np.where(late[..., None], last, first)


def _motion(camera: Camera) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Part of the image that changes before every frame [(F,)], the first and the last frame [(H, W, 3)]."""
    amount: list[float] = []
    first = last = np.empty(0)
    for pixels in read_frames(camera.frames):
        now = pixels[..., :3]
        first = first if amount else now
        amount.append(float(_differ(now, last).mean()) if amount else 0.0)
        last = now
    if not any(amount):
        raise UserInputError(
            f"{camera.frames[0].file}: nothing moves in camera {camera.name}; give masks, or an image of the empty "
            f"background as backgrounds/{camera.name}.png"
        )
    return np.array(amount), first, last


def _differ(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    return np.abs(one[..., :3] - other).max(axis=-1) > CHANGED
