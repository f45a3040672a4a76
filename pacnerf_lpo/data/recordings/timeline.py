"""One regular time axis for all cameras."""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np

from pacnerf_lpo.data.checks import STEP_TOLERANCE
from pacnerf_lpo.data.recordings.recording import Camera, Frame, Recording
from pacnerf_lpo.errors import UserInputError

log = logging.getLogger(__name__)

LATE = 0.35
"""A frame this part of a step away from its time is another frame: one was dropped."""
FEWEST = 4
"""Frames: three for the acceleration, one after contact."""


def synchronous(recording: Recording) -> tuple[Recording, np.ndarray]:
    """The recording with as many frames in every camera, all taken at the same times, and these [s, (F,)], from 0.

    The step is that of the slowest camera, the span that in which all cameras see; of the others the nearest frame is
    taken, and a warning says by how much it is off.

    Raises:
        UserInputError: times are missing, the cameras do not overlap, or one of them has dropped a frame.
    """
    stamps = [_times(recording, camera) for camera in recording.cameras]
    step = max(float(np.median(np.diff(times))) for times in stamps)
    start, end = max(float(times[0]) for times in stamps), min(float(times[-1]) for times in stamps)
    count = int(np.floor((end - start) / step + LATE)) + 1
    if count < FEWEST:
        raise UserInputError(
            f"{recording.source}: all cameras together see {max(0.0, end - start):.3g} s, {max(count, 0)} frames; at "
            f"least {FEWEST} are needed, and videos that begin at the same moment"
        )
    grid = start + step * np.arange(count)
    cameras = tuple(_resampled(recording, *pair, grid) for pair in zip(recording.cameras, stamps, strict=True))
    return replace(recording, cameras=cameras), grid - start


def _times(recording: Recording, camera: Camera) -> np.ndarray:
    times = [frame.time for frame in camera.frames if frame.time is not None]
    if len(times) < len(camera.frames):
        raise UserInputError(
            f"{recording.source}, camera {camera.name}: the layout {recording.layout} does not say when its images "
            "were taken; give the frames per second by --fps"
        )
    if len(times) < 2 or not np.all(np.diff(times) > 0):
        raise UserInputError(
            f"{recording.source}, camera {camera.name}: its {len(times)} times do not increase; give --fps"
        )
    return np.array(times)


def _resampled(recording: Recording, camera: Camera, times: np.ndarray, grid: np.ndarray) -> Camera:
    step = grid[1] - grid[0]
    nearest = np.abs(times[None] - grid[:, None]).argmin(axis=1)
    off = np.abs(times[nearest] - grid)
    worst = int(off.argmax())
    if off[worst] > LATE * step:
        raise UserInputError(
            f"{recording.source}, camera {camera.name}: no frame near {grid[worst]:.4g} s, the nearest is "
            f"{1e3 * off[worst]:.3g} ms away; it was dropped, cut the videos there or give --fps"
        )
    if off[worst] > STEP_TOLERANCE * step:
        log.warning(
            "camera %s: frames are up to %.2g of a frame away from those of the others; physics.effects can have a "
            "TimeOffset for it",
            camera.name,
            off[worst] / step,
        )
    frames: list[Frame] = [camera.frames[place] for place in nearest]
    return replace(camera, frames=tuple(frames))
