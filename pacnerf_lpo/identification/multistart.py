"""Looks at the parameter space beyond a local fit: the whole of it on a coarse body before, the next valleys after."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence

import numpy as np
import torch
from scipy.stats import qmc

from pacnerf_lpo.errors import SimulationError
from pacnerf_lpo.identification.forward_model import Model
from pacnerf_lpo.identification.least_squares import LONGEST_STEP, Fit, Residual, fit_or_none
from pacnerf_lpo.identification.processes import each
from pacnerf_lpo.mpm.parameters import Log10, Parameter
from pacnerf_lpo.mpm.physics import GROUND_HEIGHT

LOCAL_ITERATIONS = 5
GENERATIONS, CHILDREN, ELITE = 3, 8, 6  # children for each parameter
FIRST_REACH = 0.12
"""Standard deviation of the first generation's steps, as a part of the span."""
APART = 0.2
"""Of its span in one of the coordinates that are searched: so far apart lie the starts of local fits."""
HALVINGS = 1
"""Of the time step: what needs a finer one is not worth its time here."""
FIRST_AFTER_CONTACT = 2
"""Frames that the first fits of :func:`grown` see after the first contact."""
RIVAL = 2.0
"""Of the misfit of the best: a fit that ends at more is not followed."""
NEXT_VALLEY = 0.2
"""Of a log10 parameter: the next valley of a modulus is about so far away, where the body rebounds a frame later."""
MUCH_LOWER = 0.9
"""Of the misfit: a fit from another start that is so much better has found a better valley."""
Watch = Callable[[Iterator[float], int], Iterable[float]]
WatchStarts = Callable[[Iterator[np.ndarray], int], Iterable[np.ndarray]]


def span(parameter: Parameter, start: float, decades: float) -> tuple[float, float] | None:
    """Free coordinates between which a parameter is searched; None where there is nothing to search.

    Args:
        parameter: what is searched.
        start: free coordinate of the guess.
        decades: log10 parameters, to either side.
    """
    low, high = parameter.bounds
    lattice = [
        point
        for point in parameter.transform.lattice(start, decades)
        if low < float(parameter.transform.to_physical(torch.tensor(point, dtype=torch.float64))) < high
    ]
    return (min(lattice), max(lattice)) if len(lattice) > 1 else None


def points(model: Model, spans: Mapping[str, tuple[float, float]], samples: int) -> list[np.ndarray]:
    """The guess, then quasi-random points within the spans, everything else as at the guess [(K,) each]."""
    found = [model.start.copy()]
    if spans:
        for sample in qmc.Sobol(len(spans), seed=0).random(samples):
            point = model.start.copy()
            for (name, (low, high)), share in zip(spans.items(), sample, strict=True):
                point[model.names.index(name)] = low + share * (high - low)
            found.append(point)
    return found


def promising(
    model: Model,
    residual: Residual,
    tried: Sequence[np.ndarray],
    spans: Mapping[str, tuple[float, float]],
    starts: int,
    watch: Watch = lambda losses, _: losses,
) -> list[np.ndarray]:
    """The best few points, and where a short local fit leads from each; none if the motion is unstable at all of them.

    The points are followed by generations around the best of them, each half as far: valleys are narrow, and few points
    of a whole space fall into one. The best are kept apart, because a coarse body may like the wrong valley more.

    Args:
        model: of a coarse body.
        residual: of its free coordinates.
        tried: points to try [(K,) each]
        spans: of the coordinates that are searched.
        starts: how many of the best are improved.
        watch: passes losses on as they come; told how many, such as tqdm.
    """
    model.physics.most_halvings = HALVINGS
    known = _ranked(_losses(model, residual, tried, watch))
    random = np.random.default_rng(0)
    reach = FIRST_REACH * _widths(model, spans, 0.0)
    for _ in range(GENERATIONS if spans else 0):
        elite = _apart(known, ELITE, reach)
        around = [
            elite[k % len(elite)] + reach * random.standard_normal(len(reach))
            for k in range(CHILDREN * len(spans))
            if elite
        ]
        inside = [np.clip(point, *model.bounds) for point in around]
        known = _ranked([*known, *_losses(model, residual, inside, watch)])
        reach = reach / 2
    best = _apart(known, starts, reach)
    settings = model.scales, model.bounds, LOCAL_ITERATIONS
    improved = each(fit_or_none, ((residual, point, *settings) for point in best))
    return [*best, *(found.free for found in improved if found is not None)]


