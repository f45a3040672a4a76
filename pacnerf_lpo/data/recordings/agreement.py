"""Do the views agree about one body? Poses, mattes or clocks that are wrong show here, and whose they are.

A body touches each of its tangent planes. So, in each frame, whatever all views together allow must reach up to every
plane of every view; where it stays away from planes, or nothing is left, some view is wrong.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.spatial import HalfspaceIntersection, QhullError

from pacnerf_lpo.data.recordings.clocks import ENOUGH, Sighting, nearest_point
from pacnerf_lpo.data.recordings.recording import Recording
from pacnerf_lpo.data.recordings.tangents import Planes, ball, bounds
from pacnerf_lpo.errors import UserInputError

GAP = 0.03
"""How far planes may be from what all views allow, relative to the size of the body (rms of a view in a frame).

Right recordings of 96 to 256 pixels have 0.001 to 0.007, those with a matte that keeps half a ghost 0.035 to 0.08.
"""
Views = Sequence[Sequence[Planes]]
"""Tangent planes of every frame, by camera."""


def common_size(views: Views, recording: Recording) -> float:
    """Longest edge of the box around the body at frame 0, in the unit of the poses, once the views agree. Raises
    UserInputError where the views contradict each other; names the camera if without it they do not.

    They are compared at the first, the middle and the last frame.
    """
    gap = largest_gap(views)
    wrong = odd_one_out(views, gap, GAP) if gap > GAP else None
    if wrong is not None:
        name = recording.cameras[wrong].name
        raise UserInputError(
            f"{recording.source}: camera {name} disagrees with the other views: its pose, its lens, its clock or its "
            f"matte is wrong; calibrate it again, give its masks or background plate, or use --leave_out {name}"
        )
    if gap > GAP:
        raise UserInputError(
            f"{recording.source}: the outlines of the views do not belong to one body in space. Poses may be wrong: "
            "rotations transposed, world to camera instead of camera to world, axes or videos mirrored, cameras "
            "swapped, camera positions given for translations, calibration of other videos; or the lenses; or the "
            "mattes of several views, then give masks or background plates"
        )
    lower, upper = bounds(Planes.of([view[0] for view in views]))
    return float((upper - lower).max())


def check_in_front(sightings: Sequence[Sighting], recording: Recording) -> None:
    """The body lies before the cameras, not behind them. Raises UserInputError where it is behind most of them."""
    place = nearest_point(sightings)
    behind = [float((place - sighting.pose[:, 3]) @ sighting.pose[:, 2]) > 0.0 for sighting in sightings]
    if sum(behind) > len(behind) / 2:
        raise UserInputError(
            f"{recording.source}: what {sum(behind)} of {len(behind)} cameras show meets behind them; the layout "
            f"{recording.layout} has other camera axes, OpenGL's (looking along -z) for OpenCV's (along +z) or the "
            "reverse (turn y and z of each pose round), or poses are world to camera instead of camera to world"
        )


def check_different(images: Sequence[Sequence[Path]], recording: Recording) -> None:
    """No two cameras show the same first and last image. Raises UserInputError."""
    seen: dict[bytes, str] = {}
    for camera, own in zip(recording.cameras, images, strict=True):
        shown = own[0].read_bytes() + own[-1].read_bytes()
        if shown in seen:
            raise UserInputError(
                f"{recording.source}: cameras {seen[shown]} and {camera.name} show the same images; copy the right "
                f"ones, or use --leave_out {camera.name}"
            )
        seen[shown] = camera.name


def odd_one_out(views: Views, gap: float, limit: float) -> int | None:
    """The view without which the others agree, or do so twice as well; None where no view alone is to blame. ``gap`` is
    that between all of them, ``limit`` that of right ones.
    """
    if len(views) < ENOUGH:
        return None
    without = [largest_gap([*views[:number], *views[number + 1 :]]) for number in range(len(views))]
    best = int(np.argmin(without))
    return best if without[best] < max(limit, 0.5 * gap) else None


def largest_gap(views: Views) -> float:
    """How far views contradict each other in the first, the middle or the last frame: the largest rms distance of a
    view's planes from what all views allow, relative to the body; infinite where they allow nothing.
    """
    last = len(views[0]) - 1
    return max(_gap([view[frame] for view in views]) for frame in (0, last // 2, last))


def _gap(planes: Sequence[Planes]) -> float:
    """Largest rms distance of a view's planes from what all allow, relative to its size; infinite for nothing."""
    together = Planes.of(planes)
    centre, radius = ball(together)
    if not (radius > 0 and np.isfinite(radius)):
        return float("inf")
    try:
        corners = HalfspaceIntersection(np.column_stack((together.normals, -together.offsets)), centre).intersections
    except QhullError:  # numerically flat
        return float("inf")
    size = float(np.ptp(corners, axis=0).max())
    gaps = [view.offsets - (view.normals @ corners.T).max(axis=1) for view in planes if len(view.offsets)]
    return max(float(np.sqrt(np.mean(gap**2))) for gap in gaps) / size
