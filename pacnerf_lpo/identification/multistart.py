"""Least squares with many local minima: one search from many points, whose stages are data.

The cost of a whole video has a minimum for every bounce and turn of the body; that of the first frames after contact
has one, and whoever is at its bottom stays near the right minimum as more frames are taken in. So a stage names a
residual (of a coarse body first, of a fine one last) and the rows of it that are taken in one after the other.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import qmc

from pacnerf_lpo.errors import SimulationError
from pacnerf_lpo.identification.least_squares import LONGEST_STEP, Bounds, Effort, Fit, Residual, Start, fit_or_none
from pacnerf_lpo.identification.processes import each

FIRST_AFTER_CONTACT = 2
"""Frames after the first contact that a search begins with: a stiffness shows in the second, not in the first."""
Watch = Callable[[Iterable, int], Iterable]


@dataclass(frozen=True)
class Stage:
    """One stage of a search; it begins with what the stage before it kept.

    residual: of free coordinates [(K,)] to [(D,)]; may raise SimulationError.
    scales, bounds: of the coordinates [(K,)], [(K,), (K,)], as for :func:`~.least_squares.fit`.
    rows: which rows count, as a list [(D,), bool]. Fits go through it, each from where the one before ended. Points
        that are only evaluated are ranked by each, and the best of each are kept. None in it: all rows.
    keep: at most so many points or fits (evaluated points: by each of ``rows``).
    iterations: of a fit of each of ``rows``, at most; 0: points are evaluated only.
    spans: coordinates, by their index, that this stage tries elsewhere, each between two ends.
    samples: so many quasi-random points within the spans are tried, besides what was kept.
    offsets: changes of each coordinate of ``spans``, one at a time, at the best of what was kept; tried besides.
    apart: two points or fits are the same if they differ by less in all coordinates [(K,)]; None: by the longest first
        step of a fit, which a fit from one of them bridges at once.
    within: a point or fit above this multiple of the best cost is not kept; None: all are.
    confirm: a fit ends only with a Jacobian that was measured there.
    """

    residual: Residual
    scales: np.ndarray
    bounds: Bounds
    rows: Sequence[np.ndarray | None] = (None,)
    keep: int = 1
    iterations: int = 0
    spans: Mapping[int, tuple[float, float]] | None = None
    samples: int = 0
    offsets: Sequence[float] = ()
    apart: np.ndarray | None = None
    within: float | None = None
    confirm: bool = False


@dataclass(frozen=True)
class Search:
    """Where a search ended.

    fits: that the last stage kept, best first; empty where every motion was unstable.
    rollouts: how often a residual was computed.
    unstable: how many points were left out because the motion is unstable there.
    """

    fits: list[Fit]
    rollouts: int
    unstable: int


def multistart(stages: Iterable[Stage], starts: Sequence[Start], watch: Watch = lambda items, _: items) -> Search:
    """Go through the stages; one in which every motion is unstable is passed over.

    Args:
        stages: in their order, for instance coarse bodies before fine ones; made when they are needed.
        starts: points to begin with [(K,) each], or fits.
        watch: passes points on as they are tried; receives their number, such as tqdm.
    """
    kept, rollouts, unstable = list(starts), 0, 0
    fits: list[Fit] = []
    for stage in stages:
        tried = [*kept, *_elsewhere(stage, kept)]
        found = _fitted(stage, tried, watch) if stage.iterations else _evaluated(stage, tried, watch)
        rollouts += sum(other.rollouts if other else 1 for other in found)
        fits = _kept(stage, [other for other in found if other is not None]) or fits
        unstable += sum(other is None for other in found)
        kept = list(fits) or kept
    return Search(fits, rollouts, unstable)


def horizons(contact: int, frames: int) -> list[int]:
    """Numbers of frames that are taken in one after the other: half of the fall, in which a body may turn only once,
    then twice as many after contact each time, up to all.
    """
    after, found = FIRST_AFTER_CONTACT, [contact // 2 + 1] if 2 <= contact < frames else []
    while contact + after < frames:
        found.append(contact + after)
        after *= 2
    return [*found, frames]


def _elsewhere(stage: Stage, kept: Sequence[Start]) -> list[np.ndarray]:
    """Points that a stage tries besides those that were kept [(K,) each]."""
    if not stage.spans or not kept:
        return []
    best, places = _free(kept[0]), list(stage.spans)
    low, high = np.array(list(stage.spans.values())).T
    sampled = np.tile(best, (stage.samples, 1))
    if stage.samples:
        sampled[:, places] = low + qmc.Sobol(len(places), seed=0).random(stage.samples) * (high - low)
    moved = [best + offset * axis for axis in np.eye(len(best))[places] for offset in stage.offsets]
    return [*sampled, *moved]


def _evaluated(stage: Stage, tried: Sequence[Start], watch: Watch) -> list[Fit | None]:
    known = [replace(s, rollouts=0) for s in tried if isinstance(s, Fit) and s.of == stage.residual]
    points = [np.clip(_free(s), *stage.bounds) for s in tried if not (isinstance(s, Fit) and s.of == stage.residual)]
    return [*known, *watch(each(_value, ((stage.residual, point) for point in points)), len(points))]


def _value(residual: Residual, point: np.ndarray) -> Fit | None:
    """A fit of no steps; None where the motion is unstable."""
    try:
        return Fit(point, residual(point), rollouts=1)
    except SimulationError:
        return None


def _fitted(stage: Stage, tried: Sequence[Start], watch: Watch) -> list[Fit | None]:
    """Fits from every start; one that stays far above the best one so far is given up. What a stage before this one has
    fitted by the same residual stays as it is.
    """
    found: list[Fit | None] = []
    lowest = [np.inf] * len(stage.rows)
    for start in watch(tried, len(tried)):
        if isinstance(start, Fit) and start.of == stage.residual and start.jacobian is not None:
            found.append(replace(start, rollouts=0))
            lowest[-1] = min(start.cost_of(stage.rows[-1]), lowest[-1])
        else:
            found.append(_through(stage, start, lowest))
    return found


def _through(stage: Stage, start: Start, lowest: list[float]) -> Fit | None:
    """Fits of the rows of a stage one after the other; None where the motion is unstable.

    ``lowest`` is the least cost of each so far, and is kept up to date.
    """
    now, used, ended = start, 0, None
    for place, rows in enumerate(stage.rows):
        confirm = stage.confirm and place == len(stage.rows) - 1
        effort = Effort(stage.iterations, lowest[place], confirm)
        ended = fit_or_none(stage.residual, now, stage.scales, stage.bounds, effort, rows=rows)
        if ended is None:
            return None
        now, used, lowest[place] = ended, used + ended.rollouts, min(ended.cost_of(rows), lowest[place])
    return replace(ended, rollouts=used) if ended else None


def _kept(stage: Stage, found: Sequence[Fit]) -> list[Fit]:
    """The best, of those that are nearly the same only the best one."""
    apart = LONGEST_STEP * stage.scales if stage.apart is None else stage.apart
    chosen: list[Fit] = []
    for rows in stage.rows[-1:] if stage.iterations else stage.rows:
        ranked = sorted(found, key=lambda other: other.cost_of(rows))
        most = len(chosen) + stage.keep
        for other in ranked:
            near = stage.within is None or other.cost_of(rows) <= stage.within * ranked[0].cost_of(rows)
            new = all((np.abs(other.free - one.free) > apart).any() for one in chosen)
            if len(chosen) < most and near and new:
                chosen.append(other)
    return chosen


def _free(start: Start) -> np.ndarray:
    return start.free if isinstance(start, Fit) else start