def shortlist(
    model: Model,
    residual: Residual,
    tried: Sequence[np.ndarray],
    spans: Mapping[str, tuple[float, float]],
    count: int,
    watch: Watch = lambda losses, _: losses,
) -> list[np.ndarray]:
    """The best points of those that lie well apart in the space that is searched, best first.

    Args:
        model: whose free coordinates they are.
        residual: of the free coordinates.
        tried: points to try [(K,) each]; those with an unstable motion are left out.
        spans: of the coordinates that are searched; neighbours are closer than :data:`APART` of it in all of them.
        count: at most so many.
        watch: as for :func:`promising`.
    """
    model.physics.most_halvings = HALVINGS
    ranked = _ranked(_losses(model, residual, tried, watch))
    return _apart(ranked, count, APART * _widths(model, spans, np.inf))


def best_fits(model: Model, residual: Residual, starts: Iterable[np.ndarray], iterations: int) -> list[Fit]:
    """Short fits, best first; one that stays above the best misfit so far is given up.

    Args:
        model: whose free coordinates are fitted.
        residual: of the free coordinates.
        starts: points within the bounds [(K,) each]; one with an unstable motion is left out.
        iterations: of each fit, at most.
    """
    fits: list[Fit] = []
    for start in starts:
        model.physics.halvings = 0
        hopeless = min((other.misfit for other in fits), default=None)
        tried = fit_or_none(residual, start, model.scales, model.bounds, iterations, hopeless)
        if tried is not None:
            fits.append(tried)
    return sorted(fits, key=lambda found: found.misfit)


def rivals(
    model: Model,
    residual: Residual,
    starts: Sequence[np.ndarray],
    iterations: int,
    watch: WatchStarts = lambda starts, _: starts,
) -> list[Fit]:
    """Short fits that end apart from one another, and not at a misfit :data:`RIVAL` times as large; best first.

    Args:
        model, residual, iterations: as for :func:`best_fits`.
        starts: points [(K,) each]; one with an unstable motion is left out.
        watch: passes starts on as they come; told how many, such as tqdm.
    """
    inside = [np.clip(start, *model.bounds) for start in starts]
    fits = best_fits(model, residual, watch(iter(inside), len(inside)), iterations)
    kept: list[Fit] = []
    for found in fits:
        near = found.misfit <= RIVAL * fits[0].misfit
        if near and _is_apart(found.free, [other.free for other in kept], LONGEST_STEP * model.scales):
            kept.append(found)
    return kept


