"""One regular time axis for all cameras."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pacnerf_lpo.data.recordings.recording import Camera, Recording
from pacnerf_lpo.errors import Unmeasured, UserInputError

AS_TAKEN = 0.05
"""Frames this near to their time, relative to a step, are used as they are: a body moves some 0.3 pixels until then."""
FILLED = 2.5
"""Two frames so many steps apart have one missing frame between them, which can be filled in; more cannot."""
MANY = 0.25
"""Where more than this part of a camera's frames has to be filled in, it has another frame rate, and no offset."""
FEWEST = 4
"""Frames: three for the acceleration, one after contact."""


@dataclass(frozen=True)
class Timeline:
    """Common times, and what each camera shows at them.

    times: [s, (F,)], evenly spaced, from 0
    start: the first of them on the cameras' corrected clocks [s]
    places: number of the camera's own frame shown at each time, fractional where two are to be merged [(F,) each]
    offsets: how much later than these times each camera's frames were taken [s, (V,)]
    """

    times: np.ndarray
    start: float
    places: tuple[np.ndarray, ...]
    offsets: np.ndarray


def stated_times(recording: Recording) -> list[np.ndarray]:
    """When each camera's images were taken, as stamped or counted [s, (F,) each]. Raises UserInputError where times are
    missing or do not increase.
    """
    found = []
    for camera in recording.cameras:
        where = f"{recording.source}, camera {camera.name}"
        times = [frame.time for frame in camera.frames if frame.time is not None]
        if len(times) < len(camera.frames):
            raise Unmeasured(
                f"{where}: the layout {recording.layout} does not say when its images were taken; give the frames per "
                "second by --fps",
                "fps",
            )
        if len(times) < FEWEST:
            raise UserInputError(
                f"{where}: it has {len(times)} frame{'s' * (len(times) != 1)}, at least {FEWEST} are needed; give its "
                f"whole video, or use --leave_out {camera.name}"
            )
        if not np.all(np.diff(times) > 0):
            raise UserInputError(f"{where}: its {len(times)} times do not increase; give --fps")
        found.append(np.array(times))
    return found


def common_times(recording: Recording, stamps: Sequence[np.ndarray]) -> Timeline:
    """The times at which all cameras see, in steps of the slowest one, and what to show of each. Raises UserInputError
    where the cameras do not overlap, or several frames in a row are missing.

    A camera that is out of step by a constant keeps its images, and its offset is stated; missing frames, and all of a
    camera with another frame rate, are filled in between two images. ``stamps`` say when each camera's frames were
    taken, clocks corrected [s, (F,) each].
    """
    steps = [float(np.median(np.diff(times))) for times in stamps]
    step = max(steps)
    first, end = max(float(times[0]) for times in stamps), min(float(times[-1]) for times in stamps)
    slow = np.array([times[0] for times, own in zip(stamps, steps, strict=True) if own > (1.0 - AS_TAKEN) * step])
    phases = (slow - slow[:, None]) / step
    apart = np.minimum(np.abs(phases - np.round(phases)), 2.0 * AS_TAKEN).sum(axis=1)
    leader = float(slow[apart.argmin()])  # the camera of the common step with which most others are in step
    start = leader + step * np.ceil((first - leader) / step - 0.5 - AS_TAKEN)
    count = int(np.floor((end - start) / step + 0.5 + AS_TAKEN)) + 1
    if count < FEWEST:
        raise UserInputError(
            f"{recording.source}: all cameras together see {max(0.0, end - first):.3g} s, {max(count, 0)} frames; at "
            f"least {FEWEST} are needed, and videos that begin at the same moment"
        )
    grid = start + step * np.arange(count)
    shown = [_shown(recording, *pair, grid) for pair in zip(recording.cameras, stamps, strict=True)]
    return Timeline(grid - start, start, tuple(places for places, _ in shown), np.array([off for _, off in shown]))


def _shown(recording: Recording, camera: Camera, times: np.ndarray, grid: np.ndarray) -> tuple[np.ndarray, float]:
    """Which of a camera's frames are shown, and how much later than the grid they were taken [s]."""
    step = grid[1] - grid[0]
    nearest = np.abs(times[None] - grid[:, None]).argmin(axis=1)
    off = times[nearest] - grid
    offset = float(np.median(off))
    taken = np.abs(off - offset) <= AS_TAKEN * step
    if np.mean(~taken) > MANY:
        offset, taken = 0.0, np.abs(off) <= AS_TAKEN * step
    wanted = np.clip(grid + offset, times[0], times[-1])
    after = np.clip(np.searchsorted(times, wanted), 1, len(times) - 1)
    gap = np.where(taken, 0.0, times[after] - times[after - 1])
    worst = int(gap.argmax())
    if gap[worst] > FILLED * step:
        raise UserInputError(
            f"{recording.source}, camera {camera.name}: no frames between {times[after[worst] - 1]:.4g} and "
            f"{times[after[worst]]:.4g} s; they were dropped, or its mattes are wrong and look like another time; cut "
            f"all videos there, give its masks or background plate, or use --leave_out {camera.name}"
        )
    between = np.interp(wanted, times, np.arange(len(times)))
    return np.where(taken, nearest, between), offset if abs(offset) > 1e-3 * step else 0.0
