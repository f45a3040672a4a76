"""Mattes from videos without plates, made again with what the other views say about them."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from pacnerf_lpo.data.recordings.background import colours_by_views
from pacnerf_lpo.data.recordings.clocks import Clocks, nearest_point
from pacnerf_lpo.data.recordings.footage import factor_of, reduced
from pacnerf_lpo.data.recordings.mattes import Mattes
from pacnerf_lpo.data.recordings.other_views import Expectation, Silhouettes, expectations
from pacnerf_lpo.data.recordings.shots import Shots, look, synchronised
from pacnerf_lpo.data.recordings.written_scene import View
from pacnerf_lpo.heartbeat import doing

CLEAR = 0.98
"""Expected overlap of mattes by colours alone, below which the other views are asked: of a body forty pixels wide, less
than a fifth of a pixel is unsure all around then."""
ROUNDS = 6
"""How often at most: in a round, right views correct a wrong one by a few pixels along its rim."""
PASSES = 3
"""How often at most clocks are measured again by better mattes, and these made by the better clocks."""
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
    ``folder``, ``stamps`` [s, (F,)] and ``size`` are those of :func:`~pacnerf_lpo.data.recordings.shots.look`.
    """
    if all(matted.still is None for matted in mattes):
        return shots, clocks
    for _ in range(PASSES):
        centre, times = nearest_point([shot.sighting for shot in shots]), _times(mattes, shots, clocks)
        views = [_silhouettes(*pair) for pair in zip(mattes, times, strict=True)]
        if any(np.abs(own - given).max() > 0.5 * clocks.step for own, given in zip(times, stamps, strict=True)):
            as_stamped = [replace(view, times=given) for view, given in zip(views, stamps, strict=True)]
            views = min((as_stamped, views), key=lambda way: _disagreement(expectations(way, centre)))
        corrected = _corrected(mattes, views, centre)
        if not corrected:
            break
        doing("matting the videos")
        for view in corrected:
            mattes[view].enlarge_background()
            shots[view] = look(folder, view, mattes[view], stamps[view], size)
        shots, clocks = synchronised(shots)
        now = _times(mattes, shots, clocks)
        if all(np.abs(view.times - own).max() < 0.5 * clocks.step for view, own in zip(views, now, strict=True)):
            break
    return shots, clocks


def _times(mattes: Sequence[Mattes], shots: Sequence[Shots], clocks: Clocks) -> list[np.ndarray]:
    """When each camera's frames were taken, its clock corrected by whole frames [s, (F,) each].

    Mattes that are wrong look like those of a moment nearby, so fractions wait until they are right.
    """
    offsets = clocks.step * np.round(clocks.offsets / clocks.step)
    return [
        np.interp(np.arange(len(matted.camera.frames)), shot.frames, shot.sighting.times) + offset
        for matted, shot, offset in zip(mattes, shots, offsets, strict=True)
    ]


def _corrected(mattes: Sequence[Mattes], views: Sequence[Silhouettes], centre: np.ndarray) -> set[int]:
    """Correct masks by those of the other views as long as that changes something; the views that were corrected."""
    corrected: set[int] = set()
    for _ in range(ROUNDS):
        doing("comparing the views")
        found = expectations(views, centre)
        for matted, one in zip(mattes, found, strict=True):
            matted.compared |= one is not None
        if not any(_doubtful(*pair) for pair in zip(mattes, found, strict=True)):
            break
        asked = {v: one for v, one in enumerate(found) if one is not None and mattes[v].still is not None}
        colours = {view: colours_by_views(mattes[view].footage, one, mattes[view].masks) for view, one in asked.items()}
        for view, one in asked.items():
            others = [colours[other] for other in asked if other != view]
            mattes[view].correct(one, colours[view].shared_with(others) if others else colours[view])
        corrected |= set(asked)
        before, views = views, [replace(view, masks=m.masks) for view, m in zip(views, mattes, strict=True)]
        if min(_overlap(old.masks, new.masks) for old, new in zip(before, views, strict=True)) > SETTLED:
            break
    return corrected


def _disagreement(found: Sequence[Expectation | None]) -> float:
    """How much the views contradict each other, all together."""
    return sum(1.0 if one is None else one.contradicted for one in found)


def _doubtful(mattes: Mattes, expected: Expectation | None) -> bool:
    """Whether a camera's colours leave doubts, or the other views."""
    if mattes.still is None or expected is None:
        return False
    return expected.contradicted > 1.0 - SETTLED or float(mattes.overlaps.mean()) < CLEAR


def _overlap(one: np.ndarray, other: np.ndarray) -> float:
    """Intersection over union of all frames together."""
    return float((one & other).sum() / max((one | other).sum(), 1))


def _silhouettes(mattes: Mattes, times: np.ndarray) -> Silhouettes:
    camera, finer = mattes.camera, factor_of(mattes.lens.valid.shape)
    intrinsic = camera.intrinsic / [[finer], [finer], [1.0]]
    view = View(0, camera.name, intrinsic, camera.pose, reduced(mattes.lens.valid) > 0.5, None)
    return Silhouettes(view, times, mattes.masks)