def horizons(contact: int, frames: int) -> list[int]:
    """Numbers of frames of fits that take in more and more after contact, half as many again each time, up to all."""
    after, found = FIRST_AFTER_CONTACT, []
    while contact + after < frames:
        found.append(contact + after)
        after += max(after // 2, 1)
    return [*found, frames]


def grown(
    stages: Iterable[tuple[Model, Residual]],
    starts: Sequence[np.ndarray],
    iterations: int,
    watch: WatchStarts = lambda starts, _: starts,
) -> list[Fit]:
    """Where fits lead that begin with the first frames after contact and take in more and more; the rivals, best first.

    A motion soon depends so strongly on a modulus that the misfit of a whole video has a valley for every bounce and
    every turn. That of the first frames has one, and whoever is at its bottom stays in the right valley.

    Args:
        stages: models and the residuals of their free coordinates, each with more frames than the one before.
        starts: points to begin with [(K,) each]
        iterations: of each fit in each stage, at most.
        watch: as for :func:`rivals`.
    """
    fits: list[Fit] = []
    for model, residual in stages:
        fits = rivals(model, residual, starts, iterations, watch)
        starts = [found.free for found in fits]
    return fits


def best_fitted(model: Model, residual: Residual, found: Iterable[np.ndarray], entrants: int) -> np.ndarray:
    """Where the best of short fits leads [(K,)], from the model's own start and from points found on another body.

    Misfits of points tell little where valleys are narrow: a point in the right valley may lie farther from the bottom
    than one in a wrong valley does. Of the points found, the best few enter that differ by more than a step of a fit;
    one that stays above the best misfit so far is given up. The start itself where the motion is unstable everywhere.

    Args:
        model: whose free coordinates are fitted; the ground of the points found is put back to where its start has it.
        residual: of the free coordinates.
        found: points [(K,) each]
        entrants: how many of them are fitted at most, beside the start.
    """
    inside = _inside(model, found)
    losses = each(loss, ((model, residual, point) for point in inside))
    ranked = _ranked(zip(losses, inside, strict=True))
    starts = (*_apart(ranked, entrants, LONGEST_STEP * model.scales), model.start)
    fits = best_fits(model, residual, starts, LOCAL_ITERATIONS)
    return fits[0].free if fits else model.start


def _inside(model: Model, found: Iterable[np.ndarray]) -> list[np.ndarray]:
    """Points within the bounds of a model, with its ground."""
    ground = [model.names.index(name) for name in (GROUND_HEIGHT.name,) if name in model.names]
    inside = [np.clip(point, *model.bounds) for point in found]
    for point in inside:
        point[ground] = model.start[ground]
    return inside


def best_beside(
    model: Model,
    names: Collection[str],
    residual: Residual,
    best: Fit,
    iterations: int,
    reach: float = NEXT_VALLEY,
) -> Fit:
    """The best of fits that start beside another one; that one itself where the motion is unstable at every start.

    Args:
        model: whose free coordinates are fitted.
        names: unknowns of which each that is searched by its logarithm is made larger and smaller, one at a time.
        residual: of the free coordinates.
        best: the fit to start beside; a start that stays far above its misfit is given up.
        iterations: of each fit, at most.
        reach: by how much the logarithm changes.
    """
    starts = []
    for index, unknown in enumerate(model.unknowns):
        if isinstance(unknown.transform, Log10) and unknown.name in names:
            for sign in (-1.0, 1.0):
                start = best.free.copy()
                start[index] += sign * reach
                starts.append(np.clip(start, *model.bounds))
    settings = model.scales, model.bounds, iterations, best.misfit
    found = each(fit_or_none, ((residual, start, *settings) for start in starts))
    return min((other for other in found if other is not None), key=lambda other: other.misfit, default=best)


def _widths(model: Model, spans: Mapping[str, tuple[float, float]], otherwise: float) -> np.ndarray:
    """Width of the span of every unknown [(K,)], and of one that is not searched."""
    return np.array([np.ptp(spans[name]) if name in spans else otherwise for name in model.names])


def _losses(
    model: Model, residual: Residual, tried: Sequence[np.ndarray], watch: Watch
) -> Iterator[tuple[float, np.ndarray]]:
    """The loss at every point [(K,) each], and the point."""
    losses = each(loss, ((model, residual, point) for point in tried))
    return zip(watch(losses, len(tried)), tried, strict=True)


def loss(model: Model, residual: Residual, point: np.ndarray) -> float:
    """Sum of squares; infinite where the motion is unstable."""
    model.physics.halvings = 0
    try:
        return float(np.sum(residual(point) ** 2))
    except SimulationError:
        return np.inf


def _ranked(entries: Iterable[tuple[float, np.ndarray]]) -> list[tuple[float, np.ndarray]]:
    """Best first, the unstable left out."""
    return sorted((entry for entry in entries if np.isfinite(entry[0])), key=lambda entry: entry[0])


def _apart(known: Sequence[tuple[float, np.ndarray]], count: int, reach: np.ndarray) -> list[np.ndarray]:
    """The best points, of neighbours only the better one: those that differ by less than ``reach`` in everything."""
    chosen: list[np.ndarray] = []
    for _, point in known:
        if len(chosen) < count and _is_apart(point, chosen, reach):
            chosen.append(point)
    return chosen


def _is_apart(point: np.ndarray, others: Sequence[np.ndarray], reach: np.ndarray) -> bool:
    return all((np.abs(point - other) > reach).any() for other in others)
