"""Does every training view show the object, and the box around it? Checked on the loaded video, before training."""

import logging
from collections.abc import Sequence

import numpy as np

from pacnerf_lpo.data.cameras import hits_box, pixel_rays
from pacnerf_lpo.data.measurements import TrackedPoints
from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.types import Box, Video

log = logging.getLogger(__name__)

FULL_IMAGE = 0.98
"""A silhouette that covers more of the image than this has no background."""
POINT_MARGIN = 0.1
"""A tracked point may start so far outside the box, as part of its diagonal."""
OUTSIDE_WARNING = 0.01
"""Fraction of a frame-0 silhouette that may lie outside the box before a warning."""
OUTSIDE_ERROR = 0.99
"""Fraction beyond which the object counts as missed."""
AXES_AND_UNITS = (
    "most likely axes or units differ: y must point up, cameras look along -z (OpenGL), poses and box are in metres; "
    "if so they are, move the box to the object"
)
"""What is wrong where every view misses the box: one wrong number of a box rarely does that."""


def check_visible(video: Video, train: Sequence[int]) -> None:
    """Every training view (index) shows the object on white at the first frame; later it may leave the image."""
    for index in train:
        view, shown = video.view_ids[index], (video.silhouettes[index] > 0.5).flatten(1).any(dim=1)
        if not shown.any():
            raise UserInputError(
                f"{video.source}: view {view} never shows the object (all its images are white); leave it out of "
                "data.train_views or mend its images"
            )
        if not shown[0]:
            raise UserInputError(
                f"{video.source}: view {view} shows no object at frame {video.frame_ids[0]}, where the shape is learnt"
                "; leave it out of data.train_views or mend that image"
            )
        if video.silhouettes[index, 0].mean() > FULL_IMAGE:
            raise UserInputError(
                f"{video.source}: view {view} has no background at frame {video.frame_ids[0]}; matted images need the "
                "object on pure white, raw ones (data.background: raw) the background plate of the same camera"
            )


def check_points_in_box(tracks: TrackedPoints, video: Video, box: Box) -> None:
    """Tracked points that are seen at frame 0 lie in the box, or near it."""
    early = tracks.seen_until(float(video.times[0]))
    names, rows = np.unique(early.ids, return_index=True)
    lower, upper = np.array(box.lower), np.array(box.upper)
    outside = np.maximum(lower - early.positions[rows], early.positions[rows] - upper).max(1, initial=-np.inf)
    if len(names) and outside.max() > POINT_MARGIN * float(np.linalg.norm(upper - lower)):
        worst = int(outside.argmax())
        raise UserInputError(
            f"{tracks.source}: id {names[worst]} is {outside[worst]:.3g} m outside the box of the object at frame "
            f"{video.frame_ids[0]}, {list(box.lower)} to {list(box.upper)} m; check units, axes (y is up) and the clock"
        )


def check_box_seen(video: Video, box: Box, train: Sequence[int]) -> None:
    """Every training view (index) sees the box; a warning where part of the object lies outside it at frame 0."""
    size, seen = video.images.shape[2:4], {}
    for index in train:
        rays = pixel_rays(video.intrinsics[index], video.camera_to_world[index], *size)
        seen[video.view_ids[index]] = hits_box(rays, box)
    corners = f"{list(box.lower)} to {list(box.upper)} m"
    blind = ", ".join(str(view) for view, inside in seen.items() if not inside.any())
    if not any(inside.any() for inside in seen.values()):
        raise UserInputError(
            f"{video.source}: no training view sees the box data.box_lower, data.box_upper = {corners}; "
            f"{AXES_AND_UNITS}"
        )
    if blind:
        raise UserInputError(
            f"data.box_lower, data.box_upper: training view {blind} does not see the box {corners}; move the box to "
            "the object or leave the view out"
        )
    outside = {}
    for index in train:
        silhouette, view = video.silhouettes[index, 0].flatten() > 0.5, video.view_ids[index]
        outside[view] = float((silhouette & ~seen[view]).sum() / silhouette.sum())
    if min(outside.values()) > OUTSIDE_ERROR:
        raise UserInputError(
            f"{video.source}: the box data.box_lower, data.box_upper = {corners} misses the object in every training "
            f"view at frame 0; {AXES_AND_UNITS}"
        )
    worst = max(outside, key=lambda view: outside[view])
    if outside[worst] > OUTSIDE_WARNING:
        log.warning(
            f"data.box_lower, data.box_upper: {100 * outside[worst]:.0f}% of the object in view {worst} at frame 0 "
            f"lies outside the box {corners}; enlarge it, or that part cannot be learnt"
        )
