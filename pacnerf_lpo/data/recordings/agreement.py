"""Do the views agree about one body? Poses, mattes or clocks that are wrong show here, and whose they are."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pacnerf_lpo.data.recordings.fall import Ballistic, fit_ballistic, harmonics
from pacnerf_lpo.data.recordings.recording import Recording
from pacnerf_lpo.data.recordings.tangents import Planes, ball, bounds
from pacnerf_lpo.errors import UserInputError

PREDICTED = 0.08
"""Outlines of a view lie this close to what the other views predict, relative to the size of the body (rms)."""
ENOUGH = 4
"""Views from which on one of them can be predicted by the others."""
EARLY = 3
"""Frames in which views are compared: the least that have an acceleration."""


def common_size(views: Sequence[Sequence[Planes]], times: np.ndarray, recording: Recording) -> float:
    """Longest edge of the box around the body at frame 0, in the unit of the poses, once the views agree.

    Args:
        views: tangent planes of every frame, by camera.
        times: of the frames [s, (F,)].
        recording: its cameras, for messages.

    Raises:
        UserInputError: the views contradict each other; names the camera where it is one.
    """
    lower, upper = bounds(Planes.of([view[0] for view in views]))
    size = float((upper - lower).max())
    everywhere = ball(Planes.of([view[0] for view in views]))[1]
    if len(views) >= ENOUGH:
        errors = [_prediction_error(views, number, times) for number in range(len(views))]
        worst = int(np.argmax(errors))
        rest = [view[0] for number, view in enumerate(views) if number != worst]
        lower, upper = bounds(Planes.of(rest))
        alone = float((upper - lower).max())
        if ball(Planes.of(rest))[1] > 0 and (not everywhere > 0 or errors[worst] > PREDICTED * alone):
            raise UserInputError(
                f"{recording.source}: camera {recording.cameras[worst].name} disagrees with the other views: its pose, "
                "its clock or its matte is wrong; calibrate it again, give its masks or background plate, or use "
                f"--leave_out {recording.cameras[worst].name}"
            )
    if not (everywhere > 0 and np.isfinite(size)):
        raise UserInputError(
            f"{recording.source}: the outlines of the first frame have no common point in space, so poses are wrong: "
            "rotations may be transposed, poses world to camera instead of camera to world, axes mirrored, cameras "
            "swapped, or the calibration that of other videos"
        )
    return size


def _prediction_error(views: Sequence[Sequence[Planes]], number: int, times: np.ndarray) -> float:
    others = [view for place, view in enumerate(views) if place != number]
    motion = fit_ballistic(
        [Planes.of(parts) for parts in zip(*(o[:EARLY] for o in others), strict=True)], times[:EARLY]
    )
    misses = [_miss(planes, motion, time) for planes, time in zip(views[number][:EARLY], times, strict=False)]
    return float(np.sqrt(np.mean(np.concatenate(misses) ** 2))) if sum(map(len, misses)) else 0.0


def _miss(planes: Planes, motion: Ballistic, time: float) -> np.ndarray:
    place = motion.at(np.array([time]))[0]
    return planes.offsets - planes.normals @ place - harmonics(planes.normals) @ motion.shape
