"""Mattes from videos without plates, made again with what the other views say about them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pacnerf_lpo.data.images import read_png
from pacnerf_lpo.data.recordings.clocks import Clocks, nearest_point
from pacnerf_lpo.data.recordings.mattes import Mattes
from pacnerf_lpo.data.recordings.other_views import Silhouettes, expectations
from pacnerf_lpo.data.recordings.shots import Shots, look, synchronised
from pacnerf_lpo.data.recordings.written_scene import View

ROUNDS = 6
"""How often at most: in a round, right views correct a wrong one by a few pixels along its rim."""
SETTLED = 0.995
"""Overlap of mattes with those of the round before, from which on nothing more is gained: a pixel in two hundred."""


def refined(
    folder: Path,
    mattes: Sequence[Mattes],
    stamps: Sequence[np.ndarray],
    size: tuple[int, int],
    shots: list[Shots],
    clocks: Clocks,
) -> tuple[list[Shots], Clocks]:
    """The shots and clocks with better mattes, where these come from the videos alone and views agree in the main.

    Args:
        folder: of the matted images. mattes: of each camera. stamps: times of its frames [s, (F,)].
        size: width and height to which images are extended [pixels].
        shots, clocks: as they are with mattes of single views.
    """
    if all(matted.still is None for matted in mattes):
        return shots, clocks
    views = [_silhouettes(*each) for each in zip(mattes, shots, clocks.offsets, strict=True)]
    for _ in range(ROUNDS):
        found = expectations(views, nearest_point([shot.sighting for shot in shots]))
        better = [one is not None and matted.still is not None for one, matted in zip(found, mattes, strict=True)]
        if not any(better):
            break
        for view, (matted, one) in enumerate(zip(mattes, found, strict=True)):
            if one is not None and better[view]:
                numbers = np.arange(len(matted.camera.frames))
                nearest = np.abs(shots[view].frames - numbers[:, None]).argmin(axis=1)
                matted.correct_background(one.at(nearest), views[view].masks[nearest])
                shots[view] = look(folder, view, matted, stamps[view], size)
        shots, clocks = synchronised(shots)
        before, views = views, [_silhouettes(*each) for each in zip(mattes, shots, clocks.offsets, strict=True)]
        if min(_overlap(*pair) for pair in zip(before, views, strict=True)) > SETTLED:
            break
    return shots, clocks


def _overlap(one: Silhouettes, other: Silhouettes) -> float:
    """Intersection over union of all frames together; 0 where their number has changed."""
    if one.masks.shape != other.masks.shape:
        return 0.0
    return float((one.masks & other.masks).sum() / max((one.masks | other.masks).sum(), 1))


def _silhouettes(mattes: Mattes, shots: Shots, offset: float) -> Silhouettes:
    camera, (width, height) = mattes.camera, mattes.size
    masks = np.stack([read_png(image)[:height, :width, 3] > 0.5 for image in shots.images])
    view = View(0, camera.name, camera.intrinsic, camera.pose, mattes.lens.valid, None)
    return Silhouettes(view, shots.sighting.times + offset, masks)
